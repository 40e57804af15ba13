//! Unit tests of the bent link: its equations against each other, its energy and the linear model.

use crate::model::arm_model::ArmModel;
use crate::model::bending::{Bent, Given};
use crate::model::bent_forward::BentArm;
use crate::model::configuration::{Configuration, State, Surface};
use crate::model::energy::energy;
use crate::model::forward::{Actuation, Workspace, forward};
use crate::model::link::{LinkDamping, LinkKind, LinkModel};
use crate::model::link_dynamics::{Required, required};
use crate::testing;
use flexor::model::JointMotion;
use nalgebra::DVector;
use proptest::prelude::*;

const fn kind(model: LinkModel, damping: LinkDamping) -> LinkKind {
    LinkKind { model, damping }
}

const KINDS: [LinkKind; 4] = {
    let bending = LinkDamping::Bending {
        time_s: Some(0.0029),
    };
    [
        kind(LinkModel::Linear, LinkDamping::Modal),
        kind(LinkModel::Linear, bending),
        kind(LinkModel::Geometric, LinkDamping::Modal),
        kind(LinkModel::Geometric, bending),
    ]
};

/// A state away from every symmetry, with slopes of some `bend` rad.
fn state(model: &ArmModel, bend: f64) -> Vec<f64> {
    let n = model.dof();
    let wave = |i: usize, size: f64| size * libm::sin(1.0 + 1.7 * i as f64);
    let nodal = |size: f64| {
        DVector::from_fn(n, |i, _| match i % 2 == 1 && i + 1 < n {
            true => wave(i, 0.1 * size),
            false => wave(i, size),
        })
    };
    let modal = |size: f64| (&model.coordinates * nodal(size)).as_slice().to_vec();
    [vec![0.9, -0.6, 0.7, -1.3], modal(bend), modal(4.0 * bend)].concat()
}

/// What the motion with these accelerations takes.
fn needed(
    model: &ArmModel,
    state: State<'_, f64>,
    acceleration: [f64; 2],
    q_acceleration: &[f64],
    force: [f64; 2],
) -> Required<f64> {
    let [w, w_t, w_tt] = [state.q(), state.q_rate(), q_acceleration].map(|q| model.deflection(q));
    let nodal = Given([w.as_slice(), w_t.as_slice(), w_tt.as_slice()]);
    let joint = JointMotion {
        angle: state.angle(),
        rate: state.rate(),
        acceleration,
    };
    let configuration = Configuration::new(model, joint.angle);
    let bent = Bent::new(&model.link, &nodal);
    required(model, &bent, &joint, &configuration, force)
}

#[test]
fn forward_dynamics_of_the_linear_model_are_the_same_equations() {
    for arm in testing::arms() {
        for kind in &KINDS[..2] {
            let model = ArmModel::of_kind(&arm, 4, *kind).unwrap();
            let state = state(&model, 0.3);
            let state = State(state.as_slice());
            let surface = Surface {
                normal: [0.6, 0.8],
                offset_m: 0.0,
            };
            let drive = Actuation {
                torque: [-3.0, 0.4],
                geometric_stiffness: false,
            };
            let mut q_acceleration = vec![0.0; model.dof()];
            let mut workspace = Workspace::new(&model);
            let (acceleration, force) = forward(
                &model,
                &surface,
                state,
                &drive,
                &mut workspace,
                &mut q_acceleration,
            );
            let pressed = surface.normal.map(|n| n * force);
            let found = needed(&model, state, acceleration, &q_acceleration, pressed);
            for (a, b) in found.torque.iter().zip(drive.torque) {
                assert!((a - b).abs() < 1e-9, "{:?}", found.torque);
            }
            let most = q_acceleration.iter().fold(1.0, |m: f64, a| m.max(a.abs()));
            assert!(residual(found).iter().all(|r| r.abs() < 1e-12 * most));
        }
    }
}

/// What is left of the unknowns' equations when joint 2 gives its torque.
fn residual(needed: Required<f64>) -> Vec<f64> {
    let mut elastic = needed.elastic;
    elastic[0] -= needed.root * needed.torque[1];
    elastic
}

#[test]
fn the_mass_matrix_is_that_of_the_equations() {
    // It is symmetric by its making; that it solves the equations for every torque and force makes the
    // equations' own symmetric.
    let mut q_acceleration;
    for arm in testing::arms() {
        for kind in KINDS {
            let model = ArmModel::of_kind(&arm, 4, kind).unwrap();
            let state = state(&model, 0.3);
            let state = State(state.as_slice());
            let mut bent = BentArm::new(&model);
            q_acceleration = vec![0.0; model.dof()];
            for (torque, force) in [
                ([0.0, 0.0], [0.0, 0.0]),
                ([3.0, 0.0], [0.0, 1.0]),
                ([0.0, 2.0], [0.0, 0.0]),
                ([-1.0, 0.3], [5.0, 0.0]),
            ] {
                bent.shape(&model, state);
                let at = Configuration::new(&model, state.angle());
                let found =
                    bent.under_force(&model, &at, state, torque, force, &mut q_acceleration);
                let needed = needed(&model, state, found.angle, &q_acceleration, force);
                let most = q_acceleration.iter().fold(1.0, |m: f64, a| m.max(a.abs()));
                for (found, given) in needed.torque.iter().zip(torque) {
                    assert!(
                        (found - given).abs() < 1e-13 * most,
                        "{found} {given} {most:e}"
                    );
                }
                let left = residual(needed)
                    .iter()
                    .fold(0.0, |m: f64, r| m.max(r.abs()));
                assert!(left < 1e-13 * most, "{kind:?}: {left:e} of {most:e}");
            }
        }
    }
}

#[test]
fn on_a_surface_the_tip_keeps_its_height_and_the_force_is_the_one_that_it_takes() {
    for arm in testing::arms() {
        let model = ArmModel::of_kind(&arm, 3, KINDS[2]).unwrap();
        let state = state(&model, 0.3);
        let state = State(state.as_slice());
        let surface = Surface {
            normal: [0.28, 0.96],
            offset_m: 0.1,
        };
        let (mut on, mut under) = (BentArm::new(&model), BentArm::new(&model));
        let [mut a, mut b] = [(); 2].map(|()| vec![0.0; model.dof()]);
        let found = on.on_surface(&model, &surface, state, |_| [-3.0, 0.4], &mut a);
        let pressed = surface.normal.map(|n| found.force * n);
        under.shape(&model, state);
        let at = Configuration::new(&model, state.angle());
        let same = under.under_force(&model, &at, state, [-3.0, 0.4], pressed, &mut b);
        assert!((found.angle[0] - same.angle[0]).abs() < 1e-9 * found.angle[0].abs());
        // The tip's acceleration along the normal, from the chord's and the joints'.
        let [w, w_t, w_tt] = [state.q(), state.q_rate(), &a].map(|q| model.deflection(q));
        let nodal = Given([w.as_slice(), w_t.as_slice(), w_tt.as_slice()]);
        let bent = Bent::new(&model.link, &nodal);
        let joint = JointMotion {
            angle: state.angle(),
            rate: state.rate(),
            acceleration: found.angle,
        };
        let [_, _, tip] = crate::model::chord::forward_motion(&arm, bent.chord, &joint);
        let across = surface.normal[0] * tip[0] + surface.normal[1] * tip[1];
        assert!(across.abs() < 1e-9 * tip[0].abs().max(1.0), "{across:e}");
    }
}

#[test]
fn energy_changes_by_what_torques_and_damping_do() {
    // The equations are the energy's own: its rate along the motion, by differences.
    for arm in testing::arms() {
        for kind in KINDS {
            let model = ArmModel::of_kind(&arm, 3, kind).unwrap();
            let n = model.dof();
            let begin = state(&model, 0.3);
            let view = State(begin.as_slice());
            let torque = [2.0, -0.7];
            let mut bent = BentArm::new(&model);
            let mut q_acceleration = vec![0.0; n];
            bent.shape(&model, view);
            let at = Configuration::new(&model, view.angle());
            let found = bent.under_force(&model, &at, view, torque, [0.0; 2], &mut q_acceleration);
            let mut rate = [view.rate().to_vec(), found.angle.to_vec()].concat();
            rate.extend(view.q_rate());
            rate.extend(&q_acceleration);
            let [_, [_, root_rate]] = bent.shape(&model, view);
            let [rate1, rate2] = view.rate();
            let given = torque[0] * rate1 + torque[1] * (rate2 + root_rate - rate1);
            // What damping takes: what its forces would take alone.
            let [w, w_t] = [view.q(), view.q_rate()].map(|q| model.deflection(q));
            let still = DVector::zeros(n);
            let elastic = |w_t: &DVector<f64>| {
                let nodal = Given([w.as_slice(), w_t.as_slice(), still.as_slice()]);
                DVector::from_vec(Bent::new(&model.link, &nodal).elastic)
            };
            let lost = (elastic(&w_t) - elastic(&still)).dot(&w_t);
            let at = |h: f64| {
                let moved: Vec<f64> = begin.iter().zip(&rate).map(|(x, v)| x + h * v).collect();
                energy(&model, State(&moved))
            };
            let h = 1e-6;
            let change = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            let size = given.abs() + lost.abs();
            assert!(lost > 0.0);
            assert!(
                (change - given + lost).abs() < 1e-8 * size,
                "{kind:?} {change} {given} {lost}"
            );
        }
    }
}

proptest! {
    /// The exact link bends like the linear one where it bends little: what tells them apart is of second
    /// order.
    #[test]
    fn what_tells_the_models_apart_is_of_second_order(elements in 1..6_usize, up: bool) {
        let arm = testing::arms()[usize::from(up)];
        let of = |kind| ArmModel::of_kind(&arm, elements, kind).unwrap();
        let (linear, geometric) = (of(KINDS[0]), of(KINDS[2]));
        let difference = |bend: f64| {
            let state = state(&linear, bend);
            let state = State(state.as_slice());
            let zeros = vec![0.0; linear.dof()];
            let [a, b] = [&linear, &geometric].map(|model| {
                needed(model, state, [1.0, -2.0], &zeros, [0.3, 2.0])
            });
            // The axial load's geometric stiffness is of first order, and no part of the linear model: take
            // what is left of tau2, which does not feel it.
            (a.torque[1] - b.torque[1]).abs()
        };
        let ratio = difference(2e-3) / difference(1e-3);
        prop_assert!((ratio.log2() - 2.0).abs() < 0.1, "{ratio}");
    }
}

//! The bench's plant with the geometrically exact link.

use crate::model::arm_model::ArmModel;
use crate::model::configuration::{State, Surface};
use crate::model::dual::Dual;
use crate::model::energy::energy;
use crate::model::link::{LinkKind, LinkModel};
use crate::plant::bench::*;
use crate::plant::{Plant, PlantParameters};
use crate::testing;
use flexor::model::ArmParameters;
use flexor::number::Real;

/// Where the paper's path starts.
const PLANE: Surface = Surface {
    normal: [0.0, 1.0],
    offset_m: 0.05,
};
const PERIOD_S: f64 = 1.0 / 5000.0;
const FORCE_N: f64 = 2.0;
const EXACT: LinkKind = LinkKind {
    model: LinkModel::Geometric,
    damping: crate::model::link::LinkDamping::Modal,
};

fn ideal() -> CompliantParameters {
    CompliantParameters::ideal(SurfaceProfile::flat(PLANE))
}

fn rough() -> CompliantParameters {
    let mut parameters = ideal();
    parameters.contact.friction = 0.2;
    parameters.contact.friction_at_rest = 0.3;
    parameters.joints[1].friction.coulomb_nm = 0.02;
    parameters.joints[1].friction.breakaway_nm = 0.03;
    parameters.joints[0].cogging.amplitude_nm = 0.1;
    parameters.joints[1].rotor_inertia_kgm2 = 3e-5;
    parameters.joints[1].play = Some(GearPlay {
        play_rad: 1e-3,
        stiffness_nm_rad: 200.0,
        damping_nms_rad: 0.01,
    });
    parameters
}

fn resting(
    arm: &ArmParameters,
    parameters: &CompliantParameters,
    link: LinkKind,
) -> (CompliantPlant<f64>, RestState, ArmModel) {
    let model = parameters.model(arm, 4, link).unwrap();
    let start = parameters.rest(&model, 0.7, FORCE_N).unwrap();
    let arm = CompliantArm {
        model: &model,
        parameters,
        start: &start,
    };
    let plant = CompliantPlant::new(&[arm], PERIOD_S, &[]).unwrap();
    (plant, start, model)
}

#[test]
fn it_starts_at_its_own_equilibrium_with_the_tip_of_a_shorter_chord_in_its_place() {
    for parameters in [ideal(), rough()] {
        let (mut plant, start, _) = resting(&testing::PAPER, &parameters, EXACT);
        let first = plant.read();
        assert!((first.force - FORCE_N).abs() < 1e-9);
        assert!((first.tip[0] - 0.7).abs() < 1e-12);
        let (sine, cosine) = libm::sincos(first.angle[0]);
        let chord = libm::hypot(first.tip[0] - 0.5 * cosine, first.tip[1] - 0.5 * sine);
        // A cantilever that a force across its tip bends is shorter by a tenth of its squared root slope; its
        // weight adds to that.
        let shorter = 0.1 * first.root_slope * first.root_slope;
        assert!(
            shorter > 2e-3 && (chord / 0.55 - (1.0 - shorter)).abs() < 0.4 * shorter,
            "{chord} {shorter}"
        );
        for _ in 0..500 {
            plant.advance(start.torque);
        }
        let after = plant.read();
        assert!((after.force - FORCE_N).abs() < 1e-6, "{}", after.force);
        assert!((after.tip[0] - 0.7).abs() < 1e-7, "{}", after.tip[0]);
        assert!(after.rate.iter().all(|rate| rate.abs() < 1e-5));
    }
}

#[test]
fn it_rests_in_the_air_as_far_off_as_it_is_told() {
    let parameters = ideal();
    let model = parameters.model(&testing::PAPER, 4, EXACT).unwrap();
    let near = model
        .kinematics
        .inverse([0.7, 0.05], testing::PAPER.elbow)
        .unwrap();
    let start = parameters.rest_above(&model, near, 0.02).unwrap();
    let arm = CompliantArm {
        model: &model,
        parameters: &parameters,
        start: &start,
    };
    let mut plant = CompliantPlant::<f64>::new(&[arm], PERIOD_S, &[]).unwrap();
    for _ in 0..200 {
        plant.advance(start.torque);
    }
    let seen = plant.read();
    assert!((seen.depth + 0.02).abs() < 1e-8, "{}", seen.depth);
    // What a gauge sees: at rest the root's moment is the motor's torque.
    assert!((seen.root_moment - start.torque[1]).abs() < 1e-8);
}

#[test]
fn on_a_very_stiff_surface_it_is_the_rigid_plant() {
    let mut parameters = ideal();
    // So stiff that 2 N press it in by 0.2 micrometres, and damped as the contact is.
    parameters.contact.stiffness_n_m = 1e7;
    let (mut plant, start, model) = resting(&testing::PAPER, &parameters, EXACT);
    let rigid = PlantParameters {
        elements: 4,
        ..PlantParameters::default()
    };
    let state = start.state[..4 + 2 * model.dof()].to_vec();
    let mut rigid = Plant::new(model, &rigid, PLANE, PERIOD_S, state).unwrap();
    // Joint 1 pulls harder: the tip slides off along the surface.
    let torque = [start.torque[0] + 2.0, start.torque[1] + 0.05];
    for _ in 0..1000 {
        plant.advance(torque);
        rigid.advance(torque);
    }
    let (a, b) = (plant.read(), rigid.read(torque));
    assert!((a.angle[0] - b.angle[0]).abs() < 2e-6, "{a:?} {b:?}");
    assert!((a.angle[1] - b.angle[1]).abs() < 2e-6, "{a:?} {b:?}");
    assert!((a.root_slope - b.root_slope).abs() < 2e-5, "{a:?} {b:?}");
    assert!((b.angle[0] - start.state[0]).abs() > 1e-2);
}

#[test]
fn it_keeps_its_energy_through_bounces() {
    let undamped = ArmParameters {
        damping_ratio: 0.0,
        ..testing::PAPER
    };
    let drift = |substeps: u32| {
        let mut parameters = ideal();
        parameters.contact.damping_ns_m = 0.0;
        parameters.contact.stiffness_n_m = 2e3;
        parameters.substeps = Some(substeps);
        let (mut plant, _, model) = resting(&undamped, &parameters, EXACT);
        let total = |plant: &mut CompliantPlant<f64>| {
            let state = plant.state(0);
            let depth = plant.read().depth.max(0.0);
            energy(&model, State(&state[..4 + 2 * model.dof()])) + 1e3 * depth * depth
        };
        let before = total(&mut plant);
        // Without torque: it falls onto the surface and bends.
        let mut most: f64 = 0.0;
        for _ in 0..500 {
            plant.advance([0.0; 2]);
            most = most.max((total(&mut plant) - before).abs());
        }
        most
    };
    let (coarse, fine) = (drift(8), drift(32));
    assert!(fine < 1e-7 && fine < coarse / 8.0, "{coarse:e} {fine:e}");
}

#[test]
fn a_stiff_link_is_a_linear_one() {
    // 100 times as stiff it bends by 2 mrad, and the chord is shorter by 1e-7 of its length.
    let stiff = ArmParameters {
        bending_stiffness_nm2: 48.0,
        ..testing::PAPER
    };
    let seen = [LinkKind::default(), EXACT].map(|link| {
        let (mut plant, start, _) = resting(&stiff, &ideal(), link);
        for _ in 0..200 {
            plant.advance([start.torque[0] + 0.3, start.torque[1] + 0.1]);
        }
        plant.read()
    });
    let [a, b] = seen;
    assert!((a.angle[0] - b.angle[0]).abs() < 1e-5, "{a:?} {b:?}");
    assert!((a.root_moment - b.root_moment).abs() < 2e-3 * a.root_moment.abs());
    assert!((a.force - b.force).abs() < 2e-3 * a.force, "{a:?} {b:?}");
}

#[test]
fn each_lane_has_the_bits_of_a_plant_alone() {
    let parameters = rough();
    let arms: Vec<ArmParameters> = (0..4)
        .map(|i| ArmParameters {
            bending_stiffness_nm2: 0.48 + 0.02 * f64::from(i),
            link2_length_m: 0.55 - 1e-3 * f64::from(i),
            ..testing::PAPER
        })
        .collect();
    let mut parameters = parameters;
    parameters.substeps = Some(3);
    let models: Vec<ArmModel> = arms
        .iter()
        .map(|arm| parameters.model(arm, 3, EXACT).unwrap())
        .collect();
    let starts: Vec<RestState> = models
        .iter()
        .map(|model| parameters.rest(model, 0.7, FORCE_N).unwrap())
        .collect();
    let arm = |i: usize| CompliantArm {
        model: &models[i],
        parameters: &parameters,
        start: &starts[i],
    };
    let all: Vec<_> = (0..4).map(arm).collect();
    let mut four = CompliantPlant::<F64x4>::new(&all, PERIOD_S, &[]).unwrap();
    for _ in 0..40 {
        four.advance([3.0, -0.2].map(F64x4::from_f64));
    }
    for i in 0..4 {
        let mut alone = CompliantPlant::<f64>::new(&[arm(i)], PERIOD_S, &[]).unwrap();
        for _ in 0..40 {
            alone.advance([3.0, -0.2]);
        }
        let bits = |state: Vec<f64>| state.into_iter().map(f64::to_bits).collect::<Vec<_>>();
        assert_eq!(bits(four.state(i)), bits(alone.state(0)), "lane {i}");
        assert_eq!(four.outputs().lane(i), alone.read());
    }
}

#[test]
fn it_gives_its_own_linearisation() {
    let parameters = ideal();
    let model = parameters.model(&testing::arms()[1], 3, EXACT).unwrap();
    let place = testing::arms()[1].link1_length_m + 0.2;
    let start = parameters.rest(&model, place, FORCE_N).unwrap();
    let state = &start.state[..4 + 2 * model.dof()];
    let plane = PressedPlane {
        normal: PLANE.normal,
        offset_m: PLANE.offset_m,
        stiffness_n_m: parameters.contact.stiffness_n_m,
        damping_ns_m: parameters.contact.damping_ns_m,
        friction: 0.1,
        stuck: None,
    };
    let mut slope = vec![0.0; state.len()];
    let at = |state: &[f64], slope: &mut [f64]| {
        let mut arm = PressedArm::<f64>::new(&model, false, Some(plane));
        arm.derivative(state, start.torque, slope)
    };
    for column in 0..state.len() {
        let seeded: Vec<Dual<1>> = (0..state.len())
            .map(|i| Dual::with_slopes(state[i], [f64::from(u8::from(i == column))]))
            .collect();
        let mut exact = vec![Dual::<1>::ZERO; state.len()];
        let mut arm = PressedArm::<Dual<1>>::new(&model, false, Some(plane));
        let seen = arm.derivative(&seeded, start.torque.map(Dual::from_f64), &mut exact);
        let step = 1e-6;
        let mut beside = |sign: f64| {
            let mut moved = state.to_vec();
            moved[column] += sign * step;
            let seen = at(&moved, &mut slope);
            (slope.clone(), seen.root_moment, seen.motor_angle[1])
        };
        let ((high, moment_high, motor_high), (low, moment_low, motor_low)) =
            (beside(1.0), beside(-1.0));
        let largest = exact
            .iter()
            .fold(1.0, |most: f64, x| most.max(x.slopes()[0].abs()));
        for (exact, (high, low)) in exact.iter().zip(high.iter().zip(&low)) {
            let difference = (high - low) / (2.0 * step);
            let off = (exact.slopes()[0] - difference).abs();
            assert!(off < 1e-5 * largest, "{column}: {exact:?} {difference}");
        }
        let off = (seen.root_moment.slopes()[0] - (moment_high - moment_low) / (2.0 * step)).abs();
        assert!(off < 1e-5 * largest, "{column} {off}");
        let off = (seen.motor_angle[1].slopes()[0] - (motor_high - motor_low) / (2.0 * step)).abs();
        assert!(off < 1e-6, "{column} {off}");
    }
}

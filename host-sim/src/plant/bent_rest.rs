//! Where an arm with a bent link rests: with its tip on a surface, under given torques.

use crate::model::arm_model::ArmModel;
use crate::model::bending::{Bent, Given};
use crate::model::chord::forward_motion;
use crate::model::configuration::{Configuration, Surface};
use crate::model::dual::Dual;
use crate::model::link_dynamics::required;
use flexor::model::JointMotion;
use flexor::number::Real;
use nalgebra::{DMatrix, DVector};

/// Derivatives that are computed at a time.
const LANES: usize = 8;

/// Joint angles (rad) and nodal unknowns of `model`'s arm at rest with `torque` (N m) on its joints and its
/// tip on `surface`, near the joint angles `near`. `None` where it has no rest there.
pub(super) fn rest_under(
    model: &ArmModel,
    surface: &Surface,
    torque: [f64; 2],
    near: [f64; 2],
) -> Option<([f64; 2], Vec<f64>)> {
    const STEPS_MAX: usize = 60;
    /// Largest step of an angle, rad, and of a slope: what rests elsewhere is not meant.
    const STEP_MAX: f64 = 0.2;
    let n = model.dof();
    // Angles, unknowns, contact force.
    let mut x = DVector::zeros(n + 3);
    x.rows_mut(0, 2).copy_from_slice(&near);
    let scale = |i: usize| match i {
        i if i == n + 2 => f64::INFINITY,
        _ => STEP_MAX,
    };
    for _ in 0..STEPS_MAX {
        let (left, by_x) = residual(model, surface, torque, &x);
        let step = by_x.lu().solve(&left)?;
        if !step.iter().all(|step| step.is_finite()) {
            return None;
        }
        let most = (0..n + 3)
            .map(|i| step[i].abs() / scale(i))
            .fold(0.0, f64::max);
        x -= &step / most.max(1.0);
        if step.rows(0, n + 2).amax() < 1e-12 {
            return Some(([x[0], x[1]], x.rows(2, n).as_slice().to_vec()));
        }
    }
    None
}

/// What is left of the equations at rest, and its derivatives.
fn residual(
    model: &ArmModel,
    surface: &Surface,
    torque: [f64; 2],
    x: &DVector<f64>,
) -> (DVector<f64>, DMatrix<f64>) {
    let size = x.len();
    let mut left = DVector::zeros(size);
    let mut by_x = DMatrix::zeros(size, size);
    let zeros = vec![Dual::<LANES>::ZERO; size - 3];
    for from in (0..size).step_by(LANES) {
        let seeded: Vec<Dual<LANES>> = (0..size)
            .map(|i| {
                Dual::with_slopes(
                    x[i],
                    core::array::from_fn(|lane| f64::from(u8::from(from + lane == i))),
                )
            })
            .collect();
        let (angle, w, force) = (
            [seeded[0], seeded[1]],
            &seeded[2..size - 1],
            seeded[size - 1],
        );
        let joint = JointMotion {
            angle,
            ..JointMotion::default()
        };
        let bent = Bent::new(&model.link, &Given([w, &zeros, &zeros]));
        let configuration = Configuration::new(model, angle);
        let pressed = surface.normal.map(|n| force.scaled(n));
        let needed = required(model, &bent, &joint, &configuration, pressed);
        let [tip, ..] = forward_motion(&model.arm, bent.chord, &joint);
        let distance = tip[0].scaled(surface.normal[0]) + tip[1].scaled(surface.normal[1])
            - Dual::from_f64(surface.offset_m);
        let given = torque.map(Dual::from_f64);
        let mut rows = vec![needed.torque[0] - given[0], needed.torque[1] - given[1]];
        rows.extend(&needed.elastic);
        rows[2] -= needed.root * given[1];
        rows.push(distance);
        for (i, row) in rows.iter().enumerate() {
            left[i] = row.value();
            for (column, slope) in (from..size).zip(row.slopes()) {
                by_x[(i, column)] = *slope;
            }
        }
    }
    (left, by_x)
}

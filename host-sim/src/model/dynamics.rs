//! The linear model's equations of motion in modal coordinates, exact for a linear-elastic beam (eq. 5-11 with
//! every term of second order in the deflection kept; `docs/model.md` derives them).
//!
//! With `c = cos theta21`, `s = sin theta21` and a dot for a time derivative, the
//! acceleration of joint 2 along n(theta20) and e(theta20) is
//! `A_n = r1 (theta10'' c + theta10'^2 s)` and `A_e = r1 (theta10'' s - theta10'^2 c)`.
//! In modal coordinates `q` (unit mass; `b`, `p`: first and second moments, `e`: root
//! slopes, `m`: the mass matrix without root and tip inertia):
//!
//! ```text
//! q:       q'' + p theta20'' - theta20'^2 m q + b A_n = b g_n - k q - d q' + e tau2
//! theta20: J2 theta20'' + p.q'' + S2 A_n + 2 (q.m q') theta20' + (q.m q) theta20''
//!          - (b.q) A_e = S2 g_n - (b.q) g_e + tau2 - r2 f_n
//! theta10: J1 theta10'' + r1 (c F_n + s F_e) = G1 n1.g + tau1 - tau2 - r1 n1.f
//!          F_n = S2 theta20'' + b.q'' - (b.q) theta20'^2 + m2 A_n
//!          F_e = -S2 theta20'^2 - 2 (b.q') theta20' - (b.q) theta20'' + m2 A_e
//! ```
//!
//! (G1: the first moment of all that joint 1 carries without link 2's own share,
//! which F brings.) tau2 turns the root's tangent, `theta20 + e.q`; f is the force of
//! the tip on the surface.
//!
//! They are what `link_dynamics` has for the linear model, in coordinates in which mass,
//! stiffness and damping are diagonal. [`crate::model::forward`] solves them for the accelerations and
//! the contact force, generic over the scalar so that exact derivatives can be had from dual numbers;
//! here is what they say at rest.

use crate::model::arm_model::{ArmModel, dot};
use crate::model::configuration::Configuration;
use flexor::number::Real;
use nalgebra::{DMatrix, DVector};

/// `a.m b` with the translating mass: unit modal mass less root and tip inertia.
pub(super) fn translating<T: Real>(model: &ArmModel, a: &[T], b: &[T]) -> T {
    let pairs = a.iter().zip(b);
    let mut sum = pairs.fold(T::ZERO, |sum, (a, b)| sum + *a * *b);
    for (inertia, slope) in end_inertias(model) {
        sum -= T::from_f64(inertia) * dot(slope, a) * dot(slope, b);
    }
    sum
}

/// Inertias that turn with an end of the beam, and that end's slopes; zeros left out.
pub(super) fn end_inertias(model: &ArmModel) -> impl Iterator<Item = (f64, &[f64])> {
    [
        (model.arm.root_inertia_kgm2, model.root_slope.as_slice()),
        (model.arm.tip_inertia_kgm2, model.tip_slope.as_slice()),
    ]
    .into_iter()
    .filter(|(inertia, _)| *inertia != 0.0)
}

/// Modal coordinates of the arm at rest with the tip pressing with `force` (N,
/// inertial axes), and the torques (tau1, tau2), N m, that hold it. `geometric`
/// includes the axial force's effect on the stiffness.
///
/// `None` where the load makes the beam buckle exactly.
pub fn equilibrium(
    model: &ArmModel,
    angle: [f64; 2],
    force: [f64; 2],
    geometric: bool,
) -> Option<(Vec<f64>, [f64; 2])> {
    let configuration = Configuration::new(model, angle);
    let Configuration { g_n, g_n1, g_e, .. } = configuration;
    let pressed = model.arm.link2_length_m * configuration.along_n2(force);
    let n = model.dof();
    let mut stiffness = DMatrix::from_fn(n, n, |i, j| {
        -model.root_slope[i] * g_e * model.first_moment[j]
    });
    for i in 0..n {
        stiffness[(i, i)] += model.stiffness[i];
    }
    if geometric {
        stiffness -= &model.geometric_tip * configuration.along_e2(force);
        stiffness += &model.geometric_axial * g_e;
    }
    // What joint 2 holds of the straight link.
    let straight = pressed - model.link2_moment * g_n;
    let load = DVector::from_fn(n, |i, _| {
        model.first_moment[i] * g_n + model.root_slope[i] * straight
    });
    let q = stiffness.lu().solve(&load)?.as_slice().to_vec();
    let tau2 = straight + dot(&model.first_moment, &q) * g_e;
    let tau1 = tau2 - model.joint1_moment * g_n1
        + model.arm.link1_length_m * configuration.along_n1(force);
    Some((q, [tau1, tau2]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::configuration::{State, Surface};
    use crate::model::forward::{Actuation, Workspace, forward};
    use crate::testing;

    #[test]
    fn at_equilibrium_nothing_accelerates() {
        for arm in testing::arms() {
            for geometric in [false, true] {
                let model = ArmModel::new(&arm, 5).unwrap();
                let angle = [0.9, -0.6];
                let surface = Surface {
                    normal: [0.28, 0.96],
                    offset_m: 0.0,
                };
                let pressed = surface.normal.map(|n| 1.7 * n);
                let (q, torque) = equilibrium(&model, angle, pressed, geometric).unwrap();
                let mut state = vec![angle[0], angle[1], 0.0, 0.0];
                state.extend(q);
                state.extend(vec![0.0; model.dof()]);
                let mut q_acceleration = vec![0.0; model.dof()];
                let drive = Actuation {
                    torque,
                    geometric_stiffness: geometric,
                };
                let mut workspace = Workspace::new(&model);
                let (acceleration, force) = forward(
                    &model,
                    &surface,
                    State(&state),
                    &drive,
                    &mut workspace,
                    &mut q_acceleration,
                );
                assert!((force - 1.7).abs() < 1e-9, "{force}");
                assert!(
                    acceleration
                        .iter()
                        .chain(&q_acceleration)
                        .all(|a| a.abs() < 1e-6)
                );
            }
        }
    }
}

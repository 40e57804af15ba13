//! The arm's equations of motion, exact for a linear-elastic beam (eq. 5-11 with
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
//! [`crate::model::forward`] solves them for the accelerations and the contact force; [`inverse`]
//! for the torques; [`deflection_equation`] is the one that is left when tau2 is
//! eliminated, the planner's boundary-value problem. Everything is generic over the
//! scalar so that exact derivatives can be had from dual numbers.

use crate::model::arm_model::{ArmModel, NodalBeam, dot};
use crate::model::configuration::{Configuration, State};
use flexor::model::JointMotion;
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

/// Motion of the whole arm at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Motion<'a, T> {
    /// Link angles, rates and accelerations.
    pub joint: JointMotion<T>,
    /// The configuration at those angles; costs four trigonometric functions, so it is shared.
    pub configuration: Configuration<T>,
    /// Modal coordinates.
    pub q: &'a [T],
    /// Their rates, 1/s.
    pub q_rate: &'a [T],
    /// Their accelerations, 1/s^2.
    pub q_acceleration: &'a [T],
}

/// Torques (tau1, tau2), N m, that sustain `motion` while the tip presses with
/// `force` (N, inertial axes) on the surface.
///
/// tau2 comes from the theta20 equation; the `q` equations hold by themselves when
/// the motion satisfies [`deflection_equation`] ([`elastic_residual`] measures it).
pub fn inverse<T: Real>(model: &ArmModel, motion: &Motion<'_, T>, force: [T; 2]) -> [T; 2] {
    let c64 = T::from_f64;
    let two = c64(2.0);
    let configuration = motion.configuration;
    let [rate1, rate2] = motion.joint.rate;
    let [acceleration1, acceleration2] = motion.joint.acceleration;
    let r1 = c64(model.arm.link1_length_m);
    let r2 = c64(model.arm.link2_length_m);
    let s2 = c64(model.link2_moment);
    let (c, s) = (configuration.c, configuration.s);

    let a_n = r1 * (acceleration1 * c + rate1 * rate1 * s);
    let a_e = r1 * (acceleration1 * s - rate1 * rate1 * c);
    let bq = dot(&model.first_moment, motion.q);
    let bq_rate = dot(&model.first_moment, motion.q_rate);
    let bq_acceleration = dot(&model.first_moment, motion.q_acceleration);

    let tau2 = c64(model.link2_inertia) * acceleration2
        + dot(&model.second_moment, motion.q_acceleration)
        + s2 * (a_n - configuration.g_n)
        + two * translating(model, motion.q, motion.q_rate) * rate2
        + translating(model, motion.q, motion.q) * acceleration2
        - bq * (a_e - configuration.g_e)
        + r2 * configuration.along_n2(force);

    let m2 = c64(model.link2_mass);
    let inertial_n = s2 * acceleration2 + bq_acceleration - bq * rate2 * rate2 + m2 * a_n;
    let inertial_e = -(s2 * rate2 * rate2) - two * bq_rate * rate2 - bq * acceleration2 + m2 * a_e;
    let tau1 = c64(model.link1_inertia) * acceleration1 + r1 * (c * inertial_n + s * inertial_e)
        - c64(model.joint1_moment) * configuration.g_n1
        + tau2
        + r1 * configuration.along_n1(force);
    [tau1, tau2]
}

/// What is left of the `q` equations for `motion` and `tau2` (N m): zero, mode by
/// mode, for a motion that the torques sustain.
pub fn elastic_residual(model: &ArmModel, motion: &Motion<'_, f64>, tau2: f64) -> Vec<f64> {
    let configuration = motion.configuration;
    let [rate1, rate2] = motion.joint.rate;
    let [acceleration1, acceleration2] = motion.joint.acceleration;
    let a_n = model.arm.link1_length_m
        * (acceleration1 * configuration.c + rate1 * rate1 * configuration.s);
    let ends: Vec<_> = end_inertias(model)
        .map(|(inertia, slope)| (inertia * dot(slope, motion.q), slope))
        .collect();
    (0..model.dof())
        .map(|i| {
            let translating = motion.q[i] - ends.iter().map(|(x, slope)| x * slope[i]).sum::<f64>();
            motion.q_acceleration[i] + model.second_moment[i] * acceleration2
                - rate2 * rate2 * translating
                + model.first_moment[i] * (a_n - configuration.g_n)
                + model.stiffness[i] * motion.q[i]
                + model.damping[i] * motion.q_rate[i]
                - model.root_slope[i] * tau2
        })
        .collect()
}

/// The beam's equations with tau2 eliminated (eq. 14, exact), at one instant of a
/// prescribed tip motion, for nodal deflections `w` (with `M_t` the mass matrix without
/// root and tip inertia, and E = (1, 0, ..., 0)):
///
/// ```text
/// (M - E <rho B>) w'' = constant - D w' - K w + rate2^2 M_t w
///                       + E [load <B>.w + 2 rate2 w.M_t w' + acceleration2 w.M_t w]
/// ```
///
/// Its zeros come in real pairs of either sign: it must be solved as a boundary-value
/// problem. In nodal coordinates, because the matrix on the left is nearly singular (its
/// determinant against M's is 0.42, 2e-3 and 2e-5 for 3, 8 and 12 elements): here tau2
/// acts on one row, in modal coordinates on all of them, and with 12 elements
/// elimination then loses every digit.
#[derive(Clone, Debug)]
pub struct DeflectionEquation {
    /// The part without `w`, row by row.
    pub constant: DVector<f64>,
    /// theta20's rate, rad/s.
    pub rate2: f64,
    /// theta20's acceleration, rad/s^2; zero where the quadratic terms are left out.
    pub quadratic_acceleration: f64,
    /// theta20's rate in the quadratic term; zero where that is left out.
    pub quadratic_rate: f64,
    /// `load`, the axial specific force g_e - A_e on link 2, m/s^2.
    pub load: f64,
}

/// Sets up [`DeflectionEquation`] for a joint motion, its configuration and a contact force (N, inertial
/// axes). With `as_printed`, the terms that eq. 14 leaves out are left out: the axial
/// load and everything of second order in the deflection.
pub fn deflection_equation(
    model: &ArmModel,
    joint: &JointMotion<f64>,
    configuration: &Configuration<f64>,
    force: [f64; 2],
    as_printed: bool,
) -> DeflectionEquation {
    let [rate1, rate2] = joint.rate;
    let [acceleration1, acceleration2] = joint.acceleration;
    let r1 = model.arm.link1_length_m;
    let a_n = r1 * (acceleration1 * configuration.c + rate1 * rate1 * configuration.s);
    let a_e = r1 * (acceleration1 * configuration.s - rate1 * rate1 * configuration.c);
    let across = configuration.g_n - a_n;
    let root = model.link2_inertia * acceleration2 - model.link2_moment * across
        + model.arm.link2_length_m * configuration.along_n2(force);
    let mut constant =
        &model.nodal.first_moment * across - &model.nodal.second_moment * acceleration2;
    constant[0] += root;
    let kept = if as_printed { 0.0 } else { 1.0 };
    DeflectionEquation {
        constant,
        rate2,
        quadratic_acceleration: kept * acceleration2,
        quadratic_rate: kept * rate2,
        load: kept * (configuration.g_e - a_e),
    }
}

impl DeflectionEquation {
    /// The right-hand side for `w` and its rate, and its derivatives by both.
    pub fn linearise(
        &self,
        model: &ArmModel,
        w: &[f64],
        w_rate: &[f64],
        value: &mut [f64],
        by_w: &mut DMatrix<f64>,
        by_rate: &mut DMatrix<f64>,
    ) {
        let NodalBeam {
            translating_mass,
            stiffness,
            damping,
            first_moment,
            ..
        } = &model.nodal;
        let squared = self.rate2 * self.rate2;
        by_w.zip_zip_apply(stiffness, translating_mass, |x, k, m| *x = squared * m - k);
        by_rate.zip_apply(damping, |x, d| *x = -d);

        // Symmetric matrices: columns are rows.
        let row = |matrix: &DMatrix<f64>, i: usize, x: &[f64]| {
            dot(&matrix.as_slice()[i * x.len()..][..x.len()], x)
        };
        // E comes last: so far the matrices are symmetric.
        for (i, value) in value.iter_mut().enumerate() {
            *value = self.constant[i] + row(by_w, i, w) + row(by_rate, i, w_rate);
        }
        let mut root = 0.0;
        for i in 0..w.len() {
            let (mass_w, mass_rate) = (
                row(translating_mass, i, w),
                row(translating_mass, i, w_rate),
            );
            let (by_q, by_v) = (self.quadratic_acceleration, 2.0 * self.quadratic_rate);
            root += (self.load * first_moment[i] + by_v * mass_rate + by_q * mass_w) * w[i];
            by_w[(0, i)] += self.load * first_moment[i] + by_v * mass_rate + 2.0 * by_q * mass_w;
            by_rate[(0, i)] += by_v * mass_w;
        }
        value[0] += root;
    }
}

/// `M - E <rho B>`, the matrix of `w''` in [`DeflectionEquation`].
pub fn eliminated_mass(model: &ArmModel) -> DMatrix<f64> {
    let mut matrix = model.nodal.mass.clone();
    let mut row = matrix.row_mut(0);
    row -= model.nodal.second_moment.transpose();
    matrix
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
    let joint = JointMotion {
        angle,
        ..JointMotion::default()
    };
    let configuration = Configuration::new(model, angle);
    let equation = deflection_equation(model, &joint, &configuration, force, false);
    let n = model.dof();
    let mut stiffness = DMatrix::from_fn(n, n, |i, j| {
        -model.root_slope[i] * equation.load * model.first_moment[j]
    });
    for i in 0..n {
        stiffness[(i, i)] += model.stiffness[i];
    }
    if geometric {
        stiffness -= &model.geometric_tip * configuration.along_e2(force);
        stiffness += &model.geometric_axial * configuration.g_e;
    }
    let q = stiffness
        .lu()
        .solve(&model.shapes.tr_mul(&equation.constant))?
        .as_slice()
        .to_vec();
    let zeros = vec![0.0; n];
    let motion = Motion {
        joint,
        configuration,
        q: &q,
        q_rate: &zeros,
        q_acceleration: &zeros,
    };
    let torque = inverse(model, &motion, force);
    Some((q, torque))
}

/// Kinetic energy plus elastic and gravitational potential, J, of the arm in `state`.
/// Without the geometric stiffness, which has no potential in this formulation.
pub fn energy(model: &ArmModel, state: State<'_, f64>) -> f64 {
    let configuration = Configuration::new(model, state.angle());
    let [rate1, rate2] = state.rate();
    let (q, q_rate) = (state.q(), state.q_rate());
    let r1 = model.arm.link1_length_m;
    let (c, s) = (configuration.c, configuration.s);
    let bq = dot(&model.first_moment, q);
    let kinetic = 0.5 * (model.link1_inertia + model.link2_mass * r1 * r1) * rate1 * rate1
        + r1 * (model.link2_moment * c - bq * s) * rate1 * rate2
        + 0.5 * (model.link2_inertia + translating(model, q, q)) * rate2 * rate2
        + r1 * c * rate1 * dot(&model.first_moment, q_rate)
        + rate2 * dot(&model.second_moment, q_rate)
        + 0.5 * dot(q_rate, q_rate);
    let elastic: f64 = q
        .iter()
        .zip(&model.stiffness)
        .map(|(q, k)| 0.5 * k * q * q)
        .sum();
    let g = model.arm.gravity_m_s2;
    let gravity = -model.joint1_moment * (g[0] * configuration.e1[0] + g[1] * configuration.e1[1])
        - model.link2_moment * configuration.g_e
        - bq * configuration.g_n;
    kinetic + elastic + gravity
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::configuration::Surface;
    use crate::model::forward::{Actuation, Workspace, forward};
    use crate::testing;

    /// A state away from every symmetry, on the surface's position level.
    fn state(model: &ArmModel) -> Vec<f64> {
        let mut state = vec![0.9, -0.6, 0.7, -1.3];
        state.extend((0..model.dof()).map(|i| 0.02 / (1 + i * i) as f64));
        state.extend((0..model.dof()).map(|i| 0.3 / (1 + i) as f64));
        state
    }

    #[test]
    fn forward_and_inverse_are_the_same_equations() {
        for arm in testing::arms() {
            let model = ArmModel::new(&arm, 4).unwrap();
            let state = state(&model);
            let state = State(state.as_slice());
            let surface = Surface {
                normal: [0.6, 0.8],
                offset_m: 0.0,
            };
            let torque = [-3.0, 0.4];
            let drive = Actuation {
                torque,
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
            let motion = Motion {
                joint: JointMotion {
                    angle: state.angle(),
                    rate: state.rate(),
                    acceleration,
                },
                configuration: Configuration::new(&model, state.angle()),
                q: state.q(),
                q_rate: state.q_rate(),
                q_acceleration: &q_acceleration,
            };
            let found = inverse(&model, &motion, surface.normal.map(|n| n * force));
            for (a, b) in found.iter().zip(torque) {
                assert!((a - b).abs() < 1e-9, "{found:?}");
            }
            let residual = elastic_residual(&model, &motion, torque[1]);
            assert!(residual.iter().all(|r| r.abs() < 1e-7), "{residual:?}");
        }
    }

    #[test]
    fn eliminating_tau2_agrees_with_the_full_equations() {
        for arm in testing::arms() {
            let model = ArmModel::new(&arm, 3).unwrap();
            let state = state(&model);
            let state = State(state.as_slice());
            let joint = JointMotion {
                angle: state.angle(),
                rate: state.rate(),
                acceleration: [2.0, -5.0],
            };
            let force = [0.5, 1.5];
            let configuration = Configuration::new(&model, state.angle());
            let equation = deflection_equation(&model, &joint, &configuration, force, false);
            let n = model.dof();
            let mut value = vec![0.0; n];
            let mut unused = [(); 2].map(|()| DMatrix::zeros(n, n));
            let [by_w, by_rate] = &mut unused;
            let [w, w_rate] = [state.q(), state.q_rate()].map(|q| model.deflection(q));
            equation.linearise(
                &model,
                w.as_slice(),
                w_rate.as_slice(),
                &mut value,
                by_w,
                by_rate,
            );
            let w_acceleration = eliminated_mass(&model)
                .lu()
                .solve(&DVector::from_vec(value))
                .unwrap();
            let q_acceleration = &model.coordinates * w_acceleration;
            let q_acceleration = q_acceleration.as_slice();
            let motion = Motion {
                joint,
                configuration,
                q: state.q(),
                q_rate: state.q_rate(),
                q_acceleration,
            };
            let [_, tau2] = inverse(&model, &motion, force);
            let scale = q_acceleration.iter().fold(1.0, |m: f64, a| m.max(a.abs()));
            for r in elastic_residual(&model, &motion, tau2) {
                assert!(r.abs() < 1e-11 * scale, "{r:e} of {scale:e}");
            }
        }
    }

    #[test]
    fn the_linearisation_is_the_derivative() {
        for arm in testing::arms() {
            let model = ArmModel::new(&arm, 2).unwrap();
            let n = model.dof();
            let state = state(&model);
            let state = State(state.as_slice());
            let joint = JointMotion {
                angle: state.angle(),
                rate: state.rate(),
                acceleration: [2.0, -5.0],
            };
            let configuration = Configuration::new(&model, state.angle());
            let equation = deflection_equation(&model, &joint, &configuration, [0.0, 2.0], false);
            let evaluate = |q: &[f64], v: &[f64]| {
                let mut value = vec![0.0; n];
                let (mut by_q, mut by_rate) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
                equation.linearise(&model, q, v, &mut value, &mut by_q, &mut by_rate);
                (value, by_q, by_rate)
            };
            let [w, w_rate] = [state.q(), state.q_rate()].map(|q| model.deflection(q));
            let (_, by_q, by_rate) = evaluate(w.as_slice(), w_rate.as_slice());
            // Quadratic, so central differences are exact but for rounding.
            for j in 0..n {
                for (by, rate) in [(&by_q, false), (&by_rate, true)] {
                    let mut x = [w.as_slice().to_vec(), w_rate.as_slice().to_vec()];
                    x[usize::from(rate)][j] += 0.5;
                    let plus = evaluate(&x[0], &x[1]).0;
                    x[usize::from(rate)][j] -= 1.0;
                    let minus = evaluate(&x[0], &x[1]).0;
                    for i in 0..n {
                        let difference = plus[i] - minus[i];
                        assert!(
                            (difference - by[(i, j)]).abs() < 1e-8 * (1.0 + difference.abs()),
                            "{i} {j} {rate}"
                        );
                    }
                }
            }
        }
    }

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

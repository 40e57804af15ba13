//! The boundary-value problem and the inverse dynamics as the paper prints them, for comparison with
//! `link_dynamics`: for a link that bends little, without the axial load and everything
//! of second order in the deflection.

use crate::model::arm_model::{ArmModel, NodalBeam, dot};
use crate::model::configuration::Configuration;
use flexor::model::JointMotion;
use nalgebra::{DMatrix, DVector};

/// Eq. 14, the beam's equations with tau2 eliminated, at one instant of a prescribed tip motion, for
/// nodal deflections `w` (with `M_t` the mass matrix without root and tip inertia, and E = (1, 0, ..., 0)):
///
/// ```text
/// (M - E <rho B>) w'' = constant - D w' - K w + rate2^2 M_t w
/// ```
#[derive(Clone, Debug)]
pub struct PrintedDeflection {
    /// The part without `w`, row by row.
    constant: DVector<f64>,
    /// theta20's squared rate.
    squared: f64,
}

impl PrintedDeflection {
    /// For a joint motion and a contact force (N, inertial axes).
    pub fn new(model: &ArmModel, joint: &JointMotion<f64>, force: [f64; 2]) -> Self {
        let configuration = Configuration::new(model, joint.angle);
        let [rate1, rate2] = joint.rate;
        let [acceleration1, acceleration2] = joint.acceleration;
        let r1 = model.arm.link1_length_m;
        let a_n = r1 * (acceleration1 * configuration.c + rate1 * rate1 * configuration.s);
        let across = configuration.g_n - a_n;
        let root = model.link2_inertia * acceleration2 - model.link2_moment * across
            + model.arm.link2_length_m * configuration.along_n2(force);
        let mut constant =
            &model.nodal.first_moment * across - &model.nodal.second_moment * acceleration2;
        constant[0] += root;
        Self {
            constant,
            squared: rate2 * rate2,
        }
    }

    /// The left side less the right for `w`, its rate and acceleration, and its derivatives by the three.
    pub fn linearise(
        &self,
        model: &ArmModel,
        [w, w_t, w_tt]: [&[f64]; 3],
        value: &mut [f64],
        [by_w, by_rate, by_acceleration]: &mut [DMatrix<f64>; 3],
    ) {
        let NodalBeam {
            mass,
            translating_mass,
            stiffness,
            damping,
            second_moment,
            ..
        } = &model.nodal;
        by_w.zip_zip_apply(stiffness, translating_mass, |x, k, m| {
            *x = k - self.squared * m;
        });
        by_rate.copy_from(damping);
        by_acceleration.copy_from(mass);
        let mut row = by_acceleration.row_mut(0);
        row -= second_moment.transpose();
        let [w, w_t, w_tt] = [w, w_t, w_tt].map(DVector::from_column_slice);
        let sum = &*by_w * w + &*by_rate * w_t + &*by_acceleration * w_tt - &self.constant;
        value.copy_from_slice(sum.as_slice());
    }
}

/// Motion of the whole arm at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Motion<'a> {
    /// Link angles, rates and accelerations.
    pub joint: JointMotion<f64>,
    /// The configuration at those angles; costs four trigonometric functions, so it is shared.
    pub configuration: Configuration<f64>,
    /// Modal coordinates.
    pub q: &'a [f64],
    /// Their rates, 1/s.
    pub q_rate: &'a [f64],
    /// Their accelerations, 1/s^2.
    pub q_acceleration: &'a [f64],
}

/// The torques of eq. 16-17 as printed: velocities without the terms in `w theta20'`
/// (eq. 6), and tau2 as the least-squares solution of eq. 9 (link 2's angular
/// momentum) and eq. 11 (its vibration), which contradict each other. Only eq. 11's
/// root slope row has tau2, so that is the mean of the two. The torques (tau1, tau2), N m, for `motion` with
/// the tip pressing with `force` (N, inertial axes).
pub fn inverse_as_printed(model: &ArmModel, motion: &Motion<'_>, force: [f64; 2]) -> [f64; 2] {
    let configuration = motion.configuration;
    let [rate1, rate2] = motion.joint.rate;
    let [acceleration1, acceleration2] = motion.joint.acceleration;
    let r1 = model.arm.link1_length_m;
    let (c, s) = (configuration.c, configuration.s);
    let a_n = r1 * (acceleration1 * c + rate1 * rate1 * s);
    let a_e = r1 * (acceleration1 * s - rate1 * rate1 * c);

    // Eq. 9 about joint 2.
    let momentum = model.link2_inertia * acceleration2
        + dot(&model.second_moment, motion.q_acceleration)
        + model.link2_moment * (a_n - configuration.g_n)
        + model.arm.link2_length_m * configuration.along_n2(force);
    // Eq. 11, the row of the root slope: nodal rows are the modal ones times the
    // coordinates, and E has its 1 there.
    let vibration: f64 = (0..model.dof())
        .map(|i| {
            let row = motion.q_acceleration[i]
                + model.second_moment[i] * acceleration2
                + model.first_moment[i] * (a_n - configuration.g_n)
                + model.stiffness[i] * motion.q[i]
                + model.damping[i] * motion.q_rate[i];
            model.coordinates[(i, 0)] * row
        })
        .sum();
    let tau2 = 0.5 * (momentum + vibration);

    let inertial_n = model.link2_moment * acceleration2
        + dot(&model.first_moment, motion.q_acceleration)
        + model.link2_mass * a_n;
    let inertial_e = -model.link2_moment * rate2 * rate2
        - dot(&model.first_moment, motion.q_rate) * rate2
        + model.link2_mass * a_e;
    let tau1 = model.link1_inertia * acceleration1 + r1 * (c * inertial_n + s * inertial_e)
        - model.joint1_moment * configuration.g_n1
        + tau2
        + r1 * configuration.along_n1(force);
    [tau1, tau2]
}

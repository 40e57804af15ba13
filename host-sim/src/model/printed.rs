//! Inverse dynamics as the paper prints it, for comparison with
//! [`crate::model::dynamics::inverse`].

use crate::model::arm_model::{ArmModel, dot};
use crate::model::dynamics::Motion;

/// The torques of eq. 16-17 as printed: velocities without the terms in `w theta20'`
/// (eq. 6), and tau2 as the least-squares solution of eq. 9 (link 2's angular
/// momentum) and eq. 11 (its vibration), which contradict each other. Only eq. 11's
/// root slope row has tau2, so that is the mean of the two. Units as [`inverse`](crate::model::dynamics::inverse).
pub fn inverse_as_printed(model: &ArmModel, motion: &Motion<'_, f64>, force: [f64; 2]) -> [f64; 2] {
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

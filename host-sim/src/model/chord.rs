//! Kinematics of an arm whose link 2 has a chord of changing length: the tip is at
//! `r1 e(theta10) + L e(theta20)`, and a bent link has an `L` below its length.

use flexor::model::{ArmParameters, JointMotion, Kinematics, KinematicsError};
use flexor::number::Real;

/// The motion in other numbers.
pub(crate) fn lift<T: Real>(joint: &JointMotion<f64>) -> JointMotion<T> {
    JointMotion {
        angle: joint.angle.map(T::from_f64),
        rate: joint.rate.map(T::from_f64),
        acceleration: joint.acceleration.map(T::from_f64),
    }
}

/// Joint motion that gives the tip of `arm` the position, velocity and acceleration `tip` (m, m/s, m/s^2,
/// inertial axes) with a chord of the length `chord` (m, its rate and acceleration).
///
/// # Errors
/// As [`Kinematics::inverse`], with the reach of that chord.
pub(crate) fn inverse_motion<T: Real>(
    arm: &ArmParameters,
    [length, length_t, length_tt]: [T; 3],
    tip: [[f64; 2]; 3],
) -> Result<JointMotion<T>, KinematicsError> {
    let r1 = T::from_f64(arm.link1_length_m);
    let kinematics = Kinematics {
        link1_length: r1,
        link2_length: length,
    };
    let [position, velocity, acceleration] = tip.map(|x| x.map(T::from_f64));
    let angle = kinematics.inverse(position, arm.elbow)?;
    let e1 = [angle[0].cos(), angle[0].sin()];
    let e2 = [angle[1].cos(), angle[1].sin()];
    let sine = e1[0] * e2[1] - e1[1] * e2[0];
    // r1 n(theta10) p + L n(theta20) q = v.
    let solve = |v: [T; 2]| {
        [
            (v[0] * e2[0] + v[1] * e2[1]) / (r1 * sine),
            -(v[0] * e1[0] + v[1] * e1[1]) / (length * sine),
        ]
    };
    let rate = solve([
        velocity[0] - length_t * e2[0],
        velocity[1] - length_t * e2[1],
    ]);
    let along1 = r1 * rate[0] * rate[0];
    let along2 = length * rate[1] * rate[1] - length_tt;
    let across2 = (length_t + length_t) * rate[1];
    let acceleration = solve([
        acceleration[0] + along1 * e1[0] + along2 * e2[0] + across2 * e2[1],
        acceleration[1] + along1 * e1[1] + along2 * e2[1] - across2 * e2[0],
    ]);
    Ok(JointMotion {
        angle,
        rate,
        acceleration,
    })
}

/// Position, velocity and acceleration of the tip (m, m/s, m/s^2, inertial axes) of `arm` with the joint
/// motion `joint` and a chord of the length `chord` (m, its rate and acceleration).
pub(crate) fn forward_motion<T: Real>(
    arm: &ArmParameters,
    [length, length_t, length_tt]: [T; 3],
    joint: &JointMotion<T>,
) -> [[T; 2]; 3] {
    let r1 = T::from_f64(arm.link1_length_m);
    let [e1, e2] = joint.angle.map(|angle| [angle.cos(), angle.sin()]);
    let [rate1, rate2] = joint.rate;
    let [acceleration1, acceleration2] = joint.acceleration;
    // Along e and n of each link.
    let (across1, along1) = (r1 * acceleration1, -(r1 * rate1 * rate1));
    let across2 = length * acceleration2 + (length_t + length_t) * rate2;
    let along2 = length_tt - length * rate2 * rate2;
    let sum = |[along1, across1]: [T; 2], [along2, across2]: [T; 2]| {
        [
            along1 * e1[0] - across1 * e1[1] + along2 * e2[0] - across2 * e2[1],
            along1 * e1[1] + across1 * e1[0] + along2 * e2[1] + across2 * e2[0],
        ]
    };
    [
        sum([r1, T::ZERO], [length, T::ZERO]),
        sum([T::ZERO, r1 * rate1], [length_t, length * rate2]),
        sum([along1, across1], [along2, across2]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inverse_and_forward_motion_undo_each_other(
            x in 0.3..0.7_f64, y in -0.3..0.3_f64, chord in 0.5..0.6_f64,
            rates in proptest::array::uniform6(-2.0..2.0_f64),
        ) {
            let [vx, vy, ax, ay, length_t, length_tt] = rates;
            let arm = ArmParameters::PAPER;
            let chord = [chord, length_t, length_tt];
            let tip = [[x, y], [vx, vy], [ax, ay]];
            let joint = inverse_motion(&arm, chord, tip).unwrap();
            let back = forward_motion(&arm, chord, &joint);
            for (found, given) in back.into_iter().flatten().zip(tip.into_iter().flatten()) {
                prop_assert!((found - given).abs() < 1e-10 * (1.0 + joint.acceleration[0].abs()));
            }
            // A chord of constant length is a rigid link.
            let rigid = Kinematics { link1_length: 0.5, link2_length: chord[0] };
            let constant = [chord[0], 0.0, 0.0];
            let found = inverse_motion(&arm, constant, tip).unwrap();
            let expected = rigid.inverse_motion(tip[0], tip[1], tip[2], arm.elbow).unwrap();
            for i in 0..2 {
                prop_assert!((found.rate[i] - expected.rate[i]).abs() < 1e-11 * (1.0 + expected.rate[i].abs()));
                let size = 1.0 + expected.acceleration[i].abs();
                prop_assert!((found.acceleration[i] - expected.acceleration[i]).abs() < 1e-10 * size);
            }
        }
    }
}

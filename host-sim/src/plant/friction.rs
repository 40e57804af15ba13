//! Friction in the two joints.

use crate::plant::PlantParameters;
use flexor::number::Real;

/// Rate over which Coulomb friction is made smooth, rad/s.
const SMOOTH: f64 = 0.01;

/// Friction torques on the joints, N m, for the motors' rates (rad/s): viscous, and
/// Coulomb made smooth over 0.01 rad/s so that the integration keeps its order.
pub(super) fn friction<T: Real>(parameters: &PlantParameters, rate: [T; 2]) -> [T; 2] {
    [0, 1].map(|joint| {
        let v = rate[joint];
        let smooth = (v * v + T::from_f64(SMOOTH * SMOOTH)).sqrt();
        T::from_f64(parameters.viscous_friction_nms_rad[joint]) * v
            + T::from_f64(parameters.coulomb_friction_nm[joint]) * v / smooth
    })
}

/// The steepest slopes of [`friction`] over the rates, at rest, N m s/rad: what an
/// integration step must be short for.
pub(super) fn steepest(parameters: &PlantParameters) -> [f64; 2] {
    [0, 1].map(|joint| {
        parameters.viscous_friction_nms_rad[joint] + parameters.coulomb_friction_nm[joint] / SMOOTH
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn friction_takes_power_and_is_odd(
            rate in proptest::array::uniform2(-20.0..20.0_f64),
            viscous in proptest::array::uniform2(0.0..0.1_f64),
            coulomb in proptest::array::uniform2(0.0..0.1_f64),
        ) {
            let parameters = PlantParameters {
                viscous_friction_nms_rad: viscous,
                coulomb_friction_nm: coulomb,
                ..PlantParameters::default()
            };
            let torque = friction(&parameters, rate);
            let opposite = friction(&parameters, rate.map(|v| -v));
            for joint in 0..2 {
                prop_assert!(torque[joint] * rate[joint] >= 0.0);
                prop_assert_eq!(torque[joint], -opposite[joint]);
                let bound = steepest(&parameters)[joint] * rate[joint].abs();
                prop_assert!(torque[joint].abs() <= bound * (1.0 + 1e-15));
                // Coulomb friction is smooth, but whole well above 0.01 rad/s.
                let whole = viscous[joint] * rate[joint].abs() + coulomb[joint];
                prop_assert!(torque[joint].abs() <= whole * (1.0 + 1e-15));
                prop_assert!(rate[joint].abs() < 0.1 || torque[joint].abs() >= 0.99 * whole);
            }
        }
    }
}

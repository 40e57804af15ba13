//! What a controller is made from, and its form on the wire.
//!
//! The wire knows nothing of the control law, and the law nothing of the wire: the conversions
//! between them are here, where host and firmware both reach them.

use crate::control::{
    Controller, ForceProjection, LawParameters, LimitParameters, SlopeRateFeedback,
};
use crate::link::{LawSetup, LimitSetup, Setup};
use crate::model::ArmParameters;
use crate::table::{Table, TableError};

/// What a controller is made from, apart from its table; f64, SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerParameters {
    /// The arm.
    pub arm: ArmParameters,
    /// Gains and options of the law.
    pub law: LawParameters,
    /// Torque limits.
    pub limits: LimitParameters,
}

impl ControllerParameters {
    /// The firmware's controller for these parameters, at the table's first tick.
    ///
    /// # Errors
    /// [`TableError::Fingerprint`] if the table was planned for another arm.
    pub fn controller<'a>(&self, table: &Table<'a>) -> Result<Controller<'a, f32>, TableError> {
        Controller::new(table, &self.arm, &self.law, &self.limits)
    }
}

impl From<&Setup> for ControllerParameters {
    fn from(setup: &Setup) -> Self {
        let Setup { arm, law, limits } = *setup;
        Self {
            arm,
            law: LawParameters {
                force_derivative_s: law.force_derivative_s,
                force_proportional: law.force_proportional,
                force_integral_per_s: law.force_integral_per_s,
                slope_rate_nms_rad: law.slope_rate_nms_rad,
                force_filter_hz: law.force_filter_hz,
                slope_rate_filter_hz: law.slope_rate_filter_hz,
                force_projection: if law.force_projection_as_printed {
                    ForceProjection::AsPrinted
                } else {
                    ForceProjection::JacobianTranspose
                },
                slope_rate_feedback: if law.slope_rate_feedback_as_printed {
                    SlopeRateFeedback::AsPrinted
                } else {
                    SlopeRateFeedback::Deviation
                },
                feedforward: law.feedforward,
            },
            limits: LimitParameters {
                torque_nm: limits.torque_nm,
                torque_rate_nm_s: limits.torque_rate_nm_s,
            },
        }
    }
}

impl From<&ControllerParameters> for Setup {
    fn from(parameters: &ControllerParameters) -> Self {
        let ControllerParameters { arm, law, limits } = *parameters;
        Self {
            arm,
            law: LawSetup {
                force_derivative_s: law.force_derivative_s,
                force_proportional: law.force_proportional,
                force_integral_per_s: law.force_integral_per_s,
                slope_rate_nms_rad: law.slope_rate_nms_rad,
                force_filter_hz: law.force_filter_hz,
                slope_rate_filter_hz: law.slope_rate_filter_hz,
                force_projection_as_printed: match law.force_projection {
                    ForceProjection::JacobianTranspose => false,
                    ForceProjection::AsPrinted => true,
                },
                slope_rate_feedback_as_printed: match law.slope_rate_feedback {
                    SlopeRateFeedback::Deviation => false,
                    SlopeRateFeedback::AsPrinted => true,
                },
                feedforward: law.feedforward,
            },
            limits: LimitSetup {
                torque_nm: limits.torque_nm,
                torque_rate_nm_s: limits.torque_rate_nm_s,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// With the order of the wire's bytes, which the link's tests hold, this says that
        /// every parameter arrives as itself.
        #[test]
        fn every_parameter_arrives_as_itself(
            gains in prop::array::uniform4(-1e3..1e3_f64),
            filters in prop::array::uniform2(prop::option::of(1.0..1e3_f64)),
            options in prop::array::uniform3(any::<bool>()),
            limits in prop::array::uniform4(0.0..1e3_f64),
        ) {
            let [projection, feedback, feedforward] = options;
            let law = LawParameters {
                force_derivative_s: gains[0],
                force_proportional: gains[1],
                force_integral_per_s: gains[2],
                slope_rate_nms_rad: gains[3],
                force_filter_hz: filters[0],
                slope_rate_filter_hz: filters[1],
                force_projection: if projection {
                    ForceProjection::AsPrinted
                } else {
                    ForceProjection::JacobianTranspose
                },
                slope_rate_feedback: if feedback {
                    SlopeRateFeedback::AsPrinted
                } else {
                    SlopeRateFeedback::Deviation
                },
                feedforward,
            };
            let parameters = ControllerParameters {
                arm: ArmParameters::PAPER,
                law,
                limits: LimitParameters {
                    torque_nm: [limits[0], limits[1]],
                    torque_rate_nm_s: [limits[2], limits[3]],
                },
            };
            let setup = Setup::from(&parameters);
            prop_assert_eq!(setup.law.force_derivative_s, gains[0]);
            prop_assert_eq!(setup.law.force_proportional, gains[1]);
            prop_assert_eq!(setup.law.force_integral_per_s, gains[2]);
            prop_assert_eq!(setup.law.slope_rate_nms_rad, gains[3]);
            prop_assert_eq!(setup.law.force_filter_hz, filters[0]);
            prop_assert_eq!(setup.law.slope_rate_filter_hz, filters[1]);
            prop_assert_eq!(setup.law.force_projection_as_printed, projection);
            prop_assert_eq!(setup.law.slope_rate_feedback_as_printed, feedback);
            prop_assert_eq!(setup.law.feedforward, feedforward);
            prop_assert_eq!(setup.limits.torque_nm, [limits[0], limits[1]]);
            prop_assert_eq!(setup.limits.torque_rate_nm_s, [limits[2], limits[3]]);
            prop_assert_eq!(ControllerParameters::from(&setup), parameters);
        }
    }
}

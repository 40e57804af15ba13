//! What a controller is made from, and its form on the wire.
//!
//! The wire knows nothing of the control law, and the law nothing of the wire: the conversions
//! between them are here, where host and firmware both reach them.

use crate::control::{
    Controller, ForceProjection, FreeParameters, HybridParameters, LawParameters, LimitParameters,
    MotionParameters, PaperParameters, SlopeRateFeedback,
};
use crate::link::{
    FreeSetup, HybridSetup, LawSetup, LimitSetup, MonitorSetup, MotionSetup, PaperSetup, Setup,
};
use crate::model::ArmParameters;
use crate::supervisor::monitors::MonitorParameters;
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
    /// Thresholds of the monitors, where the drives are on.
    pub monitors: MonitorParameters,
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
        let Setup {
            arm,
            law,
            limits,
            monitors,
        } = *setup;
        Self {
            arm,
            law: match law {
                LawSetup::Paper(paper) => LawParameters::Paper(paper.into()),
                LawSetup::Hybrid(hybrid) => LawParameters::Hybrid(hybrid.into()),
            },
            limits: LimitParameters {
                torque_nm: limits.torque_nm,
                torque_rate_nm_s: limits.torque_rate_nm_s,
            },
            monitors: monitors.into(),
        }
    }
}

impl From<&ControllerParameters> for Setup {
    fn from(parameters: &ControllerParameters) -> Self {
        let ControllerParameters {
            arm,
            law,
            limits,
            monitors,
        } = *parameters;
        Self {
            arm,
            law: match law {
                LawParameters::Paper(paper) => LawSetup::Paper(paper.into()),
                LawParameters::Hybrid(hybrid) => LawSetup::Hybrid(hybrid.into()),
            },
            limits: LimitSetup {
                torque_nm: limits.torque_nm,
                torque_rate_nm_s: limits.torque_rate_nm_s,
            },
            monitors: monitors.into(),
        }
    }
}

impl From<MonitorSetup> for MonitorParameters {
    fn from(monitors: MonitorSetup) -> Self {
        Self {
            path_rad: monitors.path_rad,
            speed_rad_s: monitors.speed_rad_s,
            force_n: monitors.force_n,
            root_moment_nm: monitors.root_moment_nm,
            balance_nm: monitors.balance_nm,
        }
    }
}

impl From<MonitorParameters> for MonitorSetup {
    fn from(monitors: MonitorParameters) -> Self {
        Self {
            path_rad: monitors.path_rad,
            speed_rad_s: monitors.speed_rad_s,
            force_n: monitors.force_n,
            root_moment_nm: monitors.root_moment_nm,
            balance_nm: monitors.balance_nm,
        }
    }
}

impl From<PaperSetup> for PaperParameters {
    fn from(law: PaperSetup) -> Self {
        Self {
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
        }
    }
}

impl From<PaperParameters> for PaperSetup {
    fn from(law: PaperParameters) -> Self {
        Self {
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
        }
    }
}

impl From<HybridSetup> for HybridParameters {
    fn from(hybrid: HybridSetup) -> Self {
        Self {
            joint_stiffness_nm_rad: hybrid.joint_stiffness_nm_rad.map(f64::from),
            joint_damping_nms_rad: hybrid.joint_damping_nms_rad.map(f64::from),
            rate_filter_hz: hybrid.rate_filter_hz.map(f64::from),
            joint1_integral_nm_rads: hybrid.joint1_integral_nm_rads.into(),
            joint1_integral_limit_nm: hybrid.joint1_integral_limit_nm.into(),
            force_integral_per_s: hybrid.force_integral_per_s.into(),
            torque_loop_per_s: hybrid.torque_loop_per_s.into(),
            torque_correction_limit_nm: hybrid.torque_correction_limit_nm.into(),
            section_frequency_rad_s: hybrid.section_frequency_rad_s.into(),
            section_damping: hybrid.section_damping.into(),
            section_angle_nm_rad: hybrid.section_angle_nm_rad.map(f64::from),
            section_force: hybrid.section_force.map(f64::from),
            free: FreeParameters {
                stiffness_nm_rad: hybrid.free.stiffness_nm_rad.into(),
                damping_nms_rad: hybrid.free.damping_nms_rad.into(),
                torque_loop_per_s: hybrid.free.torque_loop_per_s.into(),
                section_frequency_rad_s: hybrid.free.section_frequency_rad_s.into(),
                section_damping: hybrid.free.section_damping.into(),
                section_angle_nm_rad: hybrid.free.section_angle_nm_rad.map(f64::from),
            },
            motion: MotionParameters {
                settle_s: hybrid.motion.settle_s.into(),
                approach_speed_m_s: hybrid.motion.approach_speed_m_s.into(),
                approach_limit_m: hybrid.motion.approach_limit_m.into(),
                contact_on_share: hybrid.motion.contact_on_share.into(),
                contact_off_share: hybrid.motion.contact_off_share.into(),
                force_ramp_per_s: hybrid.motion.force_ramp_per_s.into(),
                lost_s: hybrid.motion.lost_s.into(),
                stop_s: hybrid.motion.stop_s.into(),
                lift_speed_m_s: hybrid.motion.lift_speed_m_s.into(),
                lift_m: hybrid.motion.lift_m.into(),
            },
        }
    }
}

/// To the nearest f32, from which the law is made on either side.
impl From<HybridParameters> for HybridSetup {
    fn from(hybrid: HybridParameters) -> Self {
        Self {
            joint_stiffness_nm_rad: hybrid.joint_stiffness_nm_rad.map(|x| x as f32),
            joint_damping_nms_rad: hybrid.joint_damping_nms_rad.map(|x| x as f32),
            rate_filter_hz: hybrid.rate_filter_hz.map(|x| x as f32),
            joint1_integral_nm_rads: hybrid.joint1_integral_nm_rads as f32,
            joint1_integral_limit_nm: hybrid.joint1_integral_limit_nm as f32,
            force_integral_per_s: hybrid.force_integral_per_s as f32,
            torque_loop_per_s: hybrid.torque_loop_per_s as f32,
            torque_correction_limit_nm: hybrid.torque_correction_limit_nm as f32,
            section_frequency_rad_s: hybrid.section_frequency_rad_s as f32,
            section_damping: hybrid.section_damping as f32,
            section_angle_nm_rad: hybrid.section_angle_nm_rad.map(|x| x as f32),
            section_force: hybrid.section_force.map(|x| x as f32),
            free: FreeSetup {
                stiffness_nm_rad: hybrid.free.stiffness_nm_rad as f32,
                damping_nms_rad: hybrid.free.damping_nms_rad as f32,
                torque_loop_per_s: hybrid.free.torque_loop_per_s as f32,
                section_frequency_rad_s: hybrid.free.section_frequency_rad_s as f32,
                section_damping: hybrid.free.section_damping as f32,
                section_angle_nm_rad: hybrid.free.section_angle_nm_rad.map(|x| x as f32),
            },
            motion: MotionSetup {
                settle_s: hybrid.motion.settle_s as f32,
                approach_speed_m_s: hybrid.motion.approach_speed_m_s as f32,
                approach_limit_m: hybrid.motion.approach_limit_m as f32,
                contact_on_share: hybrid.motion.contact_on_share as f32,
                contact_off_share: hybrid.motion.contact_off_share as f32,
                force_ramp_per_s: hybrid.motion.force_ramp_per_s as f32,
                lost_s: hybrid.motion.lost_s as f32,
                stop_s: hybrid.motion.stop_s as f32,
                lift_speed_m_s: hybrid.motion.lift_speed_m_s as f32,
                lift_m: hybrid.motion.lift_m as f32,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::HybridLaw;
    use crate::number::SiScalar;
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
            thresholds in prop::array::uniform8(0.0..1e3_f32),
        ) {
            let [path1, path2, speed1, speed2, force_n, root_moment_nm, short, lasting] = thresholds;
            let monitors = MonitorParameters {
                path_rad: [path1, path2],
                speed_rad_s: [speed1, speed2],
                force_n,
                root_moment_nm,
                balance_nm: [short, lasting],
            };
            let [projection, feedback, feedforward] = options;
            let law = PaperParameters {
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
                law: law.into(),
                limits: LimitParameters {
                    torque_nm: [limits[0], limits[1]],
                    torque_rate_nm_s: [limits[2], limits[3]],
                },
                monitors,
            };
            let setup = Setup::from(&parameters);
            let LawSetup::Paper(sent) = setup.law else {
                return Err(TestCaseError::fail("another law"));
            };
            prop_assert_eq!(sent.force_derivative_s, gains[0]);
            prop_assert_eq!(sent.force_proportional, gains[1]);
            prop_assert_eq!(sent.force_integral_per_s, gains[2]);
            prop_assert_eq!(sent.slope_rate_nms_rad, gains[3]);
            prop_assert_eq!(sent.force_filter_hz, filters[0]);
            prop_assert_eq!(sent.slope_rate_filter_hz, filters[1]);
            prop_assert_eq!(sent.force_projection_as_printed, projection);
            prop_assert_eq!(sent.slope_rate_feedback_as_printed, feedback);
            prop_assert_eq!(sent.feedforward, feedforward);
            prop_assert_eq!(setup.limits.torque_nm, [limits[0], limits[1]]);
            prop_assert_eq!(setup.limits.torque_rate_nm_s, [limits[2], limits[3]]);
            prop_assert_eq!(setup.monitors.path_rad, [path1, path2]);
            prop_assert_eq!(setup.monitors.speed_rad_s, [speed1, speed2]);
            prop_assert_eq!(setup.monitors.balance_nm, [short, lasting]);
            prop_assert_eq!(setup.monitors.force_n, force_n);
            prop_assert_eq!(setup.monitors.root_moment_nm, root_moment_nm);
            prop_assert_eq!(ControllerParameters::from(&setup), parameters);
        }
    }
    /// Host and board make one law, bit for bit, though the gains travel in f32.
    #[test]
    fn a_board_makes_the_hybrid_law_that_the_host_makes() {
        let gains = HybridParameters::PAPER_ARM_HUB;
        let parameters = ControllerParameters {
            arm: ArmParameters::PAPER,
            law: gains.into(),
            limits: LimitParameters {
                torque_nm: [20.0, 2.0],
                torque_rate_nm_s: [1e3, 1e3],
            },
            monitors: MonitorParameters::NONE,
        };
        let received = ControllerParameters::from(&Setup::from(&parameters));
        assert_ne!(received, parameters, "0.0307 is no f32");
        let LawParameters::Hybrid(received) = received.law else {
            panic!("another law");
        };
        fn law<T: SiScalar<Format = ()>>(gains: &HybridParameters) -> HybridLaw<T> {
            HybridLaw::new(gains, &ArmParameters::PAPER, 5000)
        }
        assert_eq!(law::<f64>(&received), law::<f64>(&gains));
        assert_eq!(law::<f32>(&received), law::<f32>(&gains));
    }
}

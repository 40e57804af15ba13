//! What a controller is made from, on the wire and in the firmware's image.
//!
//! The law's and the limits' parameters have structs of their own here, whose fields are the
//! wire's bytes in their order: the control law's structs may change without the wire. The
//! supervisor, above, converts between them.

use crate::CRC32;
use crate::link::frame::FrameTooLong;
use crate::model::ArmParameters;
use serde::{Deserialize, Serialize};

/// What a controller is made from, apart from its table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// The arm.
    pub arm: ArmParameters,
    /// Gains and options of the law.
    pub law: LawSetup,
    /// Torque limits.
    pub limits: LimitSetup,
    /// Thresholds of an enabled arm's monitors; in lock-step none act.
    pub monitors: MonitorSetup,
}

/// Thresholds of the monitors, SI; infinite for one that is silent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MonitorSetup {
    /// Of the motors' angles from the planned ones, rad.
    pub path_rad: [f32; 2],
    /// Of the motors' speeds, rad/s.
    pub speed_rad_s: [f32; 2],
    /// Of the contact force from the planned one, N.
    pub force_n: f32,
    /// Of the root moment from the wanted one, N m.
    pub root_moment_nm: f32,
    /// Of root moment and contact force from each other, for short and lasting, N m.
    pub balance_nm: [f32; 2],
}

/// Which control law, and its gains, SI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum LawSetup {
    /// The paper's.
    Paper(PaperSetup),
    /// The hybrid law.
    Hybrid(HybridSetup),
}

/// Gains of the hybrid law, SI; f32, so that the setup fits a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HybridSetup {
    /// K1 and k2, N m/rad.
    pub joint_stiffness_nm_rad: [f32; 2],
    /// B1 and B2, N m s/rad.
    pub joint_damping_nms_rad: [f32; 2],
    /// Corners of the filters on the joints' rates, Hz.
    pub rate_filter_hz: [f32; 2],
    /// Ki1, N m/(rad s).
    pub joint1_integral_nm_rads: f32,
    /// Largest torque of joint 1's integral, N m.
    pub joint1_integral_limit_nm: f32,
    /// K_IF, 1/s.
    pub force_integral_per_s: f32,
    /// K_T, 1/s.
    pub torque_loop_per_s: f32,
    /// Largest correction by the torque loop, N m.
    pub torque_correction_limit_nm: f32,
    /// w, rad/s.
    pub section_frequency_rad_s: f32,
    /// z.
    pub section_damping: f32,
    /// g, N m/rad.
    pub section_angle_nm_rad: [f32; 2],
    /// h.
    pub section_force: [f32; 2],
    /// Joint 2's gains in the air.
    pub free: FreeSetup,
    /// How contact is made, kept, lost and left.
    pub motion: MotionSetup,
}

/// Joint 2's gains with the tip in the air, SI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FreeSetup {
    /// k2, N m/rad.
    pub stiffness_nm_rad: f32,
    /// B2, N m s/rad.
    pub damping_nms_rad: f32,
    /// K_T, 1/s.
    pub torque_loop_per_s: f32,
    /// w, rad/s.
    pub section_frequency_rad_s: f32,
    /// z.
    pub section_damping: f32,
    /// g, N m/rad.
    pub section_angle_nm_rad: [f32; 2],
}

/// How contact is made, kept, lost and left, SI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionSetup {
    /// Time for which the table's first tick is held, s.
    pub settle_s: f32,
    /// Speed of the tip towards the surface, m/s.
    pub approach_speed_m_s: f32,
    /// Way after which an approach is given up, m.
    pub approach_limit_m: f32,
    /// Share of the planned force from which on there is contact.
    pub contact_on_share: f32,
    /// Share below which there is none.
    pub contact_off_share: f32,
    /// Rate of the wanted force, 1/s.
    pub force_ramp_per_s: f32,
    /// Time without contact after which a run is given up, s.
    pub lost_s: f32,
    /// Time in which the table comes to a stop, s.
    pub stop_s: f32,
    /// Speed at which the tip is lifted off, m/s.
    pub lift_speed_m_s: f32,
    /// Way by which it is lifted, m.
    pub lift_m: f32,
}

/// Gains and options of the paper's control law (eq. 18-20), SI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PaperSetup {
    /// K_DF, gain on the force error's derivative, s.
    pub force_derivative_s: f64,
    /// K_PF, gain on the force error, dimensionless.
    pub force_proportional: f64,
    /// K_IF, gain on the force error's integral, 1/s.
    pub force_integral_per_s: f64,
    /// K_w, gain on the root slope rate, N m s/rad.
    pub slope_rate_nms_rad: f64,
    /// Corner of the force filter, Hz; `None` for no filter.
    pub force_filter_hz: Option<f64>,
    /// Corner of the slope rate filter, Hz; `None` for no filter.
    pub slope_rate_filter_hz: Option<f64>,
    /// A force becomes torques as printed in the paper, and not by the Jacobian's transpose.
    pub force_projection_as_printed: bool,
    /// K_w acts on the slope rate itself, as printed, and not on its deviation from the plan.
    pub slope_rate_feedback_as_printed: bool,
    /// False leaves the feedforward torques out.
    pub feedforward: bool,
}

/// Limits per joint, SI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LimitSetup {
    /// Largest torque magnitude, N m.
    pub torque_nm: [f64; 2],
    /// Largest torque rate magnitude, N m/s.
    pub torque_rate_nm_s: [f64; 2],
}

/// Most bytes of a setup with its CRC.
const SETUP_MAX: usize = 320;

impl Setup {
    /// Writes the setup with a CRC-32 behind it, as the firmware's image carries it, and
    /// returns the bytes written.
    ///
    /// # Errors
    /// [`FrameTooLong`] if the buffer is too short.
    pub fn encode<'b>(&self, buffer: &'b mut [u8]) -> Result<&'b [u8], FrameTooLong> {
        postcard::to_slice_crc32(self, buffer, CRC32.digest())
            .map(|bytes| &*bytes)
            .map_err(|_| FrameTooLong)
    }

    /// CRC-32 of the setup's bytes, which is what [`encode`](Self::encode) puts behind them: names
    /// everything that a controller is made from, apart from its table.
    pub fn crc(&self) -> u32 {
        let mut buffer = [0; SETUP_MAX];
        // No setup is longer (tested).
        let bytes = self.encode(&mut buffer).unwrap_or_default();
        bytes
            .split_last_chunk()
            .map_or(0, |(_, crc)| u32::from_le_bytes(*crc))
    }

    /// Reads what [`encode`](Self::encode) wrote; `None` if it is damaged.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        postcard::from_bytes_crc32(bytes, CRC32.digest()).ok()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::link::testing::SETUP;
    use crate::model::Elbow;
    use std::vec::Vec;

    /// Every field another value, so that none can change places unseen.
    #[test]
    fn the_bytes_are_the_fields_in_their_documented_order() {
        let setup = Setup {
            arm: ArmParameters {
                link1_length_m: 1.0,
                link1_mass_kg: 2.0,
                link2_length_m: 3.0,
                link2_mass_kg: 4.0,
                bending_stiffness_nm2: 5.0,
                damping_ratio: 6.0,
                root_inertia_kgm2: 7.0,
                tip_mass_kg: 8.0,
                tip_inertia_kgm2: 9.0,
                gravity_m_s2: [10.0, 11.0],
                elbow: Elbow::Up,
            },
            law: LawSetup::Paper(PaperSetup {
                force_derivative_s: 12.0,
                force_proportional: 13.0,
                force_integral_per_s: 14.0,
                slope_rate_nms_rad: 15.0,
                force_filter_hz: None,
                slope_rate_filter_hz: Some(16.0),
                force_projection_as_printed: true,
                slope_rate_feedback_as_printed: false,
                feedforward: true,
            }),
            limits: LimitSetup {
                torque_nm: [17.0, 18.0],
                torque_rate_nm_s: [19.0, 20.0],
            },
            monitors: MonitorSetup {
                path_rad: [21.0, 22.0],
                speed_rad_s: [23.0, 24.0],
                force_n: 25.0,
                root_moment_nm: 26.0,
                balance_nm: [27.0, 28.0],
            },
        };
        let numbers =
            |range: core::ops::RangeInclusive<u32>| range.flat_map(|x| f64::from(x).to_le_bytes());
        let mut expected: Vec<u8> = numbers(1..=11).collect();
        expected.extend([1, 0]); // elbow up; the paper's law
        expected.extend(numbers(12..=15));
        expected.extend([0, 1]); // no force filter; a slope rate filter
        expected.extend(numbers(16..=16));
        expected.extend([1, 0, 1]);
        expected.extend(numbers(17..=20));
        expected.extend((21..=28_u8).flat_map(|x| f32::from(x).to_le_bytes()));
        let mut buffer = [0; 512];
        let bytes = setup.encode(&mut buffer).unwrap();
        let (body, crc) = bytes.split_last_chunk().unwrap();
        assert_eq!(body, expected);
        assert_eq!(CRC32.checksum(body), u32::from_le_bytes(*crc));
    }

    #[test]
    fn the_hybrid_laws_bytes_are_its_gains_in_their_documented_order() {
        let law = LawSetup::Hybrid(HybridSetup {
            joint_stiffness_nm_rad: [1.0, 2.0],
            joint_damping_nms_rad: [3.0, 4.0],
            rate_filter_hz: [5.0, 6.0],
            joint1_integral_nm_rads: 7.0,
            joint1_integral_limit_nm: 8.0,
            force_integral_per_s: 9.0,
            torque_loop_per_s: 10.0,
            torque_correction_limit_nm: 11.0,
            section_frequency_rad_s: 12.0,
            section_damping: 13.0,
            section_angle_nm_rad: [14.0, 15.0],
            section_force: [16.0, 17.0],
            free: FreeSetup {
                stiffness_nm_rad: 18.0,
                damping_nms_rad: 19.0,
                torque_loop_per_s: 20.0,
                section_frequency_rad_s: 21.0,
                section_damping: 22.0,
                section_angle_nm_rad: [23.0, 24.0],
            },
            motion: MotionSetup {
                settle_s: 25.0,
                approach_speed_m_s: 26.0,
                approach_limit_m: 27.0,
                contact_on_share: 28.0,
                contact_off_share: 29.0,
                force_ramp_per_s: 30.0,
                lost_s: 31.0,
                stop_s: 32.0,
                lift_speed_m_s: 33.0,
                lift_m: 34.0,
            },
        });
        let mut buffer = [0; 512];
        let bytes = Setup { law, ..SETUP }.encode(&mut buffer).unwrap().to_vec();
        let mut expected = std::vec![1_u8];
        expected.extend((1..=34_u8).flat_map(|x| f32::from(x).to_le_bytes()));
        assert_eq!(bytes.len(), 290 + 4);
        assert!(bytes.len() <= SETUP_MAX);
        let crc = u32::from_le_bytes(*bytes.last_chunk().unwrap());
        assert_eq!(Setup { law, ..SETUP }.crc(), crc);
        assert_eq!(bytes[89..226], expected);
        assert_eq!(Setup::decode(&bytes), Some(Setup { law, ..SETUP }));
    }

    #[test]
    fn a_changed_byte_is_found_out() {
        let mut buffer = [0; 512];
        let mut bytes = SETUP.encode(&mut buffer).unwrap().to_vec();
        assert_eq!(Setup::decode(&bytes), Some(SETUP));
        bytes[20] ^= 1;
        assert_eq!(Setup::decode(&bytes), None);
        assert_eq!(Setup::decode(&[]), None);
    }
}

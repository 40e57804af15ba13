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
    /// Time for which the table's first tick is held, s.
    pub settle_s: f32,
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
        let mut buffer = [0; 256];
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
            settle_s: 18.0,
        });
        let mut buffer = [0; 256];
        let bytes = Setup { law, ..SETUP }.encode(&mut buffer).unwrap().to_vec();
        let mut expected = std::vec![1_u8];
        expected.extend((1..=18_u8).flat_map(|x| f32::from(x).to_le_bytes()));
        assert_eq!(bytes.len(), 194 + 4);
        assert_eq!(bytes[89..162], expected);
        assert_eq!(Setup::decode(&bytes), Some(Setup { law, ..SETUP }));
    }

    #[test]
    fn a_changed_byte_is_found_out() {
        let mut buffer = [0; 256];
        let mut bytes = SETUP.encode(&mut buffer).unwrap().to_vec();
        assert_eq!(Setup::decode(&bytes), Some(SETUP));
        bytes[20] ^= 1;
        assert_eq!(Setup::decode(&bytes), None);
        assert_eq!(Setup::decode(&[]), None);
    }
}

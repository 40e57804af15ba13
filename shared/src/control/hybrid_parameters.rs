//! Gains of the [hybrid law](crate::control::hybrid), as a file gives them.

use crate::control::motion_parameters::MotionParameters;

/// Gains of the hybrid law, in f64 SI units: what a `controller.toml` with `law = "hybrid"` says.
/// The law is made from the nearest f32, which is how gains go over the link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HybridParameters {
    /// K1 and k2: stiffness of the joints about their planned angles, N m/rad.
    pub joint_stiffness_nm_rad: [f64; 2],
    /// B1 and B2: damping of the joints' rates against the planned ones, N m s/rad.
    pub joint_damping_nms_rad: [f64; 2],
    /// Corners of the filters on these rates, Hz.
    pub rate_filter_hz: [f64; 2],
    /// Ki1: gain on the integral of joint 1's error, N m/(rad s). Without K1 there is none.
    pub joint1_integral_nm_rads: f64,
    /// Largest torque of that integral, N m.
    pub joint1_integral_limit_nm: f64,
    /// K_IF: gain on the integral of the force error, 1/s.
    pub force_integral_per_s: f64,
    /// K_T: bandwidth of the loop that makes the root moment what is wanted, 1/s; 0 without gauge.
    pub torque_loop_per_s: f64,
    /// Largest correction D by that loop, N m.
    pub torque_correction_limit_nm: f64,
    /// w: natural frequency of the second-order section, rad/s.
    pub section_frequency_rad_s: f64,
    /// z: its damping ratio, below 1.
    pub section_damping: f64,
    /// g: what joint 2's error feeds to the section's two states, N m/rad.
    pub section_angle_nm_rad: [f64; 2],
    /// h: what the force error's moment, phi, feeds to them.
    pub section_force: [f64; 2],
    /// Joint 2's gains with the tip in the air.
    pub free: FreeParameters,
    /// How contact is made, kept, lost and left.
    pub motion: MotionParameters,
}

/// Joint 2's gains with the tip in the air: those of the contact set that are not named here are
/// none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeParameters {
    /// k2: stiffness about the planned angle, N m/rad.
    pub stiffness_nm_rad: f64,
    /// B2: damping of the rate against the planned one, N m s/rad.
    pub damping_nms_rad: f64,
    /// K_T, 1/s.
    pub torque_loop_per_s: f64,
    /// w, rad/s.
    pub section_frequency_rad_s: f64,
    /// z, below 1.
    pub section_damping: f64,
    /// g, N m/rad.
    pub section_angle_nm_rad: [f64; 2],
}

impl HybridParameters {
    /// For a motor 2 whose rotor and hub add 2e-5 to 3e-4 kg m^2 to the root of the paper's link 2.
    pub const PAPER_ARM_HUB: Self = Self {
        joint_stiffness_nm_rad: [800.0, 2.21],
        joint_damping_nms_rad: [60.0, 0.0307],
        rate_filter_hz: [30.0, 4280.0],
        joint1_integral_nm_rads: 2500.0,
        joint1_integral_limit_nm: 50.0,
        force_integral_per_s: 10.2,
        torque_loop_per_s: 91.0,
        torque_correction_limit_nm: 0.5,
        section_frequency_rad_s: 26.7,
        section_damping: 0.567,
        section_angle_nm_rad: [0.894, 1.125],
        section_force: [0.156, 0.208],
        free: FreeParameters {
            stiffness_nm_rad: 1.882,
            damping_nms_rad: 0.02825,
            torque_loop_per_s: 91.0,
            section_frequency_rad_s: 13.7,
            section_damping: 0.1825,
            section_angle_nm_rad: [-3.005, -0.07898],
        },
        motion: MotionParameters::DEFAULT,
    };

    /// The parameters as they go over the link, in f32: a law that the host makes from the file
    /// has the bits of the one that a board makes from its setup.
    pub(super) fn sent(&self) -> Self {
        let sent = |value: f64| f64::from(value as f32);
        Self {
            joint_stiffness_nm_rad: self.joint_stiffness_nm_rad.map(sent),
            joint_damping_nms_rad: self.joint_damping_nms_rad.map(sent),
            rate_filter_hz: self.rate_filter_hz.map(sent),
            joint1_integral_nm_rads: sent(self.joint1_integral_nm_rads),
            joint1_integral_limit_nm: sent(self.joint1_integral_limit_nm),
            force_integral_per_s: sent(self.force_integral_per_s),
            torque_loop_per_s: sent(self.torque_loop_per_s),
            torque_correction_limit_nm: sent(self.torque_correction_limit_nm),
            section_frequency_rad_s: sent(self.section_frequency_rad_s),
            section_damping: sent(self.section_damping),
            section_angle_nm_rad: self.section_angle_nm_rad.map(sent),
            section_force: self.section_force.map(sent),
            free: FreeParameters {
                stiffness_nm_rad: sent(self.free.stiffness_nm_rad),
                damping_nms_rad: sent(self.free.damping_nms_rad),
                torque_loop_per_s: sent(self.free.torque_loop_per_s),
                section_frequency_rad_s: sent(self.free.section_frequency_rad_s),
                section_damping: sent(self.free.section_damping),
                section_angle_nm_rad: self.free.section_angle_nm_rad.map(sent),
            },
            motion: self.motion.sent(),
        }
    }

    /// The contact set as if it were one of the air: what both have.
    pub(super) fn contact(&self) -> FreeParameters {
        FreeParameters {
            stiffness_nm_rad: self.joint_stiffness_nm_rad[1],
            damping_nms_rad: self.joint_damping_nms_rad[1],
            torque_loop_per_s: self.torque_loop_per_s,
            section_frequency_rad_s: self.section_frequency_rad_s,
            section_damping: self.section_damping,
            section_angle_nm_rad: self.section_angle_nm_rad,
        }
    }
}

impl FreeParameters {
    /// What the section's states come to under a lasting error of joint 2, N m/rad:
    /// `-A^-1 w g`, `[z g1 + q g2, z g2 - q g1]` with `q = sqrt(1 - z^2)`.
    pub(super) fn section_rest(&self) -> [f64; 2] {
        let (z, [g1, g2]) = (self.section_damping, self.section_angle_nm_rad);
        let square = 1.0 - z * z;
        let q = libm::sqrt(if square > 0.0 { square } else { 0.0 });
        [z * g1 + q * g2, z * g2 - q * g1]
    }

    /// The section's step from tick to tick, `exp(T A)`: what each state keeps of itself, and what
    /// it takes of the other.
    pub(super) fn rotation(&self, rate_hz: f64) -> [f64; 2] {
        let angle = self.section_frequency_rad_s / rate_hz;
        let square = 1.0 - self.section_damping * self.section_damping;
        let turn = libm::sqrt(if square > 0.0 { square } else { 0.0 });
        exponential([-self.section_damping * angle, turn * angle])
    }
}

/// exp of a complex number with a real part that is not positive: Taylor's series of a small part
/// of it, squared. A board makes its law itself, and the library's sines would take a third of
/// its image.
fn exponential([mut real, mut imaginary]: [f64; 2]) -> [f64; 2] {
    let mut squarings = 0;
    // Below 1/16 ten terms leave 1e-20; 1e4 rad/s at 10 Hz are 14 squarings.
    while squarings < 40 && !(libm::fabs(real) < 0.0625 && libm::fabs(imaginary) < 0.0625) {
        real *= 0.5;
        imaginary *= 0.5;
        squarings += 1;
    }
    let times = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a * c - b * d, a * d + b * c];
    // 1 + z (1 + z/2 (1 + z/3 ...)).
    let mut sum = [1.0, 0.0];
    for term in (1..=10).rev() {
        let n = f64::from(term);
        let [x, y] = times([real / n, imaginary / n], sum);
        sum = [1.0 + x, y];
    }
    for _ in 0..squarings {
        sum = times(sum, sum);
    }
    sum
}

//! Sets of gains as numbers that a search turns, and the sets that it starts from.

use super::problem::Scales;
use flexor::control::{FreeParameters, HybridParameters, MotionParameters};

/// The paper's arm's, which its gains belong to.
const PAPER_SCALES: Scales = Scales {
    frequency: 34.5,
    stiffness: 2.618,
    moment_nm: 1.1,
};

/// Numbers of a set in contact, of the order of 1 for an arm of the paper's proportions: logarithms
/// of K_IF, B2, its filter, k2, K_T and w, then z's logit, g, h.
pub(super) type Numbers = Vec<f64>;

/// The gains in contact that `numbers` are for an arm of the scales `s`; joint 1's are left open.
pub(super) fn contact_of(numbers: &[f64], s: &Scales) -> HybridParameters {
    let (time, stiffness) = (
        s.frequency / PAPER_SCALES.frequency,
        s.stiffness / PAPER_SCALES.stiffness,
    );
    let e = |i: usize| libm::exp(numbers[i].clamp(-14.0, 14.0));
    HybridParameters {
        force_integral_per_s: digits(e(0) * time),
        joint_damping_nms_rad: [0.0, digits(e(1) * stiffness / time)],
        rate_filter_hz: [30.0, digits((e(2) * time).min(1e5))],
        joint_stiffness_nm_rad: [0.0, digits(e(3) * stiffness)],
        torque_loop_per_s: digits(e(4) * time),
        section_frequency_rad_s: digits(e(5) * time),
        section_damping: digits(0.99 / (1.0 + libm::exp(-numbers[6]))),
        section_angle_nm_rad: [
            digits(numbers[7] * stiffness),
            digits(numbers[8] * stiffness),
        ],
        section_force: [digits(numbers[9]), digits(numbers[10])],
        torque_correction_limit_nm: digits(0.5 * s.moment_nm / PAPER_SCALES.moment_nm),
        ..HybridParameters::PAPER_ARM_HUB
    }
}

/// The numbers of gains of the paper's arm.
pub(super) fn numbers_of(p: &HybridParameters) -> Numbers {
    let ln = libm::log;
    let z = p.section_damping / 0.99;
    vec![
        ln(p.force_integral_per_s),
        ln(p.joint_damping_nms_rad[1]),
        ln(p.rate_filter_hz[1]),
        ln(p.joint_stiffness_nm_rad[1]),
        ln(p.torque_loop_per_s),
        ln(p.section_frequency_rad_s),
        ln(z / (1.0 - z)),
        p.section_angle_nm_rad[0],
        p.section_angle_nm_rad[1],
        p.section_force[0],
        p.section_force[1],
    ]
}

/// A set in the air: logarithms of k2, B2 and w, z's logit, g, K_T's logarithm.
pub(super) fn air_of(numbers: &[f64], s: &Scales) -> FreeParameters {
    let (time, stiffness) = (
        s.frequency / PAPER_SCALES.frequency,
        s.stiffness / PAPER_SCALES.stiffness,
    );
    let e = |i: usize| libm::exp(numbers[i].clamp(-14.0, 14.0));
    FreeParameters {
        stiffness_nm_rad: digits(e(0) * stiffness),
        damping_nms_rad: digits(e(1) * stiffness / time),
        torque_loop_per_s: digits(e(6) * time),
        section_frequency_rad_s: digits(e(2) * time),
        section_damping: digits(0.99 / (1.0 + libm::exp(-numbers[3]))),
        section_angle_nm_rad: [
            digits(numbers[4] * stiffness),
            digits(numbers[5] * stiffness),
        ],
    }
}

/// As [`numbers_of`].
pub(super) fn air_numbers_of(p: &FreeParameters) -> Numbers {
    let ln = libm::log;
    let z = p.section_damping / 0.99;
    vec![
        ln(p.stiffness_nm_rad),
        ln(p.damping_nms_rad),
        ln(p.section_frequency_rad_s),
        ln(z / (1.0 - z)),
        p.section_angle_nm_rad[0],
        p.section_angle_nm_rad[1],
        ln(p.torque_loop_per_s),
    ]
}

/// `value` to four digits: what a file shows is what was examined.
pub fn digits(value: f64) -> f64 {
    if !(value.abs() > 0.0 && value.is_finite()) {
        return 0.0;
    }
    let place = libm::floor(libm::log10(value.abs()));
    let scale = libm::pow(10.0, 3.0 - place);
    libm::round(value * scale) / scale
}

/// The paper's arm's gains for any hub: `examples/controller.toml`.
pub const PAPER_ARM_ANY_HUB: HybridParameters = HybridParameters {
    joint_stiffness_nm_rad: [800.0, 1.92],
    joint_damping_nms_rad: [60.0, 0.00334],
    rate_filter_hz: [30.0, 77.6],
    force_integral_per_s: 6.67,
    torque_loop_per_s: 6.44,
    section_frequency_rad_s: 24.3,
    section_damping: 0.708,
    section_angle_nm_rad: [1.99, 0.747],
    section_force: [0.193, 0.165],
    free: FreeParameters {
        stiffness_nm_rad: 2.0,
        damping_nms_rad: 4.93e-5,
        torque_loop_per_s: 0.5555,
        section_frequency_rad_s: 2.0,
        section_damping: 0.9793,
        section_angle_nm_rad: [1.111, -6.0],
    },
    // One of 500 bare arms finds the surface again only after 0.2 s at 0.4 s.
    motion: MotionParameters {
        lost_s: 0.25,
        ..MotionParameters::DEFAULT
    },
    ..HybridParameters::PAPER_ARM_HUB
};

/// Starts: both sets of the paper's arm, slower ones, and with less damping.
pub(super) fn starts(
    of: impl Fn(&HybridParameters) -> Numbers,
    slower: &[usize],
    damping: usize,
    wide: bool,
) -> Vec<Numbers> {
    let (slow, less): (&[f64], &[f64]) = match wide {
        false => (&[0.0, 0.8, 2.4], &[0.0, 1.5]),
        true => (&[0.0, 0.8, 2.4, 4.0], &[0.0, 1.5, 3.0, 4.5]),
    };
    let mut starts = vec![];
    for set in [HybridParameters::PAPER_ARM_HUB, PAPER_ARM_ANY_HUB] {
        for less in less {
            for slow in slow {
                let mut numbers = of(&set);
                slower.iter().for_each(|i| numbers[*i] -= slow);
                numbers[damping] -= less;
                starts.push(numbers);
            }
        }
    }
    starts
}

/// Starts in the air without the section: stiffness and damping alone.
pub(super) fn stiff_starts() -> Vec<Numbers> {
    let mut starts = vec![];
    for stiffness in [1.0, 2.0, 4.0] {
        for damping in [0.03, 0.01, 0.003, 0.001] {
            let k = libm::log(PAPER_SCALES.stiffness * stiffness);
            let slow = libm::log(2.0);
            starts.push(vec![k, libm::log(damping), slow, 0.0, 0.0, 0.0, slow]);
        }
    }
    starts
}

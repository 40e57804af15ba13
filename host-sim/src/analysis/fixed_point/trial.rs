//! Measurements that try a number type: random ones in the admissible range, and adversarial ones
//! at the ends of the formats.

use super::range::Analysis;
use crate::planner::plan::Plan;
use flexor::control::{HybridParameters, LawParameters, LimitParameters};
use flexor::number::fixed::Exponent;
use flexor::signals::{Formats, Measurement, Reference, Saturation};
use std::f64::consts::{PI, TAU};

/// Measurements of a random trial.
const RANDOM_TICKS: usize = 100_000;

/// What both controllers are fed with, tick by tick.
pub(super) struct Trial {
    /// Measurements, or what is measured beyond the plan.
    pub(super) measurements: Vec<Measurement<f64>>,
    /// They are beyond the plan.
    about_plan: bool,
    /// The first tick of a run is as planned, so that it begins on the surface.
    begins_as_planned: bool,
}

impl Trial {
    /// What is measured where `planned` is: `fresh` at the first tick of a run.
    pub(super) fn placed(
        &self,
        given: &Measurement<f64>,
        planned: &Reference<f64>,
        fresh: bool,
    ) -> Measurement<f64> {
        let begins = fresh && self.begins_as_planned;
        if !(self.about_plan || begins) {
            return *given;
        }
        let [theta10, theta20] = planned.angle;
        let as_planned = Measurement {
            angle: planned.angle,
            root_slope: planned.root_slope,
            root_slope_rate: planned.root_slope_rate,
            force: planned.force,
            motor: [theta10, theta20 - theta10 + planned.root_slope],
            root_moment: planned.torque[1],
            drive: given.drive,
        };
        if begins {
            return as_planned;
        }
        Measurement {
            force: as_planned.force + given.force,
            motor: [0, 1].map(|i| as_planned.motor[i] + given.motor[i]),
            root_moment: as_planned.root_moment + given.root_moment,
            ..as_planned
        }
    }
}

/// Random measurements for a law on a plan.
pub(super) fn random(
    plan: &Plan,
    law: &LawParameters,
    limits: &LimitParameters,
    analysis: &Analysis,
) -> Trial {
    let (range, about_plan) = match law {
        LawParameters::Paper(_) => (analysis.admissible(), false),
        LawParameters::Hybrid(law) => (deviations(plan, law, limits), true),
    };
    Trial {
        measurements: random_measurements(&range).take(RANDOM_TICKS).collect(),
        about_plan,
        begins_as_planned: about_plan,
    }
}

/// Largest deviations from the plan of a random trial of the hybrid law: of the motors what a tenth
/// of the torque that the limits leave answers, when they jump from one to the other; of the force
/// the planned one; of the root moment a tenth of its limit.
fn deviations(plan: &Plan, law: &HybridParameters, limits: &LimitParameters) -> Measurement<f64> {
    let rate = f64::from(plan.tick_rate_hz);
    let motor = [0, 1].map(|i| {
        let turned = TAU * law.rate_filter_hz[i] / rate;
        let damping = 2.0 * turned / (1.0 + turned) * law.joint_damping_nms_rad[i] * rate;
        let answered = law.joint_stiffness_nm_rad[i] + damping;
        let left = limits.torque_nm[i] - plan.peaks.torque[i];
        (0.1 * left.max(0.0) / answered.max(1e-9)).min(0.1)
    });
    Measurement {
        motor,
        force: plan.task.normal_force.largest(),
        root_moment: 0.1 * limits.torque_nm[1],
        ..Measurement::default()
    }
}

/// Adversarial measurements for a law with signals of these formats.
pub(super) fn adversarial(law: &LawParameters, formats: &Formats<Exponent>) -> Trial {
    Trial {
        measurements: adversarial_measurements(&ends(formats)).collect(),
        about_plan: false,
        begins_as_planned: matches!(law, LawParameters::Hybrid(_)),
    }
}

/// The ends of the formats' ranges.
pub fn ends(formats: &Formats<Exponent>) -> Measurement<f64> {
    Measurement {
        angle: [PI; 2],
        root_slope: formats.root_slope.range(),
        root_slope_rate: formats.slope_rate.range(),
        force: formats.force.range(),
        // No two of them are half a turn apart, where a difference has no sign.
        motor: [0.7 * PI; 2],
        root_moment: formats.torque[1].range(),
        drive: [Saturation::None; 2],
    }
}

/// Measurements over the whole of `range`: a quasi-random sequence (additive, with the
/// powers of the root of x^6 = x + 1), one value in eight at an end.
pub fn random_measurements(range: &Measurement<f64>) -> impl Iterator<Item = Measurement<f64>> {
    const ROOT: f64 = 1.134_724_138_401_519_4;
    let range = *range;
    (1_u32..).map(move |i| {
        let fraction = |k: i32| (f64::from(i) * libm::pow(ROOT, f64::from(-k))).fract();
        let value = |k: i32, range: f64| match (fraction(k) * 16.0) as u32 {
            0 => -range,
            15 => range,
            _ => range * (fraction(k) - 0.5) / 0.4375,
        };
        Measurement {
            angle: [value(1, range.angle[0]), value(2, range.angle[1])],
            root_slope: value(3, range.root_slope),
            root_slope_rate: value(4, range.root_slope_rate),
            force: value(5, range.force),
            motor: [value(1, range.motor[0]), value(2, range.motor[1])],
            root_moment: value(3, range.root_moment),
            drive: [Saturation::None; 2],
        }
    })
}

/// Measurements at the ends of `range` and at zero: each combination held for 40 ticks,
/// then flipped from tick to tick for 10; then the same with drives that limit.
pub fn adversarial_measurements(
    range: &Measurement<f64>,
) -> impl Iterator<Item = Measurement<f64>> {
    const SIDES: [Saturation; 3] = [Saturation::None, Saturation::Upper, Saturation::Lower];
    let range = *range;
    (0..3 * 81 * 50_usize).map(move |i| {
        let (combination, tick) = (i / 50, i % 50);
        let flip = if tick >= 40 && tick % 2 == 1 {
            -1.0
        } else {
            1.0
        };
        let side = |digit: u32| flip * ((combination / 3_usize.pow(digit)) % 3) as f64 - flip;
        Measurement {
            angle: [side(1) * range.angle[0], side(2) * range.angle[1]],
            root_slope: side(3) * range.root_slope,
            root_slope_rate: side(3) * range.root_slope_rate,
            force: side(0) * range.force,
            motor: [side(1) * range.motor[0], side(2) * range.motor[1]],
            root_moment: side(3) * range.root_moment,
            drive: [SIDES[combination / 81], SIDES[(combination / 81) % 2]],
        }
    })
}

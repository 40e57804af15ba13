//! Range analysis for the fixed-point tick: how far each signal may go, the format that
//! holds it, and how exact a torque then is.
//!
//! [`analyse`] computes it from arm, task (its plan and table), gains and limits, and
//! refuses what 32 bits cannot hold exactly enough, naming the signal or the gain.
//!
//! **Ranges.** A signal's *admissible* range is what the arm can do under this controller;
//! its format holds that range and what the tick computes from it.
//!
//! | signal | admissible | format holds |
//! |---|---|---|
//! | torque | the limit; the plan where that is more | twice that: a torque that saturates lies beyond the limit by as much again |
//! | force | planned, and what a drive from its planned torque to its limit presses with where its moment arm is longest | twice that (the filter sees differences of errors) |
//! | root slope | a quarter turn | the same |
//! | root slope rate | planned and what K_w answers with twice limit and plan of joint 2, at least 10 rad/s | twice that |
//! | moment arm | r1 + r2 | the same |
//!
//! The force's range is raised further if products of moment arm and force would otherwise not
//! reach the torque's range.
//!
//! The rates of the hybrid law's motors have a format of their own, [`RATE_MAX_RAD_S`] at least; its
//! states are torques, forces and angles.
//!
//! **Error.** [`Analysis::torque_error`] bounds how far a tick's torque is from that of
//! exact arithmetic with the same saturations, the same table and the same memory
//! (filters, integral, previous torque); [`Analysis::run_error`] how far it is at any tick of the
//! plan, with a memory of its own. Their derivation is in `docs/fixed-point.md`.
//!
//! [`RATE_MAX_RAD_S`]: flexor::control::RATE_MAX_RAD_S

use super::bound::Bound;
pub use super::signal::Signal;
use super::signal::{FORCE, ROOT_SLOPE, SLOPE_RATE};
use crate::planner::plan::Plan;
use crate::text::{Shortest, four_digits};
use flexor::control::{Coefficient, Coefficients, Law, LawParameters, LimitParameters, Mismatch};
use flexor::number::fixed::{Exponent, Fixed};
use flexor::signals::{Formats, Measurement};
use flexor::table::{Header, Table};
use std::f64::consts::{FRAC_PI_2, PI};

/// Largest accepted bound of a torque's error, as a share of the joint's largest planned
/// torque: a thousandth is far below what friction leaves unknown.
pub const TORQUE_ERROR_SHARE: f64 = 1e-3;

/// Largest accepted rounding of a gain, as a share of it.
pub const GAIN_ERROR_SHARE: f64 = 1e-3;

/// What fixed point needs for an arm, a task, gains and limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Analysis {
    /// Every signal.
    pub signals: [Signal; 6],
    /// Coefficients with the formats.
    pub coefficients: Coefficients<Fixed>,
    /// Bound of each joint's torque error in one tick, N m.
    pub torque_error: [f64; 2],
    /// The same at any tick of the plan, with what the law's memory has gathered until then, N m.
    pub run_error: [f64; 2],
    /// Bound of the force error's error in one tick, N: what the integral may gather.
    pub force_error: f64,
}

/// Why an arm or task cannot run in fixed point.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RangeError {
    /// A signal's range is too large for its bits.
    #[error(
        "fixed point cannot hold the signal '{signal}': its range of {} {unit} leaves torque {joint} uncertain by {} N m, up to {} is accepted; narrow the torque limits or lower the gains",
        four_digits(*range),
        four_digits(*error_nm),
        four_digits(*accepted_nm)
    )]
    Signal {
        /// The signal that contributes most.
        signal: &'static str,
        /// Its format's range.
        range: f64,
        /// Its unit.
        unit: &'static str,
        /// The joint.
        joint: usize,
        /// Bound of the torque's error, N m.
        error_nm: f64,
        /// Largest accepted, N m.
        accepted_nm: f64,
    },
    /// A gain or length is rounded too much.
    #[error(
        "{name} = {} would be {} in fixed point: it is too large or too small for the signals' ranges",
        Shortest(*wanted),
        four_digits(*is)
    )]
    Coefficient {
        /// The key in the file.
        name: &'static str,
        /// Its value; of filters, their coefficient at the tick rate.
        wanted: f64,
        /// What it would become.
        is: f64,
    },
    /// The table holds values beyond the plan's.
    #[error(transparent)]
    Table(#[from] Mismatch),
}

/// Ranges, formats and coefficients for `plan` with `image`, its table.
///
/// # Errors
/// [`RangeError`] for what does not fit.
pub fn analyse(
    plan: &Plan,
    image: &[u8],
    law: &LawParameters,
    limits: &LimitParameters,
) -> Result<Analysis, RangeError> {
    let table = Table::open(image).map_err(Mismatch::from)?;
    let header = table.header();
    let signals = signals(plan, header, law, limits);
    let [torque1, torque2, force, root_slope, slope_rate, moment_arm] = signals.map(|s| s.exponent);
    let formats = Formats {
        torque: [torque1, torque2],
        force,
        root_slope,
        slope_rate,
        moment_arm,
    };
    let arm = &plan.model.arm;
    let rate = header.tick_rate_hz;
    let coefficients = Coefficients::<Fixed>::new(arm, law, limits, rate, &formats);
    let rounded: Vec<Coefficient> = match (coefficients.law(), law) {
        (Law::Paper(rounded), LawParameters::Paper(law)) => {
            rounded.coefficients(law, arm, rate, &formats).into()
        }
        (Law::Hybrid(rounded), LawParameters::Hybrid(law)) => {
            rounded.coefficients(law, arm, rate, &formats).collect()
        }
        // A law's coefficients are its own.
        _ => vec![],
    };
    for c in rounded {
        if !((c.is - c.wanted).abs() <= GAIN_ERROR_SHARE * c.wanted.abs()) {
            return Err(RangeError::Coefficient {
                name: c.name,
                wanted: c.wanted,
                is: c.is,
            });
        }
    }
    let bound = Bound::new(&signals, header, law, (plan, limits));
    let torque_error = [0, 1].map(|joint| bound.tick(joint));
    for joint in 0..2 {
        let accepted_nm = TORQUE_ERROR_SHARE * plan.peaks.torque[joint];
        let error_nm = torque_error[joint];
        if !(error_nm <= accepted_nm) {
            let (at, _) = bound.parts[joint]
                .into_iter()
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap_or_default();
            return Err(RangeError::Signal {
                signal: signals[at].name,
                range: signals[at].exponent.range(),
                unit: signals[at].unit,
                joint: joint + 1,
                error_nm,
                accepted_nm,
            });
        }
    }
    Ok(Analysis {
        signals,
        coefficients,
        torque_error,
        run_error: [0, 1].map(|joint| torque_error[joint] + bound.gathered[joint]),
        force_error: bound.force,
    })
}

/// Range of the root slope rate, rad/s: the plan's and what joint 2's torque, N m, answers.
fn slope_rate_range(plan: &Plan, law: &LawParameters, torque2: f64) -> f64 {
    let rates = plan.points.iter().map(|p| p.root_slope_rate.abs());
    let planned = rates.fold(0.0, f64::max);
    let gain = law.paper().map_or(0.0, |law| law.slope_rate_nms_rad);
    let answered = 2.0 * (torque2 + plan.peaks.torque[1]) / gain.abs();
    planned
        + if answered.is_finite() {
            answered.max(10.0)
        } else {
            10.0
        }
}

/// Ranges and formats of all signals.
fn signals(
    plan: &Plan,
    header: &Header,
    law: &LawParameters,
    limits: &LimitParameters,
) -> [Signal; 6] {
    let arm = &plan.model.arm;
    let normal = plan.normal_angle();
    let largest = |f: &dyn Fn(&crate::planner::plan::PlanPoint) -> f64| {
        plan.points.iter().map(|p| f(p).abs()).fold(0.0, f64::max)
    };
    let torque = [0, 1].map(|i| limits.torque_nm[i].max(plan.peaks.torque[i]));
    let moment_arm2 = |p: &crate::planner::plan::PlanPoint| {
        arm.link2_length_m * libm::sin(normal - p.joint.angle[1])
    };
    let moment_arm1 = |p: &crate::planner::plan::PlanPoint| {
        arm.link1_length_m * libm::sin(normal - p.joint.angle[0]) + moment_arm2(p)
    };
    let moment_arms = [largest(&moment_arm1), largest(&moment_arm2)];
    let pressed = [0, 1].map(|i| (torque[i] + plan.peaks.torque[i]) / moment_arms[i].max(1e-6));
    let force = plan.task.normal_force.largest() + pressed[0].max(pressed[1]);
    let slope_rate = slope_rate_range(plan, law, torque[1]);
    let moment_arm = arm.link1_length_m + arm.link2_length_m;

    // A table's column may reach 2^30 of its integers.
    let columns = |first: usize, last: usize| {
        let scaling = header.scaling[first..=last]
            .iter()
            .map(|s| 31 - i32::from(*s));
        scaling.max().unwrap_or(0) as i8
    };
    let holding = |magnitude: f64, column: i8| Exponent(Exponent::holding(magnitude).0.max(column));
    let moment_arm_format = Exponent::holding(moment_arm);
    let torque_format = [0, 1].map(|i| holding(2.0 * torque[i], columns(i, i)));
    // Products of moment arm and force are shifted left, by none or more.
    let reaching = torque_format.map(|t| t.0 - moment_arm_format.0 - 1);
    let force_format = holding(2.0 * force, columns(2, 2).max(reaching[0]).max(reaching[1]));
    let signal = |name, unit, admissible, exponent| Signal {
        name,
        unit,
        admissible,
        exponent,
    };
    [
        signal("torque1", "N m", torque[0], torque_format[0]),
        signal("torque2", "N m", torque[1], torque_format[1]),
        signal("force", "N", force, force_format),
        signal(
            "root_slope",
            "rad",
            FRAC_PI_2,
            holding(FRAC_PI_2, columns(5, 5)),
        ),
        signal(
            "slope_rate",
            "rad/s",
            slope_rate,
            holding(2.0 * slope_rate, columns(6, 6)),
        ),
        signal("moment_arm", "m", moment_arm, moment_arm_format),
    ]
}

impl Analysis {
    /// Formats of the signals.
    pub fn formats(&self) -> &Formats<Exponent> {
        &self.coefficients.formats
    }

    /// The largest admissible measurement.
    pub fn admissible(&self) -> Measurement<f64> {
        let range = |i: usize| self.signals[i].admissible;
        Measurement {
            angle: [PI; 2],
            root_slope: range(ROOT_SLOPE),
            root_slope_rate: range(SLOPE_RATE),
            force: range(FORCE),
            ..Measurement::default()
        }
    }
}

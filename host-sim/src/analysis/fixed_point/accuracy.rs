//! How exact a tick is in f32 and in fixed point, against f64.
//!
//! Three trials, from the kind to the hostile:
//!
//! - **closed loop**: the task on a simulated arm, once in f64 and once in the number type,
//!   each with an arm of its own. What differs is the number type and all that follows
//!   from it.
//! - **random**: quasi-random measurements over the whole admissible range of each signal,
//!   one in eight values at an end of it, fed to both controllers alike. For the hybrid law they
//!   are about the plan: motors that are off it by as much as a few tenths of a torque limit answer,
//!   and forces from none to twice the planned one.
//! - **adversarial**: every measured value at the ends of its fixed-point format or zero,
//!   held until the integral is wound up, then flipping from tick to tick (derivative
//!   spikes); drives that limit; the paper's law with gains on force, derivative, integral and slope
//!   rate. In fixed point signals saturate here, so the reference is [`Exact`], which
//!   saturates as they do and rounds nothing.
//!
//! **Verdict** ([`Accuracy::excess`]). Fixed point must stay within the bound of
//! [`super::range::Analysis::run_error`] in all of them; f32, whose sums round at every tick and so
//! have no useful bound, within [`range::TORQUE_ERROR_SHARE`] of each joint's planned peak in the
//! first two.

use super::exact::Exact;
use super::trial::{Trial, adversarial, random};
use crate::analysis::fixed_point::range;
use crate::analysis::fixed_point::range::RangeError;
use crate::planner::plan::Plan;
use crate::simulation::closed_loop::{Run, RunError, RunOptions, Simulation, Step};
use crate::simulation::start::plant_for;
use flexor::control::{Coefficients, Controller, LawParameters, LimitParameters, PaperParameters};
use flexor::number::TableScalar;
use flexor::number::fixed::Fixed;
use flexor::phase::Phase;
use flexor::signals::{Formats, Measurement, SaturationCounts};
use flexor::table::Table;

/// Errors of a trial's torques.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Of both joints' torques together: root of the mean square, N m.
    pub rms_nm: f64,
    /// Largest magnitude, N m.
    pub max_nm: f64,
    /// The same of each joint, N m.
    pub joint_max_nm: [f64; 2],
    /// What each joint's may be, N m; infinite where there is no bound.
    pub bound_nm: [f64; 2],
    /// SaturationCounts of all signals.
    pub saturations: u32,
    /// Ticks in which a limit, or a state of the motion, was met by one of the two alone.
    pub parted: usize,
    /// Ticks.
    pub ticks: usize,
}

/// How exact a number type is.
#[derive(Clone, Debug)]
pub struct Accuracy {
    /// The number type's name.
    pub number: &'static str,
    /// The task in closed loop.
    pub closed_loop: Errors,
    /// Largest difference of the contact forces there, N.
    pub force_difference_max_n: f64,
    /// Bits of a converter over the joint's range of torques that has the same root mean
    /// square error, for the worse joint.
    pub effective_bits: f64,
    /// Random measurements.
    pub random: Errors,
    /// Adversarial ones.
    pub adversarial: Errors,
    /// The same against f64 without saturations; for f32 no different.
    pub adversarial_f64: Errors,
    /// Time, s, and torque errors of joint 1 and 2, N m, in closed loop.
    pub trace: Vec<(f64, [f64; 2])>,
}

/// Why accuracy cannot be measured.
#[derive(Debug, thiserror::Error)]
pub enum AccuracyError {
    /// The task does not fit fixed point.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// No run.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// Share of the ticks in which fixed point may decide otherwise than what it is compared with.
pub const PARTED_SHARE: f64 = 1e-3;

/// Ticks of the closed loop that [`measure`] runs: the bulk of its work.
pub fn effort(plan: &Plan) -> u64 {
    3 * plan.points.len() as u64
}

/// A run in fixed point: the run, and what saturated.
///
/// # Errors
/// [`AccuracyError`].
pub fn run_fixed(
    plan: &Plan,
    image: &[u8],
    options: &RunOptions,
    observe: impl FnMut(&Step<Fixed>),
) -> Result<(Run, SaturationCounts<u32>), AccuracyError> {
    let law = options.law.without_settling();
    let analysis = range::analyse(plan, image, &law, &options.limits)?;
    let table = Table::open(image).map_err(RunError::from)?;
    let controller = Controller::with(&table, &analysis.coefficients).map_err(RunError::from)?;
    let plant = plant_for(plan, &options.plant, options.start).map_err(RunError::from)?;
    let mut simulation = Simulation::with_controller(plan, controller, analysis.formats(), plant);
    let run = simulation.run(observe);
    Ok((run, *simulation.controller().saturations()))
}

/// Accuracy of f32 and of fixed point. `progress` is called [`effort`] times, less often
/// where a run breaks off.
///
/// # Errors
/// [`AccuracyError`].
pub fn measure(
    plan: &Plan,
    image: &[u8],
    options: &RunOptions,
    progress: &dyn Fn(),
) -> Result<[Accuracy; 2], AccuracyError> {
    let reference = Simulation::<f64>::new(plan, image, options)?.run(|_| progress());
    let single = Simulation::<f32>::new(plan, image, options)?.run(|_| progress());
    let (fixed, saturations) = run_fixed(plan, image, options, |_| progress())?;
    let (law, limits) = (&options.law.without_settling(), &options.limits);
    let analysis = range::analyse(plan, image, law, limits)?;
    let accepted = [0, 1].map(|i| range::TORQUE_ERROR_SHARE * plan.peaks.torque[i]);
    let mut accuracies = [
        compare("f32", &reference, &single),
        compare("fixed", &reference, &fixed),
    ];
    accuracies[1].closed_loop.saturations = saturations.total();
    accuracies[0].closed_loop.bound_nm = accepted;
    accuracies[1].closed_loop.bound_nm = analysis.run_error;

    let table = Table::open(image).map_err(RunError::from)?;
    let total = SaturationCounts::<u32>::total;
    let single = float_coefficients::<f32>(plan, law, limits);
    let exact = float_coefficients::<f64>(plan, law, limits);
    let trial = random(plan, law, limits, &analysis);
    accuracies[0].random =
        side_by_side(&table, &single, &exact, none, (&trial, true))?.within(accepted);
    accuracies[1].random = side_by_side(
        &table,
        &analysis.coefficients,
        &exact,
        total,
        (&trial, true),
    )?
    .within(analysis.run_error);

    // The hostile law has formats of its own.
    let hostile = match law {
        LawParameters::Paper(paper) => hostile_law(paper, plan.tick_rate_hz).into(),
        LawParameters::Hybrid(_) => *law,
    };
    let analysis = range::analyse(plan, image, &hostile, limits)?;
    let single = float_coefficients::<f32>(plan, &hostile, limits);
    let exact = float_coefficients::<f64>(plan, &hostile, limits);
    let trial = adversarial(&hostile, analysis.formats());
    accuracies[0].adversarial = side_by_side(&table, &single, &exact, none, (&trial, true))?;
    accuracies[0].adversarial_f64 = accuracies[0].adversarial;
    let fixed = &analysis.coefficients;
    accuracies[1].adversarial_f64 = side_by_side(&table, fixed, &exact, total, (&trial, false))?;
    let (arm, rate) = (&plan.model.arm, plan.tick_rate_hz);
    let exact = Coefficients::<Exact>::new(arm, &hostile, limits, rate, analysis.formats());
    accuracies[1].adversarial =
        side_by_side(&table, fixed, &exact, total, (&trial, true))?.within(analysis.run_error);
    Ok(accuracies)
}

fn float_coefficients<T: TableScalar<Format = ()>>(
    plan: &Plan,
    law: &LawParameters,
    limits: &LimitParameters,
) -> Coefficients<T> {
    let rate = plan.tick_rate_hz;
    Coefficients::new(&plan.model.arm, law, limits, rate, &Formats::default())
}

/// `law` with every term at work.
pub fn hostile_law(law: &PaperParameters, tick_rate_hz: u32) -> PaperParameters {
    PaperParameters {
        force_derivative_s: 20.0 / f64::from(tick_rate_hz),
        force_proportional: 0.5,
        force_integral_per_s: 50.0,
        force_filter_hz: Some(0.02 * f64::from(tick_rate_hz)),
        ..*law
    }
}

/// Compares two runs of one task.
fn compare(number: &'static str, reference: &Run, run: &Run) -> Accuracy {
    let pairs = || reference.rows.iter().zip(&run.rows);
    let trace: Vec<(f64, [f64; 2])> = pairs()
        .map(|(a, b)| (a.t, [0, 1].map(|joint| b.torque[joint] - a.torque[joint])))
        .collect();
    let mean_square = |joint: usize| {
        let sum: f64 = trace
            .iter()
            .map(|(_, error)| error[joint] * error[joint])
            .sum();
        sum / trace.len().max(1) as f64
    };
    let bits = [0, 1].map(|joint| {
        let range = 2.0 * reference.summary.torque_max[joint];
        libm::log2(range / (12.0 * mean_square(joint)).sqrt())
    });
    let mut errors = Tally::default();
    for (_, error) in &trace {
        errors.add(*error);
    }
    Accuracy {
        number,
        closed_loop: errors.errors(0),
        force_difference_max_n: pairs()
            .map(|(a, b)| (b.reading.force - a.reading.force).abs())
            .fold(0.0, f64::max),
        effective_bits: bits[0].min(bits[1]),
        random: Errors::default(),
        adversarial: Errors::default(),
        adversarial_f64: Errors::default(),
        trace,
    }
}

impl Default for Errors {
    fn default() -> Self {
        Self {
            rms_nm: 0.0,
            max_nm: 0.0,
            joint_max_nm: [0.0; 2],
            bound_nm: [f64::INFINITY; 2],
            saturations: 0,
            parted: 0,
            ticks: 0,
        }
    }
}

impl Errors {
    /// The same, which may be as large as this.
    fn within(self, bound_nm: [f64; 2]) -> Self {
        Self { bound_nm, ..self }
    }

    /// The joints, 1 and 2, whose largest error is above its bound.
    fn above(&self) -> impl Iterator<Item = usize> + '_ {
        // Not a number is above, too.
        let holds = |joint: &usize| self.joint_max_nm[*joint] <= self.bound_nm[*joint];
        [0, 1].into_iter().filter(move |joint| !holds(joint))
    }
}

impl Accuracy {
    /// The trials by name.
    pub fn trials(&self) -> [(&'static str, &Errors); 4] {
        [
            ("closed loop", &self.closed_loop),
            ("random", &self.random),
            ("adversarial", &self.adversarial),
            ("the same, f64", &self.adversarial_f64),
        ]
    }

    /// What is above its bound, in words; nothing where the number type is as exact as stated.
    pub fn excess(&self) -> Vec<String> {
        let of_trial = |(trial, errors): (&'static str, &Errors)| {
            let said = |joint: usize| {
                let (is, bound) = (errors.joint_max_nm[joint], errors.bound_nm[joint]);
                let (number, joint) = (self.number, joint + 1);
                format!(
                    "{number}, {trial}: torque {joint} is off by {is:.1e} N m, its bound is {bound:.1e}"
                )
            };
            let mut excess: Vec<String> = errors.above().map(said).collect();
            let (parted, ticks) = (errors.parted, errors.ticks);
            if errors.bound_nm[0].is_finite() && parted as f64 > PARTED_SHARE * ticks as f64 {
                let number = self.number;
                excess.push(format!(
                    "{number}, {trial}: limits were met otherwise in {parted} of {ticks} ticks, in more than {PARTED_SHARE} of them"
                ));
            }
            excess
        };
        self.trials().into_iter().flat_map(of_trial).collect()
    }
}

/// Adds up errors.
#[derive(Default)]
struct Tally {
    squares: f64,
    max: [f64; 2],
    parted: usize,
    ticks: usize,
}

impl Tally {
    fn add(&mut self, error: [f64; 2]) {
        for (error, max) in error.into_iter().zip(&mut self.max) {
            self.squares += error * error;
            // What is not a number must not get lost.
            *max = if error.is_nan() {
                f64::INFINITY
            } else {
                max.max(error.abs())
            };
        }
        self.ticks += 1;
    }

    fn errors(&self, saturations: u32) -> Errors {
        Errors {
            rms_nm: (self.squares / (2 * self.ticks).max(1) as f64).sqrt(),
            max_nm: self.max[0].max(self.max[1]),
            joint_max_nm: self.max,
            saturations,
            parted: self.parted,
            ticks: self.ticks,
            ..Errors::default()
        }
    }
}

/// Runs two controllers on a trial's measurements, rounded to `T` first; both start again
/// at the table's end, or where the motion has come to its end. Counts what saturates in the first.
///
/// Where a torque is within its rounding of a limit, one of them may be limited and take back what
/// the other keeps. From there on they differ by that decision and not by their arithmetic: with
/// `together` they then start again.
fn side_by_side<T: TableScalar, R: TableScalar>(
    table: &Table,
    coefficients: &Coefficients<T>,
    reference: &Coefficients<R>,
    total: impl Fn(&SaturationCounts<T::SaturationCount>) -> u32,
    (trial, together): (&Trial, bool),
) -> Result<Errors, RunError> {
    let mut controller = Controller::with(table, coefficients)?;
    let mut exact = Controller::with(table, reference)?;
    let (formats, exact_formats) = (&coefficients.formats, &reference.formats);
    let mut tally = Tally::default();
    let mut saturations = 0;
    let mut plan = table.cursor::<f64>();
    let mut fresh = true;
    let mut parted = false;
    for measured in &trial.measurements {
        let over = controller.at_end() || controller.phase() == Phase::Hold;
        if (over || parted && together) && !fresh {
            saturations += total(controller.saturations());
            controller.restart();
            exact.restart();
            plan = table.cursor();
            fresh = true;
        }
        let measured = trial.placed(measured, &plan.row(), fresh);
        fresh = false;
        let rounded = Measurement::<T>::from_si(&measured, formats);
        let same = Measurement::<R>::from_si(&rounded.to_si(formats), exact_formats);
        let (is, should) = (controller.tick(&rounded), exact.tick(&same));
        while plan.tick() < is.tick {
            plan.advance();
        }
        parted = (is.saturation, is.phase) != (should.saturation, should.phase);
        tally.parted += usize::from(parted);
        tally.add([0, 1].map(|joint| {
            is.torque[joint].to_si(formats.torque[joint])
                - should.torque[joint].to_si(exact_formats.torque[joint])
        }));
    }
    saturations += total(controller.saturations());
    Ok(tally.errors(saturations))
}

/// What a float's controller counts.
fn none(_: &SaturationCounts<()>) -> u32 {
    0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_above_its_bound_is_named() {
        let errors = |second: f64, parted: usize| Errors {
            joint_max_nm: [1e-3, second],
            bound_nm: [2e-3, 1e-3],
            parted,
            ticks: 1000,
            ..Errors::default()
        };
        let accuracy = |random: Errors| Accuracy {
            number: "fixed",
            closed_loop: Errors::default(),
            force_difference_max_n: 0.0,
            effective_bits: 0.0,
            random,
            adversarial: Errors::default(),
            adversarial_f64: Errors {
                joint_max_nm: [9.0; 2],
                ..Errors::default()
            },
            trace: vec![],
        };
        assert!(accuracy(errors(1e-3, 1)).excess().is_empty());
        for bad in [2e-3, f64::NAN, f64::INFINITY] {
            let excess = accuracy(errors(bad, 0)).excess();
            assert_eq!(excess.len(), 1);
            assert!(
                excess[0].starts_with("fixed, random: torque 2 is off by "),
                "{excess:?}"
            );
        }
        let excess = accuracy(errors(1e-3, 2)).excess();
        assert!(excess[0].contains("in 2 of 1000 ticks"), "{excess:?}");
        let mut tally = Tally::default();
        tally.add([f64::NAN, 1.0]);
        assert_eq!(tally.errors(0).joint_max_nm, [f64::INFINITY, 1.0]);
    }
}

//! How exact a tick is in f32 and in fixed point, against f64.
//!
//! Three trials, from the kind to the hostile:
//!
//! - **closed loop**: the task on a simulated arm, once in f64 and once in the number type,
//!   each with an arm of its own. What differs is the number type and all that follows
//!   from it.
//! - **random**: quasi-random measurements over the whole admissible range of each signal,
//!   one in eight values at an end of it, fed to both controllers alike.
//! - **adversarial**: every measured value at the ends of its fixed-point format or zero,
//!   held until the integral is wound up, then flipping from tick to tick (derivative
//!   spikes); drives that limit; with gains on force, derivative, integral and slope rate.
//!   In fixed point signals saturate here, so the reference is [`Exact`], which
//!   saturates as they do and rounds nothing.

use super::exact::Exact;
use crate::analysis::fixed_point::range;
use crate::analysis::fixed_point::range::RangeError;
use crate::planner::plan::Plan;
use crate::simulation::closed_loop::{Run, RunError, RunOptions, Simulation, Step};
use crate::simulation::start::plant_for;
use flexor::control::{Coefficients, Controller, LawParameters, LimitParameters, PaperParameters};
use flexor::number::TableScalar;
use flexor::number::fixed::{Exponent, Fixed};
use flexor::signals::{Formats, Measurement, Saturation, SaturationCounts};
use flexor::table::Table;

/// Errors of a trial's torques.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Of both joints' torques together: root of the mean square, N m.
    pub rms_nm: f64,
    /// Largest magnitude, N m.
    pub max_nm: f64,
    /// SaturationCounts of all signals.
    pub saturations: u32,
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

/// Random measurements of the second trial.
pub const RANDOM_TICKS: usize = 100_000;

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
    let analysis = range::analyse(plan, image, &options.law, &options.limits)?;
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
    let (law, limits) = (&options.law, &options.limits);
    let analysis = range::analyse(plan, image, law, limits)?;
    let LawParameters::Paper(paper) = law else {
        return Err(RangeError::Law { name: law.name() }.into());
    };
    let hostile = hostile_law(paper, plan.tick_rate_hz).into();
    let mut accuracies = [
        compare("f32", &reference, &single),
        compare("fixed", &reference, &fixed),
    ];
    accuracies[1].closed_loop.saturations = saturations.total();

    let table = Table::open(image).map_err(RunError::from)?;
    let range = analysis.admissible();
    let random = || random_measurements(&range).take(RANDOM_TICKS);
    let single = float_coefficients::<f32>(plan, law, limits);
    let exact = float_coefficients::<f64>(plan, law, limits);
    accuracies[0].random = side_by_side(&table, &single, &exact, none, random())?;
    let total = SaturationCounts::<u32>::total;
    accuracies[1].random = side_by_side(&table, &analysis.coefficients, &exact, total, random())?;

    // The hostile law has formats of its own.
    let analysis = range::analyse(plan, image, &hostile, limits)?;
    let formats = *analysis.formats();
    let ends = ends(&formats);
    let single = float_coefficients::<f32>(plan, &hostile, limits);
    let exact = float_coefficients::<f64>(plan, &hostile, limits);
    let adversarial = || adversarial_measurements(&ends);
    accuracies[0].adversarial = side_by_side(&table, &single, &exact, none, adversarial())?;
    accuracies[0].adversarial_f64 = accuracies[0].adversarial;
    let fixed = &analysis.coefficients;
    accuracies[1].adversarial_f64 = side_by_side(&table, fixed, &exact, total, adversarial())?;
    let (arm, rate) = (&plan.model.arm, plan.tick_rate_hz);
    let exact = Coefficients::<Exact>::new(arm, &hostile, limits, rate, &formats);
    accuracies[1].adversarial = side_by_side(&table, fixed, &exact, total, adversarial())?;
    Ok(accuracies)
}

/// The ends of the formats' ranges.
pub fn ends(formats: &Formats<Exponent>) -> Measurement<f64> {
    Measurement {
        angle: [std::f64::consts::PI; 2],
        root_slope: formats.root_slope.range(),
        root_slope_rate: formats.slope_rate.range(),
        force: formats.force.range(),
        motor: [std::f64::consts::PI; 2],
        root_moment: formats.torque[1].range(),
        drive: [Saturation::None; 2],
    }
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

/// Adds up errors.
#[derive(Default)]
struct Tally {
    squares: f64,
    max: f64,
    ticks: usize,
}

impl Tally {
    fn add(&mut self, error: [f64; 2]) {
        for error in error {
            self.squares += error * error;
            self.max = self.max.max(error.abs());
        }
        self.ticks += 1;
    }

    fn errors(&self, saturations: u32) -> Errors {
        Errors {
            rms_nm: (self.squares / (2 * self.ticks).max(1) as f64).sqrt(),
            max_nm: self.max,
            saturations,
            ticks: self.ticks,
        }
    }
}

/// Runs two controllers on the same measurements, rounded to `T` first; both start again
/// at the table's end. Counts what saturates in the first.
fn side_by_side<T: TableScalar, R: TableScalar>(
    table: &Table,
    coefficients: &Coefficients<T>,
    reference: &Coefficients<R>,
    total: impl Fn(&SaturationCounts<T::SaturationCount>) -> u32,
    measurements: impl Iterator<Item = Measurement<f64>>,
) -> Result<Errors, RunError> {
    let mut controller = Controller::with(table, coefficients)?;
    let mut exact = Controller::with(table, reference)?;
    let (formats, exact_formats) = (&coefficients.formats, &reference.formats);
    let mut tally = Tally::default();
    let mut saturations = 0;
    for measured in measurements {
        if controller.at_end() {
            saturations += total(controller.saturations());
            controller.restart();
            exact.restart();
        }
        let rounded = Measurement::<T>::from_si(&measured, formats);
        let same = Measurement::<R>::from_si(&rounded.to_si(formats), exact_formats);
        let (is, should) = (controller.tick(&rounded), exact.tick(&same));
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
            ..Measurement::default()
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
            drive: [SIDES[combination / 81], SIDES[(combination / 81) % 2]],
            ..Measurement::default()
        }
    })
}

//! The controller and the plant in lock-step: measure, tick, hold, again. The
//! simulation owns time; nothing waits for a clock.

use crate::planner::plan::Plan;
use crate::plant::{PlantError, PlantParameters, Reading};
use crate::simulation::start::{Start, plant_for};
use flexor::control::{Command, Controller, LawParameters, LimitParameters, Mismatch};
use flexor::number::Scalar;
use flexor::signals::{Formats, Measurement, Saturation};
use flexor::table::{Table, TableError};

/// Tip error, m, beyond which a run counts as having lost its path: a tenth of the
/// paper's path.
pub const TIP_ERROR_LIMIT_M: f64 = 0.05;

/// A run at one tick, before the tick's command acts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogRow {
    /// Time from the path's start, s.
    pub t: f64,
    /// The plant as measured, under the previous tick's torques.
    pub reading: Reading,
    /// Planned tip position, m.
    pub tip_reference: [f64; 2],
    /// Planned contact force, N.
    pub force_reference: f64,
    /// Torques commanded in this tick, N m.
    pub torque: [f64; 2],
    /// How they were limited.
    pub saturation: [Saturation; 2],
    /// What the law's integral holds, N.
    pub integral: f64,
}

impl LogRow {
    /// Contact force less its reference, N.
    pub fn force_error(&self) -> f64 {
        self.reading.force - self.force_reference
    }

    /// Distance of the tip from where it should be, m.
    pub fn tip_error(&self) -> f64 {
        (self.reading.tip[0] - self.tip_reference[0])
            .hypot(self.reading.tip[1] - self.tip_reference[1])
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// To the end, pressing all the way.
    Completed,
    /// To the end, but a real tip would have left the surface on the way: the contact
    /// force became negative.
    ContactLost,
    /// To the end, but more than [`TIP_ERROR_LIMIT_M`] off the path.
    TipOffPath,
    /// The state became infinite or undefined, or the tip left the arm's reach; the
    /// run stopped there.
    Diverged,
    /// The controller latched a fault and gave no torque from there on.
    Fault(flexor::fault::Fault),
}

impl Outcome {
    /// Stable name, as in `summary.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::ContactLost => "contact_lost",
            Self::TipOffPath => "tip_off_path",
            Self::Diverged => "diverged",
            Self::Fault(fault) => fault.name(),
        }
    }
}

/// A run's figures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Root mean square of the contact force's error over all ticks, N.
    pub force_error_rms: f64,
    /// Its largest magnitude, N.
    pub force_error_max: f64,
    /// Root mean square of the tip's distance from its reference, m.
    pub tip_error_rms: f64,
    /// Largest distance, m.
    pub tip_error_max: f64,
    /// Largest torque magnitudes, N m.
    pub torque_max: [f64; 2],
    /// Ticks in which a torque was limited.
    pub limited_ticks: usize,
    /// Smallest contact force, N.
    pub force_min: f64,
    /// Ticks run.
    pub ticks: usize,
    /// How the run ended.
    pub outcome: Outcome,
}

/// A run: everything logged, and its figures.
#[derive(Clone, Debug)]
pub struct Run {
    /// One row a tick.
    pub rows: Vec<LogRow>,
    /// The run's figures.
    pub summary: Summary,
    /// The plant's deflections and slopes (m, rad) at every [`SHAPE_STRIDE`]-th tick.
    pub shapes: Vec<Vec<f64>>,
    /// Elements of the plant, for reading `shapes`.
    pub elements: usize,
}

/// Ticks from one logged shape of link 2 to the next: 50 a second at 5 kHz.
pub const SHAPE_STRIDE: usize = 100;

/// What to run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunOptions {
    /// Gains and options of the law.
    pub law: LawParameters,
    /// Torque limits.
    pub limits: LimitParameters,
    /// The plant.
    pub plant: PlantParameters,
    /// State that it starts in.
    pub start: Start,
}

/// Why a run could not start.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RunError {
    /// The table is not for this arm.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The table is not for these coefficients.
    #[error(transparent)]
    Mismatch(#[from] Mismatch),
    /// No plant.
    #[error(transparent)]
    Plant(#[from] PlantError),
}

/// The plant's reading as the measurement of perfect sensors, SI.
pub fn measurement(reading: &Reading) -> Measurement<f64> {
    Measurement {
        angle: reading.angle,
        root_slope: reading.root_slope,
        root_slope_rate: reading.root_slope_rate,
        force: reading.force,
        drive: [Saturation::None; 2],
    }
}

/// Runs the controller, in floating-point type `T`, on `image` (the plan's table) against
/// a plant, from the plan's first tick to its last.
///
/// # Errors
/// [`RunError`], before the first tick; what happens later is the [`Outcome`].
pub fn run<T: Scalar<Format = ()>>(
    plan: &Plan,
    image: &[u8],
    options: &RunOptions,
) -> Result<Run, RunError> {
    run_with::<T>(plan, image, options, |_, _| {})
}

/// As [`run`]; `observe` is shown every tick's measurement and command.
///
/// # Errors
/// As [`run`].
pub fn run_with<T: Scalar<Format = ()>>(
    plan: &Plan,
    image: &[u8],
    options: &RunOptions,
    mut observe: impl FnMut(&Measurement<T>, &Command<T>),
) -> Result<Run, RunError> {
    run_through(plan, image, options, |measured, command| {
        observe(measured, &command);
        Some(command)
    })
}

/// As [`run`]; `answer` gets every tick's measurement and command and returns the command
/// that the plant gets: another controller's, for one. `None` ends the run there.
///
/// # Errors
/// As [`run`].
pub fn run_through<T: Scalar<Format = ()>>(
    plan: &Plan,
    image: &[u8],
    options: &RunOptions,
    answer: impl FnMut(&Measurement<T>, Command<T>) -> Option<Command<T>>,
) -> Result<Run, RunError> {
    let table = Table::open(image)?;
    let mut controller =
        Controller::<T>::new(&table, &plan.model.arm, &options.law, &options.limits)?;
    run_controller(plan, &mut controller, &Formats::default(), options, answer)
}

/// As [`run_through`], with a given controller of any number type, whose law and limits
/// count instead of the options'.
///
/// # Errors
/// [`PlantError`], before the first tick.
pub fn run_controller<T: Scalar>(
    plan: &Plan,
    controller: &mut Controller<'_, T>,
    formats: &Formats<T::Format>,
    options: &RunOptions,
    mut answer: impl FnMut(&Measurement<T>, Command<T>) -> Option<Command<T>>,
) -> Result<Run, RunError> {
    let mut plant = plant_for(plan, &options.plant, options.start)?;
    let mut rows = Vec::with_capacity(plan.points.len());
    let mut shapes = Vec::with_capacity(plan.points.len() / SHAPE_STRIDE + 1);
    let mut fault = None;
    // Before the first tick the arm was held at rest by the planned torques.
    let mut held = plan.points[0].torque;
    for (tick, point) in plan.points.iter().enumerate() {
        let reading = plant.read(held);
        if !in_reach(&reading, plan) {
            break;
        }
        let measured = Measurement::from_si(&measurement(&reading), formats);
        let Some(command) = answer(&measured, controller.tick(&measured)) else {
            break;
        };
        fault = command.fault;
        held = [0, 1].map(|joint| command.torque[joint].to_si(formats.torque[joint]));
        rows.push(LogRow {
            t: point.t,
            reading,
            tip_reference: point.tip.position,
            force_reference: plan.task.normal_force,
            torque: held,
            saturation: command.saturation,
            integral: T::of_sum(controller.state().integral).to_si(formats.force),
        });
        if tick % SHAPE_STRIDE == 0 {
            let q = crate::model::configuration::State(plant.state()).q();
            shapes.push(plant.model().deflection(q).as_slice().to_vec());
        }
        plant.advance(held);
    }
    let complete = rows.len() == plan.points.len();
    let summary = summarise(&rows, |summary| match fault {
        Some(fault) => Outcome::Fault(fault),
        None if !complete => Outcome::Diverged,
        None if summary.tip_error_max > TIP_ERROR_LIMIT_M => Outcome::TipOffPath,
        None if summary.force_min < 0.0 => Outcome::ContactLost,
        None => Outcome::Completed,
    });
    Ok(Run {
        rows,
        summary,
        shapes,
        elements: plant.model().elements,
    })
}

/// False once the state is undefined, or the arm stretches or folds so far that its
/// equations become singular.
fn in_reach(reading: &Reading, plan: &Plan) -> bool {
    let elbow = (reading.angle[1] - reading.angle[0]).sin().abs();
    let planned = (plan.points[0].joint.angle[1] - plan.points[0].joint.angle[0]).sin();
    let same_side = (reading.angle[1] - reading.angle[0]).sin() * planned > 0.0;
    // The slide's Jacobian loses its rank at the stretched arm.
    elbow > 1e-3
        && same_side
        && reading.force.is_finite()
        && reading.root_slope.abs() < core::f64::consts::PI
}

/// Figures of the rows; `outcome` judges them.
fn summarise(rows: &[LogRow], outcome: impl Fn(&Summary) -> Outcome) -> Summary {
    let largest = |f: &dyn Fn(&LogRow) -> f64| rows.iter().map(f).fold(0.0, f64::max);
    let rms = |f: &dyn Fn(&LogRow) -> f64| {
        (rows.iter().map(|r| f(r).powi(2)).sum::<f64>() / rows.len().max(1) as f64).sqrt()
    };
    let mut summary = Summary {
        force_error_rms: rms(&LogRow::force_error),
        force_error_max: largest(&|r| r.force_error().abs()),
        tip_error_rms: rms(&LogRow::tip_error),
        tip_error_max: largest(&LogRow::tip_error),
        torque_max: [0, 1].map(|i| largest(&|r: &LogRow| r.torque[i].abs())),
        limited_ticks: rows
            .iter()
            .filter(|r| r.saturation != [Saturation::None; 2])
            .count(),
        force_min: rows
            .iter()
            .map(|r| r.reading.force)
            .fold(f64::INFINITY, f64::min),
        ticks: rows.len(),
        outcome: Outcome::Completed,
    };
    summary.outcome = outcome(&summary);
    summary
}

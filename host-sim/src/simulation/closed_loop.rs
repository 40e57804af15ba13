//! The controller and the plant in lock-step: measure, tick, hold, again. The
//! simulation owns time; nothing waits for a clock.

use crate::model::configuration::State;
use crate::planner::plan::Plan;
use crate::plant::{Plant, PlantError, PlantParameters, Reading};
use crate::simulation::start::{Start, plant_for};
use flexor::control::{Command, Controller, LawParameters, LimitParameters, Mismatch};
use flexor::fault::Fault;
use flexor::number::TableScalar;
use flexor::signals::{Formats, Measurement, Saturation};
use flexor::table::{Table, TableError};

/// Tip error, m, beyond which a run of `plan` counts as having lost its path: a tenth of the path.
pub fn tip_error_limit_m(plan: &Plan) -> f64 {
    0.1 * plan.task.path.length()
}

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
        let off = [0, 1].map(|i| self.reading.tip[i] - self.tip_reference[i]);
        libm::hypot(off[0], off[1])
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// To the end, pressing all the way.
    Completed,
    /// To the end, but the tip left the surface on the way, or would have: the contact force of a
    /// surface that holds it from both sides became negative.
    ContactLost,
    /// To the end, but farther off the path than the limit, [`tip_error_limit_m`] where none is
    /// given.
    TipOffPath,
    /// To the end, but the contact force was farther off its reference than a limit that was
    /// given.
    ForceOff,
    /// The table did not begin in the time that the bench allows.
    NotBegun,
    /// The run was left, but the move that was to follow did not come to its end.
    NotParked,
    /// The state became infinite or undefined, or the tip left the arm's reach; the
    /// run stopped there.
    Diverged,
    /// The controller, or the supervisor around it, latched a fault and gave no torque from there
    /// on.
    Fault(Fault),
}

impl Outcome {
    /// The outcomes that are no fault.
    const OWN: [Self; 7] = [
        Self::Completed,
        Self::ContactLost,
        Self::TipOffPath,
        Self::ForceOff,
        Self::NotBegun,
        Self::NotParked,
        Self::Diverged,
    ];

    /// The outcome of this [`name`](Self::name).
    pub fn from_name(name: &str) -> Option<Self> {
        let faults = Fault::ALL.into_iter().map(Self::Fault);
        let mut all = Self::OWN.into_iter().chain(faults);
        all.find(|outcome| outcome.name() == name)
    }

    /// True for all but [`Completed`](Self::Completed), and where the contact was lost on the way
    /// and nothing worse happened.
    pub fn failed(self) -> bool {
        !matches!(self, Self::Completed | Self::ContactLost)
    }

    /// Stable name, as in `summary.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::ContactLost => "contact_lost",
            Self::TipOffPath => "tip_off_path",
            Self::ForceOff => "force_off",
            Self::NotBegun => "not_begun",
            Self::NotParked => "not_parked",
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

/// The plant's reading as the measurement of perfect sensors, SI. The slope is the link's own, and
/// the moment what a gauge at the root would show, with the torques that are held and the
/// acceleration that they give: see [`Plant::read`].
pub fn measurement(reading: &Reading) -> Measurement<f64> {
    Measurement {
        angle: reading.angle,
        root_slope: reading.root_slope,
        root_slope_rate: reading.root_slope_rate,
        force: reading.force,
        motor: [
            reading.angle[0],
            reading.angle[1] + reading.root_slope - reading.angle[0],
        ],
        root_moment: reading.root_moment,
        drive: [Saturation::None; 2],
    }
}

/// What happened at a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step<T> {
    /// Number of the tick, from the plan's first.
    pub tick: usize,
    /// What the controller was given.
    pub measured: Measurement<T>,
    /// What the plant is given until the next tick.
    pub command: Command<T>,
    /// The same in SI, with what only a simulation can know.
    pub row: LogRow,
}

/// A controller, of number type `T`, and a plant in lock-step along a plan.
///
/// ```
/// use flexor_sim::files::config::{self, DEFAULT_ARM, PAPER_CONTROLLER, DEFAULT_TASK};
/// use flexor_sim::planner::{limits::default_limits, plan::PlanOptions, planning, table_fit};
/// use flexor_sim::simulation::{cases, closed_loop::{RunOptions, Simulation}, start::Start};
///
/// let arm = config::parse_arm("arm.toml", DEFAULT_ARM)?.arm;
/// let task = config::parse_task("task.toml", DEFAULT_TASK)?;
/// let plan = planning::plan(&arm, &task, &PlanOptions::default())?;
/// let image = table_fit::fit_table(&plan)?.image;
/// let options = RunOptions {
///     law: config::parse_controller("controller.toml", PAPER_CONTROLLER)?,
///     limits: default_limits(&plan),
///     plant: cases::plant(3, 1.0),
///     start: Start::PlanAtRest,
/// };
/// let mut simulation = Simulation::<f32>::new(&plan, &image, &options)?;
/// let step = simulation.step().expect("the motion has just begun");
/// assert_eq!(step.row.torque, simulation.held());
/// assert!((step.row.reading.force - step.row.force_reference).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Simulation<'a, T: TableScalar> {
    plan: &'a Plan,
    controller: Controller<'a, T>,
    formats: Formats<T::Format>,
    plant: Plant,
    /// Torques on the joints until the next tick, N m.
    held: [f64; 2],
    tick: usize,
    over: bool,
}

impl<'a, T: TableScalar<Format = ()>> Simulation<'a, T> {
    /// The controller, in floating-point type `T`, with `plan`'s table `image` against the
    /// plant of `options`, before the plan's first tick. It follows the table at once: this loop's
    /// plant starts as `options` say, and not as a law has settled it.
    ///
    /// # Errors
    /// [`RunError`]; what goes wrong later is the run's [`Outcome`].
    pub fn new(plan: &'a Plan, image: &'a [u8], options: &RunOptions) -> Result<Self, RunError> {
        let table = Table::open(image)?;
        let law = options.law.without_settling();
        let controller = Controller::new(&table, &plan.model.arm, &law, &options.limits)?;
        let plant = plant_for(plan, &options.plant, options.start)?;
        let formats = Formats::default();
        Ok(Self::with_controller(plan, controller, &formats, plant))
    }
}

impl<'a, T: TableScalar> Simulation<'a, T> {
    /// A given `controller`, whose signals have `formats`, against a given `plant`, which is
    /// in the state that it has at the plan's first tick.
    pub fn with_controller(
        plan: &'a Plan,
        controller: Controller<'a, T>,
        formats: &Formats<T::Format>,
        plant: Plant,
    ) -> Self {
        Self {
            plan,
            controller,
            formats: *formats,
            plant,
            // Before the first tick the arm was held at rest by the planned torques.
            held: plan.points[0].torque,
            tick: 0,
            over: false,
        }
    }

    /// Holds the last command for a control period (none before the first tick), measures and
    /// ticks. `None`, now and for ever, when the plan has no tick left or the plant's state is
    /// undefined or out of the arm's reach.
    pub fn step(&mut self) -> Option<Step<T>> {
        let own = |_: &Measurement<T>, command| Ok::<_, core::convert::Infallible>(command);
        match self.step_with(own) {
            Ok(step) => step,
            Err(never) => match never {},
        }
    }

    /// As [`step`](Self::step), but the plant gets what `replace` makes of the measurement and
    /// the own controller's command: that of another controller, for one.
    ///
    /// # Errors
    /// Those of `replace`, which end the simulation.
    pub fn step_with<E>(
        &mut self,
        replace: impl FnOnce(&Measurement<T>, Command<T>) -> Result<Command<T>, E>,
    ) -> Result<Option<Step<T>>, E> {
        let tick = self.tick;
        let Some(point) = self.plan.points.get(tick).filter(|_| !self.over) else {
            return Ok(None);
        };
        if tick > 0 {
            self.plant.advance(self.held);
        }
        let reading = self.plant.read(self.held);
        // Until this tick is through.
        self.over = true;
        if !in_reach(&reading, self.plan) {
            return Ok(None);
        }
        let measured = Measurement::from_si(&measurement(&reading), &self.formats);
        let command = replace(&measured, self.controller.tick(&measured))?;
        self.held = [0, 1].map(|i| command.torque[i].to_si(self.formats.torque[i]));
        self.tick += 1;
        self.over = false;
        Ok(Some(Step {
            tick,
            measured,
            command,
            row: LogRow {
                t: point.t,
                reading,
                tip_reference: point.tip.position,
                force_reference: point.force.normal,
                torque: self.held,
                saturation: command.saturation,
                integral: T::of_sum(self.controller.force_integral()).to_si(self.formats.force),
            },
        }))
    }

    /// Steps to the end and keeps the log; `observe` is shown every step.
    pub fn run(&mut self, mut observe: impl FnMut(&Step<T>)) -> Run {
        let mut log = RunLog::new(self);
        while let Some(step) = self.step() {
            log.add(&step, &self.plant);
            observe(&step);
        }
        log.finish()
    }

    /// The controller.
    pub fn controller(&self) -> &Controller<'a, T> {
        &self.controller
    }

    /// The plant, at the last step's tick.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Torques that the plant gets until the next tick, N m.
    pub fn held(&self) -> [f64; 2] {
        self.held
    }
}

/// Collects the steps of a simulation into a [`Run`].
#[derive(Clone, Debug)]
pub struct RunLog {
    rows: Vec<LogRow>,
    shapes: Vec<Vec<f64>>,
    fault: Option<Fault>,
    /// Rows of a complete run.
    ticks: usize,
    tip_error_limit_m: f64,
    elements: usize,
}

impl RunLog {
    /// A log for all of `simulation`.
    pub fn new<T: TableScalar>(simulation: &Simulation<'_, T>) -> Self {
        let ticks = simulation.plan.points.len();
        Self {
            rows: Vec::with_capacity(ticks),
            shapes: Vec::with_capacity(ticks / SHAPE_STRIDE + 1),
            fault: None,
            ticks,
            tip_error_limit_m: tip_error_limit_m(simulation.plan),
            elements: simulation.plant.model().elements,
        }
    }

    /// Adds a step; `plant` is the simulation's, after the step.
    pub fn add<T>(&mut self, step: &Step<T>, plant: &Plant) {
        self.fault = step.command.fault;
        self.rows.push(step.row);
        if step.tick.is_multiple_of(SHAPE_STRIDE) {
            let q = State(plant.state()).q();
            self.shapes
                .push(plant.model().deflection(q).as_slice().to_vec());
        }
    }

    /// The run, judged.
    pub fn finish(self) -> Run {
        let complete = self.rows.len() == self.ticks;
        let summary = summarise(&self.rows, |summary| match self.fault {
            Some(fault) => Outcome::Fault(fault),
            None if !complete => Outcome::Diverged,
            None if summary.tip_error_max > self.tip_error_limit_m => Outcome::TipOffPath,
            None if summary.force_min < 0.0 => Outcome::ContactLost,
            None => Outcome::Completed,
        });
        Run {
            rows: self.rows,
            summary,
            shapes: self.shapes,
            elements: self.elements,
        }
    }
}

/// False once the state is undefined, or the arm stretches or folds so far that its
/// equations become singular.
fn in_reach(reading: &Reading, plan: &Plan) -> bool {
    let elbow = |angle: [f64; 2]| libm::sin(angle[1] - angle[0]);
    let own = elbow(reading.angle);
    let same_side = own * elbow(plan.points[0].joint.angle) > 0.0;
    // The slide's Jacobian loses its rank at the stretched arm.
    own.abs() > 1e-3
        && same_side
        && reading.force.is_finite()
        && reading.root_slope.abs() < core::f64::consts::PI
}

/// Figures of the rows; `outcome` judges them.
pub(super) fn summarise(rows: &[LogRow], outcome: impl Fn(&Summary) -> Outcome) -> Summary {
    let largest = |f: &dyn Fn(&LogRow) -> f64| rows.iter().map(f).fold(0.0, f64::max);
    let rms = |f: &dyn Fn(&LogRow) -> f64| {
        (rows.iter().map(|r| f(r) * f(r)).sum::<f64>() / rows.len().max(1) as f64).sqrt()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_outcome_has_a_name_of_its_own() {
        let faults = Fault::ALL.map(Outcome::Fault);
        for outcome in Outcome::OWN.into_iter().chain(faults) {
            assert_eq!(Outcome::from_name(outcome.name()), Some(outcome));
            let sound = ["completed", "contact_lost"].contains(&outcome.name());
            assert_eq!(outcome.failed(), !sound);
        }
        assert_eq!(Outcome::from_name("Completed"), None);
    }
}

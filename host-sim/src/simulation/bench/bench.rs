//! Arms on the bench, side by side, tick by tick along a plan.

use crate::planner::plan::Plan;
use crate::plant::bench::lanes::Lanes;
use crate::plant::bench::{CompliantArm, CompliantPlant, CompliantReading, Outputs};
use crate::simulation::bench::arm::{BenchArm, BenchBoard, BenchError, period_s, poses};
use crate::simulation::bench::figures::{FailureLimits, RunFigures, Tally};
use crate::simulation::bench::lane::Lane;
use flexor::control::{LawParameters, LimitParameters};
use flexor::fault::Fault;
use flexor::link::{Program, RawSample, Refusal, Setup};
use flexor::phase::Phase;
use flexor::signals::Saturation;
use flexor::supervisor::{
    ControllerParameters, MonitorParameters, MonitoredController, Monitors, StartPose,
};
use flexor::table::{Table, TableError};

/// What all arms of a bench are to do, and with which board.
#[derive(Clone, Copy, Debug)]
pub struct BenchTask<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// Its table.
    pub image: &'a [u8],
    /// Gains and options of the law.
    pub law: &'a LawParameters,
    /// Torque limits; the board's are kept besides.
    pub limits: &'a LimitParameters,
    /// Thresholds of the board's monitors.
    pub monitors: &'a MonitorParameters,
    /// The board.
    pub board: &'a BenchBoard,
    /// From which error on a run counts as failed.
    pub failure: &'a FailureLimits,
    /// What the arm goes over to once it stands after that, if anything.
    pub then: Option<Then<'a>>,
}

/// A move that follows a run, begun where the arm stands with its drives on.
#[derive(Clone, Copy, Debug)]
pub struct Then<'a> {
    /// Its plan, of the same arm and tick rate.
    pub plan: &'a Plan,
    /// Its table.
    pub image: &'a [u8],
    /// Torque limits meanwhile; the board's are kept besides.
    pub limits: &'a LimitParameters,
    /// Thresholds of the board's monitors meanwhile.
    pub monitors: &'a MonitorParameters,
}

impl BenchTask<'_> {
    /// What a board's image is built with for this task, apart from its table.
    pub fn setup(&self) -> Setup {
        Setup::from(&ControllerParameters {
            arm: self.plan.model.arm,
            law: *self.law,
            limits: *self.limits,
            monitors: *self.monitors,
        })
    }

    /// What a board must have for this task: its table, and its settings.
    ///
    /// # Errors
    /// [`TableError`] where the task's table is none.
    pub fn program(&self) -> Result<Program, TableError> {
        let table = Table::open(self.image)?;
        Ok(Program {
            table_crc: table.crc(),
            task_fingerprint: table.header().task_fingerprint,
            setup_crc: self.setup().crc(),
        })
    }

    /// What a controller is made from that keeps within these limits and thresholds.
    fn controller(
        &self,
        limits: &LimitParameters,
        monitors: &MonitorParameters,
    ) -> ControllerParameters {
        ControllerParameters {
            arm: self.plan.model.arm,
            law: *self.law,
            limits: limits.at_most(self.board.drive_limit_nm),
            monitors: *monitors,
        }
    }
}

/// An arm and its board at one tick, before the tick's command acts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchRow {
    /// Time from the path's start, s, of a run that starts pressing; of one that starts above the
    /// surface, time from enabling.
    pub t: f64,
    /// The arm as it is.
    pub reading: CompliantReading,
    /// The counts that the board read.
    pub sample: RawSample,
    /// Planned tip position, m.
    pub tip_reference: [f64; 2],
    /// Planned contact force, N.
    pub force_reference: f64,
    /// Place of the tip along the planned surface less the planned place, m.
    pub along_error: f64,
    /// Torques that the board commanded, N m; 0 with the drives off.
    pub torque: [f64; 2],
    /// How they were limited.
    pub saturation: [Saturation; 2],
    /// What the law's integral holds, N.
    pub integral: f64,
    /// What the drives tend to until the next tick, N m.
    pub target: [f64; 2],
    /// The fault that the board has latched, or for which it has given up the run.
    pub fault: Option<Fault>,
    /// Where the run is.
    pub phase: Phase,
}

impl BenchRow {
    /// Contact force less its reference, N.
    pub fn force_error(&self) -> f64 {
        self.reading.force - self.force_reference
    }
}

/// Angle, rad, and contact force, N, from which on a state is absurd.
const ABSURD: (f64, f64) = (20.0, 1e4);

/// True once the state is undefined or absurd.
pub(super) fn diverged(reading: &CompliantReading) -> bool {
    let (angle, force) = ABSURD;
    // NaN is not below either.
    let sound = reading.angle.iter().all(|a| a.abs() < angle) && reading.force < force;
    !(sound && reading.root_slope.is_finite())
}

/// The plan's time, s, so many ticks after enabling, where the table has `begun`; until it begins
/// before the plan's first.
pub(super) fn path_s(task: &BenchTask<'_>, begun: Option<usize>, tick: usize) -> f64 {
    let plan = task.plan;
    let (period_s, first_s) = (period_s(plan), plan.points[0].t);
    match begun {
        Some(begun) => first_s + (tick - begun) as f64 * period_s,
        None => {
            let settling = f64::from(task.law.settle_ticks(plan.tick_rate_hz));
            (first_s - settling * period_s + tick as f64 * period_s).min(first_s - period_s)
        }
    }
}

/// Longest time from enabling until the table begins, s; a run that takes longer is given up.
const BEFORE_MAX_S: f64 = 20.0;

/// Longest time from leaving the table until the arm stands, s, where something is to follow.
const AFTER_MAX_S: f64 = 20.0;

/// Runs the `arms` along the task's plan, side by side, each from its start: pressing where the
/// plan begins, or above it. Figures and rows of a run that starts pressing begin with the table, as
/// long as the law takes to settle there; a fault or divergence before ends it. A run that starts
/// above the surface has rows from enabling on. `observe` is shown every such tick of every arm, with
/// the arm's number, which is that of its lane in the plant, until it diverges.
///
/// There may be fewer arms than `T` has lanes. Each one's bits are those that it has alone, if all
/// have the same [`BenchArm::kind`].
///
/// # Errors
/// [`BenchError`]; what goes wrong later is the run's outcome.
///
/// # Panics
/// If there is no arm, or more than `T` has lanes.
pub fn run<T: Lanes>(
    task: &BenchTask<'_>,
    arms: &[BenchArm],
    mut observe: impl FnMut(usize, &BenchRow, &CompliantPlant<T>),
) -> Result<Vec<RunFigures>, BenchError> {
    assert!(!arms.is_empty() && arms.len() <= T::LANES, "arms and lanes");
    let plan = task.plan;
    let period_s = period_s(plan);
    // Idle lanes repeat the first arm.
    let lane = |i: usize| arms.get(i).unwrap_or(&arms[0]).lane();
    let lanes: Vec<CompliantArm<'_>> = (0..T::LANES).map(lane).collect();
    let mut plant = CompliantPlant::<T>::new(&lanes, period_s, &poses(plan))?;

    let mut places: Vec<_> = arms.iter().map(|_| [None, None]).collect();
    let boards = boards(task, arms, &plant.outputs(), &mut places)?;
    let mut targets: Vec<[f64; 2]> = (0..T::LANES)
        .map(|i| arms.get(i).unwrap_or(&arms[0]).held(plan))
        .collect();
    let mut runs: Vec<Run<'_>> = boards
        .into_iter()
        .zip(arms)
        .map(|(board, arm)| Run::new(task, board, arm))
        .collect();
    for tick in 0.. {
        if tick > 0 {
            plant.advance([0, 1].map(|j| T::from_lanes(|i| targets[i][j])));
        }
        let outputs = plant.outputs();
        for (i, run) in runs.iter_mut().enumerate() {
            if let Some((row, shown)) = run.tick(tick, &outputs.lane(i)) {
                targets[i] = row.target;
                if shown {
                    observe(i, &row, &plant);
                }
            }
        }
        if runs.iter().all(|run| run.over) {
            break;
        }
    }
    Ok(runs.into_iter().map(|run| run.tally.finish()).collect())
}

/// One arm's run. Times are ticks since enabling.
struct Run<'a> {
    task: &'a BenchTask<'a>,
    arm: &'a BenchArm,
    board: Lane<'a>,
    tally: Tally,
    /// When the table began, when it was left, and when the one after it began.
    begun: Option<usize>,
    left: Option<usize>,
    then: Option<usize>,
    over: bool,
}

impl<'a> Run<'a> {
    fn new(task: &'a BenchTask<'a>, board: Lane<'a>, arm: &'a BenchArm) -> Self {
        Self {
            task,
            arm,
            board,
            tally: Tally::new(task.failure, task.plan, task.then.is_some()),
            begun: None,
            left: None,
            then: None,
            over: false,
        }
    }

    /// A tick with the arm as `reading` says: what it gave, and whether it is to be shown; `None`
    /// once the run is over.
    fn tick(&mut self, tick: usize, reading: &CompliantReading) -> Option<(BenchRow, bool)> {
        if !self.over && diverged(reading) {
            self.tally.diverge();
            self.over = true;
        }
        if self.over {
            return None;
        }
        let plan = self.task.plan;
        let period_s = period_s(plan);
        let last = plan.points.len() - 1;
        let since_s = tick as f64 * period_s;
        let plan_s = |begun: Option<usize>| path_s(self.task, begun, tick);
        self.go_on(tick);
        // The tick with which the table begins is on it.
        let given = self.board.tick(plan_s(self.begun), reading);
        if given.begun && self.begun.is_none() {
            self.begun = Some(tick);
        }
        let point = match (self.task.then, self.then) {
            (Some(then), Some(from)) => then.plan.points.get(tick - from),
            _ => plan.points.get(self.begun.map_or(0, |begun| tick - begun)),
        };
        let end = self.task.then.filter(|_| self.then.is_some());
        let end = end.map_or(plan, |then| then.plan).points.last();
        let point = point.or(end).unwrap_or(&plan.points[last]);
        let surface = &self.arm.parameters.surface;
        let above = self.arm.course.gap_m.is_some();
        let row = BenchRow {
            t: if above { since_s } else { plan_s(self.begun) },
            reading: *reading,
            sample: given.sample,
            tip_reference: point.tip.position,
            force_reference: point.force.normal,
            along_error: surface.along(reading.tip) - surface.along(point.tip.position),
            torque: given.torque,
            saturation: given.saturation,
            integral: given.integral,
            target: given.target,
            fault: given.fault,
            phase: given.phase,
        };
        let shown = above || self.begun.is_some();
        self.count(tick, &row, last);
        Some((row, shown))
    }

    /// Takes a tick into the figures; says when the run is over. The plan has `last` ticks.
    fn count(&mut self, tick: usize, row: &BenchRow, last: usize) {
        let period_s = period_s(self.task.plan);
        let since_s = tick as f64 * period_s;
        let leaves = row.phase == Phase::Retract || row.phase.stands();
        let Some(begun) = self.begun else {
            self.tally.before(row, since_s);
            if since_s >= BEFORE_MAX_S {
                self.tally.give_up();
                self.over = true;
            }
            // Given up, or switched off.
            self.over |= leaves || row.fault.is_some();
            return;
        };
        let ended = tick - begun >= last;
        if self.left.is_none() {
            // The last tick of the table is on it, though it is the first of leaving.
            if ended || !leaves {
                self.tally.add(row);
            }
            if leaves || ended {
                self.left = Some(tick);
            }
        }
        if let Some(left) = self.left {
            let after_s = (tick - left) as f64 * period_s;
            let along_m = self.arm.parameters.surface.along(row.reading.tip);
            self.tally.after(row, along_m, after_s);
            self.over = match (self.task.then, self.then) {
                (None, _) => after_s >= self.arm.course.after_s,
                (Some(_), None) => row.fault.is_some() || after_s >= AFTER_MAX_S,
                (Some(then), Some(from)) => self.then_over(tick - from, &then, row),
            };
        }
    }

    /// Whether the move after the run is over, so many ticks after its begin; notes how far off its end
    /// the tip stands then.
    fn then_over(&mut self, ticks: usize, then: &Then<'_>, row: &BenchRow) -> bool {
        let rest = (self.arm.course.after_s / period_s(self.task.plan)) as usize;
        let over = ticks >= then.plan.points.len() - 1 + rest;
        if over && row.phase == Phase::Park {
            self.tally.park(row);
        }
        over || row.fault.is_some()
    }

    /// Goes over to what follows the run, once the arm stands.
    fn go_on(&mut self, tick: usize) {
        let (Some(then), Some(_), None) = (self.task.then, self.left, self.then) else {
            return;
        };
        if !self.board.stands() {
            return;
        }
        let parameters = self.task.controller(then.limits, then.monitors);
        let prepared = Table::open(then.image)
            .ok()
            .and_then(|table| parameters.controller(&table).ok());
        if let Some(controller) = prepared
            && self
                .board
                .go_on(controller, then.monitors, self.task.plan.tick_rate_hz)
        {
            self.then = Some(tick);
        }
    }
}

/// The boards of `arms`, which are as `outputs` says, each enabled. `places` are where their
/// controllers live.
fn boards<'a, T: Lanes>(
    task: &BenchTask<'a>,
    arms: &[BenchArm],
    outputs: &Outputs<T>,
    places: &'a mut [[Option<MonitoredController<'a>>; 2]],
) -> Result<Vec<Lane<'a>>, BenchError> {
    let plan = task.plan;
    let parameters = task.controller(task.limits, task.monitors);
    let table = Table::open(task.image)?;
    // What follows is for the same arm, or there is no run at all.
    if let Some(then) = task.then {
        parameters.controller(&Table::open(then.image)?)?;
    }
    let start = StartPose::new(&parameters.law, &parameters.arm, &table.cursor().row());

    let mut boards = Vec::with_capacity(arms.len());
    for ((i, arm), places) in arms.iter().enumerate().zip(places) {
        let (first, rate) = (outputs.lane(i), plan.tick_rate_hz);
        // The gauge is calibrated in N m on the arm itself, by hanging a known weight from it.
        let board = BenchBoard {
            calibration: task.board.calibration.for_arm(&arm.model.arm),
            ..*task.board
        };
        let placed = MonitoredController {
            controller: parameters.controller(&table)?,
            monitors: Monitors::new(&parameters.monitors, &board.calibration, rate),
        };
        let inside = (placed, places);
        // Brakes hold the arm until it is enabled, and its drives have what holds it.
        let held = (arm.held(plan), &start);
        boards.push(Lane::new(arm, &board, inside, &first, held, rate));
    }
    Ok(boards)
}

/// Why a board would refuse to be enabled before `arm`, where it starts, if it would: its sensors
/// say that it stands elsewhere. [`run`] enables it all the same, to see what comes of it.
///
/// # Errors
/// [`BenchError`].
pub fn refusal(task: &BenchTask<'_>, arm: &BenchArm) -> Result<Option<Refusal>, BenchError> {
    let plan = task.plan;
    let mut plant = CompliantPlant::<f64>::new(&[arm.lane()], period_s(plan), &poses(plan))?;
    let mut places = [[None, None]];
    let arms = core::slice::from_ref(arm);
    let boards = boards(task, arms, &plant.outputs(), &mut places)?;
    Ok(boards.first().and_then(Lane::refusal))
}

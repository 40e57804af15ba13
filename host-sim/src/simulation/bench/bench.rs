//! Arms on the bench, side by side, tick by tick along a plan.

use crate::planner::plan::Plan;
use crate::plant::bench::lanes::Lanes;
use crate::plant::bench::{CompliantArm, CompliantPlant, CompliantReading, Outputs};
use crate::simulation::bench::arm::{BenchArm, BenchBoard, BenchError, period_s, poses};
use crate::simulation::bench::figures::{FailureLimits, RunFigures, Tally};
use crate::simulation::bench::lane::Lane;
use flexor::control::{Controller, LawParameters, LimitParameters};
use flexor::fault::Fault;
use flexor::link::{RawSample, Refusal};
use flexor::signals::Saturation;
use flexor::supervisor::ControllerParameters;
use flexor::table::Table;

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
    /// The board.
    pub board: &'a BenchBoard,
    /// From which error on a run counts as failed.
    pub failure: &'a FailureLimits,
}

/// An arm and its board at one tick, before the tick's command acts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchRow {
    /// Time from the path's start, s.
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
    /// The fault that the board has latched.
    pub fault: Option<Fault>,
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
fn diverged(reading: &CompliantReading) -> bool {
    let (angle, force) = ABSURD;
    // NaN is not below either.
    let sound = reading.angle.iter().all(|a| a.abs() < angle) && reading.force < force;
    !(sound && reading.root_slope.is_finite())
}

/// Runs the `arms` along the task's plan, side by side, each from the plan's start, pressing, with
/// as much time as the law takes to settle there. That time is before the run: no figure and no
/// log holds it, but a fault or divergence in it ends the run. `observe` is shown every tick of every
/// arm, with the arm's number, which is that of its lane in the plant, until it diverges.
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
    let mut boards = boards(task, arms, &plant.outputs(), &mut places)?;
    let planned = plan.points[0].torque;
    let mut tallies = vec![Tally::new(task.failure, plan); arms.len()];
    let mut over = vec![false; arms.len()];
    let mut targets = vec![planned; T::LANES];

    let settling = task.law.settle_ticks(plan.tick_rate_hz) as usize;
    for tick in 0..settling + plan.points.len() {
        if tick > 0 {
            plant.advance([0, 1].map(|j| T::from_lanes(|i| targets[i][j])));
        }
        // While the law settles, the table stands at its first tick.
        let point = &plan.points[tick.saturating_sub(settling)];
        let t = point.t - settling.saturating_sub(tick) as f64 * period_s;
        let outputs = plant.outputs();
        for i in 0..arms.len() {
            let reading = outputs.lane(i);
            if !over[i] && diverged(&reading) {
                tallies[i].diverge();
                over[i] = true;
            }
            if over[i] {
                continue;
            }
            let given = boards[i].tick(t, &reading);
            targets[i] = given.target;
            if tick < settling {
                tallies[i].settle(t, given.fault);
                continue;
            }
            let surface = &arms[i].parameters.surface;
            let row = BenchRow {
                t,
                reading,
                sample: given.sample,
                tip_reference: point.tip.position,
                force_reference: plan.task.normal_force,
                along_error: surface.along(reading.tip) - surface.along(point.tip.position),
                torque: given.torque,
                saturation: given.saturation,
                integral: given.integral,
                target: given.target,
                fault: given.fault,
            };
            tallies[i].add(&row);
            observe(i, &row, &plant);
        }
        if over.iter().all(|over| *over) {
            break;
        }
    }
    Ok(tallies.into_iter().map(Tally::finish).collect())
}

/// The boards of `arms`, which are as `outputs` says, each enabled. `places` are where their
/// controllers live.
fn boards<'a, T: Lanes>(
    task: &BenchTask<'a>,
    arms: &[BenchArm],
    outputs: &Outputs<T>,
    places: &'a mut [[Option<Controller<'a, f32>>; 2]],
) -> Result<Vec<Lane<'a>>, BenchError> {
    let plan = task.plan;
    let parameters = ControllerParameters {
        arm: plan.model.arm,
        law: *task.law,
        limits: task.limits.at_most(task.board.drive_limit_nm),
    };
    let table = Table::open(task.image)?;
    let first_row = table.cursor::<f32>().row();
    let planned = (plan.points[0].torque, &first_row);
    let mut boards = Vec::with_capacity(arms.len());
    for ((i, arm), places) in arms.iter().enumerate().zip(places) {
        let inside = (parameters.controller(&table)?, places);
        let (first, rate) = (outputs.lane(i), plan.tick_rate_hz);
        // The gauge is calibrated in N m on the arm itself, by hanging a known weight from it.
        let board = BenchBoard {
            calibration: task.board.calibration.for_arm(&arm.model.arm),
            ..*task.board
        };
        boards.push(Lane::new(arm, &board, inside, &first, planned, rate));
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

//! Target in the loop: a [`Target`] ticks against the simulated plant, and each of its
//! commands is compared bit by bit with the in-process controller's.
//!
//! The firmware's own lock-step mode does this (see [`flexor::link`]); there is no special
//! build.

use crate::planner::plan::Plan;
use crate::simulation::closed_loop::{Run, RunError, RunLog, RunOptions, Simulation};
use crate::target::{Target, TargetError};
use flexor::control::Command;
use flexor::link::{Refusal, Setup, Status, TickReply};
use flexor::signals::{Measurement, Saturation};
use flexor::supervisor::{ControllerParameters, MonitorParameters};
use flexor::table::{Slot, Table, TableIdentity};
use std::ops::ControlFlow;
use std::time::Instant;

/// Why a target in the loop could not be run.
#[derive(Debug, thiserror::Error)]
pub enum PilError {
    /// The target could not be talked to, or refused.
    #[error(transparent)]
    Target(#[from] TargetError),
    /// The plan's rate is not the image's.
    #[error(
        "the plan has {plan_hz} ticks a second, the firmware's timer {firmware_hz}: plan with --tick-rate-hz {firmware_hz}"
    )]
    TickRate {
        /// The plan's, Hz.
        plan_hz: u32,
        /// The firmware's, Hz.
        firmware_hz: u32,
    },
    /// The task's table is in neither slot.
    #[error(
        "the microcontroller does not have this task's table ({wanted:#010x} of task {task:#010x}): slot A {a}, slot B {b}; `flexor plan` with the same arm, task and rate writes it, `cargo xtask flash --table out/plan/table.bin --slot b` puts it into slot B"
    )]
    OtherTable {
        /// Checksum of the task's.
        wanted: u32,
        /// The task's fingerprint.
        task: u32,
        /// What slot A has.
        a: String,
        /// What slot B has.
        b: String,
    },
    /// The run could not start.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Whoever follows the progress wanted no more.
    #[error("interrupted after {done} of {all} commands")]
    Interrupted {
        /// Commands compared.
        done: usize,
        /// Commands that there were to compare.
        all: usize,
    },
}

/// What a run with a target in the loop found.
#[derive(Clone, Debug)]
pub struct PilRun {
    /// The closed loop, with the target's torques on the plant.
    pub run: Run,
    /// Slot that the table was in.
    pub slot: Slot,
    /// Ticks compared.
    pub ticks: usize,
    /// Ticks whose commands differ in at least one bit.
    pub differing_commands: usize,
    /// The first of them.
    pub first_difference: Option<usize>,
    /// Stopwatch ticks_hw of each tick.
    pub ticks_hw: Vec<u32>,
    /// Status at the end.
    pub status: Status,
    /// Time that the run took, s.
    pub wall_s: f64,
}

impl PilRun {
    /// Least, median and most ticks_hw of a tick.
    pub fn counts_spread(&self) -> [u32; 3] {
        let mut sorted = self.ticks_hw.clone();
        sorted.sort_unstable();
        let at = |i: usize| sorted.get(i).copied().unwrap_or(0);
        [
            at(0),
            at(sorted.len() / 2),
            at(sorted.len().saturating_sub(1)),
        ]
    }
}

/// True when the target's command equals the in-process one in every bit.
fn same(reply: &TickReply, command: &Command<f32>) -> bool {
    reply.torque.map(f32::to_bits) == command.torque.map(f32::to_bits)
        && reply.tick == command.tick
        && reply.saturation == command.saturation
        && reply.fault == command.fault
}

/// Begins lock-step with the table `image` in the slot that has it.
///
/// # Errors
/// [`PilError::OtherTable`] if none has; else other [`PilError`]s.
pub fn start_with(target: &mut Target, image: &[u8], setup: &Setup) -> Result<Slot, PilError> {
    let table = Table::open(image).map_err(RunError::from)?;
    let (plan_hz, firmware_hz) = (table.header().tick_rate_hz, target.identity().tick_rate_hz);
    if plan_hz != firmware_hz {
        return Err(PilError::TickRate {
            plan_hz,
            firmware_hz,
        });
    }
    let wanted = TableIdentity::from(&table);
    let mut found = [String::new(), String::new()];
    for (slot, found) in Slot::ALL.into_iter().zip(&mut found) {
        *found = match target.start(slot, setup) {
            Ok(table) if table == wanted => return Ok(slot),
            Ok(other) => format!(
                "holds {:#010x} of task {:#010x}",
                other.crc, other.task_fingerprint
            ),
            Err(TargetError::Refused(Refusal::Table(error))) => error.to_string(),
            Err(error) => return Err(error.into()),
        };
    }
    let [a, b] = found;
    Err(PilError::OtherTable {
        wanted: wanted.crc,
        task: wanted.task_fingerprint,
        a,
        b,
    })
}

/// Runs `plan` in closed loop: the plant gets the target's torques, and the in-process
/// controller the same measurements. One of the target's slots must hold `image`, the
/// plan's table. `progress` is told each tick, and may end the run.
///
/// # Errors
/// [`PilError::Interrupted`] if `progress` ends the run; else other [`PilError`]s.
pub fn run(
    target: &mut Target,
    plan: &Plan,
    image: &[u8],
    options: &RunOptions,
    mut progress: impl FnMut(usize) -> ControlFlow<()>,
) -> Result<PilRun, PilError> {
    let parameters = ControllerParameters {
        arm: plan.model.arm,
        // As the simulation beside it.
        law: options.law.without_settling(),
        limits: options.limits,
        monitors: MonitorParameters::NONE,
    };
    let slot = start_with(target, image, &Setup::from(&parameters))?;
    let begun = Instant::now();
    let mut ticks_hw = Vec::with_capacity(plan.points.len());
    let mut differing_commands = 0;
    let mut first_difference = None;
    let mut simulation = Simulation::<f32>::new(plan, image, options)?;
    let mut log = RunLog::new(&simulation);
    while let Some(step) = simulation.step_with(|measured, own| {
        let tick = ticks_hw.len();
        let reply = target.tick(tick as u32, measured)?;
        if !same(&reply, &own) {
            differing_commands += 1;
            first_difference.get_or_insert(tick);
        }
        ticks_hw.push(reply.ticks_hw);
        if progress(tick).is_break() {
            return Err(PilError::Interrupted {
                done: ticks_hw.len(),
                all: plan.points.len(),
            });
        }
        Ok(Command {
            torque: reply.torque,
            saturation: reply.saturation,
            fault: reply.fault,
            ..own
        })
    })? {
        log.add(&step, simulation.plant());
    }
    Ok(PilRun {
        ticks: ticks_hw.len(),
        run: log.finish(),
        slot,
        differing_commands,
        first_difference,
        ticks_hw,
        wall_s: begun.elapsed().as_secs_f64(),
        status: target.status()?,
    })
}

/// Compares target and in-process controller on `count` measurements of arbitrary bits:
/// normal ranges, limits, denormals, infinities and NaN. Both begin again after a fault.
/// Returns how many commands differ. `progress` is told each, and may end it.
///
/// # Errors
/// [`PilError::Interrupted`] if `progress` ends it; else other [`PilError`]s.
pub fn compare_any(
    target: &mut Target,
    image: &[u8],
    parameters: &ControllerParameters,
    count: u32,
    seed: u64,
    mut progress: impl FnMut(u32) -> ControlFlow<()>,
) -> Result<u32, PilError> {
    let table = Table::open(image).map_err(RunError::from)?;
    let mut controller = parameters.controller(&table).map_err(RunError::from)?;
    let setup = Setup::from(parameters);
    let slot = start_with(target, image, &setup)?;
    let mut random = SplitMix(seed);
    let mut differing = 0;
    for sequence in 0..count {
        let measured = any_measurement(&mut random);
        let reply = target.tick(sequence, &measured)?;
        let command = controller.tick(&measured);
        differing += u32::from(!same(&reply, &command));
        if command.fault.is_some() || reply.fault.is_some() {
            controller.restart();
            target.start(slot, &setup)?;
        }
        if progress(sequence).is_break() {
            return Err(PilError::Interrupted {
                done: sequence as usize + 1,
                all: count as usize,
            });
        }
    }
    Ok(differing)
}

/// Steele, Lea and Flood's SplitMix64: the same numbers everywhere.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// Mostly a plausible value in +-4; one in 64 a special one, one in 64 any bits at all.
fn any_value(random: &mut SplitMix) -> f32 {
    const SPECIAL: [u32; 12] = [
        0,
        0x8000_0000, // -0
        1,           // least denormal
        0x007f_ffff, // largest denormal
        0x0080_0000, // least normal
        0x7f7f_ffff, // largest
        0xff7f_ffff,
        0x7f80_0000, // infinities
        0xff80_0000,
        0x7fc0_0000, // NaN, quiet and signalling
        0x7f80_0001,
        0xffff_ffff,
    ];
    let bits = random.next();
    let low = bits as u32;
    match bits >> 58 {
        0 => f32::from_bits(SPECIAL[(low % 12) as usize]),
        1 => f32::from_bits(low),
        _ => (f64::from(low) / f64::from(u32::MAX) * 8.0 - 4.0) as f32,
    }
}

fn any_measurement(random: &mut SplitMix) -> Measurement<f32> {
    let drive = [(); 2].map(|()| match random.next() % 8 {
        0 => Saturation::Upper,
        1 => Saturation::Lower,
        _ => Saturation::None,
    });
    Measurement {
        angle: [any_value(random), any_value(random)],
        root_slope: any_value(random),
        root_slope_rate: any_value(random),
        force: any_value(random),
        motor: [any_value(random), any_value(random)],
        root_moment: any_value(random),
        drive,
    }
}

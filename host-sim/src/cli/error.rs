//! Why a command failed, and the exit code that says so.

use crate::analysis::fixed_point::accuracy::AccuracyError;
use crate::analysis::fixed_point::range::RangeError;
use crate::analysis::hybrid::HybridError;
use crate::analysis::stability::StabilityError;
use crate::campaign::engine::CampaignError;
use crate::campaign::identity::Shard;
use crate::campaign::merge::MergeError;
use crate::files::campaign_rows::RowsError;
use crate::files::config::ConfigError;
use crate::planner::table_fit::TableFitError;
use crate::planner::task::PlanError;
use crate::simulation::bench::BenchError;
use crate::simulation::closed_loop::{Outcome, RunError};
#[cfg(feature = "target")]
use crate::target::pil::PilError;
#[cfg(feature = "target")]
use crate::target::{ServeError, TargetError};
use crate::text::{Shortest, four_digits, round_away_from_zero};
#[cfg(feature = "target")]
use flexor::fault::Fault;
use flexor::table::TableError;
use std::io;
use std::path::PathBuf;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub(super) enum CliError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error("limits.torque_Nm[{}] = {}; accepted: from {} on, as the planned torque of joint {joint} reaches {} N m at t = {t_s:.4} s; a longer duration_s may need less", joint - 1, Shortest(*limit_nm), round_away_from_zero(*torque_nm), four_digits(*torque_nm))]
    Limit {
        joint: usize,
        t_s: f64,
        torque_nm: f64,
        limit_nm: f64,
    },
    #[error("{}: drives.full_scale_Nm[{}] = {}, of which drives.usable_share is {} N m; accepted: from {} on, as the planned torque of joint {joint} reaches {} N m at t = {t_s:.4} s; a longer duration_s may need less", file.display(), joint - 1, Shortest(*full_scale_nm), four_digits(*limit_nm), round_away_from_zero(*torque_nm * *full_scale_nm / *limit_nm), four_digits(*torque_nm))]
    DriveLimit {
        file: PathBuf,
        joint: usize,
        t_s: f64,
        torque_nm: f64,
        full_scale_nm: f64,
        limit_nm: f64,
    },
    #[error("{}: {source}", file.display())]
    Table { file: PathBuf, source: TableError },
    #[error("{}: the table has {found}, this task has {expected}: plan it again", file.display())]
    OtherTiming {
        file: PathBuf,
        found: String,
        expected: String,
    },
    #[error("{}: the table is of task {found:#010x}, this is task {expected:#010x}: another path, force, elbow, number of link2.elements or --model; name with --task what the file of --table was planned for, or plan it again", file.display())]
    OtherTask {
        file: PathBuf,
        found: u32,
        expected: u32,
    },
    #[error("{}: cannot be read: {cause}", file.display())]
    Unreadable { file: PathBuf, cause: io::Error },
    #[error("{}: another command is writing its results there; wait for its end, or name another folder with --out", folder.display())]
    Busy { folder: PathBuf },
    #[error("{}: cannot be written: {cause}", file.display())]
    Unwritable { file: PathBuf, cause: io::Error },
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    Range(#[from] RangeError),
    #[cfg(feature = "report")]
    #[error(transparent)]
    Report(#[from] crate::report::ReportError),
    #[error(transparent)]
    Stability(#[from] StabilityError),
    #[error("--at {}; accepted: a time of the plan from {} to {} s", Shortest(*at_s), Shortest(*start_s), Shortest(*end_s))]
    At { at_s: f64, start_s: f64, end_s: f64 },
    #[error("--only {number}; accepted: a run from 0 to {}, as --runs says", runs - 1)]
    NoRun { number: u64, runs: u64 },
    #[error("--shard {shard} has none of --runs {runs}; accepted: as many shards as runs at most")]
    EmptyShard { shard: Shard, runs: u64 },
    #[error(transparent)]
    Bench(#[from] BenchError),
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    #[error(transparent)]
    Merge(#[from] MergeError),
    #[error(transparent)]
    Rows(#[from] RowsError),
    #[error("the verdict does not hold: {0}")]
    Verdict(String),
    #[error("--map {gain} {gain}; accepted: two different gains")]
    Map { gain: String },
    #[error("law = \"{law}\" is not known to `flexor {command}` yet; accepted: \"paper\"")]
    PaperLawOnly {
        command: &'static str,
        law: &'static str,
    },
    #[error(
        "{what} needs a task along a surface, and this one is a move through the air; `flexor plan`, and `flexor run` and `flexor campaign` on the bench, take it"
    )]
    Move { what: &'static str },
    #[error("{}: --then takes a move through the air, with a [move]", file.display())]
    NoMove { file: PathBuf },
    #[error("--limit {} {}; accepted: two torques in N m above 0", Shortest(*first), Shortest(*second))]
    AccuracyLimit { first: f64, second: f64 },
    #[error(transparent)]
    Hybrid(#[from] HybridError),
    #[error("these gains do not hold every arm: {why}")]
    Unproven { why: String },
    #[error("--root-inertia-kgm2 {} {}; accepted: an inertia in kg m^2 from 0 to 1000, and no smaller one", Shortest(*low), Shortest(*high))]
    RootInertia { low: f64, high: f64 },
    #[error("{what} has no effect {beside}")]
    NoEffect {
        what: &'static str,
        beside: &'static str,
    },
    #[error(
        "demo's fast case, the task in a fifth of its duration_s, cannot be planned: {0}; `flexor run` runs a task as it is"
    )]
    Fast(Box<CliError>),
    #[error("{what} {}; accepted: from 0 to {}", Shortest(*value), Shortest(*most))]
    Margin {
        what: &'static str,
        value: f64,
        most: f64,
    },
    #[error(transparent)]
    TableFit(#[from] TableFitError),
    #[error("the simulation stopped at t = {t_s:.4} s: {}; the results up to there are in {}", outcome.name(), out.display())]
    Stopped {
        t_s: f64,
        outcome: Outcome,
        out: PathBuf,
    },
    #[error("the outcome is {}, --require-completed accepts completed; the results are in {}", outcome.name(), out.display())]
    NotCompleted { outcome: Outcome, out: PathBuf },
    #[cfg(feature = "target")]
    #[error(transparent)]
    Pil(#[from] PilError),
    #[cfg(feature = "target")]
    #[error(transparent)]
    Serve(#[from] ServeError),
    #[cfg(feature = "target")]
    #[error(transparent)]
    Board(#[from] BoardError),
    #[cfg(feature = "target")]
    #[error(
        "{differing} of {ticks} commands differ from the simulator's, the first at tick {first}"
    )]
    Differs {
        differing: usize,
        ticks: usize,
        first: usize,
    },
    #[cfg(feature = "target")]
    #[error(
        "{differing} of {count} commands for arbitrary measurements differ from the simulator's"
    )]
    RandomDiffers { differing: u32, count: u32 },
    #[error("signals cannot be caught, so nothing is begun that must be ended in order: {0}")]
    Signals(#[from] ctrlc::Error),
    #[error("standard output: {0}")]
    Stdout(io::Error),
}

impl From<AccuracyError> for CliError {
    fn from(error: AccuracyError) -> Self {
        match error {
            AccuracyError::Range(error) => Self::Range(error),
            AccuracyError::Run(error) => Self::Run(error),
        }
    }
}

impl CliError {
    /// 2 where the user's input is at fault, 3 where the work was done and its verdict is not
    /// the one that was asked for, 1 elsewhere.
    pub(super) fn exit_code(&self) -> u8 {
        match self {
            Self::Config(_)
            | Self::Plan(_)
            | Self::Limit { .. }
            | Self::DriveLimit { .. }
            | Self::Table { .. }
            | Self::OtherTiming { .. }
            | Self::OtherTask { .. }
            | Self::Unreadable { .. }
            | Self::Busy { .. }
            | Self::At { .. }
            | Self::Map { .. }
            | Self::NoEffect { .. }
            | Self::Move { .. }
            | Self::NoMove { .. }
            | Self::PaperLawOnly { .. }
            | Self::Unproven { .. }
            | Self::RootInertia { .. }
            | Self::AccuracyLimit { .. }
            | Self::NoRun { .. }
            | Self::EmptyShard { .. }
            | Self::Bench(_)
            | Self::Campaign(_)
            | Self::Merge(_)
            | Self::Rows(_)
            | Self::Range(_)
            | Self::TableFit(TableFitError::Inexact { .. })
            | Self::Run(_) => 2,
            Self::Margin { .. } => 2,
            #[cfg(feature = "target")]
            Self::Pil(
                PilError::TickRate { .. }
                | PilError::OtherTable { .. }
                | PilError::Run(_)
                | PilError::Target(
                    TargetError::NoImage { .. }
                    | TargetError::Address { .. }
                    | TargetError::NoLogTable { .. }
                    | TargetError::TableTooLong { .. }
                    | TargetError::Port { .. }
                    | TargetError::Refused(_),
                ),
            ) => 2,
            #[cfg(feature = "target")]
            Self::Board(error) => error.exit_code(),
            #[cfg(feature = "target")]
            Self::Serve(_) => 2,
            // No gains found, or the optimiser's failure, is none of the user's.
            Self::Stability(StabilityError::NotTuned { .. } | StabilityError::Optimiser(_)) => 1,
            Self::Stability(_) => 2,
            Self::Hybrid(HybridError::NotDesigned { .. }) => 1,
            Self::Hybrid(_) => 2,
            Self::NotCompleted { .. } => 3,
            Self::Unwritable { .. }
            | Self::TableFit(TableFitError::Format(_))
            | Self::Stopped { .. }
            | Self::Signals(_)
            | Self::Stdout(_) => 1,
            #[cfg(feature = "report")]
            Self::Report(_) => 1,
            #[cfg(feature = "target")]
            Self::Pil(_) | Self::Differs { .. } | Self::RandomDiffers { .. } => 1,
            Self::Verdict(_) => 3,
            Self::Fast(error) => error.exit_code(),
        }
    }
}

#[cfg(feature = "target")]
/// Why a request to the board came to nothing.
#[derive(Debug, thiserror::Error)]
pub(super) enum BoardError {
    #[error(transparent)]
    Target(#[from] TargetError),
    #[error(
        "stopped by fault {} ({fault}) after tick {tick} of {ticks}, drives off; it is latched until `flexor board acknowledge`",
        fault.number()
    )]
    Fault { fault: Fault, tick: u32, ticks: u32 },
    #[error("{count} {} in the way of enabling", if *count == 1 { "thing is" } else { "things are" })]
    Obstacles { count: usize },
    #[error("somebody else disabled it after tick {tick} of {ticks}")]
    Disabled { tick: u32, ticks: u32 },
    #[error("the run was ended after tick {tick} of {ticks}, and not by this command; disabled")]
    Retracted { tick: u32, ticks: u32 },
    #[error("interrupted and disabled after tick {tick} of {ticks}")]
    Interrupted { tick: u32, ticks: u32 },
    #[error(
        "it did not confirm to be disabled ({0}); an enabled board stops by itself 100 ms after the last request"
    )]
    NotDisabled(TargetError),
}

#[cfg(feature = "target")]
impl BoardError {
    /// 2 where the command line is at fault, 1 elsewhere.
    fn exit_code(&self) -> u8 {
        match self {
            Self::Target(
                TargetError::NoImage { .. }
                | TargetError::Address { .. }
                | TargetError::NoLogTable { .. }
                | TargetError::Port { .. },
            ) => 2,
            _ => 1,
        }
    }
}

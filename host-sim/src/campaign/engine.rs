//! The runs of a campaign: drawn, put side by side, on all cores.
//!
//! A run depends on the scenario, the campaign's seed and its own number, and on nothing else: not
//! on which arms advance beside it, on how many cores there are, or on what ran before. So runs can
//! be repeated, resumed and shared out, with the same bits.

use crate::campaign::record::{RunFigures, RunRecord};
use crate::campaign::scenario::{Scenario, run_seed};
use crate::plant::bench::F64x4;
use crate::plant::bench::lanes::Lanes;
use crate::simulation::bench::{self, ArmKind, BenchArm, BenchError, BenchRow, BenchTask};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

/// The runs that are possible, of which any may be run.
#[derive(Clone, Copy, Debug)]
pub struct Campaign<'a> {
    /// What every arm is to do, and with which board.
    pub task: BenchTask<'a>,
    /// The arms.
    pub scenario: &'a Scenario,
    /// Seed of the campaign.
    pub seed: u64,
}

/// Why a run could not take place.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("run {run} (seed {seed}) has no arm: {source}; a narrower spread is accepted")]
pub struct CampaignError {
    /// Number of the run.
    pub run: u64,
    /// Its seed.
    pub seed: u64,
    /// Why.
    pub source: BenchError,
}

/// Runs that are drawn at a time: enough that few of them have no fellow of their kind, and few
/// enough that what a kill destroys is little.
const DRAWN_AT_A_TIME: usize = 256;

/// A run, drawn.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Its number.
    pub run: u64,
    /// Its seed.
    pub seed: u64,
    /// The drawn values, in the order of [`Scenario::spread_keys`].
    pub values: Vec<f64>,
    /// The arm.
    pub arm: BenchArm,
}

impl Campaign<'_> {
    /// Makes sure that every one of these runs has an arm, before any of them is run: to draw an arm
    /// takes a twentieth of what a run takes.
    ///
    /// # Errors
    /// The first [`CampaignError`].
    pub fn check(&self, runs: &[u64]) -> Result<(), CampaignError> {
        let check = |run: &u64| self.draw(*run).map(drop);
        runs.par_iter()
            .map(check)
            .find_first(Result::is_err)
            .unwrap_or(Ok(()))
    }

    /// The runs of these numbers, each handed to `done` as soon as it is over, in no order, with its
    /// ticks if `ticks` says so. Ends early once `stop` is set.
    ///
    /// # Errors
    /// The first [`CampaignError`]; runs that were over before have been handed to `done`.
    pub fn run_all(
        &self,
        runs: &[u64],
        stop: &AtomicBool,
        ticks: bool,
        done: impl Fn(RunRecord, Vec<BenchRow>) + Sync,
    ) -> Result<(), CampaignError> {
        for some in runs.chunks(DRAWN_AT_A_TIME) {
            let drawn: Result<Vec<Drawn>, _> = some.par_iter().map(|run| self.draw(*run)).collect();
            let mut kinds: BTreeMap<ArmKind, Vec<Drawn>> = BTreeMap::new();
            for drawn in drawn? {
                kinds.entry(drawn.arm.kind()).or_default().push(drawn);
            }
            // The longest first, so that the cores are done at the same time.
            let mut batches: Vec<Vec<Drawn>> = Vec::new();
            for mut kind in kinds.into_values().rev() {
                while !kind.is_empty() {
                    let rest = kind.split_off(kind.len().min(F64x4::LANES));
                    batches.push(kind);
                    kind = rest;
                }
            }
            batches.into_par_iter().try_for_each(|batch| {
                if stop.load(Ordering::Relaxed) {
                    return Ok(());
                }
                let over = self.run_batch(batch, ticks)?;
                over.into_iter()
                    .for_each(|(record, ticks)| done(record, ticks));
                Ok(())
            })?;
            if stop.load(Ordering::Relaxed) {
                break;
            }
        }
        Ok(())
    }

    /// The arm of this run.
    ///
    /// # Errors
    /// [`CampaignError`].
    pub fn draw(&self, run: u64) -> Result<Drawn, CampaignError> {
        let seed = run_seed(self.seed, run);
        let (setup, values) = self.scenario.draw(seed);
        let arm = setup.on_bench(self.task.plan, seed);
        let arm = arm.map_err(|source| CampaignError { run, seed, source })?;
        Ok(Drawn {
            run,
            seed,
            values,
            arm,
        })
    }

    /// Runs of one kind, side by side, with their ticks if `ticks` says so.
    fn run_batch(
        &self,
        batch: Vec<Drawn>,
        ticks: bool,
    ) -> Result<Vec<(RunRecord, Vec<BenchRow>)>, CampaignError> {
        let arms: Vec<BenchArm> = batch.iter().map(|drawn| drawn.arm.clone()).collect();
        let mut logs = vec![Vec::new(); arms.len()];
        let log = |lane: usize, row: &BenchRow| {
            if ticks {
                logs[lane].push(*row);
            }
        };
        let figures = match arms.len() {
            1 => self.advance::<f64>(&arms, log),
            _ => self.advance::<F64x4>(&arms, log),
        };
        let figures = figures.map_err(|source| batch[0].error(source))?;
        let runs = batch.into_iter().zip(figures).zip(logs);
        Ok(runs
            .map(|((drawn, figures), log)| (drawn.record(figures), log))
            .collect())
    }

    fn advance<T: Lanes>(
        &self,
        arms: &[BenchArm],
        mut log: impl FnMut(usize, &BenchRow),
    ) -> Result<Vec<RunFigures>, BenchError> {
        bench::run::<T>(&self.task, arms, |lane, row, _| log(lane, row))
    }
}

impl Drawn {
    fn record(self, figures: RunFigures) -> RunRecord {
        RunRecord {
            run: self.run,
            seed: self.seed,
            drawn: self.values,
            figures,
        }
    }

    fn error(&self, source: BenchError) -> CampaignError {
        CampaignError {
            run: self.run,
            seed: self.seed,
            source,
        }
    }
}

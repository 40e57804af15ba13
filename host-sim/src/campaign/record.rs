//! What a campaign keeps of a run: the drawn values, how the run ended, and its figures.

pub use crate::simulation::bench::{FIGURES, Figure, RunFigures};
pub use crate::simulation::closed_loop::Outcome as RunOutcome;

/// A run of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct RunRecord {
    /// Number of the run in its campaign, from 0.
    pub run: u64,
    /// Seed of the run's own random numbers.
    pub seed: u64,
    /// The drawn values, in the order of [`CampaignRecords::parameters`]. A choice counts by
    /// its value, or by its number where it has none.
    pub drawn: Vec<f64>,
    /// What came of it.
    pub figures: RunFigures,
}

/// The runs of a campaign, or of a shard of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CampaignRecords {
    /// Dotted keys of the scenario's values that have a spread, in order.
    pub parameters: Vec<String>,
    /// The runs by rising number, each once.
    pub runs: Vec<RunRecord>,
}

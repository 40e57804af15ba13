//! Everything that is found in a campaign's runs, for the summary and the report.

use super::drivers::{Driver, Split, of_failure, of_force_error, splits};
use super::record::CampaignRecords;
use super::statistics::Statistics;
use super::verdict::{Judged, Limits};

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Findings {
    /// Failures and figures.
    pub statistics: Statistics,
    /// The scenario's limits, judged.
    pub verdict: Vec<Judged>,
    /// What drives failure, the strongest first.
    pub failure_drivers: Vec<Driver>,
    /// What drives the force error's rms, the strongest first.
    pub force_drivers: Vec<Driver>,
    /// The thresholds that part failures from successes best, each among the better side of the
    /// one before.
    pub splits: Vec<Split>,
}

impl Findings {
    /// What is found in these runs, with these limits.
    pub fn new(records: &CampaignRecords, limits: &Limits) -> Self {
        let statistics = Statistics::new(records);
        Self {
            verdict: limits.judge(&statistics),
            statistics,
            failure_drivers: of_failure(records),
            force_drivers: of_force_error(records),
            splits: splits(records),
        }
    }

    /// Whether every limit that is given holds.
    pub fn holds(&self) -> bool {
        self.verdict.iter().all(|judged| judged.holds)
    }
}

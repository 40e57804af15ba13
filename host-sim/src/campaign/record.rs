//! What a campaign keeps of a run: the drawn values, how the run ended, and its figures.

use flexor::fault::Fault;

/// How a run of a campaign ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunOutcome {
    /// To the end, on its path and with its force; with or without loss of contact, which the
    /// figures tell.
    Completed,
    /// The tip was farther off the path than its limit allows.
    TipOffPath,
    /// The contact force was farther off its reference than its limit allows.
    ForceOff,
    /// The state became infinite or undefined, or the tip left the arm's reach.
    Diverged,
    /// The controller or the supervisor around it latched a fault.
    Fault(Fault),
}

impl RunOutcome {
    /// The outcomes that are no fault.
    const OWN: [Self; 4] = [
        Self::Completed,
        Self::TipOffPath,
        Self::ForceOff,
        Self::Diverged,
    ];

    /// Stable name in snake case, as the files show it; a fault has its own.
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::TipOffPath => "tip_off_path",
            Self::ForceOff => "force_off",
            Self::Diverged => "diverged",
            Self::Fault(fault) => fault.name(),
        }
    }

    /// The outcome of this [`name`](Self::name).
    pub fn from_name(name: &str) -> Option<Self> {
        let faults = Fault::ALL.into_iter().map(Self::Fault);
        Self::OWN
            .into_iter()
            .chain(faults)
            .find(|outcome| outcome.name() == name)
    }

    /// True for all but [`Completed`](Self::Completed).
    pub fn failed(self) -> bool {
        self != Self::Completed
    }
}

/// A run's figures, up to the tick at which it ended. Those of a run that diverged may be
/// infinite or NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunFigures {
    /// How the run ended.
    pub outcome: RunOutcome,
    /// Root mean square of the true contact force's error over all ticks, N.
    pub force_error_rms_n: f64,
    /// Its largest magnitude, N.
    pub force_error_max_n: f64,
    /// Root mean square of the tip's error along the surface, m.
    pub along_error_rms_m: f64,
    /// Its largest magnitude, m.
    pub along_error_max_m: f64,
    /// Time without contact, all ticks together, s.
    pub contact_lost_s: f64,
    /// The longest time without contact, s.
    pub contact_lost_longest_s: f64,
    /// Largest contact force, N.
    pub force_max_n: f64,
    /// Largest torque magnitudes of both joints, N m.
    pub torque_max_nm: [f64; 2],
    /// Ticks in which a torque was limited.
    pub limited_ticks: u32,
    /// Time at which the run ended, from the path's start, s.
    pub ended_s: f64,
}

/// A figure of every run that has a unit: its name in files, and where it is in
/// [`RunFigures`].
pub type Figure = (&'static str, fn(&RunFigures) -> f64);

impl RunFigures {
    /// The figures that are real numbers, in the order of the files' columns.
    pub const COLUMNS: [Figure; 10] = [
        ("force_error_rms_N", |f| f.force_error_rms_n),
        ("force_error_max_N", |f| f.force_error_max_n),
        ("along_error_rms_m", |f| f.along_error_rms_m),
        ("along_error_max_m", |f| f.along_error_max_m),
        ("contact_lost_s", |f| f.contact_lost_s),
        ("contact_lost_longest_s", |f| f.contact_lost_longest_s),
        ("force_max_N", |f| f.force_max_n),
        ("torque1_max_Nm", |f| f.torque_max_nm[0]),
        ("torque2_max_Nm", |f| f.torque_max_nm[1]),
        ("ended_s", |f| f.ended_s),
    ];

    /// The figures of these values in the order of [`COLUMNS`](Self::COLUMNS).
    pub fn from_columns(outcome: RunOutcome, values: [f64; 10], limited_ticks: u32) -> Self {
        let [
            force_error_rms_n,
            force_error_max_n,
            along_error_rms_m,
            along_error_max_m,
            contact_lost_s,
            contact_lost_longest_s,
            force_max_n,
            torque1_max_nm,
            torque2_max_nm,
            ended_s,
        ] = values;
        Self {
            outcome,
            force_error_rms_n,
            force_error_max_n,
            along_error_rms_m,
            along_error_max_m,
            contact_lost_s,
            contact_lost_longest_s,
            force_max_n,
            torque_max_nm: [torque1_max_nm, torque2_max_nm],
            limited_ticks,
            ended_s,
        }
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_outcome_has_a_name_of_its_own() {
        let faults = Fault::ALL.map(RunOutcome::Fault);
        for outcome in RunOutcome::OWN.into_iter().chain(faults) {
            assert_eq!(RunOutcome::from_name(outcome.name()), Some(outcome));
            assert_eq!(outcome.failed(), outcome.name() != "completed");
        }
        assert_eq!(RunOutcome::from_name("Completed"), None);
    }

    #[test]
    fn figures_come_back_from_their_columns() {
        let values = std::array::from_fn(|i| 1.5 + i as f64);
        let figures = RunFigures::from_columns(RunOutcome::Diverged, values, 7);
        assert_eq!(
            RunFigures::COLUMNS.map(|(_, value)| value(&figures)),
            values
        );
        assert_eq!(figures.limited_ticks, 7);
    }
}

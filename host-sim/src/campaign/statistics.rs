//! What a campaign's runs say together: how many fail, and how well the others do.

use super::record::{CampaignRecords, FIGURES, RunFigures, RunOutcome};
use serde::Serialize;

/// Fewest successful runs whose 95th percentile may be judged: with fewer, less than one run lies
/// above it.
pub const RUNS_FOR_P95: u64 = 20;

/// 97.5th percentile of the standard normal distribution: a two-sided 95 % interval's.
const Z_95: f64 = 1.959_963_984_540_054;

/// The value below which the share `q` (0 to 1) of `sorted` lies, interpolated linearly between
/// the two nearest: the convention that NumPy's `percentile` and R's `quantile` (type 7) have by
/// default. `None` without values.
pub fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let place = q.clamp(0.0, 1.0) * last as f64;
    let below = libm::floor(place) as usize;
    let (low, high) = (sorted[below], sorted[(below + 1).min(last)]);
    if low == high {
        // Infinite values have no difference.
        return Some(low);
    }
    Some(low + (place - below as f64) * (high - low))
}

/// A figure's distribution over the runs that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantiles {
    /// Half of the runs have less.
    pub median: f64,
    /// 95 % of the runs have less, see [`quantile`].
    pub p95: f64,
    /// No run has more.
    pub max: f64,
}

impl Quantiles {
    /// Of values in any order; `None` without values.
    pub fn new(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        Some(Self {
            median: quantile(&values, 0.5)?,
            p95: quantile(&values, 0.95)?,
            max: *values.last()?,
        })
    }
}

/// A two-sided 95 % confidence interval of a rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Its lower end, 0 to 1.
    pub low: f64,
    /// Its upper end, 0 to 1.
    pub high: f64,
}

impl Interval {
    /// Wilson's score interval for `count` of `runs`; all of [0, 1] without runs.
    ///
    /// Wilson's rather than Clopper and Pearson's: one formula with one root, whose bits are the
    /// same on every host, where the other needs the beta distribution's quantile. The upper
    /// ends, by which a campaign is judged, differ little: 1.264 % and 1.222 % for none of 300,
    /// 10.07 % and 10.11 % for 20 of 300. The interval holds exactly the rates that a two-sided
    /// score test does not reject, see [`contains`](Self::contains).
    pub fn wilson(count: u64, runs: u64) -> Self {
        if runs == 0 {
            return Self {
                low: 0.0,
                high: 1.0,
            };
        }
        let (k, n) = (count.min(runs) as f64, runs as f64);
        let z2 = Z_95 * Z_95;
        let middle = (k + 0.5 * z2) / (n + z2);
        let half = Z_95 / (n + z2) * libm::sqrt(k * (n - k) / n + 0.25 * z2);
        Self {
            // Exactly, where rounding would leave a trace.
            low: if count == 0 { 0.0 } else { middle - half },
            high: if count >= runs { 1.0 } else { middle + half },
        }
    }

    /// Whether the runs are consistent with the rate `rate`, say a published one.
    pub fn contains(&self, rate: f64) -> bool {
        self.low <= rate && rate <= self.high
    }
}

/// What a campaign's runs say together.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// Number of runs.
    pub runs: u64,
    /// How many of them failed.
    pub failed: u64,
    /// How many ended how, the most frequent first.
    pub outcomes: Vec<(RunOutcome, u64)>,
    /// Confidence interval of the failure rate.
    pub fail_rate: Interval,
    /// How many lost contact at any tick, or failed: a run that fails is not one that held it.
    pub contact_lost_or_failed: u64,
    /// The figures of the runs that did not fail, in the order of [`RunFigures::COLUMNS`];
    /// `None` where all failed.
    pub figures: Option<[Quantiles; FIGURES]>,
}

impl Statistics {
    /// The statistics of these runs.
    pub fn new(records: &CampaignRecords) -> Self {
        let all = || records.runs.iter().map(|run| &run.figures);
        let count = |counts: &dyn Fn(&RunFigures) -> bool| {
            all().filter(|figures| counts(figures)).count() as u64
        };
        let mut outcomes: Vec<(RunOutcome, u64)> = vec![];
        for figures in all() {
            match outcomes
                .iter_mut()
                .find(|(outcome, _)| *outcome == figures.outcome)
            {
                Some((_, count)) => *count += 1,
                None => outcomes.push((figures.outcome, 1)),
            }
        }
        outcomes.sort_by_key(|(outcome, count)| (std::cmp::Reverse(*count), outcome.name()));
        let (runs, failed) = (count(&|_| true), count(&|f| f.outcome.failed()));
        let of = |value: fn(&RunFigures) -> f64| {
            Quantiles::new(all().filter(|f| !f.outcome.failed()).map(value).collect())
        };
        let figures: Vec<Quantiles> = RunFigures::COLUMNS
            .iter()
            .filter_map(|(_, value)| of(*value))
            .collect();
        Self {
            runs,
            failed,
            outcomes,
            fail_rate: Interval::wilson(failed, runs),
            contact_lost_or_failed: count(&|f| f.outcome.failed() || f.contact_lost_s > 0.0),
            figures: figures.try_into().ok(),
        }
    }

    /// How many runs did not fail.
    pub fn succeeded(&self) -> u64 {
        self.runs - self.failed
    }

    /// `count` as a share of all runs, 0 to 1; `None` without runs.
    pub fn share(&self, count: u64) -> Option<f64> {
        (self.runs > 0).then(|| count as f64 / self.runs as f64)
    }

    /// The distribution of the figure of this name, one of [`RunFigures::COLUMNS`].
    pub fn figure(&self, name: &str) -> Option<Quantiles> {
        let place = RunFigures::COLUMNS
            .iter()
            .position(|(column, _)| *column == name)?;
        Some(self.figures.as_ref()?[place])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::record::RunRecord;
    use flexor::fault::Fault;

    /// Runs of these outcomes, force errors (N) and times without contact (s).
    fn records(runs: &[(RunOutcome, f64, f64)]) -> CampaignRecords {
        let runs = (0..).zip(runs).map(|(run, (outcome, force, lost))| {
            let mut values = [0.5; FIGURES];
            (values[0], values[4]) = (*force, *lost);
            RunRecord {
                run,
                seed: run,
                drawn: vec![],
                figures: RunFigures::from_columns(*outcome, values, 0),
            }
        });
        CampaignRecords {
            parameters: vec![],
            runs: runs.collect(),
        }
    }

    #[test]
    fn percentiles_are_numpys() {
        let tens: Vec<f64> = (1..=10).map(f64::from).collect();
        // By hand: place 0.95 * 9 = 8.55 between 9 and 10.
        for (q, wanted) in [(0.0, 1.0), (0.5, 5.5), (0.95, 9.55), (1.0, 10.0)] {
            assert!((quantile(&tens, q).unwrap() - wanted).abs() < 1e-14, "{q}");
        }
        assert_eq!(quantile(&[4.0], 0.95), Some(4.0));
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(
            quantile(&[1.0, f64::INFINITY, f64::INFINITY], 0.9),
            Some(f64::INFINITY)
        );
        let of = Quantiles::new(vec![7.0, 1.0, 2.0, 3.0]).unwrap();
        assert_eq!((of.median, of.max), (2.5, 7.0));
        assert!((of.p95 - 6.4).abs() < 1e-14, "{of:?}");
    }

    #[test]
    fn wilsons_interval_is_the_published_one() {
        // Newcombe (1998), Statistics in Medicine 17, table I, method 3.
        for (count, runs, low, high) in [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ] {
            let found = Interval::wilson(count, runs);
            assert!(
                (found.low - low).abs() < 5e-5,
                "{count} of {runs}: {found:?}"
            );
            assert!(
                (found.high - high).abs() < 5e-5,
                "{count} of {runs}: {found:?}"
            );
            let other = Interval::wilson(runs - count, runs);
            assert!((other.high - (1.0 - found.low)).abs() < 1e-15);
        }
        // None of n: z^2 / (n + z^2).
        let none = Interval::wilson(0, 300);
        assert_eq!(none.low, 0.0);
        assert!((none.high - 3.841_458_820_694_124 / 303.841_458_820_694_1).abs() < 1e-15);
        assert_eq!(Interval::wilson(7, 7).high, 1.0);
        assert!(Interval::wilson(0, 0).contains(0.5));
    }

    #[test]
    fn an_interval_holds_what_the_score_test_does_not_reject() {
        for (count, runs) in [(0, 30), (3, 50), (55, 200), (200, 200)] {
            let interval = Interval::wilson(count, runs);
            for rate in (1..1000).map(|i| f64::from(i) / 1000.0) {
                let off = count as f64 / runs as f64 - rate;
                let z = off / libm::sqrt(rate * (1.0 - rate) / runs as f64);
                assert_eq!(interval.contains(rate), z.abs() <= Z_95, "{count}, {rate}");
            }
        }
    }

    #[test]
    fn runs_that_fail_count_as_failures_and_nowhere_else() {
        use RunOutcome::{Completed, Diverged, TipOffPath};
        let mut runs: Vec<(RunOutcome, f64, f64)> = (0..9)
            .map(|i| (Completed, f64::from(i), if i < 2 { 0.1 } else { 0.0 }))
            .collect();
        runs.push((Diverged, f64::NAN, 0.0));
        runs.push((TipOffPath, 1e9, 0.3));
        runs.push((RunOutcome::Fault(Fault::SensorRange), 1e9, 0.0));
        runs.push((Diverged, 1e9, 0.0));
        let found = Statistics::new(&records(&runs));
        assert_eq!((found.runs, found.failed, found.succeeded()), (13, 4, 9));
        assert_eq!(found.contact_lost_or_failed, 6);
        let force = found.figure("force_error_rms_N").unwrap();
        assert_eq!((force.median, force.max), (4.0, 8.0));
        assert_eq!(found.share(found.failed), Some(4.0 / 13.0));
        assert_eq!(found.figure("force_error_rms"), None);
        let names: Vec<&str> = found.outcomes.iter().map(|(o, _)| o.name()).collect();
        assert_eq!(
            names,
            ["completed", "diverged", "sensor_range", "tip_off_path"]
        );

        let all = Statistics::new(&records(&runs[9..]));
        assert_eq!((all.figures, all.fail_rate.high), (None, 1.0));
        let none = Statistics::new(&CampaignRecords::default());
        assert_eq!((none.share(0), none.figures), (None, None));
    }
}

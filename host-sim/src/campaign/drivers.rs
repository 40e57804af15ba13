//! Which drawn value drives failure, and which the force error.
//!
//! A parameter can do harm at one end of its spread, or at both: a mass that is 10 % off spoils
//! the feedforward either way, which a correlation with the mass itself does not show. Therefore
//! every parameter is looked at twice, by its value and by its distance from its median.

use super::record::{CampaignRecords, RunRecord};
use super::statistics::quantile;

/// Chance of marking anything as significant in a campaign in which nothing drives anything.
const SIGNIFICANCE: f64 = 0.05;

/// Fewest failures, and fewest successes, among which a split is looked for.
pub const RUNS_TO_SPLIT: usize = 10;

/// Fewest runs on either side of a split: fewer may differ by chance.
const SIDE_MIN: usize = 5;

/// What of a drawn value counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aspect {
    /// The value itself.
    Value,
    /// Its distance from this median of all runs' values.
    DistanceFrom(f64),
}

impl Aspect {
    /// The aspect of a drawn `value`.
    pub fn of(self, value: f64) -> f64 {
        match self {
            Self::Value => value,
            Self::DistanceFrom(median) => (value - median).abs(),
        }
    }
}

/// How a parameter goes with what is looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct Driver {
    /// The parameter's place in [`CampaignRecords::parameters`].
    pub parameter: usize,
    /// Which of its aspects is the more telling one.
    pub aspect: Aspect,
    /// Spearman's rank correlation, -1 to 1.
    pub correlation: f64,
    /// Whether chance is an unlikely explanation: the probability of so large a magnitude
    /// without any relation, times the number of correlations looked at (Bonferroni), is
    /// below 5 %.
    pub significant: bool,
}

/// The parameters by the magnitude of their rank correlation with failure, over all runs; those
/// that do not vary are left out. Empty where no run or every run failed.
pub fn of_failure(records: &CampaignRecords) -> Vec<Driver> {
    let failed = |run: &RunRecord| f64::from(u8::from(run.figures.outcome.failed()));
    drivers(records, &records.runs.iter().collect::<Vec<_>>(), &failed)
}

/// The parameters by the magnitude of their rank correlation with the force error's rms, over the
/// runs that did not fail: that of a failed run tells when it was stopped.
pub fn of_force_error(records: &CampaignRecords) -> Vec<Driver> {
    let completed = records.runs.iter().filter(|r| !r.figures.outcome.failed());
    drivers(records, &completed.collect::<Vec<_>>(), &|run| {
        run.figures.force_error_rms_n
    })
}

/// The aspects of a parameter that are looked at; none where it does not vary among `runs`.
fn aspects(runs: &[&RunRecord], parameter: usize) -> Vec<Aspect> {
    let mut values: Vec<f64> = runs.iter().map(|run| run.drawn[parameter]).collect();
    values.sort_by(f64::total_cmp);
    let Some(median) = quantile(&values, 0.5).filter(|_| values.first() != values.last()) else {
        return vec![];
    };
    vec![Aspect::Value, Aspect::DistanceFrom(median)]
}

fn drivers(
    records: &CampaignRecords,
    runs: &[&RunRecord],
    effect: &dyn Fn(&RunRecord) -> f64,
) -> Vec<Driver> {
    let effect: Vec<f64> = runs.iter().map(|run| effect(run)).collect();
    let effect = ranks(&effect);
    let mut tests = 0;
    let mut found = vec![];
    for parameter in 0..records.parameters.len() {
        let mut best: Option<Driver> = None;
        for aspect in aspects(runs, parameter) {
            let cause: Vec<f64> = runs.iter().map(|r| aspect.of(r.drawn[parameter])).collect();
            let Some(correlation) = pearson(&ranks(&cause), &effect) else {
                continue;
            };
            tests += 1;
            if best
                .as_ref()
                .is_none_or(|b| correlation.abs() > b.correlation.abs())
            {
                best = Some(Driver {
                    parameter,
                    aspect,
                    correlation,
                    significant: false,
                });
            }
        }
        found.extend(best);
    }
    for driver in &mut found {
        driver.significant =
            chance(driver.correlation, runs.len()) * f64::from(tests) < SIGNIFICANCE;
    }
    found.sort_by(|a, b| b.correlation.abs().total_cmp(&a.correlation.abs()));
    found
}

/// Ranks from 1; equal values share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    for tied in order.chunk_by(|a, b| values[*a] == values[*b]) {
        let before = order.partition_point(|i| values[*i].total_cmp(&values[tied[0]]).is_lt());
        let rank = before as f64 + 0.5 * (tied.len() + 1) as f64;
        for i in tied {
            ranks[*i] = rank;
        }
    }
    ranks
}

/// Pearson's correlation; `None` where one of both does not vary. Of ranks it is Spearman's, ties
/// included.
fn pearson(x: &[f64], y: &[f64]) -> Option<f64> {
    let n = x.len() as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
    let (mean_x, mean_y) = (mean(x), mean(y));
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        let (dx, dy) = (x - mean_x, y - mean_y);
        xx += dx * dx;
        yy += dy * dy;
        xy += dx * dy;
    }
    (xx > 0.0 && yy > 0.0).then(|| (xy / libm::sqrt(xx * yy)).clamp(-1.0, 1.0))
}

/// Probability of a correlation of at least this magnitude if `runs` effects fell to the causes by
/// chance. Over all permutations a correlation has mean 0 and variance 1 / (runs - 1), ties or
/// not; the normal distribution stands for the permutations'.
fn chance(correlation: f64, runs: usize) -> f64 {
    let freedom = runs.saturating_sub(1) as f64;
    libm::erfc(correlation.abs() * libm::sqrt(0.5 * freedom))
}

/// How many of how many runs failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// Failed runs.
    pub failed: usize,
    /// All runs.
    pub runs: usize,
}

/// A threshold of one parameter that parts failures from successes.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    /// The parameter's place in [`CampaignRecords::parameters`].
    pub parameter: usize,
    /// Which of its aspects is compared.
    pub aspect: Aspect,
    /// The threshold.
    pub threshold: f64,
    /// Runs whose value is below the threshold.
    pub below: Share,
    /// The others.
    pub above: Share,
}

impl Split {
    /// Whether a greater share of the runs below the threshold fails than of the others.
    pub fn worse_below(&self) -> bool {
        let (below, above) = (self.below, self.above);
        below.failed * above.runs > above.failed * below.runs
    }
}

/// Most thresholds that are looked for one after the other.
const SPLITS_MAX: usize = 4;

/// The threshold that parts failures from successes best; then the one that does so best among
/// the runs on its better side, which shows a rarer cause behind a frequent one; and so on.
pub fn splits(records: &CampaignRecords) -> Vec<Split> {
    let mut runs: Vec<&RunRecord> = records.runs.iter().collect();
    let mut found: Vec<Split> = vec![];
    while let Some(split) = best_split(records.parameters.len(), &runs) {
        let better_above = split.worse_below();
        runs.retain(|run| {
            let above = split.aspect.of(run.drawn[split.parameter]) >= split.threshold;
            above == better_above
        });
        found.push(split);
        if found.len() == SPLITS_MAX {
            break;
        }
    }
    found
}

/// The threshold that parts failures from successes best: a decision tree of one level, by the
/// least Gini impurity of both sides, which have at least five runs each. `None` with fewer than
/// [`RUNS_TO_SPLIT`] failures or successes, or where the best of all thresholds tried is one that
/// chance explains.
fn best_split(parameters: usize, runs: &[&RunRecord]) -> Option<Split> {
    let all = Share {
        failed: runs.iter().filter(|r| r.figures.outcome.failed()).count(),
        runs: runs.len(),
    };
    if all.failed.min(all.runs - all.failed) < RUNS_TO_SPLIT {
        return None;
    }
    let mut tried = 0;
    let mut best: Option<(f64, Split)> = None;
    for parameter in 0..parameters {
        for aspect in aspects(runs, parameter) {
            let mut order: Vec<(f64, bool)> = runs
                .iter()
                .map(|r| (aspect.of(r.drawn[parameter]), r.figures.outcome.failed()))
                .collect();
            order.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut below = Share { failed: 0, runs: 0 };
            for pair in order.windows(2) {
                below.runs += 1;
                below.failed += usize::from(pair[0].1);
                let above = Share {
                    failed: all.failed - below.failed,
                    runs: all.runs - below.runs,
                };
                if below.runs.min(above.runs) < SIDE_MIN || !(pair[0].0 < pair[1].0) {
                    continue;
                }
                tried += 1;
                let correlation = contrast(below, above);
                if best.as_ref().is_none_or(|(b, _)| correlation > *b) {
                    let threshold = short_between(pair[0].0, pair[1].0);
                    let split = Split {
                        parameter,
                        aspect,
                        threshold,
                        below,
                        above,
                    };
                    best = Some((correlation, split));
                }
            }
        }
    }
    best.filter(|(correlation, _)| chance(*correlation, all.runs) * f64::from(tried) < SIGNIFICANCE)
        .map(|(_, split)| split)
}

/// Magnitude of the correlation between failing and being above (phi). Its square is what the
/// Gini impurity decreases by, relative to that of all runs.
fn contrast(below: Share, above: Share) -> f64 {
    let [a, b] = [below.failed, below.runs - below.failed].map(|n| n as f64);
    let [c, d] = [above.failed, above.runs - above.failed].map(|n| n as f64);
    (a * d - b * c).abs() / libm::sqrt((a + b) * (c + d) * (a + c) * (b + d))
}

/// The shortest number above `low` and not above `high`.
fn short_between(low: f64, high: f64) -> f64 {
    let middle = low + 0.5 * (high - low);
    (0..17)
        .filter_map(|digits| format!("{middle:.digits$e}").parse().ok())
        .find(|short| low < *short && *short <= high)
        .unwrap_or(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::record::{FIGURES, RunFigures, RunOutcome};
    use proptest::prelude::*;

    /// Runs with these drawn values, of which some fail and have no force error.
    fn records(parameters: usize, runs: Vec<(Vec<f64>, bool, f64)>) -> CampaignRecords {
        let runs = (0..).zip(runs).map(|(run, (drawn, failed, force))| {
            let outcome = match failed {
                true => RunOutcome::Diverged,
                false => RunOutcome::Completed,
            };
            let mut values = [0.0; FIGURES];
            values[0] = if failed { f64::NAN } else { force };
            RunRecord {
                run,
                seed: 0,
                drawn,
                figures: RunFigures::from_columns(outcome, values, 0),
            }
        });
        CampaignRecords {
            parameters: (0..parameters).map(|i| format!("p.{i}")).collect(),
            runs: runs.collect(),
        }
    }

    /// Numbers from 0 to 1 that look drawn and never repeat: a golden-ratio sequence.
    fn spread(run: usize, parameter: usize) -> f64 {
        let step = [
            0.618_033_988_749_894_9,
            0.414_213_562_373_095,
            0.324_717_957_244_746,
        ];
        (0.37 + (run + 1) as f64 * step[parameter]) % 1.0
    }

    fn campaign(runs: usize, fails: impl Fn(&[f64]) -> bool) -> CampaignRecords {
        let draw = |run| -> Vec<f64> { (0..3).map(|parameter| spread(run, parameter)).collect() };
        let runs = (0..runs).map(draw).map(|drawn| {
            let (failed, force) = (fails(&drawn), 1.0 - drawn[1]);
            (drawn, failed, force)
        });
        records(3, runs.collect())
    }

    #[test]
    fn ranks_and_correlation_are_the_textbooks() {
        // Intelligence and hours of television, the standard example: -29/165.
        let iq = [106., 100., 86., 101., 99., 103., 97., 113., 112., 110.];
        let hours = [7., 27., 2., 50., 28., 29., 20., 12., 6., 17.];
        let found = pearson(&ranks(&iq), &ranks(&hours)).unwrap();
        assert!((found + 29.0 / 165.0).abs() < 1e-14, "{found}");
        assert_eq!(ranks(&[3.0, 1.0, 3.0, 3.0, 0.5]), [4.0, 2.0, 4.0, 4.0, 1.0]);
        assert_eq!(ranks(&[]), [0.0; 0]);
        assert_eq!(pearson(&[1.0, 1.0], &[1.0, 2.0]), None);
    }

    #[test]
    fn a_separated_binary_effect_has_the_closed_forms_correlation() {
        // n causes in order of which the k largest fail: the mean ranks are n/2 apart, so
        // rho = sqrt(3 k (n - k) / (n^2 - 1)).
        for (n, k) in [(200_u32, 55_u32), (50, 1), (9, 4)] {
            let cause: Vec<f64> = (0..n).map(f64::from).collect();
            let effect: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i >= n - k))).collect();
            let found = pearson(&ranks(&cause), &ranks(&effect)).unwrap();
            let wanted = f64::from(3 * k * (n - k)) / f64::from(n * n - 1);
            assert!((found * found - wanted).abs() < 1e-13, "{n} {k}: {found}");
        }
    }

    #[test]
    fn chance_is_the_normal_distributions() {
        // A correlation of z / sqrt(n - 1) has the two-sided probability of z.
        for (z, wanted) in [(1.959_963_985, 0.05), (2.575_829_304, 0.01), (0.0, 1.0)] {
            let found = chance(-z / 10.0, 101);
            assert!((found - wanted).abs() < 1e-9, "{z}: {found}");
        }
    }

    #[test]
    fn the_parameter_that_drives_failure_comes_first() {
        let low = campaign(200, |drawn| drawn[2] < 0.3);
        let found = of_failure(&low);
        assert_eq!((found.len(), found[0].parameter), (3, 2));
        assert_eq!(found[0].aspect, Aspect::Value);
        assert!(found[0].correlation < -0.7 && found[0].significant);
        assert!(!found[1].significant && !found[2].significant, "{found:?}");
        let force = of_force_error(&low);
        assert_eq!(force[0].parameter, 1);
        assert!((force[0].correlation + 1.0).abs() < 1e-12);

        // At both ends: nothing in the value, all in the distance.
        let ends = campaign(200, |drawn| (drawn[0] - 0.5).abs() > 0.4);
        let found = of_failure(&ends);
        assert_eq!(found[0].parameter, 0);
        assert!(matches!(found[0].aspect, Aspect::DistanceFrom(m) if (m - 0.5).abs() < 0.01));
        assert!(found[0].correlation > 0.6 && found[0].significant);
    }

    #[test]
    fn what_does_not_vary_drives_nothing() {
        let runs = (0..30).map(|run| (vec![2.0, f64::from(run)], run % 2 == 0, 1.0));
        let campaign = records(2, runs.collect());
        assert_eq!(of_failure(&campaign).len(), 1);
        // All force errors are the same.
        assert!(of_force_error(&campaign).is_empty());
        assert!(of_failure(&CampaignRecords::default()).is_empty());
        assert!(of_failure(&records(1, vec![(vec![1.0], true, 0.0)])).is_empty());
    }

    #[test]
    fn a_split_finds_the_threshold_and_counts_both_sides() {
        let low = campaign(200, |drawn| drawn[2] < 0.3);
        let [split] = &splits(&low)[..] else {
            panic!("no split")
        };
        assert_eq!(
            (split.parameter, split.aspect, split.threshold),
            (2, Aspect::Value, 0.3)
        );
        assert_eq!(split.below.failed, split.below.runs);
        assert_eq!(
            (split.above.failed, split.below.runs + split.above.runs),
            (0, 200)
        );

        let ends = campaign(200, |drawn| (drawn[0] - 0.5).abs() > 0.4);
        let [split] = &splits(&ends)[..] else {
            panic!("no split")
        };
        assert!(matches!(split.aspect, Aspect::DistanceFrom(_)), "{split:?}");
        assert!((split.threshold - 0.4).abs() < 0.01);
        assert_eq!(
            (split.below.failed, split.above.failed),
            (0, split.above.runs)
        );
    }

    #[test]
    fn a_rare_cause_is_found_behind_a_frequent_one() {
        let two = campaign(300, |drawn| drawn[2] < 0.3 || drawn[0] > 0.93);
        let found = splits(&two);
        let causes: Vec<usize> = found.iter().map(|split| split.parameter).collect();
        assert_eq!(causes, [2, 0]);
        assert!(found[0].worse_below() && !found[1].worse_below());
        assert!((found[1].threshold - 0.93).abs() < 0.01, "{found:?}");
        assert_eq!(
            (found[1].above.failed, found[1].below.failed),
            (found[1].above.runs, 0)
        );
        let left = found[0].above;
        assert_eq!(found[1].above.runs + found[1].below.runs, left.runs);
        assert_eq!(found[1].above.failed, left.failed);
    }

    #[test]
    fn no_split_is_claimed_where_chance_explains_it() {
        // Every fourth run fails, whatever it drew.
        let runs = (0..200).map(|run| {
            let drawn = (0..3).map(|parameter| spread(run, parameter)).collect();
            (drawn, run % 4 == 0, 1.0)
        });
        let by_chance = records(3, runs.collect());
        assert_eq!(splits(&by_chance), []);
        assert!(
            of_failure(&by_chance)
                .iter()
                .all(|driver| !driver.significant)
        );
        // Too few failures.
        assert_eq!(splits(&campaign(200, |drawn| drawn[2] < 0.04)), []);
        assert_eq!(splits(&CampaignRecords::default()), []);
    }

    #[test]
    fn thresholds_are_short() {
        assert_eq!(short_between(0.928_371, 0.934_9), 0.93);
        assert_eq!(short_between(-2.5, 7.0), 2.0);
        let (low, high) = (1.0, 1.0_f64.next_up());
        assert_eq!(short_between(low, high), high);
    }

    proptest! {
        #[test]
        fn thresholds_part_their_neighbours(a in -1e3..1e3_f64, b in -1e3..1e3_f64) {
            let (low, high) = (a.min(b), a.max(b));
            prop_assume!(low < high);
            let found = short_between(low, high);
            prop_assert!(low < found && found <= high);
        }

        #[test]
        fn a_correlation_is_the_same_for_every_rising_scale(
            pairs in prop::collection::vec((-5..5_i32, -5..5_i32), 3..40),
        ) {
            let x: Vec<f64> = pairs.iter().map(|p| f64::from(p.0)).collect();
            let y: Vec<f64> = pairs.iter().map(|p| f64::from(p.1)).collect();
            let cubes: Vec<f64> = x.iter().map(|x| 1e-3 * x * x * x + 7.0).collect();
            let down: Vec<f64> = x.iter().map(|x| -x).collect();
            let of = |x: &[f64]| pearson(&ranks(x), &ranks(&y));
            prop_assert_eq!(of(&x), of(&cubes));
            let (up, down) = (of(&x), of(&down));
            prop_assert_eq!(up.is_some(), down.is_some());
            if let (Some(up), Some(down)) = (up, down) {
                prop_assert!((up + down).abs() < 1e-12);
            }
        }
    }
}

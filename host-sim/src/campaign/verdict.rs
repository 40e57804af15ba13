//! A campaign against the limits that its scenario gives: `[verdict]`.

use super::statistics::{RUNS_FOR_P95, Statistics};
use serde::{Deserialize, Serialize};

/// The limits of a scenario's `[verdict]`, each of which may be missing. Figures are of the runs
/// that did not fail, but for the rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Share of the runs that fail, 0 to 1.
    pub fail_rate_max: Option<f64>,
    /// Upper end of that share's 95 % confidence interval, 0 to 1: with few runs no rate is
    /// proved to be small.
    pub fail_rate_upper95_max: Option<f64>,
    /// Median of the force error's rms, N.
    #[serde(rename = "force_rms_median_max_N")]
    pub force_rms_median_max_n: Option<f64>,
    /// 95th percentile of the force error's rms, N.
    #[serde(rename = "force_rms_p95_max_N")]
    pub force_rms_p95_max_n: Option<f64>,
    /// 95th percentile of the largest force error, N.
    #[serde(rename = "force_max_p95_max_N")]
    pub force_max_p95_max_n: Option<f64>,
    /// 95th percentile of the largest error along the surface, m.
    pub along_max_p95_max_m: Option<f64>,
    /// The largest error along the surface of all these runs, m.
    pub along_max_max_m: Option<f64>,
    /// Share of the runs that lose contact at any tick or fail, 0 to 1.
    pub contact_lost_runs_share_max: Option<f64>,
    /// The longest time without contact of all these runs, s.
    pub contact_lost_longest_max_s: Option<f64>,
}

/// A limit, judged.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// Its name in the scenario.
    pub key: &'static str,
    /// The limit.
    pub limit: f64,
    /// What was found; `None` where too few runs did not fail: one at least, for a 95th
    /// percentile [`RUNS_FOR_P95`].
    pub found: Option<f64>,
    /// Whether what was found is not above the limit. What was not found does not hold.
    pub holds: bool,
}

impl Limits {
    /// Every limit that is given: its name in the scenario, and its value.
    pub fn given(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let all = [
            ("fail_rate_max", self.fail_rate_max),
            ("fail_rate_upper95_max", self.fail_rate_upper95_max),
            ("force_rms_median_max_N", self.force_rms_median_max_n),
            ("force_rms_p95_max_N", self.force_rms_p95_max_n),
            ("force_max_p95_max_N", self.force_max_p95_max_n),
            ("along_max_p95_max_m", self.along_max_p95_max_m),
            ("along_max_max_m", self.along_max_max_m),
            (
                "contact_lost_runs_share_max",
                self.contact_lost_runs_share_max,
            ),
            (
                "contact_lost_longest_max_s",
                self.contact_lost_longest_max_s,
            ),
        ];
        all.into_iter()
            .filter_map(|(key, limit)| Some((key, limit?)))
    }

    /// Judges the limits that are given, one by one.
    pub fn judge(&self, statistics: &Statistics) -> Vec<Judged> {
        self.given()
            .map(|(key, limit)| {
                let found = found(key, statistics);
                Judged {
                    key,
                    limit,
                    found,
                    // Neither does NaN hold.
                    holds: found.is_some_and(|found| found <= limit),
                }
            })
            .collect()
    }
}

/// What the limit of this name is compared with.
fn found(key: &str, s: &Statistics) -> Option<f64> {
    let p95 = |name| {
        let enough = s.succeeded() >= RUNS_FOR_P95;
        s.figure(name).filter(|_| enough).map(|of| of.p95)
    };
    match key {
        "fail_rate_max" => s.share(s.failed),
        "fail_rate_upper95_max" => s.share(s.failed).map(|_| s.fail_rate.high),
        "force_rms_median_max_N" => Some(s.figure("force_error_rms_N")?.median),
        "force_rms_p95_max_N" => p95("force_error_rms_N"),
        "force_max_p95_max_N" => p95("force_error_max_N"),
        "along_max_p95_max_m" => p95("along_error_max_m"),
        "along_max_max_m" => Some(s.figure("along_error_max_m")?.max),
        "contact_lost_runs_share_max" => s.share(s.contact_lost_or_failed),
        "contact_lost_longest_max_s" => Some(s.figure("contact_lost_longest_s")?.max),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::record::{CampaignRecords, FIGURES, RunFigures, RunOutcome, RunRecord};

    /// `succeeded` runs whose figures are all their number, from 1, and `failed` others.
    fn statistics(succeeded: u64, failed: u64) -> Statistics {
        let runs = (0..succeeded + failed).map(|run| {
            let outcome = match run < succeeded {
                true => RunOutcome::Completed,
                false => RunOutcome::ForceOff,
            };
            RunRecord {
                run,
                seed: 0,
                drawn: vec![],
                figures: RunFigures::from_columns(outcome, [(run + 1) as f64; FIGURES], 0),
            }
        });
        Statistics::new(&CampaignRecords {
            parameters: vec![],
            runs: runs.collect(),
        })
    }

    /// Every limit, at the same value.
    fn all(limit: f64) -> Limits {
        let keys = [
            "fail_rate_max",
            "fail_rate_upper95_max",
            "force_rms_median_max_N",
            "force_rms_p95_max_N",
            "force_max_p95_max_N",
            "along_max_p95_max_m",
            "along_max_max_m",
            "contact_lost_runs_share_max",
            "contact_lost_longest_max_s",
        ];
        let text: String = keys.map(|key| format!("{key} = {limit:?}\n")).concat();
        toml::from_str(&text).unwrap()
    }

    #[test]
    fn every_limit_is_compared_with_its_figure() {
        let judged = all(1.0).judge(&statistics(21, 79));
        let found: Vec<f64> = judged.iter().map(|one| one.found.unwrap()).collect();
        // The figures are 1 to 21; a contact force that is never there is lost.
        let wanted = [0.79, 0.8583, 11.0, 20.0, 20.0, 20.0, 21.0, 1.0, 21.0];
        assert_eq!(found.len(), wanted.len());
        for (one, wanted) in judged.iter().zip(wanted) {
            assert!((one.found.unwrap() - wanted).abs() < 5e-5, "{one:?}");
            assert_eq!(one.holds, wanted <= 1.0, "{one:?}");
        }
    }

    #[test]
    fn a_limit_holds_at_its_value_and_not_below() {
        for one in all(0.0).judge(&statistics(40, 10)) {
            let mut limits = Limits::default();
            let found = one.found.unwrap();
            let judged = |limits: &Limits| limits.judge(&statistics(40, 10))[0].holds;
            for (limit, holds) in [(found, true), (found.next_down(), false), (f64::NAN, false)] {
                let text = format!("{} = {limit:?}", one.key);
                limits = match limit.is_nan() {
                    true => toml::from_str(&format!("{} = nan", one.key)).unwrap(),
                    false => toml::from_str(&text).unwrap(),
                };
                assert_eq!(judged(&limits), holds, "{text}");
            }
            assert_eq!(limits.given().count(), 1);
        }
        assert!(Limits::default().judge(&statistics(1, 0)).is_empty());
    }

    #[test]
    fn what_too_few_runs_say_does_not_hold() {
        let holds = |succeeded, failed| -> Vec<&str> {
            let judged = all(1e9).judge(&statistics(succeeded, failed));
            let holding = judged.iter().filter(|one| one.holds);
            holding.map(|one| one.key).collect()
        };
        assert_eq!(holds(20, 0).len(), 9);
        // No 95th percentile of nineteen.
        assert!(holds(19, 7).iter().all(|key| !key.contains("p95")));
        assert_eq!(holds(19, 7).len(), 6);
        assert_eq!(
            holds(0, 7),
            [
                "fail_rate_max",
                "fail_rate_upper95_max",
                "contact_lost_runs_share_max"
            ]
        );
        assert!(holds(0, 0).is_empty());
    }

    #[test]
    fn unknown_limits_are_refused() {
        let error = toml::from_str::<Limits>("force_rms_p95_max = 1.0").unwrap_err();
        assert!(error.to_string().contains("unknown field"), "{error}");
    }
}

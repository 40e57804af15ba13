//! What was found in a campaign, as JSON.

use super::export::object;
use crate::campaign::drivers::{Aspect, Driver, Share, Split};
use crate::campaign::findings::Findings;
use crate::campaign::record::RunFigures;
use serde_json::{Map, Value, json};

/// A campaign's findings, keys with units; `parameters` are the drawn ones, which drivers are
/// named by. A figure's values are `null` where every run failed, or where they are not finite.
///
/// `fail_rate_ci95` is the two ends of the failure rate's confidence interval; every figure an
/// object with `median`, `p95` and `max` over the runs that did not fail; `holds` is whether all
/// limits of `verdict` do. Of `failure_drivers` and `force_drivers`, strongest first, `of` is
/// `value`, or `distance` where the parameter does harm at both ends, from its median `from`. Each
/// of `failure_splits` is among the better side of the one before.
pub fn summary_json(findings: &Findings, parameters: &[String]) -> Map<String, Value> {
    let s = &findings.statistics;
    let outcomes: Map<String, Value> = s
        .outcomes
        .iter()
        .map(|(outcome, count)| (outcome.name().into(), json!(count)))
        .collect();
    let mut summary = object([
        ("runs", json!(s.runs)),
        ("failed", json!(s.failed)),
        ("fail_rate", json!(s.share(s.failed))),
        ("fail_rate_ci95", json!([s.fail_rate.low, s.fail_rate.high])),
        ("contact_lost_or_failed", json!(s.contact_lost_or_failed)),
        ("outcomes", outcomes.into()),
    ]);
    for (name, _) in RunFigures::COLUMNS {
        // An object in any case: a reader that looks into it finds null where every run failed.
        let none = || json!({ "median": null, "p95": null, "max": null });
        let found = s.figure(name).map_or_else(none, |figure| json!(figure));
        summary.insert(name.into(), found);
    }
    let drivers = |drivers: &[Driver]| -> Value {
        let of = |driver| driver_json(driver, parameters);
        drivers.iter().map(of).collect()
    };
    let splits = findings.splits.iter();
    summary.extend(object([
        ("verdict", json!(findings.verdict)),
        ("holds", json!(findings.holds())),
        ("failure_drivers", drivers(&findings.failure_drivers)),
        ("force_drivers", drivers(&findings.force_drivers)),
        (
            "failure_splits",
            splits.map(|split| split_json(split, parameters)).collect(),
        ),
    ]));
    summary
}

/// A parameter and which aspect of it counts.
fn aspect_json(parameter: usize, aspect: Aspect, parameters: &[String]) -> Map<String, Value> {
    let mut map = object([("parameter", json!(parameters.get(parameter)))]);
    match aspect {
        Aspect::Value => map.extend(object([("of", json!("value"))])),
        Aspect::DistanceFrom(median) => {
            map.extend(object([("of", json!("distance")), ("from", json!(median))]));
        }
    }
    map
}

fn driver_json(driver: &Driver, parameters: &[String]) -> Map<String, Value> {
    let mut map = aspect_json(driver.parameter, driver.aspect, parameters);
    map.extend(object([
        ("rank_correlation", json!(driver.correlation)),
        ("significant", json!(driver.significant)),
    ]));
    map
}

fn split_json(split: &Split, parameters: &[String]) -> Map<String, Value> {
    let share =
        |share: Share| object([("failed", json!(share.failed)), ("runs", json!(share.runs))]);
    let mut map = aspect_json(split.parameter, split.aspect, parameters);
    map.extend(object([
        ("threshold", json!(split.threshold)),
        ("below", share(split.below).into()),
        ("above", share(split.above).into()),
    ]));
    map
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::record::FIGURES;
    use crate::campaign::record::{CampaignRecords, RunOutcome, RunRecord};
    use crate::campaign::verdict::Limits;

    #[test]
    fn the_names_that_tools_rely_on_are_there() {
        // The runs whose second parameter is below 12 fail.
        let runs = (0..40_u32).map(|run| {
            let outcome = match run < 12 {
                true => RunOutcome::ForceOff,
                false => RunOutcome::Completed,
            };
            RunRecord {
                run: run.into(),
                seed: 0,
                drawn: vec![f64::from(run * 17 % 40), f64::from(run)],
                figures: RunFigures::from_columns(outcome, [f64::from(run); FIGURES], 0),
            }
        });
        let records = CampaignRecords {
            parameters: vec!["a.b".into(), "c.d".into()],
            runs: runs.collect(),
        };
        let limits: Limits = toml::from_str("fail_rate_max = 0.2\nalong_max_max_m = 39.0").unwrap();
        let json = summary_json(&Findings::new(&records, &limits), &records.parameters);
        assert_eq!((&json["runs"], &json["failed"]), (&json!(40), &json!(12)));
        assert_eq!(json["fail_rate"], 0.3);
        assert_eq!(json["fail_rate_ci95"].as_array().unwrap().len(), 2);
        for name in [
            "force_error_rms_N",
            "force_error_max_N",
            "along_error_max_m",
            "contact_lost_s",
        ] {
            assert_eq!(json[name]["median"], 25.5);
            assert_eq!(json[name]["max"], 39.0);
            assert!(json[name]["p95"].is_f64());
        }
        assert_eq!(json["outcomes"]["force_off"], 12);
        assert_eq!(json["holds"], false);
        assert_eq!(
            json["verdict"],
            json!([
                {"key": "fail_rate_max", "limit": 0.2, "found": 0.3, "holds": false},
                {"key": "along_max_max_m", "limit": 39.0, "found": 39.0, "holds": true},
            ])
        );
        assert_eq!(json["failure_drivers"][0]["parameter"], "c.d");
        assert_eq!(json["failure_drivers"][0]["of"], "value");
        assert_eq!(
            json["failure_splits"],
            json!([{"parameter": "c.d", "of": "value", "threshold": 12.0,
                "below": {"failed": 12, "runs": 12}, "above": {"failed": 0, "runs": 28}}])
        );
    }

    #[test]
    fn a_campaign_without_a_success_has_no_figures() {
        let found = Findings::new(&CampaignRecords::default(), &Limits::default());
        let json = summary_json(&found, &[]);
        let nothing = json!({"median": null, "p95": null, "max": null});
        assert_eq!(json["force_error_rms_N"], nothing);
        assert_eq!(
            (&json["fail_rate"], &json["holds"]),
            (&Value::Null, &json!(true))
        );
    }
}

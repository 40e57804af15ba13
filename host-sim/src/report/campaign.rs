//! The report of a campaign: verdict first, then figures, what drives failure, and the worst
//! runs with the command that repeats them.

use super::figures::{campaign_figures, correlation_text, number, percent};
use super::page::Verdict;
use super::{ReportError, page};
use crate::campaign::drivers::{Aspect, Driver, Split};
use crate::campaign::findings::Findings;
use crate::campaign::identity::{CampaignIdentity, Shard};
use crate::campaign::record::{CampaignRecords, RunRecord};
use minijinja::{Value, context};
use std::cmp::Ordering;
use std::path::Path;

/// Failed runs that the table of the worst ones has, and others.
const WORST_FAILED: usize = 10;
const WORST_COMPLETED: usize = 5;

/// Parameters that the table of drivers has.
const DRIVERS_MAX: usize = 12;

/// Drawn values that are named of a run.
const EXTREMES: usize = 3;

/// What the page on a campaign shows.
#[derive(Clone, Copy, Debug)]
pub struct CampaignPage<'a> {
    /// Which campaign.
    pub identity: &'a CampaignIdentity,
    /// Its runs.
    pub records: &'a CampaignRecords,
    /// What was found in them.
    pub findings: &'a Findings,
    /// Names and facts, after those of the identity.
    pub notes: &'a [(String, String)],
    /// What it was made from: names and facts.
    pub provenance: &'a [(String, String)],
}

/// Writes the page on a campaign to `dir`/report.html and its figures beside it as SVG files:
/// `campaign_distributions.svg` and, where any drawn value varies, `campaign_drivers.svg`. All
/// text is escaped, and the page needs nothing but itself.
///
/// # Errors
/// [`ReportError`].
pub fn write_campaign(dir: &Path, content: &CampaignPage<'_>) -> Result<(), ReportError> {
    let figures = campaign_figures(content.records, content.findings)?;
    page::write_svgs(dir, &figures)?;
    let values = values(content, &page::embedded(figures));
    page::write(&dir.join("report.html"), "campaign.html", values, None)
}

/// What the page's template takes.
fn values(content: &CampaignPage<'_>, figures: &[Value]) -> Value {
    let CampaignPage {
        identity,
        records,
        findings,
        notes,
        provenance,
    } = *content;
    let worst = worst(records);
    let command = worst.first().map(|run| identity.command(Some(run.run)));
    let failed = worst
        .iter()
        .filter(|run| run.figures.outcome.failed())
        .count();
    context! {
        title => format!("Flexor: campaign of {} runs", records.runs.len()),
        verdict => verdict(findings),
        limits => limits(findings),
        figures_of_runs => figures_of_runs(findings),
        contact => contact(findings),
        splits => split_texts(findings, &records.parameters),
        drivers => drivers(findings, &records.parameters),
        worst => worst.iter().map(|run| worst_row(run, records)).collect::<Vec<_>>(),
        worst_hint => worst_hint(failed, worst.len() - failed),
        command,
        figures,
        notes => facts(identity).into_iter().chain(notes.iter().cloned()).collect::<Vec<_>>(),
        provenance,
    }
}

/// Whether the scenario's limits hold; without any how many runs failed.
fn verdict(findings: &Findings) -> Verdict {
    let all = findings.verdict.len();
    let broken = findings.verdict.iter().filter(|j| !j.holds).count();
    let limits = match (all, broken) {
        (0, _) => "The scenario gives no limits.".to_string(),
        (1, 0) => "The limit holds.".into(),
        (_, 0) => "All limits hold.".into(),
        (_, 1) => format!("1 of {all} limits does not hold."),
        _ => format!("{broken} of {all} limits do not hold."),
    };
    Verdict {
        good: broken == 0 && (all > 0 || findings.statistics.failed == 0),
        text: format!("{limits} {}", failures(findings)),
    }
}

fn limits(findings: &Findings) -> Vec<Value> {
    let row = |judged: &crate::campaign::verdict::Judged| {
        context! {
            key => judged.key,
            limit => number(judged.limit),
            found => judged.found.map_or("too few runs".into(), number),
            holds => judged.holds,
        }
    };
    findings.verdict.iter().map(row).collect()
}

/// How many failed, with the rate's interval, and how.
fn failures(findings: &Findings) -> String {
    let s = &findings.statistics;
    let Some(rate) = s.share(s.failed) else {
        return "There are no runs.".into();
    };
    let mut text = format!(
        "{} of {} runs failed: {}, 95 % confidence interval {} to {}.",
        s.failed,
        s.runs,
        percent(rate),
        percent(s.fail_rate.low),
        percent(s.fail_rate.high)
    );
    let how: Vec<String> = s
        .outcomes
        .iter()
        .filter(|(outcome, _)| outcome.failed())
        .map(|(outcome, count)| format!("{} {count}", outcome.name().replace('_', " ")))
        .collect();
    if !how.is_empty() {
        text.push_str(&format!(" They ended as: {}.", how.join(", ")));
    }
    text
}

/// Label, name in [`RunFigures::COLUMNS`](crate::campaign::record::RunFigures::COLUMNS), and by
/// what to multiply for the label's unit.
const ROWS: [(&str, &str, f64); 6] = [
    ("Force error, rms (N)", "force_error_rms_N", 1.0),
    ("Largest force error (N)", "force_error_max_N", 1.0),
    (
        "Error along the surface, rms (mm)",
        "along_error_rms_m",
        1e3,
    ),
    (
        "Largest error along the surface (mm)",
        "along_error_max_m",
        1e3,
    ),
    (
        "Without contact, all times together (ms)",
        "contact_lost_s",
        1e3,
    ),
    (
        "Without contact, the longest time (ms)",
        "contact_lost_longest_s",
        1e3,
    ),
];

fn figures_of_runs(findings: &Findings) -> Vec<(&'static str, [String; 3])> {
    let row = |(label, name, unit): (&'static str, &str, f64)| {
        let of = findings.statistics.figure(name);
        let cells = of.map_or(["", "", ""].map(String::from), |q| {
            [q.median, q.p95, q.max].map(|value| number(unit * value))
        });
        (label, cells)
    };
    ROWS.map(row).to_vec()
}

fn contact(findings: &Findings) -> String {
    let s = &findings.statistics;
    s.share(s.contact_lost_or_failed)
        .map_or(String::new(), |share| {
            format!(
                "{} of {} runs ({}) lost contact for at least one tick, or failed.",
                s.contact_lost_or_failed,
                s.runs,
                percent(share)
            )
        })
}

/// Sentences on the thresholds that part failures from successes.
fn split_texts(findings: &Findings, parameters: &[String]) -> Vec<String> {
    let splits = findings.splits.iter().enumerate();
    splits
        .map(|(place, split)| {
            let others = if place > 0 { "Of the others, " } else { "" };
            let cause = split_text(split, &parameters[split.parameter]);
            format!("{others}{cause}")
        })
        .collect()
}

fn split_text(split: &Split, key: &str) -> String {
    let threshold = number(split.threshold);
    let worse_below = split.worse_below();
    let (these, others) = match worse_below {
        true => (split.below, split.above),
        false => (split.above, split.below),
    };
    let place = match (split.aspect, worse_below) {
        (Aspect::Value, true) => format!("below {threshold}"),
        (Aspect::Value, false) => format!("from {threshold} on"),
        (Aspect::DistanceFrom(median), true) => {
            format!("within {threshold} of its median {}", number(median))
        }
        (Aspect::DistanceFrom(median), false) => {
            format!("off its median {} by {threshold} or more", number(median))
        }
    };
    format!(
        "{key} {place}: {} of {} runs fail, else {} of {}.",
        these.failed, these.runs, others.failed, others.runs
    )
}

/// Rows of the table of drivers: what drives failure first, then what drives the force error, the
/// others by magnitude.
fn drivers(findings: &Findings, parameters: &[String]) -> Vec<Value> {
    let of = |drivers: &[Driver], parameter: usize| {
        drivers.iter().find(|d| d.parameter == parameter).cloned()
    };
    let mut rows: Vec<[Option<Driver>; 2]> = (0..parameters.len())
        .map(|parameter| {
            let lists = [&findings.failure_drivers, &findings.force_drivers];
            lists.map(|list| of(list, parameter))
        })
        .filter(|row| row.iter().any(Option::is_some))
        .collect();
    let significant = |driver: &Option<Driver>| driver.as_ref().is_some_and(|d| d.significant);
    let weight = |row: &[Option<Driver>; 2]| {
        let magnitudes = row.iter().flatten().map(|d| d.correlation.abs());
        let most = magnitudes.fold(0.0, f64::max);
        (significant(&row[0]), significant(&row[1]), most)
    };
    rows.sort_by(|a, b| {
        let (a, b) = (weight(a), weight(b));
        (b.0, b.1).cmp(&(a.0, a.1)).then(b.2.total_cmp(&a.2))
    });
    let cell = |driver: &Option<Driver>| {
        driver.as_ref().map_or(String::new(), |driver| {
            let text = correlation_text(driver);
            match driver.aspect {
                Aspect::Value => text,
                Aspect::DistanceFrom(median) => format!("{text} off {}", number(median)),
            }
        })
    };
    rows.truncate(DRIVERS_MAX);
    rows.iter()
        .map(|row| {
            let parameter = row.iter().flatten().next().map_or(0, |d| d.parameter);
            context! {
                parameter => parameters[parameter],
                failure => cell(&row[0]),
                force => cell(&row[1]),
            }
        })
        .collect()
}

/// The worst runs: of those that failed the earliest to end, then of the others those with the
/// greatest force error.
fn worst(records: &CampaignRecords) -> Vec<&RunRecord> {
    let of = |failed: bool, order: &dyn Fn(&RunRecord, &RunRecord) -> Ordering, most: usize| {
        let runs = records.runs.iter();
        let mut runs: Vec<&RunRecord> = runs
            .filter(|run| run.figures.outcome.failed() == failed)
            .collect();
        runs.sort_by(|a, b| order(a, b));
        runs.truncate(most);
        runs
    };
    let earliest = |a: &RunRecord, b: &RunRecord| a.figures.ended_s.total_cmp(&b.figures.ended_s);
    let force = |run: &RunRecord| run.figures.force_error_rms_n;
    let greatest = |a: &RunRecord, b: &RunRecord| force(b).total_cmp(&force(a));
    let mut worst = of(true, &earliest, WORST_FAILED);
    worst.extend(of(false, &greatest, WORST_COMPLETED));
    worst
}

fn worst_hint(failed: usize, completed: usize) -> String {
    let failed = (failed > 0).then_some("those that failed first");
    let completed = (completed > 0).then_some("those with the greatest force error of the others");
    let parts: Vec<&str> = failed.into_iter().chain(completed).collect();
    match parts[..] {
        [] => String::new(),
        _ => format!("Shown are {}.", parts.join(", then ")),
    }
}

fn worst_row(run: &RunRecord, records: &CampaignRecords) -> Value {
    let f = &run.figures;
    context! {
        run => run.run,
        // As text: the template's numbers are signed.
        seed => run.seed.to_string(),
        failed => f.outcome.failed(),
        outcome => f.outcome.name().replace('_', " "),
        values => [
            f.ended_s,
            f.force_error_rms_n,
            f.force_error_max_n,
            1e3 * f.along_error_max_m,
            1e3 * f.contact_lost_s,
        ].map(number),
        drawn => extremes(run, records),
    }
}

/// The drawn values of a run that are the most unusual among all runs, with the share of runs
/// that drew less.
fn extremes(run: &RunRecord, records: &CampaignRecords) -> Vec<String> {
    let runs = records.runs.len() as f64;
    let mut values: Vec<(f64, String)> = records
        .parameters
        .iter()
        .enumerate()
        .filter_map(|(place, key)| {
            let value = run.drawn[place];
            let count = |than: fn(&f64, &f64) -> bool| {
                let all = records.runs.iter().map(|other| &other.drawn[place]);
                all.filter(|other| than(other, &value)).count() as f64 / runs
            };
            let (less, more) = (count(f64::lt), count(f64::gt));
            let text = format!("{key} {} ({} %)", number(value), (100.0 * less).floor());
            // What all draw the same is nothing unusual.
            (less > 0.0 || more > 0.0).then(|| ((less - more).abs(), text))
        })
        .collect();
    values.sort_by(|a, b| b.0.total_cmp(&a.0));
    values.truncate(EXTREMES);
    values.into_iter().map(|(_, text)| text).collect()
}

/// What the campaign is.
fn facts(identity: &CampaignIdentity) -> Vec<(String, String)> {
    let mut facts: Vec<(String, String)> = identity
        .inputs
        .iter()
        .filter(|input| !input.file.is_empty())
        .map(|input| (input.option.clone(), input.file.clone()))
        .collect();
    facts.push(("seed".into(), identity.seed.to_string()));
    facts.push(("runs".into(), identity.runs.to_string()));
    if identity.shard != Shard::ALL {
        facts.push(("shard".into(), identity.shard.to_string()));
    }
    facts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::identity::CampaignInput;
    use crate::campaign::verdict::Limits;
    use crate::report::testing::campaign_records;

    fn identity(file: &str) -> CampaignIdentity {
        CampaignIdentity {
            schema_version: 1,
            version: "0.1.0".into(),
            commit: "unknown".into(),
            seed: 9000,
            runs: 200,
            shard: Shard::ALL,
            inputs: vec![CampaignInput {
                option: "scenario".into(),
                file: file.into(),
                text: String::new(),
                sha256: String::new(),
            }],
            gains: serde_json::Map::new(),
        }
    }

    fn limits() -> Limits {
        let text = "fail_rate_max = 0.5\nforce_rms_p95_max_N = 0.2\nalong_max_max_m = 0.1";
        toml::from_str(text).unwrap()
    }

    fn page_of(records: &CampaignRecords, limits: &Limits, file: &str) -> String {
        let content = CampaignPage {
            identity: &identity(file),
            records,
            findings: &Findings::new(records, limits),
            notes: &[("wall time".into(), "12 s".into())],
            provenance: &[],
        };
        let figures = campaign_figures(records, content.findings).unwrap();
        let values = values(&content, &page::embedded(figures));
        page::render("campaign.html", values, None).unwrap()
    }

    #[test]
    fn the_page_begins_with_the_verdict_and_needs_nothing_else() {
        let records = campaign_records(200);
        let page = page_of(&records, &limits(), "bench.toml");
        let place = |text: &str| {
            let at = page.find(text);
            at.unwrap_or_else(|| panic!("no {text}"))
        };
        assert!(place("1 of 3 limits does not hold.") < place("of 200 runs failed: "));
        assert!(place("of 200 runs failed: ") < place("<svg "));
        assert!(place("<svg ") < place("Worst runs"));
        assert_eq!(page.matches("<svg ").count(), 2);
        for outside in [
            "http:", "https:", "src=", "href=", "url(", "@import", "<script",
        ] {
            assert!(!page.contains(outside), "the page contains {outside}");
        }
        // The made-up campaign's causes of failure, one at both ends.
        place("arm.link1.mass_kg off its median 8.00 by 0.620 or more: ");
        place("Of the others, arm.link2.root_inertia_kgm2 below 3.60e-5: ");
        let first = worst(&records)[0].run;
        place(&format!(
            "flexor campaign --scenario bench.toml --runs 200 --seed 9000 --only {first}<"
        ));
        place("<th scope=\"row\">wall time</th><td>12 s</td>");
    }

    #[test]
    fn the_worst_runs_are_those_that_failed_first_and_those_that_nearly_did() {
        let records = campaign_records(200);
        let worst = worst(&records);
        let failed: Vec<bool> = worst.iter().map(|r| r.figures.outcome.failed()).collect();
        assert_eq!(
            failed,
            [[true; 10].as_slice(), [false; 5].as_slice()].concat()
        );
        let ended: Vec<f64> = worst[..10].iter().map(|r| r.figures.ended_s).collect();
        assert!(ended.is_sorted());
        let found = Findings::new(&records, &limits());
        let greatest = found.statistics.figure("force_error_rms_N").unwrap().max;
        assert_eq!(worst[10].figures.force_error_rms_n, greatest);
        // Of the run with the least mass, the mass is the most unusual.
        let mass = |run: &&RunRecord| run.drawn[0];
        let lightest = records
            .runs
            .iter()
            .min_by(|a, b| mass(a).total_cmp(&mass(b)));
        let said = extremes(lightest.unwrap(), &records);
        assert_eq!(said.len(), EXTREMES);
        let mass = |text: &String| text.starts_with("arm.link1.mass_kg 7.2");
        assert!(
            said.iter()
                .any(|text| mass(text) && text.ends_with(" (0 %)")),
            "{said:?}"
        );
    }

    #[test]
    fn hostile_names_stay_text() {
        let mut records = campaign_records(40);
        records.parameters[0] = "</td><script>alert(1)</script>".into();
        let page = page_of(&records, &limits(), "a b'; rm -r \"<i>\".toml");
        assert!(!page.contains("<script") && !page.contains("<i>"));
        assert!(page.contains("&lt;script&gt;alert(1)"));
    }

    #[test]
    fn campaigns_without_runs_or_limits_make_a_page() {
        let empty = page_of(&CampaignRecords::default(), &Limits::default(), "s.toml");
        assert!(empty.contains("There are no runs.") && empty.contains("no limits"));
        let mut records = campaign_records(3);
        records.runs.retain(|run| !run.figures.outcome.failed());
        let few = page_of(&records, &limits(), "s.toml");
        assert!(few.contains("too few runs"), "{few}");
        records.parameters.clear();
        records.runs.iter_mut().for_each(|run| run.drawn.clear());
        let fixed = page_of(&records, &limits(), "s.toml");
        assert!(fixed.contains("No drawn value varies."));
    }

    #[test]
    fn page_and_figures_are_written() {
        let records = campaign_records(200);
        let folder = tempfile::tempdir().unwrap();
        let content = CampaignPage {
            identity: &identity("bench.toml"),
            records: &records,
            findings: &Findings::new(&records, &limits()),
            notes: &[],
            provenance: &[],
        };
        let dir = folder.path().join("new");
        write_campaign(&dir, &content).unwrap();
        for name in [
            "report.html",
            "campaign_distributions.svg",
            "campaign_drivers.svg",
        ] {
            assert!(dir.join(name).is_file(), "{name}");
        }
    }
}

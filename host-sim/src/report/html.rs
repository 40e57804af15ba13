//! The page of runs, which needs nothing but itself: no network, and without scripts still the
//! verdict, the table and the figures.

use super::figures::{figures, number};
use super::motion::{Motion, presses};
use super::page::{Explored, Verdict};
use super::series::Panel;
use super::{Case, ReportError, page};
use crate::simulation::closed_loop::{LogRow, Outcome};
use minijinja::{Value, context};
use serde::Serialize;
use std::path::Path;

/// A row of the table of results.
#[derive(Serialize)]
struct Row {
    case: String,
    plant: String,
    force_rms: String,
    force_max: String,
    tip_rms: String,
    tip_max: String,
    outcome: String,
    good: bool,
}

/// What the page of runs shows.
#[derive(Clone, Copy, Debug)]
pub struct RunsPage<'a> {
    /// The page's title.
    pub title: &'a str,
    /// The runs, at least one.
    pub cases: &'a [Case<'a>],
    /// Which of them the page begins with.
    pub shown: usize,
    /// Names and facts.
    pub notes: &'a [(String, String)],
    /// What the runs were made from: names and facts.
    pub provenance: &'a [(String, String)],
}

/// Writes the page of runs to `path`: the verdict, a table, the moving arm with all histories, which
/// share a time, and the figures of [`write_figures`](super::write_figures). All text is escaped.
///
/// The page's fragment chooses what is shown: `#case=3&t=1.2` is the third case at 1.2 s;
/// `from` and `to` zoom, `with` compares with another case, `bend` draws link 2's bending larger.
///
/// # Errors
/// [`ReportError`].
pub fn write_html(path: &Path, content: &RunsPage<'_>) -> Result<(), ReportError> {
    let explored: Vec<Explored> = content.cases.iter().map(explored).collect();
    let shown = content.shown.min(explored.len().saturating_sub(1));
    let values = values(content)?;
    page::write(path, "report.html", values, Some((&explored, shown)))
}

/// What the page's template takes.
fn values(content: &RunsPage<'_>) -> Result<Value, ReportError> {
    let rows: Vec<Row> = content.cases.iter().map(row).collect();
    let stills = page::embedded(figures(content.cases)?);
    Ok(context! {
        title => content.title,
        verdict => verdict(content.cases),
        rows,
        stills,
        notes => content.notes,
        provenance => content.provenance,
    })
}

fn row(case: &Case) -> Row {
    let summary = &case.run.summary;
    Row {
        case: case.title(),
        plant: case.plant_title(),
        force_rms: number(summary.force_error_rms),
        force_max: number(summary.force_error_max),
        tip_rms: number(1e3 * summary.tip_error_rms),
        tip_max: number(1e3 * summary.tip_error_max),
        outcome: case.outcome(),
        good: completed(case),
    }
}

fn completed(case: &Case) -> bool {
    case.run.summary.outcome == Outcome::Completed
}

/// How the runs ended: of one with its errors, of several with the names of those that were not
/// completed.
fn verdict(cases: &[Case]) -> Verdict {
    let good = cases.iter().all(completed);
    if let [case] = cases {
        let s = &case.run.summary;
        let mut text = format!("{}: ", capital(&case.outcome()));
        if presses(case.plan) {
            text.push_str(&format!(
                "contact force off by {} N rms and {} N at most, ",
                number(s.force_error_rms),
                number(s.force_error_max)
            ));
        }
        text.push_str(&format!(
            "tip off by {} mm rms and {} mm at most.",
            number(1e3 * s.tip_error_rms),
            number(1e3 * s.tip_error_max)
        ));
        return Verdict { good, text };
    }
    let of = cases.len();
    let done = cases.iter().filter(|case| completed(case)).count();
    let text = match good {
        true => format!("All {of} runs were completed."),
        false => {
            let others = cases.iter().filter(|case| !completed(case));
            let others = others.map(|case| {
                format!(
                    "{} on {}: {}",
                    case.title(),
                    case.plant_title(),
                    case.outcome()
                )
            });
            let others: Vec<String> = others.collect();
            format!("{done} of {of} runs were completed; {}.", others.join("; "))
        }
    };
    Verdict { good, text }
}

/// `words` with a capital first letter.
fn capital(words: &str) -> String {
    let mut letters = words.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// A case as its page can be looked into.
fn explored(case: &Case) -> Explored {
    let (plan, run) = (case.plan, case.run);
    let step = 1.0 / f64::from(plan.tick_rate_hz);
    let measured = |panel: Panel, value: &dyn Fn(&LogRow) -> f64| {
        let points = run.rows.iter().map(|row| [row.t, value(row)]);
        panel.with("simulated", "0", step, points)
    };
    let planned = |panel: Panel, value: &dyn Fn(&crate::planner::plan::PlanPoint) -> f64| {
        let points = plan.points.iter().map(|point| [point.t, value(point)]);
        panel.with("planned", "planned", step, points)
    };
    let mut panels = vec![];
    if presses(plan) {
        let size = plan.task.normal_force.largest().abs().max(0.02);
        let panel = Panel::new("contact force", "N", 2e-4 * size, [-5.0 * size, 6.0 * size]);
        let reference = run.rows.iter().map(|row| [row.t, row.force_reference]);
        let panel = panel.with("planned", "planned", step, reference);
        panels.push(measured(panel, &|row| row.reading.force));
    }
    let reach = plan.model.arm.link1_length_m + plan.model.arm.link2_length_m;
    let panel = Panel::new("tip error", "mm", 1e-4, [0.0, 2e3 * reach]);
    panels.push(measured(panel, &|row| 1e3 * row.tip_error()));
    for (joint, title) in ["torque 1", "torque 2"].into_iter().enumerate() {
        let limit = 5.0 * plan.peaks.torque[joint].max(0.02);
        let panel = Panel::new(title, "N m", 1e-3, [-limit, limit]);
        let panel = planned(panel, &|point| point.torque[joint]);
        panels.push(measured(panel, &|row| row.torque[joint]));
    }
    let panel = Panel::new("root slope", "rad", 1e-4, [-1.6, 1.6]);
    let panel = planned(panel, &|point| point.root_slope);
    panels.push(measured(panel, &|row| row.reading.root_slope));
    Explored {
        name: format!("{}, {}", case.title(), case.plant_title()),
        motion: Some(Motion::of_run(plan, run)),
        panels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(title: &str, cases: &[Case], notes: &[(String, String)]) -> String {
        let content = RunsPage {
            title,
            cases,
            shown: 0,
            notes,
            provenance: notes,
        };
        let explored: Vec<Explored> = cases.iter().map(explored).collect();
        let values = values(&content).unwrap();
        crate::report::page::render("report.html", values, Some((&explored, 0))).unwrap()
    }

    use crate::report::testing::short_run;

    /// The text between two marks.
    fn between<'a>(text: &'a str, start: &str, end: &str) -> &'a str {
        let from = text.find(start).unwrap() + start.len();
        &text[from..from + text[from..].find(end).unwrap()]
    }

    #[test]
    fn the_page_refers_to_nothing_outside() {
        let (plan, run) = short_run();
        let case = Case {
            case: "proposed",
            plant: "nominal",
            plan: &plan,
            run: &run,
        };
        let notes = [("Plan time".to_owned(), "0.4 s".to_owned())];
        let page = page("Report", &[case], &notes);
        // The charts' licence names where they come from; nothing is loaded from there.
        let page = page.replacen("https://github.com/leeoniya/uPlot", "", 1);
        assert!(page.contains("Copyright (c) 2022 Leon Sorokin"));
        let own = page.replace("href=\"#", "");
        for outside in [
            "http:", "https:", "src=", "href=", "url(", "@import", "<link", "fetch(", "import(",
        ] {
            assert!(!own.contains(outside), "the page contains {outside}");
        }
        // Without scripts: table, notes and figures stand in the page itself.
        let still = page.split("<script").next().unwrap();
        assert_eq!(still.matches("<figure ").count(), 3);
        assert_eq!(still.matches("<svg ").count(), 3);
        assert!(still.contains(">Completed: contact force off by "));
        assert!(still.contains(r##"<a href="#case=1">proposed</a>"##));
        assert!(still.contains(">completed</td>"));
        assert!(still.contains(r#"<th scope="row">Plan time</th><td>0.4 s</td>"#));
    }

    #[test]
    fn hostile_text_stays_text() {
        let (plan, run) = short_run();
        let hostile = "</title></script><script>alert(1)</script><!--\u{2028}\"'&";
        let case = Case {
            case: hostile,
            plant: hostile,
            plan: &plan,
            run: &run,
        };
        let notes = [(hostile.to_owned(), hostile.to_owned())];
        let page = page(hostile, &[case], &notes);
        assert!(!page.contains("alert(1)</script>") && !page.contains("<script>alert"));
        assert!(page.contains("&lt;script&gt;alert(1)"));
        assert!(!page.contains("<!--"));
        // The data, the charts and the page's own script, and no others.
        assert_eq!(page.matches("<script").count(), 3);
        assert_eq!(page.matches("</script").count(), 3);
        let data = between(
            &page,
            r#"<script id="data" type="application/json">"#,
            "</script>",
        );
        let data: serde_json::Value = serde_json::from_str(data).unwrap();
        assert_eq!(data["cases"][0]["name"], format!("{hostile}, {hostile}"));
    }

    #[test]
    fn a_verdict_names_what_was_not_completed() {
        let (plan, run) = short_run();
        let mut off = run.clone();
        off.summary.outcome = Outcome::TipOffPath;
        let case = |plant, run| Case {
            case: "a_b",
            plant,
            plan: &plan,
            run,
        };
        let good = verdict(&[case("p", &run), case("q", &run)]);
        assert_eq!(
            (good.good, &good.text[..]),
            (true, "All 2 runs were completed.")
        );
        let bad = verdict(&[case("p", &run), case("q_x", &off)]);
        let text = "1 of 2 runs were completed; a b on q x: tip off path.";
        assert_eq!((bad.good, &bad.text[..]), (false, text));
    }

    #[test]
    fn runs_without_or_with_undefined_samples_make_a_page() {
        let (plan, run) = short_run();
        let mut undefined = run.clone();
        for row in &mut undefined.rows {
            row.reading.force = f64::NAN;
        }
        let mut empty = run.clone();
        empty.rows.clear();
        empty.shapes.clear();
        let mut mismatched = run.clone();
        mismatched.elements = 5;
        for run in [&undefined, &empty, &mismatched] {
            let case = Case {
                case: "c",
                plant: "p",
                plan: &plan,
                run,
            };
            assert!(page("t", &[case], &[]).contains("</html>"));
        }
        let nothing = RunsPage {
            title: "t",
            cases: &[],
            shown: 0,
            notes: &[],
            provenance: &[],
        };
        let path = Path::new("report.html");
        assert!(matches!(
            write_html(path, &nothing),
            Err(ReportError::NoCases)
        ));
    }

    #[test]
    fn a_page_that_cannot_be_written_is_named() {
        let (plan, run) = short_run();
        let case = Case {
            case: "c",
            plant: "p",
            plan: &plan,
            run: &run,
        };
        let folder = std::env::temp_dir();
        let content = RunsPage {
            title: "t",
            cases: &[case],
            shown: 3,
            notes: &[],
            provenance: &[],
        };
        let error = write_html(&folder, &content).unwrap_err();
        let text = error.to_string();
        assert!(text.contains(&*folder.to_string_lossy()), "{text}");
    }
}

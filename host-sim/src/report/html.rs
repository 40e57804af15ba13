//! The report as one HTML page that needs nothing but itself: no network, and without
//! scripts still the table and the figures.

use super::figures::gains::{self, Gains};
use super::figures::{POINTS_MAX, decimate, figures, force_axis, number};
use super::{Case, ReportError, page};
use crate::analysis::stability::path::Summary;
use crate::model::arm_model::deflection_matrix;
use crate::simulation::closed_loop::{Run, SHAPE_STRIDE};
use minijinja::{Value, context};
use nalgebra::DVector;
use serde::Serialize;
use std::path::Path;

/// Most frames of a case in the player.
const FRAMES_MAX: usize = 1000;

/// Intervals in which the player draws link 2.
const INTERVALS: usize = 32;

/// Deflections in the page are integers in this unit, m: a fiftieth of a pixel.
const DEFLECTION_UNIT_M: f64 = 1e-5;

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

/// What the player knows of a case. Lengths in m, angles in rad, forces in N.
#[derive(Serialize)]
struct Motion {
    case: String,
    plant: String,
    lengths: [f64; 2],
    normal: [f64; 2],
    path: [[f64; 2]; 2],
    /// The largest planned force.
    reference: f64,
    /// The planned force over time, `[t, f]`.
    planned: Vec<[f64; 2]>,
    /// First and last time of the plan, s.
    times: [f64; 2],
    /// Times of the frames, s.
    t: Vec<f64>,
    angle1: Vec<f64>,
    angle2: Vec<f64>,
    force: Vec<f64>,
    /// Tip references, `x1, x2` a frame.
    target: Vec<f64>,
    unit: f64,
    intervals: usize,
    /// Deflections at the inner points of link 2, `intervals - 1` a frame, in `unit`.
    deflection: Vec<i64>,
    /// The contact force over time in pieces of `t, f, t, f, ...`.
    curve: Vec<Vec<f64>>,
    /// Forces that the plot shows.
    range: [f64; 2],
    /// Whether the force goes beyond them.
    cut: bool,
}

/// `value` with so many decimals; JSON then has no more digits.
fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    let rounded = (value * scale).round() / scale;
    if rounded.is_finite() { rounded } else { value }
}

/// Which of a run's shapes the player shows.
fn frames(run: &Run) -> impl Iterator<Item = usize> {
    let rows = run.rows.len().div_ceil(SHAPE_STRIDE.max(1));
    let all = run.shapes.len().min(rows);
    (0..all).step_by(all.div_ceil(FRAMES_MAX).max(1))
}

impl Motion {
    fn new(case: &Case) -> Self {
        let (plan, run) = (case.plan, case.run);
        let arm = &plan.model.arm;
        let shape = deflection_matrix(arm, run.elements, INTERVALS);
        let mut motion = Self {
            case: case.title(),
            plant: case.plant_title(),
            lengths: [arm.link1_length_m, arm.link2_length_m],
            normal: plan.surface.normal,
            path: [plan.task.path.from, plan.task.path.to],
            reference: plan.task.normal_force.largest(),
            planned: { case.planned_force().into_iter() }
                .map(|point| point.map(|x| rounded(x, 4)))
                .collect(),
            times: case.times(),
            t: vec![],
            angle1: vec![],
            angle2: vec![],
            force: vec![],
            target: vec![],
            unit: DEFLECTION_UNIT_M,
            intervals: INTERVALS,
            deflection: vec![],
            curve: vec![],
            range: [0.0; 2],
            cut: false,
        };
        for frame in frames(run) {
            let row = &run.rows[frame * SHAPE_STRIDE];
            let seen = row.reading;
            let numbers = [row.t, seen.angle[0], seen.angle[1], seen.force];
            if !numbers.iter().all(|x| x.is_finite()) {
                continue;
            }
            motion.t.push(rounded(row.t, 5));
            motion.angle1.push(rounded(seen.angle[0], 5));
            motion.angle2.push(rounded(seen.angle[1], 5));
            motion.force.push(rounded(seen.force, 4));
            motion
                .target
                .extend(row.tip_reference.map(|x| rounded(x, 5)));
            let nodal = &run.shapes[frame];
            let bent = shape
                .as_ref()
                .filter(|shape| shape.ncols() == nodal.len())
                .map(|shape| shape * DVector::from_column_slice(nodal));
            // A conversion to integers makes zero of what is not a number.
            motion.deflection.extend((1..INTERVALS).map(|i| {
                bent.as_ref()
                    .map_or(0, |w| (w[i] / DEFLECTION_UNIT_M).round() as i64)
            }));
        }
        let force: Vec<[f64; 2]> = run.rows.iter().map(|r| [r.t, r.reading.force]).collect();
        let axis = force_axis(force.iter().map(|p| p[1]), motion.reference, 4);
        motion.range = axis.range;
        motion.cut = axis.cut.is_some();
        motion.curve = decimate(&force, POINTS_MAX)
            .iter()
            .map(|piece| {
                let point = |p: &[f64; 2]| [rounded(p[0], 4), rounded(p[1], 4)];
                piece.iter().flat_map(point).collect()
            })
            .collect();
        motion
    }
}

/// JSON that can stand in a script element: nothing in it can close the element or open
/// a comment.
fn script_json<T: Serialize>(value: &T) -> Result<String, serde_json::Error> {
    let json = serde_json::to_string(value)?;
    let mut safe = String::with_capacity(json.len());
    for c in json.chars() {
        match c {
            '<' | '>' | '&' | '\u{2028}' | '\u{2029}' => {
                safe.push_str(&format!("\\u{:04x}", c as u32));
            }
            c => safe.push(c),
        }
    }
    Ok(safe)
}

/// Writes the report of `cases` to `path`: one page with a table of results, a player of
/// the motions, all figures of [`write_figures`](super::write_figures) and the `notes`,
/// pairs of a name and a fact. All text is escaped.
///
/// The page's fragment chooses what the player shows: `#case=3&t=1.2` is the third case
/// at 1.2 s.
///
/// # Errors
/// [`ReportError`].
pub fn write_html(
    path: &Path,
    title: &str,
    cases: &[Case],
    notes: &[(String, String)],
) -> Result<(), ReportError> {
    page::write(path, "report.html", &values(title, cases, notes, path)?)
}

/// What the page's template takes; `path` is where it goes.
fn values(
    title: &str,
    cases: &[Case],
    notes: &[(String, String)],
    path: &Path,
) -> Result<Value, ReportError> {
    let rows: Vec<Row> = cases
        .iter()
        .map(|case| {
            let summary = &case.run.summary;
            Row {
                case: case.title(),
                plant: case.plant_title(),
                force_rms: number(summary.force_error_rms),
                force_max: number(summary.force_error_max),
                tip_rms: number(1e3 * summary.tip_error_rms),
                tip_max: number(1e3 * summary.tip_error_max),
                outcome: summary.outcome.name().replace('_', " "),
                good: summary.outcome == crate::simulation::closed_loop::Outcome::Completed,
            }
        })
        .collect();
    let figures = page::embedded(figures(cases)?);
    let motions: Vec<Motion> = cases.iter().map(Motion::new).collect();
    let data = script_json(&motions).map_err(|error| ReportError::Page {
        path: path.to_path_buf(),
        reason: error.to_string(),
    })?;
    Ok(context! {
        title,
        rows,
        notes,
        figures,
        data => Value::from_safe_string(data),
    })
}

/// What the page on gains shows.
#[derive(Clone, Copy, Debug)]
pub struct GainsPage<'a> {
    /// The page's title.
    pub title: &'a str,
    /// What to warn of.
    pub warnings: &'a [String],
    /// The plants examined, the most important first.
    pub plants: &'a [&'a Summary],
    /// The figures' data.
    pub gains: Gains<'a>,
    /// Names and facts.
    pub notes: &'a [(String, String)],
}

/// Writes the page on gains to `dir`/report.html and its figures beside it as SVG files:
/// `gains_loci.svg`, `gains_map.svg`, `gains_margins.svg`. All text is escaped, and the
/// page needs nothing but itself.
///
/// # Errors
/// [`ReportError`].
pub fn write_gains(dir: &Path, content: &GainsPage<'_>) -> Result<(), ReportError> {
    let figures = gains::figures(&content.gains)?;
    page::write_svgs(dir, &figures)?;
    let rows: Vec<Value> = content
        .plants
        .iter()
        .map(|plant| {
            context! {
                name => plant.name,
                stable => plant.stable,
                radius => format!("{:.6}", plant.spectral_radius_max),
                worst_t => format!("{:.3}", plant.worst_t_s),
                mode => plant.worst_mode,
                damping => format!("{:.3}", plant.contact_damping_min),
                gain => format!("{:.1}", plant.gain_margin_db),
                delay => format!("{:.2}", plant.delay_margin_ticks),
            }
        })
        .collect();
    let values = context! {
        title => content.title,
        warnings => content.warnings,
        rows,
        figures => page::embedded(figures),
        notes => content.notes,
    };
    page::write(&dir.join("report.html"), "gains.html", &values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(title: &str, cases: &[Case], notes: &[(String, String)]) -> String {
        let values = values(title, cases, notes, Path::new("report.html")).unwrap();
        crate::report::page::render("report.html", &values).unwrap()
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
        for outside in [
            "http:", "https:", "src=", "href=", "url(", "@import", "<link", "fetch(", "import(",
        ] {
            assert!(!page.contains(outside), "the page contains {outside}");
        }
        // Without scripts: table, notes and figures stand in the page itself.
        let still = page.split("<script").next().unwrap();
        assert_eq!(still.matches("<figure ").count(), 3);
        assert_eq!(still.matches("<svg ").count(), 3);
        assert!(still.contains("<td>proposed</td>"));
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
        // The template's two scripts and no others.
        assert_eq!(page.matches("<script").count(), 2);
        assert_eq!(page.matches("</script").count(), 2);
        let data = between(
            &page,
            r#"<script id="data" type="application/json">"#,
            "</script>",
        );
        let data: serde_json::Value = serde_json::from_str(data).unwrap();
        assert_eq!(data[0]["case"], hostile);
    }

    #[test]
    fn the_players_data_are_the_run() {
        let (plan, run) = short_run();
        let case = Case {
            case: "c",
            plant: "p",
            plan: &plan,
            run: &run,
        };
        let motion = Motion::new(&case);
        assert_eq!(motion.t.len(), run.shapes.len());
        assert_eq!(motion.deflection.len(), motion.t.len() * (INTERVALS - 1));
        let last = motion.t.len() - 1;
        let row = &run.rows[last * SHAPE_STRIDE];
        assert!((motion.t[last] - row.t).abs() < 1e-5);
        assert!((motion.force[last] - row.reading.force).abs() < 1e-4);
        // In three elements the node at a third of the link has number 1 in the shape; an
        // intermediate point of the outline lies near it.
        let node = run.shapes[last][1] / DEFLECTION_UNIT_M;
        let at = (INTERVALS - 1) * last + INTERVALS / 3 - 1;
        let (low, high) = (
            motion.deflection[at] as f64,
            motion.deflection[at + 1] as f64,
        );
        assert!(
            low.min(high) - 1.0 <= node && node <= low.max(high) + 1.0,
            "{low} {node} {high}"
        );
        assert!(node.abs() > 100.0, "the link is straight");
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
        assert!(matches!(
            values("t", &[], &[], Path::new("report.html")),
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
        let error = write_html(&folder, "t", &[case], &[]).unwrap_err();
        let text = error.to_string();
        assert!(text.contains(&*folder.to_string_lossy()), "{text}");
    }
}

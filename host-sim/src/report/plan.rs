//! The page of a plan: the arm as it is planned to move, with torques, powers and bending.

use super::figures::plan_figures;
use super::motion::{Motion, presses};
use super::page::{Explored, Verdict};
use super::series::Panel;
use super::{ReportError, page};
use crate::planner::plan::{Plan, PlanPoint};
use minijinja::context;
use std::path::Path;

/// What the page of a plan shows.
#[derive(Clone, Copy, Debug)]
pub struct PlanPage<'a> {
    /// The page's title.
    pub title: &'a str,
    /// What to know of it before it is used.
    pub verdict: &'a Verdict,
    /// What to warn of.
    pub warnings: &'a [String],
    /// The plan.
    pub plan: &'a Plan,
    /// Names and facts.
    pub notes: &'a [(String, String)],
    /// What the plan was made from: names and facts.
    pub provenance: &'a [(String, String)],
}

/// Writes the page of a plan to `dir`/report.html and `stick_figure.svg` beside it. All text is
/// escaped, and the page needs nothing but itself.
///
/// # Errors
/// [`ReportError`].
pub fn write_plan(dir: &Path, content: &PlanPage<'_>) -> Result<(), ReportError> {
    let figures = plan_figures(content.plan)?;
    page::write_svgs(dir, &figures)?;
    let values = context! {
        title => content.title,
        verdict => content.verdict,
        warnings => content.warnings,
        stills => page::embedded(figures),
        notes => content.notes,
        provenance => content.provenance,
    };
    let explored = [explored(content.plan)];
    page::write(
        &dir.join("report.html"),
        "plan.html",
        values,
        Some((&explored, 0)),
    )
}

fn explored(plan: &Plan) -> Explored {
    let step = 1.0 / f64::from(plan.tick_rate_hz);
    let all = [f64::NEG_INFINITY, f64::INFINITY];
    let panel = |title, unit, span: f64| Panel::new(title, unit, span, all);
    let curve = |panel: Panel, label: &str, style, value: &dyn Fn(&PlanPoint) -> f64| {
        let points = plan.points.iter().map(|point| [point.t, value(point)]);
        panel.with(label, style, step, points)
    };
    let mut panels = vec![];
    for (joint, title) in ["torque 1", "torque 2"].into_iter().enumerate() {
        let panel = panel(title, "N m", 1e-3);
        panels.push(curve(panel, "planned", "0", &|p| p.torque[joint]));
    }
    let powers = curve(panel("power", "W", 1e-3), "joint 1", "0", &|p| p.power()[0]);
    panels.push(curve(powers, "joint 2", "1", &|p| p.power()[1]));
    let rates = panel("joint rates", "rad/s", 1e-3);
    let rates = curve(rates, "joint 1", "0", &|p| p.joint.rate[0]);
    panels.push(curve(rates, "joint 2", "1", &|p| p.joint.rate[1]));
    let slope = panel("root slope", "rad", 1e-4);
    panels.push(curve(slope, "planned", "0", &|p| p.root_slope));
    if presses(plan) {
        let force = panel("contact force", "N", 1e-3);
        panels.push(curve(force, "planned", "0", &|p| p.force.normal));
    }
    Explored {
        name: "plan".into(),
        motion: Some(Motion::of_plan(plan)),
        panels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::testing::short_run;

    #[test]
    fn a_plan_has_a_page_and_a_figure() {
        let (plan, _) = short_run();
        let folder = tempfile::tempdir().unwrap();
        let fact = [("planned <torque>".to_string(), "up to 3 N m".to_string())];
        let content = PlanPage {
            title: "Plan",
            verdict: &Verdict {
                good: true,
                text: "It can be driven.".into(),
            },
            warnings: &["a warning".to_string()],
            plan: &plan,
            notes: &fact,
            provenance: &fact,
        };
        write_plan(folder.path(), &content).unwrap();
        let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
        for text in [
            "It can be driven.",
            "a warning",
            "planned &lt;torque&gt;",
            "\"torque 2\"",
        ] {
            assert!(page.contains(text), "no {text}");
        }
        assert!(folder.path().join("stick_figure.svg").is_file());
    }
}

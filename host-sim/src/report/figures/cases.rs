//! Time histories of each case, and the contact forces of the cases over each other.

use super::axis::Axis;
use super::plot::{
    BLUE, Curve, Figure, GREEN, INK, LEFT, PALETTE, Panel, TIME, TITLE, draw_panels, panels_height,
    render, shortened, text, units,
};
use crate::report::{Case, ReportError};
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Name of a case's figure.
fn case_file_name(case: &Case) -> String {
    format!("{}_{}", file_name(case.case), file_name(case.plant))
}

/// `name` as part of a file name.
fn file_name(name: &str) -> String {
    name.chars()
        .map(|c| match c {
            'a'..='z' | '0'..='9' | '.' | '-' => c,
            'A'..='Z' => c.to_ascii_lowercase(),
            _ => '_',
        })
        .collect()
}

/// Times of the plan in which the tip rests.
fn resting(case: &Case) -> Vec<[f64; 2]> {
    let [start, end] = case.times();
    let duration = case.plan.task.path.duration;
    [[start, 0.0], [duration, end]]
        .into_iter()
        .filter(|[from, to]| to - from > 1e-9)
        .collect()
}

/// Axis for contact forces: it spans at least a twentieth of the reference, and five
/// times the reference to either side at most.
pub(super) fn force_axis(values: impl Iterator<Item = f64>, reference: f64, ticks: usize) -> Axis {
    let size = reference.abs().max(0.02);
    let limits = [reference - 5.0 * size, reference + 5.0 * size];
    Axis::new(
        values.chain(std::iter::once(reference)),
        0.05 * size,
        limits,
        ticks,
    )
}

/// Panels of a case's time histories.
fn history_panels(case: &Case) -> [Panel; 4] {
    const TICKS: usize = 5;
    let rows = &case.run.rows;
    let plan = case.plan;
    let reference = plan.task.normal_force.largest();
    let force = vec![
        Curve::reference("reference", case.planned_force()),
        Curve::simulated("contact force", BLUE, rows, |r| r.reading.force),
    ];
    let force_axis = force_axis(force[1].values(), reference, TICKS);

    let error = Curve::simulated("tip error", BLUE, rows, |r| 1e3 * r.tip_error());
    let reach = plan.model.arm.link1_length_m + plan.model.arm.link2_length_m;
    let error_axis = Axis::new(error.values(), 0.01, [0.0, 2e3 * reach], TICKS);

    let torques = [0, 1].map(|joint| {
        let colour = [BLUE, GREEN][joint];
        let label = ["joint 1 (left axis)", "joint 2 (right axis)"][joint];
        let curve = Curve::simulated(label, colour, rows, |r| r.torque[joint]);
        let limit = 5.0 * plan.peaks.torque[joint].max(0.02);
        let axis = Axis::new(curve.values(), 0.01, [-limit, limit], TICKS);
        (axis, format!("torque {} (N m)", joint + 1), vec![curve])
    });
    let [left_torque, right_torque] = torques;

    let planned = plan.points.iter().map(|p| [p.t, p.root_slope]).collect();
    let slope = vec![
        Curve::reference("planned", planned),
        Curve::simulated("root slope", BLUE, rows, |r| r.reading.root_slope),
    ];
    let slopes = slope.iter().flat_map(Curve::values);
    let slope_axis = Axis::new(slopes, 1e-3, [-1.6, 1.6], TICKS);

    let panel = |left, right| Panel {
        heading: String::new(),
        left,
        right,
        shaded: resting(case),
    };
    [
        panel((force_axis, "force (N)".into(), force), None),
        panel((error_axis, "tip error (mm)".into(), vec![error]), None),
        panel(left_torque, Some(right_torque)),
        panel((slope_axis, "root slope (rad)".into(), slope), None),
    ]
}

/// Time histories of a case.
pub(super) fn histories(case: &Case) -> Result<Figure, ReportError> {
    let panels = history_panels(case);
    let (title, plant) = (case.title(), case.plant_title());
    let outcome = case.run.summary.outcome.name().replace('_', " ");
    let name = case_file_name(case);
    let heading = format!(
        "{}, plant {}: {outcome}",
        shortened(&title, 38),
        shortened(&plant, 22)
    );
    let height = TITLE + panels_height(&panels);
    let svg = render(&name, height, |area| {
        let (head, body) = area.split_vertically(units(TITLE));
        head.draw_text(
            &heading,
            &text(14.0, &INK).pos(Pos::new(HPos::Left, VPos::Center)),
            (units(LEFT), units(19.0)),
        )?;
        draw_panels(&body, &panels, (case.times(), TIME), true)
    })?;
    let shaded = if resting(case).is_empty() {
        ""
    } else {
        " Shaded: the tip rests while the link bends."
    };
    Ok(Figure {
        name,
        caption: format!(
            "Case “{title}” on the plant “{plant}”: contact force, distance of the tip from its reference, commanded torques, and slope of link 2 at its root.{shaded}"
        ),
        svg,
    })
}

/// Ratio of the force errors above which two cases do not share a panel.
const SQUASHED: f64 = 4.0;

/// Root mean square of a case's force error, N, for the choice of panels: at least a
/// hundredth of the reference, as less cannot be seen at any scale used.
fn force_error(case: &Case) -> f64 {
    let rms = case.run.summary.force_error_rms;
    let visible = 0.01 * case.plan.task.normal_force.largest();
    if rms > visible { rms } else { visible }
}

/// Contact forces of the cases over each other.
pub(super) fn contact_forces(cases: &[Case]) -> Result<Figure, ReportError> {
    let times = cases[0].times();
    let alike = |case: &&Case| {
        let other = case.times();
        (0..2).all(|i| (other[i] - times[i]).abs() < 1e-6)
    };
    let shown: Vec<&Case> = cases.iter().filter(alike).collect();
    let mut names: Vec<&str> = vec![];
    let mut plants: Vec<&str> = vec![];
    for case in &shown {
        if !names.contains(&case.case) {
            names.push(case.case);
        }
        if !plants.contains(&case.plant) {
            plants.push(case.plant);
        }
    }
    let mut panels = vec![];
    for plant in plants {
        let groups = grouped(shown.iter().copied().filter(|c| c.plant == plant).collect());
        for mut group in groups {
            group.sort_by_key(|c| names.iter().position(|n| *n == c.case));
            let reference = group[0].plan.task.normal_force.largest();
            let mut curves = vec![Curve::reference("reference", group[0].planned_force())];
            for (index, case) in group.iter().enumerate() {
                let colour = names.iter().position(|n| *n == case.case).unwrap_or(0);
                let mut curve = Curve::simulated(
                    shortened(&case.title(), 48),
                    PALETTE[colour % PALETTE.len()],
                    &case.run.rows,
                    |r| r.reading.force,
                );
                // Equal curves stay visible below each other.
                curve.width = 1.3 + 1.0 * (group.len() - 1 - index) as f64;
                curves.push(curve);
            }
            let axis = force_axis(curves.iter().flat_map(Curve::values), reference, 6);
            panels.push(Panel {
                heading: shortened(&group[0].plant_title(), 22) + ":",
                left: (axis, "contact force (N)".into(), curves),
                right: None,
                shaded: resting(group[0]),
            });
        }
    }
    let name = "contact_force_cases";
    let svg = render(name, panels_height(&panels), |area| {
        draw_panels(area, &panels, (times, TIME), false)
    })?;
    Ok(Figure {
        name: name.into(),
        caption: "Contact force of the cases on each plant. The scales of the panels differ; where curves agree, the wider one shows on both sides of the other."
            .into(),
        svg,
    })
}

/// Whether `case` can share a panel with the `group` of better ones.
fn joins(group: &[&Case], case: &Case) -> bool {
    let largest = group.iter().map(|c| force_error(c)).fold(0.0, f64::max);
    force_error(case) <= SQUASHED * largest
}

/// Cases in groups that can share a panel, those with the smallest force errors first.
fn grouped<'c, 'd>(mut members: Vec<&'c Case<'d>>) -> Vec<Vec<&'c Case<'d>>> {
    members.sort_by(|a, b| force_error(a).total_cmp(&force_error(b)));
    let mut groups: Vec<Vec<&Case>> = vec![];
    for case in members {
        // A case joins the smaller ones unless it would squash all of them.
        match groups.last_mut() {
            Some(group) if joins(group, case) => group.push(case),
            _ => groups.push(vec![case]),
        }
    }
    groups
}

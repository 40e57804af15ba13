//! The arm's planned configurations along its path, as a stick figure.

use super::axis::Axis;
use super::plot::{
    Area, BLUE, Drawn, Figure, INK, LEFT, LINK1, RIGHT, SOFT, TEXT, TIME_LABELS, WIDTH, chart,
    draw_axes, line, render, text, text_width, units,
};
use crate::model::arm_model::deflection_matrix;
use crate::planner::plan::{Plan, PlanPoint};
use crate::planner::task::Travel;
use crate::report::ReportError;
use nalgebra::{DMatrix, DVector};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// A point of the figure, m along a1 and a2.
type Point = (f64, f64);

/// Postures that the stick figure shows.
pub(super) const POSTURES: usize = 11;

/// Intervals in which link 2 is drawn.
const OUTLINE_INTERVALS: usize = 40;

/// Link 2 of the plan at a tick, as points from joint 2 to the tip, m.
fn planned_outline(plan: &Plan, shape: &DMatrix<f64>, tick: usize) -> Vec<Point> {
    let (arm, dof) = (&plan.model.arm, plan.model.dof());
    let [angle1, angle2] = plan.points[tick].joint.angle;
    let nodal = plan.deflection.get(dof * tick..dof * (tick + 1));
    let deflection = nodal
        .filter(|_| shape.ncols() == dof)
        .map(|w| shape * DVector::from_column_slice(w));
    let intervals = shape.nrows().max(2) - 1;
    (0..=intervals)
        .map(|i| {
            let rho = arm.link2_length_m * i as f64 / intervals as f64;
            let w = deflection.as_ref().map_or(0.0, |w| w[i]);
            (
                arm.link1_length_m * angle1.cos() + rho * angle2.cos() - w * angle2.sin(),
                arm.link1_length_m * angle1.sin() + rho * angle2.sin() + w * angle2.cos(),
            )
        })
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .collect()
}

/// Planned configurations at equal distances of the tip along the path of a case, or of the joints
/// along their ways.
fn configurations(plan: &Plan) -> Vec<Vec<Point>> {
    let path = &plan.task.path;
    let along = along(plan);
    let travelled = |point: &PlanPoint| match plan.task.travel {
        Travel::Line => {
            let tip = point.tip.position;
            ((tip[0] - path.from[0]) * along[0] + (tip[1] - path.from[1]) * along[1])
                / path.length()
        }
        Travel::Joints(_) => path.profile.at(point.t / path.duration)[0],
    };
    let ticks = (0..POSTURES).filter_map(|k| {
        let progress = k as f64 / (POSTURES - 1) as f64 - 1e-9;
        let from = (plan.pre_ticks as usize).min(plan.points.len());
        let reached = |p: &PlanPoint| travelled(p) >= progress;
        plan.points[from..]
            .iter()
            .position(reached)
            .map(|i| i + from)
    });
    let shape = deflection_matrix(&plan.model.arm, plan.model.elements, OUTLINE_INTERVALS)
        .unwrap_or_else(|| DMatrix::zeros(OUTLINE_INTERVALS + 1, plan.model.dof()));
    ticks
        .map(|tick| planned_outline(plan, &shape, tick))
        .filter(|points| !points.is_empty())
        .collect()
}

/// Unit vector from the path's start to its end.
fn along(plan: &Plan) -> [f64; 2] {
    let path = &plan.task.path;
    [0, 1].map(|i| (path.to[i] - path.from[i]) / path.length())
}

/// Both links' lengths, m.
fn reach(plan: &Plan) -> f64 {
    plan.model.arm.link1_length_m + plan.model.arm.link2_length_m
}

/// The surface, somewhat longer than the path.
fn surface(plan: &Plan) -> [Point; 2] {
    let (path, along) = (&plan.task.path, along(plan));
    let beyond = BEYOND * path.length();
    [(path.from, -beyond), (path.to, beyond)]
        .map(|(end, by)| (end[0] + by * along[0], end[1] + by * along[1]))
}

/// How much longer than the path the surface is drawn at each end.
const BEYOND: f64 = 0.08;

/// Lines of the hatching behind the surface, in a figure of `scale` pixels a metre.
fn hatching(plan: &Plan, surface: &[Point; 2], scale: f64) -> impl Iterator<Item = Vec<Point>> {
    let (along, normal) = (along(plan), plan.surface.normal);
    let depth = 0.024 * reach(plan);
    let length = plan.task.path.length();
    let from = surface[0];
    (0..)
        .map(move |i| 9.0 * f64::from(i) / scale)
        .take_while(move |at| *at <= length + 2.0 * (BEYOND * length))
        .map(move |at| {
            let foot = (from.0 + at * along[0], from.1 + at * along[1]);
            let end = (
                foot.0 + depth * (normal[0] - 0.7 * along[0]),
                foot.1 + depth * (normal[1] - 0.7 * along[1]),
            );
            vec![foot, end]
        })
}

/// A word in the figure.
struct Label {
    word: &'static str,
    at: Point,
    side: HPos,
    /// Where the word is taken to end.
    end: Point,
}

/// Words at the path's ends and joint 1. They go where the arm does not come from: beyond
/// the surface, or before it.
fn labels(plan: &Plan, configurations: &[Vec<Point>]) -> [Label; 3] {
    let (path, normal) = (&plan.task.path, plan.surface.normal);
    let reach = reach(plan);
    let joint2 = configurations
        .first()
        .map_or((0.0, 0.0), |points| points[0]);
    let beyond_surface =
        (joint2.0 - path.from[0]) * normal[0] + (joint2.1 - path.from[1]) * normal[1] <= 0.0;
    let offset = if beyond_surface { 0.048 } else { -0.028 } * reach;
    // Beside a steep surface, above or below a level one.
    let steep = normal[0].abs() > 0.7;
    let side = match (steep, offset * normal[0] > 0.0) {
        (false, _) => HPos::Center,
        (true, true) => HPos::Left,
        (true, false) => HPos::Right,
    };
    let room = if steep { 0.1 * reach } else { 0.04 * reach };
    let at_end = |word, end: [f64; 2]| {
        let at = (end[0] + offset * normal[0], end[1] + offset * normal[1]);
        let end = (at.0 + room.copysign(offset * normal[0]), at.1);
        Label {
            word,
            at,
            side,
            end,
        }
    };
    let joint1 = (0.0, if joint2.1 > 0.0 { -0.027 } else { 0.027 } * reach);
    [
        at_end("path start", path.from),
        at_end("path end", path.to),
        Label {
            word: "joint 1",
            at: joint1,
            side: HPos::Center,
            end: joint1,
        },
    ]
}

/// Axes of equal scales around `points`, pixels a metre, and the plot's height, px.
fn axes<'p>(points: impl Iterator<Item = &'p Point>, reach: f64) -> ([Axis; 2], f64, f64) {
    const TALLEST: f64 = 640.0;
    let bounds = points.fold(
        [[f64::INFINITY, f64::NEG_INFINITY]; 2],
        |[[x0, x1], [y0, y1]], (x, y)| [[x0.min(*x), x1.max(*x)], [y0.min(*y), y1.max(*y)]],
    );
    let [x, y] = bounds.map(|[low, high]| [low - 0.05 * reach, high + 0.05 * reach]);
    // A tall figure gets empty space at its sides.
    let width = f64::from(WIDTH) - LEFT - RIGHT;
    let scale = (width / (x[1] - x[0])).min(TALLEST / (y[1] - y[0]));
    let spare = 0.5 * (width / scale - (x[1] - x[0]));
    let across = Axis::exact([x[0] - spare, x[1] + spare], 10);
    // Down the page is +a2.
    let down = Axis::exact(y, 7).reversed();
    ([across, down], scale, (y[1] - y[0]) * scale)
}

/// What the colours mean.
fn draw_legend(head: &Area<'_>, pressed: bool) -> Drawn {
    let middle = units(HEAD - 14.0);
    let mut at = LEFT;
    let entries = [
        ("link 1", LINK1, 2.5),
        ("link 2, elastic", BLUE, 2.5),
        ("surface", INK, 2.0),
    ];
    // A move through the air has none.
    let shown = if pressed { 3 } else { 2 };
    let style = text(TEXT, &INK).pos(Pos::new(HPos::Left, VPos::Center));
    for (label, colour, px) in &entries[..shown] {
        head.draw(&PathElement::new(
            vec![(units(at), middle), (units(at + 20.0), middle)],
            line(*colour, *px),
        ))?;
        head.draw_text(label, &style, (units(at + 26.0), middle))?;
        at += 26.0 + text_width(label, TEXT) + 18.0;
    }
    Ok(())
}

/// Height of the legend, px.
const HEAD: f64 = 34.0;

/// The arm's planned configurations along the path of a case, at equal distances of the tip.
pub(super) fn stick_figure(plan: &Plan) -> Result<Figure, ReportError> {
    let name = "stick_figure";
    let joint1 = (0.0, 0.0);
    let configurations = configurations(plan);
    let surface = match plan.task.travel {
        Travel::Line => Some(surface(plan)),
        Travel::Joints(_) => None,
    };
    let pressed = surface.is_some();
    let labels = labels(plan, &configurations);
    let everything = configurations
        .iter()
        .flatten()
        .chain(surface.iter().flatten())
        .chain(labels.iter().map(|label| &label.end))
        .chain([&joint1]);
    let ([across, down], scale, height) = axes(everything, reach(plan));
    let svg = render(name, height + HEAD + TIME_LABELS, |area| {
        let (head, body) = area.split_vertically(units(HEAD));
        draw_legend(&head, surface.is_some())?;
        let mut chart = chart(&body, [&across, &down])?;
        draw_axes(
            &mut chart,
            true,
            ["along a1 (m)", "along a2, downwards (m)"],
        )?;
        if let Some(surface) = &surface {
            let hatching = hatching(plan, surface, scale);
            chart.draw_series(hatching.map(|points| PathElement::new(points, line(SOFT, 0.8))))?;
            chart.draw_series([PathElement::new(surface.to_vec(), line(INK, 2.0))])?;
        }
        for (index, points) in configurations.iter().enumerate() {
            let end = index == 0 || index + 1 == configurations.len();
            let px = if end { 3.0 } else { 1.2 };
            let (joint2, tip) = (points[0], points[points.len() - 1]);
            chart.draw_series([
                PathElement::new(vec![joint1, joint2], line(LINK1, px)),
                PathElement::new(points.clone(), line(BLUE, px)),
            ])?;
            let radius = if end { 4.0 } else { 2.5 };
            chart.draw_series([
                Circle::new(joint2, units(radius), INK.filled()),
                Circle::new(tip, units(radius * 0.8), INK.filled()),
            ])?;
        }
        chart.draw_series([Circle::new(joint1, units(6.0), INK.filled())])?;
        chart.draw_series([Circle::new(joint1, units(3.0), WHITE.filled())])?;
        let plot = chart.plotting_area().strip_coord_spec();
        let corner = plot.get_base_pixel();
        for Label { word, at, side, .. } in &labels {
            let (px, py) = chart.plotting_area().map_coordinate(at);
            let style = text(TEXT, &INK).pos(Pos::new(*side, VPos::Center));
            plot.draw_text(word, &style, (px - corner.0, py - corner.1))?;
        }
        Ok(())
    })?;
    Ok(Figure {
        name: name.into(),
        caption: format!(
            "Planned configurations of the arm at {} equally spaced points of {}, link 2 as bent as it is. Start and end are drawn bold; a2 points down.",
            configurations.len(),
            if pressed {
                "the path"
            } else {
                "the joints\u{2019} ways"
            }
        ),
        svg,
    })
}

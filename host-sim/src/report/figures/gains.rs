//! Figures on the stability of gains: poles along the path, a map over two gains,
//! margins against time.

use super::axis::{Axis, number};
use super::plot::{
    Area, BLUE, Chart, Curve, Drawn, Figure, GREEN, INK, LEFT, ORANGE, PURPLE, Panel, REFERENCE,
    SOFT, TEXT, TIME, TIME_LABELS, VERMILLION, chart, draw_axes, draw_panels, line, panels_height,
    render, text, text_width, units,
};
use crate::analysis::stability::map::{Class, GainId, Map};
use crate::analysis::stability::path::{
    DELAY_MARGIN_MAX_TICKS, FrozenPoint, GAIN_MARGIN_MAX_DB, PathPoint,
};
use crate::report::ReportError;
use nalgebra::Complex;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// What the figures show.
#[derive(Clone, Copy, Debug)]
pub struct Gains<'a> {
    /// The planned arm's loop along the path.
    pub points: &'a [PathPoint],
    /// The plant at the path's first point, for its poles without feedback.
    pub frozen_points: &'a [FrozenPoint],
    /// Stability over two gains.
    pub map: &'a Map,
    /// Times of the path, s, first and last.
    pub times: [f64; 2],
}

/// All figures on gains.
pub(in crate::report) fn figures(gains: &Gains<'_>) -> Result<Vec<Figure>, ReportError> {
    Ok(vec![loci(gains)?, map(gains.map)?, margins(gains)?])
}

/// Colour of a share 0 to 1 of the path: from blue by purple to orange.
fn along(share: f64) -> RGBColor {
    let between = |a: RGBColor, b: RGBColor, share: f64| {
        let mix =
            |a: u8, b: u8| (f64::from(a) + share * (f64::from(b) - f64::from(a))).round() as u8;
        RGBColor(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
    };
    if share < 0.5 {
        between(BLUE, PURPLE, 2.0 * share)
    } else {
        between(PURPLE, ORANGE, 2.0 * share - 1.0)
    }
}

/// A part of the plane of poles.
struct Plane {
    heading: String,
    real: Axis,
    imaginary: Axis,
}

/// Height of a plane's plot, px.
const PLANE: f64 = 300.0;
/// Height of a heading, px.
const HEAD: f64 = 30.0;

/// Poles of the closed loop along the path.
fn loci(gains: &Gains<'_>) -> Result<Figure, ReportError> {
    let contact = gains
        .frozen_points
        .first()
        .map_or(1.0, FrozenPoint::contact_frequency);
    let open = || gains.frozen_points.iter().flat_map(|frozen| &frozen.open);
    let broad = open().map(|p| p.re.abs()).fold(contact, f64::max);
    let fast = open().map(|p| p.im).fold(contact, f64::max);
    let everything = || {
        gains
            .points
            .iter()
            .flat_map(|p| p.verdict.poles.iter().chain(&p.verdict.tangential))
    };
    let near = |limits: [f64; 2], f: &dyn Fn(&Complex<f64>) -> f64, floor: f64| {
        Axis::new(everything().map(f).chain([floor]), 0.1 * contact, limits, 6)
    };
    let planes = [
        Plane {
            heading: "slow poles: tangential mode, force integrator, contact mode".into(),
            real: near([-1.6 * contact, 0.6 * contact], &|p| p.re, 0.2 * contact).without_cut(),
            imaginary: near([0.0, 2.2 * contact], &|p| p.im.max(0.0), 1.2 * contact).without_cut(),
        },
        Plane {
            heading: "the link's modes".into(),
            real: near([-3.0 * broad, broad], &|p| p.re, 0.3 * broad).without_cut(),
            imaginary: near([0.0, 1.5 * fast], &|p| p.im.max(0.0), 1.1 * fast).without_cut(),
        },
    ];
    let height = 26.0 + planes.len() as f64 * (HEAD + PLANE + TIME_LABELS);
    let svg = render("gains_loci", height, |area| {
        let (head, mut rest) = area.split_vertically(units(26.0));
        loci_legend(&head, gains.times)?;
        for plane in &planes {
            let (body, below) = rest.split_vertically(units(HEAD + PLANE + TIME_LABELS));
            rest = below;
            draw_plane(&body, plane, gains)?;
        }
        Ok(())
    })?;
    Ok(Figure {
        name: "gains_loci".into(),
        caption: "Poles of the closed loop along the path, frozen at each point (upper half; the logarithms of the sampled loop's eigenvalues over the period), and without feedback. The tangential pair, the tip's motion along the surface, is not controlled; left of the line is stable."
            .into(),
        svg,
    })
}

fn loci_legend(area: &Area<'_>, times: [f64; 2]) -> Drawn {
    let middle = units(15.0);
    let mut x = LEFT;
    let plain = text(TEXT, &INK).pos(Pos::new(HPos::Left, VPos::Center));
    let entries = [
        (along(0.0), format!("t = {:.2} s", times[0])),
        (along(0.5), format!("{:.2} s", 0.5 * (times[0] + times[1]))),
        (along(1.0), format!("{:.2} s", times[1])),
        (SOFT, "without feedback, at the start".to_string()),
    ];
    for (index, (colour, label)) in entries.iter().enumerate() {
        let at = (units(x + 5.0), middle);
        if index < 3 {
            area.draw(&Circle::new(at, units(3.5), colour.filled()))?;
        } else {
            area.draw(&Cross::new(at, units(4.0), line(*colour, 1.6)))?;
        }
        area.draw_text(label, &plain, (units(x + 14.0), middle))?;
        x += 14.0 + text_width(label, TEXT) + 18.0;
    }
    Ok(())
}

fn draw_plane(area: &Area<'_>, plane: &Plane, gains: &Gains<'_>) -> Drawn {
    let (head, body) = area.split_vertically(units(HEAD));
    let style = text(TEXT, &INK).pos(Pos::new(HPos::Left, VPos::Center));
    head.draw_text(&plane.heading, &style, (units(LEFT), units(HEAD - 11.0)))?;
    let mut chart = chart(&body, [&plane.real, &plane.imaginary])?;
    draw_axes(
        &mut chart,
        true,
        ["real part (1/s)", "imaginary part (rad/s)"],
    )?;
    let inside = |p: &Complex<f64>| {
        let within = |x: f64, axis: &Axis| x >= axis.range[0] && x <= axis.range[1];
        within(p.re, &plane.real) && within(p.im, &plane.imaginary)
    };
    let [low, high] = plane.imaginary.range;
    chart.draw_series([PathElement::new(
        vec![(0.0, low), (0.0, high)],
        line(VERMILLION, 1.2),
    )])?;
    if let Some(frozen) = gains.frozen_points.first() {
        chart.draw_series(
            frozen
                .open
                .iter()
                .filter(|p| inside(p))
                .map(|p| Cross::new((p.re, p.im), units(5.0), line(SOFT, 1.6))),
        )?;
    }
    let last = gains.points.len().max(2) - 1;
    for (i, point) in gains.points.iter().enumerate() {
        let colour = along(i as f64 / last as f64);
        let poles = point.verdict.poles.iter().chain(&point.verdict.tangential);
        chart.draw_series(
            poles
                .filter(|p| inside(p))
                .map(|p| Circle::new((p.re, p.im), units(2.4), colour.filled())),
        )?;
    }
    Ok(())
}

const STABLE: RGBColor = RGBColor(0xB5, 0xDD, 0xCE);
const TIGHT: RGBColor = RGBColor(0xF6, 0xE3, 0xB0);
const UNSTABLE: RGBColor = RGBColor(0xEF, 0xC4, 0xB0);

/// Colour of a cell of the map.
fn colour(class: Class) -> RGBColor {
    match class {
        Class::Stable => STABLE,
        Class::Tight => TIGHT,
        Class::Unstable => UNSTABLE,
    }
}

/// An axis' cells as decimal logarithms: the edges of all of them, and the width of one.
fn cells(values: &[f64]) -> ([f64; 2], f64) {
    let half = match values {
        [a, b, ..] => 0.5 * (b / a).log10(),
        _ => 0.5,
    };
    let [first, last] = [values.first(), values.last()].map(|v| v.map_or(0.0, |v| v.log10()));
    ([first - half, last + half], 2.0 * half)
}

/// What the map's colours mean.
fn map_legend(head: &Area<'_>) -> Drawn {
    let plain = text(TEXT, &INK).pos(Pos::new(HPos::Left, VPos::Center));
    let mut x = LEFT;
    let entries = [
        (STABLE, "stable with 6 dB and one tick to spare"),
        (TIGHT, "stable, with less"),
        (UNSTABLE, "unstable"),
    ];
    for (fill, label) in entries {
        let corners = [(units(x), units(14.0)), (units(x + 14.0), units(28.0))];
        head.draw(&Rectangle::new(corners, fill.filled()))?;
        head.draw_text(label, &plain, (units(x + 20.0), units(21.0)))?;
        x += 20.0 + text_width(label, TEXT) + 18.0;
    }
    head.draw(&Circle::new(
        (units(x + 6.0), units(21.0)),
        units(5.0),
        INK.filled(),
    ))?;
    head.draw_text("the gains", &plain, (units(x + 16.0), units(21.0)))
}

/// Draws the map's cells; neighbours of a class in a row are drawn as one.
fn draw_cells(chart: &mut Chart<'_, '_>, map: &Map, edges: &[([f64; 2], f64); 2]) -> Drawn {
    let across = map.values[0].len().max(1);
    for (row, classes) in map.classes.chunks(across).enumerate() {
        let mut from = 0;
        for to in 1..=classes.len() {
            if to < classes.len() && classes[to] == classes[from] {
                continue;
            }
            let x = [from, to].map(|i| edges[0].0[0] + i as f64 * edges[0].1);
            // A little over the next row, which is drawn later: no hairline between.
            let y = [row as f64, row as f64 + 1.1].map(|i| edges[1].0[0] + i * edges[1].1);
            chart.draw_series([Rectangle::new(
                [(x[0], y[0]), (x[1], y[1])],
                colour(classes[from]).filled(),
            )])?;
            from = to;
        }
    }
    Ok(())
}

/// Stability over two gains.
fn map(map: &Map) -> Result<Figure, ReportError> {
    let edges = [0, 1].map(|axis| cells(&map.values[axis]));
    let axes = [0, 1].map(|axis| Axis::decades(edges[axis].0));
    let height = 40.0 + 380.0 + TIME_LABELS;
    let svg = render("gains_map", height, |area| {
        let (head, body) = area.split_vertically(units(40.0));
        map_legend(&head)?;
        let mut chart = chart(&body, [&axes[0], &axes[1]])?;
        draw_cells(&mut chart, map, &edges)?;
        draw_axes(&mut chart, false, map.gains.map(GainId::key))?;
        // A gain of zero is at the edge of every logarithmic scale.
        let [x, y] = [0, 1].map(|axis| {
            let [low, high] = edges[axis].0;
            map.chosen[axis].max(1e-300).log10().clamp(low, high)
        });
        chart.draw_series([Circle::new((x, y), units(6.0), INK.filled())])?;
        chart.draw_series([Circle::new((x, y), units(2.5), WHITE.filled())])?;
        Ok(())
    })?;
    let [a, b] = map.gains.map(GainId::key);
    Ok(Figure {
        name: "gains_map".into(),
        caption: format!(
            "Stability of the planned arm's loop over {a} and {b}, the worst of {} points of the path, the other gains as given. The gains examined: {a} = {}, {b} = {}.",
            5,
            number(map.chosen[0]),
            number(map.chosen[1])
        ),
        svg,
    })
}

/// Panels of margins and damping against the path's time.
fn margin_panels(gains: &Gains<'_>) -> [Panel; 4] {
    let curve = |label: &str, colour, value: &dyn Fn(&PathPoint) -> f64| Curve {
        label: label.into(),
        colour,
        width: 1.8,
        points: gains.points.iter().map(|p| [p.t, value(p)]).collect(),
    };
    let level = |label: &str, at: f64| Curve {
        label: label.into(),
        colour: REFERENCE,
        width: 2.0,
        points: gains.times.map(|t| [t, at]).to_vec(),
    };
    let panel = |curves: Vec<Curve>, label: &str, span: f64, limits: [f64; 2]| {
        let axis = Axis::new(curves.iter().flat_map(Curve::values), span, limits, 5);
        Panel {
            heading: String::new(),
            left: (axis, label.to_string(), curves),
            right: None,
            shaded: vec![],
        }
    };
    [
        panel(
            vec![
                level("6 dB", 6.0),
                curve("gain margin", BLUE, &|p| p.gain_margin_db),
            ],
            "gain margin (dB)",
            1.0,
            [-GAIN_MARGIN_MAX_DB, GAIN_MARGIN_MAX_DB],
        ),
        panel(
            vec![
                level("1 tick", 1.0),
                curve("delay margin", BLUE, &|p| p.delay_margin_ticks),
            ],
            "delay margin (ticks)",
            0.2,
            [0.0, DELAY_MARGIN_MAX_TICKS],
        ),
        panel(
            vec![
                curve("contact mode", GREEN, &|p| p.verdict.contact_damping),
                level("edge of stability", 0.0),
            ],
            "damping ratio",
            0.02,
            [-1.0, 1.0],
        ),
        panel(
            vec![
                level("edge of stability", 0.0),
                curve("slowest pole but the tangential", BLUE, &|p| {
                    p.verdict.worst.re
                }),
                curve("tangential mode", ORANGE, &|p| {
                    p.verdict.tangential[0].re.max(p.verdict.tangential[1].re)
                }),
            ],
            "real part (1/s)",
            0.5,
            [-200.0, 200.0],
        ),
    ]
}

/// Margins and damping against the path's time.
fn margins(gains: &Gains<'_>) -> Result<Figure, ReportError> {
    let panels = margin_panels(gains);
    let svg = render("gains_margins", panels_height(&panels), |area| {
        draw_panels(area, &panels, (gains.times, TIME), false)
    })?;
    Ok(Figure {
        name: "gains_margins".into(),
        caption: format!(
            "Margins of the planned arm's loop against the path's time: by how much all gains can be raised, how many ticks the torques can act later, the contact mode's damping, and the real part of the slowest pole. Margins are looked for up to {GAIN_MARGIN_MAX_DB} dB and {DELAY_MARGIN_MAX_TICKS} ticks."
        ),
        svg,
    })
}

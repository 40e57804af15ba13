//! The drawing kit: colours, sizes, text, and panels of curves below each other.
//!
//! Colours are those of Okabe and Ito, which colour-blind readers tell apart.

use super::axis::{Axis, clip, decimate, number};
use crate::report::ReportError;
use crate::simulation::closed_loop::LogRow;
use plotters::coord::Shift;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Drawing units a pixel: plotters draws on an integer grid, which would make steps in
/// smooth curves.
const UNIT: u32 = 8;

/// Most points of a plotted curve.
pub(in crate::report) const POINTS_MAX: usize = 1500;

/// Width of a figure, px.
pub(super) const WIDTH: u32 = 800;

pub(super) const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xB2);
pub(super) const VERMILLION: RGBColor = RGBColor(0xD5, 0x5E, 0x00);
pub(super) const GREEN: RGBColor = RGBColor(0x00, 0x9E, 0x73);
pub(super) const PURPLE: RGBColor = RGBColor(0xCC, 0x79, 0xA7);
pub(super) const ORANGE: RGBColor = RGBColor(0xE6, 0x9F, 0x00);
pub(super) const SKY: RGBColor = RGBColor(0x56, 0xB4, 0xE9);
/// Link 1, as on the pages.
pub(super) const LINK1: RGBColor = RGBColor(0x7A, 0x7F, 0x85);
pub(super) const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
pub(super) const SOFT: RGBColor = RGBColor(0x66, 0x66, 0x66);
/// A planned quantity, drawn wide below the simulated one.
pub(super) const REFERENCE: RGBColor = RGBColor(0xB8, 0xB8, 0xB8);
pub(super) const GRID: RGBColor = RGBColor(0xE6, 0xE6, 0xE6);
/// Times in which the tip rests.
const SHADE: RGBColor = RGBColor(0xF2, 0xF2, 0xF2);

/// Colours of curves over each other.
pub(super) const PALETTE: [RGBColor; 7] = [BLUE, VERMILLION, GREEN, INK, ORANGE, PURPLE, SKY];

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(super) type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// A figure.
pub(in crate::report) struct Figure {
    /// Its file's name without the ending.
    pub(in crate::report) name: String,
    /// What it shows.
    pub(in crate::report) caption: String,
    /// The figure as an SVG document.
    pub(in crate::report) svg: String,
}

/// A curve over time.
pub(super) struct Curve {
    pub(super) label: String,
    pub(super) colour: RGBColor,
    /// Width of the line, px.
    pub(super) width: f64,
    pub(super) points: Vec<[f64; 2]>,
}

impl Curve {
    pub(super) fn simulated(
        label: impl Into<String>,
        colour: RGBColor,
        rows: &[LogRow],
        value: impl Fn(&LogRow) -> f64,
    ) -> Self {
        Self {
            label: label.into(),
            colour,
            width: 1.5,
            points: rows.iter().map(|row| [row.t, value(row)]).collect(),
        }
    }

    pub(super) fn reference(label: &str, points: Vec<[f64; 2]>) -> Self {
        Self {
            label: label.into(),
            colour: REFERENCE,
            width: 4.0,
            points,
        }
    }

    pub(super) fn values(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|point| point[1])
    }
}

/// One of the panels that share a time axis.
pub(super) struct Panel {
    /// Said above the panel, before the legend.
    pub(super) heading: String,
    /// The axis of ordinates with its label and curves.
    pub(super) left: (Axis, String, Vec<Curve>),
    /// Another axis on the right, for a quantity of another size.
    pub(super) right: Option<(Axis, String, Vec<Curve>)>,
    /// Stretches of time to shade.
    pub(super) shaded: Vec<[f64; 2]>,
}

/// `name` as far as there is room for it.
pub(super) fn shortened(name: &str, characters: usize) -> String {
    if name.chars().count() <= characters {
        return name.to_owned();
    }
    let kept = characters.saturating_sub(1);
    name.chars().take(kept).chain(['\u{2026}']).collect()
}

/// `px` in drawing units.
pub(super) fn units(px: f64) -> i32 {
    (px * f64::from(UNIT)).round() as i32
}

/// Text of `px` pixels.
pub(super) fn text(px: f64, colour: &RGBColor) -> TextStyle<'static> {
    // plotters writes a size divided by 1.24 into the SVG.
    ("sans-serif", px * f64::from(UNIT) * 1.24)
        .into_font()
        .color(colour)
}

/// Width of `label` at `px` pixels, px: a guess after a wide sans-serif font, as nobody
/// knows which one a viewer takes.
pub(super) fn text_width(label: &str, px: f64) -> f64 {
    let ems = label.chars().map(|c| match c {
        'i' | 'j' | 'l' | 'f' | 't' | 'r' | ' ' | '.' | ',' | ':' | '(' | ')' | '|' => 0.39,
        'm' | 'w' | 'M' | 'W' | '\u{2212}' => 0.95,
        'A'..='Z' => 0.72,
        c if c.is_ascii() => 0.63,
        _ => 1.0,
    });
    px * ems.sum::<f64>()
}

pub(super) fn line(colour: RGBColor, px: f64) -> ShapeStyle {
    colour.stroke_width(units(px).unsigned_abs())
}

/// Draws a figure of `height` pixels.
pub(super) fn render(
    name: &str,
    height: f64,
    draw: impl FnOnce(&Area) -> Drawn,
) -> Result<String, ReportError> {
    let height = height.ceil() as u32;
    let failed = |reason: String| ReportError::Draw {
        figure: name.into(),
        reason,
    };
    let size = (WIDTH * UNIT, height * UNIT);
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        area.fill(&WHITE)
            .and_then(|()| draw(&area))
            .and_then(|()| area.present())
            .map_err(|error| failed(error.to_string()))?;
    }
    // The size in pixels instead of drawing units, and corners without spikes.
    let written = format!(r#"<svg width="{}" height="{}""#, size.0, size.1);
    let wanted = format!(
        r#"<svg width="{WIDTH}" height="{height}" stroke-linejoin="round" stroke-linecap="round""#
    );
    if !svg.starts_with(&written) {
        return Err(failed("unexpected SVG from the plotting library".into()));
    }
    Ok(svg.replacen(&written, &wanted, 1))
}

/// Left edge and right edge of the plots, px from the figure's edges.
pub(super) const LEFT: f64 = 74.0;
pub(super) const RIGHT: f64 = 22.0;
/// With an axis on the right.
const RIGHT_AXIS: f64 = 70.0;
/// Room outside the axes' descriptions, px.
pub(super) const EDGE: f64 = 8.0;
/// Height of a line of the text above a panel, px, and of the space around it.
const HEADING_LINE: f64 = 17.0;
const HEADING_SPACE: f64 = 11.0;
/// Height of a panel's plot, px.
const PLOT: f64 = 148.0;
/// Height of the time axis' labels, px.
pub(super) const TIME_LABELS: f64 = 46.0;
/// Height of a figure's title, px.
pub(super) const TITLE: f64 = 30.0;
/// Size of all text but titles, px.
pub(super) const TEXT: f64 = 12.0;

/// Where the parts of a panel's heading go.
struct Heading<'a> {
    /// Curves with their place: px from the left, and line.
    legend: Vec<(&'a Curve, f64, usize)>,
    /// What is said of cut axes; each has its own line after the legend.
    cut: Vec<String>,
    /// Number of lines.
    lines: usize,
}

impl<'a> Heading<'a> {
    fn new(panel: &'a Panel) -> Self {
        let right = panel.right.iter().flat_map(|(_, _, curves)| curves);
        let mut x = LEFT;
        if !panel.heading.is_empty() {
            x += text_width(&panel.heading, TEXT) + 14.0;
        }
        let indent = x;
        let (mut legend, mut line) = (vec![], 0);
        for curve in panel.left.2.iter().chain(right) {
            let width = 26.0 + text_width(&curve.label, TEXT);
            if x + width > f64::from(WIDTH) - EDGE && x > indent {
                (x, line) = (indent, line + 1);
            }
            legend.push((curve, x, line));
            x += width + 16.0;
        }
        let axes = std::iter::once(&panel.left).chain(&panel.right);
        let cut: Vec<String> = axes
            .filter_map(|(axis, quantity, _)| Some((axis.cut?, quantity)))
            .map(|([low, high], quantity)| {
                let (low, high) = (number(low), number(high));
                format!("axis of {quantity} is cut: the values reach from {low} to {high}")
            })
            .collect();
        Self {
            legend,
            lines: line + 1 + cut.len(),
            cut,
        }
    }

    fn height(&self) -> f64 {
        HEADING_LINE * self.lines as f64 + HEADING_SPACE
    }
}

/// Draws the legend and the notes above a panel.
fn draw_heading(area: &Area, panel: &Panel, heading: &Heading) -> Drawn {
    let middle = |line: usize| units(HEADING_SPACE - 2.0 + HEADING_LINE * (line as f64 + 0.5));
    let place = Pos::new(HPos::Left, VPos::Center);
    let plain = text(TEXT, &INK).pos(place);
    if !panel.heading.is_empty() {
        area.draw_text(&panel.heading, &plain, (units(LEFT), middle(0)))?;
    }
    for (curve, x, row) in &heading.legend {
        let y = middle(*row);
        area.draw(&PathElement::new(
            vec![(units(*x), y), (units(x + 20.0), y)],
            line(curve.colour, curve.width.max(2.0)),
        ))?;
        area.draw_text(&curve.label, &plain, (units(x + 26.0), y))?;
    }
    let first = heading.lines - heading.cut.len();
    for (index, cut) in heading.cut.iter().enumerate() {
        let style = text(TEXT, &VERMILLION).pos(place);
        area.draw_text(cut, &style, (units(LEFT), middle(first + index)))?;
    }
    Ok(())
}

/// Height of panels below each other, px.
pub(super) fn panels_height(panels: &[Panel]) -> f64 {
    let each = |panel: &Panel| Heading::new(panel).height() + PLOT;
    panels.iter().map(each).sum::<f64>() + TIME_LABELS
}

/// What the axis of abscissas over times says.
pub(super) const TIME: &str = "time (s)";

/// Draws panels below each other over the common axis of abscissas `range`, which says
/// `label`; `wide` leaves room for an axis on the right in all of them.
pub(super) fn draw_panels(
    area: &Area,
    panels: &[Panel],
    (range, label): ([f64; 2], &str),
    wide: bool,
) -> Drawn {
    let mut rest = area.clone();
    let time = Axis::exact(range, 10);
    for (index, panel) in panels.iter().enumerate() {
        let last = index + 1 == panels.len();
        let labels = if last { TIME_LABELS } else { 0.0 };
        let heading = Heading::new(panel);
        let (head, below) = rest.split_vertically(units(heading.height()));
        draw_heading(&head, panel, &heading)?;
        let (body, below) = below.split_vertically(units(PLOT + labels));
        rest = below;
        draw_panel(&body, panel, &time, last.then_some(label), wide)?;
    }
    Ok(())
}

/// Draws a panel's axes and curves; the last one of several has the abscissas' label.
fn draw_panel(area: &Area, panel: &Panel, time: &Axis, label: Option<&str>, wide: bool) -> Drawn {
    let (left, y_label, curves) = &panel.left;
    let other = panel.right.as_ref();
    let right = other.map_or(left, |(axis, _, _)| axis);
    let margin = if wide { RIGHT_AXIS } else { RIGHT };
    let mut builder = ChartBuilder::on(area);
    builder
        .set_label_area_size(LabelAreaPosition::Left, units(LEFT - EDGE))
        .margin_left(units(EDGE))
        .set_label_area_size(
            LabelAreaPosition::Bottom,
            label.map_or(0, |_| units(TIME_LABELS)),
        );
    if other.is_some() {
        builder
            .set_label_area_size(LabelAreaPosition::Right, units(margin - EDGE))
            .margin_right(units(EDGE));
    } else {
        builder.margin_right(units(margin));
    }
    let mut chart = builder
        .build_cartesian_2d(time.clone(), left.clone())?
        .set_secondary_coord(time.clone(), right.clone());
    let [low, high] = left.range;
    for [from, to] in &panel.shaded {
        chart.draw_series([Rectangle::new([(*from, low), (*to, high)], SHADE.filled())])?;
    }
    draw_axes(&mut chart, true, [label.unwrap_or_default(), y_label])?;
    if let Some((axis, label, _)) = other {
        chart
            .configure_secondary_axes()
            .axis_style(line(SOFT, 1.0))
            .set_all_tick_mark_size(units(4.0))
            .label_style(text(TEXT, &INK))
            .axis_desc_style(text(TEXT, &INK))
            .y_labels(axis.ticks.len())
            .y_desc(label)
            .draw()?;
    }
    chart.draw_series([PathElement::new(
        time.range.map(|t| (t, low)).to_vec(),
        line(SOFT, 1.0),
    )])?;
    let pieces = |curve: &Curve, axis: &Axis| -> Vec<Vec<(f64, f64)>> {
        decimate(&curve.points, POINTS_MAX)
            .iter()
            .flat_map(|piece| clip(piece, axis.range))
            .collect()
    };
    for curve in curves {
        let style = line(curve.colour, curve.width);
        chart.draw_series(
            pieces(curve, left)
                .into_iter()
                .map(|piece| PathElement::new(piece, style)),
        )?;
    }
    if let Some((axis, _, curves)) = other {
        for curve in curves {
            let style = line(curve.colour, curve.width);
            chart.draw_secondary_series(
                pieces(curve, axis)
                    .into_iter()
                    .map(|piece| PathElement::new(piece, style)),
            )?;
        }
    }
    Ok(())
}

/// A chart with axes at the left and below.
pub(super) type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Axis, Axis>>;

/// A chart that fills `area`, with room for the axes' labels and descriptions.
pub(super) fn chart<'a, 'b>(
    area: &'a Area<'b>,
    [across, up]: [&Axis; 2],
) -> Result<Chart<'a, 'b>, DrawingAreaErrorKind<std::io::Error>> {
    ChartBuilder::on(area)
        .set_label_area_size(LabelAreaPosition::Left, units(LEFT - EDGE))
        .margin_left(units(EDGE))
        .set_label_area_size(LabelAreaPosition::Bottom, units(TIME_LABELS))
        .margin_right(units(RIGHT))
        .build_cartesian_2d(across.clone(), up.clone())
}

/// Draws a chart's axes and, with `grid`, lines at their ticks. `labels` say what the
/// abscissas and the ordinates are.
pub(super) fn draw_axes(chart: &mut Chart<'_, '_>, grid: bool, labels: [&str; 2]) -> Drawn {
    let (across, up) = (
        chart.as_coord_spec().x_spec(),
        chart.as_coord_spec().y_spec(),
    );
    let counts = [across.ticks.len(), up.ticks.len()];
    let mut mesh = chart.configure_mesh();
    if grid {
        mesh.bold_line_style(line(GRID, 0.8))
            .light_line_style(TRANSPARENT);
    } else {
        mesh.disable_mesh();
    }
    mesh.axis_style(line(SOFT, 1.0))
        .set_all_tick_mark_size(units(4.0))
        .label_style(text(TEXT, &INK))
        .axis_desc_style(text(TEXT, &INK))
        .x_labels(counts[0])
        .y_labels(counts[1])
        .x_desc(labels[0])
        .y_desc(labels[1])
        .draw()
}

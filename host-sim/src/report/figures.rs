//! The figures: the arm's postures along its path, every case's time histories, and
//! the contact forces of the cases over each other.
//!
//! File names: `stick_figure.svg`, `contact_force_cases.svg` and, a case,
//! `<case>_<plant>.svg`, in lower case with everything but letters, digits, dots and
//! hyphens as underscores.
//!
//! Colours are those of Okabe and Ito, which colour-blind readers tell apart.

mod accuracy;
pub(super) mod gains;

use super::{Case, ReportError, write_file};
use crate::model::arm_model::deflection_matrix;
use crate::simulation::closed_loop::LogRow;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::{Path, PathBuf};

pub(super) use accuracy::accuracy_figures;

/// Drawing units a pixel: plotters draws on an integer grid, which would make steps in
/// smooth curves.
const UNIT: u32 = 8;

/// Most points of a plotted curve.
pub(super) const POINTS_MAX: usize = 1500;

/// Width of a figure, px.
const WIDTH: u32 = 800;

const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xB2);
const VERMILLION: RGBColor = RGBColor(0xD5, 0x5E, 0x00);
const GREEN: RGBColor = RGBColor(0x00, 0x9E, 0x73);
const PURPLE: RGBColor = RGBColor(0xCC, 0x79, 0xA7);
const ORANGE: RGBColor = RGBColor(0xE6, 0x9F, 0x00);
const SKY: RGBColor = RGBColor(0x56, 0xB4, 0xE9);
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const SOFT: RGBColor = RGBColor(0x66, 0x66, 0x66);
/// A planned quantity, drawn wide below the simulated one.
const REFERENCE: RGBColor = RGBColor(0xB8, 0xB8, 0xB8);
const GRID: RGBColor = RGBColor(0xE6, 0xE6, 0xE6);
/// Times in which the tip rests.
const SHADE: RGBColor = RGBColor(0xF2, 0xF2, 0xF2);

/// Colours of curves over each other.
const PALETTE: [RGBColor; 7] = [BLUE, VERMILLION, GREEN, INK, ORANGE, PURPLE, SKY];

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// A figure.
pub(super) struct Figure {
    /// Its file's name without the ending.
    pub(super) name: String,
    /// What it shows.
    pub(super) caption: String,
    /// The figure as an SVG document.
    pub(super) svg: String,
}

/// Writes the figures of `cases` into the folder `dir` as SVG files and returns their
/// paths.
///
/// `stick_figure.svg` shows the planned motion of the first case;
/// `contact_force_cases.svg` the contact forces of all cases that take as long as the
/// first one, a panel for each plant, with further panels for cases that are off by far
/// more than the others; `<case>_<plant>.svg` the time histories of a case.
///
/// # Errors
/// [`ReportError`].
pub fn write_figures(dir: &Path, cases: &[Case]) -> Result<Vec<PathBuf>, ReportError> {
    figures(cases)?
        .into_iter()
        .map(|figure| {
            let path = dir.join(format!("{}.svg", figure.name));
            write_file(&path, &figure.svg)?;
            Ok(path)
        })
        .collect()
}

/// All figures of `cases`.
pub(super) fn figures(cases: &[Case]) -> Result<Vec<Figure>, ReportError> {
    let first = cases.first().ok_or(ReportError::NoCases)?;
    let mut figures = vec![stick_figure(first)?, contact_forces(cases)?];
    for case in cases {
        let mut figure = histories(case)?;
        // Two cases must not overwrite each other's file.
        let name = figure.name.clone();
        let mut number = 2;
        while figures.iter().any(|other| other.name == figure.name) {
            figure.name = format!("{name}_{number}");
            number += 1;
        }
        figures.push(figure);
    }
    Ok(figures)
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

/// At most `points_max` (4 or more) of `points` that keep the least and the greatest
/// value of every stretch. Samples that are not finite are left out; a stretch without
/// any other is a gap, so the result is pieces.
pub(super) fn decimate(points: &[[f64; 2]], points_max: usize) -> Vec<Vec<[f64; 2]>> {
    // Up to four points a stretch: first, least, greatest, last.
    let stretch = if points.len() <= points_max {
        1
    } else {
        points.len().div_ceil((points_max / 4).max(1))
    };
    let mut pieces: Vec<Vec<[f64; 2]>> = vec![vec![]];
    for stretch in points.chunks(stretch) {
        let finite = |i: &usize| stretch[*i].iter().all(|x| x.is_finite());
        let by = |a: &usize, b: &usize| stretch[*a][1].total_cmp(&stretch[*b][1]);
        let indices = || (0..stretch.len()).filter(finite);
        let kept = [
            indices().next(),
            indices().min_by(by),
            indices().max_by(by),
            indices().next_back(),
        ];
        let mut kept: Vec<usize> = kept.into_iter().flatten().collect();
        kept.sort_unstable();
        kept.dedup();
        if kept.is_empty() {
            pieces.push(vec![]);
        }
        for point in kept.into_iter().map(|i| stretch[i]) {
            let Some(piece) = pieces.last_mut() else {
                break;
            };
            // What lies on a level stretch tells nothing.
            if let [.., before, middle] = piece[..]
                && before[1] == middle[1]
                && middle[1] == point[1]
            {
                piece.pop();
            }
            piece.push(point);
        }
    }
    pieces.retain(|piece| !piece.is_empty());
    pieces
}

/// The parts of a polyline within `range` of the ordinate.
fn clip(points: &[[f64; 2]], range: [f64; 2]) -> Vec<Vec<(f64, f64)>> {
    let mut pieces = vec![];
    let mut piece: Vec<(f64, f64)> = vec![];
    for pair in points.windows(2) {
        let ([x0, y0], [x1, y1]) = (pair[0], pair[1]);
        // Shares of the segment at which it enters and leaves the range.
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        if y0 == y1 {
            if y0 < range[0] || y0 > range[1] {
                leave = -1.0;
            }
        } else {
            let at = range.map(|y| (y - y0) / (y1 - y0));
            enter = enter.max(at[0].min(at[1]));
            leave = leave.min(at[0].max(at[1]));
        }
        if enter > leave {
            pieces.push(std::mem::take(&mut piece));
            continue;
        }
        let at = |share: f64| (x0 + share * (x1 - x0), y0 + share * (y1 - y0));
        if piece.is_empty() {
            piece.push(at(enter));
        }
        piece.push(at(leave));
        if leave < 1.0 {
            pieces.push(std::mem::take(&mut piece));
        }
    }
    pieces.push(piece);
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

/// An axis: its range and ticks.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    /// Least and greatest value shown.
    pub(super) range: [f64; 2],
    /// Where the ticks are.
    ticks: Vec<f64>,
    /// Decimals of their labels.
    decimals: usize,
    /// Least and greatest value of the data where they are not shown.
    pub(super) cut: Option<[f64; 2]>,
    /// Whether values are decimal logarithms of what the labels say.
    logarithmic: bool,
}

impl Axis {
    /// An axis for `values` (those that are not finite are passed over) that spans at
    /// least `span`, so that rounding errors of a constant do not fill the figure, and
    /// stays within `limits`, so that a diverging signal does not hide everything else.
    pub(super) fn new(
        values: impl Iterator<Item = f64>,
        span: f64,
        limits: [f64; 2],
        ticks: usize,
    ) -> Self {
        let [least, greatest] = values
            .filter(|x| x.is_finite())
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
                [low.min(x), high.max(x)]
            });
        let [mut low, mut high] = [least, greatest].map(|x| x.clamp(limits[0], limits[1]));
        let cut = (least < limits[0] || greatest > limits[1]) && least <= greatest;
        if least > greatest {
            (low, high) = (0.0_f64.max(limits[0]), 0.0_f64.max(limits[0]));
        }
        if high - low < span {
            let middle = 0.5 * (low + high);
            (low, high) = (middle - 0.5 * span, middle + 0.5 * span);
            if low < limits[0] {
                (low, high) = (limits[0], limits[0] + span);
            }
        } else {
            let margin = 0.06 * (high - low);
            // Nothing is less than the least possible value.
            low = if low > limits[0] { low - margin } else { low };
            high += margin;
        }
        Self {
            cut: cut.then_some([least, greatest]),
            ..Self::exact([low, high], ticks)
        }
    }

    /// An axis over exactly `range` with about `ticks` ticks.
    fn exact(range: [f64; 2], ticks: usize) -> Self {
        let raw = (range[1] - range[0]) / ticks.max(1) as f64;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .map(|m| m * power)
            .find(|step| *step >= raw * 0.999)
            .unwrap_or(10.0 * power);
        let [first, last] = [
            (range[0] / step - 1e-6).ceil(),
            (range[1] / step + 1e-6).floor(),
        ];
        let count = (last - first).clamp(0.0, 50.0) as usize;
        Self {
            range,
            ticks: (0..=count).map(|i| (first + i as f64) * step).collect(),
            decimals: (-step.log10() - 1e-6).ceil().clamp(0.0, 12.0) as usize,
            cut: None,
            logarithmic: false,
        }
    }

    /// An axis over exactly `range` of decimal logarithms, with a tick a decade that is
    /// labelled with the value itself.
    fn decades(range: [f64; 2]) -> Self {
        let (first, last) = (range[0].ceil(), range[1].floor());
        let count = (last - first).clamp(0.0, 50.0) as usize;
        Self {
            range,
            ticks: (0..=count).map(|i| first + i as f64).collect(),
            decimals: 0,
            cut: None,
            logarithmic: true,
        }
    }

    /// The same, without a word on values beyond its range.
    fn without_cut(mut self) -> Self {
        self.cut = None;
        self
    }

    fn label(&self, value: f64) -> String {
        if self.logarithmic {
            let decimals = (-value).max(0.0).round() as usize;
            return format!("{:.decimals$}", 10f64.powf(value));
        }
        let text = format!("{value:.*}", self.decimals);
        let zero = text
            .trim_start_matches('-')
            .chars()
            .all(|c| "0.".contains(c));
        if zero {
            text.trim_start_matches('-').to_owned()
        } else {
            text.replace('-', "\u{2212}")
        }
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value - self.range[0]) / (self.range[1] - self.range[0]);
        // A conversion to integers saturates.
        (f64::from(limit.0) + share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() {
            vec![]
        } else {
            self.ticks.clone()
        }
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range[0]..self.range[1]
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        self.label(*value)
    }
}

/// A number for a label: three significant digits.
pub(super) fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return "not finite".into();
    }
    let magnitude = value.abs().log10().floor();
    let text = if (-3.0..5.0).contains(&magnitude) {
        format!("{value:.*}", (2.0 - magnitude).clamp(0.0, 6.0) as usize)
    } else {
        format!("{value:.2e}")
    };
    text.replace('-', "\u{2212}")
}

/// A curve over time.
struct Curve {
    label: String,
    colour: RGBColor,
    /// Width of the line, px.
    width: f64,
    points: Vec<[f64; 2]>,
}

impl Curve {
    fn simulated(
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

    fn reference(label: &str, points: Vec<[f64; 2]>) -> Self {
        Self {
            label: label.into(),
            colour: REFERENCE,
            width: 4.0,
            points,
        }
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|point| point[1])
    }
}

/// One of the panels that share a time axis.
struct Panel {
    /// Said above the panel, before the legend.
    heading: String,
    /// The axis of ordinates with its label and curves.
    left: (Axis, String, Vec<Curve>),
    /// Another axis on the right, for a quantity of another size.
    right: Option<(Axis, String, Vec<Curve>)>,
    /// Stretches of time to shade.
    shaded: Vec<[f64; 2]>,
}

/// `name` as far as there is room for it.
fn shortened(name: &str, characters: usize) -> String {
    if name.chars().count() <= characters {
        return name.to_owned();
    }
    let kept = characters.saturating_sub(1);
    name.chars().take(kept).chain(['\u{2026}']).collect()
}

/// `px` in drawing units.
fn units(px: f64) -> i32 {
    (px * f64::from(UNIT)).round() as i32
}

/// Text of `px` pixels.
fn text(px: f64, colour: &RGBColor) -> TextStyle<'static> {
    // plotters writes a size divided by 1.24 into the SVG.
    ("sans-serif", px * f64::from(UNIT) * 1.24)
        .into_font()
        .color(colour)
}

/// Width of `label` at `px` pixels, px: a guess after a wide sans-serif font, as nobody
/// knows which one a viewer takes.
fn text_width(label: &str, px: f64) -> f64 {
    let ems = label.chars().map(|c| match c {
        'i' | 'j' | 'l' | 'f' | 't' | 'r' | ' ' | '.' | ',' | ':' | '(' | ')' | '|' => 0.39,
        'm' | 'w' | 'M' | 'W' | '\u{2212}' => 0.95,
        'A'..='Z' => 0.72,
        c if c.is_ascii() => 0.63,
        _ => 1.0,
    });
    px * ems.sum::<f64>()
}

fn line(colour: RGBColor, px: f64) -> ShapeStyle {
    colour.stroke_width(units(px).unsigned_abs())
}

/// Draws a figure of `height` pixels.
fn render(
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
const LEFT: f64 = 74.0;
const RIGHT: f64 = 22.0;
/// With an axis on the right.
const RIGHT_AXIS: f64 = 70.0;
/// Room outside the axes' descriptions, px.
const EDGE: f64 = 8.0;
/// Height of a line of the text above a panel, px, and of the space around it.
const HEADING_LINE: f64 = 17.0;
const HEADING_SPACE: f64 = 11.0;
/// Height of a panel's plot, px.
const PLOT: f64 = 148.0;
/// Height of the time axis' labels, px.
const TIME_LABELS: f64 = 46.0;
/// Height of a figure's title, px.
const TITLE: f64 = 30.0;
/// Size of all text but titles, px.
const TEXT: f64 = 12.0;

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
fn panels_height(panels: &[Panel]) -> f64 {
    let each = |panel: &Panel| Heading::new(panel).height() + PLOT;
    panels.iter().map(each).sum::<f64>() + TIME_LABELS
}

/// What the axis of abscissas over times says.
const TIME: &str = "time (s)";

/// Draws panels below each other over the common axis of abscissas `range`, which says
/// `label`; `wide` leaves room for an axis on the right in all of them.
fn draw_panels(
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
    chart
        .configure_mesh()
        .bold_line_style(line(GRID, 0.8))
        .light_line_style(TRANSPARENT)
        .axis_style(line(SOFT, 1.0))
        .set_all_tick_mark_size(units(4.0))
        .label_style(text(TEXT, &INK))
        .axis_desc_style(text(TEXT, &INK))
        .x_labels(time.ticks.len())
        .y_labels(left.ticks.len())
        .x_desc(label.unwrap_or_default())
        .y_desc(y_label)
        .draw()?;
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

/// Time histories of a case.
fn histories(case: &Case) -> Result<Figure, ReportError> {
    let rows = &case.run.rows;
    let plan = case.plan;
    let times = case.times();
    let reference = plan.task.normal_force;
    let tall = 5;

    let force = vec![
        Curve::reference("reference", times.iter().map(|t| [*t, reference]).collect()),
        Curve::simulated("contact force", BLUE, rows, |r| r.reading.force),
    ];
    let force_axis = force_axis(force[1].values(), reference, tall);

    let error = Curve::simulated("tip error", BLUE, rows, |r| 1e3 * r.tip_error());
    let reach = plan.model.arm.link1_length_m + plan.model.arm.link2_length_m;
    let error_axis = Axis::new(error.values(), 0.01, [0.0, 2e3 * reach], tall);

    let torques = [0, 1].map(|joint| {
        let colour = [BLUE, VERMILLION][joint];
        let label = ["joint 1 (left axis)", "joint 2 (right axis)"][joint];
        let curve = Curve::simulated(label, colour, rows, |r| r.torque[joint]);
        let limit = 5.0 * plan.peaks.torque[joint].max(0.02);
        let axis = Axis::new(curve.values(), 0.01, [-limit, limit], tall);
        (axis, format!("torque {} (N m)", joint + 1), vec![curve])
    });
    let [left_torque, right_torque] = torques;

    let planned = plan.points.iter().map(|p| [p.t, p.root_slope]).collect();
    let slope = vec![
        Curve::reference("planned", planned),
        Curve::simulated("root slope", BLUE, rows, |r| r.reading.root_slope),
    ];
    let slope_axis = Axis::new(
        slope.iter().flat_map(Curve::values),
        1e-3,
        [-1.6, 1.6],
        tall,
    );

    let panel = |left, right| Panel {
        heading: String::new(),
        left,
        right,
        shaded: resting(case),
    };
    let panels = [
        panel((force_axis, "force (N)".into(), force), None),
        panel((error_axis, "tip error (mm)".into(), vec![error]), None),
        panel(left_torque, Some(right_torque)),
        panel((slope_axis, "root slope (rad)".into(), slope), None),
    ];
    let (title, plant) = (case.title(), case.plant_title());
    let outcome = case.run.summary.outcome.name().replace('_', " ");
    let name = format!("{}_{}", file_name(case.case), file_name(case.plant));
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
        draw_panels(&body, &panels, (times, TIME), true)
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
    let visible = 0.01 * case.plan.task.normal_force.abs();
    if rms > visible { rms } else { visible }
}

/// Contact forces of the cases over each other.
fn contact_forces(cases: &[Case]) -> Result<Figure, ReportError> {
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
        let mut members: Vec<&Case> = shown.iter().copied().filter(|c| c.plant == plant).collect();
        members.sort_by(|a, b| force_error(a).total_cmp(&force_error(b)));
        let mut groups: Vec<Vec<&Case>> = vec![];
        for case in members {
            // A case joins the smaller ones unless it would squash all of them.
            match groups.last_mut() {
                Some(group) if joins(group, case) => group.push(case),
                _ => groups.push(vec![case]),
            }
        }
        for mut group in groups {
            group.sort_by_key(|c| names.iter().position(|n| *n == c.case));
            let reference = group[0].plan.task.normal_force;
            let mut curves = vec![Curve::reference(
                "reference",
                times.iter().map(|t| [*t, reference]).collect(),
            )];
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

/// Postures that the stick figure shows.
const POSTURES: usize = 11;

/// Intervals in which link 2 is drawn.
const OUTLINE_INTERVALS: usize = 40;

/// Link 2 of the plan at a tick, as points from joint 2 to the tip, m.
fn planned_outline(case: &Case, shape: &nalgebra::DMatrix<f64>, tick: usize) -> Vec<(f64, f64)> {
    let plan = case.plan;
    let (arm, dof) = (&plan.model.arm, plan.model.dof());
    let [angle1, angle2] = plan.points[tick].joint.angle;
    let nodal = plan.deflection.get(dof * tick..dof * (tick + 1));
    let deflection = nodal
        .filter(|_| shape.ncols() == dof)
        .map(|w| shape * nalgebra::DVector::from_column_slice(w));
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

/// The arm's planned postures along the path of a case, at equal distances of the tip.
fn stick_figure(case: &Case) -> Result<Figure, ReportError> {
    const HEAD: f64 = 34.0;
    let plan = case.plan;
    let path = &plan.task.path;
    let name = "stick_figure";

    let along = [0, 1].map(|i| (path.to[i] - path.from[i]) / path.length());
    let travelled = |tip: [f64; 2]| {
        ((tip[0] - path.from[0]) * along[0] + (tip[1] - path.from[1]) * along[1]) / path.length()
    };
    let ticks = (0..POSTURES).filter_map(|k| {
        let share = k as f64 / (POSTURES - 1) as f64 - 1e-9;
        let from = (plan.pre_ticks as usize).min(plan.points.len());
        let reached = |p: &crate::planner::plan::PlanPoint| travelled(p.tip.position) >= share;
        plan.points[from..]
            .iter()
            .position(reached)
            .map(|i| i + from)
    });
    let shape = deflection_matrix(&plan.model.arm, plan.model.elements, OUTLINE_INTERVALS)
        .unwrap_or_else(|| nalgebra::DMatrix::zeros(OUTLINE_INTERVALS + 1, plan.model.dof()));
    let postures: Vec<Vec<(f64, f64)>> = ticks
        .map(|tick| planned_outline(case, &shape, tick))
        .filter(|points| !points.is_empty())
        .collect();

    // The surface, somewhat longer than the path, and the hatching behind it.
    let normal = plan.surface.normal;
    let beyond = 0.08 * path.length();
    let surface = [(path.from, -beyond), (path.to, beyond)]
        .map(|(end, by)| (end[0] + by * along[0], end[1] + by * along[1]));
    let reach = plan.model.arm.link1_length_m + plan.model.arm.link2_length_m;
    let depth = 0.024 * reach;
    // Labels go where the arm does not come from: beyond the surface, or before it.
    let joint2 = postures.first().map_or((0.0, 0.0), |points| points[0]);
    let beyond_surface =
        (joint2.0 - path.from[0]) * normal[0] + (joint2.1 - path.from[1]) * normal[1] <= 0.0;
    let side = if beyond_surface { 0.048 } else { -0.028 } * reach;
    // Beside a steep surface, above or below a level one.
    let steep = normal[0].abs() > 0.7;
    let anchor = match (steep, side * normal[0] > 0.0) {
        (false, _) => HPos::Center,
        (true, true) => HPos::Left,
        (true, false) => HPos::Right,
    };
    let labelled =
        [path.from, path.to].map(|end| (end[0] + side * normal[0], end[1] + side * normal[1]));
    let joint1_label = (0.0, if joint2.1 > 0.0 { -0.027 } else { 0.027 } * reach);
    let text_room = if steep { 0.1 * reach } else { 0.04 * reach };
    let labels_end = labelled.map(|(x, y)| (x + text_room.copysign(side * normal[0]), y));
    let joint1 = (0.0, 0.0);

    let everything = postures
        .iter()
        .flatten()
        .chain(&surface)
        .chain(&labels_end)
        .chain([&joint1_label])
        .chain([&joint1]);
    let bounds = everything.fold(
        [[f64::INFINITY, f64::NEG_INFINITY]; 2],
        |[[x0, x1], [y0, y1]], (x, y)| [[x0.min(*x), x1.max(*x)], [y0.min(*y), y1.max(*y)]],
    );
    let [mut x, y] = bounds.map(|[low, high]| [low - 0.05 * reach, high + 0.05 * reach]);
    // Equal scales; a tall figure gets empty space at its sides.
    let width = f64::from(WIDTH) - LEFT - RIGHT;
    let tallest = 640.0;
    let scale = (width / (x[1] - x[0])).min(tallest / (y[1] - y[0]));
    let spare = 0.5 * (width / scale - (x[1] - x[0]));
    x = [x[0] - spare, x[1] + spare];
    let height = (y[1] - y[0]) * scale + HEAD + TIME_LABELS;
    let horizontal = Axis::exact(x, 10);
    // Down the page is +a2.
    let vertical = Axis {
        range: [y[1], y[0]],
        ..Axis::exact(y, 7)
    };

    let hatching = (0..)
        .map(|i| 9.0 * f64::from(i) / scale)
        .take_while(|at| *at <= path.length() + 2.0 * beyond)
        .map(|at| {
            let foot = (surface[0].0 + at * along[0], surface[0].1 + at * along[1]);
            let end = (
                foot.0 + depth * (normal[0] - 0.7 * along[0]),
                foot.1 + depth * (normal[1] - 0.7 * along[1]),
            );
            vec![foot, end]
        });

    let svg = render(name, height, |area| {
        let (head, body) = area.split_vertically(units(HEAD));
        let middle = units(HEAD - 14.0);
        let mut at = LEFT;
        let legend = [
            ("link 1", BLUE, 2.5),
            ("link 2, elastic", VERMILLION, 2.5),
            ("surface", INK, 2.0),
        ];
        let at_left = Pos::new(HPos::Left, VPos::Center);
        for (label, colour, px) in legend {
            head.draw(&PathElement::new(
                vec![(units(at), middle), (units(at + 20.0), middle)],
                line(colour, px),
            ))?;
            let style = text(TEXT, &INK).pos(at_left);
            head.draw_text(label, &style, (units(at + 26.0), middle))?;
            at += 26.0 + text_width(label, TEXT) + 18.0;
        }
        let mut chart = ChartBuilder::on(&body)
            .set_label_area_size(LabelAreaPosition::Left, units(LEFT - EDGE))
            .margin_left(units(EDGE))
            .set_label_area_size(LabelAreaPosition::Bottom, units(TIME_LABELS))
            .margin_right(units(RIGHT))
            .build_cartesian_2d(horizontal.clone(), vertical.clone())?;
        chart
            .configure_mesh()
            .bold_line_style(line(GRID, 0.8))
            .light_line_style(TRANSPARENT)
            .axis_style(line(SOFT, 1.0))
            .set_all_tick_mark_size(units(4.0))
            .label_style(text(TEXT, &INK))
            .axis_desc_style(text(TEXT, &INK))
            .x_labels(horizontal.ticks.len())
            .y_labels(vertical.ticks.len())
            .x_desc("along a1 (m)")
            .y_desc("along a2, downwards (m)")
            .draw()?;
        chart.draw_series(hatching.map(|points| PathElement::new(points, line(SOFT, 0.8))))?;
        chart.draw_series([PathElement::new(surface.to_vec(), line(INK, 2.0))])?;
        for (index, points) in postures.iter().enumerate() {
            let end = index == 0 || index + 1 == postures.len();
            let px = if end { 3.0 } else { 1.2 };
            let (joint2, tip) = (points[0], points[points.len() - 1]);
            chart.draw_series([
                PathElement::new(vec![joint1, joint2], line(BLUE, px)),
                PathElement::new(points.clone(), line(VERMILLION, px)),
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
        let labels = [
            ("path start", labelled[0], anchor),
            ("path end", labelled[1], anchor),
            ("joint 1", joint1_label, HPos::Center),
        ];
        let corner = plot.get_base_pixel();
        for (label, at, side) in labels {
            let (px, py) = chart.plotting_area().map_coordinate(&at);
            let style = text(TEXT, &INK).pos(Pos::new(side, VPos::Center));
            plot.draw_text(label, &style, (px - corner.0, py - corner.1))?;
        }
        Ok(())
    })?;
    Ok(Figure {
        name: name.into(),
        caption: format!(
            "Planned postures of the arm at {} equally spaced points of the path, link 2 as bent as it is. Start and end are drawn bold; a2 points down.",
            postures.len()
        ),
        svg,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::testing::short_run;
    use crate::simulation::closed_loop::Run;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decimation_keeps_extremes_and_order(
            values in prop::collection::vec(
                prop_oneof![9 => -1e3..1e3, 1 => Just(f64::NAN), 3 => Just(1.0)], 0..3000),
            points_max in 4_usize..400,
        ) {
            let points: Vec<[f64; 2]> =
                values.iter().enumerate().map(|(i, y)| [i as f64, *y]).collect();
            let kept: Vec<[f64; 2]> = decimate(&points, points_max).concat();
            prop_assert!(kept.len() <= points_max);
            prop_assert!(kept.windows(2).all(|pair| pair[0][0] < pair[1][0]));
            prop_assert!(kept.iter().all(|p| points[p[0] as usize] == *p));
            let extremes = |points: &[[f64; 2]]| {
                points.iter().map(|p| p[1]).filter(|y| y.is_finite()).fold(
                    (f64::INFINITY, f64::NEG_INFINITY),
                    |(low, high), y| (low.min(y), high.max(y)),
                )
            };
            prop_assert_eq!(extremes(&kept), extremes(&points));
        }

        #[test]
        fn clipping_keeps_what_is_inside(
            values in prop::collection::vec(-3.0..3.0_f64, 2..60),
        ) {
            let points: Vec<[f64; 2]> =
                values.iter().enumerate().map(|(i, y)| [i as f64, *y]).collect();
            let pieces = clip(&points, [-1.0, 1.0]);
            let all: Vec<(f64, f64)> = pieces.concat();
            prop_assert!(all.iter().all(|(_, y)| y.abs() < 1.0 + 1e-9));
            for (i, y) in values.iter().enumerate().filter(|(_, y)| y.abs() < 1.0) {
                let near = |(x, v): &&(f64, f64)| (x - i as f64).abs() < 1e-9 && (v - y).abs() < 1e-9;
                prop_assert!(all.iter().find(near).is_some(), "{} {}", i, y);
            }
        }

        #[test]
        fn axes_show_their_values_with_distinct_labels(
            middle in -1e4..1e4_f64,
            exponent in -12.0..5.0_f64,
        ) {
            let half = 10f64.powf(exponent);
            let values = [middle - half, f64::NAN, middle + half];
            let axis = Axis::new(values.into_iter(), 1e-6, [-1e6, 1e6], 5);
            let [low, high] = axis.range;
            prop_assert!(low <= values[0] && values[2] <= high && axis.cut.is_none());
            prop_assert!((2..=12).contains(&axis.ticks.len()), "{:?}", axis);
            prop_assert!(axis.ticks.iter().all(|t| *t >= low - 1e-9 && *t <= high + 1e-9));
            let mut labels: Vec<String> = axis.ticks.iter().map(|t| axis.label(*t)).collect();
            labels.dedup();
            prop_assert_eq!(labels.len(), axis.ticks.len());
        }
    }

    #[test]
    fn a_constant_gets_a_span_and_a_divergence_is_cut() {
        let noise = (0..100).map(|i| 2.0 + 1e-12 * f64::from(i));
        let axis = force_axis(noise, 2.0, 5);
        assert!(
            (axis.range[1] - axis.range[0] - 0.1).abs() < 1e-6,
            "{axis:?}"
        );
        assert_eq!(axis.cut, None);

        let wild = (0..100).map(|i| 2f64.powi(i));
        let axis = force_axis(wild, 2.0, 5);
        assert!(axis.range[1] < 20.0, "{axis:?}");
        assert_eq!(axis.cut, Some([1.0, 2f64.powi(99)]));

        let nothing = Axis::new([f64::NAN].into_iter(), 0.01, [0.0, 5.0], 5);
        assert_eq!((nothing.range, nothing.cut), ([0.0, 0.01], None));
    }

    #[test]
    fn numbers_have_three_digits() {
        let texts = [0.0, 1.2345, -0.012345, 123.45, 1.5e-5, 1e9, f64::NAN].map(number);
        let wanted = [
            "0",
            "1.23",
            "\u{2212}0.0123",
            "123",
            "1.50e\u{2212}5",
            "1.00e9",
            "not finite",
        ];
        assert_eq!(texts, wanted);
    }

    /// Checks that a figure is well-formed and draws nothing outside itself.
    fn check(figure: &Figure) {
        let document = roxmltree::Document::parse(&figure.svg)
            .unwrap_or_else(|error| panic!("{}: {error}", figure.name));
        let root = document.root_element();
        let numbers = |text: &str| -> Vec<f64> {
            text.split([' ', ','])
                .filter(|t| !t.is_empty())
                .map(|t| t.parse().unwrap())
                .collect()
        };
        let size = numbers(root.attribute("viewBox").unwrap());
        let mut lines = 0;
        for node in root.descendants() {
            let points = numbers(node.attribute("points").unwrap_or_default());
            lines += usize::from(points.len() > 2);
            for point in points.chunks(2) {
                let inside =
                    (0.0..=size[2]).contains(&point[0]) && (0.0..=size[3]).contains(&point[1]);
                assert!(inside, "{}: {point:?} is outside {size:?}", figure.name);
            }
        }
        assert!(lines > 10, "{}: only {lines} lines", figure.name);
    }

    #[test]
    fn figures_are_well_formed_whatever_the_signals_are() {
        let (plan, run) = short_run();
        let changed = |change: &dyn Fn(usize, &mut LogRow)| {
            let mut run = run.clone();
            run.rows
                .iter_mut()
                .enumerate()
                .for_each(|(i, row)| change(i, row));
            run
        };
        let set = |row: &mut LogRow, x: f64| {
            row.reading.force = x;
            row.reading.tip = [x; 2];
            row.reading.root_slope = x;
            row.torque = [x; 2];
        };
        let empty = Run {
            rows: vec![],
            shapes: vec![],
            ..run.clone()
        };
        let runs = [
            run.clone(),
            changed(&|_, row| set(row, 0.0)),
            changed(&|_, row| set(row, 1e300)),
            changed(&|_, row| set(row, f64::NAN)),
            changed(&|i, row| set(row, if i % 7 == 3 { f64::INFINITY } else { -1.0 })),
            changed(&|i, row| set(row, (-1.1_f64).powi(i as i32))),
            empty,
        ];
        for run in &runs {
            let case = Case {
                case: "a <b> & \"c\"",
                plant: "p",
                plan: &plan,
                run,
            };
            let figures = figures(&[case]).unwrap();
            assert_eq!(figures.len(), 3);
            figures.iter().for_each(check);
        }
    }

    #[test]
    fn cases_far_off_get_panels_of_their_own() {
        let (plan, run) = short_run();
        let mut off = run.clone();
        off.rows.iter_mut().for_each(|row| row.reading.force += 1.0);
        off.summary.force_error_rms = 1.0;
        let case = |name, run| Case {
            case: name,
            plant: "nominal",
            plan: &plan,
            run,
        };
        let axes = |runs: &[Case]| {
            let svg = contact_forces(runs).unwrap().svg;
            svg.matches("contact force (N)").count()
        };
        assert_eq!(axes(&[case("a", &run), case("b", &run)]), 1);
        assert_eq!(
            axes(&[case("a", &run), case("b", &off), case("c", &run)]),
            2
        );
    }

    #[test]
    fn files_are_written_under_stable_names_or_the_error_names_the_path() {
        let (plan, run) = short_run();
        let case = |name| Case {
            case: name,
            plant: "stiffness_x0.9",
            plan: &plan,
            run: &run,
        };
        let folder = std::env::temp_dir().join(format!("flexor-figures-{}", std::process::id()));
        let cases = [case("feedback"), case("../My Run"), case("feedback")];
        let paths = write_figures(&folder, &cases).unwrap();
        let names: Vec<&str> = paths
            .iter()
            .map(|path| path.file_name().unwrap().to_str().unwrap())
            .collect();
        let wanted = [
            "stick_figure.svg",
            "contact_force_cases.svg",
            "feedback_stiffness_x0.9.svg",
            ".._my_run_stiffness_x0.9.svg",
            "feedback_stiffness_x0.9_2.svg",
        ];
        assert_eq!(names, wanted);
        assert!(
            paths
                .iter()
                .all(|path| path.is_file() && path.parent() == Some(&folder))
        );

        // A file is no folder.
        let error = write_figures(&paths[0], &cases).unwrap_err();
        assert!(error.to_string().contains("stick_figure.svg"), "{error}");
        assert!(matches!(
            write_figures(&folder, &[]),
            Err(ReportError::NoCases)
        ));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn the_stick_figure_has_equal_scales_and_points_down() {
        let (plan, run) = short_run();
        let case = Case {
            case: "c",
            plant: "p",
            plan: &plan,
            run: &run,
        };
        let svg = stick_figure(&case).unwrap().svg;
        let document = roxmltree::Document::parse(&svg).unwrap();
        // Link 1 is a line of two points in its colour, 0.5 m long, from joint 1 down.
        let links: Vec<Vec<f64>> = document
            .descendants()
            .filter(|node| node.attribute("stroke") == Some("#0072B2"))
            .map(|node| {
                let points = node.attribute("points").unwrap_or_default();
                let numbers = points.split([' ', ',']).filter(|t| !t.is_empty());
                numbers.map(|t| t.parse().unwrap()).collect()
            })
            .skip(1)
            .collect();
        assert_eq!(links.len(), POSTURES);
        let lengths: Vec<f64> = links
            .iter()
            .map(|p| (p[2] - p[0]).hypot(p[3] - p[1]))
            .collect();
        for (link, length) in links.iter().zip(&lengths) {
            assert!((length / lengths[0] - 1.0).abs() < 2e-3, "{lengths:?}");
            assert!(link[3] > link[1], "joint 2 is below joint 1: {link:?}");
        }
    }

    #[test]
    fn outlines_are_the_models_deflection() {
        let (plan, _) = short_run();
        let model = &plan.model;
        let q: Vec<f64> = (0..model.dof()).map(|i| 0.01 / (1.0 + i as f64)).collect();
        let shape =
            deflection_matrix(&model.arm, model.elements, 7).unwrap() * model.deflection(&q);
        for i in 0..=7 {
            let rho = model.arm.link2_length_m * i as f64 / 7.0;
            assert!((shape[i] - model.deflection_at(&q, rho)[0]).abs() < 1e-14);
        }
        assert!(deflection_matrix(&model.arm, 0, 7).is_none());
    }
}

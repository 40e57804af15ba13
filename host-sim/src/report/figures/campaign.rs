//! Figures of a campaign: how errors are distributed over its runs, and the force error over the
//! drawn values that matter most.

use super::axis::{Axis, number};
use super::plot::{
    Area, BLUE, Chart, Drawn, Figure, INK, LEFT, SOFT, TEXT, TIME_LABELS, TITLE, VERMILLION, WIDTH,
    chart, draw_axes, line, render, shortened, text, text_width, units,
};
use crate::campaign::drivers::Driver;
use crate::campaign::findings::Findings;
use crate::campaign::record::{CampaignRecords, RunFigures, RunRecord};
use crate::campaign::statistics::{Quantiles, quantile};
use crate::report::ReportError;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Bins of a histogram, without the one for what lies beyond its axis.
const BINS: usize = 40;
/// Height of a histogram's plot, px.
const HISTOGRAM: f64 = 150.0;
/// Space between a histogram and what is above it, px.
const GAP: f64 = 14.0;
/// Height of a heading above a plot, px.
const HEAD: f64 = 28.0;
/// Side of a plot over a drawn value, px, and most of them.
const SCATTER: f64 = 230.0;
const SCATTERS_MAX: usize = 4;
/// Most runs of either kind that are drawn one by one: more would make a page of many megabytes.
const DOTS_MAX: usize = 1000;

/// A figure of every run whose distribution is shown.
struct Quantity {
    label: &'static str,
    value: fn(&RunFigures) -> f64,
}

const FORCE_RMS: Quantity = Quantity {
    label: "force error, rms (N)",
    value: |f| f.force_error_rms_n,
};

const QUANTITIES: [Quantity; 3] = [
    FORCE_RMS,
    Quantity {
        label: "largest force error (N)",
        value: |f| f.force_error_max_n,
    },
    Quantity {
        label: "largest error along the surface (mm)",
        value: |f| 1e3 * f.along_error_max_m,
    },
];

/// All figures of a campaign.
pub(in crate::report) fn campaign_figures(
    records: &CampaignRecords,
    findings: &Findings,
) -> Result<Vec<Figure>, ReportError> {
    let mut figures = vec![distributions(records)?];
    figures.extend(over_drivers(records, findings)?);
    Ok(figures)
}

/// The distribution over the runs that did not fail, and where an axis for it ends: at the
/// greatest value, but at twice the 95th percentile at most, so that a few runs do not hide the
/// others.
fn span(records: &CampaignRecords, quantity: &Quantity) -> (Option<Quantiles>, f64) {
    let of = |failed: bool| {
        let runs = records.runs.iter().map(|run| &run.figures);
        let runs = runs.filter(|f| f.outcome.failed() == failed);
        let finite = runs.map(quantity.value).filter(|value| value.is_finite());
        Quantiles::new(finite.collect())
    };
    let completed = of(false);
    let end = match (completed, of(true)) {
        (Some(all), _) => all.max.min(2.0 * all.p95),
        (None, Some(all)) => 2.0 * all.median,
        (None, None) => 1.0,
    };
    // A conversion between units must not leave the greatest run outside.
    let end = 1.0001 * end;
    (
        completed,
        if end > 0.0 && end.is_finite() {
            end
        } else {
            1.0
        },
    )
}

/// How many runs did not fail, and how many did.
type Counts = [u32; 2];

/// Runs in equal bins from 0 to `end`, and those beyond or not finite.
fn histogram(records: &CampaignRecords, quantity: &Quantity, end: f64) -> (Vec<Counts>, Counts) {
    let (mut bins, mut beyond) = (vec![[0; 2]; BINS], [0; 2]);
    for run in &records.runs {
        let place = (quantity.value)(&run.figures) / end * BINS as f64;
        // NaN is in none.
        let bin = match place >= 0.0 && place < BINS as f64 {
            true => &mut bins[place as usize],
            false => &mut beyond,
        };
        bin[usize::from(run.figures.outcome.failed())] += 1;
    }
    (bins, beyond)
}

/// What the colours mean.
fn legend(head: &Area<'_>, notes: &[(RGBColor, &str)]) -> Drawn {
    let plain = text(TEXT, &INK).pos(Pos::new(HPos::Left, VPos::Center));
    let mut x = LEFT;
    for (colour, label) in notes {
        let corners = [(units(x), units(10.0)), (units(x + 12.0), units(22.0))];
        head.draw(&Rectangle::new(corners, colour.filled()))?;
        head.draw_text(label, &plain, (units(x + 18.0), units(16.0)))?;
        x += 18.0 + text_width(label, TEXT) + 18.0;
    }
    Ok(())
}

/// Histograms of the errors.
fn distributions(records: &CampaignRecords) -> Result<Figure, ReportError> {
    let each = GAP + HISTOGRAM + TIME_LABELS;
    let height = TITLE + QUANTITIES.len() as f64 * each;
    let name = "campaign_distributions";
    let svg = render(name, height, |area| {
        let (head, mut rest) = area.split_vertically(units(TITLE));
        legend(&head, &[(BLUE, "did not fail"), (VERMILLION, "failed")])?;
        for quantity in &QUANTITIES {
            let (body, below) = rest.split_vertically(units(each));
            rest = below;
            let (_, body) = body.split_vertically(units(GAP));
            draw_histogram(&body, records, quantity)?;
        }
        Ok(())
    })?;
    Ok(Figure {
        name: name.into(),
        caption: "How many runs have which error, those that failed on top of the others; the lines are the median and the 95th percentile of those that did not fail. The bar at the right end, set apart, is of all runs beyond the axis, or without a number.".into(),
        svg,
    })
}

fn draw_histogram(area: &Area<'_>, records: &CampaignRecords, quantity: &Quantity) -> Drawn {
    let (completed, end) = span(records, quantity);
    let (bins, beyond) = histogram(records, quantity, end);
    let width = end / BINS as f64;
    let most = bins
        .iter()
        .chain([&beyond])
        .map(|bin| bin[0] + bin[1])
        .max();
    let most = f64::from(most.unwrap_or(0).max(1));
    // Room for the names of the lines.
    let top = 1.22 * most;
    let mut across = Axis::exact([0.0, end + 4.0 * width], 8);
    across.ticks.retain(|tick| *tick <= end);
    let mut up = Axis::exact([0.0, top], 4);
    up.ticks.retain(|tick| *tick <= most && tick.fract() == 0.0);
    let mut chart = chart(area, [&across, &up])?;
    draw_axes(&mut chart, true, [quantity.label, "runs"])?;
    for (index, bin) in bins.iter().enumerate() {
        draw_bar(&mut chart, width * index as f64, width, *bin)?;
    }
    let last = end + 1.5 * width;
    draw_bar(&mut chart, last, 2.0 * width, beyond)?;
    let named = [
        (completed.map(|q| q.median), "median", HPos::Right, -5.0),
        (completed.map(|q| q.p95), "95 %", HPos::Left, 5.0),
    ];
    for (at, label, side, aside) in named {
        let Some(at) = at.filter(|at| *at <= end) else {
            continue;
        };
        chart.draw_series([PathElement::new(vec![(at, 0.0), (at, top)], line(INK, 1.2))])?;
        let (x, y) = chart.backend_coord(&(at, top));
        let style = text(TEXT, &INK).pos(Pos::new(side, VPos::Top));
        write_at(area, label, &style, (x + units(aside), y))?;
    }
    if beyond != [0; 2] {
        let (x, y) = chart.backend_coord(&(last + width, 0.0));
        let style = text(TEXT, &INK).pos(Pos::new(HPos::Center, VPos::Top));
        write_at(area, "beyond", &style, (x, y + units(7.0)))?;
    }
    Ok(())
}

/// Writes `label` at a place of the whole picture.
fn write_at(area: &Area<'_>, label: &str, style: &TextStyle<'_>, (x, y): (i32, i32)) -> Drawn {
    let (left, top) = area.get_base_pixel();
    area.draw_text(label, style, (x - left, y - top))
}

/// Draws a bar of runs from `left` on, those that failed on top.
fn draw_bar(chart: &mut Chart<'_, '_>, left: f64, width: f64, bin: Counts) -> Drawn {
    let [completed, failed] = bin.map(f64::from);
    let [from, to] = [left + 0.06 * width, left + 0.94 * width];
    let parts = [
        (BLUE, 0.0, completed),
        (VERMILLION, completed, completed + failed),
    ];
    let bars = parts.into_iter().filter(|(_, low, high)| high > low);
    chart.draw_series(
        bars.map(|(colour, low, high)| Rectangle::new([(from, low), (to, high)], colour.filled())),
    )?;
    Ok(())
}

/// The parameters to show, each once: those that part failures from successes, then what drives
/// failure and what drives the force error in turn, the strongest first.
fn strongest(findings: &Findings) -> Vec<usize> {
    let drivers = [&findings.failure_drivers, &findings.force_drivers];
    let most = drivers.iter().map(|list| list.len()).max().unwrap_or(0);
    let in_turn = (0..most).flat_map(|place| drivers.map(|list| list.get(place)));
    let in_turn = in_turn.flatten().map(|driver| driver.parameter);
    let splits = findings.splits.iter().map(|split| split.parameter);
    let mut chosen = vec![];
    for parameter in splits.chain(in_turn) {
        if !chosen.contains(&parameter) {
            chosen.push(parameter);
        }
    }
    chosen.truncate(SCATTERS_MAX);
    chosen
}

/// The force error over the drawn values that matter most; nothing where none varies.
fn over_drivers(
    records: &CampaignRecords,
    findings: &Findings,
) -> Result<Option<Figure>, ReportError> {
    let chosen = strongest(findings);
    if chosen.is_empty() {
        return Ok(None);
    }
    let dots = dots(records);
    let shown: usize = dots.iter().map(Vec::len).sum();
    let rows = chosen.len().div_ceil(2);
    let cell = HEAD + SCATTER + TIME_LABELS;
    let name = "campaign_drivers";
    let svg = render(name, TITLE + rows as f64 * cell, |area| {
        let (head, body) = area.split_vertically(units(TITLE));
        legend(&head, &[(BLUE, "did not fail"), (VERMILLION, "failed")])?;
        let half = units(0.5 * f64::from(WIDTH));
        for (place, &parameter) in chosen.iter().enumerate() {
            let (left, top) = (half * (place % 2) as i32, units(cell) * (place / 2) as i32);
            let area = body.clone().shrink((left, top), (half, units(cell)));
            draw_scatter(&area, records, findings, parameter, &dots)?;
        }
        Ok(())
    })?;
    let part = match shown < records.runs.len() {
        true => format!(" Shown are {shown} of {} runs.", records.runs.len()),
        false => String::new(),
    };
    Ok(Some(Figure {
        name: name.into(),
        caption: format!(
            "The force error's rms over the drawn values that go with failure and force error most, with their rank correlations. In the band above the line are the runs that failed, whose force error tells only when they were stopped, and the few that are beyond the axis.{part}"
        ),
        svg,
    }))
}

/// The runs that are drawn: those that did not fail, and those that did; of many, evenly chosen
/// ones.
fn dots(records: &CampaignRecords) -> [Vec<&RunRecord>; 2] {
    [false, true].map(|failed| {
        let of = |run: &&RunRecord| run.figures.outcome.failed() == failed;
        let all: Vec<&RunRecord> = records.runs.iter().filter(of).collect();
        let step = all.len().div_ceil(DOTS_MAX).max(1);
        all.into_iter().step_by(step).collect()
    })
}

/// The axis of a drawn value, and what of it the axis shows: its logarithm where the values reach
/// over a decade or so, and are spread over it evenly rather than over the values themselves.
fn drawn_axis(records: &CampaignRecords, parameter: usize) -> (Axis, fn(f64) -> f64) {
    let mut values: Vec<f64> = records
        .runs
        .iter()
        .map(|run| run.drawn[parameter])
        .collect();
    values.sort_by(f64::total_cmp);
    let at = |share| quantile(&values, share).unwrap_or_default();
    let [low, median, high] = [0.0, 0.5, 1.0].map(at);
    let off = |middle: f64| (median - middle).abs();
    let even = || off((low * high).sqrt()) < off(0.5 * (low + high));
    if low > 0.0 && high > 8.0 * low && even() {
        let [low, high] = [low.log10(), high.log10()];
        let margin = 0.03 * (high - low);
        (
            Axis::fine_decades([low - margin, high + margin]),
            f64::log10,
        )
    } else {
        let margin = 0.03 * (high - low);
        (Axis::exact([low - margin, high + margin], 4), |value| value)
    }
}

/// `force error -0.71*`, with a star where it is significant.
fn correlation(what: &str, drivers: &[Driver], parameter: usize) -> Option<String> {
    let driver = drivers
        .iter()
        .find(|driver| driver.parameter == parameter)?;
    Some(format!("{what} {}", correlation_text(driver)))
}

/// A rank correlation with its sign, and a star where it is significant.
pub(in crate::report) fn correlation_text(driver: &Driver) -> String {
    let star = if driver.significant { "*" } else { "" };
    format!("{:+.2}{star}", driver.correlation).replace('-', "\u{2212}")
}

fn draw_scatter(
    area: &Area<'_>,
    records: &CampaignRecords,
    findings: &Findings,
    parameter: usize,
    dots: &[Vec<&RunRecord>; 2],
) -> Drawn {
    let (head, body) = area.split_vertically(units(HEAD));
    let said = [
        correlation("failure", &findings.failure_drivers, parameter),
        correlation("force error", &findings.force_drivers, parameter),
    ];
    let said = said.into_iter().flatten().collect::<Vec<_>>().join(", ");
    let style = text(TEXT, &INK).pos(Pos::new(HPos::Left, VPos::Center));
    head.draw_text(&said, &style, (units(LEFT), units(HEAD - 10.0)))?;

    let (_, end) = span(records, &FORCE_RMS);
    let (across, shown) = drawn_axis(records, parameter);
    let mut up = Axis::exact([0.0, 1.25 * end], 5);
    up.ticks.retain(|tick| *tick <= end);
    let mut chart = chart(&body, [&across, &up])?;
    let key = shortened(&records.parameters[parameter], 46);
    draw_axes(&mut chart, true, [key.as_str(), FORCE_RMS.label])?;
    let [low, high] = across.range;
    chart.draw_series([PathElement::new(
        vec![(low, 1.03 * end), (high, 1.03 * end)],
        line(SOFT, 1.0),
    )])?;
    for (runs, colour) in dots.iter().zip([BLUE, VERMILLION]) {
        chart.draw_series(runs.iter().map(|run| {
            let force = (FORCE_RMS.value)(&run.figures);
            let inside = force <= end && !run.figures.outcome.failed();
            // Spread over the band, so that they do not cover each other.
            let aside = (run.run as f64 * 0.618_033_988_749_894_9).fract();
            let y = if inside {
                force
            } else {
                end * (1.07 + 0.14 * aside)
            };
            let at = (shown(run.drawn[parameter]), y);
            Circle::new(at, units(2.2), colour.mix(0.8).filled())
        }))?;
    }
    Ok(())
}

/// A percentage with three digits.
pub(in crate::report) fn percent(share: f64) -> String {
    format!("{} %", number(100.0 * share))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::record::FIGURES;
    use crate::campaign::record::RunOutcome;
    use crate::campaign::verdict::Limits;
    use crate::report::testing::campaign_records;

    fn figures(records: &CampaignRecords) -> Vec<Figure> {
        let findings = Findings::new(records, &Limits::default());
        campaign_figures(records, &findings).unwrap()
    }

    /// How many elements of this name the figure has in this colour.
    fn count(figure: &Figure, element: &str, colour: &str) -> usize {
        let document = roxmltree::Document::parse(&figure.svg).unwrap();
        let nodes = document.descendants();
        nodes
            .filter(|n| n.has_tag_name(element) || n.tag_name().name() == element)
            .filter(|n| n.attribute("fill") == Some(colour))
            .count()
    }

    #[test]
    fn every_run_is_in_a_bar_and_a_dot() {
        let records = campaign_records(200);
        for quantity in &QUANTITIES {
            let (_, end) = span(&records, quantity);
            let (bins, beyond) = histogram(&records, quantity, end);
            let total =
                |side: usize| -> u32 { bins.iter().chain([&beyond]).map(|b| b[side]).sum() };
            let failed = records
                .runs
                .iter()
                .filter(|r| r.figures.outcome.failed())
                .count();
            assert_eq!([total(0), total(1)], [200 - failed as u32, failed as u32]);
        }
        let drawn = &figures(&records)[1];
        let failed = records
            .runs
            .iter()
            .filter(|r| r.figures.outcome.failed())
            .count();
        let dots = [
            count(drawn, "circle", "#0072B2"),
            count(drawn, "circle", "#D55E00"),
        ];
        assert_eq!(dots, [4 * (200 - failed), 4 * failed]);
    }

    #[test]
    fn the_bar_beyond_has_what_has_no_number() {
        let mut records = campaign_records(100);
        let failed = |f: &RunFigures| f.outcome.failed();
        let count = records.runs.iter().filter(|r| failed(&r.figures)).count() as u32;
        for run in &mut records.runs {
            if failed(&run.figures) {
                run.figures.force_error_rms_n = f64::NAN;
            }
        }
        let (_, end) = span(&records, &FORCE_RMS);
        let (_, beyond) = histogram(&records, &FORCE_RMS, end);
        assert_eq!(beyond[1], count);
    }

    #[test]
    fn figures_are_well_formed_whatever_the_runs_are() {
        let base = campaign_records(30);
        let changed = |change: &dyn Fn(&mut RunRecord)| {
            let mut records = base.clone();
            records.runs.iter_mut().for_each(change);
            records
        };
        let set = |run: &mut RunRecord, outcome, value| {
            run.figures = RunFigures::from_columns(outcome, [value; FIGURES], 0);
        };
        let cases = [
            changed(&|run| set(run, RunOutcome::Completed, 0.0)),
            changed(&|run| set(run, RunOutcome::Completed, 1e300)),
            changed(&|run| set(run, RunOutcome::Diverged, f64::NAN)),
            changed(&|run| set(run, RunOutcome::Diverged, f64::INFINITY)),
            changed(&|run| set(run, RunOutcome::ForceOff, 7.0)),
            changed(&|run| run.drawn.fill(1.0)),
            changed(&|run| run.drawn.fill(if run.run == 3 { -1e-300 } else { 1e300 })),
            CampaignRecords::default(),
        ];
        for (case, records) in cases.iter().enumerate() {
            for figure in figures(records) {
                let document = roxmltree::Document::parse(&figure.svg);
                assert!(document.is_ok(), "{case}: {}", figure.name);
                assert!(!figure.svg.contains("NaN"), "{case}: {}", figure.name);
            }
        }
    }

    #[test]
    fn a_large_campaign_makes_no_large_figure() {
        let records = campaign_records(20_000);
        let figures = figures(&records);
        assert!(figures.iter().all(|figure| figure.svg.len() < 1_500_000));
        assert!(
            figures[1].caption.contains("of 20000 runs"),
            "{}",
            figures[1].caption
        );
    }
}

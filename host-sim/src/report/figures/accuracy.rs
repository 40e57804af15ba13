//! Figures of the number types' accuracy: torque errors against time, and how they are
//! distributed.

use super::axis::Axis;
use super::plot::{
    BLUE, Curve, Figure, GREEN, INK, LEFT, Panel, TITLE, draw_panels, panels_height, render, text,
    units,
};
use crate::analysis::fixed_point::accuracy::Accuracy;
use crate::report::ReportError;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Bins of the histogram a decade.
const BINS: usize = 8;
/// Decades that it shows: log10 of 1 N m.
const DECADES: [f64; 2] = [-10.0, -4.0];

/// A colour a number type.
const COLOURS: [plotters::style::RGBColor; 2] = [BLUE, GREEN];

/// Both figures.
pub(crate) fn accuracy_figures(accuracies: &[Accuracy]) -> Result<Vec<Figure>, ReportError> {
    let times = accuracies.first().map_or([0.0, 1.0], |a| {
        let end = |point: Option<&(f64, [f64; 2])>| point.map_or(0.0, |(t, _)| *t);
        [end(a.trace.first()), end(a.trace.last())]
    });
    let panels = [0, 1].map(|joint| {
        let curves: Vec<Curve> = accuracies
            .iter()
            .zip(COLOURS)
            .map(|(a, colour)| Curve {
                label: a.number.into(),
                colour,
                width: 1.2,
                points: a.trace.iter().map(|(t, e)| [*t, 1e6 * e[joint]]).collect(),
            })
            .collect();
        let axis = Axis::new(
            curves.iter().flat_map(Curve::values),
            0.1,
            [-1000.0, 1000.0],
            5,
        );
        Panel {
            heading: String::new(),
            left: (
                axis,
                format!("torque {} error (\u{b5}N m)", joint + 1),
                curves,
            ),
            right: None,
            shaded: vec![],
        }
    });
    let title = "Torque error against f64, closed loop";
    let time = figure("accuracy_time", title, &panels, times, "time (s)")?;

    let curves: Vec<Curve> = accuracies
        .iter()
        .zip(COLOURS)
        .map(|(a, colour)| Curve {
            label: a.number.into(),
            colour,
            width: 1.8,
            points: histogram(a),
        })
        .collect();
    let axis = Axis::new(curves.iter().flat_map(Curve::values), 1.0, [0.0, 100.0], 5);
    let panels = [Panel {
        heading: String::new(),
        left: (axis, "share of ticks (%)".into(), curves),
        right: None,
        shaded: vec![],
    }];
    let title = "Sizes of the torque errors, both joints";
    let label = "log10 of the error in N m";
    let histogram = figure("accuracy_histogram", title, &panels, DECADES, label)?;
    Ok(vec![
        Figure {
            caption: "Torques of each number type less those of f64, each in closed loop with an arm of its own.".into(),
            ..time
        },
        Figure {
            caption: format!("How many of the torque errors are how large, {BINS} bins a decade. Errors below 1e-10 N m are in the first bin."),
            ..histogram
        },
    ])
}

/// A figure of panels under a title.
fn figure(
    name: &str,
    title: &str,
    panels: &[Panel],
    range: [f64; 2],
    label: &str,
) -> Result<Figure, ReportError> {
    let height = TITLE + panels_height(panels);
    let svg = render(name, height, |area| {
        let (head, body) = area.split_vertically(units(TITLE));
        head.draw_text(
            title,
            &text(14.0, &INK).pos(Pos::new(HPos::Left, VPos::Center)),
            (units(LEFT), units(19.0)),
        )?;
        draw_panels(&body, panels, (range, label), false)
    })?;
    Ok(Figure {
        name: name.into(),
        caption: String::new(),
        svg,
    })
}

/// Outline of the histogram of both joints' errors, percent.
fn histogram(a: &Accuracy) -> Vec<[f64; 2]> {
    let [low, high] = DECADES;
    let bins = ((high - low) * BINS as f64) as usize;
    let mut counts = vec![0_usize; bins];
    let errors: Vec<f64> = a.trace.iter().flat_map(|(_, error)| *error).collect();
    for error in &errors {
        let place = (error.abs().max(1e-300).log10() - low) * BINS as f64;
        counts[(place.max(0.0) as usize).min(bins - 1)] += 1;
    }
    let edge = |bin: usize| low + bin as f64 / BINS as f64;
    let mut outline = vec![[low, 0.0]];
    for (bin, count) in counts.into_iter().enumerate() {
        let share = 100.0 * count as f64 / errors.len().max(1) as f64;
        outline.extend([[edge(bin), share], [edge(bin + 1), share]]);
    }
    outline.push([high, 0.0]);
    outline
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_counts_every_error() {
        let accuracy = Accuracy {
            number: "f32",
            closed_loop: Default::default(),
            force_difference_max_n: 0.0,
            effective_bits: 0.0,
            random: Default::default(),
            adversarial: Default::default(),
            adversarial_f64: Default::default(),
            trace: vec![(0.0, [0.0, 1e-7]), (1.0, [3.0, f64::NAN])],
        };
        let shares: f64 = histogram(&accuracy)
            .chunks_exact(2)
            .map(|pair| pair[1][1])
            .sum();
        assert!((shares - 100.0).abs() < 1e-9);
        assert!(accuracy_figures(&[accuracy]).unwrap().len() == 2);
    }
}

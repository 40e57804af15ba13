//! Curves for the pages' charts: thinned out so that no chart shows the difference, and written as
//! few characters.

use serde::Serialize;

/// Most points of a curve in a page.
const POINTS_MAX: usize = 3000;

/// Share of a curve's spread by which its straight pieces may miss it: a tenth of a pixel of a
/// chart that has been zoomed into once.
const TOLERANCE: f64 = 1e-4;

/// The same where there would be too many points: half a pixel. A curve that needs more is noise, of
/// which the least and greatest values are kept.
const TOLERANCE_MAX: f64 = 3e-3;

/// A curve as the page's script takes it: `x` in steps of `step` from `start`, `y` in steps of
/// `unit`, both as differences from the point before; `null` in `y` begins a gap.
#[derive(Serialize)]
pub(super) struct Series {
    label: String,
    /// How it is drawn: `planned`, or the number of a colour.
    style: &'static str,
    start: f64,
    step: f64,
    unit: f64,
    x: Vec<i64>,
    y: Vec<Option<i64>>,
}

/// A chart: curves of one quantity.
#[derive(Serialize)]
pub(super) struct Panel {
    title: &'static str,
    unit: &'static str,
    /// Least span of the axis of ordinates, and what it does not go beyond.
    span: f64,
    limits: [f64; 2],
    series: Vec<Series>,
}

impl Panel {
    /// A chart without curves yet. Its axis spans at least `span` and stays within `limits`, in
    /// `unit`, however far the curves go.
    pub(super) fn new(
        title: &'static str,
        unit: &'static str,
        span: f64,
        limits: [f64; 2],
    ) -> Self {
        Self {
            title,
            unit,
            span,
            limits,
            series: vec![],
        }
    }

    /// The same with one curve more, of points at multiples of `step` in time.
    pub(super) fn with(
        mut self,
        label: impl Into<String>,
        style: &'static str,
        step: f64,
        points: impl IntoIterator<Item = [f64; 2]>,
    ) -> Self {
        let points: Vec<[f64; 2]> = points.into_iter().collect();
        let series = Series::new(label.into(), style, step, &points, self.limits);
        self.series.push(series);
        self
    }
}

impl Series {
    /// `limits` are what the chart shows; what is beyond them has no say in the curve's accuracy.
    fn new(
        label: String,
        style: &'static str,
        step: f64,
        points: &[[f64; 2]],
        limits: [f64; 2],
    ) -> Self {
        let finite = points
            .iter()
            .filter(|p| p[0].is_finite() && p[1].is_finite());
        let [low, high] = finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
            let y = p[1].clamp(limits[0], limits[1]);
            [low.min(y), high.max(y)]
        });
        let size = low.abs().max(high.abs());
        let spread = if high > low { high - low } else { 0.0 };
        // Below the rounding of what is shown there is nothing to keep.
        let mut tolerance = (TOLERANCE * spread).max(1e-7 * size).max(1e-12);
        let mut kept = thinned(points, tolerance);
        while kept.len() > POINTS_MAX && tolerance < TOLERANCE_MAX * spread {
            tolerance *= 1.5;
            kept = thinned(points, tolerance);
        }
        if kept.len() > POINTS_MAX {
            kept = envelope(points, POINTS_MAX);
        }
        let unit = 10f64.powf((0.5 * tolerance).log10().floor());
        let start = points.first().map_or(0.0, |p| p[0]);
        let mut series = Self {
            label,
            style,
            start,
            step,
            unit,
            x: Vec::with_capacity(kept.len()),
            y: Vec::with_capacity(kept.len()),
        };
        let mut before = [0_i64; 2];
        for index in kept {
            let [x, y] = points[index];
            // Conversions to integers saturate.
            let at = ((x - start) / step).round() as i64;
            series.x.push(at - before[0]);
            before[0] = at;
            if y.is_finite() {
                let value = (y / unit).round().clamp(-1e15, 1e15) as i64;
                series.y.push(Some(value - before[1]));
                before[1] = value;
            } else {
                series.y.push(None);
            }
        }
        series
    }
}

/// Indices of at most `most` of `points` that keep the least and the greatest value of every stretch,
/// and of a stretch with a value that is not finite that one, for the gap.
fn envelope(points: &[[f64; 2]], most: usize) -> Vec<usize> {
    // First, least, greatest, last, and one that is not finite.
    let stretch = points.len().div_ceil((most / 5).max(1));
    let mut kept = vec![];
    for from in (0..points.len()).step_by(stretch) {
        let indices = || from..(from + stretch).min(points.len());
        let finite = |i: &usize| points[*i].iter().all(|x| x.is_finite());
        let by = |a: &usize, b: &usize| points[*a][1].total_cmp(&points[*b][1]);
        let mut of_stretch: Vec<usize> = [
            indices().find(finite),
            indices().filter(finite).min_by(by),
            indices().filter(finite).max_by(by),
            indices().rev().find(finite),
            indices().find(|i| points[*i][0].is_finite() && !finite(i)),
        ]
        .into_iter()
        .flatten()
        .collect();
        of_stretch.sort_unstable();
        of_stretch.dedup();
        kept.extend(of_stretch);
    }
    kept
}

/// Indices of those of `points`, rising in time, whose straight connections miss none of the others
/// by more than `tolerance`. Of a stretch without a finite value the first is kept, for the gap.
fn thinned(points: &[[f64; 2]], tolerance: f64) -> Vec<usize> {
    let mut kept: Vec<usize> = vec![];
    // The last point on the straight piece so far, and the slopes from its start that miss none
    // by more than the tolerance.
    let mut last: Option<usize> = None;
    let mut slopes = [f64::NEG_INFINITY, f64::INFINITY];
    for (i, point) in points.iter().enumerate() {
        if !point[0].is_finite() {
            continue;
        }
        if !point[1].is_finite() {
            kept.extend(last.take());
            if kept.last().is_some_and(|k| points[*k][1].is_finite()) {
                kept.push(i);
            }
            slopes = [f64::NEG_INFINITY, f64::INFINITY];
            continue;
        }
        let anchor = kept.last().filter(|k| points[**k][1].is_finite());
        let Some(mut anchor) = anchor.copied() else {
            kept.push(i);
            continue;
        };
        let slope = |anchor: usize, off: f64| {
            (point[1] + off - points[anchor][1]) / (point[0] - points[anchor][0])
        };
        if let Some(end) = last
            && !(slopes[0]..=slopes[1]).contains(&slope(anchor, 0.0))
        {
            kept.push(end);
            anchor = end;
            slopes = [f64::NEG_INFINITY, f64::INFINITY];
        }
        slopes = [
            slopes[0].max(slope(anchor, -tolerance)),
            slopes[1].min(slope(anchor, tolerance)),
        ];
        last = Some(i);
    }
    kept.extend(last);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The points of a series, as the page's script makes them.
    fn points(series: &Series) -> Vec<[f64; 2]> {
        let (mut x, mut y) = (0, 0);
        let pairs = series.x.iter().zip(&series.y);
        pairs
            .map(|(dx, dy)| {
                x += dx;
                let value = dy.map_or(f64::NAN, |dy| {
                    y += dy;
                    y as f64 * series.unit
                });
                [series.start + x as f64 * series.step, value]
            })
            .collect()
    }

    /// The value at `t` of a curve of straight pieces.
    fn at(points: &[[f64; 2]], t: f64) -> f64 {
        let next = points.iter().position(|p| p[0] >= t - 1e-9).unwrap();
        let [x1, y1] = points[next];
        if next == 0 || (x1 - t).abs() < 1e-9 {
            return y1;
        }
        let [x0, y0] = points[next - 1];
        y0 + (y1 - y0) * (t - x0) / (x1 - x0)
    }

    proptest! {
        #[test]
        fn a_thinned_curve_misses_no_point_by_more_than_is_seen(
            values in proptest::collection::vec(-3.0..3.0_f64, 2..400), smooth in 0.0..0.999_f64
        ) {
            let mut y = 0.0;
            let samples: Vec<[f64; 2]> = values
                .iter()
                .enumerate()
                .map(|(i, v)| {
                    y = smooth * y + (1.0 - smooth) * v;
                    [0.002 * i as f64 - 0.1, y]
                })
                .collect();
            let series = Series::new("a".into(), "0", 0.002, &samples, [-9.0, 9.0]);
            let curve = points(&series);
            let values = || samples.iter().map(|p| p[1]);
            let spread = values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min);
            for [t, value] in &samples {
                let off = (at(&curve, *t) - value).abs();
                prop_assert!(off <= 2.0 * TOLERANCE * spread + 1e-6, "{off} at {t}");
            }
        }
    }

    #[test]
    fn smooth_curves_are_few_points_and_noise_is_not_too_many() {
        let sampled = |f: &dyn Fn(usize) -> f64| -> Vec<[f64; 2]> {
            (0..50_000).map(|i| [2e-4 * i as f64, f(i)]).collect()
        };
        let count = |f: &dyn Fn(usize) -> f64| {
            let series = Series::new("a".into(), "0", 2e-4, &sampled(f), [-1e9, 1e9]);
            series.x.len()
        };
        assert_eq!(count(&|_| 2.0), 2);
        assert!(count(&|i| (1e-3 * i as f64).sin()) < 1000);
        let noise = |i: usize| ((i * 7919) % 1009) as f64;
        assert!(count(&noise) <= POINTS_MAX);
        // Counts of a converter about a slow curve: never off by more than the count.
        let counts = |i: usize| (0.3 + 0.1 * (1e-4 * i as f64).sin()) + 0.01 * (i % 2) as f64;
        let samples = sampled(&counts);
        let series = Series::new("a".into(), "0", 2e-4, &samples, [-1e9, 1e9]);
        assert!(series.x.len() <= POINTS_MAX);
        let curve = points(&series);
        for [t, value] in samples.iter().step_by(97) {
            let off = (at(&curve, *t) - value).abs();
            assert!(off <= 0.0111, "{off} at {t}");
        }
    }

    #[test]
    fn what_is_not_finite_is_a_gap() {
        let y = [1.0, f64::NAN, f64::INFINITY, 2.0, 1e300, f64::NAN];
        let samples: Vec<[f64; 2]> = (0..6).map(|i| [i as f64, y[i]]).collect();
        let series = Series::new("a".into(), "0", 1.0, &samples, [-9.0, 9.0]);
        let gaps: Vec<bool> = series.y.iter().map(Option::is_none).collect();
        assert_eq!(gaps, [false, true, false, false, true]);
        assert!(
            Series::new("a".into(), "0", 1.0, &[], [0.0; 2])
                .x
                .is_empty()
        );
    }
}

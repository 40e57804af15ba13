//! Axes and the numbers along them: ranges, ticks and labels; curves cut and thinned out for
//! them.

pub(in crate::report) use crate::text::three_digits as number;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// At most `points_max` (4 or more) of `points` that keep the least and the greatest
/// value of every stretch. Samples that are not finite are left out; a stretch without
/// any other is a gap, so the result is pieces.
pub(in crate::report) fn decimate(points: &[[f64; 2]], points_max: usize) -> Vec<Vec<[f64; 2]>> {
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
pub(super) fn clip(points: &[[f64; 2]], range: [f64; 2]) -> Vec<Vec<(f64, f64)>> {
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
pub(in crate::report) struct Axis {
    /// Least and greatest value shown.
    pub(in crate::report) range: [f64; 2],
    /// Where the ticks are.
    pub(super) ticks: Vec<f64>,
    /// Decimals of their labels.
    decimals: usize,
    /// Least and greatest value of the data where they are not shown.
    pub(in crate::report) cut: Option<[f64; 2]>,
    /// Whether values are decimal logarithms of what the labels say.
    logarithmic: bool,
}

impl Axis {
    /// An axis for `values` (those that are not finite are passed over) that spans at
    /// least `span`, so that rounding errors of a constant do not fill the figure, and
    /// stays within `limits`, so that a diverging signal does not hide everything else.
    pub(in crate::report) fn new(
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
    pub(super) fn exact(range: [f64; 2], ticks: usize) -> Self {
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
    pub(super) fn decades(range: [f64; 2]) -> Self {
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

    /// As [`decades`](Self::decades), with ticks at 1, 2 and 5 times the powers of ten where there
    /// are few of these.
    #[cfg(feature = "campaign")]
    pub(super) fn fine_decades(range: [f64; 2]) -> Self {
        let mut axis = Self::decades(range);
        if axis.ticks.len() < 3 {
            let decades = range[0].floor() as i32..=range[1].floor() as i32;
            let steps = decades.flat_map(|decade| [1.0, 2.0, 5.0_f64].map(|m| (m, decade)));
            let ticks = steps.map(|(m, decade)| m.log10() + f64::from(decade));
            axis.ticks = ticks.filter(|t| range[0] <= *t && *t <= range[1]).collect();
        }
        axis
    }

    /// The same, with the least value where the greatest was.
    pub(super) fn reversed(mut self) -> Self {
        self.range.reverse();
        self
    }

    /// The same, without a word on values beyond its range.
    pub(super) fn without_cut(mut self) -> Self {
        self.cut = None;
        self
    }

    fn label(&self, value: f64) -> String {
        if self.logarithmic {
            let decimals = (-value - 1e-6).ceil().max(0.0) as usize;
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

#[cfg(test)]
mod tests {
    use super::super::cases::force_axis;
    use super::*;
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

    #[cfg(feature = "campaign")]
    #[test]
    fn logarithmic_axes_are_labelled_with_the_values() {
        let labels = |axis: &Axis| -> Vec<String> {
            axis.ticks.iter().map(|tick| axis.label(*tick)).collect()
        };
        let range = |low: f64, high: f64| [low.log10(), high.log10()];
        let inertia = Axis::fine_decades(range(2.9e-5, 3.1e-4));
        assert_eq!(labels(&inertia), ["0.00005", "0.0001", "0.0002"]);
        let stiffness = Axis::fine_decades(range(1.9e3, 5.1e4));
        assert_eq!(
            labels(&stiffness),
            ["2000", "5000", "10000", "20000", "50000"]
        );
        let wide = range(0.009, 110.0);
        assert_eq!(
            labels(&Axis::fine_decades(wide)),
            ["0.01", "0.1", "1", "10", "100"]
        );
        assert_eq!(Axis::fine_decades(wide), Axis::decades(wide));
    }
}

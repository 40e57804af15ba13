//! How a number of a scenario is spread over the runs.

use crate::plant::bench::RandomStream;

/// A number, or how it is spread.
#[derive(Clone, Debug, PartialEq)]
pub enum Distribution {
    /// The same in every run.
    Fixed(f64),
    /// Evenly between two bounds.
    Uniform([f64; 2]),
    /// Its logarithm evenly between those of two positive bounds.
    LogUniform([f64; 2]),
    /// Bell-shaped about a mean with a standard deviation, and never farther off than
    /// [`CUT`] of them.
    Normal([f64; 2]),
    /// One of these, each as often.
    Choice(Vec<f64>),
}

/// Standard deviations beyond which a normal draw is drawn again: a part that is farther off than
/// that is faulty, not spread.
pub const CUT: f64 = 3.0;

impl Distribution {
    /// True where runs differ.
    pub fn is_spread(&self) -> bool {
        !matches!(self, Self::Fixed(_))
    }

    /// Its middle: what a single run takes. The median of the continuous ones, the first choice.
    pub fn middle(&self) -> f64 {
        match self {
            Self::Fixed(value) => *value,
            Self::Uniform([low, high]) => 0.5 * (low + high),
            Self::LogUniform([low, high]) => (low * high).sqrt(),
            Self::Normal([mean, _]) => *mean,
            Self::Choice(values) => values.first().copied().unwrap_or_default(),
        }
    }

    /// The smallest and the largest value that it gives.
    pub fn bounds(&self) -> [f64; 2] {
        match self {
            Self::Fixed(value) => [*value; 2],
            Self::Uniform(bounds) | Self::LogUniform(bounds) => *bounds,
            Self::Normal([mean, deviation]) => [mean - CUT * deviation, mean + CUT * deviation],
            Self::Choice(values) => values
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
                    [low.min(*value), high.max(*value)]
                }),
        }
    }

    /// A value, drawn from `random`.
    pub fn draw(&self, random: &mut RandomStream) -> f64 {
        match self {
            Self::Fixed(value) => *value,
            Self::Uniform([low, high]) => low + (high - low) * random.uniform(),
            Self::LogUniform([low, high]) => {
                let drawn = low * libm::exp(libm::log(high / low) * random.uniform());
                // Rounding must not leave the bounds.
                drawn.clamp(*low, *high)
            }
            Self::Normal([mean, deviation]) => mean + deviation * cut_normal(random),
            Self::Choice(values) => {
                let drawn = (random.uniform() * values.len() as f64) as usize;
                values.get(drawn).copied().unwrap_or_default()
            }
        }
    }
}

/// A normally distributed number (Box and Muller) of those within [`CUT`].
fn cut_normal(random: &mut RandomStream) -> f64 {
    loop {
        // One of 370 is drawn again.
        let radius = (-2.0 * libm::log(1.0 - random.uniform())).sqrt();
        let drawn = radius * libm::cos(core::f64::consts::TAU * random.uniform());
        if drawn.abs() <= CUT {
            return drawn;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(distribution: &Distribution) -> Vec<f64> {
        let mut random = RandomStream::new(3, 0);
        (0..40_000)
            .map(|_| distribution.draw(&mut random))
            .collect()
    }

    /// Share of the values below `x`.
    fn below(values: &[f64], x: f64) -> f64 {
        values.iter().filter(|value| **value < x).count() as f64 / values.len() as f64
    }

    #[test]
    fn each_has_its_quantiles_its_bounds_and_its_middle() {
        // Quantiles of the distributions at 1/4, 1/2, 3/4; those of the normal one from tables.
        let cases = [
            (Distribution::Uniform([2.0, 6.0]), [3.0, 4.0, 5.0]),
            (Distribution::LogUniform([1e-4, 1.0]), [1e-3, 1e-2, 1e-1]),
            (Distribution::Normal([5.0, 2.0]), [3.651, 5.0, 6.349]),
        ];
        for (distribution, quartiles) in cases {
            let values = drawn(&distribution);
            for (quartile, share) in quartiles.into_iter().zip([0.25, 0.5, 0.75]) {
                let found = below(&values, quartile);
                assert!((found - share).abs() < 0.01, "{distribution:?} {found}");
            }
            let [low, high] = distribution.bounds();
            assert!(values.iter().all(|x| (low..=high).contains(x)));
            let extremes = values
                .iter()
                .fold([high, low], |[a, b], x| [a.min(*x), b.max(*x)]);
            assert!(
                extremes[0] - low < 0.1 * (high - low) && high - extremes[1] < 0.1 * (high - low)
            );
            assert!((below(&values, distribution.middle()) - 0.5).abs() < 0.01);
            assert!(distribution.is_spread());
        }
        let choice = Distribution::Choice(vec![3.0, -1.0, 7.0]);
        let values = drawn(&choice);
        for value in [3.0, -1.0, 7.0] {
            let share = values.iter().filter(|x| **x == value).count() as f64 / values.len() as f64;
            assert!((share - 1.0 / 3.0).abs() < 0.01, "{value} {share}");
        }
        assert_eq!((choice.middle(), choice.bounds()), (3.0, [-1.0, 7.0]));
        assert!(!Distribution::Fixed(2.0).is_spread());
    }
}

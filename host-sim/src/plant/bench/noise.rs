//! Noise that repeats: a seeded generator for each disturbance.

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{RngCore, SeedableRng};

/// A sequence of random numbers that its seed and stream determine.
///
/// Every source of noise has a stream of its own, so that switching one off leaves the
/// others' numbers as they were.
#[derive(Clone, Debug)]
pub struct RandomStream(Xoshiro256PlusPlus);

impl RandomStream {
    /// The numbered `stream` of `seed`.
    pub fn new(seed: u64, stream: u64) -> Self {
        // The generator's own seeding (SplitMix64) decorrelates neighbouring numbers.
        Self(Xoshiro256PlusPlus::seed_from_u64(
            seed ^ stream.wrapping_mul(0x9e37_79b9_7f4a_7c15),
        ))
    }

    /// Uniform in [0, 1), of 53 random bits.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Mean 0 and variance 1, bell-shaped and within +-3.47: the sum of four uniform numbers
    /// (Irwin and Hall), because no amplifier's noise is unbounded.
    pub fn bell(&mut self) -> f64 {
        let sum: f64 = (0..4).map(|_| self.uniform()).sum();
        (sum - 2.0) * SQRT_3
    }
}

/// The reciprocal of the standard deviation of a sum of four uniform numbers.
const SQRT_3: f64 = 1.732_050_807_568_877_2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_has_unit_variance_and_repeats() {
        let count = 100_000;
        let draw = |seed, stream| {
            let mut noise = RandomStream::new(seed, stream);
            (0..count).map(|_| noise.bell()).collect::<Vec<_>>()
        };
        let first = draw(7, 0);
        assert_eq!(first, draw(7, 0));
        let mean = first.iter().sum::<f64>() / f64::from(count);
        let variance = first.iter().map(|x| x * x).sum::<f64>() / f64::from(count);
        assert!(mean.abs() < 0.012 && (variance - 1.0).abs() < 0.015);
        assert!(first.iter().all(|x| x.abs() < 3.47));
        // Streams and seeds are independent.
        for other in [draw(7, 1), draw(8, 0)] {
            let product: f64 = first.iter().zip(&other).map(|(a, b)| a * b).sum();
            assert!((product / f64::from(count)).abs() < 0.012);
        }
    }
}

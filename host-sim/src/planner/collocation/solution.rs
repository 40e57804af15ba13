//! The solution as polynomials, one an interval, with an estimate of its error.

use crate::model::gauss::COEFFICIENTS;
use nalgebra::DVector;

/// A piecewise polynomial solution.
#[derive(Clone, Debug)]
pub struct Solution {
    pub(super) size: usize,
    pub(super) mesh: Vec<f64>,
    /// Per interval and function, coefficients of `x^0 ... x^7`, with `x` from 0 to 1
    /// over the interval.
    pub(super) polynomials: Vec<[f64; COEFFICIENTS]>,
    /// Newton iterations over all meshes.
    pub iterations: usize,
}

impl Solution {
    /// Mesh points, ascending.
    pub fn mesh(&self) -> &[f64] {
        &self.mesh
    }

    /// Interval that holds `t`; the first or last one outside the mesh. `hint` is
    /// where to look first.
    pub fn interval(&self, t: f64, hint: usize) -> usize {
        let last = self.mesh.len() - 2;
        let mut i = hint.min(last);
        if self.mesh[i] <= t {
            // Usually called with t ascending: one or two steps at most.
            while i < last && self.mesh[i + 1] <= t {
                i += 1;
            }
            i
        } else {
            self.mesh
                .partition_point(|m| *m <= t)
                .saturating_sub(1)
                .min(last)
        }
    }

    /// `q`, its rate and its second derivative at `t`, within `interval` or
    /// extrapolated from there.
    pub fn evaluate(
        &self,
        t: f64,
        interval: usize,
        q: &mut [f64],
        rate: &mut [f64],
        acceleration: &mut [f64],
    ) {
        let h = self.mesh[interval + 1] - self.mesh[interval];
        let x = (t - self.mesh[interval]) / h;
        let polynomials = &self.polynomials[interval * self.size..][..self.size];
        for (k, c) in polynomials.iter().enumerate() {
            // Horner's scheme for the value and, divided by 1! and 2!, its derivatives.
            let (mut value, mut first, mut second) = (0.0, 0.0, 0.0);
            for c in c.iter().rev() {
                second = second * x + first;
                first = first * x + value;
                value = value * x + c;
            }
            q[k] = value;
            rate[k] = first / h;
            acceleration[k] = 2.0 * second / (h * h);
        }
    }

    /// The solution for `units q`, entry by entry, instead of `q`.
    pub fn scaled(mut self, units: &DVector<f64>) -> Self {
        for polynomials in self.polynomials.chunks_exact_mut(self.size) {
            for (polynomial, unit) in polynomials.iter_mut().zip(units) {
                *polynomial = polynomial.map(|c| c * unit);
            }
        }
        self
    }

    /// The same over a time of which its own is in units of `unit_s`, s.
    pub fn in_time(mut self, unit_s: f64) -> Self {
        self.mesh.iter_mut().for_each(|t| *t *= unit_s);
        self
    }

    /// Largest estimated error of `q` over all intervals, by the given norm.
    pub fn error_estimate(&self, norm: impl Fn(&[f64]) -> f64) -> f64 {
        (0..self.mesh.len() - 1)
            .map(|interval| norm(&self.errors(interval).0))
            .fold(0.0, f64::max)
    }

    /// Estimated errors of `q` and of its second derivative in an interval.
    ///
    /// The second derivative is a sum of Legendre polynomials up to the fifth. What is
    /// left out begins with a sixth, to which the last two pairs of coefficients are
    /// continued (pairs, as single ones may vanish by symmetry). Integrated twice, and
    /// with what the neighbours add, `h^2 / 12` of it is no underestimate: the tests
    /// compare.
    pub(super) fn errors(&self, interval: usize) -> (Vec<f64>, Vec<f64>) {
        let h = self.mesh[interval + 1] - self.mesh[interval];
        let polynomials = &self.polynomials[interval * self.size..][..self.size];
        let second: Vec<f64> = polynomials
            .iter()
            .map(|c| {
                // Powers x^2 to x^5 of the second derivative, then Legendre coefficients:
                // 252 x^5 - 630 x^4 + 560 x^3 - 210 x^2, 70 x^4 - 140 x^3 + 90 x^2,
                // 20 x^3 - 30 x^2, 6 x^2.
                let [a2, a3, a4, a5] =
                    [4, 5, 6, 7].map(|k: usize| (k * (k - 1)) as f64 * c[k] / (h * h));
                let l5 = a5 / 252.0;
                let l4 = (a4 + 630.0 * l5) / 70.0;
                let l3 = (a3 - 560.0 * l5 + 140.0 * l4) / 20.0;
                let l2 = (a2 + 210.0 * l5 - 90.0 * l4 + 30.0 * l3) / 6.0;
                let (last, before) = (l5.abs().max(l4.abs()), l3.abs().max(l2.abs()));
                if last < before {
                    last * (last / before)
                } else {
                    last
                }
            })
            .collect();
        (second.iter().map(|a| a * h * h / 12.0).collect(), second)
    }
}

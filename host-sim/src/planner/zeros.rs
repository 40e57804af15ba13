//! Zeros: the growth rates of the deflection for a prescribed tip, at rest. They tell how long the link
//! has to bend before and after a motion, and which of its deflections may be there then: before it only
//! what grows into it, after it only what decays.
//!
//! Glossary: *unstable subspace*: the deflections and rates that grow; *matrix sign*: the matrix with the
//! same invariant subspaces whose eigenvalues are 1 for growth and -1 for decay.

use crate::planner::task::{PlanError, Window};
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix, DVector};

/// The linearised problem at rest, `y' = Y y` with `y` the deflection's distance from rest and its rate.
///
/// What is computed with is the inverse of Y, whose invariant subspaces are the same and whose eigenvalues
/// have the same signs: the matrix of accelerations is as good as singular with many elements, that of
/// deflections never. With a heavy hub and modal damping one zero is at -2e9 1/s beside one of 40, which
/// rounding would take the sign of.
pub(super) struct RestZeros {
    /// Y's inverse, balanced: `D^-1 Y^-1 D`.
    inverse: DMatrix<f64>,
    /// D.
    balance: DVector<f64>,
    /// Growth rates, 1/s.
    zeros: Vec<Complex<f64>>,
}

impl RestZeros {
    /// From the derivatives of `G(q, q', q'')` by the three, times in units of `unit_s`, s. `None` where
    /// the first is singular.
    pub(super) fn new(
        [by_q, by_rate, by_acceleration]: &[DMatrix<f64>; 3],
        unit_s: f64,
    ) -> Option<Self> {
        let n = by_q.nrows();
        let stiffness = by_q.clone().lu();
        let mut inverse = DMatrix::zeros(2 * n, 2 * n);
        for i in 0..n {
            inverse[(n + i, i)] = 1.0;
        }
        for (matrix, column) in [(by_rate, 0), (by_acceleration, n)] {
            let solved = -stiffness.solve(matrix)?;
            inverse.view_mut((0, column), (n, n)).copy_from(&solved);
        }
        // It would not end for infinite numbers.
        if !inverse.iter().all(|x| x.is_finite()) {
            return None;
        }
        // Shares and radians, and rates of 1/s to 1e9 1/s, side by side: unbalanced, what the largest
        // zeros lose by rounding would depend on the units.
        let balance = balance_parlett_reinsch(&mut inverse);
        let periods = inverse.complex_eigenvalues();
        Some(Self {
            zeros: periods
                .iter()
                .map(|period| (period * unit_s).inv())
                .collect(),
            inverse,
            balance,
        })
    }

    /// The slowest zeros, 1/s: `[growing, decaying]`, infinite where there is none of that sign.
    pub(super) fn slowest(&self) -> [f64; 2] {
        let slowest = |sign: f64| {
            let rates = self.zeros.iter().map(|zero| sign * zero.re);
            rates
                .filter(|rate| *rate > 0.0)
                .fold(f64::INFINITY, f64::min)
        };
        [slowest(1.0), -slowest(-1.0)]
    }

    /// How many grow.
    pub(super) fn growing(&self) -> usize {
        self.zeros.iter().filter(|zero| zero.re > 0.0).count()
    }

    /// How many decay.
    pub(super) fn decaying(&self) -> usize {
        self.zeros.len() - self.growing()
    }

    /// Magnitude of the fastest zero, 1/s.
    pub(super) fn fastest(&self) -> f64 {
        let sizes = self.zeros.iter().map(|zero| libm::hypot(zero.re, zero.im));
        sizes.fold(0.0, f64::max)
    }

    /// Angular frequency of the fastest vibration, rad/s: of a zero that swings, and decays or grows
    /// without one that does the opposite, as a tip inertia makes them; 0 where there is none.
    pub(super) fn swing(&self) -> f64 {
        /// A vibration's zero is so much farther from the real axis than from the other.
        const RATIO: f64 = 2.0;
        /// Share of its size within which it has a counterpart.
        const NEAR: f64 = 0.3;
        let distance = |a: &Complex<f64>, b: &Complex<f64>| libm::hypot(a.re + b.re, a.im - b.im);
        let alone = |zero: &&Complex<f64>| {
            let near = NEAR * libm::hypot(zero.re, zero.im);
            zero.im > RATIO * zero.re.abs()
                && !self
                    .zeros
                    .iter()
                    .any(|other| other.re * zero.re < 0.0 && distance(zero, other) < near)
        };
        if self.growing() == self.decaying() {
            return 0.0;
        }
        let swinging = self.zeros.iter().filter(alone).map(|zero| zero.im);
        swinging.fold(0.0, f64::max)
    }

    /// Conditions on `y`, one a row, that leave only what grows, or only what decays: an orthonormal basis
    /// of the left invariant subspace of the others, in balanced coordinates. `None` where zeros neither
    /// grow nor decay.
    pub(super) fn conditions(&self, grows: bool) -> Option<DMatrix<f64>> {
        let size = self.inverse.nrows();
        let sign = matrix_sign(&self.inverse)?;
        let side = if grows { -0.5 } else { 0.5 };
        let projector = DMatrix::identity(size, size) * 0.5 + sign * side;
        let rank = if grows {
            self.decaying()
        } else {
            self.growing()
        };
        let trace: f64 = projector.trace();
        if !((trace - rank as f64).abs() < 0.1) {
            return None;
        }
        let basis = projector.transpose().col_piv_qr().q();
        let mut rows = basis.columns(0, rank).transpose();
        for (mut column, scale) in rows.column_iter_mut().zip(&self.balance) {
            column /= *scale;
        }
        Some(rows)
    }

    /// Length of a window, s: until the slowest growing zero has grown, `before` the motion, or the
    /// slowest decaying one has decayed, after it.
    ///
    /// # Errors
    /// [`PlanError::NoWindow`] where no zero of that sign does so within `longest_s`.
    pub(super) fn window_length(
        &self,
        window: Window,
        before: bool,
        longest_s: f64,
    ) -> Result<f64, PlanError> {
        match window {
            Window::Fixed(seconds) => Ok(seconds),
            Window::Auto { tolerance } => {
                let [growing, decaying] = self.slowest();
                let rate_per_s = if before { growing } else { -decaying };
                let seconds = -libm::log(tolerance) / rate_per_s;
                // Infinite where no zero has that sign.
                if rate_per_s.is_finite() && seconds <= longest_s {
                    Ok(seconds)
                } else {
                    let what = if before {
                        "pre_actuation_s"
                    } else {
                        "post_actuation_s"
                    };
                    Err(PlanError::NoWindow { what, rate_per_s })
                }
            }
        }
    }
}

/// The matrix sign by Newton's iteration `X -> (mu X + (mu X)^-1) / 2`, mu from the determinant. `None`
/// where an eigenvalue is on the imaginary axis, or nearly.
fn matrix_sign(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    /// Some 12 suffice for eigenvalues a thousandfold apart.
    const STEPS_MAX: usize = 60;
    let size = matrix.nrows() as f64;
    let mut x = matrix.clone();
    let mut settled = false;
    for _ in 0..STEPS_MAX {
        let lu = x.clone().lu();
        let diagonal = lu.u().diagonal();
        let log_of_determinant: f64 = diagonal.iter().map(|d| libm::log(d.abs())).sum();
        let inverse = lu.try_inverse()?;
        let scale = if settled {
            1.0
        } else {
            libm::exp(-log_of_determinant / size)
        };
        let next = (&x * scale + inverse / scale) * 0.5;
        if !next.iter().all(|x| x.is_finite()) {
            return None;
        }
        let change = (&next - &x).norm() / next.norm();
        x = next;
        if settled && change < 1e-12 {
            return Some(x);
        }
        settled = settled || change < 1e-2;
    }
    // Rounding may keep it from the last digits.
    let defect = (&x * &x - DMatrix::identity(x.nrows(), x.ncols())).norm() / x.norm();
    (defect < 1e-6).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// y' = Y y of a second-order system with known zeros: every solution that a condition leaves
        /// grows, or decays.
        #[test]
        fn conditions_leave_what_grows_or_what_decays(
            rates in proptest::array::uniform6(1.0..300.0_f64),
            mix in proptest::array::uniform9(-1.0..1.0_f64),
            signs in proptest::array::uniform6(proptest::bool::ANY),
        ) {
            let rates: Vec<f64> = rates.iter().zip(signs).map(|(r, s)| if s { *r } else { -*r }).collect();
            // q'' - diag(a + b) q' + diag(a b) q = 0 in mixed coordinates q = T z.
            let t = DMatrix::from_row_slice(3, 3, &mix) * 0.4 + DMatrix::identity(3, 3);
            let t_inverse = t.clone().try_inverse().unwrap();
            let diagonal = |f: &dyn Fn(f64, f64) -> f64| {
                let values = (0..3).map(|i| f(rates[2 * i], rates[2 * i + 1]));
                DMatrix::from_diagonal(&DVector::from_iterator(3, values))
            };
            let by_q = diagonal(&|a, b| a * b) * &t_inverse;
            let by_rate = diagonal(&|a, b| -(a + b)) * &t_inverse;
            let distinct = (0..3).all(|i| (rates[2 * i] - rates[2 * i + 1]).abs() > 1.0);
            prop_assume!(distinct);
            let zeros = RestZeros::new(&[by_q, by_rate, t_inverse], 1.0).unwrap();
            let growing = rates.iter().filter(|r| **r > 0.0).count();
            prop_assert_eq!(zeros.growing(), growing);
            for grows in [true, false] {
                let rows = zeros.conditions(grows).unwrap();
                prop_assert_eq!(rows.nrows(), if grows { 6 - growing } else { growing });
                for (i, rate) in rates.iter().enumerate() {
                    let shape = t.column(i / 2);
                    let y = DVector::from_fn(6, |k, _| if k < 3 { shape[k] } else { rate * shape[k - 3] });
                    let left = (&rows * &y).norm() / (y.norm() * rows.norm().max(1e-3));
                    prop_assert!(((*rate > 0.0) != grows) || left < 1e-7, "{left:e}");
                }
            }
        }
    }
}

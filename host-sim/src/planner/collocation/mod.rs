//! Boundary-value problems `A q'' = f(t, q, q')` with Dirichlet ends, by collocation at
//! six Gauss points an interval.
//!
//! The planner's problem has solutions that grow and decay over many orders of
//! magnitude; no initial-value method survives them. Its fastest rates, 3e4 1/s with
//! 12 elements, leave layers at the ends that are far thinner than the mesh that the
//! motion itself needs, and its matrix `A` is nearly singular (its determinant is
//! 2e-5 for 12 elements, its condition number 1e9). So:
//!
//! - **In an interval** the unknowns are the second derivatives at the Gauss points;
//!   `q` and its rate follow from those at the interval's left end by integration.
//!   The second derivatives, from which torques come, so keep their own accuracy
//!   instead of being differences of `q`. They are eliminated.
//! - **Over the mesh** what is left is a chain of linear relations between `q` and rate
//!   at neighbouring mesh points, with half of the conditions at either end. It is
//!   eliminated forwards, with pivoting over the conditions carried along and the
//!   relation that follows: growing and decaying parts are told apart by the pivots.
//! - **Newton's method** solves for corrections, whose right-hand sides are the
//!   equation's residuals. That meets the nonlinearity, and refines the linear
//!   algebra: what the condition number has cost in one step is regained in the next.
//! - The result is of order 12 at mesh points, 8 between them and 6 in the second
//!   derivative. Against a solution with 113 bits it has errors of 3e-12 rad and
//!   2e-8 N m for 12 elements when nothing is left but rounding.
//! - **The mesh** is refined where the expansion of the second derivative in Legendre
//!   polynomials has not faded.

mod elimination;
mod gauss;
mod mesh;
mod newton;
mod solution;

pub use solution::Solution;

use mesh::{halve, refine};
use nalgebra::DMatrix;
use newton::Solver;

/// Unknown functions times intervals beyond which refinement stops: what still looks
/// inaccurate then is rounding. A motion needs some fifty intervals, whatever its
/// duration; fast ones with thin layers at their ends, of 24 functions, have needed 435.
const UNKNOWNS_MAX: usize = 20_000;

/// Meshes, each twice as fine as that before, on which Newton's method may start anew.
const RETRIES_MAX: usize = 2;

/// Newton iterations on a mesh before giving up.
const ITERATIONS_MAX: usize = 20;

/// Changes, as multiples of the tolerated error, that are put down to rounding when
/// Newton's method has stopped converging.
const ROUNDING_MAX: f64 = 1e3;

/// A second-order system with a constant, invertible matrix on its highest derivative.
pub trait Problem {
    /// Number `n` of unknown functions.
    fn functions(&self) -> usize;

    /// The matrix `A`, n x n.
    fn mass(&self) -> &DMatrix<f64>;

    /// `f` at `t` for `q` and its rate (n entries each), into `value`, and its
    /// derivatives by both, into n x n matrices (their former content is overwritten).
    fn linearise(
        &self,
        t: f64,
        q: &[f64],
        rate: &[f64],
        value: &mut [f64],
        by_q: &mut DMatrix<f64>,
        by_rate: &mut DMatrix<f64>,
    );

    /// Size of an error of `q` and one of `q''`, as multiples of what is tolerated.
    fn size(&self, q: &[f64], acceleration: &[f64]) -> f64;

    /// Length of the shortest interval worth having, s. In shorter ones there is
    /// nothing left to resolve, and what looks like an error is rounding.
    fn resolution(&self) -> f64;
}

/// Why no solution was found.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CollocationError {
    /// Newton's method ran away or came to no end.
    #[error("the boundary-value problem did not converge within {ITERATIONS_MAX} iterations")]
    Diverged,
    /// A linear system was singular.
    #[error("the boundary-value problem is singular near t = {t_s:.6} s")]
    Singular {
        /// Where, s.
        t_s: f64,
    },
}

/// Solves `problem` on `[mesh[0], mesh[last]]` with `q` given at both ends.
///
/// Starts on `mesh` (at least two ascending points) and divides intervals until the
/// estimated error of each is tolerated.
///
/// # Errors
/// [`CollocationError`].
pub fn solve(
    problem: &impl Problem,
    mesh: Vec<f64>,
    ends: [&[f64]; 2],
) -> Result<Solution, CollocationError> {
    let solver = Solver::new(problem, ends);
    let mut iterate = solver.first_guess(mesh);
    let mut polished = false;
    let mut retries = 0;
    let intervals_max = UNKNOWNS_MAX / problem.functions().max(1);
    let (mut last, mut stagnant) = (f64::INFINITY, 0);
    loop {
        let solution = match solver.newton(&mut iterate, polished) {
            Ok(solution) => solution,
            Err(error) if retries == RETRIES_MAX || iterate.mesh.len() > intervals_max => {
                return Err(error);
            }
            // A mesh too coarse for the layers can lead anywhere.
            Err(_) => {
                retries += 1;
                iterate = solver.first_guess(halve(&iterate.mesh));
                continue;
            }
        };
        let errors: Vec<f64> = (0..solution.mesh.len() - 1)
            .map(|interval| {
                let (q, acceleration) = solution.errors(interval);
                problem.size(&q, &acceleration)
            })
            .collect();
        let worst = errors.iter().fold(0.0, |m: f64, e| e.max(m));
        if !worst.is_finite() {
            return Err(CollocationError::Diverged);
        }
        let fine = refine(&solution.mesh, &errors, problem.resolution());
        // Division takes most of an error away; what resists it twice is rounding.
        if !polished {
            stagnant = if worst > 0.5 * last { stagnant + 1 } else { 0 };
            last = worst;
        }
        let rounding = stagnant >= 2 && worst <= ROUNDING_MAX;
        // Where nothing is left to divide, layers thinner than the resolution remain; the
        // solution's estimate tells.
        let settled = worst <= 1.0 || rounding || fine.len() == solution.mesh.len();
        if settled || fine.len() > intervals_max {
            if polished {
                return Ok(solution);
            }
            polished = true;
            continue;
        }
        polished = false;
        iterate = solver.transfer(&solution, fine);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// q'' = lambda^2 (q - sin t) - sin t + cubic (q^3 - sin^3 t): solution sin t plus
    /// boundary layers.
    struct Layers {
        mass: DMatrix<f64>,
        lambda: f64,
        cubic: f64,
        tolerance: f64,
    }

    impl Layers {
        fn new(lambda: f64, cubic: f64) -> Self {
            Self {
                mass: DMatrix::from_element(1, 1, -2.0),
                lambda,
                cubic,
                tolerance: 1e-9,
            }
        }
    }

    impl Problem for Layers {
        fn functions(&self) -> usize {
            1
        }
        fn mass(&self) -> &DMatrix<f64> {
            &self.mass
        }
        fn linearise(
            &self,
            t: f64,
            q: &[f64],
            _: &[f64],
            value: &mut [f64],
            by_q: &mut DMatrix<f64>,
            by_rate: &mut DMatrix<f64>,
        ) {
            let (s, square) = (t.sin(), self.lambda * self.lambda);
            let rest = self.cubic * (q[0].powi(3) - s.powi(3));
            value[0] = -2.0 * (square * (q[0] - s) - s + rest);
            by_q[(0, 0)] = -2.0 * (square + 3.0 * self.cubic * q[0] * q[0]);
            by_rate[(0, 0)] = 0.0;
        }
        fn size(&self, q: &[f64], _: &[f64]) -> f64 {
            q[0].abs() / self.tolerance
        }
        fn resolution(&self) -> f64 {
            0.1 / self.lambda
        }
    }

    /// With q(0) = 1 there is a layer exp(-lambda t) on the left.
    fn exact(lambda: f64, t: f64) -> f64 {
        t.sin() + (-lambda * t).exp()
    }

    fn worst_error(solution: &Solution, exact: impl Fn(f64) -> f64) -> f64 {
        let (mut q, mut rate, mut acceleration) = ([0.0], [0.0], [0.0]);
        (0..=4000)
            .map(|i| {
                let t = 6.0 * f64::from(i) / 4000.0;
                let interval = solution.interval(t, 0);
                solution.evaluate(t, interval, &mut q, &mut rate, &mut acceleration);
                (q[0] - exact(t)).abs()
            })
            .fold(0.0, f64::max)
    }

    fn uniform(intervals: usize) -> Vec<f64> {
        (0..=intervals)
            .map(|i| 6.0 * i as f64 / intervals as f64)
            .collect()
    }

    /// The linear problem on a given mesh, as it is.
    fn unrefined(lambda: f64, ends: [f64; 2], intervals: usize) -> Solution {
        let problem = Layers::new(lambda, 0.0);
        let solver = Solver::new(&problem, [&ends[..1], &ends[1..]]);
        let mut iterate = solver.first_guess(uniform(intervals));
        solver.step(&mut iterate).unwrap();
        solver.solution(&iterate)
    }

    #[test]
    fn layers_are_resolved_and_the_estimate_covers_the_error() {
        for lambda in [3.0, 40.0, 1500.0, 1e5] {
            let problem = Layers::new(lambda, 0.0);
            let right = [exact(lambda, 6.0)];
            let solution = solve(&problem, uniform(8), [&[1.0], &right]).unwrap();
            let error = worst_error(&solution, |t| exact(lambda, t));
            let estimate = solution.error_estimate(|q| q[0].abs());
            assert!(error <= estimate, "{lambda}: {error:e} {estimate:e}");
            assert!(estimate <= 1e-9);
        }
    }

    #[test]
    fn evaluation_gives_the_derivatives() {
        let solution = unrefined(3.0, [1.0, exact(3.0, 6.0)], 40);
        let (mut q, mut rate, mut acceleration) = ([0.0], [0.0], [0.0]);
        for i in 0..=100 {
            let t = 0.06 * f64::from(i);
            let interval = solution.interval(t, 0);
            solution.evaluate(t, interval, &mut q, &mut rate, &mut acceleration);
            let layer = (-3.0 * t).exp();
            assert!((q[0] - exact(3.0, t)).abs() < 1e-10);
            assert!((rate[0] - (t.cos() - 3.0 * layer)).abs() < 1e-9);
            assert!((acceleration[0] - (-t.sin() + 9.0 * layer)).abs() < 1e-6);
        }
    }

    #[test]
    fn a_coarse_mesh_survives_stiff_layers() {
        // h lambda = 7,500: the layer cannot be seen, and must not spread. Unresolved,
        // the method is still of order 6.
        let error = |intervals: usize| {
            let solution = unrefined(1e4, [0.0, 6.0_f64.sin()], intervals);
            worst_error(&solution, f64::sin)
        };
        let (coarse, fine) = (error(8), error(16));
        assert!(coarse < 1e-2 && fine < coarse / 50.0, "{coarse:e} {fine:e}");
    }

    #[test]
    fn the_order_is_far_above_4() {
        let errors = |intervals: usize| {
            let solution = unrefined(3.0, [1.0, exact(3.0, 6.0)], intervals);
            let at_points = (1..intervals)
                .map(|i| (solution.polynomials[i][0] - exact(3.0, solution.mesh[i])).abs())
                .fold(0.0, f64::max);
            [at_points, worst_error(&solution, |t| exact(3.0, t))]
        };
        let order = |coarse: f64, fine: f64| (coarse / fine).log2();
        // At the points rounding ends it soon.
        let [coarse, middle, fine] = [5, 10, 20].map(errors);
        let [points, between] = [order(coarse[0], middle[0]), order(middle[1], fine[1])];
        assert!(
            (10.5..16.0).contains(&points),
            "{points} {coarse:?} {middle:?}"
        );
        assert!((6.7..9.0).contains(&between), "{between}");
    }

    #[test]
    fn nonlinear_problems_converge() {
        let problem = Layers::new(2.0, 5.0);
        let right = [6.0_f64.sin()];
        let solution = solve(&problem, uniform(6), [&[0.0], &right]).unwrap();
        assert!(worst_error(&solution, f64::sin) < 1e-9);
    }

    #[test]
    fn undefined_coefficients_are_an_error_and_no_panic() {
        let problem = Layers::new(f64::NAN, 0.0);
        assert!(solve(&problem, uniform(6), [&[0.0], &[0.0]]).is_err());
    }
}

//! Boundary-value problems `G(t, q, q', q'') = 0` with linear conditions at both ends, by collocation
//! at six Gauss points an interval.
//!
//! The planner's problem has solutions that grow and decay over many orders of
//! magnitude; no initial-value method survives them. Its fastest rates, 3e4 1/s with
//! 12 elements, leave layers at ends that are held, far thinner than the mesh that the
//! motion itself needs, and its matrix `dG/dq''` is nearly singular (its determinant is
//! 2e-5 for 12 elements, its condition number 1e9). So:
//!
//! - **In an interval** the unknowns are the second derivatives at the Gauss points;
//!   `q` and its rate follow from those at the interval's left end by integration.
//!   The second derivatives, from which torques come, so keep their own accuracy
//!   instead of being differences of `q`. They are eliminated.
//! - **Over the mesh** what is left is a chain of linear relations between `q` and rate
//!   at neighbouring mesh points, with some of the conditions at either end. It is
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
mod mesh;
mod newton;
mod solution;

pub use solution::Solution;

use mesh::{filled, halve, refine};
use nalgebra::{DMatrix, DVector};
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

/// A system of second order, `G(t, q, q', q'') = 0`, in which `q''` is linear.
pub trait Problem {
    /// Number `n` of unknown functions.
    fn functions(&self) -> usize;

    /// What Newton's method starts from: `q` at `t`, to `q` (n entries).
    fn guess(&self, t: f64, q: &mut [f64]);

    /// `G` at `t` for `q`, its rate and its acceleration (n entries each), to `value`, and its
    /// derivatives by the three, to n x n matrices (their former content is overwritten). Not finite
    /// where there is no `G`.
    fn linearise(
        &self,
        t: f64,
        q: [&[f64]; 3],
        value: &mut [f64],
        derivatives: &mut [DMatrix<f64>; 3],
    );

    /// Whether there is a `G` at `q`: a step of Newton's method that would leave that is shortened.
    fn admits(&self, _q: &[f64]) -> bool {
        true
    }

    /// Size of an error of `q` and one of `q''`, as multiples of what is tolerated.
    fn size(&self, q: &[f64], acceleration: &[f64]) -> f64;

    /// Length of the shortest interval worth having, s. In shorter ones there is
    /// nothing left to resolve, and what looks like an error is rounding.
    fn resolution(&self) -> f64;
}

/// Conditions on the solution at an end of its time.
#[derive(Clone, Debug)]
pub struct Boundary {
    /// One row a condition, on `q` and its rate: k x 2n. Both ends together have 2n.
    pub matrix: DMatrix<f64>,
    /// The `q` at rest, with which all conditions hold.
    pub rest: Vec<f64>,
}

impl Boundary {
    /// `q` is `rest`, whatever its rate.
    pub fn held(rest: Vec<f64>) -> Self {
        let n = rest.len();
        let mut matrix = DMatrix::zeros(n, 2 * n);
        matrix.fill_diagonal(1.0);
        Self { matrix, rest }
    }

    /// How far `point`, `q` and its rate, is from meeting the conditions.
    fn defect(&self, point: &DVector<f64>) -> DVector<f64> {
        let mut off = -point.clone();
        for (off, rest) in off.iter_mut().zip(&self.rest) {
            *off += rest;
        }
        &self.matrix * off
    }
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

/// Solves `problem` on `[mesh[0], mesh[last]]` with the conditions `ends`.
///
/// Starts on `mesh` (at least two ascending points), from the problem's guess or the solution of a
/// like one, `from`, and divides intervals until the estimated error of each is tolerated.
///
/// # Errors
/// [`CollocationError`].
pub fn solve<P: Problem + Sync>(
    problem: &P,
    mesh: Vec<f64>,
    ends: &[Boundary; 2],
    from: Option<&Solution>,
) -> Result<Solution, CollocationError> {
    let solver = Solver::new(problem, ends);
    let first = |mesh| match from {
        Some(solution) => solver.transfer(solution, mesh),
        None => solver.first_guess(mesh),
    };
    let mut iterate = first(mesh);
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
                iterate = first(halve(&iterate.mesh));
                continue;
            }
        };
        let errors: Vec<f64> = (0..solution.mesh.len() - 1)
            .map(|interval| {
                let (q, acceleration) = solution.errors(interval);
                problem.size(&q, &acceleration)
            })
            .collect();
        let errors = filled(&solution.mesh, &errors);
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
        lambda: f64,
        cubic: f64,
        tolerance: f64,
    }

    impl Layers {
        fn new(lambda: f64, cubic: f64) -> Self {
            Self {
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
        fn guess(&self, t: f64, q: &mut [f64]) {
            q[0] = t / 6.0;
        }
        fn linearise(
            &self,
            t: f64,
            [q, _, acceleration]: [&[f64]; 3],
            value: &mut [f64],
            derivatives: &mut [DMatrix<f64>; 3],
        ) {
            let (s, square) = (t.sin(), self.lambda * self.lambda);
            let rest = self.cubic * (q[0].powi(3) - s.powi(3));
            value[0] = 2.0 * (square * (q[0] - s) - s + rest - acceleration[0]);
            let by_q = 2.0 * (square + 3.0 * self.cubic * q[0] * q[0]);
            for (derivative, value) in derivatives.iter_mut().zip([by_q, 0.0, -2.0]) {
                derivative[(0, 0)] = value;
            }
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

    fn held(ends: [f64; 2]) -> [Boundary; 2] {
        ends.map(|q| Boundary::held(vec![q]))
    }

    /// The linear problem on a given mesh, as it is.
    fn unrefined(lambda: f64, ends: [f64; 2], intervals: usize) -> Solution {
        let problem = Layers::new(lambda, 0.0);
        let ends = held(ends);
        let solver = Solver::new(&problem, &ends);
        let mut iterate = solver.first_guess(uniform(intervals));
        solver.step(&mut iterate).unwrap();
        solver.solution(&iterate)
    }

    #[test]
    fn layers_are_resolved_and_the_estimate_covers_the_error() {
        for lambda in [3.0, 40.0, 1500.0, 1e5] {
            let problem = Layers::new(lambda, 0.0);
            let ends = held([1.0, exact(lambda, 6.0)]);
            let solution = solve(&problem, uniform(8), &ends, None).unwrap();
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
        let ends = held([0.0, 6.0_f64.sin()]);
        let solution = solve(&problem, uniform(6), &ends, None).unwrap();
        assert!(worst_error(&solution, f64::sin) < 1e-9);
    }

    #[test]
    fn undefined_coefficients_are_an_error_and_no_panic() {
        let problem = Layers::new(f64::NAN, 0.0);
        assert!(solve(&problem, uniform(6), &held([0.0, 0.0]), None).is_err());
    }

    #[test]
    fn conditions_without_growth_leave_no_layers() {
        // At the beginning nothing that decays, at the end nothing that grows: of the solutions
        // sin t + a exp(-lambda t) + b exp(lambda (t - 6)) that leaves the first, whatever the mesh.
        let lambda = 1e5;
        let problem = Layers::new(lambda, 0.0);
        let ends = [(-1.0, 0.0, 1.0), (1.0, 6.0_f64.sin(), 6.0_f64.cos())];
        // lambda q -+ q' is that part; here it is lambda sin t -+ cos t, said by a shifted rest.
        let ends = ends.map(|(sign, value, rate)| Boundary {
            matrix: DMatrix::from_row_slice(1, 2, &[lambda, sign * 1.0]),
            rest: vec![value + sign * rate / lambda],
        });
        let solution = solve(&problem, uniform(12), &ends, None).unwrap();
        assert!(solution.mesh().len() <= 25, "{}", solution.mesh().len());
        assert!(worst_error(&solution, f64::sin) < 1e-9);
    }

    #[test]
    fn ends_may_have_unlike_numbers_of_conditions() {
        // Both conditions at the beginning: an initial-value problem.
        let problem = Layers::new(1.0, 0.0);
        let mut matrix = DMatrix::identity(2, 2);
        matrix[(1, 0)] = 1.0;
        let ends = [
            // q = 0 and q + q' = 0.
            Boundary {
                matrix,
                rest: vec![0.0],
            },
            Boundary {
                matrix: DMatrix::zeros(0, 2),
                rest: vec![0.0],
            },
        ];
        let solution = solve(&problem, uniform(12), &ends, None).unwrap();
        // sin t - (exp t - exp -t) / 2.
        let exact = |t: f64| t.sin() - 0.5 * (t.exp() - (-t).exp());
        assert!(worst_error(&solution, exact) < 1e-7);
    }
}

//! Boundary-value problems `A q'' = f(t, q, q')` with Dirichlet ends, by collocation
//! at four Gauss points an interval.
//!
//! The planner's problem has solutions that grow and decay over many orders of
//! magnitude, in pairs; no initial-value method survives them. Collocation at Gauss
//! points is symmetric, of order 8 at the mesh points and 6 between them, and the
//! linear algebra below treats growing and decaying parts alike.
//!
//! - **Stages.** In each interval the accelerations at the Gauss points are unknowns
//!   and are eliminated against the interval's left end `(q, q')`. An even number of
//!   points is needed: with an odd one this elimination is singular for certain
//!   growth rates (its stability function has a real pole).
//! - **Mesh points.** The relations from point to point are eliminated from left to
//!   right by Householder QR: what is known at a point (`n` conditions on `2 n`
//!   numbers, from the left boundary condition on) is carried to the next; the right
//!   boundary condition closes the system. The carried conditions always include the
//!   bounded solutions, so nothing grows.
//! - **Nonlinearity** is met by Newton's method, the mesh by halving the intervals
//!   whose defect is too large.

use nalgebra::{DMatrix, DVector};

/// Gauss points an interval.
const STAGES: usize = 4;

/// Intervals beyond which refinement gives up.
const INTERVALS_MAX: usize = 20_000;

/// Newton iterations on a mesh before giving up.
const ITERATIONS_MAX: usize = 30;

/// Abscissas of the four Gauss points on [0, 1].
const ABSCISSAS: [f64; STAGES] = [
    0.069_431_844_202_973_71,
    0.330_009_478_207_571_87,
    0.669_990_521_792_428_1,
    0.930_568_155_797_026_3,
];

/// A second-order system with a constant, invertible matrix on its highest derivative.
pub trait Problem {
    /// Number `n` of unknown functions.
    fn size(&self) -> usize;

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

    /// `q'' = A^-1 f`, into `acceleration`.
    fn acceleration(&self, t: f64, q: &[f64], rate: &[f64], acceleration: &mut [f64]);

    /// Size of the error `q` in the units of the tolerance; any norm.
    fn norm(&self, q: &[f64]) -> f64;

    /// Typical ratio of each function's rate to its value, 1/s: the elimination works
    /// with rates divided by it. With growth rates from 36 to 1500 1/s, unscaled rates
    /// cost six digits.
    fn rate_scale(&self) -> &[f64];
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
    /// The tolerance would need more intervals than are allowed.
    #[error(
        "the boundary-value problem needs more than {INTERVALS_MAX} intervals for an error of {tolerance:e}; {reached:.1e} was reached"
    )]
    TooFine {
        /// The tolerance asked for.
        tolerance: f64,
        /// The error estimate reached.
        reached: f64,
    },
}

/// A piecewise polynomial solution.
#[derive(Clone, Debug)]
pub struct Solution {
    size: usize,
    mesh: Vec<f64>,
    /// Per interval and function, coefficients of `x^0 ... x^5`, with `x` from 0 to 1
    /// over the interval: continuous with its first derivative.
    polynomials: Vec<[f64; STAGES + 2]>,
    /// Estimated largest error of `q`, in the problem's norm.
    pub error_estimate: f64,
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

    /// `q` and its rate at `t`, within `interval` or extrapolated from there.
    pub fn evaluate(&self, t: f64, interval: usize, q: &mut [f64], rate: &mut [f64]) {
        let h = self.mesh[interval + 1] - self.mesh[interval];
        let x = (t - self.mesh[interval]) / h;
        let polynomials = &self.polynomials[interval * self.size..][..self.size];
        for ((q, rate), c) in q.iter_mut().zip(rate).zip(polynomials) {
            *q = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))));
            let slope =
                c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * (4.0 * c[4] + x * 5.0 * c[5])));
            *rate = slope / h;
        }
    }

    /// Second derivative of function `k` at the relative position `x` of `interval`.
    fn curvature(&self, interval: usize, k: usize, x: f64) -> f64 {
        let h = self.mesh[interval + 1] - self.mesh[interval];
        let c = &self.polynomials[interval * self.size + k];
        (2.0 * c[2] + x * (6.0 * c[3] + x * (12.0 * c[4] + x * 20.0 * c[5]))) / (h * h)
    }
}

/// The collocation method's constants.
struct Method {
    /// Coefficients, ascending, of the Lagrange polynomials on the Gauss points.
    lagrange: [[f64; STAGES]; STAGES],
    /// `alpha[j][k]`: integral of Lagrange polynomial k from 0 to Gauss point j.
    alpha: [[f64; STAGES]; STAGES],
    /// `alpha` squared, for positions.
    beta: [[f64; STAGES]; STAGES],
    /// Weights of the accelerations in the rate at the interval's end.
    end_rate: [f64; STAGES],
    /// Weights of the accelerations in the position at the interval's end.
    end_position: [f64; STAGES],
}

impl Method {
    fn new() -> Self {
        let c = ABSCISSAS;
        let mut lagrange = [[0.0; STAGES]; STAGES];
        for k in 0..STAGES {
            let mut polynomial = [1.0, 0.0, 0.0, 0.0];
            let mut degree = 0;
            for m in (0..STAGES).filter(|m| *m != k) {
                // times (x - c_m) / (c_k - c_m)
                degree += 1;
                for i in (0..=degree).rev() {
                    let below = if i > 0 { polynomial[i - 1] } else { 0.0 };
                    polynomial[i] = (below - c[m] * polynomial[i]) / (c[k] - c[m]);
                }
            }
            lagrange[k] = polynomial;
        }
        let integral = |k: usize, x: f64| {
            let p: [f64; STAGES] = lagrange[k];
            x * (p[0] + x * (p[1] / 2.0 + x * (p[2] / 3.0 + x * p[3] / 4.0)))
        };
        let alpha: [[f64; STAGES]; STAGES] =
            core::array::from_fn(|j| core::array::from_fn(|k| integral(k, c[j])));
        let beta = core::array::from_fn(|j| {
            core::array::from_fn(|k| (0..STAGES).map(|m| alpha[j][m] * alpha[m][k]).sum())
        });
        let end_rate: [f64; STAGES] = core::array::from_fn(|k| integral(k, 1.0));
        let end_position = core::array::from_fn(|k| end_rate[k] * (1.0 - c[k]));
        Self {
            lagrange,
            alpha,
            beta,
            end_rate,
            end_position,
        }
    }
}

/// Solves `problem` on `[mesh[0], mesh[last]]` with `q` given at both ends.
///
/// Starts on `mesh` (at least two ascending points) and halves intervals until the
/// estimated error of `q`, in the problem's norm, is at most `tolerance` in each.
///
/// # Errors
/// [`CollocationError`].
pub fn solve(
    problem: &impl Problem,
    mesh: Vec<f64>,
    ends: [&[f64]; 2],
    tolerance: f64,
) -> Result<Solution, CollocationError> {
    let n = problem.size();
    // First guess: a straight line between the ends, for the nonlinear terms alone.
    let span = mesh[mesh.len() - 1] - mesh[0];
    let polynomials = (0..mesh.len() - 1)
        .flat_map(|i| {
            let at =
                |t: f64, k: usize| ends[0][k] + (ends[1][k] - ends[0][k]) * (t - mesh[0]) / span;
            let (left, right) = (mesh[i], mesh[i + 1]);
            (0..n)
                .map(|k| [at(left, k), at(right, k) - at(left, k), 0.0, 0.0, 0.0, 0.0])
                .collect::<Vec<_>>()
        })
        .collect();
    let mut solution = Solution {
        size: n,
        mesh: mesh.clone(),
        polynomials,
        error_estimate: f64::INFINITY,
        iterations: 0,
    };
    let solver = Solver::new(problem, ends);
    let mut mesh = mesh;
    loop {
        solution = solver.newton(solution, &mesh, tolerance)?;
        let errors = solver.errors(&solution);
        solution.error_estimate = errors.iter().fold(0.0, |m, e| e.max(m));
        if solution.error_estimate <= tolerance {
            return Ok(solution);
        }
        mesh = refine(&solution.mesh, &errors, tolerance);
        if mesh.len() > INTERVALS_MAX {
            return Err(CollocationError::TooFine {
                tolerance,
                reached: solution.error_estimate,
            });
        }
    }
}

/// Divides the intervals whose error is too large, by what the order promises.
fn refine(mesh: &[f64], errors: &[f64], tolerance: f64) -> Vec<f64> {
    let mut fine = Vec::with_capacity(2 * mesh.len());
    for (interval, error) in mesh.windows(2).zip(errors) {
        // The error is of order 6 in the interval; beyond 4 parts the estimate is not trusted.
        let parts = (error / (0.5 * tolerance))
            .powf(1.0 / 6.0)
            .ceil()
            .clamp(1.0, 4.0);
        for part in 0..parts as usize {
            fine.push(interval[0] + (interval[1] - interval[0]) * part as f64 / parts);
        }
    }
    fine.push(mesh[mesh.len() - 1]);
    fine
}

/// What the elimination leaves of one interval.
struct Eliminated {
    /// Accelerations at the Gauss points: columns for the left `q`, its scaled rate, and 1.
    stages: DMatrix<f64>,
    /// Upper triangle of the point's unknowns.
    triangle: DMatrix<f64>,
    /// Its coupling to the next point's unknowns, and right-hand side.
    coupling: DMatrix<f64>,
}

struct Solver<'p, P> {
    problem: &'p P,
    ends: [&'p [f64]; 2],
    method: Method,
}

impl<'p, P: Problem> Solver<'p, P> {
    fn new(problem: &'p P, ends: [&'p [f64]; 2]) -> Self {
        Self {
            problem,
            ends,
            method: Method::new(),
        }
    }

    /// Newton's method on `mesh`, from `guess` on its own mesh.
    fn newton(
        &self,
        guess: Solution,
        mesh: &[f64],
        tolerance: f64,
    ) -> Result<Solution, CollocationError> {
        let mut current = guess;
        for _ in 0..ITERATIONS_MAX {
            let next = self.step(&current, mesh)?;
            let change = self.difference(&current, &next);
            if !change.is_finite() {
                return Err(CollocationError::Diverged);
            }
            let same_mesh = current.mesh.len() == next.mesh.len();
            current = next;
            // Newton squares the error: a change of 1e-5 leaves less than the tolerance
            // of any use here; on a new mesh the change includes the old mesh's error.
            if change <= tolerance.sqrt().min(1e-5) && (same_mesh || change <= 1e3 * tolerance) {
                return Ok(current);
            }
        }
        Err(CollocationError::Diverged)
    }

    /// Largest difference of two solutions at the points of the second one's mesh.
    fn difference(&self, a: &Solution, b: &Solution) -> f64 {
        let n = a.size;
        let (mut qa, mut qb, mut rate) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut worst = 0.0_f64;
        let mut hint = 0;
        for (interval, t) in b.mesh[..b.mesh.len() - 1].iter().enumerate() {
            hint = a.interval(*t, hint);
            a.evaluate(*t, hint, &mut qa, &mut rate);
            b.evaluate(*t, interval, &mut qb, &mut rate);
            qa.iter_mut().zip(&qb).for_each(|(a, b)| *a -= b);
            let size = self.problem.norm(&qa);
            if !(size <= worst) {
                worst = size;
            }
        }
        worst
    }

    /// Estimated error of each interval. The polynomial's second derivative is
    /// compared with the equation's at the ends, where its error is largest:
    /// `h^4 a'''' / 1680`, of which `h^2 / 100` or less reaches the polynomial itself.
    fn errors(&self, solution: &Solution) -> Vec<f64> {
        let n = solution.size;
        let (mut q, mut rate, mut exact) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        (0..solution.mesh.len() - 1)
            .map(|i| {
                let (left, right) = (solution.mesh[i], solution.mesh[i + 1]);
                let h = right - left;
                let mut error = 0.0_f64;
                for (t, x) in [(left, 0.0), (right, 1.0)] {
                    solution.evaluate(t, i, &mut q, &mut rate);
                    self.problem.acceleration(t, &q, &rate, &mut exact);
                    for (k, a) in exact.iter_mut().enumerate() {
                        *a -= solution.curvature(i, k, x);
                    }
                    error = error.max(self.problem.norm(&exact));
                }
                error * h * h / 100.0
            })
            .collect()
    }

    /// One Newton step: linearises about `guess` and solves the linear problem.
    fn step(&self, guess: &Solution, mesh: &[f64]) -> Result<Solution, CollocationError> {
        let n = self.problem.size();
        let scale = self.problem.rate_scale();
        let intervals = mesh.len() - 1;
        let mut eliminated = Vec::with_capacity(intervals);

        // Conditions on (q, rate / scale) at the current point: [F | f], first the left end.
        let mut known = DMatrix::zeros(n, 2 * n + 1);
        for i in 0..n {
            known[(i, i)] = 1.0;
            known[(i, 2 * n)] = self.ends[0][i];
        }
        let mut hint = 0;
        for i in 0..intervals {
            let (t, h) = (mesh[i], mesh[i + 1] - mesh[i]);
            let stages = self.stages(guess, &mut hint, t, h)?;

            // Rows: the known conditions; then y_next - T y = g.
            let mut matrix = DMatrix::zeros(3 * n, 2 * n);
            let mut right = DMatrix::zeros(3 * n, 2 * n + 1);
            matrix
                .view_mut((0, 0), (n, 2 * n))
                .copy_from(&known.view((0, 0), (n, 2 * n)));
            right
                .view_mut((0, 2 * n), (n, 1))
                .copy_from(&known.view((0, 2 * n), (n, 1)));
            for k in 0..n {
                matrix[(n + k, k)] = -1.0;
                matrix[(n + k, n + k)] = -h * scale[k];
                matrix[(2 * n + k, n + k)] = -1.0;
                right[(n + k, k)] = 1.0;
                right[(2 * n + k, n + k)] = 1.0;
                for j in 0..STAGES {
                    let (position, rate) = (
                        h * h * self.method.end_position[j],
                        h * self.method.end_rate[j] / scale[k],
                    );
                    for column in 0..2 * n {
                        let a = stages[(j * n + k, column)];
                        matrix[(n + k, column)] -= position * a;
                        matrix[(2 * n + k, column)] -= rate * a;
                    }
                    let a = stages[(j * n + k, 2 * n)];
                    right[(n + k, 2 * n)] += position * a;
                    right[(2 * n + k, 2 * n)] += rate * a;
                }
            }
            let qr = matrix.qr();
            qr.q_tr_mul(&mut right);
            let triangle = qr.r();
            known.copy_from(&right.rows(2 * n, n));
            // Unit rows, so that no condition fades.
            for mut row in known.row_iter_mut() {
                let size = row.columns(0, 2 * n).norm();
                if size > 0.0 {
                    row /= size;
                }
            }
            let coupling = right.rows(0, 2 * n).into_owned();
            eliminated.push(Eliminated {
                stages,
                triangle,
                coupling,
            });
        }

        // The right end: q given, the known conditions give the rate.
        let beta = DVector::from_column_slice(self.ends[1]);
        let conditions = known.columns(n, n).into_owned();
        let right = known.column(2 * n) - known.columns(0, n) * &beta;
        let rate = conditions
            .lu()
            .solve(&right)
            .ok_or(CollocationError::Singular {
                t_s: mesh[intervals],
            })?;
        let mut point = DVector::zeros(2 * n);
        point.rows_mut(0, n).copy_from(&beta);
        point.rows_mut(n, n).copy_from(&rate);

        let mut polynomials = vec![[0.0; STAGES + 2]; intervals * n];
        for (i, part) in eliminated.iter().enumerate().rev() {
            let right = part.coupling.column(2 * n) - part.coupling.columns(0, 2 * n) * &point;
            point = part
                .triangle
                .solve_upper_triangular(&right)
                .ok_or(CollocationError::Singular { t_s: mesh[i] })?;
            let accelerations = part.stages.columns(0, 2 * n) * &point + part.stages.column(2 * n);
            let h = mesh[i + 1] - mesh[i];
            for k in 0..n {
                let c = &mut polynomials[i * n + k];
                c[0] = point[k];
                c[1] = h * scale[k] * point[n + k];
                for j in 0..STAGES {
                    let a = h * h * accelerations[j * n + k];
                    for (m, l) in self.method.lagrange[j].iter().enumerate() {
                        c[m + 2] += a * l / ((m + 1) * (m + 2)) as f64;
                    }
                }
            }
        }
        Ok(Solution {
            size: n,
            mesh: mesh.to_vec(),
            polynomials,
            error_estimate: f64::INFINITY,
            iterations: guess.iterations + 1,
        })
    }

    /// Accelerations at the Gauss points of the interval from `t`, `h` long, as linear
    /// functions of its left end: columns for `q`, for its scaled rate, and 1.
    fn stages(
        &self,
        guess: &Solution,
        hint: &mut usize,
        t: f64,
        h: f64,
    ) -> Result<DMatrix<f64>, CollocationError> {
        let n = self.problem.size();
        let scale = self.problem.rate_scale();
        let mut system = DMatrix::zeros(STAGES * n, STAGES * n);
        let mut right = DMatrix::zeros(STAGES * n, 2 * n + 1);
        let (mut q, mut rate, mut value) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let (mut by_q, mut by_rate) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for j in 0..STAGES {
            let at = t + ABSCISSAS[j] * h;
            *hint = guess.interval(at, *hint);
            guess.evaluate(at, *hint, &mut q, &mut rate);
            self.problem
                .linearise(at, &q, &rate, &mut value, &mut by_q, &mut by_rate);
            for column in 0..n {
                for row in 0..n {
                    let (dq, dv) = (by_q[(row, column)], by_rate[(row, column)]);
                    let line = j * n + row;
                    right[(line, column)] = dq;
                    right[(line, n + column)] = (dv + ABSCISSAS[j] * h * dq) * scale[column];
                    // f(guess) less its linear part at the guess.
                    value[row] -= dq * q[column] + dv * rate[column];
                    for k in 0..STAGES {
                        system[(line, k * n + column)] =
                            -h * (self.method.alpha[j][k] * dv + h * self.method.beta[j][k] * dq);
                    }
                    system[(line, j * n + column)] += self.problem.mass()[(row, column)];
                }
            }
            for row in 0..n {
                right[(j * n + row, 2 * n)] = value[row];
            }
        }
        if system.lu().solve_mut(&mut right) {
            Ok(right)
        } else {
            Err(CollocationError::Singular { t_s: t })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// q'' = lambda^2 (q - sin t) - sin t: solution sin t plus boundary layers.
    struct Layers {
        mass: DMatrix<f64>,
        lambda: f64,
        cubic: f64,
    }

    impl Layers {
        fn new(lambda: f64, cubic: f64) -> Self {
            Self {
                mass: DMatrix::from_element(1, 1, -2.0),
                lambda,
                cubic,
            }
        }
    }

    impl Problem for Layers {
        fn size(&self) -> usize {
            1
        }
        fn mass(&self) -> &DMatrix<f64> {
            &self.mass
        }
        fn linearise(
            &self,
            t: f64,
            q: &[f64],
            rate: &[f64],
            value: &mut [f64],
            by_q: &mut DMatrix<f64>,
            by_rate: &mut DMatrix<f64>,
        ) {
            self.acceleration(t, q, rate, value);
            value[0] *= -2.0;
            by_q[(0, 0)] = -2.0 * (self.lambda * self.lambda + 3.0 * self.cubic * q[0] * q[0]);
            by_rate[(0, 0)] = 0.0;
        }
        fn acceleration(&self, t: f64, q: &[f64], _: &[f64], acceleration: &mut [f64]) {
            let s = t.sin();
            acceleration[0] =
                self.lambda.powi(2) * (q[0] - s) - s + self.cubic * (q[0].powi(3) - s.powi(3));
        }
        fn norm(&self, q: &[f64]) -> f64 {
            q[0].abs()
        }
        fn rate_scale(&self) -> &[f64] {
            core::slice::from_ref(&self.lambda)
        }
    }

    fn exact(lambda: f64, t: f64) -> f64 {
        // q(0) = 1: a layer exp(-lambda t) on the left; q(6) = sin 6: none on the right.
        t.sin() + (-lambda * t).exp()
    }

    fn worst_error(solution: &Solution, exact: impl Fn(f64) -> f64) -> f64 {
        let (mut q, mut rate) = ([0.0], [0.0]);
        (0..=4000)
            .map(|i| {
                let t = 6.0 * f64::from(i) / 4000.0;
                solution.evaluate(t, solution.interval(t, 0), &mut q, &mut rate);
                (q[0] - exact(t)).abs()
            })
            .fold(0.0, f64::max)
    }

    fn uniform(intervals: usize) -> Vec<f64> {
        (0..=intervals)
            .map(|i| 6.0 * i as f64 / intervals as f64)
            .collect()
    }

    fn zero(intervals: usize) -> Solution {
        Solution {
            size: 1,
            mesh: uniform(intervals),
            polynomials: vec![[0.0; 6]; intervals],
            error_estimate: 0.0,
            iterations: 0,
        }
    }

    #[test]
    fn layers_are_resolved_and_the_estimate_covers_the_error() {
        for lambda in [3.0, 40.0, 1500.0] {
            let problem = Layers::new(lambda, 0.0);
            let right = [exact(lambda, 6.0)];
            let solution = solve(&problem, uniform(8), [&[1.0], &right], 1e-9).unwrap();
            let error = worst_error(&solution, |t| exact(lambda, t));
            assert!(
                error <= solution.error_estimate,
                "{error:e} {:e}",
                solution.error_estimate
            );
            assert!(solution.error_estimate <= 1e-9);
        }
    }

    #[test]
    fn a_coarse_mesh_survives_stiff_layers() {
        // h lambda = 7,500: the layer cannot be seen, and must not spread.
        let problem = Layers::new(1e4, 0.0);
        let right = [6.0_f64.sin()];
        let solver = Solver::new(&problem, [&[0.0], &right]);
        let error = |intervals: usize| {
            let guess = zero(intervals);
            let solution = solver.step(&guess, &uniform(intervals)).unwrap();
            worst_error(&solution, f64::sin)
        };
        // Unresolved, the method is of order 4 at least.
        let (coarse, fine) = (error(8), error(16));
        assert!(coarse < 0.1 && fine < coarse / 14.0, "{coarse:e} {fine:e}");
    }

    #[test]
    fn the_order_is_8_at_mesh_points_and_6_between() {
        let problem = Layers::new(3.0, 0.0);
        let errors = |intervals: usize| {
            let right = [exact(3.0, 6.0)];
            let solver = Solver::new(&problem, [&[1.0], &right]);
            let solution = solver.step(&zero(intervals), &uniform(intervals)).unwrap();
            let at_points = (1..intervals)
                .map(|i| (solution.polynomials[i][0] - exact(3.0, solution.mesh[i])).abs())
                .fold(0.0, f64::max);
            [at_points, worst_error(&solution, |t| exact(3.0, t))]
        };
        let (coarse, fine) = (errors(16), errors(32));
        let order = [0, 1].map(|i| (coarse[i] / fine[i]).log2());
        assert!(
            (7.3..9.0).contains(&order[0]),
            "{order:?} {coarse:?} {fine:?}"
        );
        assert!((5.3..7.0).contains(&order[1]), "{order:?}");
    }

    #[test]
    fn nonlinear_problems_converge() {
        let problem = Layers::new(2.0, 5.0);
        let solution = solve(&problem, uniform(6), [&[0.0], &[6.0_f64.sin()]], 1e-10).unwrap();
        assert!(worst_error(&solution, f64::sin) < 1e-10);
    }

    #[test]
    fn undefined_coefficients_are_an_error_and_no_panic() {
        let problem = Layers::new(f64::NAN, 0.0);
        assert!(solve(&problem, uniform(6), [&[0.0], &[0.0]], 1e-9).is_err());
    }
}

//! Boundary-value problems `A q'' = f(t, q, q')` with Dirichlet ends, by spectral
//! elements: polynomials of degree 7 on each interval of a mesh.
//!
//! The planner's problem has solutions that grow and decay over many orders of
//! magnitude, in pairs; no initial-value method survives them. Its fastest rates, 1e4
//! 1/s and more, are far too fast for the mesh that the motion itself needs.
//!
//! - **In an interval** the equation is collocated at the six inner points of an
//!   eight-point Gauss-Lobatto rule, and the values there are eliminated against those
//!   at the interval's ends, as in a Dirichlet problem: growing and decaying parts are
//!   treated alike.
//! - **Mesh points** are coupled to their neighbours by the weak form of the equation with
//!   the same quadrature, a block tridiagonal system of n x n blocks. The weak form
//!   contains the stiffness at the mesh point itself and so keeps the fast parts where
//!   they belong. (Continuity of the rate instead, collocation at Gauss points, leaves
//!   them undetermined at mesh points: errors of 1e-5 rad for 12 elements.)
//! - The result is of order 14 at mesh points (11 is seen before rounding ends it), 8
//!   between them and 6 in the second derivative.
//! - **Nonlinearity** is met by Newton's method.
//! - **The mesh** is refined where the expansion of the second derivative in Legendre
//!   polynomials has not faded. The equation's residual would be the usual measure,
//!   but the planner's matrix `A` is nearly singular (its inverse magnifies 500 times
//!   for 8 elements, 50,000 times for 12), so the residual speaks of rounding instead
//!   of error. For the same reason [`Solution::evaluate`] takes the second derivative
//!   from the polynomial and not from the equation.

use nalgebra::{DMatrix, DVector};

/// Points of the quadrature rule on an interval, both ends included.
const POINTS: usize = 8;

/// Points between the ends.
const INNER: usize = POINTS - 2;

/// The eight Gauss-Lobatto points on [0, 1].
const ABSCISSAS: [f64; POINTS] = [
    0.0,
    0.064_129_925_745_196_69,
    0.204_149_909_283_428_85,
    0.395_350_391_048_760_6,
    0.604_649_608_951_239_4,
    0.795_850_090_716_571_2,
    0.935_870_074_254_803_3,
    1.0,
];

/// Weight of either end in the rule: 1 / (7 * 8).
const END_WEIGHT: f64 = 1.0 / 56.0;

/// Intervals beyond which refinement stops: what still looks inaccurate then is
/// rounding. A motion needs some fifty, whatever its duration.
const INTERVALS_MAX: usize = 2_000;

/// Newton iterations on a mesh before giving up.
const ITERATIONS_MAX: usize = 30;

/// Changes, as multiples of the tolerated error, that are put down to rounding when
/// Newton's method has stopped converging.
const ROUNDING_MAX: f64 = 100.0;

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

/// A piecewise polynomial solution.
#[derive(Clone, Debug)]
pub struct Solution {
    size: usize,
    mesh: Vec<f64>,
    /// Per interval and function, coefficients of `x^0 ... x^7`, with `x` from 0 to 1
    /// over the interval.
    polynomials: Vec<[f64; POINTS]>,
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

    /// Largest estimated error of `q` over all intervals, by the given norm.
    pub fn error_estimate(&self, norm: impl Fn(&[f64]) -> f64) -> f64 {
        (0..self.mesh.len() - 1)
            .map(|interval| norm(&self.errors(interval).0))
            .fold(0.0, f64::max)
    }

    /// Estimated errors of `q` and of its second derivative in an interval.
    ///
    /// The second derivative is a sum of Legendre polynomials up to the fifth. What is
    /// left out begins with a sixth, which is guessed from the last two (both, as either
    /// may vanish by symmetry). Integrated twice, and with what the neighbours add,
    /// `h^2 / 12` of it is no underestimate: the tests compare.
    fn errors(&self, interval: usize) -> (Vec<f64>, Vec<f64>) {
        let h = self.mesh[interval + 1] - self.mesh[interval];
        let polynomials = &self.polynomials[interval * self.size..][..self.size];
        let second: Vec<f64> = polynomials
            .iter()
            .map(|c| {
                // Coefficients of x^5 and x^4 in the second derivative, then in Legendre's
                // polynomials, which begin 252 x^5 - 630 x^4 and 70 x^4.
                let (a5, a4) = (42.0 * c[7] / (h * h), 30.0 * c[6] / (h * h));
                let (l5, l4) = (a5 / 252.0, (a4 + 2.5 * a5) / 70.0);
                let before = l5.abs().max(l4.abs());
                if before > 0.0 {
                    l5 * l5.abs() / before
                } else {
                    l5
                }
            })
            .collect();
        (second.iter().map(|a| a * h * h / 12.0).collect(), second)
    }
}

/// The method's constants, for an interval of unit length.
struct Method {
    /// Coefficients, ascending, of the Lagrange polynomials on the points.
    lagrange: [[f64; POINTS]; POINTS],
    /// `first[j][k]`: derivative of Lagrange polynomial k at point j.
    first: [[f64; POINTS]; POINTS],
    /// Second derivatives.
    second: [[f64; POINTS]; POINTS],
}

impl Method {
    fn new() -> Self {
        let c = ABSCISSAS;
        let mut lagrange = [[0.0; POINTS]; POINTS];
        for (k, polynomial) in lagrange.iter_mut().enumerate() {
            polynomial[0] = 1.0;
            let mut degree = 0;
            for m in (0..POINTS).filter(|m| *m != k) {
                // times (x - c_m) / (c_k - c_m)
                degree += 1;
                for i in (0..=degree).rev() {
                    let below = if i > 0 { polynomial[i - 1] } else { 0.0 };
                    polynomial[i] = (below - c[m] * polynomial[i]) / (c[k] - c[m]);
                }
            }
        }
        let table = |weight: fn(f64) -> f64, order: usize| {
            core::array::from_fn(|j| {
                core::array::from_fn(|k| {
                    let terms = (order..POINTS).rev();
                    terms.fold(0.0, |sum, m| sum * c[j] + lagrange[k][m] * weight(m as f64))
                })
            })
        };
        Self {
            first: table(|m| m, 1),
            second: table(|m| m * (m - 1.0), 2),
            lagrange,
        }
    }
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
    let mut mesh = mesh;
    let mut solution = solver.first_guess(&mesh);
    loop {
        solution = solver.newton(solution, &mesh)?;
        let errors: Vec<f64> = (0..mesh.len() - 1)
            .map(|interval| {
                let (q, acceleration) = solution.errors(interval);
                problem.size(&q, &acceleration)
            })
            .collect();
        let worst = errors.iter().fold(0.0, |m: f64, e| e.max(m));
        let fine = refine(&solution.mesh, &errors, problem.resolution());
        if !worst.is_finite() {
            return Err(CollocationError::Diverged);
        }
        // Where nothing is left to divide, layers thinner than the resolution remain; the
        // solution's estimate tells.
        if worst <= 1.0 || fine.len() == mesh.len() || fine.len() > INTERVALS_MAX {
            return Ok(solution);
        }
        mesh = fine;
    }
}

/// Divides the intervals whose error is not tolerated, by what the order promises.
fn refine(mesh: &[f64], errors: &[f64], resolution: f64) -> Vec<f64> {
    let mut fine = Vec::with_capacity(2 * mesh.len());
    for (interval, error) in mesh.windows(2).zip(errors) {
        // Of order 6 at least; beyond 3 parts the estimate is not trusted.
        let wanted = (2.0 * error).powf(1.0 / 6.0).ceil();
        let useful = (interval[1] - interval[0]) / resolution;
        let parts = wanted.min(useful.floor()).clamp(1.0, 3.0);
        for part in 0..parts as usize {
            fine.push(interval[0] + (interval[1] - interval[0]) * part as f64 / parts);
        }
    }
    fine.push(mesh[mesh.len() - 1]);
    fine
}

/// An interval after elimination. Matrices have the columns `q` at the left end, `q` at
/// the right end, and 1.
struct Eliminated {
    /// Values at the inner points, point by point.
    inner: DMatrix<f64>,
    /// The interval's share in the weak equation at its left end.
    left: DMatrix<f64>,
    /// The same at its right end.
    right: DMatrix<f64>,
}

/// Divides the rows of an equation by their largest coefficients. Stiff rows are up to
/// 1e8 times the others; pivoting would choose them first and lose the others in their
/// rounding.
fn equilibrate(matrix: &mut DMatrix<f64>, right: &mut DMatrix<f64>) {
    for (mut row, mut right) in matrix.row_iter_mut().zip(right.row_iter_mut()) {
        let size = row.amax();
        if size > 0.0 {
            row /= size;
            right /= size;
        }
    }
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

    /// A straight line between the ends: it matters for the nonlinear terms alone.
    fn first_guess(&self, mesh: &[f64]) -> Solution {
        let n = self.problem.functions();
        let (begin, end) = (mesh[0], mesh[mesh.len() - 1]);
        let mut polynomials = Vec::with_capacity((mesh.len() - 1) * n);
        for interval in mesh.windows(2) {
            for k in 0..n {
                let rise = (self.ends[1][k] - self.ends[0][k]) / (end - begin);
                let mut c = [0.0; POINTS];
                c[0] = self.ends[0][k] + rise * (interval[0] - begin);
                c[1] = rise * (interval[1] - interval[0]);
                polynomials.push(c);
            }
        }
        Solution {
            size: n,
            mesh: mesh.to_vec(),
            polynomials,
            iterations: 0,
        }
    }

    /// Newton's method on `mesh`, from `guess` on its own mesh.
    fn newton(&self, guess: Solution, mesh: &[f64]) -> Result<Solution, CollocationError> {
        let mut current = guess;
        let mut before = f64::INFINITY;
        for _ in 0..ITERATIONS_MAX {
            let next = self.step(&current, mesh)?;
            let change = self.difference(&current, &next);
            if !change.is_finite() {
                return Err(CollocationError::Diverged);
            }
            // Newton squares the error: what is left after this step is at most
            // change^2 / before, to be well below what is tolerated. Small changes from a
            // mesh to the next (`before` infinite) are the old mesh's error.
            if change * (change / before).min(1.0) <= 0.01 && (change <= 1e4 || before < 1e300) {
                return Ok(next);
            }
            if change >= 0.5 * before && change <= ROUNDING_MAX {
                return Ok(next);
            }
            before = change;
            current = next;
        }
        Err(CollocationError::Diverged)
    }

    /// Largest difference of two solutions at the points of the second one's mesh, as
    /// a multiple of what is tolerated.
    fn difference(&self, a: &Solution, b: &Solution) -> f64 {
        let n = a.size;
        let zeros = vec![0.0; n];
        let [mut qa, mut qb, mut rate, mut acceleration] = [(); 4].map(|()| vec![0.0; n]);
        let mut worst = 0.0_f64;
        let mut hint = 0;
        for (interval, t) in b.mesh[..b.mesh.len() - 1].iter().enumerate() {
            hint = a.interval(*t, hint);
            a.evaluate(*t, hint, &mut qa, &mut rate, &mut acceleration);
            b.evaluate(*t, interval, &mut qb, &mut rate, &mut acceleration);
            qa.iter_mut().zip(&qb).for_each(|(a, b)| *a -= b);
            let size = self.problem.size(&qa, &zeros);
            if !(size <= worst) {
                worst = size;
            }
        }
        worst
    }

    /// One Newton step: linearises about `guess` and solves the linear problem.
    fn step(&self, guess: &Solution, mesh: &[f64]) -> Result<Solution, CollocationError> {
        let n = self.problem.functions();
        let intervals = mesh.len() - 1;
        let mut hint = 0;
        let mut parts = Vec::with_capacity(intervals);
        for i in 0..intervals {
            parts.push(self.eliminate(guess, &mut hint, mesh[i], mesh[i + 1] - mesh[i])?);
        }

        // The weak equation at mesh point i, with the points before it eliminated:
        // q_i = forward_i (q_{i+1}, 1).
        let mut forward: Vec<DMatrix<f64>> = Vec::with_capacity(intervals);
        let mut first = DMatrix::zeros(n, n + 1);
        first.column_mut(n).copy_from_slice(self.ends[0]);
        forward.push(first);
        for i in 1..intervals {
            let (before, after) = (&parts[i - 1].right, &parts[i].left);
            let coupling = before.columns(0, n);
            let mut pivot = before.columns(n, n)
                + after.columns(0, n)
                + coupling * forward[i - 1].columns(0, n);
            let mut right = DMatrix::zeros(n, n + 1);
            right.columns_mut(0, n).copy_from(&-after.columns(n, n));
            let constant =
                after.column(2 * n) + before.column(2 * n) + coupling * forward[i - 1].column(n);
            right.column_mut(n).copy_from(&-constant);
            equilibrate(&mut pivot, &mut right);
            if !pivot.lu().solve_mut(&mut right) {
                return Err(CollocationError::Singular { t_s: mesh[i] });
            }
            forward.push(right);
        }

        let mut polynomials = vec![[0.0; POINTS]; intervals * n];
        let mut ends = DVector::zeros(2 * n + 1);
        ends[2 * n] = 1.0;
        let mut next = DVector::from_column_slice(self.ends[1]);
        for (i, part) in parts.iter().enumerate().rev() {
            let here = forward[i].columns(0, n) * &next + forward[i].column(n);
            ends.rows_mut(0, n).copy_from(&here);
            ends.rows_mut(n, n).copy_from(&next);
            let inner = &part.inner * &ends;
            for k in 0..n {
                let values: [f64; POINTS] = core::array::from_fn(|j| match j {
                    0 => here[k],
                    j if j <= INNER => inner[(j - 1) * n + k],
                    _ => next[k],
                });
                // Less the left end's value, of which only rounding is left otherwise.
                let c = &mut polynomials[i * n + k];
                for (value, lagrange) in values.iter().zip(&self.method.lagrange) {
                    for (c, l) in c.iter_mut().zip(lagrange) {
                        *c += (value - here[k]) * l;
                    }
                }
                c[0] = here[k];
            }
            next = here;
        }
        Ok(Solution {
            size: n,
            mesh: mesh.to_vec(),
            polynomials,
            iterations: guess.iterations + 1,
        })
    }

    /// Eliminates the interval from `t`, `h` long. With the residual
    /// `R = A q'' - f`, linearised about `guess`, the values at the inner points make it
    /// vanish there; an end contributes `h w R -+ A q'` to its weak equation.
    fn eliminate(
        &self,
        guess: &Solution,
        hint: &mut usize,
        t: f64,
        h: f64,
    ) -> Result<Eliminated, CollocationError> {
        let n = self.problem.functions();
        let mass = self.problem.mass();
        let Method { first, second, .. } = &self.method;
        let mut system = DMatrix::zeros(INNER * n, INNER * n);
        let mut inner = DMatrix::zeros(INNER * n, 2 * n + 1);
        // The ends' residuals by the values at all points, and 1.
        let mut ends = [(); 2].map(|()| DMatrix::zeros(n, POINTS * n + 1));
        let [mut q, mut rate, mut value, mut unused] = [(); 4].map(|()| vec![0.0; n]);
        let (mut by_q, mut by_rate) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for j in 0..POINTS {
            let at = t + ABSCISSAS[j] * h;
            *hint = guess.interval(at, *hint);
            guess.evaluate(at, *hint, &mut q, &mut rate, &mut unused);
            self.problem
                .linearise(at, &q, &rate, &mut value, &mut by_q, &mut by_rate);
            // The residual's derivative by the value at point k; f less its linear part.
            let derivative = |row: usize, k: usize, column: usize| {
                let own = if k == j { by_q[(row, column)] } else { 0.0 };
                mass[(row, column)] * second[j][k] / (h * h)
                    - by_rate[(row, column)] * first[j][k] / h
                    - own
            };
            for (row, value) in value.iter_mut().enumerate() {
                for column in 0..n {
                    *value -=
                        by_q[(row, column)] * q[column] + by_rate[(row, column)] * rate[column];
                }
            }
            let end = match j {
                0 => Some((0, 1.0)),
                j if j == POINTS - 1 => Some((1, -1.0)),
                _ => None,
            };
            if let Some((end, side)) = end {
                let weight = h * END_WEIGHT;
                for (row, value) in value.iter().enumerate() {
                    for k in 0..POINTS {
                        for column in 0..n {
                            ends[end][(row, k * n + column)] = weight * derivative(row, k, column)
                                + side * mass[(row, column)] * first[j][k] / h;
                        }
                    }
                    ends[end][(row, POINTS * n)] = -weight * value;
                }
                continue;
            }
            for (row, value) in value.iter().enumerate() {
                let line = (j - 1) * n + row;
                for column in 0..n {
                    for k in 1..=INNER {
                        system[(line, (k - 1) * n + column)] = derivative(row, k, column);
                    }
                    inner[(line, column)] = -derivative(row, 0, column);
                    inner[(line, n + column)] = -derivative(row, POINTS - 1, column);
                }
                inner[(line, 2 * n)] = *value;
            }
        }
        equilibrate(&mut system, &mut inner);
        if !system.lu().solve_mut(&mut inner) {
            return Err(CollocationError::Singular { t_s: t });
        }
        let [left, right] = ends.map(|end| {
            let mut share = end.columns(n, INNER * n) * &inner;
            for (from, to) in [(0, 0), ((POINTS - 1) * n, n)] {
                let direct = end.columns(from, n);
                let mut target = share.columns_mut(to, n);
                target += direct;
            }
            let mut constant = share.column_mut(2 * n);
            constant += end.column(POINTS * n);
            share
        });
        Ok(Eliminated { inner, left, right })
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
        let mesh = uniform(intervals);
        solver.step(&solver.first_guess(&mesh), &mesh).unwrap()
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
        let [coarse, middle, fine] = [3, 6, 12].map(errors);
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

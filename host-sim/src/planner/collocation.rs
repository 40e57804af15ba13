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

use nalgebra::{DMatrix, DVector};

/// Gauss points of an interval.
const STAGES: usize = 6;

/// Coefficients of `q` on an interval: its second derivative is a polynomial through
/// the values at the Gauss points.
const COEFFICIENTS: usize = STAGES + 2;

/// The six Gauss-Legendre points on [0, 1].
const ABSCISSAS: [f64; STAGES] = [
    0.033_765_242_898_423_99,
    0.169_395_306_766_867_74,
    0.380_690_406_958_401_55,
    0.619_309_593_041_598_4,
    0.830_604_693_233_132_3,
    0.966_234_757_101_576,
];

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

/// Change after transfer from another mesh, as a multiple of the tolerated error, that
/// one Newton step takes to 0.01 of it: the planner's nonlinear terms are small.
const FIRST_CHANGE_MAX: f64 = 1e6;

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
    polynomials: Vec<[f64; COEFFICIENTS]>,
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

    /// The solution for `matrix q` instead of `q`; `matrix` is square.
    pub fn transformed(mut self, matrix: &DMatrix<f64>) -> Self {
        for polynomials in self.polynomials.chunks_exact_mut(self.size) {
            let before = polynomials.to_vec();
            for (i, polynomial) in polynomials.iter_mut().enumerate() {
                *polynomial = core::array::from_fn(|power| {
                    let terms = before.iter().enumerate();
                    terms.map(|(j, c)| matrix[(i, j)] * c[power]).sum()
                });
            }
        }
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
    fn errors(&self, interval: usize) -> (Vec<f64>, Vec<f64>) {
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

/// The method's constants, for an interval of unit length.
struct Method {
    /// `lagrange[j]`: coefficients, ascending, of the Lagrange polynomial of point j.
    lagrange: [[f64; STAGES]; STAGES],
    /// `once[s][j]`: its integral from 0 to point s; the last row to 1.
    once: [[f64; STAGES]; STAGES + 1],
    /// The same, integrated twice.
    twice: [[f64; STAGES]; STAGES + 1],
}

impl Method {
    fn new() -> Self {
        let c = ABSCISSAS;
        let mut lagrange = [[0.0; STAGES]; STAGES];
        for (j, polynomial) in lagrange.iter_mut().enumerate() {
            polynomial[0] = 1.0;
            let mut degree = 0;
            for m in (0..STAGES).filter(|m| *m != j) {
                // times (x - c_m) / (c_j - c_m)
                degree += 1;
                for i in (0..=degree).rev() {
                    let below = if i > 0 { polynomial[i - 1] } else { 0.0 };
                    polynomial[i] = (below - c[m] * polynomial[i]) / (c[j] - c[m]);
                }
            }
        }
        let integral = |divisor: fn(f64) -> f64, order: i32| {
            core::array::from_fn(|s| {
                let x = c.get(s).copied().unwrap_or(1.0);
                core::array::from_fn(|j| {
                    let terms = (0..STAGES).rev();
                    let sum =
                        terms.fold(0.0, |sum, m| sum * x + lagrange[j][m] / divisor(m as f64));
                    sum * x.powi(order)
                })
            })
        };
        Self {
            once: integral(|m| m + 1.0, 1),
            twice: integral(|m| (m + 1.0) * (m + 2.0), 2),
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

/// Divides all intervals in two.
fn halve(mesh: &[f64]) -> Vec<f64> {
    let halves = mesh.windows(2).flat_map(|m| [m[0], 0.5 * (m[0] + m[1])]);
    halves.chain(mesh.last().copied()).collect()
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

/// A solution in the making.
struct Iterate {
    mesh: Vec<f64>,
    /// `q` and its rate at the mesh points, 2n numbers each.
    points: Vec<DVector<f64>>,
    /// Second derivatives at each interval's Gauss points, point by point.
    stages: Vec<DVector<f64>>,
    iterations: usize,
}

/// An interval after elimination of its second derivatives. Matrices have the columns
/// of the corrections of `q` and rate at the left end, and 1.
struct Eliminated {
    /// Corrections of the second derivatives at the Gauss points.
    stages: DMatrix<f64>,
    /// Corrections of `q` and rate at the right end.
    right: DMatrix<f64>,
}

/// Relation of a mesh point's corrections to those of the next one:
/// `upper here + next (there, -1) = 0`. To solve it for the matrix would cost the
/// accuracy that solving for the vector has.
struct Backward {
    upper: DMatrix<f64>,
    next: DMatrix<f64>,
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
    fn first_guess(&self, mesh: Vec<f64>) -> Iterate {
        let n = self.problem.functions();
        let (begin, end) = (mesh[0], mesh[mesh.len() - 1]);
        let rate = |k: usize| (self.ends[1][k] - self.ends[0][k]) / (end - begin);
        let point = |t: &f64| {
            DVector::from_fn(2 * n, |i, _| match i {
                i if i < n => self.ends[0][i] + rate(i) * (t - begin),
                i => rate(i - n),
            })
        };
        Iterate {
            points: mesh.iter().map(point).collect(),
            stages: vec![DVector::zeros(STAGES * n); mesh.len() - 1],
            iterations: 0,
            mesh,
        }
    }

    /// `solution` on another mesh.
    fn transfer(&self, solution: &Solution, mesh: Vec<f64>) -> Iterate {
        let n = self.problem.functions();
        let [mut q, mut rate, mut acceleration] = [(); 3].map(|()| vec![0.0; n]);
        let mut hint = 0;
        let mut points = Vec::with_capacity(mesh.len());
        let mut stages = Vec::with_capacity(mesh.len() - 1);
        for i in 0..mesh.len() {
            hint = solution.interval(mesh[i], hint);
            solution.evaluate(mesh[i], hint, &mut q, &mut rate, &mut acceleration);
            points.push(DVector::from_iterator(
                2 * n,
                q.iter().chain(&rate).copied(),
            ));
            let Some(next) = mesh.get(i + 1) else { break };
            let mut values = DVector::zeros(STAGES * n);
            for (s, x) in ABSCISSAS.iter().enumerate() {
                let t = mesh[i] + x * (next - mesh[i]);
                hint = solution.interval(t, hint);
                solution.evaluate(t, hint, &mut q, &mut rate, &mut acceleration);
                values.rows_mut(s * n, n).copy_from_slice(&acceleration);
            }
            stages.push(values);
        }
        Iterate {
            mesh,
            points,
            stages,
            iterations: solution.iterations,
        }
    }

    /// Newton's method on the iterate's mesh. A first small change since another mesh
    /// is that mesh's error and ends it; but when the iterate is to be `polished`, the
    /// rounding of that one step is to be refined away as well.
    fn newton(&self, iterate: &mut Iterate, polished: bool) -> Result<Solution, CollocationError> {
        let mut before = f64::INFINITY;
        for _ in 0..ITERATIONS_MAX {
            let change = self.step(iterate)?;
            if !change.is_finite() {
                return Err(CollocationError::Diverged);
            }
            // Newton squares the error: what is left after this step is at most
            // change^2 / before, to be well below what is tolerated.
            let left = if before.is_finite() {
                change * (change / before).min(1.0)
            } else if polished {
                change
            } else {
                change / FIRST_CHANGE_MAX
            };
            if left <= 0.01 || (change >= 0.5 * before && change <= ROUNDING_MAX) {
                return Ok(self.solution(iterate));
            }
            before = change;
        }
        Err(CollocationError::Diverged)
    }

    /// The iterate as polynomials.
    fn solution(&self, iterate: &Iterate) -> Solution {
        let n = self.problem.functions();
        let mut polynomials = Vec::with_capacity(iterate.stages.len() * n);
        for (i, stages) in iterate.stages.iter().enumerate() {
            let h = iterate.mesh[i + 1] - iterate.mesh[i];
            for k in 0..n {
                let mut c = [0.0; COEFFICIENTS];
                for (s, lagrange) in self.method.lagrange.iter().enumerate() {
                    for (m, l) in lagrange.iter().enumerate() {
                        let divisor = ((m + 1) * (m + 2)) as f64;
                        c[m + 2] += h * h * stages[s * n + k] * l / divisor;
                    }
                }
                c[0] = iterate.points[i][k];
                c[1] = h * iterate.points[i][n + k];
                polynomials.push(c);
            }
        }
        Solution {
            size: n,
            mesh: iterate.mesh.clone(),
            polynomials,
            iterations: iterate.iterations,
        }
    }

    /// One Newton step; returns the largest correction as a multiple of what is
    /// tolerated.
    fn step(&self, iterate: &mut Iterate) -> Result<f64, CollocationError> {
        let n = self.problem.functions();
        let intervals = iterate.stages.len();
        let singular = |i: usize| CollocationError::Singular {
            t_s: iterate.mesh[i],
        };
        let mut parts = Vec::with_capacity(intervals);
        let mut backward: Vec<Backward> = Vec::with_capacity(intervals);
        // n conditions on the corrections at the current mesh point: (matrix, constant).
        let mut conditions = DMatrix::zeros(n, 2 * n + 1);
        conditions.fill_diagonal(1.0);
        conditions
            .column_mut(2 * n)
            .copy_from(&(DVector::from_column_slice(self.ends[0]) - iterate.points[0].rows(0, n)));
        for i in 0..intervals {
            let part = self.eliminate(iterate, i).ok_or_else(|| singular(i))?;
            // Rows: conditions; relation `next - right here = constant`. Columns: here |
            // next, 1.
            let mut here = DMatrix::zeros(3 * n, 2 * n);
            let mut rest = DMatrix::zeros(3 * n, 2 * n + 1);
            here.rows_mut(0, n).copy_from(&conditions.columns(0, 2 * n));
            here.rows_mut(n, 2 * n)
                .copy_from(&-part.right.columns(0, 2 * n));
            rest.view_mut((n, 0), (2 * n, 2 * n)).fill_diagonal(1.0);
            rest.view_mut((0, 2 * n), (n, 1))
                .copy_from(&conditions.column(2 * n));
            rest.view_mut((n, 2 * n), (2 * n, 1))
                .copy_from(&part.right.column(2 * n));
            equilibrate(&mut here, &mut rest);
            let lu = here.lu();
            lu.p().permute_rows(&mut rest);
            let lower = lu.l();
            let mut solved = rest.rows(0, 2 * n).into_owned();
            lower
                .rows(0, 2 * n)
                .solve_lower_triangular_with_diag_mut(&mut solved, 1.0);
            conditions = rest.rows(2 * n, n) - lower.rows(2 * n, n) * &solved;
            parts.push(part);
            backward.push(Backward {
                upper: lu.u(),
                next: solved,
            });
        }

        let mut matrix = DMatrix::zeros(2 * n, 2 * n);
        matrix
            .rows_mut(0, n)
            .copy_from(&conditions.columns(0, 2 * n));
        matrix.rows_mut(n, n).fill_diagonal(1.0);
        let mut next = DVector::zeros(2 * n);
        next.rows_mut(0, n).copy_from(&conditions.column(2 * n));
        next.rows_mut(n, n).copy_from(
            &(DVector::from_column_slice(self.ends[1]) - iterate.points[intervals].rows(0, n)),
        );
        if !matrix.lu().solve_mut(&mut next) {
            return Err(singular(intervals));
        }

        let mut worst = 0.0_f64;
        for (i, (part, relation)) in parts.iter().zip(&backward).enumerate().rev() {
            let mut here = relation.next.column(2 * n) - relation.next.columns(0, 2 * n) * &next;
            if !relation.upper.solve_upper_triangular_mut(&mut here) {
                return Err(singular(i));
            }
            let stages = part.stages.columns(0, 2 * n) * &here + part.stages.column(2 * n);
            for s in 0..STAGES {
                let (q, acceleration) = (&here.as_slice()[..n], &stages.as_slice()[s * n..][..n]);
                let size = self.problem.size(q, acceleration);
                // Not max(), which passes NaN over.
                if !(size <= worst) {
                    worst = size;
                }
            }
            iterate.points[i + 1] += next;
            iterate.stages[i] += stages;
            next = here;
        }
        iterate.points[0] += next;
        iterate.iterations += 1;
        Ok(worst)
    }

    /// Eliminates interval `i`: linearised about the iterate, the corrections of the
    /// second derivatives make the equation hold at the Gauss points. `None` if they
    /// cannot.
    fn eliminate(&self, iterate: &Iterate, i: usize) -> Option<Eliminated> {
        let n = self.problem.functions();
        let mass = self.problem.mass();
        let Method { once, twice, .. } = &self.method;
        let (t, h) = (iterate.mesh[i], iterate.mesh[i + 1] - iterate.mesh[i]);
        let (point, stages) = (&iterate.points[i], &iterate.stages[i]);
        // `q` and rate at share `x` of the interval, row `row` of the integrals.
        let integrate = |row: usize, x: f64, q: &mut [f64], rate: &mut [f64]| {
            for k in 0..n {
                let (mut first, mut second) = (0.0, 0.0);
                for s in 0..STAGES {
                    first += once[row][s] * stages[s * n + k];
                    second += twice[row][s] * stages[s * n + k];
                }
                q[k] = point[k] + h * (x * point[n + k] + h * second);
                rate[k] = point[n + k] + h * first;
            }
        };
        let mut system = DMatrix::zeros(STAGES * n, STAGES * n);
        let mut solved = DMatrix::zeros(STAGES * n, 2 * n + 1);
        let [mut q, mut rate, mut value] = [(); 3].map(|()| vec![0.0; n]);
        let (mut by_q, mut by_rate) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (j, x) in ABSCISSAS.iter().enumerate() {
            integrate(j, *x, &mut q, &mut rate);
            self.problem
                .linearise(t + x * h, &q, &rate, &mut value, &mut by_q, &mut by_rate);
            for column in 0..n {
                for s in 0..STAGES {
                    let (first, second) = (h * once[j][s], h * h * twice[j][s]);
                    for row in 0..n {
                        let own = if s == j { mass[(row, column)] } else { 0.0 };
                        system[(j * n + row, s * n + column)] =
                            own - second * by_q[(row, column)] - first * by_rate[(row, column)];
                    }
                }
                for row in 0..n {
                    let line = j * n + row;
                    solved[(line, column)] = by_q[(row, column)];
                    solved[(line, n + column)] =
                        x * h * by_q[(row, column)] + by_rate[(row, column)];
                    // The residual f - A q''.
                    value[row] -= mass[(row, column)] * stages[j * n + column];
                }
            }
            solved
                .view_mut((j * n, 2 * n), (n, 1))
                .copy_from_slice(&value);
        }
        equilibrate(&mut system, &mut solved);
        if !system.lu().solve_mut(&mut solved) {
            return None;
        }

        let mut right = DMatrix::zeros(2 * n, 2 * n + 1);
        for (column, mut right) in right.column_iter_mut().enumerate() {
            let solved = solved.column(column);
            for s in 0..STAGES {
                for k in 0..n {
                    right[k] += h * h * twice[STAGES][s] * solved[s * n + k];
                    right[n + k] += h * once[STAGES][s] * solved[s * n + k];
                }
            }
        }
        for k in 0..n {
            right[(k, k)] += 1.0;
            right[(k, n + k)] += h;
            right[(n + k, n + k)] += 1.0;
        }
        // How far the iterate's right end is from its next point.
        integrate(STAGES, 1.0, &mut q, &mut rate);
        let next = &iterate.points[i + 1];
        for k in 0..n {
            right[(k, 2 * n)] += q[k] - next[k];
            right[(n + k, 2 * n)] += rate[k] - next[n + k];
        }
        Some(Eliminated {
            stages: solved,
            right,
        })
    }
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

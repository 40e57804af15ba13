//! The linear system of a Newton step, which is almost block diagonal: an interval's second
//! derivatives are eliminated, then the chain of mesh points from left to right.

use super::gauss::{ABSCISSAS, Method, STAGES};
use super::newton::{Iterate, Solver};
use super::{CollocationError, Problem};
use nalgebra::{DMatrix, DVector};

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

impl<P: Problem> Solver<'_, P> {
    /// One Newton step; returns the largest correction as a multiple of what is
    /// tolerated.
    pub(super) fn step(&self, iterate: &mut Iterate) -> Result<f64, CollocationError> {
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
            backward.push(carry(&mut conditions, &part.right));
            parts.push(part);
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
        let stages = &iterate.stages[i];
        let mut system = DMatrix::zeros(STAGES * n, STAGES * n);
        let mut solved = DMatrix::zeros(STAGES * n, 2 * n + 1);
        let [mut q, mut rate, mut value] = [(); 3].map(|()| vec![0.0; n]);
        let (mut by_q, mut by_rate) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (j, x) in ABSCISSAS.iter().enumerate() {
            self.integrate(iterate, i, (j, *x), &mut q, &mut rate);
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

        let right = self.relation(iterate, i, &solved);
        Some(Eliminated {
            stages: solved,
            right,
        })
    }

    /// The corrections of `q` and rate at the right end of interval `i`, from those of the
    /// second derivatives, `stages`, as in [`Eliminated`].
    fn relation(&self, iterate: &Iterate, i: usize, stages: &DMatrix<f64>) -> DMatrix<f64> {
        let n = self.problem.functions();
        let Method { once, twice, .. } = &self.method;
        let h = iterate.mesh[i + 1] - iterate.mesh[i];
        let mut right = DMatrix::zeros(2 * n, 2 * n + 1);
        for (column, mut right) in right.column_iter_mut().enumerate() {
            let stages = stages.column(column);
            for s in 0..STAGES {
                for k in 0..n {
                    right[k] += h * h * twice[STAGES][s] * stages[s * n + k];
                    right[n + k] += h * once[STAGES][s] * stages[s * n + k];
                }
            }
        }
        for k in 0..n {
            right[(k, k)] += 1.0;
            right[(k, n + k)] += h;
            right[(n + k, n + k)] += 1.0;
        }
        // How far the iterate's right end is from its next point.
        let [mut q, mut rate] = [(); 2].map(|()| vec![0.0; n]);
        self.integrate(iterate, i, (STAGES, 1.0), &mut q, &mut rate);
        let next = &iterate.points[i + 1];
        for k in 0..n {
            right[(k, 2 * n)] += q[k] - next[k];
            right[(n + k, 2 * n)] += rate[k] - next[n + k];
        }
        right
    }

    /// `q` and rate of the iterate in interval `i`: at `x`, 0 to 1 over the interval, which
    /// has the row `row` of the integrals.
    fn integrate(
        &self,
        iterate: &Iterate,
        i: usize,
        (row, x): (usize, f64),
        q: &mut [f64],
        rate: &mut [f64],
    ) {
        let n = self.problem.functions();
        let Method { once, twice, .. } = &self.method;
        let h = iterate.mesh[i + 1] - iterate.mesh[i];
        let (point, stages) = (&iterate.points[i], &iterate.stages[i]);
        for k in 0..n {
            let (mut first, mut second) = (0.0, 0.0);
            for s in 0..STAGES {
                first += once[row][s] * stages[s * n + k];
                second += twice[row][s] * stages[s * n + k];
            }
            q[k] = point[k] + h * (x * point[n + k] + h * second);
            rate[k] = point[n + k] + h * first;
        }
    }
}

/// Carries the n `conditions` on a mesh point's corrections, (matrix, constant), over an
/// interval with the relation `right` to the next mesh point, where they are left.
fn carry(conditions: &mut DMatrix<f64>, right: &DMatrix<f64>) -> Backward {
    let n = conditions.nrows();
    // Rows: conditions; relation `next - right here = constant`. Columns: here | next, 1.
    let mut here = DMatrix::zeros(3 * n, 2 * n);
    let mut rest = DMatrix::zeros(3 * n, 2 * n + 1);
    here.rows_mut(0, n).copy_from(&conditions.columns(0, 2 * n));
    here.rows_mut(n, 2 * n).copy_from(&-right.columns(0, 2 * n));
    rest.view_mut((n, 0), (2 * n, 2 * n)).fill_diagonal(1.0);
    rest.view_mut((0, 2 * n), (n, 1))
        .copy_from(&conditions.column(2 * n));
    rest.view_mut((n, 2 * n), (2 * n, 1))
        .copy_from(&right.column(2 * n));
    equilibrate(&mut here, &mut rest);
    let lu = here.lu();
    lu.p().permute_rows(&mut rest);
    let lower = lu.l();
    let mut solved = rest.rows(0, 2 * n).into_owned();
    lower
        .rows(0, 2 * n)
        .solve_lower_triangular_with_diag_mut(&mut solved, 1.0);
    *conditions = rest.rows(2 * n, n) - lower.rows(2 * n, n) * &solved;
    Backward {
        upper: lu.u(),
        next: solved,
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

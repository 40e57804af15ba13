//! The linear system of a Newton step, which is almost block diagonal: an interval's second
//! derivatives are eliminated, then the chain of mesh points from left to right.

use super::newton::{Iterate, Solver};
use super::{CollocationError, Problem};
use crate::model::gauss::{ABSCISSAS, Method, STAGES};
use nalgebra::{DMatrix, DVector};
use rayon::iter::{IntoParallelIterator, ParallelIterator};

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

impl<P: Problem + Sync> Solver<'_, P> {
    /// One Newton step; returns the largest correction as a multiple of what is
    /// tolerated, and the share of it that was taken.
    pub(super) fn step(&self, iterate: &mut Iterate) -> Result<(f64, f64), CollocationError> {
        let n = self.problem.functions();
        let intervals = iterate.stages.len();
        let singular = |i: usize| CollocationError::Singular {
            t_s: iterate.mesh[i],
        };
        let all: Vec<Option<Eliminated>> = (0..intervals)
            .into_par_iter()
            .map(|i| self.eliminate(iterate, i))
            .collect();
        let mut parts = Vec::with_capacity(intervals);
        let mut backward: Vec<Backward> = Vec::with_capacity(intervals);
        // Conditions on the corrections at the current mesh point: (matrix, constant).
        let [begin, end] = self.ends;
        let mut conditions = begin.matrix.clone().insert_column(2 * n, 0.0);
        conditions
            .column_mut(2 * n)
            .copy_from(&begin.defect(&iterate.points[0]));
        for (i, part) in all.into_iter().enumerate() {
            let part = part.ok_or_else(|| singular(i))?;
            backward.push(carry(&mut conditions, &part.right));
            parts.push(part);
        }

        let carried = conditions.nrows();
        let mut matrix = DMatrix::zeros(2 * n, 2 * n);
        matrix
            .rows_mut(0, carried)
            .copy_from(&conditions.columns(0, 2 * n));
        matrix
            .rows_mut(carried, 2 * n - carried)
            .copy_from(&end.matrix);
        let mut next = DMatrix::zeros(2 * n, 1);
        next.rows_mut(0, carried)
            .copy_from(&conditions.column(2 * n));
        next.rows_mut(carried, 2 * n - carried)
            .copy_from(&end.defect(&iterate.points[intervals]));
        equilibrate(&mut matrix, &mut next);
        if !matrix.lu().solve_mut(&mut next) {
            return Err(singular(intervals));
        }

        // Corrections of the mesh points and stages, from the last one on.
        let mut next: DVector<f64> = next.column(0).into_owned();
        let mut corrections = Vec::with_capacity(intervals);
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
            corrections.push((core::mem::replace(&mut next, here), stages));
        }
        corrections.reverse();
        let share = self.admitted(iterate, &next, &corrections);
        iterate.points[0] += next * share;
        for (i, (point, stages)) in corrections.into_iter().enumerate() {
            iterate.points[i + 1] += point * share;
            iterate.stages[i] += stages * share;
        }
        iterate.iterations += 1;
        Ok((worst, share))
    }

    /// The share of a step, 1 or halves of it, with which the problem admits the mesh points.
    fn admitted(
        &self,
        iterate: &Iterate,
        first: &DVector<f64>,
        others: &[(DVector<f64>, DVector<f64>)],
    ) -> f64 {
        /// With less nothing would be gained.
        const LEAST: f64 = 1.0 / 64.0;
        let n = self.problem.functions();
        let steps = core::iter::once(first).chain(others.iter().map(|(point, _)| point));
        let mut q = vec![0.0; n];
        let mut share = 1.0;
        for (point, step) in iterate.points.iter().zip(steps) {
            loop {
                for (q, (point, step)) in q.iter_mut().zip(point.iter().zip(step)) {
                    *q = point + share * step;
                }
                if share <= LEAST || self.problem.admits(&q) {
                    break;
                }
                share *= 0.5;
            }
        }
        share
    }

    /// Eliminates interval `i`: linearised about the iterate, the corrections of the
    /// second derivatives make the equation hold at the Gauss points. `None` if they
    /// cannot.
    fn eliminate(&self, iterate: &Iterate, i: usize) -> Option<Eliminated> {
        let n = self.problem.functions();
        let Method { once, twice, .. } = &self.method;
        let (t, h) = (iterate.mesh[i], iterate.mesh[i + 1] - iterate.mesh[i]);
        let stages = iterate.stages[i].as_slice();
        let mut system = DMatrix::zeros(STAGES * n, STAGES * n);
        let mut solved = DMatrix::zeros(STAGES * n, 2 * n + 1);
        let [mut q, mut rate, mut value] = [(); 3].map(|()| vec![0.0; n]);
        let mut derivatives = [(); 3].map(|()| DMatrix::zeros(n, n));
        for (j, x) in ABSCISSAS.iter().enumerate() {
            self.integrate(iterate, i, (j, *x), &mut q, &mut rate);
            let motion = [&q[..], &rate, &stages[j * n..][..n]];
            self.problem
                .linearise(t + x * h, motion, &mut value, &mut derivatives);
            let [by_q, by_rate, by_acceleration] = &derivatives;
            for column in 0..n {
                let (by_q, by_rate) = (by_q.column(column), by_rate.column(column));
                for s in 0..STAGES {
                    let (first, second) = (h * once[j][s], h * h * twice[j][s]);
                    let mut own = system.view_mut((j * n, s * n + column), (n, 1));
                    for row in 0..n {
                        own[row] = second * by_q[row] + first * by_rate[row];
                    }
                    if s == j {
                        own += by_acceleration.column(column);
                    }
                }
                for row in 0..n {
                    let line = j * n + row;
                    solved[(line, column)] = -by_q[row];
                    solved[(line, n + column)] = -(x * h * by_q[row] + by_rate[row]);
                }
            }
            for row in 0..n {
                solved[(j * n + row, 2 * n)] = -value[row];
            }
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

/// Carries `conditions` on a mesh point's corrections, (matrix, constant), over an
/// interval with the relation `right` to the next mesh point, where they are left.
fn carry(conditions: &mut DMatrix<f64>, right: &DMatrix<f64>) -> Backward {
    let (k, n2) = (conditions.nrows(), right.nrows());
    // Rows: conditions; relation `next - right here = constant`. Columns: here | next, 1.
    let mut here = DMatrix::zeros(k + n2, n2);
    let mut rest = DMatrix::zeros(k + n2, n2 + 1);
    here.rows_mut(0, k).copy_from(&conditions.columns(0, n2));
    here.rows_mut(k, n2).copy_from(&-right.columns(0, n2));
    rest.view_mut((k, 0), (n2, n2)).fill_diagonal(1.0);
    rest.view_mut((0, n2), (k, 1))
        .copy_from(&conditions.column(n2));
    rest.view_mut((k, n2), (n2, 1)).copy_from(&right.column(n2));
    equilibrate(&mut here, &mut rest);
    let lu = here.lu();
    lu.p().permute_rows(&mut rest);
    let lower = lu.l();
    let mut solved = rest.rows(0, n2).into_owned();
    lower
        .rows(0, n2)
        .solve_lower_triangular_with_diag_mut(&mut solved, 1.0);
    *conditions = rest.rows(n2, k) - lower.rows(n2, k) * &solved;
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

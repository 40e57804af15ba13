//! Newton's method on a given mesh.

use super::{Boundary, CollocationError, ITERATIONS_MAX, Problem, ROUNDING_MAX, Solution};
use crate::model::gauss::{ABSCISSAS, COEFFICIENTS, Method, STAGES};
use nalgebra::DVector;

/// Change after transfer from another mesh, as a multiple of the tolerated error, that
/// one Newton step takes to 0.01 of it: the planner's nonlinear terms are small.
const FIRST_CHANGE_MAX: f64 = 1e6;

/// A solution in the making.
pub(super) struct Iterate {
    pub(super) mesh: Vec<f64>,
    /// `q` and its rate at the mesh points, 2n numbers each.
    pub(super) points: Vec<DVector<f64>>,
    /// Second derivatives at each interval's Gauss points, point by point.
    pub(super) stages: Vec<DVector<f64>>,
    pub(super) iterations: usize,
}

pub(super) struct Solver<'p, P> {
    pub(super) problem: &'p P,
    pub(super) ends: &'p [Boundary; 2],
    pub(super) method: Method,
}

impl<'p, P: Problem + Sync> Solver<'p, P> {
    pub(super) fn new(problem: &'p P, ends: &'p [Boundary; 2]) -> Self {
        Self {
            problem,
            ends,
            method: Method::new(),
        }
    }

    /// The problem's guess, at rest.
    pub(super) fn first_guess(&self, mesh: Vec<f64>) -> Iterate {
        let n = self.problem.functions();
        let point = |t: &f64| {
            let mut point = DVector::zeros(2 * n);
            self.problem.guess(*t, &mut point.as_mut_slice()[..n]);
            point
        };
        Iterate {
            points: mesh.iter().map(point).collect(),
            stages: vec![DVector::zeros(STAGES * n); mesh.len() - 1],
            iterations: 0,
            mesh,
        }
    }

    /// `solution` on another mesh; beyond its own time as at its end.
    pub(super) fn transfer(&self, solution: &Solution, mesh: Vec<f64>) -> Iterate {
        let n = self.problem.functions();
        let [mut q, mut rate, mut acceleration] = [(); 3].map(|()| vec![0.0; n]);
        let mut hint = 0;
        let mut points = Vec::with_capacity(mesh.len());
        let mut stages = Vec::with_capacity(mesh.len() - 1);
        let within = |t: f64| t.clamp(solution.mesh[0], solution.mesh[solution.mesh.len() - 1]);
        for i in 0..mesh.len() {
            let t = within(mesh[i]);
            hint = solution.interval(t, hint);
            solution.evaluate(t, hint, &mut q, &mut rate, &mut acceleration);
            points.push(DVector::from_iterator(
                2 * n,
                q.iter().chain(&rate).copied(),
            ));
            let Some(next) = mesh.get(i + 1) else { break };
            let mut values = DVector::zeros(STAGES * n);
            for (s, x) in ABSCISSAS.iter().enumerate() {
                let t = within(mesh[i] + x * (next - mesh[i]));
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
    pub(super) fn newton(
        &self,
        iterate: &mut Iterate,
        polished: bool,
    ) -> Result<Solution, CollocationError> {
        let mut before = f64::INFINITY;
        for _ in 0..ITERATIONS_MAX {
            let (change, share) = self.step(iterate)?;
            if !change.is_finite() {
                return Err(CollocationError::Diverged);
            }
            if share < 1.0 {
                // What is left is not told by a step cut short.
                before = f64::INFINITY;
                continue;
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
    pub(super) fn solution(&self, iterate: &Iterate) -> Solution {
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
}

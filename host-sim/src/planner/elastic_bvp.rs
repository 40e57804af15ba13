//! The planner's boundary-value problem: link 2's deflection for a prescribed motion of the
//! tip, as [`collocation`] solves it.

use crate::model::arm_model::{ArmModel, dot};
use crate::model::bending::Given;
use crate::model::configuration::Surface;
use crate::model::dual::Dual;
use crate::model::link::LinkModel;
use crate::model::printed::PrintedDeflection;
use crate::model::rest::{Unrest, relaxed};
use crate::model::servo::{Instant, Reference, Servo};
use crate::model::unknowns::{LANES, Seeded, admits, largest, units_of};
use crate::planner::collocation::{self, Boundary, CollocationError, Problem, Solution};
use crate::planner::task::{Equations, PlanError, Task};
use crate::planner::zeros::RestZeros;
use nalgebra::{DMatrix, DVector};

/// The planner's boundary-value problem, without units: deflections are shares of link 2's length,
/// times those of the path's duration. So accuracy, pivots and verdicts are the same whatever the
/// units that arm and task are given in.
pub(super) struct Deflection<'a> {
    model: &'a ArmModel,
    task: &'a Task,
    surface: &'a Surface,
    equations: Equations,
    /// What one of each unknown is worth: 1 rad, or link 2's length, m.
    units: DVector<f64>,
    /// Tolerated errors of the unknowns, and of the torques (N m).
    tolerance: [f64; 2],
    /// Length of intervals that have nothing to resolve, in path's durations.
    resolution: f64,
    /// Largest angular frequency of a zero that swings, per path's duration.
    swing: f64,
    /// Shapes at rest before and after the path, in units.
    rest: [Vec<f64>; 2],
}

impl<'a> Deflection<'a> {
    /// The problem for the path and the force of `task` on its `surface`. `tolerance` is that of the
    /// unknowns, and of the torques (N m). `like` are shapes to find those at rest from, instead of a
    /// straight link.
    ///
    /// # Errors
    /// [`PlanError::Buckled`], [`PlanError::SectionAngle`], [`PlanError::Path`] where there is no rest
    /// before or after the path.
    pub(super) fn new(
        model: &'a ArmModel,
        (task, surface): (&'a Task, &'a Surface),
        equations: Equations,
        tolerance: [f64; 2],
        like: Option<&[Vec<f64>; 2]>,
    ) -> Result<Self, PlanError> {
        let units = units_of(model);
        let straight = [(); 2].map(|()| vec![0.0; model.dof()]);
        let mut problem = Self {
            model,
            task,
            surface,
            equations,
            units,
            tolerance,
            resolution: 0.0,
            swing: 0.0,
            rest: like.cloned().unwrap_or(straight),
        };
        let [start, end] = [0, 1].map(|end| problem.at_rest(end));
        problem.rest = [start?, end?];
        Ok(problem)
    }

    /// Intervals shorter than `resolution_s` have nothing to resolve; those longer than the fastest
    /// swinging zero's, of `swing` rad/s, lose its decay (see [`first_mesh`]).
    pub(super) fn resolving(&mut self, resolution_s: f64, swing: f64) {
        self.resolution = resolution_s / self.task.path.duration;
        self.swing = swing * self.task.path.duration;
    }

    /// Zeros before and after the path.
    ///
    /// # Errors
    /// [`PlanError::Deflection`] where there are none.
    pub(super) fn zeros(&self) -> Result<[RestZeros; 2], PlanError> {
        let zeros = |end: usize| {
            let (_, derivatives) = self.linearised_at_rest(end, &self.rest[end]);
            let singular = CollocationError::Singular {
                t_s: self.end_s(end),
            };
            RestZeros::new(&derivatives, self.task.path.duration).ok_or(singular)
        };
        Ok([zeros(0)?, zeros(1)?])
    }

    /// The shapes at rest before and after the path, in the problem's units.
    pub(super) fn rest(&self) -> &[Vec<f64>; 2] {
        &self.rest
    }

    /// Time at which the path begins (`end` 0) or ends (1), s.
    fn end_s(&self, end: usize) -> f64 {
        self.task.path.duration * end as f64
    }

    /// The nodal unknowns over time (s) between the conditions `ends` during `span` (s). Ends that are
    /// `held` have layers.
    ///
    /// # Errors
    /// [`CollocationError`].
    pub(super) fn solve(
        &self,
        span: [f64; 2],
        ends: &[Boundary; 2],
        held: bool,
        from: Option<&Solution>,
    ) -> Result<Solution, CollocationError> {
        let unit_s = self.task.path.duration;
        let layers = held.then_some(self.resolution);
        let mesh = first_mesh(span.map(|t| t / unit_s), 1.0, layers, self.swing);
        match collocation::solve(self, mesh, ends, from) {
            Err(CollocationError::Singular { t_s }) => {
                Err(CollocationError::Singular { t_s: unit_s * t_s })
            }
            solution => solution,
        }
    }

    /// The model that bends.
    pub(super) fn model(&self) -> &ArmModel {
        self.model
    }

    /// The arm at time `t`, s, with the unknowns, rates and accelerations `nodal`, SI.
    ///
    /// # Errors
    /// [`PlanError::Path`].
    fn at(&self, t: f64, nodal: [&[f64]; 3]) -> Result<Instant<f64>, PlanError> {
        let reference = self.task.reference(t);
        let force = self.task.force_at(self.surface, t);
        let mut servo = Servo::new(self.model);
        let instant = servo.follow(self.model, &reference, force, &Given(nodal));
        instant.map_err(|source| PlanError::Path {
            t_s: t,
            point_m: self.task.path.at(t).position,
            source,
        })
    }

    /// The shape in which the arm rests before (`end` 0) or after (1) the path, in units, by Newton's
    /// method from the present one.
    fn at_rest(&self, end: usize) -> Result<Vec<f64>, PlanError> {
        let t_s = self.end_s(end);
        let linearise = |q: &[f64]| {
            let (value, [by_q, ..]) = self.linearised_at_rest(end, q);
            (value, by_q)
        };
        relaxed(self.rest[end].clone(), linearise, |q| self.admits(q)).map_err(|(why, q)| {
            if why == Unrest::Undefined {
                let w: Vec<f64> = self
                    .units
                    .iter()
                    .zip(&q)
                    .map(|(unit, q)| unit * q)
                    .collect();
                let still = vec![0.0; q.len()];
                if let Err(error) = self.at(t_s, [&w, &still, &still]) {
                    return error;
                }
            }
            match why {
                Unrest::Undefined | Unrest::Buckled => PlanError::Buckled { end: end == 1 },
                Unrest::Steep => PlanError::SectionAngle {
                    t_s,
                    point_m: self.task.path.at(t_s).position,
                },
            }
        })
    }

    /// What is left of the equations at rest in the shape `q`, and its derivatives, in units.
    fn linearised_at_rest(&self, end: usize, q: &[f64]) -> (Vec<f64>, [DMatrix<f64>; 3]) {
        let n = self.model.dof();
        let rest = vec![0.0; n];
        let mut value = vec![0.0; n];
        let mut derivatives = [(); 3].map(|()| DMatrix::zeros(n, n));
        self.linearise(end as f64, [q, &rest, &rest], &mut value, &mut derivatives);
        (value, derivatives)
    }

    /// Refuses a `solution`, in the problem's units, along which the determinant of `dG/dq''` changes its
    /// sign: there the tip's motion does not determine the link's. What a tip inertia does is the arm's own;
    /// without one it is the finest shapes of many elements that cross, and nothing comes of it: 12 elements
    /// on the paper's path in 0.4 s have the torques of 11 to 1e-4 N m.
    ///
    /// # Errors
    /// [`PlanError::Undetermined`].
    pub(super) fn check_orientation(&self, solution: &Solution) -> Result<(), PlanError> {
        let tip_inertia_kgm2 = self.model.arm.tip_inertia_kgm2;
        if self.model.link.kind.model == LinkModel::Linear || tip_inertia_kgm2 == 0.0 {
            return Ok(());
        }
        let n = self.model.dof();
        let [mut q, mut rate, mut acceleration] = [(); 3].map(|()| vec![0.0; n]);
        let mut value = vec![0.0; n];
        let mut derivatives = [(); 3].map(|()| DMatrix::zeros(n, n));
        let mut sign = 0.0;
        for (interval, t) in solution.mesh().iter().enumerate() {
            let interval = interval.min(solution.mesh().len() - 2);
            solution.evaluate(*t, interval, &mut q, &mut rate, &mut acceleration);
            self.linearise(*t, [&q, &rate, &acceleration], &mut value, &mut derivatives);
            let here = derivatives[2].clone().lu().determinant().signum();
            if here * sign < 0.0 {
                let t_s = t * self.task.path.duration;
                return Err(PlanError::Undetermined {
                    t_s,
                    point_m: self.task.path.at(t_s).position,
                    tip_inertia_kgm2,
                });
            }
            sign = here;
        }
        Ok(())
    }

    /// The exact equations.
    fn linearise_exact(
        &self,
        t: f64,
        [w, w_t, w_tt]: [&[f64]; 3],
        value: &mut [f64],
        derivatives: &mut [DMatrix<f64>; 3],
    ) {
        let n = w.len();
        let force = self.task.force_at(self.surface, t);
        let reference = self.task.reference(t).resolved(self.model);
        let mut servo = Servo::<Dual<LANES>>::new(self.model);
        for from in (0..3 * n).step_by(LANES) {
            let nodal = Seeded::<LANES> {
                values: [w, w_t, w_tt],
                from,
            };
            let followed = reference.as_ref().is_ok_and(|reference| {
                let instant = servo.follow(self.model, reference, force, &nodal);
                instant.is_ok()
            });
            if !followed {
                value.fill(f64::NAN);
                return;
            }
            for (i, row) in servo.residual().iter().enumerate() {
                value[i] = row.value();
                for (j, slope) in (from..3 * n).zip(row.slopes()) {
                    derivatives[j / n][(i, j % n)] = *slope;
                }
            }
        }
    }

    /// The equations as the paper prints them.
    fn linearise_as_printed(
        &self,
        t: f64,
        motion: [&[f64]; 3],
        value: &mut [f64],
        derivatives: &mut [DMatrix<f64>; 3],
    ) {
        let reference = self.task.reference(t).resolved(self.model);
        let Ok(Reference::Joints(joint)) = reference else {
            value.fill(f64::NAN);
            return;
        };
        let force = self.task.force_at(self.surface, t);
        PrintedDeflection::new(self.model, &joint, force).linearise(
            self.model,
            motion,
            value,
            derivatives,
        );
    }
}

impl Problem for Deflection<'_> {
    fn functions(&self) -> usize {
        self.model.dof()
    }

    /// The shape at rest that the arm is nearest to.
    fn guess(&self, t: f64, q: &mut [f64]) {
        let [progress, ..] = self.task.path.profile.at(t);
        let [from, to] = &self.rest;
        for (q, (from, to)) in q.iter_mut().zip(from.iter().zip(to)) {
            *q = from + progress * (to - from);
        }
    }

    fn linearise(
        &self,
        t: f64,
        q: [&[f64]; 3],
        value: &mut [f64],
        derivatives: &mut [DMatrix<f64>; 3],
    ) {
        let unit_s = self.task.path.duration;
        let per_order = [1.0, 1.0 / unit_s, 1.0 / (unit_s * unit_s)];
        let [w, w_t, w_tt] = [0, 1, 2].map(|order| {
            let units = self.units.iter().zip(q[order]);
            let values = units.map(|(unit, q)| unit * q * per_order[order]);
            values.collect::<Vec<f64>>()
        });
        let motion = [&w[..], &w_t, &w_tt];
        match self.equations {
            Equations::Exact => self.linearise_exact(unit_s * t, motion, value, derivatives),
            Equations::AsPrinted => {
                self.linearise_as_printed(unit_s * t, motion, value, derivatives);
            }
        }
        for (derivative, per_order) in derivatives.iter_mut().zip(per_order) {
            for (mut column, unit) in derivative.column_iter_mut().zip(&self.units) {
                column *= unit * per_order;
            }
        }
    }

    fn admits(&self, q: &[f64]) -> bool {
        admits(self.model, q)
    }

    fn size(&self, q: &[f64], acceleration: &[f64]) -> f64 {
        let deflection = largest(q, 1.0) / self.tolerance[0];
        // How the accelerations enter the torques, tau2 and tau1 - tau2.
        let unit_s = self.task.path.duration;
        let units = self.units.iter().zip(acceleration);
        let acceleration: Vec<f64> = units
            .map(|(unit, q)| unit * q / (unit_s * unit_s))
            .collect();
        let joint2 = dot(self.model.nodal.second_moment.as_slice(), &acceleration).abs();
        let joint1 = dot(self.model.nodal.first_moment.as_slice(), &acceleration).abs();
        let torque = (joint2 + self.model.arm.link1_length_m * joint1) / self.tolerance[1];
        // Not max(), which passes NaN over.
        if torque <= deflection {
            deflection
        } else {
            torque
        }
    }

    fn resolution(&self) -> f64 {
        self.resolution
    }
}

/// `solution`, of the problem of `model` on `task`, with units.
pub(super) fn with_units(solution: Solution, model: &ArmModel, task: &Task) -> Solution {
    solution
        .scaled(&units_of(model))
        .in_time(task.path.duration)
}

/// Largest torque of joint 2, N m, that the motion would take if link 2 did not bend: what the
/// torques' errors are measured by before they are known. Not less than a millionth of joint 1's,
/// where there is nothing for joint 2 to do.
pub(super) fn rigid_torque(model: &ArmModel, task: &Task, surface: &Surface) -> f64 {
    const SAMPLES: u32 = 32;
    const LEAST: f64 = 1e-6;
    let rest = vec![0.0; model.dof()];
    let mut peaks: [f64; 2] = [0.0; 2];
    let mut servo = Servo::<f64>::new(model);
    for i in 0..=SAMPLES {
        let t = task.path.duration * f64::from(i) / f64::from(SAMPLES);
        let force = task.force_at(surface, t);
        let straight = Given([&rest[..]; 3]);
        let Ok(instant) = servo.follow(model, &task.reference(t), force, &straight) else {
            continue;
        };
        for (peak, torque) in peaks.iter_mut().zip(instant.torque) {
            *peak = peak.max(torque.abs());
        }
    }
    peaks[1].max(LEAST * peaks[0])
}

/// A first mesh that refinement has little to add to: evenly spaced for the motion and
/// for the rests before and after it, and, where ends are held and there may be `layers` (times that
/// resolve them), towards the ends of each of these ever denser, down to ten times that. Layers must be
/// seen from the start: once spread over a coarse mesh, they make all of it look inaccurate. A zero that
/// swings by `swing` rad in a unit of time must be followed by all of the mesh: over longer intervals
/// its decay is as good as none, and the motion's changes make growth of it, by 1e6 over the paper's fast
/// path with 14 rad an interval where 7 are as good as 0.7.
pub(super) fn first_mesh(
    span: [f64; 2],
    duration: f64,
    layers: Option<f64>,
    swing: f64,
) -> Vec<f64> {
    /// Largest angle that it swings by in an interval.
    const SWING_RAD: f64 = 5.0;
    /// On the paper's task this leaves an error of 1e-9 between the ends.
    const MOTION_INTERVALS: usize = 24;
    /// Long rests are as smooth as they are long.
    const REST_INTERVALS: usize = 6;
    /// More intervals than any arm was seen to need.
    const SWINGS_MAX: f64 = 4000.0;
    /// From interval to interval towards an end.
    const RATIO: f64 = 3.0;
    let mut pieces = vec![span[0]];
    let breaks = [0.0, duration].into_iter();
    pieces.extend(breaks.filter(|t| *t > span[0] && *t < span[1]));
    pieces.push(span[1]);
    let mut mesh = Vec::new();
    for piece in pieces.windows(2) {
        let moving = piece[0] >= 0.0 && piece[0] < duration;
        let count = if moving {
            MOTION_INTERVALS
        } else {
            REST_INTERVALS
        };
        let swings = (swing * (piece[1] - piece[0]) / SWING_RAD).ceil();
        let count = count.max(swings.min(SWINGS_MAX) as usize);
        let step = (piece[1] - piece[0]) / count as f64;
        let finest = layers.map_or(f64::INFINITY, |resolution| 10.0 * resolution);
        let shares = core::iter::successors(Some(RATIO), |power| Some(power * RATIO))
            .map(|power| 1.0 / power)
            .take_while(|share| share * step > finest);
        let shares: Vec<f64> = shares.collect();
        mesh.push(piece[0]);
        mesh.extend(shares.iter().rev().map(|share| piece[0] + step * share));
        mesh.extend((1..count).map(|i| piece[0] + step * i as f64));
        mesh.extend(shares.iter().map(|share| piece[1] - step * share));
    }
    mesh.push(span[1]);
    mesh
}

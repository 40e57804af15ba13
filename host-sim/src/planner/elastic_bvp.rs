//! The planner's boundary-value problem: link 2's deflection for a prescribed motion of the
//! tip ([`DeflectionEquation`]), as [`collocation`] solves it.

use crate::model::arm_model::{ArmModel, dot};
use crate::model::configuration::{Configuration, Surface};
use crate::model::dynamics;
use crate::model::dynamics::{DeflectionEquation, Motion, deflection_equation};
use crate::planner::collocation;
use crate::planner::collocation::{CollocationError, Solution};
use crate::planner::task::{Equations, Task};
use nalgebra::{DMatrix, DVector};

/// The planner's boundary-value problem, without units: deflections are shares of link 2's length,
/// times those of the path's duration. So accuracy, pivots and verdicts are the same whatever the
/// units that arm and task are given in.
pub(super) struct Deflection<'a> {
    model: &'a ArmModel,
    task: &'a Task,
    surface: &'a Surface,
    as_printed: bool,
    mass: DMatrix<f64>,
    /// What one of each unknown is worth: 1 rad, or link 2's length, m.
    units: DVector<f64>,
    /// Tolerated errors of the unknowns, and of the torques (N m).
    tolerance: [f64; 2],
    resolution: f64,
}

impl<'a> Deflection<'a> {
    /// The problem for the path and the force of `task` on its `surface`. `tolerance` is that of the
    /// unknowns, and of the torques (N m); intervals shorter than `resolution_s` have nothing to
    /// resolve.
    pub(super) fn new(
        model: &'a ArmModel,
        (task, surface): (&'a Task, &'a Surface),
        equations: Equations,
        tolerance: [f64; 2],
        resolution_s: f64,
    ) -> Self {
        let units = DVector::from_fn(model.dof(), |i, _| match is_deflection(i, model.dof()) {
            true => model.arm.link2_length_m,
            false => 1.0,
        });
        let mut mass = dynamics::eliminated_mass(model);
        scale_columns(&mut mass, &units, 1.0);
        Self {
            model,
            task,
            surface,
            as_printed: equations == Equations::AsPrinted,
            mass,
            units,
            tolerance,
            resolution: resolution_s / task.path.duration,
        }
    }

    /// The modal coordinates over time (s) from rest in one nodal shape to rest in another,
    /// `ends`, during `span` (s).
    ///
    /// # Errors
    /// [`CollocationError`].
    pub(super) fn solve(
        &self,
        span: [f64; 2],
        ends: [&DVector<f64>; 2],
    ) -> Result<Solution, CollocationError> {
        let unit_s = self.task.path.duration;
        let mesh = first_mesh(span.map(|t| t / unit_s), 1.0, self.resolution);
        let ends = ends.map(|w| w.component_div(&self.units));
        let solution = collocation::solve(self, mesh, [ends[0].as_slice(), ends[1].as_slice()]);
        let mut coordinates = self.model.coordinates.clone();
        scale_columns(&mut coordinates, &self.units, 1.0);
        match solution {
            Ok(solution) => Ok(solution.transformed(&coordinates).in_time(unit_s)),
            Err(CollocationError::Singular { t_s }) => {
                Err(CollocationError::Singular { t_s: unit_s * t_s })
            }
            Err(error) => Err(error),
        }
    }

    /// The equation at a time, s.
    fn equation(&self, t: f64) -> DeflectionEquation {
        let (kinematics, elbow) = (&self.model.kinematics, self.model.arm.elbow);
        let (_, joint) = self.task.motion(kinematics, elbow, t);
        let configuration = Configuration::new(self.model, joint.angle);
        deflection_equation(
            self.model,
            &joint,
            &configuration,
            self.task.force_at(self.surface, t),
            self.as_printed,
        )
    }
}

/// Multiplies the columns of `matrix` by the units of its unknowns and `factor`.
fn scale_columns(matrix: &mut DMatrix<f64>, units: &DVector<f64>, factor: f64) {
    for (mut column, unit) in matrix.column_iter_mut().zip(units) {
        column *= unit * factor;
    }
}

impl collocation::Problem for Deflection<'_> {
    fn functions(&self) -> usize {
        self.model.dof()
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
        let unit_s = self.task.path.duration;
        let units = self.units.iter();
        let w: Vec<f64> = units.clone().zip(q).map(|(unit, q)| unit * q).collect();
        let w_rate: Vec<f64> = units.zip(rate).map(|(unit, q)| unit * q / unit_s).collect();
        let equation = self.equation(unit_s * t);
        equation.linearise(self.model, &w, &w_rate, value, by_q, by_rate);
        value.iter_mut().for_each(|value| *value *= unit_s * unit_s);
        scale_columns(by_q, &self.units, unit_s * unit_s);
        scale_columns(by_rate, &self.units, unit_s);
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

/// Whether the nodal number `i` of `dof` is a deflection (m), else a slope (rad). They are in the
/// order of [`flexor::model::Beam`]: the root's slope, deflection and slope of each inner node, the
/// tip's slope.
fn is_deflection(i: usize, dof: usize) -> bool {
    i % 2 == 1 && i + 1 < dof
}

/// Largest nodal slope (rad) or deflection (share of `length_m`, link 2's); NaN if any is.
pub(super) fn largest(w: &[f64], length_m: f64) -> f64 {
    let size = |(i, size): (usize, &f64)| match is_deflection(i, w.len()) {
        true => size.abs() / length_m,
        false => size.abs(),
    };
    // Not max(), which passes NaN over.
    let larger = |most: f64, size: f64| if size <= most { most } else { size };
    w.iter().enumerate().map(size).fold(0.0, larger)
}

/// Largest torque of joint 2, N m, that the motion would take if link 2 did not bend: what the
/// torques' errors are measured by before they are known. Not less than a millionth of joint 1's,
/// where there is nothing for joint 2 to do.
pub(super) fn rigid_torque(model: &ArmModel, task: &Task, surface: &Surface) -> f64 {
    const SAMPLES: u32 = 32;
    const LEAST: f64 = 1e-6;
    let rest = vec![0.0; model.dof()];
    let mut peaks = [0.0_f64; 2];
    let path = &task.path;
    for i in 0..=SAMPLES {
        let t = path.duration * f64::from(i) / f64::from(SAMPLES);
        let force = task.force_at(surface, t);
        let (_, joint) = task.motion(&model.kinematics, model.arm.elbow, t);
        let motion = Motion {
            configuration: Configuration::new(model, joint.angle),
            joint,
            q: &rest,
            q_rate: &rest,
            q_acceleration: &rest,
        };
        for (peak, torque) in peaks
            .iter_mut()
            .zip(dynamics::inverse(model, &motion, force))
        {
            *peak = peak.max(torque.abs());
        }
    }
    peaks[1].max(LEAST * peaks[0])
}

/// A first mesh that refinement has little to add to: evenly spaced for the motion and
/// for the rests before and after it, and towards the ends of each of these ever
/// denser, down to ten times the `resolution`, s, as there may be layers. Layers must be seen from the start: once spread over a coarse mesh,
/// they make all of it look inaccurate.
pub(super) fn first_mesh(span: [f64; 2], duration: f64, resolution: f64) -> Vec<f64> {
    /// On the paper's task this leaves an error of 1e-9 between the ends.
    const MOTION_INTERVALS: usize = 24;
    /// Long rests are as smooth as they are long.
    const REST_INTERVALS: usize = 6;
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
        let step = (piece[1] - piece[0]) / count as f64;
        let finest = 10.0 * resolution;
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

//! The planner's boundary-value problem: link 2's deflection for a prescribed motion of the
//! tip ([`DeflectionEquation`]), as [`collocation`] solves it.

use crate::model::arm_model::{ArmModel, dot};
use crate::model::configuration::Configuration;
use crate::model::dynamics::{DeflectionEquation, deflection_equation};
use crate::planner::collocation;
use crate::planner::path::LinePath;
use nalgebra::DMatrix;

/// The planner's boundary-value problem.
pub(super) struct Deflection<'a> {
    pub(super) model: &'a ArmModel,
    pub(super) path: &'a LinePath,
    pub(super) force: [f64; 2],
    pub(super) as_printed: bool,
    pub(super) mass: DMatrix<f64>,
    /// Tolerated errors of the deflection (rad, m) and of tau2 (N m).
    pub(super) tolerance: [f64; 2],
    /// Shortest interval worth having, s.
    pub(super) resolution: f64,
}

impl Deflection<'_> {
    fn equation(&self, t: f64) -> DeflectionEquation {
        let tip = self.path.at(t);
        // The path has been checked; where rounding at its edge still refuses, rest.
        let joint = self
            .model
            .kinematics
            .inverse_motion(
                tip.position,
                tip.velocity,
                tip.acceleration,
                self.model.arm.elbow,
            )
            .unwrap_or_default();
        let configuration = Configuration::new(self.model, joint.angle);
        deflection_equation(
            self.model,
            &joint,
            &configuration,
            self.force,
            self.as_printed,
        )
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
        self.equation(t)
            .linearise(self.model, q, rate, value, by_q, by_rate);
    }

    fn size(&self, w: &[f64], acceleration: &[f64]) -> f64 {
        let deflection = largest(w) / self.tolerance[0];
        // How the accelerations enter the torques, tau2 and tau1 - tau2.
        let joint2 = dot(self.model.nodal.second_moment.as_slice(), acceleration).abs();
        let joint1 = dot(self.model.nodal.first_moment.as_slice(), acceleration).abs();
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

/// Largest nodal deflection or slope, m or rad; NaN if any is.
pub(super) fn largest(w: &[f64]) -> f64 {
    let larger = |m: f64, w: &f64| if w.abs() <= m { m } else { w.abs() };
    w.iter().fold(0.0, larger)
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

//! The moving arm of the pages: a run's postures, or those of a plan.

use crate::model::arm_model::deflection_matrix;
use crate::planner::plan::Plan;
use crate::planner::task::Travel;
use crate::simulation::closed_loop::{Run, SHAPE_STRIDE};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Most frames of a motion.
const FRAMES_MAX: usize = 500;

/// Frames a second of a motion that is planned, about.
const FRAMES_PER_S: f64 = 100.0;

/// Intervals in which the page draws link 2.
pub(super) const INTERVALS: usize = 24;

/// Deflections in the page are integers in this unit, m: a twentieth of a pixel.
pub(super) const DEFLECTION_UNIT_M: f64 = 1e-5;

/// What the page knows of a moving arm. Lengths in m, angles in rad.
#[derive(Serialize)]
pub(super) struct Motion {
    lengths: [f64; 2],
    normal: [f64; 2],
    path: [[f64; 2]; 2],
    /// Whether there is a surface.
    surface: bool,
    /// The largest planned force, N.
    reference: f64,
    /// Times of the frames, s.
    pub(super) t: Vec<f64>,
    angle1: Vec<f64>,
    angle2: Vec<f64>,
    /// Tip references, `x1, x2` a frame.
    target: Vec<f64>,
    unit: f64,
    intervals: usize,
    /// Deflections at the inner points of link 2, `intervals - 1` a frame, in `unit`.
    pub(super) deflection: Vec<i64>,
}

/// `value` with so many decimals; JSON then has no more digits.
fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    let rounded = (value * scale).round() / scale;
    if rounded.is_finite() { rounded } else { value }
}

/// Whether a task presses on a surface.
pub(super) fn presses(plan: &Plan) -> bool {
    matches!(plan.task.travel, Travel::Line)
}

impl Motion {
    fn still(plan: &Plan) -> Self {
        let arm = &plan.model.arm;
        Self {
            lengths: [arm.link1_length_m, arm.link2_length_m],
            normal: plan.surface.normal,
            path: [plan.task.path.from, plan.task.path.to],
            surface: presses(plan),
            reference: plan.task.normal_force.largest(),
            t: vec![],
            angle1: vec![],
            angle2: vec![],
            target: vec![],
            unit: DEFLECTION_UNIT_M,
            intervals: INTERVALS,
            deflection: vec![],
        }
    }

    /// Adds a frame; one that is not finite is left out. `nodal` are the link's deflections and
    /// slopes, which `shape` makes points of.
    fn add(
        &mut self,
        t: f64,
        angle: [f64; 2],
        target: [f64; 2],
        (shape, nodal): (Option<&DMatrix<f64>>, &[f64]),
    ) {
        let numbers = [t, angle[0], angle[1], target[0], target[1]];
        if !numbers.iter().all(|x| x.is_finite()) {
            return;
        }
        self.t.push(rounded(t, 5));
        self.angle1.push(rounded(angle[0], 5));
        self.angle2.push(rounded(angle[1], 5));
        self.target.extend(target.map(|x| rounded(x, 5)));
        let bent = shape
            .filter(|shape| shape.ncols() == nodal.len())
            .map(|shape| shape * DVector::from_column_slice(nodal));
        // A conversion to integers makes zero of what is not a number.
        self.deflection.extend((1..INTERVALS).map(|i| {
            bent.as_ref()
                .map_or(0, |w| (w[i] / DEFLECTION_UNIT_M).round() as i64)
        }));
    }

    /// The arm of a run.
    pub(super) fn of_run(plan: &Plan, run: &Run) -> Self {
        let shape = deflection_matrix(&plan.model.arm, run.elements, INTERVALS);
        let mut motion = Self::still(plan);
        let rows = run.rows.len().div_ceil(SHAPE_STRIDE.max(1));
        let all = run.shapes.len().min(rows);
        for frame in (0..all).step_by(all.div_ceil(FRAMES_MAX).max(1)) {
            let row = &run.rows[frame * SHAPE_STRIDE];
            motion.add(
                row.t,
                row.reading.angle,
                row.tip_reference,
                (shape.as_ref(), &run.shapes[frame]),
            );
        }
        motion
    }

    /// The arm as it is planned.
    pub(super) fn of_plan(plan: &Plan) -> Self {
        let (arm, dof) = (&plan.model.arm, plan.model.dof());
        let shape = deflection_matrix(arm, plan.model.elements, INTERVALS);
        let mut motion = Self::still(plan);
        let all = plan.points.len();
        let wanted = f64::from(plan.tick_rate_hz) / FRAMES_PER_S;
        let stride = (wanted as usize).max(all.div_ceil(FRAMES_MAX)).max(1);
        let last = all.checked_sub(1);
        for tick in (0..all).step_by(stride).chain(last) {
            let point = &plan.points[tick];
            let nodal = plan.deflection.get(dof * tick..dof * (tick + 1));
            motion.add(
                point.t,
                point.joint.angle,
                point.tip.position,
                (shape.as_ref(), nodal.unwrap_or_default()),
            );
        }
        motion
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::testing::short_run;

    #[test]
    fn the_frames_are_the_run() {
        let (plan, run) = short_run();
        let motion = Motion::of_run(&plan, &run);
        assert_eq!(motion.t.len(), run.shapes.len());
        assert_eq!(motion.deflection.len(), motion.t.len() * (INTERVALS - 1));
        let last = motion.t.len() - 1;
        let row = &run.rows[last * SHAPE_STRIDE];
        assert!((motion.t[last] - row.t).abs() < 1e-5);
        assert!((motion.angle2[last] - row.reading.angle[1]).abs() < 1e-5);
        // In three elements the node at a third of the link has number 1 in the shape; a
        // point of the outline lies there.
        let node = run.shapes[last][1] / DEFLECTION_UNIT_M;
        let at = motion.deflection[(INTERVALS - 1) * last + INTERVALS / 3 - 1];
        assert!((at as f64 - node).abs() <= 0.5 + 1e-6, "{at} {node}");
        assert!(node.abs() > 100.0, "the link is straight");
    }

    #[test]
    fn the_planned_arm_is_near_that_of_the_run() {
        let (plan, run) = short_run();
        let [planned, simulated] = [Motion::of_plan(&plan), Motion::of_run(&plan, &run)];
        assert_eq!(planned.t.first(), simulated.t.first());
        assert!(
            (planned.t[planned.t.len() - 1] - plan.points[plan.points.len() - 1].t).abs() < 1e-5
        );
        assert!((planned.angle1[0] - simulated.angle1[0]).abs() < 1e-3);
        assert!((planned.deflection[8] - simulated.deflection[8]).abs() < 100);
        assert!(planned.surface && planned.deflection[8] != 0);
    }
}

//! One arm on the bench with everything that belongs to it, and the board before it.

use crate::model::arm_model::{ArmModel, ModelError};
use crate::model::geometric_stiffness::GeometricStiffness;
use crate::model::link::{LinkKind, LinkModel};
use crate::planner::plan::Plan;
use crate::planner::task::Travel;
use crate::plant::PlantError;
use crate::plant::bench::{
    Channels, CompliantArm, CompliantError, CompliantParameters, RestState, SensorParameters,
};
use crate::simulation::bench::injection::TimedFault;
use flexor::model::ArmParameters;
use flexor::supervisor::{BoardParameters, Calibration, DriveScale, SafetyLimits};
use flexor::table::TableError;

/// What a board is made of, as far as the control loop sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchBoard {
    /// How sensors become counts.
    pub channels: Channels,
    /// How the board takes the counts for quantities.
    pub calibration: Calibration,
    /// How torques become counts, and those torques again.
    pub drives: [DriveScale; 2],
    /// Largest torques that the drives can be asked for, N m.
    pub drive_limit_nm: [f64; 2],
    /// When it stops by itself.
    pub safety: SafetyLimits,
    /// Ticks in which a real board raises its first torques while brakes hold the arm.
    pub soft_start_ticks: u32,
}

impl From<&BoardParameters> for BenchBoard {
    fn from(board: &BoardParameters) -> Self {
        Self {
            channels: board.into(),
            calibration: board.calibration(),
            drives: board.drives(),
            drive_limit_nm: board.drive_limit_nm(),
            // The bench begins where the brakes open: its drives give what holds the arm.
            safety: SafetyLimits {
                soft_start_ticks: 0,
                ..board.safety()
            },
            soft_start_ticks: board.safety().soft_start_ticks,
        }
    }
}

/// Why there is no run on the bench.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BenchError {
    /// No model of the arm.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No plant, or no start.
    #[error(transparent)]
    Plant(#[from] CompliantError),
    /// The table is not for the arm.
    #[error(transparent)]
    Table(#[from] TableError),
}

impl From<PlantError> for BenchError {
    fn from(error: PlantError) -> Self {
        Self::Plant(error.into())
    }
}

/// An arm on the bench.
#[derive(Clone, Debug)]
pub struct BenchArm {
    /// Its model, with the rotors that turn with its links.
    pub model: ArmModel,
    /// What it is made of besides.
    pub parameters: CompliantParameters,
    /// Its sensors.
    pub sensors: SensorParameters,
    /// Where it starts: at rest on its own surface, or above it.
    pub start: RestState,
    /// How much of a run there is besides the table.
    pub course: Course,
    /// What goes wrong, and when.
    pub faults: Vec<TimedFault>,
    /// Seed of its noise.
    pub seed: u64,
}

/// How much of a run there is before and after the table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Course {
    /// Distance of the tip above the surface where the run starts, m; `None` pressing.
    pub gap_m: Option<f64>,
    /// Time for which it goes on after the table, s.
    pub after_s: f64,
}

/// Steps a control period that are given, each times a power of two.
const GRID: [u32; 7] = [1, 2, 3, 4, 5, 6, 7];

impl BenchArm {
    /// The arm that is `arm` in so many `elements`, its link of a kind, with these `parameters` and
    /// `sensors`, at rest where `plan` begins.
    ///
    /// The integration step is chosen here, for the whole plan, and rounded up on a coarse grid, so
    /// that many arms of a campaign share it and can advance side by side.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn new(
        plan: &Plan,
        arm: &ArmParameters,
        (elements, link): (usize, LinkKind),
        mut parameters: CompliantParameters,
        sensors: SensorParameters,
        course: Course,
    ) -> Result<Self, BenchError> {
        // Before the choice of the step, which knows no rotor without a mass.
        parameters.check_rotors()?;
        let model = parameters.model(arm, elements, link)?;
        let first = &plan.points[0];
        let along_m = parameters.surface.along(first.tip.position);
        let start = match (plan.task.travel, course.gap_m) {
            (Travel::Joints(_), _) => parameters.rest_free(&model, first.joint.angle)?,
            (Travel::Line, None) => parameters.rest(&model, along_m, first.force.normal)?,
            (Travel::Line, Some(gap_m)) => {
                parameters.rest_above(&model, first.joint.angle, gap_m)?
            }
        };
        if parameters.substeps.is_none() {
            let needed = CompliantArm {
                model: &model,
                parameters: &parameters,
                start: &start,
            }
            .substeps(period_s(plan), &poses(plan))?;
            parameters.substeps = Some(on_grid(needed));
        }
        Ok(Self {
            model,
            parameters,
            sensors,
            start,
            course,
            faults: vec![],
            seed: 0,
        })
    }

    /// What arms must have in common to advance side by side and each have the bits that it has
    /// alone.
    pub fn kind(&self) -> ArmKind {
        let p = &self.parameters;
        ArmKind {
            substeps: p.substeps,
            elements: self.model.elements,
            link: self.model.link.kind.model,
            geometric_stiffness: p.geometric_stiffness,
            play: p.joints.map(|joint| joint.play.is_some()),
        }
    }

    /// Torques that its drives are given before it is enabled, N m: pressing, the plan's first ones,
    /// and in the air those that hold it.
    pub(super) fn held(&self, plan: &Plan) -> [f64; 2] {
        match (plan.task.travel, self.course.gap_m) {
            (Travel::Line, None) => plan.points[0].torque,
            _ => self.start.torque,
        }
    }

    /// The arm as a lane of a plant.
    pub(super) fn lane(&self) -> CompliantArm<'_> {
        CompliantArm {
            model: &self.model,
            parameters: &self.parameters,
            start: &self.start,
        }
    }
}

/// See [`BenchArm::kind`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ArmKind {
    substeps: Option<u32>,
    elements: usize,
    link: LinkModel,
    geometric_stiffness: GeometricStiffness,
    play: [bool; 2],
}

/// The next number on the grid 1 to 7, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40...: a quarter more at
/// most.
fn on_grid(substeps: u32) -> u32 {
    let mut unit = 1;
    while substeps > 7 * unit {
        unit *= 2;
    }
    GRID.iter()
        .map(|step| step * unit)
        .find(|step| *step >= substeps)
        .unwrap_or(substeps)
}

/// The plan's control period, s.
pub(super) fn period_s(plan: &Plan) -> f64 {
    1.0 / f64::from(plan.tick_rate_hz)
}

/// Angles of the links along the plan, rad, for the choice of the step.
pub(super) fn poses(plan: &Plan) -> Vec<[f64; 2]> {
    let last = plan.points.len() - 1;
    [0, last / 4, last / 2, 3 * last / 4, last]
        .map(|i| plan.points[i].joint.angle)
        .to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_is_fine_enough() {
        for needed in 1..2000 {
            let given = on_grid(needed);
            assert!(given >= needed && f64::from(given) <= 1.25 * f64::from(needed) + 1e-9);
            assert_eq!(on_grid(given), given);
        }
    }
}

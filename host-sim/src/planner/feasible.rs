//! Whether the arm can do a task at all, before anything is planned.

use crate::model::arm_model::ArmModel;
use crate::model::configuration::{Configuration, Surface};
use crate::planner::path::LinePath;
use crate::planner::task::{PlanError, Task};

/// The joint angles, rad, at the given progress along the path, 0 to 1.
fn angles_at(model: &ArmModel, path: &LinePath, progress: f64) -> Result<[f64; 2], PlanError> {
    let point_m = path.point(progress);
    let t_s = path.time_at_progress(progress);
    let angles = model.kinematics.inverse(point_m, model.arm.elbow);
    angles.map_err(|source| PlanError::Path {
        t_s,
        point_m,
        source,
    })
}

/// Refuses paths that the arm cannot follow; a straight line is worst at its ends and
/// where it is nearest to joint 1.
pub(super) fn check_path(model: &ArmModel, path: &LinePath) -> Result<(), PlanError> {
    for progress in [0.0, path.nearest_progress(), 1.0] {
        angles_at(model, path, progress)?;
    }
    Ok(())
}

/// |c2/s2| at the joint angles `angle`, rad: how steeply link 2 stands on the surface, as the
/// tangent of the angle between them. Infinite where it stands upright, and joint 2 cannot press.
pub(super) fn lever_ratio(model: &ArmModel, surface: &Surface, angle: [f64; 2]) -> f64 {
    let configuration = Configuration::new(model, angle);
    (configuration.along_e2(surface.normal) / configuration.along_n2(surface.normal)).abs()
}

/// Refuses friction with which the tip jams somewhere on the path, whichever way it is dragged.
///
/// # Errors
/// [`PlanError::Jams`], [`PlanError::Path`].
pub(super) fn check_friction(
    model: &ArmModel,
    task: &Task,
    surface: &Surface,
) -> Result<(), PlanError> {
    /// Link 2's angle changes by at most a hundredth of its range from one to the next.
    const SAMPLES: u32 = 256;
    let friction = task.friction.coefficient;
    if friction == 0.0 {
        return Ok(());
    }
    let path = &task.path;
    let mut worst = (0.0, path.from);
    for i in 0..=SAMPLES {
        let progress = f64::from(i) / f64::from(SAMPLES);
        let ratio = lever_ratio(model, surface, angles_at(model, path, progress)?);
        if ratio > worst.0 {
            worst = (ratio, path.point(progress));
        }
    }
    let (lever_ratio, point_m) = worst;
    if friction * lever_ratio < 1.0 {
        return Ok(());
    }
    Err(PlanError::Jams {
        friction,
        point_m,
        lever_ratio,
    })
}

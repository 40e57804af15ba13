//! Where a compliant plant starts: at rest on its own surface.

use crate::model::arm_model::{ArmModel, dot};
use crate::model::dynamics::equilibrium;
use crate::plant::bench::surface::SurfaceShape;
use crate::plant::bench::{CompliantError, CompliantParameters, RestState};
use crate::plant::{PlantError, state_of};

/// See [`CompliantParameters::rest`].
pub(super) fn rest(
    parameters: &CompliantParameters,
    model: &ArmModel,
    along_m: f64,
    force_n: f64,
) -> Result<RestState, CompliantError> {
    let surface = &parameters.surface;
    let depth = force_n / parameters.contact.stiffness_n_m;
    let tip = surface
        .point(along_m, depth)
        .ok_or(CompliantError::NoSurface { along_m })?;
    let angle = model
        .kinematics
        .inverse(tip, model.arm.elbow)
        .map_err(|problem| CompliantError::Unreachable { along_m, problem })?;
    let normal = SurfaceShape::<f64>::new(|_| surface).depth(tip).normal;
    let pressed = normal.map(|n| n * force_n);
    let (q, on_link) = equilibrium(
        model,
        angle,
        pressed,
        parameters.geometric_stiffness.is_any(),
    )
    .ok_or(PlantError::Buckled)?;

    let mut state = state_of(angle, &q, &vec![0.0; model.dof()]);
    // The bristles.
    state.extend([0.0; 3]);
    let link = [angle[0], angle[1] + dot(&model.root_slope, &q)];
    let carrier = [0.0, angle[0]];
    let mut torque = on_link;
    for j in 0..2 {
        let joint = &parameters.joints[j];
        let rotor = link[j] + joint.lead(on_link[j]);
        if joint.play.is_some() {
            state.extend([rotor, 0.0]);
        }
        // The cogging helps or hinders the drive.
        torque[j] -= joint.cogging(rotor - carrier[j]);
    }
    Ok(RestState { state, torque })
}

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
    at(parameters, model, angle, normal.map(|n| n * force_n))
}

/// See [`CompliantParameters::rest_above`]. Newton's method in link 2's angle.
pub(super) fn above(
    parameters: &CompliantParameters,
    model: &ArmModel,
    near: [f64; 2],
    gap_m: f64,
) -> Result<RestState, CompliantError> {
    let surface = &parameters.surface;
    let shape = SurfaceShape::<f64>::new(|_| surface);
    let arm = &model.arm;
    let mut angle = near;
    for _ in 0..50 {
        let tip = model.kinematics.forward(angle);
        let found = shape.depth(tip);
        let off = found.depth + gap_m;
        if off.abs() < 1e-13 {
            return at(parameters, model, angle, [0.0; 2]);
        }
        let (sin, cos) = (libm::sin(angle[1]), libm::cos(angle[1]));
        let turned = [-arm.link2_length_m * sin, arm.link2_length_m * cos];
        let rate = found.normal[0] * turned[0] + found.normal[1] * turned[1];
        angle[1] -= off / rate;
    }
    let along_m = surface.along(model.kinematics.forward(near));
    Err(CompliantError::NoSurface { along_m })
}

/// See [`CompliantParameters::rest_free`].
pub(super) fn free(
    parameters: &CompliantParameters,
    model: &ArmModel,
    angle: [f64; 2],
) -> Result<RestState, CompliantError> {
    at(parameters, model, angle, [0.0; 2])
}

/// At rest at these link angles (rad), the tip pressing with a force (N).
fn at(
    parameters: &CompliantParameters,
    model: &ArmModel,
    angle: [f64; 2],
    pressed: [f64; 2],
) -> Result<RestState, CompliantError> {
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

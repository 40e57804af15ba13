//! Where a compliant plant starts: at rest on its own surface.

use crate::model::arm_model::{ArmModel, dot};
use crate::model::dynamics::equilibrium;
use crate::model::link::LinkModel;
use crate::model::rest as bent;
use crate::model::servo::Reference;
use crate::plant::bench::surface::SurfaceShape;
use crate::plant::bench::{CompliantError, CompliantParameters, RestState};
use crate::plant::{PlantError, state_of};
use flexor::model::JointMotion;
use nalgebra::DVector;

/// An arm that rests.
struct Held {
    /// Angles of the links, rad.
    angle: [f64; 2],
    /// Modal coordinates.
    q: Vec<f64>,
    root_slope_rad: f64,
    chord_m: f64,
    /// Torques on the links, N m.
    torque: [f64; 2],
}

impl Held {
    /// At these link angles (rad), the tip pressing with a force (N).
    fn at(
        parameters: &CompliantParameters,
        model: &ArmModel,
        angle: [f64; 2],
        pressed: [f64; 2],
    ) -> Result<Self, CompliantError> {
        if model.link.kind.model == LinkModel::Geometric {
            let joint = JointMotion {
                angle,
                ..JointMotion::default()
            };
            return Self::bent(model, &Reference::Joints(joint), pressed);
        }
        let axial = parameters.geometric_stiffness.is_any();
        let (q, torque) = equilibrium(model, angle, pressed, axial).ok_or(PlantError::Buckled)?;
        Ok(Self {
            angle,
            root_slope_rad: dot(&model.root_slope, &q),
            chord_m: model.arm.link2_length_m,
            q,
            torque,
        })
    }

    /// With its tip at a place, m, pressing with a force (N).
    fn with_tip(
        parameters: &CompliantParameters,
        model: &ArmModel,
        (tip, along_m): ([f64; 2], f64),
        pressed: [f64; 2],
    ) -> Result<Self, CompliantError> {
        let angle = model
            .kinematics
            .inverse(tip, model.arm.elbow)
            .map_err(|problem| CompliantError::Unreachable { along_m, problem })?;
        match model.link.kind.model {
            LinkModel::Linear => Self::at(parameters, model, angle, pressed),
            LinkModel::Geometric => {
                let still = Reference::Tip([tip, [0.0; 2], [0.0; 2]]);
                Self::bent(model, &still, pressed)
            }
        }
    }

    fn bent(
        model: &ArmModel,
        reference: &Reference,
        pressed: [f64; 2],
    ) -> Result<Self, CompliantError> {
        let found = bent::rest(model, reference, pressed).map_err(|_| PlantError::Buckled)?;
        let q = &model.coordinates * DVector::from_vec(found.nodal);
        Ok(Self {
            angle: found.angle,
            q: q.as_slice().to_vec(),
            root_slope_rad: found.root_slope_rad,
            chord_m: found.chord_m,
            torque: found.torque,
        })
    }

    /// Where the tip is, m.
    fn tip(&self, model: &ArmModel) -> [f64; 2] {
        let [(s1, c1), (s2, c2)] = self.angle.map(libm::sincos);
        let r1 = model.arm.link1_length_m;
        [r1 * c1 + self.chord_m * c2, r1 * s1 + self.chord_m * s2]
    }

    /// With bristles relaxed, rotors where the gears need them, and the drives' torques.
    fn state(self, parameters: &CompliantParameters) -> RestState {
        let Self {
            angle,
            q,
            torque: on_link,
            ..
        } = self;
        let mut state = state_of(angle, &q, &vec![0.0; q.len()]);
        // The bristles.
        state.extend([0.0; 3]);
        let link = [angle[0], angle[1] + self.root_slope_rad];
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
        RestState { state, torque }
    }
}

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
    let normal = SurfaceShape::<f64>::new(|_| surface).depth(tip).normal;
    let pressed = normal.map(|n| n * force_n);
    let held = Held::with_tip(parameters, model, (tip, along_m), pressed)?;
    Ok(held.state(parameters))
}

/// See [`CompliantParameters::rest_above`]. Newton's method in link 2's angle; a bent link's chord is that of
/// the step before.
pub(super) fn above(
    parameters: &CompliantParameters,
    model: &ArmModel,
    near: [f64; 2],
    gap_m: f64,
) -> Result<RestState, CompliantError> {
    let surface = &parameters.surface;
    let shape = SurfaceShape::<f64>::new(|_| surface);
    let mut angle = near;
    for _ in 0..50 {
        let held = Held::at(parameters, model, angle, [0.0; 2])?;
        let found = shape.depth(held.tip(model));
        let off = found.depth + gap_m;
        if off.abs() < 1e-13 {
            return Ok(held.state(parameters));
        }
        let (sin, cos) = (libm::sin(angle[1]), libm::cos(angle[1]));
        let turned = [-held.chord_m * sin, held.chord_m * cos];
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
    Ok(Held::at(parameters, model, angle, [0.0; 2])?.state(parameters))
}

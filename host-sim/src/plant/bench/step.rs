//! How finely a compliant plant must be integrated.
//!
//! With mass `M`, stiffness `K` and damping `D` of everything that is elastic or damps, the
//! eigenvalues of `M x'' + D x' + K x = 0` are at most `d/2 + sqrt(d^2/4 + k)` in magnitude, `k` and
//! `d` being the largest eigenvalues of `M^-1 K` and `M^-1 D` (multiply by the eigenvector's
//! conjugate). `K` holds the modes, the contact (the tip presents little mass to it), the bristles
//! and the gears; `D` their damping, and the falling part of the Stribeck curves.
//!
//! Besides, a touch-down takes `pi / omega` with `omega^2 = kc` times the mobility that the tip
//! presents to the contact: the step is at most [`STEP_TIMES_CONTACT`]` / omega`.
//!
//! Bristles need no more than that: how fast they give way while sliding has no bound, but their
//! share is held within +-1 and does not leave it however long the step.

use crate::model::arm_model::ArmModel;
use crate::model::configuration::Configuration;
use crate::plant::bench::contact::excess;
use crate::plant::bench::runge_kutta::STEP_TIMES_EIGENVALUE;
use crate::plant::bench::surface::SurfaceShape;
use crate::plant::bench::{CompliantArm, CompliantParameters};
use crate::plant::{PlantError, SUBSTEPS_MAX};
use nalgebra::{Cholesky, DMatrix, DVector};

/// Force for which the Stribeck curve of the surface's friction is followed, N: ten times the
/// paper's. Larger ones are impacts, which do not last.
const STRIBECK_FORCE_N: f64 = 20.0;

/// Largest product of step and contact frequency: five steps from touch-down to lift-off, with
/// which forces are right to half a percent over a bounce.
const STEP_TIMES_CONTACT: f64 = 0.6;

/// Steepest fall of `1 / (1 + x^2)`, at `x^2 = 1/3`.
const STEEPEST: f64 = 0.649_519_052_838_329;

/// Integration steps a control period of `period_s` (s) that `arm` needs at its start and at the
/// link angles `poses` (rad).
///
/// # Errors
/// [`PlantError::TooStiff`].
pub(super) fn substeps(
    arm: &CompliantArm<'_>,
    period_s: f64,
    poses: &[[f64; 2]],
) -> Result<u32, PlantError> {
    if let Some(substeps) = arm.parameters.substeps {
        return Ok(substeps.max(1));
    }
    let start = [arm.start.state[0], arm.start.state[1]];
    let largest = poses
        .iter()
        .chain([&start])
        .map(|angle| fastest(arm.model, arm.parameters, *angle))
        // NaN, of a model that is none, prevails.
        .fold(0.0_f64, |m, x| if m >= x { m } else { x });
    let needed = (largest * period_s / STEP_TIMES_EIGENVALUE).ceil();
    if !(needed <= f64::from(SUBSTEPS_MAX)) {
        return Err(PlantError::TooStiff {
            frequency_hz: largest / core::f64::consts::TAU,
            substeps: needed,
        });
    }
    Ok((needed as u32).max(1))
}

/// Rate, rad/s, of which a step is to take [`STEP_TIMES_EIGENVALUE`], with the links at `angle`
/// (rad).
fn fastest(model: &ArmModel, parameters: &CompliantParameters, angle: [f64; 2]) -> f64 {
    let system = System::new(model, parameters, angle);
    let Some(factor) = Cholesky::new(system.mass) else {
        return f64::NAN;
    };
    let largest = |matrix: DMatrix<f64>| {
        // L^-1 A L^-T has the eigenvalues of M^-1 A.
        let half = factor.l().solve_lower_triangular(&matrix);
        half.and_then(|half| factor.l().solve_lower_triangular(&half.transpose()))
            .map_or(f64::NAN, |whole| whole.symmetric_eigenvalues().max())
    };
    let (k, d) = (largest(system.stiffness), largest(system.damping));
    let eigenvalue = 0.5 * d + (0.25 * d * d + k).sqrt();
    let mobility = system.into.dot(&factor.solve(&system.into));
    let contact = (parameters.contact.stiffness_n_m * mobility).sqrt();
    eigenvalue.max(contact * STEP_TIMES_EIGENVALUE / STEP_TIMES_CONTACT)
}

/// Mass, stiffness and damping of (theta10, theta20, q..., rotors...).
struct System {
    mass: DMatrix<f64>,
    stiffness: DMatrix<f64>,
    damping: DMatrix<f64>,
    /// What the coordinates' rates are in the rate of the tip's depth.
    into: DVector<f64>,
}

impl System {
    fn new(model: &ArmModel, parameters: &CompliantParameters, angle: [f64; 2]) -> Self {
        let n = model.dof();
        let rotors: Vec<usize> = (0..2)
            .filter(|j| parameters.joints[*j].play.is_some())
            .collect();
        let size = 2 + n + rotors.len();
        let configuration = Configuration::new(model, angle);
        let r1 = model.arm.link1_length_m;
        let lever = r1 * configuration.c;
        let mut mass = DMatrix::zeros(size, size);
        mass[(0, 0)] = model.link1_inertia + model.link2_mass * r1 * r1;
        mass[(1, 1)] = model.link2_inertia;
        mass[(1, 0)] = lever * model.link2_moment;
        for i in 0..n {
            mass[(2 + i, 0)] = lever * model.first_moment[i];
            mass[(2 + i, 1)] = model.second_moment[i];
            mass[(2 + i, 2 + i)] = 1.0;
        }
        for (k, j) in rotors.iter().enumerate() {
            mass[(2 + n + k, 2 + n + k)] = parameters.joints[*j].reflected_inertia_kgm2();
        }
        mass.fill_upper_triangle_with_lower_triangle();
        let mut system = Self {
            mass,
            stiffness: DMatrix::zeros(size, size),
            damping: DMatrix::zeros(size, size),
            into: DVector::zeros(size),
        };
        for i in 0..n {
            system.stiffness[(2 + i, 2 + i)] = model.stiffness[i];
            system.damping[(2 + i, 2 + i)] = model.damping[i];
        }
        system.add_contact(model, parameters, &configuration);
        system.add_joints(model, parameters, &rotors);
        system
    }

    /// Adds a spring and a damper along the coordinates' combination `row`.
    fn add(&mut self, row: &DVector<f64>, stiffness: f64, damping: f64) {
        self.stiffness.ger(stiffness, row, row, 1.0);
        self.damping.ger(damping, row, row, 1.0);
    }

    fn add_contact(
        &mut self,
        model: &ArmModel,
        parameters: &CompliantParameters,
        configuration: &Configuration<f64>,
    ) {
        let (contact, profile) = (&parameters.contact, &parameters.surface);
        let [e1, e2] = [configuration.e1, configuration.e2];
        let (r1, r2) = (model.arm.link1_length_m, model.arm.link2_length_m);
        let tip = [r1 * e1[0] + r2 * e2[0], r1 * e1[1] + r2 * e2[1]];
        let smooth = profile.without_features();
        let normal = SurfaceShape::<f64>::new(|_| &smooth).depth(tip).normal;
        let along = |v: [f64; 2]| {
            let mut row = DVector::zeros(self.mass.nrows());
            row[0] = r1 * configuration.along_n1(v);
            row[1] = r2 * configuration.along_n2(v);
            row
        };
        let (into, aside) = (along(normal), along([normal[1], -normal[0]]));
        // Friction follows the normal force: it couples the two directions.
        let coupled = 1.0 + contact.friction.max(contact.friction_at_rest);
        self.add(
            &into,
            coupled * contact.stiffness_n_m,
            coupled * contact.damping_ns_m,
        );
        self.into = into;
        if contact.friction > 0.0 {
            let fall = contact.friction
                * excess(contact.friction, contact.friction_at_rest)
                * STEEPEST
                * STRIBECK_FORCE_N
                / contact.stribeck_speed_m_s;
            self.add(&aside, contact.bristle_stiffness_n_m, fall);
        }
    }

    fn add_joints(&mut self, model: &ArmModel, parameters: &CompliantParameters, rotors: &[usize]) {
        let n = model.dof();
        for (j, joint) in parameters.joints.iter().enumerate() {
            let mut link = DVector::zeros(self.mass.nrows());
            if j == 0 {
                link[0] = 1.0;
            } else {
                link[1] = 1.0;
                for i in 0..n {
                    link[2 + i] = model.root_slope[i];
                }
            }
            let mut motor = link.clone();
            if let (Some(gear), Some(k)) = (&joint.play, rotors.iter().position(|r| *r == j)) {
                motor.fill(0.0);
                motor[2 + n + k] = 1.0;
                self.add(
                    &(&motor - &link),
                    gear.stiffness_nm_rad,
                    gear.damping_nms_rad,
                );
            }
            if j == 1 {
                motor[0] -= 1.0;
            }
            let f = &joint.friction;
            let fall =
                f.coulomb_nm * excess(f.coulomb_nm, f.breakaway_nm) * STEEPEST / f.stribeck_rad_s;
            let cogging = joint.cogging.amplitude_nm.abs() * joint.cogging.periods.abs();
            self.add(
                &motor,
                joint.bristle_stiffness() + cogging,
                f.viscous_nms_rad + fall,
            );
        }
    }
}

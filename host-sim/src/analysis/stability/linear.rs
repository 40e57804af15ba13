//! The constrained plant linearised about a point of the planned motion.
//!
//! Independent coordinates eliminate the contact: a tip on the surface is told by its
//! position `s` along it, and the two angles follow by inverse kinematics. With the
//! modal coordinates `q` that makes `m = 1 + dof` degrees of freedom and the state
//! `y = [s, q, s', q']`. From `y` and the torques the full equations of motion
//! ([`crate::plant::derivative`], the very ones that are simulated) give `y'` and what
//! can be measured; run with [`Dual`] numbers they give the derivatives as well, exactly.

use super::StabilityError;
use super::complex::norm;
use crate::model::arm_model::{ArmModel, dot};
use crate::model::configuration::Surface;
use crate::model::dual::Dual;
use crate::model::dynamics;
use crate::model::forward::Workspace;
use crate::planner::plan::{Plan, Sampler};
use crate::plant;
use crate::plant::spread::PlantVariant;
use flexor::model::{Kinematics, KinematicsError};
use flexor::number::Real;
use nalgebra::{Complex, DMatrix};

/// Number of outputs.
pub const OUTPUTS: usize = 6;
/// Output: contact force along the surface's normal, N.
pub const FORCE: usize = 0;
/// Output: rate of link 2's slope at its root, rad/s.
pub const SLOPE_RATE: usize = 1;
/// Output: theta10, rad.
pub const ANGLE1: usize = 2;
/// Output: theta20, rad.
pub const ANGLE2: usize = 3;
/// Output: position of the tip along the surface, m.
pub const TIP: usize = 4;
/// Output: slope of link 2 at its root, rad.
pub const SLOPE: usize = 5;

/// Where the equations are linearised: a state of the moving plant.
#[derive(Clone, Debug)]
pub struct OperatingPoint {
    /// Time from the path's start, s.
    pub t: f64,
    /// The plant's surface.
    pub surface: Surface,
    /// Unit vector along the surface, in the path's direction.
    pub along: [f64; 2],
    /// State `[s, q, s', q']`.
    pub state: Vec<f64>,
    /// Torques that sustain the motion, N m.
    pub torque: [f64; 2],
}

impl OperatingPoint {
    /// The point at time `t`, s, of `sampler`'s plan, for a plant that need not be the
    /// planned arm: then its link is bent further by what its own resting shape under
    /// the planned force differs from the planned arm's, and so are the torques.
    /// That is where feedback would bring it, if the motion is slow against the link.
    ///
    /// # Errors
    /// [`StabilityError::Buckled`] where there is no resting shape.
    pub fn new(
        plan: &Plan,
        sampler: &mut Sampler<'_>,
        variant: &PlantVariant,
        t: f64,
    ) -> Result<Self, StabilityError> {
        let (model, planned) = (&variant.model, &plan.model);
        let point = sampler.at(t);
        let (sine, cosine) = libm::sincos(variant.contact_angle_rad);
        let turn = |v: [f64; 2]| [cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1]];
        let along = turn(plan.task.along(&plan.surface));
        let normal = turn(plan.surface.normal);
        let tip = point.tip.position;
        let surface = Surface {
            normal,
            offset_m: normal[0] * tip[0] + normal[1] * tip[1],
        };

        let mut q = model.project_shape_from(planned, &sampler.q());
        let mut torque = point.torque;
        let angle = point.joint.angle;
        let rest = |model: &ArmModel, force, geometric| {
            dynamics::equilibrium(model, angle, force, geometric)
                .filter(|(q, _)| q.iter().all(|x| x.is_finite()))
                .ok_or(StabilityError::Buckled { t_s: t })
        };
        let geometric = variant.parameters.geometric_stiffness.is_any();
        let own = rest(model, normal.map(|n| n * point.force.normal), geometric)?;
        let theirs = rest(planned, plan.force_at(t), false)?;
        let projected = model.project_shape_from(planned, &theirs.0);
        for i in 0..q.len() {
            q[i] += own.0[i] - projected[i];
        }
        for joint in 0..2 {
            torque[joint] += own.1[joint] - theirs.1[joint];
        }

        let mut state = Vec::with_capacity(2 * (1 + q.len()));
        state.push(along[0] * tip[0] + along[1] * tip[1]);
        state.extend(q);
        let velocity = point.tip.velocity;
        state.push(along[0] * velocity[0] + along[1] * velocity[1]);
        state.extend(model.project_shape_from(planned, &sampler.q_rate()));
        Ok(Self {
            t,
            surface,
            along,
            state,
            torque,
        })
    }
}

/// Writes the rate of the independent state `y` to `rate` and returns the outputs, with
/// the drives giving `torque` (N m).
///
/// # Errors
/// [`KinematicsError`] where the tip is out of reach.
pub fn derivative<T: Real>(
    variant: &PlantVariant,
    point: &OperatingPoint,
    y: &[T],
    torque: [T; 2],
    rate: &mut [T],
) -> Result<[T; OUTPUTS], KinematicsError> {
    let model = &variant.model;
    let n = model.dof();
    let m = 1 + n;
    let along = point.along.map(T::from_f64);
    let normal = point.surface.normal.map(T::from_f64);
    let offset = T::from_f64(point.surface.offset_m);
    let kinematics = Kinematics::<T>::new(&model.arm);
    let tip = [0, 1].map(|i| offset * normal[i] + y[0] * along[i]);
    let velocity = along.map(|a| a * y[m]);
    let joint = kinematics.inverse_motion(tip, velocity, [T::ZERO; 2], model.arm.elbow)?;

    let mut full = Vec::with_capacity(4 + 2 * n);
    full.extend(joint.angle);
    full.extend(joint.rate);
    full.extend_from_slice(&y[1..m]);
    full.extend_from_slice(&y[m + 1..]);
    let mut slope = vec![T::ZERO; full.len()];
    let force = plant::derivative(
        model,
        &variant.parameters,
        &point.surface,
        torque,
        &full,
        &mut slope,
        &mut Workspace::new(model),
    );

    rate[..m].copy_from_slice(&y[m..]);
    // The tip's acceleration along the surface.
    let jacobian = kinematics.jacobian(joint.angle);
    let reach = [
        kinematics.link1_length * joint.rate[0] * joint.rate[0],
        kinematics.link2_length * joint.rate[1] * joint.rate[1],
    ];
    let e = joint.angle.map(|a| [a.cos(), a.sin()]);
    rate[m] = (0..2).fold(T::ZERO, |sum, i| {
        let acceleration = jacobian[i][0] * slope[2] + jacobian[i][1] * slope[3]
            - reach[0] * e[0][i]
            - reach[1] * e[1][i];
        sum + along[i] * acceleration
    });
    rate[m + 1..].copy_from_slice(&slope[4 + n..]);

    let at_root = |q: &[T]| dot(&model.root_slope, q);
    let mut output = [T::ZERO; OUTPUTS];
    output[FORCE] = force;
    output[SLOPE_RATE] = at_root(&y[m + 1..]);
    output[ANGLE1] = joint.angle[0];
    output[ANGLE2] = joint.angle[1];
    output[TIP] = y[0];
    output[SLOPE] = at_root(&y[1..m]);
    Ok(output)
}

/// The plant's linearisation: `y' = a y + b u`, `outputs = c y + d u`, for deviations
/// from the operating point. State `[s, q, s', q']` of `2 m` numbers, `u` the two
/// torques, outputs in the order of the constants of this module.
#[derive(Clone, Debug)]
pub struct Linear {
    /// `2m x 2m`.
    pub a: DMatrix<f64>,
    /// `2m x 2`.
    pub b: DMatrix<f64>,
    /// `OUTPUTS x 2m`.
    pub c: DMatrix<f64>,
    /// `OUTPUTS x 2`.
    pub d: DMatrix<f64>,
    /// Rate of the state at the operating point itself.
    pub rate: Vec<f64>,
    /// Outputs there.
    pub output: [f64; OUTPUTS],
}

impl Linear {
    /// Linearises `variant` at `point`.
    ///
    /// # Errors
    /// [`StabilityError::Configuration`] where the tip is out of the arm's reach,
    /// [`StabilityError::NotFinite`] where the equations have no finite derivative.
    pub fn new(variant: &PlantVariant, point: &OperatingPoint) -> Result<Self, StabilityError> {
        let size = point.state.len();
        let mut y: Vec<Dual> = point.state.iter().map(|x| Dual::new(*x, 0.0)).collect();
        let mut torque = point.torque.map(|x| Dual::new(x, 0.0));
        let mut rate = vec![Dual::default(); size];
        let mut result = Self {
            a: DMatrix::zeros(size, size),
            b: DMatrix::zeros(size, 2),
            c: DMatrix::zeros(OUTPUTS, size),
            d: DMatrix::zeros(OUTPUTS, 2),
            rate: vec![0.0; size],
            output: [0.0; OUTPUTS],
        };
        for column in 0..size + 2 {
            if column < size {
                y[column] = Dual::new(y[column].value(), 1.0);
            } else {
                torque[column - size] = Dual::new(torque[column - size].value(), 1.0);
            }
            let output = derivative(variant, point, &y, torque, &mut rate).map_err(|source| {
                StabilityError::Configuration {
                    t_s: point.t,
                    source,
                }
            })?;
            let (state, feed, column) = if column < size {
                y[column] = Dual::new(y[column].value(), 0.0);
                (&mut result.a, &mut result.c, column)
            } else {
                torque[column - size] = Dual::new(torque[column - size].value(), 0.0);
                (&mut result.b, &mut result.d, column - size)
            };
            for (i, rate) in rate.iter().enumerate() {
                state[(i, column)] = rate.slope();
                result.rate[i] = rate.value();
            }
            for (i, output) in output.iter().enumerate() {
                feed[(i, column)] = output.slope();
                result.output[i] = output.value();
            }
        }
        let matrices = [&result.a, &result.b, &result.c, &result.d];
        if matrices.iter().all(|m| m.iter().all(|x| x.is_finite())) {
            Ok(result)
        } else {
            Err(StabilityError::NotFinite { t_s: point.t })
        }
    }

    /// Number of degrees of freedom, `m`.
    pub fn dof(&self) -> usize {
        self.a.nrows() / 2
    }

    /// The same with velocities in units of `unit` times the positions' unit. It makes
    /// the entries alike in size, without which neither a matrix exponential nor
    /// eigenvalues are had cheaply.
    pub(super) fn scaled(&self, unit: f64) -> Self {
        let m = self.dof();
        let mut scaled = self.clone();
        for i in 0..m {
            scaled.a.row_mut(m + i).unscale_mut(unit);
            scaled.b.row_mut(m + i).unscale_mut(unit);
            scaled.a.column_mut(m + i).scale_mut(unit);
            scaled.c.column_mut(m + i).scale_mut(unit);
            scaled.rate[m + i] /= unit;
        }
        scaled
    }

    /// A unit for [`scaled`](Self::scaled), 1/s: the root of the largest stiffness over
    /// mass.
    pub(super) fn unit(&self) -> f64 {
        let m = self.dof();
        let stiffness = self.a.view((m, 0), (m, m)).amax();
        stiffness.sqrt().max(1.0)
    }

    /// Poles of the plant without feedback, 1/s, slowest first, each pair with its
    /// positive frequency first.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        let mut poles: Vec<Complex<f64>> = super::eigenvalues(self.scaled(self.unit()).a);
        sort(&mut poles);
        poles
    }
}

/// Slowest first; a pair's positive frequency first.
pub(super) fn sort(poles: &mut [Complex<f64>]) {
    poles.sort_by(|a, b| {
        let key = |p: &Complex<f64>| (norm(*p) * 1e9).round();
        key(a).total_cmp(&key(b)).then(b.im.total_cmp(&a.im))
    });
}

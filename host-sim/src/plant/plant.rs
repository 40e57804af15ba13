//! The simulated arm: the full equations of motion with the tip on a rigid
//! frictionless surface, driven by torques that are held for a control period.
//!
//! The plant need not be the model that was planned with: it has its own number of
//! elements, scaled parameters, friction and geometric stiffness.
//!
//! Time is an integer number of steps. Each is one of a Runge-Kutta method of order 8
//! ([`crate::plant::integrator`]), after which angles and rates are brought back onto the
//! surface (they drift off it by the step's error, 1e-14 m or so), so the constraint
//! holds to rounding for ever. The contact force is the constraint's multiplier; the
//! constraint is two-sided, so a tip that would lift off is held and its force comes
//! out negative.

use crate::model::arm_model::{ArmModel, ModelError, dot};
use crate::model::configuration::{Configuration, State, Surface};
use crate::model::dynamics;
use crate::model::forward::{Actuation, Workspace, forward};
use crate::plant::PlantParameters;
use crate::plant::bent_rest::rest_under;
use crate::plant::friction::{friction, steepest};
use crate::plant::integrator::{Integrator, STEP_TIMES_FREQUENCY};
use flexor::model::Kinematics;
use flexor::number::Real;

/// Most integration steps in a control period.
pub const SUBSTEPS_MAX: u32 = 10_000;

/// Why there is no plant.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// No model of the arm.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No equilibrium to start from.
    #[error(
        "the plant's link 2 has no resting shape under the planned force: it buckles; more bending_stiffness_scale or less force is accepted"
    )]
    Buckled,
    /// The link is too stiff to integrate explicitly.
    #[error(
        "the plant's highest frequency, {frequency_hz:.3e} Hz, needs {substeps:.3e} integration steps a control period: up to {SUBSTEPS_MAX} are accepted; fewer elements, less stiffness and less damping lower it"
    )]
    TooStiff {
        /// Bound on the highest frequency, Hz.
        frequency_hz: f64,
        /// Steps it needs.
        substeps: f64,
    },
}

/// State, laid out as [`State`], of a plant with `model` and `parameters` at rest at `angle`
/// (rad), its tip pressing with `force` (N, inertial axes) on the surface.
///
/// # Errors
/// [`PlantError::Buckled`].
pub fn resting_state(
    model: &ArmModel,
    parameters: &PlantParameters,
    angle: [f64; 2],
    force: [f64; 2],
) -> Result<Vec<f64>, PlantError> {
    let geometric = parameters.geometric_stiffness.is_any();
    let (q, _) =
        dynamics::equilibrium(model, angle, force, geometric).ok_or(PlantError::Buckled)?;
    Ok(state_of(angle, &q, &vec![0.0; model.dof()]))
}

/// State, laid out as [`State`], of a plant with the geometric `model`, at rest with `torque` (N m) on its
/// joints and its tip on `surface`, near the joint angles `near` (rad).
///
/// # Errors
/// [`PlantError::Buckled`].
pub fn resting_state_under(
    model: &ArmModel,
    surface: &Surface,
    torque: [f64; 2],
    near: [f64; 2],
) -> Result<Vec<f64>, PlantError> {
    let (angle, w) = rest_under(model, surface, torque, near).ok_or(PlantError::Buckled)?;
    let q = &model.coordinates * nalgebra::DVector::from_vec(w);
    Ok(state_of(angle, q.as_slice(), &vec![0.0; model.dof()]))
}

/// State, laid out as [`State`], with joints at rest at `angle` (rad), the modal coordinates
/// `q` and their rates `q_rate` (1/s).
pub fn state_of(angle: [f64; 2], q: &[f64], q_rate: &[f64]) -> Vec<f64> {
    [&angle, &[0.0; 2], q, q_rate].concat()
}

/// Writes the time derivative of `state` to `derivative` and returns the contact
/// force along the surface normal, N, with the drives giving `torque` (N m).
/// Layout of both as [`State`].
pub fn derivative<T: Real>(
    model: &ArmModel,
    parameters: &PlantParameters,
    surface: &Surface,
    torque: [T; 2],
    state: &[T],
    derivative: &mut [T],
    workspace: &mut Workspace<T>,
) -> T {
    let n = model.dof();
    let view = State(state);
    let q_acceleration = &mut derivative[4 + n..];
    let net = |rates: [T; 2]| {
        let lost = friction(parameters, rates);
        [torque[0] - lost[0], torque[1] - lost[1]]
    };
    let (acceleration, force) = match &mut workspace.bent {
        Some(bent) => {
            let found = bent.on_surface(model, surface, view, net, q_acceleration);
            (found.angle, found.force)
        }
        None => {
            let [rate1, rate2] = view.rate();
            let root_rate = dot(&model.root_slope, view.q_rate());
            let drive = Actuation {
                torque: net([rate1, rate2 + root_rate - rate1]),
                geometric_stiffness: parameters.geometric_stiffness.is_any(),
            };
            forward(model, surface, view, &drive, workspace, q_acceleration)
        }
    };
    [derivative[0], derivative[1]] = view.rate();
    derivative[2] = acceleration[0];
    derivative[3] = acceleration[1];
    derivative[4..4 + n].copy_from_slice(view.q_rate());
    force
}

/// What can be seen of the plant at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// (theta10, theta20), rad.
    pub angle: [f64; 2],
    /// Their rates, rad/s.
    pub rate: [f64; 2],
    /// Slope of link 2 at its root, rad.
    pub root_slope: f64,
    /// Its rate, rad/s.
    pub root_slope_rate: f64,
    /// Tip position, m.
    pub tip: [f64; 2],
    /// Contact force along the surface normal, pressing positive, N.
    pub force: f64,
    /// Bending moment at link 2's root, N m: joint 2's torque less friction and what the inertia
    /// at the root takes.
    pub root_moment: f64,
}

/// The simulated arm.
///
/// At rest under the torques that hold it, it stays so:
///
/// ```
/// use flexor_sim::files::config::{self, DEFAULT_ARM};
/// use flexor_sim::model::configuration::Surface;
/// use flexor_sim::model::{dynamics::equilibrium, link::LinkKind};
/// use flexor_sim::plant::{Plant, PlantParameters, resting_state};
///
/// let arm = config::parse_arm("arm.toml", DEFAULT_ARM)?.arm;
/// let parameters = PlantParameters::default();
/// let model = parameters.model(&arm, LinkKind::default())?;
/// // The tip at (0.6, 0.05) m presses with 2 N on a surface below it; a2 points down.
/// let surface = Surface { normal: [0.0, 1.0], offset_m: 0.05 };
/// let angle = model.kinematics.inverse([0.6, 0.05], arm.elbow).expect("in reach");
/// let force = surface.normal.map(|n| 2.0 * n);
/// let (_, torque) = equilibrium(&model, angle, force, false).expect("it does not buckle");
///
/// let state = resting_state(&model, &parameters, angle, force)?;
/// let mut plant = Plant::new(model, &parameters, surface, 1.0 / 5000.0, state)?;
/// for _ in 0..500 {
///     plant.advance(torque);
/// }
/// assert!((plant.read(torque).force - 2.0).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Plant {
    model: ArmModel,
    parameters: PlantParameters,
    surface: Surface,
    /// Control period, s.
    period: f64,
    /// Integration steps in it.
    substeps: u32,
    /// Steps taken so far.
    steps: u64,
    state: Vec<f64>,
    /// Reused, so that a period allocates nothing: see [`read`](Self::read).
    slope: Vec<f64>,
    workspace: Workspace<f64>,
    integrator: Integrator,
}

impl Plant {
    /// The plant with `model` (see [`PlantParameters::model`]) and its tip on `surface`, for
    /// control periods of `period_s` (s), in `state`, laid out as [`State`].
    ///
    /// The integration step is chosen for the configuration of `state`; see
    /// [`prepare_for`](Self::prepare_for).
    ///
    /// # Errors
    /// [`PlantError::TooStiff`].
    ///
    /// # Panics
    /// If `state` has other than 4 + 2 [`ArmModel::dof`] numbers.
    pub fn new(
        model: ArmModel,
        parameters: &PlantParameters,
        surface: Surface,
        period_s: f64,
        state: Vec<f64>,
    ) -> Result<Self, PlantError> {
        assert_eq!(state.len(), 4 + 2 * model.dof(), "length of the state");
        let angle = State(state.as_slice()).angle();
        let mut plant = Self {
            slope: vec![0.0; state.len()],
            workspace: Workspace::new(&model),
            model,
            parameters: *parameters,
            surface,
            period: period_s,
            substeps: parameters.substeps.unwrap_or(1),
            steps: 0,
            integrator: Integrator::new(state.len()),
            state,
        };
        plant.prepare_for(angle)?;
        Ok(plant)
    }

    /// Chooses a shorter integration step if the configuration `angle` (rad), which the
    /// plant is going to be in, needs it: frequencies depend on the configuration.
    /// [`PlantParameters::substeps`] prevails. To be called before the first step.
    ///
    /// # Errors
    /// [`PlantError::TooStiff`].
    pub fn prepare_for(&mut self, angle: [f64; 2]) -> Result<(), PlantError> {
        if self.parameters.substeps.is_some() {
            return Ok(());
        }
        let steepest = steepest(&self.parameters);
        let frequency = highest_frequency(&self.model, steepest, &self.surface, angle);
        let needed = (frequency * self.period / STEP_TIMES_FREQUENCY).ceil();
        if !(needed <= f64::from(SUBSTEPS_MAX)) {
            return Err(PlantError::TooStiff {
                frequency_hz: frequency / core::f64::consts::TAU,
                substeps: needed,
            });
        }
        self.substeps = self.substeps.max(needed as u32);
        Ok(())
    }

    /// The plant's model.
    pub fn model(&self) -> &ArmModel {
        &self.model
    }

    /// Integration steps a control period.
    pub fn substeps(&self) -> u32 {
        self.substeps
    }

    /// State, laid out as [`State`].
    pub fn state(&self) -> &[f64] {
        &self.state
    }

    /// Puts the plant into another state, laid out as [`State`]; it is brought onto
    /// the surface.
    ///
    /// # Panics
    /// If the length is not that of [`state`](Self::state).
    pub fn set_state(&mut self, state: &[f64]) {
        self.state.copy_from_slice(state);
        self.project();
    }

    /// Outputs y(x, u) of the present state with `torque` (N m) on the joints: the contact
    /// force depends on the present torque (direct feed-through).
    pub fn read(&mut self, torque: [f64; 2]) -> Reading {
        let force = derivative(
            &self.model,
            &self.parameters,
            &self.surface,
            torque,
            &self.state,
            &mut self.slope,
            &mut self.workspace,
        );
        let n = self.model.dof();
        let state = State(self.state.as_slice());
        let [rate1, rate2] = state.rate();
        let [[chord, _], [root_slope, root_slope_rate]] = self.workspace.shape(&self.model, state);
        let lost = friction(&self.parameters, [rate1, rate2 + root_slope_rate - rate1]);
        let turned = self
            .workspace
            .root_acceleration(&self.model, &self.slope[4 + n..]);
        let hub = self.model.arm.root_inertia_kgm2 * (self.slope[3] + turned);
        Reading {
            angle: state.angle(),
            rate: state.rate(),
            root_slope,
            root_slope_rate,
            tip: self.tip(chord),
            force,
            root_moment: torque[1] - lost[1] - hub,
        }
    }

    /// Position of the tip, m, with a chord of that length, m.
    fn tip(&self, chord: f64) -> [f64; 2] {
        let kinematics = Kinematics {
            link1_length: self.model.arm.link1_length_m,
            link2_length: chord,
        };
        kinematics.forward(State(self.state.as_slice()).angle())
    }

    /// Signed distance of the tip from the surface, m.
    pub fn constraint(&mut self) -> f64 {
        let [[chord, _], _] = self.workspace.shape(&self.model, State(&self.state));
        let tip = self.tip(chord);
        let normal = self.surface.normal;
        normal[0] * tip[0] + normal[1] * tip[1] - self.surface.offset_m
    }

    /// One control period with `torque` (N m) held.
    pub fn advance(&mut self, torque: [f64; 2]) {
        self.advance_with(|_| torque);
    }

    /// One control period with the torque (N m) as a function of the time since the
    /// plant's start, s.
    pub fn advance_with(&mut self, mut torque: impl FnMut(f64) -> [f64; 2]) {
        let h = self.period / f64::from(self.substeps);
        for _ in 0..self.substeps {
            let t = self.steps as f64 * h;
            self.integrator
                .step(&mut self.state, h, |fraction, state, slope| {
                    derivative(
                        &self.model,
                        &self.parameters,
                        &self.surface,
                        torque(t + fraction * h),
                        state,
                        slope,
                        &mut self.workspace,
                    );
                });
            self.project();
            self.steps += 1;
        }
    }

    /// Brings angles and rates onto the surface by the shortest way.
    fn project(&mut self) {
        let r1 = self.model.arm.link1_length_m;
        let normal = self.surface.normal;
        // The shape stays as it is.
        let [[chord, chord_rate], _] = self.workspace.shape(&self.model, State(&self.state));
        // A step's error is far below 1e-7 m, and Newton squares it; a state that is given may be off by more.
        for _ in 0..5 {
            let (s1, c1) = libm::sincos(self.state[0]);
            let (s2, c2) = libm::sincos(self.state[1]);
            let gradient = [
                r1 * (normal[1] * c1 - normal[0] * s1),
                chord * (normal[1] * c2 - normal[0] * s2),
            ];
            let along = normal[0] * c2 + normal[1] * s2;
            let distance =
                r1 * (normal[0] * c1 + normal[1] * s1) + chord * along - self.surface.offset_m;
            let square = gradient[0] * gradient[0] + gradient[1] * gradient[1];
            let speed =
                gradient[0] * self.state[2] + gradient[1] * self.state[3] + chord_rate * along;
            for (i, gradient) in gradient.into_iter().enumerate() {
                self.state[i] -= distance * gradient / square;
                self.state[2 + i] -= speed * gradient / square;
            }
            if distance.abs() < 1e-13 {
                break;
            }
        }
    }
}

/// Upper bound on the magnitudes, rad/s, of the eigenvalues of the arm at `angle` with its
/// tip on `surface` and friction of the slopes `friction` (N m s/rad) in the two joints.
///
/// Eliminating the motion along it leaves the modes with a reduced mass `1 - h h' / m`, whose
/// stiffness is at most `omega^2 = omega_max^2 + |omega h|^2 / (m - h.h)`. Friction on a joint
/// whose rate is `j` times the sliding speed plus `e.q'` adds a damping of at most its slope
/// times that rate's mobility, `e.e + (j - h.e)^2 / (m - h.h)`, in a direction of unit mass:
/// on a root without inertia it is what the step must be short for. Stiffness at most
/// `omega^2` and damping at most `d` bound the eigenvalues by `d/2 + sqrt(d^2/4 + omega^2)`.
fn highest_frequency(
    model: &ArmModel,
    friction: [f64; 2],
    surface: &Surface,
    angle: [f64; 2],
) -> f64 {
    let configuration = Configuration::new(model, angle);
    let (r1, r2) = (model.arm.link1_length_m, model.arm.link2_length_m);
    // Rates of the two angles when the tip slides.
    let slide = [
        -r2 * configuration.along_n2(surface.normal),
        r1 * configuration.along_n1(surface.normal),
    ];
    let mass = (model.link1_inertia + model.link2_mass * r1 * r1) * slide[0] * slide[0]
        + 2.0 * r1 * model.link2_moment * configuration.c * slide[0] * slide[1]
        + model.link2_inertia * slide[1] * slide[1];
    let (mut coupling, mut stiffness, mut root_coupling) = (0.0, 0.0, 0.0);
    for i in 0..model.dof() {
        let h = slide[0] * r1 * configuration.c * model.first_moment[i]
            + slide[1] * model.second_moment[i];
        coupling += h * h;
        stiffness += h * h * model.stiffness[i];
        root_coupling += h * model.root_slope[i];
    }
    let highest = model.angular_frequency.last().copied().unwrap_or(0.0);
    let squared = highest * highest + stiffness / (mass - coupling);

    let root = dot(&model.root_slope, &model.root_slope);
    let joint2 = slide[1] - slide[0] - root_coupling;
    let mobility = [slide[0] * slide[0], joint2 * joint2].map(|j| j / (mass - coupling));
    // Bending damping is `beta` times the stiffness.
    let bending = model.link.retardation_s * squared;
    let damping = bending + friction[0] * mobility[0] + friction[1] * (root + mobility[1]);
    0.5 * damping + (0.25 * damping * damping + squared).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::energy::energy as energy_of;
    use crate::model::geometric_stiffness::GeometricStiffness;
    use crate::model::link::LinkKind;
    use crate::testing;
    use flexor::model::ArmParameters;

    /// Where the paper's path starts, pressed downwards with 2 N.
    const SURFACE: Surface = Surface {
        normal: [0.0, 1.0],
        offset_m: 0.05,
    };
    const FORCE: [f64; 2] = [0.0, 2.0];
    const PERIOD_S: f64 = 1.0 / 5000.0;

    /// `arm` at rest on the surface under [`FORCE`] as the plant with `parameters` bends,
    /// with control periods of `period_s`.
    fn resting(arm: &ArmParameters, parameters: &PlantParameters, period_s: f64) -> Plant {
        let model = parameters.model(arm, LinkKind::default()).unwrap();
        let angle = model.kinematics.inverse([0.7, 0.05], arm.elbow).unwrap();
        let state = resting_state(&model, parameters, angle, FORCE).unwrap();
        Plant::new(model, parameters, SURFACE, period_s, state).unwrap()
    }

    /// A plant that slides and rings freely, without torque, gravity or damping.
    fn ringing(period_s: f64, substeps: Option<u32>, elements: usize) -> Plant {
        let arm = ArmParameters {
            gravity_m_s2: [0.0, 0.0],
            damping_ratio: 0.0,
            ..testing::PAPER
        };
        let parameters = PlantParameters {
            elements,
            substeps,
            ..PlantParameters::default()
        };
        let mut plant = resting(&arm, &parameters, period_s);
        let mut state = plant.state().to_vec();
        // The bent link is let go while the tip slides at about 0.5 m/s.
        state[2] = 1.0;
        state[3] = 0.5;
        plant.set_state(&state);
        plant
    }

    fn energy(plant: &Plant) -> f64 {
        energy_of(plant.model(), State(plant.state()))
    }

    /// Largest relative change of the energy in a second.
    fn energy_drift(mut plant: Plant) -> f64 {
        let before = energy(&plant);
        let elastic: f64 = State(plant.state())
            .q()
            .iter()
            .zip(&plant.model.stiffness)
            .map(|(q, k)| 0.5 * k * q * q)
            .sum();
        assert!(
            elastic > 0.05 * before,
            "nothing rings: {elastic} of {before}"
        );
        let mut worst = 0.0_f64;
        for _ in 0..5000 {
            plant.advance([0.0; 2]);
            worst = worst.max((energy(&plant) / before - 1.0).abs());
            assert!(plant.constraint().abs() < 1e-12);
        }
        worst
    }

    #[test]
    fn energy_is_kept_for_a_second() {
        for elements in [3, 8] {
            // The three lowest modes ring, at the step that the plant chooses itself.
            let mut plant = ringing(PERIOD_S, None, elements);
            let mut state = plant.state().to_vec();
            state[4..4 + 2 * elements].fill(0.0);
            state[4..7].copy_from_slice(&[8e-3, 2e-3, 5e-4]);
            plant.set_state(&state);
            let drift = energy_drift(plant);
            assert!(drift < 1e-9, "{elements} elements: {drift:e}");

            // The bent link is let go, which rings all modes up to the highest.
            let plant = ringing(PERIOD_S, Some(12), elements);
            let drift = energy_drift(plant);
            assert!(drift < 1e-9, "{elements} elements, let go: {drift:e}");
        }
    }

    #[test]
    fn halving_the_step_divides_the_error_by_two_to_the_eighth() {
        // At 1 kHz the error is far enough above rounding.
        let after = |substeps: u32| {
            let mut plant = ringing(1e-3, Some(substeps), 3);
            (0..50).for_each(|_| plant.advance([0.5, 0.1]));
            plant.state().to_vec()
        };
        let states = [2, 4, 8].map(after);
        let distance = |a: &[f64], b: &[f64]| {
            a.iter()
                .zip(b)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max)
        };
        let ratio = distance(&states[0], &states[1]) / distance(&states[1], &states[2]);
        assert!((ratio.log2() - 8.0).abs() < 0.7, "order {}", ratio.log2());
    }

    #[test]
    fn the_plants_own_equilibrium_rests_on_the_planned_force() {
        for geometric_stiffness in [
            GeometricStiffness::None,
            GeometricStiffness::Contact,
            GeometricStiffness::Full,
        ] {
            let parameters = PlantParameters {
                bending_stiffness_scale: 0.9,
                geometric_stiffness,
                ..PlantParameters::default()
            };
            let mut plant = resting(&testing::PAPER, &parameters, PERIOD_S);
            let geometric = parameters.geometric_stiffness.is_any();
            let angle = State(plant.state()).angle();
            let (_, torque) =
                dynamics::equilibrium(plant.model(), angle, FORCE, geometric).unwrap();
            for _ in 0..500 {
                plant.advance(torque);
            }
            let reading = plant.read(torque);
            assert!((reading.force - 2.0).abs() < 1e-8, "{}", reading.force);
            assert!((reading.tip[0] - 0.7).abs() < 1e-9);
        }
    }

    #[test]
    fn friction_takes_energy() {
        let mut plant = ringing(PERIOD_S, Some(2), 3);
        plant.parameters.viscous_friction_nms_rad = [0.05, 0.002];
        plant.parameters.coulomb_friction_nm = [0.02, 0.001];
        let mut before = energy(&plant);
        for _ in 0..500 {
            plant.advance([0.0; 2]);
            let now = energy(&plant);
            assert!(now < before);
            before = now;
        }
    }

    #[test]
    fn the_frequency_bound_bounds_and_is_tight() {
        let plant = ringing(PERIOD_S, None, 8);
        let bound = highest_frequency(&plant.model, [0.0; 2], &plant.surface, [0.96, -0.71]);
        let highest = plant.model.angular_frequency.last().copied().unwrap();
        assert!(
            bound >= highest && bound < 3.0 * highest,
            "{bound} {highest}"
        );
        // It is the true highest frequency to a third: with a step at 5.9 by the bound the
        // method is stable, with twice that it is not.
        let steady = |limit: f64| {
            let mut plant = ringing(limit / bound, Some(1), 8);
            (0..2000).for_each(|_| plant.advance([0.0; 2]));
            plant.state().iter().all(|x| x.abs() < 100.0)
        };
        assert!(steady(5.5) && !steady(12.0));
    }
}

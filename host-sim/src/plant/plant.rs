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
use crate::model::forward::{Actuation, forward};
use crate::planner::plan::Plan;
use crate::plant::integrator::{Integrator, STEP_TIMES_FREQUENCY};
use flexor::model::ArmParameters;
use flexor::number::Real;

/// Most integration steps in a control period.
pub const SUBSTEPS_MAX: u32 = 10_000;

/// How the plant differs from the arm that was planned for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantParameters {
    /// Elements of link 2.
    pub elements: usize,
    /// Factor on link 2's bending stiffness.
    pub bending_stiffness_scale: f64,
    /// Factor on link 1's mass.
    pub link1_mass_scale: f64,
    /// Factor on link 2's mass.
    pub link2_mass_scale: f64,
    /// Factor on the damping ratio.
    pub damping_scale: f64,
    /// Root inertia, kg m^2; `None` for the arm's.
    pub root_inertia_kgm2: Option<f64>,
    /// Tip mass, kg; `None` for the arm's.
    pub tip_mass_kg: Option<f64>,
    /// Tip inertia, kg m^2; `None` for the arm's.
    pub tip_inertia_kgm2: Option<f64>,
    /// Viscous friction of the two joints, N m s/rad.
    pub viscous_friction_nms_rad: [f64; 2],
    /// Coulomb friction of the two joints, N m.
    pub coulomb_friction_nm: [f64; 2],
    /// Whether axial force changes the bending stiffness.
    pub geometric_stiffness: bool,
    /// Integration steps a control period; `None` derives them from the highest
    /// frequency.
    pub substeps: Option<u32>,
}

impl Default for PlantParameters {
    /// The arm as it is, with eight elements.
    fn default() -> Self {
        Self {
            elements: 8,
            bending_stiffness_scale: 1.0,
            link1_mass_scale: 1.0,
            link2_mass_scale: 1.0,
            damping_scale: 1.0,
            root_inertia_kgm2: None,
            tip_mass_kg: None,
            tip_inertia_kgm2: None,
            viscous_friction_nms_rad: [0.0; 2],
            coulomb_friction_nm: [0.0; 2],
            geometric_stiffness: false,
            substeps: None,
        }
    }
}

impl PlantParameters {
    /// The arm that the plant is.
    pub fn arm(&self, planned: &ArmParameters) -> ArmParameters {
        ArmParameters {
            link1_mass_kg: planned.link1_mass_kg * self.link1_mass_scale,
            link2_mass_kg: planned.link2_mass_kg * self.link2_mass_scale,
            bending_stiffness_nm2: planned.bending_stiffness_nm2 * self.bending_stiffness_scale,
            damping_ratio: planned.damping_ratio * self.damping_scale,
            root_inertia_kgm2: self.root_inertia_kgm2.unwrap_or(planned.root_inertia_kgm2),
            tip_mass_kg: self.tip_mass_kg.unwrap_or(planned.tip_mass_kg),
            tip_inertia_kgm2: self.tip_inertia_kgm2.unwrap_or(planned.tip_inertia_kgm2),
            ..*planned
        }
    }
}

/// State that the plant starts in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// The plan's first shape with the plan's elastic velocity.
    PlanMoving,
    /// The plan's first shape at rest.
    #[default]
    PlanAtRest,
    /// The plant's own equilibrium under the planned force.
    Equilibrium,
}

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
        "the plant's highest frequency, {frequency_hz:.3e} Hz, needs {substeps:.3e} integration steps a control period: up to {SUBSTEPS_MAX} are accepted; fewer elements or less stiffness lower it"
    )]
    TooStiff {
        /// Bound on the highest frequency, Hz.
        frequency_hz: f64,
        /// Steps it needs.
        substeps: f64,
    },
}

/// Friction torques on the joints, N m, for the motors' rates (rad/s): viscous, and
/// Coulomb made smooth over 0.01 rad/s so that the integration keeps its order.
fn friction<T: Real>(parameters: &PlantParameters, rate: [T; 2]) -> [T; 2] {
    const SMOOTH: f64 = 0.01;
    [0, 1].map(|joint| {
        let v = rate[joint];
        let smooth = (v * v + T::from_f64(SMOOTH * SMOOTH)).sqrt();
        T::from_f64(parameters.viscous_friction_nms_rad[joint]) * v
            + T::from_f64(parameters.coulomb_friction_nm[joint]) * v / smooth
    })
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
) -> T {
    let n = model.dof();
    let view = State(state);
    let [rate1, rate2] = view.rate();
    let root_rate = view
        .q_rate()
        .iter()
        .zip(&model.root_slope)
        .fold(T::ZERO, |sum, (v, e)| sum + T::from_f64(*e) * *v);
    let lost = friction(parameters, [rate1, rate2 + root_rate - rate1]);
    let drive = Actuation {
        torque: [torque[0] - lost[0], torque[1] - lost[1]],
        geometric_stiffness: parameters.geometric_stiffness,
    };
    let (acceleration, force) = forward(model, surface, view, &drive, &mut derivative[4 + n..]);
    derivative[0] = rate1;
    derivative[1] = rate2;
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
}

/// The simulated arm.
#[derive(Clone, Debug)]
pub struct Plant {
    model: ArmModel,
    parameters: PlantParameters,
    surface: Surface,
    /// Integration step, s.
    step: f64,
    /// Steps a control period.
    substeps: u32,
    /// Steps taken so far.
    steps: u64,
    state: Vec<f64>,
    integrator: Integrator,
}

impl Plant {
    /// The plant for `plan`, at the plan's first tick.
    ///
    /// # Errors
    /// [`PlantError`].
    pub fn new(
        plan: &Plan,
        parameters: &PlantParameters,
        start: Start,
    ) -> Result<Self, PlantError> {
        let model = ArmModel::new(&parameters.arm(&plan.model.arm), parameters.elements)?;
        let n = model.dof();
        let mut sampler = plan.sampler();
        let point = sampler.at(plan.time(0));
        let (q, q_rate) = match start {
            Start::PlanMoving => (
                model.adopt(&plan.model, sampler.q()),
                model.adopt(&plan.model, sampler.q_rate()),
            ),
            Start::PlanAtRest => (model.adopt(&plan.model, sampler.q()), vec![0.0; n]),
            Start::Equilibrium => {
                let geometric = parameters.geometric_stiffness;
                let angle = point.joint.angle;
                let (q, _) = dynamics::equilibrium(&model, angle, plan.force(), geometric)
                    .ok_or(PlantError::Buckled)?;
                (q, vec![0.0; n])
            }
        };
        let mut state = Vec::with_capacity(4 + 2 * n);
        state.extend(point.joint.angle);
        state.extend([0.0; 2]);
        state.extend(q);
        state.extend(q_rate);

        let period = 1.0 / f64::from(plan.tick_rate_hz);
        let ends = [0, plan.points.len() - 1].map(|i| plan.points[i].joint.angle);
        let frequency = ends
            .iter()
            .map(|angle| highest_frequency(&model, &plan.surface, *angle))
            .fold(0.0, f64::max);
        let needed = (frequency * period / STEP_TIMES_FREQUENCY).ceil().max(1.0);
        let substeps = match parameters.substeps {
            Some(substeps) => substeps,
            None if needed <= f64::from(SUBSTEPS_MAX) => needed as u32,
            None => {
                return Err(PlantError::TooStiff {
                    frequency_hz: frequency / core::f64::consts::TAU,
                    substeps: needed,
                });
            }
        };
        Ok(Self {
            model,
            parameters: *parameters,
            surface: plan.surface,
            step: period / f64::from(substeps),
            substeps,
            steps: 0,
            integrator: Integrator::new(state.len()),
            state,
        })
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

    /// What can be seen, with the drives giving `torque` (N m): the contact force
    /// follows the torque at once.
    pub fn read(&self, torque: [f64; 2]) -> Reading {
        let mut slope = vec![0.0; self.state.len()];
        let force = derivative(
            &self.model,
            &self.parameters,
            &self.surface,
            torque,
            &self.state,
            &mut slope,
        );
        let state = State(self.state.as_slice());
        Reading {
            angle: state.angle(),
            rate: state.rate(),
            root_slope: dot(&self.model.root_slope, state.q()),
            root_slope_rate: dot(&self.model.root_slope, state.q_rate()),
            tip: self.model.kinematics.forward(state.angle()),
            force,
        }
    }

    /// Signed distance of the tip from the surface, m.
    pub fn constraint(&self) -> f64 {
        let tip = self
            .model
            .kinematics
            .forward([self.state[0], self.state[1]]);
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
        let h = self.step;
        for _ in 0..self.substeps {
            let t = self.steps as f64 * h;
            self.integrator
                .step(&mut self.state, h, |share, state, slope| {
                    derivative(
                        &self.model,
                        &self.parameters,
                        &self.surface,
                        torque(t + share * h),
                        state,
                        slope,
                    );
                });
            self.project();
            self.steps += 1;
        }
    }

    /// Brings angles and rates onto the surface by the shortest way.
    fn project(&mut self) {
        let (r1, r2) = (self.model.arm.link1_length_m, self.model.arm.link2_length_m);
        let normal = self.surface.normal;
        // The step's error is far below 1e-7 m, and Newton squares it.
        for _ in 0..2 {
            let (s1, c1) = (self.state[0].sin(), self.state[0].cos());
            let (s2, c2) = (self.state[1].sin(), self.state[1].cos());
            let gradient = [
                r1 * (normal[1] * c1 - normal[0] * s1),
                r2 * (normal[1] * c2 - normal[0] * s2),
            ];
            let distance = normal[0] * (r1 * c1 + r2 * c2) + normal[1] * (r1 * s1 + r2 * s2)
                - self.surface.offset_m;
            let square = gradient[0] * gradient[0] + gradient[1] * gradient[1];
            let speed = gradient[0] * self.state[2] + gradient[1] * self.state[3];
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

/// Upper bound on the angular frequencies, rad/s, of the arm at `angle` with its tip
/// on `surface`: eliminating the sliding motion leaves the modes with a reduced mass
/// `1 - h h' / m`, whose stiffness is at most `omega_max^2 + |omega h|^2 / (m - h.h)`.
fn highest_frequency(model: &ArmModel, surface: &Surface, angle: [f64; 2]) -> f64 {
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
    let (mut coupling, mut stiffness) = (0.0, 0.0);
    for i in 0..model.dof() {
        let h = slide[0] * r1 * configuration.c * model.first_moment[i]
            + slide[1] * model.second_moment[i];
        coupling += h * h;
        stiffness += h * h * model.stiffness[i];
    }
    let highest = model.angular_frequency.last().copied().unwrap_or(0.0);
    (highest * highest + stiffness / (mass - coupling)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::path::{LinePath, Profile};
    use crate::planner::plan::{PlanOptions, plan};
    use crate::planner::task::{Task, Window};
    use crate::testing;

    fn task(duration: f64) -> Task {
        Task {
            path: LinePath {
                from: [0.7, 0.05],
                to: [0.2, 0.05],
                duration,
                profile: Profile::Poly11,
            },
            normal_force: 2.0,
            direction: None,
            pre_actuation: Window::Fixed(0.0),
            post_actuation: Window::Fixed(0.0),
        }
    }

    fn free_arm() -> ArmParameters {
        ArmParameters {
            gravity_m_s2: [0.0, 0.0],
            damping_ratio: 0.0,
            ..testing::PAPER
        }
    }

    /// A plant that slides and rings freely, without torque, gravity or damping.
    fn ringing(options: &PlanOptions, substeps: Option<u32>, elements: usize) -> Plant {
        let plan = plan(&free_arm(), &task(2.0), options).unwrap();
        let parameters = PlantParameters {
            elements,
            substeps,
            ..PlantParameters::default()
        };
        let mut plant = Plant::new(&plan, &parameters, Start::PlanAtRest).unwrap();
        let mut state = plant.state().to_vec();
        // The bent link is let go while the tip slides at about 0.5 m/s.
        state[2] = 1.0;
        state[3] = 0.5;
        plant.set_state(&state);
        plant
    }

    fn energy(plant: &Plant) -> f64 {
        dynamics::energy(plant.model(), State(plant.state()))
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
            let mut plant = ringing(&PlanOptions::default(), None, elements);
            let mut state = plant.state().to_vec();
            state[4..4 + 2 * elements].fill(0.0);
            state[4..7].copy_from_slice(&[8e-3, 2e-3, 5e-4]);
            plant.set_state(&state);
            let drift = energy_drift(plant);
            assert!(drift < 1e-9, "{elements} elements: {drift:e}");

            // The bent link is let go, which rings all modes up to the highest.
            let plant = ringing(&PlanOptions::default(), Some(12), elements);
            let drift = energy_drift(plant);
            assert!(drift < 1e-9, "{elements} elements, let go: {drift:e}");
        }
    }

    #[test]
    fn halving_the_step_divides_the_error_by_two_to_the_eighth() {
        // At 1 kHz the error is far enough above rounding.
        let slow = PlanOptions {
            tick_rate_hz: 1000,
            ..PlanOptions::default()
        };
        let after = |substeps: u32| {
            let mut plant = ringing(&slow, Some(substeps), 3);
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
        for geometric_stiffness in [false, true] {
            let plan = plan(&testing::PAPER, &task(2.0), &PlanOptions::default()).unwrap();
            let parameters = PlantParameters {
                bending_stiffness_scale: 0.9,
                geometric_stiffness,
                ..PlantParameters::default()
            };
            let mut plant = Plant::new(&plan, &parameters, Start::Equilibrium).unwrap();
            let geometric = parameters.geometric_stiffness;
            let angle = State(plant.state()).angle();
            let (_, torque) =
                dynamics::equilibrium(plant.model(), angle, plan.force(), geometric).unwrap();
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
        let mut plant = ringing(&PlanOptions::default(), Some(2), 3);
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
        let plant = ringing(&PlanOptions::default(), None, 8);
        let bound = highest_frequency(&plant.model, &plant.surface, [0.96, -0.71]);
        let highest = plant.model.angular_frequency.last().copied().unwrap();
        assert!(
            bound >= highest && bound < 3.0 * highest,
            "{bound} {highest}"
        );
        // It is the true highest frequency to a third: with a step at 5.9 by the bound the
        // method is stable, with twice that it is not.
        let steady = |limit: f64| {
            let options = PlanOptions {
                tick_rate_hz: (bound / limit).ceil() as u32,
                ..PlanOptions::default()
            };
            let mut plant = ringing(&options, Some(1), 8);
            (0..2000).for_each(|_| plant.advance([0.0; 2]));
            plant.state().iter().all(|x| x.abs() < 100.0)
        };
        assert!(steady(5.5) && !steady(12.0));
    }
}

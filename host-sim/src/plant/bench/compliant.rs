//! The bench's plant: the arm with everything that a real one has, its tip on a compliant surface.
//!
//! It puts the laws together, each of which has its own file: the arm
//! ([`crate::plant::bench::free_arm`]), surface and contact ([`crate::plant::bench::surface`],
//! [`crate::plant::bench::contact`]), joints ([`crate::plant::bench::joint`]) and the drives' lag
//! ([`crate::plant::bench::drive`]). What happens once a tick, drives' delay and sensors, is beside it:
//! [`crate::plant::bench::Drive`], [`crate::plant::bench::Sensors`]. The rigid plant, [`crate::plant::Plant`],
//! stays the one that stability is proved for.
//!
//! **State**: that of the rigid plant, `[theta10, theta20, theta10', theta20', q..., q'...]`,
//! then the deflections of the bristles of surface (m), joint 1 and joint 2 (rad), then angle and
//! rate of the rotor of each joint with play (rad, rad/s; absolute).
//!
//! **Integration**: Runge-Kutta of order 4 at a fixed step, a whole number of which make a control
//! period; [`crate::plant::bench::step`] chooses it by the largest eigenvalue, contact, bristles and
//! gears included. Order 4 as long as contact and bristles stay in their branch; in a step with
//! an event (touch-down, lift-off, an edge, a bristle that begins to slide) order 1.
//!
//! **Lanes**: several arms at once, [`crate::plant::bench::lanes`].

use crate::model::arm_model::{ArmModel, ModelError};
use crate::model::geometric_stiffness::GeometricStiffness;
use crate::model::link::LinkKind;
use crate::plant::PlantError;
use crate::plant::bench::any_arm::AnyArm;
use crate::plant::bench::contact::{Contact, ContactParameters};
use crate::plant::bench::drive::{DriveParameters, Lag};
use crate::plant::bench::free_arm::{Bending, Load};
use crate::plant::bench::joint::{Joint, JointParameters, gear_torque};
use crate::plant::bench::lanes::Lanes;
use crate::plant::bench::runge_kutta::RungeKutta;
use crate::plant::bench::sensors::Stimulus;
use crate::plant::bench::surface::{SurfaceProfile, SurfaceShape};
use crate::plant::bench::{rest, step};
use flexor::model::{ArmParameters, KinematicsError};

/// What a plant is made of besides its arm.
#[derive(Clone, Debug, PartialEq)]
pub struct CompliantParameters {
    /// The real surface.
    pub surface: SurfaceProfile,
    /// Contact between tip and surface.
    pub contact: ContactParameters,
    /// The joints.
    pub joints: [JointParameters; 2],
    /// The drives; only their bandwidth is the plant's concern, the rest is
    /// [`crate::plant::bench::Drive`]'s.
    pub drives: [DriveParameters; 2],
    /// Axial forces that change a linear link's bending stiffness; in the exact model they do.
    pub geometric_stiffness: GeometricStiffness,
    /// Integration steps a control period; `None` derives them from the largest eigenvalue.
    pub substeps: Option<u32>,
}

impl CompliantParameters {
    /// A hard surface without friction, ideal joints and drives.
    pub fn ideal(surface: SurfaceProfile) -> Self {
        Self {
            surface,
            contact: ContactParameters::default(),
            joints: [JointParameters::default(); 2],
            drives: [DriveParameters::default(); 2],
            geometric_stiffness: GeometricStiffness::None,
            substeps: None,
        }
    }

    /// The model of `arm` in so many `elements`, with a link of that kind and the rotors that turn with its
    /// links.
    ///
    /// # Errors
    /// [`ModelError`].
    pub fn model(
        &self,
        arm: &ArmParameters,
        elements: usize,
        link: LinkKind,
    ) -> Result<ArmModel, ModelError> {
        let added = self.joints.map(|joint| match joint.play {
            None => joint.reflected_inertia_kgm2(),
            Some(_) => 0.0,
        });
        let arm = ArmParameters {
            root_inertia_kgm2: arm.root_inertia_kgm2 + added[1],
            ..*arm
        };
        let mut model = ArmModel::of_kind(&arm, elements, link)?.with_few_points();
        model.link1_inertia += added[0];
        self.geometric_stiffness.restrict(&mut model);
        Ok(model)
    }

    /// Whether there is a rotor in each joint that has play.
    ///
    /// # Errors
    /// [`CompliantError::NoRotor`].
    pub fn check_rotors(&self) -> Result<(), CompliantError> {
        for (i, joint) in self.joints.iter().enumerate() {
            let inertia = joint.reflected_inertia_kgm2();
            if joint.play.is_some() && !(inertia > 0.0) {
                let joint = i + 1;
                return Err(CompliantError::NoRotor { joint, inertia });
            }
        }
        Ok(())
    }

    /// Length of the state of a plant with these parameters and `model`.
    pub fn state_len(&self, model: &ArmModel) -> usize {
        let rotors = self.joints.iter().filter(|joint| joint.play.is_some());
        4 + 2 * model.dof() + 3 + 2 * rotors.count()
    }
}

/// Why there is no plant.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CompliantError {
    /// As with the rigid plant.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// The arm does not reach its start.
    #[error("no start at {along_m} m along the surface: the tip would be {problem}")]
    Unreachable {
        /// Place along the surface, m.
        along_m: f64,
        /// Why.
        problem: KinematicsError,
    },
    /// There is no surface where the arm is to start.
    #[error(
        "no start at {along_m} m along the surface: there is no surface, or a wall; a place on the surface is accepted"
    )]
    NoSurface {
        /// Place along the surface, m.
        along_m: f64,
    },
    /// Play without a rotor that could move in it.
    #[error(
        "joint{joint}.rotor_inertia_kgm2: {inertia} at the joint, which has play: more than 0 is accepted"
    )]
    NoRotor {
        /// 1 or 2.
        joint: usize,
        /// Reflected inertia, kg m^2.
        inertia: f64,
    },
    /// Arms that cannot advance side by side.
    #[error(
        "these arms cannot advance together: the same number of elements, link model, geometric_stiffness and play in the same joints are accepted"
    )]
    Lanes,
}

/// Everything about an instant, in lanes; [`Outputs::lane`] takes one arm out.
#[derive(Clone, Copy, Debug)]
pub struct Outputs<T> {
    angle: [T; 2],
    rate: [T; 2],
    motor_angle: [T; 2],
    motor_rate: [T; 2],
    root: [T; 2],
    tip: [T; 2],
    tip_velocity: [T; 2],
    depth: T,
    normal: [T; 2],
    force: T,
    friction: T,
    /// Torque on link 2's root, and the bending moment there, which [`CompliantPlant::outputs`] fills in.
    root_torque: T,
    root_moment: T,
    torque: [T; 2],
}

/// What can be seen of a compliant plant at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompliantReading {
    /// (theta10, theta20), rad.
    pub angle: [f64; 2],
    /// Their rates, rad/s.
    pub rate: [f64; 2],
    /// Motor angles, rad: theta10 and theta20 + w'(0) - theta10, or those of the rotors.
    pub motor_angle: [f64; 2],
    /// Their rates, rad/s.
    pub motor_rate: [f64; 2],
    /// Slope of link 2 at its root, rad.
    pub root_slope: f64,
    /// Its rate, rad/s.
    pub root_slope_rate: f64,
    /// Tip position, m.
    pub tip: [f64; 2],
    /// Tip velocity, m/s.
    pub tip_velocity: [f64; 2],
    /// Depth of the tip in the surface, m; negative off it.
    pub depth: f64,
    /// Normal into the real surface at the tip, inertial axes.
    pub normal: [f64; 2],
    /// Contact force along it, pressing positive, never negative, N.
    pub force: f64,
    /// Friction along `(normal_y, -normal_x)` that the tip exerts on the surface, N.
    pub friction_force: f64,
    /// Bending moment at link 2's root, N m: what a strain gauge measures.
    pub root_moment: f64,
    /// Torques of the drives, N m.
    pub torque: [f64; 2],
}

impl CompliantReading {
    /// Force of the tip on the surface in inertial axes, N.
    pub fn tip_force(&self) -> [f64; 2] {
        let n = self.normal;
        [
            self.force * n[0] + self.friction_force * n[1],
            self.force * n[1] - self.friction_force * n[0],
        ]
    }

    /// What the sensors have to measure.
    pub fn stimulus(&self) -> Stimulus {
        Stimulus {
            motor_angle: self.motor_angle,
            root_moment: self.root_moment,
            root_slope: self.root_slope,
            force: self.tip_force(),
        }
    }
}

impl<T: Lanes> Outputs<T> {
    /// The arm in `lane`, which is below [`Lanes::LANES`].
    pub fn lane(&self, lane: usize) -> CompliantReading {
        let one = |x: T| x.lane(lane);
        let two = |x: [T; 2]| x.map(one);
        CompliantReading {
            angle: two(self.angle),
            rate: two(self.rate),
            motor_angle: two(self.motor_angle),
            motor_rate: two(self.motor_rate),
            root_slope: one(self.root[0]),
            root_slope_rate: one(self.root[1]),
            tip: two(self.tip),
            tip_velocity: two(self.tip_velocity),
            depth: one(self.depth),
            normal: two(self.normal),
            force: one(self.force),
            friction_force: one(self.friction),
            root_moment: one(self.root_moment),
            torque: two(self.torque),
        }
    }
}

/// The equations of motion, in lanes.
#[derive(Clone, Debug)]
struct Equations<T> {
    arm: AnyArm<T>,
    surface: SurfaceShape<T>,
    contact: Contact<T>,
    joints: [Joint<T>; 2],
}

/// The motors at an instant.
struct Motors<T> {
    angle: [T; 2],
    rate: [T; 2],
    /// Torques on the links, N m.
    link: [T; 2],
    /// Torque of motor 2 whose reaction link 1 takes, N m.
    reaction: T,
}

impl<T: Lanes> Equations<T> {
    /// Writes the time derivative of `state` to `slope` with the drives giving `torque` (N m).
    #[inline]
    fn derivative(&mut self, torque: [T; 2], state: &[T], slope: &mut [T]) -> Outputs<T> {
        let n = self.arm.dof();
        let (angle, rate) = ([state[0], state[1]], [state[2], state[3]]);
        let (state, further) = state.split_at(4 + 2 * n);
        let (slope, further_slope) = slope.split_at_mut(4 + 2 * n);

        let stance = self.arm.stance(state);
        let (bending, tip, tip_velocity) = (&stance.bending, stance.tip, stance.tip_velocity);
        let motors = self.motors(torque, (angle, rate), bending, further, further_slope);
        let touch = self.surface.depth(tip);
        let [nx, ny] = touch.normal;
        let sliding = ny * tip_velocity[0] - nx * tip_velocity[1];
        let sinking = nx * tip_velocity[0] + ny * tip_velocity[1];
        let contact = self
            .contact
            .force(touch.depth, sinking, sliding, further[0]);
        further_slope[0] = contact.bristle_rate;

        let load = Load {
            link1: motors.link[0] - motors.reaction,
            root: motors.link[1],
            tip: [
                contact.normal * nx + contact.tangential * ny,
                contact.normal * ny - contact.tangential * nx,
            ],
        };
        let (slow, fast) = slope.split_at_mut(4 + n);
        let turn = self.arm.forward(&stance, state, &load, fast);
        slow[..2].copy_from_slice(&rate);
        slow[2..4].copy_from_slice(&turn);
        slow[4..].copy_from_slice(&state[4 + n..]);
        Outputs {
            angle,
            rate,
            motor_angle: motors.angle,
            motor_rate: motors.rate,
            root: [bending.root, bending.root_rate],
            tip,
            tip_velocity,
            depth: touch.depth,
            normal: touch.normal,
            force: contact.normal,
            friction: contact.tangential,
            root_torque: load.root,
            root_moment: T::ZERO,
            torque,
        }
    }

    /// The motors with the drives giving `torque`: friction, cogging, gears. Rates of bristles and
    /// rotors are written to `slope`, laid out as `further`: what the state has after the modes.
    #[inline]
    fn motors(
        &self,
        torque: [T; 2],
        (angle, rate): ([T; 2], [T; 2]),
        bending: &Bending<T>,
        further: &[T],
        slope: &mut [T],
    ) -> Motors<T> {
        // What turns with the link, and what carries the motor.
        let link = [angle[0], angle[1] + bending.root];
        let link_rate = [rate[0], rate[1] + bending.root_rate];
        let carrier = [T::ZERO, angle[0]];
        let carrier_rate = [T::ZERO, rate[0]];
        let mut motors = Motors {
            angle: [T::ZERO; 2],
            rate: [T::ZERO; 2],
            link: [T::ZERO; 2],
            reaction: T::ZERO,
        };
        let mut rotor = 3;
        for j in 0..2 {
            let joint = &self.joints[j];
            let (turned, turning) = match joint.gear {
                Some(_) => (further[rotor], further[rotor + 1]),
                None => (link[j], link_rate[j]),
            };
            motors.angle[j] = turned - carrier[j];
            motors.rate[j] = turning - carrier_rate[j];
            let (given, bristle_rate) =
                joint.motor(torque[j], motors.angle[j], motors.rate[j], further[1 + j]);
            slope[1 + j] = bristle_rate;
            motors.link[j] = match joint.gear {
                None => given,
                Some(gear) => {
                    let through = gear_torque(gear, turned - link[j], turning - link_rate[j]);
                    slope[rotor] = turning;
                    slope[rotor + 1] = (given - through) / gear[3];
                    rotor += 2;
                    through
                }
            };
            motors.reaction = given;
        }
        motors
    }
}

/// The bench's arm, or [`Lanes::LANES`] of them side by side.
#[derive(Clone, Debug)]
pub struct CompliantPlant<T> {
    equations: Equations<T>,
    method: RungeKutta<T>,
    lag: Lag<T>,
    /// Integration step, s, and how many make a control period.
    step: f64,
    substeps: u32,
    state: Vec<T>,
    slope: Vec<T>,
    /// Torques of the drives, N m.
    torque: [T; 2],
}

/// An arm at rest: where [`CompliantPlant`] starts.
#[derive(Clone, Debug, PartialEq)]
pub struct RestState {
    /// The state, laid out as the module says.
    pub state: Vec<f64>,
    /// Torques of the drives that hold it, N m.
    pub torque: [f64; 2],
}

/// One arm of a [`CompliantPlant`].
#[derive(Clone, Copy, Debug)]
pub struct CompliantArm<'a> {
    /// Its model; see [`CompliantParameters::model`].
    pub model: &'a ArmModel,
    /// What it is made of besides.
    pub parameters: &'a CompliantParameters,
    /// Where it starts; see [`CompliantParameters::rest`].
    pub start: &'a RestState,
}

impl CompliantArm<'_> {
    /// Integration steps that a control period of `period_s` (s) takes for this arm at its start
    /// and at the link angles `poses` (rad).
    ///
    /// # Errors
    /// [`PlantError::TooStiff`].
    pub fn substeps(&self, period_s: f64, poses: &[[f64; 2]]) -> Result<u32, PlantError> {
        step::substeps(self, period_s, poses)
    }
}

impl<T: Lanes> CompliantPlant<T> {
    /// The `arms`, one a lane, for control periods of `period_s` (s). The step suffices at the
    /// starts and at the link angles `poses` (rad), where the arms are going to be.
    ///
    /// All take as many steps as the one that needs most. An arm's bits are those that it has alone
    /// only with equally many: put arms together that need the same ([`CompliantArm::substeps`]),
    /// or give all the same [`CompliantParameters::substeps`].
    ///
    /// # Errors
    /// [`CompliantError`].
    ///
    /// # Panics
    /// If `arms` are not [`Lanes::LANES`] many, or a start has not its arm's length.
    pub fn new(
        arms: &[CompliantArm<'_>],
        period_s: f64,
        poses: &[[f64; 2]],
    ) -> Result<Self, CompliantError> {
        assert_eq!(arms.len(), T::LANES, "arms, one a lane");
        let size = arms[0].parameters.state_len(arms[0].model);
        let kind = |arm: &CompliantArm<'_>| {
            let p = arm.parameters;
            let plays = p.joints.map(|joint| joint.play.is_some());
            let link = arm.model.link.kind.model;
            (arm.model.elements, link, p.geometric_stiffness, plays)
        };
        let mut steps = 1;
        for arm in arms {
            if kind(arm) != kind(&arms[0]) {
                return Err(CompliantError::Lanes);
            }
            assert_eq!(arm.start.state.len(), size, "length of the start");
            arm.parameters.check_rotors()?;
            steps = steps.max(arm.substeps(period_s, poses)?);
        }
        let parameters = |lane: usize| arms[lane].parameters;
        let geometric = arms[0].parameters.geometric_stiffness;
        let arm = AnyArm::new(|lane| arms[lane].model, geometric.is_any());
        let step = period_s / f64::from(steps);
        Ok(Self {
            equations: Equations {
                arm,
                surface: SurfaceShape::new(|lane| &parameters(lane).surface),
                contact: Contact::new(|lane| &parameters(lane).contact),
                joints: [0, 1].map(|j| Joint::new(|lane| &parameters(lane).joints[j])),
            },
            method: RungeKutta::new(size),
            lag: Lag::new(|lane| &parameters(lane).drives, step),
            step,
            substeps: steps,
            state: (0..size)
                .map(|i| T::from_lanes(|lane| arms[lane].start.state[i]))
                .collect(),
            slope: vec![T::ZERO; size],
            torque: [0, 1].map(|j| T::from_lanes(|lane| arms[lane].start.torque[j])),
        })
    }

    /// Integration steps a control period.
    pub fn substeps(&self) -> u32 {
        self.substeps
    }

    /// The state in `lane`, laid out as the module says.
    pub fn state(&self, lane: usize) -> Vec<f64> {
        self.state.iter().map(|x| x.lane(lane)).collect()
    }

    /// One control period in which the drives tend to the torques `target` (N m).
    pub fn advance(&mut self, target: [T; 2]) {
        let Self {
            equations,
            method,
            lag,
            ..
        } = self;
        for _ in 0..self.substeps {
            let begun = self.torque;
            let mut stage = 0;
            method.step(&mut self.state, self.step, |_, state, slope| {
                let torque = lag.at(stage, begun, target);
                stage += 1;
                equations.derivative(torque, state, slope);
            });
            self.torque = lag.at(4, begun, target);
        }
    }

    /// What can be seen now.
    pub fn outputs(&mut self) -> Outputs<T> {
        let Self {
            equations, slope, ..
        } = self;
        let mut outputs = equations.derivative(self.torque, &self.state, slope);
        outputs.root_moment = outputs.root_torque - equations.arm.hub_torque(slope);
        outputs
    }
}

impl CompliantPlant<f64> {
    /// What can be seen of the one arm now.
    pub fn read(&mut self) -> CompliantReading {
        self.outputs().lane(0)
    }
}

impl CompliantParameters {
    /// The state in which the arm `model` rests on its own surface, pressing with `force_n` (N,
    /// positive) at the place `along_m` (see [`SurfaceProfile::along`]): the tip as deep as the
    /// contact needs, link 2 bent by it, bristles relaxed.
    ///
    /// # Errors
    /// [`CompliantError`].
    pub fn rest(
        &self,
        model: &ArmModel,
        along_m: f64,
        force_n: f64,
    ) -> Result<RestState, CompliantError> {
        rest::rest(self, model, along_m, force_n)
    }

    /// The state in which the arm rests in the air, the tip `gap_m` (m) above its own surface: link
    /// 1 at the angle `near[0]` (rad), link 2 near `near[1]`.
    ///
    /// # Errors
    /// [`CompliantError`].
    pub fn rest_above(
        &self,
        model: &ArmModel,
        near: [f64; 2],
        gap_m: f64,
    ) -> Result<RestState, CompliantError> {
        rest::above(self, model, near, gap_m)
    }

    /// The state in which the arm rests in the air, its links at `angle` (rad), whatever surface
    /// there is.
    ///
    /// # Errors
    /// [`CompliantError`].
    pub fn rest_free(
        &self,
        model: &ArmModel,
        angle: [f64; 2],
    ) -> Result<RestState, CompliantError> {
        rest::free(self, model, angle)
    }
}

//! The bench's arm in lanes, with either model of its link: the linear one all lanes at once
//! ([`FreeArm`]), the geometrically exact one ([`BentArm`]) a lane after the other.

use crate::model::arm_model::ArmModel;
use crate::model::bent_forward::BentArm;
use crate::model::configuration::{Configuration, State};
use crate::model::link::LinkModel;
use crate::plant::bench::free_arm::{Bending, FreeArm, Load, Pose, Scratch};
use crate::plant::bench::lanes::Lanes;

/// The arms' constants.
#[derive(Clone, Debug)]
pub(super) enum AnyArm<T> {
    /// With linear links.
    Linear(FreeArm<T>),
    /// With geometrically exact ones, a model a lane.
    Bent(Vec<ArmModel>),
}

/// Working memory of [`AnyArm`].
#[derive(Clone, Debug)]
pub(super) enum Memory<T> {
    Linear(Scratch<T>),
    /// Of the one lane.
    One(Box<BentArm<T>>),
    /// A lane each.
    Each(Vec<Lane>),
}

/// A lane taken out.
#[derive(Clone, Debug)]
pub(super) struct Lane {
    bent: BentArm<f64>,
    state: Vec<f64>,
    acceleration: Vec<f64>,
}

/// The arm in a state, before it is known what acts on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stance<T> {
    pose: Pose<T>,
    pub(super) bending: Bending<T>,
    /// Place of the tip, m, and its velocity, m/s.
    pub(super) tip: [T; 2],
    pub(super) tip_velocity: [T; 2],
}

impl<T: Lanes> AnyArm<T> {
    /// One arm a lane, all of as many elements and with the first one's link model. `geometric` lets axial
    /// forces change a linear link's bending stiffness.
    pub(super) fn new<'a>(model: impl Fn(usize) -> &'a ArmModel, geometric: bool) -> Self {
        match model(0).link.kind.model {
            LinkModel::Linear => Self::Linear(FreeArm::new(model, geometric)),
            LinkModel::Geometric => {
                Self::Bent((0..T::LANES).map(|lane| model(lane).clone()).collect())
            }
        }
    }

    /// Number of modes.
    pub(super) fn dof(&self) -> usize {
        match self {
            Self::Linear(arm) => arm.dof(),
            Self::Bent(models) => models[0].dof(),
        }
    }

    /// Working memory.
    pub(super) fn memory(&self) -> Memory<T> {
        match self {
            Self::Linear(arm) => Memory::Linear(arm.scratch()),
            Self::Bent(models) if T::LANES == 1 => Memory::One(Box::new(BentArm::new(&models[0]))),
            Self::Bent(models) => Memory::Each(models.iter().map(Lane::new).collect()),
        }
    }

    /// The arm in `state`, `[theta10, theta20, theta10', theta20', q..., q'...]`.
    #[inline]
    pub(super) fn stance(&self, state: &[T], memory: &mut Memory<T>) -> Stance<T> {
        let ([angle, rate], n) = ([[state[0], state[1]], [state[2], state[3]]], self.dof());
        match (self, memory) {
            (Self::Bent(models), memory) => {
                let shape = memory.shape(models, &state[..4 + 2 * n]);
                Stance::bent(models, Pose::at(angle), rate, shape)
            }
            (Self::Linear(arm), _) => {
                let pose = Pose::at(angle);
                let (tip, tip_velocity) = arm.tip(&pose, rate);
                Stance {
                    pose,
                    bending: arm.bending(&state[4..4 + n], &state[4 + n..4 + 2 * n]),
                    tip,
                    tip_velocity,
                }
            }
        }
    }

    /// Accelerations (theta10'', theta20''), rad/s^2, in the state whose `stance` was asked for last, under
    /// `load`; those of the modal coordinates are written to `acceleration`.
    #[inline]
    pub(super) fn forward(
        &self,
        stance: &Stance<T>,
        state: &[T],
        load: &Load<T>,
        (acceleration, memory): (&mut [T], &mut Memory<T>),
    ) -> [T; 2] {
        let n = self.dof();
        match (self, memory) {
            (Self::Linear(arm), Memory::Linear(scratch)) => arm.forward(
                &stance.pose,
                [state[2], state[3]],
                (&state[4..4 + n], &state[4 + n..4 + 2 * n]),
                &stance.bending,
                load,
                (acceleration, scratch),
            ),
            (Self::Bent(models), Memory::One(bent)) => {
                let [e1, e2] = stance.pose.e;
                let configuration = Configuration::towards(&models[0], e1, e2);
                let torque = [load.link1 + load.root, load.root];
                let state = State(&state[..4 + 2 * n]);
                let found = bent.under_force(
                    &models[0],
                    &configuration,
                    state,
                    torque,
                    load.tip,
                    acceleration,
                );
                found.angle
            }
            (Self::Bent(models), Memory::Each(lanes)) => {
                let turn = |(lane, own): (usize, &mut Lane)| {
                    own.accelerate(&models[lane], stance, load, lane)
                };
                let turns: Vec<[f64; 2]> = lanes.iter_mut().enumerate().map(turn).collect();
                for (i, a) in acceleration.iter_mut().enumerate() {
                    *a = T::from_lanes(|lane| lanes[lane].acceleration[i]);
                }
                [0, 1].map(|joint| T::from_lanes(|lane| turns[lane][joint]))
            }
            // Memory is made by the arm.
            _ => [T::ZERO; 2],
        }
    }

    /// Torque that accelerates what turns with link 2's root, N m: the root's torque less the
    /// moment that bends the link. `slope` is the derivative of a state, asked for last.
    pub(super) fn hub_torque(&self, slope: &[T], memory: &Memory<T>) -> T {
        match (self, memory) {
            (Self::Linear(arm), _) => arm.hub_torque(slope),
            (Self::Bent(models), Memory::One(bent)) => {
                let inertia = T::from_f64(models[0].arm.root_inertia_kgm2);
                inertia * (slope[3] + bent.root_acceleration())
            }
            (Self::Bent(models), Memory::Each(lanes)) => T::from_lanes(|lane| {
                let turned = slope[3].lane(lane) + lanes[lane].bent.root_acceleration();
                models[lane].arm.root_inertia_kgm2 * turned
            }),
            _ => T::ZERO,
        }
    }
}

impl<T: Lanes> Memory<T> {
    /// Chord's length and its rate, root angle and its rate of bent links in `state`.
    #[inline]
    fn shape(&mut self, models: &[ArmModel], state: &[T]) -> [[T; 2]; 2] {
        match self {
            Self::One(bent) => bent.shape(&models[0], State(state)),
            Self::Each(lanes) => {
                let shape = |(lane, own): (usize, &mut Lane)| own.shape(&models[lane], state, lane);
                let shapes: Vec<_> = lanes.iter_mut().enumerate().map(shape).collect();
                [0, 1].map(|i| [0, 1].map(|j| T::from_lanes(|lane| shapes[lane][i][j])))
            }
            Self::Linear(_) => [[T::ZERO; 2]; 2],
        }
    }
}

impl Lane {
    fn new(model: &ArmModel) -> Self {
        Self {
            bent: BentArm::new(model),
            state: vec![0.0; 4 + 2 * model.dof()],
            acceleration: vec![0.0; model.dof()],
        }
    }

    fn shape<T: Lanes>(&mut self, model: &ArmModel, state: &[T], lane: usize) -> [[f64; 2]; 2] {
        for (own, x) in self.state.iter_mut().zip(state) {
            *own = x.lane(lane);
        }
        self.bent.shape(model, State(&self.state))
    }

    fn accelerate<T: Lanes>(
        &mut self,
        model: &ArmModel,
        stance: &Stance<T>,
        load: &Load<T>,
        lane: usize,
    ) -> [f64; 2] {
        let [e1, e2] = stance.pose.e.map(|e| e.map(|x| x.lane(lane)));
        let configuration = Configuration::towards(model, e1, e2);
        let torque = [load.link1 + load.root, load.root].map(|x| x.lane(lane));
        let force = load.tip.map(|x| x.lane(lane));
        let (state, acceleration) = (State(&self.state), &mut self.acceleration);
        let bent = &mut self.bent;
        bent.under_force(model, &configuration, state, torque, force, acceleration)
            .angle
    }
}

impl<T: Lanes> Stance<T> {
    /// With the chord's length and its rate, root angle and its rate.
    fn bent(
        models: &[ArmModel],
        pose: Pose<T>,
        rate: [T; 2],
        [[length, length_rate], [root, root_rate]]: [[T; 2]; 2],
    ) -> Self {
        let r1 = T::from_lanes(|lane| models[lane].arm.link1_length_m);
        let [e1, e2] = pose.e;
        let (v1, v2) = (r1 * rate[0], length * rate[1]);
        Self {
            pose,
            bending: Bending::of_root(root, root_rate),
            tip: [r1 * e1[0] + length * e2[0], r1 * e1[1] + length * e2[1]],
            tip_velocity: [
                length_rate * e2[0] - v1 * e1[1] - v2 * e2[1],
                v1 * e1[0] + v2 * e2[0] + length_rate * e2[1],
            ],
        }
    }
}

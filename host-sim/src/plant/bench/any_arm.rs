//! The bench's arm in lanes, with either model of its link: the linear one all lanes at once
//! ([`FreeArm`]), the geometrically exact one ([`BentArm`]) a lane after the other.

use crate::model::arm_model::ArmModel;
use crate::model::bent_forward::BentArm;
use crate::model::configuration::{Configuration, State};
use crate::model::link::LinkModel;
use crate::plant::bench::free_arm::{Bending, FreeArm, Load, Pose, Scratch};
use crate::plant::bench::lanes::Lanes;

/// The arms, with the memory that their equations work in.
#[derive(Clone, Debug)]
pub(super) enum AnyArm<T> {
    /// With linear links.
    Linear(Box<FreeArm<T>>, Scratch<T>),
    /// One with an exact link.
    One(Box<ArmModel>, Box<BentArm<T>>),
    /// Several with exact links, a lane each.
    Each(Vec<Lane>),
}

/// A lane taken out.
#[derive(Clone, Debug)]
pub(super) struct Lane {
    model: ArmModel,
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
        let first = model(0);
        match (first.link.kind.model, T::LANES) {
            (LinkModel::Linear, _) => {
                let arm = FreeArm::new(model, geometric);
                let scratch = arm.scratch();
                Self::Linear(Box::new(arm), scratch)
            }
            (LinkModel::Geometric, 1) => {
                Self::One(Box::new(first.clone()), Box::new(BentArm::new(first)))
            }
            (LinkModel::Geometric, lanes) => {
                Self::Each((0..lanes).map(|lane| Lane::new(model(lane))).collect())
            }
        }
    }

    /// Number of modes.
    pub(super) fn dof(&self) -> usize {
        match self {
            Self::Linear(arm, _) => arm.dof(),
            Self::One(model, _) => model.dof(),
            Self::Each(lanes) => lanes[0].model.dof(),
        }
    }

    /// The arm in `state`, `[theta10, theta20, theta10', theta20', q..., q'...]`.
    #[inline]
    pub(super) fn stance(&mut self, state: &[T]) -> Stance<T> {
        let [angle, rate] = [[state[0], state[1]], [state[2], state[3]]];
        let pose = Pose::at(angle);
        match self {
            Self::Linear(arm, _) => {
                let n = arm.dof();
                let (tip, tip_velocity) = arm.tip(&pose, rate);
                Stance {
                    pose,
                    bending: arm.bending(&state[4..4 + n], &state[4 + n..4 + 2 * n]),
                    tip,
                    tip_velocity,
                }
            }
            Self::One(model, bent) => {
                let r1 = T::from_f64(model.arm.link1_length_m);
                Stance::bent(pose, (r1, rate), bent.shape(model, State(state)))
            }
            Self::Each(lanes) => {
                let r1 = T::from_lanes(|lane| lanes[lane].model.arm.link1_length_m);
                let shapes: Vec<[[f64; 2]; 2]> = lanes
                    .iter_mut()
                    .enumerate()
                    .map(|(lane, own)| own.shape(state, lane))
                    .collect();
                let shape =
                    [0, 1].map(|i| [0, 1].map(|j| T::from_lanes(|lane| shapes[lane][i][j])));
                Stance::bent(pose, (r1, rate), shape)
            }
        }
    }

    /// Accelerations (theta10'', theta20''), rad/s^2, in the `state` whose `stance` was asked for last, under
    /// `load`; those of the modal coordinates are written to `acceleration`.
    #[inline]
    pub(super) fn forward(
        &mut self,
        stance: &Stance<T>,
        state: &[T],
        load: &Load<T>,
        acceleration: &mut [T],
    ) -> [T; 2] {
        match self {
            Self::Linear(arm, scratch) => {
                let n = arm.dof();
                arm.forward(
                    &stance.pose,
                    [state[2], state[3]],
                    (&state[4..4 + n], &state[4 + n..4 + 2 * n]),
                    &stance.bending,
                    load,
                    (acceleration, scratch),
                )
            }
            Self::One(model, bent) => {
                let [e1, e2] = stance.pose.e;
                let at = Configuration::towards(model, e1, e2);
                let torque = [load.link1 + load.root, load.root];
                bent.under_force(model, &at, State(state), torque, load.tip, acceleration)
                    .angle
            }
            Self::Each(lanes) => {
                let turns: Vec<[f64; 2]> = lanes
                    .iter_mut()
                    .enumerate()
                    .map(|(lane, own)| own.accelerate(stance, load, lane))
                    .collect();
                for (i, a) in acceleration.iter_mut().enumerate() {
                    *a = T::from_lanes(|lane| lanes[lane].acceleration[i]);
                }
                [0, 1].map(|joint| T::from_lanes(|lane| turns[lane][joint]))
            }
        }
    }

    /// Torque that accelerates what turns with link 2's root, N m: the root's torque less the
    /// moment that bends the link. `slope` is the derivative of a state, asked for last.
    pub(super) fn hub_torque(&self, slope: &[T]) -> T {
        match self {
            Self::Linear(arm, _) => arm.hub_torque(slope),
            Self::One(model, bent) => {
                let inertia = T::from_f64(model.arm.root_inertia_kgm2);
                inertia * (slope[3] + bent.root_acceleration())
            }
            Self::Each(lanes) => T::from_lanes(|lane| {
                let own = &lanes[lane];
                let turned = slope[3].lane(lane) + own.bent.root_acceleration();
                own.model.arm.root_inertia_kgm2 * turned
            }),
        }
    }
}

impl Lane {
    fn new(model: &ArmModel) -> Self {
        Self {
            bent: BentArm::new(model),
            state: vec![0.0; 4 + 2 * model.dof()],
            acceleration: vec![0.0; model.dof()],
            model: model.clone(),
        }
    }

    /// Chord's length and its rate, root angle and its rate, in `state`.
    fn shape<T: Lanes>(&mut self, state: &[T], lane: usize) -> [[f64; 2]; 2] {
        for (own, x) in self.state.iter_mut().zip(state) {
            *own = x.lane(lane);
        }
        self.bent.shape(&self.model, State(&self.state))
    }

    fn accelerate<T: Lanes>(
        &mut self,
        stance: &Stance<T>,
        load: &Load<T>,
        lane: usize,
    ) -> [f64; 2] {
        let [e1, e2] = stance.pose.e.map(|e| e.map(|x| x.lane(lane)));
        let at = Configuration::towards(&self.model, e1, e2);
        let torque = [load.link1 + load.root, load.root].map(|x| x.lane(lane));
        let force = load.tip.map(|x| x.lane(lane));
        let (state, acceleration) = (State(&self.state), &mut self.acceleration);
        self.bent
            .under_force(&self.model, &at, state, torque, force, acceleration)
            .angle
    }
}

impl<T: Lanes> Stance<T> {
    /// With link 1's length and the links' rates, the chord's length and its rate, root angle and its rate.
    fn bent(
        pose: Pose<T>,
        (r1, rate): (T, [T; 2]),
        [[length, length_rate], [root, root_rate]]: [[T; 2]; 2],
    ) -> Self {
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

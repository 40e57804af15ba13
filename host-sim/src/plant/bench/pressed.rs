//! The bench's plant as far as it is smooth: the arm with its tip pressing on a plane, or in the
//! air, over any number of lanes. With dual numbers it gives its own linearisation, which is what
//! gains are found and proved with ([`crate::analysis::hybrid`]).
//!
//! Joints turn freely and sliding friction has one direction for good: what a Coulomb element
//! does while it slides. State: `[theta10, theta20, theta10', theta20', q..., q'...]`, as the rigid
//! plant's.

use crate::model::arm_model::ArmModel;
use crate::plant::bench::any_arm::AnyArm;
use crate::plant::bench::contact::pressing;
use crate::plant::bench::free_arm::Load;
use crate::plant::bench::lanes::Lanes;

/// A plane that a tip presses on, with friction of a given direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressedPlane {
    /// Unit normal; a tip that presses pushes along it. Inertial axes.
    pub normal: [f64; 2],
    /// Place of the plane along its normal, m.
    pub offset_m: f64,
    /// Stiffness of the contact, N/m.
    pub stiffness_n_m: f64,
    /// Its damping, N s/m.
    pub damping_ns_m: f64,
    /// Friction coefficient; positive where the tip's force on the surface points along
    /// [`tangent`](Self::tangent), negative against it.
    pub friction: f64,
    /// What friction does to a tip that does not slide; `None` where it does.
    pub stuck: Option<Stuck>,
}

/// A tip that sticks to its surface: the bristle of friction as a spring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stuck {
    /// Stiffness along the surface, N/m.
    pub stiffness_n_m: f64,
    /// Place of the tip along the plane's [`tangent`](PressedPlane::tangent) where the spring is loose, m.
    pub place_m: f64,
}

impl PressedPlane {
    /// Unit vector along the plane: the normal turned back by a right angle.
    pub fn tangent(&self) -> [f64; 2] {
        [self.normal[1], -self.normal[0]]
    }

    /// The tip's force on the surface for a normal force of 1 N, inertial axes.
    pub fn direction(&self) -> [f64; 2] {
        let tangent = self.tangent();
        [0, 1].map(|i| self.normal[i] + self.friction * tangent[i])
    }
}

/// What a board's sensors see of a [`PressedArm`].
#[derive(Clone, Copy, Debug)]
pub struct PressedReading<T> {
    /// m1 and m2, rad: motor 2 turns link 2's root tangent against link 1.
    pub motor_angle: [T; 2],
    /// Moment at link 2's root: joint 2's torque less what the inertia there takes, N m.
    pub root_moment: T,
    /// Force along the normal, N; 0 in the air.
    pub force: T,
}

/// An arm whose tip presses on a plane, or is in the air.
#[derive(Clone, Debug)]
pub struct PressedArm<T> {
    arm: AnyArm<T>,
    plane: Option<PressedPlane>,
}

impl<T: Lanes> PressedArm<T> {
    /// `model`'s arm on `plane`; `geometric` lets axial forces change its bending stiffness.
    pub fn new(model: &ArmModel, geometric: bool, plane: Option<PressedPlane>) -> Self {
        let arm = AnyArm::new(|_| model, geometric);
        Self { arm, plane }
    }

    /// Writes the derivative of `state` to `slope` and returns what is seen, the drives giving
    /// `torque` (N m).
    ///
    /// # Panics
    /// If `state` or `slope` is shorter than the state.
    pub fn derivative(
        &mut self,
        state: &[T],
        torque: [T; 2],
        slope: &mut [T],
    ) -> PressedReading<T> {
        let n = self.arm.dof();
        let (angle, rate) = ([state[0], state[1]], [state[2], state[3]]);
        let state = &state[..4 + 2 * n];
        let stance = self.arm.stance(state);
        let (tip, velocity) = (stance.tip, stance.tip_velocity);
        let (mut force, mut on_surface) = (T::ZERO, [T::ZERO; 2]);
        if let Some(plane) = &self.plane {
            let normal = plane.normal.map(T::from_f64);
            let along = |v: [T; 2]| normal[0] * v[0] + normal[1] * v[1];
            let depth = along(tip) - T::from_f64(plane.offset_m);
            let (stiffness, damping) = (plane.stiffness_n_m, plane.damping_ns_m);
            let [stiffness, damping] = [stiffness, damping].map(T::from_f64);
            force = pressing(depth, along(velocity), stiffness, damping);
            on_surface = plane.direction().map(|d| T::from_f64(d) * force);
            if let Some(stuck) = plane.stuck {
                let tangent = plane.tangent().map(T::from_f64);
                let place = tangent[0] * tip[0] + tangent[1] * tip[1];
                let off = place - T::from_f64(stuck.place_m);
                for (force, tangent) in on_surface.iter_mut().zip(tangent) {
                    *force += tangent * T::from_f64(stuck.stiffness_n_m) * off;
                }
            }
        }
        let load = Load {
            link1: torque[0] - torque[1],
            root: torque[1],
            tip: on_surface,
        };
        let (head, q_acceleration) = slope[..4 + 2 * n].split_at_mut(4 + n);
        let turn = self.arm.forward(&stance, state, &load, q_acceleration);
        head[..2].copy_from_slice(&rate);
        head[2..4].copy_from_slice(&turn);
        head[4..].copy_from_slice(&state[4 + n..]);
        PressedReading {
            motor_angle: [angle[0], angle[1] + stance.bending.root - angle[0]],
            root_moment: torque[1] - self.arm.hub_torque(slope),
            force,
        }
    }
}

//! The plant that the hybrid law meets, linearised at rest at a pose of the plan and sampled.
//!
//! Everything between a command and what a sensor says is in it: the drives' lag, whole ticks of
//! delay, the elastic link with what turns at its root, the compliant contact, and friction on the
//! surface: as a force that follows the normal one (the *frozen* sliding direction), or as a spring that a
//! tip sticks to. It is the bench's
//! own arm ([`PressedArm`]) with dual numbers, at least four elements fine: two wrongly say that a
//! bare root is stable.

use super::HybridError;
use crate::analysis::stability::sampled::exp;
use crate::model::arm_model::ArmModel;
use crate::model::dual::Dual;
use crate::model::dynamics::equilibrium;
use crate::model::link::{LinkDamping, LinkKind, LinkModel};
use crate::model::rest::rest;
use crate::model::servo::Reference;
use crate::plant::bench::{PressedArm, PressedPlane, Stuck};
use crate::plant::state_of;
use flexor::model::{ArmParameters, JointMotion, Kinematics};
use nalgebra::{DMatrix, DVector};

/// Elements that a proof takes: with three a bare root's fast mode comes out half as unstable, with
/// two it is missing.
pub const ELEMENTS: usize = 4;

/// What a board's sensors see, in the order of the outputs: m1 and m2 (rad), root moment (N m),
/// force (N).
pub const OUTPUTS: usize = 4;

/// How an arm on the bench differs from the planned one, and what is around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopPlant {
    /// Factor on link 2's bending stiffness.
    pub bending_stiffness_scale: f64,
    /// Factor on link 1's mass.
    pub link1_mass_scale: f64,
    /// Factor on link 2's mass.
    pub link2_mass_scale: f64,
    /// Factor on the elastic modes' damping.
    pub damping_scale: f64,
    /// Inertia that turns with link 2's root, kg m^2: all of it.
    pub root_inertia_kgm2: f64,
    /// Stiffness of the contact, N/m; `None` with the tip in the air.
    pub contact_stiffness_n_m: Option<f64>,
    /// Friction coefficient of a tip that slides, signed by its direction.
    pub friction: f64,
    /// Whether the tip sticks to the surface instead.
    pub stuck: bool,
    /// Corner of the drives' lag, Hz.
    pub drive_bandwidth_hz: f64,
    /// Whole ticks from command to drive, at least 1: what is computed at a tick acts at the next.
    pub delay_ticks: usize,
    /// Finite elements of link 2.
    pub elements: usize,
    /// Whether the contact force along link 2 changes the stiffness of a linear link; an exact one's it does.
    pub geometric_stiffness: bool,
    /// How link 2 bends, as the plan has it.
    pub link: LinkKind,
}

/// Damping of the contact, N s/m, as the bench's.
const CONTACT_DAMPING_NS_M: f64 = 5.0;

/// Stiffness of what sticks along the surface, N/m, as the bench's.
const BRISTLE_STIFFNESS_N_M: f64 = 4e3;

impl LoopPlant {
    /// `arm` as planned, on a hard surface without friction, with drives of 300 Hz.
    pub fn nominal(arm: &ArmParameters) -> Self {
        Self {
            bending_stiffness_scale: 1.0,
            link1_mass_scale: 1.0,
            link2_mass_scale: 1.0,
            damping_scale: 1.0,
            root_inertia_kgm2: arm.root_inertia_kgm2,
            contact_stiffness_n_m: Some(2e4),
            friction: 0.0,
            stuck: false,
            drive_bandwidth_hz: 300.0,
            delay_ticks: 1,
            elements: ELEMENTS,
            geometric_stiffness: true,
            link: LinkKind::default(),
        }
    }

    /// The plant's arm.
    pub fn arm(&self, planned: &ArmParameters) -> ArmParameters {
        ArmParameters {
            bending_stiffness_nm2: planned.bending_stiffness_nm2 * self.bending_stiffness_scale,
            link1_mass_kg: planned.link1_mass_kg * self.link1_mass_scale,
            link2_mass_kg: planned.link2_mass_kg * self.link2_mass_scale,
            damping_ratio: planned.damping_ratio * self.damping_scale,
            root_inertia_kgm2: self.root_inertia_kgm2,
            ..*planned
        }
    }
}

/// Where the arm stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopPose {
    /// Time in the plan, s.
    pub t_s: f64,
    /// (theta10, theta20), rad.
    pub angle: [f64; 2],
    /// The planned force along the normal, N.
    pub force_n: f64,
    /// Direction of the surface's normal, rad.
    pub normal_angle: f64,
}

impl LoopPlant {
    /// How its link 2 bends.
    fn own_link(&self) -> LinkKind {
        let damping = match self.link.damping {
            LinkDamping::Modal => LinkDamping::Modal,
            LinkDamping::Bending { time_s } => LinkDamping::Bending {
                time_s: time_s.map(|time_s| self.damping_scale * time_s),
            },
        };
        LinkKind {
            damping,
            ..self.link
        }
    }
}

/// The plant between two ticks: `x+ = phi x + gamma u`, `v = c x`, in deviations from rest. `x` is
/// [`PressedArm`]'s state with the drives' torques behind it, velocities in a unit of their own; `u`
/// the torques that reach the drives' lag in that period (N m), `v` the [`OUTPUTS`].
#[derive(Clone, Debug)]
pub struct SampledPlant {
    /// State to state.
    pub phi: DMatrix<f64>,
    /// Torques to state, one column a joint.
    pub gamma: DMatrix<f64>,
    /// State to what is measured.
    pub c: DMatrix<f64>,
    /// What disturbs: see [`Disturbance`]. Columns of state, rates of the continuous state over a
    /// period.
    pub disturbance: DMatrix<f64>,
    /// What a disturbance does to the measurement at once.
    pub measured: DMatrix<f64>,
    /// Whole ticks from command to drive.
    pub delay_ticks: usize,
    /// Where it stands.
    pub pose: LoopPose,
    /// Unit of the velocities in the state, 1/s.
    #[cfg(test)]
    unit: f64,
}

/// What acts on the arm besides the drives, in the order of [`SampledPlant::disturbance`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Disturbance {
    /// A torque at link 2's root, N m: gear friction, cogging.
    RootTorque = 0,
    /// A force of the surface along itself, N.
    Tangential = 1,
    /// The surface's height, m; away from the arm.
    Height = 2,
}

impl Disturbance {
    /// All of them.
    const ALL: [Self; DISTURBANCES] = [Self::RootTorque, Self::Tangential, Self::Height];
}

/// Their number.
pub const DISTURBANCES: usize = 3;

/// Rates of the state, and outputs, that disturbances make.
struct Response {
    rate: Vec<f64>,
    output: [f64; OUTPUTS],
}

/// The smooth plant at rest at a pose.
struct AtRest {
    model: ArmModel,
    geometric: bool,
    plane: Option<PressedPlane>,
    state: Vec<f64>,
    torque: [f64; 2],
    /// Where the tip is, m.
    tip: [f64; 2],
}

/// A shape at rest: modal coordinates, the torques that hold it (N m) and the place of the tip (m).
type Resting = (Vec<f64>, [f64; 2], [f64; 2]);

/// `model`'s arm at rest at these joint angles (rad), its tip pressing with a force (N, inertial axes).
fn resting(
    model: &ArmModel,
    angle: [f64; 2],
    pressed: [f64; 2],
    geometric_stiffness: bool,
) -> Option<Resting> {
    match model.link.kind.model {
        LinkModel::Linear => {
            let (q, torque) = equilibrium(model, angle, pressed, geometric_stiffness)?;
            Some((q, torque, model.kinematics.forward(angle)))
        }
        LinkModel::Geometric => {
            let joint = JointMotion {
                angle,
                ..JointMotion::default()
            };
            let found = rest(model, &Reference::Joints(joint), pressed).ok()?;
            let q = &model.coordinates * DVector::from_vec(found.nodal);
            let tip = Kinematics {
                link2_length: found.chord_m,
                ..model.kinematics
            };
            Some((q.as_slice().to_vec(), found.torque, tip.forward(angle)))
        }
    }
}

impl AtRest {
    fn new(
        planned: &ArmParameters,
        plant: &LoopPlant,
        pose: &LoopPose,
    ) -> Result<Self, HybridError> {
        let arm = plant.arm(planned);
        let mut model =
            ArmModel::of_kind(&arm, plant.elements, plant.own_link())?.with_few_points();
        // The contact's part of the axial force alone, as the bench's scenarios have it.
        model.geometric_axial.fill(0.0);
        model.geometric_centrifugal.fill(0.0);
        let (sine, cosine) = libm::sincos(pose.normal_angle);
        let normal = [cosine, sine];
        let mut plane = plant
            .contact_stiffness_n_m
            .map(|stiffness_n_m| PressedPlane {
                normal,
                offset_m: 0.0,
                stiffness_n_m,
                damping_ns_m: CONTACT_DAMPING_NS_M,
                friction: plant.friction,
                stuck: None,
            });
        let pressed = plane.map_or([0.0; 2], |plane| {
            plane.direction().map(|d| d * pose.force_n)
        });
        let geometric = plant.geometric_stiffness;
        let (q, torque, tip) = resting(&model, pose.angle, pressed, geometric)
            .filter(|(q, ..)| q.iter().all(|x| x.is_finite()))
            .ok_or(HybridError::Buckled { t_s: pose.t_s })?;
        if let Some(plane) = &mut plane {
            plane.offset_m =
                normal[0] * tip[0] + normal[1] * tip[1] - pose.force_n / plane.stiffness_n_m;
            let tangent = plane.tangent();
            plane.stuck = plant.stuck.then_some(Stuck {
                stiffness_n_m: BRISTLE_STIFFNESS_N_M,
                place_m: tangent[0] * tip[0] + tangent[1] * tip[1],
            });
        }
        let state = state_of(pose.angle, &q, &vec![0.0; q.len()]);
        Ok(Self {
            model,
            geometric,
            plane,
            state,
            torque,
            tip,
        })
    }

    /// Rates and outputs with a slope of 1 in the state's `column`, or in a torque behind them.
    fn slopes(&self, column: usize) -> (Vec<f64>, [f64; OUTPUTS]) {
        let size = self.state.len();
        let of = |value: f64, i: usize| Dual::new(value, f64::from(u8::from(i == column)));
        let state: Vec<Dual> = (0..size).map(|i| of(self.state[i], i)).collect();
        let torque = [0, 1].map(|joint| of(self.torque[joint], size + joint));
        let mut rate = vec![Dual::default(); size];
        let seen = PressedArm::new(&self.model, self.geometric, self.plane)
            .derivative(&state, torque, &mut rate);
        let [m1, m2] = seen.motor_angle;
        let output = [m1, m2, seen.root_moment, seen.force].map(Dual::slope);
        (rate.into_iter().map(Dual::slope).collect(), output)
    }

    /// Rates and outputs that a [`Disturbance`] of 1 makes, by what it changes.
    fn disturbed(&self, disturbance: Disturbance) -> Response {
        let size = self.state.len();
        let none = Response {
            rate: vec![0.0; size],
            output: [0.0; OUTPUTS],
        };
        let at = |plane: Option<PressedPlane>| {
            let mut rate = vec![0.0; size];
            let mut arm = PressedArm::new(&self.model, self.geometric, plane);
            let seen = arm.derivative(&self.state, self.torque, &mut rate);
            let [m1, m2] = seen.motor_angle;
            (rate, [m1, m2, seen.root_moment, seen.force])
        };
        let change = |step: f64, plane: PressedPlane| {
            let ((rate, output), (rate0, output0)) = (at(Some(plane)), at(self.plane));
            let less = |a: f64, b: f64| (a - b) / step;
            Response {
                rate: rate.iter().zip(rate0).map(|(a, b)| less(*a, b)).collect(),
                output: core::array::from_fn(|i| less(output[i], output0[i])),
            }
        };
        match (disturbance, self.plane) {
            // It turns link 2's root against link 1, as joint 2's torque does; the gauge sees it.
            (Disturbance::RootTorque, _) => {
                let (rate, output) = self.slopes(size + 1);
                Response { rate, output }
            }
            (_, None) => none,
            (Disturbance::Tangential, Some(plane)) => {
                // Linear in friction times the normal force.
                let force = plane.stiffness_n_m * self.depth(&plane);
                let friction = plane.friction + 1.0 / force;
                change(1.0, PressedPlane { friction, ..plane })
            }
            (Disturbance::Height, Some(plane)) => {
                let step = 1e-3 * self.depth(&plane);
                let offset_m = plane.offset_m + step;
                change(step, PressedPlane { offset_m, ..plane })
            }
        }
    }

    fn depth(&self, plane: &PressedPlane) -> f64 {
        plane.normal[0] * self.tip[0] + plane.normal[1] * self.tip[1] - plane.offset_m
    }
}

impl SampledPlant {
    /// `plant` instead of the arm `planned`, at rest at `pose`, sampled at `tick_rate_hz`. With
    /// `link1` false link 1 is locked: what joint 2's loop is by itself.
    ///
    /// # Errors
    /// [`HybridError`].
    pub fn new(
        planned: &ArmParameters,
        plant: &LoopPlant,
        pose: &LoopPose,
        tick_rate_hz: u32,
        link1: bool,
    ) -> Result<Self, HybridError> {
        let mut rest = AtRest::new(planned, plant, pose)?;
        if !link1 {
            // So heavy that nothing moves it.
            rest.model.link1_inertia = 1e12 * (1.0 + rest.model.link1_inertia);
        }
        let size = rest.state.len();
        let half = (size - 4) / 2;
        let kept: Vec<usize> = (0..size)
            .filter(|i| link1 || (*i != 0 && *i != 2))
            .collect();
        let joints: &[usize] = if link1 { &[0, 1] } else { &[1] };

        let columns: Vec<_> = kept.iter().map(|i| rest.slopes(*i)).collect();
        let inputs: Vec<_> = joints.iter().map(|j| rest.slopes(size + j)).collect();
        let unit = velocity_unit(&kept, half, &columns);
        let scale = |i: usize| if is_velocity(i, half) { unit } else { 1.0 };
        let (n, inner) = (kept.len(), kept.len() + joints.len());
        let lag = core::f64::consts::TAU * plant.drive_bandwidth_hz;
        let mut a = DMatrix::zeros(inner, inner);
        let mut b = DMatrix::zeros(inner, joints.len() + DISTURBANCES);
        let mut c = DMatrix::zeros(OUTPUTS, inner);
        for (j, (rate, output)) in columns.iter().chain(&inputs).enumerate() {
            let of = kept.get(j).map_or(1.0, |i| scale(*i));
            for (row, i) in kept.iter().enumerate() {
                a[(row, j)] = rate[*i] * of / scale(*i);
            }
            for (row, value) in output.iter().enumerate() {
                c[(row, j)] = value * of;
            }
        }
        for j in 0..joints.len() {
            a[(n + j, n + j)] = -lag;
            b[(n + j, j)] = lag;
        }
        let mut measured = DMatrix::zeros(OUTPUTS, DISTURBANCES);
        for disturbance in Disturbance::ALL {
            let column = disturbance as usize;
            let response = rest.disturbed(disturbance);
            for (row, i) in kept.iter().enumerate() {
                b[(row, joints.len() + column)] = response.rate[*i] / scale(*i);
            }
            for (row, value) in response.output.iter().enumerate() {
                measured[(row, column)] = *value;
            }
        }
        let (phi, all_inputs) = sample(&a, &b, 1.0 / f64::from(tick_rate_hz));
        let finite = |m: &DMatrix<f64>| m.iter().all(|x| x.is_finite());
        if !(finite(&phi) && finite(&all_inputs) && finite(&c)) {
            return Err(HybridError::NotFinite { t_s: pose.t_s });
        }
        Ok(Self {
            phi,
            gamma: all_inputs.columns(0, joints.len()).into_owned(),
            disturbance: all_inputs.columns(joints.len(), DISTURBANCES).into_owned(),
            c,
            measured,
            delay_ticks: plant.delay_ticks.max(1),
            pose: *pose,
            #[cfg(test)]
            unit,
        })
    }

    /// Whether link 1 moves.
    pub fn both_joints(&self) -> bool {
        self.gamma.ncols() == 2
    }
}

/// Whether place `i` of a [`PressedArm`]'s state of `half` modes is a rate.
fn is_velocity(i: usize, half: usize) -> bool {
    i == 2 || i == 3 || i >= 4 + half
}

/// A unit for the rates among the places `kept` that makes the entries of the linearisation alike in
/// size, 1/s; `columns` are the state's rates by each of them.
fn velocity_unit(kept: &[usize], half: usize, columns: &[(Vec<f64>, [f64; OUTPUTS])]) -> f64 {
    let rates = || kept.iter().filter(|i| is_velocity(**i, half));
    let mut largest = 0.0_f64;
    for ((rate, _), _) in columns
        .iter()
        .zip(kept)
        .filter(|(_, i)| !is_velocity(**i, half))
    {
        largest = rates().fold(largest, |most, i| most.max(rate[*i].abs()));
    }
    largest.sqrt().max(1.0)
}

/// Over one period, `exp` of `[[a, b], [0, 0]] period`: state to state and inputs to state.
fn sample(a: &DMatrix<f64>, b: &DMatrix<f64>, period_s: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, m) = (a.nrows(), b.ncols());
    let mut whole = DMatrix::zeros(n + m, n + m);
    whole.view_mut((0, 0), (n, n)).copy_from(a);
    whole.view_mut((0, n), (n, m)).copy_from(b);
    let whole = exp(whole * period_s);
    let part = |column, width| whole.view((0, column), (n, width)).into_owned();
    (part(0, n), part(n, m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use proptest::prelude::*;

    const RATE_HZ: u32 = 5000;

    /// The plant's own equations over a period, in many small steps, from a deviation of its state;
    /// the drives' torques behind it, and what they are told beside the torque at rest.
    fn integrated(rest: &AtRest, lag: f64, from: &[f64], told: [f64; 2]) -> Vec<f64> {
        const STEPS: u32 = 4000;
        let step = 1.0 / f64::from(RATE_HZ * STEPS);
        let mut arm = PressedArm::new(&rest.model, rest.geometric, rest.plane);
        let n = rest.state.len();
        let mut rate = |x: &[f64]| {
            let state: Vec<f64> = (0..n).map(|i| rest.state[i] + x[i]).collect();
            let torque = [0, 1].map(|j| rest.torque[j] + x[n + j]);
            let mut slope = vec![0.0; n + 2];
            arm.derivative(&state, torque, &mut slope);
            (0..2).for_each(|j| slope[n + j] = lag * (told[j] - x[n + j]));
            slope
        };
        let mut x = from.to_vec();
        let moved = |x: &[f64], by: &[f64], h: f64| -> Vec<f64> {
            x.iter().zip(by).map(|(x, by)| x + h * by).collect()
        };
        for _ in 0..STEPS {
            let middle = moved(&x, &rate(&x), 0.5 * step);
            let slope = rate(&middle);
            x = moved(&x, &slope, step);
        }
        x
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]

        #[test]
        fn a_period_from_a_small_deviation_is_the_plants_own(
            shape in proptest::collection::vec(-1.0..1.0_f64, 24),
            told in [-1.0..1.0_f64, -1.0..1.0_f64],
            friction in -0.3..0.3_f64,
            which in 0..2_usize,
        ) {
            let arm = testing::arms()[which];
            let plant = LoopPlant { friction, elements: 2, ..LoopPlant::nominal(&arm) };
            let pose = LoopPose {
                t_s: 0.0,
                angle: [0.9, -0.6 + 0.7],
                force_n: 2.0,
                normal_angle: 1.5,
            };
            let rest = AtRest::new(&arm, &plant, &pose).unwrap();
            let sampled = SampledPlant::new(&arm, &plant, &pose, RATE_HZ, true).unwrap();
            let n = rest.state.len();
            let small = 1e-9;
            // Deviations of velocities as large as their unit makes them.
            let half = (n - 4) / 2;
            let unit = |i: usize| match i {
                2 | 3 => sampled.unit,
                i if i >= 4 + half && i < n => sampled.unit,
                _ => 1.0,
            };
            let x: Vec<f64> = (0..n + 2).map(|i| small * shape[i]).collect();
            let told = told.map(|t| small * t);
            let from: Vec<f64> = x.iter().enumerate().map(|(i, x)| x * unit(i)).collect();
            let lag = core::f64::consts::TAU * plant.drive_bandwidth_hz;
            let found = integrated(&rest, lag, &from, told);
            let column = |v: &[f64]| DMatrix::from_column_slice(v.len(), 1, v);
            let expected = &sampled.phi * column(&x) + &sampled.gamma * column(&told);
            let size = expected.amax();
            for i in 0..n + 2 {
                let off = found[i] / unit(i) - expected[i];
                prop_assert!(off.abs() < 1e-5 * size, "{i}: {off:e} of {size:e}");
            }
        }
    }
}

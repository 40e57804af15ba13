//! The hybrid law: joint 1 holds the place along the surface, joint 2 makes the force.
//!
//! It uses what a board measures: the motors' angles m1 and m2 (m2 turns link 2's root tangent
//! against link 1), the moment M at link 2's root and the tip's force f.
//!
//! ```text
//! e1 = m1 - m1_d      e2 = m2 - m2_d      e_f = f_d - f
//!
//! place    tau1 = tau1_d - K1 (e1 + integral(w1 e1)) - B1 e1'             w1 = Ki1 / K1
//! force    want = tau2_d + s2 integral(K_IF e_f) - B2 e2' - k2 e2 + x
//! section  (x, y)' = w (R - 1) (x, y) + w g e2 + w h phi                  phi = -s2 e_f
//! torque   tau2 = want + D      D' = K_T (want - M),  |D| limited
//! ```
//!
//! **Plan.** `m1_d = theta10`, `m2_d = theta20 - theta10 + w'(0)`, and a force along the normal
//! has the moment arm `s2 = r2 sin(psi - theta20)` about joint 2, psi the normal's direction, all
//! of the planned motion. The table's cursor makes them of the columns once a segment, so that a
//! tick takes neither a sine nor sums for them. The force's share in tau1 is left out: on a given
//! surface joint 1 alone decides the place, and static force is joint 2's alone.
//!
//! **Rates** are the errors' differences from tick to tick behind a first-order low-pass (backward
//! Euler, `a = omega T / (1 + omega T)`); here they are in radians a tick, and the damping a tick
//! carries the rate. In fixed point such a difference is a small angle, and [`Scalar::fine`] gives
//! it a format of its own, to [`RATE_MAX_RAD_S`]. Encoder 2 turns with the torque of motor 2, so that B2 takes energy out
//! whatever the link does.
//!
//! **Section.** A second-order filter with frequency w and damping z shapes the loop:
//! `R = exp(T [[-z w, w_q], [-w_q, -z w]])`, `w_q = w sqrt(1 - z^2)`, exact for any tick; inputs are
//! `w T g` and `w T h`. It turns the phase of the force loop, whose plant has a zero on the right.
//!
//! **Torque loop.** D makes the root moment what the law wants: it takes out gear friction and the
//! drive's error. K_T = 0 does without the gauge.
//!
//! **In the air** the same equations run with other numbers for joint 2 ([`FreeParameters`]): the
//! force integral stands still, the force error feeds nothing, and the joint is stiff about its
//! planned angle, where in contact it is soft on purpose. [`HybridLaw::change`] goes from one set to
//! the other without a step in the torque; which one acts is the motion's business
//! ([`crate::control::motion`]).
//!
//! **First tick.** All states are zero and the errors before are the present ones: no kick.
//!
//! **Anti-windup.** What this tick added to joint 1's integral, the force integral and D is taken
//! back, each where it pushed its joint farther into *any* limit behind the law.

use crate::control::feedback::FeedbackLaw;
use crate::control::filter::{filter_alpha, low_pass};
use crate::control::hybrid_parameters::{FreeParameters, HybridParameters};
use crate::control::motion_parameters::MotionCoefficients;
use crate::model::ArmParameters;
use crate::number::{Scalar, SiScalar};
use crate::signals::{Deviation, Formats, Measurement, PoseSetpoint, Saturation, SaturationCounts};
use serde::{Deserialize, Serialize};

/// Largest error that joint 1's integral stands for, rad: what fixed point holds.
const INTEGRAL_MAX_RAD: f64 = 3.0;

/// Largest deviation of a motor's speed from the planned one, rad/s, that fixed point holds at the
/// least: a damper answers it with more than any limit.
pub const RATE_MAX_RAD_S: f64 = 60.0;

/// Joint 2's coefficients, of contact or of the air.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub(super) struct Joint2<T: Scalar> {
    /// k2.
    pub(super) stiffness: T::Gain,
    /// B2 divided by the control period.
    pub(super) damping: T::Gain,
    /// K_IF times the control period.
    pub(super) force_integral: T::Alpha,
    /// K_T times the control period.
    pub(super) torque_loop: T::Alpha,
    /// What the section's states keep of themselves, and what x takes of y and y of x.
    pub(super) rotation: [T::Alpha; 3],
    /// w T g.
    pub(super) section_angle: [T::Gain; 2],
    /// w T h.
    pub(super) section_force: [T::Gain; 2],
    /// What the section's states come to under a lasting error, for each rad of it.
    section_rest: [T::Gain; 2],
}

impl<T: SiScalar> Joint2<T> {
    fn new(
        p: &FreeParameters,
        (force_integral_per_s, section_force): (f64, [f64; 2]),
        (rate_hz, fine): (f64, T::Shift),
        torque: T::Format,
    ) -> Self {
        let section = p.section_frequency_rad_s / rate_hz;
        let [keeps, takes] = p.rotation(rate_hz);
        Self {
            stiffness: T::angle_gain(p.stiffness_nm_rad, torque),
            damping: T::fine_gain(p.damping_nms_rad * rate_hz, fine, torque),
            force_integral: T::alpha(force_integral_per_s / rate_hz),
            torque_loop: T::alpha(p.torque_loop_per_s / rate_hz),
            rotation: [keeps, takes, -takes].map(T::alpha),
            section_angle: p
                .section_angle_nm_rad
                .map(|gain| T::angle_gain(section * gain, torque)),
            section_force: section_force.map(|gain| T::gain(section * gain, torque, torque)),
            section_rest: p.section_rest().map(|gain| T::angle_gain(gain, torque)),
        }
    }
}

/// The hybrid law: its coefficients in the tick's number type.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct HybridLaw<T: Scalar> {
    /// Lengths r1 and r2: from a sine to a moment arm.
    pub(super) link_length: [T::Gain; 2],
    /// K1.
    pub(super) stiffness: T::Gain,
    /// B1 divided by the control period.
    pub(super) damping: T::Gain,
    /// What makes angles of a tick fine.
    pub(super) fine: T::Shift,
    pub(super) rate_filter: [T::Alpha; 2],
    /// Ki1 / K1 times the control period: the integral is kept as an angle.
    pub(super) place_integral: T::Alpha,
    /// Its limit, rad.
    place_integral_limit: T,
    /// Limit of D, N m.
    correction_limit: T,
    /// Joint 2's with the tip on the surface.
    pub(super) contact: Joint2<T>,
    /// Joint 2's with the tip in the air.
    pub(super) free: Joint2<T>,
    /// Format change of moment arm (m) times force (N) to joint 1's and joint 2's torque (N m).
    torque: [T::Shift; 2],
    /// What the motion counts with.
    pub(super) motion: MotionCoefficients<T>,
}

/// What the hybrid law remembers from tick to tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HybridState<T: Scalar> {
    /// Whether joint 2's gains are those of the air.
    pub free: bool,
    /// Whether the root moment is not to be trusted: D stands still.
    pub without_gauge: bool,
    /// Errors of the motors' angles at the tick before, rad; `None` before the first.
    pub angle_error: Option<[T; 2]>,
    /// Their filtered differences, rad a tick.
    pub rate_error: [T::Sum; 2],
    /// Integral of joint 1's error times Ki1 / K1, rad.
    pub place_integral: T::Sum,
    /// K_IF times the force error's integral, N.
    pub force_integral: T::Sum,
    /// Torque D that makes the root moment what is wanted, N m.
    pub torque_correction: T::Sum,
    /// The section's x and y, N m.
    pub section: [T::Sum; 2],
}

impl<T: Scalar> Default for HybridState<T> {
    fn default() -> Self {
        Self {
            free: false,
            without_gauge: false,
            angle_error: None,
            rate_error: [T::Sum::default(); 2],
            place_integral: T::Sum::default(),
            force_integral: T::Sum::default(),
            torque_correction: T::Sum::default(),
            section: [T::Sum::default(); 2],
        }
    }
}

impl<T: Scalar> HybridState<T> {
    /// The first tick, at which the errors before are the present ones.
    #[cold]
    #[inline(never)]
    fn begin(&mut self, error: [T; 2]) -> [T; 2] {
        self.angle_error = Some(error);
        error
    }
}

/// Torques that the hybrid law asks for, before any limit, and what
/// [`HybridLaw::anti_windup`] wants to know of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HybridDemand<T: Scalar> {
    /// (tau1, tau2), N m.
    pub torque: [T; 2],
    /// s2: joint 2's torque of a unit force along the surface normal, m.
    pub moment_arm: T,
    /// Planned force less the measured one, N.
    force_error: T,
    /// Its moment about joint 2, -phi, N m.
    missing_moment: T,
    /// Root moment that is wanted less the measured one, N m.
    moment_error: T,
    /// Place integral, force integral and torque correction without this tick's steps.
    before: [T::Sum; 3],
}

impl<T: SiScalar<Format = ()>> HybridLaw<T> {
    /// Coefficients for `arm` at `tick_rate_hz`, in floating point.
    pub fn new(parameters: &HybridParameters, arm: &ArmParameters, tick_rate_hz: u32) -> Self {
        Self::in_formats(parameters, arm, tick_rate_hz, &Formats::default())
    }
}

impl<T: SiScalar> HybridLaw<T> {
    /// Coefficients for `arm` at `tick_rate_hz` and signals of the given formats. Those that a
    /// format cannot take saturate.
    pub fn in_formats(
        parameters: &HybridParameters,
        arm: &ArmParameters,
        tick_rate_hz: u32,
        formats: &Formats<T::Format>,
    ) -> Self {
        let p = parameters.sent();
        let rate = f64::from(tick_rate_hz);
        let [torque1, torque2] = formats.torque;
        let stiffness1 = p.joint_stiffness_nm_rad[0];
        // Shares of joint 1's stiffness, which may be none.
        let of_stiffness = |torque: f64| {
            if stiffness1 > 0.0 {
                torque / stiffness1
            } else {
                0.0
            }
        };
        let limit_rad = of_stiffness(p.joint1_integral_limit_nm);
        let in_contact = (p.force_integral_per_s, p.section_force);
        let length = |m: f64| T::gain(m, T::SINE, formats.moment_arm);
        // The filter sees differences of rates.
        let fine = T::fine_shift(2.0 * RATE_MAX_RAD_S / rate);
        Self {
            link_length: [length(arm.link1_length_m), length(arm.link2_length_m)],
            stiffness: T::angle_gain(stiffness1, torque1),
            damping: T::fine_gain(p.joint_damping_nms_rad[0] * rate, fine, torque1),
            fine,
            rate_filter: p.rate_filter_hz.map(|hz| T::alpha(filter_alpha(hz, rate))),
            place_integral: T::alpha(of_stiffness(p.joint1_integral_nm_rads) / rate),
            place_integral_limit: T::from_rad(limit_rad.min(INTEGRAL_MAX_RAD)),
            correction_limit: T::from_si(p.torque_correction_limit_nm, torque2),
            contact: Joint2::new(&p.contact(), in_contact, (rate, fine), torque2),
            free: Joint2::new(&p.free, (0.0, [0.0; 2]), (rate, fine), torque2),
            torque: formats
                .torque
                .map(|torque| T::shift(formats.moment_arm, formats.force, torque)),
            motion: MotionCoefficients::new(&p.motion, (arm, tick_rate_hz), fine, formats),
        }
    }
}

impl<T: Scalar> HybridLaw<T> {
    /// The law's torques for a measurement, as the module says; steps all states on.
    #[inline]
    pub fn update(
        &self,
        state: &mut HybridState<T>,
        setpoint: &PoseSetpoint<T>,
        measured: &Measurement<T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> HybridDemand<T> {
        let before = [
            state.place_integral,
            state.force_integral,
            state.torque_correction,
        ];
        let joint2 = if state.free {
            &self.free
        } else {
            &self.contact
        };
        let error = Self::angle_error(setpoint, measured);
        let rate = self.rates(state, error, saturations);
        let tau1 = self.place(state, setpoint.torque[0], error[0], rate[0], saturations);

        let moment_arm = setpoint.moment_arm;
        let force_error = setpoint.force.minus(measured.force, &mut saturations.force);
        let step = force_error.times_alpha(joint2.force_integral);
        state.force_integral =
            T::accumulated(state.force_integral, step, &mut saturations.integral);
        let count = &mut saturations.torque[1];
        let force_moment = moment_arm.times(T::of_sum(state.force_integral), self.torque[1], count);
        let want = setpoint.torque[1]
            .plus(force_moment, count)
            .minus(rate[1].scaled(joint2.damping, count), count)
            .minus(error[1].scaled(joint2.stiffness, count), count)
            .plus(T::of_sum(state.section[0]), count);
        let missing = moment_arm.times(force_error, self.torque[1], count);
        Self::advance_section(joint2, state, error[1], missing, count);
        let moment_error = want.minus(measured.root_moment, count);
        if !state.without_gauge {
            let step = moment_error.times_alpha(joint2.torque_loop);
            state.torque_correction = clipped(
                T::accumulated(state.torque_correction, step, count),
                self.correction_limit,
            );
        }
        HybridDemand {
            torque: [tau1, want.plus(T::of_sum(state.torque_correction), count)],
            moment_arm,
            force_error,
            missing_moment: missing,
            moment_error,
            before,
        }
    }

    /// The motors' angles less the planned ones, e1 and e2, rad.
    #[inline]
    pub(super) fn angle_error(setpoint: &PoseSetpoint<T>, measured: &Measurement<T>) -> [T; 2] {
        let [m1, m2] = measured.motor;
        let [planned1, planned2] = setpoint.motor;
        [m1.angle_minus(planned1), m2.angle_minus(planned2)]
    }

    /// Torques of an arm that stands, N m: what the next `update` gives but for the rates, which are
    /// none, and a tick of the integrals.
    pub(super) fn at_rest(
        &self,
        state: &HybridState<T>,
        (setpoint, measured): (&PoseSetpoint<T>, &Measurement<T>),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> [T; 2] {
        let joint2 = if state.free {
            &self.free
        } else {
            &self.contact
        };
        let [error1, error2] = Self::angle_error(setpoint, measured);
        let force = T::of_sum(state.force_integral);
        let [count1, count2] = &mut saturations.torque;
        let place = error1.plus(T::of_sum(state.place_integral), &mut saturations.motor);
        let tau1 = setpoint.torque[0].minus(place.scaled(self.stiffness, count1), count1);
        let tau2 = setpoint.torque[1]
            .plus(
                setpoint.moment_arm.times(force, self.torque[1], count2),
                count2,
            )
            .minus(error2.scaled(joint2.stiffness, count2), count2)
            .plus(T::of_sum(state.section[0]), count2)
            .plus(T::of_sum(state.torque_correction), count2);
        [tau1, tau2]
    }

    /// What makes a sine a moment arm of link 2's end.
    pub(super) fn link2_length(&self) -> T::Gain {
        self.link_length[1]
    }

    /// Joint 1's torque of a force (N) along the normal, whose direction is `normal` (rad), N m:
    /// `s1 = r1 sin(psi - theta10) + s2` times it.
    pub(super) fn force_on_joint1(
        &self,
        setpoint: &PoseSetpoint<T>,
        (normal, force): (T, T),
        count: &mut T::SaturationCount,
    ) -> T {
        let of_link1 = normal
            .angle_minus(setpoint.motor[0])
            .sine()
            .scaled(self.link_length[0], count);
        let moment_arm = of_link1.plus(setpoint.moment_arm, count);
        moment_arm.times(force, self.torque[0], count)
    }

    /// Joint 2's torque of a force (N) along the normal, N m.
    pub(super) fn force_on_joint2(&self, setpoint: &PoseSetpoint<T>, force: T) -> T {
        let count = &mut T::SaturationCount::default();
        setpoint.moment_arm.times(force, self.torque[1], count)
    }

    /// Goes over to joint 2's gains of the air, or to those of contact, without a step in the
    /// torque: what stiffness and section give is taken over by the force integral. Returns
    /// joint 2's error (rad), about which it is to be counted from now on; the next `update`'s
    /// setpoint must be shifted by it.
    pub(super) fn change(
        &self,
        state: &mut HybridState<T>,
        free: bool,
        (setpoint, measured): (&PoseSetpoint<T>, &Measurement<T>),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> T {
        let joint2 = if state.free {
            &self.free
        } else {
            &self.contact
        };
        let [_, error] = Self::angle_error(setpoint, measured);
        let moment_arm = setpoint.moment_arm;
        let held = T::of_sum(state.section[0]).minus(
            error.scaled(joint2.stiffness, &mut saturations.torque[1]),
            &mut saturations.torque[1],
        );
        let step = held.over(moment_arm, self.torque[1], &mut saturations.integral);
        state.force_integral =
            T::accumulated(state.force_integral, step.sum(), &mut saturations.integral);
        state.section = [T::Sum::default(); 2];
        state.free = free;
        if let Some([_, before]) = &mut state.angle_error {
            *before = before.angle_minus(error);
        }
        error
    }

    /// Counts joint 2's error `angle` (rad) higher, without a step in the torque: the section comes
    /// to where it would be had the error always been there, and the force integral gives what it
    /// and the stiffness take. The next `update`'s setpoint must be as much lower.
    pub(super) fn recount(
        &self,
        state: &mut HybridState<T>,
        (setpoint, angle): (&PoseSetpoint<T>, T),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        let joint2 = if state.free {
            &self.free
        } else {
            &self.contact
        };
        let count = &mut saturations.torque[1];
        let rest = joint2.section_rest.map(|gain| angle.scaled(gain, count));
        for (own, rest) in state.section.iter_mut().zip(rest) {
            *own = T::accumulated(*own, rest.sum(), count);
        }
        let taken = angle.scaled(joint2.stiffness, count).minus(rest[0], count);
        let moment_arm = setpoint.moment_arm;
        let step = taken.over(moment_arm, self.torque[1], &mut saturations.integral);
        state.force_integral =
            T::accumulated(state.force_integral, step.sum(), &mut saturations.integral);
        if let Some([_, before]) = &mut state.angle_error {
            *before = before.angle_minus(angle.negative());
        }
    }

    /// The filtered differences of the errors from tick to tick, rad.
    #[inline]
    fn rates(
        &self,
        state: &mut HybridState<T>,
        error: [T; 2],
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> [T; 2] {
        let before = match &mut state.angle_error {
            Some(before) => core::mem::replace(before, error),
            None => state.begin(error),
        };
        [0, 1].map(|joint| {
            low_pass(
                &mut state.rate_error[joint],
                Some(self.rate_filter[joint]),
                error[joint]
                    .angle_minus(before[joint])
                    .fine(self.fine, &mut saturations.motor),
                &mut saturations.motor,
            )
        })
    }

    /// Joint 1's torque.
    #[inline]
    fn place(
        &self,
        state: &mut HybridState<T>,
        feedforward: T,
        error: T,
        rate: T,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> T {
        let count = &mut saturations.motor;
        let step = error.times_alpha(self.place_integral);
        state.place_integral = clipped(
            T::accumulated(state.place_integral, step, count),
            self.place_integral_limit,
        );
        let held = error.plus(T::of_sum(state.place_integral), count);
        let count = &mut saturations.torque[0];
        feedforward
            .minus(held.scaled(self.stiffness, count), count)
            .minus(rate.scaled(self.damping, count), count)
    }

    /// The section's next state, from joint 2's error (rad) and the force error's moment about it,
    /// -phi (N m).
    #[inline]
    fn advance_section(
        joint2: &Joint2<T>,
        state: &mut HybridState<T>,
        error: T,
        missing: T,
        count: &mut T::SaturationCount,
    ) {
        let [keeps, taken @ ..] = joint2.rotation;
        let [x, y] = state.section.map(T::of_sum);
        let next = |own: T, other: T, i: usize, count: &mut T::SaturationCount| {
            let turned = T::accumulated(own.times_alpha(keeps), other.times_alpha(taken[i]), count);
            let fed = error
                .scaled(joint2.section_angle[i], count)
                .minus(missing.scaled(joint2.section_force[i], count), count);
            T::accumulated(turned, fed.sum(), count)
        };
        state.section = [next(x, y, 0, count), next(y, x, 1, count)];
    }

    /// Tells the law which joints were limited in this tick. Takes the steps back that pushed
    /// them farther into their limits.
    #[inline]
    pub fn anti_windup(
        &self,
        state: &mut HybridState<T>,
        demand: &HybridDemand<T>,
        saturation: [Saturation; 2],
    ) {
        let [place, force, correction] = demand.before;
        let pushed = |joint: usize, up: bool, down: bool| match saturation[joint] {
            Saturation::None => false,
            Saturation::Upper => up,
            Saturation::Lower => down,
        };
        // More integral of the error is less torque.
        if pushed(
            0,
            state.place_integral < place,
            state.place_integral > place,
        ) {
            state.place_integral = place;
        }
        let (more, less) = (state.force_integral > force, state.force_integral < force);
        let (along, against) = (demand.moment_arm > T::ZERO, demand.moment_arm < T::ZERO);
        if pushed(
            1,
            along && more || against && less,
            along && less || against && more,
        ) {
            state.force_integral = force;
        }
        let now = state.torque_correction;
        if pushed(1, now > correction, now < correction) {
            state.torque_correction = correction;
        }
    }
}

/// The sum, no farther from zero than `limit`, which is not negative.
#[inline]
fn clipped<T: Scalar>(sum: T::Sum, limit: T) -> T::Sum {
    if T::of_sum(sum).is_within(limit) {
        sum
    } else {
        beyond(sum, limit)
    }
}

/// The same of one that may be farther: seldom.
#[cold]
#[inline(never)]
fn beyond<T: Scalar>(sum: T::Sum, limit: T) -> T::Sum {
    let (low, high) = (limit.negative().sum(), limit.sum());
    if sum > high {
        high
    } else if sum < low {
        low
    } else {
        sum
    }
}

impl<T: Scalar> FeedbackLaw<T> for HybridLaw<T> {
    type Setpoint = PoseSetpoint<T>;
    type State = HybridState<T>;
    type Demand = HybridDemand<T>;

    fn reads_finite(measured: &Measurement<T>) -> bool {
        let [m1, m2] = measured.motor;
        T::all_finite([m1, m2, measured.root_moment, measured.force])
    }

    #[inline]
    fn shows_in_torque(measured: &Measurement<T>) -> bool {
        // D is within its limit whatever the moment is.
        T::all_finite([measured.root_moment])
    }

    #[inline]
    fn update(
        &self,
        state: &mut Self::State,
        setpoint: &Self::Setpoint,
        measured: &Measurement<T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> Self::Demand {
        self.update(state, setpoint, measured, saturations)
    }

    #[inline]
    fn torque(demand: &Self::Demand) -> [T; 2] {
        demand.torque
    }

    #[inline]
    fn note(
        demand: &Self::Demand,
        setpoint: &Self::Setpoint,
        measured: &Measurement<T>,
        deviation: &mut Deviation<T>,
    ) {
        let count = &mut T::SaturationCount::default();
        deviation.force = demand.force_error;
        deviation.root_moment = demand.moment_error;
        deviation.balance = measured
            .root_moment
            .minus(setpoint.torque[1], count)
            .plus(demand.missing_moment, count);
    }

    #[inline]
    fn anti_windup(
        &self,
        state: &mut Self::State,
        demand: &Self::Demand,
        saturation: [Saturation; 2],
    ) {
        self.anti_windup(state, demand, saturation);
    }
}

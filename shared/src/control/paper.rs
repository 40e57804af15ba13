//! The paper's control law, eq. 18-20: feedforward torques plus direct feedback of contact
//! force and root slope rate.
//!
//! ```text
//! tau1 = tau1_d + s1 u
//! tau2 = tau2_d + s2 u - K_w (w'0_rate [- planned w'0_rate])
//! u    = K_DF de_f/dt + K_PF e_f + K_IF integral(e_f)        e_f = f_d - f
//! ```
//!
//! `s1` and `s2` turn a force along the surface normal into joint torques. With the
//! normal's direction `phi` the Jacobian's transpose gives
//! `s2 = r2 sin(phi - theta20)` and `s1 = r1 sin(phi - theta10) + s2`; for the
//! paper's horizontal surface, phi = pi/2, the sines are the cosines of eq. 20. The
//! paper prints `s2 = r1 cos theta10`, which changes sign along its own path and
//! makes the integrator unstable there.
//!
//! **Force filter.** Force error and its derivative pass one first-order low-pass
//! with corner `omega`, discretised by backward Euler:
//! `x_k = x_{k-1} + a (e_k - x_{k-1})`, `a = omega T / (1 + omega T)`. `K_PF` acts on
//! `x_k` and `K_DF` on `(x_k - x_{k-1}) / T`, which is the filtered error's
//! derivative; `K_IF` acts on `e_k` itself. Without a corner, `a = 1`.
//!
//! **Slope rate filter.** The slope rate passes a filter of the same kind before `K_w`.
//! A root without hub inertia follows torque so fast that a sampled `K_w` large enough
//! to damp the contact mode (some 5 Hz) makes the root itself unstable; a corner
//! between the two keeps both. This filter starts from zero.
//!
//! **Anti-windup.** An increment of the integral is taken back when it pushed a joint
//! farther into *any* limit behind the law: torque limit, torque-rate limit or a
//! drive that reports that it limits. The law therefore runs in two steps,
//! [`PaperLaw::update`] and, when the limits have spoken, [`PaperLaw::anti_windup`].
//!
//! Coefficients ([`PaperLaw`]) and state ([`PaperState`]) are apart, so a state can be
//! reset, copied or compared without touching the gains.

use crate::control::feedback::{Coefficient, FeedbackLaw};
use crate::control::filter::{filter_alpha, low_pass};
use crate::model::ArmParameters;
use crate::number::{Scalar, SiScalar};
use crate::signals::{Deviation, Formats, Measurement, Saturation, SaturationCounts, Setpoint};
use serde::{Deserialize, Serialize};

/// How a force along the surface normal becomes joint torques.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ForceProjection {
    /// By the Jacobian's transpose, for any surface normal.
    #[default]
    JacobianTranspose,
    /// With the printed s2 of eq. 20, `r1 sin(phi - theta10)`.
    AsPrinted,
}

/// What the root slope rate feedback acts on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SlopeRateFeedback {
    /// On the deviation from the planned rate.
    #[default]
    Deviation,
    /// On the rate itself, as printed; that brakes the planned motion too.
    AsPrinted,
}

/// Gains and options of the paper's law, in f64 SI units: what a `controller.toml` with
/// `law = "paper"` says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PaperParameters {
    /// K_DF, gain on the force error's derivative, s.
    pub force_derivative_s: f64,
    /// K_PF, gain on the force error, dimensionless.
    pub force_proportional: f64,
    /// K_IF, gain on the force error's integral, 1/s.
    pub force_integral_per_s: f64,
    /// K_w, gain on the root slope rate, N m s/rad.
    pub slope_rate_nms_rad: f64,
    /// Corner of the force filter, Hz; `None` for no filter.
    pub force_filter_hz: Option<f64>,
    /// Corner of the slope rate filter, Hz; `None` for no filter.
    pub slope_rate_filter_hz: Option<f64>,
    /// How force becomes torque.
    pub force_projection: ForceProjection,
    /// What K_w acts on.
    pub slope_rate_feedback: SlopeRateFeedback,
    /// False leaves the feedforward torques out (the paper's figure 5).
    pub feedforward: bool,
}

impl PaperParameters {
    /// Feedforward alone: all gains zero (the paper's figures 3 and 4).
    pub const FEEDFORWARD: Self = Self {
        force_derivative_s: 0.0,
        force_proportional: 0.0,
        force_integral_per_s: 0.0,
        slope_rate_nms_rad: 0.0,
        force_filter_hz: None,
        slope_rate_filter_hz: None,
        force_projection: ForceProjection::JacobianTranspose,
        slope_rate_feedback: SlopeRateFeedback::Deviation,
        feedforward: true,
    };

    /// True with any gain on force or slope rate.
    pub fn has_feedback(&self) -> bool {
        let gains = [
            self.force_derivative_s,
            self.force_proportional,
            self.force_integral_per_s,
            self.slope_rate_nms_rad,
        ];
        gains.iter().any(|gain| *gain != 0.0)
    }
}

/// The paper's law: its coefficients in the tick's number type.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct PaperLaw<T: Scalar> {
    /// Lengths r1 and r2 of the links: from a sine to a moment arm.
    link_length: [T::Gain; 2],
    /// `None` without gains on the force error and its derivative.
    force_pd: Option<ForcePd<T>>,
    /// K_IF times the control period.
    integral_per_tick: T::Alpha,
    /// K_w.
    slope_rate: T::Gain,
    /// `None` without a filter.
    slope_rate_filter: Option<T::Alpha>,
    /// `None` for the default.
    options: Option<PaperOptions>,
    /// Format change of moment arm (m) times force (N) to torque (N m), a joint.
    torque: [T::Shift; 2],
}

/// Options that differ from the default. Together, so that a tick asks once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct PaperOptions {
    projection: ForceProjection,
    slope_rate_feedback: SlopeRateFeedback,
    feedforward: bool,
}

impl PaperOptions {
    const DEFAULT: Self = Self {
        projection: ForceProjection::JacobianTranspose,
        slope_rate_feedback: SlopeRateFeedback::Deviation,
        feedforward: true,
    };

    /// s2, feedforward torques and planned slope rate as these options have them, from what they
    /// are without; `moment_arm` is that of link 1. A function of its own, or the compiler selects
    /// each value in every tick, and of numbers, or it keeps them in memory.
    #[cold]
    #[inline(never)]
    fn applied<T: Scalar>(
        &self,
        (moment_arm, s2): (T, T),
        (torque1, torque2): (T, T),
        slope_rate: T,
    ) -> [T; 4] {
        let or_none = |value, kept| if kept { value } else { T::ZERO };
        let printed = self.projection == ForceProjection::AsPrinted;
        [
            if printed { moment_arm } else { s2 },
            or_none(torque1, self.feedforward),
            or_none(torque2, self.feedforward),
            or_none(
                slope_rate,
                self.slope_rate_feedback == SlopeRateFeedback::Deviation,
            ),
        ]
    }
}

/// The law's proportional and derivative part, on the filtered force error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
struct ForcePd<T: Scalar> {
    /// K_DF divided by the control period.
    derivative_per_tick: T::Gain,
    /// K_PF.
    proportional: T::Gain,
    /// `None` without a filter.
    filter: Option<T::Alpha>,
}

/// What the law remembers from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PaperState<S> {
    /// Filtered force error, N; `None` before the first tick, which must not
    /// differentiate the step from nothing, and at all ticks without gains on it.
    pub filtered_error: Option<S>,
    /// K_IF times the force error's integral, N.
    pub integral: S,
    /// Filtered root slope rate that K_w acts on, rad/s; from zero on, so that a deviation
    /// at the start does not make the torque jump.
    pub filtered_slope_rate: S,
}

/// Torques that the law asks for, before any limit, and what
/// [`PaperLaw::anti_windup`] wants to know of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperDemand<T: Scalar> {
    /// (tau1, tau2), N m.
    pub torque: [T; 2],
    /// (s1, s2): joint torques of a unit force along the surface normal, J^T n, m.
    pub force_to_torque: [T; 2],
    /// Planned force less the measured one, N.
    pub force_error: T,
    /// What this tick added to the integral, N.
    pub integral_step: T::Sum,
    /// The integral without it, N.
    pub integral_before: T::Sum,
}

impl<T: SiScalar<Format = ()>> PaperLaw<T> {
    /// Coefficients for `arm` at `tick_rate_hz`, in floating point.
    pub fn new(parameters: &PaperParameters, arm: &ArmParameters, tick_rate_hz: u32) -> Self {
        Self::in_formats(parameters, arm, tick_rate_hz, &Formats::default())
    }
}

impl<T: SiScalar> PaperLaw<T> {
    /// Coefficients for `arm` at `tick_rate_hz` and signals of the given formats. Those
    /// that a format cannot take saturate: see [`coefficients`](Self::coefficients).
    pub fn in_formats(
        parameters: &PaperParameters,
        arm: &ArmParameters,
        tick_rate_hz: u32,
        formats: &Formats<T::Format>,
    ) -> Self {
        let rate = f64::from(tick_rate_hz);
        let filter = |corner_hz: Option<f64>| corner_hz.map(|hz| T::alpha(filter_alpha(hz, rate)));
        let force = |gain| T::gain(gain, formats.force, formats.force);
        let gains = [
            parameters.force_derivative_s * rate,
            parameters.force_proportional,
        ];
        let options = PaperOptions {
            projection: parameters.force_projection,
            slope_rate_feedback: parameters.slope_rate_feedback,
            feedforward: parameters.feedforward,
        };
        Self {
            link_length: [arm.link1_length_m, arm.link2_length_m]
                .map(|length| T::gain(length, T::SINE, formats.moment_arm)),
            force_pd: (gains != [0.0; 2]).then(|| ForcePd {
                derivative_per_tick: force(gains[0]),
                proportional: force(gains[1]),
                filter: filter(parameters.force_filter_hz),
            }),
            integral_per_tick: T::alpha(parameters.force_integral_per_s / rate),
            slope_rate: T::gain(
                parameters.slope_rate_nms_rad,
                formats.slope_rate,
                formats.torque[1],
            ),
            slope_rate_filter: filter(parameters.slope_rate_filter_hz),
            options: (options != PaperOptions::DEFAULT).then_some(options),
            torque: formats
                .torque
                .map(|torque| T::shift(formats.moment_arm, formats.force, torque)),
        }
    }

    /// The coefficients after rounding, beside what they were made from.
    pub fn coefficients(
        &self,
        parameters: &PaperParameters,
        arm: &ArmParameters,
        tick_rate_hz: u32,
        formats: &Formats<T::Format>,
    ) -> [Coefficient; 8] {
        let rate = f64::from(tick_rate_hz);
        let force = |gain| T::gain_value(gain, formats.force, formats.force);
        let length = |gain| T::gain_value(gain, T::SINE, formats.moment_arm);
        let filter = |corner_hz: Option<f64>| corner_hz.map_or(0.0, |hz| filter_alpha(hz, rate));
        let filtered = |alpha: Option<T::Alpha>| alpha.map_or(0.0, T::alpha_value);
        let pd = |gain: fn(&ForcePd<T>) -> T::Gain| {
            self.force_pd.as_ref().map_or(0.0, |pd| force(gain(pd)))
        };
        [
            (
                "link1.length_m",
                arm.link1_length_m,
                length(self.link_length[0]),
            ),
            (
                "link2.length_m",
                arm.link2_length_m,
                length(self.link_length[1]),
            ),
            (
                "K_DF_s",
                parameters.force_derivative_s,
                pd(|pd| pd.derivative_per_tick) / rate,
            ),
            (
                "K_PF",
                parameters.force_proportional,
                pd(|pd| pd.proportional),
            ),
            (
                "K_IF_per_s",
                parameters.force_integral_per_s,
                T::alpha_value(self.integral_per_tick) * rate,
            ),
            (
                "K_w_Nms_rad",
                parameters.slope_rate_nms_rad,
                T::gain_value(self.slope_rate, formats.slope_rate, formats.torque[1]),
            ),
            (
                "force_filter_Hz",
                self.force_pd
                    .map_or(0.0, |_| filter(parameters.force_filter_hz)),
                self.force_pd.map_or(0.0, |pd| filtered(pd.filter)),
            ),
            (
                "slope_rate_filter_Hz",
                filter(parameters.slope_rate_filter_hz),
                filtered(self.slope_rate_filter),
            ),
        ]
        .map(|(name, wanted, is)| Coefficient { name, wanted, is })
    }
}

impl<T: Scalar> PaperLaw<T> {
    /// The law's torques for a measurement, eq. 18-20; steps filters and integral on.
    #[inline]
    pub fn update(
        &self,
        state: &mut PaperState<T::Sum>,
        setpoint: &Setpoint<T>,
        measured: &Measurement<T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> PaperDemand<T> {
        let count = saturations;
        let force_error = setpoint.force.minus(measured.force, &mut count.force);
        let integral_before = state.integral;
        let integral_step = force_error.times_alpha(self.integral_per_tick);
        state.integral = T::accumulated(integral_before, integral_step, &mut count.integral);
        let mut u = T::of_sum(state.integral);
        if let Some(pd) = &self.force_pd {
            u = pd
                .update(state, force_error, count)
                .plus(u, &mut count.force_correction);
        }

        let ([r1, r2], [theta10, theta20]) = (self.link_length, measured.angle);
        let phi = setpoint.normal_angle;
        // Moment arms of a force along the normal at each link's end about the link's joint;
        // their format holds both lengths together.
        let no_count = &mut T::SaturationCount::default();
        let arm1 = phi.angle_minus(theta10).sine().scaled(r1, no_count);
        let arm2 = phi.angle_minus(theta20).sine().scaled(r2, no_count);
        let mut force_to_torque = [arm1.plus_in_range(arm2), arm2];
        let (mut feedforward, mut planned_rate) = (setpoint.torque, setpoint.root_slope_rate);
        if let Some(options) = &self.options {
            let [torque1, torque2] = feedforward;
            let applied = options.applied((arm1, arm2), (torque1, torque2), planned_rate);
            force_to_torque[1] = applied[0];
            feedforward = [applied[1], applied[2]];
            planned_rate = applied[3];
        }

        let slope_rate = measured
            .root_slope_rate
            .minus(planned_rate, &mut count.slope_rate);
        let slope_rate = low_pass(
            &mut state.filtered_slope_rate,
            self.slope_rate_filter,
            slope_rate,
            &mut count.slope_rate,
        );

        let [s1, s2] = force_to_torque;
        let [count1, count2] = &mut count.torque;
        let tau1 = s1
            .times(u, self.torque[0], count1)
            .plus(feedforward[0], count1);
        let tau2 = s2
            .times(u, self.torque[1], count2)
            .plus(feedforward[1], count2)
            .minus(slope_rate.scaled(self.slope_rate, count2), count2);
        PaperDemand {
            torque: [tau1, tau2],
            force_to_torque,
            force_error,
            integral_step,
            integral_before,
        }
    }

    /// Tells the law which joints were limited in this tick. Takes the integral's step back
    /// when it pushed any of them farther into its limit.
    #[inline]
    pub fn anti_windup(
        &self,
        state: &mut PaperState<T::Sum>,
        demand: &PaperDemand<T>,
        saturation: [Saturation; 2],
    ) {
        let nothing = T::Sum::default();
        let (more, less) = (
            demand.integral_step > nothing,
            demand.integral_step < nothing,
        );
        let pushed = |joint: usize| {
            let s = demand.force_to_torque[joint];
            let (along, against) = (s > T::ZERO, s < T::ZERO);
            match saturation[joint] {
                Saturation::None => false,
                Saturation::Upper => along && more || against && less,
                Saturation::Lower => along && less || against && more,
            }
        };
        if pushed(0) || pushed(1) {
            state.integral = demand.integral_before;
        }
    }
}

impl<T: Scalar> FeedbackLaw<T> for PaperLaw<T> {
    type Setpoint = Setpoint<T>;
    type State = PaperState<T::Sum>;
    type Demand = PaperDemand<T>;

    fn reads_finite(measured: &Measurement<T>) -> bool {
        T::all_finite([
            measured.angle[0],
            measured.angle[1],
            measured.root_slope_rate,
            measured.force,
        ])
    }

    #[inline]
    fn shows_in_torque(measured: &Measurement<T>) -> bool {
        // A sine is within 1 whatever the angle is.
        T::all_finite(measured.angle)
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
        _: &Self::Setpoint,
        _: &Measurement<T>,
        deviation: &mut Deviation<T>,
    ) {
        deviation.force = demand.force_error;
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

impl<T: Scalar> ForcePd<T> {
    /// K_DF times the derivative of the filtered force error, and K_PF times that error, N.
    #[inline]
    fn update(
        &self,
        state: &mut PaperState<T::Sum>,
        force_error: T,
        count: &mut SaturationCounts<T::SaturationCount>,
    ) -> T {
        let memory = state.filtered_error.get_or_insert(force_error.sum());
        let before = T::of_sum(*memory);
        let filtered = low_pass(memory, self.filter, force_error, &mut count.force);
        let count = &mut count.force_correction;
        filtered
            .minus(before, count)
            .scaled(self.derivative_per_tick, count)
            .plus(filtered.scaled(self.proportional, count), count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    const ARM: ArmParameters = ArmParameters::PAPER;
    const GAINS: PaperParameters = PaperParameters {
        force_derivative_s: 0.01,
        force_proportional: 0.5,
        force_integral_per_s: 4.0,
        slope_rate_nms_rad: 0.1,
        ..PaperParameters::FEEDFORWARD
    };

    fn setpoint() -> Setpoint<f64> {
        Setpoint {
            torque: [-3.0, 0.3],
            force: 2.0,
            root_slope_rate: 0.05,
            normal_angle: FRAC_PI_2,
        }
    }

    fn measured(force: f64) -> Measurement<f64> {
        Measurement {
            angle: [0.95, -0.72],
            root_slope: 0.17,
            root_slope_rate: 0.25,
            force,
            ..Measurement::default()
        }
    }

    /// What the law asks for when `force` is measured.
    fn update(law: &PaperLaw<f64>, state: &mut PaperState<f64>, force: f64) -> PaperDemand<f64> {
        law.update(
            state,
            &setpoint(),
            &measured(force),
            &mut SaturationCounts::default(),
        )
    }

    #[test]
    fn without_error_the_feedforward_passes_unchanged() {
        let law = PaperLaw::new(&PaperParameters::FEEDFORWARD, &ARM, 5000);
        let demand = update(&law, &mut PaperState::default(), -7.0);
        assert_eq!(demand.torque, [-3.0, 0.3]);
    }

    #[test]
    fn each_term_is_that_of_equations_18_to_20() {
        let law = PaperLaw::new(&GAINS, &ARM, 1000);
        let mut state = PaperState::default();
        update(&law, &mut state, 1.5); // e = 0.5
        let p = update(&law, &mut state, 1.4); // e = 0.6
        let u = 0.01 * (0.1 / 1e-3) + 0.5 * 0.6 + 4.0 * (0.5 + 0.6) * 1e-3;
        let (c1, c2) = (libm::cos(0.95), libm::cos(-0.72));
        let (s1, s2) = (0.5 * c1 + 0.55 * c2, 0.55 * c2);
        assert!(
            (p.force_to_torque[0] - s1).abs() < 1e-8 && (p.force_to_torque[1] - s2).abs() < 1e-8
        );
        assert!((p.torque[0] - (-3.0 + s1 * u)).abs() < 1e-7);
        assert!((p.torque[1] - (0.3 + s2 * u - 0.1 * 0.2)).abs() < 1e-7);
    }

    #[test]
    fn the_printed_variants_can_be_had() {
        let printed = PaperParameters {
            force_projection: ForceProjection::AsPrinted,
            slope_rate_feedback: SlopeRateFeedback::AsPrinted,
            ..GAINS
        };
        let p = update(
            &PaperLaw::new(&printed, &ARM, 1000),
            &mut PaperState::default(),
            1.5,
        );
        assert!((p.force_to_torque[1] - 0.5 * libm::cos(0.95)).abs() < 1e-8);
        let u = 0.5 * 0.5 + 4.0 * 0.5e-3;
        assert!((p.torque[1] - (0.3 + p.force_to_torque[1] * u - 0.1 * 0.25)).abs() < 1e-9);
    }

    #[test]
    fn the_first_tick_does_not_differentiate_a_step() {
        let only_derivative = PaperParameters {
            force_proportional: 0.0,
            force_integral_per_s: 0.0,
            slope_rate_nms_rad: 0.0,
            ..GAINS
        };
        let law = PaperLaw::new(&only_derivative, &ARM, 5000);
        let p = update(&law, &mut PaperState::default(), -50.0);
        assert_eq!(p.torque, [-3.0, 0.3]);
    }

    #[test]
    fn the_filter_has_the_stated_corner() {
        // A step of the error is followed as 1 - exp(-omega t), to the order of the step.
        let corner = 10.0;
        let filtered = PaperParameters {
            force_filter_hz: Some(corner),
            ..GAINS
        };
        let law = PaperLaw::new(&filtered, &ARM, 100_000);
        let mut state = PaperState::default();
        update(&law, &mut state, 2.0);
        let ticks = 1592; // one time constant, 1 / (2 pi 10 Hz) = 15.92 ms
        for _ in 0..ticks {
            update(&law, &mut state, 1.0);
        }
        let expected = 1.0 - libm::exp(-core::f64::consts::TAU * corner * f64::from(ticks) * 1e-5);
        assert!((state.filtered_error.unwrap() - expected).abs() < 1e-3);
    }

    #[test]
    fn the_integral_stops_at_every_limit_but_may_leave_it() {
        let law = PaperLaw::new(&GAINS, &ARM, 1000);
        for joint in 0..2 {
            let mut saturation = [Saturation::None; 2];
            saturation[joint] = Saturation::Upper;
            let mut state = PaperState::default();
            // e > 0 and s > 0: the increment pushes up, into the limit.
            let p = update(&law, &mut state, 0.0);
            law.anti_windup(&mut state, &p, saturation);
            assert_eq!(state.integral, 0.0);
            // e < 0 pushes down, away from it.
            let p = update(&law, &mut state, 5.0);
            law.anti_windup(&mut state, &p, saturation);
            assert!(state.integral < 0.0);
        }
    }
}

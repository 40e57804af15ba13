//! How contact is made, kept, lost and left: thresholds, speeds and times of the
//! [motion](crate::control::motion), as a file gives them and as a tick counts with them.

use crate::control::filter::filter_alpha;
use crate::control::slowed::SlowedPlan;
use crate::model::ArmParameters;
use crate::number::{Scalar, SiScalar};
use crate::signals::Formats;
use serde::{Deserialize, Serialize};

/// How contact is made, kept, lost and left, in f64 SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionParameters {
    /// Time for which the table's first tick is held once the force is the plan's, s: the integrals
    /// find what the plan does not know of the arm at rest (weight, stiffness, offsets).
    pub settle_s: f64,
    /// Speed of the tip towards the surface, m/s.
    pub approach_speed_m_s: f64,
    /// Way after which an approach that finds nothing is given up, m.
    pub approach_limit_m: f64,
    /// f_on: force from which on there is contact, as a share of the table's first one.
    pub contact_on_share: f64,
    /// f_off: force below which there is none, as a share of it.
    pub contact_off_share: f64,
    /// Rate at which the wanted force rises and falls, in such forces a second, 1/s.
    pub force_ramp_per_s: f64,
    /// t_lost: time without contact after which a run is given up, s.
    pub lost_s: f64,
    /// Time in which the table comes to a stop, s.
    pub stop_s: f64,
    /// Speed at which the tip is lifted off, m/s.
    pub lift_speed_m_s: f64,
    /// Way by which it is lifted after the last contact, m.
    pub lift_m: f64,
}

impl MotionParameters {
    /// What a `controller.toml` leaves out.
    pub const DEFAULT: Self = Self {
        settle_s: 2.0,
        approach_speed_m_s: 0.02,
        approach_limit_m: 0.1,
        contact_on_share: 0.1,
        contact_off_share: 0.05,
        force_ramp_per_s: 1.0,
        lost_s: 0.2,
        stop_s: 0.15,
        lift_speed_m_s: 0.04,
        lift_m: 0.02,
    };

    /// Ticks for which a settling law holds the table's first one, at `tick_rate_hz`.
    pub fn settle_ticks(&self, tick_rate_hz: u32) -> u32 {
        ticks(self.sent().settle_s, tick_rate_hz)
    }

    /// The parameters as they go over the link, in f32.
    pub(super) fn sent(&self) -> Self {
        let sent = |value: f64| f64::from(value as f32);
        Self {
            settle_s: sent(self.settle_s),
            approach_speed_m_s: sent(self.approach_speed_m_s),
            approach_limit_m: sent(self.approach_limit_m),
            contact_on_share: sent(self.contact_on_share),
            contact_off_share: sent(self.contact_off_share),
            force_ramp_per_s: sent(self.force_ramp_per_s),
            lost_s: sent(self.lost_s),
            stop_s: sent(self.stop_s),
            lift_speed_m_s: sent(self.lift_speed_m_s),
            lift_m: sent(self.lift_m),
        }
    }
}

/// The nearest number of ticks; none where the time is negative or NaN.
fn ticks(time_s: f64, tick_rate_hz: u32) -> u32 {
    (time_s * f64::from(tick_rate_hz) + 0.5) as u32
}

/// Time for which the force must be above f_on, or below f_off, to be believed, s. Noise of 0.05 N
/// is below f_on - f_off by eight times its rms; a bounce is longer.
const BELIEVED_S: [f64; 2] = [1e-3, 2e-3];

/// Corner of the filter on the force by which it is judged, Hz, and how near to the plan's it must
/// be for the table to begin: a share of it.
const JUDGED: (f64, f64) = (16.0, 0.1);

/// Mean force from which on the tip presses and does not bounce any more, as a share of the plan's.
const PRESSING: f64 = 0.25;

/// How many times as fast as elsewhere the force rises until then.
pub(super) const PRESSING_STEPS: u32 = 2;

/// Time without contact after which a touch is forgotten, s.
const FORGET_S: f64 = 0.05;

/// Time that the force has to come so near after the law has settled, s.
const PATIENCE_S: f64 = 5.0;

/// Corner of the filter behind which joint 1's share of the force follows the wanted force, Hz.
const SHARE_HZ: f64 = 16.0;

/// Time constant with which what another table's run ended with fades, s: slow against the link's
/// first mode (0.04 s), fast against any plan. After sixteen of them a ten-millionth is left.
const FADE_S: f64 = 0.1;
const FADE_TIMES: f64 = 16.0;

/// Rate with which joint 2 comes to its planned angle in the air, 1/s: a third of the slowest section
/// among the examples' gains (1.55 rad/s, for any hub). With 2 in its place 5 of 100 arms swing on
/// those, with 1 none; on the gains for a hub 100 arms park within 13 mm (95th percentile), 38 without.
const CREEP_PER_S: f64 = 0.5;

/// Time without contact after which, before the table begins, the approach goes on, s.
const RETRY_S: f64 = 0.03;

/// Losses of contact before the table begins after which the approach is given up.
pub(super) const LOSSES: u8 = 20;

/// Longest way of lifting, as a multiple of [`MotionParameters::lift_m`]: a tip that still touches
/// is lifted on.
pub(super) const LIFT_MOST: u32 = 8;

/// The motion's thresholds and steps in the tick's number type.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub(super) struct MotionCoefficients<T: Scalar> {
    pub(super) settle_ticks: u32,
    pub(super) patience_ticks: u32,
    pub(super) approach_ticks: u32,
    pub(super) lift_ticks: u32,
    pub(super) lost_ticks: u32,
    pub(super) forget_ticks: u32,
    pub(super) retry_ticks: u32,
    /// Ways of the tip in a tick on an arm of 1 m, rad: approaching and lifting.
    pub(super) approach_turn: T,
    pub(super) lift_turn: T,
    /// What makes a moment arm (m) times an angle such a way.
    pub(super) turn: T::Shift,
    /// Of a stop that throws no link.
    pub(super) stop_ticks: u32,
    /// f_on and f_off, shares of the table's first force.
    pub(super) contact: [T::Gain; 2],
    /// Ticks until they are believed.
    pub(super) believed: [u32; 2],
    /// What the wanted force changes in a tick, as a share of it.
    pub(super) force_step: T::Gain,
    pub(super) judged: T::Alpha,
    pub(super) judged_share: T::Gain,
    pub(super) pressing: T::Gain,
    pub(super) share: T::Alpha,
    /// What fades in a tick of what another table's run ended with, and for how long.
    pub(super) fade: T::Alpha,
    pub(super) fade_ticks: u32,
    /// Share of joint 2's error in the air by which a tick turns the angle that it is counted from.
    pub(super) creep: T::Alpha,
    /// The plan's torques at less than full speed.
    pub(super) slowed: SlowedPlan<T>,
}

impl<T: SiScalar> MotionCoefficients<T> {
    /// The coefficients at `tick_rate_hz`, for signals of the given formats.
    pub(super) fn new(
        parameters: &MotionParameters,
        (arm, tick_rate_hz): (&ArmParameters, u32),
        fine: T::Shift,
        formats: &Formats<T::Format>,
    ) -> Self {
        let p = parameters.sent();
        let rate = f64::from(tick_rate_hz);
        let of_time = |time_s| ticks(time_s, tick_rate_hz);
        let share = |value| T::gain(value, formats.force, formats.force);
        let alpha = |hz| T::alpha(filter_alpha(hz, rate));
        // A way at no speed is not gone.
        let of_way = |way_m: f64, speed_m_s: f64| {
            if speed_m_s > 0.0 {
                of_time(way_m / speed_m_s)
            } else {
                0
            }
        };
        let stop_ticks = of_time(p.stop_s);
        Self {
            settle_ticks: of_time(p.settle_s),
            patience_ticks: of_time(PATIENCE_S),
            approach_ticks: of_way(p.approach_limit_m, p.approach_speed_m_s),
            lift_ticks: of_way(p.lift_m, p.lift_speed_m_s),
            lost_ticks: of_time(p.lost_s),
            forget_ticks: of_time(FORGET_S),
            retry_ticks: of_time(RETRY_S),
            approach_turn: T::from_rad(p.approach_speed_m_s / rate),
            lift_turn: T::from_rad(p.lift_speed_m_s / rate),
            turn: T::shift(T::SINE, formats.moment_arm, T::SINE),
            stop_ticks,
            contact: [share(p.contact_on_share), share(p.contact_off_share)],
            believed: BELIEVED_S.map(|time_s| of_time(time_s).max(1)),
            force_step: share(p.force_ramp_per_s / rate),
            judged: alpha(JUDGED.0),
            judged_share: share(JUDGED.1),
            pressing: share(PRESSING),
            share: alpha(SHARE_HZ),
            fade: alpha(1.0 / (core::f64::consts::TAU * FADE_S)),
            fade_ticks: of_time(FADE_TIMES * FADE_S).max(1),
            creep: T::alpha(CREEP_PER_S / rate),
            slowed: SlowedPlan::new(arm, (tick_rate_hz, stop_ticks), fine, formats),
        }
    }
}

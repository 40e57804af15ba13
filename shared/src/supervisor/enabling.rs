//! When the drives may be enabled, and when they must not stay so.
//!
//! The arm starts disabled. [`check_enable`] decides on a request to enable; [`FaultMonitor`] looks at
//! every tick of an enabled arm and names the [`Fault`] that it finds; what is done about one says
//! [`Fault::reaction`]. A fault is latched by the caller until the host acknowledges it.

use crate::control::{LawParameters, LimitParameters};
use crate::fault::Fault;
use crate::link::{Interlocks, Refusal};
use crate::model::ArmParameters;
use crate::number::Scalar;
use crate::signals::{Measurement, Reference};
use crate::table::{Slot, SlotError};

/// Tolerances checked at enabling, and the link time-out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafetyLimits {
    /// Largest deviation of the arm from the table's first row when it is enabled, of
    /// theta10, theta20 and root slope, rad: for the paper's law ([`StartPose::Links`]).
    pub start_rad: [f32; 3],
    /// The same of the motors' angles, rad: for the hybrid law ([`StartPose::Motors`]).
    pub start_motor_rad: [f32; 2],
    /// Ticks in which the first torques are raised while brakes hold the arm; 0 and 1 are none.
    pub soft_start_ticks: u32,
    /// Ticks without a request after which an enabled arm stops.
    pub link_timeout_ticks: u32,
}

/// Drives and sensors at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputHealth {
    /// Emergency stop and drives.
    pub interlocks: Interlocks,
    /// Both conversions are new since the tick before.
    pub fresh: bool,
    /// Both converters are off their rails.
    pub in_range: bool,
}

impl InputHealth {
    /// Every fault that keeps the drives off.
    fn faults(&self) -> [Option<Fault>; 4] {
        [
            (!self.interlocks.estop_released).then_some(Fault::EmergencyStop),
            (!self.interlocks.drives_ok).then_some(Fault::Drive),
            (!self.fresh).then_some(Fault::SensorsStale),
            (!self.in_range).then_some(Fault::SensorRange),
        ]
    }

    /// The fault that keeps the drives off.
    #[inline]
    pub fn fault(&self) -> Option<Fault> {
        if !self.interlocks.estop_released {
            Some(Fault::EmergencyStop)
        } else if !self.interlocks.drives_ok {
            Some(Fault::Drive)
        } else if !self.fresh {
            Some(Fault::SensorsStale)
        } else if !self.in_range {
            Some(Fault::SensorRange)
        } else {
            None
        }
    }
}

/// Everything that [`check_enable`] looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnableInputs {
    /// The latched fault.
    pub latched: Option<Fault>,
    /// Where the joints are is known.
    pub homed: bool,
    /// Drives and sensors now.
    pub health: InputHealth,
    /// What the sensors say.
    pub measured: Measurement<f32>,
}

/// Where the arm is to stand when it is enabled, as far as the law's sensors tell it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StartPose {
    /// theta10, theta20 and root slope, rad: the paper's law has a gauge that shows the slope.
    Links([f32; 3]),
    /// Motor angles (m1, m2), rad. The hybrid law's gauge shows the root's moment, from which no
    /// slope follows on an arm of another stiffness, and so no theta20: it asks the encoders alone.
    Motors {
        /// Where the table begins, pressing.
        pressing: [f32; 2],
        /// Motor 2's angle from there to where the tip is in the air, so far above the surface that an
        /// approach just finds it: the link straightens, and the tip is lifted.
        to_the_air: f32,
    },
}

impl StartPose {
    /// Where a table with this first row begins for this law: m1 = theta10 and
    /// m2 = theta20 - theta10 + w'(0). The hybrid law approaches the surface by itself: there the tip of
    /// an `arm` that is to press may be in the air.
    pub fn new(law: &LawParameters, arm: &ArmParameters, first_row: &Reference<f32>) -> Self {
        let [angle1, angle2] = first_row.angle;
        match law {
            LawParameters::Paper(_) => Self::Links([angle1, angle2, first_row.root_slope]),
            LawParameters::Hybrid(law) => Self::Motors {
                pressing: [angle1, angle2 - angle1 + first_row.root_slope],
                to_the_air: to_the_air(arm, law.motion.approach_limit_m as f32, first_row),
            },
        }
    }

    /// Whether the arm stands there.
    fn check(&self, limits: &SafetyLimits, measured: &Measurement<f32>) -> Result<(), Refusal> {
        // Not within the limit is also what is not a number.
        let within = |(deviation, limit): (&f32, &f32)| deviation.abs() <= *limit;
        match self {
            Self::Links([angle1, angle2, root_slope]) => {
                let deviation_rad = [
                    measured.angle[0] - angle1,
                    measured.angle[1] - angle2,
                    measured.root_slope - root_slope,
                ];
                if deviation_rad.iter().zip(&limits.start_rad).all(within) {
                    return Ok(());
                }
                Err(Refusal::AwayFromStart { deviation_rad })
            }
            Self::Motors {
                pressing,
                to_the_air,
            } => {
                let away = [0, 1].map(|i| measured.motor[i] - pressing[i]);
                let (low, high) = (to_the_air.min(0.0), to_the_air.max(0.0));
                // From the nearer end of what there is to choose from; not a number remains so.
                let beyond = if away[1] < low {
                    away[1] - low
                } else if away[1] > high {
                    away[1] - high
                } else {
                    away[1] * 0.0
                };
                let deviation_rad = [away[0], beyond];
                let allowed_rad = limits.start_motor_rad;
                if deviation_rad.iter().zip(&allowed_rad).all(within) {
                    return Ok(());
                }
                Err(Refusal::MotorsAwayFromStart {
                    deviation_rad,
                    allowed_rad,
                })
            }
        }
    }
}

/// What motor 2 turns by from where a table begins that presses on the surface to where the tip is in
/// the air, `gap_m` above it, rad: the slope that the force makes at link 2's root, and the tip's way.
/// Nothing where the table presses on nothing.
fn to_the_air(arm: &ArmParameters, gap_m: f32, first_row: &Reference<f32>) -> f32 {
    if !(first_row.force > 0.0) {
        return 0.0;
    }
    let length_m = arm.link2_length_m as f32;
    let across = (first_row.normal_angle - first_row.angle[1]).sine();
    let slope = first_row.force * length_m * across / arm.moment_per_root_slope() as f32;
    -(slope + (gap_m / length_m).copysign(across))
}

/// The table to enable with, and its slot: the `wanted` slot's and no other, or without a wish
/// slot A's, or slot B's where A has none that is usable. `open` opens a slot's table.
///
/// # Errors
/// [`Refusal::Table`] for a wanted slot, [`Refusal::NoTable`] without a wish.
pub fn select_table<T>(
    wanted: Option<Slot>,
    mut open: impl FnMut(Slot) -> Result<T, SlotError>,
) -> Result<(Slot, T), Refusal> {
    if let Some(slot) = wanted {
        let table = open(slot).map_err(Refusal::Table)?;
        return Ok((slot, table));
    }
    match open(Slot::A) {
        Ok(table) => Ok((Slot::A, table)),
        Err(a) => match open(Slot::B) {
            Ok(table) => Ok((Slot::B, table)),
            Err(b) => Err(Refusal::NoTable(a, b)),
        },
    }
}

/// Whether an arm with a usable table, which begins at `start`, may be enabled.
///
/// # Errors
/// The first [`Refusal`] that applies.
pub fn check_enable(
    limits: &SafetyLimits,
    inputs: &EnableInputs,
    start: &StartPose,
) -> Result<(), Refusal> {
    if let Some(fault) = inputs.latched {
        return Err(Refusal::Latched(fault));
    }
    if let Some(fault) = inputs.health.fault() {
        return Err(Refusal::Cause(fault));
    }
    if !inputs.homed {
        return Err(Refusal::NotHomed);
    }
    start.check(limits, &inputs.measured)
}

/// Tells every reason why [`check_enable`] refuses, and not the first alone. Where the arm stands can be
/// said of one that is homed, with a table that begins at `start`.
pub fn each_obstacle(
    limits: &SafetyLimits,
    inputs: &EnableInputs,
    start: Option<&StartPose>,
    mut tell: impl FnMut(Refusal),
) {
    if let Some(fault) = inputs.latched {
        tell(Refusal::Latched(fault));
    }
    for fault in inputs.health.faults().into_iter().flatten() {
        tell(Refusal::Cause(fault));
    }
    if !inputs.homed {
        tell(Refusal::NotHomed);
    } else if let Some(Err(refusal)) = start.map(|start| start.check(limits, &inputs.measured)) {
        tell(refusal);
    }
}

/// Whether a table whose torques are bounded by `planned_nm` keeps within the limits: the law
/// would lose the path where they cut it off.
///
/// # Errors
/// [`Refusal::TooMuchTorque`].
pub fn check_torque_bound(planned_nm: [f32; 2], limits: &LimitParameters) -> Result<(), Refusal> {
    let within = |joint: usize| f64::from(planned_nm[joint]) <= limits.torque_nm[joint];
    if within(0) && within(1) {
        Ok(())
    } else {
        Err(Refusal::TooMuchTorque {
            planned_nm,
            limit_nm: limits.torque_nm.map(|limit| limit as f32),
        })
    }
}

/// Watches an enabled arm from tick to tick.
#[derive(Clone, Copy, Debug)]
pub struct FaultMonitor {
    link_timeout_ticks: u32,
    silent_ticks: u32,
    /// Longest time from one tick's begin to the next one's, ticks of the stopwatch.
    longest_ticks_hw: u32,
    /// When the last tick began.
    begun: Option<u32>,
    /// The tick before had no new conversion.
    stale: bool,
}

impl FaultMonitor {
    /// A monitor that begins now: the host counts as just heard. The control period is
    /// `period_ticks_hw` ticks of the stopwatch, 0 for unknown.
    pub fn new(limits: &SafetyLimits, period_ticks_hw: u32) -> Self {
        Self {
            link_timeout_ticks: limits.link_timeout_ticks,
            silent_ticks: 0,
            longest_ticks_hw: match period_ticks_hw {
                0 => u32::MAX,
                // Half a period is for the tick's own jitter.
                period => period.saturating_add(period / 2),
            },
            begun: None,
            stale: false,
        }
    }

    /// The host has sent a request.
    pub fn link_alive(&mut self) {
        self.silent_ticks = 0;
    }

    /// The fault of this tick, if any, which began at `begun` by the stopwatch. `late`: the last
    /// tick was not over when this one was due.
    ///
    /// One tick without a new conversion is let pass, with the values before: a trigger that comes
    /// late does no harm. Two in a row are a fault.
    #[inline]
    pub fn tick(&mut self, health: &InputHealth, late: bool, begun: u32) -> Option<Fault> {
        self.silent_ticks = self.silent_ticks.saturating_add(1);
        let before = self.begun.replace(begun).unwrap_or(begun);
        let lost = begun.wrapping_sub(before) > self.longest_ticks_hw;
        let stale = core::mem::replace(&mut self.stale, !health.fresh);
        let tolerated = InputHealth {
            fresh: health.fresh || !stale,
            ..*health
        };
        tolerated
            .fault()
            .or(late.then_some(Fault::TickOverrun))
            .or(lost.then_some(Fault::TicksLost))
            .or((self.silent_ticks > self.link_timeout_ticks).then_some(Fault::LinkTimeout))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::control::HybridParameters;

    const LIMITS: SafetyLimits = SafetyLimits {
        start_rad: [0.01, 0.01, 0.02],
        start_motor_rad: [0.01, 0.05],
        soft_start_ticks: 0,
        link_timeout_ticks: 3,
    };
    const GOOD: InputHealth = InputHealth {
        interlocks: Interlocks {
            estop_released: true,
            drives_ok: true,
        },
        fresh: true,
        in_range: true,
    };

    /// Each health that alone keeps the drives off, and its fault.
    fn bad() -> [(Fault, InputHealth); 4] {
        let mut bad = [
            Fault::EmergencyStop,
            Fault::Drive,
            Fault::SensorsStale,
            Fault::SensorRange,
        ]
        .map(|fault| (fault, GOOD));
        bad[0].1.interlocks.estop_released = false;
        bad[1].1.interlocks.drives_ok = false;
        bad[2].1.fresh = false;
        bad[3].1.in_range = false;
        bad
    }

    const ROW: Reference<f32> = Reference {
        angle: [0.9, -0.7],
        root_slope: 0.17,
        torque: [0.0; 2],
        force: 0.0,
        root_slope_rate: 0.0,
        normal_angle: 0.0,
    };

    fn links() -> StartPose {
        StartPose::new(&LawParameters::FEEDFORWARD, &ArmParameters::PAPER, &ROW)
    }

    fn motors() -> StartPose {
        StartPose::new(
            &HybridParameters::PAPER_ARM_HUB.into(),
            &ArmParameters::PAPER,
            &ROW,
        )
    }

    fn at_start() -> EnableInputs {
        EnableInputs {
            latched: None,
            homed: true,
            health: GOOD,
            measured: Measurement {
                angle: [0.905, -0.705],
                root_slope: 0.18,
                // theta20 - theta10 + w'(0), on a link that hangs otherwise than planned.
                motor: [0.905, -0.705 - 0.905 + 0.18 + 0.03],
                ..Measurement::default()
            },
        }
    }

    #[test]
    fn without_a_wish_slot_a_comes_first_and_a_wish_is_never_replaced() {
        type Slots = [Result<u8, SlotError>; 2];
        let choose = |wanted, slots: Slots| {
            select_table(wanted, |slot| match slot {
                Slot::A => slots[0],
                Slot::B => slots[1],
            })
        };
        let both: Slots = [Ok(1), Ok(2)];
        let only_b: Slots = [Err(SlotError::Crc), Ok(2)];
        let only_a: Slots = [Ok(1), Err(SlotError::Magic)];
        let none: Slots = [Err(SlotError::Crc), Err(SlotError::Magic)];
        let (a, b) = (Some(Slot::A), Some(Slot::B));
        assert_eq!(choose(None, both), Ok((Slot::A, 1)));
        assert_eq!(choose(None, only_b), Ok((Slot::B, 2)));
        assert_eq!(choose(None, only_a), Ok((Slot::A, 1)));
        let neither = Refusal::NoTable(SlotError::Crc, SlotError::Magic);
        assert_eq!(choose(None, none), Err(neither));
        assert_eq!(choose(a, both), Ok((Slot::A, 1)));
        assert_eq!(choose(b, both), Ok((Slot::B, 2)));
        assert_eq!(choose(a, only_b), Err(Refusal::Table(SlotError::Crc)));
        assert_eq!(choose(b, only_a), Err(Refusal::Table(SlotError::Magic)));
    }

    #[test]
    fn an_arm_at_the_start_with_good_inputs_may_be_enabled() {
        for start in [links(), motors()] {
            assert_eq!(check_enable(&LIMITS, &at_start(), &start), Ok(()));
        }
    }

    #[test]
    fn each_condition_refuses_by_itself() {
        let refusal = |change: &dyn Fn(&mut EnableInputs)| {
            let mut inputs = at_start();
            change(&mut inputs);
            let refusals = [links(), motors()].map(|start| {
                let checked = check_enable(&LIMITS, &inputs, &start);
                checked.unwrap_err()
            });
            assert_eq!(refusals[0], refusals[1]);
            refusals[0]
        };
        assert_eq!(
            refusal(&|s| s.latched = Some(Fault::Drive)),
            Refusal::Latched(Fault::Drive)
        );
        for (fault, health) in bad() {
            assert_eq!(refusal(&|s| s.health = health), Refusal::Cause(fault));
        }
        assert_eq!(refusal(&|s| s.homed = false), Refusal::NotHomed);
    }

    #[test]
    fn all_obstacles_are_told_at_once_and_each_is_one_that_refuses() {
        let told = |inputs: &EnableInputs| {
            let mut told = std::vec![];
            each_obstacle(&LIMITS, inputs, Some(&motors()), |refusal| {
                told.push(refusal);
            });
            assert_eq!(
                told.first().copied(),
                check_enable(&LIMITS, inputs, &motors()).err()
            );
            told
        };
        assert!(told(&at_start()).is_empty());
        let mut inputs = at_start();
        inputs.latched = Some(Fault::TickOverrun);
        inputs.health.interlocks.estop_released = false;
        inputs.health.interlocks.drives_ok = false;
        inputs.health.in_range = false;
        inputs.homed = false;
        let expected = [
            Refusal::Latched(Fault::TickOverrun),
            Refusal::Cause(Fault::EmergencyStop),
            Refusal::Cause(Fault::Drive),
            Refusal::Cause(Fault::SensorRange),
            Refusal::NotHomed,
        ];
        assert_eq!(told(&inputs), expected);
        inputs.homed = true;
        inputs.measured.motor[0] = 0.0;
        let away = told(&inputs)[4];
        assert!(matches!(away, Refusal::MotorsAwayFromStart { .. }));
    }

    #[test]
    fn each_law_asks_what_its_sensors_tell() {
        let check = |start: &StartPose, change: &dyn Fn(&mut Measurement<f32>)| {
            let mut inputs = at_start();
            change(&mut inputs.measured);
            check_enable(&LIMITS, &inputs, start)
        };
        let of_links: [fn(&mut Measurement<f32>); 4] = [
            |m| m.angle[0] += 0.01,
            |m| m.angle[1] -= 0.01,
            |m| m.root_slope += 0.02,
            |m| m.root_slope = f32::NAN,
        ];
        for change in of_links {
            let refusal = check(&links(), &change).unwrap_err();
            assert!(matches!(refusal, Refusal::AwayFromStart { .. }));
            assert_eq!(check(&motors(), &change), Ok(()), "no encoder shows it");
        }
        let of_motors: [fn(&mut Measurement<f32>); 3] = [
            |m| m.motor[0] += 0.01,
            |m| m.motor[1] += 0.05,
            |m| m.motor[1] = f32::NAN,
        ];
        for change in of_motors {
            let refusal = check(&motors(), &change).unwrap_err();
            assert!(matches!(refusal, Refusal::MotorsAwayFromStart { .. }));
            assert_eq!(check(&links(), &change), Ok(()));
        }
    }

    #[test]
    fn a_tip_that_is_to_press_may_be_in_the_air_and_one_that_is_not_may_not() {
        // Normal downwards, the link at -40 degrees: the force turns motor 2 forwards.
        let presses = Reference {
            force: 2.0,
            normal_angle: core::f32::consts::FRAC_PI_2,
            ..ROW
        };
        let law = HybridParameters::PAPER_ARM_HUB.into();
        let arm = ArmParameters::PAPER;
        let start = StartPose::new(&law, &arm, &presses);
        let StartPose::Motors { to_the_air, .. } = start else {
            panic!("the hybrid law asks the motors");
        };
        let lever = arm.link2_length_m * libm::sin(core::f64::consts::FRAC_PI_2 + 0.7);
        let slope = 2.0 * lever / arm.moment_per_root_slope();
        let lift = 0.1 / arm.link2_length_m;
        assert!(
            (f64::from(to_the_air) + slope + lift).abs() < 1e-5,
            "{to_the_air}"
        );
        let check = |start: &StartPose, off: f32| {
            let mut inputs = at_start();
            inputs.measured.motor[1] = -0.7 - 0.9 + 0.17 + off;
            check_enable(&LIMITS, &inputs, start).is_ok()
        };
        for (off, may) in [
            (0.04, true),
            (0.06, false),
            (0.5 * to_the_air, true),
            (to_the_air - 0.04, true),
            (to_the_air - 0.06, false),
            (f32::NAN, false),
        ] {
            assert_eq!(check(&start, off), may, "{off}");
        }
        assert!(!check(&motors(), 0.5 * to_the_air), "no force");
    }

    #[test]
    fn a_motor_that_is_away_is_named_with_how_much() {
        use std::string::ToString;
        let words = |deviation_rad| {
            let refusal = Refusal::MotorsAwayFromStart {
                deviation_rad,
                allowed_rad: LIMITS.start_motor_rad,
            };
            refusal.to_string()
        };
        let second = words([0.002, -0.3]);
        assert!(second.contains("motor 2 stands -0.3000 rad"), "{second}");
        assert!(second.contains("0.0500") && !second.contains("motor 1"));
        let both = words([f32::NAN, 0.06]);
        assert!(both.contains("motor 1 stands NaN rad") && both.contains("motor 2"));
    }

    #[test]
    fn a_table_beyond_the_limits_is_refused() {
        let limits = LimitParameters {
            torque_nm: [20.0, 2.0],
            torque_rate_nm_s: [1e3; 2],
        };
        assert_eq!(check_torque_bound([20.0, 2.0], &limits), Ok(()));
        for planned_nm in [[20.1, 1.0], [1.0, 2.1], [f32::NAN, 0.0]] {
            let refusal = check_torque_bound(planned_nm, &limits).unwrap_err();
            assert!(matches!(refusal, Refusal::TooMuchTorque { .. }));
        }
    }

    #[test]
    fn an_enabled_arm_stops_for_each_cause() {
        let mut monitor = FaultMonitor::new(&LIMITS, 0);
        assert_eq!(monitor.tick(&GOOD, false, 0), None);
        for (fault, health) in bad() {
            monitor.link_alive();
            if !health.fresh {
                assert_eq!(monitor.tick(&health, false, 0), None, "one may be missing");
            }
            assert_eq!(monitor.tick(&health, false, 0), Some(fault));
        }
        monitor.link_alive();
        assert_eq!(monitor.tick(&GOOD, true, 0), Some(Fault::TickOverrun));
        assert_eq!(monitor.tick(&GOOD, false, 0), None);
        assert_eq!(monitor.tick(&GOOD, false, 0), None);
        assert_eq!(monitor.tick(&GOOD, false, 0), Some(Fault::LinkTimeout));
        monitor.link_alive();
        assert_eq!(monitor.tick(&GOOD, false, 0), None);
    }

    #[test]
    fn a_conversion_may_be_missing_every_second_tick_but_not_twice_in_a_row() {
        let mut monitor = FaultMonitor::new(&LIMITS, 0);
        let stale = InputHealth {
            fresh: false,
            ..GOOD
        };
        for _ in 0..3 {
            monitor.link_alive();
            assert_eq!(monitor.tick(&stale, false, 0), None);
            assert_eq!(monitor.tick(&GOOD, false, 0), None);
        }
        monitor.link_alive();
        assert_eq!(monitor.tick(&stale, false, 0), None);
        assert_eq!(monitor.tick(&stale, false, 0), Some(Fault::SensorsStale));
    }

    #[test]
    fn a_tick_that_did_not_take_place_shows_in_the_time_that_has_passed() {
        let tick = |monitor: &mut FaultMonitor, begun| {
            monitor.link_alive();
            monitor.tick(&GOOD, false, begun)
        };
        // The counter's wrap is no jump, and the first tick has none before it.
        let mut monitor = FaultMonitor::new(&LIMITS, 1000);
        for begun in [u32::MAX - 1500, u32::MAX - 400, 499, 1999] {
            assert_eq!(tick(&mut monitor, begun), None, "{begun}");
        }
        assert_eq!(tick(&mut monitor, 3999), Some(Fault::TicksLost));
        let mut unknown = FaultMonitor::new(&LIMITS, 0);
        assert_eq!(tick(&mut unknown, 0), None);
        assert_eq!(tick(&mut unknown, u32::MAX), None);
    }
}

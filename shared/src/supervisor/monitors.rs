//! Monitors: what of an enabled arm's motion and sensors cannot be, at every tick.
//!
//! | monitor | compares | with | fault | reaction |
//! |---|---|---|---|---|
//! | encoder step | counts from tick to tick | twice the speed limit, and 8 counts for the line's noise | encoder_step | off |
//! | frozen encoder | planned motion since an encoder has last moved by more than one count | half of `path_rad` | encoder_frozen | off |
//! | path | each motor's angle less the planned one | `path_rad` | path_deviation | stop |
//! | speed | each motor's speed, filtered over 13 ms | `speed_rad_s` | joint_speed | stop |
//! | root moment | wanted less measured moment, filtered over 10 ms | `root_moment_nm` | root_moment | stop |
//! | balance | measured moment less that of the plan and the measured force, filtered over 50 ms and 200 ms | `balance_nm`, of the two | force_balance | stop |
//! | force band | contact force less the planned one, filtered over 10 ms and 200 ms | six times `force_n`, and once | force_band | stop |
//! | frozen converter | each converter's count | the one before, for 0.2 s in which a motor has turned by 0.1 rad; only where `force_n`, or `root_moment_nm`, is a limit | sensor_frozen | stop |
//! | stop | each motor's speed, once a stop has been ordered | twice `speed_rad_s`, and once after 0.1 s | stop_not_obeyed | off |
//!
//! The first eight end with the first finding: what is wrong then goes on being wrong while the arm
//! is stopped. From there on only the steps and the stop itself are looked at.
//!
//! A monitor's threshold is a number of the task, with a default that the host derives from the
//! plan; [`MonitorParameters::NONE`] lets everything pass. What a law does not know of the plan
//! ([`Deviation`]) is zero, and its monitors are silent.
//!
//! Only the steps are looked at in every tick; the rest takes turns, a fourth of it a tick, so that all
//! monitors together take some sixty instructions. Counts are integers, filters are first order
//! (`x += (v - x) / n`), and no tick is remembered.

use crate::fault::Fault;
use crate::signals::Deviation;
use crate::supervisor::sensing::{Calibration, Sensing};

/// Thresholds of the monitors, SI; infinite for a monitor that is to be silent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonitorParameters {
    /// Largest deviation of the motors' angles from the planned ones, rad.
    pub path_rad: [f32; 2],
    /// Largest speed of the motors, rad/s.
    pub speed_rad_s: [f32; 2],
    /// Largest lasting deviation of the contact force from the planned one, N; a short one may be
    /// six times as large.
    pub force_n: f32,
    /// Largest deviation of the root moment from the one that the law wants, N m.
    pub root_moment_nm: f32,
    /// Largest short and lasting contradiction between root moment and contact force, N m.
    pub balance_nm: [f32; 2],
}

impl MonitorParameters {
    /// Nothing is monitored but the encoders' steps beyond any speed.
    pub const NONE: Self = Self {
        path_rad: [f32::INFINITY; 2],
        speed_rad_s: [f32::INFINITY; 2],
        force_n: f32::INFINITY,
        root_moment_nm: f32::INFINITY,
        balance_nm: [f32::INFINITY; 2],
    };
}

/// Times of the filters, s: of moment and short force, of the short balance, and of what lasts.
const QUICK_S: f32 = 0.01;
const BALANCE_S: f32 = 0.05;
const LASTING_S: f32 = 0.2;
/// The short deviation of the force that is let pass, in lasting ones.
const SHORT_FORCE: f32 = 6.0;
/// Counts that an encoder may step by through its line's noise.
const NOISE_COUNTS: u32 = 8;
/// Counts by which an encoder that has lost a track may move to and fro, with some to spare.
const DITHER_COUNTS: f32 = 1.5;
/// Time and motion of either motor after which a converter that shows none is frozen, s and rad.
const FROZEN_S: f32 = 0.2;
const FROZEN_RAD: f32 = 0.1;
/// Time that a stop has before no more than the planned speed is allowed, s.
const STOP_S: f32 = 0.1;
/// Ticks in which everything has its turn once.
const TURNS: u32 = 4;
/// Fraction bits of the filtered speeds.
const SPEED_BITS: u32 = 8;
/// The speeds' filter forgets 2^-4 a turn, in 64 ticks.
const SPEED_SHIFT: u32 = 4;

/// What a converter showed last, for how many turns, and where the motors were.
#[derive(Clone, Copy, Debug, Default)]
struct Converter {
    count: u16,
    turns: u32,
    position: [i32; 2],
}

impl Converter {
    /// True when it still shows the `count` after more than so many turns, and with a motor turned
    /// by more counts than its `moved`.
    #[inline]
    fn frozen(&mut self, count: u16, position: [i32; 2], (turns, moved): (u32, [u32; 2])) -> bool {
        if count != self.count {
            *self = Self {
                count,
                turns: 0,
                position,
            };
            return false;
        }
        self.turns = self.turns.saturating_add(1);
        let turned = |i: usize| position[i].wrapping_sub(self.position[i]).unsigned_abs();
        self.turns > turns && (turned(0) > moved[0] || turned(1) > moved[1])
    }
}

/// A motor's encoder.
#[derive(Clone, Copy, Debug, Default)]
struct Encoder {
    /// Position at the last tick, and at the last turn.
    position: i32,
    before: i32,
    /// The motor's deviation from its planned angle, rad.
    error: f32,
    /// Position and deviation when it had last moved by more than a count.
    still: (i32, f32),
    /// Filtered motion: counts a turn times 2^([`SPEED_BITS`] + [`SPEED_SHIFT`]).
    speed: i32,
    /// Largest step in a tick, counts.
    step_limit: u32,
    /// Largest [`speed`](Self::speed).
    speed_limit: u32,
    /// Planned motion after which it must show one, rad.
    still_limit: f32,
    /// Largest change of the deviation in a turn of an encoder that shows none, rad: beyond it is
    /// another plan.
    plan_limit: f32,
}

impl Encoder {
    /// An encoder whose counts stand for `rad` each, of a motor that may turn by `speed` (rad/s) and
    /// be off its path by `path` (rad).
    fn new(rad: f32, (path, speed): (f32, f32), rate_hz: f32) -> Self {
        let turned = speed * (TURNS as f32 / rate_hz);
        let counts = (turned / rad).abs();
        // `as` stops at the type's end, where a step cannot be.
        let limit = counts * (1_u32 << (SPEED_BITS + SPEED_SHIFT)) as f32;
        Self {
            step_limit: ((2.0 / TURNS as f32 * counts) as u32).saturating_add(NOISE_COUNTS),
            speed_limit: limit as u32,
            still_limit: 0.5 * path,
            plan_limit: turned + DITHER_COUNTS * rad.abs(),
            ..Self::default()
        }
    }

    /// Follows to a tick's position; true when the step to it is too large.
    #[inline]
    fn steps_too_far(&mut self, position: i32) -> bool {
        let step = position.wrapping_sub(self.position);
        self.position = position;
        step.unsigned_abs() > self.step_limit
    }

    /// A turn: follows the speed.
    #[inline]
    fn turn(&mut self) {
        let moved = self.position.wrapping_sub(self.before);
        self.before = self.position;
        let forgotten = self.speed >> SPEED_SHIFT;
        self.speed = self
            .speed
            .wrapping_add(moved.wrapping_shl(SPEED_BITS))
            .wrapping_sub(forgotten);
    }

    /// A turn: true when it shows no motion, where the `error` (rad) says that there must be one.
    #[inline]
    fn frozen(&mut self, error: f32) -> bool {
        let planned = error - self.error;
        self.error = error;
        let (position, before) = self.still;
        let moved = self.position.wrapping_sub(position).unsigned_abs() > 1;
        // What the law counts from may change at once; that is no motion.
        if moved || planned.abs() > self.plan_limit {
            self.still = (self.position, error);
            return false;
        }
        (error - before).abs() > self.still_limit
    }

    /// True when it turns faster than the largest speed, doubled so many times.
    #[inline]
    fn faster_than(&self, doublings: u32) -> bool {
        self.speed.unsigned_abs() >> doublings > self.speed_limit
    }
}

/// The monitors of one run, from tick to tick.
#[derive(Clone, Debug)]
pub struct Monitors {
    limits: MonitorParameters,
    /// Largest short deviation of the force, N.
    short_force_n: f32,
    /// What the filters of 10, 50 and 200 ms take of what is new at a turn.
    shares: [f32; 3],
    /// Turns after which a converter must have shown something new, and counts of the motors.
    frozen: (u32, [u32; 2]),
    /// Turns that a stop has.
    stop_turns: u32,
    encoders: [Encoder; 2],
    force: Converter,
    strain: Converter,
    root_moment: f32,
    balance: [f32; 2],
    short_force: f32,
    lasting_force: f32,
    /// Whose turn it is; `None` before the first tick.
    turn: Option<u32>,
    /// Turns since a stop was ordered, if it was.
    stopping: Option<u32>,
}

impl Monitors {
    /// Monitors of a run that is to begin, at `tick_rate_hz`.
    pub fn new(
        parameters: &MonitorParameters,
        calibration: &Calibration,
        tick_rate_hz: u32,
    ) -> Self {
        let rate_hz = tick_rate_hz as f32;
        let turns = |time_s: f32| time_s * rate_hz / TURNS as f32;
        Self {
            limits: *parameters,
            short_force_n: SHORT_FORCE * parameters.force_n,
            // A filter that is faster than the turns is none.
            shares: [QUICK_S, BALANCE_S, LASTING_S].map(|time_s| (1.0 / turns(time_s)).min(1.0)),
            frozen: (
                turns(FROZEN_S) as u32,
                calibration
                    .encoder_rad
                    .map(|rad| (FROZEN_RAD / rad).abs() as u32),
            ),
            stop_turns: turns(STOP_S) as u32,
            encoders: [0, 1].map(|i| {
                let limits = (parameters.path_rad[i], parameters.speed_rad_s[i]);
                Encoder::new(calibration.encoder_rad[i], limits, rate_hz)
            }),
            force: Converter::default(),
            strain: Converter::default(),
            root_moment: 0.0,
            balance: [0.0; 2],
            short_force: 0.0,
            lasting_force: 0.0,
            turn: None,
            stopping: None,
        }
    }

    /// A stop, or a hold, has been ordered: from now on it is looked at whether it is obeyed.
    pub fn stop(&mut self) {
        self.stopping = self.stopping.or(Some(0));
    }

    /// What of this tick cannot be, if anything: the counts that it read, and how far from the plan
    /// they are.
    #[inline]
    pub fn tick(&mut self, sensing: &Sensing, deviation: &Deviation<f32>) -> Option<Fault> {
        let position = sensing.position();
        let turn = match self.turn {
            Some(turn) => turn,
            None => self.begin(position),
        };
        self.turn = Some((turn + 1) % TURNS);
        let [first, second] = &mut self.encoders;
        // Both are to be followed, whatever is found.
        if first.steps_too_far(position[0]) | second.steps_too_far(position[1]) {
            return Some(Fault::EncoderStep);
        }
        match turn {
            0 => self.motor(0, deviation),
            1 => self.motor(1, deviation),
            _ if self.stopping.is_some() => None,
            2 => self.moments(deviation),
            _ => self.forces(sensing, deviation),
        }
    }

    /// The first tick has no step.
    #[cold]
    fn begin(&mut self, position: [i32; 2]) -> u32 {
        for (encoder, position) in self.encoders.iter_mut().zip(position) {
            (encoder.position, encoder.before) = (position, position);
            // Far away, so that the first turn counts as a motion.
            encoder.still.0 = position.wrapping_add(i32::MAX);
        }
        (self.force.position, self.strain.position) = (position, position);
        0
    }

    /// Path and speed of a motor.
    #[inline]
    fn motor(&mut self, i: usize, deviation: &Deviation<f32>) -> Option<Fault> {
        let encoder = &mut self.encoders[i];
        encoder.turn();
        if let Some(turns) = &mut self.stopping {
            // Both motors count.
            *turns = turns.saturating_add(1);
            let doublings = u32::from(*turns <= 2 * self.stop_turns);
            return encoder
                .faster_than(doublings)
                .then_some(Fault::StopNotObeyed);
        }
        let error = deviation.angle[i];
        if encoder.frozen(error) {
            Some(Fault::EncoderFrozen)
        } else if error.abs() > self.limits.path_rad[i] {
            Some(Fault::PathDeviation)
        } else {
            encoder.faster_than(0).then_some(Fault::JointSpeed)
        }
    }

    /// The gauge, by the law and by the force cell.
    #[inline]
    fn moments(&mut self, deviation: &Deviation<f32>) -> Option<Fault> {
        let [quick, short, lasting] = self.shares;
        self.root_moment += quick * (deviation.root_moment - self.root_moment);
        for (filtered, share) in self.balance.iter_mut().zip([short, lasting]) {
            *filtered += share * (deviation.balance - *filtered);
        }
        if self.root_moment.abs() > self.limits.root_moment_nm {
            Some(Fault::RootMoment)
        } else {
            let beyond = |i: usize| self.balance[i].abs() > self.limits.balance_nm[i];
            (beyond(0) || beyond(1)).then_some(Fault::ForceBalance)
        }
    }

    /// The force, and converters that stand still.
    #[inline]
    fn forces(&mut self, sensing: &Sensing, deviation: &Deviation<f32>) -> Option<Fault> {
        let [quick, _, lasting] = self.shares;
        self.short_force += quick * (deviation.force - self.short_force);
        self.lasting_force += lasting * (deviation.force - self.lasting_force);
        let (raw, position) = (sensing.raw(), sensing.position());
        // Both are to be followed, whatever is found.
        let force = self.force.frozen(raw.force, position, self.frozen);
        let strain = self.strain.frozen(raw.strain, position, self.frozen);
        if self.short_force.abs() > self.short_force_n
            || self.lasting_force.abs() > self.limits.force_n
        {
            Some(Fault::ForceBand)
        } else {
            // What is held to no band feeds nothing: without feedback a force may stand still for good.
            let force = force && self.limits.force_n < f32::INFINITY;
            let strain = strain && self.limits.root_moment_nm < f32::INFINITY;
            (force | strain).then_some(Fault::SensorFrozen)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::RawSample;

    const RATE_HZ: u32 = 5000;
    const CALIBRATION: Calibration = Calibration {
        encoder_rad: [1e-3, -1e-3],
        home_rad: [0.0; 2],
        force_n: (0.01, 2048.0),
        slope_rad: (1e-3, 2048.0),
        moment_nm_rad: 2.6,
        range: (16, 4079),
    };
    /// 2 rad/s are 0.4 counts a tick.
    const PARAMETERS: MonitorParameters = MonitorParameters {
        path_rad: [0.03, 0.2],
        speed_rad_s: [2.0, 2.0],
        force_n: 1.0,
        root_moment_nm: 0.2,
        balance_nm: [0.6, 0.4],
    };
    const ON_PATH: Deviation<f32> = Deviation {
        angle: [0.0; 2],
        force: 0.0,
        root_moment: 0.0,
        balance: 0.0,
    };

    /// An arm in motion: its encoders turn by so many counts in a hundred ticks, its live converters'
    /// last bit is noise.
    struct Rig {
        monitors: Monitors,
        sensing: Sensing,
        raw: RawSample,
        speed: [i32; 2],
        ticks: i32,
        live: [bool; 2],
    }

    impl Rig {
        fn new(parameters: &MonitorParameters) -> Self {
            let raw = RawSample {
                encoder: [65_530, 3],
                force: 2248,
                strain: 2100,
                fresh: true,
            };
            Self {
                monitors: Monitors::new(parameters, &CALIBRATION, RATE_HZ),
                sensing: Sensing::new(&CALIBRATION, RATE_HZ, &raw),
                raw,
                speed: [30, -25],
                ticks: 0,
                live: [true; 2],
            }
        }

        fn tick(&mut self, deviation: &Deviation<f32>) -> Option<Fault> {
            self.ticks += 1;
            for i in 0..2 {
                let turned = |ticks: i32| (ticks * self.speed[i]).div_euclid(100);
                let step = turned(self.ticks) - turned(self.ticks - 1);
                self.raw.encoder[i] = self.raw.encoder[i].wrapping_add_signed(step as i16);
            }
            let noise = (self.ticks.wrapping_mul(0x2545_F491) >> 16) as u16;
            self.raw.force ^= noise & u16::from(self.live[0]);
            self.raw.strain ^= noise & u16::from(self.live[1]);
            self.sensing.update(&self.raw);
            self.monitors.tick(&self.sensing, deviation)
        }

        /// The first finding in so many ticks, and after how many.
        fn first(&mut self, ticks: u32, deviation: &Deviation<f32>) -> Option<(u32, Fault)> {
            (1..=ticks).find_map(|tick| self.tick(deviation).map(|fault| (tick, fault)))
        }
    }

    /// A rig that has run without a finding for a second.
    fn running() -> Rig {
        let mut rig = Rig::new(&PARAMETERS);
        assert_eq!(rig.first(RATE_HZ, &ON_PATH), None);
        rig
    }

    /// Ticks after which a first-order filter of `n` ticks has gone `share` of the way.
    fn filtered(n: f64, share: f64) -> core::ops::Range<u32> {
        let ticks = libm::log(1.0 - share) / libm::log(1.0 - 1.0 / n);
        (0.96 * ticks) as u32..(1.04 * ticks) as u32 + 2 + TURNS
    }

    #[test]
    fn each_deviation_is_found_beyond_its_threshold_and_in_its_time() {
        type Change = fn(&mut Deviation<f32>, f32);
        let cases: [(Change, f32, Fault, f64); 8] = [
            (|d, x| d.angle[0] = x, 0.03, Fault::PathDeviation, 0.0),
            (|d, x| d.angle[1] = -x, 0.2, Fault::PathDeviation, 0.0),
            (|d, x| d.root_moment = x, 0.2, Fault::RootMoment, 50.0),
            (|d, x| d.root_moment = -x, 0.2, Fault::RootMoment, 50.0),
            (|d, x| d.balance = -x, 0.4, Fault::ForceBalance, 1000.0),
            (|d, x| d.balance = 2.0 * x, 0.3, Fault::ForceBalance, 250.0),
            (|d, x| d.force = x, 1.0, Fault::ForceBand, 1000.0),
            (|d, x| d.force = -8.0 * x, 0.75, Fault::ForceBand, 50.0),
        ];
        for (i, (change, threshold, fault, n)) in cases.into_iter().enumerate() {
            let mut deviation = ON_PATH;
            // Short ones may be larger than those that last.
            if !matches!(i, 5 | 7) {
                change(&mut deviation, 0.99 * threshold);
                assert_eq!(running().first(4 * RATE_HZ, &deviation), None, "case {i}");
            }
            change(&mut deviation, 1.25 * threshold);
            let (ticks, found) = running().first(4 * RATE_HZ, &deviation).unwrap();
            assert_eq!(found, fault, "case {i}");
            let expected = if n > 0.0 {
                filtered(n, 0.8)
            } else {
                1..1 + TURNS
            };
            assert!(expected.contains(&ticks), "case {i}: {ticks}, {expected:?}");
        }
        let mut silent = Rig::new(&MonitorParameters::NONE);
        let far = Deviation {
            angle: [3.0; 2],
            force: 1e3,
            root_moment: -1e3,
            balance: 1e3,
        };
        assert_eq!(silent.first(RATE_HZ, &far), None);
    }

    #[test]
    fn a_step_is_found_in_its_tick_and_a_speed_in_its_filters_time() {
        for i in 0..2 {
            let mut rig = running();
            // Noise of the line, there and back.
            for noise in [5, -5] {
                rig.raw.encoder[i] = rig.raw.encoder[i].wrapping_add_signed(noise);
                assert_eq!(rig.tick(&ON_PATH), None);
            }
            let mut far = running();
            far.raw.encoder[i] = far.raw.encoder[i].wrapping_add(32_767);
            assert_eq!(far.tick(&ON_PATH), Some(Fault::EncoderStep));

            rig.speed[i] = 38;
            assert_eq!(rig.first(RATE_HZ, &ON_PATH), None);
            rig.speed[i] = -80;
            let (ticks, found) = rig.first(RATE_HZ, &ON_PATH).unwrap();
            assert_eq!(found, Fault::JointSpeed);
            // From 38 to -80: at -40 after two thirds of the way.
            assert!(filtered(64.0, 78.0 / 118.0).contains(&ticks), "{ticks}");
        }
    }

    #[test]
    fn an_encoder_is_frozen_where_the_plan_moves_and_it_does_not() {
        for dither in [0, 1] {
            let mut rig = running();
            rig.speed[0] = 0;
            let mut deviation = ON_PATH;
            // The plan goes on at 1.5 rad/s: half the path's 0.03 rad are 50 ticks.
            let found = (1..=100_u16).find_map(|tick| {
                deviation.angle[0] -= 1.5 / RATE_HZ as f32;
                rig.raw.encoder[0] = rig.raw.encoder[0] & !1 | tick & dither;
                rig.tick(&deviation).map(|fault| (tick, fault))
            });
            let (tick, fault) = found.unwrap();
            assert_eq!(fault, Fault::EncoderFrozen);
            assert!((45..=60).contains(&tick), "{tick}");
        }
        // An arm at rest, and one whose plan is exchanged for another.
        let mut rig = running();
        rig.speed = [0; 2];
        assert_eq!(rig.first(RATE_HZ, &ON_PATH), None);
        let mut deviation = ON_PATH;
        deviation.angle = [0.025, -0.19];
        assert_eq!(rig.first(RATE_HZ, &deviation), None);
    }

    #[test]
    fn a_converter_is_frozen_only_where_the_arm_moves() {
        for i in 0..2 {
            let mut rig = running();
            rig.live[i] = false;
            let (ticks, fault) = rig.first(RATE_HZ, &ON_PATH).unwrap();
            assert_eq!(fault, Fault::SensorFrozen);
            // The faster motor turns by 100 counts in 333 ticks; 1000 are wanted.
            assert!((1000..1010).contains(&ticks), "{ticks}");
            // One that moves to and fro is as good as one at rest.
            let mut rig = running();
            (rig.live, rig.speed) = ([false; 2], [0; 2]);
            for tick in 0..4 * RATE_HZ {
                rig.raw.encoder[1] ^= u16::from(tick % 2 == 0);
                assert_eq!(rig.tick(&ON_PATH), None);
            }
            rig.speed[1] = 4;
            let (ticks, fault) = rig.first(RATE_HZ, &ON_PATH).unwrap();
            assert_eq!(fault, Fault::SensorFrozen);
            assert!((2475..2555).contains(&ticks), "{ticks}");
        }
    }

    #[test]
    fn after_a_stop_only_what_does_not_obey_it_is_found() {
        let far = Deviation {
            angle: [0.1, 0.1],
            force: 9.0,
            root_moment: 1.0,
            balance: 1.0,
        };
        let stopped = || {
            let mut rig = running();
            rig.monitors.stop();
            rig
        };
        let mut obeys = stopped();
        obeys.live = [false; 2];
        assert_eq!(obeys.first(RATE_HZ, &far), None);
        // Up to twice the limit for 0.1 s, and then no more than once.
        let mut slow = stopped();
        slow.speed[1] = 60;
        let (ticks, fault) = slow.first(RATE_HZ, &far).unwrap();
        assert_eq!(fault, Fault::StopNotObeyed);
        assert!((500..=504).contains(&ticks), "{ticks}");
        let mut fast = stopped();
        fast.speed[0] = -200;
        let (ticks, fault) = fast.first(RATE_HZ, &far).unwrap();
        assert!(ticks < 70 && fault == Fault::StopNotObeyed, "{ticks}");
        let mut far_off = stopped();
        far_off.raw.encoder[1] ^= 0x4000;
        assert_eq!(far_off.tick(&far), Some(Fault::EncoderStep));
    }
}

//! Faults that are put into a run at a given time: of sensors, of drives, and of what the
//! supervisor is told.
//!
//! They act where they would on a board: on the counts that encoders and converters give (after
//! noise, delay and quantisation), on the torques that the drives make of their counts, on the
//! interlocks' lines, on the timer and on the link. Where contact is lost or something is in the
//! way, the surface says so, not this file.

use crate::plant::bench::{Channels, RandomStream};
use flexor::link::RawSample;

/// What goes wrong. Joints are 0 and 1; counts are those of the encoder or converter concerned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// The encoder's count stands still: its cable is off.
    EncoderStuck(usize),
    /// One of the encoder's tracks is cut: the count moves to and fro between two neighbours.
    EncoderTrackCut(usize),
    /// The encoder counts the wrong way from now on: its tracks are swapped.
    EncoderReversed(usize),
    /// The encoder's count is off by so many.
    EncoderJump(usize, f64),
    /// The encoder's count dithers by up to so many to either side.
    EncoderNoise(usize, f64),
    /// An analog channel misbehaves.
    Analog(AnalogChannel, AnalogFault),
    /// The converters have nothing new.
    ConversionMissing,
    /// The drive gives no torque and says that it is well.
    DriveDead(usize),
    /// The drive gives this share of the torque.
    DriveWeak(usize, f64),
    /// The drive gives on what it gave last, enabled or not.
    DriveFrozen(usize),
    /// The drive gives the opposite torque.
    DriveReversed(usize),
    /// The drive gives this torque, N m, whatever it is asked for.
    DriveRunaway(usize, f64),
    /// A drive says that it has a fault.
    DriveFault,
    /// The emergency stop is pressed.
    EmergencyStop,
    /// Every second tick does not take place: interrupts were held off.
    TicksLost,
    /// A tick is not over when the next one is due.
    TickOverrun,
    /// The host is silent.
    LinkLost,
    /// No fault: the operator ends the run.
    Retract,
    /// No fault: the operator lets the table stand.
    Pause,
}

/// An analog channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnalogChannel {
    /// The root gauge's.
    Strain,
    /// The force cell's.
    Force,
}

/// What is wrong with an analog channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnalogFault {
    /// It is at its upper rail.
    Rail,
    /// Its count stands still.
    Stuck,
    /// It shows zero, the middle of its range: the bridge has lost its supply.
    MidRail,
    /// It shows the mirror image of its count about zero: its wires are swapped.
    Reversed,
    /// It is off by so many counts.
    Offset(f64),
    /// It shows so many counts from zero, whatever there is.
    Shows(f64),
    /// It drifts by so many counts a second.
    Drift(f64),
    /// It has a noise of up to so many counts to either side.
    Noise(f64),
}

/// A fault as it is written: its name, the unit of the value that it takes, if it takes one, and
/// what it is with that value.
pub struct FaultName {
    /// Name in snake case.
    pub name: &'static str,
    /// Unit of its value; `None` where it takes none.
    pub unit: Option<&'static str>,
    make: fn(f64) -> FaultKind,
}

impl FaultName {
    const fn plain(name: &'static str, make: fn(f64) -> FaultKind) -> Self {
        let unit = None;
        Self { name, unit, make }
    }

    const fn with(name: &'static str, unit: &'static str, make: fn(f64) -> FaultKind) -> Self {
        let unit = Some(unit);
        Self { name, unit, make }
    }

    /// The fault of this name; `value` is of no meaning where there is no unit.
    pub fn kind(&self, value: f64) -> FaultKind {
        (self.make)(value)
    }

    /// Every name, of faults and then of wishes.
    pub fn all() -> impl Iterator<Item = &'static Self> {
        FAULT_NAMES.iter().chain(WISH_NAMES)
    }

    /// The entry of this name, if there is one.
    pub fn find(name: &str) -> Option<&'static Self> {
        Self::all().find(|entry| entry.name == name)
    }
}

/// What the operator may wish in a run, put into it as faults are.
pub const WISH_NAMES: &[FaultName] = &[
    FaultName::plain("retract", |_| FaultKind::Retract),
    FaultName::plain("pause", |_| FaultKind::Pause),
];

/// Every fault that can be put into a run.
pub const FAULT_NAMES: &[FaultName] = {
    use AnalogChannel::{Force, Strain};
    use AnalogFault::{Drift, MidRail, Noise, Offset, Rail, Reversed, Shows, Stuck};
    use FaultKind as F;
    use FaultName as N;
    &[
        N::plain("encoder1_stuck", |_| F::EncoderStuck(0)),
        N::plain("encoder2_stuck", |_| F::EncoderStuck(1)),
        N::plain("encoder1_track_cut", |_| F::EncoderTrackCut(0)),
        N::plain("encoder2_track_cut", |_| F::EncoderTrackCut(1)),
        N::plain("encoder1_reversed", |_| F::EncoderReversed(0)),
        N::plain("encoder2_reversed", |_| F::EncoderReversed(1)),
        N::with("encoder1_jump", "counts", |x| F::EncoderJump(0, x)),
        N::with("encoder2_jump", "counts", |x| F::EncoderJump(1, x)),
        N::with("encoder1_noise", "counts", |x| F::EncoderNoise(0, x)),
        N::with("encoder2_noise", "counts", |x| F::EncoderNoise(1, x)),
        N::plain("strain_rail", |_| F::Analog(Strain, Rail)),
        N::plain("strain_stuck", |_| F::Analog(Strain, Stuck)),
        N::plain("strain_mid_rail", |_| F::Analog(Strain, MidRail)),
        N::plain("strain_reversed", |_| F::Analog(Strain, Reversed)),
        N::with("strain_offset", "counts", |x| F::Analog(Strain, Offset(x))),
        N::with("strain_drift", "counts/s", |x| F::Analog(Strain, Drift(x))),
        N::with("strain_noise", "counts", |x| F::Analog(Strain, Noise(x))),
        N::plain("force_rail", |_| F::Analog(Force, Rail)),
        N::plain("force_stuck", |_| F::Analog(Force, Stuck)),
        N::plain("force_mid_rail", |_| F::Analog(Force, MidRail)),
        N::plain("force_reversed", |_| F::Analog(Force, Reversed)),
        N::with("force_offset", "counts", |x| F::Analog(Force, Offset(x))),
        N::with("force_shows", "counts", |x| F::Analog(Force, Shows(x))),
        N::with("force_noise", "counts", |x| F::Analog(Force, Noise(x))),
        N::plain("conversion_missing", |_| F::ConversionMissing),
        N::plain("drive1_dead", |_| F::DriveDead(0)),
        N::plain("drive2_dead", |_| F::DriveDead(1)),
        N::with("drive1_weak", "share", |x| F::DriveWeak(0, x)),
        N::with("drive2_weak", "share", |x| F::DriveWeak(1, x)),
        N::plain("drive1_frozen", |_| F::DriveFrozen(0)),
        N::plain("drive2_frozen", |_| F::DriveFrozen(1)),
        N::plain("drive1_reversed", |_| F::DriveReversed(0)),
        N::plain("drive2_reversed", |_| F::DriveReversed(1)),
        N::with("drive1_runaway", "N m", |x| F::DriveRunaway(0, x)),
        N::with("drive2_runaway", "N m", |x| F::DriveRunaway(1, x)),
        N::plain("drive_fault", |_| F::DriveFault),
        N::plain("emergency_stop", |_| F::EmergencyStop),
        N::plain("ticks_lost", |_| F::TicksLost),
        N::plain("tick_overrun", |_| F::TickOverrun),
        N::plain("link_lost", |_| F::LinkLost),
    ]
};

/// A fault with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedFault {
    /// What goes wrong.
    pub kind: FaultKind,
    /// When it begins, s from the path's start.
    pub from_s: f64,
    /// When it is over, s; infinite for one that stays.
    pub to_s: f64,
}

/// The faults of one arm, from tick to tick.
#[derive(Clone, Debug)]
pub(super) struct Injection {
    faults: Vec<ActiveFault>,
    noise: RandomStream,
    channels: Channels,
    period_s: f64,
}

/// A fault and what was when it began.
#[derive(Clone, Debug)]
struct ActiveFault {
    fault: TimedFault,
    active: bool,
    /// Ticks since it began.
    ticks: u32,
    /// The sample when it began.
    sample: RawSample,
    /// The torques of the drives when it began, N m.
    torque: [f64; 2],
}

impl Injection {
    /// No fault has begun yet. `seed` determines the noise of those that have any.
    pub(super) fn new(
        faults: &[TimedFault],
        channels: &Channels,
        period_s: f64,
        seed: u64,
    ) -> Self {
        let active = |fault: &TimedFault| ActiveFault {
            fault: *fault,
            active: false,
            ticks: 0,
            sample: RawSample::default(),
            torque: [0.0; 2],
        };
        Self {
            faults: faults.iter().map(active).collect(),
            noise: RandomStream::new(seed, 31),
            channels: *channels,
            period_s,
        }
    }

    /// Goes on to the tick at `t_s` (s), at which the sensors say `sample` and the drives have
    /// been giving `torque` (N m).
    pub(super) fn advance(&mut self, t_s: f64, sample: &RawSample, torque: [f64; 2]) {
        // Half a period of grace, so that a time that is a tick's is that tick's.
        let now = t_s + 0.5 * self.period_s;
        for fault in &mut self.faults {
            let active = fault.fault.from_s <= now && now < fault.fault.to_s;
            if active && !fault.active {
                (fault.sample, fault.torque, fault.ticks) = (*sample, torque, 0);
            } else {
                fault.ticks += 1;
            }
            fault.active = active;
        }
    }

    /// The faults that act now.
    fn acting(&self) -> impl Iterator<Item = &ActiveFault> {
        self.faults.iter().filter(|fault| fault.active)
    }

    /// True where one of the faults that act now is `kind`.
    pub(super) fn has(&self, kind: FaultKind) -> bool {
        self.acting().any(|fault| fault.fault.kind == kind)
    }

    /// True where this tick does not take place.
    pub(super) fn loses_tick(&self) -> bool {
        self.acting()
            .any(|fault| fault.fault.kind == FaultKind::TicksLost && !fault.ticks.is_multiple_of(2))
    }

    /// What the board reads instead of `sample`.
    pub(super) fn sample(&mut self, sample: RawSample) -> RawSample {
        let Self {
            faults,
            noise,
            channels,
            period_s,
        } = self;
        let mut given = sample;
        for fault in faults.iter().filter(|fault| fault.active) {
            let begun = &fault.sample;
            match fault.fault.kind {
                FaultKind::EncoderTrackCut(j) => {
                    let turned = given.encoder[j].wrapping_sub(begun.encoder[j]);
                    given.encoder[j] = begun.encoder[j].wrapping_add(turned & 1);
                }
                FaultKind::EncoderStuck(j) => given.encoder[j] = begun.encoder[j],
                FaultKind::EncoderReversed(j) => {
                    let turned = given.encoder[j].wrapping_sub(begun.encoder[j]);
                    given.encoder[j] = begun.encoder[j].wrapping_sub(turned);
                }
                FaultKind::EncoderJump(j, counts) => {
                    given.encoder[j] = given.encoder[j].wrapping_add(counts.round() as i64 as u16);
                }
                FaultKind::EncoderNoise(j, counts) => {
                    let off = (2.0 * noise.uniform() - 1.0) * counts;
                    given.encoder[j] = given.encoder[j].wrapping_add(off.round() as i16 as u16);
                }
                FaultKind::Analog(channel, kind) => {
                    let (converter, count, held) = match channel {
                        AnalogChannel::Strain => {
                            (&channels.strain, &mut given.strain, begun.strain)
                        }
                        AnalogChannel::Force => (&channels.force, &mut given.force, begun.force),
                    };
                    let zero = converter.zero_count;
                    let (now, age_s) = (f64::from(*count), f64::from(fault.ticks) * *period_s);
                    let shown = match kind {
                        AnalogFault::Rail => f64::from(converter.count_max),
                        AnalogFault::Stuck => f64::from(held),
                        AnalogFault::MidRail => zero,
                        AnalogFault::Reversed => 2.0 * zero - now,
                        AnalogFault::Offset(counts) => now + counts,
                        AnalogFault::Shows(counts) => zero + counts,
                        AnalogFault::Drift(rate) => now + rate * age_s,
                        AnalogFault::Noise(counts) => now + (2.0 * noise.uniform() - 1.0) * counts,
                    };
                    // `as` stops at the type's ends and takes NaN for 0.
                    *count = (shown.round() as u16).min(converter.count_max);
                }
                FaultKind::ConversionMissing => given.fresh = false,
                _ => {}
            }
        }
        given
    }

    /// What the drives tend to instead of `torque`, N m.
    pub(super) fn torque(&self, torque: [f64; 2]) -> [f64; 2] {
        let mut given = torque;
        for fault in self.acting() {
            match fault.fault.kind {
                FaultKind::DriveDead(j) => given[j] = 0.0,
                FaultKind::DriveWeak(j, share) => given[j] *= share,
                FaultKind::DriveFrozen(j) => given[j] = fault.torque[j],
                FaultKind::DriveReversed(j) => given[j] = -given[j],
                FaultKind::DriveRunaway(j, nm) => given[j] = nm,
                _ => {}
            }
        }
        given
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::bench::{ConverterChannel, EncoderChannel};

    const ENCODER: EncoderChannel = EncoderChannel {
        rad_per_count: 1e-3,
        home_rad: 0.0,
    };
    const CONVERTER: ConverterChannel = ConverterChannel {
        per_count: 0.01,
        zero_count: 2048.0,
        count_max: 4095,
    };
    const CHANNELS: Channels = Channels {
        encoder: [ENCODER; 2],
        force: CONVERTER,
        strain: CONVERTER,
    };

    /// What is read and given at ticks 0 to 9 (1 ms apart) of an arm that moves, with the fault of
    /// this `name` and `value` from tick 3 on, over before tick 7.
    fn injected(name: &str, value: f64) -> Vec<(RawSample, [f64; 2])> {
        let fault = TimedFault {
            kind: FaultName::find(name).expect("a fault's name").kind(value),
            from_s: 3e-3,
            to_s: 7e-3,
        };
        let mut injection = Injection::new(&[fault], &CHANNELS, 1e-3, 1);
        (0..10_u16)
            .map(|tick| {
                let raw = sample(tick);
                injection.advance(f64::from(tick) * 1e-3, &raw, torque(tick));
                (injection.sample(raw), injection.torque(torque(tick)))
            })
            .collect()
    }

    fn sample(tick: u16) -> RawSample {
        RawSample {
            encoder: [10 * tick, 65_530 + tick.min(5)],
            force: 2200 + tick,
            strain: 2000 - tick,
            fresh: true,
        }
    }

    fn torque(tick: u16) -> [f64; 2] {
        [f64::from(tick), -1.0]
    }

    #[test]
    fn each_acts_from_its_time_to_its_end_and_only_on_what_it_is_of() {
        for entry in FAULT_NAMES {
            let seen = injected(entry.name, 30.0);
            for (tick, (raw, given)) in (0..).zip(&seen) {
                if !(3..7).contains(&tick) {
                    assert_eq!(
                        (*raw, *given),
                        (sample(tick), torque(tick)),
                        "{}",
                        entry.name
                    );
                }
                let untouched = sample(tick);
                if !entry.name.starts_with("encoder") {
                    assert_eq!(raw.encoder, untouched.encoder, "{}", entry.name);
                }
                if !entry.name.starts_with("strain") {
                    assert_eq!(raw.strain, untouched.strain, "{}", entry.name);
                }
                if !entry.name.starts_with("force") {
                    assert_eq!(raw.force, untouched.force, "{}", entry.name);
                }
            }
        }
    }

    #[test]
    fn counts_and_torques_are_what_the_names_say() {
        let at5 = |name, value| injected(name, value)[5];
        assert_eq!(at5("encoder1_stuck", 0.0).0.encoder[0], 30);
        assert_eq!(at5("encoder1_track_cut", 0.0).0.encoder[0], 30);
        let other_edge = injected("encoder2_track_cut", 0.0)[4];
        assert_eq!(other_edge.0.encoder[1], 65_534);
        assert_eq!(at5("encoder2_track_cut", 0.0).0.encoder[1], 65_533);
        assert_eq!(at5("encoder1_reversed", 0.0).0.encoder[0], 10);
        assert_eq!(at5("encoder1_jump", -60.0).0.encoder[0], 65_526);
        assert_eq!(at5("encoder2_jump", 5.0).0.encoder[1], 4);
        let dither = at5("encoder1_noise", 5.0).0.encoder[0];
        assert!((45..=55).contains(&dither) && dither != 50);
        assert_eq!(at5("strain_rail", 0.0).0.strain, 4095);
        assert_eq!(at5("strain_stuck", 0.0).0.strain, 1997);
        assert_eq!(at5("strain_mid_rail", 0.0).0.strain, 2048);
        assert_eq!(at5("strain_reversed", 0.0).0.strain, 2101);
        assert_eq!(at5("strain_offset", 30.0).0.strain, 2025);
        assert_eq!(at5("strain_drift", 1000.0).0.strain, 1997);
        assert_eq!(at5("force_shows", -5000.0).0.force, 0);
        assert_eq!(at5("force_offset", 5000.0).0.force, 4095);
        assert!(!at5("conversion_missing", 0.0).0.fresh);
        assert_eq!(at5("drive1_dead", 0.0).1, [0.0, -1.0]);
        assert_eq!(at5("drive1_weak", 0.8).1, [4.0, -1.0]);
        assert_eq!(at5("drive1_frozen", 0.0).1, [3.0, -1.0]);
        assert_eq!(at5("drive2_reversed", 0.0).1, [5.0, 1.0]);
        assert_eq!(at5("drive2_runaway", 3.5).1, [5.0, 3.5]);
    }
}

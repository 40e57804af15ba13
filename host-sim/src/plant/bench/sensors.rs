//! The sensors: from what is to the counts that a board reads.
//!
//! | sensor | measures |
//! |---|---|
//! | encoders | the motors' angles; joint 2's is `theta20 + w'(0) - theta10` (with gear play: the rotor's) |
//! | root gauge | the bending moment M at link 2's root, as the slope `r2 M / (3 EI)` that a load at the tip alone would give ([`GaugeSignal`] has the other) |
//! | force cell | the force of the tip on the surface along the *planned* normal: on a tilted surface it sees some of the friction |
//!
//! `M = tau2 - J_r (theta20'' + E.w'')`, with `tau2` the torque on the root after friction: a
//! gauge does not see the slope, it sees what bends the link.
//!
//! Noise is drawn each tick; delays are whole ticks. A converter stops at its ends and an encoder's
//! 16 bits wrap. Where a conversion drops out, the last one stands and is not `fresh`.

use crate::plant::bench::drive::DELAY_TICKS_MAX;
use crate::plant::bench::noise::RandomStream;
use flexor::link::RawSample;
use flexor::supervisor::{BoardParameters, ConverterScale};

/// How an encoder counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderChannel {
    /// Joint angle a count, rad; negative where it counts against the angle.
    pub rad_per_count: f64,
    /// Angle at which it counts 0, rad: the home pose.
    pub home_rad: f64,
}

/// How a converter counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConverterChannel {
    /// What a count is in the channel's unit (N, rad).
    pub per_count: f64,
    /// Count at zero.
    pub zero_count: f64,
    /// Largest count.
    pub count_max: u16,
}

impl ConverterChannel {
    /// The count of a value in the channel's unit, rounded and stopped at either end; NaN counts 0.
    pub fn count(&self, value: f64) -> u16 {
        let count = (self.zero_count + value / self.per_count).round();
        // `as` stops at the type's ends and takes NaN for 0.
        (count as u16).min(self.count_max)
    }
}

/// A board's channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channels {
    /// Encoders of motor 1 and 2.
    pub encoder: [EncoderChannel; 2],
    /// Converter of the force cell, N.
    pub force: ConverterChannel,
    /// Converter of the root gauge, rad of equivalent slope.
    pub strain: ConverterChannel,
}

impl From<&BoardParameters> for Channels {
    fn from(board: &BoardParameters) -> Self {
        let rad_per_count = board.encoder_rad_per_count();
        let converter = |scale: ConverterScale| ConverterChannel {
            per_count: scale.per_count,
            zero_count: scale.zero_count,
            count_max: board.converter_count_max(),
        };
        Self {
            encoder: [0, 1].map(|i| EncoderChannel {
                rad_per_count: rad_per_count[i],
                home_rad: board.home_rad[i],
            }),
            force: converter(board.force_scale()),
            strain: converter(board.slope_scale()),
        }
    }
}

/// Errors of a gauge or a cell, in its own unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnalogErrors {
    /// Measured over true, less 1.
    pub gain: f64,
    /// Measured at zero.
    pub offset: f64,
    /// Growth of the offset, a second.
    pub drift_per_s: f64,
    /// Standard deviation of the noise, drawn each tick.
    pub noise: f64,
    /// Magnitude at which it saturates.
    pub saturation: f64,
    /// Whole ticks that it is late, up to [`DELAY_TICKS_MAX`].
    pub delay_ticks: usize,
}

impl Default for AnalogErrors {
    /// None.
    fn default() -> Self {
        Self {
            gain: 0.0,
            offset: 0.0,
            drift_per_s: 0.0,
            noise: 0.0,
            saturation: f64::INFINITY,
            delay_ticks: 0,
        }
    }
}

/// What a root gauge shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GaugeSignal {
    /// The bending moment, which is what a strain gauge measures.
    #[default]
    Moment,
    /// The slope of the root against the chord, which no gauge measures: what the paper's law
    /// asks for.
    Slope,
}

/// What the sensors are like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorParameters {
    /// The angles that homing took for the home pose, less the true one, rad.
    pub homing_rad: [f64; 2],
    /// Whole ticks that the encoders are late, up to [`DELAY_TICKS_MAX`].
    pub encoder_delay_ticks: usize,
    /// What the root gauge shows.
    pub gauge_signal: GaugeSignal,
    /// Slope that the gauge's moment stands for, `r2 / (3 EI)` of the planned link, rad/(N m): the
    /// board's scale, so that board and gauge agree in N m whatever the real link's stiffness.
    pub slope_per_moment: f64,
    /// Errors of the root gauge, rad.
    pub gauge: AnalogErrors,
    /// Direction along which the force cell measures: the planned normal.
    pub normal: [f64; 2],
    /// Errors of the force cell, N.
    pub cell: AnalogErrors,
    /// Probability that a tick's conversions drop out.
    pub dropout: f64,
}

impl SensorParameters {
    /// Perfect sensors of a link whose moment is worth `slope_per_moment` (rad/(N m)), the cell
    /// along `normal`; only counting is left.
    pub fn ideal(slope_per_moment: f64, normal: [f64; 2]) -> Self {
        Self {
            homing_rad: [0.0; 2],
            encoder_delay_ticks: 0,
            gauge_signal: GaugeSignal::Moment,
            slope_per_moment,
            gauge: AnalogErrors::default(),
            normal,
            cell: AnalogErrors::default(),
            dropout: 0.0,
        }
    }
}

/// What there is to be measured at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stimulus {
    /// Motor angles, rad.
    pub motor_angle: [f64; 2],
    /// Moment at link 2's root, N m.
    pub root_moment: f64,
    /// Slope of link 2 at its root against the chord, rad.
    pub root_slope: f64,
    /// Force of the tip on the surface in inertial axes, N.
    pub force: [f64; 2],
}

/// What the sensors say in their own units, before it is counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensed {
    /// Motor angles, rad, as homed.
    pub motor_angle: [f64; 2],
    /// Equivalent slope of the root gauge, rad.
    pub strain: f64,
    /// Force of the cell, N.
    pub force: f64,
}

impl Sensed {
    /// The counts of `channels`; `fresh` says whether the conversions are new.
    pub fn counted(&self, channels: &Channels, fresh: bool) -> RawSample {
        RawSample {
            encoder: [0, 1].map(|i| {
                let channel = &channels.encoder[i];
                let turned = self.motor_angle[i] - channel.home_rad;
                // Wraps, as a counter of 16 bits does.
                (turned / channel.rad_per_count).round() as i64 as u16
            }),
            force: channels.force.count(self.force),
            strain: channels.strain.count(self.strain),
            fresh,
        }
    }
}

/// The last ticks' values of a channel, the newest first.
type History<T> = [T; DELAY_TICKS_MAX + 1];

/// The sensors from tick to tick.
#[derive(Clone, Debug)]
pub struct Sensors {
    parameters: SensorParameters,
    period: f64,
    tick: u64,
    gauge_noise: RandomStream,
    cell_noise: RandomStream,
    dropouts: RandomStream,
    angles: History<[f64; 2]>,
    strain: History<f64>,
    force: History<f64>,
    /// The conversions that stand.
    held: [f64; 2],
}

impl Sensors {
    /// Sensors at ticks `period_s` (s) apart that have measured `first` for long. `seed` determines
    /// noise and dropouts. Delays beyond [`DELAY_TICKS_MAX`] are that.
    pub fn new(parameters: &SensorParameters, period_s: f64, first: &Stimulus, seed: u64) -> Self {
        let mut sensors = Self {
            parameters: *parameters,
            period: period_s,
            tick: 0,
            gauge_noise: RandomStream::new(seed, 11),
            cell_noise: RandomStream::new(seed, 12),
            dropouts: RandomStream::new(seed, 13),
            angles: [[0.0; 2]; DELAY_TICKS_MAX + 1],
            strain: [0.0; DELAY_TICKS_MAX + 1],
            force: [0.0; DELAY_TICKS_MAX + 1],
            held: [0.0; 2],
        };
        let angle = sensors.angle(first);
        let strain = parameters.gauge.measured(sensors.slope(first), 0.0, 0.0);
        let force = parameters.cell.measured(sensors.along(first), 0.0, 0.0);
        sensors.angles.fill(angle);
        sensors.strain.fill(strain);
        sensors.force.fill(force);
        sensors.held = [strain, force];
        sensors
    }

    /// Measures at the next tick. True where the conversions are new.
    pub fn sense(&mut self, now: &Stimulus) -> (Sensed, bool) {
        let p = self.parameters;
        let time = self.tick as f64 * self.period;
        self.tick += 1;
        let (gauge_noise, cell_noise) = (self.gauge_noise.bell(), self.cell_noise.bell());
        let fresh = self.dropouts.uniform() >= p.dropout;

        let angle = self.angle(now);
        push(&mut self.angles, angle);
        let strain = p.gauge.measured(self.slope(now), time, gauge_noise);
        push(&mut self.strain, strain);
        let force = p.cell.measured(self.along(now), time, cell_noise);
        push(&mut self.force, force);
        if fresh {
            self.held = [
                late(&self.strain, p.gauge.delay_ticks),
                late(&self.force, p.cell.delay_ticks),
            ];
        }
        let sensed = Sensed {
            motor_angle: late(&self.angles, p.encoder_delay_ticks),
            strain: self.held[0],
            force: self.held[1],
        };
        (sensed, fresh)
    }

    /// As [`sense`](Self::sense), in the counts of `channels`.
    pub fn sample(&mut self, now: &Stimulus, channels: &Channels) -> RawSample {
        let (sensed, fresh) = self.sense(now);
        sensed.counted(channels, fresh)
    }

    /// Motor angles as homed, rad.
    fn angle(&self, now: &Stimulus) -> [f64; 2] {
        [0, 1].map(|i| now.motor_angle[i] + self.parameters.homing_rad[i])
    }

    /// What the gauge shows, as a slope, rad.
    fn slope(&self, now: &Stimulus) -> f64 {
        match self.parameters.gauge_signal {
            GaugeSignal::Moment => now.root_moment * self.parameters.slope_per_moment,
            GaugeSignal::Slope => now.root_slope,
        }
    }

    /// The force along the cell, N.
    fn along(&self, now: &Stimulus) -> f64 {
        let n = self.parameters.normal;
        now.force[0] * n[0] + now.force[1] * n[1]
    }
}

impl AnalogErrors {
    /// What is measured of `value` at a time (s) with a noise of unit deviation.
    fn measured(&self, value: f64, time: f64, noise: f64) -> f64 {
        let drifted = self.offset + self.drift_per_s * time;
        (value * (1.0 + self.gain) + drifted + self.noise * noise)
            .clamp(-self.saturation, self.saturation)
    }
}

/// Puts `value` first.
fn push<T>(history: &mut History<T>, value: T) {
    history.rotate_right(1);
    history[0] = value;
}

/// The value of `delay` ticks ago.
fn late<T: Copy>(history: &History<T>, delay: usize) -> T {
    history[delay.min(DELAY_TICKS_MAX)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SLOPE: f64 = 0.55 / (3.0 * 0.48);
    const CHANNELS: Channels = Channels {
        encoder: [
            EncoderChannel {
                rad_per_count: core::f64::consts::TAU / 16_384.0,
                home_rad: 1.5,
            },
            EncoderChannel {
                rad_per_count: -core::f64::consts::TAU / 16_384.0,
                home_rad: 0.0,
            },
        ],
        force: ConverterChannel {
            per_count: 40.0 / 4096.0,
            zero_count: 2048.0,
            count_max: 4095,
        },
        strain: ConverterChannel {
            per_count: 1.0 / 4096.0,
            zero_count: 2048.0,
            count_max: 4095,
        },
    };

    fn stimulus(force: f64) -> Stimulus {
        Stimulus {
            motor_angle: [1.0, -1.5],
            root_moment: 0.3,
            root_slope: 0.2,
            force: [0.0, force],
        }
    }

    fn ideal() -> SensorParameters {
        SensorParameters::ideal(SLOPE, [0.0, 1.0])
    }

    #[test]
    fn converters_step_at_half_counts_and_stop_at_their_ends() {
        let c = CHANNELS.force;
        let step = c.per_count;
        assert_eq!(c.count(0.0), 2048);
        assert_eq!(c.count(0.499 * step), 2048);
        assert_eq!(c.count(0.501 * step), 2049);
        assert_eq!(c.count(-0.501 * step), 2047);
        assert_eq!(c.count(100.0), 4095);
        assert_eq!(c.count(-100.0), 0);
        // Everywhere within half a count: the error of a uniform quantiser is step/sqrt(12).
        let mut square = 0.0;
        for i in 0..10_000 {
            let value = -3.0 + 6.0 * f64::from(i) / 9_999.0;
            let back = (f64::from(c.count(value)) - c.zero_count) * step;
            assert!((back - value).abs() <= 0.5 * step * (1.0 + 1e-9));
            square += (back - value).powi(2) / 1e4;
        }
        assert!((square.sqrt() / step * 12.0_f64.sqrt() - 1.0).abs() < 0.01);
    }

    #[test]
    fn encoders_count_either_way_and_wrap() {
        let mut sensors = Sensors::new(&ideal(), 2e-4, &stimulus(2.0), 1);
        let raw = sensors.sample(&stimulus(2.0), &CHANNELS);
        let counts = |rad: f64| (rad * 16_384.0 / core::f64::consts::TAU).round();
        assert_eq!(raw.encoder[0].cast_signed(), counts(1.0 - 1.5) as i16);
        assert_eq!(raw.encoder[1].cast_signed(), counts(1.5) as i16);
        let turned = Stimulus {
            motor_angle: [1.5 + 5.0 * core::f64::consts::TAU, 0.0],
            ..stimulus(2.0)
        };
        let raw = sensors.sample(&turned, &CHANNELS);
        assert_eq!(raw.encoder[0], (5 * 16_384 % 65_536) as u16);
    }

    #[test]
    fn the_gauge_shows_the_slope_that_a_load_at_the_tip_would_give() {
        // A load F at the tip of a beam pinned at the root's chord: M = F r2, slope M r2 / (3 EI).
        let parameters = SensorParameters {
            gauge: AnalogErrors {
                gain: 0.03,
                offset: 2e-3,
                drift_per_s: 1e-3,
                ..AnalogErrors::default()
            },
            ..ideal()
        };
        let mut sensors = Sensors::new(&parameters, 0.5, &stimulus(2.0), 1);
        let exact = 0.3 * SLOPE * 1.03 + 2e-3;
        assert!((sensors.sense(&stimulus(2.0)).0.strain - exact).abs() < 1e-15);
        sensors.sense(&stimulus(2.0));
        // A second later.
        let drifted = sensors.sense(&stimulus(2.0)).0.strain;
        assert!((drifted - exact - 1e-3).abs() < 1e-15);
        // The gauge that the paper's law asks for.
        let mut wished = ideal();
        wished.gauge_signal = GaugeSignal::Slope;
        let mut sensors = Sensors::new(&wished, 0.5, &stimulus(2.0), 1);
        assert_eq!(sensors.sense(&stimulus(2.0)).0.strain, 0.2);
    }

    #[test]
    fn on_a_tilted_surface_the_cell_sees_friction() {
        let tilt = 0.02_f64;
        let (c, s) = (libm::cos(tilt), libm::sin(tilt));
        let (normal, friction) = (2.0, 0.6);
        // Into the surface (-s, c), along it (c, s).
        let force = [-s * normal + c * friction, c * normal + s * friction];
        let mut sensors = Sensors::new(&ideal(), 2e-4, &stimulus(2.0), 1);
        let seen = sensors
            .sense(&Stimulus {
                force,
                ..stimulus(0.0)
            })
            .0
            .force;
        assert!((seen - (normal * c + friction * s)).abs() < 1e-15);
    }

    #[test]
    fn delays_are_whole_ticks_and_each_sensors_own() {
        let mut parameters = ideal();
        parameters.cell.delay_ticks = 3;
        parameters.encoder_delay_ticks = 1;
        let mut sensors = Sensors::new(&parameters, 2e-4, &stimulus(0.0), 1);
        for tick in 0..8_i32 {
            let now = Stimulus {
                motor_angle: [f64::from(tick), 0.0],
                root_moment: f64::from(tick),
                root_slope: 0.0,
                force: [0.0, f64::from(tick)],
            };
            let (seen, fresh) = sensors.sense(&now);
            assert!(fresh);
            assert_eq!(seen.force, f64::from((tick - 3).max(0)));
            let before = if tick == 0 { 1.0 } else { f64::from(tick - 1) };
            assert_eq!(seen.motor_angle[0], before);
            assert!((seen.strain - SLOPE * f64::from(tick)).abs() < 1e-15);
        }
    }

    #[test]
    fn noise_saturates_and_dropouts_hold_the_last_conversion() {
        let mut parameters = ideal();
        parameters.cell.noise = 0.05;
        parameters.cell.saturation = 20.0;
        parameters.dropout = 0.2;
        let run = |parameters: &SensorParameters, force: f64| {
            let mut sensors = Sensors::new(parameters, 2e-4, &stimulus(force), 5);
            (0..20_000)
                .map(|_| sensors.sense(&stimulus(force)))
                .collect::<Vec<_>>()
        };
        let seen = run(&parameters, 2.0);
        let missing = seen.iter().filter(|(_, fresh)| !fresh).count() as f64 / 2e4;
        assert!((missing - 0.2).abs() < 0.015, "{missing}");
        for pair in seen.windows(2) {
            assert!(pair[1].1 || pair[1].0.force == pair[0].0.force);
        }
        let square: f64 = seen.iter().map(|(s, _)| (s.force - 2.0).powi(2)).sum();
        assert!(((square / 2e4).sqrt() / 0.05 - 1.0).abs() < 0.03);
        assert!(run(&parameters, 25.0).iter().all(|(s, _)| s.force == 20.0));
        // A cell that reads nothing.
        let mut dead = ideal();
        dead.cell.gain = -1.0;
        let mut sensors = Sensors::new(&dead, 2e-4, &stimulus(2.0), 5);
        assert_eq!(sensors.sense(&stimulus(2.0)).0.force, 0.0);
        // Another source switched off leaves this one's noise as it was.
        let mut other = parameters;
        other.gauge.noise = 0.0;
        assert!(run(&other, 2.0) == seen);
    }

    proptest! {
        #[test]
        fn whatever_is_measured_becomes_counts_in_range(
            a: f64, b: f64, moment: f64, force: f64,
        ) {
            let now = Stimulus { motor_angle: [a, b], root_moment: moment, root_slope: 0.0, force: [0.0, force] };
            let mut sensors = Sensors::new(&ideal(), 2e-4, &now, 1);
            let raw = sensors.sample(&now, &CHANNELS);
            prop_assert!(raw.force <= 4095 && raw.strain <= 4095);
        }
    }
}

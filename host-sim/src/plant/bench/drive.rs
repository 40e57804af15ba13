//! The drives: what becomes of a commanded torque.
//!
//! ```text
//! u_k  = gain limited(c_(k - delay)) + offset + noise       once a tick
//! tau' = 2 pi bandwidth (u_k - tau)                         between ticks
//! ```
//!
//! c_k is the command of tick k. With a delay of 0 it acts in the tick in which it is computed;
//! with 1, the usual one, from the next tick on. `u` is held for a tick, so the lag is solved
//! exactly, `tau = u + (tau_0 - u) exp(-2 pi bandwidth t)`, and no bandwidth is too high for the
//! plant's integration step.

use crate::plant::bench::lanes::Lanes;
use crate::plant::bench::noise::RandomStream;
use crate::plant::bench::runge_kutta::STAGE_TIME;
use flexor::signals::Saturation;

/// Longest delay of a drive or a sensor, ticks.
pub const DELAY_TICKS_MAX: usize = 15;

/// A drive's properties.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveParameters {
    /// Bandwidth of the torque loop, Hz, positive; `None` for one that follows at once.
    pub bandwidth_hz: Option<f64>,
    /// Whole ticks from command to torque, up to [`DELAY_TICKS_MAX`].
    pub delay_ticks: usize,
    /// Torque given over torque asked for.
    pub gain: f64,
    /// Torque given where none is asked for, N m.
    pub offset_nm: f64,
    /// Standard deviation of the torque's noise before the lag, drawn anew each tick, N m.
    pub noise_nm: f64,
    /// Largest magnitude that it can be asked for, N m.
    pub limit_nm: f64,
}

impl Default for DriveParameters {
    /// An ideal drive: it gives what it is asked for, at once.
    fn default() -> Self {
        Self {
            bandwidth_hz: None,
            delay_ticks: 0,
            gain: 1.0,
            offset_nm: 0.0,
            noise_nm: 0.0,
            limit_nm: f64::INFINITY,
        }
    }
}

/// A drive from tick to tick.
#[derive(Clone, Debug)]
pub struct Drive {
    parameters: DriveParameters,
    noise: RandomStream,
    /// The latest commands, the newest first.
    commands: [f64; DELAY_TICKS_MAX + 1],
}

impl Drive {
    /// A drive that has been commanded `torque` (N m) for long; `seed` and `stream` determine its
    /// noise. A delay beyond [`DELAY_TICKS_MAX`] is that.
    pub fn new(parameters: &DriveParameters, torque: f64, seed: u64, stream: u64) -> Self {
        Self {
            parameters: *parameters,
            noise: RandomStream::new(seed, stream),
            commands: [torque; DELAY_TICKS_MAX + 1],
        }
    }

    /// Takes the command of a tick, N m. Returns the torque that the drive tends to until the next
    /// one, N m, and which limit this command met: the drive says so at once, whatever its delay.
    pub fn command(&mut self, torque: f64) -> (f64, Saturation) {
        let p = &self.parameters;
        let saturation = if torque > p.limit_nm {
            Saturation::Upper
        } else if torque < -p.limit_nm {
            Saturation::Lower
        } else {
            Saturation::None
        };
        self.commands.rotate_right(1);
        self.commands[0] = torque.clamp(-p.limit_nm, p.limit_nm);
        let delayed = self.commands[p.delay_ticks.min(DELAY_TICKS_MAX)];
        let noise = p.noise_nm * self.noise.bell();
        (p.gain * delayed + p.offset_nm + noise, saturation)
    }
}

/// The drives' lag, in lanes: how much of a torque's distance from its target is left.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lag<T> {
    /// A joint, and in it each stage of an integration step and the step's end.
    left: [[T; 5]; 2],
}

impl<T: Lanes> Lag<T> {
    /// For integration steps of `h` seconds.
    pub(super) fn new<'a>(parameters: impl Fn(usize) -> &'a [DriveParameters; 2], h: f64) -> Self {
        let times: [f64; 5] = core::array::from_fn(|i| h * STAGE_TIME.get(i).unwrap_or(&1.0));
        let left = |drive: &DriveParameters, t: f64| {
            drive.bandwidth_hz.map_or(0.0, |bandwidth| {
                libm::exp(-core::f64::consts::TAU * bandwidth * t)
            })
        };
        Self {
            left: [0, 1].map(|joint| {
                times.map(|t| T::from_lanes(|lane| left(&parameters(lane)[joint], t)))
            }),
        }
    }

    /// Torques at a `stage` of a step, N m, that begins with `torque` and tends to `target`; 4 is
    /// the step's end.
    #[inline]
    pub(super) fn at(&self, stage: usize, torque: [T; 2], target: [T; 2]) -> [T; 2] {
        [0, 1].map(|i| target[i] + (torque[i] - target[i]) * self.left[i][stage])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_followed_after_the_delay_with_the_lag() {
        let parameters = DriveParameters {
            bandwidth_hz: Some(300.0),
            delay_ticks: 2,
            gain: 0.95,
            offset_nm: 0.01,
            ..DriveParameters::default()
        };
        let (period, substeps) = (2e-4, 4);
        let drives = [parameters; 2];
        let lag = Lag::<f64>::new(|_| &drives, period / f64::from(substeps));
        let mut drive = Drive::new(&parameters, 0.0, 1, 0);
        let mut torque = [0.01; 2];
        for tick in 0..50 {
            let (target, saturation) = drive.command(1.0);
            assert_eq!(saturation, Saturation::None);
            for _ in 0..substeps {
                torque = lag.at(4, torque, [target; 2]);
            }
            let t = (f64::from(tick + 1) - 2.0) * period;
            let rise = if t > 0.0 {
                1.0 - libm::exp(-core::f64::consts::TAU * 300.0 * t)
            } else {
                0.0
            };
            assert!((torque[0] - (0.01 + 0.95 * rise)).abs() < 1e-12, "{tick}");
        }
    }

    #[test]
    fn an_ideal_drive_follows_at_once() {
        let parameters = DriveParameters::default();
        let drives = [parameters; 2];
        let lag = Lag::<f64>::new(|_| &drives, 1e-4);
        for stage in 0..5 {
            assert_eq!(lag.at(stage, [5.0, 1.0], [0.3, -0.2]), [0.3, -0.2]);
        }
        assert_eq!(Drive::new(&parameters, 0.0, 1, 0).command(0.7).0, 0.7);
    }

    #[test]
    fn limits_are_kept_and_said() {
        let parameters = DriveParameters {
            limit_nm: 3.5,
            delay_ticks: 1,
            ..DriveParameters::default()
        };
        let mut drive = Drive::new(&parameters, 0.0, 1, 0);
        assert_eq!(drive.command(4.0), (0.0, Saturation::Upper));
        assert_eq!(drive.command(-9.0), (3.5, Saturation::Lower));
        assert_eq!(drive.command(1.0), (-3.5, Saturation::None));
        // What it is asked for is limited, not what a wrong gain makes of that.
        let strong = DriveParameters {
            gain: 2.0,
            delay_ticks: 0,
            ..parameters
        };
        let mut drive = Drive::new(&strong, 0.0, 1, 0);
        assert_eq!(drive.command(4.0), (7.0, Saturation::Upper));
    }

    #[test]
    fn noise_has_its_deviation_and_repeats() {
        let parameters = DriveParameters {
            noise_nm: 0.02,
            ..DriveParameters::default()
        };
        let draw = || {
            let mut drive = Drive::new(&parameters, 0.0, 3, 1);
            (0..10_000)
                .map(|_| drive.command(0.0).0)
                .collect::<Vec<_>>()
        };
        let noise = draw();
        assert_eq!(noise, draw());
        let square: f64 = noise.iter().map(|x| x * x).sum::<f64>() / 1e4;
        assert!((square.sqrt() / 0.02 - 1.0).abs() < 0.03);
    }
}

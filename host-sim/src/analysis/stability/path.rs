//! Stability along the whole path: poles, margins and the worst point, for the planned
//! arm and for a spread of plants.

use super::StabilityError;
use super::complex::{ln, norm};
use super::linear::{Linear, OperatingPoint};
use super::sampled::{LinearLaw, Sampled, with_gains_times};
use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::plant::spread::{PlantVariant, Spread};
use flexor::control::PaperParameters;
use nalgebra::Complex;
use rayon::prelude::*;

/// Points of the path at which the loop is frozen, when nothing else is asked for.
pub const DEFAULT_POINTS: usize = 50;

/// Largest gain margin that is looked for, dB: beyond, gains are as good as none.
pub const GAIN_MARGIN_MAX_DB: f64 = 40.0;

/// Largest delay margin that is looked for, ticks. The delayed torques are states of the
/// loop, and the effort grows with their number's cube.
pub const DELAY_MARGIN_MAX_TICKS: f64 = 10.0;

/// Steps in which gain margins are looked for, dB: at every point of the planned arm, and
/// for a spread's least margins. An unstable stretch that is shorter is passed over.
const GAIN_STEPS_DB: [f64; 2] = [2.5, 15.0];

/// Delays at which a loop is tried, ticks.
const DELAYS: [f64; 7] = [0.5, 1.0, 2.0, 3.0, 5.0, 7.0, DELAY_MARGIN_MAX_TICKS];

/// A plant at a point of the path: all that does not depend on the gains.
#[derive(Clone, Debug)]
pub struct FrozenPoint {
    /// Time from the path's start, s.
    pub t: f64,
    /// The sampled plant.
    pub sampled: Sampled,
    /// Poles without feedback, 1/s, slowest first: the tangential pair, the contact mode's
    /// pair, the link's further modes.
    pub open: Vec<Complex<f64>>,
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
}

/// What the loop does at a [`FrozenPoint`] with given gains.
#[derive(Clone, Debug, PartialEq)]
pub struct StabilityVerdict {
    /// Poles of the closed loop, 1/s (the logarithms of the sampled loop's eigenvalues
    /// over the period), but for the tangential pair and for those that decay within a
    /// tick; slowest first.
    pub poles: Vec<Complex<f64>>,
    /// The tangential pair, 1/s.
    pub tangential: [Complex<f64>; 2],
    /// Largest magnitude of the eigenvalues from tick to tick, without the tangential pair
    /// while that is as it is without feedback.
    pub radius: f64,
    /// The pole of that eigenvalue, 1/s.
    pub worst: Complex<f64>,
    /// Least damping ratio of the poles that oscillate at 1/3 to 3 times the contact
    /// mode's frequency; 1 where none does.
    pub contact_damping: f64,
}

impl StabilityVerdict {
    /// True if every mode but the tangential one is inside the unit circle.
    pub fn is_stable(&self) -> bool {
        self.radius < 1.0
    }
}

impl FrozenPoint {
    /// `variant` at time `t`, s, of `plan`.
    ///
    /// # Errors
    /// [`StabilityError`].
    pub fn new(
        plan: &Plan,
        sampler: &mut crate::planner::plan::Sampler<'_>,
        variant: &PlantVariant,
        t: f64,
    ) -> Result<Self, StabilityError> {
        let point = OperatingPoint::new(plan, sampler, variant, t)?;
        let linear = Linear::new(variant, &point)?;
        Ok(Self {
            t,
            sampled: Sampled::new(&linear, variant),
            open: linear.poles(),
            tick_rate_hz: variant.tick_rate_hz,
        })
    }

    /// Frequency of the contact mode without feedback, rad/s.
    pub fn contact_frequency(&self) -> f64 {
        self.open.get(2).map_or(0.0, |pole| norm(*pole))
    }

    /// The closed loop with the gains of `law`, its torques acting `delay_ticks` late.
    pub fn verdict(
        &self,
        plan: &Plan,
        law: &PaperParameters,
        delay_ticks: f64,
    ) -> StabilityVerdict {
        let linear = LinearLaw::new(law, plan, self.sampled.angle(), self.tick_rate_hz);
        let period = self.sampled.period;
        let matrix = self.sampled.closed_loop(&linear, delay_ticks);
        let mut poles: Vec<(Complex<f64>, f64)> = super::eigenvalues(matrix)
            .into_iter()
            // An eigenvalue of zero decays at once.
            .filter(|z| !(norm(*z) < 1e-9))
            .map(|z| (ln(z) / period, norm(z)))
            .collect();
        // The tangential mode is the pole nearest to that without feedback. Where others come
        // near, as an integrator of its frequency does, it is the least damped of them.
        let mut taken = |near: Complex<f64>| {
            let distance = |i: &usize| norm(poles[*i].0 - near);
            let close = (0..poles.len()).filter(|i| distance(i) < 0.5 * norm(near));
            let found = close
                .max_by(|i, j| poles[*i].0.re.total_cmp(&poles[*j].0.re))
                .or_else(|| (0..poles.len()).min_by(|i, j| distance(i).total_cmp(&distance(j))));
            found.map_or((near, f64::NAN), |i| poles.swap_remove(i))
        };
        let tangential = [0, 1].map(|i| taken(self.open[i]));
        let mut radius = 0.0;
        let mut worst = Complex::new(f64::NEG_INFINITY, 0.0);
        let mut consider = |pole: Complex<f64>, size: f64| {
            // Not max(), which passes NaN over.
            if !(size <= radius) {
                (radius, worst) = (size, pole);
            }
        };
        poles.iter().for_each(|(pole, size)| consider(*pole, *size));
        let freely = self.open[..2].iter().map(|p| p.re).fold(0.0, f64::max);
        for (pole, size) in tangential {
            if !(pole.re <= freely + tangential_allowance(plan)) {
                consider(pole, size);
            }
        }
        let contact = self.contact_frequency();
        let contact_damping = poles
            .iter()
            .filter(|(p, _)| p.im > 0.0 && norm(*p) > contact / 3.0 && norm(*p) < 3.0 * contact)
            .map(|(p, _)| -p.re / norm(*p))
            .fold(1.0, f64::min);
        let mut poles: Vec<Complex<f64>> = poles.into_iter().map(|(pole, _)| pole).collect();
        super::linear::sort(&mut poles);
        StabilityVerdict {
            poles,
            tangential: tangential.map(|(pole, _)| pole),
            radius,
            worst,
            contact_damping,
        }
    }

    fn is_stable(&self, plan: &Plan, law: &PaperParameters, factor: f64, delay_ticks: f64) -> bool {
        self.verdict(plan, &with_gains_times(law, factor), delay_ticks)
            .is_stable()
    }

    /// By how much all gains can be raised until the loop becomes unstable, dB; negative
    /// where they must be lowered to make it stable. Looked for in steps of `step` dB up
    /// to `most` dB.
    pub fn gain_margin_db(&self, plan: &Plan, law: &PaperParameters, step: f64, most: f64) -> f64 {
        let up = self.is_stable(plan, law, 1.0, 0.0);
        self.gain_margin_from(plan, law, up, step, most)
    }

    /// As [`gain_margin_db`](Self::gain_margin_db), for a loop that is known to be stable
    /// (`up`), or not.
    fn gain_margin_from(
        &self,
        plan: &Plan,
        law: &PaperParameters,
        up: bool,
        step: f64,
        most: f64,
    ) -> f64 {
        let stable = |db: f64| self.is_stable(plan, law, libm::pow(10.0, db / 20.0), 0.0);
        let (step, end) = if up {
            (step, most)
        } else {
            (-step, -GAIN_MARGIN_MAX_DB)
        };
        let mut edge = 0.0;
        while edge != end {
            let next: f64 = edge + step;
            let next = if (next - end) * step >= 0.0 {
                end
            } else {
                next
            };
            if stable(next) != up {
                return bisect(edge, next, 0.01, |db| stable(db) == up);
            }
            edge = next;
        }
        end
    }

    /// By how many ticks the torques may act later until the loop becomes unstable; 0
    /// where it is unstable as it is. Looked for up to `most`.
    pub fn delay_margin_ticks(&self, plan: &Plan, law: &PaperParameters, most: f64) -> f64 {
        let stable = |delay: f64| self.is_stable(plan, law, 1.0, delay);
        if !stable(0.0) {
            return 0.0;
        }
        let mut edge = 0.0;
        for next in DELAYS {
            let next = next.min(most);
            if !stable(next) {
                return bisect(edge, next, 0.01, stable);
            }
            if next >= most {
                break;
            }
            edge = next;
        }
        most
    }
}

/// How much faster than without feedback the tangential mode may grow, 1/s: e-fold within the
/// motion. It is not controlled by eq. 18-20 at all; frozen at a point of a motion that
/// brakes or speeds up it may grow or decay without being unstable.
pub fn tangential_allowance(plan: &Plan) -> f64 {
    1.0 / plan.task.path.duration
}

/// Where between `inside` and `outside` the condition ends, to `tolerance`.
fn bisect(mut inside: f64, mut outside: f64, tolerance: f64, holds: impl Fn(f64) -> bool) -> f64 {
    while (outside - inside).abs() > tolerance {
        let middle = 0.5 * (inside + outside);
        if holds(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    inside
}

/// Times at which a plan's loop is frozen: `points` (2 or more) evenly spaced ones, its
/// ends among them, s.
pub fn times(plan: &Plan, points: usize) -> Vec<f64> {
    let [start, end] = [plan.time(0), plan.time(plan.ticks)];
    let last = points.max(2) - 1;
    (0..=last)
        .map(|i| start + (end - start) * i as f64 / last as f64)
        .collect()
}

/// `variant` at `times`, s, of `plan`.
///
/// # Errors
/// [`StabilityError`].
pub fn frozen_points(
    plan: &Plan,
    variant: &PlantVariant,
    times: &[f64],
) -> Result<Vec<FrozenPoint>, StabilityError> {
    let mut sampler = plan.sampler();
    times
        .iter()
        .map(|t| FrozenPoint::new(plan, &mut sampler, variant, *t))
        .collect()
}

/// A plant's loop at one point of the path.
#[derive(Clone, Debug, PartialEq)]
pub struct PathPoint {
    /// Time from the path's start, s.
    pub t: f64,
    /// Poles and what follows from them.
    pub verdict: StabilityVerdict,
    /// Gain margin, dB; see [`FrozenPoint::gain_margin_db`].
    pub gain_margin_db: f64,
    /// Delay margin; see [`FrozenPoint::delay_margin_ticks`].
    pub delay_margin_ticks: f64,
}

/// A plant's loop over the path.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// What the plant is.
    pub name: String,
    /// Whether the loop is stable at every point.
    pub stable: bool,
    /// Largest [`StabilityVerdict::radius`].
    pub spectral_radius_max: f64,
    /// Where that is, s.
    pub worst_t_s: f64,
    /// The pole there, 1/s.
    pub worst_pole: Complex<f64>,
    /// What that pole is, in words.
    pub worst_mode: String,
    /// Least [`StabilityVerdict::contact_damping`].
    pub contact_damping_min: f64,
    /// Least gain margin, dB.
    pub gain_margin_db: f64,
    /// Where that is, s.
    pub gain_margin_t_s: f64,
    /// Least delay margin.
    pub delay_margin_ticks: f64,
    /// Fastest growth of the tangential pair, 1/s.
    pub tangential_growth_max_per_s: f64,
}

impl Summary {
    fn new(name: &str, frozen_points: &[FrozenPoint], points: &[PathPoint]) -> Option<Self> {
        let worst = (0..points.len()).max_by(|i, j| {
            points[*i]
                .verdict
                .radius
                .total_cmp(&points[*j].verdict.radius)
        })?;
        let least =
            |f: &dyn Fn(&PathPoint) -> f64| points.iter().map(f).fold(f64::INFINITY, f64::min);
        let verdict = &points[worst].verdict;
        let tightest = points
            .iter()
            .min_by(|a, b| a.gain_margin_db.total_cmp(&b.gain_margin_db))?;
        Some(Self {
            name: name.to_string(),
            stable: points.iter().all(|p| p.verdict.is_stable()),
            spectral_radius_max: verdict.radius,
            worst_t_s: points[worst].t,
            worst_pole: verdict.worst,
            worst_mode: describe(verdict.worst, &frozen_points[worst]),
            contact_damping_min: least(&|p| p.verdict.contact_damping),
            gain_margin_db: tightest.gain_margin_db,
            gain_margin_t_s: tightest.t,
            delay_margin_ticks: least(&|p| p.delay_margin_ticks),
            tangential_growth_max_per_s: -least(&|p| {
                -p.verdict.tangential[0].re.max(p.verdict.tangential[1].re)
            }),
        })
    }
}

/// What a pole, 1/s, of the closed loop at `frozen` is, in words.
pub fn describe(pole: Complex<f64>, frozen: &FrozenPoint) -> String {
    let hertz = pole.im.abs() / core::f64::consts::TAU;
    let nyquist = 0.5 / frozen.sampled.period;
    let contact = frozen.contact_frequency();
    let tangential = frozen.open[..2]
        .iter()
        .any(|p| norm(p - pole) < 0.1 * (1.0 + norm(*p)));
    let name = if tangential {
        "the tangential mode".to_string()
    } else if hertz > 0.9 * nyquist {
        "the link's root alternating from tick to tick".to_string()
    } else if pole.im == 0.0 && norm(pole) < 3.0 * contact {
        "the force integrator".to_string()
    } else if norm(pole) < 0.5 * contact {
        "the force integrator against the link".to_string()
    } else {
        let pairs = frozen.open.iter().enumerate().skip(2);
        let nearest = pairs.filter(|(_, p)| p.im >= 0.0).min_by(|(_, a), (_, b)| {
            let ratio = |p: &Complex<f64>| libm::log(norm(*p) / norm(pole)).abs();
            ratio(a).total_cmp(&ratio(b))
        });
        match nearest {
            Some((2 | 3, _)) | None => "the contact mode".to_string(),
            Some((i, _)) => format!("the link's mode {}", i / 2),
        }
    };
    if pole.im == 0.0 {
        format!("{name}, {:+.3} 1/s without oscillation", pole.re)
    } else {
        format!("{name}, {:+.3} 1/s at {hertz:.2} Hz", pole.re)
    }
}

/// Examines `variant` at `times` with the gains of `law`, with margins at every point;
/// `progress` is called after each.
///
/// # Errors
/// [`StabilityError`].
pub fn examine(
    plan: &Plan,
    name: &str,
    variant: &PlantVariant,
    law: &PaperParameters,
    times: &[f64],
    progress: &(dyn Fn() + Sync),
) -> Result<(Summary, Vec<PathPoint>), StabilityError> {
    let frozen_points = frozen_points(plan, variant, times)?;
    let points: Vec<PathPoint> = frozen_points
        .par_iter()
        .map(|frozen| {
            let step = GAIN_STEPS_DB[0];
            let point = PathPoint {
                t: frozen.t,
                verdict: frozen.verdict(plan, law, 0.0),
                gain_margin_db: frozen.gain_margin_db(plan, law, step, GAIN_MARGIN_MAX_DB),
                delay_margin_ticks: frozen.delay_margin_ticks(plan, law, DELAY_MARGIN_MAX_TICKS),
            };
            progress();
            point
        })
        .collect();
    let summary = Summary::new(name, &frozen_points, &points).ok_or(StabilityError::NoPoints)?;
    Ok((summary, points))
}

/// As [`examine`], but with the margins' least values only, which costs far less: at each
/// point the loop is tried with the least margins found before. Points after the first
/// have margins that are upper bounds of their own.
///
/// # Errors
/// [`StabilityError`].
pub fn examine_least(
    plan: &Plan,
    name: &str,
    variant: &PlantVariant,
    law: &PaperParameters,
    times: &[f64],
    progress: &(dyn Fn() + Sync),
) -> Result<Summary, StabilityError> {
    let frozen_points = frozen_points(plan, variant, times)?;
    let (mut gain, mut delay) = (GAIN_MARGIN_MAX_DB, DELAY_MARGIN_MAX_TICKS);
    let points: Vec<PathPoint> = frozen_points
        .iter()
        .map(|frozen| {
            let verdict = frozen.verdict(plan, law, 0.0);
            // Where the loop is unstable as it is, both are looked for downwards.
            let stable = verdict.is_stable();
            if !stable || gain > 0.0 {
                let step = GAIN_STEPS_DB[1];
                gain = gain.min(frozen.gain_margin_from(plan, law, stable, step, gain.max(0.0)));
            }
            let holds = delay > 0.0 && stable && frozen.is_stable(plan, law, 1.0, delay);
            if !holds {
                delay = frozen.delay_margin_ticks(plan, law, delay);
            }
            progress();
            PathPoint {
                t: frozen.t,
                verdict,
                gain_margin_db: gain,
                delay_margin_ticks: delay,
            }
        })
        .collect();
    Summary::new(name, &frozen_points, &points).ok_or(StabilityError::NoPoints)
}

/// As [`examine`], without margins: they come out infinite.
///
/// # Errors
/// [`StabilityError`].
pub fn quick_check(
    plan: &Plan,
    name: &str,
    variant: &PlantVariant,
    law: &PaperParameters,
    times: &[f64],
) -> Result<Summary, StabilityError> {
    let frozen_points = frozen_points(plan, variant, times)?;
    let points: Vec<PathPoint> = frozen_points
        .par_iter()
        .map(|frozen| PathPoint {
            t: frozen.t,
            verdict: frozen.verdict(plan, law, 0.0),
            gain_margin_db: f64::INFINITY,
            delay_margin_ticks: f64::INFINITY,
        })
        .collect();
    Summary::new(name, &frozen_points, &points).ok_or(StabilityError::NoPoints)
}

/// Stability over the path: the planned arm with everything, other plants in short.
#[derive(Clone, Debug)]
pub struct Report {
    /// The plant that was asked for; by default the planned arm.
    pub nominal: Summary,
    /// Its points.
    pub points: Vec<PathPoint>,
    /// The plants around it.
    pub spread: Vec<Summary>,
}

impl Report {
    /// Examines `plant` and the `spread` around it at `points` points of `plan`'s time.
    /// `progress` is called [`Report::effort`] times.
    ///
    /// # Errors
    /// [`StabilityError`].
    pub fn new(
        plan: &Plan,
        plant: &PlantParameters,
        spread: &Spread,
        law: &PaperParameters,
        points: usize,
        progress: &(dyn Fn() + Sync),
    ) -> Result<Self, StabilityError> {
        super::check(law)?;
        let times = times(plan, points);
        let variant = PlantVariant::new(&plan.model.arm, plan.tick_rate_hz, plant, 0.0)?;
        let (nominal, points) = examine(plan, "as planned", &variant, law, &times, progress)?;
        let spread = spread
            .variants(&plan.model.arm, plan.tick_rate_hz, plant)?
            .par_iter()
            .map(|(name, variant)| examine_least(plan, name, variant, law, &times, progress))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            nominal,
            points,
            spread,
        })
    }

    /// Points that [`Report::new`] examines, over all plants.
    pub fn effort(spread: &Spread, points: usize) -> u64 {
        (spread.plants() as u64 + 1) * points.max(2) as u64
    }

    /// The plant, of all examined, with the largest spectral radius.
    pub fn worst(&self) -> &Summary {
        self.spread.iter().fold(&self.nominal, |worst, other| {
            if other.spectral_radius_max > worst.spectral_radius_max {
                other
            } else {
                worst
            }
        })
    }
}

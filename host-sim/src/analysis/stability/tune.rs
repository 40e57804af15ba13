//! Finds gains: the least predicted force error over a spread of plants, with margins.
//!
//! **Cost.** For the plants at the spread's ends in stiffness, with all its masses, the force
//! error over the whole motion is predicted to first order: the linearised plants along the
//! path, closed with the law, are driven by what the plan's torques leave over on that
//! plant. It starts once from the plant's own equilibrium and once, at rest, from the
//! plan's first shape. The cost is the root mean square, over plants and starts, of the
//! error's rms divided by that without feedback, the second start counted threefold: 1 is as
//! good as none. From the own equilibrium, a
//! tip that gets farther off than [`TIP_LIMIT`] times without feedback adds to it.
//!
//! **Margins.** Every corner of the spread must be stable, also with all gains raised by
//! the gain margin and with torques that act later by the delay margin; a finer mesh of
//! the link (its root is lighter, which is what limits K_w) must be stable at
//! [`FINE_FACTOR`] times the gains.
//!
//! The search is a particle swarm over the logarithms of K_DF, K_PF, K_IF, K_w and the
//! corners of both filters; a gain near its lower bound is left out. The slope rate filter
//! belongs to the search because with a given one K_w is bound to what the root's inertia
//! allows. Gains are tried as rounded to two digits, and those found are examined at every
//! point for every plant before they are returned.

use super::StabilityError;
use super::linear::{self, FORCE, Linear, OUTPUTS, OperatingPoint, SLOPE_RATE};
use super::map::GainId;
use super::path::{self, FrozenPoint, Report};
use super::sampled::{LinearLaw, Sampled, with_gains_times};
use crate::model::arm_model::ELEMENTS_MAX;
use crate::model::dynamics;
use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::plant::spread::{PlantVariant, Spread};
use argmin::core::{CostFunction, Executor};
use argmin::solver::particleswarm::ParticleSwarm;
use core::f64::consts::LN_2;
use flexor::control::PaperParameters;
use nalgebra::DMatrix;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use rayon::prelude::*;

/// Farthest that the tip may get off its path, against the same plant without feedback.
pub const TIP_LIMIT: f64 = 1.5;

/// Weights of the two starts in the cost. The second one's errors are larger, and with
/// equal weights the search trades the contact mode's damping for a faster integral.
const START_WEIGHTS: [f64; 2] = [1.0, 3.0];

/// Factor on the gains with which a finer mesh must be stable.
pub const FINE_FACTOR: f64 = 1.5;

/// Part of a gain's logarithmic range, from its lower bound, that stands for a gain of 0.
const LEAST: f64 = 0.2;

/// Share of the cost that a gain must be worth, for noise and rounding it costs besides.
const WORTH: f64 = 1.01;

/// How to tune.
#[derive(Clone, Debug, PartialEq)]
pub struct TuneOptions {
    /// Options and filters that are not searched for, and no gains.
    pub law: PaperParameters,
    /// The plant in the middle of the spread.
    pub plant: PlantParameters,
    /// The plants.
    pub spread: Spread,
    /// Points of the path at which the result is examined.
    pub points: usize,
    /// Least gain margin, dB.
    pub gain_margin_db: f64,
    /// Least delay margin, ticks.
    pub delay_margin_ticks: f64,
    /// Seed of the search; the same seed finds the same gains.
    pub seed: u64,
    /// Particles of the swarm.
    pub particles: usize,
    /// Steps that each takes.
    pub iterations: u64,
}

/// Gains found.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// The law with them.
    pub law: PaperParameters,
    /// Its cost.
    pub cost: f64,
    /// Predicted errors of the plants that the cost counts.
    pub predictions: Vec<PlantPrediction>,
    /// Stability with them.
    pub report: Report,
    /// Laws that were tried.
    pub tried: u64,
}

/// What is predicted for a plant with the gains found, and without feedback.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantPrediction {
    /// What the plant is.
    pub name: String,
    /// With the gains.
    pub tuned: Predicted,
    /// Without feedback.
    pub open: Predicted,
}

/// Errors predicted for a plant: from its own equilibrium, and from the plan's first
/// shape at rest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Predicted {
    /// Root mean square of the force error, N.
    pub force_rms_n: [f64; 2],
    /// Root mean square of the tip's deviation along the surface, m.
    pub tip_rms_m: [f64; 2],
}

/// Part of the path on which the prediction keeps the linearised plant.
#[derive(Clone, Debug)]
struct Segment {
    plant: Sampled,
    angle: [f64; 2],
}

/// First-order prediction of a plant's errors along the path.
#[derive(Clone, Debug)]
pub struct Prediction {
    name: String,
    tick_rate_hz: u32,
    segments: Vec<Segment>,
    /// Ticks of a segment, a multiple of the stride.
    ticks: usize,
    /// Deviations of the state at the start.
    start: [Vec<f64>; 2],
    /// Without feedback.
    pub open: Predicted,
}

/// Segments of a path.
const SEGMENTS: usize = 50;
/// Ticks from one evaluated force error to the next, a power of two.
const STRIDE: usize = 8;

impl Prediction {
    /// Prepares the prediction for `variant`.
    ///
    /// # Errors
    /// [`StabilityError`].
    pub fn new(plan: &Plan, name: &str, variant: &PlantVariant) -> Result<Self, StabilityError> {
        let planned = PlantVariant::planned(&plan.model, plan.tick_rate_hz);
        let all = plan.ticks as usize;
        let ticks = (all.div_ceil(SEGMENTS)).next_multiple_of(STRIDE);
        let count = all.div_ceil(ticks).max(1);
        let time = |tick: usize| plan.time(tick.min(all) as u32);
        let mut sampler = plan.sampler();
        // What is left over at the segments' ends: rates of the state, measured outputs.
        let mut left_over = vec![];
        for i in 0..=count {
            left_over.push(mismatch(
                plan,
                &mut sampler,
                &planned,
                variant,
                time(i * ticks),
            )?);
        }
        let mut segments = vec![];
        for i in 0..count {
            let middle = 0.5 * (time(i * ticks) + time((i + 1) * ticks));
            let point = OperatingPoint::new(plan, &mut sampler, variant, middle)?;
            let linear = Linear::new(variant, &point)?;
            let sampled = Sampled::new(&linear, variant);
            let (now, next) = (&left_over[i], &left_over[i + 1]);
            let before = sampled.driven_by(&now.0);
            let change: Vec<f64> = next.0.iter().zip(&now.0).map(|(b, a)| b - a).collect();
            let change = sampled.driven_by(&change);
            let offset = [now.1, [next.1[0] - now.1[0], next.1[1] - now.1[1]]];
            segments.push(Segment {
                angle: sampled.angle(),
                plant: sampled.driven([&before, &change], offset, 1.0 / ticks as f64),
            });
        }
        let start = starts(plan, variant)?;
        let mut prediction = Self {
            name: name.to_string(),
            tick_rate_hz: variant.tick_rate_hz,
            segments,
            ticks,
            start,
            open: Predicted::default(),
        };
        prediction.open = prediction.errors(plan, &PaperParameters::FEEDFORWARD);
        Ok(prediction)
    }

    /// Errors with the gains of `law`.
    pub fn errors(&self, plan: &Plan, law: &PaperParameters) -> Predicted {
        let mut state: Option<DMatrix<f64>> = None;
        let (mut force, mut tip, mut count) = ([0.0; 2], [0.0; 2], 0.0);
        let mut unit = 1.0;
        for segment in &self.segments {
            let linear = LinearLaw::new(law, plan, segment.angle, self.tick_rate_hz);
            let plant = &segment.plant;
            let n = plant.states();
            let m = (n - 2) / 2;
            let tick = plant.closed_loop(&linear, 0.0);
            let row = plant.force_row();
            let mut z = match state.take() {
                None => {
                    let mut z = DMatrix::zeros(tick.nrows(), 2);
                    for (column, start) in self.start.iter().enumerate() {
                        for (i, x) in start.iter().enumerate() {
                            z[(i, column)] = if i < m { *x } else { x / plant.velocity_unit() };
                        }
                    }
                    z
                }
                Some(mut z) => {
                    // The velocities' unit differs a little from segment to segment.
                    z.rows_mut(m, m).scale_mut(unit / plant.velocity_unit());
                    z
                }
            };
            unit = plant.velocity_unit();
            z.row_mut(n - 2).fill(1.0);
            z.row_mut(n - 1).fill(0.0);
            let mut stride = tick;
            for _ in 0..STRIDE.trailing_zeros() {
                stride = &stride * &stride;
            }
            for _ in 0..self.ticks / STRIDE {
                for column in 0..2 {
                    let z = z.column(column);
                    let error: f64 = row.iter().zip(z.iter()).map(|(c, x)| c * x).sum();
                    force[column] += error * error;
                    tip[column] += z[0] * z[0];
                }
                count += 1.0;
                z = &stride * z;
            }
            state = Some(z);
        }
        let rms = |sums: [f64; 2]| sums.map(|sum: f64| (sum / count).sqrt());
        Predicted {
            force_rms_n: rms(force),
            tip_rms_m: rms(tip),
        }
    }
}

/// What the plan's motion and torques leave over on `variant` at time `t`: a rate of its
/// state, and deviations of force (N) and slope rate (rad/s).
fn mismatch(
    plan: &Plan,
    sampler: &mut crate::planner::plan::Sampler<'_>,
    planned: &PlantVariant,
    variant: &PlantVariant,
    t: f64,
) -> Result<(Vec<f64>, [f64; 2]), StabilityError> {
    let point = OperatingPoint::new(plan, sampler, planned, t)?;
    let evaluate = |variant: &PlantVariant, state: &[f64]| {
        let mut rate = vec![0.0; state.len()];
        let output: [f64; OUTPUTS] =
            linear::derivative(variant, &point, state, point.torque, &mut rate)
                .map_err(|source| StabilityError::Configuration { t_s: t, source })?;
        Ok::<_, StabilityError>((rate, output))
    };
    let (model, from) = (&variant.model, &planned.model);
    let project = |planned: &[f64]| {
        let m = planned.len() / 2;
        let mut projected = vec![planned[0]];
        projected.extend(model.project_shape_from(from, &planned[1..m]));
        projected.push(planned[m]);
        projected.extend(model.project_shape_from(from, &planned[m + 1..]));
        projected
    };
    let (rate, output) = evaluate(planned, &point.state)?;
    let (own_rate, own_output) = evaluate(variant, &project(&point.state))?;
    let left = own_rate
        .iter()
        .zip(project(&rate))
        .map(|(own, planned)| own - planned)
        .collect();
    let difference = [FORCE, SLOPE_RATE].map(|i| own_output[i] - output[i]);
    Ok((left, difference))
}

/// Deviations of the state from the planned motion at its start: at the plant's own
/// equilibrium, and with the plan's first shape at rest.
fn starts(plan: &Plan, variant: &PlantVariant) -> Result<[Vec<f64>; 2], StabilityError> {
    let mut sampler = plan.sampler();
    let t = plan.time(0);
    let point = sampler.at(t);
    let model = &variant.model;
    let geometric = variant.parameters.geometric_stiffness.is_any();
    let (rest, _) = dynamics::equilibrium(model, point.joint.angle, plan.force_at(t), geometric)
        .ok_or(StabilityError::Buckled { t_s: t })?;
    let q = model.project_shape_from(&plan.model, &sampler.q());
    let rate = model.project_shape_from(&plan.model, &sampler.q_rate());
    let (n, m) = (q.len(), 1 + q.len());
    let mut still = vec![0.0; 2 * m];
    for i in 0..n {
        still[m + 1 + i] = -rate[i];
    }
    let mut own = still.clone();
    for i in 0..n {
        own[1 + i] = rest[i] - q[i];
    }
    Ok([own, still])
}

/// Points of the path with the conditions that a loop must meet there.
struct Condition {
    frozen_points: Vec<FrozenPoint>,
    /// Factors on the gains and delays, ticks.
    at: Vec<(f64, f64)>,
}

/// The search's problem.
struct Search<'a> {
    plan: &'a Plan,
    options: &'a TuneOptions,
    bounds: Bounds,
    predictions: Vec<Prediction>,
    conditions: Vec<Condition>,
    progress: &'a (dyn Fn() + Sync),
    tried: std::sync::atomic::AtomicU64,
}

/// Lower and upper bounds of the logarithms of K_DF, K_PF, K_IF, K_w and the two corners.
struct Bounds {
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Bounds {
    /// Around what the arm's own scales suggest: the contact mode's frequency `contact`,
    /// rad/s, and the stiffness of its link.
    fn new(plan: &Plan, contact: f64) -> Self {
        let arm = &plan.model.arm;
        let rate = f64::from(plan.tick_rate_hz);
        // Braking torque per rate with which the contact mode's stiffness is matched.
        let slope_rate = arm.bending_stiffness_nm2 / arm.link2_length_m / contact;
        let corner = contact / core::f64::consts::TAU;
        let ranges = [
            (1e-4 / contact, 0.3 / contact),
            (1e-3, 3.0),
            (0.003 * contact, 3.0 * contact),
            (0.02 * slope_rate, 50.0 * slope_rate),
            (
                0.2 * corner,
                (50.0 * corner).min(0.25 * rate).max(0.4 * corner),
            ),
            (
                1.0 * corner,
                (50.0 * corner).min(0.25 * rate).max(2.0 * corner),
            ),
        ];
        Self {
            low: ranges.iter().map(|(low, _)| libm::log(*low)).collect(),
            high: ranges.iter().map(|(_, high)| libm::log(*high)).collect(),
        }
    }

    /// The law at a place of the search; gains near their lower bound are left out.
    fn law(&self, base: &PaperParameters, place: &[f64]) -> PaperParameters {
        let value = |i: usize| {
            let share = (place[i] - self.low[i]) / (self.high[i] - self.low[i]);
            if i < 4 && share < LEAST {
                0.0
            } else {
                two_digits(libm::exp(place[i]))
            }
        };
        PaperParameters {
            force_derivative_s: value(0),
            force_proportional: value(1),
            force_integral_per_s: value(2),
            slope_rate_nms_rad: value(3),
            force_filter_hz: Some(value(4)),
            slope_rate_filter_hz: Some(value(5)),
            ..*base
        }
    }
}

/// The nearest number with two significant digits.
fn two_digits(value: f64) -> f64 {
    // By way of text, so that the number is the one that a file says.
    format!("{value:.1e}").parse().unwrap_or(value)
}

impl Search<'_> {
    /// How fast the loop grows, 1/s, under the first plant whose conditions are not met;
    /// `None` when all are.
    fn violation(&self, law: &PaperParameters) -> Option<f64> {
        for condition in &self.conditions {
            let mut worst: Option<f64> = None;
            for frozen in &condition.frozen_points {
                for (factor, delay) in &condition.at {
                    let verdict =
                        frozen.verdict(self.plan, &with_gains_times(law, *factor), *delay);
                    if !verdict.is_stable() {
                        let growth = libm::log(verdict.radius) / frozen.sampled.period;
                        let growth = if growth.is_finite() { growth } else { 1e6 };
                        worst = Some(worst.map_or(growth, |w: f64| w.max(growth)));
                    }
                }
            }
            if worst.is_some() {
                return worst;
            }
        }
        None
    }

    /// `law` without the gains that are not worth having: those without which the cost is
    /// at most [`WORTH`] larger. Without K_DF and K_PF there is nothing to filter.
    fn simplified(&self, mut law: PaperParameters) -> PaperParameters {
        let most = WORTH * self.cost(&law);
        for gain in [GainId::ForceDerivative, GainId::ForceProportional] {
            let without = gain.set(&law, 0.0);
            if self.cost(&without) <= most {
                law = without;
            }
        }
        if law.force_derivative_s == 0.0 && law.force_proportional == 0.0 {
            law.force_filter_hz = None;
        }
        law
    }

    fn cost(&self, law: &PaperParameters) -> f64 {
        if let Some(growth) = self.violation(law) {
            return 1e3 + growth.min(1e6);
        }
        let mut sum = 0.0;
        let mut terms = 0.0;
        // Below this part of the reference an error is as good as none.
        let least = 1e-4 * self.plan.task.normal_force.largest().max(1e-3);
        for prediction in &self.predictions {
            let errors = prediction.errors(self.plan, law);
            for start in 0..2 {
                let ratio =
                    errors.force_rms_n[start] / (prediction.open.force_rms_n[start] + least);
                sum += START_WEIGHTS[start] * ratio * ratio;
                terms += START_WEIGHTS[start];
            }
            let tip = errors.tip_rms_m[0] / (prediction.open.tip_rms_m[0] + 1e-6);
            let off = (tip / TIP_LIMIT - 1.0).max(0.0);
            sum += 10.0 * (off * off);
        }
        let cost = (sum / terms).sqrt();
        if cost.is_finite() { cost } else { 1e9 }
    }
}

impl CostFunction for Search<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, place: &Self::Param) -> Result<f64, argmin::core::Error> {
        let law = self.bounds.law(&self.options.law, place);
        let cost = Search::cost(self, &law);
        self.tried
            .fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        (self.progress)();
        Ok(cost)
    }
}

/// First and last of `values`, one if they are the same.
fn ends<T: Copy + PartialEq>(values: &[T]) -> Vec<T> {
    match values {
        [] => vec![],
        [one] => vec![*one],
        [first, .., last] if first == last => vec![*first],
        [first, .., last] => vec![*first, *last],
    }
}

/// Laws that [`tune`] tries, and points that it examines the best with.
pub fn effort(options: &TuneOptions) -> u64 {
    options.particles as u64 * (options.iterations + 1)
        + Report::effort(&options.spread, options.points)
}

/// The plants that a search looks at.
struct Plants {
    /// The plant in the middle and the spread's corners.
    corners: Vec<(String, PlantVariant)>,
    /// Those with a finer mesh.
    fine: Vec<(String, PlantVariant)>,
    /// Those whose force error is predicted.
    predicted: Vec<(String, PlantVariant)>,
}

impl Plants {
    fn new(plan: &Plan, options: &TuneOptions) -> Result<Self, StabilityError> {
        let spread = &options.spread;
        let corners = Spread {
            bending_stiffness_scale: ends(&spread.bending_stiffness_scale),
            link2_mass_scale: ends(&spread.link2_mass_scale),
            added_root_inertia_kgm2: ends(&spread.added_root_inertia_kgm2),
            contact_angle_rad: ends(&spread.contact_angle_rad),
            tick_rate_hz: ends(&spread.tick_rate_hz),
            elements: spread.elements.clone(),
        };
        let predicted = Spread {
            link2_mass_scale: spread.link2_mass_scale.clone(),
            added_root_inertia_kgm2: corners.added_root_inertia_kgm2[..1].to_vec(),
            contact_angle_rad: vec![0.0],
            tick_rate_hz: vec![],
            elements: vec![],
            ..corners.clone()
        };
        let fine = Spread {
            link2_mass_scale: vec![1.0],
            elements: vec![(2 * options.plant.elements + 2).min(ELEMENTS_MAX)],
            ..corners.clone()
        };
        let variants =
            |spread: &Spread| spread.variants(&plan.model.arm, plan.tick_rate_hz, &options.plant);
        Ok(Self {
            corners: [variants(&Spread::none())?, variants(&corners)?].concat(),
            fine: variants(&fine)?,
            predicted: variants(&predicted)?,
        })
    }
}

impl<'a> Search<'a> {
    fn new(
        plan: &'a Plan,
        options: &'a TuneOptions,
        progress: &'a (dyn Fn() + Sync),
    ) -> Result<Self, StabilityError> {
        // A hair more than asked for, as the conditions are tried at fewer points.
        let gain = libm::pow(10.0, (options.gain_margin_db + 0.1) / 20.0);
        let delay = options.delay_margin_ticks + 0.02;
        let plants = Plants::new(plan, options)?;
        let condition = |(_, variant): &(String, PlantVariant), points, at: &[(f64, f64)]| {
            Ok::<_, StabilityError>(Condition {
                frozen_points: path::frozen_points(plan, variant, &path::times(plan, points))?,
                at: at.to_vec(),
            })
        };
        let mut conditions = vec![];
        for variant in &plants.corners {
            let at = [(1.0, 0.0), (gain, 0.0), (1.0, delay)];
            conditions.push(condition(variant, 9, &at)?);
        }
        for variant in &plants.fine {
            conditions.push(condition(variant, 3, &[(FINE_FACTOR, 0.0)])?);
        }
        let predictions = plants
            .predicted
            .par_iter()
            .map(|(name, variant)| Prediction::new(plan, name, variant))
            .collect::<Result<Vec<_>, _>>()?;
        let contact = conditions
            .first()
            .and_then(|c| c.frozen_points.first())
            .map_or(1.0, FrozenPoint::contact_frequency);
        Ok(Self {
            plan,
            options,
            bounds: Bounds::new(plan, contact),
            predictions,
            conditions,
            progress,
            tried: 0.into(),
        })
    }

    /// Lets the swarm fly; the search itself and the best law found.
    fn fly(self) -> Result<(Self, PaperParameters), StabilityError> {
        let options = self.options;
        let failed = |error: argmin::core::Error| StabilityError::Optimiser(error.to_string());
        let bounds = (self.bounds.low.clone(), self.bounds.high.clone());
        // The usual factors, which the library derives from the platform's logarithm.
        let swarm = ParticleSwarm::new(bounds, options.particles)
            .with_inertia_factor(1.0 / (2.0 * LN_2))
            .and_then(|swarm| swarm.with_cognitive_factor(0.5 + LN_2))
            .and_then(|swarm| swarm.with_social_factor(0.5 + LN_2))
            .map_err(failed)?
            .with_rng_generator(Xoshiro256PlusPlus::seed_from_u64(options.seed));
        let result = Executor::new(self, swarm)
            .configure(|state| state.max_iters(options.iterations))
            .ctrlc(false)
            .run()
            .map_err(failed)?;
        let argmin::core::OptimizationResult {
            problem, mut state, ..
        } = result;
        let search = problem
            .problem
            .ok_or_else(|| StabilityError::Optimiser("lost its problem".into()))?;
        let best = state
            .take_best_individual()
            .ok_or_else(|| StabilityError::Optimiser("has no result".into()))?;
        let law = search.simplified(search.bounds.law(&options.law, &best.position));
        Ok((search, law))
    }
}

/// Refuses a law whose `report` does not keep the margins asked for.
fn check_margins(report: &Report, options: &TuneOptions) -> Result<(), StabilityError> {
    let everything = || std::iter::once(&report.nominal).chain(&report.spread);
    let short = everything().find(|s| {
        !(s.stable
            && s.gain_margin_db >= options.gain_margin_db
            && s.delay_margin_ticks >= options.delay_margin_ticks)
    });
    if let Some(short) = short {
        return Err(StabilityError::NotTuned {
            gain_margin_db: options.gain_margin_db,
            delay_margin_ticks: options.delay_margin_ticks,
            worst: format!(
                "{} with {:.2} dB and {:.2} ticks ({})",
                short.name, short.gain_margin_db, short.delay_margin_ticks, short.worst_mode
            ),
        });
    }
    Ok(())
}

/// Finds gains for `plan`; `progress` is called [`effort`] times.
///
/// # Errors
/// [`StabilityError::NotTuned`] if none were found, and what examining plants gives.
pub fn tune(
    plan: &Plan,
    options: &TuneOptions,
    progress: &(dyn Fn() + Sync),
) -> Result<Tuned, StabilityError> {
    let (search, law) = Search::new(plan, options, progress)?.fly()?;
    let report = Report::new(
        plan,
        &options.plant,
        &options.spread,
        &law,
        options.points,
        search.progress,
    )?;
    check_margins(&report, options)?;
    Ok(Tuned {
        cost: search.cost(&law),
        predictions: search
            .predictions
            .iter()
            .map(|p| PlantPrediction {
                name: p.name.clone(),
                tuned: p.errors(plan, &law),
                open: p.open,
            })
            .collect(),
        law,
        report,
        tried: search.tried.into_inner(),
    })
}

//! The search for joint 2's gains: what a set costs, and simplexes that go down.

use super::closed::{ClosedLoop, LinearHybrid, Stress};
use super::plant::{LoopPose, SampledPlant};
use super::problem::{Problem, Scales};
use super::sets::{Numbers, air_of, contact_of, numbers_of};
use super::spread::NamedPlant;
use super::{FRICTION_LEVERAGE_MAX, HybridError, friction_leverage};
use argmin::core::{CostFunction, Executor, State};
use argmin::solver::neldermead::NelderMead;
use flexor::control::HybridParameters;
use rayon::prelude::*;

/// Factor on joint 2's torque with which every arm must be stable, a tick later.
pub(super) const STRESS_GAIN: f64 = 1.3;

/// Least stiffness in the air about the planned angle, as a share of `3 EI / r2`: what gains for any
/// hub of the paper's arm have.
const AIR_STIFFNESS: f64 = 0.75;

/// How much is tried.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    /// Simplexes, and steps of each.
    rounds: usize,
    steps: u64,
    /// Whether the starts lie far apart.
    pub(super) wide: bool,
}

impl Extent {
    pub(super) const SHORT: Self = Self {
        rounds: 2,
        steps: 40,
        wide: false,
    };
    pub(super) const WIDE: Self = Self {
        rounds: 6,
        steps: 120,
        wide: true,
    };
    pub(super) const LONG: Self = Self {
        rounds: 6,
        steps: 300,
        wide: false,
    };
}

/// Sign of the friction whose moment about joint 2 is against that of the normal force: it makes
/// the force loop's gain larger.
fn against_the_force(pose: &LoopPose) -> f64 {
    // The tangent is the normal turned back by a right angle: moments go with sine and -cosine.
    let (sine, cosine) = libm::sincos(pose.normal_angle - pose.angle[1]);
    (sine * cosine).signum()
}

/// A plant that a search tries laws on, and what is asked of it.
#[derive(Clone)]
struct Trial {
    plant: SampledPlant,
    pose: LoopPose,
    stress: Stress,
    in_the_air: bool,
    /// Whether the tip is on the surface.
    touches: bool,
    /// Whether its force counts.
    counts: bool,
}

/// Joint 2's loop of an arm and its spread.
#[derive(Clone)]
pub(super) struct Search<'a> {
    problem: &'a Problem<'a>,
    scales: Scales,
    trials: Vec<Trial>,
    /// The set in contact, while one for the air is looked for.
    contact: Option<HybridParameters>,
    /// The filter's number, where it is not looked for.
    filter: Option<f64>,
}

/// Place of the rate's filter among the numbers.
const FILTER: usize = 2;

/// Of the contact mode's frequency: decay that stable means, so that rounding and what is between
/// the arms does not matter.
const DECAY: f64 = 0.5 / 34.5;
/// Damping ratio that every mode must keep, also under stress: a third of what the weakest damped
/// arms of the bench have without feedback. Without it a bare root's fast modes come out just
/// stable, and encoder counts make them sing.
const DAMPING: f64 = 0.005;
/// What an unstable arm adds to the cost, and the most that its growth adds.
pub(super) const UNSTABLE: f64 = 5.0;
const GROWTH_MAX: f64 = 50.0;

impl<'a> Search<'a> {
    pub(super) fn new(
        problem: &'a Problem<'a>,
        contact: Option<HybridParameters>,
    ) -> Result<Self, HybridError> {
        let scales = Scales::new(problem)?;
        let mut search = Self {
            problem,
            scales,
            trials: vec![],
            contact,
            filter: None,
        };
        let spread = &problem.spread;
        let ends = |named: &NamedPlant| {
            let root = named.plant.root_inertia_kgm2;
            spread.root_inertia_kgm2.contains(&root)
        };
        if search.contact.is_none() {
            // Friction the other way helps: the proof looks at it.
            let against = against_the_force(&search.steepest());
            let dragged = |n: &&NamedPlant| ends(n) && n.plant.friction * against >= 0.0;
            for named in spread.in_contact(problem.arm).iter().filter(dragged) {
                search.add(named, false)?;
            }
        } else {
            for named in spread.in_the_air(problem.arm).iter().filter(|n| ends(n)) {
                search.add(named, true)?;
            }
            let touching = spread.in_contact(problem.arm);
            let smooth = |n: &&NamedPlant| ends(n) && n.plant.friction == 0.0;
            for named in touching.iter().filter(smooth) {
                search.add(named, true)?;
            }
        }
        Ok(search)
    }

    /// The same search with the rate's filter at that of `set`, if one is given.
    pub(super) fn with_filter_of(&self, set: Option<&HybridParameters>) -> Self {
        Self {
            filter: set.map(|set| numbers_of(set)[FILTER]),
            ..self.clone()
        }
    }

    /// The pose with the largest leverage of friction.
    fn steepest(&self) -> LoopPose {
        let poses = self.problem.poses;
        let leverage = |pose: &LoopPose| friction_leverage(std::slice::from_ref(pose));
        let mut best = poses[0];
        for pose in poses {
            if leverage(pose) > leverage(&best) {
                best = *pose;
            }
        }
        best
    }

    fn add(&mut self, named: &NamedPlant, in_the_air: bool) -> Result<(), HybridError> {
        let problem = self.problem;
        let (spread, root) = (&problem.spread, named.plant.root_inertia_kgm2);
        let sliding = named.plant.friction != 0.0;
        let poses: &[LoopPose] = if sliding {
            &[self.steepest()]
        } else {
            &[problem.poses[0], self.steepest()]
        };
        for (i, pose) in poses.iter().enumerate() {
            let mut plant = named.plant;
            if sliding {
                // A fifth more friction, as far as any is accepted.
                let most = FRICTION_LEVERAGE_MAX / friction_leverage(&[*pose]);
                let friction = (1.2 * plant.friction.abs()).min(most);
                plant.friction = friction.max(plant.friction.abs()).copysign(plant.friction);
            }
            let gain = if sliding { 1.0 } else { STRESS_GAIN };
            self.trials.push(Trial {
                plant: SampledPlant::new(problem.arm, &plant, pose, problem.tick_rate_hz, false)?,
                pose: *pose,
                stress: Stress {
                    gain: [1.0, gain],
                    ticks: 1,
                },
                in_the_air,
                touches: named.plant.contact_stiffness_n_m.is_some(),
                counts: !in_the_air && i == 0 && (sliding || root == spread.root_inertia_kgm2[0]),
            });
        }
        Ok(())
    }

    fn linear(&self, law: &HybridParameters, trial: &Trial) -> LinearHybrid {
        let rate = self.problem.tick_rate_hz;
        LinearHybrid::new(
            law,
            self.problem.arm,
            &trial.pose,
            rate,
            (trial.in_the_air, false),
        )
    }

    /// The least decay under `stress`, over the contact mode's frequency.
    fn decay(&self, trial: &Trial, linear: &LinearHybrid, stress: &Stress) -> f64 {
        let closed = ClosedLoop::new(&trial.plant, linear, stress);
        closed.least_decay(DAMPING) / self.scales.frequency
    }

    /// What `law` costs on a trial in contact.
    fn cost_of(&self, law: &HybridParameters, trial: &Trial) -> f64 {
        let linear = self.linear(law, trial);
        let mut cost = penalty(self.decay(trial, &linear, &trial.stress));
        if trial.counts {
            let closed = ClosedLoop::new(&trial.plant, &linear, &Stress::NONE);
            let force = closed.force_rms(&trial.plant, &linear, &self.problem.noise);
            cost += match force {
                Some(force) => libm::log(force / self.problem.poses[0].force_n).clamp(-20.0, 20.0),
                None => 2.0 * UNSTABLE,
            };
        }
        cost
    }

    /// What a law of the air costs on a trial, and its slowest decay there. With the tip in the air
    /// also with more and with less torque; with the tip on the surface it need only be stable.
    fn of_the_air(&self, law: &HybridParameters, trial: &Trial) -> (f64, f64) {
        let linear = self.linear(law, trial);
        let decay = self.decay(trial, &linear, &Stress::NONE);
        if trial.touches {
            return (penalty(decay - DECAY), decay);
        }
        let less = Stress {
            gain: [1.0, 1.0 / STRESS_GAIN],
            ticks: 0,
        };
        let more = self.decay(trial, &linear, &trial.stress);
        let stressed = more.max(self.decay(trial, &linear, &less));
        (penalty(decay) + penalty(stressed - DECAY), decay)
    }

    /// The law of `numbers`.
    pub(super) fn law(&self, numbers: &[f64]) -> HybridParameters {
        match &self.contact {
            None => {
                let mut numbers = numbers.to_vec();
                numbers[FILTER] = self.filter.unwrap_or(numbers[FILTER]);
                contact_of(&numbers, &self.scales)
            }
            Some(contact) => HybridParameters {
                free: air_of(numbers, &self.scales),
                ..*contact
            },
        }
    }

    /// What the gains of `numbers` cost.
    fn cost_at(&self, numbers: &[f64]) -> f64 {
        let law = self.law(numbers);
        let cost = if self.contact.is_none() {
            let costs = self
                .trials
                .par_iter()
                .map(|trial| self.cost_of(&law, trial));
            let counted = self.trials.iter().filter(|t| t.counts).count();
            costs.collect::<Vec<f64>>().iter().sum::<f64>() / counted.max(1) as f64
        } else {
            self.cost_in_the_air(&law)
        };
        // Far from the start only where it pays.
        let far: f64 = numbers.iter().map(|x| x * x).sum();
        if cost.is_finite() {
            cost + 1e-4 * far
        } else {
            1e6
        }
    }

    /// The slowest decay in the air; unstable ones, also on the surface, and too little stiffness
    /// add to it.
    fn cost_in_the_air(&self, law: &HybridParameters) -> f64 {
        let trials = self.trials.par_iter();
        let each: Vec<(f64, f64)> = trials.map(|t| self.of_the_air(law, t)).collect();
        let in_the_air = each.iter().zip(&self.trials).filter(|(_, t)| !t.touches);
        let slowest = in_the_air.fold(f64::NEG_INFINITY, |most, ((_, decay), _)| most.max(*decay));
        let cost: f64 = each.iter().map(|(cost, _)| cost).sum();
        let p = &law.free;
        let square = 1.0 - p.section_damping * p.section_damping;
        let [g1, g2] = p.section_angle_nm_rad;
        let rest = p.section_damping * g1 + square.max(0.0).sqrt() * g2;
        let short = AIR_STIFFNESS - (p.stiffness_nm_rad - rest) / self.scales.stiffness;
        cost + 10.0 * slowest.max(-0.5) + 10.0 * short.max(0.0)
    }
}

/// What a trial costs whose slowest pole, over the contact mode's frequency, is `decay`.
fn penalty(decay: f64) -> f64 {
    match decay < -DECAY {
        true => 0.0,
        false => UNSTABLE + (20.0 * (decay + DECAY)).min(GROWTH_MAX),
    }
}

impl CostFunction for &Search<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, place: &Self::Param) -> Result<f64, argmin::core::Error> {
        Ok(self.cost_at(place))
    }
}

/// The best of `starts`, then better ones by so many simplexes of so many steps.
pub(super) fn descend(
    search: &Search<'_>,
    starts: &[Numbers],
    extent: &Extent,
) -> (Numbers, f64, u64) {
    let (rounds, steps) = (extent.rounds, extent.steps);
    let mut order: Vec<(f64, &Numbers)> = starts.iter().map(|s| (search.cost_at(s), s)).collect();
    order.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let mut tried = starts.len() as u64;
    let mut best: Option<(f64, Numbers)> = None;
    // Several starts where there is time for several simplexes of each.
    let from = (rounds / ROUNDS_A_START).max(1);
    for (start_cost, start) in order.into_iter().take(from) {
        let (mut cost, mut numbers) = (start_cost, start.clone());
        for round in 0..rounds.min(ROUNDS_A_START) {
            let Some((found, value, count)) = simplex(search, &numbers, round, steps) else {
                continue;
            };
            tried += count;
            if value < cost {
                (cost, numbers) = (value, found);
            }
        }
        if best.as_ref().is_none_or(|(other, _)| cost < *other) {
            best = Some((cost, numbers));
        }
    }
    let (cost, numbers) = best.unwrap_or((f64::INFINITY, starts[0].clone()));
    (numbers, cost, tried)
}

/// Simplexes from one start, each smaller than the one before.
const ROUNDS_A_START: usize = 3;

/// Where a simplex about `numbers` gets in so many steps: numbers, cost, laws tried.
fn simplex(
    search: &Search<'_>,
    numbers: &Numbers,
    round: usize,
    steps: u64,
) -> Option<(Numbers, f64, u64)> {
    let size = [0.5, 0.25, 0.12][round % ROUNDS_A_START];
    let mut corners = vec![numbers.clone()];
    corners.extend((0..numbers.len()).map(|i| {
        let mut corner = numbers.clone();
        let back = (i + round).is_multiple_of(3);
        corner[i] += if back { -size } else { size };
        corner
    }));
    let solver = NelderMead::new(corners).with_sd_tolerance(1e-5).ok()?;
    let executor = Executor::new(search, solver).configure(|state| state.max_iters(steps));
    let result = executor.run().ok()?;
    let state = result.state();
    let found = state.get_best_param()?.clone();
    Some((found, state.get_best_cost(), state.get_iter()))
}

/// Root mean square over the arms whose force counts, N.
pub(super) fn force_rms(search: &Search<'_>, law: &HybridParameters) -> f64 {
    let squares: Vec<f64> = search
        .trials
        .iter()
        .filter(|trial| trial.counts)
        .map(|trial| {
            let linear = search.linear(law, trial);
            let closed = ClosedLoop::new(&trial.plant, &linear, &Stress::NONE);
            let force = closed.force_rms(&trial.plant, &linear, &search.problem.noise);
            force.map_or(f64::INFINITY, |force| force * force)
        })
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

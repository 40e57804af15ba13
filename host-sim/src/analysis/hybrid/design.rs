//! Gains for the arm at hand.
//!
//! **Cost.** Joint 2's loop with link 1 locked does not depend on the path but through the moment arm
//! of the force, so one set of gains does. For the arms at the spread's ends the root mean square of
//! the force is predicted under the bench's noises, from the discrete Lyapunov equation; the cost is
//! the mean of its logarithm. Every arm of the spread must be stable, also with joint 2's torque
//! raised by [`STRESS_GAIN`] and a tick later; what is not adds to the cost by how fast it grows.
//! What is not in the spread is not held.
//!
//! **Start.** The gains that were found for the paper's arm, brought to the arm at hand by the
//! frequency of its contact mode and the stiffness of its link against the root's turning,
//! `3 EI / r2`: that alone is right for an arm of the same proportions. From there a simplex
//! (Nelder and Mead) goes on; [`Effort::Tune`] takes more starts and steps.
//!
//! **In the air** joint 2 is to come to rest fast, no softer than [`AIR_STIFFNESS`] of the link, and
//! also with the tip on the surface, where it is for some ticks at every touch.
//!
//! **Joint 1** is placed: stiffness and damping by the inertia that it turns, its bandwidth lowered
//! where both joints together are not stable.

use super::closed::{ClosedLoop, LinearHybrid, Noise, Stress};
use super::plant::{LoopPlant, LoopPose, SampledPlant};
use super::proof::{FRICTION_LEVERAGE_MAX, Proof, Subject};
use super::spread::{LoopSpread, NamedPlant};
use super::{HybridError, friction_leverage};
use crate::analysis::stability::eigenvalues;
use crate::model::arm_model::ArmModel;
use argmin::core::{CostFunction, Executor, State};
use argmin::solver::neldermead::NelderMead;
use flexor::control::{FreeParameters, HybridParameters, MotionParameters};
use flexor::model::ArmParameters;
use rayon::prelude::*;

/// Factor on joint 2's torque with which every arm must be stable, a tick later.
pub const STRESS_GAIN: f64 = 1.3;

/// Least stiffness in the air about the planned angle, as a share of `3 EI / r2`: what gains for any
/// hub of the paper's arm have.
const AIR_STIFFNESS: f64 = 0.75;

/// The paper's arm: frequency of its contact mode (rad/s) and `3 EI / r2` (N m/rad), which its gains
/// belong to.
const PAPER_SCALES: Scales = Scales {
    frequency: 34.5,
    stiffness: 2.618,
    moment_nm: 1.1,
};

/// Joint 1's bandwidth, rad/s: scanned on the paper's arm for the least place error without chatter
/// of a 16384-count encoder.
const JOINT1_RAD_S: f64 = 33.0;
/// Its damping over twice the critical one's half, and its integral's rate, 1/s.
const JOINT1_DAMPING: f64 = 2.5;
const JOINT1_INTEGRAL_PER_S: f64 = 3.1;
/// Corner of its rate's filter, times the bandwidth.
const JOINT1_FILTER: f64 = 5.7;
/// Error whose stiffness torque is the integral's largest, rad.
const JOINT1_LIMIT_RAD: f64 = 1.0 / 16.0;

/// How long to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Well under a second.
    Design,
    /// Some ten seconds.
    Tune,
}

/// What gains are to be found for.
#[derive(Clone, Debug)]
pub struct Problem<'a> {
    /// The arm that is planned for.
    pub arm: &'a ArmParameters,
    /// Poses of its plan.
    pub poses: &'a [LoopPose],
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// Arms that must be held.
    pub spread: LoopSpread,
    /// What disturbs them.
    pub noise: Noise,
    /// Thresholds of the motion around the law.
    pub motion: MotionParameters,
}

/// Gains found, and what they do.
#[derive(Clone, Debug)]
pub struct Design {
    /// The gains.
    pub law: HybridParameters,
    /// Predicted force of the arms at the spread's ends under the noises: root mean square over
    /// them, N.
    pub force_rms_n: f64,
    /// Sets of gains that were tried.
    pub tried: u64,
    /// Stability with them.
    pub proof: Proof,
}

/// What an arm's gains scale with.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scales {
    /// Of the contact mode without feedback, rad/s.
    frequency: f64,
    /// `3 EI / r2`, N m/rad.
    stiffness: f64,
    /// Moment of the planned force at the root of a link along the surface, N m.
    moment_nm: f64,
}

impl Scales {
    fn new(problem: &Problem<'_>) -> Result<Self, HybridError> {
        let arm = problem.arm;
        let pose = &problem.poses[0];
        let heavy = LoopPlant {
            root_inertia_kgm2: problem.spread.root_inertia_kgm2[1],
            ..problem.spread.middle(arm)
        };
        let plant = SampledPlant::new(arm, &heavy, pose, problem.tick_rate_hz, false)?;
        let rate = f64::from(problem.tick_rate_hz);
        let modes = eigenvalues(plant.phi).into_iter().filter(|z| z.im > 1e-9);
        let frequency = modes
            .map(|z| {
                let decay = libm::log(libm::hypot(z.re, z.im));
                rate * libm::hypot(decay, libm::atan2(z.im, z.re))
            })
            .fold(f64::INFINITY, f64::min);
        Ok(Self {
            frequency: frequency.min(0.3 * rate),
            stiffness: 3.0 * arm.bending_stiffness_nm2 / arm.link2_length_m,
            moment_nm: arm.link2_length_m * pose.force_n,
        })
    }
}

/// Numbers of a set in contact, of the order of 1 for an arm of the paper's proportions: logarithms
/// of K_IF, B2, its filter, k2, K_T and w, then z's logit, g, h.
type Numbers = Vec<f64>;

/// Their scales: factors on the paper's arm's.
fn contact_of(numbers: &[f64], s: &Scales) -> HybridParameters {
    let (time, stiffness) = (
        s.frequency / PAPER_SCALES.frequency,
        s.stiffness / PAPER_SCALES.stiffness,
    );
    let e = |i: usize| libm::exp(numbers[i].clamp(-14.0, 14.0));
    HybridParameters {
        force_integral_per_s: digits(e(0) * time),
        joint_damping_nms_rad: [0.0, digits(e(1) * stiffness / time)],
        rate_filter_hz: [JOINT1_RAD_S, digits((e(2) * time).min(1e5))],
        joint_stiffness_nm_rad: [0.0, digits(e(3) * stiffness)],
        torque_loop_per_s: digits(e(4) * time),
        section_frequency_rad_s: digits(e(5) * time),
        section_damping: digits(0.99 / (1.0 + libm::exp(-numbers[6]))),
        section_angle_nm_rad: [
            digits(numbers[7] * stiffness),
            digits(numbers[8] * stiffness),
        ],
        section_force: [digits(numbers[9]), digits(numbers[10])],
        torque_correction_limit_nm: digits(0.5 * s.moment_nm / PAPER_SCALES.moment_nm),
        ..HybridParameters::PAPER_ARM_HUB
    }
}

/// The numbers of gains of the paper's arm.
fn numbers_of(p: &HybridParameters) -> Numbers {
    let ln = libm::log;
    let z = p.section_damping / 0.99;
    vec![
        ln(p.force_integral_per_s),
        ln(p.joint_damping_nms_rad[1]),
        ln(p.rate_filter_hz[1]),
        ln(p.joint_stiffness_nm_rad[1]),
        ln(p.torque_loop_per_s),
        ln(p.section_frequency_rad_s),
        ln(z / (1.0 - z)),
        p.section_angle_nm_rad[0],
        p.section_angle_nm_rad[1],
        p.section_force[0],
        p.section_force[1],
    ]
}

/// A set in the air: logarithms of k2, B2 and w, z's logit, g, K_T's logarithm.
fn air_of(numbers: &[f64], s: &Scales) -> FreeParameters {
    let (time, stiffness) = (
        s.frequency / PAPER_SCALES.frequency,
        s.stiffness / PAPER_SCALES.stiffness,
    );
    let e = |i: usize| libm::exp(numbers[i].clamp(-14.0, 14.0));
    FreeParameters {
        stiffness_nm_rad: digits(e(0) * stiffness),
        damping_nms_rad: digits(e(1) * stiffness / time),
        torque_loop_per_s: digits(e(6) * time),
        section_frequency_rad_s: digits(e(2) * time),
        section_damping: digits(0.99 / (1.0 + libm::exp(-numbers[3]))),
        section_angle_nm_rad: [
            digits(numbers[4] * stiffness),
            digits(numbers[5] * stiffness),
        ],
    }
}

/// As [`numbers_of`].
fn air_numbers_of(p: &FreeParameters) -> Numbers {
    let ln = libm::log;
    let z = p.section_damping / 0.99;
    vec![
        ln(p.stiffness_nm_rad),
        ln(p.damping_nms_rad),
        ln(p.section_frequency_rad_s),
        ln(z / (1.0 - z)),
        p.section_angle_nm_rad[0],
        p.section_angle_nm_rad[1],
        ln(p.torque_loop_per_s),
    ]
}

/// `value` to four digits: what a file shows is what was examined.
pub fn digits(value: f64) -> f64 {
    if !(value.abs() > 0.0 && value.is_finite()) {
        return 0.0;
    }
    let place = libm::floor(libm::log10(value.abs()));
    let scale = libm::pow(10.0, 3.0 - place);
    libm::round(value * scale) / scale
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
struct Search<'a> {
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
const UNSTABLE: f64 = 5.0;
const GROWTH_MAX: f64 = 50.0;

impl<'a> Search<'a> {
    fn new(
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
    fn law(&self, numbers: &[f64]) -> HybridParameters {
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
fn descend(search: &Search<'_>, starts: &[Numbers], extent: &Extent) -> (Numbers, f64, u64) {
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
        let back = (i + round) % 3 == 0;
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

/// The paper's arm's gains for any hub: `examples/controller.toml`.
pub const PAPER_ARM_ANY_HUB: HybridParameters = HybridParameters {
    joint_stiffness_nm_rad: [800.0, 1.703],
    joint_damping_nms_rad: [60.0, 0.0035],
    rate_filter_hz: [30.0, 80.0],
    force_integral_per_s: 7.005,
    torque_loop_per_s: 5.565,
    section_frequency_rad_s: 23.34,
    section_damping: 0.708,
    section_angle_nm_rad: [1.823, 0.7978],
    section_force: [0.1719, 0.1304],
    free: FreeParameters {
        stiffness_nm_rad: 1.677,
        damping_nms_rad: 4.93e-5,
        torque_loop_per_s: 0.5555,
        section_frequency_rad_s: 1.55,
        section_damping: 0.9793,
        section_angle_nm_rad: [1.111, -6.533],
    },
    ..HybridParameters::PAPER_ARM_HUB
};

/// Starts: both sets of the paper's arm, slower ones, and with less damping.
fn starts(
    of: impl Fn(&HybridParameters) -> Numbers,
    slower: &[usize],
    damping: usize,
    wide: bool,
) -> Vec<Numbers> {
    let (slow, less): (&[f64], &[f64]) = match wide {
        false => (&[0.0, 0.8, 2.4], &[0.0, 1.5]),
        true => (&[0.0, 0.8, 2.4, 4.0], &[0.0, 1.5, 3.0, 4.5]),
    };
    let mut starts = vec![];
    for set in [HybridParameters::PAPER_ARM_HUB, PAPER_ARM_ANY_HUB] {
        for less in less {
            for slow in slow {
                let mut numbers = of(&set);
                slower.iter().for_each(|i| numbers[*i] -= slow);
                numbers[damping] -= less;
                starts.push(numbers);
            }
        }
    }
    starts
}

/// Starts in the air without the section: stiffness and damping alone.
fn stiff_starts() -> Vec<Numbers> {
    let mut starts = vec![];
    for stiffness in [1.0, 2.0, 4.0] {
        for damping in [0.03, 0.01, 0.003, 0.001] {
            let k = libm::log(PAPER_SCALES.stiffness * stiffness);
            let slow = libm::log(2.0);
            starts.push(vec![k, libm::log(damping), slow, 0.0, 0.0, 0.0, slow]);
        }
    }
    starts
}

/// Gains for `problem`, with their proof. Where a short search finds none that hold every arm, a
/// longer one from more starts is made.
///
/// # Errors
/// [`HybridError::NotDesigned`] where none hold the spread, [`HybridError::Friction`] where its
/// friction is too much for the path, and others.
pub fn design(problem: &Problem<'_>, effort: Effort) -> Result<Design, HybridError> {
    let efforts: &[Extent] = match effort {
        Effort::Design => &[Extent::SHORT, Extent::WIDE],
        Effort::Tune => &[Extent::LONG, Extent::WIDE],
    };
    let search = Search::new(problem, None)?;
    let mut all = 0;
    let mut refusal = HybridError::NotFinite { t_s: 0.0 };
    for extent in efforts {
        let (law, tried) = search_both(problem, &search, extent)?;
        all += tried;
        let (law, proof) = with_joint1_proved(problem, &law)?;
        if proof.is_stable() {
            return Ok(Design {
                force_rms_n: force_rms(&search, &law),
                law,
                tried: all,
                proof,
            });
        }
        refusal = refused(problem, &proof);
    }
    Err(refusal)
}

/// How much is tried.
#[derive(Clone, Copy, Debug)]
struct Extent {
    /// Simplexes, and steps of each.
    rounds: usize,
    steps: u64,
    /// Whether the starts lie far apart.
    wide: bool,
}

impl Extent {
    const SHORT: Self = Self {
        rounds: 2,
        steps: 40,
        wide: false,
    };
    const WIDE: Self = Self {
        rounds: 6,
        steps: 120,
        wide: true,
    };
    const LONG: Self = Self {
        rounds: 6,
        steps: 300,
        wide: false,
    };
}

/// `law` with joint 1 as fast as all arms are stable with; the best of all where none is.
fn with_joint1_proved(
    problem: &Problem<'_>,
    law: &HybridParameters,
) -> Result<(HybridParameters, Proof), HybridError> {
    let law = HybridParameters {
        motion: problem.motion,
        ..*law
    };
    let inertia = joint1_inertia(problem)?;
    let mut best: Option<(HybridParameters, Proof)> = None;
    for slower in [1.0, 0.7, 0.5, 0.35, 0.25, 0.12] {
        let placed = with_joint1(&law, inertia, slower * JOINT1_RAD_S);
        let subject = Subject {
            arm: problem.arm,
            law: &placed,
            poses: problem.poses,
            tick_rate_hz: problem.tick_rate_hz,
        };
        let proof = Proof::new(&subject, &problem.spread, false)?;
        if proof.is_stable() {
            return Ok((placed, proof));
        }
        let slowest = |proof: &Proof| proof.worst().map_or(f64::INFINITY, |p| p.slowest.re);
        let better = best
            .as_ref()
            .is_none_or(|(_, other)| slowest(&proof) < slowest(other));
        if better {
            best = Some((placed, proof));
        }
    }
    best.ok_or(HybridError::NotFinite { t_s: 0.0 })
}

/// Joint 2's gains in contact and in the air. Both have one filter on the rate: where that of the
/// best set in contact leaves none for the air, a set with the start's filter is taken.
fn search_both(
    problem: &Problem<'_>,
    search: &Search<'_>,
    extent: &Extent,
) -> Result<(HybridParameters, u64), HybridError> {
    let starts_in_contact = starts(numbers_of, &[0, 2, 4, 5], 1, extent.wide);
    let mut tried = 0;
    let mut best: Option<(HybridParameters, f64)> = None;
    for kept_filter in [false, true] {
        let search = Search {
            filter: kept_filter.then(|| numbers_of(&PAPER_ARM_ANY_HUB)[FILTER]),
            ..search.clone()
        };
        let (numbers, cost, count) = descend(&search, &starts_in_contact, extent);
        let contact = search.law(&numbers);
        let air = Search::new(problem, Some(contact))?;
        let mut air_starts = starts(|set| air_numbers_of(&set.free), &[2, 6], 1, extent.wide);
        if extent.wide {
            air_starts.extend(stiff_starts());
        }
        let (in_air, air_cost, air_count) = descend(&air, &air_starts, extent);
        tried += count + air_count;
        let all = cost.max(-20.0) + air_cost.max(-20.0);
        let law = air.law(&in_air);
        let better = best.as_ref().is_none_or(|(_, other)| all < *other);
        if better {
            best = Some((law, all));
        }
        // Nothing unstable in either.
        if cost < UNSTABLE / 10.0 && air_cost < UNSTABLE / 2.0 {
            break;
        }
    }
    let (law, _) = best.ok_or(HybridError::NotFinite { t_s: 0.0 })?;
    Ok((law, tried))
}

/// Root mean square over the arms whose force counts, N.
fn force_rms(search: &Search<'_>, law: &HybridParameters) -> f64 {
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

/// What joint 1 turns, kg m^2: link 1, and link 2's mass at its end.
fn joint1_inertia(problem: &Problem<'_>) -> Result<f64, HybridError> {
    let model = ArmModel::new(problem.arm, 1)?;
    let r1 = problem.arm.link1_length_m;
    Ok(model.link1_inertia + model.link2_mass * r1 * r1)
}

/// `law` with joint 1 placed at a bandwidth, rad/s.
fn with_joint1(law: &HybridParameters, inertia: f64, bandwidth: f64) -> HybridParameters {
    let stiffness = digits(bandwidth * bandwidth * inertia);
    let hub_filter = law.rate_filter_hz[1];
    HybridParameters {
        joint_stiffness_nm_rad: [stiffness, law.joint_stiffness_nm_rad[1]],
        joint_damping_nms_rad: [
            digits(JOINT1_DAMPING * (stiffness * inertia).sqrt()),
            law.joint_damping_nms_rad[1],
        ],
        rate_filter_hz: [
            digits(JOINT1_FILTER * bandwidth / core::f64::consts::TAU),
            hub_filter,
        ],
        joint1_integral_nm_rads: digits(
            JOINT1_INTEGRAL_PER_S * stiffness * bandwidth / JOINT1_RAD_S,
        ),
        joint1_integral_limit_nm: digits(JOINT1_LIMIT_RAD * stiffness),
        ..*law
    }
}

/// Why nothing was found, and what would make it easier.
fn refused(problem: &Problem<'_>, proof: &Proof) -> HybridError {
    let worst = proof.worst().map_or(String::new(), |p| {
        let hertz = p.slowest.im.abs() / core::f64::consts::TAU;
        format!(
            "with the best ones {} grows at {:+.2} 1/s ({hertz:.1} Hz)",
            p.name, p.slowest.re
        )
    });
    let [low, high] = problem.spread.root_inertia_kgm2;
    let remedy = match proof.root_inertia_kgm2 {
        Some([from, to]) if from > low || to < high => format!(
            "they hold a root inertia from {from:.2e} to {to:.2e} kg m^2, {low:.2e} to {high:.2e} was asked for: a narrower range is accepted"
        ),
        _ => "a smaller spread, faster drives, less delay or a higher control rate makes it easier"
            .into(),
    };
    HybridError::NotDesigned { worst, remedy }
}

//! Whether gains hold every arm of a spread at every pose, and with what margin.

use super::closed::{ClosedLoop, LinearHybrid, Stress};
use super::plant::{LoopPlant, LoopPose, SampledPlant};
use super::spread::{LoopSpread, NamedPlant};
use super::{FRICTION_LEVERAGE_MAX, HybridError, friction_leverage};
use flexor::control::HybridParameters;
use flexor::model::ArmParameters;
use nalgebra::Complex;
use rayon::prelude::*;

/// Factors by which joint 2's torque is multiplied, in the order in which margins are looked for.
const GAINS_UP: [f64; 7] = [1.2, 1.4, 1.7, 2.0, 2.5, 3.0, 4.0];
const GAINS_DOWN: [f64; 4] = [0.8, 0.6, 0.4, 0.2];
/// Ticks of delay more.
const TICKS: [usize; 6] = [1, 2, 3, 4, 6, 8];

/// What gains and their arm are, for a proof.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The arm that is planned for.
    pub arm: &'a ArmParameters,
    /// The gains.
    pub law: &'a HybridParameters,
    /// Poses at which the loop is frozen.
    pub poses: &'a [LoopPose],
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
}

/// One arm of the spread over the poses.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantProof {
    /// What it is.
    pub name: String,
    /// Its slowest pole, 1/s.
    pub slowest: Complex<f64>,
    /// Where in the plan that is, s.
    pub t_s: f64,
    /// Largest factor on joint 2's torque with which it is stable; 1 for none.
    pub gain_up: f64,
    /// Least factor.
    pub gain_down: f64,
    /// Whole ticks of delay that it bears more.
    pub ticks: usize,
}

impl PlantProof {
    /// Whether every pole decays.
    pub fn is_stable(&self) -> bool {
        self.slowest.re < 0.0
    }
}

/// Proof for a spread.
#[derive(Clone, Debug, PartialEq)]
pub struct Proof {
    /// Every arm in contact, with the law of contact; none where the tip presses nowhere.
    pub contact: Vec<PlantProof>,
    /// Every arm in the air, with the law of the air.
    pub air: Vec<PlantProof>,
    /// Inertias at the root, kg m^2, between which every arm is stable: the ends of the spread where
    /// they are.
    pub root_inertia_kgm2: Option<[f64; 2]>,
}

impl Proof {
    /// Examines the subject over `spread`; margins are left out unless they are asked for, which
    /// takes ten times as long.
    ///
    /// # Errors
    /// [`HybridError`]; instability is no error.
    pub fn new(
        subject: &Subject<'_>,
        spread: &LoopSpread,
        margins: bool,
    ) -> Result<Self, HybridError> {
        let leverage = friction_leverage(subject.poses);
        let product = spread.friction * leverage;
        if subject.presses() && !(product <= FRICTION_LEVERAGE_MAX) {
            return Err(HybridError::Friction {
                friction: spread.friction,
                product,
                accepted: FRICTION_LEVERAGE_MAX / leverage,
            });
        }
        let all = |plants: Vec<NamedPlant>| -> Result<Vec<PlantProof>, HybridError> {
            let proofs = plants
                .par_iter()
                .map(|named| subject.examine(named, margins));
            proofs.collect()
        };
        let contact = all(subject.in_contact(spread))?;
        let air = all(spread.in_the_air(subject.arm))?;
        let stable = contact.iter().chain(&air).all(PlantProof::is_stable);
        let root_inertia_kgm2 = if stable {
            Some(spread.root_inertia_kgm2)
        } else {
            subject.stable_roots(spread)?
        };
        Ok(Self {
            contact,
            air,
            root_inertia_kgm2,
        })
    }

    /// All arms.
    pub fn all(&self) -> impl Iterator<Item = &PlantProof> {
        self.contact.iter().chain(&self.air)
    }

    /// The arm with the slowest pole.
    pub fn worst(&self) -> Option<&PlantProof> {
        self.all()
            .reduce(|worst, other| match other.slowest.re > worst.slowest.re {
                true => other,
                false => worst,
            })
    }

    /// Whether every arm is stable.
    pub fn is_stable(&self) -> bool {
        self.all().all(PlantProof::is_stable)
    }

    /// Least margins of all arms in contact, or of a move through the air in the air: factor up,
    /// factor down, ticks.
    pub fn margins(&self) -> (f64, f64, usize) {
        let all = || match self.contact.is_empty() {
            false => self.contact.iter(),
            true => self.air.iter(),
        };
        (
            all().map(|p| p.gain_up).fold(f64::INFINITY, f64::min),
            all().map(|p| p.gain_down).fold(0.0, f64::max),
            all().map(|p| p.ticks).min().unwrap_or(0),
        )
    }
}

impl Subject<'_> {
    /// Whether the tip presses at any of the poses.
    fn presses(&self) -> bool {
        self.poses.iter().any(|pose| pose.force_n > 0.0)
    }

    /// The arms of `spread` that are in contact on the way: none of a move through the air.
    fn in_contact(&self, spread: &LoopSpread) -> Vec<NamedPlant> {
        if self.presses() {
            spread.in_contact(self.arm)
        } else {
            vec![]
        }
    }

    /// The law at a pose, for a plant in contact or in the air.
    fn law(&self, pose: &LoopPose, plant: &LoopPlant) -> LinearHybrid {
        let free = plant.contact_stiffness_n_m.is_none();
        LinearHybrid::new(self.law, self.arm, pose, self.tick_rate_hz, (free, true))
    }

    /// The slowest pole of `plant` over the poses, and when.
    ///
    /// # Errors
    /// [`HybridError`].
    pub fn slowest(&self, plant: &LoopPlant) -> Result<(Complex<f64>, f64), HybridError> {
        let mut worst = (Complex::new(f64::NEG_INFINITY, 0.0), 0.0);
        for pose in self.poses {
            let sampled = SampledPlant::new(self.arm, plant, pose, self.tick_rate_hz, true)?;
            let pole = ClosedLoop::new(&sampled, &self.law(pose, plant), &Stress::NONE).slowest();
            // Not max(), which passes NaN over.
            if !(pole.re <= worst.0.re) {
                worst = (pole, pose.t_s);
            }
        }
        Ok(worst)
    }

    /// One arm, with its margins if they are asked for.
    fn examine(&self, named: &NamedPlant, margins: bool) -> Result<PlantProof, HybridError> {
        let plant = &named.plant;
        let mut loops = vec![];
        for pose in self.poses {
            let sampled = SampledPlant::new(self.arm, plant, pose, self.tick_rate_hz, true)?;
            loops.push((pose.t_s, sampled, self.law(pose, plant)));
        }
        let under = |stress: Stress| {
            let mut worst = (Complex::new(f64::NEG_INFINITY, 0.0), 0.0);
            for (t_s, sampled, law) in &loops {
                let pole = ClosedLoop::new(sampled, law, &stress).slowest();
                if !(pole.re <= worst.0.re) {
                    worst = (pole, *t_s);
                }
            }
            worst
        };
        let (slowest, t_s) = under(Stress::NONE);
        let mut proof = PlantProof {
            name: named.name.clone(),
            slowest,
            t_s,
            gain_up: 1.0,
            gain_down: 1.0,
            ticks: 0,
        };
        if !(proof.is_stable() && margins) {
            return Ok(proof);
        }
        // Margins where the loop is slowest and at both ends.
        let last_pose = loops.len().saturating_sub(1);
        let worst = loops.iter().position(|(t, _, _)| *t == t_s).unwrap_or(0);
        let tightest: Vec<_> = loops
            .iter()
            .enumerate()
            .filter(|(i, _)| [0, worst, last_pose].contains(i))
            .collect();
        let holds = |stress: Stress| {
            tightest.iter().all(|(_, (_, sampled, law))| {
                ClosedLoop::new(sampled, law, &stress).slowest().re < 0.0
            })
        };
        let factor = |gain: f64| Stress {
            gain: [1.0, gain],
            ticks: 0,
        };
        proof.gain_up = last(&GAINS_UP, 1.0, |gain| holds(factor(gain)));
        proof.gain_down = last(&GAINS_DOWN, 1.0, |gain| holds(factor(gain)));
        let later = |ticks| Stress {
            ticks,
            ..Stress::NONE
        };
        proof.ticks = last(&TICKS, 0, |ticks| holds(later(ticks)));
        Ok(proof)
    }

    /// Between which inertias at the root, kg m^2, every kind of arm of `spread` is stable in
    /// contact and in the air: the widest stretch within the spread's own and beyond; none where there is none.
    ///
    /// # Errors
    /// [`HybridError`].
    pub fn stable_roots(&self, spread: &LoopSpread) -> Result<Option<[f64; 2]>, HybridError> {
        let holds = |root: f64| -> Result<bool, HybridError> {
            let one = LoopSpread {
                root_inertia_kgm2: [root; 2],
                ..*spread
            };
            let all = self.in_contact(&one).into_iter();
            for named in all.chain(one.in_the_air(self.arm)) {
                if !(self.slowest(&named.plant)?.0.re < 0.0) {
                    return Ok(false);
                }
            }
            Ok(true)
        };
        // From a thousandth of the unknown hub's end to ten times it, and nothing at all.
        let unknown = LoopSpread::unknown_root_inertia(self.arm)[1];
        let mut grid = vec![0.0];
        grid.extend((0..=12).map(|i| 1e-3 * unknown * libm::pow(10.0, f64::from(i) / 3.0)));
        let stable: Vec<bool> = grid
            .par_iter()
            .map(|root| holds(*root))
            .collect::<Result<_, _>>()?;
        let mut best: Option<(usize, usize)> = None;
        let mut from = None;
        for i in 0..=grid.len() {
            if stable.get(i) == Some(&true) {
                from = from.or(Some(i));
            } else if let Some(first) = from.take() {
                let longer = best.is_none_or(|(a, b)| i - 1 - first > b - a);
                best = if longer { Some((first, i - 1)) } else { best };
            }
        }
        let Some((first, last)) = best else {
            return Ok(None);
        };
        let edge = |inside: f64, outside: f64| -> Result<f64, HybridError> {
            let (mut inside, mut outside) = (inside, outside);
            while (inside / outside).max(outside / inside) > 1.02 && inside != outside {
                let middle = if outside > 0.0 {
                    (inside * outside).sqrt()
                } else {
                    0.5 * inside
                };
                if holds(middle)? {
                    inside = middle;
                } else {
                    outside = middle;
                }
            }
            Ok(inside)
        };
        let low = match first {
            0 => 0.0,
            _ => edge(grid[first], grid[first - 1])?,
        };
        let high = match grid.get(last + 1) {
            None => grid[last],
            Some(beyond) => edge(grid[last], *beyond)?,
        };
        Ok(Some([low, high]))
    }
}

/// The last of `steps` up to which all hold; `none` if the first does not.
fn last<T: Copy>(steps: &[T], none: T, holds: impl Fn(T) -> bool) -> T {
    let held = steps.iter().take_while(|step| holds(**step));
    held.last().copied().unwrap_or(none)
}

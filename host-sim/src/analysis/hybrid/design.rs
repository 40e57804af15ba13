//! Gains for the arm at hand.
//!
//! **Cost.** Joint 2's loop with link 1 locked does not depend on the path but through the moment arm
//! of the force, so one set of gains does. For the arms at the spread's ends the root mean square of
//! the force is predicted under the bench's noises, from the discrete Lyapunov equation; the cost is
//! the mean of its logarithm. Every arm of the spread must be stable, also with joint 2's torque
//! raised by three tenths and a tick later; what is not adds to the cost by how fast it grows.
//! What is not in the spread is not held.
//!
//! **Start.** The gains that were found for the paper's arm, brought to the arm at hand by the
//! frequency of its contact mode and the stiffness of its link against the root's turning,
//! `3 EI / r2`: that alone is right for an arm of the same proportions. From there a simplex
//! (Nelder and Mead) goes on; [`Effort::Tune`] takes more starts and steps.
//!
//! **In the air** joint 2 is to come to rest fast, no softer than three quarters of the link, and
//! also with the tip on the surface, where it is for some ticks at every touch.
//!
//! **Joint 1** is placed: stiffness and damping by the inertia that it turns, its bandwidth lowered
//! where a count of the encoder would ask much of the drive (an arm of the Shuttle's size takes 65 kN m
//! a count at the bandwidth of a small one), and where both joints together are not stable.

use super::HybridError;
use super::problem::Problem;
use super::proof::{Proof, Subject};
use super::search::{Extent, Search, UNSTABLE, descend, force_rms};
use super::sets::{PAPER_ARM_ANY_HUB, air_numbers_of, digits, numbers_of, starts, stiff_starts};
use crate::model::arm_model::ArmModel;
use flexor::control::HybridParameters;

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

/// Largest stiffness torque of a count of a 16384-count encoder, as a share of the largest planned
/// torque: 0.02 on the paper's arm in 2 s, whose damper makes fourteen times that of a count, for 5 ms.
const JOINT1_COUNT_SHARE: f64 = 0.03;

/// How long to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Well under a second.
    Design,
    /// Some ten seconds.
    Tune,
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

/// Gains for `problem`, with their proof. Where a short search finds none that hold every arm, a
/// longer one from more starts is made.
///
/// # Errors
/// [`HybridError::NotDesigned`] where none hold the spread, [`HybridError::Friction`] where its
/// friction is too much for the path, [`HybridError::NoContact`] where there is none, and others.
pub fn design(problem: &Problem<'_>, effort: Effort) -> Result<Design, HybridError> {
    let efforts: &[Extent] = match effort {
        Effort::Design => &[Extent::SHORT, Extent::WIDE],
        Effort::Tune => &[Extent::LONG, Extent::WIDE],
    };
    if !problem.poses.iter().any(|pose| pose.force_n > 0.0) {
        return Err(HybridError::NoContact);
    }
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
    let count_rad = core::f64::consts::TAU / 16384.0;
    let stiffest = JOINT1_COUNT_SHARE * problem.joint1_torque_nm / count_rad;
    let fastest = (stiffest / inertia).sqrt().min(JOINT1_RAD_S);
    let mut best: Option<(HybridParameters, Proof)> = None;
    for slower in [1.0, 0.7, 0.5, 0.35, 0.25, 0.12] {
        let placed = with_joint1(&law, inertia, slower * fastest);
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
        let search = search.with_filter_of(kept_filter.then_some(&PAPER_ARM_ANY_HUB));
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

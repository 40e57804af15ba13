//! What is wrong with gains, and what would help: in words.

use super::StabilityError;
use super::path::{self, FrozenPoint, Summary};
use super::sampled::with_gains_times;
use crate::planner::plan::Plan;
use crate::plant::spread::PlantVariant;
use crate::text::four_digits;
use flexor::control::{ForceProjection, PaperParameters};
use rayon::prelude::*;

/// Gain margin below which a stable loop gets a word of caution, dB.
pub const CAUTION_DB: f64 = 6.0;
/// Delay margin below which it gets one.
pub const CAUTION_TICKS: f64 = 1.0;

/// A gain of the law: its key in `controller.toml`, and access to it.
type GainField = (&'static str, fn(&mut PaperParameters) -> &mut f64);

/// The law's gains.
pub(super) const GAINS: [GainField; 4] = [
    ("K_DF_s", |law| &mut law.force_derivative_s),
    ("K_PF", |law| &mut law.force_proportional),
    ("K_IF_per_s", |law| &mut law.force_integral_per_s),
    ("K_w_Nms_rad", |law| &mut law.slope_rate_nms_rad),
];

fn stable(frozen_points: &[FrozenPoint], plan: &Plan, law: &PaperParameters) -> bool {
    frozen_points
        .par_iter()
        .all(|frozen| frozen.verdict(plan, law, 0.0).is_stable())
}

/// The largest share of a gain, to 1 %, with which `holds`; `None` if not even a
/// thousandth does.
fn share(holds: impl Fn(f64) -> bool) -> Option<f64> {
    const LEAST: f64 = 1e-3;
    if !holds(LEAST) {
        return None;
    }
    let (mut inside, mut outside) = (LEAST, 1.0);
    while outside / inside > 1.01 {
        let middle = (inside * outside).sqrt();
        if holds(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    Some(inside)
}

/// Two significant digits, rounded down in magnitude.
fn down(value: f64) -> String {
    if !(value > 0.0) {
        return "0".into();
    }
    let unit = libm::pow(10.0, libm::log10(value).floor() - 1.0);
    four_digits((value / unit + 1e-9).floor() * unit).to_string()
}

/// What to say about a loop whose `summary` is that of `variant` at `times`, s: nothing,
/// one caution, or for an unstable one the mode, the point and what would help.
///
/// # Errors
/// [`StabilityError`].
pub fn advice(
    plan: &Plan,
    variant: &PlantVariant,
    law: &PaperParameters,
    summary: &Summary,
    times: &[f64],
) -> Result<Vec<String>, StabilityError> {
    if summary.stable {
        return Ok(cautions(summary));
    }
    let mut words = vec![format!(
        "the gains are unstable ({}): worst at t = {:.3} s in {}",
        summary.name, summary.worst_t_s, summary.worst_mode
    )];
    let remedies = remedies(plan, variant, law, times)?;
    words.push(if remedies.is_empty() {
        "no smaller gain and no faster tick alone makes it stable".to_string()
    } else {
        format!("stable would be, each alone: {}", remedies.join("; or "))
    });
    Ok(words)
}

/// What to say of a stable loop with small margins.
fn cautions(summary: &Summary) -> Vec<String> {
    let mut words = vec![];
    if summary.gain_margin_db < CAUTION_DB {
        words.push(format!(
            "the gain margin is only {:.1} dB, at t = {:.3} s; {CAUTION_DB} dB are usual",
            summary.gain_margin_db, summary.gain_margin_t_s
        ));
    }
    if summary.delay_margin_ticks < CAUTION_TICKS {
        words.push(format!(
            "the delay margin is only {:.2} ticks: a drive or a computation that takes a tick makes the loop unstable",
            summary.delay_margin_ticks
        ));
    }
    words
}

/// What would make an unstable loop stable, each alone.
fn remedies(
    plan: &Plan,
    variant: &PlantVariant,
    law: &PaperParameters,
    times: &[f64],
) -> Result<Vec<String>, StabilityError> {
    let frozen_points = path::frozen_points(plan, variant, times)?;
    let mut remedies = vec![];
    for (name, gain) in GAINS {
        let value = *gain(&mut { *law });
        if value == 0.0 {
            continue;
        }
        let with = |share: f64| {
            let mut law = *law;
            *gain(&mut law) = value * share;
            stable(&frozen_points, plan, &law)
        };
        if let Some(share) = share(with) {
            remedies.push(format!("{name} up to {}", down(value * share)));
        }
    }
    if remedies.is_empty()
        && let Some(share) =
            share(|share| stable(&frozen_points, plan, &with_gains_times(law, share)))
    {
        remedies.push(format!("all gains times {}", down(share)));
    }
    let transpose = PaperParameters {
        force_projection: ForceProjection::JacobianTranspose,
        ..*law
    };
    if law.force_projection == ForceProjection::AsPrinted
        && stable(&frozen_points, plan, &transpose)
    {
        remedies.push("force_projection = \"jacobian-transpose\"".to_string());
    }
    if let Some(rate) = faster(plan, variant, law, times)? {
        remedies.push(format!(
            "a control rate of {rate} Hz ({:.1} times as fast)",
            f64::from(rate) / f64::from(variant.tick_rate_hz)
        ));
    }
    Ok(remedies)
}

/// The lowest of some control rates, Hz, above the variant's at which the loop is stable.
fn faster(
    plan: &Plan,
    variant: &PlantVariant,
    law: &PaperParameters,
    times: &[f64],
) -> Result<Option<u32>, StabilityError> {
    const FACTORS: [f64; 11] = [1.1, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0];
    for factor in FACTORS {
        let tick_rate_hz = (f64::from(variant.tick_rate_hz) * factor).round();
        if tick_rate_hz > 1e6 {
            break;
        }
        let variant = PlantVariant {
            tick_rate_hz: tick_rate_hz as u32,
            ..variant.clone()
        };
        if stable(&path::frozen_points(plan, &variant, times)?, plan, law) {
            return Ok(Some(variant.tick_rate_hz));
        }
    }
    Ok(None)
}

/// Quick look at the loop of `plan` with `plant` before it is simulated: the words of
/// [`advice`] if it is unstable, else none. Margins are not looked for.
///
/// # Errors
/// [`StabilityError`].
pub fn warning(
    plan: &Plan,
    plant: &crate::plant::PlantParameters,
    law: &PaperParameters,
) -> Result<Vec<String>, StabilityError> {
    super::check(law)?;
    let times = path::times(plan, path::DEFAULT_POINTS);
    let variant = PlantVariant::new(&plan.model.arm, plan.tick_rate_hz, plant, 0.0)?;
    let summary = path::quick_check(plan, "simulated plant", &variant, law, &times)?;
    if summary.stable {
        return Ok(vec![]);
    }
    advice(plan, &variant, law, &summary, &times)
}

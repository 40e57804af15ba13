//! Where in the plane of two gains the loop is stable.

use super::StabilityError;
use super::advice::GAINS;
use super::path::{self, FrozenPoint};
use super::sampled::with_gains_times;
use crate::planner::plan::Plan;
use crate::plant::spread::PlantVariant;
use flexor::control::PaperParameters;
use rayon::prelude::*;

/// A gain of the law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GainId {
    /// K_DF, s.
    ForceDerivative,
    /// K_PF.
    ForceProportional,
    /// K_IF, 1/s.
    ForceIntegral,
    /// K_w, N m s/rad.
    SlopeRate,
}

impl GainId {
    /// Its key in `controller.toml`.
    pub fn key(self) -> &'static str {
        GAINS[self as usize].0
    }

    /// Its value in `law`.
    pub fn of(self, law: &PaperParameters) -> f64 {
        let mut law = *law;
        *GAINS[self as usize].1(&mut law)
    }

    /// `law` with another value of it.
    pub fn set(self, law: &PaperParameters, value: f64) -> PaperParameters {
        let mut law = *law;
        *GAINS[self as usize].1(&mut law) = value;
        law
    }

    /// A value to look around where the law has none: of the size that matters for
    /// `plan`'s arm, whose contact mode has the frequency `contact`, rad/s.
    fn usual(self, plan: &Plan, contact: f64) -> f64 {
        let arm = &plan.model.arm;
        match self {
            Self::ForceDerivative => 0.1 / contact,
            Self::ForceProportional => 0.1,
            Self::ForceIntegral => 0.1 * contact,
            Self::SlopeRate => arm.bending_stiffness_nm2 / arm.link2_length_m / contact,
        }
    }
}

/// How stable a loop is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// Not.
    Unstable,
    /// Stable, with less than 6 dB of gain margin or less than a tick of delay margin.
    Tight,
    /// Stable with both.
    Stable,
}

/// A map over two gains, on logarithmic scales.
#[derive(Clone, Debug)]
pub struct Map {
    /// The gains along the abscissa and the ordinate.
    pub gains: [GainId; 2],
    /// Their values at the cells' middles.
    pub values: [Vec<f64>; 2],
    /// Classes, row by row from the least ordinate.
    pub classes: Vec<Class>,
    /// The law's own values.
    pub chosen: [f64; 2],
}

/// Cells of a map, across and up.
pub const CELLS: [usize; 2] = [36, 28];

/// Decades that a map spans about its middle.
const DECADES: f64 = 3.0;

/// Points of the path that a map is examined at; the worst of them counts.
const POINTS: usize = 5;

/// Stability of `variant` over `gains`, both about the values of `law`.
///
/// # Errors
/// [`StabilityError`].
pub fn map(
    plan: &Plan,
    variant: &PlantVariant,
    law: &PaperParameters,
    gains: [GainId; 2],
) -> Result<Map, StabilityError> {
    let frozen_points = path::frozen_points(plan, variant, &path::times(plan, POINTS))?;
    let contact = frozen_points
        .first()
        .map_or(1.0, FrozenPoint::contact_frequency);
    let values = [0, 1].map(|axis| {
        let own = gains[axis].of(law);
        let middle = if own > 0.0 {
            own
        } else {
            gains[axis].usual(plan, contact)
        };
        (0..CELLS[axis])
            .map(|i| {
                let share = (i as f64 + 0.5) / CELLS[axis] as f64 - 0.5;
                middle * libm::pow(10.0, DECADES * share)
            })
            .collect::<Vec<f64>>()
    });
    let classes = (0..CELLS[0] * CELLS[1])
        .into_par_iter()
        .map(|i| {
            let law = gains[0].set(law, values[0][i % CELLS[0]]);
            let law = gains[1].set(&law, values[1][i / CELLS[0]]);
            let holds = |factor: f64, delay: f64| {
                let law = with_gains_times(&law, factor);
                frozen_points
                    .iter()
                    .all(|frozen| frozen.verdict(plan, &law, delay).is_stable())
            };
            if !holds(1.0, 0.0) {
                Class::Unstable
            } else if holds(2.0, 0.0) && holds(1.0, 1.0) {
                Class::Stable
            } else {
                Class::Tight
            }
        })
        .collect();
    Ok(Map {
        chosen: gains.map(|gain| gain.of(law)),
        gains,
        values,
        classes,
    })
}

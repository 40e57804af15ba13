//! Which control law acts.
//!
//! | law | file | measures |
//! |---|---|---|
//! | `paper` | `paper` | root slope rate against the chord, force, link angles |
//! | `hybrid` | `hybrid` | motor angles, root moment, force |

use crate::control::hybrid::HybridLaw;
use crate::control::hybrid_parameters::HybridParameters;
use crate::control::motion_parameters::MotionParameters;
use crate::control::paper::{PaperLaw, PaperParameters};
use crate::model::ArmParameters;
use crate::number::{Scalar, SiScalar};
use crate::signals::Formats;
use serde::{Deserialize, Serialize};

/// A law's gains and options, in f64 SI units: what `controller.toml` says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LawParameters {
    /// Of the paper's law, eq. 18-20.
    Paper(PaperParameters),
    /// Of the hybrid law.
    Hybrid(HybridParameters),
}

impl LawParameters {
    /// Feedforward alone: the paper's law without gains.
    pub const FEEDFORWARD: Self = Self::Paper(PaperParameters::FEEDFORWARD);

    /// The law's name, as in `controller.toml`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Paper(_) => "paper",
            Self::Hybrid(_) => "hybrid",
        }
    }

    /// Ticks for which the controller holds the table's first one before the table begins.
    pub fn settle_ticks(&self, tick_rate_hz: u32) -> u32 {
        match self {
            Self::Paper(_) => 0,
            Self::Hybrid(hybrid) => hybrid.motion.settle_ticks(tick_rate_hz),
        }
    }

    /// The same law, which follows the table at once.
    #[must_use]
    pub fn without_settling(self) -> Self {
        match self {
            Self::Paper(_) => self,
            Self::Hybrid(hybrid) => Self::Hybrid(HybridParameters {
                motion: MotionParameters {
                    settle_s: 0.0,
                    ..hybrid.motion
                },
                ..hybrid
            }),
        }
    }

    /// The parameters of the paper's law, if that is the one.
    pub fn paper(&self) -> Option<&PaperParameters> {
        match self {
            Self::Paper(paper) => Some(paper),
            Self::Hybrid(_) => None,
        }
    }
}

impl From<PaperParameters> for LawParameters {
    fn from(parameters: PaperParameters) -> Self {
        Self::Paper(parameters)
    }
}

impl From<HybridParameters> for LawParameters {
    fn from(parameters: HybridParameters) -> Self {
        Self::Hybrid(parameters)
    }
}

/// A law's coefficients in the tick's number type.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub enum Law<T: Scalar> {
    /// The paper's.
    Paper(PaperLaw<T>),
    /// The hybrid law.
    Hybrid(HybridLaw<T>),
}

impl<T: SiScalar> Law<T> {
    /// Coefficients for `arm` at `tick_rate_hz` and signals of the given formats. Those that a
    /// format cannot take saturate.
    pub fn in_formats(
        parameters: &LawParameters,
        arm: &ArmParameters,
        tick_rate_hz: u32,
        formats: &Formats<T::Format>,
    ) -> Self {
        match parameters {
            LawParameters::Paper(paper) => {
                Self::Paper(PaperLaw::in_formats(paper, arm, tick_rate_hz, formats))
            }
            LawParameters::Hybrid(hybrid) => {
                Self::Hybrid(HybridLaw::in_formats(hybrid, arm, tick_rate_hz, formats))
            }
        }
    }
}

//! Stability of the closed loop over the whole planned motion (eq. 21-23), and gains
//! found by it.
//!
//! The paper linearises its equations about the planned motion and says that the gains
//! are "determined appropriately". Here the plant that is simulated is linearised by
//! exact derivatives ([`linear`]), sampled as the controller samples it and closed with
//! the controller's own law ([`sampled`]), examined along the path and for a spread of
//! plants ([`path`]), and searched for gains (`tune`). Eq. 23 as the paper prints it is
//! in [`printed`]. `docs/gains.md` has the findings.
//!
//! Glossary: *frozen* means linearised at a point of the motion, as if the motion stayed
//! there; the *tangential mode* is the tip's motion along the surface, a pair of poles that
//! eq. 18-20 do not control; the *contact mode* is the link's slowest vibration with the
//! tip on the surface; *radius* is the largest magnitude of an eigenvalue from tick to
//! tick, below 1 for a stable loop; a *variant* is a plant that differs from the planned
//! arm, a *spread* a set of them.

pub mod advice;
mod complex;
pub mod linear;
pub mod map;
pub mod path;
pub mod printed;
// What only the search for gains asks of it.
#[cfg_attr(not(feature = "tune"), allow(dead_code))]
pub mod sampled;
#[cfg(feature = "tune")]
pub mod tune;

use crate::model::arm_model::ModelError;
use crate::text::Shortest;
use flexor::control::PaperParameters;
use flexor::model::KinematicsError;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix, Schur};

/// Why there is no statement on stability.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StabilityError {
    /// A gain or corner that no controller can have.
    #[error("{name} = {}; accepted: {accepted}", Shortest(*value))]
    Gain {
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
        accepted: &'static str,
    },
    /// No model of a plant.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A plant's link has no resting shape.
    #[error(
        "at t = {t_s:.4} s link 2 of a plant of the spread has no resting shape under the planned force: it buckles; more stiffness or less force is accepted"
    )]
    Buckled {
        /// When, s.
        t_s: f64,
    },
    /// The tip is out of reach.
    #[error("at t = {t_s:.4} s the arm is {source}")]
    Configuration {
        /// When, s.
        t_s: f64,
        /// What is wrong there.
        source: KinematicsError,
    },
    /// The equations have no finite derivative.
    #[error("at t = {t_s:.4} s the equations of motion have no finite derivatives")]
    NotFinite {
        /// When, s.
        t_s: f64,
    },
    /// No point to examine.
    #[error("0 points of the path: 2 or more are accepted")]
    NoPoints,
    /// No gains satisfy the margins.
    #[error(
        "no gains were found that keep every plant of the spread stable with a gain margin of {} dB and a delay margin of {} ticks: the worst is {worst}; a higher control rate, a smaller spread or more root inertia makes it easier",
        Shortest(*gain_margin_db),
        Shortest(*delay_margin_ticks)
    )]
    NotTuned {
        /// Gain margin asked for, dB.
        gain_margin_db: f64,
        /// Delay margin asked for.
        delay_margin_ticks: f64,
        /// What remains.
        worst: String,
    },
    /// The optimiser gave up.
    #[error("the optimiser failed: {0}")]
    Optimiser(String),
}

/// Refuses gains that are not finite, negative or absurdly large.
///
/// # Errors
/// [`StabilityError::Gain`].
pub fn check(law: &PaperParameters) -> Result<(), StabilityError> {
    let gains = [
        (
            "K_DF_s",
            law.force_derivative_s,
            1e3,
            "a gain in s from 0 to 1000",
        ),
        ("K_PF", law.force_proportional, 1e3, "a gain from 0 to 1000"),
        (
            "K_IF_per_s",
            law.force_integral_per_s,
            1e6,
            "a gain in 1/s from 0 to 1e6",
        ),
        (
            "K_w_Nms_rad",
            law.slope_rate_nms_rad,
            1e4,
            "a gain in N m s/rad from 0 to 10000",
        ),
    ];
    for (name, value, high, accepted) in gains {
        if !(value >= 0.0 && value <= high) {
            return Err(StabilityError::Gain {
                name,
                value,
                accepted,
            });
        }
    }
    let corners = [
        ("force_filter_Hz", law.force_filter_hz),
        ("slope_rate_filter_Hz", law.slope_rate_filter_hz),
    ];
    for (name, value) in corners {
        if let Some(value) = value
            && !(value > 0.0 && value <= 1e6)
        {
            let accepted = "a frequency in Hz above 0 up to 1e6";
            return Err(StabilityError::Gain {
                name,
                value,
                accepted,
            });
        }
    }
    Ok(())
}

/// Eigenvalues of a square matrix; infinite if its entries are not finite.
pub(crate) fn eigenvalues(mut matrix: DMatrix<f64>) -> Vec<Complex<f64>> {
    /// QR iterations; some 3 an eigenvalue are usual.
    const ITERATIONS: usize = 10_000;
    let size = matrix.nrows();
    if matrix.iter().all(|x| x.is_finite()) {
        balance_parlett_reinsch(&mut matrix);
        if let Some(schur) = Schur::try_new(matrix, f64::EPSILON, ITERATIONS) {
            return schur.complex_eigenvalues().iter().copied().collect();
        }
    }
    vec![Complex::new(f64::INFINITY, 0.0); size]
}

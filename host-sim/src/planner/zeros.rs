//! Zeros: the growth rates of the deflection for a prescribed tip. They come in pairs of
//! either sign, tell how long the link has to bend before and after a motion, and how thin
//! the deflection's boundary layers are.

use crate::model::arm_model::ArmModel;
use crate::model::configuration::Configuration;
use crate::model::dynamics;
use crate::planner::task::{PlanError, Window};
use flexor::model::JointMotion;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix};

/// Zeros of the arm at rest at `angle` under `force` (N, inertial axes): growth rates,
/// 1/s, of the deflection with a fixed tip.
fn zeros_of(model: &ArmModel, angle: [f64; 2], force: [f64; 2]) -> Vec<Complex<f64>> {
    let n = model.dof();
    let joint = JointMotion {
        angle,
        ..JointMotion::default()
    };
    let configuration = Configuration::new(model, angle);
    let equation = dynamics::deflection_equation(model, &joint, &configuration, force, false);
    let (mut by_q, mut by_rate) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    let zeros = vec![0.0; n];
    let mut value = vec![0.0; n];
    equation.linearise(model, &zeros, &zeros, &mut value, &mut by_q, &mut by_rate);
    let mass = dynamics::eliminated_mass(model).lu();
    let mut system = DMatrix::zeros(2 * n, 2 * n);
    for i in 0..n {
        system[(i, n + i)] = 1.0;
    }
    for (matrix, column) in [(by_q, 0), (by_rate, n)] {
        if let Some(solved) = mass.solve(&matrix) {
            system.view_mut((n, column), (n, n)).copy_from(&solved);
        }
    }
    // Metres and radians, and rates of 1/s to 1e5 1/s, side by side: unbalanced, what the smallest
    // zeros lose by rounding would depend on the units. (It would not end for infinite numbers.)
    if system.iter().all(|x| x.is_finite()) {
        balance_parlett_reinsch(&mut system);
    }
    system.complex_eigenvalues().iter().copied().collect()
}

/// The slowest zeros, 1/s, of the arm at rest at `angle` under `force` (N, inertial
/// axes): `[growing, decaying]`, infinite where there is none of that sign.
pub fn slowest_zeros(model: &ArmModel, angle: [f64; 2], force: [f64; 2]) -> [f64; 2] {
    let zeros = zeros_of(model, angle, force);
    let slowest = |sign: f64| {
        let rates = zeros.iter().map(|zero| sign * zero.re);
        rates
            .filter(|rate| *rate > 0.0)
            .fold(f64::INFINITY, f64::min)
    };
    [slowest(1.0), -slowest(-1.0)]
}

/// Magnitude, 1/s, of the fastest zero of the arm at rest at `angle` under
/// `force` (N, inertial axes).
///
/// # Errors
/// [`PlanError::Unpaired`] where there are not as many growing as decaying zeros.
pub(super) fn fastest_zero(
    model: &ArmModel,
    angle: [f64; 2],
    force: [f64; 2],
) -> Result<f64, PlanError> {
    let zeros = zeros_of(model, angle, force);
    let growing = zeros.iter().filter(|zero| zero.re > 0.0).count();
    if 2 * growing != zeros.len() {
        return Err(PlanError::Unpaired {
            growing,
            decaying: zeros.len() - growing,
            tip_inertia_kgm2: model.arm.tip_inertia_kgm2,
            elements: model.elements,
        });
    }
    Ok(zeros
        .iter()
        .map(|zero| libm::hypot(zero.re, zero.im))
        .fold(0.0, f64::max))
}

/// Length of a window, s, for the arm at rest at the joint angles `angle` under `force` (N,
/// inertial axes): until the slowest growing zero has grown, `before` the motion, or the slowest
/// decaying one has decayed, after it.
///
/// # Errors
/// [`PlanError::NoWindow`] where no zero of that sign does so within `longest_s`.
pub(super) fn window_length(
    model: &ArmModel,
    window: Window,
    (angle, force): ([f64; 2], [f64; 2]),
    before: bool,
    longest_s: f64,
) -> Result<f64, PlanError> {
    match window {
        Window::Fixed(seconds) => Ok(seconds),
        Window::Auto { tolerance } => {
            let [growing, decaying] = slowest_zeros(model, angle, force);
            let rate_per_s = if before { growing } else { -decaying };
            let seconds = -libm::log(tolerance) / rate_per_s;
            // Infinite where no zero has that sign.
            if rate_per_s.is_finite() && seconds <= longest_s {
                Ok(seconds)
            } else {
                let what = if before {
                    "pre_actuation_s"
                } else {
                    "post_actuation_s"
                };
                Err(PlanError::NoWindow { what, rate_per_s })
            }
        }
    }
}

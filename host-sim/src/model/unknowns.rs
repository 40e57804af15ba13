//! The numbers that say how link 2 is bent, as the planner has them: nodal slopes (of the geometric model the sines of
//! section angles) and deflections, in the order of [`flexor::model::Beam`].

use crate::model::arm_model::{ArmModel, dot};
use crate::model::bending::Nodal;
use crate::model::dual::Dual;
use crate::model::link::LinkModel;
use nalgebra::DVector;

/// Largest sine of a section angle: 72 degrees. The unknown that it is cannot pass 1, and near a right
/// angle a link of Hermite elements means nothing any more.
pub(crate) const SECTION_SINE_MAX: f64 = 0.95;

/// Derivatives that are computed at a time.
pub(crate) const LANES: usize = 8;

/// The unknowns with their derivatives by `N` of them, rates and accelerations, from the one number
/// `from` on.
pub(crate) struct Seeded<'a, const N: usize> {
    pub(crate) values: [&'a [f64]; 3],
    pub(crate) from: usize,
}

impl<const N: usize> Nodal<Dual<N>> for Seeded<'_, N> {
    #[inline]
    fn sum(&self, order: usize, first: usize, coefficients: &[f64]) -> Dual<N> {
        let values = self.values[order];
        let value = dot(coefficients, &values[first..first + coefficients.len()]);
        let mut slopes = [0.0; N];
        let begin = order * values.len() + first;
        for (i, coefficient) in coefficients.iter().enumerate() {
            // Below `from` it wraps to a large number.
            if let Some(slope) = slopes.get_mut((begin + i).wrapping_sub(self.from)) {
                *slope = *coefficient;
            }
        }
        Dual::with_slopes(value, slopes)
    }
}

/// What one of each unknown of `model` is worth: 1 rad, or link 2's length, m.
pub(crate) fn units_of(model: &ArmModel) -> DVector<f64> {
    DVector::from_fn(model.dof(), |i, _| match is_deflection(i, model.dof()) {
        true => model.arm.link2_length_m,
        false => 1.0,
    })
}

/// Whether `model`'s link can have the nodal unknowns `q`, whose slopes are without units.
pub(crate) fn admits(model: &ArmModel, q: &[f64]) -> bool {
    model.link.kind.model == LinkModel::Linear || steepest_sine(q) < SECTION_SINE_MAX
}

/// Whether the nodal number `i` of `dof` is a deflection (m), else a slope (rad). They are in the
/// order of [`flexor::model::Beam`]: the root's slope, deflection and slope of each inner node, the
/// tip's slope.
fn is_deflection(i: usize, dof: usize) -> bool {
    i % 2 == 1 && i + 1 < dof
}

/// Largest nodal slope: the sine of a section angle.
pub(crate) fn steepest_sine(q: &[f64]) -> f64 {
    let slopes = q.iter().enumerate();
    let slopes = slopes.filter(|(i, _)| !is_deflection(*i, q.len()));
    slopes.fold(0.0, |most, (_, slope)| slope.abs().max(most))
}

/// Largest nodal slope (rad) or deflection (share of `length_m`, link 2's); NaN if any is.
pub(crate) fn largest(w: &[f64], length_m: f64) -> f64 {
    let size = |(i, size): (usize, &f64)| match is_deflection(i, w.len()) {
        true => size.abs() / length_m,
        false => size.abs(),
    };
    // Not max(), which passes NaN over.
    let larger = |most: f64, size: f64| if size <= most { most } else { size };
    w.iter().enumerate().map(size).fold(0.0, larger)
}

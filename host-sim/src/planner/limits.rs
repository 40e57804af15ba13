//! Torque limits for drives of which nothing is known.

use super::plan::Plan;
use flexor::control::LimitParameters;

/// Limits for drives of which nothing is known: three times the largest planned
/// torque, reached from zero within half a millisecond. They are there to stop a
/// runaway, not to shape the motion.
pub fn default_limits(plan: &Plan) -> LimitParameters {
    /// A peak that is smaller than this in the other joint's is rounding.
    const LEAST: f64 = 1e-6;
    let peaks = plan.peaks.torque;
    let least = LEAST * peaks[0].max(peaks[1]);
    let torque_nm = peaks.map(|peak| 3.0 * peak.max(least));
    LimitParameters {
        torque_nm,
        torque_rate_nm_s: torque_nm.map(|torque| torque / 5e-4),
    }
}

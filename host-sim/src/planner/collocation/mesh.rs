//! Refinement: where a mesh is divided.

/// Divides all intervals in two.
pub(super) fn halve(mesh: &[f64]) -> Vec<f64> {
    let halves = mesh.windows(2).flat_map(|m| [m[0], 0.5 * (m[0] + m[1])]);
    halves.chain(mesh.last().copied()).collect()
}

/// Divides the intervals whose error is not tolerated, by what the order promises.
pub(super) fn refine(mesh: &[f64], errors: &[f64], resolution: f64) -> Vec<f64> {
    let mut fine = Vec::with_capacity(2 * mesh.len());
    for (interval, error) in mesh.windows(2).zip(errors) {
        // Of order 6 at least; beyond 3 parts the estimate is not trusted.
        let wanted = libm::pow(2.0 * error, 1.0 / 6.0).ceil();
        let useful = (interval[1] - interval[0]) / resolution;
        let parts = wanted.min(useful.floor()).clamp(1.0, 3.0);
        for part in 0..parts as usize {
            fine.push(interval[0] + (interval[1] - interval[0]) * part as f64 / parts);
        }
    }
    fine.push(mesh[mesh.len() - 1]);
    fine
}

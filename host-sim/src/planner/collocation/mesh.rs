//! Refinement: where a mesh is divided.

/// The estimated `errors` of the intervals of `mesh`, none less than its neighbours' lead one to expect: an
/// estimate may vanish by chance, between a positive and a negative one.
pub(super) fn filled(mesh: &[f64], errors: &[f64]) -> Vec<f64> {
    let length = |i: usize| mesh[i + 1] - mesh[i];
    let expected = |i: usize| {
        let ratio = length(i) * length(i) / (length(i - 1) * length(i + 1));
        // Of order 6: their geometric mean, brought to its length.
        libm::sqrt(errors[i - 1] * errors[i + 1]) * (ratio * ratio * ratio)
    };
    let within = 1..errors.len().saturating_sub(1);
    (0..errors.len())
        .map(|i| match within.contains(&i) {
            true => errors[i].max(expected(i)),
            false => errors[i],
        })
        .collect()
}

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

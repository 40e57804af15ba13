//! Gauss-Legendre points of an interval, of time or of the link, and integration of what is known
//! there.

/// Gauss points of an interval of time.
pub(crate) const STAGES: usize = 6;

/// Coefficients of `q` on an interval: its second derivative is a polynomial through
/// the values at the Gauss points.
pub(crate) const COEFFICIENTS: usize = STAGES + 2;

/// The six Gauss-Legendre points on [0, 1].
pub(crate) const ABSCISSAS: [f64; STAGES] = [
    0.033_765_242_898_423_99,
    0.169_395_306_766_867_74,
    0.380_690_406_958_401_55,
    0.619_309_593_041_598_4,
    0.830_604_693_233_132_3,
    0.966_234_757_101_576,
];

/// The four of them.
pub(crate) const FOUR_ABSCISSAS: [f64; 4] = [
    0.069_431_844_202_973_71,
    0.330_009_478_207_571_87,
    0.669_990_521_792_428_1,
    0.930_568_155_797_026_3,
];

/// `[j]`: coefficients, ascending, of the polynomial that is 1 at point `c[j]` and 0 at the others.
fn lagrange<const N: usize>(c: [f64; N]) -> [[f64; N]; N] {
    let mut lagrange = [[0.0; N]; N];
    for (j, polynomial) in lagrange.iter_mut().enumerate() {
        polynomial[0] = 1.0;
        let mut degree = 0;
        for m in (0..N).filter(|m| *m != j) {
            // times (x - c_m) / (c_j - c_m)
            degree += 1;
            for i in (0..=degree).rev() {
                let below = if i > 0 { polynomial[i - 1] } else { 0.0 };
                polynomial[i] = (below - c[m] * polynomial[i]) / (c[j] - c[m]);
            }
        }
    }
    lagrange
}

/// `[j]`: integral of each of these polynomials from 0 to `x`, taken `order` (1 or 2) times.
fn integrals<const N: usize>(lagrange: &[[f64; N]; N], x: f64, order: i32) -> [f64; N] {
    lagrange.map(|polynomial| {
        let sum = polynomial
            .iter()
            .enumerate()
            .rev()
            .fold(0.0, |sum, (m, p)| {
                let m = m as f64;
                let divisor = if order == 1 {
                    m + 1.0
                } else {
                    (m + 1.0) * (m + 2.0)
                };
                sum * x + p / divisor
            });
        sum * if order == 1 { x } else { x * x }
    })
}

/// Weights of the points `c` for integrals over the unit interval: `[i]` from 0 to point `i`, and to 1.
pub(crate) fn weights<const N: usize>(c: [f64; N]) -> ([[f64; N]; N], [f64; N]) {
    let lagrange = lagrange(c);
    (
        c.map(|x| integrals(&lagrange, x, 1)),
        integrals(&lagrange, 1.0, 1),
    )
}

/// The method's constants, for an interval of unit length.
pub(crate) struct Method {
    /// `lagrange[j]`: coefficients, ascending, of the Lagrange polynomial of point j.
    pub(crate) lagrange: [[f64; STAGES]; STAGES],
    /// `once[s][j]`: its integral from 0 to point s; the last row to 1.
    pub(crate) once: [[f64; STAGES]; STAGES + 1],
    /// The same, integrated twice.
    pub(crate) twice: [[f64; STAGES]; STAGES + 1],
}

impl Method {
    pub(crate) fn new() -> Self {
        let lagrange = lagrange(ABSCISSAS);
        let integral = |order| {
            core::array::from_fn(|s| {
                let x = ABSCISSAS.get(s).copied().unwrap_or(1.0);
                integrals(&lagrange, x, order)
            })
        };
        Self {
            once: integral(1),
            twice: integral(2),
            lagrange,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error of the integrals of 1, x, ... x^(2 N - 1) over the unit interval.
    fn error<const N: usize>(c: [f64; N]) -> f64 {
        let (_, whole) = weights(c);
        let errors = (0..2 * N as i32).map(|degree| {
            let sum: f64 = c.iter().zip(whole).map(|(x, w)| w * x.powi(degree)).sum();
            (sum - 1.0 / f64::from(degree + 1)).abs()
        });
        errors.fold(0.0, f64::max)
    }

    #[test]
    fn points_integrate_what_gauss_says() {
        let (six, four) = (error(ABSCISSAS), error(FOUR_ABSCISSAS));
        // Ascending coefficients of the six cancel two digits.
        assert!(six < 1e-13 && four < 1e-14, "{six:e} {four:e}");
    }

    #[test]
    fn weights_to_a_point_integrate_to_it() {
        let (partial, _) = weights(FOUR_ABSCISSAS);
        for (to, weights) in FOUR_ABSCISSAS.into_iter().zip(partial) {
            let sum: f64 = FOUR_ABSCISSAS
                .iter()
                .zip(weights)
                .map(|(x, w)| w * x * x)
                .sum();
            assert!((sum - to * to * to / 3.0).abs() < 1e-15);
        }
    }
}

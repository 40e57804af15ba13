//! The six Gauss-Legendre points of an interval, of time or of the link, and integration of what is
//! known there.

/// Gauss points of an interval.
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
        let c = ABSCISSAS;
        let mut lagrange = [[0.0; STAGES]; STAGES];
        for (j, polynomial) in lagrange.iter_mut().enumerate() {
            polynomial[0] = 1.0;
            let mut degree = 0;
            for m in (0..STAGES).filter(|m| *m != j) {
                // times (x - c_m) / (c_j - c_m)
                degree += 1;
                for i in (0..=degree).rev() {
                    let below = if i > 0 { polynomial[i - 1] } else { 0.0 };
                    polynomial[i] = (below - c[m] * polynomial[i]) / (c[j] - c[m]);
                }
            }
        }
        let integral = |divisor: fn(f64) -> f64, order: i32| {
            core::array::from_fn(|s| {
                let x = c.get(s).copied().unwrap_or(1.0);
                core::array::from_fn(|j| {
                    let terms = (0..STAGES).rev();
                    let sum =
                        terms.fold(0.0, |sum, m| sum * x + lagrange[j][m] / divisor(m as f64));
                    sum * if order == 1 { x } else { x * x }
                })
            })
        };
        Self {
            once: integral(|m| m + 1.0, 1),
            twice: integral(|m| (m + 1.0) * (m + 2.0), 2),
            lagrange,
        }
    }
}

//! Functions of complex numbers by `libm`. Those of `num-complex` call the platform's
//! mathematics library as soon as any crate of the build wants `num-traits` with `std`.

use nalgebra::Complex;

/// Magnitude.
pub(crate) fn norm(z: Complex<f64>) -> f64 {
    libm::hypot(z.re, z.im)
}

/// Principal logarithm.
pub(super) fn ln(z: Complex<f64>) -> Complex<f64> {
    Complex::new(libm::log(norm(z)), libm::atan2(z.im, z.re))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn they_are_those_of_the_platform_to_rounding(re in -9.0..9.0_f64, im in -9.0..9.0_f64) {
            let z = Complex::new(re, im);
            prop_assert!((norm(z) - z.norm()).abs() < 1e-14 * z.norm());
            prop_assert!((ln(z) - z.ln()).norm() < 1e-13);
        }
    }
}

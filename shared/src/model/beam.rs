//! Link 2 as cubic Hermite beam elements (eq. 24-27).
//!
//! The beam is measured from its chord, so it is pinned at both ends. With `N`
//! equal elements the degrees of freedom are
//! `[w'_0, w_1, w'_1, ..., w_{N-1}, w'_{N-1}, w'_N]`: `2 N` of them, slopes in rad
//! (small, dw/drho) and deflections in m, positive along n(theta20). The paper's
//! "N = 4" is three such elements.
//!
//! Rust cannot yet compute `2 N` from a const `N`, so types carry the number of
//! degrees of freedom `DOF = 2 N`; an odd one does not compile.
//!
//! Glossary: *mode* is an eigenvector of stiffness against mass, normalised to unit
//! modal mass; *modal damping* gives every mode the same damping ratio;
//! `<...>` is the integral over link 2's mass; `B` is the row of shape functions,
//! `w(rho) = B(rho) w`.

use nalgebra::{Cholesky, RealField, SMatrix, SVector};

/// What a beam is made of. All f64, SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamParameters<T> {
    /// Length, m.
    pub length: T,
    /// Mass, uniform, kg.
    pub mass: T,
    /// Bending stiffness EI, N m^2.
    pub bending_stiffness: T,
    /// Inertia that turns with the root's tangent, kg m^2.
    pub root_inertia: T,
    /// Point mass at the tip, kg. It does not move against the chord, so it enters
    /// no matrix of this module; the arm's equations of motion take it.
    pub tip_mass: T,
    /// Inertia that turns with the tip's tangent, kg m^2.
    pub tip_inertia: T,
}

/// The assembled finite-element beam.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam<T: RealField, const DOF: usize> {
    /// What the beam is made of.
    pub parameters: BeamParameters<T>,
    /// Mass matrix `<B'B>` of the translating mass alone: it is what centrifugal
    /// and Coriolis terms see.
    pub translating_mass: SMatrix<T, DOF, DOF>,
    /// Mass matrix with the root and tip inertias added on the end slopes.
    pub mass: SMatrix<T, DOF, DOF>,
    /// Stiffness matrix K.
    pub stiffness: SMatrix<T, DOF, DOF>,
    /// `<B>`: momentum of the deflection.
    pub first_moment: SVector<T, DOF>,
    /// `<rho B>`, with the root and tip inertias on the end slopes: angular
    /// momentum of the deflection about joint 2.
    pub second_moment: SVector<T, DOF>,
}

/// Natural modes of a [`Beam`].
#[derive(Clone, Debug, PartialEq)]
pub struct Modes<T: RealField, const DOF: usize> {
    /// Natural angular frequencies in rad/s, ascending.
    pub angular_frequency: SVector<T, DOF>,
    /// Mode shapes as columns, `shape' M shape = 1`, positive slope at the root.
    pub shape: SMatrix<T, DOF, DOF>,
}

/// Position of the element matrices' four local unknowns (deflection and slope at
/// either end) of element `element` among the beam's, `None` where pinned.
fn degrees_of_freedom(element: usize, elements: usize) -> [Option<usize>; 4] {
    let last = element + 1 == elements;
    let left = 2 * element;
    [
        (element > 0).then(|| left - 1),
        Some(left),
        (!last).then_some(left + 1),
        Some(if last { left + 1 } else { left + 2 }),
    ]
}

impl<T: RealField + Copy, const DOF: usize> Beam<T, DOF> {
    /// Number of elements.
    pub const ELEMENTS: usize = {
        assert!(
            DOF >= 2 && DOF.is_multiple_of(2),
            "DOF must be twice the number of elements"
        );
        DOF / 2
    };

    /// Assembles the matrices of eq. 24-27 from closed-form element integrals.
    ///
    /// `parameters` must be positive in length, mass and stiffness and
    /// not negative elsewhere; other values give matrices without physical meaning.
    pub fn new(parameters: BeamParameters<T>) -> Self {
        let c = nalgebra::convert::<f64, T>;
        let l = parameters.length / c(Self::ELEMENTS as f64);
        let element_mass = parameters.mass / c(Self::ELEMENTS as f64);

        // Local unknowns: deflection and slope at the left end, then at the right.
        let mass = {
            let k = element_mass / c(420.0);
            let (a, b, d, e) = (c(22.0) * l, c(13.0) * l, c(4.0) * l * l, c(3.0) * l * l);
            [
                [c(156.0), a, c(54.0), -b],
                [a, d, b, -e],
                [c(54.0), b, c(156.0), -a],
                [-b, -e, -a, d],
            ]
            .map(|row| row.map(|x| x * k))
        };
        let stiffness = {
            let k = parameters.bending_stiffness / (l * l * l);
            let (a, b, d, e) = (c(12.0), c(6.0) * l, c(4.0) * l * l, c(2.0) * l * l);
            [[a, b, -a, b], [b, d, -b, e], [-a, -b, a, -b], [b, e, -b, d]]
                .map(|row| row.map(|x| x * k))
        };
        let first = {
            let k = element_mass / c(12.0);
            [c(6.0), l, c(6.0), -l].map(|x| x * k)
        };
        // Integral of x B over the element's mass, x from the element's left end.
        let local_second = {
            let k = element_mass * l / c(60.0);
            [c(9.0), c(2.0) * l, c(21.0), c(-3.0) * l].map(|x| x * k)
        };

        let mut beam = Self {
            parameters,
            translating_mass: SMatrix::zeros(),
            mass: SMatrix::zeros(),
            stiffness: SMatrix::zeros(),
            first_moment: SVector::zeros(),
            second_moment: SVector::zeros(),
        };
        for element in 0..Self::ELEMENTS {
            let index = degrees_of_freedom(element, Self::ELEMENTS);
            let offset = l * c(element as f64);
            for (i, row) in index.iter().enumerate() {
                let Some(row) = *row else { continue };
                beam.first_moment[row] += first[i];
                beam.second_moment[row] += local_second[i] + offset * first[i];
                for (j, column) in index.iter().enumerate() {
                    let Some(column) = *column else { continue };
                    beam.translating_mass[(row, column)] += mass[i][j];
                    beam.stiffness[(row, column)] += stiffness[i][j];
                }
            }
        }
        beam.mass = beam.translating_mass;
        for (slope, inertia) in [
            (0, parameters.root_inertia),
            (DOF - 1, parameters.tip_inertia),
        ] {
            beam.mass[(slope, slope)] += inertia;
            beam.second_moment[slope] += inertia;
        }
        beam
    }

    /// Shape functions and their derivative at `rho` (m from joint 2, brought into
    /// the beam): `(B(rho), dB/drho)`, so that `w(rho) = B w`.
    pub fn shape(&self, rho: T) -> (SVector<T, DOF>, SVector<T, DOF>) {
        let c = nalgebra::convert::<f64, T>;
        let l = self.parameters.length / c(Self::ELEMENTS as f64);
        let rho = rho.clamp(T::zero(), self.parameters.length);
        let element = nalgebra::try_convert::<T, f64>(rho / l)
            .map_or(0, |x| x as usize)
            .min(Self::ELEMENTS - 1);
        let x = rho / l - c(element as f64);
        let (x2, x3) = (x * x, x * x * x);
        let value = [
            c(1.0) - c(3.0) * x2 + c(2.0) * x3,
            l * (x - c(2.0) * x2 + x3),
            c(3.0) * x2 - c(2.0) * x3,
            l * (x3 - x2),
        ];
        let slope = [
            c(6.0) * (x2 - x) / l,
            c(1.0) - c(4.0) * x + c(3.0) * x2,
            c(6.0) * (x - x2) / l,
            c(3.0) * x2 - c(2.0) * x,
        ];
        let mut row = SVector::zeros();
        let mut derivative = SVector::zeros();
        for (i, index) in degrees_of_freedom(element, Self::ELEMENTS)
            .iter()
            .enumerate()
        {
            if let Some(index) = *index {
                row[index] += value[i];
                derivative[index] += slope[i];
            }
        }
        (row, derivative)
    }

    /// Geometric stiffness `integral P(rho) dB' dB drho` for the axial force
    /// `P = sum_k coefficients[k] (rho / length)^k`, tension positive, N. A tension
    /// of 1 N is `[1, 0, 0]`. In 1/m times the deflections' units, as K.
    pub fn geometric_stiffness(&self, coefficients: [T; 3]) -> SMatrix<T, DOF, DOF> {
        let c = nalgebra::convert::<f64, T>;
        let l = self.parameters.length / c(Self::ELEMENTS as f64);
        // Four Gauss points integrate the degree 4 + 2 exactly.
        const NODES: [f64; 4] = [
            -0.861_136_311_594_052_6,
            -0.339_981_043_584_856_3,
            0.339_981_043_584_856_3,
            0.861_136_311_594_052_6,
        ];
        const WEIGHTS: [f64; 4] = [
            0.347_854_845_137_453_85,
            0.652_145_154_862_546_1,
            0.652_145_154_862_546_1,
            0.347_854_845_137_453_85,
        ];
        let mut matrix = SMatrix::zeros();
        for element in 0..Self::ELEMENTS {
            for (node, weight) in NODES.iter().zip(WEIGHTS) {
                let rho = l * (c(element as f64) + (c(1.0) + c(*node)) / c(2.0));
                let r = rho / self.parameters.length;
                let force = coefficients[0] + r * (coefficients[1] + r * coefficients[2]);
                let (_, slope) = self.shape(rho);
                matrix += slope * slope.transpose() * (force * c(weight) * l / c(2.0));
            }
        }
        matrix
    }

    /// Natural modes: `K shape = M shape omega^2`.
    ///
    /// By Jacobi's method, which gives the soft modes their own relative accuracy.
    /// (Tridiagonalisation gives all modes the error of the stiffest: with 12 elements
    /// 1e-11 instead of 1e-14 in the first, and 3e-9 in what decides how the link
    /// follows a prescribed tip, `1 - <rho B> shape shape' E` = 2e-5.)
    ///
    /// `None` if the mass matrix is not positive definite (parameters out of range).
    pub fn modes(&self) -> Option<Modes<T, DOF>> {
        let (lower, reduced) = self.reduced_stiffness()?;
        let (eigenvalues, eigenvectors) = jacobi(reduced);
        Self::modes_of(&lower, &eigenvalues, &eigenvectors)
    }

    /// Cholesky factor L of the mass matrix and `L^-1 K L^-T`, whose eigenvalues are
    /// those of K against M.
    fn reduced_stiffness(&self) -> Option<(SMatrix<T, DOF, DOF>, SMatrix<T, DOF, DOF>)> {
        let lower = Cholesky::new(self.mass)?.l();
        let half = lower.solve_lower_triangular(&self.stiffness)?;
        let reduced = lower.solve_lower_triangular(&half.transpose())?;
        let symmetric = (reduced + reduced.transpose()) * nalgebra::convert::<f64, T>(0.5);
        Some((lower, symmetric))
    }

    /// Sorted and normalised modes from the reduced stiffness's eigenpairs.
    fn modes_of(
        lower: &SMatrix<T, DOF, DOF>,
        eigenvalues: &SVector<T, DOF>,
        eigenvectors: &SMatrix<T, DOF, DOF>,
    ) -> Option<Modes<T, DOF>> {
        let mut order = [0; DOF];
        for (i, slot) in order.iter_mut().enumerate() {
            *slot = i;
        }
        order.sort_unstable_by(|&a, &b| {
            eigenvalues[a]
                .partial_cmp(&eigenvalues[b])
                .unwrap_or(core::cmp::Ordering::Equal)
        });
        let shapes: SMatrix<T, DOF, DOF> = lower.tr_solve_lower_triangular(eigenvectors)?;
        let mut modes = Modes::<T, DOF> {
            angular_frequency: SVector::zeros(),
            shape: SMatrix::zeros(),
        };
        for (i, &from) in order.iter().enumerate() {
            modes.angular_frequency[i] = eigenvalues[from].max(T::zero()).sqrt();
            let sign = if shapes[(0, from)] < T::zero() {
                -T::one()
            } else {
                T::one()
            };
            modes.shape.set_column(i, &(shapes.column(from) * sign));
        }
        Some(modes)
    }

    /// Modal damping matrix `D = M shape diag(2 ratio omega) shape' M`, N s/m and
    /// kin: every mode gets the damping ratio `ratio`.
    pub fn damping(&self, modes: &Modes<T, DOF>, ratio: T) -> SMatrix<T, DOF, DOF> {
        let two = nalgebra::convert::<f64, T>(2.0);
        let momentum = self.mass * modes.shape;
        let rates = SMatrix::from_diagonal(&(modes.angular_frequency * (two * ratio)));
        momentum * rates * momentum.transpose()
    }
}

/// Eigenvalues and, as columns, eigenvectors of a symmetric positive definite matrix by
/// cyclic Jacobi rotations.
fn jacobi<T: RealField + Copy, const N: usize>(
    mut a: SMatrix<T, N, N>,
) -> (SVector<T, N>, SMatrix<T, N, N>) {
    /// Convergence is quadratic: 32 unknowns take 8 sweeps.
    const SWEEPS_MAX: usize = 30;
    let mut vectors = SMatrix::<T, N, N>::identity();
    for _ in 0..SWEEPS_MAX {
        let mut rotated = false;
        for p in 0..N {
            for q in p + 1..N {
                let coupling = a[(p, q)];
                let scale = (a[(p, p)].abs() * a[(q, q)].abs()).sqrt();
                if coupling.abs() <= scale * T::default_epsilon() {
                    continue;
                }
                rotated = true;
                let ratio = (a[(q, q)] - a[(p, p)]) / (coupling + coupling);
                let length = ratio.abs() + (ratio * ratio + T::one()).sqrt();
                let tangent = T::one().copysign(ratio) / length;
                let cosine = T::one() / (tangent * tangent + T::one()).sqrt();
                let sine = tangent * cosine;
                for k in 0..N {
                    let (x, y) = (a[(k, p)], a[(k, q)]);
                    a[(k, p)] = cosine * x - sine * y;
                    a[(k, q)] = sine * x + cosine * y;
                }
                for k in 0..N {
                    let (x, y) = (a[(p, k)], a[(q, k)]);
                    a[(p, k)] = cosine * x - sine * y;
                    a[(q, k)] = sine * x + cosine * y;
                    let (x, y) = (vectors[(k, p)], vectors[(k, q)]);
                    vectors[(k, p)] = cosine * x - sine * y;
                    vectors[(k, q)] = sine * x + cosine * y;
                }
                // Zero but for rounding, which must not be rotated again.
                a[(p, q)] = T::zero();
                a[(q, p)] = T::zero();
            }
        }
        if !rotated {
            break;
        }
    }
    (a.diagonal(), vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEEL: BeamParameters<f64> = BeamParameters {
        length: 0.55,
        mass: 0.24,
        bending_stiffness: 0.48,
        root_inertia: 0.0,
        tip_mass: 0.0,
        tip_inertia: 0.0,
    };

    /// Integrates over the beam's mass with a fine Simpson rule per element.
    fn integrate<const DOF: usize>(
        beam: &Beam<f64, DOF>,
        mut f: impl FnMut(f64, &SVector<f64, DOF>, f64),
    ) {
        let l = STEEL.length / (DOF / 2) as f64;
        for element in 0..DOF / 2 {
            let panels = 400;
            for i in 0..=panels {
                let weight = match i {
                    0 => 1.0,
                    i if i == panels => 1.0,
                    i if i % 2 == 1 => 4.0,
                    _ => 2.0,
                };
                // Just inside the element, where shape() picks it.
                let x = (f64::from(i) / f64::from(panels)).clamp(1e-12, 1.0 - 1e-12);
                let rho = l * (element as f64 + x);
                let (b, _) = beam.shape(rho);
                let dm = STEEL.mass / STEEL.length * l / (3.0 * f64::from(panels)) * weight;
                f(rho, &b, dm);
            }
        }
    }

    #[test]
    fn closed_forms_equal_integrals_of_the_shape_functions() {
        let beam = Beam::<f64, 8>::new(STEEL);
        let mut mass = SMatrix::<f64, 8, 8>::zeros();
        let mut first = SVector::<f64, 8>::zeros();
        let mut second = SVector::<f64, 8>::zeros();
        integrate(&beam, |rho, b, dm| {
            mass += b * b.transpose() * dm;
            first += b * dm;
            second += b * (rho * dm);
        });
        assert!((mass - beam.translating_mass).amax() < 1e-10 * mass.amax());
        assert!((first - beam.first_moment).amax() < 1e-10 * first.amax());
        assert!((second - beam.second_moment).amax() < 1e-10 * second.amax());
    }

    #[test]
    fn a_cubic_that_vanishes_at_both_ends_is_represented_exactly() {
        let beam = Beam::<f64, 6>::new(STEEL);
        let w = |x: f64| x * (x - 0.55) * (x + 0.2);
        let slope = |x: f64| 3.0 * x * x + 2.0 * (0.2 - 0.55) * x - 0.11;
        let l = 0.55 / 3.0;
        let q = SVector::<f64, 6>::from([
            slope(0.0),
            w(l),
            slope(l),
            w(2.0 * l),
            slope(2.0 * l),
            slope(0.55),
        ]);
        for i in 0..=50 {
            let rho = 0.55 * f64::from(i) / 50.0;
            let (b, d) = beam.shape(rho);
            assert!((b.dot(&q) - w(rho)).abs() < 1e-14);
            assert!((d.dot(&q) - slope(rho)).abs() < 1e-13);
        }
    }

    #[test]
    fn modes_diagonalise_mass_stiffness_and_damping() {
        let parameters = BeamParameters {
            root_inertia: 3e-5,
            tip_inertia: 1e-5,
            ..STEEL
        };
        let beam = Beam::<f64, 10>::new(parameters);
        let modes = beam.modes().unwrap();
        let identity = modes.shape.transpose() * beam.mass * modes.shape;
        assert!((identity - SMatrix::identity()).amax() < 1e-10);
        let damping = modes.shape.transpose() * beam.damping(&modes, 0.05) * modes.shape;
        for i in 0..10 {
            let omega = modes.angular_frequency[i];
            let k = modes
                .shape
                .column(i)
                .dot(&(beam.stiffness * modes.shape.column(i)));
            assert!((k - omega * omega).abs() < 1e-10 * omega * omega);
            assert!((damping[(i, i)] - 0.1 * omega).abs() < 1e-9 * omega);
            assert!(i == 0 || omega > modes.angular_frequency[i - 1]);
        }
    }

    #[test]
    fn frequencies_approach_the_continuous_beam_from_above() {
        let modes = Beam::<f64, 24>::new(STEEL).modes().unwrap();
        for i in 0..3 {
            let k = (i + 1) as f64 * core::f64::consts::PI / 0.55;
            let exact = k * k * libm::sqrt(0.48 * 0.55 / 0.24);
            let found = modes.angular_frequency[i];
            // Hermite elements: relative error (k l)^4 / 1440.
            let bound = 1.0 + libm::pow(k * 0.55 / 12.0, 4.0) / 1440.0 * 1.1;
            assert!(found > exact && found < exact * bound, "{found} {exact}");
        }
    }

    #[test]
    fn the_euler_load_makes_the_beam_lose_its_stiffness() {
        let beam = Beam::<f64, 12>::new(STEEL);
        let euler = libm::pow(core::f64::consts::PI / 0.55, 2.0) * 0.48;
        assert!((euler - 15.66).abs() < 0.01);
        for (load, stable) in [(0.999, true), (1.001, false)] {
            let k = beam.stiffness + beam.geometric_stiffness([-load * euler, 0.0, 0.0]);
            assert_eq!(Cholesky::new(k).is_some(), stable, "{load}");
        }
    }
}

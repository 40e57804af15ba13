//! The elastic arm as numbers: rigid-body constants and link 2's finite-element
//! beam in modal coordinates, for any number of elements chosen at run time.
//!
//! Simulation and inverse dynamics work on modal coordinates `q` (deflection vector
//! `w = shapes q`, unit modal mass), where mass, stiffness and damping are diagonal:
//! the same finite-element model, an order of magnitude cheaper to evaluate. The
//! planner's boundary-value problem is solved for the nodal `w`, because it is ill
//! conditioned in modal coordinates. The matrices come from [`flexor::model`], the only place where they are assembled.
//!
//! Glossary: *participation* is a mode's share in a quantity, e.g. its slope at the
//! root; *chord* is the line from joint 2 to the tip.

use crate::model::link::{Link, LinkDamping, LinkKind};
use flexor::model::{ArmParameters, Beam, BeamParameters, Kinematics};
use flexor::number::Real;
use nalgebra::{DMatrix, DVector};

/// Largest number of elements that link 2 can be divided into.
pub const ELEMENTS_MAX: usize = 16;

/// An arm with link 2 divided into a number of elements. Vectors have one entry a
/// mode, ascending in frequency.
#[derive(Clone, Debug)]
pub struct ArmModel {
    /// The arm's physical data.
    pub arm: ArmParameters,
    /// Number of beam elements; there are twice as many modes.
    pub elements: usize,
    /// Two-link kinematics.
    pub kinematics: Kinematics<f64>,
    /// Natural angular frequencies of the pinned beam, rad/s.
    pub angular_frequency: Vec<f64>,
    /// Their squares, the modal stiffnesses, 1/s^2.
    pub stiffness: Vec<f64>,
    /// Damping of the modes, 1/s: `2 zeta omega`, or `beta omega^2` where the link's bending is damped.
    pub damping: Vec<f64>,
    /// Slope at the root per modal coordinate (E in modal coordinates).
    pub root_slope: Vec<f64>,
    /// Slope at the tip per modal coordinate.
    pub tip_slope: Vec<f64>,
    /// `<B>` in modal coordinates.
    pub first_moment: Vec<f64>,
    /// `<rho B>` in modal coordinates, with root and tip inertia.
    pub second_moment: Vec<f64>,
    /// Mode shapes as columns: `w = shapes q`.
    pub shapes: DMatrix<f64>,
    /// `q = coordinates w`, the inverse of `shapes`.
    pub coordinates: DMatrix<f64>,
    /// The same beam in nodal coordinates `w`.
    pub nodal: NodalBeam,
    /// Link 2 at its Gauss points, for the equations that hold where it really bends.
    pub link: Link,
    /// Geometric stiffness, in modal coordinates, for a tip tension of 1 N.
    pub geometric_tip: DMatrix<f64>,
    /// Geometric stiffness per unit of axial specific force, 1 m/s^2 towards the tip.
    pub geometric_axial: DMatrix<f64>,
    /// Geometric stiffness per unit of theta20's squared rate (centrifugal).
    pub geometric_centrifugal: DMatrix<f64>,
    /// Inertia of link 1 about joint 1, `m1 r1^2 / 3`, kg m^2.
    pub link1_inertia: f64,
    /// First moment of all that joint 1 carries, for gravity: `m1 r1 / 2 + m2 r1`, kg m.
    pub joint1_moment: f64,
    /// Mass of link 2 with its tip mass, kg.
    pub link2_mass: f64,
    /// First moment `<rho>` of link 2 with its tip mass about joint 2, kg m.
    pub link2_moment: f64,
    /// Inertia `<rho^2>` of link 2 with tip mass, root and tip inertia about joint 2, kg m^2.
    pub link2_inertia: f64,
}

/// Link 2's matrices for nodal deflections and slopes `w` (m, rad), the first of which
/// is the slope at the root; `dof` rows and columns, SI. [`flexor::model::Beam`] tells what
/// they are.
#[derive(Clone, Debug)]
pub struct NodalBeam {
    /// `<B'B>` with root and tip inertia.
    pub mass: DMatrix<f64>,
    /// `<B'B>` without them.
    pub translating_mass: DMatrix<f64>,
    /// Bending stiffness.
    pub stiffness: DMatrix<f64>,
    /// Damping, modal or of bending.
    pub damping: DMatrix<f64>,
    /// `<B>`.
    pub first_moment: DVector<f64>,
    /// `<rho B>`, with root and tip inertia.
    pub second_moment: DVector<f64>,
}

/// What [`ArmModel`] needs of a beam, whatever its number of elements.
struct AnyBeam {
    shapes: DMatrix<f64>,
    angular_frequency: DVector<f64>,
    nodal: NodalBeam,
    /// Geometric stiffness for an axial force of 1, rho/r2 and (rho/r2)^2 newtons.
    geometric: [DMatrix<f64>; 3],
}

/// Evaluates `$body` with the constant `$dof` set to twice the run-time `$elements`;
/// `None` outside 1 to [`ELEMENTS_MAX`].
macro_rules! with_dof {
    ($elements:expr, $dof:ident => $body:expr) => {
        with_dof!(@ $elements, $dof => $body,
            1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16)
    };
    (@ $elements:expr, $dof:ident => $body:expr, $($n:literal)*) => {
        match $elements {
            $($n => {
                const $dof: usize = 2 * $n;
                Some($body)
            })*
            _ => None,
        }
    };
}

impl AnyBeam {
    fn new(parameters: BeamParameters<f64>, damping_ratio: f64, elements: usize) -> Option<Self> {
        with_dof!(elements, DOF => {
            let beam = Beam::<f64, DOF>::new(parameters);
            let modes = beam.modes()?;
            let matrix = |m: &[f64]| DMatrix::from_column_slice(DOF, DOF, m);
            let vector = |v: &[f64]| DVector::from_column_slice(v);
            Self {
                shapes: matrix(modes.shape.as_slice()),
                angular_frequency: vector(modes.angular_frequency.as_slice()),
                nodal: NodalBeam {
                    mass: matrix(beam.mass.as_slice()),
                    translating_mass: matrix(beam.translating_mass.as_slice()),
                    stiffness: matrix(beam.stiffness.as_slice()),
                    damping: matrix(beam.damping(&modes, damping_ratio).as_slice()),
                    first_moment: vector(beam.first_moment.as_slice()),
                    second_moment: vector(beam.second_moment.as_slice()),
                },
                geometric: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
                    .map(|force| matrix(beam.geometric_stiffness(force).as_slice())),
            }
        })
    }
}

/// Data from which no model can be made; [`crate::files::config`] keeps users from it.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
#[error(
    "no finite-element model of link 2 with {elements} elements: 1 to {ELEMENTS_MAX} elements and positive lengths, masses and stiffness are accepted"
)]
pub struct ModelError {
    /// The number of elements asked for.
    pub elements: usize,
}

/// Link 2 of `arm` as a beam.
fn beam_parameters(arm: &ArmParameters) -> BeamParameters<f64> {
    BeamParameters {
        length: arm.link2_length_m,
        mass: arm.link2_mass_kg,
        bending_stiffness: arm.bending_stiffness_nm2,
        root_inertia: arm.root_inertia_kgm2,
        tip_mass: arm.tip_mass_kg,
        tip_inertia: arm.tip_inertia_kgm2,
    }
}

impl ArmModel {
    /// The linear model of `arm` with modal damping and link 2 in `elements` equal elements, 1 to
    /// [`ELEMENTS_MAX`].
    ///
    /// # Errors
    /// [`ModelError`] for another number, or data without a positive definite mass
    /// matrix.
    pub fn new(arm: &ArmParameters, elements: usize) -> Result<Self, ModelError> {
        Self::of_kind(arm, elements, LinkKind::default())
    }

    /// The model of `arm` with link 2 of the given `kind`, in `elements` equal elements, 1 to
    /// [`ELEMENTS_MAX`]. What it has in modal coordinates is that of small deflections.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of_kind(
        arm: &ArmParameters,
        elements: usize,
        kind: LinkKind,
    ) -> Result<Self, ModelError> {
        let mut beam = AnyBeam::new(beam_parameters(arm), arm.damping_ratio, elements)
            .ok_or(ModelError { elements })?;
        let modal = |v: &DVector<f64>| beam.shapes.tr_mul(v).as_slice().to_vec();
        let row = |i: usize| beam.shapes.row(i).iter().copied().collect::<Vec<_>>();
        let dof = 2 * elements;

        // Axial force P(rho) = P_tip + specific force * (mass beyond rho) + centrifugal part,
        // as polynomials in rho / r2.
        let (mass, length, tip_mass) = (arm.link2_mass_kg, arm.link2_length_m, arm.tip_mass_kg);
        let geometric = |c: [f64; 3]| {
            let matrix = (0..3).fold(DMatrix::zeros(dof, dof), |sum, k| {
                sum + &beam.geometric[k] * c[k]
            });
            beam.shapes.tr_mul(&(matrix * &beam.shapes))
        };
        let angular_frequency = beam.angular_frequency.as_slice().to_vec();
        let modes = angular_frequency.iter();
        let (damping, retardation_s) = match kind.damping {
            LinkDamping::Modal => (modes.map(|w| 2.0 * arm.damping_ratio * w).collect(), 0.0),
            LinkDamping::Bending { time_s } => {
                let lowest = 2.0 * arm.damping_ratio / angular_frequency[0];
                let time_s = time_s.unwrap_or(lowest);
                beam.nodal.damping = &beam.nodal.stiffness * time_s;
                (modes.map(|w| time_s * (w * w)).collect(), time_s)
            }
        };
        Ok(Self {
            arm: *arm,
            elements,
            kinematics: Kinematics::new(arm),
            stiffness: angular_frequency.iter().map(|w| w * w).collect(),
            damping,
            link: Link::new(arm, elements, kind, retardation_s, &beam.nodal.damping),
            angular_frequency,
            root_slope: row(0),
            tip_slope: row(dof - 1),
            first_moment: modal(&beam.nodal.first_moment),
            second_moment: modal(&beam.nodal.second_moment),
            geometric_tip: geometric([1.0, 0.0, 0.0]),
            geometric_axial: geometric([tip_mass + mass, -mass, 0.0]),
            geometric_centrifugal: geometric([
                (tip_mass + 0.5 * mass) * length,
                0.0,
                -0.5 * mass * length,
            ]),
            coordinates: beam.shapes.tr_mul(&beam.nodal.mass),
            shapes: beam.shapes,
            nodal: beam.nodal,
            link1_inertia: arm.link1_mass_kg * (arm.link1_length_m * arm.link1_length_m) / 3.0,
            joint1_moment: (0.5 * arm.link1_mass_kg + mass + tip_mass) * arm.link1_length_m,
            link2_mass: mass + tip_mass,
            link2_moment: (0.5 * mass + tip_mass) * length,
            link2_inertia: (mass / 3.0 + tip_mass) * (length * length)
                + arm.root_inertia_kgm2
                + arm.tip_inertia_kgm2,
        })
    }

    /// The same with no more Gauss points on link 2 than a simulation needs: a geometrically exact link's
    /// torques are then true to 6e-6 N m where they are to 5e-9 as it is made, on the paper's task in 0.4 s.
    #[must_use]
    pub fn with_few_points(mut self) -> Self {
        self.link.take_few_points(&self.arm, self.elements);
        self
    }

    /// Number of elastic degrees of freedom, twice the number of elements.
    pub fn dof(&self) -> usize {
        self.stiffness.len()
    }

    /// Slope at the root, rad, of modal coordinates (or its rate, of their rates).
    pub fn slope_at_root(&self, q: &[f64]) -> f64 {
        dot(&self.root_slope, q)
    }

    /// Nodal deflections and slopes (m, rad) of modal coordinates.
    pub fn deflection(&self, q: &[f64]) -> DVector<f64> {
        &self.shapes * DVector::from_column_slice(q)
    }

    /// Deflection (m, along n(theta20)) and slope (rad) of link 2 at `rho` metres from
    /// joint 2, for modal coordinates `q`.
    pub fn deflection_at(&self, q: &[f64], rho: f64) -> [f64; 2] {
        let w = self.deflection(q);
        with_dof!(self.elements, DOF => {
            let (value, slope) = Beam::<f64, DOF>::new(beam_parameters(&self.arm)).shape(rho);
            [value.as_slice(), slope.as_slice()].map(|row| dot(row, w.as_slice()))
        })
        .unwrap_or_default()
    }

    /// The deflection (or its rate) with the modal coordinates `q` of the model
    /// `from`, in this model's modal coordinates: this model's nodes take the
    /// deflection and slope that the other shape has there. That is the projection
    /// with the least bending energy left over, so it excites nothing.
    pub fn project_shape_from(&self, from: &Self, q: &[f64]) -> Vec<f64> {
        let mut nodal = DVector::zeros(self.dof());
        for node in 0..=self.elements {
            let rho = self.arm.link2_length_m * node as f64 / self.elements as f64;
            let [value, slope] = from.deflection_at(q, rho);
            if node == 0 {
                nodal[0] = slope;
            } else if node == self.elements {
                nodal[2 * node - 1] = slope;
            } else {
                nodal[2 * node - 1] = value;
                nodal[2 * node] = slope;
            }
        }
        (&self.coordinates * nodal).as_slice().to_vec()
    }
}

/// The matrix that takes nodal deflections and slopes (m, rad) of `arm`'s link 2 in
/// `elements` elements to its deflection (m, along n(theta20)) at `intervals + 1`
/// equally spaced points of the chord, from joint 2 to the tip. `None` for a number of
/// elements outside 1 to [`ELEMENTS_MAX`].
pub fn deflection_matrix(
    arm: &ArmParameters,
    elements: usize,
    intervals: usize,
) -> Option<DMatrix<f64>> {
    let step = arm.link2_length_m / intervals.max(1) as f64;
    with_dof!(elements, DOF => {
        let beam = Beam::<f64, DOF>::new(beam_parameters(arm));
        let mut matrix = DMatrix::zeros(intervals + 1, DOF);
        for i in 0..=intervals {
            let (value, _) = beam.shape(i as f64 * step);
            matrix.row_mut(i).copy_from_slice(value.as_slice());
        }
        matrix
    })
}

/// Scalar product of constants with variables.
pub(crate) fn dot<T: Real>(constants: &[f64], variables: &[T]) -> T {
    constants
        .iter()
        .zip(variables)
        .fold(T::ZERO, |sum, (c, v)| sum + T::from_f64(*c) * *v)
}

#[cfg(test)]
mod tests {
    use nalgebra::{ComplexField, RealField};

    // A Linux platform's exponential, for one, differs in a tenth of these.
    #[test]
    fn matrices_are_computed_with_libm() {
        let argument = |i: i32| 0.01 + 0.000_737 * f64::from(i);
        for x in (0..20_000).map(argument) {
            for (found, libm) in [
                (ComplexField::sin(x), libm::sin(x)),
                (ComplexField::exp(x), libm::exp(x)),
                (RealField::atan2(x, 2.0), libm::atan2(x, 2.0)),
                (ComplexField::hypot(x, 1.3), libm::hypot(x, 1.3)),
            ] {
                assert_eq!(found.to_bits(), libm.to_bits(), "of {x}");
            }
        }
    }
}

//! Link 2 as the exact equations see it: which of the two models, which damping, and its shape
//! functions at Gauss points.
//!
//! The deflection `w` is cubic Hermite on equal elements, with the nodal values of
//! [`flexor::model::Beam`]; what it is a function of is the *arc length* `s` from joint 2 in the
//! geometric model and the place on the chord in the linear one. All integrals over the link are sums
//! over the Gauss points of its elements. Four are exact for the linear model. The geometric one is planned
//! with six, to 5e-9 N m of torque on the paper's task in 0.4 s, and simulated on the bench with four, to 6e-6
//! N m (five: 2e-7), in two thirds of the time.
//!
//! Glossary: *chord*: the straight line from joint 2 to the tip; *section angle*: the angle of the
//! link's tangent against the chord.

use crate::model::gauss::{ABSCISSAS, FOUR_ABSCISSAS, STAGES, weights};
use flexor::model::ArmParameters;
use nalgebra::DMatrix;

/// Gauss points of an element, at the most.
pub(crate) const POINTS_MAX: usize = STAGES;

/// Those of the linear model, and of whatever has to be fast.
pub(crate) const POINTS_FEW: usize = FOUR_ABSCISSAS.len();

/// Evaluates `$body` with the constant `$points` set to the number of Gauss points of an element of `$link`.
macro_rules! with_points {
    ($link:expr, $points:ident => $body:expr) => {
        if $link.points == $crate::model::link::POINTS_FEW {
            const $points: usize = $crate::model::link::POINTS_FEW;
            $body
        } else {
            const $points: usize = $crate::model::link::POINTS_MAX;
            $body
        }
    };
}
pub(crate) use with_points;

/// How link 2 bends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LinkModel {
    /// Linear elasticity for small deflections: the chord keeps its length.
    #[default]
    Linear,
    /// Geometrically exact: inextensible, with the moment proportional to the curvature. The chord of a
    /// bent link is shorter.
    Geometric,
}

/// The names in files.
const NAMES: [(LinkModel, &str); 2] = [
    (LinkModel::Linear, "linear"),
    (LinkModel::Geometric, "geometric"),
];

impl LinkModel {
    /// The one of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        let named = NAMES.iter().find(|(_, n)| *n == name);
        named.map(|(model, _)| *model)
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => NAMES[0].1,
            Self::Geometric => NAMES[1].1,
        }
    }
}

/// How link 2's vibration is damped.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LinkDamping {
    /// Every mode of the straight link with the arm's damping ratio.
    #[default]
    Modal,
    /// As the material does: the moment is `EI (kappa + time_s kappa')`, kappa the curvature.
    Bending {
        /// Retardation time beta, s; `None` for `2 zeta / omega_1`, with which the lowest mode of the
        /// pinned link has the arm's damping ratio zeta.
        time_s: Option<f64>,
    },
}

/// Link 2's model and damping.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkKind {
    /// How it bends.
    pub model: LinkModel,
    /// How it is damped.
    pub damping: LinkDamping,
}

/// Shape functions at a Gauss point, of those unknowns of the link that its element has: up to four,
/// one after the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Section {
    /// Number of the first of them among the link's unknowns.
    pub(crate) first: usize,
    /// How many there are: the link's ends do not leave the chord.
    pub(crate) count: usize,
    /// Functions of the deflection.
    value: [f64; 4],
    /// Their first derivative by the place, 1/m.
    slope: [f64; 4],
    /// Their second derivative, 1/m^2.
    curvature: [f64; 4],
}

impl Section {
    /// Functions of the deflection.
    pub(crate) fn value(&self) -> &[f64] {
        &self.value[..self.count]
    }

    /// Their first derivative by the place, 1/m.
    pub(crate) fn slope(&self) -> &[f64] {
        &self.slope[..self.count]
    }

    /// Their second derivative, 1/m^2.
    pub(crate) fn curvature(&self) -> &[f64] {
        &self.curvature[..self.count]
    }
}

/// Link 2 at its Gauss points.
#[derive(Clone, Debug)]
pub struct Link {
    /// Which equations.
    pub kind: LinkKind,
    /// Gauss points of an element: [`POINTS_FEW`] or [`POINTS_MAX`].
    pub(crate) points: usize,
    /// Their shape functions, element by element from joint 2 on.
    pub(crate) sections: Vec<Section>,
    /// Integral from an element's beginning to a point, as weights of all its points, m.
    pub(crate) partial: [[f64; POINTS_MAX]; POINTS_MAX],
    /// Integral over an element, m.
    pub(crate) whole: [f64; POINTS_MAX],
    /// Mass of a point, kg.
    pub(crate) mass: [f64; POINTS_MAX],
    /// Bending stiffness EI, N m^2.
    pub(crate) bending_stiffness: f64,
    /// Retardation time of bending damping, s; 0 for modal damping.
    pub(crate) retardation_s: f64,
    /// Matrix of modal damping; empty for bending damping.
    pub(crate) modal_damping: DMatrix<f64>,
}

impl Link {
    /// Link 2 of `arm` in `elements` elements. `retardation_s` is that of bending damping, or there is
    /// modal damping with the matrix `modal_damping`.
    pub(super) fn new(
        arm: &ArmParameters,
        elements: usize,
        kind: LinkKind,
        retardation_s: f64,
        modal_damping: &DMatrix<f64>,
    ) -> Self {
        let modal = kind.damping == LinkDamping::Modal;
        let mut link = Self {
            kind,
            points: 0,
            sections: Vec::new(),
            partial: [[0.0; POINTS_MAX]; POINTS_MAX],
            whole: [0.0; POINTS_MAX],
            mass: [0.0; POINTS_MAX],
            bending_stiffness: arm.bending_stiffness_nm2,
            retardation_s: if modal { 0.0 } else { retardation_s },
            modal_damping: if modal {
                modal_damping.clone()
            } else {
                DMatrix::zeros(0, 0)
            },
        };
        match kind.model {
            LinkModel::Linear => link.take_points(arm, elements, FOUR_ABSCISSAS),
            LinkModel::Geometric => link.take_points(arm, elements, ABSCISSAS),
        }
        link
    }

    /// Takes no more Gauss points than a simulation needs, which finds an acceleration some ten thousand
    /// times a second. `arm` and `elements` are those that it was made of.
    pub(super) fn take_few_points(&mut self, arm: &ArmParameters, elements: usize) {
        if self.points > POINTS_FEW {
            self.take_points(arm, elements, FOUR_ABSCISSAS);
        }
    }

    /// Integrates over the Gauss points `abscissas`, on [0, 1], of each of `elements`.
    fn take_points<const N: usize>(
        &mut self,
        arm: &ArmParameters,
        elements: usize,
        abscissas: [f64; N],
    ) {
        let element_m = arm.link2_length_m / elements as f64;
        let per_metre = arm.link2_mass_kg / arm.link2_length_m;
        let (partial, whole) = weights(abscissas);
        let sections = (0..elements).flat_map(|element| {
            abscissas.map(|x| section(x, element_m, element, element + 1 == elements))
        });
        self.points = N;
        self.sections = sections.collect();
        for (i, weight) in whole.into_iter().enumerate() {
            self.whole[i] = weight * element_m;
            self.mass[i] = weight * element_m * per_metre;
            for (j, weight) in partial[i].into_iter().enumerate() {
                self.partial[i][j] = weight * element_m;
            }
        }
    }

    /// Number of unknowns.
    pub(crate) fn dof(&self) -> usize {
        2 * self.elements()
    }

    /// Number of elements.
    pub(crate) fn elements(&self) -> usize {
        self.sections.len() / self.points
    }
}

/// Cubic Hermite functions at `x`, 0 to 1, of an element of length `l`, m.
fn section(x: f64, l: f64, element: usize, last: bool) -> Section {
    let (x2, x3) = (x * x, x * x * x);
    let value = [
        1.0 - 3.0 * x2 + 2.0 * x3,
        l * (x - 2.0 * x2 + x3),
        3.0 * x2 - 2.0 * x3,
        l * (x3 - x2),
    ];
    let slope = [
        6.0 * (x2 - x) / l,
        1.0 - 4.0 * x + 3.0 * x2,
        6.0 * (x - x2) / l,
        3.0 * x2 - 2.0 * x,
    ];
    let curvature = [
        (12.0 * x - 6.0) / (l * l),
        (6.0 * x - 4.0) / l,
        (6.0 - 12.0 * x) / (l * l),
        (6.0 * x - 2.0) / l,
    ];
    // The unknowns that it has, of deflection and slope at its beginning and at its end.
    let of: &[usize] = match (element == 0, last) {
        (false, false) => &[0, 1, 2, 3],
        (true, false) => &[1, 2, 3],
        (false, true) => &[0, 1, 3],
        (true, true) => &[1, 3],
    };
    let own = |all: [f64; 4]| core::array::from_fn(|i| of.get(i).map_or(0.0, |of| all[*of]));
    Section {
        first: (2 * element).saturating_sub(1),
        count: of.len(),
        value: own(value),
        slope: own(slope),
        curvature: own(curvature),
    }
}

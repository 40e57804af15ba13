//! The bent link against its chord: where its sections are, how they turn, and what bending takes.
//!
//! With `w' = sin(phi)`, phi the section angle, and `C = cos(phi) = sqrt(1 - w'^2)`, a place `s` of the
//! link is `X(s) = integral of C` along the chord, and the chord's length is `L = X(r2)`. The curvature
//! is `kappa = w'' / C`. The linear model has `C = 1`, `X = s` and `kappa = w''`, so one routine serves
//! both:
//!
//! | | linear | geometric |
//! |---|---|---|
//! | dX/ds | 1 | C |
//! | sigma = -d(dX/ds)/dw' | 0 | w'/C |
//! | its rate | 0 | -sigma w'_t |
//! | its acceleration | 0 | -sigma w'_tt - w'_t^2 / C^3 |
//! | kappa = alpha w'', alpha | 1 | 1/C |
//! | dkappa/dw' = gamma | 0 | w'' w' / C^3 |
//! | phi | w' | asin w' |
//! | dphi/dw' | 1 | 1/C |
//!
//! The same integrals over the link's Gauss points are taken for places and, transposed, for the forces
//! that act there ([`crate::model::link_dynamics`]); so virtual work is exact in the discrete system, its
//! mass matrix symmetric and its energy kept.

use crate::model::link::{Link, LinkModel, with_points};
use flexor::number::Real;

/// Nodal deflections and slopes of link 2 (m, rad), their rates and accelerations, as the equations read
/// them: sums with constant coefficients.
pub(crate) trait Nodal<T> {
    /// `sum_i coefficients[i] x[first + i]`, with `x` the unknowns (`order` 0), their rates (1) or their
    /// accelerations (2).
    fn sum(&self, order: usize, first: usize, coefficients: &[f64]) -> T;
}

/// The numbers themselves: the unknowns, their rates, their accelerations, of which `N` are given and
/// the others are zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Given<'a, T, const N: usize>(pub(crate) [&'a [T]; N]);

impl<T: Real, const N: usize> Nodal<T> for Given<'_, T, N> {
    #[inline]
    fn sum(&self, order: usize, first: usize, coefficients: &[f64]) -> T {
        let Some(numbers) = self.0.get(order) else {
            return T::ZERO;
        };
        let terms = coefficients.iter().zip(&numbers[first..]);
        terms.fold(T::ZERO, |sum, (c, x)| sum + x.scaled(*c))
    }
}

/// A section at a Gauss point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BentSection<T> {
    /// Distance from the chord along n(theta20), m, its rate and acceleration.
    pub(crate) off: [T; 3],
    /// Place along the chord from joint 2, m, its rate and acceleration.
    pub(crate) along: [T; 3],
    /// `sigma`, by which a change of the slope shortens the chord; 0 in the linear model.
    pub(crate) shortening: T,
}

/// The angle of an end's section against the chord.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EndAngle<T> {
    /// The angle, rad, its rate and acceleration.
    pub(crate) angle: [T; 3],
    /// Its derivative by the end's slope.
    pub(crate) by_slope: T,
}

/// The bent link.
#[derive(Clone, Debug)]
pub(crate) struct Bent<T> {
    /// Its sections, element by element from joint 2 on.
    pub(crate) sections: Vec<BentSection<T>>,
    /// Length of the chord, m, its rate and acceleration.
    pub(crate) chord: [T; 3],
    /// Section at joint 2.
    pub(crate) root: EndAngle<T>,
    /// Section at the tip.
    pub(crate) tip: EndAngle<T>,
    /// Generalised forces of bending and damping on the unknowns: moments for slopes, N m, forces for
    /// deflections, N.
    pub(crate) elastic: Vec<T>,
}

impl<T: Real> Bent<T> {
    /// `link` straight: memory for [`bend`](Self::bend).
    pub(crate) fn empty(link: &Link) -> Self {
        let end = EndAngle {
            angle: [T::ZERO; 3],
            by_slope: T::ONE,
        };
        Self {
            sections: Vec::with_capacity(link.sections.len()),
            chord: [T::ZERO; 3],
            root: end,
            tip: end,
            elastic: vec![T::ZERO; link.dof()],
        }
    }

    /// `link` with the unknowns `nodal`.
    pub(crate) fn new(link: &Link, nodal: &impl Nodal<T>) -> Self {
        let mut bent = Self::empty(link);
        bent.bend(link, nodal);
        bent
    }

    /// Bends `link`, of as many elements as that which this is for, to the unknowns `nodal`. Where a slope
    /// reaches 1 (a right angle) the geometric model ends, and its numbers are not finite.
    pub(crate) fn bend(&mut self, link: &Link, nodal: &impl Nodal<T>) {
        let n = link.dof();
        self.sections.clear();
        self.chord = [T::ZERO; 3];
        self.root = end_angle(link, nodal, 0);
        self.tip = end_angle(link, nodal, n - 1);
        self.elastic.fill(T::ZERO);
        with_points!(link, POINTS => {
            for element in 0..link.elements() {
                self.element::<POINTS>(link, nodal, element);
            }
        });
        if !link.modal_damping.is_empty() {
            let rows = link.modal_damping.as_slice().chunks_exact(n);
            for (row, elastic) in rows.zip(&mut self.elastic) {
                // Symmetric: columns are rows.
                *elastic += nodal.sum(1, 0, row);
            }
        }
    }

    /// Adds an element, whose beginning the chord has come to.
    fn element<const POINTS: usize>(&mut self, link: &Link, nodal: &impl Nodal<T>, element: usize) {
        let begin = element * POINTS;
        // dX/ds, its rate and acceleration.
        let mut stretches = [[T::ONE, T::ZERO, T::ZERO]; POINTS];
        for (point, stretch) in stretches.iter_mut().enumerate() {
            let section = &link.sections[begin + point];
            let at = |order, functions| nodal.sum(order, section.first, functions);
            let off = [0, 1, 2].map(|order| at(order, section.value()));
            let w2 = at(0, section.curvature());
            let mut shortening = T::ZERO;
            let moment = link.bending_stiffness * link.whole[point];
            let retarded = link.retardation_s;
            let first = &mut self.elastic[section.first..][..section.count];
            match link.kind.model {
                LinkModel::Linear => {
                    let mut kappa = w2;
                    if retarded > 0.0 {
                        kappa += at(1, section.curvature()).scaled(retarded);
                    }
                    let moment = kappa.scaled(moment);
                    for (row, f) in first.iter_mut().zip(section.curvature()) {
                        *row += moment.scaled(*f);
                    }
                }
                LinkModel::Geometric => {
                    let [w1, w1_t, w1_tt] = [0, 1, 2].map(|order| at(order, section.slope()));
                    let cosine = (T::ONE - w1 * w1).sqrt();
                    let alpha = T::ONE / cosine;
                    let cubed = alpha * alpha * alpha;
                    shortening = w1 * alpha;
                    *stretch = [
                        cosine,
                        -(shortening * w1_t),
                        -(shortening * w1_tt) - w1_t * w1_t * cubed,
                    ];
                    let gamma = w2 * w1 * cubed;
                    let mut kappa = alpha * w2;
                    if retarded > 0.0 {
                        let rate = alpha * at(1, section.curvature()) + gamma * w1_t;
                        kappa += rate.scaled(retarded);
                    }
                    let moment = kappa.scaled(moment);
                    let (by_w2, by_w1) = (moment * alpha, moment * gamma);
                    let functions = section.curvature().iter().zip(section.slope());
                    for (row, (f2, f1)) in first.iter_mut().zip(functions) {
                        *row += by_w2.scaled(*f2) + by_w1.scaled(*f1);
                    }
                }
            }
            self.sections.push(BentSection {
                off,
                along: [T::ZERO; 3],
                shortening,
            });
        }
        self.lay_out(link, begin, &stretches);
    }

    /// Lays the sections of an element, the first of which is `begin`, along the chord.
    fn lay_out<const POINTS: usize>(
        &mut self,
        link: &Link,
        begin: usize,
        stretches: &[[T; 3]; POINTS],
    ) {
        // The linear model's chord moves with no section.
        let orders = match link.kind.model {
            LinkModel::Linear => 1,
            LinkModel::Geometric => 3,
        };
        for order in 0..orders {
            let integral = |from: T, weights: &[f64]| {
                let terms = weights[..POINTS].iter().zip(stretches);
                terms.fold(from, |sum, (weight, stretch)| {
                    sum + stretch[order].scaled(*weight)
                })
            };
            let from = self.chord[order];
            for (section, weights) in self.sections[begin..].iter_mut().zip(&link.partial) {
                section.along[order] = integral(from, weights);
            }
            self.chord[order] = integral(from, &link.whole);
        }
    }
}

/// The section angle at an end of `link`, whose slope is the unknown number `slope`.
pub(crate) fn end_angle<T: Real>(link: &Link, nodal: &impl Nodal<T>, slope: usize) -> EndAngle<T> {
    let [w1, w1_t, w1_tt] = [0, 1, 2].map(|order| nodal.sum(order, slope, &[1.0]));
    match link.kind.model {
        LinkModel::Linear => EndAngle {
            angle: [w1, w1_t, w1_tt],
            by_slope: T::ONE,
        },
        LinkModel::Geometric => {
            let cosine = (T::ONE - w1 * w1).sqrt();
            let alpha = T::ONE / cosine;
            let bend = w1 * w1_t * w1_t * alpha * alpha * alpha;
            EndAngle {
                angle: [w1.atan2(cosine), w1_t * alpha, w1_tt * alpha + bend],
                by_slope: alpha,
            }
        }
    }
}

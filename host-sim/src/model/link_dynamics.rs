//! The equations of motion of the arm with a bent link, for the forces that a motion takes.
//!
//! They are the Lagrange equations of the arm whose link 2 is at the places of
//! [`crate::model::bending`]. With `delta = theta20 - theta10`, `c`, `s` its cosine and sine, the
//! acceleration of joint 2 along n(theta20) and e(theta20) is `j_n = r1 (theta10'' c + theta10'^2 s)`,
//! `j_e = r1 (theta10'' s - theta10'^2 c)`, and that of a section, less gravity,
//!
//! ```text
//! A_n = X theta20'' + w_tt + 2 X_t theta20' - w theta20'^2 + j_n - g_n
//! A_e = X_tt - w theta20'' - 2 w_t theta20' - X theta20'^2 + j_e - g_e
//! ```
//!
//! (the tip's with `X = L`, `w = 0`). `S(s) = -(integral of A_e beyond s + m_t A_eL + f_e)` is the
//! section force along the chord, tension positive; `M_r`, `M_t` are the moments that the root's and the
//! tip's inertia take, `J (theta20'' + phi_tt)`; `E = dphi(0)/dw'(0)` in the root slope's row:
//!
//! ```text
//! w:        <A_n N> + integral sigma S N' + bending + E M_r + tip's M_t         = E tau2
//! theta20:  <X A_n - w A_e> + m_t L A_nL + L f_n + M_r + M_t                    = tau2
//! theta10:  J1 theta10'' - (m1 r1/2) n1.g + r1 (c F_n + s F_e) + r1 n1.f        = tau1 - tau2
//! ```
//!
//! with `F = <A> + m_t A_L`. f is the force of the tip on the surface; f_n does no work on the
//! deflection, but f_e, the buckling load, is in S.

use crate::model::arm_model::ArmModel;
use crate::model::bending::Bent;
use crate::model::configuration::Configuration;
use crate::model::link::{Link, LinkModel, with_points};
use flexor::model::JointMotion;
use flexor::number::Real;

/// The forces that a motion takes.
#[derive(Clone, Debug)]
pub(crate) struct Required<T> {
    /// On the unknowns, of which joint 2 gives [`root`](Self::root) times its torque to the first: N m for
    /// slopes, N for deflections.
    pub(crate) elastic: Vec<T>,
    /// What a torque of joint 2 is for the root's slope.
    pub(crate) root: T,
    /// Torques (tau1, tau2), N m.
    pub(crate) torque: [T; 2],
}

/// What the motion of `model`'s arm takes, with the link bent as `bent`, at the joint motion `joint`, with the tip
/// pressing with `force` (N, inertial axes).
pub(crate) fn required<T: Real>(
    model: &ArmModel,
    bent: &Bent<T>,
    joint: &JointMotion<T>,
    configuration: &Configuration<T>,
    force: [T; 2],
) -> Required<T> {
    let mut elastic = vec![T::ZERO; bent.elastic.len()];
    let (root, torque) = required_into(model, bent, joint, configuration, force, &mut elastic);
    Required {
        elastic,
        root,
        torque,
    }
}

/// The same, with the unknowns' forces to `elastic`; what a torque of joint 2 is for the root's slope, and
/// the torques.
pub(crate) fn required_into<T: Real>(
    model: &ArmModel,
    bent: &Bent<T>,
    joint: &JointMotion<T>,
    configuration: &Configuration<T>,
    force: [T; 2],
    elastic: &mut [T],
) -> (T, [T; 2]) {
    let bare = required_bare(model, bent, joint, configuration, force, elastic);
    elastic[0] += bare.root * bare.hub;
    (bare.root, bare.torque())
}

/// Motion of link 2's chord.
struct Frame<T> {
    /// theta20'', rad/s^2.
    acceleration: T,
    /// 2 theta20', rad/s.
    twice_rate: T,
    /// theta20'^2, rad^2/s^2.
    squared_rate: T,
    /// Acceleration of joint 2 less gravity, along n(theta20) and e(theta20), m/s^2.
    joint: [T; 2],
}

impl<T: Real> Frame<T> {
    /// At a joint motion, with link 1 of length `r1`, m.
    #[inline]
    fn new(joint: &JointMotion<T>, configuration: &Configuration<T>, r1: f64) -> Self {
        let Configuration { c, s, g_n, g_e, .. } = *configuration;
        let ([rate1, rate2], [turn1, turn2]) = (joint.rate, joint.acceleration);
        let squared1 = rate1 * rate1;
        Self {
            acceleration: turn2,
            twice_rate: rate2 + rate2,
            squared_rate: rate2 * rate2,
            joint: [
                (turn1 * c + squared1 * s).scaled(r1) - g_n,
                (turn1 * s - squared1 * c).scaled(r1) - g_e,
            ],
        }
    }

    /// A_n and A_e, m/s^2, of a point at the distance `off` from the chord and the place `along` it, with
    /// their rates and accelerations.
    #[inline]
    fn acceleration(&self, [w, w_t, w_tt]: [T; 3], [x, x_t, x_tt]: [T; 3]) -> [T; 2] {
        [
            x * self.acceleration + w_tt + self.twice_rate * x_t - w * self.squared_rate
                + self.joint[0],
            x_tt - w * self.acceleration - self.twice_rate * w_t - x * self.squared_rate
                + self.joint[1],
        ]
    }
}

/// What a motion takes besides what turns with link 2's root.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bare<T> {
    /// What a torque of joint 2 is for the root's slope.
    pub(crate) root: T,
    /// Torque that the root's inertia takes, N m.
    pub(crate) hub: T,
    /// Torques (tau1, tau2) of an arm without it, N m.
    pub(crate) bare: [T; 2],
}

impl<T: Real> Bare<T> {
    /// Torques (tau1, tau2), N m.
    pub(crate) fn torque(&self) -> [T; 2] {
        self.bare.map(|torque| torque + self.hub)
    }
}

/// The same, with what turns with link 2's root kept apart. It has no part in the unknowns' equations once
/// joint 2 gives its torque, but leaves its rounding there: 12 elements with 1e-2 kg m^2 had no plan.
pub(crate) fn required_bare<T: Real>(
    model: &ArmModel,
    bent: &Bent<T>,
    joint: &JointMotion<T>,
    configuration: &Configuration<T>,
    force: [T; 2],
    elastic: &mut [T],
) -> Bare<T> {
    with_points!(model.link, POINTS => {
        bare_of::<T, POINTS>(model, bent, joint, configuration, force, elastic)
    })
}

/// The same for a link with so many Gauss points an element.
fn bare_of<T: Real, const POINTS: usize>(
    model: &ArmModel,
    bent: &Bent<T>,
    joint: &JointMotion<T>,
    configuration: &Configuration<T>,
    force: [T; 2],
    elastic: &mut [T],
) -> Bare<T> {
    let arm = &model.arm;
    let link = &model.link;
    let r1 = arm.link1_length_m;
    let Configuration { c, s, .. } = *configuration;
    let [acceleration1, acceleration2] = joint.acceleration;
    let frame = Frame::new(joint, configuration, r1);

    let n = link.dof();
    let sections = &bent.sections;
    let (chord, root, tip) = (bent.chord, bent.root, bent.tip);
    elastic.copy_from_slice(&bent.elastic);
    let [tip_n, tip_e] = frame.acceleration([T::ZERO; 3], chord);
    let mut sum_n = tip_n.scaled(arm.tip_mass_kg);
    let mut sum_e = tip_e.scaled(arm.tip_mass_kg);
    let mut moment = chord[0] * (sum_n + configuration.along_n2(force));
    // Force along the chord that is needed beyond an element, from the tip inwards.
    let mut beyond = sum_e + configuration.along_e2(force);
    for element in (0..link.elements()).rev() {
        let begin = element * POINTS;
        let mut needed = [T::ZERO; POINTS];
        for point in 0..POINTS {
            let section = &sections[begin + point];
            let [a_n, a_e] = frame.acceleration(section.off, section.along);
            let (f_n, f_e) = (a_n.scaled(link.mass[point]), a_e.scaled(link.mass[point]));
            moment += section.along[0] * f_n - section.off[0] * f_e;
            sum_n += f_n;
            needed[point] = f_e;
            let functions = &link.sections[begin + point];
            let rows = &mut elastic[functions.first..][..functions.count];
            for (row, f) in rows.iter_mut().zip(functions.value()) {
                *row += f_n.scaled(*f);
            }
        }
        if link.kind.model == LinkModel::Geometric {
            pull(link, bent, begin, beyond, &needed, elastic);
        }
        let own = needed.iter().fold(T::ZERO, |sum, f_e| sum + *f_e);
        beyond += own;
        sum_e += own;
    }
    let turned = |inertia: f64, angle: [T; 3]| (acceleration2 + angle[2]).scaled(inertia);
    let root_moment = turned(arm.root_inertia_kgm2, root.angle);
    let tip_moment = turned(arm.tip_inertia_kgm2, tip.angle);
    elastic[n - 1] += tip.by_slope * tip_moment;
    let tau2 = moment + tip_moment;
    let of_link1 = acceleration1.scaled(model.link1_inertia)
        - configuration.g_n1.scaled(0.5 * arm.link1_mass_kg * r1);
    let tau1 = of_link1 + (c * sum_n + s * sum_e + configuration.along_n1(force)).scaled(r1) + tau2;
    Bare {
        root: root.by_slope,
        hub: root_moment,
        bare: [tau1, tau2],
    }
}

/// Takes off the `elastic` forces what the section force along the chord does in the element whose first
/// point is `begin`, with the force `beyond` needed beyond it, and `needed` at its points, N.
fn pull<T: Real, const POINTS: usize>(
    link: &Link,
    bent: &Bent<T>,
    begin: usize,
    beyond: T,
    needed: &[T; POINTS],
    elastic: &mut [T],
) {
    for point in 0..POINTS {
        // The transpose of the integral that lays the sections along the chord.
        let mut pull = beyond.scaled(link.whole[point]);
        for (f_e, weights) in needed.iter().zip(&link.partial) {
            pull += f_e.scaled(weights[point]);
        }
        let pull = bent.sections[begin + point].shortening * pull;
        let functions = &link.sections[begin + point];
        let rows = &mut elastic[functions.first..][..functions.count];
        for (row, f) in rows.iter_mut().zip(functions.slope()) {
            *row -= pull.scaled(*f);
        }
    }
}

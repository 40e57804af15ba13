//! Forward dynamics of the arm with its tip free, in lanes: the equations of
//! [`crate::model::dynamics`] with the tip's force as an input.
//!
//! It differs from [`crate::model::forward`] in that: there the surface is a constraint and its
//! force a result; here the contact is a law of its own. And the model's constants are numbers of
//! lanes, so that each lane is an arm of its own.

use crate::model::arm_model::{ArmModel, dot};
use crate::plant::bench::lanes::Lanes;
use nalgebra::DMatrix;

/// The arms' constants, in lanes: those of [`ArmModel`] and sums of them.
#[derive(Clone, Debug)]
pub(super) struct FreeArm<T> {
    r1: T,
    r2: T,
    gravity: [T; 2],
    first_moment: Vec<T>,
    second_moment: Vec<T>,
    stiffness: Vec<T>,
    damping: Vec<T>,
    root_slope: Vec<T>,
    root_inertia: T,
    /// Slopes of the modes at the tip and the inertia that turns with it; left out where no lane
    /// has any.
    tip: Option<(Vec<T>, T)>,
    /// b.b, b.p and p.p of first and second moments.
    products: [T; 3],
    /// Inertia of link 1 and link 2's mass about joint 1.
    inertia1: T,
    inertia2: T,
    moment1: T,
    moment2: T,
    geometric: Option<Geometric<T>>,
}

/// Geometric stiffness, row by row: per newton at the tip, per specific force, per squared rate.
#[derive(Clone, Debug)]
struct Geometric<T> {
    tip: Vec<T>,
    axial: Vec<T>,
    centrifugal: Vec<T>,
}

/// Working memory of [`FreeArm::forward`].
#[derive(Clone, Debug)]
pub(super) struct Scratch<T> {
    axial: Vec<T>,
}

/// What depends on the angles alone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose<T> {
    /// Directions of link 1 and of link 2's chord.
    pub(super) e: [[T; 2]; 2],
    /// Cosine and sine of theta21.
    c: T,
    s: T,
}

/// What the modal coordinates sum up to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bending<T> {
    b_q: T,
    b_rate: T,
    /// Slope at the root, rad, and its rate.
    pub(super) root: T,
    pub(super) root_rate: T,
    /// q.m q and q.m q' with the translating mass.
    square: T,
    square_rate: T,
    tip: T,
}

/// What acts on the arm besides gravity and elasticity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load<T> {
    /// Torque on link 1, N m, with the reaction of motor 2.
    pub(super) link1: T,
    /// Torque on link 2's root, N m.
    pub(super) root: T,
    /// Force of the tip on the surface, inertial axes, N.
    pub(super) tip: [T; 2],
}

impl<T: Lanes> Pose<T> {
    /// The pose at the angles (theta10, theta20), rad.
    #[inline]
    pub(super) fn at(angle: [T; 2]) -> Self {
        let e = angle.map(|a| {
            let (sine, cosine) = a.sin_cos();
            [cosine, sine]
        });
        Self {
            e,
            c: e[0][0] * e[1][0] + e[0][1] * e[1][1],
            s: e[0][0] * e[1][1] - e[0][1] * e[1][0],
        }
    }
}

impl<T: Lanes> Bending<T> {
    /// Of a link of which nothing but the slope at its root is asked, rad and rad/s.
    #[inline]
    pub(super) fn of_root(root: T, root_rate: T) -> Self {
        let zero = T::ZERO;
        Self {
            b_q: zero,
            b_rate: zero,
            root,
            root_rate,
            square: zero,
            square_rate: zero,
            tip: zero,
        }
    }
}

/// Sum of the products.
#[inline]
fn sum<T: Lanes>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::ZERO, |sum, (a, b)| sum + *a * *b)
}

impl<T: Lanes> FreeArm<T> {
    /// One arm a lane, all of as many elements.
    pub(super) fn new<'a>(model: impl Fn(usize) -> &'a ArmModel, geometric: bool) -> Self {
        let lanes = |value: &dyn Fn(&ArmModel) -> f64| T::from_lanes(|i| value(model(i)));
        let dof = model(0).dof();
        let modes = |value: fn(&ArmModel) -> &Vec<f64>| -> Vec<T> {
            (0..dof).map(|k| lanes(&|m| value(m)[k])).collect()
        };
        let matrix = |value: fn(&ArmModel) -> &DMatrix<f64>| -> Vec<T> {
            (0..dof * dof)
                .map(|k| lanes(&|m| value(m)[(k / dof, k % dof)]))
                .collect()
        };
        let tipped = (0..T::LANES).any(|i| model(i).arm.tip_inertia_kgm2 != 0.0);
        Self {
            r1: lanes(&|m| m.arm.link1_length_m),
            r2: lanes(&|m| m.arm.link2_length_m),
            gravity: [0, 1].map(|axis| lanes(&|m| m.arm.gravity_m_s2[axis])),
            first_moment: modes(|m| &m.first_moment),
            second_moment: modes(|m| &m.second_moment),
            stiffness: modes(|m| &m.stiffness),
            damping: modes(|m| &m.damping),
            root_slope: modes(|m| &m.root_slope),
            root_inertia: lanes(&|m| m.arm.root_inertia_kgm2),
            tip: tipped.then(|| (modes(|m| &m.tip_slope), lanes(&|m| m.arm.tip_inertia_kgm2))),
            products: [
                lanes(&|m| dot(&m.first_moment, &m.first_moment)),
                lanes(&|m| dot(&m.first_moment, &m.second_moment)),
                lanes(&|m| dot(&m.second_moment, &m.second_moment)),
            ],
            inertia1: lanes(&|m| {
                m.link1_inertia + m.link2_mass * m.arm.link1_length_m * m.arm.link1_length_m
            }),
            inertia2: lanes(&|m| m.link2_inertia),
            moment1: lanes(&|m| m.joint1_moment),
            moment2: lanes(&|m| m.link2_moment),
            geometric: geometric.then(|| Geometric {
                tip: matrix(|m| &m.geometric_tip),
                axial: matrix(|m| &m.geometric_axial),
                centrifugal: matrix(|m| &m.geometric_centrifugal),
            }),
        }
    }

    /// Number of modes.
    pub(super) fn dof(&self) -> usize {
        self.stiffness.len()
    }

    /// Torque that accelerates what turns with link 2's root, N m: the root's torque less the
    /// moment that bends the link. `slope` is the derivative of a state.
    pub(super) fn hub_torque(&self, slope: &[T]) -> T {
        let n = self.dof();
        self.root_inertia * (slope[3] + sum(&self.root_slope, &slope[4 + n..4 + 2 * n]))
    }

    /// Working memory.
    pub(super) fn scratch(&self) -> Scratch<T> {
        Scratch {
            axial: vec![T::ZERO; self.dof()],
        }
    }

    /// The tip's position (m) and velocity (m/s) at the links' rates.
    #[inline]
    pub(super) fn tip(&self, pose: &Pose<T>, rate: [T; 2]) -> ([T; 2], [T; 2]) {
        let [e1, e2] = pose.e;
        let (v1, v2) = (self.r1 * rate[0], self.r2 * rate[1]);
        (
            [
                self.r1 * e1[0] + self.r2 * e2[0],
                self.r1 * e1[1] + self.r2 * e2[1],
            ],
            [-(v1 * e1[1]) - v2 * e2[1], v1 * e1[0] + v2 * e2[0]],
        )
    }

    /// The modal coordinates `q` and their rates, summed up.
    #[inline]
    pub(super) fn bending(&self, q: &[T], q_rate: &[T]) -> Bending<T> {
        let root = sum(&self.root_slope, q);
        let root_rate = sum(&self.root_slope, q_rate);
        let mut square = sum(q, q) - self.root_inertia * root * root;
        let mut square_rate = sum(q, q_rate) - self.root_inertia * root * root_rate;
        let mut tip = T::ZERO;
        if let Some((slope, inertia)) = &self.tip {
            tip = sum(slope, q);
            square -= *inertia * tip * tip;
            square_rate -= *inertia * tip * sum(slope, q_rate);
        }
        Bending {
            b_q: sum(&self.first_moment, q),
            b_rate: sum(&self.first_moment, q_rate),
            root,
            root_rate,
            square,
            square_rate,
            tip,
        }
    }

    /// Accelerations (theta10'', theta20''), rad/s^2; those of the modal coordinates are written
    /// to `acceleration`. `bending` is that of `q` and `q_rate`.
    #[inline]
    pub(super) fn forward(
        &self,
        pose: &Pose<T>,
        rate: [T; 2],
        (q, q_rate): (&[T], &[T]),
        bending: &Bending<T>,
        load: &Load<T>,
        (acceleration, scratch): (&mut [T], &mut Scratch<T>),
    ) -> [T; 2] {
        let ([e1, e2], g, f) = (pose.e, self.gravity, load.tip);
        let [along_n1, along_n2] = [e1, e2].map(|e| move |v: [T; 2]| v[1] * e[0] - v[0] * e[1]);
        let along_e2 = |v: [T; 2]| v[0] * e2[0] + v[1] * e2[1];
        let squared = rate[1] * rate[1];
        let centripetal = self.r1 * rate[0] * rate[0];
        let across = along_n2(g) - centripetal * pose.s;
        let specific = along_e2(g) + centripetal * pose.c;
        let lever = self.r1 * pose.c;
        let sway = self.r1 * pose.s;

        // q'' = free - column1 theta10'' - p theta20'', column1 = lever b - sway axial.
        self.free(
            (q, q_rate),
            bending,
            (across, squared, load.root),
            acceleration,
        );
        let [b_b, b_p, p_p] = self.products;
        let (mut b_column, mut p_column) = (lever * b_b, lever * b_p);
        if let Some(geometric) = &self.geometric {
            let axial = &mut scratch.axial;
            geometric.stiffen(q, [along_e2(f), specific, squared], acceleration, axial);
            b_column -= sway * sum(&self.first_moment, axial);
            p_column -= sway * sum(&self.second_moment, axial);
        }
        let b_free = sum(&self.first_moment, acceleration);
        let p_free = sum(&self.second_moment, acceleration);

        let two = T::from_f64(2.0);
        let coupling = self.r1 * (self.moment2 * pose.c - bending.b_q * pose.s);
        let m11 = self.inertia1 - lever * b_column;
        let m12 = coupling - lever * b_p;
        let m21 = coupling - p_column;
        let m22 = self.inertia2 - p_p + bending.square;
        let right1 = self.r1
            * (pose.c * bending.b_q * squared
                + pose.s * (self.moment2 * squared + two * bending.b_rate * rate[1]))
            + self.moment1 * along_n1(g)
            + load.link1
            - lever * b_free
            - self.r1 * along_n1(f);
        let right2 = self.moment2 * across - bending.b_q * specific + load.root
            - two * bending.square_rate * rate[1]
            - p_free
            - self.r2 * along_n2(f);
        let scale = T::ONE / (m11 * m22 - m12 * m21);
        let turn1 = (m22 * right1 - m12 * right2) * scale;
        let turn2 = (m11 * right2 - m21 * right1) * scale;

        self.follow(acceleration, lever * turn1, turn2);
        if self.geometric.is_some() {
            let by1 = sway * turn1;
            for (a, x) in acceleration.iter_mut().zip(&scratch.axial) {
                *a += *x * by1;
            }
        }
        [turn1, turn2]
    }

    /// Takes what the joints' accelerations carry along off the modal accelerations: `across`
    /// (m/s^2, joint 2's across link 2) and `turn` (theta20'', rad/s^2).
    #[inline]
    fn follow(&self, acceleration: &mut [T], across: T, turn: T) {
        for ((a, b), p) in acceleration
            .iter_mut()
            .zip(&self.first_moment)
            .zip(&self.second_moment)
        {
            *a -= *b * across + *p * turn;
        }
    }

    /// Writes the modal accelerations with the joints held to `free`, for the specific force
    /// across link 2, theta20's squared rate and the root's torque.
    #[inline]
    fn free(
        &self,
        (q, q_rate): (&[T], &[T]),
        bending: &Bending<T>,
        (across, squared, torque): (T, T, T),
        free: &mut [T],
    ) {
        let n = free.len();
        let (q, q_rate) = (&q[..n], &q_rate[..n]);
        let (b, k, d, e) = (
            &self.first_moment[..n],
            &self.stiffness[..n],
            &self.damping[..n],
            &self.root_slope[..n],
        );
        // The root's inertia does not translate: it takes no part in the centrifugal force.
        let root = torque - squared * self.root_inertia * bending.root;
        for i in 0..n {
            free[i] = b[i] * across + (squared - k[i]) * q[i] - d[i] * q_rate[i] + e[i] * root;
        }
        if let Some((slope, inertia)) = &self.tip {
            let share = squared * *inertia * bending.tip;
            for (a, l) in free.iter_mut().zip(slope) {
                *a -= share * *l;
            }
        }
    }
}

impl<T: Lanes> Geometric<T> {
    /// Takes the geometric stiffness off the modal accelerations `free`, for the force of the tip
    /// on the surface along link 2, the specific force along it and theta20's squared rate; what
    /// link 1's acceleration adds to it is written to `axial`.
    #[inline]
    fn stiffen(&self, q: &[T], along: [T; 3], free: &mut [T], axial: &mut [T]) {
        let [pressed, specific, squared] = along;
        let n = q.len();
        for i in 0..n {
            let row = |matrix: &[T]| sum(&matrix[i * n..][..n], q);
            axial[i] = row(&self.axial);
            // The tip's force on the surface compresses link 2.
            free[i] +=
                pressed * row(&self.tip) - specific * axial[i] - squared * row(&self.centrifugal);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::configuration::{State, Surface};
    use crate::model::forward::{Actuation, Workspace, forward};
    use crate::testing;

    #[test]
    fn with_the_constraints_force_at_the_tip_it_moves_as_the_constrained_arm() {
        for arm in testing::arms() {
            for geometric in [false, true] {
                let model = ArmModel::new(&arm, 4).unwrap();
                let n = model.dof();
                let mut state = vec![0.9, -0.6, 0.7, -1.3];
                state.extend((0..n).map(|i| 0.02 / (1 + i * i) as f64));
                state.extend((0..n).map(|i| 0.3 / (1 + i) as f64));
                let view = State(state.as_slice());
                let surface = Surface {
                    normal: [0.6, 0.8],
                    offset_m: 0.0,
                };
                let torque = [-3.0, 0.4];
                let drive = Actuation {
                    torque,
                    geometric_stiffness: geometric,
                };
                let mut exact_q = vec![0.0; n];
                let mut workspace = Workspace::new(&model);
                let (exact, force) =
                    forward(&model, &surface, view, &drive, &mut workspace, &mut exact_q);

                let free = FreeArm::<f64>::new(|_| &model, geometric);
                let pose = Pose::at(view.angle());
                let bending = free.bending(view.q(), view.q_rate());
                let load = Load {
                    link1: torque[0] - torque[1],
                    root: torque[1],
                    tip: surface.normal.map(|x| x * force),
                };
                let mut found_q = vec![0.0; n];
                let found = free.forward(
                    &pose,
                    view.rate(),
                    (view.q(), view.q_rate()),
                    &bending,
                    &load,
                    (&mut found_q, &mut free.scratch()),
                );
                let scale = exact_q.iter().fold(1.0_f64, |m, a| m.max(a.abs()));
                for (a, b) in found.iter().zip(exact) {
                    assert!((a - b).abs() < 1e-11 * scale, "{found:?} {exact:?}");
                }
                for (a, b) in found_q.iter().zip(&exact_q) {
                    assert!((a - b).abs() < 1e-11 * scale, "{a} {b}");
                }
            }
        }
    }
}

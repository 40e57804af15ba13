//! Forward dynamics: accelerations and contact force from state and torques, with the tip
//! held on the surface. The equations are those of [`crate::model::dynamics`].

use crate::model::arm_model::{ArmModel, dot};
use crate::model::configuration::{Configuration, State, Surface};
use crate::model::dynamics::{end_inertias, translating, weigh};
use flexor::number::Real;
use nalgebra::DMatrix;

/// What acts on the arm besides gravity, elasticity and the surface.
#[derive(Clone, Copy, Debug)]
pub struct Actuation<T> {
    /// Torques (tau1, tau2) on the joints, friction already taken off, N m.
    pub torque: [T; 2],
    /// Whether the axial force changes the bending stiffness.
    pub geometric_stiffness: bool,
}

/// Accelerations `(theta10'', theta20'')` (rad/s^2) and the contact force along the
/// surface normal (N, pressing positive), for the arm in `state` with its tip held on
/// `surface`, from both sides: the force may come out negative. Modal accelerations are
/// written to `q_acceleration`.
pub fn forward<T: Real>(
    model: &ArmModel,
    surface: &Surface,
    state: State<'_, T>,
    drive: &Actuation<T>,
    q_acceleration: &mut [T],
) -> ([T; 2], T) {
    let c64 = T::from_f64;
    let two = c64(2.0);
    let configuration = Configuration::new(model, state.angle());
    let [rate1, rate2] = state.rate();
    let (q, q_rate) = (state.q(), state.q_rate());
    let [tau1, tau2] = drive.torque;
    let r1 = c64(model.arm.link1_length_m);
    let r2 = c64(model.arm.link2_length_m);
    let s2 = c64(model.link2_moment);
    let (c, s) = (configuration.c, configuration.s);
    let squared = rate2 * rate2;
    let centripetal = r1 * rate1 * rate1;
    let normal = surface.normal.map(T::from_f64);

    // The q equations: q'' = free - column1 theta10'' - p theta20'' - column_f f.
    // `free` is left in q_acceleration.
    let across = configuration.g_n - centripetal * s;
    for i in 0..q.len() {
        q_acceleration[i] = c64(model.first_moment[i]) * across
            + (squared - c64(model.stiffness[i])) * q[i]
            - c64(model.damping[i]) * q_rate[i]
            + c64(model.root_slope[i]) * tau2;
    }
    for (inertia, slope) in end_inertias(model) {
        let share = squared * c64(inertia) * weigh(slope, q);
        for (a, l) in q_acceleration.iter_mut().zip(slope) {
            *a -= share * c64(*l);
        }
    }
    // Axial force: P = -f (n.e2) at the tip, X (mass beyond), X = g_e - A_e, centrifugal.
    let geometric = drive.geometric_stiffness.then(|| {
        let times = |m: &DMatrix<f64>| -> Vec<T> {
            (0..q.len())
                .map(|i| (0..q.len()).fold(T::ZERO, |sum, j| sum + c64(m[(i, j)]) * q[j]))
                .collect()
        };
        let axial = times(&model.geometric_axial);
        let centrifugal = times(&model.geometric_centrifugal);
        let specific = configuration.g_e + centripetal * c;
        for (i, a) in q_acceleration.iter_mut().enumerate() {
            *a -= specific * axial[i] + squared * centrifugal[i];
        }
        (axial, times(&model.geometric_tip))
    });
    // b.column and p.column of the columns above.
    let (b, p) = (&model.first_moment, &model.second_moment);
    let mut b_column1 = r1 * c * c64(dot(b, b));
    let mut p_column1 = r1 * c * c64(dot(b, p));
    let (mut b_column_f, mut p_column_f) = (T::ZERO, T::ZERO);
    if let Some((axial, tip)) = &geometric {
        b_column1 -= r1 * s * weigh(b, axial);
        p_column1 -= r1 * s * weigh(p, axial);
        b_column_f = -(configuration.along_e2(normal) * weigh(b, tip));
        p_column_f = -(configuration.along_e2(normal) * weigh(p, tip));
    }
    let b_free = weigh(b, q_acceleration);
    let p_free = weigh(p, q_acceleration);

    // Two joint equations and the constraint, 3 x 3 in theta10'', theta20'', f.
    let bq = weigh(b, q);
    let bq_rate = weigh(b, q_rate);
    let coupling = r1 * (s2 * c - bq * s);
    let lever = r1 * c;
    let matrix = [
        [
            c64(model.link1_inertia + model.link2_mass * model.arm.link1_length_m.powi(2))
                - lever * b_column1,
            coupling - lever * c64(dot(b, p)),
            r1 * configuration.along_n1(normal) - lever * b_column_f,
        ],
        [
            coupling - p_column1,
            c64(model.link2_inertia - dot(p, p)) + translating(model, q, q),
            r2 * configuration.along_n2(normal) - p_column_f,
        ],
        [
            r1 * configuration.along_n1(normal),
            r2 * configuration.along_n2(normal),
            T::ZERO,
        ],
    ];
    let right = [
        r1 * (c * bq * squared + s * (s2 * squared + two * bq_rate * rate2))
            + c64(model.joint1_moment) * configuration.g_n1
            + tau1
            - tau2
            - lever * b_free,
        s2 * across - bq * (configuration.g_e + centripetal * c) + tau2
            - two * translating(model, q, q_rate) * rate2
            - p_free,
        centripetal * (normal[0] * configuration.e1[0] + normal[1] * configuration.e1[1])
            + r2 * squared * configuration.along_e2(normal),
    ];
    let [acceleration1, acceleration2, force] = solve3(&matrix, &right);

    for (i, a) in q_acceleration.iter_mut().enumerate() {
        *a -= c64(b[i]) * lever * acceleration1 + c64(p[i]) * acceleration2;
    }
    if let Some((axial, tip)) = &geometric {
        for (i, a) in q_acceleration.iter_mut().enumerate() {
            *a +=
                r1 * s * axial[i] * acceleration1 + configuration.along_e2(normal) * tip[i] * force;
        }
    }
    ([acceleration1, acceleration2], force)
}

/// Solves a 3 x 3 system by Cramer's rule; its determinant is that of a mass matrix
/// bordered by a constraint and does not vanish away from singular configurations.
fn solve3<T: Real>(m: &[[T; 3]; 3], b: &[T; 3]) -> [T; 3] {
    let minor = |i: usize, j: usize| {
        let (r, s) = ((i + 1) % 3, (i + 2) % 3);
        let (u, v) = ((j + 1) % 3, (j + 2) % 3);
        m[r][u] * m[s][v] - m[r][v] * m[s][u]
    };
    let determinant = m[0][0] * minor(0, 0) + m[0][1] * minor(0, 1) + m[0][2] * minor(0, 2);
    core::array::from_fn(|j| {
        (b[0] * minor(0, j) + b[1] * minor(1, j) + b[2] * minor(2, j)) / determinant
    })
}

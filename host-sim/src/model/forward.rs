//! Forward dynamics of the linear model: accelerations and contact force from state and torques, with
//! the tip held on the surface. The equations are those of [`crate::model::dynamics`].

use crate::model::arm_model::{ArmModel, dot};
use crate::model::bent_forward::BentArm;
use crate::model::configuration::{Configuration, State, Surface};
use crate::model::dynamics::{end_inertias, translating};
use crate::model::link::LinkModel;
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

/// Memory that the equations work in, so that a simulation allocates none: of the linear model geometric
/// stiffness times deflection, mode by mode, of the geometric one the bent arm.
#[derive(Clone, Debug)]
pub struct Workspace<T> {
    /// The arm of a geometric model.
    pub(crate) bent: Option<BentArm<T>>,
    /// Per unit of axial specific force.
    axial: Vec<T>,
    /// Per unit of theta20's squared rate.
    centrifugal: Vec<T>,
    /// Per unit of tension at the tip.
    tip: Vec<T>,
}

impl<T: Real> Workspace<T> {
    /// For `model`, or another one with as many modes.
    pub fn new(model: &ArmModel) -> Self {
        let modes = || vec![T::ZERO; model.dof()];
        let bends = model.link.kind.model == LinkModel::Geometric;
        Self {
            bent: bends.then(|| BentArm::new(model)),
            axial: modes(),
            centrifugal: modes(),
            tip: modes(),
        }
    }

    /// The chord of `model`'s link 2 in `state`, m, and the angle of its root against the chord, rad; both
    /// with their rates.
    pub fn shape(&mut self, model: &ArmModel, state: State<'_, T>) -> [[T; 2]; 2] {
        match &mut self.bent {
            Some(bent) => bent.shape(model, state),
            None => {
                let root = [state.q(), state.q_rate()].map(|q| dot(&model.root_slope, q));
                [[T::from_f64(model.arm.link2_length_m), T::ZERO], root]
            }
        }
    }

    /// Acceleration of the root's angle against the chord, rad/s^2, for the modal accelerations that
    /// were found last.
    pub fn root_acceleration(&self, model: &ArmModel, q_acceleration: &[T]) -> T {
        match &self.bent {
            Some(bent) => bent.root_acceleration(),
            None => dot(&model.root_slope, q_acceleration),
        }
    }

    /// Multiplies `model`'s geometric stiffnesses with the deflection `q`.
    fn multiply(&mut self, model: &ArmModel, q: &[T]) {
        let times = |matrix: &DMatrix<f64>, product: &mut [T]| {
            for (i, product) in product.iter_mut().enumerate() {
                *product =
                    (0..q.len()).fold(T::ZERO, |sum, j| sum + T::from_f64(matrix[(i, j)]) * q[j]);
            }
        };
        times(&model.geometric_axial, &mut self.axial);
        times(&model.geometric_centrifugal, &mut self.centrifugal);
        times(&model.geometric_tip, &mut self.tip);
    }
}

/// What the equations share at an instant.
struct Instant<T> {
    configuration: Configuration<T>,
    /// The surface's normal.
    normal: [T; 2],
    r1: T,
    r2: T,
    /// theta20'^2.
    squared: T,
    /// `r1 theta10'^2`, the acceleration of joint 2 towards joint 1.
    centripetal: T,
}

/// Accelerations `(theta10'', theta20'')` (rad/s^2) and the contact force along the
/// surface normal (N, pressing positive), for the arm in `state` with its tip held on
/// `surface`, from both sides: the force may come out negative. Modal accelerations are
/// written to `q_acceleration`.
///
/// # Panics
/// If `state`, `q_acceleration` or `workspace` has not `model`'s number of modes.
pub fn forward<T: Real>(
    model: &ArmModel,
    surface: &Surface,
    state: State<'_, T>,
    actuation: &Actuation<T>,
    workspace: &mut Workspace<T>,
    q_acceleration: &mut [T],
) -> ([T; 2], T) {
    let r1 = T::from_f64(model.arm.link1_length_m);
    let [rate1, rate2] = state.rate();
    let instant = Instant {
        configuration: Configuration::new(model, state.angle()),
        normal: surface.normal.map(T::from_f64),
        r1,
        r2: T::from_f64(model.arm.link2_length_m),
        squared: rate2 * rate2,
        centripetal: r1 * rate1 * rate1,
    };
    // The q equations: q'' = free - column1 theta10'' - p theta20'' - column_f f, of which
    // `free` is left in q_acceleration.
    free(model, &instant, state, actuation.torque[1], q_acceleration);
    let geometric = actuation.geometric_stiffness.then(|| {
        workspace.multiply(model, state.q());
        stiffen(&instant, workspace, q_acceleration);
        &*workspace
    });
    let (matrix, right) = joints_and_contact(
        model,
        &instant,
        state,
        actuation.torque,
        geometric,
        q_acceleration,
    );
    let [acceleration1, acceleration2, force] = solve3(&matrix, &right);

    let Configuration { c, s, .. } = instant.configuration;
    let lever = r1 * c;
    let (b, p) = (&model.first_moment, &model.second_moment);
    for (i, a) in q_acceleration.iter_mut().enumerate() {
        *a -= T::from_f64(b[i]) * lever * acceleration1 + T::from_f64(p[i]) * acceleration2;
    }
    if let Some(Workspace { axial, tip, .. }) = geometric {
        let along = instant.configuration.along_e2(instant.normal);
        for (i, a) in q_acceleration.iter_mut().enumerate() {
            *a += r1 * s * axial[i] * acceleration1 + along * tip[i] * force;
        }
    }
    ([acceleration1, acceleration2], force)
}

/// The part of the q equations without accelerations, contact force and geometric
/// stiffness.
fn free<T: Real>(
    model: &ArmModel,
    instant: &Instant<T>,
    state: State<'_, T>,
    tau2: T,
    q_acceleration: &mut [T],
) {
    let c64 = T::from_f64;
    let (q, q_rate) = (state.q(), state.q_rate());
    let Instant { squared, .. } = *instant;
    let across = instant.across();
    for i in 0..q.len() {
        q_acceleration[i] = c64(model.first_moment[i]) * across
            + (squared - c64(model.stiffness[i])) * q[i]
            - c64(model.damping[i]) * q_rate[i]
            + c64(model.root_slope[i]) * tau2;
    }
    for (inertia, slope) in end_inertias(model) {
        let turned = squared * c64(inertia) * dot(slope, q);
        for (a, l) in q_acceleration.iter_mut().zip(slope) {
            *a -= turned * c64(*l);
        }
    }
}

/// Takes off what the axial force does to the q equations. It is P = -f (n.e2) at the tip,
/// X (mass beyond) with X = g_e - A_e, and centrifugal; parts of P with an acceleration or f
/// in them are left for [`joints_and_contact`].
fn stiffen<T: Real>(instant: &Instant<T>, workspace: &Workspace<T>, q_acceleration: &mut [T]) {
    let specific = instant.specific();
    for (i, a) in q_acceleration.iter_mut().enumerate() {
        *a -= specific * workspace.axial[i] + instant.squared * workspace.centrifugal[i];
    }
}

impl<T: Real> Instant<T> {
    /// Specific force on link 2 across it, m/s^2, without accelerations.
    fn across(&self) -> T {
        self.configuration.g_n - self.centripetal * self.configuration.s
    }

    /// Specific force on link 2 along it, m/s^2, without accelerations.
    fn specific(&self) -> T {
        self.configuration.g_e + self.centripetal * self.configuration.c
    }
}

/// The two joint equations and the constraint, with the q equations (`free`: what
/// [`free`] and [`stiffen`] leave) put into them: 3 x 3 in theta10'', theta20'', f, and the
/// right side.
fn joints_and_contact<T: Real>(
    model: &ArmModel,
    instant: &Instant<T>,
    state: State<'_, T>,
    torque: [T; 2],
    geometric: Option<&Workspace<T>>,
    free: &[T],
) -> ([[T; 3]; 3], [T; 3]) {
    let c64 = T::from_f64;
    let Instant {
        configuration,
        normal,
        r1,
        r2,
        squared,
        centripetal,
    } = *instant;
    let Configuration { c, s, .. } = configuration;
    let (b, p) = (&model.first_moment, &model.second_moment);
    // b.column and p.column of the q equations' columns.
    let mut b_column1 = r1 * c * c64(dot(b, b));
    let mut p_column1 = r1 * c * c64(dot(b, p));
    let (mut b_column_f, mut p_column_f) = (T::ZERO, T::ZERO);
    if let Some(Workspace { axial, tip, .. }) = geometric {
        b_column1 -= r1 * s * dot(b, axial);
        p_column1 -= r1 * s * dot(p, axial);
        b_column_f = -(configuration.along_e2(normal) * dot(b, tip));
        p_column_f = -(configuration.along_e2(normal) * dot(p, tip));
    }
    let (q, q_rate, rate2) = (state.q(), state.q_rate(), state.rate()[1]);
    let bq = dot(b, q);
    let two = c64(2.0);
    let s2 = c64(model.link2_moment);
    let coupling = r1 * (s2 * c - bq * s);
    let lever = r1 * c;
    let length = model.arm.link1_length_m;
    let matrix = [
        [
            c64(model.link1_inertia + model.link2_mass * (length * length)) - lever * b_column1,
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
    let [tau1, tau2] = torque;
    let right = [
        r1 * (c * bq * squared + s * (s2 * squared + two * dot(b, q_rate) * rate2))
            + c64(model.joint1_moment) * configuration.g_n1
            + tau1
            - tau2
            - lever * dot(b, free),
        s2 * instant.across() - bq * instant.specific() + tau2
            - two * translating(model, q, q_rate) * rate2
            - dot(p, free),
        centripetal * (normal[0] * configuration.e1[0] + normal[1] * configuration.e1[1])
            + r2 * squared * configuration.along_e2(normal),
    ];
    (matrix, right)
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

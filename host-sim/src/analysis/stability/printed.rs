//! Eq. 21-23 as the paper prints them: `H1 X' + H2 X = 0` with
//! `X = [w', w, e_f, integral of e_f]`, for comparison with [`super::linear`].
//!
//! What the print leaves out or gets wrong, line by line:
//!
//! - the joint angles' deviations. The angles are held at their planned values, so the
//!   tangential mode is missing, and the link's modes are those of a link whose chord stands
//!   still;
//! - with the angles gone there are as many equations as before and fewer unknowns, and
//!   `e_f` and its integral count as independent of each other (no row says that one is
//!   the other's derivative). With K_DF = 0 the column of `e_f` vanishes altogether;
//! - `a`, `b` and `c` stand in the beam's rows, whose torque is tau2, with `s1`; tau2 has
//!   `s2`, and the contact force does no work on a beam that is pinned at both ends, so
//!   that the `1 +` has no place there;
//! - `c` in link 1's row has `s2` for `s1`; K_w is missing in link 2's row; `omega <rho B>`
//!   there has the unit of a momentum among torques;
//! - filters, sampling and hold, which decide how large K_w and K_PF may be.
//!
//! So its eigenvalues say little about the loop: with the demo's gains, stable in every
//! simulation, they have pairs that grow (docs/gains.md). They are here to show that.

use super::complex::norm;
use super::linear::OperatingPoint;
use crate::plant::spread::PlantVariant;
use flexor::control::{ForceProjection, PaperParameters};
use nalgebra::{Complex, DMatrix};

/// The matrices of eq. 23, in modal coordinates of the link: `X` and the link's rows are
/// those of the paper transformed with the modes, which leaves eigenvalues as they are.
#[derive(Clone, Debug)]
pub struct Printed {
    /// Matrix of X'.
    pub h1: DMatrix<f64>,
    /// Matrix of X.
    pub h2: DMatrix<f64>,
}

impl Printed {
    /// Eq. 23 with the gains of `law` for `variant` at `point`. `normal_angle` is the
    /// direction of the surface's normal, rad; `angle` and `rate` are theta10 and
    /// theta20, rad, and their rates, rad/s. `s2` is the one that the law uses.
    pub fn new(
        variant: &PlantVariant,
        law: &PaperParameters,
        normal_angle: f64,
        angle: [f64; 2],
        rate: [f64; 2],
    ) -> Self {
        let model = &variant.model;
        let n = model.dof();
        let (r1, r2) = (model.arm.link1_length_m, model.arm.link2_length_m);
        let lever = [
            r1 * libm::sin(normal_angle - angle[0]),
            r2 * libm::sin(normal_angle - angle[1]),
        ];
        let s1 = lever[0] + lever[1];
        let s2 = match law.force_projection {
            ForceProjection::JacobianTranspose => lever[1],
            ForceProjection::AsPrinted => lever[0],
        };
        let (sin_elbow, cos_elbow) = libm::sincos(angle[1] - angle[0]);
        let omega = rate[1];
        let (kd, kp, ki) = (
            law.force_derivative_s,
            law.force_proportional,
            law.force_integral_per_s,
        );
        let (a, b, c) = (-s1 * kd, -s1 * (1.0 + kp), -s2 * ki);
        let (e, f, g) = (-s2 * kd, -s2 * (1.0 + kp), -s2 * ki);
        let size = 2 * n + 2;
        let (mut h1, mut h2) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
        let (slope, first, second) = (&model.root_slope, &model.first_moment, &model.second_moment);
        for i in 0..n {
            h1[(i, i)] = 1.0;
            h1[(i, n + i)] = model.damping[i];
            for j in 0..n {
                h1[(i, n + j)] += law.slope_rate_nms_rad * slope[i] * slope[j];
            }
            h1[(i, 2 * n)] = a * slope[i];
            h1[(i, 2 * n + 1)] = b * slope[i];
            h2[(i, n + i)] = model.stiffness[i] - omega * omega;
            h2[(i, 2 * n + 1)] = c * slope[i];
            h1[(n + i, n + i)] = 1.0;
            h2[(n + i, i)] = -1.0;
            h1[(2 * n, i)] = second[i] + r1 * cos_elbow * first[i];
            h1[(2 * n, n + i)] = -2.0 * r1 * omega * sin_elbow * first[i];
            h2[(2 * n, n + i)] =
                -(r1 * sin_elbow * omega * first[i] + r1 * omega * omega * second[i]);
            h1[(2 * n + 1, i)] = second[i];
            h2[(2 * n + 1, n + i)] = omega * second[i];
        }
        h1[(2 * n, 2 * n)] = a;
        h1[(2 * n, 2 * n + 1)] = b;
        h2[(2 * n, 2 * n + 1)] = c;
        h1[(2 * n + 1, 2 * n)] = e;
        h1[(2 * n + 1, 2 * n + 1)] = f;
        h2[(2 * n + 1, 2 * n + 1)] = g;
        Self { h1, h2 }
    }

    /// As [`new`](Self::new), at an operating point of the linearisation.
    pub fn at(
        variant: &PlantVariant,
        law: &PaperParameters,
        normal_angle: f64,
        point: &OperatingPoint,
    ) -> Option<Self> {
        let model = &variant.model;
        let m = point.state.len() / 2;
        let (s, speed) = (point.state[0], point.state[m]);
        let normal = point.surface.normal;
        let tip = [0, 1].map(|i| point.surface.offset_m * normal[i] + s * point.along[i]);
        let velocity = point.along.map(|a| a * speed);
        let joint = model
            .kinematics
            .inverse_motion(tip, velocity, [0.0; 2], model.arm.elbow)
            .ok()?;
        Some(Self::new(
            variant,
            law,
            normal_angle,
            joint.angle,
            joint.rate,
        ))
    }

    /// Whether eq. 23 has as many independent columns as unknowns; without K_DF it has
    /// not.
    pub fn is_square(&self) -> bool {
        let column = self.h1.ncols() - 2;
        self.h1.column(column).amax() > 0.0
    }

    /// Finite eigenvalues, 1/s, slowest first. Without K_DF the column of e_f, which is
    /// zero, and link 1's row are left out, as one of the rows must be.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        let (mut h1, mut h2) = (self.h1.clone(), self.h2.clone());
        if !self.is_square() {
            let at = h1.ncols() - 2;
            (h1, h2) = (
                h1.remove_row(at).remove_column(at),
                h2.remove_row(at).remove_column(at),
            );
        }
        // h1 may be singular; with p = shift h1 + h2, each eigenvalue u of p^-1 h1 is that
        // of the pair by lambda = shift - 1/u. A shift in the modes' range that is none.
        let shift = 100.3 * 2.0_f64.sqrt();
        let p = &h1 * shift + &h2;
        let Some(matrix) = p.lu().solve(&h1) else {
            return vec![];
        };
        let mut poles: Vec<Complex<f64>> = super::eigenvalues(matrix)
            .into_iter()
            // Rounding makes something of the infinite ones.
            .filter(|u| norm(*u) > 1e-9 && norm(*u).is_finite())
            .map(|u| -u.inv() + shift)
            .collect();
        super::linear::sort(&mut poles);
        poles
    }
}

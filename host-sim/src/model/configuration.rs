//! Where the arm is: its state, the configuration that follows from its angles, and the
//! surface that its tip touches.

use crate::model::arm_model::ArmModel;
use flexor::number::Real;

/// Sines, cosines and gravity at a configuration.
#[derive(Clone, Copy, Debug)]
pub struct Configuration<T> {
    /// e(theta10), the direction of link 1.
    pub e1: [T; 2],
    /// e(theta20), the direction of link 2's chord.
    pub e2: [T; 2],
    /// cos(theta21).
    pub c: T,
    /// sin(theta21).
    pub s: T,
    /// Gravity along n(theta10), m/s^2.
    pub g_n1: T,
    /// Gravity along n(theta20), m/s^2.
    pub g_n: T,
    /// Gravity along e(theta20), m/s^2.
    pub g_e: T,
}

impl<T: Real> Configuration<T> {
    /// The configuration with the angles (theta10, theta20), rad.
    pub fn new(model: &ArmModel, angle: [T; 2]) -> Self {
        let [e1, e2] = angle.map(|angle| [angle.cos(), angle.sin()]);
        Self::towards(model, e1, e2)
    }

    /// The configuration with link 1 and link 2's chord along the unit vectors `e1` and `e2`.
    #[inline]
    pub fn towards(model: &ArmModel, e1: [T; 2], e2: [T; 2]) -> Self {
        let g = model.arm.gravity_m_s2.map(T::from_f64);
        Self {
            e1,
            e2,
            c: e1[0] * e2[0] + e1[1] * e2[1],
            s: e1[0] * e2[1] - e1[1] * e2[0],
            g_n1: g[1] * e1[0] - g[0] * e1[1],
            g_n: g[1] * e2[0] - g[0] * e2[1],
            g_e: g[0] * e2[0] + g[1] * e2[1],
        }
    }

    /// Component of `v` along n(theta10).
    pub fn along_n1(&self, v: [T; 2]) -> T {
        v[1] * self.e1[0] - v[0] * self.e1[1]
    }

    /// Component of `v` along n(theta20).
    pub fn along_n2(&self, v: [T; 2]) -> T {
        v[1] * self.e2[0] - v[0] * self.e2[1]
    }

    /// Component of `v` along e(theta20).
    pub fn along_e2(&self, v: [T; 2]) -> T {
        v[0] * self.e2[0] + v[1] * self.e2[1]
    }
}

/// A rigid frictionless surface that the tip slides on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Unit normal in inertial axes, pointing into the surface: a pressing tip
    /// pushes along it.
    pub normal: [f64; 2],
    /// `normal . x` of every point of the surface, m.
    pub offset_m: f64,
}

/// State of the arm: angles, rates, modal coordinates and their rates, in one vector
/// `[theta10, theta20, theta10', theta20', q..., q'...]`.
#[derive(Clone, Copy, Debug)]
pub struct State<'a, T>(pub &'a [T]);

impl<'a, T: Real> State<'a, T> {
    /// (theta10, theta20), rad.
    pub fn angle(&self) -> [T; 2] {
        [self.0[0], self.0[1]]
    }

    /// Their rates, rad/s.
    pub fn rate(&self) -> [T; 2] {
        [self.0[2], self.0[3]]
    }

    /// Modal coordinates.
    pub fn q(&self) -> &'a [T] {
        &self.0[4..2 + self.0.len() / 2]
    }

    /// Rates of the modal coordinates, 1/s.
    pub fn q_rate(&self) -> &'a [T] {
        &self.0[2 + self.0.len() / 2..]
    }
}

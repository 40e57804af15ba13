//! What the tip does to the surface: the planned normal force, and the friction that it meets.
//!
//! Friction takes no part in what the tip shall do, but in what that costs: the tip drags the
//! surface along its path with `mu f tanh(s / s_0)`, `f` the normal force and `s` the way that it has
//! come, and the torques, the link's shape and its motion carry it. So tip and surface give a little
//! before they slide, by `s_0`, and where the tip stops the friction that has bent it stays: of a
//! friction that follows the speed instead, `tanh(v / v_s)`, both ends of a path are wrong
//! (docs/bench.md has figures). Where the path starts there is none yet.
//!
//! The moment that joint 2 needs is `s2 f_n + c2 f_t` and what else it moves, with
//! `|s2| = r2 |sin(psi - theta20)|` and `|c2| = r2 |cos(psi - theta20)|`, `psi` the direction of the
//! normal: with friction, a moment changes the force by `1 / (s2 (1 +- mu |c2/s2|))`. Where
//! `mu |c2/s2|` comes near 1, dragged against its slope, the tip bites: force feedback found
//! without friction has too much gain there, and from 1 on the tip jams.

/// Friction between tip and surface, as the plan counts on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFriction {
    /// Its coefficient `mu`, not negative; 0 for none.
    pub coefficient: f64,
    /// Way `s_0` over which it sets in, m, positive.
    pub way_m: f64,
}

impl Default for SurfaceFriction {
    /// None.
    fn default() -> Self {
        Self {
            coefficient: 0.0,
            way_m: 1e-4,
        }
    }
}

/// Friction times |c2/s2| up to which force feedback has gain to spare: the examples' gains are
/// stable with half as much again.
pub const FRICTION_SHARE_MAX: f64 = 0.55;

/// Force of the tip on the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TipForce {
    /// Along the normal, into the surface, N.
    pub normal: f64,
    /// Along the path, from its start to its end, N: the friction that the tip overcomes.
    pub along: f64,
}

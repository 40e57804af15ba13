//! The real surface: how deep a point is in it, and in which direction it is pushed out.
//!
//! The planned surface is a plane, `n0 . x = offset`, with `n0` pointing into it. The real one
//! lies `h(u)` deeper, `u = t0 . x` along `t0 = (n0_y, -n0_x)` (the x axis where `n0` points
//! down):
//!
//! ```text
//! h(u) = raise + slope (u - reference) + waviness sin(2 pi u / wavelength + phase)
//! p    = (n0 . x - offset - h) / sqrt(1 + h'^2)          depth, positive inside
//! ```
//!
//! Steps, holes and ends are cut out of that solid, as intersections and unions of half planes:
//! with `p` the depth so far, a raise `a`, a drop `b` and walls of depth `w0` and `w1`,
//! `p -> min(p + a, max(w0, w1, p - b))`. All are continuous, walls may be vertical, and a tip that
//! meets a wall from the side is pushed back sideways.
//!
//! **Direction.** The contact pushes along the gradient of `p`, all of it, including the share of
//! the curvature: the spring's force is then the derivative of `kc p^2 / 2`, and no path along the
//! surface, around an edge or into a hole and out again, gains energy. The gradient is the unit
//! normal but for the product of depth and curvature (1e-4 for 0.1 mm and 1 /m).

use crate::model::configuration::Surface;
use crate::plant::bench::lanes::Lanes;

/// Where the real surface departs from a smooth one. Places are along `t0`, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SurfaceFeature {
    /// From `at_m` on the surface lies `drop_m` deeper (negative: higher), after a wall `wall_m`
    /// long that slopes down (or up); 0 for a vertical one.
    Step {
        /// Where the wall begins, m.
        at_m: f64,
        /// How much deeper the surface is behind it, m.
        drop_m: f64,
        /// Length of the wall along the surface, m.
        wall_m: f64,
    },
    /// A hole with a flat bottom.
    Hole {
        /// Rim where it begins, m.
        from_m: f64,
        /// Rim where it ends, m.
        to_m: f64,
        /// Depth of its bottom, m, positive.
        depth_m: f64,
        /// Length of either wall along the surface, m; 0 for vertical walls.
        wall_m: f64,
    },
    /// Before `at_m` there is no surface.
    Begin {
        /// The edge, m.
        at_m: f64,
    },
    /// Behind `at_m` there is no surface.
    End {
        /// The edge, m.
        at_m: f64,
    },
}

/// The real surface against the planned one.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceProfile {
    /// The planned surface.
    pub plane: Surface,
    /// How much deeper the real one is at `reference_m`, m.
    pub raise_m: f64,
    /// Tangent of its tilt: how much deeper it becomes a metre along `t0`.
    pub slope: f64,
    /// Place along `t0` about which it is tilted, m.
    pub reference_m: f64,
    /// Amplitude of its waviness, m.
    pub waviness_m: f64,
    /// Wavelength, m, positive.
    pub wavelength_m: f64,
    /// Phase at 0, rad.
    pub phase_rad: f64,
    /// Steps, holes and ends, each cut out of what those before it left.
    pub features: Vec<SurfaceFeature>,
}

impl SurfaceProfile {
    /// The planned surface itself.
    pub fn flat(plane: Surface) -> Self {
        Self {
            plane,
            raise_m: 0.0,
            slope: 0.0,
            reference_m: 0.0,
            waviness_m: 0.0,
            wavelength_m: 0.1,
            phase_rad: 0.0,
            features: vec![],
        }
    }

    /// The smooth surface: this one without its features.
    pub(super) fn without_features(&self) -> Self {
        Self {
            features: vec![],
            ..self.clone()
        }
    }

    /// Place along the surface, m, of a point (m).
    pub fn along(&self, point: [f64; 2]) -> f64 {
        let n = self.plane.normal;
        n[1] * point[0] - n[0] * point[1]
    }

    /// The point `depth_m` inside the real surface at the place `along_m`, by Newton's method
    /// from the smooth surface; `None` where there is no such point, behind an edge or beside a
    /// wall.
    pub fn point(&self, along_m: f64, depth_m: f64) -> Option<[f64; 2]> {
        let shape = SurfaceShape::<f64>::new(|_| self);
        let n = self.plane.normal;
        let at = |deep: f64| {
            let into = self.plane.offset_m + deep;
            [n[1] * along_m + n[0] * into, n[1] * into - n[0] * along_m]
        };
        let mut deep = shape.smooth(along_m).0;
        for _ in 0..50 {
            let point = at(deep);
            let found = shape.depth(point);
            let missing = depth_m - found.depth;
            if missing.abs() < 1e-15 {
                return Some(point);
            }
            deep += missing / (found.normal[0] * n[0] + found.normal[1] * n[1]);
        }
        let point = at(deep);
        let left = shape.depth(point).depth - depth_m;
        (left.abs() < 1e-12).then_some(point)
    }
}

/// Depth in the surface, and the way out of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depth<T> {
    /// Depth, m, positive inside.
    pub(super) depth: T,
    /// Its gradient in inertial axes: the normal into the surface.
    pub(super) normal: [T; 2],
}

impl<T: Lanes> Depth<T> {
    fn smaller(self, other: Self) -> Self {
        self.take(other, other.depth.below(self.depth))
    }

    fn larger(self, other: Self) -> Self {
        self.take(other, self.depth.below(other.depth))
    }

    fn take(self, other: Self, mask: T::Mask) -> Self {
        Self {
            depth: T::select(mask, other.depth, self.depth),
            normal: [0, 1].map(|i| T::select(mask, other.normal[i], self.normal[i])),
        }
    }

    fn deeper_by(self, length: T) -> Self {
        Self {
            depth: self.depth + length,
            ..self
        }
    }
}

/// A half plane in the coordinates (place along the surface, depth): `along u + into p + offset`.
#[derive(Clone, Copy, Debug)]
struct Wall<T> {
    along: T,
    into: T,
    offset: T,
}

impl Wall<f64> {
    /// No wall: a half plane that nothing is in.
    const NONE: Self = Self {
        along: 0.0,
        into: 0.0,
        offset: -1e9,
    };
    /// A half plane whose border everything is on.
    const NEUTRAL: Self = Self {
        along: 0.0,
        into: 0.0,
        offset: 0.0,
    };

    /// Solid on the far (`direction` 1) or near (-1) side of the place `at`, behind a wall that
    /// goes from there at depth 0 over `run` along the surface against that direction to the
    /// depth `rise`.
    fn new(at: f64, direction: f64, rise: f64, run: f64) -> Self {
        let length = (rise * rise + run * run).sqrt();
        Self {
            along: direction * rise / length,
            into: run / length,
            offset: -direction * at * rise / length,
        }
    }
}

/// A feature as it is evaluated.
#[derive(Clone, Copy, Debug)]
struct Cut<T> {
    raise: T,
    drop: T,
    walls: [Wall<T>; 2],
}

impl Cut<f64> {
    /// Deeper than any tip gets.
    const BOTTOMLESS: f64 = 1e6;
    /// A cut that changes nothing.
    const NEUTRAL: Self = Self {
        raise: 0.0,
        drop: 0.0,
        walls: [Wall::NEUTRAL; 2],
    };

    fn new(feature: &SurfaceFeature) -> Self {
        let down = |drop, walls| Self {
            raise: 0.0,
            drop,
            walls,
        };
        let bottomless = Self::BOTTOMLESS;
        match *feature {
            SurfaceFeature::Step { drop_m: 0.0, .. } => Self::NEUTRAL,
            SurfaceFeature::Step {
                at_m,
                drop_m,
                wall_m,
            } if drop_m > 0.0 => down(drop_m, [Wall::new(at_m, -1.0, drop_m, wall_m), Wall::NONE]),
            SurfaceFeature::Step {
                at_m,
                drop_m,
                wall_m,
            } => Self {
                raise: -drop_m,
                drop: 0.0,
                walls: [Wall::new(at_m, 1.0, -drop_m, wall_m), Wall::NONE],
            },
            SurfaceFeature::Hole {
                from_m,
                to_m,
                depth_m,
                wall_m,
            } => down(
                depth_m,
                [
                    Wall::new(from_m, -1.0, depth_m, wall_m),
                    Wall::new(to_m, 1.0, depth_m, wall_m),
                ],
            ),
            SurfaceFeature::Begin { at_m } => down(
                bottomless,
                [Wall::new(at_m, 1.0, bottomless, 0.0), Wall::NONE],
            ),
            SurfaceFeature::End { at_m } => down(
                bottomless,
                [Wall::new(at_m, -1.0, bottomless, 0.0), Wall::NONE],
            ),
        }
    }
}

/// The surface's constants, in lanes.
#[derive(Clone, Debug)]
pub(super) struct SurfaceShape<T> {
    normal: [T; 2],
    offset: T,
    raise: T,
    slope: T,
    reference: T,
    /// Amplitude, wave number (rad/m) and phase; left out where no lane has any.
    waves: Option<[T; 3]>,
    cuts: Vec<Cut<T>>,
}

impl<T: Lanes> SurfaceShape<T> {
    /// One surface a lane.
    pub(super) fn new<'a>(profile: impl Fn(usize) -> &'a SurfaceProfile) -> Self {
        let lanes = |value: &dyn Fn(&SurfaceProfile) -> f64| T::from_lanes(|i| value(profile(i)));
        let wavy = (0..T::LANES).any(|i| profile(i).waviness_m != 0.0);
        let count = (0..T::LANES).map(|i| profile(i).features.len()).max();
        let cut = |lane: usize, number: usize| {
            let feature = profile(lane).features.get(number);
            feature.map_or(Cut::NEUTRAL, Cut::new)
        };
        let cuts = (0..count.unwrap_or(0)).map(|number| Cut {
            raise: T::from_lanes(|i| cut(i, number).raise),
            drop: T::from_lanes(|i| cut(i, number).drop),
            walls: [0, 1].map(|wall| Wall {
                along: T::from_lanes(|i| cut(i, number).walls[wall].along),
                into: T::from_lanes(|i| cut(i, number).walls[wall].into),
                offset: T::from_lanes(|i| cut(i, number).walls[wall].offset),
            }),
        });
        Self {
            normal: [0, 1].map(|axis| lanes(&|p| p.plane.normal[axis])),
            offset: lanes(&|p| p.plane.offset_m),
            raise: lanes(&|p| p.raise_m),
            slope: lanes(&|p| p.slope),
            reference: lanes(&|p| p.reference_m),
            waves: wavy.then(|| {
                [
                    lanes(&|p| p.waviness_m),
                    lanes(&|p| core::f64::consts::TAU / p.wavelength_m),
                    lanes(&|p| p.phase_rad),
                ]
            }),
            cuts: cuts.collect(),
        }
    }

    /// h, h' and h'' (m, 1, 1/m) at a place along the surface.
    #[inline]
    fn smooth(&self, along: T) -> (T, T, T) {
        let height = self.raise + self.slope * (along - self.reference);
        match self.waves {
            None => (height, self.slope, T::ZERO),
            Some([amplitude, number, phase]) => {
                let (sine, cosine) = (number * along + phase).sin_cos();
                let wave = amplitude * sine;
                (
                    height + wave,
                    self.slope + amplitude * number * cosine,
                    -(number * number * wave),
                )
            }
        }
    }

    /// How deep `tip` (m) is in the surface.
    #[inline]
    pub(super) fn depth(&self, tip: [T; 2]) -> Depth<T> {
        let n = self.normal;
        let tangent = [n[1], -n[0]];
        let along = tangent[0] * tip[0] + tangent[1] * tip[1];
        let deep = n[0] * tip[0] + n[1] * tip[1] - self.offset;
        let (height, slope, bend) = self.smooth(along);
        let shrink = T::ONE / (T::ONE + slope * slope).sqrt();
        let depth = (deep - height) * shrink;
        // d p / d u and d p / d deep.
        let by_along = -(slope * shrink) - depth * slope * bend * shrink * shrink;
        let mut found = Depth {
            depth,
            normal: [0, 1].map(|i| by_along * tangent[i] + shrink * n[i]),
        };
        for cut in &self.cuts {
            let wall = |wall: &Wall<T>| Depth {
                depth: wall.along * along + wall.into * found.depth + wall.offset,
                normal: [0, 1].map(|i| wall.along * tangent[i] + wall.into * found.normal[i]),
            };
            let beside = wall(&cut.walls[0]).larger(wall(&cut.walls[1]));
            let bottom = found.deeper_by(-cut.drop);
            found = found.deeper_by(cut.raise).smaller(beside.larger(bottom));
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PLANE: Surface = Surface {
        normal: [0.0, 1.0],
        offset_m: 0.05,
    };

    fn with(features: Vec<SurfaceFeature>) -> SurfaceProfile {
        SurfaceProfile {
            features,
            ..SurfaceProfile::flat(PLANE)
        }
    }

    fn depth(profile: &SurfaceProfile, point: [f64; 2]) -> Depth<f64> {
        SurfaceShape::new(|_| profile).depth(point)
    }

    #[test]
    fn height_tilt_and_waviness_are_those_of_the_formula() {
        let profile = SurfaceProfile {
            raise_m: 2e-3,
            slope: 0.1,
            reference_m: 0.45,
            waviness_m: 1e-3,
            wavelength_m: 0.05,
            ..SurfaceProfile::flat(PLANE)
        };
        for along in [0.2, 0.45, 0.512, 0.7] {
            let k = core::f64::consts::TAU / 0.05;
            let y = 0.05 + 2e-3 + 0.1 * (along - 0.45) + 1e-3 * libm::sin(k * along);
            let slope = 0.1 + 1e-3 * k * libm::cos(k * along);
            let q = 1.0 / (1.0 + slope * slope).sqrt();
            let found = depth(&profile, [along, y + 1e-4]);
            assert!((found.depth - 1e-4 * q).abs() < 1e-15);
            let on = depth(&profile, [along, y]);
            assert!((on.normal[0] + slope * q).abs() < 1e-12);
            assert!((on.normal[1] - q).abs() < 1e-12);
        }
    }

    #[test]
    fn features_are_cut_out_where_they_are_said_to_be() {
        let hole = |wall_m| SurfaceFeature::Hole {
            from_m: 0.4,
            to_m: 0.43,
            depth_m: 3e-3,
            wall_m,
        };
        let at = |profile: &SurfaceProfile, x: f64, below: f64| depth(profile, [x, 0.05 + below]);
        let vertical = with(vec![hole(0.0)]);
        assert!((at(&vertical, 0.39, 1e-4).depth - 1e-4).abs() < 1e-15);
        assert!((at(&vertical, 0.415, 3e-3 + 1e-4).depth - 1e-4).abs() < 1e-15);
        assert!(at(&vertical, 0.415, 1e-4).depth < 0.0);
        // Against the far wall from inside: pushed back along -x.
        let wall = at(&vertical, 0.4301, 1.5e-3);
        assert!((wall.depth - 1e-4).abs() < 1e-12);
        assert!(wall.normal == [1.0, 0.0]);
        // A wall of 45 degrees: 3 mm down over 3 mm.
        let sloped = with(vec![hole(3e-3)]);
        let wall = at(&sloped, 0.4285, 1.5e-3 + 1e-4);
        let half = 0.5_f64.sqrt();
        assert!((wall.depth - 1e-4 * half).abs() < 1e-12);
        assert!((wall.normal[0] - half).abs() < 1e-12 && (wall.normal[1] - half).abs() < 1e-12);

        let step = |drop_m| {
            with(vec![SurfaceFeature::Step {
                at_m: 0.5,
                drop_m,
                wall_m: 0.0,
            }])
        };
        assert!((at(&step(2e-3), 0.6, 2.1e-3).depth - 1e-4).abs() < 1e-15);
        assert!((at(&step(2e-3), 0.49, 1e-4).depth - 1e-4).abs() < 1e-15);
        assert!((at(&step(-2e-3), 0.6, -1.9e-3).depth - 1e-4).abs() < 1e-15);
        assert!((at(&step(-2e-3), 0.49, 1e-4).depth - 1e-4).abs() < 1e-15);
        let face = at(&step(-2e-3), 0.5001, -1e-3);
        assert!((face.depth - 1e-4).abs() < 1e-12 && face.normal == [1.0, 0.0]);

        let ends = with(vec![
            SurfaceFeature::Begin { at_m: 0.1 },
            SurfaceFeature::End { at_m: 0.7 },
        ]);
        assert!((at(&ends, 0.4, 1e-4).depth - 1e-4).abs() < 1e-15);
        assert!(at(&ends, 0.71, 0.1).depth < 0.0 && at(&ends, 0.09, 0.1).depth < 0.0);
    }

    #[test]
    fn points_are_found_at_a_depth_on_a_turned_surface() {
        let profile = SurfaceProfile {
            slope: 0.05,
            waviness_m: 1e-3,
            ..SurfaceProfile::flat(Surface {
                normal: [0.6, 0.8],
                offset_m: 0.3,
            })
        };
        let point = profile.point(0.2, 1e-4).unwrap();
        assert!((profile.along(point) - 0.2).abs() < 1e-12);
        assert!((depth(&profile, point).depth - 1e-4).abs() < 1e-12);
        let ended = SurfaceProfile {
            features: vec![SurfaceFeature::End { at_m: 0.1 }],
            ..profile
        };
        assert!(ended.point(0.2, 1e-4).is_none());
    }

    proptest! {
        /// The normal is the gradient of the depth, everywhere: the spring has a potential.
        #[test]
        fn the_normal_is_the_gradient_and_the_depth_is_continuous(
            x in 0.35..0.55_f64, below in -5e-3..5e-3_f64, wall in 0.0..2e-3_f64,
            drop in -2e-3..2e-3_f64,
        ) {
            let profile = SurfaceProfile {
                slope: 0.03,
                waviness_m: 5e-4,
                wavelength_m: 0.02,
                features: vec![
                    SurfaceFeature::Hole { from_m: 0.4, to_m: 0.43, depth_m: 3e-3, wall_m: wall },
                    SurfaceFeature::Step { at_m: 0.5, drop_m: drop, wall_m: wall },
                ],
                ..SurfaceProfile::flat(PLANE)
            };
            let at = |x: f64, y: f64| depth(&profile, [x, y]);
            let y = 0.05 + below;
            let here = at(x, y);
            let e = 1e-7;
            // Continuous: no jump over a micrometre, however steep the wall.
            prop_assert!((at(x + e, y).depth - here.depth).abs() < 1.5 * e);
            prop_assert!((at(x, y + e).depth - here.depth).abs() < 1.5 * e);
            // Differences, where no edge lies between them.
            let (left, right) = (at(x - e, y), at(x + e, y));
            if (left.normal[0] - right.normal[0]).abs() < 1e-3 {
                let slope = (right.depth - left.depth) / (2.0 * e);
                prop_assert!((slope - here.normal[0]).abs() < 2e-3);
            }
        }
    }
}

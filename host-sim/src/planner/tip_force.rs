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

use crate::text::{Shortest, four_digits};

/// The planned normal force along the path.
#[derive(Clone, Debug, PartialEq)]
pub enum NormalForce {
    /// The same everywhere, N.
    Constant(f64),
    /// Another one from place to place.
    Along(ForceProfile),
}

impl NormalForce {
    /// The force at a way from the path's start, m, in N.
    pub fn at(&self, way_m: f64) -> f64 {
        match self {
            Self::Constant(force) => *force,
            Self::Along(profile) => profile.at(way_m),
        }
    }

    /// The largest, N.
    pub fn largest(&self) -> f64 {
        match self {
            Self::Constant(force) => *force,
            Self::Along(profile) => profile.largest(),
        }
    }
}

impl From<f64> for NormalForce {
    fn from(force: f64) -> Self {
        Self::Constant(force)
    }
}

/// Most way-points of a [`ForceProfile`].
pub const WAY_POINTS_MAX: usize = 1000;

/// A force over the way along the path, through way-points.
///
/// Between two way-points it is a polynomial of degree 5 with their slopes and curvatures, so it is twice
/// continuously differentiable, and the planned torques are. Slopes and curvatures are those of the parabola
/// through a way-point and its neighbours (at an end, the line's), but no larger than leaves the six control
/// points of each polynomial in order (Bernstein's: `y0 + {0, h d0 / 5, 2 h d0 / 5 + h^2 c0 / 20}`,
/// `y1 - {2 h d1 / 5 - h^2 c1 / 20, h d1 / 5, 0}`): then the force rises or falls with the two way-points, never
/// leaves their range, nor turns between them. A slope is 0 where lines to either side have
/// different signs, and at most 1.25 times either, so that `h (d0 + d1)` is at most 2.5 times the
/// rise; curvatures have the half each of what that leaves. Where nothing is cut, parabolas are parabolas.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceProfile {
    points: Vec<WayPoint>,
}

/// A place with its force, and the force's slope and curvature there; m, N, N/m, N/m^2.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WayPoint {
    way_m: f64,
    force_n: f64,
    slope: f64,
    curvature: f64,
}

/// The straight line between two way-points.
#[derive(Clone, Copy)]
struct Line {
    step_m: f64,
    slope: f64,
}

/// Slope of a force between two lines; the one line's at an end.
fn slope_between(before: Option<&Line>, after: Option<&Line>) -> f64 {
    /// Of a slope over that of a line beside it.
    const STEEPEST: f64 = 1.25;
    match (before, after) {
        (Some(a), Some(b)) if a.slope * b.slope > 0.0 => {
            let parabola = (b.step_m * a.slope + a.step_m * b.slope) / (a.step_m + b.step_m);
            let most = STEEPEST * a.slope.abs().min(b.slope.abs());
            parabola.clamp(-most, most)
        }
        (Some(_), Some(_)) => 0.0,
        (line, None) | (None, line) => line.map_or(0.0, |line| line.slope),
    }
}

/// The curvatures, from the lowest to the highest, that leave a polynomial's control points in order at the
/// end (the `right` one or the left one) of a line; it has the slope `own` there and `other` at its other
/// end.
fn curvatures(line: &Line, own: f64, other: f64, right: bool) -> [f64; 2] {
    let Line { step_m, slope } = *line;
    let left_over = 0.5 * (slope.abs() - 0.4 * (own + other).abs()).max(0.0);
    let most = 20.0 * left_over / step_m;
    let own = (4.0 * own.abs() / step_m).min(most);
    // Away from the way-point a force that rises must not fall.
    if (slope > 0.0) == right {
        [-most, own]
    } else {
        [-own, most]
    }
}

/// Why way-points are no [`ForceProfile`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ForceProfileError {
    /// Too few or too many.
    #[error("{0} way-points; accepted: 2 to {WAY_POINTS_MAX}")]
    Number(usize),
    /// A force that is no number or pulls.
    #[error("way-point {place} has a force of {} N; accepted: a force in N from 0 to 1e6", Shortest(*force_n))]
    Force {
        /// Which, from 1.
        place: usize,
        /// Its force, N.
        force_n: f64,
    },
    /// A way-point that does not come after the one before it.
    #[error("way-point {place} is at {} m, the one before it at {} m; accepted: rising places, more than {} m apart", Shortest(*way_m), Shortest(*before_m), four_digits(*least_m))]
    Order {
        /// Which, from 1.
        place: usize,
        /// Where it is, m.
        way_m: f64,
        /// Where the one before it is, m.
        before_m: f64,
        /// How far it must be beyond that, m.
        least_m: f64,
    },
    /// They leave a part of the path without a force.
    #[error("they reach from {} to {} m; accepted: from 0 to the path's length, {} m, or farther", Shortest(span_m[0]), Shortest(span_m[1]), four_digits(*length_m))]
    Span {
        /// From where to where they are, m.
        span_m: [f64; 2],
        /// Length of the path, m.
        length_m: f64,
    },
}

impl ForceProfile {
    /// The profile through way-points `[way from the path's start in m, force in N]` for a path of
    /// this length, m.
    ///
    /// # Errors
    /// [`ForceProfileError`].
    pub fn new(way_points: &[[f64; 2]], length_m: f64) -> Result<Self, ForceProfileError> {
        /// What a path's end may be beyond the last way-point, as a share of its length.
        const ROUNDING: f64 = 1e-9;
        const FORCE_MAX_N: f64 = 1e6;
        /// Share of the path's length that way-points are apart.
        const APART: f64 = 1e-6;
        let ([first, .., last], 2..=WAY_POINTS_MAX) = (way_points, way_points.len()) else {
            return Err(ForceProfileError::Number(way_points.len()));
        };
        let forces = way_points.iter().zip(1..);
        if let Some(([_, force_n], place)) =
            { forces }.find(|([_, force_n], _)| !(0.0..=FORCE_MAX_N).contains(force_n))
        {
            let force_n = *force_n;
            return Err(ForceProfileError::Force { place, force_n });
        }
        let mut pairs = way_points.windows(2).zip(2..);
        let least_m = APART * length_m;
        if let Some((pair, place)) = pairs.find(|(pair, _)| !(pair[0][0] + least_m < pair[1][0])) {
            let [before_m, way_m] = [0, 1].map(|i| pair[i][0]);
            return Err(ForceProfileError::Order {
                place,
                way_m,
                before_m,
                least_m,
            });
        }
        let span_m = [first[0], last[0]];
        let covered = span_m[0] <= 0.0 && span_m[1] >= length_m * (1.0 - ROUNDING);
        if !(covered && span_m.iter().all(|way| way.is_finite())) {
            return Err(ForceProfileError::Span { span_m, length_m });
        }
        let lines = way_points.windows(2).map(|pair| {
            let step_m = pair[1][0] - pair[0][0];
            let slope = (pair[1][1] - pair[0][1]) / step_m;
            Line { step_m, slope }
        });
        let lines: Vec<Line> = lines.collect();
        let before = |i: usize| i.checked_sub(1).and_then(|i| lines.get(i));
        let slopes = (0..way_points.len()).map(|i| slope_between(before(i), lines.get(i)));
        let slopes: Vec<f64> = slopes.collect();
        let curvature = |i: usize| match (before(i), lines.get(i)) {
            (Some(a), Some(b)) => {
                let parabola = 2.0 * (b.slope - a.slope) / (a.step_m + b.step_m);
                let left = curvatures(a, slopes[i], slopes[i - 1], true);
                let right = curvatures(b, slopes[i], slopes[i + 1], false);
                parabola.clamp(left[0].max(right[0]), left[1].min(right[1]))
            }
            _ => 0.0,
        };
        let points = way_points.iter().enumerate();
        Ok(Self {
            points: points
                .map(|(i, [way_m, force_n])| WayPoint {
                    way_m: *way_m,
                    force_n: *force_n,
                    slope: slopes[i],
                    curvature: curvature(i),
                })
                .collect(),
        })
    }

    /// The force, N, at a way from the path's start, m.
    pub fn at(&self, way_m: f64) -> f64 {
        let after = self.points.partition_point(|point| point.way_m <= way_m);
        let after = after.clamp(1, self.points.len() - 1);
        let (from, to) = (self.points[after - 1], self.points[after]);
        let step = to.way_m - from.way_m;
        let x = ((way_m - from.way_m) / step).clamp(0.0, 1.0);
        // The difference to the straight line: for equal slopes nothing.
        let line = (to.force_n - from.force_n) / step;
        let (rise, fall) = (from.slope - line, to.slope - line);
        // Hermite's polynomials of degree 5 for a slope and for a curvature of 1 at an end.
        let slope = |x: f64| x * (1.0 + x * x * (-6.0 + x * (8.0 - 3.0 * x)));
        let curvature = |x: f64, rest: f64| 0.5 * (x * x) * (rest * rest * rest);
        let rest = 1.0 - x;
        let straight = from.force_n + x * (to.force_n - from.force_n);
        let bent = from.curvature * curvature(x, rest) + to.curvature * curvature(rest, x);
        straight + step * (rise * slope(x) - fall * slope(rest) + step * bent)
    }

    /// The largest, N.
    pub fn largest(&self) -> f64 {
        let forces = self.points.iter().map(|point| point.force_n);
        forces.fold(0.0, f64::max)
    }

    /// The way-points, `[way in m, force in N]`.
    pub fn way_points(&self) -> impl Iterator<Item = [f64; 2]> {
        self.points.iter().map(|point| [point.way_m, point.force_n])
    }
}

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

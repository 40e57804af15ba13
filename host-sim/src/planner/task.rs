//! What the tip shall do, and why there may be no plan for it.

use crate::model::arm_model::ModelError;
use crate::model::configuration::Surface;
use crate::model::servo::Reference;
use crate::planner::collocation::CollocationError;
use crate::planner::path::{JointWay, LinePath};
use crate::planner::tip_force::{FRICTION_SHARE_MAX, NormalForce, SurfaceFriction, TipForce};
use crate::text::{Shortest, four_digits};
use flexor::model::{ArmParameters, KinematicsError};

/// Which equations the planner uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Equations {
    /// All of them, with the terms of second order in the deflection.
    #[default]
    Exact,
    /// Eq. 14-17 as the paper prints them, but for their slips of sign: without the
    /// axial load and the terms of second order, and with the torques as least-squares
    /// solution of eq. 9 and 11, which then contradict each other.
    AsPrinted,
}

/// What the link may do at the first and the last instant of a plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ends {
    /// Bend into the motion and out of it: at the first instant it has only what grows into the motion, at
    /// the last only what decays, as if it had rested for ever before and rested for ever after.
    #[default]
    Spectral,
    /// Have its resting shape, whatever its rate. Where the time before the motion is short it has to bend
    /// at once, and from some 6 elements on there are layers thinner than a control period.
    Dirichlet,
}

/// How long the link may bend before or after the tip's motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Window {
    /// This long, s.
    Fixed(f64),
    /// Until the slowest zero at the path's end has decayed to the given tolerance.
    Auto {
        /// Ratio to which the deflection's rate decays.
        tolerance: f64,
    },
}

/// How the tip gets from one end of its path to the other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Travel {
    /// Straight, along the surface.
    #[default]
    Line,
    /// Through the air, each joint straight to its end.
    Joints(JointWay),
}

/// What the tip shall do.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// The tip's path and its timing; of a move through the air its ends and timing.
    pub path: LinePath,
    /// How it is travelled.
    pub travel: Travel,
    /// Force on the surface along its normal, N.
    pub normal_force: NormalForce,
    /// Direction that tells the path's two normals apart: the force is along the one
    /// with a positive component in this direction. `None`: downwards (+a2), or along
    /// +a1 for a vertical path.
    pub direction: Option<[f64; 2]>,
    /// Friction of the surface that the plan counts on.
    pub friction: SurfaceFriction,
    /// Time before the tip's motion.
    pub pre_actuation: Window,
    /// Time after it.
    pub post_actuation: Window,
    /// What the link may do at the ends of all that. The printed equations have Dirichlet ends always.
    pub ends: Ends,
}

/// Why there is no plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The arm cannot take the tip along the path.
    #[error("the path cannot be followed: at t = {t_s:.4} s, point ({:.4}, {:.4}) m, it is {source}", point_m[0], point_m[1])]
    Path {
        /// When, s.
        t_s: f64,
        /// Where, m.
        point_m: [f64; 2],
        /// What is wrong there.
        source: KinematicsError,
    },
    /// The path is a point.
    #[error("path.from_m and path.to_m are the same point ({}, {}) m: a path longer than {} m is accepted", Shortest(point_m[0]), Shortest(point_m[1]), four_digits(*least_m))]
    NoPath {
        /// The point, m.
        point_m: [f64; 2],
        /// Shortest path that is accepted, m.
        least_m: f64,
    },
    /// A move goes nowhere.
    #[error("move: from and to are the same angles ({}, {}) rad: a move of more than 1e-9 rad is accepted", Shortest(angle_rad[0]), Shortest(angle_rad[1]))]
    NoMove {
        /// The angles, rad.
        angle_rad: [f64; 2],
    },
    /// The tip cannot be lifted so far by joint 2.
    #[error("move.clearance_m = {}: joint 2 cannot lift the tip so far off the surface at point ({:.4}, {:.4}) m; a smaller one is accepted", Shortest(*clearance_m), point_m[0], point_m[1])]
    NoClearance {
        /// Where on the surface, m.
        point_m: [f64; 2],
        /// How far, m.
        clearance_m: f64,
    },
    /// A move through the air meets a surface.
    #[error("the move goes through the surface of its task: at t = {t_s:.4} s the tip is at point ({:.4}, {:.4}) m, beyond it; a move on the other side, or around its ends, is accepted", point_m[0], point_m[1])]
    ThroughSurface {
        /// When, s.
        t_s: f64,
        /// Where, m.
        point_m: [f64; 2],
    },
    /// The force's direction does not choose between the path's normals.
    #[error("force.direction = [{}, {}] runs along the path: a direction with a component across it is accepted", Shortest(.0[0]), Shortest(.0[1]))]
    Direction([f64; 2]),
    /// Too few or too many control periods.
    #[error(
        "{what} of {} s is {} control periods at {tick_rate_hz} Hz: {accepted} are accepted",
        Shortest(*value_s),
        four_digits(*ticks)
    )]
    Duration {
        /// What takes that long.
        what: &'static str,
        /// How long, s.
        value_s: f64,
        /// The same in ticks.
        ticks: f64,
        /// Control rate, Hz.
        tick_rate_hz: u32,
        /// What is accepted.
        accepted: String,
    },
    /// No real part of a zero to derive a window from.
    #[error(
        "{what} = \"auto\" cannot be derived: the arm's slowest zero there decays at {} 1/s, which takes longer than a plan may; give a number of seconds",
        four_digits(*rate_per_s)
    )]
    NoWindow {
        /// Which window.
        what: &'static str,
        /// Decay rate, 1/s.
        rate_per_s: f64,
    },
    /// The deflection could not be found.
    #[error("no elastic motion was found for this task ({cause}): {remedy}")]
    Deflection {
        /// What the method said.
        cause: CollocationError,
        /// What was found to help.
        remedy: Remedy,
    },
    /// The link buckles at an end of the path.
    #[error("link 2 has no resting shape at {} of the path: the load reaches its buckling load", if *.end { "the end" } else { "the start" })]
    Buckled {
        /// At the end, or at the start.
        end: bool,
    },
    /// Friction would hold the tip, however hard joint 2 presses.
    #[error(
        "surface.friction = {} lets the tip jam: at point ({:.4}, {:.4}) m link 2 stands so steeply on the surface that friction times |c2/s2| = {} reaches {}; below 1, a friction below {}, is accepted, and below {FRICTION_SHARE_MAX}, {}, is of use",
        Shortest(*friction), point_m[0], point_m[1], four_digits(*lever_ratio),
        four_digits(friction * lever_ratio), four_digits(1.0 / lever_ratio),
        four_digits(FRICTION_SHARE_MAX / lever_ratio)
    )]
    Jams {
        /// Coefficient of friction in the plan.
        friction: f64,
        /// Where, m.
        point_m: [f64; 2],
        /// |c2/s2| there.
        lever_ratio: f64,
    },
    /// A planned quantity is not finite or absurdly large.
    #[error(
        "the planned {what} reaches {} at t = {t_s:.4} s: at most {} is accepted; a longer duration_s makes motion's share smaller, less force.normal_N and a stiffer link2 the share at rest",
        four_digits(*value),
        four_digits(*limit)
    )]
    Excessive {
        /// What is excessive.
        what: &'static str,
        /// Its value.
        value: f64,
        /// When, s.
        t_s: f64,
        /// What is accepted.
        limit: f64,
    },
    /// Not as many deflections may be there before the motion and after it as there are.
    #[error(
        "link 2 has {} growing and {} decaying zeros at the start of the path and {} and {} at its end, as many of each are accepted at both: {}",
        start[0], start[1], end[0], end[1],
        if *tip_inertia_kgm2 > 0.0 {
            format!("link2.tip_inertia_kgm2 = {} lets the tip swing freely against the plan at one of them; a smaller one or 0 is accepted", Shortest(*tip_inertia_kgm2))
        } else {
            "a path whose ends are more alike is accepted".to_string()
        }
    )]
    UnlikeEnds {
        /// Zeros that grow and that decay, at the path's start.
        start: [usize; 2],
        /// The same at its end.
        end: [usize; 2],
        /// The arm's tip inertia, kg m^2.
        tip_inertia_kgm2: f64,
    },
    /// Some deflection neither grows nor decays at rest.
    #[error(
        "link 2 has zeros at {} of the path that neither grow nor decay: {}",
        if *.end { "the end" } else { "the start" },
        if *damping > 0.0 {
            format!("another link2.tip_inertia_kgm2 than {} is accepted", Shortest(*tip_inertia_kgm2))
        } else {
            "a link2.damping_ratio above 0 is accepted".to_string()
        }
    )]
    Lasting {
        /// At the end, or at the start.
        end: bool,
        /// The arm's damping ratio.
        damping: f64,
        /// The arm's tip inertia, kg m^2.
        tip_inertia_kgm2: f64,
    },
    /// The link bends too far for any of its equations.
    #[error(
        "link 2 bends too far: at t = {t_s:.4} s, point ({:.4}, {:.4}) m, its section angle would pass 72 degrees; a longer duration_s makes motion's share smaller, less force.normal_N and a stiffer link2 the share at rest",
        point_m[0], point_m[1]
    )]
    SectionAngle {
        /// When, s.
        t_s: f64,
        /// Where the tip is, m.
        point_m: [f64; 2],
    },
    /// The tip's motion stops to determine the link's.
    #[error(
        "the tip does not determine the motion of link 2 throughout: near t = {t_s:.4} s, point ({:.4}, {:.4}) m, the determinant of its equations changes sign; another link2.tip_inertia_kgm2 than {} is accepted",
        point_m[0], point_m[1], Shortest(*tip_inertia_kgm2)
    )]
    Undetermined {
        /// When, s.
        t_s: f64,
        /// Where, m.
        point_m: [f64; 2],
        /// The arm's tip inertia, kg m^2.
        tip_inertia_kgm2: f64,
    },
    /// The deflection found is not good enough to be used.
    #[error(
        "the planned deflection is only good to {estimate:.1e} rad or of link 2's length, 1e-2 is accepted; a longer duration_s, pre_actuation_s or fewer link2.elements make it better"
    )]
    Inaccurate {
        /// Estimated error.
        estimate: f64,
    },
    /// The arm has no model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl From<CollocationError> for PlanError {
    fn from(cause: CollocationError) -> Self {
        Self::Deflection {
            cause,
            remedy: Remedy::None,
        }
    }
}

/// What was tried, and helps, where no deflection was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Remedy {
    /// Fewer elements.
    Elements {
        /// With as many there is no plan.
        refused: usize,
        /// With as many there is one.
        accepted: usize,
    },
    /// More time: the link would bend beyond all bounds.
    Duration {
        /// In this time there is no plan, s.
        refused_s: f64,
        /// In this time there is one, s.
        accepted_s: f64,
        /// Elements that it has.
        elements: usize,
        /// Slope at the root that it reaches, rad.
        slope_rad: f64,
    },
    /// Nothing of these.
    None,
}

impl core::fmt::Display for Remedy {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Elements { refused, accepted } => write!(
                f,
                "link2.elements = {refused} are too many for its rounding; with {accepted} there is a plan"
            ),
            Self::Duration {
                refused_s,
                accepted_s,
                elements,
                slope_rad,
            } => write!(
                f,
                "in duration_s = {} the link would bend without bound; in {} s there is a plan (of {elements} elements), whose slope at link 2's root reaches {} rad of the {} that a beam's equations hold for",
                Shortest(refused_s),
                four_digits(accepted_s),
                four_digits(slope_rad),
                four_digits(SLOPE_MAX_RAD)
            ),
            Self::None => f.write_str(
                "neither a longer duration_s nor fewer link2.elements help; less force.normal_N, a stiffer link2 or a shorter path may",
            ),
        }
    }
}

/// Largest planned slope at link 2's root, rad: beyond a right angle a small-deflection beam means
/// nothing.
pub const SLOPE_MAX_RAD: f64 = core::f64::consts::FRAC_PI_2;

/// Unit normal of the surface along `task`'s path, into which the tip of `arm` presses. A move through
/// the air has none: a level one that the arm does not reach.
pub(super) fn surface(task: &Task, arm: &ArmParameters) -> Result<Surface, PlanError> {
    /// Shortest path, as a share of the arm's reach.
    const LEAST: f64 = 1e-6;
    let path = &task.path;
    let length = path.length();
    let reach_m = arm.link1_length_m + arm.link2_length_m;
    if let Travel::Joints(_) = task.travel {
        return Ok(Surface {
            normal: [0.0, 1.0],
            offset_m: 2.0 * reach_m,
        });
    }
    let least_m = LEAST * reach_m;
    if !(length > least_m) {
        return Err(PlanError::NoPath {
            point_m: path.from,
            least_m,
        });
    }
    let along = [
        (path.to[0] - path.from[0]) / length,
        (path.to[1] - path.from[1]) / length,
    ];
    let normal = [-along[1], along[0]];
    let component = |d: [f64; 2]| d[0] * normal[0] + d[1] * normal[1];
    let side = match task.direction {
        Some(direction) => {
            let side = component(direction);
            if side.abs() < 1e-6 * libm::hypot(direction[0], direction[1]) || side == 0.0 {
                return Err(PlanError::Direction(direction));
            }
            side
        }
        None if normal[1].abs() > 1e-9 => normal[1],
        None => normal[0],
    };
    let normal = normal.map(|n| n * side.signum());
    Ok(Surface {
        normal,
        offset_m: normal[0] * path.from[0] + normal[1] * path.from[1],
    })
}

impl Task {
    /// What is prescribed at time `t`, s after the path's start.
    pub(super) fn reference(&self, t: f64) -> Reference {
        let path = &self.path;
        match &self.travel {
            Travel::Line => {
                let tip = path.at(t);
                Reference::Tip([tip.position, tip.velocity, tip.acceleration])
            }
            Travel::Joints(way) => {
                let [s, rate, acceleration] = path.profile.at(t / path.duration);
                Reference::Joints(way.at([
                    s,
                    rate / path.duration,
                    acceleration / (path.duration * path.duration),
                ]))
            }
        }
    }

    /// Unit vector along the surface in the direction of travel, inertial axes; `surface` is the
    /// task's own.
    pub fn along(&self, surface: &Surface) -> [f64; 2] {
        match self.travel {
            Travel::Line => self.path.direction(),
            Travel::Joints(_) => [surface.normal[1], -surface.normal[0]],
        }
    }

    /// The tip's force at time `t`, s after the path's start.
    pub fn tip_force(&self, t: f64) -> TipForce {
        let path = &self.path;
        let [progress, _, _] = path.profile.at(t / path.duration);
        let way_m = path.length() * progress;
        let normal = self.normal_force.at(way_m);
        let friction = &self.friction;
        if friction.coefficient == 0.0 {
            return TipForce { normal, along: 0.0 };
        }
        TipForce {
            normal,
            along: friction.coefficient * normal * libm::tanh(way_m / friction.way_m),
        }
    }

    /// The same in inertial axes, N; `surface` is the task's own.
    pub fn force_at(&self, surface: &Surface, t: f64) -> [f64; 2] {
        let TipForce { normal, along } = self.tip_force(t);
        let pressed = surface.normal.map(|n| n * normal);
        // Nothing is added where there is none: not even to a zero's sign.
        if self.friction.coefficient == 0.0 {
            return pressed;
        }
        let direction = self.path.direction();
        [0, 1].map(|i| pressed[i] + along * direction[i])
    }
}

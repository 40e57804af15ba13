//! Moves through the air: from rest to rest, without contact, each joint straight to its end.
//!
//! The tip of a move is nowhere asked to be on a line: its joints are, so that a move may begin or
//! end where the arm is stretched or hangs, where no line of the tip can be followed. All else is
//! planned as along a surface, with no force: the link bends as the motion wants it to, and rests at
//! both ends.
//!
//! Glossary: *clearance*: how far off the surface the tip stands where a move ends above a task's
//! start or begins above its end, by turning joint 2, as the run's approach and lifting do.

use crate::model::arm_model::ArmModel;
use crate::model::configuration::Surface;
use crate::model::rest::{Rest, rest};
use crate::model::servo::Reference;
use crate::planner::path::{JointWay, LinePath, Profile};
use crate::planner::task::{Ends, PlanError, Task, Travel, Window, surface};
use crate::planner::tip_force::SurfaceFriction;
use flexor::model::JointMotion;

/// Where a move begins or ends. Angles are in rad from a1 towards a2.
#[derive(Clone, Debug, PartialEq)]
pub enum MoveEnd {
    /// The links' angles (theta10, theta20).
    Angles([f64; 2]),
    /// The motors' angles, as encoders show them: theta10, and link 2's root tangent against link 1.
    Motors([f64; 2]),
    /// Off the surface of a task: above its start where a move ends, above its end where one begins.
    Task {
        /// The task.
        task: Box<Task>,
        /// How far off, m.
        clearance_m: f64,
    },
}

/// A move through the air.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeMove {
    /// Where it begins.
    pub from: MoveEnd,
    /// Where it ends.
    pub to: MoveEnd,
    /// How long it takes, s.
    pub duration_s: f64,
    /// How its progress grows.
    pub profile: Profile,
    /// Time before the joints' motion.
    pub pre_actuation: Window,
    /// Time after it.
    pub post_actuation: Window,
}

/// The piece of a surface that a task's path lies on.
struct Stretch {
    surface: Surface,
    /// The path on it, from and to, m.
    path: [[f64; 2]; 2],
}

impl FreeMove {
    /// What there is to plan for `model`'s arm.
    ///
    /// # Errors
    /// [`PlanError`]: ends that the arm cannot reach, a way that goes nowhere or through a surface.
    pub fn task(&self, model: &ArmModel) -> Result<Task, PlanError> {
        let (from, off_from) = self.from.angles(model, 1.0)?;
        let (to, off_to) = self.to.angles(model, 0.0)?;
        let way = JointWay { ends: [from, to] };
        let off: Vec<Stretch> = off_from.into_iter().chain(off_to).collect();
        if way.is_point() {
            return Err(PlanError::NoMove { angle_rad: from });
        }
        let [start, end] = way.ends.map(|angle| tip_at(model, angle));
        let (start, end) = (start?, end?);
        self.check_clear(model, &way, &off)?;
        Ok(Task {
            path: LinePath {
                from: start,
                to: end,
                duration: self.duration_s,
                profile: self.profile,
            },
            travel: Travel::Joints(way),
            normal_force: 0.0.into(),
            direction: None,
            friction: SurfaceFriction::default(),
            pre_actuation: self.pre_actuation,
            post_actuation: self.post_actuation,
            ends: Ends::Spectral,
        })
    }

    /// Refuses a move whose tip goes beyond a surface that it is to stay off.
    fn check_clear(
        &self,
        model: &ArmModel,
        way: &JointWay,
        off: &[Stretch],
    ) -> Result<(), PlanError> {
        /// A joint turns by at most a hundredth of its way from one to the next.
        const SAMPLES: u32 = 256;
        if off.is_empty() {
            return Ok(());
        }
        for i in 0..=SAMPLES {
            let share = f64::from(i) / f64::from(SAMPLES);
            let progress = self.profile.at(share);
            let point_m = tip_at(model, way.at(progress).angle)?;
            if off.iter().any(|stretch| stretch.holds(point_m)) {
                let t_s = share * self.duration_s;
                return Err(PlanError::ThroughSurface { t_s, point_m });
            }
        }
        Ok(())
    }
}

impl Stretch {
    /// Whether a point, m, is beyond the surface where the path is.
    fn holds(&self, point: [f64; 2]) -> bool {
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        let [from, to] = self.path;
        let along = [to[0] - from[0], to[1] - from[1]];
        let share = dot([point[0] - from[0], point[1] - from[1]], along) / dot(along, along);
        let depth = dot(self.surface.normal, point) - self.surface.offset_m;
        depth > 0.0 && (0.0..=1.0).contains(&share)
    }
}

impl MoveEnd {
    /// The links' angles there, rad, and the surface that they are above, if any; `progress` is that
    /// along a task's path.
    fn angles(
        &self,
        model: &ArmModel,
        progress: f64,
    ) -> Result<([f64; 2], Option<Stretch>), PlanError> {
        match self {
            Self::Angles(angle) => Ok((*angle, None)),
            Self::Motors(motor) => Ok((at_motors(model, *motor)?, None)),
            Self::Task { task, clearance_m } => {
                let plane = surface(task, &model.arm)?;
                let point_m = task.path.point(progress);
                let t_s = progress * task.path.duration;
                let pressing = Reference::Tip([point_m, [0.0; 2], [0.0; 2]]);
                let force = task.force_at(&plane, t_s);
                model
                    .kinematics
                    .inverse(point_m, model.arm.elbow)
                    .map_err(|source| PlanError::Path {
                        t_s,
                        point_m,
                        source,
                    })?;
                let end = progress > 0.0;
                let on = rest(model, &pressing, force).map_err(|_| PlanError::Buckled { end })?;
                let above = lifted(model, &plane, on.angle, *clearance_m);
                let above = above.ok_or(PlanError::NoClearance {
                    point_m,
                    clearance_m: *clearance_m,
                })?;
                let stretch = Stretch {
                    surface: plane,
                    path: [task.path.from, task.path.to],
                };
                Ok((above, Some(stretch)))
            }
        }
    }
}

/// `model`'s arm at rest in the air at the links' angles `angle`, rad.
fn hanging(model: &ArmModel, angle: [f64; 2]) -> Option<Rest> {
    let joint = JointMotion {
        angle,
        ..JointMotion::default()
    };
    rest(model, &Reference::Joints(joint), [0.0; 2]).ok()
}

/// The tip of `model`'s arm in the air at the links' angles `angle`, rad: where the chord of a link that
/// hangs by its weight has it.
fn tip_at(model: &ArmModel, angle: [f64; 2]) -> Result<[f64; 2], PlanError> {
    let hangs = hanging(model, angle).ok_or(PlanError::Buckled { end: false })?;
    let [e1, e2] = angle.map(|a| [libm::cos(a), libm::sin(a)]);
    let r1 = model.arm.link1_length_m;
    Ok([0, 1].map(|i| r1 * e1[i] + hangs.chord_m * e2[i]))
}

/// The links' angles, rad, at which the arm rests in the air with its motors at `motor`, rad: link 2
/// hangs from its root tangent by its weight. The slope's change with the angle is a small share, so
/// that a fixed-point iteration finds it.
fn at_motors(model: &ArmModel, motor: [f64; 2]) -> Result<[f64; 2], PlanError> {
    /// Each one brings some two digits.
    const STEPS: u32 = 60;
    /// Rounding of an angle, rad.
    const SMALL: f64 = 1e-15;
    let tangent = motor[0] + motor[1];
    let mut angle = [motor[0], tangent];
    for _ in 0..STEPS {
        let hangs = hanging(model, angle).ok_or(PlanError::Buckled { end: false })?;
        let before = core::mem::replace(&mut angle[1], tangent - hangs.root_slope_rad);
        if (angle[1] - before).abs() <= SMALL {
            break;
        }
    }
    Ok(angle)
}

/// Angles with the tip of a link that hangs by its weight `clearance_m` above `surface`, by a turn of
/// joint 2 from `angle`, rad: the tip's depth is `n . r1 e(theta10) + L cos(theta20 - psi) - offset`, psi
/// the normal's direction, L the chord's length, which depends on the angle but little.
fn lifted(
    model: &ArmModel,
    surface: &Surface,
    angle: [f64; 2],
    clearance_m: f64,
) -> Option<[f64; 2]> {
    /// Each one brings some two digits.
    const STEPS: u32 = 20;
    /// Rounding of an angle, rad.
    const SMALL: f64 = 1e-15;
    let [x, y] = surface.normal;
    let joint2_m = model.arm.link1_length_m * (x * libm::cos(angle[0]) + y * libm::sin(angle[0]));
    let wanted = surface.offset_m - clearance_m - joint2_m;
    let normal_angle = libm::atan2(y, x);
    let from_normal = libm::remainder(angle[1] - normal_angle, core::f64::consts::TAU);
    let mut above = angle;
    for _ in 0..STEPS {
        let cosine = wanted / hanging(model, above)?.chord_m;
        if !(cosine.abs() <= 1.0) {
            return None;
        }
        let turn = libm::acos(cosine).copysign(from_normal) - from_normal;
        let before = core::mem::replace(&mut above[1], angle[1] + turn);
        if (above[1] - before).abs() <= SMALL {
            break;
        }
    }
    Some(above)
}

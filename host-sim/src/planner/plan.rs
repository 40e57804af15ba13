//! Planning: from a task to joint motion, elastic motion and feedforward torques
//! (eq. 12-17).
//!
//! The tip's motion and the contact force are given. The deflection follows from a boundary-value
//! problem (`elastic_bvp`, solved by [`crate::planner::collocation`]) with conditions at both ends;
//! inverse kinematics with the bent link's chord gives the link angles, inverse dynamics the torques.
//!
//! Glossary: *pre-* and *post-actuation* are the times before and after the tip's
//! motion in which the link bends while the tip rests, so that the motion can start
//! and end with the link at rest too; *zeros* are the growth rates of the deflection
//! for a prescribed tip, of either sign.

use crate::model::arm_model::ArmModel;
use crate::model::bending::Given;
use crate::model::chord::forward_motion;
use crate::model::configuration::{Configuration, Surface};
use crate::model::link::{LinkDamping, LinkKind, LinkModel};
use crate::model::printed::{Motion, inverse_as_printed};
use crate::model::servo::{Instant, Reference, Servo};
use crate::model::unknowns::{SECTION_SINE_MAX, largest, steepest_sine};
use crate::planner::collocation::Solution;
use crate::planner::feasible::lever_ratio;
use crate::planner::path::{Profile, TipMotion};
use crate::planner::task::{Ends, Equations, PlanError, SLOPE_MAX_RAD, Task, Travel};
use crate::planner::tip_force::{NormalForce, TipForce};
use flexor::model::{Elbow, JointMotion, fingerprint};
use nalgebra::DVector;
use rayon::iter::ParallelIterator;
use rayon::slice::ParallelSlice;

/// Fewest control periods that a path can be travelled in.
pub const TICKS_MIN: f64 = 16.0;

/// Most control periods of a whole plan, 200 s at 5 kHz: some 300 bytes each in memory and
/// as much again in plan.csv, and some seconds to plan.
pub const TICKS_MAX: f64 = 1e6;

/// The plan at an instant, but for the deflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanPoint {
    /// Time from the path's start, s.
    pub t: f64,
    /// The tip's motion.
    pub tip: TipMotion,
    /// The links' motion.
    pub joint: JointMotion<f64>,
    /// Length of link 2's chord, m.
    pub chord_m: f64,
    /// Slope of link 2 at its root, rad: the angle of its tangent there against the chord.
    pub root_slope: f64,
    /// Its rate, rad/s.
    pub root_slope_rate: f64,
    /// Feedforward torques (tau1, tau2), N m.
    pub torque: [f64; 2],
    /// The tip's force on the surface.
    pub force: TipForce,
}

impl PlanPoint {
    /// Mechanical power of the two joints, W; joint 2 turns the root tangent against
    /// link 1.
    pub fn power(&self) -> [f64; 2] {
        let [rate1, rate2] = self.joint.rate;
        [
            self.torque[0] * rate1,
            self.torque[1] * (rate2 + self.root_slope_rate - rate1),
        ]
    }
}

/// Largest planned magnitudes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Peaks {
    /// |tau1|, |tau2|, N m.
    pub torque: [f64; 2],
    /// Power magnitudes, W.
    pub power: [f64; 2],
    /// Largest change of either torque within a control period, times the rate, N m/s.
    pub torque_rate: [f64; 2],
}

/// A plan: everything known about the motion before it happens.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The model that was planned with.
    pub model: ArmModel,
    /// The task.
    pub task: Task,
    /// The equations used.
    pub equations: Equations,
    /// The surface along the path.
    pub surface: Surface,
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// Control periods before the path's start.
    pub pre_ticks: u32,
    /// Control periods of the whole plan.
    pub ticks: u32,
    /// The plan at every tick, `ticks + 1` points.
    pub points: Vec<PlanPoint>,
    /// Nodal deflections and slopes at every tick (m, rad), `dof` numbers a tick.
    pub deflection: Vec<f64>,
    /// Largest magnitudes.
    pub peaks: Peaks,
    pub(super) solution: Solution,
    pub(super) branch: Branch,
}

/// Makes the angle of the line from joint 1 to the tip continuous along the path: the
/// principal value jumps where the path crosses the negative a1 axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Branch {
    /// Added to both angles where the tip is above (x2 < 0), and elsewhere, rad.
    above: f64,
    below: f64,
}

impl Branch {
    pub(super) fn of(task: &Task) -> Self {
        let ([x0, y0], [x1, y1]) = (task.path.from, task.path.to);
        // Angles that are given are continuous.
        let crosses = task.travel == Travel::Line
            && (y0 < 0.0) != (y1 < 0.0)
            && x0 * y1 - x1 * y0 != 0.0
            && {
                let crossing = y0 / (y0 - y1);
                x0 + crossing * (x1 - x0) < 0.0
            };
        let turn = core::f64::consts::TAU;
        match (crosses, y0 < 0.0) {
            (false, _) => Self {
                above: 0.0,
                below: 0.0,
            },
            (true, false) => Self {
                above: turn,
                below: 0.0,
            },
            (true, true) => Self {
                above: 0.0,
                below: -turn,
            },
        }
    }
}

/// How to plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanOptions {
    /// Elements of link 2.
    pub elements: usize,
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// The equations to use.
    pub equations: Equations,
    /// How link 2 bends and is damped.
    pub link: LinkKind,
    /// Largest error of the deflection, rad and share of link 2's length.
    pub tolerance: f64,
}

impl Default for PlanOptions {
    /// The paper's elements, 5 kHz, the exact equations, and a tolerance with which the
    /// deflections of the paper's task are good to 1e-9 rad and its torques to 1e-6 N m.
    fn default() -> Self {
        Self {
            elements: 3,
            tick_rate_hz: 5000,
            equations: Equations::Exact,
            link: LinkKind::default(),
            tolerance: 2e-9,
        }
    }
}

impl Plan {
    /// Estimated largest error of the deflection, rad or share of link 2's length.
    pub fn error_estimate(&self) -> f64 {
        let length_m = self.model.arm.link2_length_m;
        self.solution.error_estimate(|w| largest(w, length_m))
    }

    /// Intervals of the boundary-value problem's mesh, and Newton iterations spent.
    pub fn effort(&self) -> (usize, usize) {
        (self.solution.mesh().len() - 1, self.solution.iterations)
    }

    /// Time of a tick, s from the path's start.
    pub fn time(&self, tick: u32) -> f64 {
        (f64::from(tick) - f64::from(self.pre_ticks)) / f64::from(self.tick_rate_hz)
    }

    /// Planned force of the tip on the surface with its friction, N, inertial axes, at a time, s from
    /// the path's start.
    pub fn force_at(&self, t: f64) -> [f64; 2] {
        self.task.force_at(&self.surface, t)
    }

    /// Largest |c2/s2| of the plan (how steeply link 2 stands on the surface), and when it is reached, s.
    pub fn lever_ratio_max(&self) -> (f64, f64) {
        let ratios = self.points.iter().map(|point| {
            let ratio = lever_ratio(&self.model, &self.surface, point.joint.angle);
            (ratio, point.t)
        });
        let larger = |most: (f64, f64), next: (f64, f64)| if next.0 > most.0 { next } else { most };
        ratios.fold((0.0, 0.0), larger)
    }

    /// Direction of the surface normal, rad from a1 towards a2.
    pub fn normal_angle(&self) -> f64 {
        libm::atan2(self.surface.normal[1], self.surface.normal[0])
    }

    /// Nodal deflections and slopes at a tick (m, rad).
    pub fn deflection_at(&self, tick: u32) -> &[f64] {
        let n = self.model.dof();
        &self.deflection[tick as usize * n..][..n]
    }

    /// Fingerprint of what was planned for the arm: of path, duration and profile, force and the
    /// side that it presses on, elbow, windows and rate in ticks, elements and equations. A table
    /// carries it ([`flexor::table::Header::task_fingerprint`]).
    pub fn task_fingerprint(&self) -> u32 {
        let path = &self.task.path;
        let profile = match path.profile {
            Profile::Poly11 => 11.0,
        };
        let elbow = match self.model.arm.elbow {
            Elbow::Down => 0.0,
            Elbow::Up => 1.0,
        };
        let equations = match self.equations {
            Equations::Exact => 0.0,
            Equations::AsPrinted => 1.0,
        };
        let mut values = vec![
            path.from[0],
            path.from[1],
            path.to[0],
            path.to[1],
            path.duration,
            profile,
            self.task.normal_force.at(0.0),
            self.surface.normal[0],
            self.surface.normal[1],
            elbow,
            f64::from(self.pre_ticks),
            f64::from(self.ticks),
            f64::from(self.tick_rate_hz),
            self.model.elements as f64,
            equations,
        ];
        // What the first tables knew nothing of counts where there is any.
        if self.task.ends == Ends::Dirichlet && self.equations == Equations::Exact {
            values.push(3.0);
        }
        let link = self.model.link.kind;
        if link.model == LinkModel::Geometric {
            values.push(2.0);
        }
        if let LinkDamping::Bending { .. } = link.damping {
            values.push(self.model.link.retardation_s);
        }
        let friction = self.task.friction;
        if friction.coefficient != 0.0 {
            values.extend([friction.coefficient, friction.way_m]);
        }
        if let NormalForce::Along(profile) = &self.task.normal_force {
            values.extend(profile.way_points().flatten());
        }
        if let Travel::Joints(way) = &self.task.travel {
            values.extend(way.ends.into_iter().flatten());
        }
        fingerprint("flexor task 1", &values)
    }

    /// Reads the plan at any time.
    pub fn sampler(&self) -> Sampler<'_> {
        Sampler::new(self)
    }

    /// Fills the points, deflections and peaks; refuses torques beyond `limit_nm`, N m.
    pub(super) fn tabulate(&mut self, limit_nm: f64) -> Result<(), PlanError> {
        /// Ticks that are evaluated in one go.
        const BATCH: usize = 512;
        let ticks: Vec<u32> = (0..=self.ticks).collect();
        let batches: Vec<(Vec<PlanPoint>, Vec<f64>)> = ticks
            .par_chunks(BATCH)
            .map(|ticks| {
                let mut sampler = self.sampler();
                let mut deflection = Vec::with_capacity(ticks.len() * self.model.dof());
                let points = ticks.iter().map(|tick| {
                    let point = sampler.at(self.time(*tick));
                    deflection.extend(sampler.deflection());
                    point
                });
                (points.collect(), deflection)
            })
            .collect();
        for (points, deflection) in batches {
            self.points.extend(points);
            self.deflection.extend(deflection);
        }
        self.peaks = self.peaks_within(limit_nm)?;
        Ok(())
    }

    /// The largest magnitudes of the points; refuses torques beyond `limit_nm`, N m, and links that bend
    /// too far.
    fn peaks_within(&self, limit_nm: f64) -> Result<Peaks, PlanError> {
        let mut peaks = Peaks::default();
        let mut last: Option<&PlanPoint> = None;
        let slopes = self.deflection.chunks_exact(self.model.dof());
        for (point, w) in self.points.iter().zip(slopes) {
            let power = point.power();
            for joint in 0..2 {
                let torque = point.torque[joint];
                if !(torque.abs() <= limit_nm) {
                    let what = ["torque tau1 (N m)", "torque tau2 (N m)"][joint];
                    let (value, t_s) = (torque, point.t);
                    return Err(PlanError::Excessive {
                        what,
                        value,
                        t_s,
                        limit: limit_nm,
                    });
                }
                peaks.torque[joint] = peaks.torque[joint].max(torque.abs());
                peaks.power[joint] = peaks.power[joint].max(power[joint].abs());
                if let Some(last) = last {
                    let rate = (torque - last.torque[joint]).abs() * f64::from(self.tick_rate_hz);
                    peaks.torque_rate[joint] = peaks.torque_rate[joint].max(rate);
                }
            }
            match self.model.link.kind.model {
                LinkModel::Linear if !(point.root_slope.abs() <= SLOPE_MAX_RAD) => {
                    return Err(PlanError::Excessive {
                        what: "slope at link 2's root (rad)",
                        value: point.root_slope,
                        t_s: point.t,
                        limit: SLOPE_MAX_RAD,
                    });
                }
                LinkModel::Geometric if !(steepest_sine(w) <= SECTION_SINE_MAX) => {
                    return Err(PlanError::SectionAngle {
                        t_s: point.t,
                        point_m: point.tip.position,
                    });
                }
                _ => {}
            }
            last = Some(point);
        }
        Ok(peaks)
    }
}

/// Evaluates a [`Plan`] at any time; cheapest for ascending times.
#[derive(Clone, Debug)]
pub struct Sampler<'p> {
    plan: &'p Plan,
    interval: usize,
    /// Nodal unknowns, rates and accelerations.
    nodal: [Vec<f64>; 3],
    servo: Servo<f64>,
}

impl<'p> Sampler<'p> {
    pub(super) fn new(plan: &'p Plan) -> Self {
        let n = plan.model.dof();
        Self {
            plan,
            interval: 0,
            nodal: [(); 3].map(|()| vec![0.0; n]),
            servo: Servo::new(&plan.model),
        }
    }

    /// The plan at time `t`, s from the path's start; the link's shape is to be had from
    /// [`deflection`](Self::deflection), [`q`](Self::q) and [`q_rate`](Self::q_rate) then. Just outside
    /// the plan's time the deflection is extrapolated.
    pub fn at(&mut self, t: f64) -> PlanPoint {
        let plan = self.plan;
        let model = &plan.model;
        self.interval = plan.solution.interval(t, self.interval);
        let [w, rate, acceleration] = &mut self.nodal;
        plan.solution
            .evaluate(t, self.interval, w, rate, acceleration);
        let reference = plan.task.reference(t);
        let force = plan.force_at(t);
        // The path has been checked; where rounding at its edge still refuses, there is no number.
        let nodal = Given([&self.nodal[0][..], &self.nodal[1], &self.nodal[2]]);
        let Ok(instant) = self.servo.follow(model, &reference, force, &nodal) else {
            return self.nowhere(t);
        };
        let Instant {
            mut joint,
            chord,
            root,
            torque,
        } = instant;
        let tip = match reference {
            Reference::Tip(_) => plan.task.path.at(t),
            Reference::Joints(_) => {
                let [position, velocity, acceleration] = forward_motion(&model.arm, chord, &joint);
                TipMotion {
                    position,
                    velocity,
                    acceleration,
                }
            }
        };
        let torque = if plan.equations == Equations::AsPrinted {
            let [q, q_rate, q_acceleration] = [0, 1, 2].map(|order| self.modal(order));
            let motion = Motion {
                joint,
                configuration: Configuration::new(model, joint.angle),
                q: &q,
                q_rate: &q_rate,
                q_acceleration: &q_acceleration,
            };
            inverse_as_printed(model, &motion, force)
        } else {
            torque
        };
        let turn = if tip.position[1] < 0.0 {
            plan.branch.above
        } else {
            plan.branch.below
        };
        joint.angle = joint.angle.map(|a| a + turn);
        let [root_slope, root_slope_rate, _] = root.angle;
        PlanPoint {
            t,
            tip,
            joint,
            chord_m: chord[0],
            root_slope,
            root_slope_rate,
            torque,
            force: plan.task.tip_force(t),
        }
    }

    /// A point without numbers.
    fn nowhere(&self, t: f64) -> PlanPoint {
        PlanPoint {
            t,
            tip: self.plan.task.path.at(t),
            joint: JointMotion::default(),
            chord_m: f64::NAN,
            root_slope: f64::NAN,
            root_slope_rate: f64::NAN,
            torque: [f64::NAN; 2],
            force: self.plan.task.tip_force(t),
        }
    }

    /// Nodal deflections and slopes at the time last asked for (m, rad; of the geometric model the sines of
    /// section angles).
    pub fn deflection(&self) -> &[f64] {
        &self.nodal[0]
    }

    /// Modal coordinates at the time last asked for.
    pub fn q(&self) -> Vec<f64> {
        self.modal(0)
    }

    /// Their rates, 1/s.
    pub fn q_rate(&self) -> Vec<f64> {
        self.modal(1)
    }

    fn modal(&self, order: usize) -> Vec<f64> {
        let nodal = DVector::from_column_slice(&self.nodal[order]);
        (&self.plan.model.coordinates * nodal).as_slice().to_vec()
    }

    /// What is left of the elastic equations at the time last asked for, `t` (s): zero to rounding with
    /// the exact equations. Moments for slopes, N m, forces for deflections, N.
    pub fn residual(&self, t: f64) -> Vec<f64> {
        let plan = self.plan;
        let nodal = Given([&self.nodal[0][..], &self.nodal[1], &self.nodal[2]]);
        let mut servo = Servo::new(&plan.model);
        let (reference, force) = (plan.task.reference(t), plan.force_at(t));
        match servo.follow(&plan.model, &reference, force, &nodal) {
            Ok(_) => servo.residual().to_vec(),
            Err(_) => vec![f64::NAN; plan.model.dof()],
        }
    }
}

//! Planning: from a task to joint motion, elastic motion and feedforward torques
//! (eq. 12-17).
//!
//! The tip's motion and the contact force are given. Inverse kinematics gives the
//! link angles; the deflection follows from a boundary-value problem
//! ([`crate::model::dynamics::DeflectionEquation`] by [`crate::planner::collocation`]) with the
//! resting shapes at both ends; inverse dynamics gives the torques.
//!
//! Glossary: *pre-* and *post-actuation* are the times before and after the tip's
//! motion in which the link bends while the tip rests, so that the motion can start
//! and end with the link at rest too; *zeros* are the growth rates of the deflection
//! for a prescribed tip, in pairs of either sign.

use crate::model::arm_model::{ArmModel, dot};
use crate::model::configuration::{Configuration, Surface};
use crate::model::dynamics;
use crate::model::dynamics::Motion;
use crate::model::printed::inverse_as_printed;
use crate::planner::collocation::Solution;
use crate::planner::elastic_bvp::{Deflection, largest, rigid_torque};
use crate::planner::feasible::{angles_at, check_friction, check_path, lever_ratio};
use crate::planner::path::{Profile, TipMotion};
use crate::planner::task::{Equations, PlanError, Remedy, SLOPE_MAX_RAD, Task, Travel, surface};
use crate::planner::tip_force::{NormalForce, TipForce};
use crate::planner::zeros::{fastest_zero, window_length};
use crate::text::Shortest;
use flexor::model::{ArmParameters, Elbow, JointMotion, fingerprint};
use nalgebra::DVector;

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
    /// Slope of link 2 at its root, rad.
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
    solution: Solution,
    branch: Branch,
}

/// Makes the angle of the line from joint 1 to the tip continuous along the path: the
/// principal value jumps where the path crosses the negative a1 axis.
#[derive(Clone, Copy, Debug)]
struct Branch {
    /// Added to both angles where the tip is above (x2 < 0), and elsewhere, rad.
    above: f64,
    below: f64,
}

impl Branch {
    fn of(task: &Task) -> Self {
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

/// Tolerated error of the torques for one of the deflection: a share of the [`rigid_torque`] per
/// rad. With 1e-7 rad on the paper's task 5e-7 N m, by an estimate that is some 10 times too large.
const TORQUE_SHARE_PER_RAD: f64 = 15.0;

/// Torques beyond this many times those of a rigid arm are no plan.
const TORQUE_RATIO_MAX: f64 = 1e6;

/// How to plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanOptions {
    /// Elements of link 2.
    pub elements: usize,
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// The equations to use.
    pub equations: Equations,
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
            tolerance: 1e-7,
        }
    }
}

/// Plans `task` for `arm`.
///
/// # Errors
/// [`PlanError`]: paths that cannot be followed, durations out of range, motions for
/// which no deflection is found.
///
/// ```
/// use flexor_sim::files::config::{self, DEFAULT_ARM, DEFAULT_TASK};
/// use flexor_sim::planner::plan::{PlanOptions, plan};
///
/// let arm = config::parse_arm("arm.toml", DEFAULT_ARM)?.arm;
/// let task = config::parse_task("task.toml", DEFAULT_TASK)?;
/// let plan = plan(&arm, &task, &PlanOptions::default())?;
/// assert_eq!(plan.ticks, 10_000);
/// assert!((plan.points[5_000].tip.position[0] - 0.45).abs() < 1e-9);
/// assert!(plan.error_estimate() < 1e-7);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn plan(arm: &ArmParameters, task: &Task, options: &PlanOptions) -> Result<Plan, PlanError> {
    match attempt(arm, task, options) {
        Err(PlanError::Deflection { cause, .. }) => Err(PlanError::Deflection {
            cause,
            remedy: remedy(arm, task, options),
        }),
        other => other,
    }
}

/// What makes a task that has no plan one that has: fewer elements, or more time, the shortest
/// but for a sixteenth of it. All that is tried costs less than the failure of one plan of many
/// elements.
fn remedy(arm: &ArmParameters, task: &Task, options: &PlanOptions) -> Remedy {
    /// As few as give the paper's torques.
    const FEW: usize = 3;
    /// Up to 64 times the duration.
    const DOUBLINGS: u32 = 6;
    const HALVINGS: u32 = 3;
    let refused = options.elements;
    let elements = refused.min(FEW);
    let options = PlanOptions {
        elements,
        ..*options
    };
    let within = |duration: f64| {
        let mut slower = task.clone();
        slower.path.duration = duration;
        attempt(arm, &slower, &options).ok()
    };
    let refused_s = task.path.duration;
    if elements < refused && within(refused_s).is_some() {
        return Remedy::Elements {
            refused,
            accepted: elements,
        };
    }
    let doubled = (1..=DOUBLINGS).map(|power| refused_s * f64::from(1 << power));
    let found = doubled.filter_map(|duration| Some((duration, within(duration)?)));
    let Some((mut accepted_s, mut plan)) = { found }.next() else {
        return Remedy::None;
    };
    let mut short = 0.5 * accepted_s;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (short + accepted_s);
        match within(middle) {
            Some(shorter) => (accepted_s, plan) = (middle, shorter),
            None => short = middle,
        }
    }
    let slopes = plan.points.iter().map(|point| point.root_slope.abs());
    Remedy::Duration {
        refused_s,
        accepted_s,
        elements,
        slope_rad: slopes.fold(0.0, f64::max),
    }
}

/// [`plan`], without a look for what would help.
fn attempt(arm: &ArmParameters, task: &Task, options: &PlanOptions) -> Result<Plan, PlanError> {
    let PlanOptions {
        elements,
        tick_rate_hz,
        equations,
        ..
    } = *options;
    let model = ArmModel::new(arm, elements)?;
    let surface = surface(task, arm)?;
    let path = task.path;
    let ends = match &task.travel {
        Travel::Line => {
            check_path(&model, &path)?;
            check_friction(&model, task, &surface)?;
            [
                angles_at(&model, &path, 0.0)?,
                angles_at(&model, &path, 1.0)?,
            ]
        }
        Travel::Joints(way) => way.ends,
    };
    let forces = [0.0, path.duration].map(|t| task.force_at(&surface, t));
    let (pre_ticks, ticks) = ticks(&model, task, ends, forces, tick_rate_hz)?;
    let rate = f64::from(tick_rate_hz);
    let span = [
        -f64::from(pre_ticks) / rate,
        f64::from(ticks - pre_ticks) / rate,
    ];

    let [start, end] = ends;
    let rest_start =
        resting(&model, start, forces[0], equations).ok_or(PlanError::Buckled { end: false })?;
    let rest_end =
        resting(&model, end, forces[1], equations).ok_or(PlanError::Buckled { end: true })?;
    let torque_nm = rigid_torque(&model, task, &surface);
    let fastest_s = 1.0 / fastest_zero(&model, start, forces[0])?.max(1.0 / path.duration);
    let tolerance = options.tolerance;
    let tolerance = [tolerance, TORQUE_SHARE_PER_RAD * torque_nm * tolerance];
    let load = (task, &surface);
    let problem = Deflection::new(&model, load, equations, tolerance, 0.1 * fastest_s);
    let solution = problem.solve(span, [&rest_start, &rest_end])?;

    let mut plan = Plan {
        branch: Branch::of(task),
        surface,
        task: task.clone(),
        equations,
        tick_rate_hz,
        pre_ticks,
        ticks,
        points: Vec::with_capacity(ticks as usize + 1),
        deflection: Vec::with_capacity((ticks as usize + 1) * model.dof()),
        peaks: Peaks::default(),
        solution,
        model,
    };
    let estimate = plan.error_estimate();
    if !(estimate <= 1e-2) {
        return Err(PlanError::Inaccurate { estimate });
    }
    plan.tabulate(TORQUE_RATIO_MAX * torque_nm)?;
    Ok(plan)
}

/// Control periods before the path's start, and of the whole plan. The path's `ends` are in
/// joint angles (rad), the `forces` there in N, inertial axes.
fn ticks(
    model: &ArmModel,
    task: &Task,
    ends: [[f64; 2]; 2],
    forces: [[f64; 2]; 2],
    tick_rate_hz: u32,
) -> Result<(u32, u32), PlanError> {
    let rate = f64::from(tick_rate_hz);
    let longest_s = TICKS_MAX / rate;
    let window = |window, end: usize| {
        window_length(model, window, (ends[end], forces[end]), end == 0, longest_s)
    };
    let pre = window(task.pre_actuation, 0)?;
    let post = window(task.post_actuation, 1)?;
    let duration = task.path.duration;
    let refuse = |what, value_s: f64, accepted: String| PlanError::Duration {
        what,
        value_s,
        ticks: value_s * rate,
        tick_rate_hz,
        accepted,
    };
    if !(duration * rate >= TICKS_MIN) {
        let accepted = format!("{TICKS_MIN} or more");
        return Err(refuse("duration_s", duration, accepted));
    }
    let total = pre + duration + post;
    if !(total * rate <= TICKS_MAX) {
        let longest = Shortest(longest_s);
        let accepted = format!("up to {} ({longest} s)", Shortest(TICKS_MAX));
        return Err(refuse("the whole motion", total, accepted));
    }
    // Whole ticks, rounded up: the tip rests for the remainder of the last one.
    let whole = |seconds: f64| (seconds * rate - 1e-6).ceil().max(0.0);
    let pre_ticks = whole(pre) as u32;
    Ok((pre_ticks, pre_ticks + whole(duration + post) as u32))
}

/// The resting deflection, nodal, at the joint angles `angle` (rad) under `force` (N,
/// inertial axes); `None` where the link buckles.
fn resting(
    model: &ArmModel,
    angle: [f64; 2],
    force: [f64; 2],
    equations: Equations,
) -> Option<DVector<f64>> {
    let at_rest = match equations {
        Equations::Exact => {
            dynamics::equilibrium(model, angle, force, false).map(|(q, _)| model.deflection(&q))
        }
        Equations::AsPrinted => {
            let joint = JointMotion {
                angle,
                ..JointMotion::default()
            };
            let configuration = Configuration::new(model, angle);
            let equation =
                dynamics::deflection_equation(model, &joint, &configuration, force, true);
            model.nodal.stiffness.clone().lu().solve(&equation.constant)
        }
    };
    at_rest.filter(|w| w.iter().all(|x| x.is_finite()))
}

impl Plan {
    /// Estimated largest error of the deflection, rad or share of link 2's length.
    pub fn error_estimate(&self) -> f64 {
        let length_m = self.model.arm.link2_length_m;
        self.solution
            .error_estimate(|q| largest(self.model.deflection(q).as_slice(), length_m))
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
        // What today's tables know nothing of counts where there is any.
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
        let n = self.model.dof();
        Sampler {
            plan: self,
            interval: 0,
            q: vec![0.0; n],
            q_rate: vec![0.0; n],
            q_acceleration: vec![0.0; n],
        }
    }

    /// Fills the points, deflections and peaks; refuses torques beyond `limit_nm`, N m.
    fn tabulate(&mut self, limit_nm: f64) -> Result<(), PlanError> {
        let mut points = core::mem::take(&mut self.points);
        let mut deflection = core::mem::take(&mut self.deflection);
        let mut peaks = Peaks::default();
        let mut sampler = self.sampler();
        let shapes = self.model.shapes.transpose();
        for tick in 0..=self.ticks {
            let point = sampler.at(self.time(tick));
            // Rows of shapes are columns of its transpose: contiguous.
            deflection.extend(
                shapes
                    .as_slice()
                    .chunks_exact(self.model.dof())
                    .map(|row| dot(row, &sampler.q)),
            );
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
                if let Some(last) = points.last() {
                    let last: &PlanPoint = last;
                    let rate = (torque - last.torque[joint]).abs() * f64::from(self.tick_rate_hz);
                    peaks.torque_rate[joint] = peaks.torque_rate[joint].max(rate);
                }
            }
            if !(point.root_slope.abs() <= SLOPE_MAX_RAD) {
                return Err(PlanError::Excessive {
                    what: "slope at link 2's root (rad)",
                    value: point.root_slope,
                    t_s: point.t,
                    limit: SLOPE_MAX_RAD,
                });
            }
            points.push(point);
        }
        self.points = points;
        self.deflection = deflection;
        self.peaks = peaks;
        Ok(())
    }
}

/// Evaluates a [`Plan`] at any time; cheapest for ascending times.
#[derive(Clone, Debug)]
pub struct Sampler<'p> {
    plan: &'p Plan,
    interval: usize,
    q: Vec<f64>,
    q_rate: Vec<f64>,
    q_acceleration: Vec<f64>,
}

impl Sampler<'_> {
    /// The plan at time `t`, s from the path's start; modal coordinates and rates are
    /// to be had from [`q`](Self::q) and [`q_rate`](Self::q_rate) then. Just outside
    /// the plan's time the deflection is extrapolated.
    pub fn at(&mut self, t: f64) -> PlanPoint {
        let plan = self.plan;
        let model = &plan.model;
        let (tip, mut joint) = plan.task.motion(&model.kinematics, model.arm.elbow, t);
        let turn = if tip.position[1] < 0.0 {
            plan.branch.above
        } else {
            plan.branch.below
        };
        joint.angle = joint.angle.map(|a| a + turn);

        self.interval = plan.solution.interval(t, self.interval);
        plan.solution.evaluate(
            t,
            self.interval,
            &mut self.q,
            &mut self.q_rate,
            &mut self.q_acceleration,
        );
        let force = plan.force_at(t);
        let configuration = Configuration::new(model, joint.angle);
        let motion = Motion {
            joint,
            configuration,
            q: &self.q,
            q_rate: &self.q_rate,
            q_acceleration: &self.q_acceleration,
        };
        let torque = if plan.equations == Equations::AsPrinted {
            inverse_as_printed(model, &motion, force)
        } else {
            dynamics::inverse(model, &motion, force)
        };
        PlanPoint {
            t,
            tip,
            joint,
            root_slope: model.slope_at_root(&self.q),
            root_slope_rate: model.slope_at_root(&self.q_rate),
            torque,
            force: plan.task.tip_force(t),
        }
    }

    /// Modal coordinates at the time last asked for.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Their rates, 1/s.
    pub fn q_rate(&self) -> &[f64] {
        &self.q_rate
    }

    /// What is left of the elastic equations at the time last asked for, given the
    /// point found there: zero to rounding with the exact equations.
    pub fn residual(&self, point: &PlanPoint) -> DVector<f64> {
        let motion = Motion {
            joint: point.joint,
            configuration: Configuration::new(&self.plan.model, point.joint.angle),
            q: &self.q,
            q_rate: &self.q_rate,
            q_acceleration: &self.q_acceleration,
        };
        DVector::from_vec(dynamics::elastic_residual(
            &self.plan.model,
            &motion,
            point.torque[1],
        ))
    }
}

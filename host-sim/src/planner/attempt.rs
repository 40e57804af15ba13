//! One attempt at a plan.

use crate::model::arm_model::ArmModel;
use crate::model::configuration::Surface;
use crate::model::link::LinkModel;
use crate::planner::collocation::{Boundary, Solution};
use crate::planner::elastic_bvp::{Deflection, rigid_torque, with_units};
use crate::planner::feasible::{check_friction, check_path};
use crate::planner::plan::{Branch, Peaks, Plan, PlanOptions, TICKS_MAX, TICKS_MIN};
use crate::planner::task::{Ends, Equations, PlanError, Task, Travel, surface};
use crate::planner::zeros::RestZeros;
use crate::text::Shortest;
use flexor::model::ArmParameters;

/// Tolerated error of the torques for one of the deflection: a share of the [`rigid_torque`] per
/// rad. With 1e-7 rad on the paper's task 5e-7 N m, by an estimate that is some 10 times too large.
const TORQUE_SHARE_PER_RAD: f64 = 15.0;

/// Torques beyond this many times those of a rigid arm are no plan.
const TORQUE_RATIO_MAX: f64 = 1e6;

/// [`plan`](crate::planner::planning::plan), without a look for what would help.
pub(super) fn attempt(
    arm: &ArmParameters,
    task: &Task,
    options: &PlanOptions,
) -> Result<Plan, PlanError> {
    let PlanOptions {
        tick_rate_hz,
        equations,
        ..
    } = *options;
    let model = ArmModel::of_kind(arm, options.elements, options.link)?;
    let surface = surface(task, arm)?;
    if task.travel == Travel::Line {
        check_path(&model, &task.path)?;
        check_friction(&model, task, &surface)?;
    }
    let torque_nm = rigid_torque(&model, task, &surface);
    let tolerance = options.tolerance;
    let tolerance = [tolerance, TORQUE_SHARE_PER_RAD * torque_nm * tolerance];
    let found = solve(&model, (task, &surface), options, tolerance)?;
    let mut plan = Plan {
        branch: Branch::of(task),
        surface,
        task: task.clone(),
        equations,
        tick_rate_hz,
        pre_ticks: found.pre_ticks,
        ticks: found.ticks,
        points: Vec::with_capacity(found.ticks as usize + 1),
        deflection: Vec::with_capacity((found.ticks as usize + 1) * model.dof()),
        peaks: Peaks::default(),
        solution: with_units(found.solution, &model, task),
        model,
    };
    let estimate = plan.error_estimate();
    if !(estimate <= 1e-2) {
        return Err(PlanError::Inaccurate { estimate });
    }
    plan.tabulate(TORQUE_RATIO_MAX * torque_nm)?;
    Ok(plan)
}

/// A solution of the boundary-value problem, with its time.
struct Found {
    /// In the problem's units.
    solution: Solution,
    /// Shapes at rest before and after the path, in the problem's units.
    rest: [Vec<f64>; 2],
    pre_ticks: u32,
    ticks: u32,
}

/// Finds the deflection of `model`'s link for a task on its surface; where a straight link is no guess to
/// begin with, from that of ever softer links.
fn solve(
    model: &ArmModel,
    load: (&Task, &Surface),
    options: &PlanOptions,
    tolerance: [f64; 2],
) -> Result<Found, PlanError> {
    /// Factors on the bending stiffness.
    const STIFFENED: [f64; 5] = [16.0, 8.0, 4.0, 2.0, 1.4];
    let first = solve_from(model, load, options, tolerance, None);
    let bent = model.link.kind.model == LinkModel::Geometric;
    let lost = matches!(
        first,
        Err(PlanError::Deflection { .. }
            | PlanError::SectionAngle { .. }
            | PlanError::Buckled { .. })
    );
    if !(bent && lost) {
        return first;
    }
    let mut before = None;
    for factor in STIFFENED {
        let arm = ArmParameters {
            bending_stiffness_nm2: factor * model.arm.bending_stiffness_nm2,
            ..model.arm
        };
        let stiffer = ArmModel::of_kind(&arm, model.elements, options.link)?;
        match solve_from(&stiffer, load, options, tolerance, before.as_ref()) {
            Ok(found) => before = Some(found),
            // What the link itself says.
            Err(_) => return first,
        }
    }
    solve_from(model, load, options, tolerance, before.as_ref())
}

/// The same, with the solution of a like link to begin with.
fn solve_from(
    model: &ArmModel,
    (task, surface): (&Task, &Surface),
    options: &PlanOptions,
    tolerance: [f64; 2],
    from: Option<&Found>,
) -> Result<Found, PlanError> {
    let like = from.map(|found| &found.rest);
    let load = (task, surface);
    let mut problem = Deflection::new(model, load, options.equations, tolerance, like)?;
    let zeros = problem.zeros()?;
    let (pre_ticks, ticks) = ticks(&zeros, task, options.tick_rate_hz)?;
    let rate = f64::from(options.tick_rate_hz);
    let span = [
        -f64::from(pre_ticks) / rate,
        f64::from(ticks - pre_ticks) / rate,
    ];
    let fastest = zeros[0].fastest().max(zeros[1].fastest());
    let swing = zeros[0].swing().max(zeros[1].swing());
    problem.resolving(0.1 / fastest.max(1.0 / task.path.duration), swing);
    let held = task.ends == Ends::Dirichlet || options.equations == Equations::AsPrinted;
    let ends = if held {
        problem.rest().clone().map(Boundary::held)
    } else {
        spectral(&problem, &zeros)?
    };
    let solution = problem.solve(span, &ends, held, from.map(|found| &found.solution))?;
    problem.check_orientation(&solution)?;
    Ok(Found {
        rest: problem.rest().clone(),
        solution,
        pre_ticks,
        ticks,
    })
}

/// Conditions that leave what grows before the motion, and what decays after it.
fn spectral(problem: &Deflection<'_>, zeros: &[RestZeros; 2]) -> Result<[Boundary; 2], PlanError> {
    let [start, end] = zeros;
    let arm = &problem.model().arm;
    let counts = [start, end].map(|zeros| [zeros.growing(), zeros.decaying()]);
    if counts[0] != counts[1] {
        return Err(PlanError::UnlikeEnds {
            start: counts[0],
            end: counts[1],
            tip_inertia_kgm2: arm.tip_inertia_kgm2,
        });
    }
    let condition = |end: usize| {
        let matrix = zeros[end].conditions(end == 0);
        let matrix = matrix.ok_or(PlanError::Lasting {
            end: end == 1,
            damping: arm.damping_ratio,
            tip_inertia_kgm2: arm.tip_inertia_kgm2,
        })?;
        let rest = problem.rest()[end].clone();
        Ok::<_, PlanError>(Boundary { matrix, rest })
    };
    Ok([condition(0)?, condition(1)?])
}

/// Control periods before the path's start, and of the whole plan, for the zeros at its ends.
fn ticks(zeros: &[RestZeros; 2], task: &Task, tick_rate_hz: u32) -> Result<(u32, u32), PlanError> {
    let rate = f64::from(tick_rate_hz);
    let longest_s = TICKS_MAX / rate;
    let pre = zeros[0].window_length(task.pre_actuation, true, longest_s)?;
    let post = zeros[1].window_length(task.post_actuation, false, longest_s)?;
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

//! Plans tasks, and finds by trying what would help where there is no plan.

use crate::planner::attempt::attempt;
use crate::planner::plan::{Plan, PlanOptions};
use crate::planner::task::{PlanError, Remedy, Task};
use flexor::model::ArmParameters;

/// Plans `task` for `arm`.
///
/// # Errors
/// [`PlanError`]: paths that cannot be followed, durations out of range, motions for
/// which no deflection is found.
///
/// ```
/// use flexor_sim::files::config::{self, DEFAULT_ARM, DEFAULT_TASK};
/// use flexor_sim::planner::plan::PlanOptions;
/// use flexor_sim::planner::planning::plan;
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

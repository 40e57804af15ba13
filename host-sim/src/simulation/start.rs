//! The plant for a plan, in the state that it starts in.

use crate::model::link::LinkModel;
use crate::planner::plan::Plan;
use crate::plant::{
    Plant, PlantError, PlantParameters, resting_state, resting_state_under, state_of,
};

/// State that the plant starts in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// The plan's first shape with the plan's elastic velocity.
    PlanMoving,
    /// The plan's first shape at rest.
    PlanAtRest,
    /// The plant's own equilibrium under the planned force (the linear model, at the planned angles) or
    /// under the planned torques (the geometric model, whose chord the plan may not know): what an arm that is put on the
    /// surface does by itself. Any other shape springs back, and a plant of more elements than
    /// were planned with does so within milliseconds and with many times the force.
    #[default]
    Equilibrium,
}

/// The plant with `parameters` at `plan`'s first tick, with a step that suffices for the
/// whole motion.
///
/// # Errors
/// [`PlantError`].
pub fn plant_for(
    plan: &Plan,
    parameters: &PlantParameters,
    start: Start,
) -> Result<Plant, PlantError> {
    let model = parameters.model(&plan.model.arm, plan.model.link.kind)?;
    let mut sampler = plan.sampler();
    let angle = sampler.at(plan.time(0)).joint.angle;
    let taken = |q: &[f64]| model.project_shape_from(&plan.model, q);
    let state = match start {
        Start::PlanMoving => state_of(angle, &taken(&sampler.q()), &taken(&sampler.q_rate())),
        Start::PlanAtRest => state_of(angle, &taken(&sampler.q()), &vec![0.0; model.dof()]),
        Start::Equilibrium => match model.link.kind.model {
            LinkModel::Linear => {
                resting_state(&model, parameters, angle, plan.force_at(plan.time(0)))?
            }
            LinkModel::Geometric => {
                resting_state_under(&model, &plan.surface, plan.points[0].torque, angle)?
            }
        },
    };
    let period_s = 1.0 / f64::from(plan.tick_rate_hz);
    let mut plant = Plant::new(model, parameters, plan.surface, period_s, state)?;
    for end in [plan.points.first(), plan.points.last()]
        .into_iter()
        .flatten()
    {
        plant.prepare_for(end.joint.angle)?;
    }
    Ok(plant)
}

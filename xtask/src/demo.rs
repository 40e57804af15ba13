//! What the default image is built for: the paper's arm and task.

use anyhow::Result;
use host_sim::closed_loop::RunOptions;
use host_sim::knots::{EncodedTable, encode};
use host_sim::plan::{Plan, PlanOptions, Task, Window, plan};
use host_sim::plant::{PlantParameters, Start};
use host_sim::trajectory::{Line, Profile};
use shared::arm::{ArmParameters, Elbow};
use shared::guard::LimitParameters;
use shared::law::LawParameters;
use shared::link::Setup;

/// The paper's arm (Table 1).
const ARM: ArmParameters = ArmParameters {
    link1_length_m: 0.5,
    link1_mass_kg: 8.0,
    link2_length_m: 0.55,
    link2_mass_kg: 0.24,
    bending_stiffness_nm2: 0.48,
    damping_ratio: 0.05,
    root_inertia_kgm2: 0.0,
    tip_mass_kg: 0.0,
    tip_inertia_kgm2: 0.0,
    gravity_m_s2: [0.0, 9.81],
    elbow: Elbow::Down,
};

/// Arm, gains and limits of the default image.
pub(crate) const SETUP: Setup = Setup {
    arm: ARM,
    law: LawParameters {
        force_derivative_s: 0.0,
        force_proportional: 0.1,
        force_integral_per_s: 2.0,
        slope_rate_nms_rad: 0.01,
        force_filter_hz: Some(20.0),
        slope_rate_filter_hz: Some(20.0),
        ..LawParameters::FEEDFORWARD
    },
    limits: LimitParameters {
        torque_nm: [40.0, 4.0],
        torque_rate_nm_s: [4000.0, 400.0],
    },
};

/// The plan and its table.
pub(crate) fn table() -> Result<(Plan, EncodedTable)> {
    table_for(2.0)
}

/// The paper's path in the given time, s.
pub(crate) fn table_for(duration_s: f64) -> Result<(Plan, EncodedTable)> {
    let task = Task {
        path: Line {
            from: [0.7, 0.05],
            to: [0.2, 0.05],
            duration: duration_s,
            profile: Profile::Poly11,
        },
        normal_force: 2.0,
        direction: None,
        pre_actuation: Window::Fixed(0.0),
        post_actuation: Window::Fixed(0.0),
    };
    let plan = plan(&ARM, &task, &PlanOptions::default())?;
    let table = encode(&plan)?;
    Ok((plan, table))
}

/// How the demo runs: against an arm of 5 % less stiffness, so that the feedback has
/// work to do.
pub(crate) fn options() -> RunOptions {
    RunOptions {
        law: SETUP.law,
        limits: SETUP.limits,
        plant: PlantParameters {
            bending_stiffness_scale: 0.95,
            ..PlantParameters::default()
        },
        start: Start::PlanMoving,
    }
}

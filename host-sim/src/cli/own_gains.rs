//! Which arms gains of the hybrid law must hold for a scenario, gains for an arm that has none, and
//! the refusal of those that hold not all.

use super::CliError;
use crate::analysis::hybrid::proof::{PlantProof, Subject};
use crate::analysis::hybrid::{
    Design, Effort, HybridError, LoopSpread, Noise, Problem, Proof, design, friction_leverage,
    poses,
};
use crate::campaign::scenario::Scenario;
use crate::files::{config, export};
use crate::model::link::LinkKind;
use crate::planner::plan::Plan;
use flexor::control::{HybridParameters, MotionParameters};
use serde_json::{Map, Value, json};

/// Poses of the path at which a design is made and gains are held against a scenario.
pub(super) const DESIGN_POSES: usize = 9;

/// `base` with what `scenario` says of its arms in its place.
fn laid_over(base: LoopSpread, scenario: &Scenario) -> LoopSpread {
    let bounds = |name: &str, otherwise: [f64; 2]| {
        let mut numbers = scenario.numbers.iter();
        let found = numbers.find(|(key, _)| key.name == name);
        found.map_or(otherwise, |(_, distribution)| distribution.bounds())
    };
    let mass1 = bounds("plant.link1_mass_scale", base.mass_scale);
    let mass2 = bounds("plant.link2_mass_scale", base.mass_scale);
    let [slowest, _] = bounds("drive2.bandwidth_Hz", [base.drive_bandwidth_hz; 2]);
    let [_, latest] = bounds("drive2.delay_ticks", [base.delay_ticks as f64; 2]);
    let [_, friction] = bounds("contact.friction", [base.friction; 2]);
    let stiffness = "plant.bending_stiffness_scale";
    LoopSpread {
        root_inertia_kgm2: bounds("plant.root_inertia_kgm2", base.root_inertia_kgm2),
        bending_stiffness_scale: bounds(stiffness, base.bending_stiffness_scale),
        mass_scale: [mass1[0].min(mass2[0]), mass1[1].max(mass2[1])],
        damping_scale: bounds("plant.damping_scale", base.damping_scale),
        contact_stiffness_n_m: bounds("contact.stiffness_N_m", base.contact_stiffness_n_m),
        friction,
        drive_bandwidth_hz: slowest,
        delay_ticks: (latest as usize).max(1),
        link: base.link,
    }
}

/// How the link of `scenario`'s arms bends, where that of `plan` is meant.
fn link_of(scenario: &Scenario, plan: &Plan) -> LinkKind {
    scenario.middle().plant.link(plan.model.link.kind)
}

/// The arms of `scenario`: what it leaves out is as planned.
fn arms_of(scenario: &Scenario, plan: &Plan) -> LoopSpread {
    let arm = &plan.model.arm;
    let contact = scenario.middle().compliant.contact.stiffness_n_m;
    let planned = LoopSpread {
        root_inertia_kgm2: [arm.root_inertia_kgm2; 2],
        bending_stiffness_scale: [1.0; 2],
        mass_scale: [1.0; 2],
        damping_scale: [1.0; 2],
        contact_stiffness_n_m: [contact; 2],
        friction: 0.0,
        ..LoopSpread::uncalibrated(arm, link_of(scenario, plan))
    };
    laid_over(planned, scenario)
}

/// Arms that gains are found for where `scenario` says what it says: the rest is not calibrated, and
/// a root without inertia is one that nobody knows.
pub(super) fn to_be_held(scenario: &Scenario, plan: &Plan) -> LoopSpread {
    let arm = &plan.model.arm;
    let poses = poses(plan, DESIGN_POSES);
    let usual = LoopSpread::uncalibrated(arm, link_of(scenario, plan))
        .with_friction_for(friction_leverage(&poses));
    let mut spread = laid_over(usual, scenario);
    if spread.root_inertia_kgm2[1] == 0.0 {
        spread.root_inertia_kgm2 = LoopSpread::unknown_root_inertia(arm);
    }
    spread
}

/// The text of a controller file with gains for `plan`'s arm on the arms of `scenario`, where no
/// file gives any.
///
/// # Errors
/// [`HybridError`].
pub(super) fn designed_text(plan: &Plan, scenario: &Scenario) -> Result<String, CliError> {
    let spread = to_be_held(scenario, plan);
    let found = designed(plan, spread, Effort::Design)?;
    let how = origin(&spread, plan.tick_rate_hz);
    Ok(config::controller_toml(&found.law.into(), &how))
}

/// Gains for `plan`'s arm on arms of this spread.
///
/// # Errors
/// [`HybridError`].
pub(super) fn designed(
    plan: &Plan,
    spread: LoopSpread,
    effort: Effort,
) -> Result<Design, HybridError> {
    let poses = poses(plan, DESIGN_POSES);
    let problem = Problem {
        arm: &plan.model.arm,
        poses: &poses,
        tick_rate_hz: plan.tick_rate_hz,
        spread,
        noise: Noise::for_plan(plan),
        joint1_torque_nm: plan.peaks.torque[0],
        motion: MotionParameters::DEFAULT,
    };
    design(&problem, effort)
}

/// How gains were found, for the head of their file.
pub(super) fn origin(spread: &LoopSpread, tick_rate_hz: u32) -> Vec<String> {
    let [low, high] = spread.root_inertia_kgm2;
    vec![
        format!("Found by `flexor gains` for root inertias from {low:.3e} to {high:.3e} kg m^2,"),
        format!(
            "masses times {:?}, bending stiffness times {:?},",
            spread.mass_scale, spread.bending_stiffness_scale
        ),
        format!(
            "friction up to {}, drives of {} Hz with {} ticks of delay, {tick_rate_hz} Hz.",
            spread.friction, spread.drive_bandwidth_hz, spread.delay_ticks
        ),
    ]
}

/// Holds gains against the arms of `scenario`: what a summary says of them, and why they are refused,
/// if they are.
///
/// # Errors
/// [`HybridError`].
pub(super) fn hold(
    plan: &Plan,
    scenario: &Scenario,
    law: &HybridParameters,
) -> Result<(Map<String, Value>, Option<String>), HybridError> {
    let arm = &plan.model.arm;
    let spread = arms_of(scenario, plan);
    let poses = poses(plan, DESIGN_POSES);
    let subject = Subject {
        arm,
        law,
        poses: &poses,
        tick_rate_hz: plan.tick_rate_hz,
    };
    let proof = Proof::new(&subject, &spread, true)?;
    let (up, down, ticks) = proof.margins();
    let worst = proof.worst();
    let keys = export::object([
        ("gains", law_json(law)),
        ("gains_stable", json!(proof.is_stable())),
        (
            "gains_worst_pole_per_s",
            json!(worst.map(|p| [p.slowest.re, p.slowest.im])),
        ),
        ("gains_factor_margin", json!([down, up])),
        ("gains_delay_margin_ticks", json!(ticks)),
    ]);
    Ok((keys, verdict(&proof, &spread)))
}

/// Why gains are refused, if they are.
pub(super) fn verdict(proof: &Proof, spread: &LoopSpread) -> Option<String> {
    if proof.is_stable() {
        return None;
    }
    let worst = proof.worst()?;
    let [low, high] = spread.root_inertia_kgm2;
    let remedy = match proof.root_inertia_kgm2 {
        Some([from, to]) if from > low || to < high => {
            format!(
                "root_inertia_kgm2 from {low:.3e} to {high:.3e} is asked for; accepted with these gains: from {from:.3e} to {to:.3e}, or gains that `flexor gains design` finds for that range"
            )
        }
        _ => "gains that `flexor gains design` finds for these arms are accepted".into(),
    };
    Some(format!("{}; {remedy}", grows(worst)))
}

/// What an arm does that is not stable.
fn grows(worst: &PlantProof) -> String {
    let hertz = worst.slowest.im.abs() / core::f64::consts::TAU;
    format!(
        "{} grows at {:+.2} 1/s ({hertz:.1} Hz) at t = {:.3} s",
        worst.name, worst.slowest.re, worst.t_s
    )
}

/// The gains of joint 2 and joint 1 as a file names them.
pub(super) fn law_json(p: &HybridParameters) -> Value {
    json!({
        "joint_stiffness_Nm_rad": p.joint_stiffness_nm_rad,
        "joint_damping_Nms_rad": p.joint_damping_nms_rad,
        "rate_filter_Hz": p.rate_filter_hz,
        "joint1_integral_Nm_rads": p.joint1_integral_nm_rads,
        "force_integral_per_s": p.force_integral_per_s,
        "torque_loop_per_s": p.torque_loop_per_s,
        "section_frequency_rad_s": p.section_frequency_rad_s,
        "section_damping": p.section_damping,
        "section_angle_Nm_rad": p.section_angle_nm_rad,
        "section_force": p.section_force,
    })
}

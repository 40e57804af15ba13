//! `flexor gains`: are these gains stable over the whole motion, and with what margin;
//! `flexor gains tune`: find good ones.

mod examine;
mod hybrid;
mod tune;

use super::bench::ScenarioArgs;
use super::plan::Planned;
use super::provenance::Provenance;
use super::{CliError, Common, Output, controller, pages, paper_law, say};
use crate::analysis::stability::advice::{advice, warning};
use crate::analysis::stability::map::GainId;
use crate::analysis::stability::path::{Report, Summary};
use crate::analysis::stability::{StabilityError, path};
use crate::files::{config, export};
use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::plant::spread::{PlantVariant, Spread};
use crate::simulation::cases;
use crate::text::Shortest;
use clap::Args;
use clap::Subcommand;
use flexor::control::PaperParameters;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Arguments of `gains`.
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct GainsArgs {
    #[command(subcommand)]
    command: Option<GainsCommand>,
    #[command(flatten)]
    examine: examine::ExamineArgs,
}

#[derive(Subcommand)]
enum GainsCommand {
    /// Finds the gains and filters with the least predicted force error over a spread of
    /// plants, subject to margins, and writes controller.toml.
    #[command(
        after_help = "Example: flexor gains tune --task examples/task_fast.toml --out out/gains\n\nThe same seed finds the same gains. Of the controller file only its options count: force_projection, slope_rate_feedback and feedforward."
    )]
    Tune(tune::TuneArgs),
    /// Finds gains of the hybrid law for the arm at hand that hold every arm of a spread, and writes
    /// controller.toml.
    #[command(
        after_help = "Example: flexor gains design --arm examples/arm.toml --root-inertia-kgm2 3e-5 3e-4 --out out/gains\n\nWithout --root-inertia-kgm2 and --scenario the arm's own inertia is taken to be known to a factor of 2, none as unknown."
    )]
    Design(DesignArgs),
}

/// Arguments of `gains design`.
#[derive(Args)]
struct DesignArgs {
    #[command(flatten)]
    plants: PlantArgs,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/gains")]
    out: PathBuf,
}

/// What both take.
#[derive(Args)]
struct PlantArgs {
    #[command(flatten)]
    common: Common,
    /// Gains, and which law; without it those that `run` takes: of the hybrid law, for the arm at
    /// hand
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Hybrid law: least and largest inertia that turns with link 2's root, rotor and hub, kg m^2;
    /// without it the scenario's, or what the arm's file tells
    #[arg(long, value_names = ["LEAST", "LARGEST"], num_args = 2)]
    root_inertia_kgm2: Vec<f64>,
    /// Paper's law: the plant in the middle; without it the planned arm [examples/plant_soft.toml]
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Paper's law: plants around it [examples/spread.toml]
    #[arg(long, value_name = "FILE")]
    spread: Option<PathBuf>,
    /// Points of the path at which the loop is frozen
    #[arg(long, value_name = "N", default_value_t = path::DEFAULT_POINTS as u32,
          value_parser = clap::value_parser!(u32).range(2..=1000))]
    points: u32,
}

/// What is examined, read and planned.
struct Setting {
    law: PaperParameters,
    plant: PlantParameters,
    spread: Spread,
    planned: Planned,
    /// What it is made from.
    made: Provenance,
}

impl Setting {
    /// The plant in the middle.
    fn variant(&self) -> Result<PlantVariant, StabilityError> {
        let plan = &self.planned.plan;
        let (arm, rate) = (&plan.model.arm, plan.tick_rate_hz);
        Ok(PlantVariant::new(arm, rate, &self.plant, 0.0)?)
    }
}

impl PlantArgs {
    /// The files that are read.
    fn inputs(&self) -> impl Iterator<Item = Option<&Path>> {
        let files = [&self.controller, &self.plant, &self.spread];
        let inputs = self.common.inputs().into_iter();
        inputs.chain(files.map(|file| file.as_deref()))
    }

    /// Whether the paper's law is asked for.
    fn is_paper(&self) -> Result<bool, CliError> {
        let law = controller(self.controller.as_deref(), config::DEFAULT_CONTROLLER)?;
        Ok(law.paper().is_some())
    }

    fn setting(&self) -> Result<Setting, CliError> {
        let scenario = &self.scenario;
        let what = match () {
            () if scenario.scenario.is_some() => Some("--scenario"),
            () if !scenario.set.is_empty() => Some("--set"),
            () if !self.root_inertia_kgm2.is_empty() => Some("--root-inertia-kgm2"),
            () => None,
        };
        if let Some(what) = what {
            return Err(CliError::NoEffect {
                what,
                beside: "with the paper's law, whose plants --plant and --spread tell",
            });
        }
        let (arm, task) = self.common.load_on_surface("`flexor gains`")?;
        let law = paper_law("gains", self.controller.as_deref())?;
        let plant = match &self.plant {
            Some(file) => config::load(Some(file), "", config::parse_plant)?.0,
            None => cases::plant(arm.elements, 1.0),
        };
        let spread = config::load(
            self.spread.as_deref(),
            config::DEFAULT_SPREAD,
            config::parse_spread,
        )?;
        let planned = self.common.plan(&arm, &task)?;
        let made = Provenance::of(&self.common)?
            .profile(&task)
            .file(
                "controller",
                self.controller.as_deref(),
                config::PAPER_CONTROLLER,
            )?
            .file("plant", self.plant.as_deref(), "")?
            .file("spread", self.spread.as_deref(), config::DEFAULT_SPREAD)?
            .plant(&plant);
        Ok(Setting {
            law,
            plant,
            spread,
            planned,
            made,
        })
    }
}

/// Runs `gains`.
pub(super) fn command(args: &GainsArgs) -> Result<(), CliError> {
    match &args.command {
        Some(GainsCommand::Tune(args)) => return tune::tune_command(args),
        Some(GainsCommand::Design(args)) => {
            return hybrid::design_command(&args.plants, &args.out);
        }
        None => {}
    }
    examine::examine(&args.examine)
}

/// Says on standard error what is wrong with the gains that are about to be simulated on
/// `plant`.
pub(super) fn warn(plan: &Plan, plant: &PlantParameters, law: &PaperParameters) {
    // What cannot be examined is not wrong for that: the run will tell.
    for word in warning(plan, plant, law).unwrap_or_default() {
        say(format_args!("warning: {word}"));
    }
}

/// A plant's figures as flat JSON.
fn summary_json(summary: &Summary) -> Map<String, Value> {
    export::object([
        ("stable", json!(summary.stable)),
        ("spectral_radius_max", json!(summary.spectral_radius_max)),
        ("worst_t_s", json!(summary.worst_t_s)),
        ("worst_mode", json!(summary.worst_mode)),
        (
            "worst_pole_per_s",
            json!([summary.worst_pole.re, summary.worst_pole.im]),
        ),
        ("contact_damping_min", json!(summary.contact_damping_min)),
        ("gain_margin_dB", json!(summary.gain_margin_db)),
        ("gain_margin_t_s", json!(summary.gain_margin_t_s)),
        ("delay_margin_ticks", json!(summary.delay_margin_ticks)),
        (
            "sliding_growth_max_per_s",
            json!(summary.tangential_growth_max_per_s),
        ),
    ])
}

/// A spread's figures: the worst of each.
fn spread_json(report: &Report) -> Value {
    let all = &report.spread;
    let least = |f: &dyn Fn(&Summary) -> f64| all.iter().map(f).fold(f64::INFINITY, f64::min);
    let Some(worst) = all.iter().reduce(|worst, other| {
        if other.spectral_radius_max > worst.spectral_radius_max {
            other
        } else {
            worst
        }
    }) else {
        return Value::Null;
    };
    json!({
        "plants": all.len(),
        "stable": all.iter().all(|s| s.stable),
        "unstable_plants": all.iter().filter(|s| !s.stable).count(),
        "worst_plant": worst.name,
        "spectral_radius_max": worst.spectral_radius_max,
        "worst_t_s": worst.worst_t_s,
        "worst_mode": worst.worst_mode,
        "contact_damping_min": least(&|s| s.contact_damping_min),
        "gain_margin_dB": least(&|s| s.gain_margin_db),
        "delay_margin_ticks": least(&|s| s.delay_margin_ticks),
    })
}

/// The variant of `setting` that `report` found worst.
fn worst_variant(setting: &Setting, report: &Report) -> Result<PlantVariant, StabilityError> {
    let plan = &setting.planned.plan;
    let worst = report.worst();
    let variants = setting
        .spread
        .variants(&plan.model.arm, plan.tick_rate_hz, &setting.plant)?;
    match variants.into_iter().find(|(name, _)| *name == worst.name) {
        Some((_, variant)) => Ok(variant),
        None => setting.variant(),
    }
}

/// What to say about the gains.
fn warnings(
    setting: &Setting,
    law: &PaperParameters,
    report: &Report,
) -> Result<Vec<String>, StabilityError> {
    let plan = &setting.planned.plan;
    let times: Vec<f64> = report.points.iter().map(|p| p.t).collect();
    // The plant in the middle first: where it is unstable, the rest follows.
    let (summary, variant) = if report.nominal.stable && !report.worst().stable {
        (report.worst(), worst_variant(setting, report)?)
    } else {
        (&report.nominal, setting.variant()?)
    };
    let mut words = advice(plan, &variant, law, summary, &times)?;
    let growth = report.nominal.tangential_growth_max_per_s;
    if report.nominal.stable && growth > 1.0 {
        words.push(format!(
            "the tangential mode, the tip's motion along the surface, grows at up to {growth:.2} 1/s; no gain of eq. 18-20 controls it"
        ));
    }
    Ok(words)
}

/// Writes the page and its figures, and says where they are.
fn write_page(
    setting: &Setting,
    law: &PaperParameters,
    report: &Report,
    map_of: [GainId; 2],
    warnings: &[String],
    facts: &[(String, String)],
    output: &Output,
) -> Result<String, CliError> {
    let page = pages::GainsContent {
        plan: &setting.planned.plan,
        plant: &setting.plant,
        law,
        report,
        map_of,
        warnings,
        facts,
        provenance: &setting.made.clone().gains(&(*law).into()).facts(),
    };
    pages::gains(output, &page)
}

/// Gains as facts.
fn law_facts(law: &PaperParameters) -> Vec<(String, String)> {
    let corner =
        |hz: Option<f64>| hz.map_or("none".to_string(), |hz| format!("{} Hz", Shortest(hz)));
    [
        ("K_DF", format!("{} s", Shortest(law.force_derivative_s))),
        ("K_PF", Shortest(law.force_proportional).to_string()),
        (
            "K_IF",
            format!("{} 1/s", Shortest(law.force_integral_per_s)),
        ),
        (
            "K_w",
            format!("{} N m s/rad", Shortest(law.slope_rate_nms_rad)),
        ),
        ("force filter", corner(law.force_filter_hz)),
        ("slope rate filter", corner(law.slope_rate_filter_hz)),
    ]
    .map(|(name, fact)| (name.to_string(), fact))
    .to_vec()
}

/// The report as facts.
fn report_facts(report: &Report, tick_rate_hz: u32) -> Vec<(String, String)> {
    let nominal = &report.nominal;
    let words = |stable: bool| if stable { "stable" } else { "UNSTABLE" };
    let mut facts = vec![
        (
            "the loop".to_string(),
            format!(
                "{} at {} points of the path, {tick_rate_hz} Hz; slowest or unstable: {} at t = {:.3} s",
                words(nominal.stable),
                report.points.len(),
                nominal.worst_mode,
                nominal.worst_t_s
            ),
        ),
        (
            "margins".to_string(),
            format!(
                "gains x {:.3} ({:.1} dB), {:.2} ticks of delay; contact mode's damping ratio {:.3}",
                libm::pow(10.0, nominal.gain_margin_db / 20.0),
                nominal.gain_margin_db,
                nominal.delay_margin_ticks,
                nominal.contact_damping_min
            ),
        ),
    ];
    if !report.spread.is_empty() {
        let least =
            |f: &dyn Fn(&Summary) -> f64| report.spread.iter().map(f).fold(f64::INFINITY, f64::min);
        let unstable = report.spread.iter().filter(|s| !s.stable).count();
        facts.push((
            format!("{} plants around it", report.spread.len()),
            format!(
                "{}; at least {:.1} dB, {:.2} ticks, damping ratio {:.3}",
                if unstable == 0 {
                    "all stable".to_string()
                } else {
                    format!("{unstable} UNSTABLE")
                },
                least(&|s| s.gain_margin_db),
                least(&|s| s.delay_margin_ticks),
                least(&|s| s.contact_damping_min)
            ),
        ));
    }
    facts
}

//! `flexor gains`: are these gains stable over the whole motion, and with what margin;
//! `flexor gains tune`: find good ones.

use super::plan::Planned;
use super::{CliError, Common, Output, controller, print, print_facts, progress_bar};
use crate::analysis::stability::advice::{advice, warning};
use crate::analysis::stability::linear::{Linear, OperatingPoint};
use crate::analysis::stability::map::GainId;
use crate::analysis::stability::path::{Report, Summary};
use crate::analysis::stability::printed::Printed;
use crate::analysis::stability::tune::TuneOptions;
use crate::analysis::stability::{StabilityError, map, path, tune};
use crate::files::config::ArmConfig;
use crate::files::{config, export};
use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::plant::spread::{PlantVariant, Spread};
use crate::report;
use crate::simulation::cases;
use crate::text::Shortest;
use clap::{Args, Subcommand, ValueEnum};
use flexor::control::{ForceProjection, LawParameters, SlopeRateFeedback};
use nalgebra::Complex;
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `gains`.
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct GainsArgs {
    #[command(subcommand)]
    command: Option<GainsCommand>,
    #[command(flatten)]
    examine: ExamineArgs,
}

#[derive(Subcommand)]
enum GainsCommand {
    /// Finds the gains and filters with the least predicted force error over a spread of
    /// plants, subject to margins, and writes controller.toml.
    #[command(
        after_help = "Example: flexor gains tune --task examples/task_fast.toml --out out/gains\n\nThe same seed finds the same gains. Of the controller file only its options count: force_projection, slope_rate_feedback and feedforward."
    )]
    Tune(TuneArgs),
}

/// What both take.
#[derive(Args)]
struct PlantArgs {
    #[command(flatten)]
    common: Common,
    /// Gains, and options of the law; without it those of examples/controller.toml
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    /// The plant in the middle; without it the planned arm [examples/plant_soft.toml]
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Plants around it [examples/spread.toml]
    #[arg(long, value_name = "FILE")]
    spread: Option<PathBuf>,
    /// Points of the path at which the loop is frozen
    #[arg(long, value_name = "N", default_value_t = path::DEFAULT_POINTS as u32,
          value_parser = clap::value_parser!(u32).range(2..=1000))]
    points: u32,
}

#[derive(Args)]
struct ExamineArgs {
    #[command(flatten)]
    plants: PlantArgs,
    /// Time of the path, s, at which poles without feedback are listed
    #[arg(
        long,
        value_name = "T",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    at: f64,
    /// Equations whose poles are listed: the plant's without feedback, or eq. 23 as the
    /// paper prints it, with the gains
    #[arg(long, value_enum, default_value_t = LinearisationArg::Exact)]
    linearisation: LinearisationArg,
    /// The two gains of the map
    #[arg(long, value_enum, num_args = 2, value_names = ["GAIN", "GAIN"],
          default_values_t = [GainArg::KIf, GainArg::KW])]
    map: Vec<GainArg>,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/gains")]
    out: PathBuf,
}

#[derive(Args)]
struct TuneArgs {
    #[command(flatten)]
    plants: PlantArgs,
    /// Least gain margin of every plant, dB
    #[arg(
        long = "gain-margin-dB",
        value_name = "DB",
        default_value_t = 6.0,
        allow_negative_numbers = true
    )]
    gain_margin_db: f64,
    /// Least delay margin of every plant, ticks
    #[arg(
        long,
        value_name = "TICKS",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    delay_margin_ticks: f64,
    /// Seed of the search
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Particles of the swarm
    #[arg(long, value_name = "N", default_value_t = 30,
          value_parser = clap::value_parser!(u32).range(2..=1000))]
    particles: u32,
    /// Steps of each particle
    #[arg(long, value_name = "N", default_value_t = 50,
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    iterations: u32,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/gains")]
    out: PathBuf,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum LinearisationArg {
    Exact,
    AsPrinted,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum GainArg {
    #[value(name = "K_DF")]
    KDf,
    #[value(name = "K_PF")]
    KPf,
    #[value(name = "K_IF")]
    KIf,
    #[value(name = "K_w")]
    KW,
}

impl GainArg {
    fn gain(self) -> GainId {
        match self {
            Self::KDf => GainId::ForceDerivative,
            Self::KPf => GainId::ForceProportional,
            Self::KIf => GainId::ForceIntegral,
            Self::KW => GainId::SlopeRate,
        }
    }
}

/// What is examined, read and planned.
struct Setting {
    arm: ArmConfig,
    law: LawParameters,
    plant: PlantParameters,
    spread: Spread,
    planned: Planned,
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
    fn setting(&self) -> Result<Setting, CliError> {
        let (arm, task) = self.common.load()?;
        let law = controller(self.controller.as_deref())?;
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
        Ok(Setting {
            arm,
            law,
            plant,
            spread,
            planned,
        })
    }
}

/// Runs `gains`.
pub(super) fn command(args: &GainsArgs) -> Result<(), CliError> {
    match &args.command {
        None => examine(&args.examine),
        Some(GainsCommand::Tune(args)) => tune_command(args),
    }
}

/// Says on standard error what is wrong with the gains that are about to be simulated on
/// `plant`.
pub(super) fn warn(plan: &Plan, plant: &PlantParameters, law: &LawParameters) {
    // What cannot be examined is not wrong for that: the run will tell.
    for word in warning(plan, plant, law).unwrap_or_default() {
        super::say(format_args!("warning: {word}"));
    }
}

fn pairs(poles: &[Complex<f64>]) -> Value {
    json!(poles.iter().map(|p| [p.re, p.im]).collect::<Vec<_>>())
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
    law: &LawParameters,
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

/// Writes the page and its figures.
fn write_page(
    setting: &Setting,
    law: &LawParameters,
    report: &Report,
    map_of: [GainId; 2],
    warnings: &[String],
    facts: &[(String, String)],
    output: &Output<'_>,
) -> Result<(), CliError> {
    let plan = &setting.planned.plan;
    let variant = setting.variant()?;
    let start = plan.time(0);
    let frozen_points = path::frozen_points(plan, &variant, &[start])?;
    let map = map::map(plan, &variant, law, map_of)?;
    let mut spread: Vec<&Summary> = report.spread.iter().collect();
    spread.sort_by(|a, b| b.spectral_radius_max.total_cmp(&a.spectral_radius_max));
    let plants: Vec<&Summary> = std::iter::once(&report.nominal).chain(spread).collect();
    let content = report::GainsPage {
        title: "Flexor: gains",
        warnings,
        plants: &plants,
        gains: report::Gains {
            points: &report.points,
            frozen_points: &frozen_points,
            map: &map,
            times: [start, plan.time(plan.ticks)],
        },
        notes: facts,
    };
    Ok(report::write_gains(output.folder, &content)?)
}

/// Gains as facts.
fn law_facts(law: &LawParameters) -> Vec<(String, String)> {
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

fn examine(args: &ExamineArgs) -> Result<(), CliError> {
    if let [first, second] = args.map[..]
        && first == second
    {
        let name = first.to_possible_value();
        return Err(CliError::Map {
            gain: name.map_or(String::new(), |name| name.get_name().into()),
        });
    }
    let setting = args.plants.setting()?;
    let plan = &setting.planned.plan;
    let law = &setting.law;
    let [start, end] = [plan.time(0), plan.time(plan.ticks)];
    if !(args.at >= start && args.at <= end) {
        return Err(CliError::At {
            at_s: args.at,
            start_s: start,
            end_s: end,
        });
    }
    let since = Instant::now();
    // Before the work: a folder that cannot be made should not cost minutes.
    let output = Output::new(&args.out)?;
    let points = args.plants.points as usize;
    let progress = progress_bar(
        Report::effort(&setting.spread, points),
        "points of all plants, {eta} left",
    );
    let report = Report::new(plan, &setting.plant, &setting.spread, law, points, &|| {
        progress.inc(1);
    })?;
    progress.finish_and_clear();
    let wall_ms = since.elapsed().as_secs_f64() * 1e3;
    let warnings = warnings(&setting, law, &report)?;

    let variant = setting.variant()?;
    let point = OperatingPoint::new(plan, &mut plan.sampler(), &variant, args.at)?;
    let poles = match args.linearisation {
        LinearisationArg::Exact => Linear::new(&variant, &point)?.poles(),
        LinearisationArg::AsPrinted => Printed::at(&variant, law, plan.normal_angle(), &point)
            .map_or(vec![], |printed| printed.poles()),
    };

    let mut facts = law_facts(law);
    facts.extend(report_facts(&report, plan.tick_rate_hz));
    facts.push(("examined in".into(), format!("{wall_ms:.0} ms")));
    let map_of = [args.map[0].gain(), args.map[1].gain()];
    write_page(&setting, law, &report, map_of, &warnings, &facts, &output)?;

    let mut summary = summary_json(&report.nominal);
    summary.extend(export::object([
        ("points", json!(report.points.len())),
        ("tick_rate_Hz", json!(plan.tick_rate_hz)),
        ("spread", spread_json(&report)),
        ("warnings", json!(warnings)),
        ("at_s", json!(args.at)),
        (
            "linearisation",
            json!(match args.linearisation {
                LinearisationArg::Exact => "exact",
                LinearisationArg::AsPrinted => "as-printed",
            }),
        ),
        ("poles_per_s", pairs(&poles)),
        ("wall_ms", json!(wall_ms)),
        ("plan_ms", json!(setting.planned.plan_ms)),
    ]));
    let summary = Value::Object(summary);
    output.json("summary.json", &summary)?;
    for word in &warnings {
        super::say(format_args!("warning: {word}"));
    }
    if args.plants.common.json {
        return print(&summary);
    }
    print_facts(&facts)?;
    let label = match args.linearisation {
        LinearisationArg::Exact => "poles without feedback",
        LinearisationArg::AsPrinted => "poles of eq. 23 as printed",
    };
    print(format_args!("\n{label} at t = {} s, 1/s:", args.at))?;
    for pole in poles.iter().filter(|p| p.im >= 0.0) {
        let pair = if pole.im == 0.0 {
            String::new()
        } else {
            format!(" +- {:.3}j", pole.im)
        };
        print(format_args!("  {:.3}{pair}", pole.re))?;
    }
    print(format_args!(
        "\nThe report is {}",
        args.out.join("report.html").display()
    ))
}

/// `law` as a `controller.toml` that says how it was found.
fn controller_toml(law: &LawParameters, how: &[String]) -> String {
    let mut text = String::from(
        "# Gains of eq. 18-20, found by `flexor gains tune`; docs/gains.md says how.\n",
    );
    for line in how {
        text += &format!("# {line}\n");
    }
    // Every number as a float, which TOML tells from an integer.
    let number = |x: f64| format!("{x:?}");
    let mut put = |assignment: String, comment: &str| {
        // A line break before an assignment starts a paragraph.
        let bare = assignment.trim_start();
        if bare.len() < assignment.len() {
            text.push('\n');
        }
        text += &format!("{bare:<41} # {comment}\n");
    };
    let l = law;
    put(
        format!("\nK_DF_s = {}", number(l.force_derivative_s)),
        "on the force error's derivative",
    );
    put(
        format!("K_PF = {}", number(l.force_proportional)),
        "on the force error",
    );
    put(
        format!("K_IF_per_s = {}", number(l.force_integral_per_s)),
        "on its integral",
    );
    put(
        format!("K_w_Nms_rad = {}", number(l.slope_rate_nms_rad)),
        "on the root slope rate",
    );
    let acts = l.force_derivative_s != 0.0 || l.force_proportional != 0.0;
    match l.force_filter_hz {
        Some(hz) if acts => put(
            format!("\nforce_filter_Hz = {}", number(hz)),
            "corner of the filter on the force error; left out: none, or 100 with K_DF",
        ),
        _ => put(
            "\n# force_filter_Hz = 100.0".into(),
            "corner of the filter on the force error; left out: none, or 100 with K_DF",
        ),
    }
    match l.slope_rate_filter_hz {
        Some(hz) => put(
            format!("slope_rate_filter_Hz = {}", number(hz)),
            "corner of the filter on the slope rate; left out: none",
        ),
        None => put(
            "# slope_rate_filter_Hz = 50.0".into(),
            "corner of the filter on the slope rate; left out: none",
        ),
    }
    put(
        match l.force_projection {
            ForceProjection::JacobianTranspose => "\nforce_projection = \"jacobian-transpose\"",
            ForceProjection::AsPrinted => "\nforce_projection = \"as-printed\"",
        }
        .into(),
        "\"jacobian-transpose\" or \"as-printed\"",
    );
    put(
        match l.slope_rate_feedback {
            SlopeRateFeedback::Deviation => "slope_rate_feedback = \"deviation\"",
            SlopeRateFeedback::AsPrinted => "slope_rate_feedback = \"as-printed\"",
        }
        .into(),
        "\"deviation\" from the plan, or \"as-printed\": all of it",
    );
    put(
        format!("feedforward = {}", l.feedforward),
        "false: feedback only, as in the paper's figure 5",
    );
    text
}

fn tune_command(args: &TuneArgs) -> Result<(), CliError> {
    let setting = args.plants.setting()?;
    let plan = &setting.planned.plan;
    let positive = |what, value: f64, most: f64| {
        if value >= 0.0 && value <= most {
            Ok(())
        } else {
            Err(CliError::Margin { what, value, most })
        }
    };
    positive(
        "--gain-margin-dB",
        args.gain_margin_db,
        path::GAIN_MARGIN_MAX_DB - 1.0,
    )?;
    positive(
        "--delay-margin-ticks",
        args.delay_margin_ticks,
        path::DELAY_MARGIN_MAX_TICKS - 1.0,
    )?;
    let options = TuneOptions {
        law: setting.law,
        plant: setting.plant,
        spread: setting.spread.clone(),
        points: args.plants.points as usize,
        gain_margin_db: args.gain_margin_db,
        delay_margin_ticks: args.delay_margin_ticks,
        seed: args.seed,
        particles: args.particles as usize,
        iterations: u64::from(args.iterations),
    };
    let output = Output::new(&args.out)?;
    let since = Instant::now();
    let progress = progress_bar(tune::effort(&options), "laws and points tried, {eta} left");
    let tuned = tune::tune(plan, &options, &|| progress.inc(1));
    progress.finish_and_clear();
    let tuned = tuned?;
    let wall_ms = since.elapsed().as_secs_f64() * 1e3;

    let report = &tuned.report;
    let law = &tuned.law;
    let mut facts = law_facts(law);
    facts.extend(report_facts(report, plan.tick_rate_hz));
    facts.push((
        "predicted force error".into(),
        format!(
            "{:.3} of that without feedback (root mean square over the plants)",
            tuned.cost
        ),
    ));
    for prediction in &tuned.predictions {
        facts.push((
            format!("  {}", prediction.name),
            format!(
                "{:.4} N rms from its own equilibrium ({:.4} without feedback), {:.4} N ({:.4}) from the plan's first shape",
                prediction.tuned.force_rms_n[0],
                prediction.open.force_rms_n[0],
                prediction.tuned.force_rms_n[1],
                prediction.open.force_rms_n[1]
            ),
        ));
    }
    facts.push((
        "tuned in".into(),
        format!(
            "{:.1} s, {} laws tried, seed {}",
            wall_ms / 1e3,
            tuned.tried,
            args.seed
        ),
    ));
    let how = [
        format!(
            "Arm with {} elements, {} Hz, seed {}, {} particles, {} steps; predicted force error",
            setting.arm.elements, plan.tick_rate_hz, args.seed, args.particles, args.iterations
        ),
        format!(
            "{:.3} of that without feedback; over {} plants at least {:.1} dB and {:.2} ticks to spare.",
            tuned.cost,
            report.spread.len(),
            report
                .spread
                .iter()
                .map(|s| s.gain_margin_db)
                .fold(report.nominal.gain_margin_db, f64::min),
            report
                .spread
                .iter()
                .map(|s| s.delay_margin_ticks)
                .fold(report.nominal.delay_margin_ticks, f64::min),
        ),
    ];
    let file = controller_toml(law, &how);
    output.write("controller.toml", |w| w.write_all(file.as_bytes()))?;
    let map_of = [GainId::ForceIntegral, GainId::SlopeRate];
    let warnings = warnings(&setting, law, report)?;
    write_page(&setting, law, report, map_of, &warnings, &facts, &output)?;

    let mut summary = export::object([
        ("K_DF_s", json!(law.force_derivative_s)),
        ("K_PF", json!(law.force_proportional)),
        ("K_IF_per_s", json!(law.force_integral_per_s)),
        ("K_w_Nms_rad", json!(law.slope_rate_nms_rad)),
        ("force_filter_Hz", json!(law.force_filter_hz)),
        ("slope_rate_filter_Hz", json!(law.slope_rate_filter_hz)),
        ("cost", json!(tuned.cost)),
        ("laws_tried", json!(tuned.tried)),
        ("seed", json!(args.seed)),
    ]);
    summary.extend(summary_json(&report.nominal));
    summary.insert("spread".into(), spread_json(report));
    summary.insert("wall_ms".into(), json!(wall_ms));
    let summary = Value::Object(summary);
    output.json("summary.json", &summary)?;
    if args.plants.common.json {
        return print(&summary);
    }
    print_facts(&facts)?;
    print(format_args!(
        "\ncontroller.toml and report.html are in {}",
        args.out.display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_controller_is_read_as_it_was() {
        let law = LawParameters {
            force_derivative_s: 1.2e-5,
            force_proportional: 0.25,
            force_integral_per_s: 4.0,
            slope_rate_nms_rad: 0.088,
            force_filter_hz: Some(120.0),
            slope_rate_filter_hz: None,
            force_projection: ForceProjection::AsPrinted,
            slope_rate_feedback: SlopeRateFeedback::AsPrinted,
            feedforward: false,
        };
        let text = controller_toml(&law, &["a word".into()]);
        assert_eq!(config::parse_controller("c", &text).unwrap(), law, "{text}");
        // A filter without a gain on what it filters is not written.
        let idle = LawParameters {
            force_derivative_s: 0.0,
            force_proportional: 0.0,
            slope_rate_filter_hz: Some(30.0),
            ..law
        };
        let text = controller_toml(&idle, &[]);
        let read = config::parse_controller("c", &text).unwrap();
        let expected = LawParameters {
            force_filter_hz: None,
            ..idle
        };
        assert_eq!(read, expected, "{text}");
    }
}

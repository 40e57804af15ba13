//! `flexor gains tune`: finds good gains and writes them as a controller file.

use super::{
    PlantArgs, Setting, law_facts, report_facts, spread_json, summary_json, warnings, write_page,
};
use crate::analysis::stability::map::GainId;
use crate::analysis::stability::path::{DELAY_MARGIN_MAX_TICKS, GAIN_MARGIN_MAX_DB, Summary};
use crate::analysis::stability::tune::{self, TuneOptions, Tuned};
use crate::cli::provenance::with_timing;
use crate::cli::{CliError, Output, print, print_facts, progress_bar};
use crate::files::{config, export};
use clap::Args;
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

#[derive(Args)]
pub(super) struct TuneArgs {
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

impl TuneArgs {
    /// The search's options, checked.
    fn options(&self, setting: &Setting) -> Result<TuneOptions, CliError> {
        let (gain, delay) = (self.gain_margin_db, self.delay_margin_ticks);
        for (what, value, most) in [
            ("--gain-margin-dB", gain, GAIN_MARGIN_MAX_DB - 1.0),
            ("--delay-margin-ticks", delay, DELAY_MARGIN_MAX_TICKS - 1.0),
        ] {
            if !(value >= 0.0 && value <= most) {
                return Err(CliError::Margin { what, value, most });
            }
        }
        Ok(TuneOptions {
            law: setting.law,
            plant: setting.plant,
            spread: setting.spread.clone(),
            points: self.plants.points as usize,
            gain_margin_db: gain,
            delay_margin_ticks: delay,
            seed: self.seed,
            particles: self.particles as usize,
            iterations: u64::from(self.iterations),
        })
    }
}

/// Searches, and writes and prints what was found.
pub(super) fn tune_command(args: &TuneArgs) -> Result<(), CliError> {
    if !args.plants.is_paper()? {
        return super::hybrid::tune_command(&args.plants, args.seed, &args.out);
    }
    let output = Output::open(&args.out, args.plants.inputs())?;
    let setting = args.plants.setting()?;
    let plan = &setting.planned.plan;
    let options = args.options(&setting)?;
    let since = Instant::now();
    let progress = progress_bar(tune::effort(&options), "laws and points tried, {eta} left");
    let tuned = tune::tune(plan, &options, &|| progress.inc(1));
    progress.finish_and_clear();
    let tuned = tuned?;
    let wall_ms = since.elapsed().as_secs_f64() * 1e3;

    let (report, law) = (&tuned.report, &tuned.law);
    let mut facts = law_facts(law);
    facts.extend(report_facts(report, plan.tick_rate_hz));
    facts.extend(tuned_facts(&tuned));
    let tried = format!("{} laws, seed {}", tuned.tried, args.seed);
    facts.push(("tried".into(), tried));
    let file = config::controller_toml(&(*law).into(), &origin(args, &setting, &tuned));
    output.write("controller.toml", |w| w.write_all(file.as_bytes()))?;
    let map_of = [GainId::ForceIntegral, GainId::SlopeRate];
    let warnings = warnings(&setting, law, report)?;
    write_page(&setting, law, report, map_of, &warnings, &facts, &output)?;

    let made = setting.made.clone().gains(&(*law).into());
    let summary = made.summary(tuned_json(&tuned, args.seed));
    output.json("summary.json", &summary)?;
    output.commit()?;
    if args.plants.common.json {
        let mut timing = setting.planned.timing();
        timing.insert("wall_ms".into(), json!(wall_ms));
        return print(with_timing(&summary, timing));
    }
    print_facts(&facts)?;
    print_facts(&[("tuned in".into(), format!("{:.1} s", wall_ms / 1e3))])?;
    let files = match cfg!(feature = "report") {
        true => "controller.toml and report.html are",
        false => "controller.toml is",
    };
    print(format_args!("\n{files} in {}", args.out.display()))
}

/// What the gains are predicted to do, for a reader.
fn tuned_facts(tuned: &Tuned) -> Vec<(String, String)> {
    let mut facts = vec![(
        "predicted force error".into(),
        format!(
            "{:.3} of that without feedback (root mean square over the plants)",
            tuned.cost
        ),
    )];
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
    facts
}

/// How the gains were found, for the head of their file.
fn origin(args: &TuneArgs, setting: &Setting, tuned: &Tuned) -> [String; 2] {
    let (plan, report) = (&setting.planned.plan, &tuned.report);
    let least = |margin: fn(&Summary) -> f64| {
        let spread = report.spread.iter().map(margin);
        spread.fold(margin(&report.nominal), f64::min)
    };
    [
        format!(
            "Arm with {} elements, {} Hz, seed {}, {} particles, {} steps; predicted force error",
            plan.model.elements, plan.tick_rate_hz, args.seed, args.particles, args.iterations
        ),
        format!(
            "{:.3} of that without feedback; over {} plants at least {:.1} dB and {:.2} ticks to spare.",
            tuned.cost,
            report.spread.len(),
            least(|s| s.gain_margin_db),
            least(|s| s.delay_margin_ticks),
        ),
    ]
}

/// What was found, as flat JSON.
fn tuned_json(tuned: &Tuned, seed: u64) -> Map<String, Value> {
    let law = &tuned.law;
    let mut summary = export::object([
        ("K_DF_s", json!(law.force_derivative_s)),
        ("K_PF", json!(law.force_proportional)),
        ("K_IF_per_s", json!(law.force_integral_per_s)),
        ("K_w_Nms_rad", json!(law.slope_rate_nms_rad)),
        ("force_filter_Hz", json!(law.force_filter_hz)),
        ("slope_rate_filter_Hz", json!(law.slope_rate_filter_hz)),
        ("cost", json!(tuned.cost)),
        ("laws_tried", json!(tuned.tried)),
        ("seed", json!(seed)),
    ]);
    summary.extend(summary_json(&tuned.report.nominal));
    summary.insert("spread".into(), spread_json(&tuned.report));
    summary
}

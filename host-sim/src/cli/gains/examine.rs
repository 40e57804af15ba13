//! `flexor gains`: are these gains stable over the whole motion, and with what margin.

use super::write_page;
use super::{PlantArgs, Setting, law_facts, report_facts, spread_json, summary_json, warnings};
use crate::analysis::stability::StabilityError;
use crate::analysis::stability::linear::{Linear, OperatingPoint};
use crate::analysis::stability::map::GainId;
use crate::analysis::stability::path::Report;
use crate::analysis::stability::printed::Printed;
use crate::cli::provenance::with_timing;
use crate::cli::{CliError, Output, print, print_facts, progress_bar, say};
use crate::files::export;
use clap::{Args, ValueEnum};
use nalgebra::Complex;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;

#[derive(Args)]
pub(super) struct ExamineArgs {
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

impl LinearisationArg {
    /// Its name in results.
    fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::AsPrinted => "as-printed",
        }
    }

    /// Poles of these equations at a time of the path, 1/s.
    fn poles(self, setting: &Setting, t_s: f64) -> Result<Vec<Complex<f64>>, StabilityError> {
        let plan = &setting.planned.plan;
        let variant = setting.variant()?;
        let point = OperatingPoint::new(plan, &mut plan.sampler(), &variant, t_s)?;
        Ok(match self {
            Self::Exact => Linear::new(&variant, &point)?.poles(),
            Self::AsPrinted => Printed::at(&variant, &setting.law, plan.normal_angle(), &point)
                .map_or(vec![], |printed| printed.poles()),
        })
    }
}

/// Poles as pairs of real and imaginary part.
fn pairs(poles: &[Complex<f64>]) -> Value {
    json!(poles.iter().map(|p| [p.re, p.im]).collect::<Vec<_>>())
}

/// Refuses options that make no sense for the plan.
fn check(args: &ExamineArgs, setting: &Setting) -> Result<(), CliError> {
    let plan = &setting.planned.plan;
    let [start, end] = [plan.time(0), plan.time(plan.ticks)];
    if !(args.at >= start && args.at <= end) {
        return Err(CliError::At {
            at_s: args.at,
            start_s: start,
            end_s: end,
        });
    }
    Ok(())
}

/// Refuses options that the paper's law alone has.
fn check_hybrid(args: &ExamineArgs) -> Result<(), CliError> {
    let what = match () {
        () if args.at != 0.0 => "--at",
        () if args.linearisation != LinearisationArg::Exact => "--linearisation",
        () if args.map != [GainArg::KIf, GainArg::KW] => "--map",
        () => return Ok(()),
    };
    Err(CliError::NoEffect {
        what,
        beside: "with the hybrid law: --controller of the paper's law has it",
    })
}

/// Prints poles, of each complex pair one.
fn print_poles(args: &ExamineArgs, poles: &[Complex<f64>]) -> Result<(), CliError> {
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
    Ok(())
}

/// Examines the gains, and writes and prints what was found.
pub(super) fn examine(args: &ExamineArgs) -> Result<(), CliError> {
    if !args.plants.is_paper()? {
        check_hybrid(args)?;
        return super::hybrid::examine(&args.plants, &args.out);
    }
    if let [first, second] = args.map[..]
        && first == second
    {
        let name = first.to_possible_value();
        return Err(CliError::Map {
            gain: name.map_or(String::new(), |name| name.get_name().into()),
        });
    }
    let output = Output::open(&args.out, args.plants.inputs())?;
    let setting = args.plants.setting()?;
    check(args, &setting)?;
    let plan = &setting.planned.plan;
    let law = &setting.law;
    let since = Instant::now();
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
    let poles = args.linearisation.poles(&setting, args.at)?;

    let mut facts = law_facts(law);
    facts.extend(report_facts(&report, plan.tick_rate_hz));
    let map_of = [args.map[0].gain(), args.map[1].gain()];
    let place = write_page(&setting, law, &report, map_of, &warnings, &facts, &output)?;

    let mut summary = summary_json(&report.nominal);
    summary.extend(export::object([
        ("points", json!(report.points.len())),
        ("tick_rate_Hz", json!(plan.tick_rate_hz)),
        ("spread", spread_json(&report)),
        ("warnings", json!(warnings)),
        ("at_s", json!(args.at)),
        ("linearisation", json!(args.linearisation.name())),
        ("poles_per_s", pairs(&poles)),
    ]));
    let summary = setting.made.clone().gains(&(*law).into()).summary(summary);
    output.json("summary.json", &summary)?;
    output.commit()?;
    for word in &warnings {
        say(format_args!("warning: {word}"));
    }
    if args.plants.common.json {
        let mut timing = setting.planned.timing();
        timing.insert("wall_ms".into(), json!(wall_ms));
        return print(with_timing(&summary, timing));
    }
    print_facts(&facts)?;
    print_facts(&[("examined in".into(), format!("{wall_ms:.0} ms"))])?;
    print_poles(args, &poles)?;
    print(format_args!("\n{place}"))
}

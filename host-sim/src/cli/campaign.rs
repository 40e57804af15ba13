//! The command `campaign`: thousands of runs of a scenario, and shards of them put together.

use super::bench::{Bench, ProofArgs, ScenarioArgs};
use super::provenance::{COMMIT, Provenance, SCHEMA_VERSION, VERSION, with_timing};
use super::run::judge;
use super::{CliError, Common, Output, pages, print, print_facts, progress_bar, say};
use crate::campaign::engine::Campaign;
use crate::campaign::findings::Findings;
use crate::campaign::identity::{CampaignIdentity, Shard};
use crate::campaign::merge::{ShardResults, merge};
use crate::campaign::record::{CampaignRecords, RunRecord};
use crate::campaign::scenario::Scenario;
use crate::campaign::statistics::Statistics;
use crate::files::campaign_parquet::rows_parquet;
use crate::files::campaign_rows::{RowWriter, read_rows, read_rows_lenient, rows_csv};
use crate::files::campaign_summary::summary_json;
use crate::files::ticks_parquet::ticks_parquet;
use crate::files::{config, export};
use crate::simulation::bench::BenchRow;
use crate::text::{Shortest, four_digits};
use clap::{Args, Subcommand, ValueEnum};
use flexor::control::LawParameters;
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Most runs of a campaign: a row of 300 bytes each, and a month of one core.
const RUNS_MAX: u64 = 10_000_000;

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct CampaignArgs {
    #[command(subcommand)]
    command: Option<CampaignCommand>,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    proof: ProofArgs,
    /// Gains; without it the scenario's, or those of examples/controller.toml
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    /// How many runs
    #[arg(long, value_name = "N", default_value_t = 200,
          value_parser = clap::value_parser!(u64).range(1..=RUNS_MAX))]
    runs: u64,
    /// What the runs' values and noise are drawn by
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Only the I-th of N equal parts of the runs; `campaign merge` puts them together
    #[arg(long, value_name = "I/N", default_value = "1/1")]
    shard: Shard,
    /// Repeat the run of this number alone, and write all of it, as `run` does
    #[arg(long, value_name = "K", conflicts_with_all = ["shard", "write"])]
    only: Option<u64>,
    /// What is written: the runs' figures, or beside them every tick of every run
    #[arg(long, value_enum, default_value_t = WriteArg::Summary)]
    write: WriteArg,
    /// Folder for the results; made if it is not there. One that an interrupted campaign has left
    /// is gone on with
    #[arg(long, value_name = "DIR", default_value = "out/campaign")]
    out: PathBuf,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum WriteArg {
    /// One row a run
    Summary,
    /// One row a run, and a Parquet file of its ticks in the folder runs
    All,
}

#[derive(Subcommand)]
enum CampaignCommand {
    /// Puts the shards of a campaign together
    #[command(
        after_help = "Example: flexor campaign merge out/shard-1 out/shard-2 --out out/campaign\n\nThe result is that of the campaign without shards."
    )]
    Merge(MergeArgs),
}

#[derive(Args)]
struct MergeArgs {
    /// Folders of the shards
    #[arg(required = true, value_name = "DIR")]
    shards: Vec<PathBuf>,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/campaign")]
    out: PathBuf,
}

pub(super) fn campaign(args: &CampaignArgs) -> Result<(), CliError> {
    match (&args.command, args.only) {
        (Some(CampaignCommand::Merge(merge)), _) => merge_command(merge),
        (None, Some(number)) => only(args, number),
        (None, None) => runs(args),
    }
}

impl CampaignArgs {
    /// The files that are read.
    fn inputs(&self) -> impl Iterator<Item = Option<&Path>> {
        let own = [&self.scenario.scenario, &self.controller];
        let own = own.into_iter().map(|file| file.as_deref());
        self.common.inputs().into_iter().chain(own)
    }

    /// What the campaign is, on gains that were proved with these results.
    fn identity(&self, bench: &Bench, gains: Map<String, Value>) -> CampaignIdentity {
        CampaignIdentity {
            schema_version: SCHEMA_VERSION,
            version: VERSION.into(),
            commit: COMMIT.into(),
            seed: self.seed,
            runs: self.runs,
            shard: self.shard,
            inputs: bench.inputs.clone(),
            gains,
        }
    }
}

/// One run of the campaign, with all that `run` writes.
fn only(args: &CampaignArgs, number: u64) -> Result<(), CliError> {
    if number >= args.runs {
        return Err(CliError::NoRun {
            number,
            runs: args.runs,
        });
    }
    let output = Output::open(&args.out, args.inputs())?;
    let bench = args.scenario.prepare(
        &args.common,
        args.controller.as_deref(),
        config::DEFAULT_CONTROLLER,
    )?;
    let proved = args.proof.check(&bench)?;
    let campaign = Campaign {
        task: bench.task(),
        scenario: &bench.config.scenario,
        seed: args.seed,
    };
    let drawn = campaign.draw(number)?;
    let values = bench.config.scenario.spread_keys().zip(&drawn.values);
    let mut facts = vec![("run".to_string(), format!("{number}, seed {}", drawn.seed))];
    let mut keys = export::object([("run", json!(number)), ("seed", json!(drawn.seed))]);
    keys.extend(proved);
    for (key, value) in values {
        facts.push((key.to_string(), value.to_string()));
        keys.insert(key.to_string(), json!(value));
    }
    let made = Provenance::of_inputs(&bench.inputs).gains(&bench.law);
    let titled = ("Flexor: run of a campaign", &made);
    let figures = bench.run(output, &drawn.arm, titled, (keys, facts), args.common.json)?;
    judge(figures.outcome, figures.ended_s, false, &args.out)
}

fn runs(args: &CampaignArgs) -> Result<(), CliError> {
    let output = Output::open(&args.out, args.inputs())?;
    let bench = args.scenario.prepare(
        &args.common,
        args.controller.as_deref(),
        config::DEFAULT_CONTROLLER,
    )?;
    let gains = args.proof.check(&bench)?;
    let identity = args.identity(&bench, gains);
    let ticks = match args.write {
        WriteArg::Summary => None,
        WriteArg::All => Some(output.keep("runs")?),
    };
    let mut checkpoint = Checkpoint::open(&output, &identity, &bench, ticks)?;
    let done: BTreeSet<u64> = checkpoint.numbers().collect();
    if !done.is_empty() {
        say(format_args!(
            "{} runs of an interrupted campaign are there",
            done.len()
        ));
    }
    let left: Vec<u64> = identity
        .shard
        .runs(args.runs)
        .filter(|run| !done.contains(run))
        .collect();
    if left.is_empty() && done.is_empty() {
        return Err(CliError::EmptyShard {
            shard: args.shard,
            runs: args.runs,
        });
    }
    bench.say_note();
    let since = Instant::now();
    let ended = advance(args.seed, &bench, &left, &mut checkpoint);
    let wall_s = since.elapsed().as_secs_f64();
    if ended.is_err() && checkpoint.records.runs.is_empty() {
        output.forget();
    }
    ended?;
    let plan = &bench.planned.plan;
    let simulated_s = left.len() as f64 * plan.points.len() as f64 / f64::from(plan.tick_rate_hz);
    let results = Results {
        identity,
        records: checkpoint.finish(&output)?,
        scenario: &bench.config.scenario,
        real_time_factor: (!left.is_empty()).then_some(simulated_s / wall_s),
    };
    results.report(output, args.common.json)
}

/// Makes the runs that are `left`, on all cores, each into the `checkpoint` as soon as it is over.
fn advance(
    seed: u64,
    bench: &Bench,
    left: &[u64],
    checkpoint: &mut Checkpoint,
) -> Result<(), CliError> {
    let campaign = Campaign {
        task: bench.task(),
        scenario: &bench.config.scenario,
        seed,
    };
    campaign.check(left)?;
    let progress = progress_bar(left.len() as u64, "runs, {eta} left");
    let stop = AtomicBool::new(false);
    let ticks = checkpoint.ticks.clone();
    let failed = Mutex::new(None);
    let shared = Mutex::new(checkpoint);
    let ended = campaign.run_all(left, &stop, ticks.is_some(), |record, rows| {
        progress.inc(1);
        let written = ticks
            .as_ref()
            .map_or(Ok(()), |folder| write_ticks(folder, record.run, &rows));
        let mut checkpoint = shared.lock().unwrap_or_else(PoisonError::into_inner);
        // In this order: a run that is there has its ticks.
        if let Err(error) = written.and_then(|()| checkpoint.add(record)) {
            stop.store(true, Ordering::Relaxed);
            *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
    });
    progress.finish_and_clear();
    ended?;
    let failed = failed.into_inner().unwrap_or_else(PoisonError::into_inner);
    failed.map_or(Ok(()), Err)
}

/// The error of a file that cannot be written.
fn unwritable(file: &Path) -> impl FnOnce(io::Error) -> CliError {
    let file = file.to_path_buf();
    move |cause| CliError::Unwritable { file, cause }
}

/// Writes the ticks of a run into `folder`.
fn write_ticks(folder: &Path, run: u64, rows: &[BenchRow]) -> Result<(), CliError> {
    let file = folder.join(format!("{run:06}.parquet"));
    let write = || {
        let mut writer = BufWriter::new(File::create(&file)?);
        ticks_parquet(rows, &mut writer)?;
        writer.flush()
    };
    write().map_err(unwritable(&file))
}

/// The runs so far, in a place that outlives a kill.
struct Checkpoint {
    records: CampaignRecords,
    file: PathBuf,
    writer: RowWriter<File>,
    /// The folder of the runs' ticks, where they are wanted.
    ticks: Option<PathBuf>,
}

impl Checkpoint {
    /// What an interrupted campaign of this `identity` has left, or nothing yet. `ticks` is the
    /// folder for the runs' ticks, where they are wanted.
    fn open(
        output: &Output,
        identity: &CampaignIdentity,
        bench: &Bench,
        ticks: Option<PathBuf>,
    ) -> Result<Self, CliError> {
        // Runs without ticks are of no use where they are wanted.
        let name = match &ticks {
            Some(_) => "rows_with_ticks.csv",
            None => "rows.csv",
        };
        let other = output.keep("campaign.json")?;
        let same = is_of(&other, identity);
        if !same {
            // Nothing of another campaign may get into this one: neither its rows, of either kind,
            // nor its ticks.
            output.forget();
        }
        let file = output.keep(name)?;
        if let Some(folder) = &ticks {
            std::fs::create_dir_all(folder).map_err(unwritable(folder))?;
        }
        let keys = bench.config.scenario.spread_keys();
        let parameters: Vec<String> = keys.map(String::from).collect();
        if same
            && let Ok(whole) = read_rows_lenient(&file)
            // Not even its first line, perhaps.
            && whole.bytes > 0
            && whole.records.parameters == parameters
        {
            let open = || {
                let opened = OpenOptions::new().append(true).open(&file)?;
                // What a kill has cut off.
                opened.set_len(whole.bytes)?;
                Ok(opened)
            };
            return Ok(Self {
                records: whole.records,
                writer: RowWriter::resumed(open().map_err(unwritable(&file))?),
                file,
                ticks,
            });
        }
        let text = serde_json::to_string(identity).map_err(io::Error::from);
        text.and_then(|text| std::fs::write(&other, text))
            .map_err(unwritable(&other))?;
        let create = || {
            let mut writer = RowWriter::new(File::create(&file)?, &parameters)?;
            writer.flush()?;
            Ok(writer)
        };
        let writer = create().map_err(unwritable(&file))?;
        let records = CampaignRecords {
            parameters,
            runs: vec![],
        };
        Ok(Self {
            records,
            file,
            writer,
            ticks,
        })
    }

    /// Numbers of the runs that are there.
    fn numbers(&self) -> impl Iterator<Item = u64> {
        self.records.runs.iter().map(|record| record.run)
    }

    fn add(&mut self, record: RunRecord) -> Result<(), CliError> {
        let written = self
            .writer
            .write(&record)
            .and_then(|()| self.writer.flush());
        written.map_err(unwritable(&self.file))?;
        self.records.runs.push(record);
        Ok(())
    }

    /// All runs by their number; their ticks go to `output`.
    fn finish(mut self, output: &Output) -> Result<CampaignRecords, CliError> {
        if let Some(ticks) = &self.ticks {
            let place = output.partial().join("runs");
            std::fs::rename(ticks, &place).map_err(unwritable(&place))?;
        }
        self.records.runs.sort_by_key(|record| record.run);
        Ok(self.records)
    }
}

/// Whether what an interrupted campaign has left is of this one, by its identity in `file`.
fn is_of(file: &Path, identity: &CampaignIdentity) -> bool {
    let found = std::fs::read_to_string(file).ok();
    let found = found.and_then(|text| serde_json::from_str::<CampaignIdentity>(&text).ok());
    let Some(found) = found else {
        return false;
    };
    let difference = found.difference(identity).or_else(|| {
        let shards = (found.shard, identity.shard);
        (shards.0 != shards.1).then(|| format!("shard {} and {}", shards.0, shards.1))
    });
    if let Some(difference) = &difference {
        say(format_args!(
            "note: an interrupted campaign in this folder was another one ({difference}); it is begun anew"
        ));
    }
    difference.is_none()
}

/// A campaign's results, to be written and shown.
struct Results<'a> {
    identity: CampaignIdentity,
    records: CampaignRecords,
    scenario: &'a Scenario,
    /// Simulated over elapsed time; `None` where nothing was simulated.
    real_time_factor: Option<f64>,
}

impl Results<'_> {
    /// Writes everything, prints the result, and judges it.
    fn report(&self, output: Output, json: bool) -> Result<(), CliError> {
        let findings = Findings::new(&self.records, &self.scenario.verdict);
        let mut summary = summary_json(&findings, &self.records.parameters);
        summary.extend(export::object([
            ("seed", json!(self.identity.seed)),
            ("shard", json!(self.identity.shard.to_string())),
        ]));
        summary.extend(self.identity.gains.clone());
        // Of the whole campaign, also where these are a shard's runs, or were put together from
        // shards: the results are the same.
        let made =
            Provenance::of_inputs(&self.identity.inputs).command(self.identity.command(None));
        let made = match law_of(&self.identity) {
            Some(law) => made.gains(&law),
            None => made,
        };
        let summary = made.summary(summary);
        output.write("runs.csv", |w| rows_csv(&self.records, w))?;
        output.write("runs.parquet", |w| rows_parquet(&self.records, w))?;
        let identity =
            serde_json::to_value(&self.identity).map_err(|error| CliError::Unwritable {
                file: output.folder().join("campaign.json"),
                cause: error.into(),
            })?;
        output.json("campaign.json", &identity)?;
        output.json("summary.json", &summary)?;
        let folder = output.folder().to_path_buf();
        let place = pages::campaign(
            &output,
            (&self.identity, &self.records, &findings),
            &made.facts(),
        )?;
        output.commit()?;
        if json {
            let timing = export::object([("real_time_factor", json!(self.real_time_factor))]);
            print(with_timing(&summary, timing))?;
        } else {
            print_facts(&facts(&findings, self.real_time_factor))?;
            print(format_args!(
                "\nruns.csv, runs.parquet and summary.json are in {}\n{place}",
                folder.display()
            ))?;
        }
        if findings.holds() {
            return Ok(());
        }
        let broken: Vec<String> = findings
            .verdict
            .iter()
            .filter(|judged| !judged.holds)
            .map(|judged| match judged.found {
                Some(found) => format!(
                    "{} = {} is exceeded by {}",
                    judged.key,
                    Shortest(judged.limit),
                    four_digits(found)
                ),
                None => format!(
                    "{} = {}: too few runs succeeded to tell",
                    judged.key,
                    Shortest(judged.limit)
                ),
            })
            .collect();
        Err(CliError::Verdict(broken.join("; ")))
    }
}

/// The law that a campaign's text says.
fn law_of(identity: &CampaignIdentity) -> Option<LawParameters> {
    let mut inputs = identity.inputs.iter();
    let input = inputs.find(|input| input.option == "controller")?;
    config::parse_controller(&input.file, &input.text).ok()
}

/// What was found, for a reader.
fn facts(findings: &Findings, real_time_factor: Option<f64>) -> Vec<(String, String)> {
    let s: &Statistics = &findings.statistics;
    let percent = |x: f64| format!("{:.1} %", 100.0 * x);
    let mut facts = vec![(
        "failed".to_string(),
        format!(
            "{} of {} runs, {} (95 %: {} to {})",
            s.failed,
            s.runs,
            s.share(s.failed).map_or("-".into(), percent),
            percent(s.fail_rate.low),
            percent(s.fail_rate.high)
        ),
    )];
    for (outcome, count) in &s.outcomes {
        facts.push((format!("  {}", outcome.name()), count.to_string()));
    }
    for (name, label, unit, scale) in [
        ("force_error_rms_N", "force error, rms", "N", 1.0),
        ("force_error_max_N", "force error, max", "N", 1.0),
        ("along_error_max_m", "along the surface, max", "mm", 1e3),
        ("contact_lost_s", "without contact", "ms", 1e3),
    ] {
        if let Some(q) = s.figure(name) {
            let [median, p95, max] = [q.median, q.p95, q.max].map(|x| four_digits(scale * x));
            let words = format!("median {median}, 95th percentile {p95}, largest {max} {unit}");
            facts.push((label.to_string(), words));
        }
    }
    if let Some(factor) = real_time_factor {
        facts.push(("speed".into(), format!("{factor:.0} times real time")));
    }
    facts
}

/// Puts shards together.
fn merge_command(args: &MergeArgs) -> Result<(), CliError> {
    let output = Output::open(
        &args.out,
        args.shards.iter().map(|shard| Some(shard.as_path())),
    )?;
    let shards: Result<Vec<ShardResults>, CliError> = args
        .shards
        .iter()
        .map(|folder| read_shard(folder))
        .collect();
    let (identity, records) = merge(shards?)?;
    let text = identity
        .inputs
        .iter()
        .find(|input| input.option == "scenario");
    let scenario = match text {
        Some(input) => config::parse_scenario(&input.file, &input.text)?.scenario,
        None => Scenario::default(),
    };
    let results = Results {
        identity,
        records,
        scenario: &scenario,
        real_time_factor: None,
    };
    results.report(output, args.json)
}

fn read_shard(folder: &Path) -> Result<ShardResults, CliError> {
    let file = folder.join("campaign.json");
    let unreadable = |cause| CliError::Unreadable {
        file: file.clone(),
        cause,
    };
    let text = std::fs::read_to_string(&file).map_err(unreadable)?;
    Ok(ShardResults {
        name: folder.display().to_string(),
        identity: serde_json::from_str(&text).map_err(|error| unreadable(error.into()))?,
        records: read_rows(&folder.join("runs.csv"))?,
    })
}

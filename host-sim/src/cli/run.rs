//! The command `run`: a task, a controller and a plant, simulated; `pil` takes the same.

use super::bench::{ProofArgs, ScenarioArgs};
use super::plan::Planned;
use super::provenance::{Provenance, with_timing};
use super::{
    CliError, Common, Output, accuracy, controller, gains, pages, print, print_facts, progress_bar,
    results, say,
};
use crate::analysis::fixed_point::accuracy::run_fixed;
use crate::analysis::fixed_point::range;
use crate::files::{config, export};
use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::simulation::cases::Mode;
use crate::simulation::closed_loop;
use crate::simulation::closed_loop::{Outcome, Run, RunOptions};
use crate::simulation::start::Start;
use crate::text::Shortest;
use clap::{Args, ValueEnum};
use flexor::control::LawParameters;
use flexor::table::Table;
use serde_json::{Map, Value, json};
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What is run: task, controller and plant.
#[derive(Args)]
pub(super) struct SimulationArgs {
    #[command(flatten)]
    pub(super) common: Common,
    /// Gains; without it those of examples/controller.toml, and in the paper's world, with --ideal or
    /// `pil`, those of examples/controller_paper.toml
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    /// Which part of the law acts: both, or one; without it as the controller file's
    /// feedforward says
    #[arg(long, value_enum)]
    mode: Option<ModeArg>,
    /// How the plant differs from the planned arm; without it not at all, but for eight
    /// elements [examples/plant_soft.toml]
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Elements of the plant's link 2; before the plant file's
    #[arg(long, value_name = "N")]
    plant_elements: Option<u32>,
    /// Factor on the plant's bending stiffness; before the plant file's
    #[arg(long, value_name = "X")]
    bending_stiffness_scale: Option<f64>,
    /// State that the plant starts in; before the plant file's [equilibrium]
    #[arg(long, value_enum)]
    start: Option<StartArg>,
    /// Exit code 3 unless the run is completed: also where the tip leaves the path or, with
    /// --ideal, the contact is lost (on the bench that is a figure, contact_lost_s)
    #[arg(long)]
    require_completed: bool,
    /// A table to run instead of the one that is planned; it must be of this arm and task,
    /// planned with the same --model
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
}

#[derive(Args)]
pub(super) struct RunArgs {
    #[command(flatten)]
    pub(super) simulation: SimulationArgs,
    #[command(flatten)]
    pub(super) scenario: ScenarioArgs,
    #[command(flatten)]
    proof: ProofArgs,
    /// Perfect readings and torques, and a rigid surface that holds the tip from both sides: the
    /// paper's world, without board and scenario
    #[arg(long, conflicts_with_all = ["scenario", "set", "board"])]
    ideal: bool,
    /// Number type that the controller computes in; another than f32 is of the paper's world
    #[arg(long, value_enum, default_value_t = NumberArg::F32)]
    number: NumberArg,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/run")]
    pub(super) out: PathBuf,
}

#[derive(Clone, Copy, ValueEnum)]
enum ModeArg {
    Proposed,
    Feedforward,
    Feedback,
}

#[derive(Clone, Copy, ValueEnum)]
enum StartArg {
    /// The plan's first shape with its elastic velocity
    PlanMoving,
    /// The plan's first shape at rest
    PlanAtRest,
    /// The plant's own equilibrium under the planned force
    Equilibrium,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum NumberArg {
    F32,
    F64,
    /// Fixed point of 32 bits
    Fixed,
}

pub(super) fn run_command(args: &RunArgs) -> Result<(), CliError> {
    match (args.ideal, args.only_ideal()) {
        (true, _) => run_ideal(args),
        (false, None) => run_on_bench(args),
        (false, Some(what)) if args.says_bench() => Err(CliError::NoEffect {
            what,
            beside: "on the bench, whose board computes in f32 and whose arm starts at its own equilibrium: leave it or --scenario, --set and --board out",
        }),
        (false, Some(what)) => {
            say(format_args!(
                "note: {what} is of the paper's world alone, without a board's counts: as with --ideal"
            ));
            run_ideal(args)
        }
    }
}

impl RunArgs {
    /// What was asked for that only the paper's world has, if anything.
    fn only_ideal(&self) -> Option<&'static str> {
        let simulation = &self.simulation;
        if self.number != NumberArg::F32 {
            return Some("another --number than f32");
        }
        if !matches!(simulation.start, None | Some(StartArg::Equilibrium)) {
            return Some("another --start than equilibrium");
        }
        // What is wrong with the file is said by whoever runs.
        let read = config::load(simulation.plant.as_deref(), "", config::parse_plant);
        let starts = read.map_or(Start::Equilibrium, |(_, start)| start);
        let other = starts != Start::Equilibrium && simulation.start.is_none();
        other.then_some("another start than \"equilibrium\"")
    }

    /// Whether anything was said that only the bench has.
    fn says_bench(&self) -> bool {
        let scenario = &self.scenario;
        let board = &self.simulation.common.board;
        scenario.scenario.is_some() || !scenario.set.is_empty() || board.is_some()
    }
}

/// `run` in the paper's world.
fn run_ideal(args: &RunArgs) -> Result<(), CliError> {
    let output = Output::open(&args.out, args.simulation.inputs())?;
    let simulation = args.simulation.prepare()?;
    let Simulation {
        planned, options, ..
    } = &simulation;
    let (plan, image) = (&planned.plan, &planned.table.image);
    // The hybrid law is proved on the bench's arms alone: an ideal plant has no drive to prove.
    if let (true, Some(law)) = (simulation.mode != Mode::Feedforward, options.law.paper()) {
        gains::warn(plan, &options.plant, law);
    }
    if plan.task.friction.coefficient > 0.0 {
        say(format_args!(
            "warning: the plan reckons with surface.friction = {}, and the ideal surface has none; without --ideal a scenario's surface has it (contact.friction)",
            Shortest(plan.task.friction.coefficient)
        ));
    }
    let since = Instant::now();
    let progress = progress_bar(plan.points.len() as u64, "ticks, {eta} left");
    let (run, saturations) = match args.number {
        NumberArg::F32 => {
            let mut simulation = closed_loop::Simulation::<f32>::new(plan, image, options)?;
            (simulation.run(|_| progress.inc(1)), None)
        }
        NumberArg::F64 => {
            let mut simulation = closed_loop::Simulation::<f64>::new(plan, image, options)?;
            (simulation.run(|_| progress.inc(1)), None)
        }
        NumberArg::Fixed => {
            let (run, saturations) = run_fixed(plan, image, options, |_| progress.inc(1))?;
            (run, Some(saturations))
        }
    };
    progress.finish_and_clear();
    let run_ms = since.elapsed().as_secs_f64() * 1e3;

    let (mut keys, mut facts) = (Map::new(), vec![]);
    if let Some(saturations) = saturations {
        let total = saturations.total();
        keys.insert("saturations".into(), json!(total));
        for (signal, count) in saturations.entries() {
            keys.insert(format!("saturations_{signal}"), json!(count));
        }
        let analysis = range::analyse(plan, image, &options.law, &options.limits)?;
        facts.extend(accuracy::format_facts(&analysis));
        facts.push(("fixed point: saturations".into(), total.to_string()));
    }
    let timing = export::object([("run_ms", json!(run_ms))]);
    let took = ("simulated in".to_string(), format!("{run_ms:.0} ms"));
    let report = RunReport {
        run: &run,
        title: "Flexor: run",
        keys,
        facts,
        timing: (timing, took),
        json: args.simulation.common.json,
    };
    simulation.report(output, report)?;
    simulation.judge(&run, &args.out)
}

/// `run` through the board's counts.
fn run_on_bench(args: &RunArgs) -> Result<(), CliError> {
    let simulation = &args.simulation;
    let inputs = simulation
        .inputs()
        .chain([args.scenario.scenario.as_deref()]);
    let output = Output::open(&args.out, inputs)?;
    simulation.check_gains()?;
    let scenario = &args.scenario;
    if simulation.plant.is_some() && (scenario.scenario.is_some() || !scenario.set.is_empty()) {
        return Err(CliError::NoEffect {
            what: "--plant",
            beside: "beside --scenario or --set, whose plant section says how the arm differs: leave one of them out",
        });
    }
    let mut bench = args.scenario.prepare(
        &simulation.common,
        simulation.controller.as_deref(),
        simulation.default_controller(),
    )?;
    simulation.check_mode(&bench.law)?;
    bench.take_law(simulation.mode(&bench.law).of(&bench.law));
    let plan = &bench.planned.plan;
    if let Some(file) = &simulation.table {
        bench.planned.table.image = read_table(file, plan)?;
    }
    let mut setup = bench.config.scenario.middle();
    if let Some(file) = &simulation.plant {
        setup.plant = config::load(Some(file), "", config::parse_plant)?.0;
    }
    simulation.adjust(&mut setup.plant, &mut Start::default())?;
    let arm = setup.on_bench(plan, 1)?;
    let keys = args.proof.check(&bench)?;
    if let LawParameters::Paper(law) = &bench.law
        && law.has_feedback()
    {
        let plant = setup.on_rigid_surface(&plan.model.arm);
        gains::warn(plan, &plant, law);
    }
    let json = simulation.common.json;
    let mut made = Provenance::of_inputs(&bench.inputs);
    if let Some(file) = &simulation.plant {
        made = made.file("plant", Some(file), "")?;
    }
    let made = made
        .file("table", simulation.table.as_deref(), "")?
        .gains(&bench.law)
        .plant(&setup.plant);
    let title = "Flexor: run";
    let figures = bench.run(output, &arm, (title, &made), (keys, Vec::new()), json)?;
    let required = simulation.require_completed;
    judge(figures.outcome, figures.ended_s, required, &args.out)
}

/// What is to be run, planned.
pub(super) struct Simulation {
    pub(super) planned: Planned,
    pub(super) options: RunOptions,
    pub(super) mode: Mode,
    /// What it is made from.
    made: Provenance,
    /// Whether another outcome than completed is a failure.
    require_completed: bool,
}

/// What is particular to a run that is reported.
pub(super) struct RunReport<'a> {
    pub(super) run: &'a Run,
    pub(super) title: &'a str,
    pub(super) keys: Map<String, Value>,
    pub(super) facts: Vec<(String, String)>,
    /// How long it took: keys for `--json`, a fact for a reader.
    pub(super) timing: (Map<String, Value>, (String, String)),
    /// Whether JSON is printed.
    pub(super) json: bool,
}

impl Simulation {
    /// Writes the files of a run, all that `output` gets, and prints its result.
    pub(super) fn report(&self, output: Output, report: RunReport<'_>) -> Result<(), CliError> {
        let Planned { plan, table, .. } = &self.planned;
        let run = report.run;
        let mut summary = export::summary_json(&run.summary);
        summary.extend(self.planned.json());
        summary.extend(report.keys);
        summary.insert("plant_elements".into(), json!(run.elements));
        let summary = self.made.summary(summary);
        output.write("plan.csv", |w| export::plan_csv(plan, w))?;
        output.write("table.bin", |w| w.write_all(&table.image))?;
        output.write("run.csv", |w| export::run_csv(run, w))?;
        output.json("summary.json", &summary)?;
        let name = match self.mode {
            Mode::Proposed => "proposed",
            Mode::Feedforward => "feedforward",
            Mode::Feedback => "feedback",
        };
        let mut all = self.planned.facts();
        all.push(("plant".into(), format!("{} elements", run.elements)));
        all.extend(report.facts);
        let page = pages::RunsContent {
            title: report.title,
            cases: &[(name, "plant", plan, run)],
            shown: 0,
            facts: &all,
            provenance: &self.made.facts(),
        };
        let place = pages::runs(&output, &page)?;
        output.commit()?;
        let (timing, took) = report.timing;
        if report.json {
            let mut all = self.planned.timing();
            all.extend(timing);
            return print(with_timing(&summary, all));
        }
        print_facts(&all)?;
        print_facts(&[self.planned.took(), took])?;
        print("")?;
        print(results([(name, "plant", run)]))?;
        print(format_args!("\n{place}"))
    }

    /// See [`judge`]; the results are in `out`.
    pub(super) fn judge(&self, run: &Run, out: &Path) -> Result<(), CliError> {
        let first = self.planned.plan.points[0].t;
        let ended_s = run.rows.last().map_or(first, |row| row.t);
        judge(run.summary.outcome, ended_s, self.require_completed, out)
    }
}

/// A run that could not go on beyond the time `ended_s` is a failure; a bad result is one only if
/// that is what was asked for. The results are in `out`.
pub(super) fn judge(
    outcome: Outcome,
    ended_s: f64,
    require_completed: bool,
    out: &Path,
) -> Result<(), CliError> {
    let out = out.to_path_buf();
    if require_completed && outcome != Outcome::Completed {
        return Err(CliError::NotCompleted { outcome, out });
    }
    if outcome == Outcome::Diverged {
        let t_s = ended_s;
        return Err(CliError::Stopped { t_s, outcome, out });
    }
    Ok(())
}

impl SimulationArgs {
    /// The files that are read.
    pub(super) fn inputs(&self) -> impl Iterator<Item = Option<&Path>> {
        let files = [&self.controller, &self.plant, &self.table];
        let inputs = self.common.inputs().into_iter();
        inputs.chain(files.map(|file| file.as_deref()))
    }

    /// Reads the files and plans.
    pub(super) fn prepare(&self) -> Result<Simulation, CliError> {
        self.check_gains()?;
        let (arm, task) = self
            .common
            .load_on_surface("the rigid surface of --ideal and pil")?;
        let law = controller(self.controller.as_deref(), config::PAPER_CONTROLLER)?;
        self.check_mode(&law)?;
        let (mut plant, mut start) = config::load(self.plant.as_deref(), "", config::parse_plant)?;
        self.adjust(&mut plant, &mut start)?;
        let mut planned = self.common.plan(&arm, &task)?;
        if let Some(file) = &self.table {
            planned.table.image = read_table(file, &planned.plan)?;
        }
        let mode = self.mode(&law);
        let options = RunOptions {
            law: mode.of(&law),
            limits: planned.limits,
            plant,
            start,
        };
        let made = Provenance::of(&self.common)?
            .profile(&task)
            .file(
                "controller",
                self.controller.as_deref(),
                config::PAPER_CONTROLLER,
            )?
            .file("plant", self.plant.as_deref(), "")?
            .file("table", self.table.as_deref(), "")?
            .gains(&options.law)
            .plant(&options.plant);
        Ok(Simulation {
            planned,
            options,
            mode,
            made,
            require_completed: self.require_completed,
        })
    }

    /// Whether `law` has the part that is to act.
    fn check_mode(&self, law: &LawParameters) -> Result<(), CliError> {
        match (self.mode, law) {
            (Some(ModeArg::Feedback), LawParameters::Hybrid(_)) => Err(CliError::NoEffect {
                what: "--mode feedback",
                beside: "with law = \"hybrid\", which needs the planned torques: proposed and feedforward are accepted",
            }),
            _ => Ok(()),
        }
    }

    /// The controller on the bench where no file names one.
    fn default_controller(&self) -> &'static str {
        match self.mode {
            // Which the hybrid law has not.
            Some(ModeArg::Feedback) => config::PAPER_CONTROLLER,
            _ => config::DEFAULT_CONTROLLER,
        }
    }

    /// Gains that nothing asks for are a mistake.
    fn check_gains(&self) -> Result<(), CliError> {
        if matches!(self.mode, Some(ModeArg::Feedforward)) && self.controller.is_some() {
            return Err(CliError::NoEffect {
                what: "--controller",
                beside: "with --mode feedforward, which has no gains: leave one of them out",
            });
        }
        Ok(())
    }

    /// Which part of `law` acts.
    fn mode(&self, law: &LawParameters) -> Mode {
        match self.mode {
            Some(ModeArg::Proposed) => Mode::Proposed,
            Some(ModeArg::Feedforward) => Mode::Feedforward,
            Some(ModeArg::Feedback) => Mode::Feedback,
            None if law.paper().is_some_and(|law| !law.feedforward) => Mode::Feedback,
            None => Mode::Proposed,
        }
    }

    /// Puts what was said on the command line before what the plant file says.
    fn adjust(&self, plant: &mut PlantParameters, start: &mut Start) -> Result<(), CliError> {
        if let Some(elements) = self.plant_elements {
            config::check_option("--plant-elements", "elements", f64::from(elements))?;
            plant.elements = elements as usize;
        }
        if let Some(scale) = self.bending_stiffness_scale {
            let (option, field) = ("--bending-stiffness-scale", "bending_stiffness_scale");
            plant.bending_stiffness_scale = config::check_option(option, field, scale)?;
        }
        match self.start {
            Some(StartArg::PlanMoving) => *start = Start::PlanMoving,
            Some(StartArg::PlanAtRest) => *start = Start::PlanAtRest,
            Some(StartArg::Equilibrium) => *start = Start::Equilibrium,
            None => {}
        }
        Ok(())
    }
}

/// Bytes of a file that are read as a table.
const TABLE_BYTES_MAX: u64 = 64 << 20;

/// Reads a table image and makes sure that it is for the plan's arm and task.
fn read_table(file: &Path, plan: &Plan) -> Result<Vec<u8>, CliError> {
    // More than any slot holds is no table; a device would never end.
    let mut image = Vec::new();
    File::open(file)
        .and_then(|opened| opened.take(TABLE_BYTES_MAX).read_to_end(&mut image))
        .map_err(|cause| CliError::Unreadable {
            file: file.to_path_buf(),
            cause,
        })?;
    let table = Table::open_for(&image, plan.model.arm.fingerprint()).map_err(|source| {
        CliError::Table {
            file: file.to_path_buf(),
            source,
        }
    })?;
    let header = table.header();
    let first_tick = -plan.pre_ticks.cast_signed();
    let is = (header.tick_rate_hz, header.ticks, header.first_tick);
    let should = (plan.tick_rate_hz, plan.ticks, first_tick);
    let words = |(rate, ticks, first): (u32, u32, i32)| {
        format!("{ticks} ticks from tick {first} at {rate} Hz")
    };
    if is != should {
        return Err(CliError::OtherTiming {
            file: file.to_path_buf(),
            found: words(is),
            expected: words(should),
        });
    }
    let (found, expected) = (header.task_fingerprint, plan.task_fingerprint());
    if found != expected {
        return Err(CliError::OtherTask {
            file: file.to_path_buf(),
            found,
            expected,
        });
    }
    Ok(image)
}

//! What `run` and `campaign` share: scenario, plan, controller and board, ready for the bench.

use super::plan::Planned;
use super::provenance::{Provenance, profile_text, sha256_of, with_timing};
use super::{
    CliError, Common, ModelArg, Output, own_gains, pages, print, print_facts, progress_bar,
    results, say,
};
use crate::campaign::identity::CampaignInput;
use crate::campaign::scenario::Scenario;
use crate::files::config::{
    self, ArmConfig, ConfigError, FILE_BYTES_MAX, ScenarioConfig, read_text,
};
use crate::files::export;
use crate::planner::plan::Plan;
use crate::planner::task::{Task, Travel};
use crate::simulation::bench::{
    self, BenchArm, BenchBoard, BenchLog, BenchRow, BenchTask, RunFigures, Then,
};
use crate::simulation::closed_loop::Run;
use crate::text::{Shortest, four_digits};
use clap::Args;
use flexor::control::LawParameters;
use flexor::model::ArmParameters;
use flexor::supervisor::MonitorParameters;
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::slice;
use std::time::Instant;

/// Which arms are on the bench.
#[derive(Args, Clone)]
pub(super) struct ScenarioArgs {
    /// Arms, surface, drives and sensors as they are, and the files that they belong to; without
    /// it all is ideal but the board's counts [examples/scenarios]
    #[arg(long, value_name = "FILE")]
    pub(super) scenario: Option<PathBuf>,
    /// A value of the scenario, say contact.friction=0.3; may be given several times
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
    /// A move through the air that every arm goes over to once it stands after the task
    /// [examples/task_park.toml]
    #[arg(long, value_name = "FILE")]
    pub(super) then: Option<PathBuf>,
}

/// Gains of the hybrid law are held against the scenario's arms before anything runs.
#[derive(Args, Clone)]
pub(super) struct ProofArgs {
    /// Run gains of the hybrid law also where they are not proved stable on every arm
    #[arg(long)]
    unproven: bool,
}

impl ProofArgs {
    /// Refuses gains that do not hold the bench's arms, or says so; what a summary says of them.
    ///
    /// # Errors
    /// [`CliError::Unproven`], [`CliError::Hybrid`].
    pub(super) fn check(&self, bench: &Bench) -> Result<Map<String, Value>, CliError> {
        if let LawParameters::Hybrid(law) = &bench.law {
            let (plan, scenario) = (&bench.planned.plan, &bench.config.scenario);
            return match own_gains::hold(plan, scenario, law) {
                Ok((keys, None)) => Ok(keys),
                Ok((keys, Some(why))) if self.unproven => {
                    let refusal = CliError::Unproven { why };
                    say(format_args!("warning: {refusal}"));
                    Ok(keys)
                }
                Ok((_, Some(why))) => Err(CliError::Unproven {
                    why: why + "; --unproven runs them all the same",
                }),
                // What cannot be examined, as a friction that no gains bear.
                Err(why) if self.unproven => {
                    say(format_args!("warning: {why}"));
                    Ok(Map::new())
                }
                Err(why) => Err(why.into()),
            };
        }
        Ok(Map::new())
    }
}

/// All that a bench's runs have in common.
pub(super) struct Bench {
    /// The plan with its table and limits.
    pub(super) planned: Planned,
    /// Gains and options of the law.
    pub(super) law: LawParameters,
    /// Thresholds of the monitors.
    monitors: MonitorParameters,
    /// The board.
    pub(super) board: BenchBoard,
    /// What follows, and the thresholds of the monitors meanwhile.
    then: Option<(Planned, MonitorParameters)>,
    /// The scenario.
    pub(super) config: ScenarioConfig,
    /// What a reader should know, once it is clear that something runs.
    note: Option<String>,
    /// The texts that decide the runs.
    pub(super) inputs: Vec<CampaignInput>,
}

impl ScenarioArgs {
    /// Reads scenario and the files that it or the command line, `asked`, names, the command line's
    /// first, and plans.
    pub(super) fn prepare(
        &self,
        asked: &Common,
        asked_gains: Option<&Path>,
        default_gains: &'static str,
    ) -> Result<Bench, CliError> {
        let mut config = config::load_scenario(self.scenario.as_deref(), &self.set)?;
        let mut common = asked.clone();
        for (given, named) in [
            (&mut common.arm, &config.arm),
            (&mut common.task, &config.task),
            (&mut common.board, &config.board),
        ] {
            if given.is_none() {
                given.clone_from(named);
            }
        }
        let gains = asked_gains.or(config.controller.as_deref());
        let (arm, task) = common.load()?;
        let planned = common.plan(&arm, &task)?;
        let (law, law_text) = law_for(gains, default_gains, &planned.plan, &config.scenario)?;
        config.scenario.for_law(&law);
        let monitors = monitors_for(&common, &arm, &planned.plan, &law)?;
        self.check_faults(&config, &planned.plan)?;
        let then = self.plan_then(&common, &arm, &law)?;
        let (board, note) = board_for(&common, &planned.plan)?;
        let scenario = self.scenario.as_deref();
        let mut inputs = vec![CampaignInput {
            // Nobody has written the ideal one.
            sha256: scenario.map_or(Ok(String::new()), |file| sha256_of(Some(file), ""))?,
            ..input("scenario", (scenario, scenario), config.canonical.clone())?
        }];
        inputs.extend(file_texts(asked, &common, &task)?);
        inputs.push(input("controller", (asked_gains, gains), law_text)?);
        if let (Some(file), Some((then, _))) = (&self.then, &then) {
            let said = text(Some(file), "")? + &move_text(&then.plan.task);
            inputs.push(input("then", (Some(file), Some(file)), said)?);
        }
        inputs.extend(self.values(asked, planned.plan.tick_rate_hz));
        Ok(Bench {
            planned,
            law,
            monitors,
            board,
            then,
            config,
            note,
            inputs,
        })
    }

    /// The move that follows, planned for `arm`, and thresholds for it.
    fn plan_then(
        &self,
        common: &Common,
        arm: &ArmConfig,
        law: &LawParameters,
    ) -> Result<Option<(Planned, MonitorParameters)>, CliError> {
        let Some(file) = &self.then else {
            return Ok(None);
        };
        if law.paper().is_some() {
            return Err(CliError::NoEffect {
                what: "--then",
                beside: "with law = \"paper\", which leaves no arm standing: the hybrid law does",
            });
        }
        let of_move = Common {
            task: Some(file.clone()),
            ..common.clone()
        };
        let (_, task) = of_move.load()?;
        if let Travel::Line = task.travel {
            return Err(CliError::NoMove { file: file.clone() });
        }
        let planned = of_move.plan(arm, &task)?;
        let monitors = monitors_for(common, arm, &planned.plan, law)?;
        Ok(Some((planned, monitors)))
    }

    /// A fault that no run lives to see is a mistake.
    fn check_faults(&self, config: &ScenarioConfig, plan: &Plan) -> Result<(), CliError> {
        let end_s = plan.points.last().map_or(0.0, |point| point.t);
        let faults = config.scenario.faults.iter().enumerate();
        match faults.into_iter().find(|(_, fault)| fault.from_s > end_s) {
            None => Ok(()),
            Some((i, fault)) => Err(CliError::Config(ConfigError::OutOfRange {
                file: self
                    .scenario
                    .as_ref()
                    .map_or("--set".into(), |file| file.display().to_string()),
                field: format!("faults[{i}].at_s"),
                value: fault.from_s,
                accepted: format!("a time in s up to the run's end, {end_s}"),
            })),
        }
    }

    /// What the command line says that is in no file.
    fn values(&self, asked: &Common, tick_rate_hz: u32) -> Vec<CampaignInput> {
        let said = |option: &str, said: String, text: String| CampaignInput {
            option: option.into(),
            file: said,
            text,
            sha256: String::new(),
        };
        let rate = asked.tick_rate_hz.map(|rate| rate.to_string());
        let mut values = vec![said(
            "tick-rate-hz",
            rate.unwrap_or_default(),
            tick_rate_hz.to_string(),
        )];
        if let ModelArg::AsPrinted = asked.model {
            let model = "as-printed";
            values.push(said("model", model.into(), model.into()));
        }
        // What they say is in the scenario's text already.
        let sets = self.set.iter();
        values.extend(sets.map(|set| said("set", set.clone(), String::new())));
        values
    }
}

/// The board for a plan: the one that is named, or the default one made large enough, as it need
/// not be the arm's; and a note, if that was so.
fn board_for(common: &Common, plan: &Plan) -> Result<(BenchBoard, Option<String>), CliError> {
    let board = common.board()?.parameters;
    if common.board.is_some() {
        return Ok((BenchBoard::from(&board), None));
    }
    let slopes = plan.points.iter().map(|point| point.root_slope.abs());
    let slope = slopes.fold(0.0, f64::max);
    let (board, enlarged) =
        board.fitted(plan.peaks.torque, plan.task.normal_force.largest(), slope);
    let note = enlarged.then(|| {
        format!(
            "the default board's ranges do not fit this arm; the bench takes drives of {} and {} N m, a force cell of {} N, a gauge of {} rad; --board FILE says what there is",
            board.drive_full_scale_nm[0],
            board.drive_full_scale_nm[1],
            board.force_range_n[1],
            board.gauge_range_rad[1]
        )
    });
    Ok((BenchBoard::from(&board), note))
}

/// The texts of arm, task and board: `asked` is what the command line said, `common` what holds.
fn file_texts(
    asked: &Common,
    common: &Common,
    task: &Task,
) -> Result<[CampaignInput; 3], CliError> {
    let of = |option: &str, said: &Option<PathBuf>, file: &Option<PathBuf>, default: &str| {
        let text = text(file.as_deref(), default)?;
        input(option, (said.as_deref(), file.as_deref()), text)
    };
    let mut of_task = of("task", &asked.task, &common.task, config::DEFAULT_TASK)?;
    // The files that it names decide the runs, too.
    of_task.text.push_str(&profile_text(task));
    of_task.text.push_str(&move_text(task));
    Ok([
        of("arm", &asked.arm, &common.arm, config::DEFAULT_ARM)?,
        of_task,
        of("board", &asked.board, &common.board, config::DEFAULT_BOARD)?,
    ])
}

/// An input that decides the runs; `said` is what the command line named it by, nothing where the
/// scenario names the `file` or it is built in.
fn input(
    option: &str,
    (said, file): (Option<&Path>, Option<&Path>),
    text: String,
) -> Result<CampaignInput, CliError> {
    Ok(CampaignInput {
        option: option.into(),
        file: said.map_or(String::new(), |file| file.display().to_string()),
        sha256: sha256_of(file, &text)?,
        text,
    })
}

/// The ends of a move through the air, as a comment in a task's text.
fn move_text(task: &Task) -> String {
    match task.travel {
        Travel::Line => String::new(),
        Travel::Joints(way) => {
            let [from, to] = way.ends.map(|end| end.map(Shortest));
            format!(
                "\n# The joints' way: from {}, {} to {}, {} rad\n",
                from[0], from[1], to[0], to[1]
            )
        }
    }
}

fn text(file: Option<&Path>, default: &str) -> Result<String, ConfigError> {
    match file {
        Some(file) => read_text(file, FILE_BYTES_MAX).map(|(_, text)| text),
        None => Ok(default.to_string()),
    }
}

/// The law, and its text.
fn law_for(
    file: Option<&Path>,
    default: &'static str,
    plan: &Plan,
    scenario: &Scenario,
) -> Result<(LawParameters, String), CliError> {
    let text = law_text(file, default, plan, scenario)?;
    let named = file.map_or("gains found for the arm".into(), |f| {
        f.display().to_string()
    });
    Ok((config::parse_controller(&named, &text)?, text))
}

/// The text of the gains: the file's; without one the examples' where the arm is theirs, else such
/// as are found for it: no arm runs on another arm's gains.
fn law_text(
    file: Option<&Path>,
    default: &'static str,
    plan: &Plan,
    scenario: &Scenario,
) -> Result<String, CliError> {
    if file.is_none()
        && default == config::DEFAULT_CONTROLLER
        && (plan.model.arm != ArmParameters::PAPER || plan.tick_rate_hz != EXAMPLES_RATE_HZ)
    {
        return own_gains::designed_text(plan, scenario);
    }
    Ok(text(file, default)?)
}

/// Control rate of the gains in the examples, Hz.
const EXAMPLES_RATE_HZ: u32 = 5000;

/// The arm's thresholds where it has any, and those of the plan.
fn monitors_for(
    common: &Common,
    arm: &ArmConfig,
    plan: &Plan,
    law: &LawParameters,
) -> Result<MonitorParameters, ConfigError> {
    let file = common
        .arm
        .as_ref()
        .map_or("arm".into(), |file| file.display().to_string());
    arm.monitors.checked(&file, plan, law)
}

impl Bench {
    /// Says what a reader should know.
    pub(super) fn say_note(&self) {
        if let Some(note) = &self.note {
            say(format_args!("note: {note}"));
        }
    }

    /// Runs another law. One without feedback asks nothing of force cell and gauge, and so do the
    /// monitors.
    pub(super) fn take_law(&mut self, law: LawParameters) {
        if law.paper().is_some_and(|paper| !paper.has_feedback()) {
            self.monitors.force_n = f32::INFINITY;
            self.monitors.root_moment_nm = f32::INFINITY;
            self.monitors.balance_nm = [f32::INFINITY; 2];
        }
        self.law = law;
    }

    /// What every arm is to do.
    pub(super) fn task(&self) -> BenchTask<'_> {
        BenchTask {
            plan: &self.planned.plan,
            image: &self.planned.table.image,
            law: &self.law,
            limits: &self.planned.limits,
            monitors: &self.monitors,
            board: &self.board,
            failure: &self.config.scenario.failure,
            then: self.then.as_ref().map(|(then, monitors)| Then {
                plan: &then.plan,
                image: &then.table.image,
                limits: &then.limits,
                monitors,
            }),
        }
    }
}

impl Bench {
    /// Runs `arm`, writes everything, all that `output` gets, and prints the result. `keys` and
    /// `facts` are what is particular to it.
    pub(super) fn run(
        &self,
        output: Output,
        arm: &BenchArm,
        (title, made): (&str, &Provenance),
        (keys, facts): (Map<String, Value>, Vec<(String, String)>),
        json: bool,
    ) -> Result<RunFigures, CliError> {
        let plan = &self.planned.plan;
        self.say_note();
        if let Some(refusal) = bench::refusal(&self.task(), arm)? {
            say(format_args!(
                "warning: a board would not be enabled where this arm starts ({refusal}); the bench enables it all the same"
            ));
        }
        let since = Instant::now();
        let progress = progress_bar(plan.points.len() as u64, "ticks, {eta} left");
        let mut log = BenchLog::new(plan.points.len());
        let figures = bench::run::<f64>(&self.task(), slice::from_ref(arm), |lane, row, plant| {
            log.add(row, (plant, lane), arm);
            progress.inc(1);
        })?;
        progress.finish_and_clear();
        let figures = figures[0];
        let (run, rows) = log.finish(&figures, arm);
        let run_ms = since.elapsed().as_secs_f64() * 1e3;

        let mut more = keys;
        more.insert("plant_elements".into(), json!(run.elements));
        let mut all = facts;
        all.extend(facts_of(&figures, run.elements));
        let recorded = (&run, &rows[..], &figures);
        self.write(
            output,
            (title, made),
            (more, all),
            recorded,
            (json, Some(run_ms)),
        )?;
        Ok(figures)
    }

    /// Writes everything of a run, all that `output` gets, and prints the result. `keys` and `facts` are
    /// what is particular to it; simulated ones took so many milliseconds.
    pub(super) fn write(
        &self,
        output: Output,
        (title, made): (&str, &Provenance),
        (keys, facts): (Map<String, Value>, Vec<(String, String)>),
        (run, rows, figures): (&Run, &[BenchRow], &RunFigures),
        (json, run_ms): (bool, Option<f64>),
    ) -> Result<(), CliError> {
        let plan = &self.planned.plan;
        let mut summary = export::summary_json(&run.summary);
        summary.extend(export::bench_json(figures));
        summary.extend(self.planned.json());
        summary.extend(keys);
        let summary = made.summary(summary);
        output.write("plan.csv", |w| export::plan_csv(plan, w))?;
        output.write("table.bin", |w| w.write_all(&self.planned.table.image))?;
        output.write("run.csv", |w| export::bench_csv(rows, w))?;
        output.json("summary.json", &summary)?;
        let mut all = self.planned.facts();
        all.extend(facts);
        let name = law_name(&self.law);
        let page = pages::RunsContent {
            title,
            cases: &[(name, "bench", plan, run)],
            shown: 0,
            facts: &all,
            provenance: &made.facts(),
        };
        let place = pages::runs(&output, &page)?;
        output.commit()?;
        if json {
            let mut timing = self.planned.timing();
            timing.extend(run_ms.map(|run_ms| ("run_ms".into(), json!(run_ms))));
            return print(with_timing(&summary, timing));
        }
        print_facts(&all)?;
        let took = run_ms.map(|run_ms| ("simulated in".to_string(), format!("{run_ms:.0} ms")));
        let times: Vec<_> = [self.planned.took()].into_iter().chain(took).collect();
        print_facts(&times)?;
        print("")?;
        print(results([(name, "bench", run)]))?;
        print(format_args!("\n{place}"))
    }
}

/// What of which law acts, for a reader.
fn law_name(law: &LawParameters) -> &'static str {
    match law {
        LawParameters::Hybrid(_) => "hybrid",
        LawParameters::Paper(law) => match (law.feedforward, law.has_feedback()) {
            (true, true) => "proposed",
            (true, false) => "feedforward",
            _ => "feedback",
        },
    }
}

/// What a reader wants to know of a run besides its errors.
fn facts_of(figures: &RunFigures, elements: usize) -> [(String, String); 3] {
    let off_mm = four_digits(1e3 * figures.along_error_max_m);
    let lost_ms = four_digits(1e3 * figures.contact_lost_s);
    [
        ("plant", format!("{elements} elements")),
        ("without contact", format!("{lost_ms} ms")),
        ("along the surface", format!("{off_mm} mm off at most")),
    ]
    .map(|(name, fact)| (name.into(), fact))
}

//! Behaviour across Flexor's crates: the tests are in `tests/`, the independent
//! reference figures they check against in `reference/`.
//!
//! This library reads the reference files, knows the paper's arm and tasks, and puts scenarios on
//! the bench.

use flexor::control::{LawParameters, LimitParameters, PaperParameters};
use flexor::model::ArmParameters;
use flexor::supervisor::MonitorParameters;
use flexor_sim::campaign::engine::Campaign;
use flexor_sim::campaign::record::RunRecord;
use flexor_sim::files::config;
use flexor_sim::files::config::ScenarioConfig;
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::monitors::default_monitors;
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit;
use flexor_sim::planner::table_fit::EncodedTable;
use flexor_sim::planner::task::{Task, Window};
use flexor_sim::simulation::bench::{BenchBoard, BenchTask};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// A reference file of numbers: the header's names and the rows.
#[derive(Debug)]
pub struct RefTable {
    names: Vec<String>,
    /// Rows in the file's order.
    pub rows: Vec<Vec<f64>>,
}

impl RefTable {
    /// Reads `reference/<name>`.
    ///
    /// # Panics
    /// If it cannot be read: the test that wants it has failed.
    pub fn read(name: &str) -> Self {
        let mut reader = csv::Reader::from_path(path(name)).expect(name);
        let names = reader
            .headers()
            .expect(name)
            .iter()
            .map(String::from)
            .collect();
        let rows = reader.deserialize().collect::<Result<_, _>>().expect(name);
        Self { names, rows }
    }

    /// Position of a column.
    ///
    /// # Panics
    /// If there is none of that name.
    pub fn column(&self, name: &str) -> usize {
        let found = self.names.iter().position(|n| n == name);
        found.unwrap_or_else(|| panic!("no column {name} in {:?}", self.names))
    }
}

/// Where a reference file is.
pub fn path(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "reference", name]
        .iter()
        .collect()
}

/// The example's gains, of the paper's law.
pub fn paper_law() -> PaperParameters {
    let law = config::parse_controller("example", config::PAPER_CONTROLLER)
        .expect("the example is valid");
    *law.paper().expect("the example is of the paper's law")
}

/// The hybrid law with the example's gains for any inertia at link 2's root.
pub fn any_hub_law() -> LawParameters {
    let text = include_str!("../examples/controller.toml");
    config::parse_controller("example", text).expect("the example is valid")
}

/// The paper's arm (Table 1), elbow down.
pub fn paper_arm() -> ArmParameters {
    config::parse_arm("example", config::DEFAULT_ARM)
        .expect("the example is valid")
        .arm
}

/// The paper's task: 0.5 m in 2 s, pressing with 2 N.
pub fn paper_task() -> Task {
    config::parse_task("example", config::DEFAULT_TASK).expect("the example is valid")
}

/// The paper's path in 0.4 s, with `window` seconds of pre- and post-actuation.
pub fn fast_task(window: f64) -> Task {
    let mut task = paper_task();
    task.path.duration = 0.4;
    task.pre_actuation = Window::Fixed(window);
    task.post_actuation = Window::Fixed(window);
    task
}

/// A plan with the default options, and its table.
///
/// # Panics
/// If there is none: the test that wants it has failed.
pub fn planned(arm: &ArmParameters, task: &Task) -> (Plan, EncodedTable) {
    let plan = plan(arm, task, &PlanOptions::default()).expect("a plan");
    let table = table_fit::fit_table(&plan).expect("a table");
    (plan, table)
}

/// A file of `examples`.
pub fn example(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "..", "examples", name]
        .iter()
        .collect()
}

/// A scenario, planned, with all that its runs need: what `flexor campaign` makes of its file.
#[derive(Clone, Debug)]
pub struct OnBench {
    /// The scenario, and the files that it names.
    pub config: ScenarioConfig,
    /// The plan.
    pub plan: Plan,
    /// Its table.
    pub image: Vec<u8>,
    /// The gains.
    pub law: LawParameters,
    /// The torque limits.
    pub limits: LimitParameters,
    /// Thresholds of the monitors.
    pub monitors: MonitorParameters,
    /// The board.
    pub board: BenchBoard,
}

impl OnBench {
    /// The scenario `file` with `sets` (`key=value`) laid over it.
    ///
    /// # Panics
    /// If it is none, or has no plan.
    pub fn new(file: &Path, sets: &[&str]) -> Self {
        Self::on_law(file, sets, None)
    }

    /// The same with `law` instead of the scenario's.
    fn on_law(file: &Path, sets: &[&str], law: Option<LawParameters>) -> Self {
        let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
        let mut config = config::load_scenario(Some(file), &sets).expect("a scenario");
        let (arm, task, gains) = (&config.arm, &config.task, &config.controller);
        let arm = config::load(arm.as_deref(), config::DEFAULT_ARM, config::parse_arm);
        let task = config::load(task.as_deref(), config::DEFAULT_TASK, config::parse_task);
        let law = law.unwrap_or_else(|| {
            let file = gains.as_deref();
            config::load(file, config::DEFAULT_CONTROLLER, config::parse_controller).expect("gains")
        });
        config.scenario.for_law(&law);
        let named = config.board.as_deref();
        let board = config::load(named, config::DEFAULT_BOARD, config::parse_board);
        let (arm, mut board) = (arm.expect("an arm"), board.expect("a board").parameters);
        let options = PlanOptions {
            elements: arm.elements,
            tick_rate_hz: board.tick_rate_hz,
            ..PlanOptions::default()
        };
        let plan = plan(&arm.arm, &task.expect("a task"), &options).expect("a plan");
        if config.board.is_none() {
            let slopes = plan.points.iter().map(|point| point.root_slope.abs());
            let slope = slopes.fold(0.0, f64::max);
            let force = plan.task.normal_force.largest();
            board = board.fitted(plan.peaks.torque, force, slope).0;
        }
        Self {
            image: table_fit::fit_table(&plan).expect("a table").image,
            monitors: default_monitors(&plan, &law),
            law,
            limits: arm.limits.unwrap_or_else(|| default_limits(&plan)),
            board: BenchBoard::from(&board),
            config,
            plan,
        }
    }

    /// The same without monitors: to see what becomes of an arm that nothing stops.
    #[must_use]
    pub fn unmonitored(self) -> Self {
        Self {
            monitors: MonitorParameters::NONE,
            ..self
        }
    }

    /// The same with the example's gains of the paper's law, and no monitor: it is there to be
    /// compared with simulators that stop no arm.
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn paper(file: &Path, sets: &[&str]) -> Self {
        Self::on_law(file, sets, Some(paper_law().into())).unmonitored()
    }

    /// What every arm is to do.
    pub fn task(&self) -> BenchTask<'_> {
        BenchTask {
            plan: &self.plan,
            image: &self.image,
            law: &self.law,
            limits: &self.limits,
            monitors: &self.monitors,
            board: &self.board,
            failure: &self.config.scenario.failure,
            then: None,
        }
    }

    /// The campaign with this seed.
    pub fn campaign(&self, seed: u64) -> Campaign<'_> {
        Campaign {
            task: self.task(),
            scenario: &self.config.scenario,
            seed,
        }
    }

    /// The runs of these numbers, by rising number.
    ///
    /// # Panics
    /// If one of them has no arm.
    pub fn runs(&self, seed: u64, numbers: &[u64]) -> Vec<RunRecord> {
        let records = Mutex::new(Vec::new());
        self.campaign(seed)
            .run_all(numbers, &AtomicBool::new(false), false, |record, _| {
                records.lock().expect("no panic").push(record);
            })
            .expect("an arm for every run");
        let mut records = records.into_inner().expect("no panic");
        records.sort_by_key(|record| record.run);
        records
    }
}

/// The firmware's image, which `cargo xtask test` builds.
///
/// # Panics
/// Where `FLEXOR_ELF` does not say where it is.
pub fn elf() -> PathBuf {
    std::env::var_os("FLEXOR_ELF")
        .expect("FLEXOR_ELF is not set: run `cargo xtask test`")
        .into()
}

/// A new folder for a test.
///
/// # Panics
/// If it cannot be made.
pub fn folder() -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = format!("flexor-test-{}-{count}", std::process::id());
    let folder = std::env::temp_dir().join(name);
    std::fs::create_dir(&folder).expect("a folder for temporary files");
    folder
}

//! The command `plan`, and planning for all commands: plan, table, limits, and what a reader
//! should know of them.

use super::provenance::{Provenance, with_timing};
use super::{CliError, Common, ModelArg, Output, pages, print, print_facts, say};
use crate::files::config::ArmConfig;
use crate::files::export;
use crate::model::link::{LinkKind, LinkModel};
use crate::planner::limits::default_limits;
use crate::planner::plan::{Plan, PlanOptions, PlanPoint};
use crate::planner::table_fit::EncodedTable;
use crate::planner::task::{Equations, Task};
use crate::planner::tip_force::FRICTION_SHARE_MAX;
use crate::planner::{planning, table_fit};
use crate::text::{Shortest, four_digits};
use clap::Args;
use flexor::control::LimitParameters;
use flexor::supervisor::BoardParameters;
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Args)]
pub(super) struct PlanArgs {
    #[command(flatten)]
    common: Common,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/plan")]
    out: PathBuf,
}

pub(super) fn plan_command(args: &PlanArgs) -> Result<(), CliError> {
    let output = Output::open(&args.out, args.common.inputs())?;
    let (arm, task) = args.common.load()?;
    let planned = args.common.plan(&arm, &task)?;
    let mut warnings = planned.doubts.clone();
    if let Some(word) = bending_doubt(&planned.plan) {
        say(format_args!("warning: {word}"));
        warnings.push(word);
    }
    let made = Provenance::of(&args.common)?.profile(&task);
    output.write("plan.csv", |w| export::plan_csv(&planned.plan, w))?;
    output.write("table.bin", |w| w.write_all(&planned.table.image))?;
    let summary = made.summary(planned.json());
    let facts = planned.facts();
    let page = pages::PlanContent {
        plan: &planned.plan,
        verdict: planned.verdict(),
        warnings: &warnings,
        facts: &facts,
        provenance: &made.facts(),
    };
    let place = pages::plan(&output, &page)?;
    output.json("summary.json", &summary)?;
    output.commit()?;
    if args.common.json {
        return print(with_timing(&summary, planned.timing()));
    }
    print_facts(&facts)?;
    print_facts(&[planned.took()])?;
    print(format_args!(
        "\nplan.csv, table.bin and summary.json are in {}\n{place}",
        args.out.display()
    ))
}

/// What a reader should know before using a plan and the drives' `limits`.
fn doubts(plan: &Plan, limits: &LimitParameters) -> Vec<String> {
    /// Share of a torque's peak that it may change by in the first or last control period;
    /// with up to 8 elements the paper's task stays below it.
    const JUMP: f64 = 0.03;
    let mut doubts = Vec::new();
    let points = &plan.points;
    let last = points.len() - 1;
    for (end, window, i, j) in [
        ("starts", "pre_actuation_s", 0, 1),
        ("ends", "post_actuation_s", last - 1, last),
    ] {
        for joint in 0..2 {
            let jump = (points[i].torque[joint] - points[j].torque[joint]).abs();
            if jump > JUMP * plan.peaks.torque[joint] {
                doubts.push(format!(
                    "the plan {end} with a jump of torque tau{} by {} N m within a control period, to bend the link at once; a longer {window}, for instance \"auto\", or fewer link2.elements avoid it",
                    joint + 1,
                    four_digits(jump)
                ));
            }
        }
    }
    for joint in 0..2 {
        let step = |pair: &[PlanPoint]| (pair[1].torque[joint] - pair[0].torque[joint]).abs();
        let steepest = points.windows(2).max_by(|a, b| step(a).total_cmp(&step(b)));
        let (limit, need) = (
            limits.torque_rate_nm_s[joint],
            plan.peaks.torque_rate[joint],
        );
        if let Some(pair) = steepest
            && need > limit
        {
            doubts.push(format!(
                "limits.torque_rate_Nm_s[{joint}] = {} is less than the {} N m/s that the plan needs of joint {} at t = {:.4} s: the arm will lag behind the plan; a longer duration_s may need less",
                Shortest(limit),
                four_digits(need),
                joint + 1,
                pair[0].t
            ));
        }
    }
    doubts.extend(friction_doubt(plan));
    doubts
}

/// Whether a link that is planned as if it bent little bends more than that.
fn bending_doubt(plan: &Plan) -> Option<String> {
    /// From here on the paper's arm misses its path by millimetres and its force by tenths, rad.
    const SLOPE_RAD: f64 = 0.3;
    if plan.model.link.kind.model != LinkModel::Linear {
        return None;
    }
    let slope = |point: &&PlanPoint| point.root_slope.abs();
    let points = plan.points.iter();
    let steepest = points.max_by(|a, b| slope(a).total_cmp(&slope(b)))?;
    (slope(&steepest) > SLOPE_RAD).then(|| {
        format!(
            "link 2 bends by {} rad at its root at t = {:.4} s: link2.model = \"linear\" is not valid there, beyond some {SLOPE_RAD} rad, as a bent link is shorter; link2.model = \"geometric\" is",
            four_digits(slope(&steepest)),
            steepest.t
        )
    })
}

/// Whether the friction in the plan takes the force loop's gain where its feedback was not made for.
fn friction_doubt(plan: &Plan) -> Option<String> {
    let friction = plan.task.friction.coefficient;
    let (ratio, t_s) = plan.lever_ratio_max();
    let share = friction * ratio;
    (share > FRICTION_SHARE_MAX).then(|| {
        format!(
            "surface.friction = {} times |c2/s2| = {} (how steeply link 2 stands on the surface, at t = {t_s:.4} s) is {}: dragged against its slope the tip bites, and the force loop has {} times its gain; up to {FRICTION_SHARE_MAX} is of no concern, a friction up to {}, or a path on which link 2 lies flatter",
            Shortest(friction),
            four_digits(ratio),
            four_digits(share),
            four_digits(1.0 / (1.0 - share)),
            four_digits(FRICTION_SHARE_MAX / ratio),
        )
    })
}

/// A task planned and encoded, with how long that took.
pub(super) struct Planned {
    pub(super) plan: Plan,
    pub(super) table: EncodedTable,
    plan_ms: f64,
    table_ms: f64,
    pub(super) limits: LimitParameters,
    limits_of: LimitsOf,
    /// What a reader should know before using it, which was said.
    doubts: Vec<String>,
}

/// Whose the limits of a plan's torques are.
#[derive(Clone, Copy)]
struct LimitsOf {
    /// The arm file's; else those that are derived from the plan.
    arm: bool,
    /// And no wider than those of the drives in a board's file.
    board: bool,
}

impl LimitsOf {
    /// Its name in `summary.json`.
    fn name(self) -> &'static str {
        match (self.arm, self.board) {
            (true, false) => "arm",
            (true, true) => "arm_and_board",
            (false, false) => "plan",
            (false, true) => "plan_and_board",
        }
    }

    /// The same for a reader, and what to do where nothing is known.
    fn words(self) -> &'static str {
        match (self.arm, self.board) {
            (true, false) => "the arm file's",
            (true, true) => "the arm file's, no wider than what the board's drives give",
            (false, false) => {
                "three times the plan's peaks, as nothing is known of the drives: [limits] in the arm file, or --board FILE, says what they give"
            }
            (false, true) => {
                "three times the plan's peaks, no wider than what the board's drives give"
            }
        }
    }
}

/// The torque limits to run a plan with: the arm's, or without any wide ones of the plan's own; no
/// wider than the drives of a board whose file was `named`. An arm need not be the default board's.
///
/// # Errors
/// [`CliError::Limit`] and [`CliError::DriveLimit`] where the plan needs more torque than these
/// allow.
fn limits(
    arm: &ArmConfig,
    named: Option<(&Path, &BoardParameters)>,
    plan: &Plan,
) -> Result<LimitParameters, CliError> {
    if let Some(limits) = &arm.limits
        && let Some((joint, t_s)) = first_beyond(plan, limits.torque_nm)
    {
        return Err(CliError::Limit {
            joint: joint + 1,
            t_s,
            torque_nm: plan.peaks.torque[joint],
            limit_nm: limits.torque_nm[joint],
        });
    }
    let limits = arm.limits.unwrap_or_else(|| default_limits(plan));
    let Some((file, board)) = named else {
        return Ok(limits);
    };
    let drives_nm = board.drive_limit_nm();
    if let Some((joint, t_s)) = first_beyond(plan, drives_nm) {
        return Err(CliError::DriveLimit {
            file: file.to_path_buf(),
            joint: joint + 1,
            t_s,
            torque_nm: plan.peaks.torque[joint],
            full_scale_nm: board.drive_full_scale_nm[joint],
            limit_nm: drives_nm[joint],
        });
    }
    Ok(limits.at_most(drives_nm))
}

/// The first joint (0 or 1) whose planned torque exceeds its limit, N m, and when it is largest, s.
fn first_beyond(plan: &Plan, limit_nm: [f64; 2]) -> Option<(usize, f64)> {
    let joint = (0..2).find(|i| plan.peaks.torque[*i] > limit_nm[*i])?;
    let size = |point: &&PlanPoint| point.torque[joint].abs();
    let points = plan.points.iter();
    let peak = points.max_by(|a, b| size(a).total_cmp(&size(b)));
    Some((joint, peak.map_or(0.0, |point| point.t)))
}

impl Common {
    pub(super) fn plan(&self, arm: &ArmConfig, task: &Task) -> Result<Planned, CliError> {
        let board = self.board()?;
        let options = PlanOptions {
            elements: arm.elements,
            tick_rate_hz: self.tick_rate_hz.unwrap_or(board.parameters.tick_rate_hz),
            equations: match self.model {
                ModelArg::Exact => Equations::Exact,
                ModelArg::AsPrinted => Equations::AsPrinted,
            },
            link: LinkKind {
                // What the paper prints is for small deflections.
                model: match self.model {
                    ModelArg::Exact => arm.link.model,
                    ModelArg::AsPrinted => LinkModel::Linear,
                },
                ..arm.link
            },
            ..PlanOptions::default()
        };
        let milliseconds = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
        let since = Instant::now();
        let plan = planning::plan(&arm.arm, task, &options)?;
        let plan_ms = milliseconds(since);
        let named = self.board.as_deref().map(|file| (file, &board.parameters));
        let limits = limits(arm, named, &plan)?;
        let limits_of = LimitsOf {
            arm: arm.limits.is_some(),
            board: named.is_some(),
        };
        let since = Instant::now();
        let table = table_fit::fit_table(&plan)?;
        let doubts = doubts(&plan, &limits);
        for word in &doubts {
            say(format_args!("warning: {word}"));
        }
        Ok(Planned {
            plan,
            table,
            plan_ms,
            table_ms: milliseconds(since),
            limits,
            limits_of,
            doubts,
        })
    }
}

impl Planned {
    /// The plan's figures as flat JSON.
    pub(super) fn json(&self) -> Map<String, Value> {
        let (intervals, iterations) = self.plan.effort();
        let peaks = &self.plan.peaks;
        let seconds = |ticks: u32| f64::from(ticks) / f64::from(self.plan.tick_rate_hz);
        export::object([
            ("table_bytes", json!(self.table.image.len())),
            (
                "table_torque_error_max_Nm",
                json!(self.table.torque_error_max_nm),
            ),
            (
                "table_torque_error_share",
                json!(self.table.torque_error_share),
            ),
            (
                "table_angle_error_max_rad",
                json!(self.table.angle_error_max_rad),
            ),
            ("error_estimate", json!(self.plan.error_estimate())),
            ("mesh_intervals", json!(intervals)),
            ("newton_iterations", json!(iterations)),
            ("tick_rate_Hz", json!(self.plan.tick_rate_hz)),
            ("plan_ticks", json!(self.plan.ticks)),
            ("pre_actuation_s", json!(seconds(self.plan.pre_ticks))),
            ("elements", json!(self.plan.model.elements)),
            ("link_model", json!(self.plan.model.link.kind.model.name())),
            (
                "arm_fingerprint",
                json!(format!("{:#010x}", self.plan.model.arm.fingerprint())),
            ),
            (
                "table_task",
                json!(format!("{:#010x}", self.plan.task_fingerprint())),
            ),
            ("planned_torque1_max_Nm", json!(peaks.torque[0])),
            ("planned_torque2_max_Nm", json!(peaks.torque[1])),
            ("planned_power1_max_W", json!(peaks.power[0])),
            ("planned_power2_max_W", json!(peaks.power[1])),
            ("torque_limit1_Nm", json!(self.limits.torque_nm[0])),
            ("torque_limit2_Nm", json!(self.limits.torque_nm[1])),
            ("torque_limits_of", json!(self.limits_of.name())),
            (
                "initial_slope_rate_rad_s",
                json!(self.plan.points[0].root_slope_rate),
            ),
        ])
    }

    /// How long planning took, for `--json`.
    pub(super) fn timing(&self) -> Map<String, Value> {
        export::object([
            ("plan_ms", json!(self.plan_ms)),
            ("table_ms", json!(self.table_ms)),
        ])
    }

    /// The same for a reader.
    pub(super) fn took(&self) -> (String, String) {
        let words = format!(
            "{:.1} ms, the table in {:.1} ms",
            self.plan_ms, self.table_ms
        );
        ("planned in".into(), words)
    }

    /// Whether drives that are known give the plan's torques, in a sentence.
    fn verdict(&self) -> (bool, String) {
        let [first, second] = self.plan.peaks.torque.map(four_digits);
        let [most1, most2] = self.limits.torque_nm.map(four_digits);
        let known = self.limits_of.arm || self.limits_of.board;
        let text = match known {
            true => format!(
                "Planned: torques up to {first} and {second} N m, within the {most1} and {most2} N m that the drives give."
            ),
            false => format!(
                "Planned: torques up to {first} and {second} N m. Nothing is known of the drives: [limits] in the arm file, or --board FILE, says what they give."
            ),
        };
        (self.doubts.is_empty(), text)
    }

    /// The plan's figures as facts for a reader.
    pub(super) fn facts(&self) -> Vec<(String, String)> {
        let plan = &self.plan;
        let peaks = &plan.peaks;
        let end = plan.points[plan.points.len() - 1].t;
        let (intervals, iterations) = plan.effort();
        [
            (
                "motion",
                format!(
                    "{:.4} to {end:.4} s, {} ticks at {} Hz",
                    plan.points[0].t, plan.ticks, plan.tick_rate_hz
                ),
            ),
            (
                "solved with",
                format!("{intervals} intervals, {iterations} Newton steps"),
            ),
            (
                "deflection error estimate",
                format!("{:.1e} rad, of the length", plan.error_estimate()),
            ),
            (
                "planned torque",
                format!(
                    "up to {} and {} N m",
                    four_digits(peaks.torque[0]),
                    four_digits(peaks.torque[1])
                ),
            ),
            (
                "torque limits",
                format!(
                    "{} and {} N m, {}",
                    four_digits(self.limits.torque_nm[0]),
                    four_digits(self.limits.torque_nm[1]),
                    self.limits_of.words()
                ),
            ),
            (
                "planned power",
                format!(
                    "up to {} and {} W",
                    four_digits(peaks.power[0]),
                    four_digits(peaks.power[1])
                ),
            ),
            (
                "slope rate at the start",
                format!("{:.2e} rad/s", plan.points[0].root_slope_rate),
            ),
            (
                "feedforward table",
                format!(
                    "task {:#010x}, {} bytes, torque to {:.1e} N m, {:.1e} of its peak",
                    plan.task_fingerprint(),
                    self.table.image.len(),
                    self.table.torque_error_max_nm,
                    self.table.torque_error_share
                ),
            ),
        ]
        .map(|(name, fact)| (name.to_string(), fact))
        .to_vec()
    }
}

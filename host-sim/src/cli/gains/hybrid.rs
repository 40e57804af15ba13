//! Gains of the hybrid law: found for the arm at hand, proved over a spread of arms, improved on the
//! bench.

use super::PlantArgs;
use crate::analysis::hybrid::proof::Subject;
use crate::analysis::hybrid::sets::digits;
use crate::analysis::hybrid::{Effort, HybridError, LoopPose, LoopSpread, Proof, poses};
use crate::campaign::distribution::Distribution;
use crate::campaign::engine::Campaign;
use crate::campaign::scenario::Scenario;
use crate::cli::bench::Bench;
use crate::cli::own_gains::{DESIGN_POSES, designed, law_json, origin, to_be_held, verdict};
use crate::cli::provenance::{Provenance, with_timing};
use crate::cli::{CliError, Output, print, print_facts, progress_bar};
use crate::files::{config, export};
use flexor::control::{HybridParameters, LawParameters};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// A plan, arms and gains to examine.
struct Setting {
    bench: Bench,
    spread: LoopSpread,
    /// What the commands take, if it is of this law: a scenario may name the paper's.
    law: Option<HybridParameters>,
}

impl PlantArgs {
    /// What the hybrid law's commands examine.
    fn hybrid_setting(&self) -> Result<Setting, CliError> {
        for (given, what) in [(&self.plant, "--plant"), (&self.spread, "--spread")] {
            if given.is_some() {
                return Err(CliError::NoEffect {
                    what,
                    beside: "with the hybrid law, whose arms --scenario and --root-inertia-kgm2 tell",
                });
            }
        }
        let (file, default) = (self.controller.as_deref(), config::DEFAULT_CONTROLLER);
        let bench = self.scenario.prepare(&self.common, file, default)?;
        let mut spread = to_be_held(&bench.config.scenario, &bench.planned.plan);
        if let [low, high] = self.root_inertia_kgm2[..] {
            if !(low >= 0.0 && high >= low && high <= 1e3) {
                return Err(CliError::RootInertia { low, high });
            }
            spread.root_inertia_kgm2 = [low, high];
        }
        let law = match &bench.law {
            LawParameters::Hybrid(law) => Some(*law),
            LawParameters::Paper(_) => None,
        };
        Ok(Setting { bench, spread, law })
    }
}

/// `flexor gains`: are the gains of the hybrid law stable on every arm, and with what margin.
pub(super) fn examine(args: &PlantArgs, out: &Path) -> Result<(), CliError> {
    let output = Output::open(out, args.hybrid_inputs())?;
    let setting = args.hybrid_setting()?;
    let law = setting.law.ok_or(CliError::NoEffect {
        what: "--scenario",
        beside: "with the paper's law, which its controller has: --controller names gains of the hybrid law",
    })?;
    let since = Instant::now();
    let proof = setting.prove(&law, args.points as usize, true)?;
    let wall_ms = since.elapsed().as_secs_f64() * 1e3;
    let told = Told {
        keys: Map::new(),
        facts: vec![],
        timing: ("wall_ms", wall_ms),
        took: ("examined in".into(), format!("{wall_ms:.0} ms")),
        json: args.common.json,
    };
    setting.report(output, &law, &proof, told)
}

/// `flexor gains design`: gains for the arm at hand.
pub(super) fn design_command(args: &PlantArgs, out: &Path) -> Result<(), CliError> {
    let output = Output::open(out, args.hybrid_inputs())?;
    let setting = args.hybrid_setting()?;
    let since = Instant::now();
    let found = designed(&setting.bench.planned.plan, setting.spread, Effort::Design)?;
    let design_ms = since.elapsed().as_secs_f64() * 1e3;
    let proof = setting.prove(&found.law, args.points as usize, true)?;
    let keys = export::object([
        ("laws_tried", json!(found.tried)),
        ("predicted_force_rms_N", json!(found.force_rms_n)),
    ]);
    let facts = vec![
        (
            "predicted force".into(),
            format!("{:.4} N rms over the spread's ends", found.force_rms_n),
        ),
        ("tried".into(), format!("{} sets", found.tried)),
    ];
    setting.write_law(&output, &found.law)?;
    let told = Told {
        keys,
        facts,
        timing: ("design_ms", design_ms),
        took: ("found in".into(), format!("{design_ms:.0} ms")),
        json: args.common.json,
    };
    setting.report(output, &found.law, &proof, told)
}

/// `flexor gains tune`: as design, with a longer search, and the best of what was found improved on
/// the bench.
pub(super) fn tune_command(args: &PlantArgs, seed: u64, out: &Path) -> Result<(), CliError> {
    let output = Output::open(out, args.hybrid_inputs())?;
    let mut setting = args.hybrid_setting()?;
    if args.scenario.scenario.is_none() && args.scenario.set.is_empty() {
        setting.bench.config.scenario = own_scenario(setting.spread.root_inertia_kgm2)?;
    }
    let since = Instant::now();
    let plan = &setting.bench.planned.plan;
    let progress = progress_bar(BENCH_TRIALS, "sets tried on the bench, {eta} left");
    let mut candidates = vec![];
    if args.controller.is_some() {
        candidates.extend(setting.law);
    }
    for effort in [Effort::Design, Effort::Tune] {
        match designed(plan, setting.spread, effort) {
            Ok(found) => candidates.push(found.law),
            Err(HybridError::NotDesigned { .. }) if effort == Effort::Tune => {}
            Err(error) => return Err(error.into()),
        }
    }
    let tuner = BenchTuner {
        setting: &setting,
        seed,
    };
    let (law, score, tried) = tuner.tune(&candidates, &|| progress.inc(1))?;
    progress.finish_and_clear();
    let wall_ms = since.elapsed().as_secs_f64() * 1e3;
    let proof = setting.prove(&law, args.points as usize, true)?;
    let keys = export::object([
        ("seed", json!(seed)),
        ("bench_runs_a_set", json!(BENCH_RUNS)),
        ("bench_failed", json!(score.failed)),
        (
            "bench_force_rms_N",
            json!({"median": score.median, "p95": score.p95}),
        ),
    ]);
    let facts = vec![
        (
            "on the bench".into(),
            format!(
                "{} of {BENCH_RUNS} arms fail; force error {:.3} N rms in the median, {:.3} N in 95 of 100",
                score.failed, score.median, score.p95
            ),
        ),
        (
            "tried".into(),
            format!("{tried} sets on the bench, seed {seed}"),
        ),
    ];
    setting.write_law(&output, &law)?;
    let told = Told {
        keys,
        facts,
        timing: ("wall_ms", wall_ms),
        took: ("tuned in".into(), format!("{:.1} s", wall_ms / 1e3)),
        json: args.common.json,
    };
    setting.report(output, &law, &proof, told)
}

/// What a command has to tell besides gains and proof.
struct Told {
    keys: Map<String, Value>,
    facts: Vec<(String, String)>,
    /// How long it took: a key and ms.
    timing: (&'static str, f64),
    /// The same for a reader.
    took: (String, String),
    /// Whether JSON is printed.
    json: bool,
}

/// The bench's own noise and spread, without the files that its scenario names, with this range of
/// root inertias, kg m^2.
fn own_scenario(root: [f64; 2]) -> Result<Scenario, CliError> {
    let mut own = config::parse_scenario("bench.toml", BENCH_SCENARIO)?.scenario;
    for (key, distribution) in &mut own.numbers {
        if key.name == "plant.root_inertia_kgm2" {
            *distribution = match root {
                [low, high] if low > 0.0 && high > low => Distribution::LogUniform(root),
                [low, high] if high > low => Distribution::Uniform([low, high]),
                [low, _] => Distribution::Fixed(low),
            };
        }
    }
    Ok(own)
}

/// The spread that gains are tuned on where no scenario is named.
const BENCH_SCENARIO: &str = include_str!("../../../../examples/scenarios/bench.toml");

/// Arms that a set of gains is tried on: the same for every set.
const BENCH_RUNS: u64 = 40;
/// Sets that are tried, about.
const BENCH_TRIALS: u64 = 40;

/// What a set of gains does on the bench: arms that fail, force error's rms, N.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Score {
    failed: usize,
    median: f64,
    p95: f64,
}

impl Score {
    /// Less is better: failures first.
    fn value(&self) -> f64 {
        10.0 * self.failed as f64 + self.median + self.p95
    }
}

struct BenchTuner<'a> {
    setting: &'a Setting,
    seed: u64,
}

impl BenchTuner<'_> {
    /// What `law` does on the bench.
    fn score(&self, law: &HybridParameters) -> Result<Score, CliError> {
        let bench = &self.setting.bench;
        let law = LawParameters::Hybrid(*law);
        let mut task = bench.task();
        task.law = &law;
        let campaign = Campaign {
            task,
            scenario: &bench.config.scenario,
            seed: self.seed,
        };
        let figures = Mutex::new(vec![]);
        let numbers: Vec<u64> = (0..BENCH_RUNS).collect();
        campaign.run_all(&numbers, &AtomicBool::new(false), false, |record, _| {
            let mut all = figures.lock().unwrap_or_else(PoisonError::into_inner);
            let figures = &record.figures;
            all.push((figures.outcome.failed(), figures.force_error_rms_n));
        })?;
        let figures = figures.into_inner().unwrap_or_else(PoisonError::into_inner);
        let failed = figures.iter().filter(|(failed, _)| *failed).count();
        let mut force: Vec<f64> = figures.iter().filter(|f| !f.0).map(|f| f.1).collect();
        force.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = (share * force.len() as f64) as usize;
            force.get(place.min(force.len().saturating_sub(1))).copied()
        };
        Ok(Score {
            failed,
            median: at(0.5).unwrap_or(f64::INFINITY),
            p95: at(0.95).unwrap_or(f64::INFINITY),
        })
    }

    /// The best of `candidates`, then better ones about it, as long as they are proved.
    fn tune(
        &self,
        candidates: &[HybridParameters],
        progress: &dyn Fn(),
    ) -> Result<(HybridParameters, Score, u64), CliError> {
        let mut tried = 0;
        let mut best: Option<(HybridParameters, Score)> = None;
        for law in candidates {
            if !self.setting.prove(law, DESIGN_POSES, false)?.is_stable() {
                continue;
            }
            let score = self.score(law)?;
            progress();
            tried += 1;
            if best.as_ref().is_none_or(|(_, b)| score.value() < b.value()) {
                best = Some((*law, score));
            }
        }
        let Some((mut law, mut score)) = best else {
            return Err(CliError::Unproven {
                why: "no gains were found".into(),
            });
        };
        for step in [1.25, 1.12] {
            for change in CHANGES {
                for factor in [step, 1.0 / step] {
                    let other = change(&law, factor);
                    progress();
                    if !self.setting.prove(&other, DESIGN_POSES, false)?.is_stable() {
                        continue;
                    }
                    let found = self.score(&other)?;
                    tried += 1;
                    if found.value() < score.value() {
                        (law, score) = (other, found);
                        break;
                    }
                }
            }
        }
        Ok((law, score, tried))
    }
}

/// What is changed on the bench, each by a factor: K_IF, B2, k2 with what the section takes of it,
/// K_T, the section's frequency and the force's share in it, joint 1's integral.
const CHANGES: [fn(&HybridParameters, f64) -> HybridParameters; 7] = [
    |p, f| HybridParameters {
        force_integral_per_s: digits(p.force_integral_per_s * f),
        ..*p
    },
    |p, f| {
        let [b1, b2] = p.joint_damping_nms_rad;
        HybridParameters {
            joint_damping_nms_rad: [b1, digits(b2 * f)],
            ..*p
        }
    },
    |p, f| {
        let [k1, k2] = p.joint_stiffness_nm_rad;
        HybridParameters {
            joint_stiffness_nm_rad: [k1, digits(k2 * f)],
            section_angle_nm_rad: p.section_angle_nm_rad.map(|g| digits(g * f)),
            ..*p
        }
    },
    |p, f| HybridParameters {
        torque_loop_per_s: digits(p.torque_loop_per_s * f),
        ..*p
    },
    |p, f| HybridParameters {
        section_frequency_rad_s: digits(p.section_frequency_rad_s * f),
        ..*p
    },
    |p, f| HybridParameters {
        section_force: p.section_force.map(|h| digits(h * f)),
        ..*p
    },
    |p, f| HybridParameters {
        joint1_integral_nm_rads: digits(p.joint1_integral_nm_rads * f),
        ..*p
    },
];

impl PlantArgs {
    fn hybrid_inputs(&self) -> impl Iterator<Item = Option<&Path>> {
        self.inputs().chain([self.scenario.scenario.as_deref()])
    }
}

impl Setting {
    /// The proof of `law` at so many points of the path, with margins if they are asked for.
    fn prove(
        &self,
        law: &HybridParameters,
        points: usize,
        margins: bool,
    ) -> Result<Proof, CliError> {
        let plan = &self.bench.planned.plan;
        let poses: Vec<LoopPose> = poses(plan, points);
        let subject = Subject {
            arm: &plan.model.arm,
            law,
            poses: &poses,
            tick_rate_hz: plan.tick_rate_hz,
        };
        Ok(Proof::new(&subject, &self.spread, margins)?)
    }

    fn write_law(&self, output: &Output, law: &HybridParameters) -> Result<(), CliError> {
        let how = origin(&self.spread, self.bench.planned.plan.tick_rate_hz);
        let file = config::controller_toml(&(*law).into(), &how);
        output.write("controller.toml", |w| w.write_all(file.as_bytes()))
    }

    /// Writes and prints what was found.
    fn report(
        &self,
        output: Output,
        law: &HybridParameters,
        proof: &Proof,
        told: Told,
    ) -> Result<(), CliError> {
        let mut summary = proof_json(proof, &self.spread);
        summary.insert("gains".into(), law_json(law));
        summary.extend(told.keys);
        let made = Provenance::of_inputs(&self.bench.inputs).gains(&(*law).into());
        let summary = made.summary(summary);
        output.write("proof.csv", |w| proof_csv(proof, w))?;
        output.json("summary.json", &summary)?;
        let place = output.folder().display().to_string();
        output.commit()?;
        // Also of gains that were just found: they were found at fewer poses.
        let refused =
            verdict(proof, &self.spread).map_or(Ok(()), |why| Err(CliError::Unproven { why }));
        if told.json {
            let mut timing = self.bench.planned.timing();
            timing.insert(told.timing.0.into(), json!(told.timing.1));
            print(with_timing(&summary, timing))?;
            return refused;
        }
        let mut all = law_facts(law);
        all.extend(proof_facts(proof, &self.spread));
        all.extend(told.facts);
        all.push(told.took);
        print_facts(&all)?;
        print(format_args!("\nproof.csv and summary.json are in {place}"))?;
        refused
    }
}

fn law_facts(p: &HybridParameters) -> Vec<(String, String)> {
    let [k1, k2] = p.joint_stiffness_nm_rad;
    let [b1, b2] = p.joint_damping_nms_rad;
    let [fc1, fc2] = p.rate_filter_hz;
    [
        (
            "joint 1",
            format!(
                "K1 {k1} N m/rad, B1 {b1} N m s/rad behind {fc1} Hz, Ki1 {} N m/(rad s)",
                p.joint1_integral_nm_rads
            ),
        ),
        (
            "joint 2",
            format!(
                "k2 {k2} N m/rad, B2 {b2} N m s/rad behind {fc2} Hz, K_IF {} 1/s, K_T {} 1/s",
                p.force_integral_per_s, p.torque_loop_per_s
            ),
        ),
        (
            "section",
            format!(
                "{} rad/s, damping {}, g {:?} N m/rad, h {:?}",
                p.section_frequency_rad_s,
                p.section_damping,
                p.section_angle_nm_rad,
                p.section_force
            ),
        ),
    ]
    .map(|(name, fact)| (name.to_string(), fact))
    .to_vec()
}

fn proof_json(proof: &Proof, spread: &LoopSpread) -> Map<String, Value> {
    let (up, down, ticks) = proof.margins();
    let worst = proof.worst();
    export::object([
        ("stable", json!(proof.is_stable())),
        ("plants", json!(proof.all().count())),
        (
            "unstable_plants",
            json!(proof.all().filter(|p| !p.is_stable()).count()),
        ),
        ("worst_plant", json!(worst.map(|p| p.name.clone()))),
        (
            "worst_pole_per_s",
            json!(worst.map(|p| [p.slowest.re, p.slowest.im])),
        ),
        ("worst_t_s", json!(worst.map(|p| p.t_s))),
        ("gain_up", json!(up)),
        ("gain_down", json!(down)),
        ("delay_margin_ticks", json!(ticks)),
        ("root_inertia_kgm2", json!(spread.root_inertia_kgm2)),
        ("stable_root_inertia_kgm2", json!(proof.root_inertia_kgm2)),
        ("mass_scale", json!(spread.mass_scale)),
        (
            "bending_stiffness_scale",
            json!(spread.bending_stiffness_scale),
        ),
        ("friction", json!(spread.friction)),
        ("drive_bandwidth_Hz", json!(spread.drive_bandwidth_hz)),
        ("delay_ticks", json!(spread.delay_ticks)),
    ])
}

fn proof_facts(proof: &Proof, spread: &LoopSpread) -> Vec<(String, String)> {
    let (up, down, ticks) = proof.margins();
    let [low, high] = spread.root_inertia_kgm2;
    let count = proof.all().count();
    let unstable = proof.all().filter(|p| !p.is_stable()).count();
    let mut facts = vec![
        (
            "arms".to_string(),
            format!(
                "{count} at the spread's ends: root {low:.2e} to {high:.2e} kg m^2, masses times {:?}, stiffness times {:?}, friction {}, contact {:?} N/m, drives {} Hz and {} ticks",
                spread.mass_scale,
                spread.bending_stiffness_scale,
                spread.friction,
                spread.contact_stiffness_n_m,
                spread.drive_bandwidth_hz,
                spread.delay_ticks
            ),
        ),
        (
            "the loop".to_string(),
            match unstable {
                0 => "stable on all of them".to_string(),
                some => format!("UNSTABLE on {some} of them"),
            },
        ),
        (
            "margins".to_string(),
            format!("joint 2's torque x {down} to x {up}, {ticks} ticks of delay more"),
        ),
    ];
    if let Some(worst) = proof.worst() {
        let hertz = worst.slowest.im.abs() / core::f64::consts::TAU;
        facts.push((
            "slowest".to_string(),
            format!(
                "{:+.3} 1/s ({hertz:.1} Hz) at t = {:.3} s: {}",
                worst.slowest.re, worst.t_s, worst.name
            ),
        ));
    }
    if let Some([from, to]) = proof.root_inertia_kgm2 {
        facts.push((
            "root inertia".to_string(),
            format!("stable from {from:.3e} to {to:.3e} kg m^2"),
        ));
    }
    facts
}

/// A row an arm.
fn proof_csv(proof: &Proof, to: &mut dyn Write) -> std::io::Result<()> {
    let mut csv = csv::Writer::from_writer(to);
    csv.write_record([
        "plant",
        "pole_re_per_s",
        "pole_im_per_s",
        "t_s",
        "gain_up",
        "gain_down",
        "delay_ticks",
    ])?;
    for p in proof.all() {
        let numbers = [p.slowest.re, p.slowest.im, p.t_s, p.gain_up, p.gain_down];
        let mut row = vec![p.name.clone()];
        row.extend(numbers.iter().map(ToString::to_string));
        row.push(p.ticks.to_string());
        csv.write_record(row)?;
    }
    csv.flush()
}

//! What the board makes of every fault that the bench can put into a run, and of arms without any.

use flexor::fault::{Fault, Reaction};
use flexor_sim::plant::bench::F64x4;
use flexor_sim::plant::bench::lanes::Lanes;
use flexor_sim::simulation::bench::{
    self, ArmKind, BenchArm, BenchRow, FAULT_NAMES, FaultName, RunFigures, TimedFault,
};
use flexor_sim::simulation::closed_loop::Outcome;
use flexor_tests::{OnBench, example};
use std::collections::{BTreeMap, BTreeSet};

/// What the board makes of a fault.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Made {
    /// It finds it, as one of these, within so many ms.
    Found(&'static [Fault], f64),
    /// It lets it pass: the force is off by no more than so many N, and the tip stays on its path.
    Borne(f64),
}
use Made::{Borne, Found};

impl Made {
    /// As docs/bench.md says it.
    fn words(self) -> String {
        match self {
            Found(faults, within_ms) => {
                let names: Vec<String> = faults
                    .iter()
                    .map(|fault| format!("{} ({})", fault.number(), fault.reaction()))
                    .collect();
                let time = if within_ms < 1.0 {
                    "at once".into()
                } else {
                    format!("within {within_ms} ms")
                };
                format!("fault {}, {time}", names.join(" or "))
            }
            Borne(force_n) => format!("let pass; force error up to {force_n} N"),
        }
    }
}

use Fault::{
    Drive, EmergencyStop, EncoderFrozen, EncoderStep, ForceBalance, ForceBand, JointSpeed,
    LinkTimeout, PathDeviation, RootMoment, SensorFrozen, SensorRange, SensorsStale, TickOverrun,
    TicksLost,
};

/// Every fault, with a value, its numbers in the list of faults, and what the board makes of it at mid
/// path of arms drawn from bench.toml.
const FAULTS: &[(&str, f64, &str, Made)] = &[
    ("encoder1_stuck", 0.0, "1", Found(&[EncoderFrozen], 20.0)),
    ("encoder2_stuck", 0.0, "1", Found(&[EncoderFrozen], 100.0)),
    (
        "encoder1_track_cut",
        0.0,
        "2",
        Found(&[EncoderFrozen], 20.0),
    ),
    (
        "encoder2_track_cut",
        0.0,
        "2",
        Found(&[EncoderFrozen], 100.0),
    ),
    ("encoder1_reversed", 0.0, "4", Found(&[PathDeviation], 20.0)),
    ("encoder2_reversed", 0.0, "4", Found(&[JointSpeed], 30.0)),
    ("encoder1_jump", 500.0, "5, 6", Found(&[EncoderStep], 0.0)),
    ("encoder2_jump", 500.0, "5, 6", Found(&[EncoderStep], 0.0)),
    ("encoder1_noise", 50.0, "7", Found(&[EncoderStep], 1.0)),
    ("encoder2_noise", 50.0, "7", Found(&[EncoderStep], 1.0)),
    ("strain_rail", 0.0, "8", Found(&[SensorRange], 0.0)),
    ("strain_stuck", 0.0, "9", Found(&[SensorFrozen], 250.0)),
    (
        "strain_mid_rail",
        0.0,
        "10",
        Found(&[SensorFrozen, ForceBalance], 250.0),
    ),
    ("strain_reversed", 0.0, "12", Found(&[RootMoment], 100.0)),
    ("strain_offset", 30.0, "11", Borne(1.5)),
    ("strain_drift", 100.0, "13", Borne(1.5)),
    ("strain_noise", 20.0, "14", Borne(1.5)),
    ("force_rail", 0.0, "15", Found(&[SensorRange], 0.0)),
    ("force_stuck", 0.0, "16", Found(&[SensorFrozen], 250.0)),
    (
        "force_mid_rail",
        0.0,
        "17",
        Found(&[ForceBalance, SensorFrozen], 150.0),
    ),
    ("force_reversed", 0.0, "20", Found(&[ForceBalance], 80.0)),
    ("force_offset", 200.0, "19", Found(&[ForceBalance], 150.0)),
    (
        "force_shows",
        -2028.0,
        "18",
        Found(&[ForceBand, ForceBalance], 10.0),
    ),
    ("force_noise", 205.0, "21", Borne(1.5)),
    ("conversion_missing", 0.0, "23", Found(&[SensorsStale], 0.2)),
    ("drive1_dead", 0.0, "37, 46", Found(&[PathDeviation], 200.0)),
    (
        "drive2_dead",
        0.0,
        "37, 46",
        Found(&[RootMoment, JointSpeed], 500.0),
    ),
    ("drive1_weak", 0.8, "38", Borne(1.5)),
    ("drive2_weak", 0.8, "38", Borne(1.5)),
    ("drive1_frozen", 0.0, "39", Found(&[PathDeviation], 600.0)),
    ("drive2_frozen", 0.0, "39", Found(&[RootMoment], 1300.0)),
    (
        "drive1_reversed",
        0.0,
        "40",
        Found(&[ForceBalance, JointSpeed, PathDeviation], 80.0),
    ),
    (
        "drive2_reversed",
        0.0,
        "40",
        Found(&[JointSpeed, RootMoment], 40.0),
    ),
    (
        "drive1_runaway",
        35.0,
        "28",
        Found(&[ForceBalance, JointSpeed, PathDeviation], 60.0),
    ),
    (
        "drive2_runaway",
        3.5,
        "28",
        Found(&[EncoderStep, RootMoment], 10.0),
    ),
    ("drive_fault", 0.0, "36", Found(&[Drive], 0.0)),
    ("emergency_stop", 0.0, "41", Found(&[EmergencyStop], 0.0)),
    // The second tick from there on does not take place, and shows in the one after it.
    ("ticks_lost", 0.0, "48", Found(&[TicksLost], 0.4)),
    // It shows in the next tick.
    ("tick_overrun", 0.0, "47", Found(&[TickOverrun], 0.2)),
    ("link_lost", 0.0, "70", Found(&[LinkTimeout], 100.0)),
];

/// From where on a fault is there, s: in the middle of the path.
const FAULT_AT_S: f64 = 1.0;

/// The first `count` arms of the campaign with this seed, in batches that advance side by side.
fn batches(bench: &OnBench, seed: u64, count: u64) -> Vec<Vec<BenchArm>> {
    let campaign = bench.campaign(seed);
    let mut kinds: BTreeMap<ArmKind, Vec<BenchArm>> = BTreeMap::new();
    for run in 0..count {
        let arm = campaign.draw(run).unwrap().arm;
        kinds.entry(arm.kind()).or_default().push(arm);
    }
    let chunks = |kind: Vec<BenchArm>| -> Vec<Vec<BenchArm>> {
        kind.chunks(F64x4::LANES)
            .map(<[BenchArm]>::to_vec)
            .collect()
    };
    kinds.into_values().flat_map(chunks).collect()
}

/// One arm's ticks from a fault on, as far as they are asked for here.
#[derive(Clone, Debug, Default)]
struct Seen {
    /// The fault that the board latched, and after how many ms.
    found: Option<(Fault, f64)>,
    /// Largest force error until then, N.
    force_n: f64,
    /// A torque was given after that, or one was wanted of the drives.
    driven: bool,
}

/// The arms of `batch` with a `fault` of this value from `at_s` on.
fn injected(
    bench: &OnBench,
    batch: &[BenchArm],
    (fault, value): (&FaultName, f64),
    at_s: f64,
) -> Vec<(Seen, RunFigures)> {
    let arms: Vec<BenchArm> = batch
        .iter()
        .map(|arm| {
            let mut arm = arm.clone();
            arm.faults = vec![TimedFault {
                kind: fault.kind(value),
                from_s: at_s,
                to_s: f64::INFINITY,
            }];
            arm
        })
        .collect();
    let mut seen = vec![Seen::default(); arms.len()];
    let figures = bench::run::<F64x4>(&bench.task(), &arms, |lane, row: &BenchRow, _| {
        let seen = &mut seen[lane];
        match (seen.found, row.fault) {
            (None, None) => seen.force_n = seen.force_n.max(row.force_error().abs()),
            (None, Some(fault)) => seen.found = Some((fault, 1e3 * (row.t - at_s))),
            _ => {}
        }
        seen.driven |= row.fault.is_some() && row.torque != [0.0; 2];
    });
    seen.into_iter().zip(figures.unwrap()).collect()
}

#[test]
fn the_board_makes_of_every_fault_what_is_said_of_it() {
    let listed: BTreeSet<&str> = FAULTS.iter().map(|(name, ..)| *name).collect();
    let known: BTreeSet<&str> = FAULT_NAMES.iter().map(|entry| entry.name).collect();
    assert_eq!(listed, known);
    let bench = OnBench::new(&example("scenarios/bench.toml"), &[]);
    let batches = batches(&bench, 7, 8);
    for (name, value, _, made) in FAULTS {
        let fault = FaultName::find(name).unwrap();
        for batch in &batches {
            for (seen, figures) in injected(&bench, batch, (fault, *value), FAULT_AT_S) {
                let told = format!("{name}: {made:?} is said, {seen:?} happens");
                match (*made, seen.found) {
                    (Found(faults, within_ms), Some((found, after_ms))) => {
                        assert!(faults.contains(&found), "{told}");
                        // Half a tick for the rounding of times.
                        assert!((-0.1..within_ms + 0.1).contains(&after_ms), "{told}");
                        let off = found.reaction() == Reaction::Off;
                        assert_eq!(seen.driven, !off, "{told}");
                    }
                    (Borne(force_n), None) => {
                        assert!(!figures.outcome.failed(), "{told}");
                        assert!(seen.force_n <= force_n, "{told}");
                    }
                    _ => panic!("{told}"),
                }
            }
        }
    }
}

/// The same list at four times the speed: what is found there is found, in less than half a second.
#[test]
fn on_a_fast_path_too_each_fault_is_found() {
    let bench = OnBench::new(&example("scenarios/bench_fast.toml"), &[]);
    let batches = batches(&bench, 7, 4);
    for (name, value, _, made) in FAULTS {
        let fault = FaultName::find(name).unwrap();
        // The planned force itself is not more than what the fast link's motion makes of the balance.
        let value = if *name == "force_offset" {
            500.0
        } else {
            *value
        };
        for batch in &batches {
            for (seen, _) in injected(&bench, batch, (fault, value), 0.2) {
                if let (Found(..), found) = (made, seen.found) {
                    let (_, after_ms) = found.unwrap_or_else(|| panic!("{name}: {seen:?}"));
                    assert!((-0.1..500.0).contains(&after_ms), "{name}: {seen:?}");
                }
            }
        }
    }
}

#[test]
fn no_monitor_alarms_on_arms_without_a_fault() {
    for scenario in [
        "bench",
        "bench_fast",
        "unknown_inertia",
        "calibrated",
        "calibrated_fast",
    ] {
        let file = example(&format!("scenarios/{scenario}.toml"));
        let bench = OnBench::new(&file, &[]);
        let runs: Vec<u64> = (0..48).collect();
        for run in bench.runs(3, &runs) {
            let outcome = run.figures.outcome;
            assert!(
                matches!(outcome, Outcome::Completed | Outcome::ContactLost),
                "{scenario}: {run:?}"
            );
        }
    }
}

#[test]
fn the_documents_table_of_faults_is_this_one() {
    let file = example("../docs/bench.md");
    let text = std::fs::read_to_string(file).unwrap();
    let rows = text
        .lines()
        .skip_while(|line| !line.starts_with("| fault | value in |"));
    let rows: Vec<Vec<&str>> = rows
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect();
    assert_eq!(rows.len(), FAULTS.len());
    for (row, (name, value, number, made)) in rows.iter().zip(FAULTS) {
        let [shown, unit, is, in_matrix, words] = row.as_slice() else {
            panic!("{row:?}");
        };
        assert_eq!(*shown, format!("`{name}`"));
        let unit_of = FaultName::find(name).unwrap().unit;
        let expected = unit_of.map_or(String::new(), |unit| format!("{unit}: {value}"));
        assert_eq!(*unit, expected, "{name}");
        assert!(!is.is_empty(), "{name}");
        assert_eq!(
            (*in_matrix, *words),
            (*number, made.words().as_str()),
            "{name}"
        );
    }
}

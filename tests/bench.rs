//! Today's law on the bench against an independent simulator, and what a campaign's runs depend on.
//!
//! `reference/bench_one_at_a_time.csv` is the output of another simulator: written in C for the
//! design of the control law, before this bench and without its sources, with a Runge-Kutta method
//! of its own, Dahl's friction where the bench has an elasto-plastic bristle, a surface whose holes
//! have upright walls, the law in f64, and no counts of the drives. One row is one change of the
//! nominal arm, run once; columns are the gauge that shows the slope, as the paper's law asks for,
//! and the one that shows the moment, as gauges do; the paper's path in 2 s and in 0.4 s. `ok` is a
//! run that pressed all the way, `loss` one that left the surface at some tick, `FAIL` one whose
//! tip was more than 50 mm off or whose force more than 20 N.

use flexor_sim::campaign::record::{RunFigures, RunRecord};
use flexor_sim::campaign::statistics::{Quantiles, quantile};
use flexor_sim::simulation::bench;
use flexor_tests::{OnBench, example, path};
use std::collections::BTreeMap;
use std::slice;

const TASKS: [(&str, &str); 2] = [("2s", "task_bench.toml"), ("0.4s", "task_fast.toml")];

/// The reference's rows as changes of the nominal scenario. Its rows of other encoders are
/// left out: today's law takes nothing but levers from them, and the rows are equal to the nominal
/// one's; so is the one without noise, which no scenario is.
const ROWS: &[(&str, &[&str])] = &[
    ("nominal", &[]),
    ("EI-15", &["plant.bending_stiffness_scale=0.85"]),
    ("EI+15", &["plant.bending_stiffness_scale=1.15"]),
    ("m1+10", &["plant.link1_mass_scale=1.1"]),
    ("m1-10", &["plant.link1_mass_scale=0.9"]),
    ("m2+10", &["plant.link2_mass_scale=1.1"]),
    ("m2-10", &["plant.link2_mass_scale=0.9"]),
    ("r1+2mm", &["plant.link1_length_offset_m=0.002"]),
    ("r2+2mm", &["plant.link2_length_offset_m=0.002"]),
    ("zeta x.3", &["plant.damping_scale=0.3"]),
    ("mu .15", &["contact.friction=0.15"]),
    ("mu .3", &["contact.friction=0.3"]),
    ("cf1 .05", &["joint1.coulomb_Nm=0.05"]),
    ("cf2 .05", &["joint2.coulomb_Nm=0.05"]),
    ("dh 2mm", &["surface.deeper_m=0.002"]),
    ("tilt 1", &["surface.tilt_rad=0.017453292519943295"]),
    ("tilt -1", &["surface.tilt_rad=-0.017453292519943295"]),
    ("sf .05", &["force_cell.noise_N=0.05"]),
    ("kc 2e3", &["contact.stiffness_N_m=2e3"]),
    ("kc 5e4", &["contact.stiffness_N_m=5e4"]),
    ("cog", &["joint1.cogging_Nm=0.1", "joint2.cogging_Nm=0.01"]),
    ("Jr 0", &["plant.root_inertia_kgm2=0"]),
    ("Jr 2e-5", &["plant.root_inertia_kgm2=2e-5"]),
    ("Jr 1e-4", &["plant.root_inertia_kgm2=1e-4"]),
    ("gauge gain 3%", &["root_gauge.gain_error=0.03"]),
    ("gauge off 5mrad", &["root_gauge.offset_rad=0.005"]),
    ("foff .05", &["force_cell.offset_N=0.05"]),
    ("geo", &["plant.geometric_stiffness=\"contact\""]),
    (
        "bump 1mm/50mm",
        &["surface.waviness_m=0.001", "surface.wavelength_m=0.05"],
    ),
    (
        "bump .5mm/20mm",
        &["surface.waviness_m=0.0005", "surface.wavelength_m=0.02"],
    ),
    ("delay 2", &["drive1.delay_ticks=2", "drive2.delay_ticks=2"]),
    (
        "bw 100",
        &["drive1.bandwidth_Hz=100", "drive2.bandwidth_Hz=100"],
    ),
    (
        "Jr 0, drive 2 kHz, no delay",
        &[
            "plant.root_inertia_kgm2=0",
            "drive1.bandwidth_Hz=2000",
            "drive2.bandwidth_Hz=2000",
            "drive1.delay_ticks=0",
            "drive2.delay_ticks=0",
        ],
    ),
    (
        "Jr 1e-4, drive 100 Hz",
        &[
            "plant.root_inertia_kgm2=1e-4",
            "drive1.bandwidth_Hz=100",
            "drive2.bandwidth_Hz=100",
        ],
    ),
    (
        "friction .3 + m1+10",
        &["contact.friction=0.3", "plant.link1_mass_scale=1.1"],
    ),
    (
        "hole 3mm/30mm",
        &["surface.features=[{hole={from_m=0.4,to_m=0.43,depth_m=0.003}}]"],
    ),
];

/// Rows whose force error is farther apart than [`FACTOR`]: gauge, task, row, factor.
const FARTHER: &[(&str, &str, &str, f64)] = &[
    // On the edge of stability: with no noise at all, counts alone keep up 0.1 N on the bench.
    ("slope", "2s", "EI-15", 3.5),
    // What is there of the reference's error is its plan's end, see `tips_agree`.
    ("slope", "0.4s", "Jr 1e-4", 3.0),
    // Either jumps on the surface.
    ("moment", "0.4s", "Jr 1e-4, drive 100 Hz", 2.5),
];

/// How far two force errors of the same row may be apart. Today's law is close to its limit of
/// stability, so that noise and counts are what most rows show: the reference itself gives 0.055
/// to 0.072 N, rms, for five seeds of the nominal arm, and the bench has the drives' counts besides.
const FACTOR: f64 = 1.6;

/// Force error, rms, N, that a bare root has at least, or fails.
const BARE_ROOT_RMS_N: f64 = 0.3;

/// What the reference says of a run.
#[derive(Debug)]
struct Reference {
    outcome: String,
    force_rms_n: f64,
    force_max_n: f64,
    tip_mm: f64,
}

/// The reference's rows by name.
fn reference() -> BTreeMap<String, BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(path("bench_one_at_a_time.csv")).unwrap();
    let rows = reader.deserialize().map(Result::unwrap);
    rows.map(|row: BTreeMap<String, String>| (row["scenario"].clone(), row))
        .collect()
}

/// Five runs of every row, and what the reference says: with the paper's law and a `gauge` that
/// shows the slope or the moment, or with the hybrid law (`"hybrid"`) and a gauge as it is.
fn compared(
    gauge: &str,
    (column, task): (&str, &str),
) -> Vec<(&'static str, Vec<RunFigures>, Reference)> {
    let reference = reference();
    let task = format!("task={:?}", example(task).display().to_string());
    let shown = if gauge == "slope" { "slope" } else { "moment" };
    let gauge_set = format!("root_gauge.measures={shown:?}");
    let all = ROWS.iter().map(|(name, sets)| {
        let sets = [*sets, &[&task, &gauge_set]].concat();
        let file = example("scenarios/nominal.toml");
        let bench = match gauge {
            "hybrid" => OnBench::new(&file, &sets).unmonitored(),
            _ => OnBench::paper(&file, &sets),
        };
        let runs = bench.runs(1, &[0, 1, 2, 3, 4]);
        let cell = |what: &str| reference[*name][&format!("{gauge}_{column}_{what}")].as_str();
        let number = |what: &str| cell(what).parse().unwrap();
        let row = Reference {
            outcome: cell("outcome").to_string(),
            force_rms_n: number("f_rms_N"),
            force_max_n: number("f_max_N"),
            tip_mm: number("x_max_mm"),
        };
        (*name, runs.iter().map(|run| run.figures).collect(), row)
    });
    all.collect()
}

/// What the reference allows the hybrid law, a quarter more at most.
#[test]
fn the_hybrid_law_holds_every_row_that_the_reference_holds() {
    for (column, task) in [("2s", "task_bench.toml"), ("0.4s", "task_fast.toml")] {
        for (name, runs, reference) in compared("hybrid", (column, task)) {
            let what = format!("{column} {name}");
            if reference.outcome == "FAIL" {
                continue;
            }
            assert!(
                runs.iter().all(|run| !run.outcome.failed()),
                "{what}: {runs:?}"
            );
            // Which loses contact is not held to a force: its bounces are chance.
            if reference.outcome != "ok" {
                continue;
            }
            let force_n = median(&runs, |run| run.force_error_rms_n);
            let tip_mm = 1e3 * median(&runs, |run| run.along_error_max_m);
            // Half a millimetre more than it: a torque count is 0.2 mm at the tip.
            let tip_limit_mm = (1.25 * reference.tip_mm).max(reference.tip_mm + 0.5);
            assert!(
                force_n <= 1.25 * reference.force_rms_n && tip_mm <= tip_limit_mm,
                "{what}: {force_n} N, {tip_mm} mm; {reference:?}"
            );
        }
    }
}

fn median(runs: &[RunFigures], figure: fn(&RunFigures) -> f64) -> f64 {
    Quantiles::new(runs.iter().map(figure).collect())
        .unwrap()
        .median
}

/// Asserts that two positive figures are no farther apart than a factor.
#[track_caller]
fn near(found: f64, wanted: f64, factor: f64, what: &str) {
    let ratio = found / wanted;
    assert!(
        (1.0 / factor..=factor).contains(&ratio),
        "{what}: {found} here, {wanted} in the reference"
    );
}

/// The tip's largest error of a run that presses all the way agrees.
#[track_caller]
fn tips_agree(found_mm: f64, wanted_mm: f64, fast: bool, what: &str) {
    let off = found_mm - wanted_mm;
    // Lengths, height, friction and masses decide it, and noise hardly. A torque count more or
    // less, which the reference has none of, is 0.2 mm at the tip.
    let (below, above) = if fast {
        // The reference was run on an older plan, whose motion after the path adds up to 6.2 mm
        // where nothing else does, and never takes away.
        (6.2, 1.5)
    } else {
        (0.5, 0.5)
    };
    let share = 0.01 * wanted_mm;
    assert!(
        (-below - share..=above + share).contains(&off),
        "{what}: {found_mm} mm here, {wanted_mm} mm in the reference"
    );
}

/// The cells of the rows of docs/bench.md below the head that begins with `head`.
fn documented(head: &str) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(example("../docs/bench.md")).unwrap();
    let rows = text.lines().skip_while(|line| !line.starts_with(head));
    let rows = rows.skip(2).take_while(|line| line.starts_with('|'));
    let cells = |row: &str| {
        let cells = row.trim_matches('|').split('|');
        cells.map(|cell| cell.trim().replace('*', "")).collect()
    };
    rows.map(cells).collect()
}

/// Asserts that `shown` is `value` with the decimals that are shown.
#[track_caller]
fn shown_is(shown: &str, value: f64, what: &str) {
    let decimals = shown.split_once('.').map_or(0, |(_, digits)| digits.len());
    assert_eq!(shown, format!("{value:.decimals$}"), "{what}");
}

#[test]
fn the_document_shows_these_figures() {
    let names = [
        "nominal",
        "m1+10",
        "m1-10",
        "mu .3",
        "friction .3 + m1+10",
        "bump 1mm/50mm",
        "kc 5e4",
        "delay 2",
    ];
    let rows = documented("| change of the nominal arm |");
    let all = compared("slope", TASKS[0]);
    for (row, name) in rows.iter().zip(names) {
        let (_, runs, other) = all.iter().find(|(n, ..)| *n == name).unwrap();
        let force = median(runs, |run| run.force_error_rms_n);
        let tip_mm = 1e3 * median(runs, |run| run.along_error_max_m);
        let values = [force, other.force_rms_n, tip_mm, other.tip_mm];
        for (shown, value) in row[1..].iter().zip(values) {
            shown_is(shown, value, name);
        }
    }
    // Those that fail have no figures.
    assert!(rows[names.len()..].iter().all(|row| row[1] == "fails"));
}

/// One gauge and task: the outcome's class, and the figures where there is a steady run.
fn rows_agree(gauge: &str, task: (&str, &str)) -> [usize; 3] {
    let mut seen = [0; 3];
    for (name, runs, row) in compared(gauge, task) {
        let what = format!("{gauge} {} {name}", task.0);
        let failed = runs.iter().filter(|run| run.outcome.failed()).count();
        let lost = runs.iter().filter(|run| run.contact_lost_s > 0.0).count();
        let rms = median(&runs, |run| run.force_error_rms_n);
        if name.starts_with("Jr 0") {
            // Without a hub the loop is unstable in either simulator, and nothing but chance says
            // how far it gets in the time that there is: only that neither holds the force.
            let restless = row.outcome == "FAIL" || row.force_rms_n > BARE_ROOT_RMS_N;
            assert!(restless, "{what}: {row:?}");
            assert!(failed >= 3 || rms > BARE_ROOT_RMS_N, "{what}: {rms} N");
            continue;
        }
        let (class, agrees) = match row.outcome.as_str() {
            "ok" => (0, failed == 0 && lost == 0),
            "loss" => (1, failed == 0 && lost == 5),
            "FAIL" => (2, failed >= 3),
            other => panic!("{what}: {other}"),
        };
        assert!(
            agrees,
            "{what}: {row:?}; here {failed} of 5 fail, {lost} lose contact"
        );
        seen[class] += 1;
        let off_path = row.outcome == "FAIL" && row.tip_mm > 50.0 && row.force_max_n < 2.0;
        if class == 2 && !off_path {
            // What a run does after it has become unstable, or fallen into a hole, says nothing.
            continue;
        }
        let listed = FARTHER
            .iter()
            .find(|(g, t, n, _)| (*g, *t, *n) == (gauge, task.0, name));
        let factor = listed.map_or(FACTOR, |(.., factor)| *factor);
        near(rms, row.force_rms_n, factor, &what);
        let largest = median(&runs, |run| run.force_error_max_n);
        // Listed rows differ by that in their largest error too, or by twice as much.
        let more = if listed.is_some() { 2.0 } else { 1.15 };
        near(largest, row.force_max_n, more * factor, &what);
        let tip_mm = 1e3 * median(&runs, |run| run.along_error_max_m);
        tips_agree(tip_mm, row.tip_mm, task.0 == "0.4s", &what);
    }
    seen
}

#[test]
fn with_the_slope_every_row_is_the_references() {
    assert_eq!(rows_agree("slope", TASKS[0]), [26, 3, 5]);
    assert_eq!(rows_agree("slope", TASKS[1]), [24, 5, 5]);
}

#[test]
fn with_the_moment_every_row_is_the_references() {
    // Nearly all fail: only a large hub holds.
    assert_eq!(rows_agree("moment", TASKS[0]), [1, 0, 33]);
    assert_eq!(rows_agree("moment", TASKS[1]), [1, 1, 32]);
}

/// What is published of 200 arms, the reference's own draws.
struct Published {
    /// Its row in docs/bench.md, if it has one.
    shown: Option<&'static str>,
    scenario: &'static str,
    sets: &'static [&'static str],
    /// How many failed.
    failed: u32,
    /// Of those that did not: median and 95th percentile of the force error's rms, N, and of the
    /// tip's largest error, mm; and the factors within which they are found again.
    figures: [(f64, f64); 4],
}

/// Tips: the 95th percentile is all but cut off by the 50 mm that count as failed.
const TIP: (f64, f64) = (1.25, 1.1);
const FAST_SLOPE: &str = "root_gauge.measures=\"slope\"";
const PUBLISHED: [Published; 4] = [
    Published {
        shown: Some("2 s, slope"),
        scenario: "bench_slope.toml",
        sets: &[],
        failed: 55,
        figures: [(0.213, 1.25), (0.427, 1.25), (25.6, TIP.0), (47.2, TIP.1)],
    },
    Published {
        shown: Some("2 s, moment"),
        scenario: "bench.toml",
        sets: &[],
        failed: 102,
        // Arms that jump and do not fail are few, with anything from 0.5 to 2.5 N: their 95th
        // percentile is chance.
        figures: [(0.253, 1.25), (2.14, 2.0), (25.9, TIP.0), (47.4, TIP.1)],
    },
    Published {
        shown: Some("0.4 s, slope"),
        scenario: "bench_fast.toml",
        sets: &[FAST_SLOPE],
        failed: 15,
        figures: [(0.363, 1.25), (0.853, 1.3), (15.1, TIP.0), (44.9, TIP.1)],
    },
    Published {
        shown: Some("0.4 s, moment"),
        scenario: "bench_fast.toml",
        sets: &[],
        failed: 75,
        figures: [(0.759, 1.25), (1.82, 1.4), (16.5, TIP.0), (44.4, TIP.1)],
    },
];

#[test]
fn campaigns_fail_as_often_as_the_reference() {
    let numbers: Vec<u64> = (0..200).collect();
    let documented = documented("| path, gauge |");
    for published in PUBLISHED {
        let file = example("scenarios").join(published.scenario);
        let bench = OnBench::paper(&file, published.sets);
        let runs: Vec<RunRecord> = [1, 2]
            .into_iter()
            .flat_map(|seed| bench.runs(seed, &numbers))
            .collect();
        let all = || runs.iter().map(|run| run.figures);
        let good: Vec<RunFigures> = all().filter(|run| !run.outcome.failed()).collect();
        let (n, m) = (runs.len() as f64, 200.0);
        let rate = 1.0 - good.len() as f64 / n;
        let wanted = f64::from(published.failed) / m;
        let what = format!("{} {:?}", published.scenario, published.sets);
        // Two rates, both of samples: their difference against its standard deviation if they were
        // the same. A bench that fails 9 % more or less of its arms is found out.
        let pooled = (rate * n + wanted * m) / (n + m);
        let deviation = (pooled * (1.0 - pooled) * (1.0 / n + 1.0 / m)).sqrt();
        assert!(
            (rate - wanted).abs() < 1.96 * deviation,
            "{what}: {rate} fail here, {wanted} in the reference"
        );
        if let Some(words) = published.shown {
            let row = documented.iter().find(|row| row[0] == words).unwrap();
            shown_is(row[1].trim_end_matches(" %"), 100.0 * rate, words);
            shown_is(row[2].trim_end_matches(" %"), 100.0 * wanted, words);
        }
        let of = |figure: fn(&RunFigures) -> f64, q: f64| {
            let mut values: Vec<f64> = good.iter().map(figure).collect();
            values.sort_by(f64::total_cmp);
            quantile(&values, q).unwrap()
        };
        let force: fn(&RunFigures) -> f64 = |run| run.force_error_rms_n;
        let tip: fn(&RunFigures) -> f64 = |run| 1e3 * run.along_error_max_m;
        let found = [of(force, 0.5), of(force, 0.95), of(tip, 0.5), of(tip, 0.95)];
        for (found, (wanted, factor)) in found.into_iter().zip(published.figures) {
            near(found, wanted, factor, &what);
        }
    }
}

/// All the bits of a run.
fn bits(figures: &RunFigures) -> (String, Vec<u64>, u32) {
    let values = RunFigures::COLUMNS
        .iter()
        .map(|(_, value)| value(figures).to_bits());
    (
        figures.outcome.name().to_string(),
        values.collect(),
        figures.limited_ticks,
    )
}

#[test]
fn a_run_depends_on_its_number_and_on_nothing_beside_it() {
    // Everything on, play in a joint and dropouts included, so that arms of many kinds come
    // together in lanes, some of them alone.
    let sets = [
        "joint2.rotor_inertia_kgm2=2e-5",
        "joint2.play_rad={choice=[0.0,1e-3]}",
        "contact.friction_at_rest=0.4",
        "converter.dropout=2e-4",
        "drive1.noise_Nm=0.02",
        "plant.elements={choice=[3,4]}",
    ];
    let bench = OnBench::paper(&example("scenarios/bench_fast.toml"), &sets);
    let numbers: Vec<u64> = (40..61).collect();
    let together = bench.runs(7, &numbers);
    assert_eq!(together.len(), numbers.len());
    let kinds: std::collections::BTreeSet<_> = numbers
        .iter()
        .map(|run| bench.campaign(7).draw(*run).unwrap().arm.kind())
        .collect();
    assert!(kinds.len() >= 4, "{kinds:?}");

    // Alone, in the scalar's code, on this thread.
    for record in &together {
        let drawn = bench.campaign(7).draw(record.run).unwrap();
        let figures = bench::run::<f64>(&bench.task(), slice::from_ref(&drawn.arm), |_, _, _| ());
        assert_eq!(
            bits(&figures.unwrap()[0]),
            bits(&record.figures),
            "{}",
            record.run
        );
        assert_eq!((drawn.seed, &drawn.values), (record.seed, &record.drawn));
    }
    // In another order, and fewer of them: other neighbours.
    let mut others: Vec<u64> = numbers.iter().copied().step_by(2).collect();
    others.reverse();
    for record in bench.runs(7, &others) {
        let same = together
            .iter()
            .find(|other| other.run == record.run)
            .unwrap();
        assert_eq!(bits(&record.figures), bits(&same.figures), "{}", record.run);
    }
    // Another seed is another campaign.
    let first = &bench.runs(8, &numbers[..1])[0];
    assert_ne!(first.drawn, together[0].drawn);
    assert_ne!(bits(&first.figures), bits(&together[0].figures));
}

#[test]
fn a_spread_more_or_less_leaves_the_other_values_as_they_are() {
    let drawn = |sets: &[&str]| {
        let bench = OnBench::paper(&example("scenarios/bench.toml"), sets);
        let keys: Vec<&str> = bench.config.scenario.spread_keys().collect();
        let values = (0..20).map(|run| {
            let drawn = bench.campaign(3).draw(run).unwrap();
            let pairs = keys.iter().map(ToString::to_string).zip(drawn.values);
            pairs.collect::<BTreeMap<String, f64>>()
        });
        values.collect::<Vec<_>>()
    };
    let before = drawn(&[]);
    let more = drawn(&[
        "plant.tip_mass_kg={uniform=[0.0,0.01]}",
        "encoders.homing1_rad={normal=[0.0,0.001]}",
    ]);
    let less = drawn(&["contact.friction=0.1", "plant.damping_scale=1.0"]);
    for ((before, more), less) in before.iter().zip(&more).zip(&less) {
        assert_eq!((before.len(), more.len(), less.len()), (19, 21, 17));
        for (key, value) in before {
            assert_eq!(more[key], *value, "{key}");
            assert!(less.get(key).is_none_or(|other| other == value), "{key}");
        }
    }
    // Runs differ in every value, and so do values of the same spread.
    for key in before[0].keys() {
        assert_ne!(before[0][key], before[1][key], "{key}");
    }
    assert_ne!(
        before[0]["joint1.coulomb_Nm"],
        before[0]["joint2.coulomb_Nm"]
    );
}

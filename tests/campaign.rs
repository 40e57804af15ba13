//! Campaigns and runs on the bench as a user meets them: reproducible, resumable, in shards, and
//! clear about what is wrong.

mod campaign_laws;

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A folder of its own for a test, empty at its start.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn scenario(name: &str) -> String {
    let file = root().join("examples/scenarios").join(name);
    file.display().to_string()
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_flexor"));
    command.args(arguments);
    command
}

fn flexor(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// `flexor campaign` on the bench's scenario with `more` arguments, into `out`.
fn campaign(out: &Path, more: &[&str]) -> Output {
    let (bench, out) = (scenario("bench.toml"), out.display().to_string());
    let mut arguments = vec!["campaign", "--scenario", &bench, "--json", "--out", &out];
    arguments.extend(more);
    flexor(&arguments)
}

/// The gains of the paper's law, with which arms fail.
fn paper() -> String {
    root()
        .join("examples/controller_paper.toml")
        .display()
        .to_string()
}

/// Asserts that two campaigns have left the same results, byte for byte.
#[track_caller]
fn same_results(a: &Path, b: &Path) {
    for file in ["runs.csv", "runs.parquet", "summary.json", "campaign.json"] {
        let read = |folder: &Path| fs::read(folder.join(file)).unwrap();
        assert!(read(a) == read(b), "{file} differs");
    }
}

#[test]
fn a_campaign_prints_what_tools_rely_on_and_is_reproducible() {
    let (place, law) = (folder("campaign_json"), paper());
    let campaign = |out: &Path, more: &[&str]| {
        // Some arms shall fail.
        campaign(out, &[more, &["--controller", &law]].concat())
    };
    let (first, again) = (place.join("first"), place.join("again"));
    let result = json(&campaign(&first, &["--runs", "24", "--seed", "3"]));
    assert_eq!(result["runs"], 24);
    let failed = result["failed"].as_u64().unwrap();
    assert!(0 < failed && failed < 24, "{failed}");
    let interval = result["fail_rate_ci95"].as_array().unwrap();
    let ends: Vec<f64> = interval.iter().map(|end| end.as_f64().unwrap()).collect();
    let rate = failed as f64 / 24.0;
    assert!(ends[0] < rate && rate < ends[1] && ends[1] - ends[0] < 0.45);
    for figure in [
        "force_error_rms_N",
        "force_error_max_N",
        "along_error_max_m",
        "contact_lost_s",
    ] {
        let value = |key: &str| result[figure][key].as_f64().unwrap();
        assert!(value("median") <= value("p95") && value("p95") <= value("max"));
    }
    assert!(result["timing"]["real_time_factor"].as_f64().unwrap() > 0.0);
    for file in ["report.html", "runs.parquet", "campaign_drivers.svg"] {
        assert!(first.join(file).metadata().unwrap().len() > 1000, "{file}");
    }
    json(&campaign(&again, &["--runs", "24", "--seed", "3"]));
    same_results(&first, &again);
    // Another seed is another campaign; a longer one begins as this one.
    json(&campaign(&again, &["--runs", "30", "--seed", "3"]));
    let lines = |folder: &Path| {
        let csv = fs::read_to_string(folder.join("runs.csv")).unwrap();
        csv.lines().map(String::from).collect::<Vec<_>>()
    };
    assert_eq!(lines(&first)[..], lines(&again)[..25]);
    json(&campaign(&again, &["--runs", "24", "--seed", "4"]));
    assert_ne!(lines(&first)[1..], lines(&again)[1..]);
}

#[test]
fn shards_make_the_campaign_that_one_machine_makes() {
    let place = folder("campaign_shards");
    let whole = place.join("whole");
    json(&campaign(&whole, &["--runs", "14"]));
    let shards = ["1/3", "2/3", "3/3"].map(|shard| {
        let out = place.join(format!("shard-{}", &shard[..1]));
        json(&campaign(&out, &["--runs", "14", "--shard", shard]));
        out.display().to_string()
    });
    let merged = place.join("merged");
    let out = merged.display().to_string();
    let merge = |shards: &[&str]| {
        let mut arguments = vec!["campaign", "merge", "--json", "--out", &out];
        arguments.extend(shards);
        flexor(&arguments)
    };
    let [one, two, three] = &shards;
    let result = json(&merge(&[three, one, two]));
    assert_eq!(result["runs"], 14);
    same_results(&whole, &merged);
    // One missing, one twice, one of another campaign.
    let refused = |shards: &[&str], words: &str| {
        let output = merge(shards);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(
            message.contains(words) && message.lines().count() == 1,
            "{message}"
        );
    };
    refused(&[one, three], "5 of 14 runs are missing");
    refused(&[one, two, three, two], "run 1 is both in");
    let other = place.join("other");
    json(&campaign(
        &other,
        &["--runs", "14", "--seed", "2", "--shard", "2/3"],
    ));
    refused(&[one, &other.display().to_string(), three], "seed 1 and 2");
    refused(&["nowhere"], "nowhere");
}

#[test]
fn a_run_can_be_repeated_alone_with_all_its_ticks() {
    let place = folder("campaign_only");
    let (all, one) = (place.join("all"), place.join("one"));
    json(&campaign(&all, &["--runs", "9", "--write", "all"]));
    let mut csv = csv::Reader::from_path(all.join("runs.csv")).unwrap();
    let header = csv.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|column| column == name).unwrap();
    for (number, record) in csv.records().enumerate() {
        let record = record.unwrap();
        let number = number.to_string();
        let output = campaign(&one, &["--runs", "9", "--only", &number]);
        let result: Value = serde_json::from_slice(&output.stdout).unwrap();
        for name in [
            "force_error_rms_N",
            "force_error_max_N",
            "along_error_rms_m",
            "along_error_max_m",
            "contact.friction",
            "plant.root_inertia_kgm2",
        ] {
            let (alone, beside): (f64, f64) = (
                result[name].as_f64().unwrap(),
                record[column(name)].parse().unwrap(),
            );
            assert_eq!(alone.to_bits(), beside.to_bits(), "run {number}, {name}");
        }
        assert_eq!(result["outcome"], record[column("outcome")]);
        // Every tick from the path's start to the run's end, and a file of them in the campaign.
        let ticks = fs::read_to_string(one.join("run.csv")).unwrap();
        let last = ticks.lines().last().unwrap().split(',').next().unwrap();
        assert_eq!(
            last.parse::<f64>(),
            record[column("ended_s")].parse::<f64>()
        );
        let kept = all.join("runs").join(format!("{number:0>6}.parquet"));
        assert!(kept.metadata().unwrap().len() > 10_000);
    }
}

#[test]
fn a_killed_campaign_goes_on_where_it_was() {
    let place = folder("campaign_killed");
    let (whole, killed) = (place.join("whole"), place.join("killed"));
    json(&campaign(&whole, &["--runs", "40"]));
    let (bench, out) = (scenario("bench.toml"), killed.display().to_string());
    let arguments = [
        "campaign",
        "--scenario",
        &bench,
        "--runs",
        "40",
        "--out",
        &out,
    ];
    let rows = killed.join(".flexor-kept/rows.csv");
    let lines = || fs::read_to_string(&rows).map_or(0, |rows| rows.lines().count());
    // Twice, so that what was resumed is resumed.
    for least in [5, 15] {
        let mut child = command(&arguments).stdout(Stdio::null()).spawn().unwrap();
        let since = Instant::now();
        while lines() < least && child.try_wait().unwrap().is_none() {
            assert!(since.elapsed() < Duration::from_secs(60), "no rows come");
            std::thread::sleep(Duration::from_millis(2));
        }
        let _ = child.kill();
        child.wait().unwrap();
        assert!(
            killed.join("summary.json").metadata().is_err(),
            "it was too fast"
        );
    }
    // As a kill in the middle of a row leaves it.
    let mut cut = fs::read(&rows).unwrap();
    cut.truncate(cut.len() - 7);
    fs::write(&rows, cut).unwrap();
    let output = campaign(&killed, &["--runs", "40"]);
    json(&output);
    let message = text(&output.stderr);
    assert!(
        message.contains("of an interrupted campaign are there"),
        "{message}"
    );
    same_results(&whole, &killed);
    assert!(!killed.join(".flexor-kept").exists());
}

#[test]
fn what_another_campaign_has_left_does_not_get_into_this_one() {
    let place = folder("campaign_left");
    let (other, out) = (place.join("other"), place.join("out"));
    json(&campaign(&other, &["--runs", "8", "--seed", "2"]));
    // As one leaves it that was killed after all its runs and a ninth's ticks.
    let kept = out.join(".flexor-kept");
    fs::create_dir_all(kept.join("runs")).unwrap();
    fs::write(kept.join("runs/000008.parquet"), "ticks").unwrap();
    fs::copy(other.join("campaign.json"), kept.join("campaign.json")).unwrap();
    for rows in ["rows.csv", "rows_with_ticks.csv"] {
        fs::copy(other.join("runs.csv"), kept.join(rows)).unwrap();
    }
    let (alone, more) = (place.join("alone"), ["--runs", "8", "--write", "all"]);
    let output = campaign(&out, &more);
    assert!(text(&output.stderr).contains("was another one"));
    json(&output);
    json(&campaign(&alone, &more));
    same_results(&alone, &out);
    assert_eq!(fs::read_dir(out.join("runs")).unwrap().count(), 8);
}

#[test]
fn limits_that_do_not_hold_are_an_exit_code() {
    let place = folder("campaign_verdict");
    let bench = scenario("bench.toml");
    let file = place.join("strict.toml");
    let write = |limits: &str| {
        fs::write(
            &file,
            format!(
                "base = {bench:?}\ncontroller = {:?}\n[verdict]\n{limits}\n",
                paper()
            ),
        )
        .unwrap();
        let (file, out) = (
            file.display().to_string(),
            place.join("out").display().to_string(),
        );
        flexor(&[
            "campaign",
            "--scenario",
            &file,
            "--runs",
            "24",
            "--out",
            &out,
        ])
    };
    let output = write("fail_rate_max = 0.01\nalong_max_max_m = 0.06");
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(
        message.contains("fail_rate_max = 0.01 is exceeded by 0."),
        "{message}"
    );
    assert!(!message.contains("along_max_max_m"), "{message}");
    // The results are there all the same.
    let summary = fs::read_to_string(place.join("out/summary.json")).unwrap();
    let summary: Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(
        (&summary["holds"], &summary["runs"]),
        (&false.into(), &24.into())
    );
    assert_eq!(write("fail_rate_max = 0.99").status.code(), Some(0));
    // No run that did not fail: there are no figures, but their places are.
    let output = campaign(
        &place.join("all"),
        &["--runs", "2", "--set", "drive1.gain=-1"],
    );
    let result = json(&output);
    assert_eq!(result["failed"], 2);
    let none = serde_json::json!({ "median": null, "p95": null, "max": null });
    assert_eq!(result["force_error_rms_N"], none);
}

#[test]
fn a_queue_of_workers_does_what_one_machine_does() {
    let python = Command::new("python3").arg("--version").output();
    if !python.is_ok_and(|output| output.status.success()) {
        eprintln!("python3 is not there: the queue of workers was not tried");
        return;
    }
    let place = folder("campaign_workers");
    let whole = place.join("whole");
    json(&campaign(&whole, &["--runs", "12", "--seed", "5"]));
    let out = place.join("queue");
    let shape = "--runs 12 --seed 5 --shards 4 --local 2";
    let output = Command::new("python3")
        .arg(root().join("examples/cluster/workers.py"))
        .args(["serve", "--scenario", &scenario("bench.toml")])
        .args(shape.split(' '))
        .args(["--flexor", env!("CARGO_BIN_EXE_flexor"), "--out"])
        .arg(&out)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let (merged, read) = (out.join("merged"), |file: PathBuf| fs::read(file).unwrap());
    for file in ["runs.csv", "runs.parquet"] {
        assert!(read(whole.join(file)) == read(merged.join(file)), "{file}");
    }
    // What they were made from has other names.
    let [a, b] = [&whole, &merged].map(|of| {
        let mut summary = serde_json::from_slice::<Value>(&read(of.join("summary.json"))).unwrap();
        summary["provenance"].take();
        summary
    });
    assert_eq!(a, b);
}

/// Asserts that a scenario with this text, or these arguments, is refused in one line that has all
/// of `words`, with exit code 2, and leaves nothing.
#[track_caller]
fn refused(text_of_file: &str, more: &[&str], words: &[&str]) {
    let place = folder("campaign_refused");
    let (file, out) = (place.join("bad.toml"), place.join("out"));
    fs::write(&file, text_of_file).unwrap();
    let (file, out_name) = (file.display().to_string(), out.display().to_string());
    for verb in ["campaign", "run"] {
        let mut arguments = vec![verb, "--scenario", &file, "--out", &out_name];
        arguments.extend(more);
        let output = flexor(&arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{text_of_file:?}: {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        for word in words {
            assert!(message.contains(word), "no {word:?} in {message}");
        }
        assert!(!out.exists(), "something was written");
    }
}

#[test]
fn what_is_wrong_with_a_scenario_is_said_in_one_line() {
    let accepted = "accepted:";
    refused("[contact", &[], &["bad.toml", "line 1"]);
    refused(
        "[contact]\nfriktion = 0.1",
        &[],
        &["contact.friktion: unknown", "friction_at_rest"],
    );
    refused(
        "[kontact]\nfriction = 0.1",
        &[],
        &["kontact: unknown", "joint1", "[verdict]"],
    );
    refused("contact = 3", &[], &["contact: unknown"]);
    refused(
        "[contact]\nfriction = -0.1",
        &[],
        &["contact.friction = -0.1", accepted],
    );
    refused(
        "[contact]\nfriction = nan",
        &[],
        &["contact.friction", accepted],
    );
    refused(
        "[contact]\nfriction = \"much\"",
        &[],
        &["contact.friction = \"much\"", accepted],
    );
    refused(
        "[contact]\nfriction = { uniform = [0.3, 0.1] }",
        &[],
        &["contact.friction", accepted],
    );
    refused(
        "[contact]\nfriction = { uniform = [0.0, 99.0] }",
        &[],
        &["contact.friction", accepted],
    );
    refused(
        "[contact]\nfriction = { log_uniform = [0.0, 0.3] }",
        &[],
        &["contact.friction", accepted],
    );
    refused(
        "[contact]\nfriction = { normal = [0.1, 0.2] }",
        &[],
        &["contact.friction", "deviation"],
    );
    refused(
        "[contact]\nfriction = { choice = [] }",
        &[],
        &["contact.friction", accepted],
    );
    refused(
        "[contact]\nfriction = { unifrom = [0.0, 0.1] }",
        &[],
        &["contact.friction", accepted],
    );
    refused(
        "[plant]\nelements = { uniform = [2, 8] }",
        &[],
        &["plant.elements", "choice"],
    );
    refused(
        "[plant]\nelements = 4.5",
        &[],
        &["plant.elements = 4.5", "whole number"],
    );
    refused(
        "[plant]\nelements = { choice = [4, 99] }",
        &[],
        &["plant.elements", accepted],
    );
    refused(
        "[plant]\ngeometric_stiffness = 1",
        &[],
        &["plant.geometric_stiffness = 1", "\"contact\" or \"full\""],
    );
    refused(
        "[root_gauge]\nmeasures = \"strain\"",
        &[],
        &["root_gauge.measures", "\"moment\" or \"slope\""],
    );
    refused(
        "[[faults]]\nfault = \"earthquake\"\nat_s = 1.0",
        &[],
        &["faults[0].fault", "emergency_stop"],
    );
    refused(
        "[[faults]]\nfault = \"strain_offset\"\nat_s = 1.0",
        &[],
        &[
            "faults[0].value missing",
            "accepted for strain_offset",
            "counts",
        ],
    );
    refused(
        "[[faults]]\nfault = \"strain_rail\"\nat_s = 1.0\nvalue = 3",
        &[],
        &["faults[0].value", "without effect"],
    );
    refused(
        "[[faults]]\nfault = \"strain_rail\"\nat_s = inf",
        &[],
        &["faults[0].at_s", accepted],
    );
    refused(
        "[[faults]]\nfault = \"strain_rail\"\nat_s = 99.0",
        &[],
        &["faults[0].at_s = 99", "the run's end"],
    );
    refused(
        "[verdict]\nfail_rate = 0.1",
        &[],
        &["verdict", "fail_rate_max"],
    );
    refused(
        "[verdict]\nfail_rate_max = 1.5",
        &[],
        &["verdict.fail_rate_max = 1.5", accepted],
    );
    refused(
        "[failed]\nalong_error_m = 0.0",
        &[],
        &["failed.along_error_m = 0", accepted],
    );
    refused(
        "[[surface.features]]\nhole = { from_m = 0.5, to_m = 0.4, depth_m = 0.01 }",
        &[],
        &["surface.features[0].hole.to_m", accepted],
    );
    refused(
        "base = \"nowhere.toml\"",
        &[],
        &["nowhere.toml", "cannot be read"],
    );
    refused("base = \"bad.toml\"", &[], &["bases in a row"]);
    refused("arm = 3", &[], &["arm", "a file"]);
    refused(
        "arm = \"nowhere.toml\"",
        &[],
        &["nowhere.toml", "cannot be read"],
    );
    refused(
        "",
        &["--set", "contact.friction"],
        &["--set", "section.key=value"],
    );
    refused(
        "",
        &["--set", "contact.friktion=1"],
        &["contact.friktion: unknown"],
    );
    // An arm that cannot be: link 2 is too short for the path.
    refused(
        "[plant]\nlink2_length_offset_m = -0.5",
        &[],
        &["no start at"],
    );
    // Play without a rotor that could move in it.
    refused(
        "[joint1]\nplay_rad = 0.01",
        &[],
        &["joint1.rotor_inertia_kgm2", "is accepted"],
    );
    // A contact so damped that no step is short enough.
    refused(
        "[contact]\ndamping_Ns_m = 1e6",
        &[],
        &["integration steps", "less damping"],
    );
}

#[test]
fn numbers_of_runs_and_shards_have_their_range() {
    let place = folder("campaign_usage");
    for (arguments, word) in [
        (&["--runs", "0"][..], "--runs"),
        (&["--shard", "4/3"], "4/3"),
        (&["--runs", "5", "--only", "5"], "from 0 to 4"),
        (&["--seed=-1"], "--seed"),
    ] {
        let output = campaign(&place.join("out"), arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(word), "{message}");
        assert!(!place.join("out").exists());
    }
}

#[test]
fn a_plain_run_goes_through_the_boards_counts() {
    let place = folder("bench_run");
    let out = place.display().to_string();
    let run = |more: &[&str]| {
        let mut arguments = vec!["run", "--json", "--out", &out];
        arguments.extend(more);
        flexor(&arguments)
    };
    let rms = |more: &[&str]| json(&run(more))["force_error_rms_N"].as_f64().unwrap();
    // A step of the drives' converters is 2 mN m at joint 2, whose arm is 0.35 m long.
    let (counted, ideal) = (
        rms(&["--mode", "feedforward"]),
        rms(&["--mode", "feedforward", "--ideal"]),
    );
    assert!(
        ideal < 1e-4 && (5e-3..5e-2).contains(&counted),
        "{ideal} {counted}"
    );
    let header = fs::read_to_string(place.join("run.csv")).unwrap();
    assert!(header.starts_with("t_s,f_normal_N,"));
    // With the gauge that tells the slope, so that its count is one.
    json(&run(&["--set", "root_gauge.measures=\"slope\""]));
    let mut csv = csv::Reader::from_path(place.join("run.csv")).unwrap();
    let header = csv.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|column| column == name).unwrap();
    for record in csv.records().step_by(500) {
        let record = record.unwrap();
        let value = |name: &str| record[column(name)].parse::<f64>().unwrap();
        // The default board's counts: 4096 lines, home at pi/2; 20 N, 0.5 rad on 12 bits.
        let turned =
            (value("motor1_rad") - std::f64::consts::FRAC_PI_2) * 16_384.0 / std::f64::consts::TAU;
        let counted = f64::from((value("encoder1_count") as u16).cast_signed());
        assert!((turned - counted).abs() < 0.51, "{turned} {counted}");
        let force = (value("force_count") - 2048.0) * 40.0 / 4096.0;
        assert!((force - value("f_normal_N")).abs() < 0.006);
        let slope = (value("strain_count") - 2048.0) / 4096.0;
        assert!((slope - value("root_slope_rad")).abs() < 1.3e-4);
        let given = value("drive1_Nm") / 40.0 * 2048.0;
        assert!(
            (given - given.round()).abs() < 1e-3
                && (value("drive1_Nm") - value("tau1_Nm")).abs() < 0.011
        );
    }
    for (arguments, word) in [
        (
            &["--number", "fixed", "--set", "contact.friction=0.1"][..],
            "--number",
        ),
        (
            &["--start", "plan-moving", "--scenario", "x.toml"],
            "--start",
        ),
        (&["--ideal", "--scenario", "x.toml"], "--scenario"),
        (&["--ideal", "--set", "contact.friction=1"], "--set"),
    ] {
        let output = run(arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(word), "{message}");
    }
    // What only the paper's world has is run there.
    let moving = ["--start", "plan-moving", "--mode", "feedforward"];
    let output = run(&moving);
    let said = json(&run(&[&moving[..], &["--ideal"]].concat()));
    assert_eq!(
        json(&output)["force_error_rms_N"],
        said["force_error_rms_N"]
    );
    assert!(text(&output.stderr).contains("as with --ideal"));
    // A scenario's fault ends it, and a script can demand that it does not.
    let file = place.join("stop.toml");
    fs::write(
        &file,
        "[[faults]]\nfault = \"emergency_stop\"\nat_s = 0.5\n",
    )
    .unwrap();
    let stop = file.display().to_string();
    assert_eq!(
        json(&run(&["--scenario", &stop]))["outcome"],
        "emergency_stop"
    );
    let output = run(&["--scenario", &stop, "--require-completed"]);
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
}

#[test]
fn what_a_board_would_not_do_is_said() {
    let place = folder("bench_refusal");
    let out = place.display().to_string();
    let run = |more: &[&str]| flexor(&[&["run", "--json", "--out", &out], more].concat());
    // Homed a tenth of a radian off: no board would be enabled there.
    let output = run(&["--set", "encoders.homing1_rad=0.1"]);
    let message = text(&output.stderr);
    assert!(
        message.contains("warning: a board would not be enabled"),
        "{message}"
    );
    assert!(!text(&run(&[]).stderr).contains("would not be enabled"));
    // Bounces on a hard surface are no completed run, though no failed one of a campaign.
    let hard = scenario("hard_surface.toml");
    let (hard, slope, law) = (hard, "root_gauge.measures=slope", paper());
    let hard = ["--scenario", &hard, "--set", slope, "--controller", &law];
    let output = run(&[&hard[..], &["--require-completed"]].concat());
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    let campaign = [
        &["campaign", "--json", "--runs", "2", "--out", &out],
        &hard[..],
    ]
    .concat();
    let result = json(&flexor(&campaign));
    assert_eq!(
        (&result["failed"], &result["outcomes"]["contact_lost"]),
        (&0.into(), &2.into())
    );
    // What would be of no effect.
    let plant = root()
        .join("examples/plant_soft.toml")
        .display()
        .to_string();
    let output = run(&["--plant", &plant, "--set", "contact.friction=0.1"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--plant"));
    let output = flexor(&["campaign", "--runs", "4", "--shard", "5/10", "--out", &out]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--shard 5/10"));
    // A drive weaker than the board's is seen in the log, which the board does not tell.
    let weak = run(&["--set", "drive1.limit_Nm=10.8"]);
    let weak: Value = serde_json::from_slice(&weak.stdout).unwrap();
    assert!(weak["limited_ticks"].as_u64().unwrap() > 1000);
}

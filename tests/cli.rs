//! The command line as a user meets it: results, errors and exit codes.

mod cli_arms;
mod cli_gains;
mod cli_moves;
mod cli_tables;

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const ARM: &str = include_str!("../examples/arm.toml");
const TASK: &str = include_str!("../examples/task.toml");
const CONTROLLER: &str = include_str!("../examples/controller_paper.toml");
const BOARD: &str = include_str!("../boards/stm32f405.toml");

/// A folder of its own for a test, empty at its start.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn flexor(arguments: &[&str]) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_flexor"));
    Command::new(program).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Runs `arguments`, which must fail with `code` and one line that has all of `words`.
fn refused(arguments: &[&str], code: i32, words: &[&str]) {
    let output = flexor(arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    assert!(!message.contains("panicked"), "{message}");
    for word in words {
        assert!(
            message.contains(word),
            "{arguments:?}: no {word:?} in {message}"
        );
    }
}

#[test]
fn the_demo_reports_ten_cases_within_their_bars() {
    let out = folder("demo");
    let out = out.to_str().unwrap();
    let result = json(&flexor(&["demo", "--json", "--out", out]));
    let cases = result["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 10);
    let rms = |case: &str, plant: &str| {
        let found = cases
            .iter()
            .find(|c| c["case"] == case && c["plant"] == plant);
        found.unwrap()["force_error_rms_N"].as_f64().unwrap()
    };
    for case in ["feedforward_with_initial_velocity", "feedforward"] {
        assert!(rms(case, "nominal") <= 5e-5);
    }
    assert!(rms("proposed", "stiffness_x0.9") <= 0.45 * rms("feedforward", "stiffness_x0.9"));
    assert!(rms("fast_from_rest", "nominal") <= 0.002);
    for case in cases {
        let fails = case["outcome"] != "completed";
        assert_eq!(fails, case["case"] == "feedback", "{case}");
    }
    for file in [
        "report.html",
        "plan.csv",
        "summary.json",
        "stick_figure.svg",
        "contact_force_cases.svg",
        "proposed_stiffness_x0.9.svg",
        "proposed_stiffness_x0.9/run.csv",
        "proposed_stiffness_x0.9/summary.json",
    ] {
        let size = std::fs::metadata(Path::new(out).join(file)).unwrap().len();
        assert!(size > 500, "{file} has {size} bytes");
    }
}

#[test]
fn a_plan_comes_as_csv_table_and_json() {
    let out = folder("plan");
    let result = json(&flexor(&["plan", "--json", "--out", out.to_str().unwrap()]));
    assert!(result["table_bytes"].as_u64().unwrap() <= 16 * 1024);
    assert!(result["table_torque_error_max_Nm"].as_f64().unwrap() <= 1e-5);
    assert!(result["table_torque_error_share"].as_f64().unwrap() <= 1e-6);
    assert!(result["error_estimate"].as_f64().unwrap() <= 1e-6);
    assert!(result["timing"]["plan_ms"].as_f64().unwrap() > 0.0);
    let csv = std::fs::read_to_string(out.join("plan.csv")).unwrap();
    let mut lines = csv.lines();
    let header = lines.next().unwrap();
    let columns =
        "t_s,theta10_rad,theta20_rad,w0,w1,w2,w3,w4,w5,root_slope_rate_rad_s,tau1_Nm,tau2_Nm";
    assert!(header.starts_with(columns), "{header}");
    assert_eq!(lines.clone().count(), 10_001);
    assert!(lines.clone().next().unwrap().starts_with("0.0,0.96444"));
    assert!(lines.next_back().unwrap().starts_with("2.0,"));
    let image = std::fs::read(out.join("table.bin")).unwrap();
    assert_eq!(image.len() as u64, result["table_bytes"].as_u64().unwrap());
}

#[test]
fn controllers_modes_starts_and_numbers_can_be_chosen() {
    let out = folder("options");
    let path = |name: &str| out.join(name).to_str().unwrap().to_string();
    let rms = |arguments: &[&str]| {
        let out = path("run");
        let mut all = vec!["run", "--ideal", "--json", "--plant-elements", "3"];
        all.extend(["--out", &out]);
        all.extend(arguments);
        json(&flexor(&all))["force_error_rms_N"].as_f64().unwrap()
    };
    let soft = ["--bending-stiffness-scale", "0.9"];
    let alone = [soft[0], soft[1], "--mode", "feedforward"];
    let from = |start: &str| rms(&[&alone[..], &["--start", start]].concat());
    let (feedforward, equilibrium) = (from("plan-at-rest"), from("equilibrium"));
    assert_eq!(rms(&alone), equilibrium);
    assert!((feedforward - 0.081).abs() < 0.001 && (equilibrium - 0.0076).abs() < 1e-4);
    let single = rms(&["--number", "f32"]);
    let double = rms(&["--number", "f64"]);
    assert!(
        single != double && (single - double).abs() < 1e-5,
        "{single} {double}"
    );
    std::fs::write(
        path("printed.toml"),
        "K_DF = 0.0\nK_PF = 0.0\nK_IF = 2.0\nK_w = 0.1\nforce_projection = \"as-printed\"\n",
    )
    .unwrap();
    let printed = rms(&[soft[0], soft[1], "--controller", &path("printed.toml")]);
    assert!(printed != rms(&soft));
    // The paper's equations are no plan for a fast motion.
    // --mode goes before the file's feedforward, and nothing is ignored in silence.
    let idle = path("idle.toml");
    let file = CONTROLLER.replace("feedforward = true", "feedforward = false");
    std::fs::write(&idle, file).unwrap();
    let feedback = rms(&["--controller", &idle]);
    assert_eq!(feedback, rms(&["--mode", "feedback"]));
    let both = rms(&["--controller", &idle, "--mode", "proposed"]);
    assert_eq!(both, rms(&[]));
    refused(
        &[
            "run",
            "--controller",
            &idle,
            "--mode",
            "feedforward",
            "--out",
            &path("run"),
        ],
        2,
        &["--controller", "--mode feedforward"],
    );
    refused(
        &["demo", "--controller", &idle, "--out", &path("demo")],
        2,
        &["feedforward = false", "demo"],
    );
    let exact = rms(&["--mode", "feedforward"]);
    assert!(rms(&["--mode", "feedforward", "--model", "as-printed"]) > 10.0 * exact);
}

#[test]
fn a_script_can_demand_that_a_run_is_completed() {
    let out = folder("demand");
    let results = out.join("results");
    let run = |more: &[&str]| {
        let arguments = [
            "run",
            "--ideal",
            "--json",
            "--out",
            results.to_str().unwrap(),
        ];
        flexor(&[&arguments[..], more].concat())
    };
    // Feedback alone leaves the path; these gains, with drives that give them all they want, end in
    // infinity.
    let strong = out.join("strong.toml");
    let limits = "[limits]\ntorque_Nm = [1e5, 1e5]\ntorque_rate_Nm_s = [1e9, 1e9]\n";
    std::fs::write(&strong, format!("{ARM}\n{limits}")).unwrap();
    let wild = out.join("wild.toml");
    let gains = "K_DF_s = 0.0\nK_PF = 0.0\nK_IF_per_s = 9000.0\nK_w_Nms_rad = 0.0\n";
    std::fs::write(&wild, gains).unwrap();
    let [strong, wild] = [strong, wild].map(|file| file.to_str().unwrap().to_string());
    let wild = ["--controller", &wild, "--arm", &strong];
    let cases = [
        (&["--start", "plan-at-rest"][..], "completed", [0, 0]),
        (&["--mode", "feedback"], "tip_off_path", [0, 3]),
        (&wild, "diverged", [1, 3]),
    ];
    for (arguments, outcome, codes) in cases {
        for (demand, code) in [&[][..], &["--require-completed"]].into_iter().zip(codes) {
            let output = run(&[arguments, demand].concat());
            let message = text(&output.stderr);
            assert_eq!(output.status.code(), Some(code), "{outcome}: {message}");
            // Printed and written as ever.
            let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
            let written = std::fs::read(results.join("summary.json")).unwrap();
            let written: Value = serde_json::from_slice(&written).unwrap();
            assert_eq!(printed["outcome"], outcome);
            assert_eq!(written["outcome"], outcome);
            if code == 3 {
                let last = message.lines().last().unwrap();
                for word in ["error: ", outcome, "--require-completed"] {
                    assert!(last.contains(word), "no {word:?} in {last}");
                }
            }
        }
    }
}

/// Every `key = value` line of a TOML text, with its value's place.
fn fields(toml: &str) -> Vec<(usize, String)> {
    let lines = toml.lines().enumerate();
    let keyed = lines.filter(|(_, line)| !line.starts_with('#') && line.contains(" = "));
    keyed
        .map(|(i, line)| (i, line.split(" = ").next().unwrap().to_string()))
        .collect()
}

#[test]
fn every_field_of_the_planners_files_is_guarded() {
    let out = folder("fields");
    let path = |name: &str| out.join(name).to_str().unwrap().to_string();
    let results = path("results");
    for (option, name, toml) in [
        ("--arm", "arm.toml", ARM),
        ("--task", "task.toml", TASK),
        ("--board", "board.toml", BOARD),
    ] {
        let file = path(name);
        let with_line = |at: usize, line: Option<&str>| {
            let lines = toml.lines().enumerate();
            let changed: Vec<_> = lines
                .filter_map(|(i, old)| if i == at { line } else { Some(old) })
                .collect();
            std::fs::write(&file, changed.join("\n")).unwrap();
            flexor(&["plan", option, &file, "--out", &results])
        };
        for (at, key) in fields(toml) {
            let pair = toml.lines().nth(at).unwrap().contains('[');
            let mut bad: Vec<(String, bool)> = vec![
                (format!("{key} = true"), true),
                (format!("{key} = {{ a = 1 }}"), true),
                (format!("{key}_x = 1.0"), true),
                (format!("{key} ="), true),
            ];
            // Zero is good for some: gravity, damping, windows, force, coordinates.
            for (number, must_fail) in [
                ("nan", true),
                ("inf", true),
                ("1e300", true),
                ("-1e300", true),
                ("-1.0", false),
                ("0.0", false),
            ] {
                let value = if pair {
                    format!("[{number}, 0.05]")
                } else {
                    number.to_string()
                };
                bad.push((format!("{key} = {value}"), must_fail));
            }
            for (line, must_fail) in bad {
                let output = with_line(at, Some(&line));
                let message = text(&output.stderr);
                let code = output.status.code();
                assert!(!message.contains("panicked"), "{line}: {message}");
                if must_fail || code != Some(0) {
                    assert_eq!(code, Some(2), "{line}: {message}");
                    assert_eq!(message.trim_end().lines().count(), 1, "{line}: {message}");
                    assert!(message.len() < 400, "{line}: {message}");
                    for word in ["invalid type", "variant", "f64", "000000000"] {
                        assert!(!message.contains(word), "{line}: {message}");
                    }
                    assert!(
                        [&key, "line", "path", "duration"]
                            .iter()
                            .any(|w| message.contains(*w)),
                        "{line}: {message}"
                    );
                }
            }
            // Left out, the link is the exact one.
            if key == "model" {
                continue;
            }
            let output = with_line(at, None);
            let message = text(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "without {key}: {message}");
            assert!(
                message.contains(&key) && message.contains("missing"),
                "{message}"
            );
        }
    }
}

#[test]
fn paths_out_of_reach_and_drives_too_weak_are_named() {
    let out = folder("paths");
    let path = |name: &str| out.join(name).to_str().unwrap().to_string();
    let (task, results) = (path("task.toml"), path("results"));
    std::fs::write(
        &task,
        TASK.replace("to_m = [0.2, 0.05]", "to_m = [1.2, 0.05]"),
    )
    .unwrap();
    refused(
        &["plan", "--task", &task, "--out", &results],
        2,
        &["t = 2.0000 s", "1.2000", "unreachable"],
    );
    std::fs::write(
        &task,
        TASK.replace("to_m = [0.2, 0.05]", "to_m = [0.7, 0.05]"),
    )
    .unwrap();
    refused(
        &["plan", "--task", &task, "--out", &results],
        2,
        &["path.from_m", "path.to_m"],
    );
    let arm = path("arm.toml");
    let limits = "[limits]\ntorque_Nm = [5.0, 1.0]\ntorque_rate_Nm_s = [1e4, 1e4]\n";
    std::fs::write(&arm, format!("{ARM}\n{limits}")).unwrap();
    refused(
        &["plan", "--arm", &arm, "--out", &results],
        2,
        &["joint 1", "10.96", "t = 0.0", "limits.torque_Nm[0] = 5"],
    );
    // Drives that are strong enough but too slow are accepted with a warning.
    let limits = "[limits]\ntorque_Nm = [33.0, 1.0]\ntorque_rate_Nm_s = [10.0, 600.0]\n";
    std::fs::write(&arm, format!("{ARM}\n{limits}")).unwrap();
    for command in ["plan", "run"] {
        let output = flexor(&[command, "--arm", &arm, "--out", &results]);
        let message = text(&output.stderr);
        assert!(output.status.success(), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        for word in [
            "warning: limits.torque_rate_Nm_s[0] = 10",
            "16.99 N m/s",
            "t = 1.08",
        ] {
            assert!(message.contains(word), "{message}");
        }
    }
    // Friction that leaves a force loop little to spare is accepted with a warning, more refused.
    let rough = |friction: &str| {
        std::fs::write(&task, format!("{TASK}\n[surface]\nfriction = {friction}\n")).unwrap();
        flexor(&["plan", "--task", &task, "--out", &results])
    };
    let output = rough("0.38");
    assert!(output.status.success() && output.stderr.is_empty());
    let output = rough("0.4");
    let message = text(&output.stderr);
    assert!(output.status.success(), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    for word in [
        "warning: surface.friction = 0.4 times |c2/s2| = 1.423",
        "t = 1.2",
        "2.321 times its gain",
        "a friction up to 0.3865",
    ] {
        assert!(message.contains(word), "{message}");
    }
    // The ideal surface has none of it.
    assert_eq!(rough("0.1").status.code(), Some(0));
    let output = flexor(&["run", "--ideal", "--task", &task, "--out", &results]);
    let message = text(&output.stderr);
    assert!(
        message.contains("warning: the plan reckons with surface.friction = 0.1"),
        "{message}"
    );
    for (friction, words) in [
        ("0.71", "below 1, a friction below 0.7027"),
        (
            "-0.1",
            "surface.friction = -0.1; accepted: a friction coefficient from 0 to 10",
        ),
        (
            "\"rough\"",
            "surface.friction = \"rough\"; accepted: a friction coefficient from 0 to 10",
        ),
    ] {
        let output = rough(friction);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(words), "{message}");
    }
    // More than a plan may hold.
    std::fs::write(
        &task,
        TASK.replace("duration_s = 2.0", "duration_s = 201.0"),
    )
    .unwrap();
    refused(
        &["plan", "--task", &task, "--out", &results],
        2,
        &["201 s", "up to 1e6 (200 s)"],
    );
}

#[test]
fn whose_the_torque_limits_are_is_said() {
    let out = folder("limits");
    let path = |name: &str| out.join(name).to_str().unwrap().to_string();
    let (arm, board, results) = (path("arm.toml"), path("board.toml"), path("results"));
    let limits = "[limits]\ntorque_Nm = [33.0, 1.0]\ntorque_rate_Nm_s = [1e5, 1e5]\n";
    std::fs::write(&arm, format!("{ARM}\n{limits}")).unwrap();
    std::fs::write(&board, BOARD).unwrap();
    for command in ["plan", "run"] {
        for (files, of, said) in [
            (
                &[][..],
                "plan",
                &[
                    "three times the plan's peaks",
                    "[limits] in the arm file",
                    "--board",
                ][..],
            ),
            (&["--arm", &arm], "arm", &["33 and 1 N m, the arm file's"]),
            (
                &["--board", &board],
                "plan_and_board",
                &["three times the plan's peaks, no wider"],
            ),
            (
                &["--arm", &arm, "--board", &board],
                "arm_and_board",
                &["the arm file's, no wider"],
            ),
        ] {
            let arguments = [&[command, "--out", &results], files].concat();
            let words = text(&flexor(&arguments).stdout);
            let line = words.lines().find(|line| line.starts_with("torque limits"));
            for word in said {
                assert!(line.unwrap().contains(word), "no {word:?} in {line:?}");
            }
            let result = json(&flexor(&[&arguments[..], &["--json"]].concat()));
            assert_eq!(result["torque_limits_of"], of);
            for joint in [1, 2] {
                let figure = |key: String| result[key.as_str()].as_f64().unwrap();
                let limit = figure(format!("torque_limit{joint}_Nm"));
                let peak = figure(format!("planned_torque{joint}_max_Nm"));
                let own = [33.0, 1.0][joint - 1];
                let expected = if of.starts_with("arm") {
                    own
                } else {
                    3.0 * peak
                };
                assert!(
                    (limit - expected).abs() <= 1e-12 * expected,
                    "{of}: {limit}"
                );
            }
        }
    }
}

#[test]
fn demo_says_what_its_fast_case_needs() {
    let out = folder("demo_fast");
    let task = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/task_fast.toml");
    refused(
        &["demo", "--task", task, "--out", out.to_str().unwrap()],
        2,
        &["fast case", "a fifth of its duration_s", "`flexor run`"],
    );
}

#[test]
fn files_without_end_are_refused() {
    let out = folder("endless");
    let long = out.join("long.toml");
    std::fs::write(&long, " ".repeat((1 << 20) + 1)).unwrap();
    let results = out.join("results").to_str().unwrap().to_string();
    refused(
        &["plan", "--arm", long.to_str().unwrap(), "--out", &results],
        2,
        &["long.toml", "more than 1048576 bytes"],
    );
}

#[test]
fn usage_and_output_errors_have_their_codes() {
    let out = folder("usage");
    let file = out.join("a_file");
    std::fs::write(&file, "x").unwrap();
    let results = out.join("results").to_str().unwrap().to_string();
    let inside = file.join("results");
    for command in ["plan", "run", "demo", "gains", "pil"] {
        refused(
            &[command, "--out", inside.to_str().unwrap()],
            1,
            &["a_file", "cannot be written"],
        );
    }
    refused(
        &["plan", "--arm", "/nowhere/arm.toml", "--out", &results],
        2,
        &["/nowhere/arm.toml", "cannot be read"],
    );
    for arguments in [
        &["fly"][..],
        &["plan", "--speed", "3"],
        &["run", "--mode", "best"],
        &["run", "--tick-rate-hz", "0"],
        &["run", "--tick-rate-hz", "fast"],
        &["gains", "--points", "1001"],
        &["gains", "tune", "--particles", "1001"],
        &["gains", "--at", "1", "tune"],
    ] {
        assert_eq!(flexor(arguments).status.code(), Some(2), "{arguments:?}");
    }
    refused(
        &["run", "--plant-elements", "99", "--out", &results],
        2,
        &["--plant-elements 99", "1 to 16"],
    );
    let out = out.to_str().unwrap();
    refused(
        &["pil", "--elf", "/nowhere/firmware", "--out", out],
        2,
        &["/nowhere/firmware", "`cargo xtask firmware` builds it"],
    );
    refused(
        &["plan", "--out", file.to_str().unwrap()],
        1,
        &["a_file", "cannot be written", "not a directory"],
    );
    refused(
        &["run", "--bending-stiffness-scale", "nan", "--out", &results],
        2,
        &["--bending-stiffness-scale NaN", "0.01 to 100"],
    );
    for arguments in [
        &["--help"][..],
        &["plan", "--help"],
        &["run", "--help"],
        &["demo", "--help"],
        &["pil", "--help"],
    ] {
        let output = flexor(arguments);
        assert!(output.status.success() && text(&output.stdout).contains("Example:"));
    }
}

#[test]
fn accuracy_comes_as_json_figures_and_a_page() {
    let out = folder("accuracy");
    let out = out.to_str().unwrap();
    let result = json(&flexor(&["accuracy", "--json", "--out", out]));
    for (number, factor) in [("f32", 100.0), ("fixed", 1.0)] {
        let is = |key: &str| result[number][key].as_f64().unwrap();
        assert!(is("torque_error_rms_Nm") <= 2e-4 / factor);
        assert!(is("torque_error_max_Nm") <= 1e-3 / factor);
        assert!(is("force_difference_max_N") <= 2e-3 / factor);
        assert_eq!(is("saturations"), 0.0);
        assert_eq!(result[number]["random"]["ticks"], 100_000);
    }
    for file in [
        "report.html",
        "summary.json",
        "accuracy.csv",
        "accuracy_time.svg",
        "accuracy_histogram.svg",
    ] {
        let size = std::fs::metadata(Path::new(out).join(file)).unwrap().len();
        assert!(size > 500, "{file} has {size} bytes");
    }
}

#[test]
fn without_feedback_a_force_that_stands_still_is_no_fault() {
    let out = folder("feedforward_bench");
    let out = out.to_str().unwrap();
    // Perfect readings: with a hub and a fine link the force is the planned one, to less than a count,
    // over half the path.
    let arm = Path::new(out).join("arm.toml");
    let hub = ARM.replacen("elements = 3", "elements = 8\nroot_inertia_kgm2 = 1e-3", 1);
    assert_ne!(hub, ARM);
    std::fs::write(&arm, hub).unwrap();
    let run = [
        "run",
        "--arm",
        arm.to_str().unwrap(),
        "--mode",
        "feedforward",
        "--plant-elements",
        "8",
        "--require-completed",
        "--json",
        "--out",
        out,
    ];
    let result = json(&flexor(&run));
    assert_eq!(result["outcome"], "completed");
}

#[test]
fn a_run_in_fixed_point_counts_saturations_and_refuses_what_does_not_fit() {
    let out = folder("fixed");
    let out = out.to_str().unwrap();
    let result = json(&flexor(&[
        "run",
        "--json",
        "--number",
        "fixed",
        "--plant-elements",
        "3",
        "--out",
        out,
    ]));
    assert_eq!(result["outcome"], "completed");
    assert_eq!(result["saturations"], 0);
    assert_eq!(result["saturations_integral"], 0);
    let file = Path::new(out).join("controller.toml");
    let gains = "K_DF_s = 0.0\nK_PF = 0.0\nK_IF_per_s = 1e-6\nK_w_Nms_rad = 0.1\n";
    std::fs::write(&file, gains).unwrap();
    let file = file.to_str().unwrap();
    let refused = flexor(&[
        "run",
        "--number",
        "fixed",
        "--controller",
        file,
        "--out",
        out,
    ]);
    assert_eq!(refused.status.code(), Some(2));
    let message = String::from_utf8(refused.stderr).unwrap();
    assert!(message.contains("K_IF_per_s = 1e-6"), "{message}");
}

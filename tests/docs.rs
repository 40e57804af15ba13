//! What README and docs print: the commands are run, the tables compared with what the
//! program says.

use flexor_sim::campaign::keys::{KEYS, Key};
use flexor_sim::files::config::{DEFAULT_BOARD, parse_board};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// All documents that show commands.
fn documents() -> Vec<String> {
    let mut names = vec!["README.md".to_string(), "CONTRIBUTING.md".to_string()];
    for entry in fs::read_dir(root().join("docs")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name.ends_with(".md") {
            names.push(format!("docs/{name}"));
        }
    }
    names
}

/// The arguments of every `cargo run --release -- ...` in the `sh` blocks of the documents, each
/// once, without comments and what follows `&&`.
fn commands() -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for document in documents() {
        let mut in_block = false;
        for line in read(&document).lines() {
            if line.starts_with("```") {
                in_block = line == "```sh";
                continue;
            }
            let Some(rest) = line.strip_prefix("cargo run --release -- ") else {
                continue;
            };
            if !in_block {
                continue;
            }
            let command = rest.split(" # ").next().unwrap_or_default();
            let command = command.split("&&").next().unwrap_or_default();
            let arguments: Vec<String> = command.split_whitespace().map(String::from).collect();
            if !found.contains(&arguments) {
                found.push(arguments);
            }
        }
    }
    found
}

/// An empty folder with the examples in it, and the file that the documents leave to the reader.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    let _ = fs::remove_dir_all(&folder);
    for examples in ["examples", "examples/scenarios"] {
        fs::create_dir_all(folder.join(examples)).unwrap();
        for entry in fs::read_dir(root().join(examples)).unwrap() {
            let entry = entry.unwrap();
            if entry.path().is_file() {
                let copy = folder.join(examples).join(entry.file_name());
                fs::copy(entry.path(), copy).unwrap();
            }
        }
    }
    fs::copy(
        folder.join("examples/controller_paper.toml"),
        folder.join("my_gains.toml"),
    )
    .unwrap();
    folder
}

fn flexor(folder: &Path, arguments: &[impl AsRef<std::ffi::OsStr>]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_flexor"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
}

/// The summary that `arguments` with `--json` print.
fn json(folder: &Path, arguments: &[&str]) -> Value {
    let output = flexor(folder, &[arguments, &["--json"]].concat());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {message}");
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn every_printed_command_does_what_it_says() {
    let folder = folder("docs_commands");
    let commands = commands();
    assert!(commands.len() >= 10, "{commands:?}");
    for arguments in &commands {
        // These need the image or a board, or never end: here only their command line can be judged.
        let within = arguments.iter().any(|argument| argument == "--virtual");
        let elsewhere =
            ["board", "pil", "virtual-board"].contains(&arguments[0].as_str()) && !within;
        if elsewhere {
            let mut line = arguments.clone();
            line.push("--help".into());
            assert!(flexor(&folder, &line).status.success(), "{arguments:?}");
            continue;
        }
        // Tuning is the test below.
        if arguments.iter().any(|argument| argument == "tune") {
            continue;
        }
        let output = flexor(&folder, arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {message}");
    }
}

#[test]
fn the_examples_gains_are_what_tuning_finds() {
    let folder = folder("docs_tune");
    let output = flexor(
        &folder,
        &[
            "gains",
            "tune",
            "--controller",
            "examples/controller_paper.toml",
            "--out",
            "out/gains",
        ],
    );
    assert!(output.status.success(), "{output:?}");
    let values = |text: &str| -> BTreeMap<String, String> {
        let pairs = text.lines().filter_map(|line| line.split_once('='));
        pairs
            .filter(|(key, _)| !key.trim_start().starts_with('#'))
            .map(|(key, value)| {
                let value = value.split('#').next().unwrap_or_default();
                (key.trim().to_string(), value.trim().to_string())
            })
            .collect()
    };
    let found = values(&fs::read_to_string(folder.join("out/gains/controller.toml")).unwrap());
    let shipped = values(&read("examples/controller_paper.toml"));
    for (key, value) in &found {
        let number = |text: &String| text.parse::<f64>().ok();
        let is = shipped.get(key).unwrap_or_else(|| panic!("no {key}"));
        assert!(
            is == value || number(is) == number(value),
            "{key}: {is}, tuned {value}"
        );
    }
}

/// The rows of the table in `document` whose head begins with `head`, cell by cell.
fn table(document: &str, head: &str) -> Vec<Vec<String>> {
    let text = read(document);
    let rows: Vec<Vec<String>> = text
        .lines()
        .skip_while(|line| !line.starts_with(head))
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| {
            let cells = line.trim_matches('|').split('|');
            cells.map(|cell| cell.trim().replace(',', "")).collect()
        })
        .collect();
    assert!(!rows.is_empty(), "{document} has no table {head}");
    rows
}

/// Whether `printed` is `value` rounded to the digits that are printed.
#[track_caller]
fn same(printed: &str, value: f64, what: &str) {
    let number: f64 = printed
        .parse()
        .unwrap_or_else(|_| panic!("{what}: {printed}"));
    let mantissa = printed.split('e').next().unwrap_or_default();
    let digits = mantissa.trim_start_matches(['0', '.', '-']);
    let count = digits.chars().filter(char::is_ascii_digit).count().max(1);
    let rounded: f64 = format!("{value:.*e}", count - 1).parse().unwrap();
    assert!(
        (number - rounded).abs() <= 1e-9 * rounded.abs(),
        "{what}: {printed} is printed, the program says {value:e}"
    );
}

#[test]
fn the_readmes_table_is_the_demos() {
    let result = json(&folder("docs_demo"), &["demo", "--out", "out"]);
    let cases = result["cases"].as_array().unwrap();
    let rows = table("README.md", "| case | plant |");
    assert_eq!(rows.len(), cases.len());
    for (row, case) in rows.iter().zip(cases) {
        let [_, plant, force, tip, outcome] = row.as_slice() else {
            panic!("{row:?}");
        };
        let name = format!("{} {}", case["case"], case["plant"]);
        let nominal = case["plant"] == "nominal";
        assert_eq!(plant == "nominal", nominal, "{name}");
        same(force, case["force_error_rms_N"].as_f64().unwrap(), &name);
        same(tip, case["tip_error_max_m"].as_f64().unwrap(), &name);
        assert_eq!(outcome.replace(' ', "_"), case["outcome"], "{name}");
    }
}

#[test]
fn the_table_of_what_feedback_is_worth_is_what_run_gives() {
    let folder = folder("docs_gains");
    for (row, start) in table("docs/gains.md", "| start | force error")
        .iter()
        .zip(["equilibrium", "plan-at-rest"])
    {
        let run = |mode: &str| {
            json(
                &folder,
                &[
                    "run",
                    "--ideal",
                    "--bending-stiffness-scale",
                    "0.9",
                    "--plant-elements",
                    "3",
                    "--start",
                    start,
                    "--mode",
                    mode,
                    "--out",
                    "out",
                ],
            )
        };
        let (with, without) = (run("proposed"), run("feedforward"));
        let figure = |summary: &Value, key: &str| summary[key].as_f64().unwrap();
        let unaided = row[2].split(' ').next().unwrap_or_default();
        same(&row[1], figure(&with, "force_error_rms_N"), &row[0]);
        same(unaided, figure(&without, "force_error_rms_N"), &row[0]);
        same(&row[3], 1e3 * figure(&with, "tip_error_rms_m"), &row[0]);
        same(&row[4], 1e3 * figure(&without, "tip_error_rms_m"), &row[0]);
    }
}

#[test]
fn the_tables_of_fixed_point_are_what_accuracy_says() {
    let hybrid = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/controller.toml");
    let with_hybrid = ["accuracy", "--out", "out", "--controller", hybrid];
    accuracy_table(
        "| number, hybrid law | trial |",
        &json(&folder("docs_hybrid"), &with_hybrid),
    );
    let result = json(&folder("docs_accuracy"), &["accuracy", "--out", "out"]);
    accuracy_table("| number | trial |", &result);
    formats_table(&result);
}

/// Compares a table of errors with what `flexor accuracy` said.
fn accuracy_table(head: &str, result: &Value) {
    for row in table("docs/fixed-point.md", head) {
        let [number, trial, rms, largest, saturations] = row.as_slice() else {
            panic!("{row:?}");
        };
        let figures = &result[number.as_str()];
        let figures = match trial {
            trial if trial.contains("random") => &figures["random"],
            trial if trial.contains("adversarial") => &figures["adversarial"],
            _ => figures,
        };
        let figure = |key: &str| figures[key].as_f64().unwrap();
        same(rms, figure("torque_error_rms_Nm"), trial);
        same(largest, figure("torque_error_max_Nm"), trial);
        if !saturations.is_empty() {
            assert_eq!(saturations, &figures["saturations"].to_string(), "{trial}");
        }
    }
}

/// Compares the table of ranges with what `flexor accuracy` said.
fn formats_table(result: &Value) {
    let signals = [
        "torque1",
        "torque2",
        "force",
        "root_slope",
        "slope_rate",
        "moment_arm",
    ];
    let rows = table("docs/fixed-point.md", "| signal | admissible |");
    assert_eq!(rows.len(), signals.len());
    for (row, signal) in rows.iter().zip(signals) {
        let format = &result["formats"][signal];
        let figure = |key: &str| format[key].as_f64().unwrap();
        let admissible = row[1].split(' ').next().unwrap_or_default();
        same(admissible, figure("admissible"), signal);
        same(&row[2], figure("range"), signal);
        same(&row[3], figure("resolution"), signal);
    }
}

/// Every file that is named with its folder, in a link or between backticks, is there.
#[test]
fn every_file_that_is_named_exists() {
    let mut named = 0;
    for document in documents() {
        let text = read(&document);
        let folder = root().join(Path::new(&document).parent().unwrap());
        let links = text
            .split("](")
            .skip(1)
            .map(|rest| (true, rest.split(')').next()));
        let quoted = text
            .split('`')
            .skip(1)
            .step_by(2)
            .map(|word| (false, Some(word)));
        for (link, name) in links.chain(quoted) {
            let name = name
                .unwrap_or_default()
                .split('#')
                .next()
                .unwrap_or_default();
            let source = [
                "shared/",
                "host-sim/",
                "firmware/",
                "xtask/",
                "docs/",
                "examples/",
                "boards/",
                "tests/",
            ];
            let file = !link && source.iter().any(|place| name.starts_with(place));
            let elsewhere = name.is_empty() || name.contains("://") || name.contains(' ');
            if elsewhere || !(link || file) || name.contains(['*', '{', '<']) {
                continue;
            }
            let path = if link {
                folder.join(name)
            } else {
                root().join(name)
            };
            assert!(path.exists(), "{document} names {name}, which is not there");
            named += 1;
        }
    }
    assert!(named >= 50, "{named}");
}

#[test]
fn the_wiring_is_that_of_the_default_board() {
    let board = parse_board("board", DEFAULT_BOARD).unwrap().parameters;
    let document = read("docs/firmware.md").replace('\n', " ");
    let [force, slope] = [board.force_range_n, board.gauge_range_rad];
    let [first, second] = board.drive_full_scale_nm;
    let [limit1, limit2] = board.drive_limit_nm();
    for words in [
        format!("{} lines, 3.3 V", board.encoder_lines[0]),
        format!("0 to 3.3 V for {} to {} N |", force[0], force[1]),
        format!("0 to 3.3 V for {} to {} rad |", slope[0], slope[1]),
        format!("for -{first} to {first} N m, -{second} to {second} N m;"),
        format!("at most {limit1:.0} and {limit2:.1} N m |"),
        format!("within {} counts", board.rail_counts),
        format!("no request for {} ms", 1e3 * board.link_timeout_s),
    ] {
        assert!(document.contains(&words), "no {words:?}");
    }
}

/// What a scenario's number accepts, as docs/bench.md says it.
fn accepted(key: &Key) -> String {
    let short = |x: f64| match x.abs() {
        size if size == 0.0 || (1e-2..1e4).contains(&size) => format!("{x}"),
        _ => format!("{x:e}"),
    };
    let above = if key.above { "above " } else { "" };
    let whole = if key.whole { " (whole)" } else { "" };
    format!("{above}{} to {}{whole}", short(key.low), short(key.high))
}

#[test]
fn the_scenarios_numbers_are_all_explained() {
    let rows = table("docs/bench.md", "| number | accepts |");
    let keys: Vec<&Key> = KEYS.iter().copied().flatten().collect();
    for (row, key) in rows.iter().zip(&keys) {
        let [name, accepts, means] = row.as_slice() else {
            panic!("{row:?}");
        };
        let wanted = (format!("`{}`", key.name), accepted(key));
        assert_eq!((name, accepts), (&wanted.0, &wanted.1));
        assert!(means.len() > 10, "{name}: {means}");
    }
    assert_eq!(rows.len(), keys.len());
}

#[test]
fn every_fault_has_its_section() {
    let document = read("docs/faults.md");
    for fault in flexor::fault::Fault::ALL {
        let heading = format!("\n## {} {}\n", fault.number(), fault.name());
        assert!(document.contains(&heading), "no section{heading}");
    }
    let sections = document.matches("**Cause.**").count();
    assert_eq!(sections, flexor::fault::Fault::ALL.len());
}

/// The figures of the first compiler in a budget that has them all.
fn measured(budget: &str) -> toml::Table {
    let budget: toml::Table = read(budget).parse().unwrap();
    let compilers = budget["measured"].as_table().unwrap();
    compilers
        .values()
        .next()
        .unwrap()
        .as_table()
        .unwrap()
        .clone()
}

/// A number as documents show it: thousands apart.
fn with_commas(number: &toml::Value) -> String {
    let digits = number.as_integer().unwrap().to_string();
    let parts: Vec<&[u8]> = digits.as_bytes().rchunks(3).rev().collect();
    let parts = parts.iter().map(|part| std::str::from_utf8(part).unwrap());
    parts.collect::<Vec<_>>().join(",")
}

#[test]
fn the_ticks_figures_are_the_budgets() {
    let figures = measured("firmware/budget.toml");
    let document = read("docs/firmware.md").replace('\n', " ");
    let sentence = format!(
        "takes {} instructions in the median and {} at most",
        with_commas(&figures["tick_instructions_median"]),
        with_commas(&figures["tick_instructions_max"])
    );
    assert!(document.contains(&sentence), "no {sentence:?}");

    let figures = measured("firmware/replay/budget.toml");
    let document = read("docs/fixed-point.md");
    for core in ["m0", "m3"] {
        for (number, shown) in [("fixed", "fixed"), ("float", "f32")] {
            let of = |what: &str| with_commas(&figures[&format!("{core}_{number}_{what}")]);
            let row = format!(
                "| {shown} | {} | {} | {} | {} | {} |",
                of("instructions_median"),
                of("instructions_max"),
                of("tick_flash_bytes"),
                of("controller_bytes"),
                of("stack_bytes")
            );
            assert!(document.contains(&row), "no {row:?}");
            let row = format!(
                "| {shown}, hybrid law | {} | {} | | | |",
                of("hybrid_instructions_median"),
                of("hybrid_instructions_max")
            );
            assert!(document.contains(&row), "no {row:?}");
        }
    }
}

//! A results folder is one unit: whatever happens to a command, what is beside `summary.json`
//! belongs to it, an older result is neither mixed with nor taken for a newer one, and two
//! commands do not write into one folder.
#![cfg(unix)] // kill(1) and ulimit.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const ARM: &str = include_str!("../examples/arm.toml");
const TASK: &str = include_str!("../examples/task.toml");

/// A folder of its own for a test, empty at its start.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_flexor"));
    command.args(arguments);
    command
}

fn flexor(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

#[track_caller]
fn succeeds(arguments: &[&str]) {
    let output = flexor(arguments);
    assert!(output.status.success(), "{arguments:?}: {output:?}");
}

/// Checks exit code and that there is one line with all `words`.
#[track_caller]
fn fails(output: &Output, code: i32, words: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for word in words {
        assert!(message.contains(word), "no {word:?} in {message}");
    }
}

/// Every file below a folder with its bytes, but for `.flexor`.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(inner).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if !path.ends_with(".flexor") {
                let name = path.strip_prefix(folder).unwrap().to_path_buf();
                found.insert(name, fs::read(path).unwrap());
            }
        }
    }
    found
}

/// Names of the files of a plan.
const PLANS: [&str; 5] = [
    "plan.csv",
    "report.html",
    "stick_figure.svg",
    "summary.json",
    "table.bin",
];

/// Names of the files right in a folder.
fn names(folder: &Path) -> Vec<String> {
    let files = files(folder).into_keys();
    let own = files.filter(|name| name.components().count() == 1);
    own.map(|name| name.to_str().unwrap().to_string()).collect()
}

/// Checks that everything beside `summary.json`, if that is there, belongs to it; the number of
/// planned ticks then.
#[track_caller]
fn whole(out: &Path) -> Option<u64> {
    let text = fs::read_to_string(out.join("summary.json")).ok()?;
    let summary: Value = serde_json::from_str(&text).unwrap();
    let ticks = summary["plan_ticks"].as_u64().unwrap();
    for name in ["plan.csv", "run.csv"] {
        // One row a tick and the last, after the head.
        match fs::read_to_string(out.join(name)) {
            Ok(csv) => assert_eq!(csv.lines().count() as u64, ticks + 2, "{name}"),
            Err(error) => assert!(name == "run.csv", "{name}: {error}"),
        }
    }
    let table = fs::metadata(out.join("table.bin")).unwrap().len();
    assert_eq!(Some(table), summary["table_bytes"].as_u64());
    Some(ticks)
}

/// The example task with other words.
fn task(folder: &Path, name: &str, from: &str, to: &str) -> String {
    assert!(TASK.contains(from));
    let file = folder.join(name);
    fs::write(&file, TASK.replacen(from, to, 1)).unwrap();
    file.to_str().unwrap().to_string()
}

/// A run that takes long, once it has taken its folder.
fn long_run(folder: &Path, out: &Path) -> Child {
    let long = task(
        folder,
        "long.toml",
        "duration_s = 2.0",
        "duration_s = 150.0",
    );
    let child = command(&["run", "--task", &long, "--out", out.to_str().unwrap()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let since = Instant::now();
    while !out.join(".flexor-partial").exists() {
        assert!(since.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

fn kill(child: &Child, signal: &str) {
    let pid = child.id().to_string();
    let status = Command::new("kill").args([signal, &pid]).status().unwrap();
    assert!(status.success());
}

/// Whether this process, and so what it starts, lets hang-ups pass: then commands do not handle
/// signals.
fn hangup_is_ignored() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.is_some_and(|mask| u64::from_str_radix(mask.trim(), 16).unwrap() & 1 != 0)
}

#[test]
fn a_refused_command_moves_the_older_result_and_nobody_elses_files() {
    let root = folder("folder_refused");
    let out = root.join("out");
    let path = out.to_str().unwrap();
    succeeds(&["run", "--out", path]);
    let older = files(&out);
    assert!(older.contains_key(Path::new("run.csv")) && whole(&out) == Some(10_000));
    fs::write(out.join("notes.txt"), "mine").unwrap();

    let hard = task(
        &root,
        "hard.toml",
        "to_m = [0.2, 0.05]",
        "to_m = [1.2, 0.05]",
    );
    for _ in 0..2 {
        let refused = flexor(&["run", "--task", &hard, "--out", path]);
        fails(&refused, 2, &["1.2000", "unreachable"]);
        assert_eq!(names(&out), ["notes.txt"]);
        // The second one, after which there was nothing to move, leaves it there.
        assert_eq!(files(&out.join("previous")), older);
    }

    // The next result has the folder to itself again, and a result after it takes its place.
    succeeds(&["run", "--out", path]);
    succeeds(&["plan", "--out", path, "--tick-rate-hz", "1000"]);
    assert_eq!(whole(&out), Some(2000));
    let expected = [&["notes.txt"], &PLANS[..]].concat();
    assert_eq!(names(&out), expected);
    assert_eq!(whole(&out.join("previous")), Some(10_000));
}

#[test]
fn a_refused_command_leaves_no_trace_where_nothing_was() {
    let root = folder("folder_new");
    let out = root.join("a/b");
    let arguments = ["plan", "--arm", "/nowhere.toml", "--out"];
    let refused = flexor(&[&arguments[..], &[out.to_str().unwrap()]].concat());
    fails(&refused, 2, &["/nowhere.toml"]);
    assert!(!root.join("a").exists());
    let refused = flexor(&[&arguments[..], &[root.to_str().unwrap()]].concat());
    fails(&refused, 2, &["/nowhere.toml"]);
    assert_eq!(fs::read_dir(&root).unwrap().count(), 0);
}

#[test]
fn a_command_can_read_what_lies_in_its_folder() {
    let root = folder("folder_inputs");
    let out = root.join("out");
    let (path, table) = (out.to_str().unwrap(), out.join("table.bin"));
    let run = |arm: &str| {
        let table = table.to_str().unwrap();
        flexor(&["run", "--arm", arm, "--table", table, "--out", path])
    };
    let (arm, other) = (root.join("arm.toml"), root.join("other.toml"));
    fs::write(&arm, ARM).unwrap();
    fs::write(&other, ARM.replacen("0.24", "0.25", 1)).unwrap();
    succeeds(&["plan", "--out", path]);
    let image = fs::read(&table).unwrap();
    for _ in 0..2 {
        fails(
            &run(other.to_str().unwrap()),
            2,
            &["table.bin", "planned for arm"],
        );
        // What it read stays; what would be taken for its result goes.
        assert_eq!(names(&out), ["table.bin"]);
        assert_eq!(fs::read(&table).unwrap(), image);
    }
    let output = run(arm.to_str().unwrap());
    assert!(output.status.success(), "{output:?}");
    assert_eq!(fs::read(&table).unwrap(), image);
    assert_eq!(whole(&out), Some(10_000));
}

#[test]
fn a_second_writer_is_refused_and_a_signal_leaves_the_older_result() {
    let root = folder("folder_signals");
    let out = root.join("out");
    let path = out.to_str().unwrap();
    succeeds(&["run", "--out", path]);
    let older = files(&out);
    let fresh = root.join("fresh/out");
    for signal in ["-INT", "-TERM", "-HUP"] {
        let child = long_run(&root, &out);
        for command in ["plan", "run", "demo", "gains", "accuracy"] {
            fails(
                &flexor(&[command, "--out", path]),
                2,
                &[path, "another command is writing", "--out"],
            );
        }
        kill(&child, signal);
        let output = child.wait_with_output().unwrap();
        if hangup_is_ignored() {
            return;
        }
        fails(&output, 130, &["interrupted", path]);
        assert!(!out.join(".flexor-partial").exists());
        assert_eq!(files(&out), older, "{signal}");
        // And where there was nothing, there is nothing.
        let child = long_run(&root, &fresh);
        kill(&child, signal);
        fails(&child.wait_with_output().unwrap(), 130, &["interrupted"]);
        assert!(!root.join("fresh").exists());
    }
    succeeds(&["run", "--out", path]);
    assert_eq!(whole(&out), Some(10_000));
}

#[test]
fn what_a_killed_command_leaves_goes_with_the_next() {
    let root = folder("folder_killed");
    let out = root.join("out");
    let path = out.to_str().unwrap();
    succeeds(&["plan", "--out", path]);
    let older = files(&out);
    let mut child = long_run(&root, &out);
    fs::write(out.join(".flexor-partial/half.csv"), "1,2,").unwrap();
    kill(&child, "-KILL");
    assert_eq!(child.wait().unwrap().signal(), Some(9));
    let mut now = files(&out);
    now.retain(|name, _| !name.starts_with(".flexor-partial"));
    assert_eq!(now, older);
    succeeds(&["plan", "--out", path, "--tick-rate-hz", "1000"]);
    assert!(!out.join(".flexor-partial").exists());
    assert_eq!(names(&out), PLANS);
    assert_eq!(whole(&out), Some(2000));
}

#[test]
fn a_kill_at_any_moment_leaves_a_whole_result_or_none() {
    let root = folder("folder_kills");
    let out = root.join("out");
    let path = out.to_str().unwrap();
    let mut seen = BTreeMap::new();
    for number in 0..60_u32 {
        let rate = ["1000", "2000"][number as usize % 2];
        let mut child = command(&["plan", "--out", path, "--tick-rate-hz", rate])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // From the moment when it begins to write in steps of a part of what that takes.
        let since = Instant::now();
        while !out.join(".flexor-partial/summary.json").exists()
            && child.try_wait().unwrap().is_none()
        {
            assert!(since.elapsed() < Duration::from_secs(60));
        }
        std::thread::sleep(Duration::from_micros(u64::from(number) * 100));
        let _ = child.kill();
        child.wait().unwrap();
        *seen.entry(whole(&out)).or_insert(0) += 1;
    }
    assert!(seen.keys().any(Option::is_some), "{seen:?}");
    succeeds(&["plan", "--out", path]);
    assert_eq!(names(&out), PLANS);
    assert_eq!(whole(&out), Some(10_000));
}

#[test]
fn of_two_commands_in_one_folder_one_whole_result_is_left() {
    let root = folder("folder_parallel");
    let fast = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/task_fast.toml");
    for number in 0..6 {
        let out = root.join(number.to_string());
        let path = out.to_str().unwrap();
        let start = |arguments: &[&str]| {
            command(&[&["run", "--out", path], arguments].concat())
                .stdout(Stdio::null())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap()
        };
        let first = start(&[]);
        std::thread::sleep(Duration::from_millis(40 * number));
        let second = start(&["--task", fast]);
        let ends = [first, second].map(|child| child.wait_with_output().unwrap());
        let good = ends.iter().filter(|end| end.status.success()).count();
        assert!(good >= 1, "{ends:?}");
        for end in ends.iter().filter(|end| !end.status.success()) {
            fails(end, 2, &["another command is writing"]);
        }
        assert!(whole(&out).is_some());
    }
}

#[test]
fn a_full_disk_leaves_nothing_half_written() {
    let root = folder("folder_full");
    let out = root.join("out");
    let path = out.to_str().unwrap();
    succeeds(&["run", "--out", path]);
    let older = files(&out);
    // No file longer than 512 KiB, and an error instead of a signal.
    let script = "trap '' XFSZ; ulimit -f 1024; exec \"$0\" \"$@\"";
    let program = env!("CARGO_BIN_EXE_flexor");
    let output = Command::new("sh")
        .args(["-c", script, program, "run", "--out", path])
        .output()
        .unwrap();
    fails(&output, 1, &["out/plan.csv", "cannot be written"]);
    assert!(names(&out).is_empty() && !out.join(".flexor-partial").exists());
    assert_eq!(files(&out.join("previous")), older);
}

#[test]
fn a_demos_folders_are_part_of_its_result() {
    let root = folder("folder_demo");
    let out = root.join("out");
    let path = out.to_str().unwrap();
    let short = task(&root, "short.toml", "duration_s = 2.0", "duration_s = 1.5");
    succeeds(&["demo", "--task", &short, "--out", path]);
    let inner = "proposed_stiffness_x0.9/summary.json";
    assert!(out.join(inner).exists());
    succeeds(&["plan", "--out", path]);
    assert_eq!(names(&out), PLANS);
    assert!(!out.join("proposed_stiffness_x0.9").exists());
    assert!(out.join("previous").join(inner).exists());
}

//! Results say what they were made from, and equal commands leave equal files.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("provenance")
        .join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// Runs the program in the project's folder, with its results in `out`.
fn flexor(arguments: &[&str], out: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_flexor"))
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .args(arguments)
        .args(["--out", out.to_str().unwrap()])
        .output()
        .unwrap()
}

fn done(arguments: &[&str], out: &Path) -> Output {
    let output = flexor(arguments, out);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {message}");
    output
}

/// Every file below a folder with its bytes; what is kept of results before is left out.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    found
}

const SCENARIO: [&str; 2] = ["--scenario", "examples/scenarios/bench.toml"];
const PAPER: [&str; 2] = ["--controller", "examples/controller_paper.toml"];

/// A command line of every command that leaves files and needs nothing but the host.
fn commands() -> Vec<(&'static str, Vec<&'static str>)> {
    let line = |parts: &[&[&'static str]]| parts.concat();
    vec![
        ("plan", vec!["plan", "--task", "examples/task_fast.toml"]),
        ("move", vec!["plan", "--task", "examples/task_park.toml"]),
        ("demo", vec!["demo"]),
        (
            "ideal",
            vec!["run", "--ideal", "--plant", "examples/plant_soft.toml"],
        ),
        ("bench", line(&[&["run"], &SCENARIO])),
        ("campaign", line(&[&["campaign", "--runs", "6"], &SCENARIO])),
        (
            "only",
            line(&[&["campaign", "--runs", "6", "--only", "2"], &SCENARIO]),
        ),
        ("accuracy", vec!["accuracy"]),
        ("gains", line(&[&["gains"], &PAPER])),
        ("proof", vec!["gains"]),
        ("design", vec!["gains", "design"]),
    ]
}

#[test]
fn equal_commands_leave_equal_files() {
    let place = folder("equal");
    for (name, arguments) in commands() {
        // The second one elsewhere, and with another output.
        let [first, second] = ["first", "second"].map(|of| place.join(of).join(name));
        done(&arguments, &first);
        done(&[&arguments[..], &["--json"]].concat(), &second);
        let [first, second] = [first, second].map(|out| {
            let named = files(&out).into_iter();
            named
                .map(|(path, bytes)| (path.strip_prefix(&out).unwrap().to_path_buf(), bytes))
                .collect::<BTreeMap<_, _>>()
        });
        assert!(first.keys().eq(second.keys()), "{name}: {:?}", first.keys());
        for (file, bytes) in &first {
            assert!(bytes == &second[file], "{name}: {} differs", file.display());
        }
        let pages = first
            .keys()
            .filter(|file| file.ends_with("report.html"))
            .count();
        let page = !["proof", "design"].contains(&name);
        assert_eq!(pages, usize::from(page), "{name}");
    }
}

#[test]
fn every_summary_and_page_says_what_it_is_made_from() {
    let place = folder("said");
    for (name, arguments) in commands() {
        let out = place.join(name);
        let output = done(&[&arguments[..], &["--json"]].concat(), &out);
        let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
        for (file, bytes) in files(&out) {
            if file.extension().is_none_or(|extension| extension != "json") {
                continue;
            }
            let written: Value = serde_json::from_slice(&bytes).unwrap();
            assert_eq!(written["schema_version"], 1, "{}", file.display());
            if !file.ends_with("summary.json") {
                continue;
            }
            assert!(written.get("timing").is_none(), "{name}");
            let from = &written["provenance"];
            assert_eq!(from["version"], env!("CARGO_PKG_VERSION"), "{name}");
            let commit = from["commit"].as_str().unwrap();
            let hex = commit.trim_end_matches('+');
            let is_hex = hex.len() == 8 && u32::from_str_radix(hex, 16).is_ok();
            assert!(is_hex || commit == "unknown", "{name}: {commit}");
            assert!(
                from["command"].as_str().unwrap().starts_with("flexor "),
                "{name}"
            );
            let inputs = from["inputs"].as_array().unwrap();
            assert!(
                inputs.iter().any(|input| input["option"] == "arm"),
                "{name}"
            );
            if name != "plan" && name != "move" {
                assert!(from["gains"]["law"].is_string(), "{name}: {from}");
            }
        }
        // As `--json` prints it, but for how long it took.
        assert!(printed["timing"].is_object(), "{name}");
        let written = fs::read(out.join("summary.json")).unwrap();
        let written: Value = serde_json::from_slice(&written).unwrap();
        let mut untimed = printed.clone();
        untimed.as_object_mut().unwrap().remove("timing");
        assert_eq!(untimed, written, "{name}");
        if let Ok(page) = fs::read_to_string(out.join("report.html")) {
            let page = page.replace("&#x2f;", "/");
            let command = written["provenance"]["command"].as_str().unwrap();
            let commit = written["provenance"]["commit"].as_str().unwrap();
            for text in [command, commit, "SHA-256 "] {
                assert!(page.contains(text), "{name}: no {text:?} in the page");
            }
        }
    }
}

#[test]
fn inputs_are_named_with_the_hash_that_sha256sum_prints() {
    let place = folder("hash");
    let task = place.join("task.toml");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/task_fast.toml");
    fs::copy(example, &task).unwrap();
    let out = place.join("out");
    let inputs = |out: &Path| {
        let text = fs::read(out.join("summary.json")).unwrap();
        let summary: Value = serde_json::from_slice(&text).unwrap();
        summary["provenance"]["inputs"].as_array().unwrap().clone()
    };
    let named = |out: &Path| {
        let all = inputs(out);
        let task = all.iter().find(|input| input["option"] == "task");
        task.unwrap().clone()
    };
    let file = task.to_str().unwrap();
    done(&["plan", "--task", file], &out);
    let planned = named(&out);
    assert_eq!(planned["file"], file);
    if let Ok(output) = Command::new("sha256sum").arg(&task).output() {
        let sum = String::from_utf8(output.stdout).unwrap();
        assert_eq!(planned["sha256"], sum.split(' ').next().unwrap());
    }
    // Of the bench the same, and of another text another.
    done(&["run", "--task", file], &out);
    assert_eq!(named(&out), planned);
    fs::write(&task, fs::read_to_string(&task).unwrap() + "# more\n").unwrap();
    done(&["plan", "--task", file], &out);
    assert_ne!(named(&out)["sha256"], planned["sha256"]);
    done(&["plan"], &out);
    assert_eq!(named(&out)["file"], "built in");
}

#[test]
fn shards_of_different_programs_are_not_merged() {
    let place = folder("shards");
    let shards = ["1/2", "2/2"].map(|shard| {
        let out = place.join(&shard[..1]);
        let line = ["campaign", "--runs", "4", "--shard", shard];
        done(&[&line[..], &SCENARIO].concat(), &out);
        out
    });
    let folders = shards.each_ref().map(|out| out.to_str().unwrap());
    let merge = ["campaign", "merge", folders[0], folders[1]];
    done(&merge, &place.join("whole"));
    let file = shards[1].join("campaign.json");
    let mut identity: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    identity["commit"] = "01234567".into();
    fs::write(&file, identity.to_string()).unwrap();
    let output = flexor(&merge, &place.join("whole"));
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    for words in [
        "different campaigns",
        "made by programs of commit",
        "01234567",
    ] {
        assert!(message.contains(words), "no {words:?} in {message}");
    }
}

#[test]
fn shells_and_man_know_every_command() {
    let place = folder("shell");
    let program = env!("CARGO_BIN_EXE_flexor");
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let output = Command::new(program).args(["completions", shell]).output();
        let output = output.unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{shell}");
        for word in ["campaign", "accuracy", "limit", "design"] {
            assert!(text.contains(word), "{shell}: no {word}");
        }
    }
    let refused = Command::new(program).args(["completions", "sh"]).output();
    assert_eq!(refused.unwrap().status.code(), Some(2));
    done(&["man"], &place);
    let page = |name: &str| fs::read_to_string(place.join(name)).unwrap();
    assert!(page("flexor.1").contains("flexor\\-campaign(1)"));
    assert!(page("flexor-accuracy.1").contains("JOINT1"));
}

#[test]
fn accuracy_is_judged_joint_by_joint() {
    let place = folder("limit");
    let run = |limits: [&str; 2]| {
        let line = ["accuracy", "--json", "--limit", limits[0], limits[1]];
        flexor(&line, &place.join("out"))
    };
    let verdicts = |output: &Output| -> Vec<bool> {
        let told: Value = serde_json::from_slice(&output.stdout).unwrap();
        let list = told["limits"].as_array().unwrap();
        list.iter()
            .map(|entry| entry["holds"].as_bool().unwrap())
            .collect()
    };
    let wide = run(["1e-3", "1e-4"]);
    assert_eq!(wide.status.code(), Some(0));
    assert_eq!(verdicts(&wide), [true; 4]);
    // Joint 2 alone is off by more than that.
    let tight = run(["1e-3", "1e-9"]);
    assert_eq!(tight.status.code(), Some(3));
    assert_eq!(verdicts(&tight), [true, false, true, false]);
    let message = String::from_utf8_lossy(&tight.stderr);
    for words in [
        "f32, closed loop: torque 2 is off by",
        "fixed, closed loop: torque 2",
        "--limit",
    ] {
        assert!(message.contains(words), "no {words:?} in {message}");
    }
    assert!(!message.contains("torque 1"), "{message}");
    let page = fs::read_to_string(place.join("out/report.html")).unwrap();
    assert!(page.contains("Not within its bounds and limits: f32, closed loop: torque 2"));
    for limits in [["0", "1"], ["1", "-1"], ["nan", "1"]] {
        let refused = run(limits);
        let message = String::from_utf8_lossy(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{message}");
        assert!(
            message.contains("accepted: two torques in N m above 0"),
            "{message}"
        );
    }
}

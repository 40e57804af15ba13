//! Moves through the air, from the file to where the bench's arms are parked.

use super::{flexor, folder, json, refused};
use std::fs;
use std::path::Path;

/// A file of the examples.
fn example(name: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    root.join("examples").join(name).display().to_string()
}

#[test]
fn every_arm_moves_to_the_start_and_is_parked_after_the_path() {
    let place = folder("moves");
    let out = place.display().to_string();
    let gains = example("controller_hub.toml");
    let campaign = |scenario: &str, more: &[&str]| {
        let scenario = example(&format!("scenarios/{scenario}"));
        let common = [
            "campaign",
            "--scenario",
            &scenario,
            "--controller",
            &gains,
            "--runs",
            "40",
            "--seed",
            "5",
            "--json",
            "--out",
            &out,
        ];
        let result = json(&flexor(&[&common[..], more].concat()));
        assert_eq!(result["failed"], 0, "{more:?}");
        move |key: &str| result[key]["max"].as_f64().unwrap()
    };
    let to_start = example("task_to_start.toml");
    let most = campaign("bench.toml", &["--task", &to_start]);
    // Nothing is touched.
    assert_eq!(most("force_max_N"), 0.0);
    assert!(most("along_error_max_m") < 0.04);
    let park = example("task_park.toml");
    let most = campaign("approach.toml", &["--then", &park]);
    let off = most("parked_off_m");
    assert!(off > 0.0 && off < 0.02, "{off}");
    // On the way to where it is parked nothing is touched again.
    assert!(most("after_force_max_N") < 2.5);
}

#[test]
fn a_run_shows_every_phase_from_approach_to_park() {
    let place = folder("moves_run");
    let out = place.display().to_string();
    let (scenario, park) = (
        example("scenarios/approach.toml"),
        example("task_park.toml"),
    );
    let arguments = [
        "run",
        "--scenario",
        &scenario,
        "--then",
        &park,
        "--out",
        &out,
        "--json",
    ];
    let result = json(&flexor(&arguments));
    assert_eq!(result["outcome"], "completed");
    let rows = fs::read_to_string(place.join("run.csv")).unwrap();
    let column = rows
        .lines()
        .next()
        .unwrap()
        .split(',')
        .position(|name| name == "phase");
    let phases = rows
        .lines()
        .skip(1)
        .map(|row| row.split(',').nth(column.unwrap()).unwrap());
    let mut phases: Vec<&str> = phases.collect();
    phases.dedup();
    // Approach, contact, follow, retract, hold, free, park.
    assert_eq!(phases, ["1.0", "2.0", "3.0", "5.0", "6.0", "0.0", "7.0"]);
}

#[test]
fn moves_are_refused_where_they_have_no_sense() {
    let place = folder("moves_refused");
    let file = place.join("move.toml").display().to_string();
    let write = |of_move: &str| {
        fs::write(&file, format!("duration_s = 1.0\n[move]\n{of_move}\n")).unwrap();
    };
    let plan = ["plan", "--task", &file];
    write("from_rad = [1.0, 0.0]");
    refused(
        &plan,
        2,
        &["move.to_rad: missing", "move.to_motor_rad or move.to_task"],
    );
    write("from_rad = [1.0, 0.0]\nto_rad = [1.0, 0.1]\nto_motor_rad = [1.0, 0.1]");
    refused(&plan, 2, &["more than one of", "move.to_rad"]);
    write("from_rad = [1.0, 30.0]\nto_rad = [1.0, 0.1]");
    refused(&plan, 2, &["move.from_rad", "30"]);
    write("from_rad = [1.0, 0.0]\nto_task = \"none.toml\"");
    refused(&plan, 2, &["none.toml"]);
    write("from_rad = [1.0, 0.0]\nto_rad = [1.0, 0.0]");
    refused(&plan, 2, &["same angles"]);
    write("from_rad = [1.0, 0.0]\nto_rad = [1.1, 0.0]\nforce_N = 1.0");
    refused(&plan, 2, &["force_N"]);
    write("from_rad = [1.0, 0.0]\nto_rad = [1.1, 0.0]");
    for command in ["accuracy", "demo"] {
        refused(&[command, "--task", &file], 2, &["move through the air"]);
    }
    refused(
        &["gains", "design", "--task", &file],
        2,
        &["presses nowhere"],
    );
    refused(&["run", "--ideal", "--task", &file], 2, &["rigid surface"]);
    let task = example("task.toml");
    refused(&["run", "--then", &task], 2, &["--then", "[move]"]);
    let paper = example("controller_paper.toml");
    let park = example("task_park.toml");
    refused(
        &["run", "--then", &park, "--controller", &paper],
        2,
        &["law = \"paper\""],
    );
    let heavy = place.join("arm.toml").display().to_string();
    let arm = include_str!("../examples/arm.toml").replace("mass_kg = 0.24", "mass_kg = 0.3");
    fs::write(&heavy, arm).unwrap();
    refused(
        &["run", "--arm", &heavy, "--task", &file],
        2,
        &["--controller"],
    );
}

//! Campaigns with the hybrid law, and what knows the paper's law alone.

use crate::{campaign, flexor, folder, json, root, text};

/// A controller file of the examples.
fn example(name: &str) -> String {
    root().join("examples").join(name).display().to_string()
}

#[test]
fn the_hybrid_law_fails_on_no_arm_of_the_bench() {
    let place = folder("campaign_hybrid");
    let p95 = |more: &[&str]| {
        let arguments = [&["--runs", "40", "--seed", "5"], more].concat();
        let result = json(&campaign(&place, &arguments));
        assert_eq!(result["failed"], 0, "{more:?}");
        assert_eq!(result["contact_lost_s"]["max"], 0.0, "{more:?}");
        // On gains that were proved, as the summary says.
        assert_eq!(result["gains_stable"], true, "{more:?}");
        assert!(result["gains"]["torque_loop_per_s"].as_f64().unwrap() > 0.0);
        let value = |key: &str| result[key]["p95"].as_f64().unwrap();
        assert!(value("along_error_max_m") < 0.01, "{more:?}");
        value("force_error_rms_N")
    };
    let hub = example("controller_hub.toml");
    assert!(p95(&["--controller", &hub]) < 0.25);
    let any = example("controller.toml");
    let bare = ["--set", "plant.root_inertia_kgm2=0.0"];
    assert!(p95(&["--controller", &any]) < 0.27);
    assert!(p95(&[&["--controller", &any][..], &bare].concat()) < 0.27);
}

#[test]
fn from_above_the_surface_every_arm_finds_it_and_every_stop_is_short() {
    let place = folder("campaign_motion");
    let run = |scenario: &str, gains: &str| {
        let file = example(&format!("scenarios/{scenario}"));
        let out = place.join(scenario).join(gains).display().to_string();
        let gains = example(gains);
        let result = json(&flexor(&[
            "campaign",
            "--scenario",
            &file,
            "--controller",
            &gains,
            "--runs",
            "40",
            "--seed",
            "5",
            "--json",
            "--out",
            &out,
        ]));
        assert_eq!(result["failed"], 0, "{scenario} {gains}");
        result
    };
    for (gains, impact_n) in [("controller_hub.toml", 1.2), ("controller.toml", 1.6)] {
        let result = run("approach.toml", gains);
        let figure = |key: &str, of: &str| result[key][of].as_f64().unwrap();
        assert!(figure("approach_force_max_N", "p95") < impact_n, "{gains}");
        assert!(figure("touched_s", "median") < 2.0, "{gains}");
        // The path's errors have nothing of the approach.
        assert!(figure("force_error_rms_N", "p95") < 0.27, "{gains}");
        // At the end the tip is taken off, not dropped.
        assert!(figure("after_force_max_N", "max") < 2.5, "{gains}");

        let result = run("stop.toml", gains);
        let figure = |key: &str, of: &str| result[key][of].as_f64().unwrap();
        let (way, force) = (
            figure("after_way_m", "max"),
            figure("after_force_max_N", "max"),
        );
        // 0.7 m/s to nothing in 0.15 s are 51 mm.
        assert!(way > 0.04 && way < 0.065, "{gains}: {way}");
        assert!(force < 2.5, "{gains}: {force}");
        assert!(figure("after_speed_m_s", "max") < 0.015, "{gains}");
    }
}

/// The force profile of a task comes from a file of its own, and is a part of what a campaign is.
#[test]
fn a_campaign_along_another_force_is_another_campaign() {
    let place = folder("campaign_force");
    let ramp = std::fs::read_to_string(example("task_force_ramp.toml")).unwrap();
    let ramp = ramp.replace("profile_m_N", "# profile_m_N");
    let ramp = ramp.replace("# profile_csv", "profile_csv");
    let task = place.join("task.toml").display().to_string();
    std::fs::write(&task, ramp).unwrap();
    let run = |force: &str| {
        let way_points = format!("s_m,force_N\n0,1\n0.25,{force}\n0.5,2\n");
        std::fs::write(place.join("force.csv"), way_points).unwrap();
        let out = place.join("out");
        let result = json(&campaign(&out, &["--task", &task, "--runs", "2"]));
        assert_eq!(result["failed"], 0);
        let identity = std::fs::read_to_string(out.join("campaign.json")).unwrap();
        (result["force_max_N"]["max"].as_f64().unwrap(), identity)
    };
    let (low, first) = run("2");
    assert_eq!(run("2"), (low, first.clone()));
    let (high, other) = run("3");
    assert!(low < 2.5 && high > 2.8 && high < 3.5, "{low} {high}");
    assert_ne!(first, other);
}

#[test]
fn an_operators_stop_at_full_speed_is_no_fault_of_the_arm() {
    let place = folder("campaign_stop_fast");
    let scenario = example("scenarios/stop_fast.toml");
    let out = place.join("out").display().to_string();
    let result = json(&flexor(&[
        "campaign",
        "--scenario",
        &scenario,
        "--runs",
        "20",
        "--seed",
        "21",
        "--json",
        "--out",
        &out,
    ]));
    let outcomes = &result["outcomes"];
    assert_eq!(outcomes["completed"], 20, "{outcomes}");
    let most = |key: &str| result[key]["max"].as_f64().unwrap();
    assert!(most("after_way_m") < 0.253, "{}", most("after_way_m"));
    let force = most("after_force_max_N");
    assert!(force < 15.0, "{force}");
}

#[test]
fn what_knows_the_papers_law_alone_says_so() {
    let (place, law) = (folder("hybrid_refused"), example("controller.toml"));
    let out = place.join("out").display().to_string();
    for (arguments, words) in [
        (
            &["demo"][..],
            "law = \"hybrid\" is not known to `flexor demo` yet",
        ),
        (
            &["run", "--mode", "feedback"],
            "--mode feedback has no effect",
        ),
        (
            &["run", "--ideal", "--mode", "feedback"],
            "--mode feedback has no effect",
        ),
    ] {
        let output = flexor(&[arguments, &["--controller", &law, "--out", &out]].concat());
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(
            message.contains(words) && message.lines().count() == 1,
            "{message}"
        );
    }
    // In the ideal world it runs, in every number type, and as exactly as stated.
    for more in [
        &["run", "--ideal", "--require-completed"][..],
        &["run", "--ideal", "--require-completed", "--number", "fixed"],
        &["accuracy"],
    ] {
        let output = flexor(&[more, &["--out", &out, "--controller", &law]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
}

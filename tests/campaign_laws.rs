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
fn what_knows_the_papers_law_alone_says_so() {
    let (place, law) = (folder("hybrid_refused"), example("controller.toml"));
    let out = place.join("out").display().to_string();
    for (arguments, words) in [
        (
            &["gains"][..],
            "law = \"hybrid\" is not known to `flexor gains` yet",
        ),
        (
            &["demo"],
            "law = \"hybrid\" is not known to `flexor demo` yet",
        ),
        (
            &["accuracy"],
            "law = \"hybrid\" has no formats in fixed point yet",
        ),
        (
            &["run", "--ideal", "--number", "fixed"],
            "law = \"hybrid\" has no formats in fixed point yet",
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
    // In the ideal world it runs.
    let more = [
        "run",
        "--ideal",
        "--require-completed",
        "--out",
        &out,
        "--controller",
        &law,
    ];
    let output = flexor(&more);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

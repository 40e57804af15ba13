//! `flexor gains` and `flexor gains tune`, and what other commands say of gains.

use super::{flexor, folder, json, refused, text};
use std::path::Path;

/// A file of the examples.
fn example(name: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    root.join("examples").join(name).display().to_string()
}

/// Without it the light root of `run`'s finer plants bears no such K_w.
const FILTER: &str = "slope_rate_filter_Hz = 50.0\n";

/// A controller file with all four gains, and `more` lines.
fn controller(file: &Path, integral: f64, slope_rate: f64, more: &str) -> String {
    let text = format!(
        "K_DF_s = 0.0\nK_PF = 0.0\nK_IF_per_s = {integral:?}\nK_w_Nms_rad = {slope_rate:?}\n{more}\n"
    );
    std::fs::write(file, text).unwrap();
    file.to_str().unwrap().to_string()
}

#[test]
fn gains_are_judged_in_json_and_in_a_report() {
    let out = folder("gains");
    let path = out.to_str().unwrap();
    let law = example("controller_paper.toml");
    let arguments = [
        "gains",
        "--controller",
        &law,
        "--json",
        "--at",
        "0",
        "--out",
        path,
    ];
    let result = json(&flexor(&arguments));
    assert_eq!(result["stable"], true);
    assert_eq!(result["spread"]["stable"], true);
    assert_eq!(
        (&result["points"], &result["spread"]["plants"]),
        (&50.into(), &27.into())
    );
    let number = |key: &str| result[key].as_f64().unwrap();
    assert!(number("spectral_radius_max") < 1.0);
    assert!((0.0..=2.0).contains(&number("worst_t_s")));
    assert!(number("contact_damping_min") > 0.05);
    assert!(number("gain_margin_dB") >= 6.0 && number("delay_margin_ticks") >= 1.0);
    let poles = result["poles_per_s"].as_array().unwrap();
    assert_eq!(poles.len(), 14);
    assert!((poles[2][0].as_f64().unwrap() + 1.739).abs() < 1e-3);
    assert!((poles[2][1].as_f64().unwrap() - 34.486).abs() < 1e-3);
    for file in [
        "report.html",
        "summary.json",
        "gains_loci.svg",
        "gains_map.svg",
        "gains_margins.svg",
    ] {
        let size = std::fs::metadata(out.join(file)).unwrap().len();
        assert!(size > 500, "{file} has {size} bytes");
    }
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    // The charts' licence names where they come from; nothing is loaded from there.
    let page = page.replacen("https://github.com/leeoniya/uPlot", "", 1);
    for outside in ["http:", "https:", "src=", "href=", "url(", "fetch("] {
        assert!(!page.contains(outside), "the page contains {outside}");
    }
    assert_eq!(page.matches("<figure ").count(), 3);
}

#[test]
fn unstable_gains_are_told_by_gains_run_and_demo() {
    let out = folder("unstable");
    let file = |name: &str| out.join(name);
    let path = file("out");
    let path = path.to_str().unwrap();
    let printed = controller(
        &file("printed.toml"),
        5.0,
        0.05,
        &format!("{FILTER}force_projection = \"as-printed\""),
    );
    let result = json(&flexor(&[
        "gains",
        "--json",
        "--controller",
        &printed,
        "--out",
        path,
    ]));
    assert_eq!(result["stable"], false);
    assert!(result["spectral_radius_max"].as_f64().unwrap() > 1.0);
    assert!(
        result["worst_mode"]
            .as_str()
            .unwrap()
            .contains("integrator")
    );
    assert!(result["worst_t_s"].as_f64().unwrap() > 1.0);
    let transpose = controller(&file("transpose.toml"), 5.0, 0.05, FILTER);
    let result = json(&flexor(&[
        "gains",
        "--json",
        "--controller",
        &transpose,
        "--out",
        path,
    ]));
    assert_eq!(result["stable"], true);

    for command in ["run", "demo"] {
        let told = |controller: &str| {
            let output = flexor(&[command, "--json", "--controller", controller, "--out", path]);
            assert!(output.status.success() || command == "run");
            text(&output.stderr)
        };
        let words = told(&printed);
        assert!(
            words.contains("force_projection = \"jacobian-transpose\""),
            "{words}"
        );
        assert!(
            words.contains("warning: the gains are unstable")
                && words.contains("integrator")
                && words.contains("t = "),
            "{command}: {words}"
        );
        assert_eq!(told(&transpose), "", "{command}");
    }

    // K_w that the bare root does not bear: mode, point, and what would help.
    let shaking = controller(&file("shaking.toml"), 0.0, 0.05, "");
    let output = flexor(&[
        "gains",
        "--json",
        "--tick-rate-hz",
        "1000",
        "--controller",
        &shaking,
        "--out",
        path,
    ]);
    let words = text(&output.stderr);
    for word in ["root", "t = ", "K_w_Nms_rad up to", "a control rate of"] {
        assert!(words.contains(word), "no {word} in {words}");
    }
}

#[test]
fn gains_that_cannot_be_are_refused_by_name() {
    let out = folder("bad_gains");
    let path = out.join("out");
    let path = path.to_str().unwrap();
    let good = std::fs::read_to_string(controller(&out.join("good.toml"), 2.0, 0.1, "")).unwrap();
    for (from, to, name) in [
        ("K_IF_per_s = 2.0", "K_IF_per_s = -2.0", "K_IF_per_s = -2"),
        (
            "K_w_Nms_rad = 0.1",
            "K_w_Nms_rad = nan",
            "K_w_Nms_rad = NaN",
        ),
        ("K_PF = 0.0", "K_PF = 1e12", "K_PF = 1e12"),
        ("K_DF_s = 0.0", "K_DF_s = inf", "K_DF_s = inf"),
    ] {
        let bad = out.join("bad.toml");
        assert!(good.contains(from));
        std::fs::write(&bad, good.replacen(from, to, 1)).unwrap();
        for command in ["gains", "run", "demo"] {
            let arguments = [
                command,
                "--controller",
                bad.to_str().unwrap(),
                "--out",
                path,
            ];
            refused(&arguments, 2, &[name, "accepted"]);
        }
    }
    let law = example("controller_paper.toml");
    refused(
        &["gains", "--controller", &law, "--at", "2.5", "--out", path],
        2,
        &["--at 2.5", "0 to 2 s"],
    );
    refused(
        &[
            "gains",
            "--controller",
            &law,
            "--map",
            "K_IF",
            "K_IF",
            "--out",
            path,
        ],
        2,
        &["--map K_IF K_IF", "two different gains"],
    );
    refused(
        &[
            "gains",
            "tune",
            "--controller",
            &law,
            "--gain-margin-dB",
            "-1",
            "--out",
            path,
        ],
        2,
        &["--gain-margin-dB"],
    );
}

#[test]
fn tuned_gains_are_written_as_a_controller() {
    let out = folder("tune");
    let path = out.to_str().unwrap();
    let law = example("controller_paper.toml");
    let arguments = [
        "gains",
        "tune",
        "--controller",
        &law,
        "--json",
        "--particles",
        "8",
        "--iterations",
        "5",
        "--seed",
        "3",
        "--delay-margin-ticks",
        "1.5",
        "--out",
        path,
    ];
    let first = json(&flexor(&arguments));
    assert_eq!(
        (&first["stable"], &first["spread"]["stable"]),
        (&true.into(), &true.into())
    );
    assert!(first["delay_margin_ticks"].as_f64().unwrap() >= 1.5);
    let written = std::fs::read_to_string(out.join("controller.toml")).unwrap();
    // The same seed writes the same file, and the file is one that the others take.
    json(&flexor(&arguments));
    let again = std::fs::read_to_string(out.join("controller.toml")).unwrap();
    assert_eq!(written, again);
    let file = out.join("controller.toml");
    let result = json(&flexor(&[
        "gains",
        "--json",
        "--controller",
        file.to_str().unwrap(),
        "--out",
        path,
    ]));
    assert_eq!(result["gain_margin_dB"], first["gain_margin_dB"]);
}

#[test]
fn gains_of_the_hybrid_law_are_found_proved_and_refused_with_the_number_to_change() {
    let out = folder("design");
    let path = out.to_str().unwrap();
    let range = ["--root-inertia-kgm2", "3e-5", "3e-4"];
    let design = [&["gains", "design", "--json", "--out", path], &range[..]].concat();
    let found = json(&flexor(&design));
    assert_eq!(
        (&found["stable"], &found["unstable_plants"]),
        (&true.into(), &0.into())
    );
    assert!(found["worst_pole_per_s"][0].as_f64().unwrap() < 0.0);
    assert!(found["delay_margin_ticks"].as_u64().unwrap() >= 1);
    assert!(found["gain_up"].as_f64().unwrap() >= 1.2);
    let file = out.join("controller.toml");
    let file = file.to_str().unwrap();
    let elsewhere = folder("design_judged");
    let elsewhere = elsewhere.to_str().unwrap();
    let judge = ["gains", "--controller", file, "--json", "--out", elsewhere];
    let judged = json(&flexor(&[&judge, &range[..]].concat()));
    assert_eq!(judged["worst_pole_per_s"], found["worst_pole_per_s"]);

    // A hub's gains on a root that may be bare: refused with the range that would do, and run all the
    // same only where that is asked for.
    let hub = example("controller_hub.toml");
    let scenario = example("scenarios/unknown_inertia.toml");
    for arguments in [
        vec!["gains", "--controller", &hub],
        vec!["run", "--controller", &hub],
        vec![
            "campaign",
            "--scenario",
            &scenario,
            "--controller",
            &hub,
            "--runs",
            "2",
        ],
    ] {
        let all = [&arguments[..], &["--out", elsewhere]].concat();
        let output = flexor(&all);
        let words = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {words}");
        for word in [
            "do not hold every arm",
            "root 0.00e0 kg m^2 grows at +",
            "1/s",
        ] {
            assert!(words.contains(word), "{arguments:?}: no {word} in {words}");
        }
    }
    let words = text(&flexor(&["gains", "--controller", &hub, "--out", elsewhere]).stderr);
    assert!(
        words.contains("accepted with these gains: from 1."),
        "{words}"
    );
    let run = [
        "run",
        "--controller",
        &hub,
        "--unproven",
        "--out",
        elsewhere,
    ];
    let words = text(&flexor(&run).stderr);
    assert!(
        words.contains("warning: these gains do not hold"),
        "{words}"
    );

    refused(
        &[
            "gains",
            "--root-inertia-kgm2",
            "2e-4",
            "1e-4",
            "--out",
            elsewhere,
        ],
        2,
        &["--root-inertia-kgm2 2e-4 1e-4", "accepted"],
    );
    refused(
        &[
            "gains",
            "--spread",
            &example("spread.toml"),
            "--out",
            elsewhere,
        ],
        2,
        &["--spread has no effect with the hybrid law"],
    );
}

#[test]
fn an_arm_without_gains_runs_on_gains_of_its_own() {
    let out = folder("own_gains");
    let arm = std::fs::read_to_string(example("arm.toml")).unwrap();
    let file = out.join("arm.toml");
    let heavy = arm.replacen("mass_kg = 0.24", "mass_kg = 0.4", 1);
    assert_ne!(heavy, arm);
    std::fs::write(
        &file,
        heavy.replacen(
            "bending_stiffness_Nm2 = 0.48",
            "bending_stiffness_Nm2 = 2.0",
            1,
        ),
    )
    .unwrap();
    let results = out.join("out");
    let run = [
        "run",
        "--json",
        "--require-completed",
        "--set",
        "root_gauge.measures=\"moment\"",
        "--arm",
        file.to_str().unwrap(),
        "--out",
        results.to_str().unwrap(),
    ];
    let result = json(&flexor(&run));
    assert_eq!(result["gains_stable"], true);
    let stiffness = result["gains"]["joint_stiffness_Nm_rad"][1]
        .as_f64()
        .unwrap();
    assert!((stiffness - 1.703).abs() > 0.1, "{stiffness}");
}

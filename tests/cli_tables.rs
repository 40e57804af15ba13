//! `flexor run --table` and what refuses a table, or the making of one.

use super::{ARM, TASK, flexor, folder, json, refused, text};

#[test]
fn a_table_that_would_command_something_else_is_refused() {
    // Root inertia, a tip mass and no post-actuation: torques swing between two ticks.
    let out = folder("table_off");
    let file = |name: &str, text: &str, changes: &[(&str, &str)]| {
        let mut text = text.to_string();
        for (from, to) in changes {
            assert!(text.contains(from), "no {from:?} in the example");
            text = text.replacen(from, to, 1);
        }
        let file = out.join(name);
        std::fs::write(&file, text).unwrap();
        file.to_str().unwrap().to_string()
    };
    let arm = file(
        "arm.toml",
        ARM,
        &[
            ("elements = 3", "elements = 6"),
            ("damping_ratio = 0.05", "damping_ratio = 0.1"),
            (
                "bending_stiffness_Nm2 = 0.48",
                "bending_stiffness_Nm2 = 8.4",
            ),
            ("# root_inertia_kgm2 = 0.0", "root_inertia_kgm2 = 6e-3"),
            ("# tip_mass_kg = 0.0", "tip_mass_kg = 0.2"),
        ],
    );
    let task = file(
        "task.toml",
        TASK,
        &[
            (
                "duration_s = 2.0",
                "duration_s = 0.27\nends = \"dirichlet\"",
            ),
            ("pre_actuation_s = 0.0", "pre_actuation_s = \"auto\""),
        ],
    );
    let results = out.join("results");
    for command in ["plan", "run"] {
        refused(
            &[
                command,
                "--arm",
                &arm,
                "--task",
                &task,
                "--out",
                results.to_str().unwrap(),
            ],
            2,
            &[
                "feedforward table",
                "torque tau1 (N m) only to",
                "is accepted",
                "a longer post_actuation_s",
            ],
        );
        assert!(!results.exists(), "{command} leaves results");
    }
}

#[test]
fn a_run_takes_a_table_file_and_refuses_a_bad_one() {
    let out = folder("table");
    let path = |name: &str| out.join(name).to_str().unwrap().to_string();
    let run = |table: &str| {
        let out = path("run");
        flexor(&[
            "run",
            "--json",
            "--plant-elements",
            "3",
            "--table",
            table,
            "--out",
            &out,
        ])
    };
    json(&flexor(&["plan", "--json", "--out", &path("")]));
    let result = json(&run(&path("table.bin")));
    assert_eq!(result["outcome"], "completed");
    let csv = std::fs::read_to_string(path("run/run.csv")).unwrap();
    assert!(csv.starts_with(
        "t_s,f_normal_N,f_normal_ref_N,x1_m,x2_m,x1_ref_m,x2_ref_m,theta10_rad,theta20_rad,root_slope_rad,root_slope_rate_rad_s,tau1_Nm,tau2_Nm"
    ));

    let image = std::fs::read(path("table.bin")).unwrap();
    let refused_table = |name: &str, bytes: &[u8], word: &str| {
        std::fs::write(path(name), bytes).unwrap();
        refused(
            &["run", "--table", &path(name), "--out", &path("run")],
            2,
            &[name, word],
        );
    };
    refused_table("short.bin", &image[..1000], "truncated");
    refused_table("empty.bin", &[], "truncated");
    refused_table("erased.bin", &[0xff; 5000], "FLXT");
    let mut changed = image.clone();
    changed[2000] ^= 4;
    refused_table("changed.bin", &changed, "checksum");
    // A damaged header is named with what it says, and what is accepted.
    let with = |at: usize, bytes: &[u8]| {
        let mut changed = image.clone();
        changed[at..at + bytes.len()].copy_from_slice(bytes);
        changed
    };
    let pieces = "'pieces' is 65, 1 to 64 is accepted";
    refused_table("pieces.bin", &with(6, &[65, 0]), pieces);
    let piece = "'ticks of a piece' is 0, 1 to 16777216 is accepted";
    refused_table("piece.bin", &with(52, &[0; 4]), piece);
    let version = "version is 1, this program reads 2";
    refused_table("old.bin", &with(4, &[1, 0]), version);
    let rows = "'rows' is 0, ";
    refused_table("rows.bin", &with(24, &[0; 4]), rows);
    refused(
        &["run", "--table", &path("none.bin"), "--out", &path("run")],
        2,
        &["none.bin"],
    );
    // A good table of another task.
    refused(
        &[
            "run",
            "--tick-rate-hz",
            "1000",
            "--table",
            &path("table.bin"),
            "--out",
            &path("run"),
        ],
        2,
        &["10000 ticks", "2000 ticks", "plan it again"],
    );
    // And of another arm.
    std::fs::write(path("arm.toml"), ARM.replace("0.24", "0.25")).unwrap();
    refused(
        &[
            "run",
            "--arm",
            &path("arm.toml"),
            "--table",
            &path("table.bin"),
            "--out",
            &path("run"),
        ],
        2,
        &["table.bin", "planned for arm", "plan it again"],
    );
}

#[test]
fn a_table_is_run_with_its_own_task_alone() {
    let out = folder("task");
    let path = |name: &str| out.join(name).to_str().unwrap().to_string();
    let (plan, results) = (path("plan"), path("run"));
    let (table, task) = (path("plan/table.bin"), path("task.toml"));
    let planned = json(&flexor(&["plan", "--json", "--out", &plan]));
    let named = planned["table_task"].as_str().unwrap().to_string();
    assert!(named.len() == 10 && named.starts_with("0x"), "{named}");
    let words = text(&flexor(&["plan", "--out", &plan]).stdout);
    assert!(words.contains(&format!("task {named}, ")), "{words}");
    let with = |more: &[&str]| {
        let arguments = ["run", "--table", &table, "--out", &results];
        [&arguments[..], more]
            .concat()
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
    };
    let run = |more: &[&str]| {
        let arguments = with(more);
        flexor(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let summary = json(&run(&["--json", "--task", "../examples/task.toml"]));
    assert_eq!(summary["table_task"], named.as_str());
    // The same arm, length and rate; another path, force, side and posture.
    for (from, to) in [
        ("to_m = [0.2, 0.05]", "to_m = [0.25, 0.05]"),
        ("normal_N = 2.0", "normal_N = 2.001"),
        ("normal_N = 2.0", "normal_N = 2.0\ndirection = [0.0, -1.0]"),
    ] {
        assert!(TASK.contains(from), "{from}");
        std::fs::write(&task, TASK.replacen(from, to, 1)).unwrap();
        let other = json(&flexor(&[
            "plan",
            "--json",
            "--task",
            &task,
            "--out",
            &path("other"),
        ]));
        let arguments = with(&["--task", &task]);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let is = format!("this is task {}", other["table_task"].as_str().unwrap());
        let was = format!("of task {named}");
        refused(
            &arguments,
            2,
            &["table.bin", &was, &is, "--task", "plan it again"],
        );
    }
    let arguments = with(&["--model", "as-printed"]);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    refused(&arguments, 2, &["--table", "--model", &named]);
    // A table of the paper's equations runs where they are named.
    json(&flexor(&[
        "plan",
        "--json",
        "--model",
        "as-printed",
        "--out",
        &plan,
    ]));
    assert!(run(&["--model", "as-printed"]).status.success());
    assert_eq!(run(&[]).status.code(), Some(2));
}

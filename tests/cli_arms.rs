//! Published arms, each on gains of its own.

use super::{flexor, folder, json};
use std::fs;
use std::path::Path;

/// Arms of `examples/arms`, and from which force error on, N, a run on their own gains is worse than
/// it was.
const ARMS: [(&str, f64); 3] = [
    ("de_luca_1990", 0.06),
    ("gu_petkov", 0.25),
    ("geared_forearm", 0.4),
];

#[test]
fn published_arms_are_stable_on_gains_of_their_own_elbow_down_and_up() {
    let place = folder("published_arms");
    let arms = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/arms");
    for (name, most_n) in ARMS {
        let file = |of: &str| arms.join(format!("{name}{of}.toml"));
        let down = fs::read_to_string(file("")).unwrap();
        let up = down.replace("elbow = \"down\"", "elbow = \"up\"");
        assert_ne!(down, up, "{name}");
        for (elbow, text) in [("down", down), ("up", up)] {
            let arm = place.join(format!("{name}_{elbow}.toml"));
            fs::write(&arm, text).unwrap();
            let out = place.join(format!("{name}_{elbow}"));
            let result = json(&flexor(&[
                "run",
                "--arm",
                &arm.display().to_string(),
                "--task",
                &file("_task").display().to_string(),
                "--out",
                &out.display().to_string(),
                "--json",
            ]));
            let number = |key: &str| result[key].as_f64().unwrap();
            assert_eq!(result["gains_stable"], true, "{name} {elbow}");
            assert!(result["gains_worst_pole_per_s"][0].as_f64().unwrap() < -0.1);
            assert!(number("gains_delay_margin_ticks") >= 2.0, "{name} {elbow}");
            let error_n = number("force_error_rms_N");
            assert!(error_n < most_n, "{name} {elbow}: {error_n}");
        }
    }
}

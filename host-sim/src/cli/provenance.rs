//! What results were made from: program, command line, input files, gains and plant. Every summary
//! and every page says it. Nothing of it changes from run to run: equal commands leave equal files.

use super::{CliError, Common};
use crate::campaign::identity::CampaignInput;
use crate::files::config;
use crate::files::export::object;
use crate::model::link::{LinkDamping, LinkModel};
use crate::planner::task::Task;
use crate::planner::tip_force::NormalForce;
use crate::plant::PlantParameters;
use crate::text::{Shortest, quoted};
use flexor::control::LawParameters;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use std::ffi::OsString;
use std::path::Path;
use std::sync::{PoisonError, RwLock};

/// Version of the files' and `--json`'s keys: it rises when one of them changes its meaning or goes.
pub(super) const SCHEMA_VERSION: u32 = 1;

/// Version of the program.
pub(super) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Commit that it was built from: eight hex digits, with `+` where the sources differed from it;
/// `unknown` outside a repository.
pub(super) const COMMIT: &str = env!("FLEXOR_COMMIT");

/// Options that change no result, and whether a value follows.
const WITHOUT_EFFECT: [(&str, bool); 2] = [("--out", true), ("--json", false)];

/// The command line of this process, as [`remember`] took it.
static COMMAND: RwLock<String> = RwLock::new(String::new());

/// Takes the command line, the program's name first.
pub(super) fn remember(arguments: &[OsString]) {
    let mut command = COMMAND.write().unwrap_or_else(PoisonError::into_inner);
    *command = canonical(arguments);
}

/// A command line as a shell takes it, without the options that change no result. Two runs that
/// differ in these alone have equal files.
fn canonical(arguments: &[OsString]) -> String {
    let mut words = vec!["flexor".to_string()];
    let mut rest = arguments.iter().skip(1);
    while let Some(argument) = rest.next() {
        let word = argument.to_string_lossy();
        let skipped = WITHOUT_EFFECT.iter().find(|(option, value)| {
            let joined = word.strip_prefix(option);
            word == *option || (*value && joined.is_some_and(|rest| rest.starts_with('=')))
        });
        match skipped {
            None => words.push(quoted(&word)),
            Some((option, true)) if word == *option => drop(rest.next()),
            Some(_) => {}
        }
    }
    words.join(" ")
}

/// An input of a command.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Input {
    /// The option that names it, without hyphens.
    option: String,
    /// The file, as it was named; `built in` where none was.
    file: String,
    /// SHA-256 of its bytes, in hex.
    sha256: String,
}

/// What results were made from.
#[derive(Clone, Debug)]
pub(super) struct Provenance {
    command: String,
    inputs: Vec<Input>,
    gains: Value,
    plant: Value,
}

impl Provenance {
    /// Of a command with these options; see [`file`](Self::file) for the others.
    ///
    /// # Errors
    /// [`CliError::Unreadable`].
    pub(super) fn of(common: &Common) -> Result<Self, CliError> {
        let none = Self {
            command: COMMAND
                .read()
                .unwrap_or_else(PoisonError::into_inner)
                .clone(),
            inputs: vec![],
            gains: Value::Null,
            plant: Value::Null,
        };
        none.file("arm", common.arm.as_deref(), config::DEFAULT_ARM)?
            .file("task", common.task.as_deref(), config::DEFAULT_TASK)?
            .file("board", common.board.as_deref(), config::DEFAULT_BOARD)
    }

    /// Of a campaign, or a run on its bench, with these inputs.
    pub(super) fn of_inputs(inputs: &[CampaignInput]) -> Self {
        let files = inputs.iter().filter(|input| !input.sha256.is_empty());
        let inputs = files.map(|input| Input {
            option: input.option.clone(),
            file: match input.file.is_empty() {
                true => BUILT_IN.into(),
                false => input.file.clone(),
            },
            sha256: input.sha256.clone(),
        });
        Self {
            command: COMMAND
                .read()
                .unwrap_or_else(PoisonError::into_inner)
                .clone(),
            inputs: inputs.collect(),
            gains: Value::Null,
            plant: Value::Null,
        }
    }

    /// The same with the file of an `option`, which was not named where it is `None`: then the text
    /// is built in, or, if that is empty, there is none.
    ///
    /// # Errors
    /// [`CliError::Unreadable`].
    pub(super) fn file(
        mut self,
        option: &str,
        file: Option<&Path>,
        built_in: &str,
    ) -> Result<Self, CliError> {
        if file.is_none() && built_in.is_empty() {
            return Ok(self);
        }
        let sha256 = sha256_of(file, built_in)?;
        self.inputs.push(Input {
            option: option.into(),
            file: file.map_or(BUILT_IN.into(), |file| file.display().to_string()),
            sha256,
        });
        Ok(self)
    }

    /// The same with the force profile of a task, which may be in a file that the task names.
    pub(super) fn profile(mut self, task: &Task) -> Self {
        let text = profile_text(task);
        if !text.is_empty() {
            self.inputs.push(Input {
                option: "force profile".into(),
                file: "way-points as read".into(),
                sha256: sha256(text.as_bytes()),
            });
        }
        self
    }

    /// The same with these gains.
    pub(super) fn gains(mut self, law: &LawParameters) -> Self {
        // As a controller file has them, so that there is one list of keys.
        let text = config::controller_toml(law, &[]);
        self.gains = toml::from_str(&text).unwrap_or_default();
        self
    }

    /// The same with this plant.
    pub(super) fn plant(mut self, plant: &PlantParameters) -> Self {
        self.plant = Value::Object(plant_json(plant));
        self
    }

    /// The same with another command line.
    pub(super) fn command(mut self, command: String) -> Self {
        self.command = command;
        self
    }

    /// As JSON: what was not said to belong to it is `null`.
    fn json(&self) -> Value {
        let inputs = self.inputs.iter().map(
            |input| json!({ "option": input.option, "file": input.file, "sha256": input.sha256 }),
        );
        json!({
            "version": VERSION,
            "commit": COMMIT,
            "command": self.command,
            "inputs": inputs.collect::<Vec<_>>(),
            "gains": self.gains,
            "plant": self.plant,
        })
    }

    /// A summary: the version of its keys, these `keys`, and what they were made from.
    pub(super) fn summary(&self, keys: Map<String, Value>) -> Value {
        let mut summary = object([("schema_version", json!(SCHEMA_VERSION))]);
        summary.extend(keys);
        summary.insert("provenance".into(), self.json());
        Value::Object(summary)
    }

    /// For a page: names and facts.
    pub(super) fn facts(&self) -> Vec<(String, String)> {
        let mut facts = vec![
            (
                "program".to_string(),
                format!("flexor {VERSION}, commit {COMMIT}"),
            ),
            ("command".into(), self.command.clone()),
        ];
        facts.extend(self.inputs.iter().map(|input| {
            let fact = format!("{}, SHA-256 {}", input.file, input.sha256);
            (input.option.clone(), fact)
        }));
        for (name, value) in [("gains", &self.gains), ("plant", &self.plant)] {
            let words = assignments(value, "");
            if !words.is_empty() {
                facts.push((name.into(), words.join(", ")));
            }
        }
        facts
    }
}

/// What an object says, as a file would: `key = value`, with dots where objects are in objects.
fn assignments(value: &Value, before: &str) -> Vec<String> {
    match value {
        Value::Null => vec![],
        Value::Object(map) => {
            let dot = if before.is_empty() { "" } else { "." };
            let inner = |(key, value): (&String, &Value)| {
                assignments(value, &format!("{before}{dot}{key}"))
            };
            map.iter().flat_map(inner).collect()
        }
        value => vec![format!("{before} = {value}")],
    }
}

/// What stands for a file where none was named.
const BUILT_IN: &str = "built in";

/// A summary as `--json` prints it: with how long things took, which files leave out.
pub(super) fn with_timing(summary: &Value, timing: Map<String, Value>) -> Value {
    let mut printed = summary.clone();
    printed["timing"] = Value::Object(timing);
    printed
}

/// SHA-256, in hex, of a file's bytes, or of the text that is built in where none is named.
///
/// # Errors
/// [`CliError::Unreadable`].
pub(super) fn sha256_of(file: Option<&Path>, built_in: &str) -> Result<String, CliError> {
    let Some(file) = file else {
        return Ok(sha256(built_in.as_bytes()));
    };
    let failed = |cause| CliError::Unreadable {
        file: file.to_path_buf(),
        cause,
    };
    Ok(sha256(&std::fs::read(file).map_err(failed)?))
}

/// The way-points of a force profile, as a comment in a task's text; nothing where the force is
/// constant.
pub(super) fn profile_text(task: &Task) -> String {
    match &task.normal_force {
        NormalForce::Constant(_) => String::new(),
        NormalForce::Along(profile) => {
            let points = profile
                .way_points()
                .map(|[way, force]| format!("# at {} m: {} N\n", Shortest(way), Shortest(force)));
            format!(
                "\n# The force along the path:\n{}",
                points.collect::<String>()
            )
        }
    }
}

/// SHA-256 in hex.
fn sha256(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A plant under the keys of its file.
fn plant_json(plant: &PlantParameters) -> Map<String, Value> {
    let (damping, time_s) = match plant.link_damping {
        None => (None, None),
        Some(LinkDamping::Modal) => (Some("modal"), None),
        Some(LinkDamping::Bending { time_s }) => (Some("bending"), time_s),
    };
    object([
        ("elements", json!(plant.elements)),
        (
            "bending_stiffness_scale",
            json!(plant.bending_stiffness_scale),
        ),
        ("link1_mass_scale", json!(plant.link1_mass_scale)),
        ("link2_mass_scale", json!(plant.link2_mass_scale)),
        ("damping_scale", json!(plant.damping_scale)),
        ("root_inertia_kgm2", json!(plant.root_inertia_kgm2)),
        ("tip_mass_kg", json!(plant.tip_mass_kg)),
        ("tip_inertia_kgm2", json!(plant.tip_inertia_kgm2)),
        (
            "viscous_friction_Nms_rad",
            json!(plant.viscous_friction_nms_rad),
        ),
        ("coulomb_friction_Nm", json!(plant.coulomb_friction_nm)),
        (
            "geometric_stiffness",
            json!(format!("{:?}", plant.geometric_stiffness).to_lowercase()),
        ),
        ("model", json!(plant.link_model.map(LinkModel::name))),
        ("damping", json!(damping)),
        ("bending_damping_s", json!(time_s)),
        ("substeps", json!(plant.substeps)),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> Vec<OsString> {
        line.split(' ').map(OsString::from).collect()
    }

    #[test]
    fn a_command_is_what_decides_the_result() {
        let line =
            "/usr/bin/flexor run --json --out out/x --task a.toml --out=b --require-completed";
        let wanted = "flexor run --task a.toml --require-completed";
        assert_eq!(canonical(&words(line)), wanted);
        assert_eq!(canonical(&words("flexor")), "flexor");
        let odd = ["f", "run", "--task", "a b'c"].map(OsString::from);
        assert_eq!(canonical(&odd), r"flexor run --task 'a b'\''c'");
    }

    #[test]
    fn hashes_are_those_of_sha256sum() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256(b"abc"), abc);
    }

    #[test]
    fn a_plants_keys_are_those_of_its_file() {
        let plant = PlantParameters {
            bending_stiffness_scale: 0.9,
            tip_mass_kg: Some(0.1),
            ..PlantParameters::default()
        };
        let keys = plant_json(&plant);
        let set = keys.iter().filter(|(_, value)| !value.is_null());
        let text: String = set
            .map(|(key, value)| format!("{key} = {value}\n"))
            .collect();
        let (read, _) = config::parse_plant("plant.toml", &text).unwrap();
        assert_eq!(read, plant, "{text}");
    }

    #[test]
    fn a_summary_says_what_it_is_made_from() {
        let common = Common::default();
        let law = LawParameters::FEEDFORWARD;
        let made = Provenance::of(&common).unwrap().gains(&law);
        let summary = made.summary(object([("a", json!(1))]));
        assert_eq!(summary["schema_version"], SCHEMA_VERSION);
        assert_eq!(summary["a"], 1);
        let from = &summary["provenance"];
        assert_eq!(from["version"], VERSION);
        assert_eq!(from["inputs"][0]["option"], "arm");
        assert_eq!(from["inputs"][0]["file"], "built in");
        assert_eq!(from["gains"]["feedforward"], true);
        let facts = made.facts();
        assert!(
            facts
                .iter()
                .any(|(name, fact)| name == "gains" && fact.contains("K_IF"))
        );
    }
}

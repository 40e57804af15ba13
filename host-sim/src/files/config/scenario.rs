//! A scenario file: arms of a bench with their spreads and faults, the files that they belong to,
//! and what is asked of a campaign.
//!
//! Any number may be a spread instead, an inline table with one of these keys:
//!
//! ```toml
//! friction = 0.15
//! friction = { uniform = [0.0, 0.3] }
//! stiffness_N_m = { log_uniform = [2e3, 5e4] }
//! noise_N = { normal = [0.03, 0.005] }       # mean, standard deviation; cut at three of them
//! link1_mass_scale = { choice = [0.9, 1.0, 1.1] }
//! ```
//!
//! `base = "other.toml"` takes everything from another scenario first; what this one says goes
//! before it, key by key. Files are looked for from the scenario's own folder.

use super::plant::geometric_stiffness;
use super::ranges::accepted as accepted_word;
use super::{ConfigError, FILE_BYTES_MAX, read_text};
use crate::campaign::distribution::Distribution;
use crate::campaign::keys::{KEYS, Key};
use crate::campaign::scenario::Scenario;
use crate::campaign::verdict::Limits as VerdictLimits;
use crate::model::link::LinkModel;
use crate::plant::bench::{GaugeSignal, SurfaceFeature};
use crate::simulation::bench::{FAULT_NAMES, FailureLimits, FaultName, TimedFault, WISH_NAMES};
use crate::text::{Shortest, one_line};
use serde::Deserialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A scenario and the files that it names.
#[derive(Clone, Debug, Default)]
pub struct ScenarioConfig {
    /// The scenario.
    pub scenario: Scenario,
    /// The arm that is planned for.
    pub arm: Option<PathBuf>,
    /// The task.
    pub task: Option<PathBuf>,
    /// The board.
    pub board: Option<PathBuf>,
    /// Gains.
    pub controller: Option<PathBuf>,
    /// Everything that decides the runs, bases included, in one text: equal scenarios have equal
    /// ones, whatever their comments.
    pub canonical: String,
}

/// Scenarios that may be based on each other in a row.
const BASES_MAX: usize = 8;

/// Keys whose values are files.
const FILES: [&str; 4] = ["arm", "task", "board", "controller"];

/// Reads a scenario file, its bases, and what `sets` says before them (`key=value`, as TOML writes
/// values). Without a file all is ideal.
///
/// # Errors
/// [`ConfigError`], one line.
pub fn load_scenario(path: Option<&Path>, sets: &[String]) -> Result<ScenarioConfig, ConfigError> {
    let mut merged = Table::new();
    let mut name = path.map_or("built-in scenario".to_string(), |p| p.display().to_string());
    if !sets.is_empty() {
        name += " with --set";
    }
    if let Some(path) = path {
        merged = with_bases(path, BASES_MAX)?;
    }
    for set in sets {
        apply(&mut merged, set)?;
    }
    Reader { file: &name }.scenario(merged)
}

/// Reads the text of a scenario without a base; `file` is its name for messages.
///
/// # Errors
/// [`ConfigError`].
pub fn parse_scenario(file: &str, text: &str) -> Result<ScenarioConfig, ConfigError> {
    let table = table(file, text)?;
    Reader { file }.scenario(table)
}

fn malformed(file: &str, message: impl Into<String>) -> ConfigError {
    ConfigError::Malformed {
        file: file.to_string(),
        message: one_line(&message.into(), super::MESSAGE_MAX),
    }
}

fn table(file: &str, text: &str) -> Result<Table, ConfigError> {
    text.parse::<Table>().map_err(|error| {
        let at = error.span().map_or(0, |span| span.start.min(text.len()));
        let line = text.as_bytes()[..at]
            .iter()
            .filter(|b| **b == b'\n')
            .count()
            + 1;
        malformed(file, format!("line {line}: {}", error.message()))
    })
}

/// The file's table laid over its bases', paths resolved.
fn with_bases(path: &Path, bases_left: usize) -> Result<Table, ConfigError> {
    let (file, text) = read_text(path, FILE_BYTES_MAX)?;
    let mut own = table(&file, &text)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    for key in FILES {
        if let Some(Value::String(name)) = own.get_mut(key) {
            *name = folder.join(&*name).display().to_string();
        }
    }
    let Some(base) = own.remove("base") else {
        return Ok(own);
    };
    let Value::String(base) = base else {
        return Err(malformed(&file, "base: a file in quotes is accepted"));
    };
    if bases_left == 0 {
        let words = format!("base = {base:?}: up to {BASES_MAX} bases in a row are accepted");
        return Err(malformed(&file, words));
    }
    let mut merged = with_bases(&folder.join(base), bases_left - 1)?;
    lay_over(&mut merged, own);
    Ok(merged)
}

/// Lays `upper` over `lower`, table by table.
fn lay_over(lower: &mut Table, upper: Table) {
    for (key, value) in upper {
        match (lower.get_mut(&key), value) {
            // A spread is one value, and replaced whole.
            (Some(Value::Table(below)), Value::Table(above))
                if !is_spread(below) && !is_spread(&above) =>
            {
                lay_over(below, above);
            }
            (_, value) => {
                lower.insert(key, value);
            }
        }
    }
}

/// Names of the spreads.
const SPREADS: [&str; 4] = ["uniform", "log_uniform", "normal", "choice"];

fn is_spread(table: &Table) -> bool {
    SPREADS.iter().any(|name| table.contains_key(*name))
}

/// Lays one `key=value` over `merged`.
fn apply(merged: &mut Table, set: &str) -> Result<(), ConfigError> {
    let wrong = |message: String| malformed("--set", message);
    let Some((key, value)) = set.split_once('=') else {
        return Err(wrong(format!("{set:?}; accepted: section.key=value")));
    };
    let key = key.trim();
    let line = format!("value = {value}");
    let mut parsed = table("--set", &line)
        // A word without quotes is a text.
        .or_else(|_| table("--set", &format!("value = {:?}", value.trim())))?;
    let Some(value) = parsed.remove("value").filter(|_| parsed.is_empty()) else {
        return Err(wrong(format!("{set:?}; accepted: one value")));
    };
    let mut upper = Table::new();
    match key.split_once('.') {
        Some((section, name)) => {
            let inner = Table::from_iter([(name.to_string(), value)]);
            upper.insert(section.to_string(), Value::Table(inner));
        }
        None => {
            upper.insert(key.to_string(), value);
        }
    }
    lay_over(merged, upper);
    Ok(())
}

/// A fault, as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FaultFile {
    fault: String,
    at_s: f64,
    for_s: Option<f64>,
    value: Option<f64>,
}

/// What counts as a failed run, as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FailureFile {
    along_error_m: Option<f64>,
    #[serde(rename = "force_error_N")]
    force_error: Option<f64>,
}

/// A feature of the surface, as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "lowercase")]
enum FeatureFile {
    Step {
        at_m: f64,
        drop_m: f64,
        #[serde(default)]
        wall_m: f64,
    },
    Hole {
        from_m: f64,
        to_m: f64,
        depth_m: f64,
        #[serde(default)]
        wall_m: f64,
    },
    Begin {
        at_m: f64,
    },
    End {
        at_m: f64,
    },
}

/// Reads a merged table of a file.
struct Reader<'a> {
    file: &'a str,
}

impl Reader<'_> {
    fn malformed(&self, message: impl Into<String>) -> ConfigError {
        malformed(self.file, message)
    }

    fn scenario(&self, mut merged: Table) -> Result<ScenarioConfig, ConfigError> {
        let mut config = ScenarioConfig::default();
        let mut file = |key: &str| match merged.remove(key) {
            None => Ok(None),
            Some(Value::String(name)) => Ok(Some(PathBuf::from(name))),
            Some(_) => Err(self.malformed(format!("{key}: a file in quotes is accepted"))),
        };
        config.arm = file("arm")?;
        config.task = file("task")?;
        config.board = file("board")?;
        config.controller = file("controller")?;
        config.canonical = canonical(&merged);
        let scenario = &mut config.scenario;
        for (section, value) in merged {
            match section.as_str() {
                "faults" => scenario.faults = self.faults(value)?,
                "failed" => scenario.failure = self.failure(value)?,
                "verdict" => scenario.verdict = self.verdict(value)?,
                _ => self.section(scenario, &section, value)?,
            }
        }
        Ok(config)
    }

    /// A structure that serde knows.
    fn structure<T: for<'de> Deserialize<'de>>(
        &self,
        section: &str,
        value: Value,
    ) -> Result<T, ConfigError> {
        serde_path_to_error::deserialize(value).map_err(|error| {
            let (path, inner) = (
                error.path().to_string(),
                error.inner().message().to_string(),
            );
            let place = match path.as_str() {
                "." => section.to_string(),
                path => format!("{section}.{path}"),
            };
            self.malformed(format!("{place}: {inner}"))
        })
    }

    /// A section of numbers.
    fn section(
        &self,
        scenario: &mut Scenario,
        section: &str,
        value: Value,
    ) -> Result<(), ConfigError> {
        let Value::Table(table) = value else {
            return Err(self.malformed(unknown(section)));
        };
        for (name, value) in table {
            let full = format!("{section}.{name}");
            match (full.as_str(), value) {
                ("plant.geometric_stiffness", value) => {
                    let read = geometric_stiffness(&value);
                    let accepted = accepted_word("geometric_stiffness").unwrap_or_default();
                    scenario.geometric_stiffness =
                        read.ok_or_else(|| self.refused(&full, &value, &accepted))?;
                }
                ("plant.model", value) => {
                    let read = value.as_str().and_then(LinkModel::from_name);
                    let accepted = accepted_word("model").unwrap_or_default();
                    scenario.link_model =
                        Some(read.ok_or_else(|| self.refused(&full, &value, &accepted))?);
                }
                ("root_gauge.measures", value) => {
                    let accepted = "\"moment\" or \"slope\"";
                    scenario.gauge_signal = Some(match value.as_str() {
                        Some("moment") => GaugeSignal::Moment,
                        Some("slope") => GaugeSignal::Slope,
                        _ => return Err(self.refused(&full, &value, accepted)),
                    });
                }
                ("surface.features", value) => scenario.features = self.features(value)?,
                (_, value) => {
                    let Some(key) = Key::find(&full) else {
                        return Err(self.malformed(unknown(&full)));
                    };
                    let distribution = self.distribution(key, &value)?;
                    scenario.numbers.push((key, distribution));
                }
            }
        }
        Ok(())
    }

    fn refused(&self, name: &str, value: &Value, accepted: &str) -> ConfigError {
        let written = one_line(&short(value), 60);
        self.malformed(format!("{name} = {written}; accepted: {accepted}"))
    }

    /// A number or a spread that `key` accepts.
    fn distribution(&self, key: &'static Key, value: &Value) -> Result<Distribution, ConfigError> {
        let wrong = || self.refused(key.name, value, &accepted(key));
        let distribution = match value {
            Value::Table(table) => spread(table).ok_or_else(wrong)?,
            value => Distribution::Fixed(number(value).ok_or_else(wrong)?),
        };
        let holds = match &distribution {
            Distribution::Fixed(value) => key.holds(*value),
            Distribution::Choice(values) => values.iter().all(|value| key.holds(*value)),
            // What lies between two whole numbers is none.
            spread => !key.whole && spread.bounds().iter().all(|bound| key.holds(*bound)),
        };
        if holds {
            Ok(distribution)
        } else {
            Err(wrong())
        }
    }

    fn faults(&self, value: Value) -> Result<Vec<TimedFault>, ConfigError> {
        let read: Vec<FaultFile> = self.structure("faults", value)?;
        let fault = |(i, fault): (usize, &FaultFile)| {
            let place = format!("faults[{i}]");
            let Some(entry) = FaultName::find(&fault.fault) else {
                let all = FAULT_NAMES.iter().chain(WISH_NAMES);
                let names: Vec<&str> = all.map(|entry| entry.name).collect();
                let message = format!(
                    "{place}.fault = {:?}; accepted: one of {}",
                    one_line(&fault.fault, 40),
                    names.join(", ")
                );
                return Err(malformed_long(self.file, message));
            };
            let value = match (entry.unit, fault.value) {
                (Some(_), Some(value)) if value.is_finite() && value.abs() <= 1e5 => value,
                (None, None) => 0.0,
                (Some(unit), given) => {
                    let given = given.map_or("missing".into(), |x| format!("= {}", Shortest(x)));
                    let words = format!(
                        "{place}.value {given}; accepted for {}: a number in {unit} from -1e5 to 1e5",
                        entry.name
                    );
                    return Err(self.malformed(words));
                }
                (None, Some(_)) => {
                    let words = format!(
                        "{place}.value: without effect on {}; none is accepted",
                        entry.name
                    );
                    return Err(self.malformed(words));
                }
            };
            let time = |name: &str, value: f64, low: f64| {
                if value.is_finite() && value >= low && value <= 1e4 {
                    Ok(value)
                } else {
                    let words = format!(
                        "{place}.{name} = {}; accepted: a time in s from {} to 10000",
                        Shortest(value),
                        Shortest(low)
                    );
                    Err(self.malformed(words))
                }
            };
            let from_s = time("at_s", fault.at_s, -60.0)?;
            let length = fault.for_s.map(|length| time("for_s", length, 0.0));
            Ok(TimedFault {
                kind: entry.kind(value),
                from_s,
                to_s: from_s + length.transpose()?.unwrap_or(f64::INFINITY),
            })
        };
        read.iter().enumerate().map(fault).collect()
    }

    fn verdict(&self, value: Value) -> Result<VerdictLimits, ConfigError> {
        let limits: VerdictLimits = self.structure("verdict", value)?;
        for (key, limit) in limits.given() {
            // What has no unit is a share of the runs.
            let unit = [
                ("_N", "a force in N"),
                ("_m", "a length in m"),
                ("_s", "a time in s"),
            ];
            let unit = unit.iter().find(|(ending, _)| key.ends_with(ending));
            let (what, most) = unit.map_or(("a share", 1.0), |(_, what)| (*what, 1e6));
            if !(0.0..=most).contains(&limit) {
                return Err(ConfigError::OutOfRange {
                    file: self.file.to_string(),
                    field: format!("verdict.{key}"),
                    value: limit,
                    accepted: format!("{what} from 0 to {}", Shortest(most)),
                });
            }
        }
        Ok(limits)
    }

    fn failure(&self, value: Value) -> Result<FailureLimits, ConfigError> {
        let read: FailureFile = self.structure("failed", value)?;
        let limit = |name: &str, value: Option<f64>| match value {
            Some(value) if !(value > 0.0 && value <= 1e6) => Err(ConfigError::OutOfRange {
                file: self.file.to_string(),
                field: format!("failed.{name}"),
                value,
                accepted: "an error above 0 up to 1e6".to_string(),
            }),
            given => Ok(given),
        };
        Ok(FailureLimits {
            along_m: limit("along_error_m", read.along_error_m)?,
            force_n: limit("force_error_N", read.force_error)?,
        })
    }

    fn features(&self, value: Value) -> Result<Vec<SurfaceFeature>, ConfigError> {
        let read: Vec<FeatureFile> = self.structure("surface.features", value)?;
        let check = |(i, feature): (usize, FeatureFile)| {
            let place = |name: &str| format!("surface.features[{i}].{name}");
            let within = |name: &str, value: f64, low: f64, high: f64| {
                if (low..=high).contains(&value) {
                    return Ok(value);
                }
                Err(ConfigError::OutOfRange {
                    file: self.file.to_string(),
                    field: place(name),
                    value,
                    accepted: format!("a length in m from {} to {}", Shortest(low), Shortest(high)),
                })
            };
            Ok(match feature {
                FeatureFile::Step {
                    at_m,
                    drop_m,
                    wall_m,
                } => SurfaceFeature::Step {
                    at_m: within("step.at_m", at_m, -200.0, 200.0)?,
                    drop_m: within("step.drop_m", drop_m, -10.0, 10.0)?,
                    wall_m: within("step.wall_m", wall_m, 0.0, 10.0)?,
                },
                FeatureFile::Hole {
                    from_m,
                    to_m,
                    depth_m,
                    wall_m,
                } => {
                    let from_m = within("hole.from_m", from_m, -200.0, 200.0)?;
                    SurfaceFeature::Hole {
                        from_m,
                        to_m: within("hole.to_m", to_m, from_m, 200.0)?,
                        depth_m: within("hole.depth_m", depth_m, 1e-6, 10.0)?,
                        wall_m: within("hole.wall_m", wall_m, 0.0, 10.0)?,
                    }
                }
                FeatureFile::Begin { at_m } => SurfaceFeature::Begin {
                    at_m: within("begin.at_m", at_m, -200.0, 200.0)?,
                },
                FeatureFile::End { at_m } => SurfaceFeature::End {
                    at_m: within("end.at_m", at_m, -200.0, 200.0)?,
                },
            })
        };
        read.into_iter().enumerate().map(check).collect()
    }
}

/// As [`malformed`], where the message lists many names.
fn malformed_long(file: &str, message: String) -> ConfigError {
    ConfigError::Malformed {
        file: file.to_string(),
        message,
    }
}

/// The message for a name that no section or key has.
fn unknown(name: &str) -> String {
    let section = name.split_once('.').map(|(section, _)| section);
    let keys = KEYS.iter().copied().flatten().map(|key| key.name);
    let mut known: Vec<&str> = match section {
        Some(section) => keys
            .filter_map(|key| key.strip_prefix(section)?.strip_prefix('.'))
            .collect(),
        None => vec![],
    };
    match section {
        Some("plant") => known.extend(["geometric_stiffness", "model"]),
        Some("root_gauge") => known.push("measures"),
        Some("surface") => known.push("features"),
        _ => {}
    }
    if known.is_empty() {
        let mut sections: Vec<&str> = KEYS
            .iter()
            .copied()
            .flatten()
            .filter_map(|key| Some(key.name.split_once('.')?.0))
            .collect();
        sections.sort_unstable();
        sections.dedup();
        let name = section.unwrap_or(name);
        return format!(
            "{name}: unknown; accepted: base, arm, task, board, controller, [failed], [verdict], [[faults]] and the sections {}",
            sections.join(", ")
        );
    }
    format!("{name}: unknown; accepted: {}", known.join(", "))
}

/// What a key accepts, in words.
fn accepted(key: &Key) -> String {
    let (low, high) = (Shortest(key.low), Shortest(key.high));
    let range = if key.above {
        format!("{} above {low} up to {high}", key.what)
    } else {
        format!("{} from {low} to {high}", key.what)
    };
    let spreads = if key.whole {
        "a spread { choice = [...] }"
    } else {
        "a spread within that: { uniform = [low, high] }, log_uniform (above 0), { normal = [mean, deviation] } (three of them) or { choice = [...] }"
    };
    format!("{range}, or {spreads}")
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    }
}

/// The spread of a table; `None` if it is none.
fn spread(table: &Table) -> Option<Distribution> {
    let mut entries = table.iter();
    let (Some((name, Value::Array(array))), None) = (entries.next(), entries.next()) else {
        return None;
    };
    let numbers: Vec<f64> = array.iter().map(number).collect::<Option<_>>()?;
    if numbers.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let pair = <[f64; 2]>::try_from(numbers.clone()).ok();
    let rising = pair.filter(|[low, high]| low <= high);
    match name.as_str() {
        "uniform" => rising.map(Distribution::Uniform),
        "log_uniform" => rising
            .filter(|[low, _]| *low > 0.0)
            .map(Distribution::LogUniform),
        "normal" => pair
            .filter(|[_, deviation]| *deviation >= 0.0)
            .map(Distribution::Normal),
        "choice" if !numbers.is_empty() => Some(Distribution::Choice(numbers)),
        _ => None,
    }
}

/// A value in a line, as it could be written.
fn short(value: &Value) -> String {
    match value {
        Value::String(text) => format!("{text:?}"),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => Shortest(*number).to_string(),
        Value::Boolean(yes) => yes.to_string(),
        Value::Datetime(time) => time.to_string(),
        Value::Array(values) => {
            let inner: Vec<String> = values.iter().map(short).collect();
            format!("[{}]", inner.join(", "))
        }
        Value::Table(table) => {
            let inner: Vec<String> = table
                .iter()
                .map(|(key, value)| format!("{key} = {}", short(value)))
                .collect();
            format!("{{ {} }}", inner.join(", "))
        }
    }
}

/// A table as a text: one line a value, keys in the table's order, which is that of the alphabet.
fn canonical(table: &Table) -> String {
    let mut text = String::new();
    for (section, value) in table {
        match value {
            Value::Table(inner) => {
                for (name, value) in inner {
                    let _ = writeln!(text, "{section}.{name} = {}", exact(value));
                }
            }
            value => {
                let _ = writeln!(text, "{section} = {}", exact(value));
            }
        }
    }
    text
}

/// A value with every digit.
fn exact(value: &Value) -> String {
    match value {
        Value::Array(values) => {
            let inner: Vec<String> = values.iter().map(exact).collect();
            format!("[{}]", inner.join(", "))
        }
        Value::Table(table) => {
            let inner: Vec<String> = table
                .iter()
                .map(|(key, value)| format!("{key} = {}", exact(value)))
                .collect();
            format!("{{ {} }}", inner.join(", "))
        }
        value => number(value).map_or_else(|| short(value), |x| x.to_string()),
    }
}

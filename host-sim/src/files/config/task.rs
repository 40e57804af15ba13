//! `task.toml`: path, force, and times before and after.

use super::{Check, ConfigError, accepted, optional_pair, pair, parse};
use crate::planner::path::{LinePath, Profile};
use crate::planner::task::{Task, Window};
use crate::planner::tip_force::SurfaceFriction;
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TaskFile {
    duration_s: f64,
    pre_actuation_s: WindowFile,
    post_actuation_s: WindowFile,
    #[serde(default = "default_actuation_tolerance")]
    actuation_tolerance: f64,
    path: PathFile,
    force: ForceFile,
    surface: Option<SurfaceFile>,
}

/// Ratio to which "auto" lets the link's motion decay: the paper's fast task then starts
/// with a slope rate of 1e-6 rad/s instead of 1.3.
fn default_actuation_tolerance() -> f64 {
    1e-6
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathFile {
    #[serde(deserialize_with = "pair")]
    from_m: [f64; 2],
    #[serde(deserialize_with = "pair")]
    to_m: [f64; 2],
    profile: ProfileFile,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum ProfileFile {
    Poly11,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ForceFile {
    #[serde(rename = "normal_N")]
    normal: f64,
    #[serde(default, deserialize_with = "optional_pair")]
    direction: Option<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SurfaceFile {
    #[serde(default)]
    friction: f64,
    friction_way_m: Option<f64>,
}

/// Seconds, or "auto".
enum WindowFile {
    Seconds(f64),
    Auto,
}

impl<'de> Deserialize<'de> for WindowFile {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Words;
        impl Visitor<'_> for Words {
            type Value = WindowFile;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or \"auto\"")
            }
            fn visit_f64<E: de::Error>(self, v: f64) -> Result<WindowFile, E> {
                Ok(WindowFile::Seconds(v))
            }
            fn visit_i64<E: de::Error>(self, v: i64) -> Result<WindowFile, E> {
                Ok(WindowFile::Seconds(v as f64))
            }
            fn visit_str<E: de::Error>(self, v: &str) -> Result<WindowFile, E> {
                if v == "auto" {
                    Ok(WindowFile::Auto)
                } else {
                    Err(E::invalid_value(de::Unexpected::Str(v), &self))
                }
            }
        }
        deserializer.deserialize_any(Words)
    }
}

/// Reads the text of a `task.toml`; `file` is its name for messages.
///
/// # Errors
/// [`ConfigError`].
pub fn parse_task(file: &str, text: &str) -> Result<Task, ConfigError> {
    let read: TaskFile = parse(file, text)?;
    let check = Check { file };
    let tolerance = check.value("actuation_tolerance", read.actuation_tolerance)?;
    let window = |field: &str, window: &WindowFile| match window {
        WindowFile::Seconds(seconds) => check.value(field, *seconds).map(Window::Fixed),
        WindowFile::Auto => Ok(Window::Auto { tolerance }),
    };
    if let Some(direction) = read.force.direction {
        check.pair("force.direction", direction)?;
        if direction == [0.0; 2] {
            return Err(ConfigError::OutOfRange {
                file: file.to_string(),
                field: "force.direction".to_string(),
                value: 0.0,
                accepted: accepted("force.direction").unwrap_or_default(),
            });
        }
    }
    let mut friction = SurfaceFriction::default();
    if let Some(surface) = read.surface {
        friction.coefficient = check.value("surface.friction", surface.friction)?;
        let way = check.optional("surface.friction_way_m", surface.friction_way_m)?;
        friction.way_m = way.unwrap_or(friction.way_m);
    }
    Ok(Task {
        path: LinePath {
            from: check.pair("path.from_m", read.path.from_m)?,
            to: check.pair("path.to_m", read.path.to_m)?,
            duration: check.value("duration_s", read.duration_s)?,
            profile: match read.path.profile {
                ProfileFile::Poly11 => Profile::Poly11,
            },
        },
        normal_force: check.value("force.normal_N", read.force.normal)?,
        direction: read.force.direction,
        friction,
        pre_actuation: window("pre_actuation_s", &read.pre_actuation_s)?,
        post_actuation: window("post_actuation_s", &read.post_actuation_s)?,
    })
}

//! `task.toml`: path, force, and times before and after.

use super::{
    Check, ConfigError, FILE_BYTES_MAX, WRITTEN_MAX, accepted, optional_pair, pair, parse,
    read_text,
};
use crate::planner::path::{LinePath, Profile};
use crate::planner::task::{Ends, Task, Travel, Window};
use crate::planner::tip_force::{ForceProfile, NormalForce, SurfaceFriction};
use crate::text::one_line;
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TaskFile {
    duration_s: f64,
    pre_actuation_s: WindowFile,
    post_actuation_s: WindowFile,
    #[serde(default = "default_actuation_tolerance")]
    actuation_tolerance: f64,
    #[serde(default)]
    ends: EndsFile,
    path: PathFile,
    force: ForceFile,
    surface: Option<SurfaceFile>,
}

/// Ratio to which "auto" lets the link's motion decay: the paper's fast task then starts
/// with a slope rate of 1e-6 rad/s instead of 1.3.
pub(super) fn default_actuation_tolerance() -> f64 {
    1e-6
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum EndsFile {
    #[default]
    Spectral,
    Dirichlet,
}

impl From<EndsFile> for Ends {
    fn from(read: EndsFile) -> Self {
        match read {
            EndsFile::Spectral => Self::Spectral,
            EndsFile::Dirichlet => Self::Dirichlet,
        }
    }
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

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ProfileFile {
    #[default]
    Poly11,
}

impl From<ProfileFile> for Profile {
    fn from(read: ProfileFile) -> Self {
        match read {
            ProfileFile::Poly11 => Self::Poly11,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ForceFile {
    #[serde(rename = "normal_N")]
    normal: Option<f64>,
    #[serde(rename = "profile_m_N")]
    profile: Option<Vec<WayPointFile>>,
    profile_csv: Option<PathBuf>,
    #[serde(default, deserialize_with = "optional_pair")]
    direction: Option<[f64; 2]>,
}

/// A place along the path, m, and the force there, N.
#[derive(Deserialize)]
struct WayPointFile(#[serde(deserialize_with = "pair")] [f64; 2]);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SurfaceFile {
    #[serde(default)]
    friction: f64,
    friction_way_m: Option<f64>,
}

/// Seconds, or "auto".
pub(super) enum WindowFile {
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

/// The window that `field` gives, with the tolerance of an "auto".
pub(super) fn window(
    check: &Check<'_>,
    field: &str,
    read: &WindowFile,
    tolerance: f64,
) -> Result<Window, ConfigError> {
    match read {
        WindowFile::Seconds(seconds) => check.value(field, *seconds).map(Window::Fixed),
        WindowFile::Auto => Ok(Window::Auto { tolerance }),
    }
}

/// The planned force: a constant, or a profile for `path` from the task or a file beside it.
fn normal_force(
    check: &Check<'_>,
    read: &ForceFile,
    path: &LinePath,
) -> Result<NormalForce, ConfigError> {
    let malformed = |message: String| ConfigError::Malformed {
        file: check.file.to_string(),
        message,
    };
    let profile = |key: &str, way_points: &[[f64; 2]]| {
        let profile = ForceProfile::new(way_points, path.length());
        profile
            .map(NormalForce::Along)
            .map_err(|error| malformed(format!("{key}: {error}")))
    };
    match (read.normal, &read.profile, &read.profile_csv) {
        (Some(force), None, None) => check.value("force.normal_N", force).map(Into::into),
        (None, Some(way_points), None) => {
            let way_points: Vec<_> = way_points.iter().map(|point| point.0).collect();
            profile("force.profile_m_N", &way_points)
        }
        (None, None, Some(csv)) => {
            let folder = Path::new(check.file).parent().unwrap_or(Path::new(""));
            let (file, text) = read_text(&folder.join(csv), FILE_BYTES_MAX)?;
            let way_points = parse_way_points(&file, &text)?;
            profile(&format!("force.profile_csv, {file}"), &way_points)
        }
        (None, None, None) => Err(malformed(format!(
            "force.normal_N: missing; accepted: {}, or force.profile_m_N or force.profile_csv",
            accepted("force.normal_N").unwrap_or_default()
        ))),
        _ => Err(malformed(
            "force: more than one of normal_N, profile_m_N and profile_csv; accepted: one of them"
                .into(),
        )),
    }
}

/// The way-points in a file of force over way: a line `s_m,force_N`, then two numbers a line. Empty
/// lines and those that begin with # are passed over.
fn parse_way_points(file: &str, text: &str) -> Result<Vec<[f64; 2]>, ConfigError> {
    const HEADER: &str = "s_m,force_N";
    let lines = (1..).zip(text.lines().map(str::trim));
    let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let malformed = |number: usize, line: &str, accepted: &str| ConfigError::Malformed {
        file: file.to_string(),
        message: format!(
            "line {number}: {:?}; accepted: {accepted}",
            one_line(line, WRITTEN_MAX)
        ),
    };
    match lines.next() {
        Some((_, line)) if line.replace(' ', "").eq_ignore_ascii_case(HEADER) => {}
        Some((number, line)) => return Err(malformed(number, line, HEADER)),
        None => return Err(malformed(1, "", HEADER)),
    }
    lines
        .map(|(number, line)| {
            let numbers = line.split_once(',');
            let numbers = numbers.and_then(|(way, force)| {
                Some([way.trim().parse().ok()?, force.trim().parse().ok()?])
            });
            numbers.ok_or_else(|| malformed(number, line, "a way in m, a comma, a force in N"))
        })
        .collect()
}

/// Reads the text of a `task.toml`; `file` is its name for messages, and in its folder lies the file
/// that it may name.
///
/// # Errors
/// [`ConfigError`].
pub fn parse_task(file: &str, text: &str) -> Result<Task, ConfigError> {
    let read: TaskFile = parse(file, text)?;
    let check = Check { file };
    let tolerance = check.value("actuation_tolerance", read.actuation_tolerance)?;
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
    let path = LinePath {
        from: check.pair("path.from_m", read.path.from_m)?,
        to: check.pair("path.to_m", read.path.to_m)?,
        duration: check.value("duration_s", read.duration_s)?,
        profile: read.path.profile.into(),
    };
    Ok(Task {
        travel: Travel::Line,
        normal_force: normal_force(&check, &read.force, &path)?,
        path,
        direction: read.force.direction,
        friction,
        pre_actuation: window(&check, "pre_actuation_s", &read.pre_actuation_s, tolerance)?,
        post_actuation: window(
            &check,
            "post_actuation_s",
            &read.post_actuation_s,
            tolerance,
        )?,
        ends: read.ends.into(),
    })
}

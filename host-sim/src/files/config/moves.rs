//! A task file with a `[move]`: a move through the air, and times before and after.

use super::task::{ProfileFile, WindowFile, default_actuation_tolerance, parse_task, window};
use super::{Check, ConfigError, FILE_BYTES_MAX, optional_pair, parse, read_text};
use crate::planner::free_move::{FreeMove, MoveEnd};
use crate::planner::path::Profile;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::path::{Path, PathBuf};

/// Whatever the file holds besides.
#[derive(Deserialize)]
struct Kind {
    #[serde(rename = "move")]
    is_move: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MoveTaskFile {
    duration_s: f64,
    #[serde(default = "auto")]
    pre_actuation_s: WindowFile,
    #[serde(default = "auto")]
    post_actuation_s: WindowFile,
    #[serde(default = "default_actuation_tolerance")]
    actuation_tolerance: f64,
    #[serde(rename = "move")]
    way: MoveFile,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MoveFile {
    #[serde(default, deserialize_with = "optional_pair")]
    from_rad: Option<[f64; 2]>,
    #[serde(default, deserialize_with = "optional_pair")]
    from_motor_rad: Option<[f64; 2]>,
    from_task: Option<PathBuf>,
    #[serde(default, deserialize_with = "optional_pair")]
    to_rad: Option<[f64; 2]>,
    #[serde(default, deserialize_with = "optional_pair")]
    to_motor_rad: Option<[f64; 2]>,
    to_task: Option<PathBuf>,
    clearance_m: Option<f64>,
    #[serde(default)]
    profile: ProfileFile,
}

/// A joint starts and stops without a jerk only where the link may bend before and after.
fn auto() -> WindowFile {
    WindowFile::Auto
}

/// As far as a run lifts the tip off at its end where nothing else is said, m.
const CLEARANCE_M: f64 = 0.02;

/// One end of a move: exactly one of the three ways to say it.
fn end(
    check: &Check<'_>,
    [rad, motor_rad, of_task]: [&str; 3],
    (angles, motors, file): (Option<[f64; 2]>, Option<[f64; 2]>, Option<&Path>),
    clearance_m: f64,
) -> Result<MoveEnd, ConfigError> {
    match (angles, motors, file) {
        (Some(angles), None, None) => check.pair(rad, angles).map(MoveEnd::Angles),
        (None, Some(motors), None) => check.pair(motor_rad, motors).map(MoveEnd::Motors),
        (None, None, Some(file)) => {
            let folder = Path::new(check.file).parent().unwrap_or(Path::new(""));
            let (file, text) = read_text(&folder.join(file), FILE_BYTES_MAX)?;
            Ok(MoveEnd::Task {
                task: Box::new(parse_task(&file, &text)?),
                clearance_m,
            })
        }
        (None, None, None) => Err(ConfigError::Malformed {
            file: check.file.to_string(),
            message: format!("{rad}: missing; accepted: {rad}, {motor_rad} or {of_task}"),
        }),
        _ => Err(ConfigError::Malformed {
            file: check.file.to_string(),
            message: format!(
                "move: more than one of {rad}, {motor_rad} and {of_task}; accepted: one of them"
            ),
        }),
    }
}

/// Reads the text of a task file that is a move through the air; `None` for one that is not. `file`
/// is its name for messages, and in its folder lie the tasks that it may name.
///
/// # Errors
/// [`ConfigError`].
pub fn parse_move(file: &str, text: &str) -> Result<Option<FreeMove>, ConfigError> {
    // What is no file at all is said by whoever reads it as a task.
    let kind: Result<Kind, _> = parse(file, text);
    if !kind.is_ok_and(|kind| kind.is_move.is_some()) {
        return Ok(None);
    }
    let read: MoveTaskFile = parse(file, text)?;
    let check = Check { file };
    let tolerance = check.value("actuation_tolerance", read.actuation_tolerance)?;
    let way = &read.way;
    let clearance = check.optional("move.clearance_m", way.clearance_m)?;
    let clearance_m = clearance.unwrap_or(CLEARANCE_M);
    let from = (way.from_rad, way.from_motor_rad, way.from_task.as_deref());
    let to = (way.to_rad, way.to_motor_rad, way.to_task.as_deref());
    let names = |end: &str| ["rad", "motor_rad", "task"].map(|what| format!("move.{end}_{what}"));
    let [from_names, to_names] = [names("from"), names("to")];
    Ok(Some(FreeMove {
        from: end(
            &check,
            from_names.each_ref().map(String::as_str),
            from,
            clearance_m,
        )?,
        to: end(
            &check,
            to_names.each_ref().map(String::as_str),
            to,
            clearance_m,
        )?,
        duration_s: check.value("duration_s", read.duration_s)?,
        profile: Profile::from(way.profile),
        pre_actuation: window(&check, "pre_actuation_s", &read.pre_actuation_s, tolerance)?,
        post_actuation: window(
            &check,
            "post_actuation_s",
            &read.post_actuation_s,
            tolerance,
        )?,
    }))
}

//! A board file: what control, planning and simulation must know of a board.

use super::{Check, ConfigError, accepted, pair, parse};
use crate::text::Shortest;
use flexor::supervisor::BoardParameters;
use serde::Deserialize;

/// A board file's content.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardConfig {
    /// The board's name: that of its folder among the firmware's boards.
    pub name: String,
    /// Its sensors, drives, rate and limits.
    pub parameters: BoardParameters,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoardFile {
    name: String,
    #[serde(rename = "tick_rate_Hz")]
    tick_rate: u32,
    encoders: EncodersFile,
    force_cell: ForceCellFile,
    root_gauge: RootGaugeFile,
    converter: ConverterFile,
    drives: DrivesFile,
    enabling: EnablingFile,
    link: LinkFile,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EncodersFile {
    #[serde(deserialize_with = "pair")]
    lines: [u32; 2],
    #[serde(deserialize_with = "pair")]
    gear_ratio: [f64; 2],
    #[serde(deserialize_with = "pair")]
    sign: [i64; 2],
    #[serde(deserialize_with = "pair")]
    home_rad: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ForceCellFile {
    #[serde(rename = "range_N")]
    #[serde(deserialize_with = "pair")]
    range: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RootGaugeFile {
    #[serde(deserialize_with = "pair")]
    range_rad: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConverterFile {
    bits: u32,
    rail_counts: u32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DrivesFile {
    #[serde(rename = "full_scale_Nm")]
    #[serde(deserialize_with = "pair")]
    full_scale: [f64; 2],
    #[serde(deserialize_with = "pair")]
    sign: [i64; 2],
    bits: u32,
    usable_share: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EnablingFile {
    #[serde(deserialize_with = "pair")]
    angle_rad: [f64; 2],
    slope_rad: f64,
    #[serde(deserialize_with = "pair")]
    motor_rad: [f64; 2],
    soft_start_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LinkFile {
    timeout_s: f64,
}

/// Longest name of a board, characters.
const NAME_MAX: usize = 32;

/// Narrowest range of a sensor, N or rad, whose counts are still numbers in the tick's `f32`.
const RANGE_MIN: f64 = 1e-9;

/// Reads the text of a board file; `file` is its name for messages.
///
/// # Errors
/// [`ConfigError`].
pub fn parse_board(file: &str, text: &str) -> Result<BoardConfig, ConfigError> {
    let read: BoardFile = parse(file, text)?;
    let check = Check { file };
    let (encoders, drives) = (read.encoders, read.drives);
    let rail_counts = check.whole("converter.rail_counts", read.converter.rail_counts)?;
    let parameters = BoardParameters {
        tick_rate_hz: check.whole("tick_rate_Hz", read.tick_rate)?,
        encoder_lines: {
            check.pair("encoders.lines", encoders.lines.map(f64::from))?;
            encoders.lines
        },
        encoder_gear_ratio: check.pair("encoders.gear_ratio", encoders.gear_ratio)?,
        encoder_reversed: reversed(file, "encoders.sign", encoders.sign)?,
        home_rad: check.pair("encoders.home_rad", encoders.home_rad)?,
        force_range_n: check.pair("force_cell.range_N", read.force_cell.range)?,
        gauge_range_rad: check.pair("root_gauge.range_rad", read.root_gauge.range_rad)?,
        converter_bits: check.whole("converter.bits", read.converter.bits)?,
        // Within the range of its field, and so of the type.
        rail_counts: rail_counts as u16,
        drive_full_scale_nm: check.pair("drives.full_scale_Nm", drives.full_scale)?,
        drive_reversed: reversed(file, "drives.sign", drives.sign)?,
        drive_bits: check.whole("drives.bits", drives.bits)?,
        drive_usable_share: check.value("drives.usable_share", drives.usable_share)?,
        start_angle_rad: check.pair("enabling.angle_rad", read.enabling.angle_rad)?,
        start_slope_rad: check.value("enabling.slope_rad", read.enabling.slope_rad)?,
        start_motor_rad: check.pair("enabling.motor_rad", read.enabling.motor_rad)?,
        soft_start_s: check.value("enabling.soft_start_s", read.enabling.soft_start_s)?,
        link_timeout_s: check.value("link.timeout_s", read.link.timeout_s)?,
    };
    check_rails(file, &parameters)?;
    Ok(BoardConfig {
        name: named(file, read.name)?,
        parameters,
    })
}

/// A value that no range says all about; `field` is one of the list's.
fn malformed(file: &str, field: &str, value: &str, more: &str) -> ConfigError {
    let accepted = accepted(field).unwrap_or_default();
    ConfigError::Malformed {
        file: file.to_string(),
        message: format!("{field} = {value}; accepted: {accepted}{more}"),
    }
}

/// The name, if it can be that of a folder with sources.
fn named(file: &str, name: String) -> Result<String, ConfigError> {
    let good = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    if name.is_empty() || name.len() > NAME_MAX || !name.chars().all(good) {
        let shown = super::one_line(&format!("{name:?}"), super::WRITTEN_MAX);
        return Err(malformed(file, "name", &shown, ""));
    }
    Ok(name)
}

/// Which of two signs are -1.
fn reversed(file: &str, field: &str, signs: [i64; 2]) -> Result<[bool; 2], ConfigError> {
    if signs.iter().all(|sign| [1, -1].contains(sign)) {
        Ok(signs.map(|sign| sign == -1))
    } else {
        Err(malformed(file, field, &format!("{signs:?}"), ""))
    }
}

/// Checks that either sensor has counts off the rails, that of none among them.
fn check_rails(file: &str, board: &BoardParameters) -> Result<(), ConfigError> {
    let (least, largest) = board.calibration().range;
    // Half the range: a quarter of it at either end is no rail any more.
    if 4 * u32::from(least) > u32::from(board.converter_count_max()) {
        return Err(malformed(
            file,
            "converter.rail_counts",
            &least.to_string(),
            ", at most a quarter of those that converter.bits give",
        ));
    }
    for (field, range, scale) in [
        (
            "force_cell.range_N",
            board.force_range_n,
            board.force_scale(),
        ),
        (
            "root_gauge.range_rad",
            board.gauge_range_rad,
            board.slope_scale(),
        ),
    ] {
        let off_the_rails =
            f64::from(least) <= scale.zero_count && scale.zero_count <= f64::from(largest);
        if !off_the_rails || (range[1] - range[0]).abs() < RANGE_MIN {
            let [low, high] = range.map(Shortest);
            let more = ", 1e-9 apart at least, whose 0 is converter.rail_counts from either end";
            return Err(malformed(file, field, &format!("[{low}, {high}]"), more));
        }
    }
    Ok(())
}

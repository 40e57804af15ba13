//! The user's files: arm, task, controller, plant and board, in TOML.
//!
//! Every number has a range; every error is one line that names the file, the field,
//! its value and what is accepted. Unknown keys are refused, with the known ones named.

mod arm;
mod board;
mod controller;
mod hybrid;
mod moves;
mod plant;
mod ranges;
#[cfg(feature = "campaign")]
mod scenario;
#[cfg(feature = "stability")]
mod spread;
mod task;
mod written;

use self::ranges::{RANGES, accepted};
use crate::text::{Shortest, one_line};
use serde::de::{DeserializeOwned, Error as _, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::marker::PhantomData;
use std::path::Path;

pub use arm::{ArmConfig, parse_arm};
pub use board::{BoardConfig, parse_board};
pub use controller::{DERIVATIVE_FILTER_HZ, controller_toml, parse_controller};
pub use moves::parse_move;
pub use plant::parse_plant;
#[cfg(feature = "campaign")]
pub use scenario::{ScenarioConfig, load_scenario, parse_scenario};
#[cfg(feature = "stability")]
pub use spread::parse_spread;
pub use task::parse_task;

/// The arm that is used when no file is given: the paper's, `examples/arm.toml`.
pub const DEFAULT_ARM: &str = include_str!("../../../examples/arm.toml");
/// The task that is used when no file is given: the paper's, `examples/task.toml`.
pub const DEFAULT_TASK: &str = include_str!("../../../examples/task.toml");
/// The controller that is used when no file is given, of the hybrid law:
/// `examples/controller.toml`.
pub const DEFAULT_CONTROLLER: &str = include_str!("../../../examples/controller.toml");
/// The controller of the paper's law, which is used when no file is given where the paper's figures
/// are made: `examples/controller_paper.toml`.
pub const PAPER_CONTROLLER: &str = include_str!("../../../examples/controller_paper.toml");
/// The board that is used when no file is given: `boards/stm32f405.toml`.
pub const DEFAULT_BOARD: &str = include_str!("../../../boards/stm32f405.toml");
/// The plants that gains are examined with when no file is given: `examples/spread.toml`.
pub const DEFAULT_SPREAD: &str = include_str!("../../../examples/spread.toml");

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// It cannot be read.
    #[error("{file}: cannot be read: {cause}")]
    Unreadable {
        /// The file.
        file: String,
        /// Why.
        cause: std::io::Error,
    },
    /// It is not TOML, or not of the right structure.
    #[error("{file}: {message}")]
    Malformed {
        /// The file.
        file: String,
        /// Where and what, with what is accepted.
        message: String,
    },
    /// A value is out of its range.
    #[error("{file}: {field} = {}; accepted: {accepted}", Shortest(*value))]
    OutOfRange {
        /// The file.
        file: String,
        /// Dotted name of the field.
        field: String,
        /// Its value.
        value: f64,
        /// The range.
        accepted: String,
    },
    /// A value on the command line is out of its range.
    #[error("{option} {}; accepted: {accepted}", Shortest(*value))]
    Option {
        /// The option, as it is typed.
        option: &'static str,
        /// Its value.
        value: f64,
        /// The range.
        accepted: String,
    },
}

/// Reads TOML; errors become one line.
fn parse<T: DeserializeOwned>(file: &str, text: &str) -> Result<T, ConfigError> {
    let malformed = |message: String| ConfigError::Malformed {
        file: file.to_string(),
        message: one_line(&message, MESSAGE_MAX),
    };
    let line = |error: &toml::de::Error| {
        let at = error.span().map_or(0, |span| span.start.min(text.len()));
        text.as_bytes()[..at]
            .iter()
            .filter(|b| **b == b'\n')
            .count()
            + 1
    };
    // What the file says at the error.
    let written = |error: &toml::de::Error| {
        let there = error.span().and_then(|span| text.get(span));
        there
            .map(|words| one_line(words, WRITTEN_MAX))
            .filter(|words| !words.is_empty())
    };
    let deserializer = toml::Deserializer::parse(text).map_err(|e| {
        let key = match written(&e) {
            Some(key) if e.message() == "duplicate key" => format!(" {key}"),
            _ => String::new(),
        };
        malformed(format!("line {}: {}{key}", line(&e), e.message()))
    })?;
    serde_path_to_error::deserialize(deserializer).map_err(|e| {
        let path = e.path().to_string();
        let inner = e.inner();
        let message = inner.message();
        // An element of an array is named like the array.
        let accepted = |field: &str| accepted(field.split('[').next().unwrap_or_default());
        // "missing field `x`" comes with the path of its table.
        let missing = message
            .strip_prefix("missing field `")
            .and_then(|m| m.strip_suffix('`'));
        if let Some(name) = missing {
            let field = match path.as_str() {
                "." => name.to_string(),
                table => format!("{table}.{name}"),
            };
            let hint = accepted(&field).map_or(String::new(), |a| format!("; accepted: {a}"));
            return malformed(format!("{field}: {message}{hint}"));
        }
        let place = format!("line {}: {}", line(inner), one_line(&path, WRITTEN_MAX));
        // These are about the key, all others about its value.
        let of_key = ["unknown field", "duplicate field"];
        let of_key = of_key.iter().any(|words| message.starts_with(words));
        malformed(match (written(inner), accepted(&path)) {
            (Some(value), Some(accepted)) if !of_key => {
                format!("{place} = {value}; accepted: {accepted}")
            }
            _ => format!("{place}: {message}"),
        })
    })
}

/// Characters of what a file says that a message repeats.
const WRITTEN_MAX: usize = 40;

/// Characters of a message about a file.
const MESSAGE_MAX: usize = 400;

/// Bytes of a file that are read: enough for any of these files with comments.
pub const FILE_BYTES_MAX: u64 = 1 << 20;

/// Checks values against their ranges.
struct Check<'a> {
    file: &'a str,
}

impl Check<'_> {
    fn value(&self, field: &str, value: f64) -> Result<f64, ConfigError> {
        let name = field.split('[').next().unwrap_or_default();
        let Some(range) = RANGES.iter().find(|r| r.field == name) else {
            debug_assert!(false, "{field} has no range");
            return Ok(value);
        };
        if range.holds(value) {
            Ok(value)
        } else {
            Err(ConfigError::OutOfRange {
                file: self.file.to_string(),
                field: field.to_string(),
                value,
                accepted: range.to_string(),
            })
        }
    }

    fn pair(&self, field: &str, values: [f64; 2]) -> Result<[f64; 2], ConfigError> {
        self.value(&format!("{field}[0]"), values[0])?;
        self.value(&format!("{field}[1]"), values[1])?;
        Ok(values)
    }

    fn optional(&self, field: &str, value: Option<f64>) -> Result<Option<f64>, ConfigError> {
        value.map(|v| self.value(field, v)).transpose()
    }

    /// Whole numbers are read as integers; only their range is left to check.
    fn whole(&self, field: &str, value: u32) -> Result<u32, ConfigError> {
        self.value(field, f64::from(value)).map(|_| value)
    }
}

/// Checks the number given with `option`, say `--plant-elements`, against the range of the
/// file's `field` that it goes before.
///
/// # Errors
/// [`ConfigError::Option`].
pub fn check_option(
    option: &'static str,
    field: &'static str,
    value: f64,
) -> Result<f64, ConfigError> {
    match RANGES.iter().find(|range| range.field == field) {
        Some(range) if !range.holds(value) => Err(ConfigError::Option {
            option,
            value,
            accepted: range.to_string(),
        }),
        Some(_) => Ok(value),
        None => {
            debug_assert!(false, "{field} has no range");
            Ok(value)
        }
    }
}

/// Reads `path`, or takes `default` where there is none, and hands name and text to
/// `parse`.
///
/// # Errors
/// [`ConfigError`].
pub fn load<T>(
    path: Option<&Path>,
    default: &str,
    parse: impl Fn(&str, &str) -> Result<T, ConfigError>,
) -> Result<T, ConfigError> {
    let Some(path) = path else {
        return parse("built-in example", default);
    };
    let (file, text) = read_text(path, FILE_BYTES_MAX)?;
    parse(&file, &text)
}

/// The name and the text of a file of up to `bytes_max` bytes.
///
/// # Errors
/// [`ConfigError::Unreadable`], [`ConfigError::Malformed`] if it is longer.
pub fn read_text(path: &Path, bytes_max: u64) -> Result<(String, String), ConfigError> {
    let file = path.display().to_string();
    let mut text = String::new();
    // One byte more than is accepted; a device would never end.
    let read =
        File::open(path).and_then(|opened| opened.take(bytes_max + 1).read_to_string(&mut text));
    match read {
        Ok(bytes) if bytes as u64 > bytes_max => Err(ConfigError::Malformed {
            file,
            message: format!("more than {bytes_max} bytes; accepted: up to as many"),
        }),
        Ok(_) => Ok((file, text)),
        Err(cause) => Err(ConfigError::Unreadable { file, cause }),
    }
}

/// Exactly two values; serde's own arrays leave a third one unread.
fn pair<'de, T, D>(deserializer: D) -> Result<[T; 2], D::Error>
where
    T: Copy + Default + Deserialize<'de>,
    D: Deserializer<'de>,
{
    struct Two<T>(PhantomData<T>);
    impl<'de, T: Copy + Default + Deserialize<'de>> Visitor<'de> for Two<T> {
        type Value = [T; 2];
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("an array of length 2")
        }
        fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<[T; 2], A::Error> {
            let mut values = [T::default(); 2];
            for (i, value) in values.iter_mut().enumerate() {
                *value = list
                    .next_element()?
                    .ok_or_else(|| A::Error::invalid_length(i, &self))?;
            }
            let mut length = 2;
            while list.next_element::<IgnoredAny>()?.is_some() {
                length += 1;
            }
            if length > 2 {
                return Err(A::Error::invalid_length(length, &self));
            }
            Ok(values)
        }
    }
    deserializer.deserialize_seq(Two(PhantomData))
}

/// [`pair`] of a key that may be missing.
fn optional_pair<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[f64; 2]>, D::Error> {
    pair(deserializer).map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::task::Window;

    #[test]
    fn the_examples_are_the_papers_arm_and_task() {
        let config = parse_arm("arm", DEFAULT_ARM).unwrap();
        assert_eq!(config.arm, crate::testing::PAPER);
        assert_eq!((config.elements, config.limits), (3, None));
        let task = parse_task("task", DEFAULT_TASK).unwrap();
        assert_eq!((task.path.from, task.path.to), ([0.7, 0.05], [0.2, 0.05]));
        assert_eq!((task.path.duration, task.normal_force), (2.0, 2.0.into()));
        let law = parse_controller("controller", PAPER_CONTROLLER).unwrap();
        assert_eq!(law.name(), "paper");
        let spread = parse_spread("spread", DEFAULT_SPREAD).unwrap();
        assert_eq!(spread.bending_stiffness_scale, [0.8, 1.0, 1.2]);
        assert!(spread.tick_rate_hz.is_empty() && spread.elements.is_empty());
        let soft = include_str!("../../../examples/plant_soft.toml");
        assert_eq!(
            parse_plant("plant", soft)
                .unwrap()
                .0
                .bending_stiffness_scale,
            0.9
        );
    }

    fn arm_error(from: &str, to: &str) -> String {
        assert!(DEFAULT_ARM.contains(from));
        parse_arm("arm.toml", &DEFAULT_ARM.replacen(from, to, 1))
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn errors_are_one_line_with_field_value_and_what_is_accepted() {
        for (from, to, expected) in [
            (
                "length_m = 0.5\n",
                "length_m = -0.5\n",
                "arm.toml: link1.length_m = -0.5; accepted: a length in m from 0.001 to 100",
            ),
            (
                "length_m = 0.5\n",
                "",
                "arm.toml: link1.length_m: missing field `length_m`; accepted: a length in m from 0.001 to 100",
            ),
            (
                "length_m = 0.5\n",
                "length_m = \"long\"\n",
                "arm.toml: line 4: link1.length_m = \"long\"; accepted: a length in m from 0.001 to 100",
            ),
            (
                "mass_kg = 0.24",
                "mass_kg = nan",
                "arm.toml: link2.mass_kg = NaN; accepted: a mass in kg from 1e-6 to 100000",
            ),
            (
                "[0.0, 9.81]",
                "[0.0, inf]",
                "arm.toml: base.gravity_m_s2[1] = inf; accepted: two accelerations in m/s^2 from -1000 to 1000",
            ),
            (
                "mass_kg = 8.0",
                "mas_kg = 8.0",
                "arm.toml: line 5: link1.mas_kg: unknown field `mas_kg`, expected `length_m` or `mass_kg`",
            ),
            (
                "\"down\"",
                "\"sideways\"",
                "arm.toml: line 23: base.elbow = \"sideways\"; accepted: \"down\" or \"up\"",
            ),
            (
                "\"down\"",
                "3",
                "arm.toml: line 23: base.elbow = 3; accepted: \"down\" or \"up\"",
            ),
            (
                "[0.0, 9.81]",
                "[0.0,  9.81, 3.0]",
                "arm.toml: line 22: base.gravity_m_s2 = [0.0, 9.81, 3.0]; accepted: two accelerations in m/s^2 from -1000 to 1000",
            ),
            (
                "mass_kg = 8.0",
                "mass_kg = 8.0\nmass_kg = 9.0",
                "arm.toml: line 6: duplicate key mass_kg",
            ),
            (
                "mass_kg = 0.24",
                "mass_kg = 1e-300",
                "arm.toml: link2.mass_kg = 1e-300; accepted: a mass in kg from 1e-6 to 100000",
            ),
            (
                "elements = 3",
                "elements = 0",
                "arm.toml: link2.elements = 0; accepted: a whole number of elements from 1 to 12",
            ),
        ] {
            assert_eq!(arm_error(from, to), expected);
        }
        assert!(arm_error("elements = 3", "elements = -3").contains("link2.elements"));
        assert!(arm_error("[link1]", "[link1").starts_with("arm.toml: line 3: "));
        assert!(arm_error("[0.0, 9.81]", "[0.0]").contains("base.gravity_m_s2"));
    }

    #[test]
    fn windows_are_numbers_or_auto() {
        let with = |value: &str| {
            let text = DEFAULT_TASK.replacen(
                "pre_actuation_s = 0.0",
                &format!("pre_actuation_s = {value}"),
                1,
            );
            parse_task("task.toml", &text)
        };
        assert_eq!(with("1").unwrap().pre_actuation, Window::Fixed(1.0));
        assert!(matches!(
            with("\"auto\"").unwrap().pre_actuation,
            Window::Auto { .. }
        ));
        for bad in ["\"soon\"", "-0.1", "nan", "[1.0]", "true"] {
            let error = with(bad).unwrap_err().to_string();
            assert!(
                error.contains("pre_actuation_s") && error.contains("auto"),
                "{error}"
            );
            assert!(!error.contains('\n'));
        }
    }

    #[test]
    fn a_spread_names_what_is_wrong_with_it() {
        for (text, words) in [
            (
                "bending_stiffness_scale = []",
                "bending_stiffness_scale = []; accepted",
            ),
            (
                "link2_mass_scale = [1.0, -1.0]",
                "link2_mass_scale[1] = -1; accepted",
            ),
            (
                "tick_rate_Hz = [1]",
                "tick_rate_Hz[0] = 1; accepted: control rates in Hz",
            ),
            ("elements = [17]", "elements[0] = 17; accepted"),
            ("stiffness = [1.0]", "unknown field `stiffness`"),
        ] {
            let error = parse_spread("spread.toml", text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        let many = format!("contact_angle_rad = {:?}", vec![0.0; 1001]);
        let error = parse_spread("spread.toml", &many).unwrap_err().to_string();
        assert!(
            error.contains("1001 combinations; accepted: up to 1000"),
            "{error}"
        );
    }

    #[test]
    fn a_derivative_gain_has_a_filter() {
        let text = PAPER_CONTROLLER.replacen("K_DF_s = 0.0", "K_DF_s = 0.01", 1);
        let law = parse_controller("controller.toml", &text).unwrap();
        assert_eq!(
            law.paper().unwrap().force_filter_hz,
            Some(DERIVATIVE_FILTER_HZ)
        );
        let law = parse_controller("controller.toml", PAPER_CONTROLLER).unwrap();
        assert_eq!(law.paper().unwrap().force_filter_hz, None);
    }
}

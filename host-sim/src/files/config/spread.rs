//! A spread file: the plants that gains are examined and tuned with.

use super::{Check, ConfigError, parse};
use crate::plant::spread::Spread;
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SpreadFile {
    #[serde(default = "unscaled")]
    bending_stiffness_scale: Vec<f64>,
    #[serde(default = "unscaled")]
    link2_mass_scale: Vec<f64>,
    #[serde(default = "nothing_added")]
    added_root_inertia_kgm2: Vec<f64>,
    #[serde(default = "nothing_added")]
    contact_angle_rad: Vec<f64>,
    #[serde(default, rename = "tick_rate_Hz")]
    tick_rate: Vec<u32>,
    #[serde(default)]
    elements: Vec<u32>,
}

fn unscaled() -> Vec<f64> {
    vec![1.0]
}

fn nothing_added() -> Vec<f64> {
    vec![0.0]
}

/// Most plants of a spread: three or four values of each property make no more. Each costs
/// some milliseconds to examine, and `gains tune` as much again for every law.
const SPREAD_MAX: usize = 1000;

/// Reads the text of a spread file; `file` is its name for messages.
///
/// # Errors
/// [`ConfigError`].
pub fn parse_spread(file: &str, text: &str) -> Result<Spread, ConfigError> {
    let read: SpreadFile = parse(file, text)?;
    let check = Check { file };
    let list = |field: &str, values: Vec<f64>| {
        if values.is_empty() {
            return Err(ConfigError::Malformed {
                file: file.to_string(),
                message: format!("{field} = []; accepted: at least one value"),
            });
        }
        for (i, value) in values.iter().enumerate() {
            check.value(&format!("{field}[{i}]"), *value)?;
        }
        Ok(values)
    };
    let whole = |field: &str, values: Vec<u32>| {
        for (i, value) in values.iter().enumerate() {
            check.whole(&format!("{field}[{i}]"), *value)?;
        }
        Ok(values)
    };
    let spread = Spread {
        bending_stiffness_scale: list("bending_stiffness_scale", read.bending_stiffness_scale)?,
        link2_mass_scale: list("link2_mass_scale", read.link2_mass_scale)?,
        added_root_inertia_kgm2: list("added_root_inertia_kgm2", read.added_root_inertia_kgm2)?,
        contact_angle_rad: list("contact_angle_rad", read.contact_angle_rad)?,
        tick_rate_hz: whole("tick_rate_Hz", read.tick_rate)?,
        elements: whole("elements", read.elements)?
            .into_iter()
            .map(|elements| elements as usize)
            .collect(),
    };
    let plants = spread.plants();
    if plants > SPREAD_MAX {
        return Err(ConfigError::Malformed {
            file: file.to_string(),
            message: format!("{plants} combinations; accepted: up to {SPREAD_MAX}"),
        });
    }
    Ok(spread)
}

//! `arm.toml`: the arm and its drives.

use super::{Check, ConfigError, pair, parse};
use flexor::control::LimitParameters;
use flexor::model::{ArmParameters, Elbow};
use serde::Deserialize;

/// `arm.toml`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmConfig {
    /// The arm's physical data.
    pub arm: ArmParameters,
    /// Elements of link 2 to plan with.
    pub elements: usize,
    /// The drives' limits, if the file has them.
    pub limits: Option<LimitParameters>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ArmFile {
    link1: Link1File,
    link2: Link2File,
    base: BaseFile,
    limits: Option<LimitsFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Link1File {
    length_m: f64,
    mass_kg: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Link2File {
    length_m: f64,
    mass_kg: f64,
    #[serde(rename = "bending_stiffness_Nm2")]
    bending_stiffness: f64,
    damping_ratio: f64,
    elements: u32,
    #[serde(default)]
    root_inertia_kgm2: f64,
    #[serde(default)]
    tip_mass_kg: f64,
    #[serde(default)]
    tip_inertia_kgm2: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BaseFile {
    #[serde(deserialize_with = "pair")]
    gravity_m_s2: [f64; 2],
    elbow: ElbowFile,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum ElbowFile {
    Down,
    Up,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LimitsFile {
    #[serde(rename = "torque_Nm")]
    #[serde(deserialize_with = "pair")]
    torque: [f64; 2],
    #[serde(rename = "torque_rate_Nm_s")]
    #[serde(deserialize_with = "pair")]
    torque_rate: [f64; 2],
}

/// Reads the text of an `arm.toml`; `file` is its name for messages.
///
/// # Errors
/// [`ConfigError`].
pub fn parse_arm(file: &str, text: &str) -> Result<ArmConfig, ConfigError> {
    let read: ArmFile = parse(file, text)?;
    let check = Check { file };
    let (link1, link2, base) = (read.link1, read.link2, read.base);
    let limits = read.limits.map(|limits| {
        Ok(LimitParameters {
            torque_nm: check.pair("limits.torque_Nm", limits.torque)?,
            torque_rate_nm_s: check.pair("limits.torque_rate_Nm_s", limits.torque_rate)?,
        })
    });
    Ok(ArmConfig {
        arm: ArmParameters {
            link1_length_m: check.value("link1.length_m", link1.length_m)?,
            link1_mass_kg: check.value("link1.mass_kg", link1.mass_kg)?,
            link2_length_m: check.value("link2.length_m", link2.length_m)?,
            link2_mass_kg: check.value("link2.mass_kg", link2.mass_kg)?,
            bending_stiffness_nm2: check
                .value("link2.bending_stiffness_Nm2", link2.bending_stiffness)?,
            damping_ratio: check.value("link2.damping_ratio", link2.damping_ratio)?,
            root_inertia_kgm2: check.value("link2.root_inertia_kgm2", link2.root_inertia_kgm2)?,
            tip_mass_kg: check.value("link2.tip_mass_kg", link2.tip_mass_kg)?,
            tip_inertia_kgm2: check.value("link2.tip_inertia_kgm2", link2.tip_inertia_kgm2)?,
            gravity_m_s2: check.pair("base.gravity_m_s2", base.gravity_m_s2)?,
            elbow: match base.elbow {
                ElbowFile::Down => Elbow::Down,
                ElbowFile::Up => Elbow::Up,
            },
        },
        elements: check.whole("link2.elements", link2.elements)? as usize,
        limits: limits.transpose()?,
    })
}

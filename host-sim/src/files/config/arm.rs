//! `arm.toml`: the arm and its drives.

use super::{Check, ConfigError, pair, parse};
use crate::model::link::{LinkDamping, LinkKind, LinkModel};
use crate::planner::monitors::{default_monitors, planned_speed};
use crate::planner::plan::Plan;
use flexor::control::{LawParameters, LimitParameters};
use flexor::model::{ArmParameters, Elbow};
use flexor::supervisor::MonitorParameters;
use serde::Deserialize;

/// The link's model where a file says none: the one that is true for links that bend.
const MODEL: LinkModel = LinkModel::Geometric;

/// `arm.toml`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmConfig {
    /// The arm's physical data.
    pub arm: ArmParameters,
    /// Elements of link 2 to plan with.
    pub elements: usize,
    /// How link 2 bends and is damped.
    pub link: LinkKind,
    /// The drives' limits, if the file has them.
    pub limits: Option<LimitParameters>,
    /// Thresholds of the monitors, as far as the file has them.
    pub monitors: MonitorConfig,
}

/// `[monitors]` of `arm.toml`: what it leaves out is derived from the plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MonitorConfig {
    path_rad: Option<[f64; 2]>,
    speed_rad_s: Option<[f64; 2]>,
    #[serde(rename = "force_N")]
    force_n: Option<f64>,
    #[serde(rename = "root_moment_Nm")]
    root_moment_nm: Option<f64>,
    #[serde(rename = "balance_Nm")]
    balance_nm: Option<[f64; 2]>,
}

impl MonitorConfig {
    /// The thresholds for `plan` and `law`; `file` is their name for messages.
    ///
    /// # Errors
    /// [`ConfigError::OutOfRange`] for one that would alarm on the plan itself.
    pub fn checked(
        &self,
        file: &str,
        plan: &Plan,
        law: &LawParameters,
    ) -> Result<MonitorParameters, ConfigError> {
        let least = |threshold: &mut f32, (key, given): (String, Option<f64>), least, what| {
            let Some(value) = given else {
                return Ok(());
            };
            // NaN is not above anything.
            if value > least {
                *threshold = value as f32;
                return Ok(());
            }
            Err(ConfigError::OutOfRange {
                file: file.into(),
                field: format!("monitors.{key}"),
                value,
                accepted: format!("{what} above {least:.4}, or inf for no limit"),
            })
        };
        let planned = planned_speed(plan);
        let mut monitors = default_monitors(plan, law);
        let (angle, force, moment) = ("an angle in rad", "a force in N", "a moment in N m");
        let speed = "a speed in rad/s, the planned one being less:";
        for i in 0..2 {
            let each = |name: &str, pair: Option<[f64; 2]>| {
                (format!("{name}[{i}]"), pair.map(|pair| pair[i]))
            };
            let (path, rate, balance) = (
                each("path_rad", self.path_rad),
                each("speed_rad_s", self.speed_rad_s),
                each("balance_Nm", self.balance_nm),
            );
            least(&mut monitors.path_rad[i], path, 0.0, angle)?;
            least(&mut monitors.speed_rad_s[i], rate, planned[i], speed)?;
            least(&mut monitors.balance_nm[i], balance, 0.0, moment)?;
        }
        let lasting = ("force_N".into(), self.force_n);
        least(&mut monitors.force_n, lasting, 0.0, force)?;
        let root = ("root_moment_Nm".into(), self.root_moment_nm);
        least(&mut monitors.root_moment_nm, root, 0.0, moment)?;
        Ok(monitors)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ArmFile {
    link1: Link1File,
    link2: Link2File,
    base: BaseFile,
    limits: Option<LimitsFile>,
    #[serde(default)]
    monitors: MonitorConfig,
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
    model: Option<ModelFile>,
    damping: Option<DampingFile>,
    bending_damping_s: Option<f64>,
    #[serde(default)]
    root_inertia_kgm2: f64,
    #[serde(default)]
    tip_mass_kg: f64,
    #[serde(default)]
    tip_inertia_kgm2: f64,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ModelFile {
    Linear,
    Geometric,
}

impl From<ModelFile> for LinkModel {
    fn from(read: ModelFile) -> Self {
        match read {
            ModelFile::Linear => Self::Linear,
            ModelFile::Geometric => Self::Geometric,
        }
    }
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum DampingFile {
    Modal,
    Bending,
}

/// How link 2 is damped, if the file says so; `key` is the name of the retardation time.
pub(super) fn link_damping(
    check: &Check<'_>,
    damping: Option<DampingFile>,
    (key, time_s): (&str, Option<f64>),
) -> Result<Option<LinkDamping>, ConfigError> {
    let time_s = check.optional(key, time_s)?;
    match (damping, time_s) {
        (Some(DampingFile::Bending), time_s) => Ok(Some(LinkDamping::Bending { time_s })),
        (Some(DampingFile::Modal), None) => Ok(Some(LinkDamping::Modal)),
        (None, None) => Ok(None),
        (_, Some(value)) => Err(ConfigError::OutOfRange {
            file: check.file.to_string(),
            field: key.to_string(),
            value,
            accepted: format!(
                "it beside {} = \"bending\"",
                key.replace("bending_damping_s", "damping")
            ),
        }),
    }
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
        link: LinkKind {
            model: link2.model.map_or(MODEL, LinkModel::from),
            damping: link_damping(
                &check,
                link2.damping,
                ("link2.bending_damping_s", link2.bending_damping_s),
            )?
            .unwrap_or_default(),
        },
        limits: limits.transpose()?,
        monitors: read.monitors,
    })
}

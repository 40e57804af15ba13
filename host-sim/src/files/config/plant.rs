//! A plant file: how the simulated arm differs from the planned one.

use super::arm::{DampingFile, ModelFile, link_damping};
use super::{Check, ConfigError, optional_pair, parse};
use crate::model::geometric_stiffness::GeometricStiffness;
use crate::model::link::LinkModel;
use crate::plant::PlantParameters;
use crate::simulation::start::Start;
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use toml::Value;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlantFile {
    elements: Option<u32>,
    bending_stiffness_scale: Option<f64>,
    link1_mass_scale: Option<f64>,
    link2_mass_scale: Option<f64>,
    damping_scale: Option<f64>,
    root_inertia_kgm2: Option<f64>,
    tip_mass_kg: Option<f64>,
    tip_inertia_kgm2: Option<f64>,
    #[serde(rename = "viscous_friction_Nms_rad")]
    #[serde(default, deserialize_with = "optional_pair")]
    viscous_friction: Option<[f64; 2]>,
    #[serde(rename = "coulomb_friction_Nm")]
    #[serde(default, deserialize_with = "optional_pair")]
    coulomb_friction: Option<[f64; 2]>,
    #[serde(default, deserialize_with = "optional_stiffness")]
    geometric_stiffness: Option<GeometricStiffness>,
    model: Option<ModelFile>,
    damping: Option<DampingFile>,
    bending_damping_s: Option<f64>,
    substeps: Option<u32>,
    start: Option<StartFile>,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum StartFile {
    PlanMoving,
    PlanAtRest,
    Equilibrium,
}

/// Geometric stiffness as files say it: a name; `true` is everything, `false` nothing.
pub(super) fn geometric_stiffness(value: &Value) -> Option<GeometricStiffness> {
    match value {
        Value::Boolean(on) => Some(GeometricStiffness::from(*on)),
        Value::String(name) => GeometricStiffness::from_name(name),
        _ => None,
    }
}

fn optional_stiffness<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<GeometricStiffness>, D::Error> {
    let value = Value::deserialize(deserializer)?;
    geometric_stiffness(&value)
        .map(Some)
        .ok_or_else(|| D::Error::custom("not a name of a geometric stiffness"))
}

/// Reads the text of a plant file; `file` is its name for messages. What the file
/// leaves out is as in [`PlantParameters::default`] and [`Start::default`].
///
/// # Errors
/// [`ConfigError`].
pub fn parse_plant(file: &str, text: &str) -> Result<(PlantParameters, Start), ConfigError> {
    let read: PlantFile = parse(file, text)?;
    let check = Check { file };
    let scale =
        |field: &str, value: Option<f64>| check.optional(field, value).map(|v| v.unwrap_or(1.0));
    let pair =
        |field: &str, value: Option<[f64; 2]>| value.map_or(Ok([0.0; 2]), |v| check.pair(field, v));
    let default = PlantParameters::default();
    let parameters = PlantParameters {
        elements: match read.elements {
            Some(elements) => check.whole("elements", elements)? as usize,
            None => default.elements,
        },
        bending_stiffness_scale: scale("bending_stiffness_scale", read.bending_stiffness_scale)?,
        link1_mass_scale: scale("link1_mass_scale", read.link1_mass_scale)?,
        link2_mass_scale: scale("link2_mass_scale", read.link2_mass_scale)?,
        damping_scale: scale("damping_scale", read.damping_scale)?,
        root_inertia_kgm2: check.optional("root_inertia_kgm2", read.root_inertia_kgm2)?,
        tip_mass_kg: check.optional("tip_mass_kg", read.tip_mass_kg)?,
        tip_inertia_kgm2: check.optional("tip_inertia_kgm2", read.tip_inertia_kgm2)?,
        viscous_friction_nms_rad: pair("viscous_friction_Nms_rad", read.viscous_friction)?,
        coulomb_friction_nm: pair("coulomb_friction_Nm", read.coulomb_friction)?,
        link_model: read.model.map(LinkModel::from),
        link_damping: link_damping(
            &check,
            read.damping,
            ("bending_damping_s", read.bending_damping_s),
        )?,
        geometric_stiffness: read.geometric_stiffness.unwrap_or_default(),
        substeps: read
            .substeps
            .map(|s| check.whole("substeps", s))
            .transpose()?,
    };
    let start = match read.start {
        Some(StartFile::PlanMoving) => Start::PlanMoving,
        Some(StartFile::PlanAtRest) => Start::PlanAtRest,
        Some(StartFile::Equilibrium) => Start::Equilibrium,
        None => Start::default(),
    };
    Ok((parameters, start))
}

//! Plants that differ from the planned arm: a variant, and a spread of them.

use crate::model::arm_model::{ArmModel, ModelError};
use crate::model::link::LinkKind;
use crate::plant::PlantParameters;
use crate::text::Shortest;
use flexor::model::ArmParameters;

/// A plant to examine: how it differs from the planned arm, with its model.
#[derive(Clone, Debug)]
pub struct PlantVariant {
    /// The plant's parameters.
    pub parameters: PlantParameters,
    /// Turn of the real surface's normal against the planned one, rad.
    pub contact_angle_rad: f64,
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// The plant's model.
    pub model: ArmModel,
}

impl PlantVariant {
    /// The plant that differs by `parameters` from the arm `planned`, on a surface turned by
    /// `contact_angle_rad`, controlled at `tick_rate_hz`.
    ///
    /// # Errors
    /// [`ModelError`].
    pub fn new(
        planned: &ArmParameters,
        tick_rate_hz: u32,
        parameters: &PlantParameters,
        contact_angle_rad: f64,
    ) -> Result<Self, ModelError> {
        Ok(Self {
            parameters: *parameters,
            contact_angle_rad,
            tick_rate_hz,
            model: parameters.model(planned, LinkKind::default())?,
        })
    }

    /// The planned arm itself, whose model is `planned`.
    pub fn planned(planned: &ArmModel, tick_rate_hz: u32) -> Self {
        Self {
            parameters: PlantParameters {
                elements: planned.elements,
                ..PlantParameters::default()
            },
            contact_angle_rad: 0.0,
            tick_rate_hz,
            model: planned.clone(),
        }
    }
}

/// Plants to examine: all combinations of the values.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Factors on link 2's bending stiffness.
    pub bending_stiffness_scale: Vec<f64>,
    /// Factors on link 2's mass.
    pub link2_mass_scale: Vec<f64>,
    /// Inertias added to the root's, kg m^2.
    pub added_root_inertia_kgm2: Vec<f64>,
    /// Turns of the surface's normal, rad.
    pub contact_angle_rad: Vec<f64>,
    /// Control rates, Hz; empty for the plan's.
    pub tick_rate_hz: Vec<u32>,
    /// Elements of link 2; empty for the plant's own.
    pub elements: Vec<usize>,
}

impl Spread {
    /// No spread: a plant as it is.
    pub fn none() -> Self {
        Self {
            bending_stiffness_scale: vec![1.0],
            link2_mass_scale: vec![1.0],
            added_root_inertia_kgm2: vec![0.0],
            contact_angle_rad: vec![0.0],
            tick_rate_hz: vec![],
            elements: vec![],
        }
    }

    /// Number of combinations.
    pub fn plants(&self) -> usize {
        let lists = [
            self.bending_stiffness_scale.len(),
            self.link2_mass_scale.len(),
            self.added_root_inertia_kgm2.len(),
            self.contact_angle_rad.len(),
            self.tick_rate_hz.len().max(1),
            self.elements.len().max(1),
        ];
        lists.into_iter().fold(1, usize::saturating_mul)
    }

    /// Every combination around `plant`, with a name; the arm `planned` and `tick_rate_hz` are
    /// those of the plan.
    ///
    /// # Errors
    /// [`ModelError`].
    pub fn variants(
        &self,
        planned: &ArmParameters,
        tick_rate_hz: u32,
        plant: &PlantParameters,
    ) -> Result<Vec<(String, PlantVariant)>, ModelError> {
        let rates = or_own(&self.tick_rate_hz, tick_rate_hz);
        let meshes = or_own(&self.elements, plant.elements);
        let root = plant.root_inertia_kgm2.unwrap_or(planned.root_inertia_kgm2);
        let mut variants = vec![];
        for &stiffness in &self.bending_stiffness_scale {
            for &mass in &self.link2_mass_scale {
                for &inertia in &self.added_root_inertia_kgm2 {
                    let parameters = PlantParameters {
                        bending_stiffness_scale: plant.bending_stiffness_scale * stiffness,
                        link2_mass_scale: plant.link2_mass_scale * mass,
                        root_inertia_kgm2: Some(root + inertia),
                        ..*plant
                    };
                    let name = format!(
                        "stiffness x {}, mass x {}, root + {} kg m2",
                        Shortest(stiffness),
                        Shortest(mass),
                        Shortest(inertia)
                    );
                    self.placed(planned, &parameters, &name, &meshes, &rates, &mut variants)?;
                }
            }
        }
        Ok(variants)
    }

    /// Adds the plant with `parameters` and `name` on every surface, with every mesh and at
    /// every rate to `variants`.
    fn placed(
        &self,
        planned: &ArmParameters,
        parameters: &PlantParameters,
        name: &str,
        meshes: &[usize],
        rates: &[u32],
        variants: &mut Vec<(String, PlantVariant)>,
    ) -> Result<(), ModelError> {
        for &angle in &self.contact_angle_rad {
            for &elements in meshes {
                let parameters = PlantParameters {
                    elements,
                    ..*parameters
                };
                let model = parameters.model(planned, LinkKind::default())?;
                for &rate in rates {
                    let mut name = name.to_string();
                    if self.contact_angle_rad.len() > 1 {
                        name += &format!(", contact turned by {} rad", Shortest(angle));
                    }
                    if meshes.len() > 1 {
                        name += &format!(", {elements} elements");
                    }
                    if rates.len() > 1 {
                        name += &format!(", {rate} Hz");
                    }
                    let variant = PlantVariant {
                        parameters,
                        contact_angle_rad: angle,
                        tick_rate_hz: rate,
                        model: model.clone(),
                    };
                    variants.push((name, variant));
                }
            }
        }
        Ok(())
    }
}

/// `values`, or the plant's or plan's `own` one where there are none.
fn or_own<T: Copy>(values: &[T], own: T) -> Vec<T> {
    if values.is_empty() {
        vec![own]
    } else {
        values.to_vec()
    }
}

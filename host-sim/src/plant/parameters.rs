//! How a plant differs from the arm that was planned for.

use crate::model::arm_model::{ArmModel, ModelError};
use crate::model::geometric_stiffness::GeometricStiffness;
use crate::model::link::{LinkDamping, LinkKind, LinkModel};
use flexor::model::ArmParameters;

/// How the plant differs from the arm that was planned for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantParameters {
    /// Elements of link 2.
    pub elements: usize,
    /// Factor on link 2's bending stiffness.
    pub bending_stiffness_scale: f64,
    /// Factor on link 1's mass.
    pub link1_mass_scale: f64,
    /// Factor on link 2's mass.
    pub link2_mass_scale: f64,
    /// Factor on the damping ratio.
    pub damping_scale: f64,
    /// Root inertia, kg m^2; `None` for the arm's.
    pub root_inertia_kgm2: Option<f64>,
    /// Tip mass, kg; `None` for the arm's.
    pub tip_mass_kg: Option<f64>,
    /// Tip inertia, kg m^2; `None` for the arm's.
    pub tip_inertia_kgm2: Option<f64>,
    /// Viscous friction of the two joints, N m s/rad.
    pub viscous_friction_nms_rad: [f64; 2],
    /// Coulomb friction of the two joints, N m.
    pub coulomb_friction_nm: [f64; 2],
    /// How link 2 bends; `None` for as it was planned.
    pub link_model: Option<LinkModel>,
    /// How link 2 is damped; `None` for as it was planned.
    pub link_damping: Option<LinkDamping>,
    /// Axial forces that change the bending stiffness of the linear model.
    pub geometric_stiffness: GeometricStiffness,
    /// Integration steps a control period; `None` derives them from the highest
    /// frequency.
    pub substeps: Option<u32>,
}

impl Default for PlantParameters {
    /// The arm as it is, with eight elements.
    fn default() -> Self {
        Self {
            elements: 8,
            bending_stiffness_scale: 1.0,
            link1_mass_scale: 1.0,
            link2_mass_scale: 1.0,
            damping_scale: 1.0,
            root_inertia_kgm2: None,
            tip_mass_kg: None,
            tip_inertia_kgm2: None,
            viscous_friction_nms_rad: [0.0; 2],
            coulomb_friction_nm: [0.0; 2],
            link_model: None,
            link_damping: None,
            geometric_stiffness: GeometricStiffness::None,
            substeps: None,
        }
    }
}

impl PlantParameters {
    /// The model of the plant that differs so from the arm `planned`, with a link 2 of the kind
    /// `link`.
    ///
    /// # Errors
    /// [`ModelError`] for a number of elements or data that no model can be made of.
    pub fn model(&self, planned: &ArmParameters, link: LinkKind) -> Result<ArmModel, ModelError> {
        let mut model = ArmModel::of_kind(&self.arm(planned), self.elements, self.link(link))?;
        self.geometric_stiffness.restrict(&mut model);
        Ok(model)
    }

    /// The kind of its link 2, where that of the arm that was planned for is `planned`.
    pub fn link(&self, planned: LinkKind) -> LinkKind {
        let damping = self.link_damping.unwrap_or(planned.damping);
        LinkKind {
            model: self.link_model.unwrap_or(planned.model),
            damping: match damping {
                LinkDamping::Modal => LinkDamping::Modal,
                LinkDamping::Bending { time_s } => LinkDamping::Bending {
                    time_s: time_s.map(|time_s| self.damping_scale * time_s),
                },
            },
        }
    }

    /// The arm that the plant is.
    pub fn arm(&self, planned: &ArmParameters) -> ArmParameters {
        ArmParameters {
            link1_mass_kg: planned.link1_mass_kg * self.link1_mass_scale,
            link2_mass_kg: planned.link2_mass_kg * self.link2_mass_scale,
            bending_stiffness_nm2: planned.bending_stiffness_nm2 * self.bending_stiffness_scale,
            damping_ratio: planned.damping_ratio * self.damping_scale,
            root_inertia_kgm2: self.root_inertia_kgm2.unwrap_or(planned.root_inertia_kgm2),
            tip_mass_kg: self.tip_mass_kg.unwrap_or(planned.tip_mass_kg),
            tip_inertia_kgm2: self.tip_inertia_kgm2.unwrap_or(planned.tip_inertia_kgm2),
            ..*planned
        }
    }
}

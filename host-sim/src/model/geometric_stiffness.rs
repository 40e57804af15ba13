//! Which axial forces change link 2's bending stiffness.

use crate::model::arm_model::ArmModel;

/// Axial forces that change link 2's bending stiffness: compression softens it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum GeometricStiffness {
    /// None.
    #[default]
    None,
    /// The contact force's part along link 2's chord, the same all along the link.
    Contact,
    /// That and the link's own: gravity, inertia of the motion and centrifugal force.
    Full,
}

/// The names in files.
const NAMES: [(GeometricStiffness, &str); 3] = [
    (GeometricStiffness::None, "none"),
    (GeometricStiffness::Contact, "contact"),
    (GeometricStiffness::Full, "full"),
];

impl GeometricStiffness {
    /// The one of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        NAMES
            .iter()
            .find(|(_, n)| *n == name)
            .map(|(kind, _)| *kind)
    }

    /// Whether there is any.
    pub fn is_any(self) -> bool {
        self != Self::None
    }

    /// Leaves in `model` the geometric stiffness of these forces alone.
    pub(crate) fn restrict(self, model: &mut ArmModel) {
        if self == Self::Contact {
            model.geometric_axial.fill(0.0);
            model.geometric_centrifugal.fill(0.0);
        }
    }
}

/// Everything, or nothing: what files said with `true` and `false` at first.
impl From<bool> for GeometricStiffness {
    fn from(on: bool) -> Self {
        if on { Self::Full } else { Self::None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn the_contacts_alone_keeps_the_tips_matrix_and_drops_the_links_own() {
        let arm = testing::arms()[0];
        let whole = ArmModel::new(&arm, 4).unwrap();
        for kind in [GeometricStiffness::None, GeometricStiffness::Full] {
            let mut model = whole.clone();
            kind.restrict(&mut model);
            assert_eq!(model.geometric_axial, whole.geometric_axial);
        }
        let mut model = whole.clone();
        GeometricStiffness::Contact.restrict(&mut model);
        assert_eq!(model.geometric_tip, whole.geometric_tip);
        assert!(whole.geometric_axial.norm() > 0.0 && whole.geometric_centrifugal.norm() > 0.0);
        assert_eq!(model.geometric_axial.norm(), 0.0);
        assert_eq!(model.geometric_centrifugal.norm(), 0.0);
    }

    #[test]
    fn names_come_back() {
        for (kind, name) in NAMES {
            assert_eq!(GeometricStiffness::from_name(name), Some(kind));
        }
        assert_eq!(GeometricStiffness::from_name("tip"), None);
        assert_eq!(GeometricStiffness::from(true), GeometricStiffness::Full);
        assert_eq!(GeometricStiffness::from(false), GeometricStiffness::None);
    }
}

//! Arms that the unit tests share.

use flexor::model::{ArmParameters, Elbow};

/// The paper's arm (Table 1), elbow down.
pub(crate) const PAPER: ArmParameters = ArmParameters::PAPER;

/// The paper's arm and one with every optional part, other proportions and tilted
/// gravity.
pub(crate) fn arms() -> [ArmParameters; 2] {
    [
        PAPER,
        ArmParameters {
            link1_length_m: 0.42,
            link1_mass_kg: 3.0,
            link2_length_m: 0.5,
            link2_mass_kg: 0.31,
            bending_stiffness_nm2: 1.1,
            damping_ratio: 0.02,
            root_inertia_kgm2: 4e-4,
            tip_mass_kg: 0.05,
            tip_inertia_kgm2: 2e-5,
            gravity_m_s2: [1.0, 7.0],
            elbow: Elbow::Up,
        },
    ]
}

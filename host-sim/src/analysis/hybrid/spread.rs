//! Which arms gains must hold.

use super::plant::LoopPlant;
use crate::model::link::LinkKind;
use flexor::model::ArmParameters;

/// A plant with a name for messages.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedPlant {
    /// What is special about it.
    pub name: String,
    /// The plant.
    pub plant: LoopPlant,
}

/// Ranges in which the arms lie that gains must hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopSpread {
    /// Inertia that turns with link 2's root, kg m^2.
    pub root_inertia_kgm2: [f64; 2],
    /// Factors on link 2's bending stiffness.
    pub bending_stiffness_scale: [f64; 2],
    /// Factors on the links' masses.
    pub mass_scale: [f64; 2],
    /// Factors on the elastic modes' damping.
    pub damping_scale: [f64; 2],
    /// Stiffness of the contact, N/m.
    pub contact_stiffness_n_m: [f64; 2],
    /// Largest friction coefficient of the surface.
    pub friction: f64,
    /// Corner of the drives' lag, Hz.
    pub drive_bandwidth_hz: f64,
    /// Ticks from command to drive.
    pub delay_ticks: usize,
    /// How their link 2 bends.
    pub link: LinkKind,
}

/// Inertia up to which an unknown hub is held, as a share of link 2's mass times its squared length:
/// 1e-3 kg m^2 on the paper's arm.
const UNKNOWN_HUB_SHARE: f64 = 0.0138;

/// What an inertia that a file gives is taken to be known to, as factors.
const KNOWN_HUB: [f64; 2] = [0.5, 2.0];

impl LoopSpread {
    /// As the bench's scenarios spread an arm that was not calibrated. An inertia at the root that
    /// the arm's file gives is known to a factor of two; none is unknown. Link 2 bends as `link` says.
    pub fn uncalibrated(arm: &ArmParameters, link: LinkKind) -> Self {
        let known = arm.root_inertia_kgm2;
        let root_inertia_kgm2 = if known > 0.0 {
            KNOWN_HUB.map(|factor| factor * known)
        } else {
            Self::unknown_root_inertia(arm)
        };
        Self {
            root_inertia_kgm2,
            bending_stiffness_scale: [0.85, 1.15],
            mass_scale: [0.9, 1.1],
            damping_scale: [0.3, 2.0],
            contact_stiffness_n_m: [2e3, 5e4],
            friction: 0.3,
            drive_bandwidth_hz: 300.0,
            delay_ticks: 1,
            link,
        }
    }

    /// With no more friction than is accepted on a path of this [`friction_leverage`], with a tenth to
    /// spare: for a friction that nobody has said.
    ///
    /// [`friction_leverage`]: super::friction_leverage
    pub fn with_friction_for(self, leverage: f64) -> Self {
        let accepted = 0.9 * super::FRICTION_LEVERAGE_MAX / leverage;
        Self {
            friction: self.friction.min(accepted),
            ..self
        }
    }

    /// From a bare root to a heavy hub, kg m^2.
    pub fn unknown_root_inertia(arm: &ArmParameters) -> [f64; 2] {
        let mass = arm.link2_mass_kg + arm.tip_mass_kg;
        let link = mass * arm.link2_length_m * arm.link2_length_m;
        [0.0, UNKNOWN_HUB_SHARE * link]
    }

    /// The plant in the middle, with the lightest root.
    pub fn middle(&self, arm: &ArmParameters) -> LoopPlant {
        LoopPlant {
            root_inertia_kgm2: self.root_inertia_kgm2[0],
            drive_bandwidth_hz: self.drive_bandwidth_hz,
            delay_ticks: self.delay_ticks,
            link: self.link,
            ..LoopPlant::nominal(arm)
        }
    }

    /// The arms at the spread's ends with the tip on the surface, each with the lightest and the
    /// heaviest root.
    pub fn in_contact(&self, arm: &ArmParameters) -> Vec<NamedPlant> {
        let middle = self.middle(arm);
        let [soft, stiff] = self.bending_stiffness_scale;
        let [light, heavy] = self.mass_scale;
        let [rubber, steel] = self.contact_stiffness_n_m;
        let weak = LoopPlant {
            damping_scale: self.damping_scale[0],
            ..middle
        };
        let mut kinds = vec![
            ("the planned link", middle),
            (
                "a soft, heavy, weakly damped link",
                LoopPlant {
                    bending_stiffness_scale: soft,
                    link1_mass_scale: heavy,
                    link2_mass_scale: heavy,
                    ..weak
                },
            ),
            (
                "a stiff, light, weakly damped link",
                LoopPlant {
                    bending_stiffness_scale: stiff,
                    link1_mass_scale: light,
                    link2_mass_scale: light,
                    ..weak
                },
            ),
            (
                "the softest surface",
                LoopPlant {
                    contact_stiffness_n_m: Some(rubber),
                    ..middle
                },
            ),
            (
                "the hardest surface, a weakly damped link",
                LoopPlant {
                    contact_stiffness_n_m: Some(steel),
                    ..weak
                },
            ),
        ];
        if self.friction > 0.0 {
            for friction in [self.friction, -self.friction] {
                let with_friction = LoopPlant { friction, ..middle };
                kinds.push(("friction", with_friction));
                kinds.push((
                    "friction on the softest surface, a soft link",
                    LoopPlant {
                        contact_stiffness_n_m: Some(rubber),
                        bending_stiffness_scale: soft,
                        ..with_friction
                    },
                ));
            }
        }
        self.with_roots(&kinds)
    }

    /// The same with the tip in the air, where surfaces make no difference.
    pub fn in_the_air(&self, arm: &ArmParameters) -> Vec<NamedPlant> {
        let mut all = self.in_contact(arm);
        all.retain(|named| {
            named.plant.friction == 0.0
                && named.plant.contact_stiffness_n_m
                    == LoopPlant::nominal(arm).contact_stiffness_n_m
        });
        for named in &mut all {
            named.plant.contact_stiffness_n_m = None;
            named.name += ", in the air";
        }
        all
    }

    /// Each kind with the roots of both ends, and between them where they are far apart.
    fn with_roots(&self, kinds: &[(&str, LoopPlant)]) -> Vec<NamedPlant> {
        let mut all = vec![];
        for root in self.roots() {
            for (name, plant) in kinds {
                let slid = match plant.friction {
                    mu if mu > 0.0 => format!(" {mu} one way"),
                    mu if mu < 0.0 => format!(" {} the other way", -mu),
                    _ => String::new(),
                };
                all.push(NamedPlant {
                    name: format!("{name}{slid}, root {root:.2e} kg m^2"),
                    plant: LoopPlant {
                        root_inertia_kgm2: root,
                        ..*plant
                    },
                });
            }
        }
        all
    }

    /// Inertias at the root, kg m^2: the ends, and so many between them that they are no more than a
    /// factor of 6 apart; from nothing on a light hub first.
    fn roots(&self) -> Vec<f64> {
        const FACTOR: f64 = 6.0;
        let [low, high] = self.root_inertia_kgm2;
        let mut roots = vec![low];
        let mut next = if low > 0.0 {
            low * FACTOR
        } else {
            high / (FACTOR * FACTOR * FACTOR)
        };
        while next < high * 0.9 {
            roots.push(next);
            next *= FACTOR;
        }
        if high > low {
            roots.push(high);
        }
        roots
    }
}

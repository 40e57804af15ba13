//! One arm of a scenario, its values drawn: what it is made of, apart from the plan.

use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::plant::bench::{CompliantParameters, GearPlay, SensorParameters, SurfaceProfile};
use crate::simulation::bench::{BenchArm, BenchError, TimedFault};
use flexor::model::ArmParameters;

/// An arm with everything around it, in values.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchSetup {
    /// Elements of link 2.
    pub elements: usize,
    /// Factor on link 1's mass.
    pub link1_mass_scale: f64,
    /// Factor on link 2's mass.
    pub link2_mass_scale: f64,
    /// What link 1 is longer than planned, m.
    pub link1_length_offset_m: f64,
    /// What link 2 is longer than planned, m.
    pub link2_length_offset_m: f64,
    /// Factor on the bending stiffness.
    pub bending_stiffness_scale: f64,
    /// Factor on the damping ratio.
    pub damping_scale: f64,
    /// Inertia at link 2's root, kg m^2; `None` for the planned arm's.
    pub root_inertia_kgm2: Option<f64>,
    /// Tip mass, kg; `None` for the planned arm's.
    pub tip_mass_kg: Option<f64>,
    /// Tip inertia, kg m^2; `None` for the planned arm's.
    pub tip_inertia_kgm2: Option<f64>,
    /// Surface, contact, joints and drives. The surface's plane is the plan's, whatever it says.
    pub compliant: CompliantParameters,
    /// Place along the surface about which it is tilted, m; `None` for the middle of the path.
    pub tilt_about_m: Option<f64>,
    /// Gear play of the joints; none where the angle is 0.
    pub gear_play: [GearPlay; 2],
    /// The sensors. Slope a moment and normal are the arm's and the plan's, whatever they say.
    pub sensors: SensorParameters,
    /// What goes wrong, and when.
    pub faults: Vec<TimedFault>,
}

/// A gear's flanks where nothing is said: stiff enough that they turn by 1 mrad under 1 N m.
const FLANKS: GearPlay = GearPlay {
    play_rad: 0.0,
    stiffness_nm_rad: 1000.0,
    damping_nms_rad: 0.1,
};

impl Default for BenchSetup {
    /// The arm as planned, in four elements, on a hard surface without friction, with ideal
    /// joints, drives and sensors, and the gauge showing the slope.
    fn default() -> Self {
        let plane = crate::model::configuration::Surface {
            normal: [0.0, 1.0],
            offset_m: 0.0,
        };
        let mut sensors = SensorParameters::ideal(1.0, plane.normal);
        sensors.gauge_signal = crate::plant::bench::GaugeSignal::Slope;
        Self {
            elements: 4,
            link1_mass_scale: 1.0,
            link2_mass_scale: 1.0,
            link1_length_offset_m: 0.0,
            link2_length_offset_m: 0.0,
            bending_stiffness_scale: 1.0,
            damping_scale: 1.0,
            root_inertia_kgm2: None,
            tip_mass_kg: None,
            tip_inertia_kgm2: None,
            compliant: CompliantParameters::ideal(SurfaceProfile::flat(plane)),
            tilt_about_m: None,
            gear_play: [FLANKS; 2],
            sensors,
            faults: vec![],
        }
    }
}

impl BenchSetup {
    /// The real arm's data where `planned` was planned for.
    pub fn arm(&self, planned: &ArmParameters) -> ArmParameters {
        ArmParameters {
            link1_length_m: planned.link1_length_m + self.link1_length_offset_m,
            link1_mass_kg: planned.link1_mass_kg * self.link1_mass_scale,
            link2_length_m: planned.link2_length_m + self.link2_length_offset_m,
            link2_mass_kg: planned.link2_mass_kg * self.link2_mass_scale,
            bending_stiffness_nm2: planned.bending_stiffness_nm2 * self.bending_stiffness_scale,
            damping_ratio: planned.damping_ratio * self.damping_scale,
            root_inertia_kgm2: self.root_inertia_kgm2.unwrap_or(planned.root_inertia_kgm2),
            tip_mass_kg: self.tip_mass_kg.unwrap_or(planned.tip_mass_kg),
            tip_inertia_kgm2: self.tip_inertia_kgm2.unwrap_or(planned.tip_inertia_kgm2),
            ..*planned
        }
    }

    /// Takes over how a `plant` differs from the planned arm.
    pub fn apply(&mut self, plant: &PlantParameters) {
        self.elements = plant.elements;
        self.link1_mass_scale = plant.link1_mass_scale;
        self.link2_mass_scale = plant.link2_mass_scale;
        self.bending_stiffness_scale = plant.bending_stiffness_scale;
        self.damping_scale = plant.damping_scale;
        self.root_inertia_kgm2 = plant.root_inertia_kgm2;
        self.tip_mass_kg = plant.tip_mass_kg;
        self.tip_inertia_kgm2 = plant.tip_inertia_kgm2;
        self.compliant.geometric_stiffness = plant.geometric_stiffness;
        self.compliant.substeps = plant.substeps;
        for (i, joint) in self.compliant.joints.iter_mut().enumerate() {
            joint.friction.viscous_nms_rad = plant.viscous_friction_nms_rad[i];
            joint.friction.coulomb_nm = plant.coulomb_friction_nm[i];
        }
    }

    /// The same arm on a rigid surface, as far as it can be there: what stability is examined with.
    /// `planned` is the arm that it was planned for.
    pub fn plant(&self, planned: &ArmParameters) -> PlantParameters {
        let friction = self.compliant.joints.map(|joint| joint.friction);
        let rotor = self.compliant.joints[1].reflected_inertia_kgm2();
        PlantParameters {
            elements: self.elements,
            bending_stiffness_scale: self.bending_stiffness_scale,
            link1_mass_scale: self.link1_mass_scale,
            link2_mass_scale: self.link2_mass_scale,
            damping_scale: self.damping_scale,
            root_inertia_kgm2: Some(self.arm(planned).root_inertia_kgm2 + rotor),
            tip_mass_kg: self.tip_mass_kg,
            tip_inertia_kgm2: self.tip_inertia_kgm2,
            viscous_friction_nms_rad: friction.map(|friction| friction.viscous_nms_rad),
            coulomb_friction_nm: friction.map(|friction| friction.coulomb_nm),
            geometric_stiffness: self.compliant.geometric_stiffness,
            substeps: None,
        }
    }

    /// The arm on the bench, at rest where `plan` begins; `seed` determines its noise.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn on_bench(&self, plan: &Plan, seed: u64) -> Result<BenchArm, BenchError> {
        let arm = self.arm(&plan.model.arm);
        let mut parameters = self.compliant.clone();
        let surface = &mut parameters.surface;
        surface.plane = plan.surface;
        let path = &plan.task.path;
        let middle = [0, 1].map(|i| 0.5 * (path.from[i] + path.to[i]));
        surface.reference_m = self.tilt_about_m.unwrap_or_else(|| surface.along(middle));
        for (joint, play) in parameters.joints.iter_mut().zip(self.gear_play) {
            joint.play = (play.play_rad > 0.0).then_some(play);
            let friction = &mut joint.friction;
            friction.breakaway_nm = friction.breakaway_nm.max(friction.coulomb_nm);
        }
        let contact = &mut parameters.contact;
        contact.friction_at_rest = contact.friction_at_rest.max(contact.friction);
        let mut sensors = self.sensors;
        sensors.slope_per_moment = arm.link2_length_m / (3.0 * arm.bending_stiffness_nm2);
        sensors.normal = plan.surface.normal;
        let mut on_bench = BenchArm::new(plan, &arm, self.elements, parameters, sensors)?;
        on_bench.faults.clone_from(&self.faults);
        on_bench.seed = seed;
        Ok(on_bench)
    }
}

//! One arm of a scenario, its values drawn: what it is made of, apart from the plan.

use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::plant::bench::{CompliantParameters, GearPlay, SensorParameters, SurfaceProfile};
use crate::simulation::bench::{BenchArm, BenchError, Course, TimedFault};
use flexor::model::ArmParameters;

/// An arm with everything around it, in values.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchSetup {
    /// How it differs from the planned arm.
    pub plant: PlantParameters,
    /// What link 1 is longer than planned, m.
    pub link1_length_offset_m: f64,
    /// What link 2 is longer than planned, m.
    pub link2_length_offset_m: f64,
    /// Surface, contact, joints and drives. The surface's plane is the plan's, and what `plant` says
    /// of joints, stiffness and steps is that, whatever this says.
    pub compliant: CompliantParameters,
    /// Place along the surface about which it is tilted, m; `None` for the middle of the path.
    pub tilt_about_m: Option<f64>,
    /// Gear play of the joints; none where the angle is 0.
    pub gear_play: [GearPlay; 2],
    /// The sensors. Slope a moment and normal are the arm's and the plan's, whatever they say.
    pub sensors: SensorParameters,
    /// How much of a run there is besides the table.
    pub course: Course,
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
    /// joints, drives and sensors.
    fn default() -> Self {
        let plane = crate::model::configuration::Surface {
            normal: [0.0, 1.0],
            offset_m: 0.0,
        };
        Self {
            plant: PlantParameters {
                elements: 4,
                ..PlantParameters::default()
            },
            link1_length_offset_m: 0.0,
            link2_length_offset_m: 0.0,
            compliant: CompliantParameters::ideal(SurfaceProfile::flat(plane)),
            tilt_about_m: None,
            gear_play: [FLANKS; 2],
            sensors: SensorParameters::ideal(1.0, plane.normal),
            course: Course::default(),
            faults: vec![],
        }
    }
}

impl BenchSetup {
    /// The real arm's data where `planned` was planned for.
    pub fn arm(&self, planned: &ArmParameters) -> ArmParameters {
        let mut arm = self.plant.arm(planned);
        arm.link1_length_m += self.link1_length_offset_m;
        arm.link2_length_m += self.link2_length_offset_m;
        arm
    }

    /// The same arm on a rigid surface, as far as it can be there: what stability is examined with.
    pub fn on_rigid_surface(&self, planned: &ArmParameters) -> PlantParameters {
        let rotor = self.compliant.joints[1].reflected_inertia_kgm2();
        let hub = self.plant.root_inertia_kgm2;
        PlantParameters {
            root_inertia_kgm2: Some(hub.unwrap_or(planned.root_inertia_kgm2) + rotor),
            ..self.plant
        }
    }

    /// The arm on the bench, at rest where `plan` begins; `seed` determines its noise.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn on_bench(&self, plan: &Plan, seed: u64) -> Result<BenchArm, BenchError> {
        let arm = self.arm(&plan.model.arm);
        let mut parameters = self.compliant.clone();
        parameters.geometric_stiffness = self.plant.geometric_stiffness;
        parameters.substeps = self.plant.substeps;
        let surface = &mut parameters.surface;
        surface.plane = plan.surface;
        let path = &plan.task.path;
        let middle = [0, 1].map(|i| 0.5 * (path.from[i] + path.to[i]));
        surface.reference_m = self.tilt_about_m.unwrap_or_else(|| surface.along(middle));
        for (i, joint) in parameters.joints.iter_mut().enumerate() {
            let play = self.gear_play[i];
            joint.play = (play.play_rad > 0.0).then_some(play);
            let friction = &mut joint.friction;
            friction.viscous_nms_rad = self.plant.viscous_friction_nms_rad[i];
            friction.coulomb_nm = self.plant.coulomb_friction_nm[i];
            friction.breakaway_nm = friction.breakaway_nm.max(friction.coulomb_nm);
        }
        let contact = &mut parameters.contact;
        contact.friction_at_rest = contact.friction_at_rest.max(contact.friction);
        let mut sensors = self.sensors;
        sensors.slope_per_moment = 1.0 / arm.moment_per_root_slope();
        sensors.normal = plan.surface.normal;
        let mut on_bench = BenchArm::new(
            plan,
            &arm,
            (self.plant.elements, self.plant.link(plan.model.link.kind)),
            parameters,
            sensors,
            self.course,
        )?;
        on_bench.faults.clone_from(&self.faults);
        on_bench.seed = seed;
        Ok(on_bench)
    }
}

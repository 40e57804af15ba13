//! The bench's plant as a whole.

use crate::model::configuration::{State, Surface};
use crate::model::energy;
use crate::model::geometric_stiffness::GeometricStiffness;
use crate::model::link::LinkKind;
use crate::plant::bench::lanes::Lanes;
use crate::plant::bench::*;
use crate::plant::*;
use crate::testing;
use flexor::model::ArmParameters;
use proptest::prelude::*;

/// Where the paper's path starts.
const PLANE: Surface = Surface {
    normal: [0.0, 1.0],
    offset_m: 0.05,
};
const PERIOD_S: f64 = 1.0 / 5000.0;
const FORCE_N: f64 = 2.0;

fn ideal() -> CompliantParameters {
    CompliantParameters::ideal(SurfaceProfile::flat(PLANE))
}

/// Everything on.
fn everything() -> CompliantParameters {
    let joint = |scale: f64| JointParameters {
        friction: JointFriction {
            coulomb_nm: 0.05,
            breakaway_nm: 0.07,
            viscous_nms_rad: 1e-3,
            ..JointFriction::default()
        },
        cogging: Cogging {
            amplitude_nm: 0.1 * scale,
            ..Cogging::default()
        },
        rotor_inertia_kgm2: 3e-5,
        gear_ratio: 1.0,
        play: None,
    };
    CompliantParameters {
        surface: SurfaceProfile {
            raise_m: 2e-3,
            slope: 0.02,
            reference_m: 0.45,
            waviness_m: 1e-4,
            wavelength_m: 0.05,
            features: vec![SurfaceFeature::Hole {
                from_m: 0.5,
                to_m: 0.53,
                depth_m: 3e-3,
                wall_m: 1e-3,
            }],
            ..SurfaceProfile::flat(PLANE)
        },
        contact: ContactParameters {
            friction: 0.3,
            friction_at_rest: 0.4,
            ..ContactParameters::default()
        },
        joints: [joint(1.0), joint(0.1)],
        drives: [DriveParameters {
            bandwidth_hz: Some(300.0),
            delay_ticks: 1,
            ..DriveParameters::default()
        }; 2],
        geometric_stiffness: GeometricStiffness::Full,
        substeps: None,
    }
}

fn with_play(parameters: CompliantParameters) -> CompliantParameters {
    let mut parameters = parameters;
    parameters.joints[1].play = Some(GearPlay {
        play_rad: 1e-3,
        stiffness_nm_rad: 200.0,
        damping_nms_rad: 0.01,
    });
    parameters.joints[1].rotor_inertia_kgm2 = 3e-5;
    parameters
}

/// `arm` with `elements`, at rest at 0.7 m.
fn resting(
    arm: &ArmParameters,
    elements: usize,
    parameters: &CompliantParameters,
) -> (CompliantPlant<f64>, RestState) {
    let model = parameters
        .model(arm, elements, LinkKind::default())
        .unwrap();
    let start = parameters.rest(&model, 0.7, FORCE_N).unwrap();
    let arm = CompliantArm {
        model: &model,
        parameters,
        start: &start,
    };
    (CompliantPlant::new(&[arm], PERIOD_S, &[]).unwrap(), start)
}

#[test]
fn it_starts_at_its_own_equilibrium_on_the_real_surface() {
    for parameters in [ideal(), everything(), with_play(everything())] {
        let (mut plant, start) = resting(&testing::PAPER, 4, &parameters);
        let first = plant.read();
        assert!((first.force - FORCE_N).abs() < 1e-9);
        assert!((first.tip[0] - 0.7).abs() < 1e-12);
        // Friction does not help: the force along the normal alone holds the tip.
        assert!(first.friction_force == 0.0);
        for _ in 0..500 {
            plant.advance(start.torque);
        }
        let after = plant.read();
        assert!((after.force - FORCE_N).abs() < 1e-6, "{}", after.force);
        assert!((after.tip[0] - 0.7).abs() < 1e-7, "{}", after.tip[0]);
        assert!(after.rate.iter().all(|rate| rate.abs() < 1e-5));
    }
}

#[test]
fn places_without_a_start_are_refused() {
    let mut parameters = ideal();
    let model = parameters
        .model(&testing::PAPER, 3, LinkKind::default())
        .unwrap();
    let error = parameters.rest(&model, 1.2, FORCE_N).unwrap_err();
    assert!(
        matches!(error, CompliantError::Unreachable { .. }),
        "{error}"
    );
    parameters.surface.features = vec![SurfaceFeature::End { at_m: 0.6 }];
    let error = parameters.rest(&model, 0.7, FORCE_N).unwrap_err();
    assert!(matches!(error, CompliantError::NoSurface { .. }), "{error}");
}

#[test]
fn the_gauge_sees_the_moment_and_without_gravity_the_slope() {
    // At rest the root's moment is the drive's torque, and for a link without weight of its own
    // bending, pinned at its chord's ends, the slope is r2 M / (3 EI).
    let arm = ArmParameters {
        gravity_m_s2: [0.0; 2],
        root_inertia_kgm2: 3e-5,
        ..testing::PAPER
    };
    let (mut plant, start) = resting(&arm, 4, &ideal());
    let reading = plant.read();
    assert!((reading.root_moment - start.torque[1]).abs() < 1e-9);
    let slope = arm.link2_length_m * reading.root_moment / (3.0 * arm.bending_stiffness_nm2);
    assert!((reading.root_slope - slope).abs() < 1e-9 * slope.abs());
    // M = r2 f across the link.
    let exact = arm.link2_length_m * libm::cos(reading.angle[1]) * FORCE_N;
    assert!((reading.root_moment - exact).abs() < 1e-9);
    // A hub takes its share of a torque that has just changed.
    plant.advance([start.torque[0], start.torque[1] + 0.1]);
    let after = plant.read();
    assert!((after.root_moment - after.torque[1]).abs() > 1e-3);
}

/// Torques (N m) that move the arm smoothly about its rest.
fn swing(rest: [f64; 2], tick: u32) -> [f64; 2] {
    let t = f64::from(tick) * PERIOD_S;
    let wave = libm::sin(60.0 * t);
    [
        rest[0] + 0.4 * wave * wave,
        rest[1] + 0.05 * libm::sin(90.0 * t) * wave,
    ]
}

#[test]
fn a_hard_surface_is_the_rigid_plants_constraint() {
    // 1e5 N/m give 20 um under 2 N; the rest of the difference is the force's own vibration
    // against that spring.
    let mut parameters = ideal();
    parameters.contact.stiffness_n_m = 1e5;
    for elements in [3, 8] {
        let (mut plant, start) = resting(&testing::PAPER, elements, &parameters);
        let rigid_parameters = PlantParameters {
            elements,
            ..PlantParameters::default()
        };
        let model = rigid_parameters
            .model(&testing::PAPER, LinkKind::default())
            .unwrap();
        let angle = model
            .kinematics
            .inverse([0.7, 0.05], model.arm.elbow)
            .unwrap();
        let state = resting_state(&model, &rigid_parameters, angle, [0.0, FORCE_N]).unwrap();
        let mut rigid = Plant::new(model, &rigid_parameters, PLANE, PERIOD_S, state).unwrap();
        let (mut force, mut along, mut slope, mut moved) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        for tick in 0..1000 {
            let torque = swing(start.torque, tick);
            plant.advance(torque);
            rigid.advance(torque);
            let (a, b) = (plant.read(), rigid.read(torque));
            force = force.max((a.force - b.force).abs());
            along = along.max((a.tip[0] - b.tip[0]).abs());
            slope = slope.max((a.root_slope - b.root_slope).abs());
            moved = moved.max((b.tip[0] - 0.7).abs());
        }
        assert!(moved > 2e-3, "{moved}");
        assert!(along < 2e-5, "{elements}: {along:e} m");
        assert!(slope < 4e-4, "{elements}: {slope:e} rad");
        assert!(force < 0.03, "{elements}: {force:e} N");
    }
}

/// The arm with so many integration steps in control periods of `period_s`, its links turned from
/// rest by `turn` (rad) and let go at a rate of link 2 (rad/s).
fn let_go(
    parameters: &CompliantParameters,
    (substeps, period_s): (u32, f64),
    turn: [f64; 2],
    rate: f64,
) -> (CompliantPlant<f64>, RestState) {
    let parameters = CompliantParameters {
        substeps: Some(substeps),
        ..parameters.clone()
    };
    let model = parameters
        .model(&testing::PAPER, 4, LinkKind::default())
        .unwrap();
    let mut start = parameters.rest(&model, 0.7, FORCE_N).unwrap();
    start.state[0] += turn[0];
    start.state[1] += turn[1];
    start.state[3] += rate;
    let arm = CompliantArm {
        model: &model,
        parameters: &parameters,
        start: &start,
    };
    let plant = CompliantPlant::new(&[arm], period_s, &[]).unwrap();
    (plant, start)
}

#[test]
fn halving_the_step_shows_order_4_in_lasting_contact() {
    // At 1 ms, where errors stand out from rounding.
    let after = |substeps: u32| {
        let mut parameters = ideal();
        parameters.contact.stiffness_n_m = 1e5;
        let (mut plant, start) = let_go(&parameters, (substeps, 1e-3), [0.0; 2], 0.01);
        for _ in 0..10 {
            plant.advance(start.torque);
            assert!(plant.read().force > 0.0);
        }
        plant.state(0)
    };
    let states = [16, 32, 64].map(after);
    let distance = |a: &[f64], b: &[f64]| {
        let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, f64::max)
    };
    let ratio = distance(&states[0], &states[1]) / distance(&states[1], &states[2]);
    assert!((ratio.log2() - 4.0).abs() < 0.5, "order {}", ratio.log2());
}

#[test]
fn halving_the_step_shows_what_touch_downs_cost() {
    // Dropped from 1 mm it lands on a surface of 1e5 N/m.
    let mut parameters = ideal();
    parameters.contact.stiffness_n_m = 1e5;
    let forces = |substeps: u32| {
        let (mut plant, start) = let_go(&parameters, (substeps, PERIOD_S), [-4e-3, 0.0], 0.0);
        let mut forces = vec![];
        for _ in 0..150 {
            plant.advance(start.torque);
            forces.push(plant.read().force);
        }
        forces
    };
    let exact = forces(1024);
    let touches = exact.windows(2).filter(|w| w[0] == 0.0 && w[1] > 0.0);
    assert!(touches.count() >= 1, "it does not land");
    let norm = |f: &[f64]| f.iter().map(|f| f * f).sum::<f64>().sqrt();
    let error = |substeps: u32| {
        let found = forces(substeps);
        let off: Vec<f64> = found.iter().zip(&exact).map(|(a, b)| a - b).collect();
        norm(&off) / norm(&exact)
    };
    // Its own step: the contact force to half a percent, rms over the landing.
    let own = resting(&testing::PAPER, 4, &parameters).0.substeps();
    assert!(own <= 4 && error(own) < 5e-3, "{own}: {}", error(own));
    // Order 1 and erratic, by where in the step the events fall: the bound falls with the step.
    for substeps in [4, 8, 16, 32, 64] {
        let bound = 0.02 / f64::from(substeps);
        assert!(error(substeps) < bound, "{substeps}: {}", error(substeps));
    }
}

/// Energy of the plant: the arm's, the rotors', and what contact, bristles, gears and cogging
/// store, J.
fn energy(
    parameters: &CompliantParameters,
    model: &crate::model::arm_model::ArmModel,
    state: &[f64],
    reading: &CompliantReading,
) -> f64 {
    let arm = 4 + 2 * model.dof();
    let further = &state[arm..];
    let mut sum = energy::energy(model, State(&state[..arm]));
    let contact = &parameters.contact;
    sum += 0.5 * contact.stiffness_n_m * reading.depth.max(0.0).powi(2);
    if contact.friction > 0.0 {
        sum += 0.5 * contact.bristle_stiffness_n_m * further[0].powi(2);
    }
    let mut rotor = 3;
    let link = [reading.angle[0], reading.angle[1] + reading.root_slope];
    for (j, joint) in parameters.joints.iter().enumerate() {
        sum += 0.5 * joint.friction.coulomb_nm / joint.friction.pre_sliding_rad
            * further[1 + j].powi(2);
        let c = &joint.cogging;
        sum += c.amplitude_nm / c.periods * libm::cos(c.periods * reading.motor_angle[j]);
        if let Some(gear) = &joint.play {
            let ahead = (further[rotor] - link[j]).abs() - 0.5 * gear.play_rad;
            sum += 0.5 * gear.stiffness_nm_rad * ahead.max(0.0).powi(2);
            sum += 0.5 * joint.reflected_inertia_kgm2() * further[rotor + 1].powi(2);
            rotor += 2;
        }
    }
    sum
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// Let go without torque, whatever the arm does on its surface takes energy.
    #[test]
    fn the_plant_never_makes_energy(
        play: bool, along in -1.5..1.5_f64, down in -1.0..1.0_f64, lift in 0.0..0.01_f64,
        bend in -0.02..0.02_f64,
    ) {
        let mut parameters = everything();
        // The geometric stiffness has no potential in this formulation.
        parameters.geometric_stiffness = GeometricStiffness::None;
        if play {
            parameters = with_play(parameters);
        }
        for joint in &mut parameters.joints {
            joint.cogging.amplitude_nm *= 0.1;
        }
        let model = parameters.model(&testing::PAPER, 3, LinkKind::default()).unwrap();
        // Beside the hole, which it may slide into.
        let mut start = parameters.rest(&model, 0.54, FORCE_N).unwrap();
        start.state[0] -= lift;
        start.state[2] = down;
        start.state[3] = along;
        start.state[4] += bend;
        start.torque = [0.0; 2];
        // So fine that the step's error, which may have either sign, is out of the way.
        parameters.substeps = Some(32);
        let arm = CompliantArm { model: &model, parameters: &parameters, start: &start };
        let mut plant = CompliantPlant::<f64>::new(&[arm], PERIOD_S, &[]).unwrap();
        let mut now = energy(&parameters, &model, &plant.state(0), &plant.read());
        let first = now;
        for _ in 0..250 {
            plant.advance([0.0; 2]);
            let reading = plant.read();
            prop_assert!(reading.force >= 0.0);
            let next = energy(&parameters, &model, &plant.state(0), &reading);
            prop_assert!(next <= now + 3e-6, "{next} after {now}, first {first}");
            now = next;
        }
        prop_assert!(now < first);
    }
}

/// Torques (N m) that change from tick to tick without a pattern, the same for every test.
fn erratic(rest: [f64; 2], scale: f64, random: &mut RandomStream) -> [f64; 2] {
    [
        rest[0] + scale * (2.0 * random.uniform() - 1.0),
        rest[1] + 0.1 * scale * (2.0 * random.uniform() - 1.0),
    ]
}

/// Goes on for `ticks` under erratic torques. Shows `check` the energy gained and the work of the
/// drives since the start, J: exact, for an ideal drive's torque is constant over a tick.
fn ledger(
    arm: &ArmParameters,
    parameters: &CompliantParameters,
    (ticks, scale, seed): (u32, f64, u64),
    mut check: impl FnMut(f64, f64),
) {
    let model = parameters.model(arm, 3, LinkKind::default()).unwrap();
    let start = parameters.rest(&model, 0.54, FORCE_N).unwrap();
    let arm = CompliantArm {
        model: &model,
        parameters,
        start: &start,
    };
    let mut plant = CompliantPlant::<f64>::new(&[arm], PERIOD_S, &[]).unwrap();
    let mut random = RandomStream::new(seed, 0);
    let mut before = plant.read();
    let first = energy(parameters, &model, &plant.state(0), &before);
    let mut work = 0.0;
    for _ in 0..ticks {
        let torque = erratic(start.torque, scale, &mut random);
        plant.advance(torque);
        let now = plant.read();
        for j in 0..2 {
            work += torque[j] * (now.motor_angle[j] - before.motor_angle[j]);
        }
        before = now;
        let gained = energy(parameters, &model, &plant.state(0), &now) - first;
        check(gained, work);
    }
}

#[test]
fn without_losses_the_drives_work_is_all_there_is() {
    // Undamped, on an elastic surface without friction, on and off it, with waves, cogging and
    // gear play: conservative.
    let arm = ArmParameters {
        damping_ratio: 0.0,
        ..testing::PAPER
    };
    let mut parameters = with_play(everything());
    parameters.geometric_stiffness = GeometricStiffness::None;
    parameters.contact.damping_ns_m = 0.0;
    parameters.contact.friction = 0.0;
    parameters.contact.friction_at_rest = 0.0;
    parameters.surface.features.clear();
    parameters.drives = [DriveParameters::default(); 2];
    for joint in &mut parameters.joints {
        joint.friction = JointFriction::default();
        if let Some(gear) = &mut joint.play {
            gear.damping_nms_rad = 0.0;
        }
    }
    let off = |substeps: u32| {
        parameters.substeps = Some(substeps);
        let (mut off, mut moved) = (0.0_f64, 0.0_f64);
        ledger(&arm, &parameters, (1000, 4.0, 1), |gained, work| {
            off = off.max((gained - work).abs());
            moved = moved.max(work.abs());
        });
        assert!(moved > 0.02, "{moved} J are little");
        off
    };
    let mut off = off;
    // What is left is the step's, and falls with it.
    let (coarse, fine) = (off(16), off(64));
    assert!(coarse < 2e-5, "{coarse:e} J");
    assert!(fine < 0.2 * coarse, "{fine:e} J after {coarse:e}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    /// Under any torques, the arm gains no more energy than the drives put in.
    #[test]
    fn no_more_is_gained_than_the_drives_put_in(
        play: bool, seed: u64, scale in 0.1..5.0_f64, friction in 0.0..0.5_f64,
        stiffness in 2e3..1e5_f64,
    ) {
        let mut parameters = everything();
        // It has no potential in this formulation.
        parameters.geometric_stiffness = GeometricStiffness::None;
        parameters.drives = [DriveParameters::default(); 2];
        parameters.contact.stiffness_n_m = stiffness;
        parameters.contact.friction = friction;
        parameters.contact.friction_at_rest = 1.3 * friction;
        if play {
            parameters = with_play(parameters);
        }
        parameters.substeps = Some(32);
        let mut worst = f64::NEG_INFINITY;
        let mut last = [0.0; 2];
        ledger(&testing::PAPER, &parameters, (400, scale, seed), |gained, work| {
            worst = worst.max(gained - work);
            last = [gained, work];
        });
        prop_assert!(worst < 1e-5, "{worst} J");
        // It loses some, too.
        prop_assert!(last[0] < last[1], "{last:?}");
    }
}

#[test]
fn friction_on_a_bare_root_is_followed_by_the_plants_own_step() {
    // Smoothed Coulomb friction of this size needed 128 steps a tick on a root without a hub.
    let mut parameters = ideal();
    parameters.joints[1].friction.coulomb_nm = 0.05;
    let arm = ArmParameters {
        root_inertia_kgm2: 0.0,
        ..testing::PAPER
    };
    let readings = |substeps: Option<u32>| {
        let own = CompliantParameters {
            substeps,
            ..parameters.clone()
        };
        let (mut plant, start) = resting(&arm, 8, &own);
        let readings = (0..2000).map(|tick| {
            plant.advance(swing(start.torque, tick));
            plant.read()
        });
        let readings: Vec<CompliantReading> = readings.collect();
        (readings, plant.substeps())
    };
    let (own, substeps) = readings(None);
    let (fine, _) = readings(Some(16 * substeps));
    let difference = |of: fn(&CompliantReading) -> f64| {
        let pairs = own.iter().zip(&fine);
        let square: f64 = pairs.map(|(a, b)| (of(a) - of(b)).powi(2)).sum();
        (square / own.len() as f64).sqrt()
    };
    let (force, along) = (difference(|r| r.force), difference(|r| r.tip[0]));
    assert!(force < 2e-3, "{substeps} steps: {force:e} N");
    assert!(along < 1e-6, "{substeps} steps: {along:e} m");
    // It matters: the same without friction is elsewhere.
    parameters.joints[1].friction.coulomb_nm = 0.0;
    let (free, _) = {
        let (mut plant, start) = resting(&arm, 8, &parameters);
        let last = (0..2000).map(|tick| {
            plant.advance(swing(start.torque, tick));
            plant.read()
        });
        (last.last().unwrap(), start)
    };
    assert!((free.tip[0] - own[1999].tip[0]).abs() > 1e-5);
}

#[test]
fn a_drives_torque_rises_as_its_lag() {
    let mut parameters = ideal();
    parameters.drives[1].bandwidth_hz = Some(200.0);
    let (mut plant, start) = resting(&testing::PAPER, 3, &parameters);
    for tick in 1..20 {
        plant.advance([start.torque[0], start.torque[1] + 0.1]);
        let rise = 1.0 - libm::exp(-core::f64::consts::TAU * 200.0 * f64::from(tick) * PERIOD_S);
        let torque = plant.read().torque;
        assert!((torque[1] - start.torque[1] - 0.1 * rise).abs() < 1e-12);
        assert!(torque[0] == start.torque[0]);
    }
}

#[test]
fn off_its_edge_the_tip_falls_freely() {
    let mut parameters = ideal();
    let (mut plant, start) = {
        let model = parameters
            .model(&testing::PAPER, 3, LinkKind::default())
            .unwrap();
        let start = parameters.rest(&model, 0.7, FORCE_N).unwrap();
        parameters.surface.features = vec![SurfaceFeature::End { at_m: 0.69 }];
        let arm = CompliantArm {
            model: &model,
            parameters: &parameters,
            start: &start,
        };
        (
            CompliantPlant::<f64>::new(&[arm], PERIOD_S, &[]).unwrap(),
            start,
        )
    };
    for _ in 0..100 {
        plant.advance(start.torque);
    }
    let reading = plant.read();
    assert_eq!(reading.force, 0.0);
    assert!(reading.tip[1] > 0.052, "{}", reading.tip[1]);
    assert!(reading.depth < -5e-3, "{}", reading.depth);
}

/// Four arms that differ in everything that may differ.
fn four(parameters: &CompliantParameters) -> Vec<(ArmParameters, CompliantParameters)> {
    (0..4)
        .map(|i| {
            let x = f64::from(i);
            let mut own = parameters.clone();
            own.surface.slope += 0.01 * x;
            own.surface.features.truncate(if i == 1 { 0 } else { 1 });
            own.contact.friction = 0.1 * x;
            own.contact.friction_at_rest = 0.15 * x;
            own.contact.stiffness_n_m *= 1.0 + x;
            own.joints[0].friction.coulomb_nm *= x;
            own.drives[1].bandwidth_hz = (i != 2).then_some(150.0 + 50.0 * x);
            let arm = ArmParameters {
                link1_mass_kg: 8.0 + 0.3 * x,
                bending_stiffness_nm2: 0.48 + 0.02 * x,
                link2_length_m: 0.55 - 1e-3 * x,
                ..testing::PAPER
            };
            (arm, own)
        })
        .collect()
}

#[test]
fn arms_of_different_kinds_do_not_advance_together() {
    let own = ideal();
    let other = CompliantParameters {
        geometric_stiffness: GeometricStiffness::Full,
        ..own.clone()
    };
    let models = [3, 4].map(|elements| {
        own.model(&testing::PAPER, elements, LinkKind::default())
            .unwrap()
    });
    let starts = [0, 1].map(|i| own.rest(&models[i], 0.7, FORCE_N).unwrap());
    let arm = |i: usize, parameters| CompliantArm {
        model: &models[i],
        parameters,
        start: &starts[i],
    };
    let first = arm(0, &own);
    for odd in [arm(1, &own), arm(0, &other)] {
        let arms = [first, first, odd, first];
        let error = CompliantPlant::<F64x4>::new(&arms, PERIOD_S, &[]).unwrap_err();
        assert_eq!(error, CompliantError::Lanes);
    }
    let mut bare = with_play(ideal());
    bare.joints[1].rotor_inertia_kgm2 = 0.0;
    let start = bare.rest(&models[0], 0.7, FORCE_N).unwrap();
    let arms = [CompliantArm {
        start: &start,
        ..arm(0, &bare)
    }];
    let error = CompliantPlant::<f64>::new(&arms, PERIOD_S, &[]).unwrap_err();
    assert!(
        matches!(error, CompliantError::NoRotor { joint: 2, .. }),
        "{error}"
    );
}

#[test]
fn each_lane_has_the_bits_of_a_plant_alone() {
    for (parameters, elements) in [
        (ideal(), 8),
        (everything(), 4),
        (with_play(everything()), 3),
    ] {
        let four = four(&parameters);
        let models: Vec<_> = four
            .iter()
            .map(|(arm, own)| own.model(arm, elements, LinkKind::default()).unwrap())
            .collect();
        let starts: Vec<_> = four
            .iter()
            .zip(&models)
            .map(|((_, own), model)| own.rest(model, 0.7, FORCE_N).unwrap())
            .collect();
        let arms: Vec<_> = (0..4)
            .map(|i| CompliantArm {
                model: &models[i],
                parameters: &four[i].1,
                start: &starts[i],
            })
            .collect();
        let mut together = CompliantPlant::<F64x4>::new(&arms, PERIOD_S, &[]).unwrap();
        let substeps = together.substeps();
        let torque = |lane: usize, tick: u32| swing(starts[lane].torque, tick);
        for tick in 0..300 {
            together.advance([0, 1].map(|j| F64x4::from_lanes(|i| torque(i, tick)[j])));
        }
        for lane in 0..4 {
            let own = CompliantParameters {
                substeps: Some(substeps),
                ..four[lane].1.clone()
            };
            let arm = CompliantArm {
                parameters: &own,
                ..arms[lane]
            };
            let mut alone = CompliantPlant::<f64>::new(&[arm], PERIOD_S, &[]).unwrap();
            for tick in 0..300 {
                alone.advance(torque(lane, tick));
            }
            let (a, b) = (together.state(lane), alone.state(0));
            assert!(a.iter().all(|x| x.is_finite()));
            for (a, b) in a.iter().zip(&b) {
                assert_eq!(a.to_bits(), b.to_bits(), "lane {lane}: {a} {b}");
            }
            assert_eq!(together.outputs().lane(lane), alone.read());
        }
    }
}

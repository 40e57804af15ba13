//! Unit tests of the motion: every transition of its drawing, and that none is a step.

extern crate std;

use crate::control::{Controller, HybridParameters, LimitParameters, MotionParameters};
use crate::fault::Fault;
use crate::model::ArmParameters;
use crate::phase::Phase;
use crate::signals::{Measurement, Reference};
use crate::table::{Header, Piece, Table, TableWriter, image_bytes};
use core::f64::consts::FRAC_PI_2;
use proptest::prelude::*;
use std::vec::Vec;

const RATE_HZ: u32 = 5000;
const TICKS: u32 = 2000;
const GAINS: HybridParameters = HybridParameters {
    motion: MotionParameters {
        settle_s: 0.1,
        ..MotionParameters::DEFAULT
    },
    ..HybridParameters::PAPER_ARM_HUB
};

/// The plan in the middle of the paper's path, pressing with `force` (N); joint 1 turns by
/// `turn` (rad) from end to end.
fn image(force: f64, turn: f64) -> Vec<u8> {
    let header = Header {
        arm_fingerprint: ArmParameters::PAPER.fingerprint(),
        task_fingerprint: 0,
        tick_rate_hz: RATE_HZ,
        ticks: TICKS,
        first_tick: 0,
        scaling: [20; 8],
    };
    let segments = 20;
    let pieces = [Piece {
        ticks: TICKS,
        segments,
    }];
    let mut image = std::vec![0; image_bytes(&pieces)];
    let mut writer = TableWriter::new(&mut image, &header, &pieces).unwrap();
    for i in 0..pieces[0].rows() {
        let share = f64::from(i) / f64::from(segments);
        writer
            .row(&Reference {
                torque: [-3.0, 0.3],
                force,
                angle: [0.9 + turn * share, -0.7],
                root_slope: 0.2,
                normal_angle: FRAC_PI_2,
                ..Reference::default()
            })
            .unwrap();
    }
    writer.finish().unwrap();
    image
}

fn controller(image: &[u8]) -> Controller<'_, f64> {
    let limits = LimitParameters {
        torque_nm: [50.0, 5.0],
        torque_rate_nm_s: [1e9; 2],
    };
    let table = Table::open(image).unwrap();
    Controller::new(&table, &ArmParameters::PAPER, &GAINS.into(), &limits).unwrap()
}

/// As planned but for these errors of the motors' angles, rad, with this force and moment.
fn measured(error: [f64; 2], force: f64, root_moment: f64) -> Measurement<f64> {
    Measurement {
        motor: [0.9 + error[0], -0.7 - 0.9 + 0.2 + error[1]],
        force,
        root_moment,
        ..Measurement::default()
    }
}

/// Ticks until the phase is another one, with this force; the last tick's phase.
fn until_it_changes(controller: &mut Controller<'_, f64>, force: f64) -> (u32, Phase) {
    let before = controller.phase();
    for ticks in 1..40_000 {
        let phase = controller.tick(&measured([0.0; 2], force, 0.3)).phase;
        if phase != before {
            return (ticks, phase);
        }
    }
    (40_000, before)
}

fn seconds(ticks: u32) -> f64 {
    f64::from(ticks) / f64::from(RATE_HZ)
}

#[test]
fn pressing_it_settles_and_follows_and_at_the_end_lifts_off_and_holds() {
    let image = image(2.0, 0.0);
    let mut controller = controller(&image);
    let first = controller.tick(&measured([0.0; 2], 2.0, 0.3));
    assert_eq!((first.phase, first.tick), (Phase::Contact, 0));
    assert!(!controller.begun());
    let (ticks, phase) = until_it_changes(&mut controller, 2.0);
    assert_eq!((ticks, phase), (500, Phase::Follow));
    assert!(controller.begun());
    let (ticks, phase) = until_it_changes(&mut controller, 2.0);
    assert_eq!((ticks, phase), (TICKS, Phase::Retract));
    assert!(controller.at_end());
    // 1 s to take 2 N away, 0.5 s to lift by 20 mm; nothing is latched.
    let (ticks, phase) = until_it_changes(&mut controller, 0.0);
    assert_eq!(phase, Phase::Hold);
    assert!((seconds(ticks) - 1.5).abs() < 0.3, "{}", seconds(ticks));
    assert_eq!(controller.retract_cause(), None);
    let held = controller.tick(&measured([0.0; 2], 0.0, 0.3));
    assert_eq!((held.fault, held.phase), (None, Phase::Hold));
}

#[test]
fn in_the_air_it_approaches_until_the_mean_force_says_that_it_presses() {
    let image = image(2.0, 0.0);
    let mut controller = controller(&image);
    for _ in 0..1000 {
        let phase = controller.tick(&measured([0.0; 2], 0.05, 0.3)).phase;
        assert_eq!(phase, Phase::Approach);
    }
    // A bounce of 2 ms, and away for 20 ms: nothing yet.
    for tick in 0..1000 {
        let force = if tick % 110 < 10 { 1.0 } else { 0.0 };
        let phase = controller.tick(&measured([0.0; 2], force, 0.3)).phase;
        assert_eq!(phase, Phase::Approach);
    }
    let (ticks, phase) = until_it_changes(&mut controller, 0.7);
    assert_eq!(phase, Phase::Contact);
    assert!(seconds(ticks) < 0.05);
    // From 0.5 N with 2 N/s, and 0.1 s of settling; the force follows.
    for _ in 0..2000 {
        controller.tick(&measured([0.0; 2], 1.5, 0.3));
    }
    let (ticks, phase) = until_it_changes(&mut controller, 2.0);
    assert_eq!(phase, Phase::Follow);
    assert!((seconds(ticks + 2000) - 0.85).abs() < 0.15);
}

#[test]
fn where_there_is_no_surface_the_approach_is_given_up_and_named() {
    let image = image(2.0, 0.0);
    let mut controller = controller(&image);
    controller.tick(&measured([0.0; 2], 0.0, 0.3));
    let (ticks, phase) = until_it_changes(&mut controller, 0.0);
    assert_eq!(phase, Phase::Retract);
    // 100 mm with 20 mm/s.
    assert!((seconds(ticks) - 5.0).abs() < 0.01);
    assert_eq!(controller.retract_cause(), Some(Fault::NoContact));
}

#[test]
fn a_force_that_does_not_come_near_the_plans_is_named() {
    let image = image(2.0, 0.0);
    let mut controller = controller(&image);
    controller.tick(&measured([0.0; 2], 1.0, 0.3));
    let (_, phase) = until_it_changes(&mut controller, 1.0);
    assert_eq!(phase, Phase::Retract);
    assert_eq!(controller.retract_cause(), Some(Fault::ForceNotReached));
    assert!(!controller.begun());
}

#[test]
fn contact_that_is_lost_is_found_again_or_ends_the_run() {
    let image = image(2.0, 0.0);
    for away in [50, 5000] {
        let mut controller = controller(&image);
        controller.tick(&measured([0.0; 2], 2.0, 0.3));
        until_it_changes(&mut controller, 2.0);
        // 2 ms are believed.
        let (ticks, phase) = until_it_changes(&mut controller, 0.0);
        assert_eq!((ticks, phase), (10, Phase::Lost));
        let began = controller.tick(&measured([0.0; 2], 0.0, 0.3)).tick;
        for _ in 0..away {
            controller.tick(&measured([0.0; 2], 0.0, 0.3));
        }
        let command = controller.tick(&measured([0.0; 2], 2.0, 0.3));
        if away == 50 {
            // The table went on.
            assert_eq!((command.phase, command.tick), (Phase::Follow, began + 51));
            assert_eq!(controller.retract_cause(), None);
        } else {
            assert_eq!(command.phase, Phase::Retract);
            let cause = controller.retract_cause();
            assert_eq!(cause, Some(Fault::ContactNotRegained));
            assert!(!controller.at_end());
        }
    }
}

#[test]
fn a_table_without_force_is_followed_in_the_air() {
    let image = image(0.0, 0.0);
    let mut controller = controller(&image);
    let first = controller.tick(&measured([0.0; 2], 0.0, 0.3));
    assert_eq!(first.phase, Phase::Free);
    let (ticks, phase) = until_it_changes(&mut controller, 0.0);
    assert_eq!((ticks, phase), (TICKS, Phase::Park));
}

#[test]
fn another_table_is_gone_over_to_where_the_arm_stands() {
    let (pressing, free) = (image(2.0, 0.0), image(0.0, 0.3));
    let mut first = controller(&pressing);
    let mut next = controller(&free);
    let off = measured([0.003, 0.03], 0.0, 0.27);
    first.tick(&measured([0.003, 0.03], 2.0, 0.3));
    assert!(!next.go_on_from(&first), "it does not stand");
    first.retract(None);
    while !first.phase().stands() {
        first.tick(&off);
    }
    let before = first.tick(&off);
    assert!(next.go_on_from(&first));
    let after = next.tick(&off);
    assert_eq!((after.phase, after.tick), (Phase::Free, 0));
    let step = [0, 1].map(|j| after.torque[j] - before.torque[j]);
    // To a tick of the place integral and of the torque loop; alone, the plan's torque of joint 1
    // would be 0.3 N m and more off.
    assert!(step[0].abs() < 0.01 && step[1].abs() < 1e-3, "{step:?}");
    assert!((controller(&free).tick(&off).torque[0] - before.torque[0]).abs() > 0.3);
    // What differed fades: the law's own torques are left.
    let mut fresh = controller(&free);
    let mut last = [0.0; 2];
    let mut alone = [0.0; 2];
    for _ in 0..10 * TICKS {
        last = next.tick(&off).torque;
        alone = fresh.tick(&off).torque;
    }
    assert!((last[0] - alone[0]).abs() < 1e-9 && (last[1] - alone[1]).abs() < 0.02);
    // And back to a table that presses.
    assert_eq!(next.phase(), Phase::Park);
    assert!(first.go_on_from(&next));
    assert_eq!(first.tick(&off).phase, Phase::Approach);
}

#[test]
fn the_table_stands_and_goes_on_without_a_jump() {
    let turn = 0.5;
    let image = image(2.0, turn);
    let mut controller = controller(&image);
    // Joint 1's torque says where the planned angle is, as the measured one stands.
    let torque = |controller: &mut Controller<'_, f64>| {
        let command = controller.tick(&measured([0.0; 2], 2.0, 0.3));
        (command.torque[0], command.tick)
    };
    while !controller.begun() {
        torque(&mut controller);
    }
    let mut stood = 0;
    let mut before = torque(&mut controller);
    // What K1, B1 and the integral make of a tick's turn, and of a change of it.
    let most = turn / f64::from(TICKS) * (800.0 + 60.0 * f64::from(RATE_HZ) * 0.04) + 0.05;
    for tick in 0..2900 {
        controller.pause((400..1600).contains(&tick));
        let now = torque(&mut controller);
        assert!(
            (now.0 - before.0).abs() < most,
            "{tick}: {now:?} {before:?}"
        );
        stood += u32::from(now.1 == before.1);
        before = now;
    }
    // Stopping and starting take the half of 0.15 s each; what is left of a tick is caught up.
    let missed = 1200 - 750 + 750;
    assert!(stood.abs_diff(missed) <= 16, "{stood}");
}

proptest! {
    /// Whatever the force does, the torques change from tick to tick by no more than the integrals,
    /// the section and the share of joint 1 can: no transition is a step.
    #[test]
    fn no_transition_is_a_step(
        forces in prop::collection::vec(
            (prop::sample::select(std::vec![0.0, 0.15, 0.7, 2.0, 4.0]), 1..400_usize),
            1..30,
        ),
        error in prop::array::uniform2(-0.02..0.02_f64),
        ends in 0..4000_usize,
    ) {
        let image = image(2.0, 0.0);
        let mut controller = controller(&image);
        let mut before: Option<[f64; 2]> = None;
        let ticks = forces.iter().flat_map(|(force, n)| core::iter::repeat_n(*force, *n));
        for (tick, force) in ticks.enumerate() {
            if tick == ends {
                controller.retract(None);
            }
            let command = controller.tick(&measured(error, force, 0.3));
            if let Some(before) = before {
                let step = [0, 1].map(|j| (command.torque[j] - before[j]).abs());
                // Joint 1: 2 % of the share of 2 N a tick, and its own integral.
                prop_assert!(step[0] < 0.06, "{}: {step:?}", command.phase);
                // Joint 2: the section takes up to 1e-3 of 4 N and of 1 N m, the torque loop 2 % of
                // what is wanted, once more after a change of the gains.
                prop_assert!(step[1] < 0.02, "{}: {step:?}", command.phase);
            }
            before = Some(command.torque);
        }
    }
}

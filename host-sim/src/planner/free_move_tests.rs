//! Unit tests of moves through the air.

use crate::files::config::{DEFAULT_ARM, DEFAULT_TASK, parse_arm, parse_task};
use crate::model::arm_model::ArmModel;
use crate::model::dynamics::equilibrium;
use crate::model::link::{LinkKind, LinkModel};
use crate::planner::free_move::{FreeMove, MoveEnd};
use crate::planner::path::Profile;
use crate::planner::plan::{Plan, PlanOptions};
use crate::planner::planning::plan;
use crate::planner::task::{Ends, PlanError, Task, Travel, Window};
use core::f64::consts::FRAC_PI_2;
use flexor::model::{ArmParameters, Elbow};
use proptest::prelude::*;

const ELEMENTS: usize = 3;

fn arm() -> ArmParameters {
    parse_arm("arm", DEFAULT_ARM).unwrap().arm
}

fn above(clearance_m: f64) -> MoveEnd {
    MoveEnd::Task {
        task: Box::new(parse_task("task", DEFAULT_TASK).unwrap()),
        clearance_m,
    }
}

fn free_move(from: MoveEnd, to: MoveEnd) -> FreeMove {
    let auto = Window::Auto { tolerance: 1e-6 };
    FreeMove {
        from,
        to,
        duration_s: 1.5,
        profile: Profile::Poly11,
        pre_actuation: auto,
        post_actuation: auto,
    }
}

fn planned(arm: &ArmParameters, way: &FreeMove) -> Result<(Task, Plan), PlanError> {
    let task = way.task(&ArmModel::new(arm, ELEMENTS)?)?;
    let plan = plan(arm, &task, &PlanOptions::default())?;
    Ok((task, plan))
}

#[test]
fn a_move_ends_off_the_surface_by_a_turn_of_joint_2() {
    let (arm, to) = (arm(), above(0.02));
    let (task, plan) = planned(&arm, &free_move(MoveEnd::Angles([1.2, -1.2]), to)).unwrap();
    let path = parse_task("task", DEFAULT_TASK).unwrap().path;
    let kinematics = ArmModel::new(&arm, ELEMENTS).unwrap().kinematics;
    let on_it = kinematics.inverse(path.from, Elbow::Down).unwrap();
    let last = plan.points.last().unwrap();
    assert!((last.joint.angle[0] - on_it[0]).abs() < 1e-12);
    // The surface is level, 0.05 m below joint 1, and pressed on from above.
    assert!((last.tip.position[1] - (0.05 - 0.02)).abs() < 1e-12);
    assert!((task.path.to[0] - last.tip.position[0]).abs() < 1e-12);
    assert!(plan.points.iter().all(|point| point.force.normal == 0.0));
}

#[test]
fn it_rests_at_both_ends_and_bends_as_the_equations_want_between() {
    let arm = arm();
    let (task, plan) =
        planned(&arm, &free_move(above(0.02), MoveEnd::Angles([1.2, -1.2]))).unwrap();
    let Travel::Joints(way) = task.travel else {
        panic!("a move")
    };
    for (point, angle) in [&plan.points[0], plan.points.last().unwrap()]
        .into_iter()
        .zip(way.ends)
    {
        let (_, torque) = equilibrium(&plan.model, angle, [0.0; 2], false).unwrap();
        for joint in 0..2 {
            assert!((point.joint.angle[joint] - angle[joint]).abs() < 1e-12);
            assert!((point.torque[joint] - torque[joint]).abs() < 1e-4);
        }
    }
    let mut sampler = plan.sampler();
    for i in 0..=20 {
        let point = sampler.at(1.5 * f64::from(i) / 20.0);
        // Modal forces, where the elastic ones reach 1: what lies between points of collocation.
        let left = sampler
            .residual(point.t)
            .iter()
            .fold(0.0, |most: f64, x| most.max(x.abs()));
        assert!(left < 1e-5, "{left}");
        // Both joints have gone the same share of their ways.
        let share = |joint: usize| {
            (point.joint.angle[joint] - way.ends[0][joint])
                / (way.ends[1][joint] - way.ends[0][joint])
        };
        assert!((share(0) - share(1)).abs() < 1e-12);
    }
}

#[test]
fn a_stretched_arm_may_hang() {
    // No line of the tip can be followed there.
    let hanging = MoveEnd::Angles([FRAC_PI_2; 2]);
    let (_, plan) = planned(&arm(), &free_move(MoveEnd::Angles([1.2, 1.0]), hanging)).unwrap();
    let last = plan.points.last().unwrap();
    assert!(
        last.torque.iter().all(|torque| torque.abs() < 1e-5),
        "{:?}",
        last.torque
    );
    assert!((last.tip.position[1] - 1.05).abs() < 1e-12);
}

#[test]
fn what_cannot_be_is_refused_by_name() {
    let refused = |from, to| {
        planned(&arm(), &free_move(from, to))
            .map(|_| ())
            .unwrap_err()
    };
    let there = || MoveEnd::Angles([1.2, -1.2]);
    assert!(matches!(
        refused(there(), there()),
        PlanError::NoMove { .. }
    ));
    assert!(matches!(
        refused(there(), above(2.0)),
        PlanError::NoClearance { .. }
    ));
    // From above the path's end down to where the arm hangs.
    let through = refused(above(0.02), MoveEnd::Angles([FRAC_PI_2, 0.2]));
    assert!(
        matches!(through, PlanError::ThroughSurface { .. }),
        "{through}"
    );
}

proptest! {
    /// Angles that encoders show are those at which the arm hangs.
    #[test]
    fn motors_angles_are_those_of_the_hanging_link(link1 in -0.5..1.5_f64, link2 in -1.5..1.5_f64) {
        let arm = arm();
        let motors = [link1, link2 - link1];
        let way = free_move(MoveEnd::Motors(motors), MoveEnd::Angles([2.0, 2.0]));
        let Travel::Joints(found) = way.task(&ArmModel::new(&arm, ELEMENTS).unwrap()).unwrap().travel else {
            panic!("a move")
        };
        let model = ArmModel::new(&arm, ELEMENTS).unwrap();
        let angle = found.ends[0];
        let (q, _) = equilibrium(&model, angle, [0.0; 2], false).unwrap();
        let tangent = angle[1] + model.slope_at_root(q.as_slice());
        prop_assert!((angle[0] - motors[0]).abs() < 1e-12);
        prop_assert!((tangent - angle[0] - motors[1]).abs() < 1e-12);
    }
}

/// A link soft enough that its weight alone bends it by 0.2 rad.
#[test]
fn a_bent_link_hangs_as_it_is() {
    let soft = ArmParameters {
        bending_stiffness_nm2: 0.5,
        ..arm()
    };
    let link = LinkKind {
        model: LinkModel::Geometric,
        ..LinkKind::default()
    };
    let options = PlanOptions {
        link,
        ..PlanOptions::default()
    };
    let model = ArmModel::of_kind(&soft, ELEMENTS, link).unwrap();
    let motors = [0.6, -1.1];
    let way = free_move(MoveEnd::Motors(motors), above(0.02));
    let plan = plan(&soft, &way.task(&model).unwrap(), &options).unwrap();
    let [first, last] = [&plan.points[0], plan.points.last().unwrap()];
    assert!(first.root_slope.abs() > 0.1, "{}", first.root_slope);
    assert!(first.chord_m < 0.55 - 1e-3, "{}", first.chord_m);
    let [link1, link2] = first.joint.angle;
    assert!((link1 - motors[0]).abs() < 1e-12);
    // The window cuts off 1e-6 of the bending that goes before the motion.
    let motor2 = link2 + first.root_slope - link1;
    assert!((motor2 - motors[1]).abs() < 2e-6, "{motor2}");
    // With a straight chord it would be off by what it is shorter.
    assert!((last.tip.position[1] - (0.05 - 0.02)).abs() < 1e-6);
    // Link 1 stands as on the surface, pressing.
    let mut on_it = parse_task("task", DEFAULT_TASK).unwrap();
    on_it.ends = Ends::Spectral;
    let pressing = crate::planner::planning::plan(&soft, &on_it, &options).unwrap();
    let pressing = pressing.points[0].joint.angle[0];
    assert!((last.joint.angle[0] - pressing).abs() < 1e-6);
}

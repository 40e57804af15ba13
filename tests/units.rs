//! Units are a convention: an arm and a task with all lengths, masses and times in other units
//! have the same verdict, the same table but for its scaling, and the same torques in those units.

use flexor::model::ArmParameters;
use flexor_sim::planner::path::{LinePath, Profile};
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit::{EncodedTable, TORQUE_SHARE, fit_table};
use flexor_sim::planner::task::{Ends, Equations, Task, Travel, Window};
use flexor_sim::planner::tip_force::SurfaceFriction;
use flexor_tests::{paper_arm, paper_task};
use proptest::prelude::*;

const AUTO: Window = Window::Auto { tolerance: 1e-6 };

/// What one of the other units is worth in m, kg and s, turned over: numbers of lengths, masses and
/// times are multiplied by these.
#[derive(Clone, Copy, Debug)]
struct Units {
    length: f64,
    mass: f64,
    time: f64,
}

impl Units {
    fn force(self) -> f64 {
        self.mass * self.length / (self.time * self.time)
    }

    fn torque(self) -> f64 {
        self.force() * self.length
    }

    fn arm(self, arm: &ArmParameters) -> ArmParameters {
        let inertia = self.mass * self.length * self.length;
        ArmParameters {
            link1_length_m: self.length * arm.link1_length_m,
            link1_mass_kg: self.mass * arm.link1_mass_kg,
            link2_length_m: self.length * arm.link2_length_m,
            link2_mass_kg: self.mass * arm.link2_mass_kg,
            bending_stiffness_nm2: self.torque() * self.length * arm.bending_stiffness_nm2,
            root_inertia_kgm2: inertia * arm.root_inertia_kgm2,
            tip_mass_kg: self.mass * arm.tip_mass_kg,
            tip_inertia_kgm2: inertia * arm.tip_inertia_kgm2,
            gravity_m_s2: arm
                .gravity_m_s2
                .map(|g| self.length / (self.time * self.time) * g),
            ..*arm
        }
    }

    fn task(self, task: &Task) -> Task {
        let window = |window| match window {
            Window::Fixed(seconds) => Window::Fixed(self.time * seconds),
            auto => auto,
        };
        let path = &task.path;
        Task {
            path: LinePath {
                from: path.from.map(|x| self.length * x),
                to: path.to.map(|x| self.length * x),
                duration: self.time * path.duration,
                ..*path
            },
            travel: Travel::Line,
            normal_force: (self.force() * task.normal_force.largest()).into(),
            friction: SurfaceFriction {
                way_m: self.length * task.friction.way_m,
                ..task.friction
            },
            pre_actuation: window(task.pre_actuation),
            post_actuation: window(task.post_actuation),
            ..task.clone()
        }
    }

    fn options(self, options: &PlanOptions) -> PlanOptions {
        PlanOptions {
            tick_rate_hz: (f64::from(options.tick_rate_hz) / self.time).round() as u32,
            ..*options
        }
    }
}

/// Plan and table, or the name of what refuses them.
fn verdict(
    arm: &ArmParameters,
    task: &Task,
    options: &PlanOptions,
) -> Result<(Plan, EncodedTable), String> {
    // The variant alone: its figures are in units.
    let name = |error: &dyn std::fmt::Debug| {
        let words = format!("{error:?}");
        let end = words.find([' ', '(', '{']).unwrap_or(words.len());
        words[..end].to_string()
    };
    let plan = plan(arm, task, options).map_err(|error| name(&error))?;
    let table = fit_table(&plan).map_err(|error| name(&error))?;
    Ok((plan, table))
}

/// Compares plan and table here and in other units: torques as shares of their peaks, the table's
/// length as a share of itself.
fn compare(
    units: Units,
    (arm, task, options): (&ArmParameters, &Task, &PlanOptions),
    [torque, bytes]: [f64; 2],
) -> Result<(), TestCaseError> {
    let here = verdict(arm, task, options);
    let there = verdict(&units.arm(arm), &units.task(task), &units.options(options));
    let ((plan, table), (other, other_table)) = match (here, there) {
        (Ok(here), Ok(there)) => (here, there),
        (here, there) => {
            let word = |verdict: Result<_, String>| verdict.err().unwrap_or("planned".into());
            prop_assert_eq!(word(here.map(|_| ())), word(there.map(|_| ())));
            return Ok(());
        }
    };
    prop_assert_eq!((plan.pre_ticks, plan.ticks), (other.pre_ticks, other.ticks));
    for (point, other) in plan.points.iter().zip(&other.points) {
        for joint in 0..2 {
            let error = (units.torque() * point.torque[joint] - other.torque[joint]).abs();
            let share = error / (units.torque() * plan.peaks.torque[joint]);
            prop_assert!(
                share <= torque,
                "tau{}: {share:e} at {} s",
                joint + 1,
                point.t
            );
        }
    }
    let lengths = [&table, &other_table].map(|table| table.image.len());
    let difference = lengths[0].abs_diff(lengths[1]) as f64;
    prop_assert!(difference <= bytes * lengths[0] as f64, "{lengths:?} bytes");
    Ok(())
}

/// Units that are powers of a base.
fn units(base: f64) -> impl Strategy<Value = Units> {
    (-3..=3_i32, -5..=5_i32, -1..=1_i32).prop_map(move |exponents| {
        let power = |exponent: i32| libm::pow(base, f64::from(exponent));
        Units {
            length: power(exponents.0),
            mass: power(exponents.1),
            time: power(exponents.2),
        }
    })
}

prop_compose! {
    /// Arms like the paper's with a hub and a tip mass, and motions of theirs.
    fn cases()(
        elements in 1..=6_usize,
        root in prop_oneof![Just(0.0), 1e-5..1e-2_f64],
        tip in prop_oneof![Just(0.0), 0.0..0.2_f64],
        stiffness in 0.0..1.5_f64,
        gravity: bool,
        as_printed in prop::bool::weighted(0.2),
        windows in prop::array::uniform2(prop_oneof![Just(Window::Fixed(0.0)), Just(AUTO)]),
        duration in 0.2..4.0_f64,
        force in 0.0..5.0_f64,
        coefficient in prop_oneof![Just(0.0), 0.0..0.5_f64],
        to in 0.15..0.65_f64,
    ) -> (ArmParameters, Task, PlanOptions) {
        let arm = ArmParameters {
            bending_stiffness_nm2: 0.48 * libm::pow(10.0, stiffness),
            root_inertia_kgm2: root,
            tip_mass_kg: tip,
            gravity_m_s2: [0.0, if gravity { 9.81 } else { 0.0 }],
            ..paper_arm()
        };
        let task = Task {
            path: LinePath { from: [0.7, 0.05], to: [to, 0.05], duration, profile: Profile::Poly11 },
            travel: Travel::Line,
            normal_force: force.into(),
            direction: None,
            friction: SurfaceFriction { coefficient, ..SurfaceFriction::default() },
            pre_actuation: windows[0],
            post_actuation: windows[1],
            ends: Ends::Spectral,
        };
        let equations = if as_printed { Equations::AsPrinted } else { Equations::Exact };
        let options = PlanOptions { elements, tick_rate_hz: 1000, equations, ..PlanOptions::default() };
        (arm, task, options)
    }
}

proptest! {
    // Always the same cases: a rare one shall not stop somebody else's change.
    #![proptest_config(ProptestConfig {
        cases: 100,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        ..ProptestConfig::default()
    })]

    /// But for rounding, which the condition of the plan's matrices magnifies: a table may take a
    /// few knots more or less for that.
    #[test]
    fn other_units_change_nothing(
        units in prop_oneof![units(2.0), units(10.0)],
        (arm, task, options) in cases(),
    ) {
        compare(units, (&arm, &task, &options), [0.1 * TORQUE_SHARE, 0.02])?;
    }
}

/// The paper's arm in a tenth of the length and a thousandth of the mass, and others.
#[test]
fn the_papers_arm_has_the_same_table_in_other_units() {
    for (length, mass, time) in [
        (0.1, 1e-3, 1.0),
        (10.0, 1e3, 1.0),
        (1e-3, 1e-6, 0.1),
        (1.0, 1e6, 1.0),
    ] {
        let units = Units { length, mass, time };
        let case = (&paper_arm(), &paper_task(), &PlanOptions::default());
        compare(units, case, [1e-8, 0.0]).unwrap();
    }
}

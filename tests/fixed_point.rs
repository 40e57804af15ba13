//! The tick in fixed point: how exact it is, that nothing wraps or drifts, and what does
//! not fit is refused by name.

use flexor::control::{
    Coefficients, Controller, HybridParameters, LawParameters, LimitParameters, Mismatch,
    PaperParameters,
};
use flexor::number::fixed::{Exponent, Fixed};
use flexor::number::{Scalar, SiScalar};
use flexor::phase::Phase;
use flexor::signals::{Measurement, Saturation};
use flexor::table::Table;
use flexor_sim::analysis::fixed_point::accuracy::{Errors, hostile_law, measure};
use flexor_sim::analysis::fixed_point::range::{Analysis, RangeError, TORQUE_ERROR_SHARE, analyse};
use flexor_sim::analysis::fixed_point::trial::{ends, random_measurements};
use flexor_sim::files::config;
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::plan::Plan;
use flexor_sim::simulation::cases;
use flexor_sim::simulation::cases::Mode;
use flexor_sim::simulation::closed_loop::RunOptions;
use flexor_sim::simulation::start::Start;
use flexor_tests::{fast_task, paper_arm, paper_task, planned};
use proptest::prelude::*;
use std::sync::LazyLock;

fn law() -> PaperParameters {
    flexor_tests::paper_law()
}

fn options(plan: &Plan) -> RunOptions {
    RunOptions {
        law: Mode::Proposed.of(&law().into()),
        limits: default_limits(plan),
        plant: cases::plant(plan.model.elements, 0.9),
        start: Start::PlanAtRest,
    }
}

/// The paper's task: plan, table image, analysis with the example's gains.
struct Paper {
    plan: Plan,
    image: Vec<u8>,
    limits: LimitParameters,
    analysis: Analysis,
}

static PAPER: LazyLock<Paper> = LazyLock::new(|| {
    let (plan, table) = planned(&paper_arm(), &paper_task());
    let limits = default_limits(&plan);
    let analysis = analyse(&plan, &table.image, &law().into(), &limits).unwrap();
    Paper {
        plan,
        image: table.image,
        limits,
        analysis,
    }
});

/// The hybrid law with the gains of an example.
fn hybrid(text: &str) -> HybridParameters {
    match config::parse_controller("example", text) {
        Ok(LawParameters::Hybrid(law)) => law,
        other => panic!("{other:?}"),
    }
}

/// For any inertia at link 2's root, and for a hub.
fn hybrids() -> [HybridParameters; 2] {
    [
        include_str!("../examples/controller.toml"),
        include_str!("../examples/controller_hub.toml"),
    ]
    .map(hybrid)
}

#[test]
fn the_papers_task_is_within_the_bars_in_closed_loop() {
    let paper = &*PAPER;
    let [single, fixed] =
        measure(&paper.plan, &paper.image, &options(&paper.plan), &|| ()).unwrap();
    for (a, factor) in [(&single, 100.0), (&fixed, 1.0)] {
        assert_eq!(a.closed_loop.ticks, paper.plan.points.len());
        assert!(a.closed_loop.rms_nm <= 2e-4 / factor, "{a:?}");
        assert!(a.closed_loop.max_nm <= 1e-3 / factor);
        assert!(a.force_difference_max_n <= 2e-3 / factor);
        assert_eq!(a.closed_loop.saturations, 0);
        assert!(a.effective_bits > 18.0);
    }
    // Fixed point is better than the bars by far; what it reaches must not get lost.
    assert!(fixed.closed_loop.max_nm <= 3e-6 && fixed.force_difference_max_n <= 2e-5);
}

#[test]
fn random_and_adversarial_inputs_stay_within_the_stated_bound() {
    let paper = &*PAPER;
    let options = options(&paper.plan);
    let [_, fixed] = measure(&paper.plan, &paper.image, &options, &|| ()).unwrap();
    assert_eq!(fixed.random.ticks, 100_000);
    assert_eq!(fixed.excess(), Vec::<String>::new());
    let within = |errors: &Errors, largest: f64| {
        for joint in 0..2 {
            let allowed = errors.bound_nm[joint];
            assert!(
                errors.joint_max_nm[joint] <= allowed && allowed < largest,
                "{errors:?}"
            );
        }
    };
    within(&fixed.random, 1e-4);
    within(&fixed.adversarial, 1e-3);
    // The trial has found the ends of the formats.
    assert!(fixed.adversarial.saturations > 1000);
}

#[test]
fn the_hybrid_law_stays_within_its_bounds_in_every_trial() {
    let paper = &*PAPER;
    for law in hybrids() {
        let options = RunOptions {
            law: law.into(),
            ..options(&paper.plan)
        };
        let [single, fixed] = measure(&paper.plan, &paper.image, &options, &|| ()).unwrap();
        assert_eq!(single.excess(), Vec::<String>::new());
        assert_eq!(fixed.excess(), Vec::<String>::new());
        for errors in [fixed.closed_loop, fixed.random, fixed.adversarial] {
            // A hub's gauge loop of 91 1/s multiplies what it gathers by 200.
            assert!(
                errors.bound_nm[0] < 4e-3 && errors.bound_nm[1] < 5e-2,
                "{errors:?}"
            );
            assert!(errors.ticks > 10_000);
        }
        // What is reached is far below the bounds, and must not get lost.
        let [first, second] = fixed.closed_loop.joint_max_nm;
        assert!(first < 4e-4 && second < 2e-5, "{:?}", fixed.closed_loop);
        assert!(fixed.force_difference_max_n < 5e-5);
        assert_eq!(fixed.closed_loop.saturations, 0);
        assert!(fixed.adversarial.saturations > 1000);
        // The same share of the planned torques is asked of f32, in either joint.
        let [first, second] = single.closed_loop.bound_nm;
        assert_eq!(
            [first, second],
            [0, 1].map(|i| TORQUE_ERROR_SHARE * paper.plan.peaks.torque[i])
        );
    }
}

/// From the air through contact and along the path until the tip is lifted off: the motion comes
/// to the same states in fixed point as in f64, within a tick or two, and asks
/// for the same torques until the table begins.
#[test]
fn the_motion_in_fixed_point_is_that_of_f64() {
    let paper = &*PAPER;
    let law = LawParameters::Hybrid(hybrids()[0]);
    let analysis = analyse(&paper.plan, &paper.image, &law, &paper.limits).unwrap();
    let formats = analysis.formats();
    let table = Table::open(&paper.image).unwrap();
    let mut fixed = Controller::with(&table, &analysis.coefficients).unwrap();
    let mut exact =
        Controller::<f64>::new(&table, &paper.plan.model.arm, &law, &paper.limits).unwrap();
    let mut seen: Vec<(Phase, [u32; 2])> = vec![];
    let (mut worst, mut together) = ([0.0_f64; 2], 0);
    for tick in 0..40_000_usize {
        let point = &paper.plan.points[(exact_tick(&seen, tick)).min(paper.plan.points.len() - 1)];
        let [theta10, theta20] = point.joint.angle;
        // Contact after a second, a loss of 4 ms on the path, none when the tip is lifted off.
        let lifted = seen
            .last()
            .is_some_and(|(phase, _)| *phase == Phase::Retract);
        let force = if tick < 5000 || (22_000..22_020).contains(&tick) || lifted {
            0.0
        } else {
            2.0
        };
        let si = Measurement {
            motor: [theta10 + 1e-4, theta20 - theta10 + point.root_slope - 1e-3],
            force,
            root_moment: point.torque[1],
            ..Measurement::default()
        };
        let rounded = Measurement::<Fixed>::from_si(&si, formats);
        let (is, should) = (fixed.tick(&rounded), exact.tick(&rounded.to_si(formats)));
        if is.phase == should.phase {
            together += 1;
        }
        if seen.last().is_none_or(|(phase, _)| *phase != should.phase) {
            seen.push((should.phase, [should.tick, tick as u32]));
        }
        // From there on the tables may be a tick apart, and the planned torques with them.
        let begun = seen.iter().any(|(phase, _)| *phase == Phase::Follow);
        if is.phase == should.phase && !begun {
            for joint in 0..2 {
                let is = is.torque[joint].to_si(formats.torque[joint]);
                worst[joint] = worst[joint].max((is - should.torque[joint]).abs());
            }
        }
        if [is.phase, should.phase] == [Phase::Hold; 2] {
            break;
        }
    }
    let phases: Vec<Phase> = seen.iter().map(|(phase, _)| *phase).collect();
    assert_eq!(
        phases,
        [
            Phase::Approach,
            Phase::Contact,
            Phase::Follow,
            Phase::Lost,
            Phase::Follow,
            Phase::Retract,
            Phase::Hold
        ]
    );
    assert_eq!(fixed.phase(), Phase::Hold);
    let last = seen.last().map_or(0, |(_, [_, tick])| *tick);
    assert!(last - together < 10, "{together} of {last}");
    assert!(worst[0] < 2e-3 && worst[1] < 1e-3, "{worst:?}");
}

/// Tick of the plan at a `tick` of the run: the table begins with the first follow.
fn exact_tick(seen: &[(Phase, [u32; 2])], tick: usize) -> usize {
    let begun = seen.iter().find(|(phase, _)| *phase == Phase::Follow);
    begun.map_or(0, |(_, [table, at])| *table as usize + tick - *at as usize)
}

#[test]
fn admissible_measurements_saturate_nothing_but_torques_beyond_their_limits() {
    let paper = &*PAPER;
    let table = Table::open(&paper.image).unwrap();
    let mut controller = Controller::with(&table, &paper.analysis.coefficients).unwrap();
    let range = paper.analysis.admissible();
    for measured in random_measurements(&range).take(10_000) {
        let measured = Measurement::from_si(&measured, paper.analysis.formats());
        let before = *controller.saturations();
        let command = controller.tick(&measured);
        let after = controller.saturations();
        for joint in 0..2 {
            if after.torque[joint] != before.torque[joint] {
                assert_ne!(command.saturation[joint], Saturation::None);
            }
        }
    }
    let counts = controller.saturations();
    assert_eq!(
        counts.total(),
        counts.torque[0] + counts.torque[1],
        "{counts:?}"
    );
}

#[test]
fn a_faster_task_and_another_rate_fit_too() {
    let arm = paper_arm();
    let (plan, table) = planned(&arm, &fast_task(0.3));
    let options = options(&plan);
    let [_, fixed] = measure(&plan, &table.image, &options, &|| ()).unwrap();
    assert!(fixed.closed_loop.max_nm <= 1e-3 && fixed.force_difference_max_n <= 2e-3);
}

#[test]
fn nothing_drifts_in_ten_million_ticks() {
    // Half an hour at 5 kHz, held at the table's end. The force errs by a little that
    // cancels out in pairs of ticks but for less than a unit of the increment; the slope
    // rate's deviation, too, is too small to move a filter of 32 bits.
    let paper = &*PAPER;
    let law = law();
    let table = Table::open(&paper.image).unwrap();
    let analysis = &paper.analysis;
    let formats = analysis.formats();
    let mut fixed = Controller::with(&table, &analysis.coefficients).unwrap();
    let mut exact =
        Controller::<f64>::new(&table, &paper.plan.model.arm, &law.into(), &paper.limits).unwrap();
    let last = paper.plan.points.last().unwrap();
    let measured = [0.013, -0.013 + 1e-6].map(|error| {
        let si = Measurement {
            angle: last.joint.angle,
            root_slope: last.root_slope,
            root_slope_rate: 3e-8,
            force: 2.0 - error,
            ..Measurement::default()
        };
        let rounded = Measurement::<Fixed>::from_si(&si, formats);
        (rounded, rounded.to_si(formats))
    });
    // On to the end of the table first: torques are the plan's there.
    let mut worst = 0.0_f64;
    for tick in 0..10_000_000_usize {
        let (rounded, same) = &measured[tick % 2];
        let (is, should) = (fixed.tick(rounded), exact.tick(same));
        if tick > 20_000 {
            for joint in 0..2 {
                let is = is.torque[joint].to_si(formats.torque[joint]);
                worst = worst.max((is - should.torque[joint]).abs());
            }
        }
    }
    let integral = Fixed::of_sum(fixed.force_integral()).to_si(formats.force);
    // 1e-6 N / 2 gathered over 2000 s with 2 1/s.
    assert!(exact.force_integral() > 1e-3, "{}", exact.force_integral());
    let drift = integral - exact.force_integral();
    assert!(drift.abs() < 2e-6, "integral drifted by {drift:e} N");
    assert!(worst < 1e-5, "torque drifted by {worst:e} N m");
    assert_eq!(fixed.saturations().total(), 0);
}

#[test]
fn torques_are_monotone_up_to_and_beyond_saturation() {
    let paper = &*PAPER;
    let law = PaperParameters {
        force_proportional: 3.0,
        ..law()
    };
    let analysis = analyse(&paper.plan, &paper.image, &law.into(), &paper.limits).unwrap();
    let table = Table::open(&paper.image).unwrap();
    let fresh = Controller::with(&table, &analysis.coefficients).unwrap();
    let first = &paper.plan.points[0];
    let formats = analysis.formats();
    let at_rest = Measurement::<Fixed>::from_si(
        &Measurement {
            angle: first.joint.angle,
            force: 2.0,
            root_slope_rate: first.root_slope_rate,
            ..Measurement::default()
        },
        formats,
    );
    // Every end of the format, and 2000 steps between.
    let grid = || {
        (-1000..=1000_i64)
            .map(|i| {
                Fixed::from_bits((i * 2_147_483).clamp(i32::MIN.into(), i32::MAX.into()) as i32)
            })
            .chain([Fixed::MAX])
    };
    let grid = || std::iter::once(Fixed::MIN).chain(grid());
    let mut before: Option<[Fixed; 2]> = None;
    let mut saturated = 0;
    for force in grid() {
        let mut controller = fresh.clone();
        let torque = controller.tick(&Measurement { force, ..at_rest }).torque;
        saturated += controller.saturations().total();
        // Both moment arms are positive there: more force is answered with less torque.
        if let Some(before) = before {
            assert!(torque[0] <= before[0] && torque[1] <= before[1]);
        }
        before = Some(torque);
    }
    assert!(saturated > 100);
    before = None;
    for root_slope_rate in grid() {
        let mut controller = fresh.clone();
        let torque = controller
            .tick(&Measurement {
                root_slope_rate,
                ..at_rest
            })
            .torque;
        assert!(before.is_none_or(|before| torque[1] <= before[1]));
        before = Some(torque);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Debug builds panic where a sum that is held to be in range is not.
    #[test]
    fn no_bits_wrap_or_leave_the_limits(
        words in proptest::collection::vec(proptest::array::uniform8(any::<i32>()), 300),
        sides in proptest::collection::vec(0..3_usize, 300),
        which in 0..4_usize,
    ) {
        const SIDES: [Saturation; 3] = [Saturation::None, Saturation::Upper, Saturation::Lower];
        let paper = &*PAPER;
        let law: LawParameters = match which {
            0 => law().into(),
            1 => hostile_law(&law(), paper.plan.tick_rate_hz).into(),
            _ => hybrids()[which - 2].into(),
        };
        let analysis = analyse(&paper.plan, &paper.image, &law, &paper.limits).unwrap();
        let table = Table::open(&paper.image).unwrap();
        let mut controller = Controller::with(&table, &analysis.coefficients).unwrap();
        let formats = analysis.formats();
        for (bits, side) in words.into_iter().zip(sides) {
            let [a, b, c, d, e, m1, m2, moment] = bits.map(Fixed::from_bits);
            let command = controller.tick(&Measurement {
                angle: [a, b],
                root_slope: c,
                root_slope_rate: d,
                force: e,
                motor: [m1, m2],
                root_moment: moment,
                drive: [SIDES[side], SIDES[2 - side]],
            });
            prop_assert_eq!(command.fault, None);
            for joint in 0..2 {
                let torque = command.torque[joint].to_si(formats.torque[joint]);
                prop_assert!(torque.abs() <= paper.limits.torque_nm[joint] + 1e-6);
            }
        }
    }
}

#[test]
fn measurements_beyond_a_format_are_held_at_its_end() {
    let formats = PAPER.analysis.formats();
    let mut far = ends(formats);
    far.force *= 3.0;
    let held = Measurement::<Fixed>::from_si(&far, formats);
    assert_eq!(held.force, Fixed::MAX);
    far.force = f64::NAN;
    assert_eq!(
        Measurement::<Fixed>::from_si(&far, formats).force,
        Fixed::ZERO
    );
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let paper = &*PAPER;
    let refusal = |law: &PaperParameters, limits: &LimitParameters| {
        analyse(&paper.plan, &paper.image, &(*law).into(), limits).unwrap_err()
    };
    let wide = LimitParameters {
        torque_nm: [1e6, 1.0],
        ..paper.limits
    };
    let error = refusal(&law(), &wide);
    assert!(
        matches!(
            error,
            RangeError::Signal {
                signal: "force",
                ..
            }
        ),
        "{error}"
    );
    let slow = PaperParameters {
        force_integral_per_s: 1e-5,
        ..law()
    };
    let error = refusal(&slow, &paper.limits);
    assert!(error.to_string().starts_with("K_IF_per_s = "), "{error}");
    let steep = PaperParameters {
        slope_rate_nms_rad: 1e4,
        ..law()
    };
    let error = refusal(&steep, &paper.limits);
    assert!(error.to_string().contains("'slope_rate'"), "{error}");
    let refused = |change: fn(&mut HybridParameters)| {
        let [mut law, _] = hybrids();
        change(&mut law);
        analyse(&paper.plan, &paper.image, &law.into(), &paper.limits)
            .unwrap_err()
            .to_string()
    };
    let error = refused(|law| law.force_integral_per_s = 1e-6);
    assert!(error.starts_with("force_integral_per_s = "), "{error}");
    let error = refused(|law| law.free.torque_loop_per_s = 1e-6);
    assert!(error.starts_with("free.torque_loop_per_s = "), "{error}");
    let error = refused(|law| law.joint_damping_nms_rad[0] = 1e4);
    assert!(error.contains("'torque1'"), "{error}");
    let error = refused(|law| law.joint_stiffness_nm_rad[1] = 1e4);
    assert!(error.contains("'root_slope'"), "{error}");
    // A table whose torques may exceed the format.
    let table = Table::open(&paper.image).unwrap();
    let mut formats = *paper.analysis.formats();
    formats.torque[0] = Exponent(2);
    let arm = &paper.plan.model.arm;
    let tight = Coefficients::<Fixed>::new(arm, &law().into(), &paper.limits, 5000, &formats);
    assert_eq!(
        Controller::with(&table, &tight).unwrap_err(),
        Mismatch::Range { column: 0 }
    );
    let mut other = paper.analysis.coefficients;
    other.tick_rate_hz = 4000;
    assert_eq!(
        Controller::with(&table, &other).unwrap_err(),
        Mismatch::TickRate {
            expected: 4000,
            found: 5000
        }
    );
}

#[test]
fn admissible_measurements_fit_their_formats() {
    let Paper { analysis, .. } = &*PAPER;
    for signal in analysis.signals {
        assert!(signal.admissible < signal.exponent.range(), "{signal:?}");
    }
}

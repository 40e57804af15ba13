//! The tick in fixed point: how exact it is, that nothing wraps or drifts, and what does
//! not fit is refused by name.

use flexor::control::{Coefficients, Controller, LimitParameters, Mismatch, PaperParameters};
use flexor::number::fixed::{Exponent, Fixed};
use flexor::number::{Scalar, SiScalar};
use flexor::signals::{Measurement, Saturation};
use flexor::table::Table;
use flexor_sim::analysis::fixed_point::accuracy::{ends, measure, random_measurements};
use flexor_sim::analysis::fixed_point::range::{Analysis, RangeError, analyse};
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

/// Bound of a run's torque errors: a tick's, and what the integral has gathered.
fn bound(analysis: &Analysis, law: &PaperParameters, plan: &Plan) -> f64 {
    let seconds = f64::from(plan.ticks) / f64::from(plan.tick_rate_hz);
    let arm = &plan.model.arm;
    let gathered = law.force_integral_per_s * seconds * analysis.force_error;
    let [first, second] = analysis.torque_error;
    first.max(second) + (arm.link1_length_m + arm.link2_length_m) * gathered
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
    let allowed = bound(&paper.analysis, &law(), &paper.plan);
    assert!(fixed.random.max_nm <= allowed, "{:?}", fixed.random);
    assert!(allowed < 1e-4, "{allowed}");

    let hostile =
        flexor_sim::analysis::fixed_point::accuracy::hostile_law(&law(), paper.plan.tick_rate_hz);
    let analysis = analyse(&paper.plan, &paper.image, &hostile.into(), &options.limits).unwrap();
    let allowed = bound(&analysis, &hostile, &paper.plan);
    assert!(
        fixed.adversarial.max_nm <= allowed,
        "{:?}",
        fixed.adversarial
    );
    assert!(allowed < 1e-3, "{allowed}");
    // The trial has found the ends of the formats.
    assert!(fixed.adversarial.saturations > 1000);
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
        words in proptest::collection::vec(proptest::array::uniform5(any::<i32>()), 300),
        sides in proptest::collection::vec(0..3_usize, 300),
        hostile: bool,
    ) {
        const SIDES: [Saturation; 3] = [Saturation::None, Saturation::Upper, Saturation::Lower];
        let paper = &*PAPER;
        let law = if hostile {
            flexor_sim::analysis::fixed_point::accuracy::hostile_law(&law(), paper.plan.tick_rate_hz)
        } else {
            law()
        };
        let analysis = analyse(&paper.plan, &paper.image, &law.into(), &paper.limits).unwrap();
        let table = Table::open(&paper.image).unwrap();
        let mut controller = Controller::with(&table, &analysis.coefficients).unwrap();
        let formats = analysis.formats();
        for (bits, side) in words.into_iter().zip(sides) {
            let [a, b, c, d, e] = bits.map(Fixed::from_bits);
            let command = controller.tick(&Measurement {
                angle: [a, b],
                root_slope: c,
                root_slope_rate: d,
                force: e,
                drive: [SIDES[side], SIDES[2 - side]],
                ..Measurement::default()
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

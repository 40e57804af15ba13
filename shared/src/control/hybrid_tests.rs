//! Unit tests of the hybrid law.

use crate::control::filter::filter_alpha;
use crate::control::{HybridDemand, HybridLaw, HybridParameters, HybridState};
use crate::model::ArmParameters;
use crate::number::SiScalar;
use crate::number::fixed::{Exponent, Fixed};
use crate::signals::{Formats, Measurement, PoseSetpoint, Saturation, SaturationCounts};
use proptest::prelude::*;

const ARM: ArmParameters = ArmParameters::PAPER;
const GAINS: HybridParameters = HybridParameters {
    // Exact in f32, so that closed forms need no rounding of their own.
    joint_damping_nms_rad: [60.0, 0.03125],
    force_integral_per_s: 10.25,
    joint_stiffness_nm_rad: [800.0, 2.25],
    section_frequency_rad_s: 26.75,
    section_damping: 0.5625,
    section_angle_nm_rad: [0.875, 1.125],
    section_force: [0.15625, 0.203125],
    ..HybridParameters::PAPER_ARM_HUB
};
const RATE_HZ: u32 = 5000;
const T: f64 = 1.0 / 5000.0;

fn setpoint() -> PoseSetpoint<f64> {
    PoseSetpoint {
        torque: [-3.0, 0.3],
        force: 2.0,
        motor: [0.95, 0.17 - 0.72 - 0.95],
        moment_arm: moment_arm(),
    }
}

/// As planned, but for errors of the motor angles, and with this force and root moment.
fn measured(error: [f64; 2], force: f64, root_moment: f64) -> Measurement<f64> {
    let p = setpoint();
    Measurement {
        motor: [0, 1].map(|i| p.motor[i] + error[i]),
        force,
        root_moment,
        ..Measurement::default()
    }
}

fn update(
    law: &HybridLaw<f64>,
    state: &mut HybridState<f64>,
    measured: &Measurement<f64>,
) -> HybridDemand<f64> {
    law.update(
        state,
        &setpoint(),
        measured,
        &mut SaturationCounts::default(),
    )
}

fn law(gains: &HybridParameters) -> HybridLaw<f64> {
    HybridLaw::new(gains, &ARM, RATE_HZ)
}

/// Joint 2's moment arm at [`setpoint`].
fn moment_arm() -> f64 {
    0.55 * libm::cos(0.72)
}

#[track_caller]
fn near(is: f64, should: f64, tolerance: f64) {
    assert!((is - should).abs() <= tolerance, "{is} is not {should}");
}

#[test]
fn as_planned_the_feedforward_passes() {
    let (law, mut state) = (law(&GAINS), HybridState::default());
    for _ in 0..1000 {
        let demand = update(&law, &mut state, &measured([0.0; 2], 2.0, 0.3));
        near(demand.torque[0], -3.0, 1e-10);
        near(demand.torque[1], 0.3, 1e-10);
    }
}

#[test]
fn the_first_tick_knows_no_rates() {
    let demand = update(
        &law(&GAINS),
        &mut HybridState::default(),
        &measured([0.01, 0.1], 2.0, 0.3),
    );
    let place = 800.0 * 0.01 + 2500.0 * T * 0.01;
    near(demand.torque[0], -3.0 - place, 1e-9);
    let want = 0.3 - 2.25 * 0.1;
    near(demand.torque[1], want + 91.0 * T * (want - 0.3), 1e-9);
}

#[test]
fn joint_1_answers_a_step_and_a_ramp_by_closed_forms() {
    let law = law(&GAINS);
    let mut state = HybridState::default();
    for k in 1..=2000 {
        let demand = update(&law, &mut state, &measured([1e-3, 0.0], 2.0, 0.3));
        let integral = 2500.0 * T * 1e-3 * f64::from(k);
        near(demand.torque[0], -3.0 - 0.8 - integral, 1e-9);
    }
    // The rate passes 1 - (1 - a)^k of itself.
    let mut state = HybridState::default();
    let a = filter_alpha(30.0, f64::from(RATE_HZ));
    let rate = 0.05;
    for k in 0..1000_i32 {
        let error = rate * T * f64::from(k);
        let demand = update(&law, &mut state, &measured([error, 0.0], 2.0, 0.3));
        let seen = rate * (1.0 - libm::pow(1.0 - a, f64::from(k)));
        let integral = 2500.0 * T * T * rate * f64::from(k * (k + 1) / 2);
        near(
            demand.torque[0],
            -3.0 - 800.0 * error - integral - 60.0 * seen,
            1e-8,
        );
    }
}

#[test]
fn the_force_integral_and_the_section_answer_a_step_by_closed_forms() {
    // Without the torque loop; link 2 as planned.
    let law = law(&HybridParameters {
        torque_loop_per_s: 0.0,
        ..GAINS
    });
    let mut state = HybridState::default();
    let (error, s2) = (0.1, moment_arm());
    let [w, z] = [GAINS.section_frequency_rad_s, GAINS.section_damping];
    let decay = |k: i32| libm::exp(-z * w * T * f64::from(k));
    let turn = |k: i32| w * libm::sqrt(1.0 - z * z) * T * f64::from(k);
    let mut x = 0.0;
    for k in 0..5000 {
        let demand = update(&law, &mut state, &measured([0.0; 2], 2.0 - error, 0.3));
        let force = s2 * 10.25 * T * error * f64::from(k + 1);
        near(demand.torque[1], 0.3 + force + x, 1e-6);
        // Every tick's input rings down on its own: R^k (b1, b2).
        let b = GAINS.section_force.map(|h| w * T * h * -s2 * error);
        x += decay(k) * (b[0] * libm::cos(turn(k)) + b[1] * libm::sin(turn(k)));
    }
    // At rest: the gain of the section, z h1 + sqrt(1 - z^2) h2.
    let h = GAINS.section_force;
    let rest = -s2 * error * (z * h[0] + libm::sqrt(1.0 - z * z) * h[1]);
    near(state.section[0], rest, 2.0 * w * T * rest.abs());
}

#[test]
fn the_sections_poles_are_the_stated_ones_at_any_rate() {
    for rate_hz in [500, 1000, 5000, 20_000] {
        let law = HybridLaw::<f64>::new(&GAINS, &ARM, rate_hz);
        let period = 1.0 / f64::from(rate_hz);
        let mut state = HybridState {
            section: [1.0, 0.0],
            ..HybridState::default()
        };
        let ticks = rate_hz / 10;
        for _ in 0..ticks {
            update(&law, &mut state, &measured([0.0; 2], 2.0, 0.3));
        }
        let time = f64::from(ticks) * period;
        let [w, z] = [GAINS.section_frequency_rad_s, GAINS.section_damping];
        let (decay, turn) = (libm::exp(-z * w * time), w * libm::sqrt(1.0 - z * z) * time);
        near(state.section[0], decay * libm::cos(turn), 1e-9);
        near(state.section[1], -decay * libm::sin(turn), 1e-9);
    }
}

#[test]
fn the_torque_loop_follows_the_moment_up_to_its_limit() {
    let law = law(&GAINS);
    let mut state = HybridState::default();
    let missing = 0.05;
    for k in 1..=2000 {
        let demand = update(&law, &mut state, &measured([0.0; 2], 2.0, 0.3 - missing));
        let correction = (91.0 * T * missing * f64::from(k)).min(0.5);
        near(demand.torque[1], 0.3 + correction, 1e-9);
    }
}

#[test]
fn whatever_pushes_into_a_limit_stops_and_leaves_it() {
    let law = law(&GAINS);
    // Errors that let each of the three states grow into the upper limit, and the lower.
    for (limit, sign) in [(Saturation::Upper, 1.0), (Saturation::Lower, -1.0)] {
        let mut state = HybridState::default();
        let push = measured([-sign * 0.01, 0.0], 2.0 - sign * 0.5, 0.3 - sign);
        let demand = update(&law, &mut state, &push);
        let with = state;
        law.anti_windup(&mut state, &demand, [limit; 2]);
        assert_eq!(
            [
                state.place_integral,
                state.force_integral,
                state.torque_correction
            ],
            [0.0; 3]
        );
        // The other joint's limit is none of a joint's business.
        let mut state = with;
        law.anti_windup(&mut state, &demand, [limit, Saturation::None]);
        assert_eq!(
            (state.place_integral, state.force_integral),
            (0.0, with.force_integral)
        );
        // What leads away stays.
        let mut state = HybridState::default();
        let demand = update(&law, &mut state, &push);
        let away = match limit {
            Saturation::Upper => Saturation::Lower,
            _ => Saturation::Upper,
        };
        law.anti_windup(&mut state, &demand, [away; 2]);
        assert_eq!(state, with);
    }
}

#[test]
fn without_joint_1s_stiffness_there_is_no_integral() {
    let law = law(&HybridParameters {
        joint_stiffness_nm_rad: [0.0, 2.25],
        ..GAINS
    });
    let mut state = HybridState::default();
    for _ in 0..10 {
        let demand = update(&law, &mut state, &measured([0.5, 0.0], 2.0, 0.3));
        assert_eq!(demand.torque[0], -3.0);
    }
}

proptest! {
    /// Fixed point follows f64 on the same rounded measurements.
    #[test]
    fn fixed_point_follows(
        ticks in prop::collection::vec(
            (-2e-3..2e-3_f64, -5e-3..5e-3_f64, -1.0..4.0_f64, -0.5..1.0_f64), 1..300,
        ),
    ) {
        let formats = Formats {
            torque: [Exponent(7), Exponent(3)],
            force: Exponent(6),
            root_slope: Exponent(1),
            slope_rate: Exponent(6),
            moment_arm: Exponent(1),
        };
        let fixed = HybridLaw::<Fixed>::in_formats(&GAINS, &ARM, RATE_HZ, &formats);
        let exact = law(&GAINS);
        let (mut a, mut b) = (HybridState::default(), HybridState::default());
        let p = setpoint();
        let planned = PoseSetpoint {
            torque: [0, 1].map(|i| Fixed::from_si(p.torque[i], formats.torque[i])),
            force: Fixed::from_si(p.force, formats.force),
            motor: p.motor.map(Fixed::from_rad),
            moment_arm: Fixed::from_si(p.moment_arm, formats.moment_arm),
        };
        let mut counts = SaturationCounts::default();
        for (e1, e2, force, moment) in ticks {
            let m = Measurement::<Fixed>::from_si(&measured([e1, e2], force, moment), &formats);
            let is = fixed.update(&mut a, &planned, &m, &mut counts).torque;
            let should = update(&exact, &mut b, &m.to_si(&formats)).torque;
            for i in 0..2 {
                let error = is[i].to_si(formats.torque[i]) - should[i];
                prop_assert!(error.abs() < [2e-5, 1e-5][i], "torque {i}: {error:e}");
            }
        }
        prop_assert_eq!(counts.total(), 0);
    }
}

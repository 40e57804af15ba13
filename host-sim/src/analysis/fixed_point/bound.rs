//! Bounds of a torque's error in fixed point, of the two laws; their derivation is in
//! `docs/fixed-point.md`.

use super::signal::{FORCE, MOMENT_ARM, ROOT_SLOPE, SLOPE_RATE, Signal, TORQUE2};
use crate::planner::plan::Plan;
use flexor::control::{
    FreeParameters, HybridParameters, LawParameters, LimitParameters, PaperParameters,
    RATE_MAX_RAD_S,
};
use flexor::number::SiScalar;
use flexor::number::fixed::{Exponent, Fixed, RADIANS_PER_UNIT};
use flexor::table::Header;
use std::f64::consts::{SQRT_2, TAU};

/// The sine's own error.
const SINE_ERROR: f64 = 3e-8;

/// Bounds of what fixed point changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bound {
    /// A tick's torque errors in parts, N m: for each joint a signal's position and what it
    /// contributes.
    pub(super) parts: [[(usize, f64); 5]; 2],
    /// What the law's memory adds to them by the plan's end, N m.
    pub(super) gathered: [f64; 2],
    /// Of the force error in one tick, N.
    pub(super) force: f64,
}

impl Bound {
    /// The bounds for a law on a plan, with signals of these formats.
    pub(super) fn new(
        signals: &[Signal; 6],
        header: &Header,
        law: &LawParameters,
        (plan, limits): (&Plan, &LimitParameters),
    ) -> Self {
        let rounding = Rounding {
            signals,
            header,
            lengths: [plan.model.arm.link1_length_m, plan.model.arm.link2_length_m],
            seconds: f64::from(plan.ticks) / f64::from(plan.tick_rate_hz),
        };
        match law {
            LawParameters::Paper(law) => rounding.paper(law),
            LawParameters::Hybrid(law) => rounding.hybrid(law, limits),
        }
    }

    /// Bound of a joint's torque error in one tick, N m.
    pub(super) fn tick(&self, joint: usize) -> f64 {
        self.parts[joint].iter().map(|(_, part)| part).sum()
    }
}

/// What rounds, and by how much.
struct Rounding<'a> {
    signals: &'a [Signal; 6],
    header: &'a Header,
    /// r1 and r2, m.
    lengths: [f64; 2],
    /// The plan's length.
    seconds: f64,
}

/// 2 to the power `e`.
fn power(e: i32) -> f64 {
    libm::ldexp(1.0, e)
}

/// Rounding of a filter's coefficient.
const ALPHA_ERROR: f64 = 1.0 / 4_294_967_296.0;

impl Rounding<'_> {
    fn exponent(&self, signal: usize) -> Exponent {
        self.signals[signal].exponent
    }

    fn unit(&self, signal: usize) -> f64 {
        self.exponent(signal).unit()
    }

    /// Splines: 16 units of 2^-28 of what the column's integers can hold, and of the
    /// signal's own where those are coarser.
    fn spline(&self, column: usize, unit: f64) -> f64 {
        let holds = power(30 - i32::from(self.header.scaling[column]));
        16.0 * (power(-28) * holds).max(unit)
    }

    /// The spline of motor 2's angle, the sum of three columns: its control points hold four times
    /// what the largest of them does, and each of the three is rounded down.
    fn motor2(&self) -> f64 {
        let least = self.header.scaling[3..=5].iter().min();
        let holds = power(32 - i32::from(*least.unwrap_or(&0)));
        (16.0 + 3.0) * (power(-28) * holds).max(RADIANS_PER_UNIT)
    }

    /// A product with a gain that loses these bits: its mantissa and the rounding, 2^up units of
    /// the result.
    fn scaled(&self, up: u8, to: usize) -> f64 {
        1.5 * power(i32::from(up)) * self.unit(to)
    }

    /// A product of moment arm and force in a joint's torque.
    fn product(&self, joint: usize) -> f64 {
        let (arm, force) = (self.exponent(MOMENT_ARM), self.exponent(FORCE));
        power(i32::from(Fixed::shift(arm, force, self.exponent(joint)))) * self.unit(joint)
    }

    fn length(&self, link: usize) -> f64 {
        let gain = Fixed::gain(self.lengths[link], Fixed::SINE, self.exponent(MOMENT_ARM));
        self.scaled(gain.up(), MOMENT_ARM)
    }

    fn rate(&self) -> f64 {
        f64::from(self.header.tick_rate_hz)
    }

    /// Of the paper's law.
    fn paper(&self, law: &PaperParameters) -> Bound {
        let rate = self.rate();
        let force_unit = self.unit(FORCE);
        let force_gain = |value| {
            let gain = Fixed::gain(value, self.exponent(FORCE), self.exponent(FORCE));
            self.scaled(gain.up(), FORCE)
        };
        let force = self.spline(2, force_unit) + force_unit;
        let (derivative, proportional) = (law.force_derivative_s * rate, law.force_proportional);
        let correction = derivative.abs() * (2.0 * force + force_unit)
            + force_gain(derivative)
            + proportional.abs() * (force + force_unit)
            + force_gain(proportional)
            + law.force_integral_per_s / rate * force
            + force_unit;
        // Argument: table, the measured angle's unit; then the polynomial.
        let angle = self.spline(7, RADIANS_PER_UNIT) + 2.0 * RADIANS_PER_UNIT;
        let longest = self.lengths[0] + self.lengths[1];
        let moment_arm = longest * (angle + SINE_ERROR) + self.length(0) + self.length(1);
        let slope_rate = {
            let gain = law.slope_rate_nms_rad;
            let own = Fixed::gain(gain, self.exponent(SLOPE_RATE), self.exponent(TORQUE2));
            let deviation = self.spline(6, self.unit(SLOPE_RATE)) + 2.0 * self.unit(SLOPE_RATE);
            gain.abs() * deviation + self.scaled(own.up(), TORQUE2)
        };
        let largest_force = self.exponent(FORCE).range();
        Bound {
            parts: [0, 1].map(|joint| {
                [
                    (joint, self.spline(joint, self.unit(joint))),
                    (FORCE, longest * correction),
                    // What a moment arm's error does grows with the range of forces.
                    (FORCE, largest_force * moment_arm),
                    (FORCE, self.product(joint)),
                    (SLOPE_RATE, if joint == 1 { slope_rate } else { 0.0 }),
                ]
            }),
            gathered: [longest * law.force_integral_per_s * self.seconds * force; 2],
            force,
        }
    }

    /// Of the hybrid law: the larger of those with the gains of contact and of the air.
    fn hybrid(&self, law: &HybridParameters, limits: &LimitParameters) -> Bound {
        let (tick1, gathered1) = self.place(law);
        let contact = FreeParameters {
            stiffness_nm_rad: law.joint_stiffness_nm_rad[1],
            damping_nms_rad: law.joint_damping_nms_rad[1],
            torque_loop_per_s: law.torque_loop_per_s,
            section_frequency_rad_s: law.section_frequency_rad_s,
            section_damping: law.section_damping,
            section_angle_nm_rad: law.section_angle_nm_rad,
        };
        let [contact, free] = [(&contact, law.section_force), (&law.free, [0.0; 2])]
            .map(|(joint, section_force)| self.force(law, joint, section_force));
        let larger = |a: f64, b: f64| a.max(b);
        let tick2 = [0, 1, 2, 3, 4].map(|i| {
            let (at, part) = contact.parts[i];
            (at, larger(part, free.parts[i].1))
        });
        Bound {
            parts: [tick1, tick2],
            gathered: [
                gathered1,
                larger(contact.gathered, free.gathered).min(2.0 * limits.torque_nm[1]),
            ],
            force: contact.force,
        }
    }

    /// Error of a motor's rate deviation, rad a tick, from that of its angle: the filtered
    /// difference of angles that are each off by `angle` is off by twice the filter's coefficient
    /// times that; then its own rounding, and that of the coefficient.
    fn rate_error(&self, angle: f64, corner_hz: f64) -> f64 {
        let turned = TAU * corner_hz / self.rate();
        let alpha = turned / (1.0 + turned);
        let shift = Fixed::fine_shift(2.0 * RATE_MAX_RAD_S / self.rate());
        let fine = RADIANS_PER_UNIT * power(-i32::from(shift));
        let coefficient = ALPHA_ERROR / alpha * 2.0 * RATE_MAX_RAD_S / self.rate();
        2.0 * alpha * angle + 3.0 * fine + coefficient
    }

    /// Rounding of joint `joint`'s stiffness and damping times their angles, N m.
    fn of_gains(&self, joint: usize, stiffness: f64, damping: f64) -> f64 {
        let (to, rate) = (self.exponent(joint), self.rate());
        let shift = Fixed::fine_shift(2.0 * RATE_MAX_RAD_S / rate);
        let (k, b) = (
            Fixed::angle_gain(stiffness, to).up(),
            Fixed::fine_gain(damping * rate, shift, to).up(),
        );
        self.scaled(k, joint) + self.scaled(b, joint)
    }

    /// Joint 1: parts of a tick's error and what its integral gathers, N m.
    fn place(&self, law: &HybridParameters) -> ([(usize, f64); 5], f64) {
        let [stiffness, _] = law.joint_stiffness_nm_rad;
        let [damping, _] = law.joint_damping_nms_rad;
        let angle = self.spline(3, RADIANS_PER_UNIT) + RADIANS_PER_UNIT;
        let rate = self.rate_error(angle, law.rate_filter_hz[0]);
        let integral = law.joint1_integral_nm_rads;
        // The coefficient's rounding, of the integral at its limit.
        let coefficient = if integral > 0.0 {
            ALPHA_ERROR * stiffness * self.rate() / integral * law.joint1_integral_limit_nm
        } else {
            0.0
        };
        let parts = [
            (0, self.spline(0, self.unit(0))),
            (0, stiffness * (angle + 2.0 * RADIANS_PER_UNIT)),
            (0, damping * self.rate() * rate),
            (0, self.of_gains(0, stiffness, damping)),
            (0, integral / self.rate() * angle),
        ];
        (parts, integral * self.seconds * angle + coefficient)
    }

    /// Joint 2 with one set of gains.
    fn force(&self, law: &HybridParameters, p: &FreeParameters, phi: [f64; 2]) -> Force {
        let (rate, unit) = (self.rate(), self.unit(TORQUE2));
        let longest = self.lengths[1];
        let largest_force = self.exponent(FORCE).range();
        let force = self.spline(2, self.unit(FORCE)) + self.unit(FORCE);
        // The moment arm's ends: table, sine, length; then the way between them.
        let angle = self.spline(7, RADIANS_PER_UNIT) + self.spline(4, RADIANS_PER_UNIT);
        let moment_arm = longest * (angle + 2.0 * RADIANS_PER_UNIT + SINE_ERROR)
            + self.length(1)
            + 4.0 * self.unit(MOMENT_ARM);
        let of_arm = largest_force * moment_arm + self.product(1);
        let angle = self.motor2() + RADIANS_PER_UNIT;
        let turning = p.damping_nms_rad * rate * self.rate_error(angle, law.rate_filter_hz[1]);
        let stiffness = p.stiffness_nm_rad * angle;
        let gains = self.of_gains(1, p.stiffness_nm_rad, p.damping_nms_rad) + unit;
        let step = law.force_integral_per_s / rate;
        let parts = [
            (TORQUE2, self.spline(1, unit)),
            (FORCE, longest * (step * force + self.unit(FORCE))),
            (FORCE, of_arm),
            (ROOT_SLOPE, stiffness + turning),
            (TORQUE2, gains),
        ];
        let tick: f64 = parts.iter().map(|(_, part)| part).sum();
        // The force integral: its error's, and its coefficient's at the format's end.
        let of_integral = longest
            * (law.force_integral_per_s * self.seconds * force
                + relative(ALPHA_ERROR, step) * largest_force);
        let section = self.section(p, (angle, phi), longest * force + of_arm);
        let wanted = tick + of_integral + section;
        let torque_loop = p.torque_loop_per_s;
        let correction = torque_loop * self.seconds * wanted
            + relative(ALPHA_ERROR, torque_loop / rate) * law.torque_correction_limit_nm;
        Force {
            parts,
            // Two corrections within one limit.
            gathered: of_integral + section + correction.min(2.0 * law.torque_correction_limit_nm),
            force,
        }
    }

    /// What the section's state gathers, N m: with poles of radius rho a lasting error of a tick
    /// comes to at most sqrt(2) / (1 - rho) of it. `moment` is phi's error, N m.
    fn section(&self, p: &FreeParameters, (angle, phi): (f64, [f64; 2]), moment: f64) -> f64 {
        let turned = p.section_frequency_rad_s / self.rate();
        let (to, unit) = (self.exponent(TORQUE2), self.unit(TORQUE2));
        let fed = [0, 1].map(|i| {
            let (g, h) = (turned * p.section_angle_nm_rad[i], turned * phi[i]);
            let ups = [Fixed::angle_gain(g, to).up(), Fixed::gain(h, to, to).up()];
            let rounded: f64 = ups.map(|up| self.scaled(up, TORQUE2)).iter().sum();
            // And what is kept of both states: rounded down, with rounded coefficients.
            let kept = 2.0 * unit + 2.0 * ALPHA_ERROR * to.range();
            g.abs() * angle + h.abs() * moment + rounded + kept
        });
        let forgotten = 1.0 - libm::exp(-p.section_damping * turned);
        let ticks = (1.0 / forgotten).min(self.seconds * self.rate());
        SQRT_2 * ticks * fed[0].max(fed[1])
    }
}

/// `error` as a share of `value`, none of nothing.
fn relative(error: f64, value: f64) -> f64 {
    if value > 0.0 { error / value } else { 0.0 }
}

/// Joint 2's bounds with one set of gains.
struct Force {
    parts: [(usize, f64); 5],
    gathered: f64,
    force: f64,
}

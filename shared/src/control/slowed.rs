//! The plan's torques where its table goes slower than planned: while it stops, stands and goes on.
//!
//! A table's torques are those of full speed. Where it goes on by `r` ticks a tick, the same path is
//! gone with `q' = r q'_d` and `q'' = r^2 q''_d + r' q'_d`, so that of a rigid arm's torques what
//! is at rest stays, what moves goes with the square, and the change of speed adds an inertia:
//!
//! ```text
//! tau = tau_s + r^2 (tau_d - tau_s) + r' H q'_d
//!
//! tau_s2 = -S2 g sin(gamma - theta20) + m2 r2 / 8 w'(0) g cos(gamma - theta20) + s2 f_d
//! tau_s1 = -S1 g sin(gamma - theta10) + r1 sin(psi - theta10) f_d + tau_s2
//! H q'   : joint 2   J2 theta20' + h cos(theta20 - theta10) theta10'
//!          joint 1   J1 theta10' + h cos(theta20 - theta10) theta20' + joint 2's
//! ```
//!
//! with the weight's direction gamma; `S1 = (m1 / 2 + m2 + mt) r1`, `S2 = (m2 / 2 + mt) r2`; `J1 =
//! m1 r1^2 / 3 + (m2 + mt) r1^2`, `J2 = m2 r2^2 / 3 + mt r2^2` and the inertias of root and tip,
//! `h = S2 r1`. An end moment bends a beam that is pinned at both ends by `r2 w'(0) / 8` on the
//! average: so far its weight is off the chord.
//!
//! Another torque bends the link otherwise than planned, and motor 2 stands elsewhere for the same
//! place of the tip, by the difference times `r2 / (3 EI)` where a force at the tip makes the moment,
//! 0.75 of it where the load is spread over the link, 0.83 where it grows towards the tip: 0.8.

use crate::control::hybrid::HybridLaw;
use crate::model::ArmParameters;
use crate::number::{Scalar, SiScalar, TableScalar};
use crate::signals::{Formats, PoseSetpoint, SaturationCounts};
use crate::table::Links;
use core::f64::consts::FRAC_PI_2;
use serde::{Deserialize, Serialize};

/// A table's speed of one tick a tick.
pub(super) const FULL: u32 = 1 << 16;

/// Share of a tip force's deflection that the link's own inertia makes with the same root moment.
const SPREAD: f64 = 0.8;

/// What the arm's data give, in the tick's number type.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub(super) struct SlowedPlan<T: Scalar> {
    /// gamma, rad, and a quarter turn.
    weight: T,
    quarter: T,
    /// S1 g and S2 g.
    moment: [T::Gain; 2],
    /// m2 r2 g / 8, of a root slope a torque, to be multiplied by a cosine.
    bent: T::Gain,
    /// Of the angles of a tick the torques J1 theta10', J2 theta20', h theta10', h theta20' when
    /// the table's speed changes by a stop's step.
    inertia: [T::Gain; 4],
    /// Product of a cosine and a torque of joint 1, of joint 2.
    cosine: [T::Shift; 2],
    /// Joint 2's torque as one of joint 1.
    carried: T::Gain,
    /// Compliance of the link's root, rad of a torque of joint 2.
    compliance: T::Gain,
}

impl<T: SiScalar> SlowedPlan<T> {
    /// For `arm` at `tick_rate_hz`, where a stop takes `stop_step` 2^-16 ticks a tick from the
    /// speed in each tick.
    pub(super) fn new(
        arm: &ArmParameters,
        (tick_rate_hz, stop_step): (u32, u32),
        fine: T::Shift,
        formats: &Formats<T::Format>,
    ) -> Self {
        let [torque1, torque2] = formats.torque;
        let (r1, r2, tip) = (arm.link1_length_m, arm.link2_length_m, arm.tip_mass_kg);
        let (m1, m2) = (arm.link1_mass_kg, arm.link2_mass_kg);
        let [g1, g2] = arm.gravity_m_s2;
        let g = libm::hypot(g1, g2);
        let moment1 = (0.5 * m1 + m2 + tip) * r1;
        let moment2 = (0.5 * m2 + tip) * r2;
        let inertia1 = (m1 / 3.0 + m2 + tip) * r1 * r1;
        let inertia2 = (m2 / 3.0 + tip) * r2 * r2 + arm.root_inertia_kgm2 + arm.tip_inertia_kgm2;
        let coupled = moment2 * r1;
        let rate = f64::from(tick_rate_hz);
        // Rates of a radian a tick, slowed in a tick.
        let slowed = rate * rate * f64::from(stop_step) / f64::from(FULL);
        let inertia = |value: f64, torque| T::fine_gain(value * slowed, fine, torque);
        Self {
            weight: T::from_rad(libm::atan2(g2, g1)),
            quarter: T::from_rad(FRAC_PI_2),
            moment: [
                T::gain(moment1 * g, T::SINE, torque1),
                T::gain(moment2 * g, T::SINE, torque2),
            ],
            bent: T::gain(m2 * r2 * g / 8.0, formats.root_slope, torque2),
            inertia: [
                inertia(inertia1, torque1),
                inertia(inertia2, torque2),
                inertia(coupled, torque2),
                inertia(coupled, torque1),
            ],
            cosine: [torque1, torque2].map(|torque| T::shift(T::SINE, torque, torque)),
            carried: T::gain(1.0, torque2, torque1),
            compliance: T::turn_gain(SPREAD / arm.moment_per_root_slope(), torque2),
        }
    }
}

impl<T: TableScalar> SlowedPlan<T> {
    /// Makes the planned torques and motor angle of `setpoint` those of a table that goes on by
    /// `rate`, which the tick changes by `change` (2^-16 ticks a tick; a stop's step at the most,
    /// `stop_step`).
    pub(super) fn apply(
        &self,
        law: &HybridLaw<T>,
        (rate, change): (u32, i32),
        links: &Links<T>,
        setpoint: &mut PoseSetpoint<T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        let rest = self.at_rest(law, links, setpoint, saturations);
        let inertia = self.inertia(law, links, saturations);
        let speed = T::fraction(rate, T::reciprocal_of(FULL));
        let stop_step = law.motion.stop_step;
        let slowing = T::fraction(
            change.unsigned_abs().min(stop_step),
            T::reciprocal_of(stop_step),
        );
        let mut added = T::ZERO;
        for joint in [0, 1] {
            let count = &mut saturations.torque[joint];
            let planned = setpoint.torque[joint];
            let moving = planned.minus(rest[joint], count);
            let moving = moving.times_in_range::<1>(speed).times_in_range::<1>(speed);
            let slowing = inertia[joint].times_in_range::<1>(slowing);
            let torque = rest[joint].plus(moving, count);
            let torque = if change < 0 {
                torque.minus(slowing, count)
            } else {
                torque.plus(slowing, count)
            };
            setpoint.torque[joint] = torque;
            added = torque.minus(planned, count);
        }
        let bent = added.scaled(self.compliance, &mut saturations.motor);
        let [_, motor2] = &mut setpoint.motor;
        *motor2 = motor2.angle_minus(bent.negative());
    }

    /// tau_s, N m.
    fn at_rest(
        &self,
        law: &HybridLaw<T>,
        links: &Links<T>,
        setpoint: &PoseSetpoint<T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> [T; 2] {
        let [count1, count2] = &mut saturations.torque;
        let [below1, below2] = links.angle.map(|angle| self.weight.angle_minus(angle));
        let force = setpoint.force;
        let bent = links.root_slope.scaled(self.bent, count2);
        let cosine = self.quarter.angle_minus(below2).sine();
        let held2 = bent
            .times(cosine, self.cosine[1], count2)
            .minus(below2.sine().scaled(self.moment[1], count2), count2);
        let pressed2 = law.force_on_joint2(setpoint, force, count2);
        let pressed1 = law.force_on_joint1(setpoint, (links.normal, force), count1);
        let held1 = held2
            .scaled(self.carried, count1)
            .minus(below1.sine().scaled(self.moment[0], count1), count1);
        [held1.plus(pressed1, count1), held2.plus(pressed2, count2)]
    }

    /// H q' of a stop's step, N m.
    fn inertia(
        &self,
        law: &HybridLaw<T>,
        links: &Links<T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> [T; 2] {
        let [count1, count2] = &mut saturations.torque;
        let fine = |turn: T| turn.fine(law.fine, &mut saturations.motor);
        let [turn1, turn2] = links.turn.map(fine);
        let [angle1, angle2] = links.angle;
        let folded = angle2.angle_minus(angle1);
        let cosine = self.quarter.angle_minus(folded).sine();
        let [own1, own2, coupled2, coupled1] = self.inertia;
        let joint2 = turn2.scaled(own2, count2).plus(
            turn1
                .scaled(coupled2, count2)
                .times(cosine, self.cosine[1], count2),
            count2,
        );
        let joint1 = turn1
            .scaled(own1, count1)
            .plus(
                turn2
                    .scaled(coupled1, count1)
                    .times(cosine, self.cosine[0], count1),
                count1,
            )
            .plus(joint2.scaled(self.carried, count1), count1);
        [joint1, joint2]
    }
}

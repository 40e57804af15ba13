//! The plan's torque of joint 1 where its table goes slower than planned: while it stops, stands
//! and goes on.
//!
//! A table's torques are those of full speed. Where it goes on by `r` ticks a tick, the same path
//! is gone with `q' = r q'_d` and `q'' = r^2 q''_d + r' q'_d`: what is at rest stays of a torque,
//! what moves goes with the square, and the change of speed adds an inertia:
//!
//! ```text
//! tau1 = tau_s + r^2 (tau1_d - tau_s) + r' tau_i
//!
//! tau_s = s1 f_d - S1 g sin(gamma - theta10) - S2 g sin(gamma - theta20)
//! tau_i = J1 theta10' + h cos(theta20 - theta10) (theta10' + theta20') + J2 theta20'
//! ```
//!
//! with the weight's direction gamma; `S1 = (m1 / 2 + m2 + mt) r1`, `S2 = (m2 / 2 + mt) r2`; `J1 =
//! m1 r1^2 / 3 + (m2 + mt) r1^2`, `J2 = m2 r2^2 / 3 + mt r2^2` and the inertias of root and tip,
//! `h = S2 r1`. Link 2 counts as straight: its bow is off the chord by little for joint 1.
//!
//! **Joint 2 keeps the table's torque.** Its inertia, `J2 theta20' + h cos(theta20 - theta10)
//! theta10'`, moves the link's tip by bending the link first, which takes a quarter of its contact
//! mode's period: half of a stop. Given at once it throws the tip, and a stop from 3.4 m/s brought
//! the force cell to its end on 51 of 60 arms, on none without it. What it says is how hard a stop
//! is on the link: [`longer`](SlowedPlan::longer).

use crate::control::progress::{FULL, LONGER_MOST};
use crate::model::ArmParameters;
use crate::number::{Scalar, SiScalar, TableScalar};
use crate::signals::{Formats, PoseSetpoint, SaturationCounts};
use crate::table::Links;
use core::f64::consts::FRAC_PI_2;
use serde::{Deserialize, Serialize};

/// What the arm's data give, in the tick's number type.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub(super) struct SlowedPlan<T: Scalar> {
    /// gamma, rad, and a quarter turn.
    weight: T,
    quarter: T,
    /// S1 g and S2 g, of sines torques of joint 1.
    moment: [T::Gain; 2],
    /// Angles of a tick are made fine by this.
    fine: T::Shift,
    /// J1, h and J2: of fine angles of a tick torques of joint 1, when the table's speed changes by
    /// `unit`.
    inertia: [T::Gain; 3],
    /// Product of a cosine and a torque of joint 1.
    cosine: T::Shift,
    /// Joint 2's torque as one of joint 1.
    carried: T::Gain,
    /// Twice a stop's step: no change of the speed is larger.
    unit: u32,
}

impl<T: SiScalar> SlowedPlan<T> {
    /// For `arm` at `tick_rate_hz`, where a stop takes `stop_ticks`.
    pub(super) fn new(
        arm: &ArmParameters,
        (tick_rate_hz, stop_ticks): (u32, u32),
        fine: T::Shift,
        formats: &Formats<T::Format>,
    ) -> Self {
        let [torque1, torque2] = formats.torque;
        let (r1, r2, tip) = (arm.link1_length_m, arm.link2_length_m, arm.tip_mass_kg);
        let (m1, m2) = (arm.link1_mass_kg, arm.link2_mass_kg);
        let [g1, g2] = arm.gravity_m_s2;
        let g = libm::hypot(g1, g2);
        let moments = [(0.5 * m1 + m2 + tip) * r1, (0.5 * m2 + tip) * r2];
        let inertias = [
            (m1 / 3.0 + m2 + tip) * r1 * r1,
            moments[1] * r1,
            (m2 / 3.0 + tip) * r2 * r2 + arm.root_inertia_kgm2 + arm.tip_inertia_kgm2,
        ];
        let unit = 2 * FULL / stop_ticks.clamp(1, FULL);
        let rate = f64::from(tick_rate_hz);
        // Of a speed of a radian a tick, changed in a tick.
        let changed = rate * rate * f64::from(unit) / f64::from(FULL);
        Self {
            weight: T::from_rad(libm::atan2(g2, g1)),
            quarter: T::from_rad(FRAC_PI_2),
            moment: moments.map(|moment| T::gain(moment * g, T::SINE, torque1)),
            fine,
            inertia: inertias.map(|inertia| T::fine_gain(inertia * changed, fine, torque1)),
            cosine: T::shift(T::SINE, torque1, torque1),
            carried: T::gain(1.0, torque2, torque1),
            unit,
        }
    }
}

impl<T: TableScalar> SlowedPlan<T> {
    /// Makes joint 1's planned torque that of a table that goes on by `rate`, which the tick
    /// changes by `change`, in 2^-16 ticks a tick. `pressed` is joint 1's torque of the planned
    /// force, N m.
    pub(super) fn apply(
        &self,
        (rate, change): (u32, i32),
        links: &Links<T>,
        (setpoint, pressed): (&mut PoseSetpoint<T>, T),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        let [angle1, angle2] = links.angle;
        let between = angle2.angle_minus(angle1);
        let [_, slowing] = self.inertia((links.turn, between), saturations);
        let count = &mut saturations.torque[0];
        let mut rest = pressed;
        for (angle, moment) in links.angle.into_iter().zip(self.moment) {
            let held = self.weight.angle_minus(angle).sine().scaled(moment, count);
            rest = rest.minus(held, count);
        }
        let speed = T::fraction(rate, T::reciprocal_of(FULL));
        let planned = setpoint.torque[0].minus(rest, count);
        let moving = planned.times_in_range::<1>(speed);
        let torque = rest.plus(moving.times_in_range::<1>(speed), count);
        let share = change.unsigned_abs().min(self.unit);
        let share = T::fraction(share, T::reciprocal_of(self.unit));
        let slowing = slowing.times_in_range::<1>(share);
        setpoint.torque[0] = if change < 0 {
            torque.minus(slowing, count)
        } else {
            torque.plus(slowing, count)
        };
    }

    /// By how many sixteenths a stop has to be longer for the link's inertia to ask no more of joint
    /// 2 than the planned force does: more throws the tip off the surface, and back onto it.
    /// `pressed` is joint 2's torque of that force, N m; of the links what they turn in a tick at full speed
    /// and the angle between them, rad, which the slope of link 2's root may be in: sixteenths are coarse.
    pub(super) fn longer(&self, links: ([T; 2], T), pressed: T) -> u32 {
        let saturations = &mut SaturationCounts::default();
        let [thrown, _] = self.inertia(links, saturations);
        let count = &mut saturations.torque[0];
        let magnitude = |torque: T| torque.larger(torque.negative());
        // A stop's step is half of what the inertia is for.
        let thrown = magnitude(thrown).half();
        let mut held = magnitude(pressed.scaled(self.carried, count));
        let sixteenth = held.half().half().half().half();
        let mut longer = 0;
        while longer < LONGER_MOST && thrown > held {
            held = held.plus(sixteenth, count);
            longer += 1;
        }
        longer
    }

    /// What a change of the speed by `unit` takes of joint 2, and in all of joint 1, as torques of
    /// joint 1, N m; of the links as for [`longer`](Self::longer).
    fn inertia(
        &self,
        (turn, between): ([T; 2], T),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> [T; 2] {
        let turn = turn.map(|turn| turn.fine(self.fine, &mut saturations.motor));
        let cosine = self.quarter.angle_minus(between).sine();
        let count = &mut saturations.torque[0];
        let [own1, coupled, own2] = self.inertia;
        let [of1, of2] = turn.map(|turn| {
            turn.scaled(coupled, count)
                .times(cosine, self.cosine, count)
        });
        let joint2 = turn[1].scaled(own2, count).plus(of1, count);
        let joint1 = turn[0].scaled(own1, count).plus(of2, count);
        [joint2, joint1.plus(joint2, count)]
    }
}

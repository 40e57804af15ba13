//! Unit tests of a slowed plan's torque: Newton's law for an arm of many small masses.

extern crate std;

use super::progress::FULL;
use super::slowed::SlowedPlan;
use crate::control::RATE_MAX_RAD_S;
use crate::model::ArmParameters;
use crate::number::TableScalar;
use crate::number::fixed::{Exponent, Fixed};
use crate::signals::{Formats, PoseSetpoint, SaturationCounts};
use crate::table::Links;
use proptest::prelude::*;

const RATE_HZ: u32 = 5000;
const STOP_TICKS: u32 = 750;
const PIECES: u32 = 400;

/// An arm with all that it can carry, its weight aslant.
const ARM: ArmParameters = ArmParameters {
    root_inertia_kgm2: 2e-4,
    tip_mass_kg: 0.05,
    tip_inertia_kgm2: 1e-4,
    gravity_m_s2: [3.0, 9.0],
    ..ArmParameters::PAPER
};

/// A path: theta10 and theta20 as parabolas over the seconds of its own time.
#[derive(Clone, Copy, Debug)]
struct Path([[f64; 3]; 2]);

impl Path {
    fn angles(&self, s: f64) -> [f64; 2] {
        self.0.map(|[a, b, c]| a + b * s + c * s * s)
    }

    /// Joint 1's torque, N m, where the path goes on by `rate` with a growth of `growth` (1/s): the
    /// moment of all masses' accelerations less gravity about joint 1, from their places at three
    /// times.
    fn torque1(&self, rate: f64, growth: f64) -> f64 {
        const H: f64 = 1e-4;
        let at = [-H, 0.0, H].map(|t| self.angles(rate * t + 0.5 * growth * t * t));
        let mut torque = 0.0;
        let mut add = |mass: f64, along: [f64; 2]| {
            let place = at.map(|angle| {
                let sums = |f: fn(f64) -> f64| along[0] * f(angle[0]) + along[1] * f(angle[1]);
                [sums(libm::cos), sums(libm::sin)]
            });
            let pull = [0, 1].map(|i| {
                let acceleration = (place[0][i] - 2.0 * place[1][i] + place[2][i]) / (H * H);
                mass * (acceleration - ARM.gravity_m_s2[i])
            });
            torque += place[1][0] * pull[1] - place[1][1] * pull[0];
        };
        let (r1, r2) = (ARM.link1_length_m, ARM.link2_length_m);
        for i in 0..PIECES {
            let share = (f64::from(i) + 0.5) / f64::from(PIECES);
            add(ARM.link1_mass_kg / f64::from(PIECES), [share * r1, 0.0]);
            add(ARM.link2_mass_kg / f64::from(PIECES), [r1, share * r2]);
        }
        add(ARM.tip_mass_kg, [r1, r2]);
        let turned = (at[0][1] - 2.0 * at[1][1] + at[2][1]) / (H * H);
        torque + (ARM.root_inertia_kgm2 + ARM.tip_inertia_kgm2) * turned
    }

    /// What the slowed plan makes of joint 1's torque, N m, with `pressed` of the force in it.
    fn slowed<T: TableScalar>(
        &self,
        formats: &Formats<T::Format>,
        speed: (u32, i32),
        pressed: f64,
    ) -> f64 {
        let fine = T::fine_shift(2.0 * RATE_MAX_RAD_S / f64::from(RATE_HZ));
        let plan = SlowedPlan::<T>::new(&ARM, (RATE_HZ, STOP_TICKS), fine, formats);
        let torque = |nm| T::from_si(nm, formats.torque[0]);
        let links = Links {
            angle: self.angles(0.0).map(T::from_rad),
            turn: self.0.map(|[_, b, _]| T::from_rad(b / f64::from(RATE_HZ))),
            normal: T::ZERO,
        };
        let mut setpoint = PoseSetpoint {
            torque: [torque(self.torque1(1.0, 0.0) + pressed), T::ZERO],
            ..PoseSetpoint::default()
        };
        let counts = &mut SaturationCounts::default();
        plan.apply(speed, &links, (&mut setpoint, torque(pressed)), counts);
        setpoint.torque[0].to_si(formats.torque[0])
    }
}

proptest! {
    #[test]
    fn it_is_newtons_for_the_slower_path(
        angle in proptest::array::uniform2(-3.0..3.0_f64),
        rate in proptest::array::uniform2(-4.0..4.0_f64),
        bend in proptest::array::uniform2(-5.0..5.0_f64),
        share in 0..=FULL,
        change in -170..=170_i32,
        pressed in -2.0..2.0_f64,
    ) {
        let path = Path([0, 1].map(|i| [angle[i], rate[i], bend[i]]));
        let full = f64::from(FULL);
        let growth = f64::from(change) / full * f64::from(RATE_HZ);
        let exact = path.torque1(f64::from(share) / full, growth) + pressed;
        let float = path.slowed::<f64>(&Formats::default(), (share, change), pressed);
        prop_assert!((float - exact).abs() < 1e-3, "{float} for {exact}");
        let formats = Formats {
            torque: [Exponent(8), Exponent(3)],
            ..Formats::default()
        };
        let fixed = path.slowed::<Fixed>(&formats, (share, change), pressed);
        prop_assert!((fixed - exact).abs() < 2e-3, "{fixed} for {exact}");
    }

    #[test]
    fn a_stop_is_longer_until_the_links_inertia_is_held_by_the_force(
        rate in -8.0..8.0_f64,
        pressed in 0.05..2.0_f64,
    ) {
        // Link 1 stands: link 2 alone turns about joint 2.
        let links = Links {
            angle: [0.0, 1.0],
            turn: [0.0, rate / f64::from(RATE_HZ)],
            normal: 0.0,
        };
        let plan = SlowedPlan::<f64>::new(&ARM, (RATE_HZ, STOP_TICKS), (), &Formats::default());
        let between = links.angle[1] - links.angle[0];
        let longer = plan.longer((links.turn, between), pressed);
        let (m2, r2) = (ARM.link2_mass_kg, ARM.link2_length_m);
        let inertia = (m2 / 3.0 + ARM.tip_mass_kg) * r2 * r2
            + ARM.root_inertia_kgm2
            + ARM.tip_inertia_kgm2;
        let step = f64::from(2 * FULL / STOP_TICKS) / 2.0 / f64::from(FULL);
        let thrown = inertia * rate.abs() * step * f64::from(RATE_HZ);
        let wanted = (16.0 * (thrown / pressed - 1.0)).max(0.0).ceil().min(16.0);
        prop_assert!((f64::from(longer) - wanted).abs() < 1e-9 || wanted > 15.999, "{longer} for {wanted}");
        prop_assert!(longer <= 16);
    }
}

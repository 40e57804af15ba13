//! What tip and surface do to each other: a one-sided spring and damper, and friction.
//!
//! With `p` the depth that the tip is in the surface (m) and `p'` its rate,
//!
//! ```text
//! f   = max(0, kc p + cc p')   where p > 0, else 0       never pulls
//! f_t = friction of a bristle with the level mu f         ([`crate::plant::bench::bristle`])
//! ```
//!
//! (Kelvin and Voigt's contact, cut off where it would pull.) On the tip act `-f` along the
//! normal into the surface and `-f_t` along the direction of sliding.
//!
//! **Energy.** With `W = kc p^2 / 2`, `f p' - W'` is `cc p'^2` where the contact presses and
//! `-kc p p' > 0` where it is cut off: never negative. The bristle's is in its own file.
//!
//! **Order.** `f` jumps by `cc p'` where the tip comes down and has a kink where it leaves. A step
//! with such an event in it is of order 1, its error at most `h cc p' / m` of speed for a step `h`
//! and the mass `m` that the tip presents; the steps between events have the integrator's order.

use crate::plant::bench::bristle::Bristle;
use crate::plant::bench::lanes::Lanes;

/// Stiffness, damping and friction between tip and surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactParameters {
    /// Stiffness kc, N/m, positive.
    pub stiffness_n_m: f64,
    /// Damping cc, N s/m, not negative.
    pub damping_ns_m: f64,
    /// Friction coefficient mu when sliding fast; 0 for none.
    pub friction: f64,
    /// Friction coefficient at breakaway; no less than `friction`.
    pub friction_at_rest: f64,
    /// Sliding speed at which half the difference of the two is gone, m/s, positive.
    pub stribeck_speed_m_s: f64,
    /// Stiffness of the bristle along the surface, N/m, positive: where friction can give `F`,
    /// the tip slides after a few times `F` over this.
    pub bristle_stiffness_n_m: f64,
}

impl Default for ContactParameters {
    /// A hard surface without friction; with 0.3 and 2 N the bristle would give by 0.15 mm.
    fn default() -> Self {
        Self {
            stiffness_n_m: 2e4,
            damping_ns_m: 5.0,
            friction: 0.0,
            friction_at_rest: 0.0,
            stribeck_speed_m_s: 0.01,
            bristle_stiffness_n_m: 4e3,
        }
    }
}

/// How fast a bristle that touches nothing comes back, 1/s.
const RELIEF: f64 = 50.0;

/// The contact's constants, in lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact<T> {
    stiffness: T,
    damping: T,
    friction: T,
    bristle: Bristle<T>,
}

/// Forces of the contact, and the rate of its bristle.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactForce<T> {
    /// Along the normal, pressing positive, N.
    pub(super) normal: T,
    /// Along the direction of sliding, positive against it, N.
    pub(super) tangential: T,
    /// x' of the bristle, m/s.
    pub(super) bristle_rate: T,
}

impl<T: Lanes> Contact<T> {
    /// One contact a lane.
    pub(super) fn new<'a>(parameters: impl Fn(usize) -> &'a ContactParameters) -> Self {
        let lanes = |value: fn(&ContactParameters) -> f64| T::from_lanes(|i| value(parameters(i)));
        Self {
            stiffness: lanes(|c| c.stiffness_n_m),
            damping: lanes(|c| c.damping_ns_m),
            friction: lanes(|c| c.friction),
            bristle: Bristle {
                stiffness: lanes(|c| c.bristle_stiffness_n_m),
                excess: lanes(|c| excess(c.friction, c.friction_at_rest)),
                slowness: lanes(|c| 1.0 / c.stribeck_speed_m_s),
            },
        }
    }

    /// The forces at a depth (m) and its rate (m/s), a speed of sliding (m/s) and a deflection of
    /// the bristle (m).
    #[inline]
    pub(super) fn force(&self, depth: T, rate: T, sliding: T, bristle: T) -> ContactForce<T> {
        let normal = pressing(depth, rate, self.stiffness, self.damping);
        let touching = T::ZERO.below(normal);
        let (tangential, bristle_rate) =
            self.bristle
                .friction(bristle, sliding, self.friction * normal);
        ContactForce {
            normal,
            tangential,
            bristle_rate: T::select(touching, bristle_rate, -(T::from_f64(RELIEF) * bristle)),
        }
    }
}

/// Breakaway over sliding friction, less 1; 0 where there is no friction or the breakaway is the
/// smaller one.
pub(super) fn excess(sliding: f64, at_rest: f64) -> f64 {
    if sliding > 0.0 && at_rest > sliding {
        at_rest / sliding - 1.0
    } else {
        0.0
    }
}

/// Force of a one-sided spring and damper: `max(0, stiffness depth + damping rate)` where the
/// depth is positive, 0 elsewhere.
#[inline]
pub(super) fn pressing<T: Lanes>(depth: T, rate: T, stiffness: T, damping: T) -> T {
    let force = (stiffness * depth + damping * rate).larger(T::ZERO);
    T::select(T::ZERO.below(depth), force, T::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::bench::runge_kutta::RungeKutta;
    use proptest::prelude::*;

    /// A point mass above and on a level surface, y down: [x, y, x', y', bristle].
    fn fall(
        contact: &Contact<f64>,
        mass: f64,
        gravity: [f64; 2],
        state: &mut [f64; 5],
        h: f64,
        steps: u32,
        mut observe: impl FnMut(&[f64; 5], f64),
    ) {
        let mut method = RungeKutta::new(5);
        for _ in 0..steps {
            method.step(state, h, |_, s, slope| {
                let f = contact.force(s[1], s[3], s[2], s[4]);
                slope[0] = s[2];
                slope[1] = s[3];
                slope[2] = gravity[0] - f.tangential / mass;
                slope[3] = gravity[1] - f.normal / mass;
                slope[4] = f.bristle_rate;
            });
            let f = contact.force(state[1], state[3], state[2], state[4]);
            observe(state, f.normal);
        }
    }

    fn contact(parameters: &ContactParameters) -> Contact<f64> {
        Contact::new(|_| parameters)
    }

    /// A mass that bounces off a spring and damper that does not pull, without gravity: the time
    /// t until the force is 0 again, times omega,
    /// `tan(omega_d t) = 2 zeta sqrt(1 - zeta^2) / (2 zeta^2 - 1)`; the speed ratio
    /// `exp(-zeta omega t)` (Schwager and Poeschel 2007); and the largest depth, times omega over
    /// the speed, at `tan(omega_d t) = sqrt(1 - zeta^2) / zeta`.
    fn bounce(zeta: f64) -> [f64; 3] {
        let root = (1.0 - zeta * zeta).sqrt();
        let time = Real::atan2(2.0 * zeta * root, 2.0 * zeta * zeta - 1.0) / root;
        let deepest = (-zeta * Real::atan2(root, zeta) / root).exp();
        [time, (-zeta * time).exp(), deepest]
    }

    use flexor::number::Real;

    #[test]
    fn a_bounce_loses_what_the_closed_form_says() {
        for (stiffness, damping) in [(2e4, 5.0), (1e5, 5.0), (1e3, 0.5), (2e4, 0.0)] {
            let parameters = ContactParameters {
                stiffness_n_m: stiffness,
                damping_ns_m: damping,
                ..ContactParameters::default()
            };
            let mass = 0.01;
            let omega = (stiffness / mass).sqrt();
            let zeta = damping / (2.0 * (stiffness * mass).sqrt());
            // Time in contact, speed ratio and largest depth, made free of dimension as above.
            let after = |h_omega: f64| {
                let mut state = [0.0, -1e-5, 0.0, 0.3, 0.0];
                let h = h_omega / omega;
                let steps = (5.0 / h_omega) as u32;
                let (mut pressed, mut deepest) = (0.0, 0.0_f64);
                fall(
                    &contact(&parameters),
                    mass,
                    [0.0; 2],
                    &mut state,
                    h,
                    steps,
                    |s, f| {
                        assert!(f >= 0.0);
                        deepest = deepest.max(s[1]);
                        pressed += if f > 0.0 { h_omega } else { 0.0 };
                    },
                );
                [pressed, -state[3] / 0.3, deepest * omega / 0.3]
            };
            let exact = bounce(zeta);
            // Order 1 at the touch-down: the bound stated above. The time is counted in steps, and
            // the depth falls between them.
            for h_omega in [0.2, 0.05, 0.0125] {
                let found = after(h_omega);
                let bound = 2.0 * zeta * h_omega + 1e-3 * h_omega;
                let bounds = [2.0 * h_omega, bound, bound + h_omega * h_omega];
                for ((found, exact), bound) in found.iter().zip(exact).zip(bounds) {
                    assert!(
                        (found - exact).abs() < bound,
                        "{stiffness} {damping} {h_omega}: {found} {exact}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_mass_on_a_tilt_below_the_friction_sticks_and_above_it_slides() {
        let parameters = ContactParameters {
            friction: 0.3,
            friction_at_rest: 0.3,
            damping_ns_m: 20.0,
            ..ContactParameters::default()
        };
        let mass = 0.2;
        for (slope, sticks) in [(0.2, true), (0.29, true), (0.31, false), (0.5, false)] {
            // The frame is the tilted surface's; gravity leans.
            let level = 9.81 / (1.0_f64 + slope * slope).sqrt();
            let gravity = [level * slope, level];
            let sink = mass * level / parameters.stiffness_n_m;
            let mut state = [0.0, sink, 0.0, 0.0, 0.0];
            let mut speed_before = 0.0;
            let mut acceleration = 0.0;
            fall(
                &contact(&parameters),
                mass,
                gravity,
                &mut state,
                5e-5,
                40_000,
                |s, _| {
                    acceleration = (s[2] - speed_before) / 5e-5;
                    speed_before = s[2];
                },
            );
            if sticks {
                // It rings on the bristle, which holds it within its own deflection for ever.
                let bristle = 0.3 * mass * level / parameters.bristle_stiffness_n_m;
                assert!(state[0].abs() < 20.0 * bristle, "{slope}: {}", state[0]);
                assert!(state[2].abs() < 0.02, "{slope}: {}", state[2]);
            } else {
                let exact = level * (slope - 0.3);
                assert!((acceleration - exact).abs() < 1e-3 * level, "{slope}");
            }
        }
    }

    #[test]
    fn a_spring_drags_a_mass_in_stick_and_slip_with_the_closed_forms_period() {
        // A spring's end moves at a speed v; the mass holds until the spring pulls with
        // F_s = mu_s f, and slips against F_k = mu_k f. With D = F_s - F_k it sticks for
        // 2 D / (k v) and slips for 2 (pi - atan(D / (v sqrt(k m)))) / omega: half an oscillation
        // about F_k, and the arcs to the drag's own speed. The spring's force swings by
        // sqrt(D^2 + v^2 k m) to either side of F_k. A Stribeck curve of no width, that is;
        // the real one takes a few milliseconds to fall: 3 %.
        let parameters = ContactParameters {
            friction: 0.2,
            friction_at_rest: 0.4,
            damping_ns_m: 20.0,
            stribeck_speed_m_s: 2e-3,
            bristle_stiffness_n_m: 4e5,
            ..ContactParameters::default()
        };
        let contact = contact(&parameters);
        let (mass, pull, weight): (f64, f64, f64) = (0.2, 100.0, 2.0);
        for speed in [0.01, 0.03] {
            let drop = 0.2 * weight;
            let impedance = (pull * mass).sqrt();
            let stick = 2.0 * drop / (pull * speed);
            let arc = Real::atan2(drop, speed * impedance);
            let slip = 2.0 * (core::f64::consts::PI - arc) * impedance / pull;
            let swing = drop.hypot(speed * impedance);

            let mut state = [0.0, weight / parameters.stiffness_n_m, 0.0, 0.0, 0.0];
            let (h, mut time) = (5e-5, 0.0);
            let (mut breaks, mut slipping) = (vec![], false);
            let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
            let mut method = RungeKutta::new(5);
            while breaks.len() < 5 {
                method.step(&mut state, h, |share, s, slope| {
                    let f = contact.force(s[1], s[3], s[2], s[4]);
                    let drag = pull * (speed * (time + share * h) - s[0]);
                    slope[0] = s[2];
                    slope[1] = s[3];
                    slope[2] = (drag - f.tangential) / mass;
                    slope[3] = (weight - f.normal) / mass;
                    slope[4] = f.bristle_rate;
                });
                time += h;
                let drag = pull * (speed * time - state[0]);
                (least, most) = (least.min(drag), most.max(drag));
                if !slipping && state[2] > speed {
                    slipping = true;
                    breaks.push(time);
                } else if slipping && state[2] < 0.1 * speed {
                    slipping = false;
                }
                assert!(time < 10.0, "it does not slip: {breaks:?}");
            }
            // The first from rest: F_s / (k v), and until the mass is as fast as the drag.
            let lag = Real::atan2(speed * impedance, drop) * impedance / pull;
            let first = 0.4 * weight / (pull * speed) + lag;
            assert!((breaks[0] / first - 1.0).abs() < 0.03, "{breaks:?} {first}");
            for force in [most - 0.2 * weight, 0.2 * weight - least] {
                assert!((force / swing - 1.0).abs() < 0.05, "{force} {swing}");
            }
            for pair in breaks.windows(2) {
                let period = pair[1] - pair[0];
                let exact = stick + slip;
                assert!((period / exact - 1.0).abs() < 0.03, "{period} {exact}");
            }
        }
    }

    proptest! {
        /// Whatever a mass does on the surface, its energy with contact's and bristle's never
        /// grows by more than the step's error.
        #[test]
        fn contact_and_friction_never_make_energy(
            stiffness in 1e3..1e5_f64, damping in 0.0..20.0_f64, friction in 0.0..1.0_f64,
            extra in 0.0..0.5_f64, down in -0.5..0.5_f64, along in -0.5..0.5_f64,
        ) {
            let parameters = ContactParameters {
                stiffness_n_m: stiffness,
                damping_ns_m: damping,
                friction,
                friction_at_rest: friction + extra,
                ..ContactParameters::default()
            };
            let mass = 0.05;
            let energy = |s: &[f64; 5], normal: f64| {
                let depth = s[1].max(0.0);
                let touching = if normal > 0.0 { s[4] } else { 0.0 };
                0.5 * mass * (s[2] * s[2] + s[3] * s[3]) - mass * 9.81 * s[1]
                    + 0.5 * stiffness * depth * depth
                    + 0.5 * parameters.bristle_stiffness_n_m * touching * touching
            };
            let mut state = [0.0, -1e-3, along, down, 0.0];
            let first = energy(&state, 0.0);
            let mut largest = f64::NEG_INFINITY;
            fall(&contact(&parameters), mass, [0.0, 9.81], &mut state, 5e-6, 20_000, |s, f| {
                largest = largest.max(energy(s, f));
            });
            prop_assert!(largest <= first + 1e-4 * first.abs() + 1e-7, "{largest} {first}");
        }
    }
}

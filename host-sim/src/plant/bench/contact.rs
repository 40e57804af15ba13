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

    /// Speed ratio of a mass that bounces off a spring and damper that does not pull, without
    /// gravity: `exp(-zeta omega t)` with t the time at which the force is 0 again,
    /// `tan(omega_d t) = 2 zeta sqrt(1 - zeta^2) / (2 zeta^2 - 1)` (Schwager and Poeschel 2007).
    fn restitution(zeta: f64) -> f64 {
        let root = (1.0 - zeta * zeta).sqrt();
        let time = Real::atan2(2.0 * zeta * root, 2.0 * zeta * zeta - 1.0) / root;
        (-zeta * time).exp()
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
            let after = |h_omega: f64| {
                let mut state = [0.0, -1e-5, 0.0, 0.3, 0.0];
                let h = h_omega / omega;
                let steps = (5.0 / h_omega) as u32;
                fall(
                    &contact(&parameters),
                    mass,
                    [0.0; 2],
                    &mut state,
                    h,
                    steps,
                    |_, f| assert!(f >= 0.0),
                );
                -state[3] / 0.3
            };
            let exact = restitution(zeta);
            // Order 1 at the touch-down: the bound stated above.
            for h_omega in [0.2, 0.05, 0.0125] {
                let found = after(h_omega);
                let bound = 2.0 * zeta * h_omega + 1e-3 * h_omega;
                assert!(
                    (found - exact).abs() < bound,
                    "{stiffness} {damping}: {found} {exact}"
                );
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
    fn a_spring_drags_a_mass_in_stick_and_slip_with_the_closed_forms_breakaway() {
        // A slow end of a spring pulls; the mass breaks away at mu_s f and then jumps.
        let parameters = ContactParameters {
            friction: 0.2,
            friction_at_rest: 0.4,
            damping_ns_m: 20.0,
            stribeck_speed_m_s: 1e-3,
            bristle_stiffness_n_m: 4e4,
            ..ContactParameters::default()
        };
        let contact = contact(&parameters);
        let (mass, pull, speed, weight) = (0.2, 100.0, 0.01, 2.0);
        let mut state = [0.0, weight / parameters.stiffness_n_m, 0.0, 0.0, 0.0];
        let (mut time, mut first, mut stops, mut slipping) = (0.0, None, 0, false);
        let h = 5e-5;
        let mut method = RungeKutta::new(5);
        while time < 1.5 {
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
            if !slipping && state[2] > 0.05 {
                slipping = true;
                first.get_or_insert(time);
            } else if slipping && state[2] < 1e-3 {
                slipping = false;
                stops += 1;
            }
        }
        // Pulled by mu_s f at t = mu_s f / (pull speed) = 0.8 s.
        let broke = first.unwrap();
        assert!((0.78..0.86).contains(&broke), "{broke}");
        // Undamped, the mass jumps on by twice (mu_s - mu_k) f / pull and sticks again.
        assert!(stops >= 1);
        let jumped = state[0];
        let exact = 2.0 * 0.2 * weight / pull;
        assert!((jumped - exact).abs() < 0.15 * exact, "{jumped} {exact}");
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

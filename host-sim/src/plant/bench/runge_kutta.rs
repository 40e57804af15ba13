//! One step of the classical Runge-Kutta method of order 4, in lanes.
//!
//! Why this one and not the order 8 of [`crate::plant::integrator`]: the simulated bench has
//! events (the tip touches, a bristle slides), and a step with an event in it is of order 1 or 2
//! whatever the method; and of the explicit methods this one has the largest stable step a
//! stage, 2.83 / 4 on the imaginary axis where the beam's modes are, against 5.9 / 12.

use crate::plant::bench::lanes::Lanes;

/// Largest product of step and largest eigenvalue that the plants choose. Stability ends at 2.8;
/// the rest is for eigenvalues that grow along the way.
pub const STEP_TIMES_EIGENVALUE: f64 = 1.6;

/// When the four stages are taken, as shares of the step.
pub(super) const STAGE_TIME: [f64; 4] = [0.0, 0.5, 0.5, 1.0];

/// Working memory of the method.
#[derive(Clone, Debug)]
pub(super) struct RungeKutta<T> {
    slope: Vec<T>,
    sum: Vec<T>,
    trial: Vec<T>,
}

impl<T: Lanes> RungeKutta<T> {
    /// For states of `size` numbers.
    pub(super) fn new(size: usize) -> Self {
        Self {
            slope: vec![T::ZERO; size],
            sum: vec![T::ZERO; size],
            trial: vec![T::ZERO; size],
        }
    }

    /// Takes `state` a step of `h` on. `derivative(share, state, slope)` writes the time
    /// derivative of a state, at a share 0 to 1 of the step, to `slope`.
    ///
    /// # Panics
    /// If `state` has not the size given to [`new`](Self::new).
    #[inline]
    pub(super) fn step(
        &mut self,
        state: &mut [T],
        h: f64,
        mut derivative: impl FnMut(f64, &[T], &mut [T]),
    ) {
        let Self { slope, sum, trial } = self;
        let size = slope.len();
        assert_eq!(state.len(), size, "length of the state");
        let (sum, trial) = (&mut sum[..size], &mut trial[..size]);
        let [half, whole, sixth, third] = [0.5 * h, h, h / 6.0, h / 3.0].map(T::from_f64);

        derivative(STAGE_TIME[0], state, slope);
        for i in 0..size {
            sum[i] = state[i] + sixth * slope[i];
            trial[i] = state[i] + half * slope[i];
        }
        derivative(STAGE_TIME[1], trial, slope);
        for i in 0..size {
            sum[i] += third * slope[i];
            trial[i] = state[i] + half * slope[i];
        }
        derivative(STAGE_TIME[2], trial, slope);
        for i in 0..size {
            sum[i] += third * slope[i];
            trial[i] = state[i] + whole * slope[i];
        }
        derivative(STAGE_TIME[3], trial, slope);
        for i in 0..size {
            state[i] = sum[i] + sixth * slope[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error after 2 s of x' = x cos(t), x(0) = 1, whose solution is exp(sin t).
    fn error(steps: u32) -> f64 {
        let h = 2.0 / f64::from(steps);
        let mut method = RungeKutta::new(1);
        let mut x = [1.0];
        for i in 0..steps {
            let t = f64::from(i) * h;
            method.step(&mut x, h, |share, x, slope| {
                slope[0] = x[0] * (t + share * h).cos();
            });
        }
        (x[0] - 2.0_f64.sin().exp()).abs()
    }

    #[test]
    fn the_order_is_4() {
        let order = (error(64) / error(128)).log2();
        assert!((order - 4.0).abs() < 0.1, "{order}");
    }

    #[test]
    fn oscillations_and_decays_stay_bounded_with_margin_to_the_chosen_step() {
        let after = |real: f64, imaginary: f64| {
            let mut method = RungeKutta::new(2);
            let mut x = [1.0, 0.0];
            for _ in 0..10_000 {
                method.step(&mut x, 1.0, |_, x, slope| {
                    slope[0] = real * x[0] + imaginary * x[1];
                    slope[1] = real * x[1] - imaginary * x[0];
                });
            }
            x[0].hypot(x[1])
        };
        for (real, imaginary) in [(0.0, 2.8), (-2.7, 0.0), (-1.5, 1.5)] {
            assert!(after(real, imaginary) <= 1.0);
        }
        assert!(!(after(0.0, 2.9) <= 1e3) && !(after(-2.9, 0.0) <= 1e3));
    }
}

//! The first torques of an enabled arm: raised from nothing while brakes hold it.
//!
//! The first tick of a table wants a whole row of torques at once, 11 N m of the example's, and
//! drives may take some periods to give any: a step, or an arm that falls meanwhile. So the
//! controller runs its first tick with the brakes closed; what that wants is then raised in a straight
//! line, and only with the whole of it do the brakes open and the controller goes on.

/// How far the first torques have been raised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SoftStart {
    /// Ticks that have passed.
    done: u32,
    /// Ticks that it takes, at least one.
    ticks: u32,
}

impl SoftStart {
    /// Of so many ticks, with the whole torque in the last of them; 0 and 1 are none, with the whole
    /// torque in the first.
    pub(super) fn new(ticks: u32) -> Self {
        Self {
            done: 0,
            ticks: ticks.max(1),
        }
    }

    /// Whether the controller's first tick is still to come.
    pub(super) fn is_new(&self) -> bool {
        self.done == 0
    }

    /// Whether brakes are open and the controller goes on.
    #[inline]
    pub(super) fn is_over(&self) -> bool {
        self.done == self.ticks
    }

    /// Goes on by a tick: the share of these torques, N m, to command in it.
    pub(super) fn advance(&mut self, torque: [f32; 2]) -> [f32; 2] {
        if self.done < self.ticks {
            self.done += 1;
        }
        if self.is_over() {
            return torque;
        }
        let share = self.done as f32 / self.ticks as f32;
        torque.map(|torque| torque * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever the torques and the time are, no step is larger than the ramp's, and the last is
        /// what was wanted, bit for bit.
        #[test]
        fn no_step_is_larger_than_the_ramps(
            ticks in 0..2000_u32,
            torque in prop::array::uniform2(-1e3..1e3_f32),
        ) {
            let mut start = SoftStart::new(ticks);
            let all = ticks.max(1);
            let mut before = [0.0; 2];
            for tick in 1..=all {
                prop_assert!(!start.is_over());
                prop_assert_eq!(start.is_new(), tick == 1);
                let given = start.advance(torque);
                for joint in 0..2 {
                    let step = (given[joint] - before[joint]).abs();
                    let most = torque[joint].abs() / all as f32;
                    prop_assert!(step <= most + 4.0 * f32::EPSILON * torque[joint].abs());
                }
                before = given;
            }
            prop_assert!(start.is_over());
            prop_assert_eq!(before, torque);
            prop_assert_eq!(start.advance(torque), torque, "and it stays over");
        }
    }
}

//! How far a table goes on in a tick: at full speed, to a stop and on again.
//!
//! Speeds are in 2^-16 ticks a tick; fractions of a tick are added up as integers, so that nothing
//! drifts. A stop of `stop_s` takes as much from the speed in each of its ticks. A link that the
//! path moves fast would be thrown by that: the stop is then longer by some sixteenths, and begins
//! and ends with ramps in which that step grows and shrinks, each twice as long as what was added,
//! or half the stop. Going on again is the same the other way round.
//!
//! **A change takes two ticks to begin.** Other things happen in the tick that wants it, the law's
//! gains change for one, and how long it is to take is asked in the next one; the speed changes from
//! the one after that. All in one tick it was by far the longest of the default table: 838
//! instructions on a Cortex-M4F, for 681 at most now.

/// A table's speed of one tick a tick.
pub(super) const FULL: u32 = 1 << 16;

/// By how many sixteenths a stop may be longer: twice as long.
pub(super) const LONGER_MOST: u32 = 16;

/// What the table's speed changes by in a tick, and in how many ticks it grows to that.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Change {
    /// In 2^-16 ticks a tick, at least 1.
    step: u32,
    /// None where there is no ramp.
    ramp: u32,
}

impl Change {
    /// A stop of `ticks`, longer by these sixteenths.
    fn new(ticks: u32, longer: u32) -> Self {
        let ticks = ticks.clamp(1, FULL);
        let added = ticks * longer.min(LONGER_MOST) / 16;
        let ramp = (2 * added).min((ticks + added) / 2);
        Self {
            step: FULL / (ticks + added - ramp),
            ramp,
        }
    }
}

/// How fast the table goes on, and where between two ticks it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Progress {
    /// Speed, in 2^-16 ticks a tick.
    pub(super) rate: u32,
    /// Part of a tick gone beyond the cursor's, in 2^-16.
    pub(super) part: u32,
    /// What the last tick has added to the speed.
    pub(super) change: i32,
    /// How the speed changes, and whether to full speed or to none.
    by: Change,
    up: bool,
    /// Whether the last tick wanted it the other way round.
    turns: bool,
    /// Ticks of the ramp that the speed's change is on.
    pull: u32,
}

impl Progress {
    /// At rest.
    pub(super) const REST: Self = Self {
        rate: 0,
        part: 0,
        change: 0,
        by: Change { step: 1, ramp: 0 },
        up: false,
        turns: false,
        pull: 0,
    };

    /// At full speed from rest: a table begins at rest by itself.
    pub(super) fn begin(&mut self) {
        *self = Self {
            rate: FULL,
            up: true,
            ..Self::REST
        };
    }

    /// Whether the table goes on by a tick a tick.
    pub(super) fn is_full(&self) -> bool {
        self.rate == FULL
    }

    /// Whether it does, and stands at whole ticks.
    pub(super) fn is_plain(&self) -> bool {
        self.is_full() && self.part == 0
    }

    /// One tick towards full speed, or to rest; whether the table goes on by a tick. A stop takes
    /// `stop_ticks`, and `longer` says by how many sixteenths more, in the tick before it begins.
    pub(super) fn tick(&mut self, up: bool, stop_ticks: u32, longer: impl FnOnce() -> u32) -> bool {
        let before = self.rate;
        let other = up != self.up;
        if other {
            if self.turns {
                self.up = up;
                self.pull = 0;
                self.by = Change::new(stop_ticks, longer());
            }
            self.part += self.rate;
        } else if up {
            self.rate += self.step(FULL - self.rate);
            if self.is_full() {
                // A part that is left is waited for, with a speed that no damper feels.
                self.part -= self.part.min(FULL / 256);
            }
            self.part += self.rate;
        } else {
            self.rate -= self.step(self.rate);
            self.part += self.rate;
        }
        self.turns = other && !self.turns;
        self.change = self.rate.cast_signed() - before.cast_signed();
        let goes = self.part >= FULL;
        if goes {
            self.part -= FULL;
        }
        goes
    }

    /// What the speed changes by in this tick, where so much is left of the change.
    fn step(&mut self, left: u32) -> u32 {
        let Change { step, ramp } = self.by;
        if ramp == 0 {
            return left.min(step);
        }
        // Whether so much is left that the step can yet shrink from there to nothing.
        let [step, all] = [step, ramp].map(u64::from);
        let enough = |pull: u32| {
            let pull = u64::from(pull);
            2 * all * u64::from(left) >= step * pull * (pull + 1)
        };
        let next = (self.pull + 1).min(ramp);
        if enough(next) {
            self.pull = next;
        } else if !enough(self.pull) {
            self.pull = (self.pull - 1).max(1);
        }
        let now = step * u64::from(self.pull) / all;
        left.min((now as u32).max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_stop_takes_its_time_and_its_way_and_no_jerk(
            ticks in 64..4000_u32,
            longer in 0..=LONGER_MOST,
        ) {
            let mut progress = Progress::REST;
            progress.begin();
            // Asked for in one tick, begun in the next but one.
            for _ in 0..2 {
                prop_assert!(progress.tick(false, ticks, || longer) && progress.is_plain());
            }
            let (mut taken, mut way, mut steepest, mut jerk) = (0_u32, 0_u64, 0, 0);
            while progress.rate > 0 {
                let before = progress;
                let goes = progress.tick(false, ticks, || longer);
                prop_assert!(progress.rate < before.rate);
                let gone = progress.part + if goes { FULL } else { 0 } - before.part;
                prop_assert_eq!(gone, progress.rate);
                steepest = steepest.max(progress.change.unsigned_abs());
                jerk = jerk.max(progress.change.abs_diff(before.change));
                way += u64::from(gone);
                taken += 1;
            }
            let wanted = f64::from(ticks) * (1.0 + f64::from(longer) / 16.0);
            let near = |value: f64, wanted: f64| (value / wanted - 1.0).abs() < 0.1;
            prop_assert!(near(f64::from(taken), wanted), "{taken} of {wanted}");
            let way = way as f64 / f64::from(FULL);
            prop_assert!(near(way, wanted / 2.0), "{way} of {wanted} / 2");
            prop_assert!(steepest <= 2 * FULL / ticks, "{steepest}");
            if longer >= 8 {
                // Half of it grows, half of it shrinks.
                let most = 4 * FULL / ticks / ticks + 3;
                prop_assert!(jerk <= most, "{jerk} > {most}");
            }
        }

        #[test]
        fn it_goes_on_again_from_wherever_it_stopped(
            ticks in 64..4000_u32,
            longer in 0..=LONGER_MOST,
            stopped in 1..4000_u32,
        ) {
            let mut progress = Progress::REST;
            progress.begin();
            for _ in 0..stopped {
                progress.tick(false, ticks, || longer);
            }
            let mut taken = 0;
            while !progress.is_plain() {
                let before = progress.rate;
                progress.tick(true, ticks, || longer);
                prop_assert!(progress.rate > before || before == FULL || taken < 2);
                taken += 1;
                prop_assert!(taken < 3 * ticks + 300);
            }
        }
    }
}

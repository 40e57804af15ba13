//! How far a table goes on in a tick: at full speed, to a stop and on again.
//!
//! Speeds are in 2^-16 ticks a tick; fractions of a tick are added up as integers, so that nothing
//! drifts. A stop of `stop_s` takes as much from the speed in each of its ticks. A link that the
//! path moves fast would be thrown by that: the stop is then longer by some sixteenths, and begins
//! and ends with ramps in which that step grows and shrinks, each twice as long as what was added,
//! or half the stop. Going on again is the same the other way round.

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
    /// `stop_ticks`, and `longer` says by how many sixteenths more, where it begins.
    pub(super) fn tick(&mut self, up: bool, stop_ticks: u32, longer: impl FnOnce() -> u32) -> bool {
        if up != self.up {
            self.up = up;
            self.pull = 0;
            self.by = Change::new(stop_ticks, longer());
        }
        let before = self.rate;
        if up {
            self.rate += self.step(FULL - self.rate);
            // A part that is left at full speed is caught up a sixteenth of a tick at a time.
            let gap = (FULL - self.part) % FULL;
            self.part += self.rate;
            if self.rate == FULL {
                self.part += gap.min(FULL / 16);
            }
        } else {
            self.rate -= self.step(self.rate);
            self.part += self.rate;
        }
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
        // What the speed still changes by while the step shrinks from here to nothing.
        let [pull, all] = [self.pull, ramp].map(u64::from);
        let shrinking = u64::from(step) * pull * (pull + 1) / (2 * all);
        self.pull = if u64::from(left) > shrinking {
            (self.pull + 1).min(ramp)
        } else {
            self.pull.saturating_sub(1).max(1)
        };
        let now = u64::from(step) * u64::from(self.pull) / all;
        left.min((now as u32).max(1))
    }
}

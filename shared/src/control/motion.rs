//! The motion of a run: from where the tip stands, onto the surface, along it, and off again.
//!
//! The law knows one set of numbers for the tip on the surface and one for the tip in the air; the
//! motion says which one acts, what force is wanted, where joint 2 is to stand and how fast the
//! table goes on. It changes what the law reads, never what it gives, so that no limit is passed by.
//!
//! ```text
//!              first tick: no force                    first tick: f > f_on
//!                      |                                        |
//!                      v          f > f_on, 1 ms                v
//!                 +----------+ ----------------------> +-----------------+
//!            +--> | Approach |                         |     Contact     | <-+
//!            |    +----------+ <-----------------+     +-----------------+   |
//!            |         | no contact after        |       |    |     |  force |
//!  not yet   |         | approach_limit_m   f < f_off    |    |     |  reached, settled
//!  followed  |         v                         |       |    |     v        |
//!            |    +---------+     stop(fault)    |       |    |  +--------+  |
//!            |    | Retract | <---- any state    |       |    |  | Follow |  | f > f_on, 1 ms
//!            |    +---------+ <------------------+-------+----+- +--------+  |
//!            |     |     ^      table's end      v     force not   |         |
//!            |     v     |     t_lost, or   +--------+ reached     | f < f_off
//!            |   +------+|     lost too     |  Lost  | <-----------+         |
//!            |   | Hold |+---- often ------ +--------+ ----------------------+
//!            |   +------+                     |
//!            +--------------------------------+
//! ```
//!
//! | state | law | what it does |
//! |---|---|---|
//! | approach | air | the table's first tick; joint 2 turns towards the surface at a speed of the tip |
//! | contact | contact | the wanted force rises to the plan's; then the law settles |
//! | follow | contact | the table goes on by a tick a tick |
//! | lost | air | stands where contact was lost, still asked to press; the table goes on if it did |
//! | retract | air | the table comes to a stop, the force is taken away, the tip lifted off |
//! | hold, park | air | stands |
//!
//! **Tables without contact**, whose force is 0 throughout, are followed on the law of the air,
//! in the state *free*, and held at their end, in the state *park*.
//!
//! **One table after the other.** An arm that stands, in *hold* or *park*, may go over to another
//! table ([`Motion::go_on_from`]) without a step in a torque.
//!
//! **Bumpless.** No change of state is a step in a torque: what stiffness and section give is taken
//! over by the force integral ([`HybridLaw::change`]), joint 2's angle is counted from where it
//! stands (`offset`), and joint 1's share of the force follows it through a low-pass (`share`).
//!
//! **Progress.** The table goes on by fractions of a tick ([`Progress`]). A stop takes `stop_s`.

use crate::control::filter::low_pass;
use crate::control::handover::Handover;
use crate::control::hybrid::{HybridLaw, HybridState};
use crate::control::motion_forces::{Forces, towards};
use crate::control::motion_parameters::{LIFT_MOST, LOSSES, PRESSING_STEPS};
use crate::control::progress::Progress;
use crate::fault::{Fault, Reaction};
use crate::number::{Scalar, TableScalar};
use crate::phase::Phase;
use crate::signals::{Measurement, PoseSetpoint, SaturationCounts};
use crate::table::Cursor;

/// A motion's state, with what only it needs. Numbers are ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State<T> {
    /// Before the first tick.
    Start,
    Free,
    Approach {
        /// What joint 2 turns in a tick, rad.
        turn: T,
        left: u32,
        /// Since the last touch, up to when it is forgotten.
        untouched: u32,
    },
    Contact {
        below: u32,
        settle_left: u32,
        patience_left: u32,
    },
    Follow {
        below: u32,
    },
    Lost {
        since: u32,
        touching: u32,
    },
    Retract {
        /// What joint 2 turns in a tick, rad, once the force is taken away.
        turn: Option<T>,
        /// Of lifting: since the last contact, and in all.
        lifted: [u32; 2],
    },
    Hold,
    Park,
}

/// What the law reads at a tick: the setpoint, which the motion changes, and the measurement.
struct Reading<'r, 't, T: TableScalar> {
    setpoint: &'r mut PoseSetpoint<T>,
    measured: &'r Measurement<T>,
    cursor: &'r Cursor<'t, T>,
}

/// The motion of a run on the hybrid law.
#[derive(Clone, Debug)]
pub(super) struct Motion<T: Scalar> {
    state: State<T>,
    /// Whether the table presses anywhere.
    presses: bool,
    /// Whether it has begun.
    begun: bool,
    /// In a follow that needs no care: at full speed, in contact at the tick before.
    plain: bool,
    /// How fast the table goes on.
    progress: Progress,
    /// The table is to stand still, by the operator's wish.
    paused: bool,
    forces: Forces<T>,
    /// Angle that joint 2 is to stand at beyond the planned one, rad.
    offset: T,
    /// What the offset is still to lose, rad: less than its last digit.
    creep: T::Sum,
    /// Force that is wanted, N.
    reference: T,
    /// Force whose share joint 1 gives, N.
    share: T::Sum,
    /// Measured force behind a low-pass, N.
    judged: T::Sum,
    losses: u8,
    /// What the run is ended for.
    cause: Option<Fault>,
    handover: Handover<T>,
}

impl<T: TableScalar> Motion<T> {
    /// At rest before a table that presses somewhere, or nowhere.
    pub(super) fn new(presses: bool) -> Self {
        Self {
            state: State::Start,
            presses,
            begun: false,
            plain: false,
            progress: Progress::REST,
            paused: false,
            forces: Forces::default(),
            offset: T::ZERO,
            creep: T::Sum::default(),
            reference: T::ZERO,
            share: T::Sum::default(),
            judged: T::Sum::default(),
            losses: 0,
            cause: None,
            handover: Handover::None,
        }
    }

    /// Before its first tick, on an arm that stands with these torques, N m.
    pub(super) fn go_on_from(&mut self, torque: [T; 2]) {
        self.restart();
        self.handover = Handover::from(torque);
    }

    /// The same before its first tick.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.presses);
    }

    /// Where the run is.
    pub(super) fn phase(&self) -> Phase {
        match self.state {
            State::Start | State::Hold => Phase::Hold,
            State::Park => Phase::Park,
            State::Free => Phase::Free,
            State::Approach { .. } => Phase::Approach,
            State::Contact { .. } => Phase::Contact,
            State::Follow { .. } => Phase::Follow,
            State::Lost { .. } => Phase::Lost,
            State::Retract { .. } => Phase::Retract,
        }
    }

    /// Whether root moment and contact force have to agree with the plan's: on the table they do.
    pub(super) fn on_plan(&self) -> bool {
        match self.state {
            State::Follow { .. } | State::Free => true,
            State::Lost { .. } => self.begun,
            _ => false,
        }
    }

    /// Whether the table is to stand by the operator's wish.
    pub(super) fn paused(&self) -> bool {
        self.paused
    }

    /// Whether the table has begun.
    pub(super) fn begun(&self) -> bool {
        self.begun
    }

    /// Why the run was given up, if it was.
    pub(super) fn cause(&self) -> Option<Fault> {
        self.cause
    }

    /// Ends the run: the table stops, the force is taken away, the tip lifted off. The first cause
    /// counts; none is the operator's wish.
    pub(super) fn retract(&mut self, cause: Option<Fault>) {
        self.plain = false;
        self.cause = self.cause.or(cause);
        match self.state {
            // Nothing is to be left.
            State::Retract { .. } | State::Hold | State::Park => {}
            State::Start => self.state = State::Hold,
            _ => {
                self.state = State::Retract {
                    turn: None,
                    lifted: [0; 2],
                };
            }
        }
    }

    /// Lets the table stand, or go on, without leaving the surface.
    pub(super) fn pause(&mut self, paused: bool) {
        if paused != self.paused {
            self.plain = false;
            self.paused = paused;
        }
    }

    /// One tick: what the law is to read, and whether the table goes on by a tick.
    #[inline]
    pub(super) fn tick(
        &mut self,
        law: &HybridLaw<T>,
        memory: &mut HybridState<T>,
        (measured, cursor): (&Measurement<T>, &Cursor<'_, T>),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> (PoseSetpoint<T>, bool) {
        if self.plain && measured.force > self.forces.off && !cursor.at_end() {
            return (self.counted(cursor.pose(0)), true);
        }
        // In registers above, in memory below.
        self.step(law, memory, (measured, cursor), saturations)
    }

    /// The planned pose with joint 2's angle counted from where it is to stand.
    #[inline]
    fn counted(&self, mut planned: PoseSetpoint<T>) -> PoseSetpoint<T> {
        let [_, motor2] = &mut planned.motor;
        *motor2 = motor2.angle_minus(self.offset.negative());
        planned
    }

    /// A tick that is not like the one before.
    #[cold]
    #[inline(never)]
    fn step(
        &mut self,
        law: &HybridLaw<T>,
        memory: &mut HybridState<T>,
        (measured, cursor): (&Measurement<T>, &Cursor<'_, T>),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> (PoseSetpoint<T>, bool) {
        let mut setpoint = self.counted(cursor.pose(self.progress.part));
        if self.begun && !self.progress.is_full() {
            self.slow(law, cursor, &mut setpoint, saturations);
        }
        let reading = &mut Reading {
            setpoint: &mut setpoint,
            measured,
            cursor,
        };
        let planned = reading.setpoint.force;
        self.judge(law, reading);
        if let State::Start = self.state {
            self.start(law, memory, reading);
        }
        match self.state {
            State::Start | State::Hold => {}
            State::Free | State::Park => {
                self.creep(law, reading);
                if reading.cursor.at_end() {
                    self.state = State::Park;
                }
            }
            State::Approach { .. } => self.approach(law, memory, reading),
            State::Contact { .. } => self.contact(law, memory, reading, saturations),
            State::Follow { below } => self.follow(law, below, reading),
            State::Lost { .. } => self.lost(law, reading),
            State::Retract { .. } => self.lift(law, memory, reading),
        }
        self.choose_gains(law, memory, reading, saturations);
        self.want(law, reading, planned, saturations);
        let counted = (&mut *reading.setpoint, reading.measured);
        self.handover.tick(law, memory, counted, saturations);
        let goes_on = self.go_on(law, reading);
        (setpoint, goes_on)
    }

    /// Whether this tick's force is contact, or none.
    fn judge(&mut self, law: &HybridLaw<T>, reading: &Reading<'_, '_, T>) {
        let count = &mut T::SaturationCount::default();
        low_pass(
            &mut self.judged,
            Some(law.motion.judged),
            reading.measured.force,
            count,
        );
    }

    /// The first tick: what there is to begin with.
    fn start(
        &mut self,
        law: &HybridLaw<T>,
        memory: &mut HybridState<T>,
        reading: &mut Reading<'_, '_, T>,
    ) {
        let (force, planned) = (reading.measured.force, reading.setpoint.force);
        let count = &mut T::SaturationCount::default();
        self.judged = force.sum();
        self.forces = Forces {
            on: planned.scaled(law.motion.contact[0], count),
            off: planned.scaled(law.motion.contact[1], count),
            pressing: planned.scaled(law.motion.pressing, count),
            step: planned.scaled(law.motion.force_step, count),
        };
        if !self.presses {
            // The link hangs as it hangs: counted from where it stands.
            memory.free = true;
            let [_, error] = HybridLaw::angle_error(reading.setpoint, reading.measured);
            self.turn(reading, error);
            self.begun = true;
            self.progress.begin();
            self.state = State::Free;
        } else if force > self.forces.on {
            self.reference = planned;
            self.share = self.reference.sum();
            self.state = State::contact(law);
        } else {
            // Held where it stands, without the plan's force.
            memory.free = true;
            memory.force_integral = planned.negative().sum();
            let [_, error] = HybridLaw::angle_error(reading.setpoint, reading.measured);
            self.turn(reading, error);
            self.state = self.approaching(law, reading);
        }
    }

    /// Joint 1's torque of a table that does not go on at full speed.
    fn slow(
        &self,
        law: &HybridLaw<T>,
        cursor: &Cursor<'_, T>,
        setpoint: &mut PoseSetpoint<T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        let Progress {
            rate, part, change, ..
        } = self.progress;
        let links = cursor.links(part);
        let force = (links.normal, setpoint.force);
        let pressed = law.force_on_joint1(setpoint, force, &mut saturations.torque[0]);
        let slowed = &law.motion.slowed;
        slowed.apply((rate, change), &links, (setpoint, pressed), saturations);
    }

    /// Counts joint 2's angle from `error` (rad) farther on.
    fn turn(&mut self, reading: &mut Reading<'_, '_, T>, error: T) {
        let back = error.negative();
        self.offset = self.offset.angle_minus(back);
        let [_, planned] = &mut reading.setpoint.motor;
        *planned = planned.angle_minus(back);
    }

    /// Brings joint 2 to its planned angle in the air, whatever the link weighs: slowly against the
    /// law of the air, as the angle that it is counted from.
    fn creep(&mut self, law: &HybridLaw<T>, reading: &mut Reading<'_, '_, T>) {
        let count = &mut T::SaturationCount::default();
        let [_, error] = HybridLaw::angle_error(reading.setpoint, reading.measured);
        let off = error.angle_minus(self.offset.negative());
        self.creep = T::accumulated(self.creep, off.times_alpha(law.motion.creep), count);
        let step = T::of_sum(self.creep).negative();
        self.creep = T::accumulated(self.creep, step.sum(), count);
        self.turn(reading, step);
    }

    fn approaching(&self, law: &HybridLaw<T>, reading: &Reading<'_, '_, T>) -> State<T> {
        State::Approach {
            turn: self.turn_of(law, reading, law.motion.approach_turn),
            left: law.motion.approach_ticks,
            untouched: law.motion.forget_ticks,
        }
    }

    /// The angle that joint 2 turns for a way of the tip along the normal, rad.
    fn turn_of(&self, law: &HybridLaw<T>, reading: &Reading<'_, '_, T>, way: T) -> T {
        way.over(
            reading.setpoint.moment_arm,
            law.motion.turn,
            &mut T::SaturationCount::default(),
        )
    }

    /// Takes the wanted force, and the law's own, to where nothing presses.
    fn unload(&mut self, memory: &mut HybridState<T>, reading: &Reading<'_, '_, T>) -> bool {
        let step = self.forces.step;
        let gone = reading.setpoint.force.negative();
        let integral = towards(T::of_sum(memory.force_integral), gone, step);
        memory.force_integral = integral.sum();
        self.reference = towards(self.reference, T::ZERO, step);
        integral == gone && self.reference == T::ZERO
    }

    fn approach(
        &mut self,
        law: &HybridLaw<T>,
        memory: &mut HybridState<T>,
        reading: &mut Reading<'_, '_, T>,
    ) {
        let State::Approach {
            turn,
            left,
            untouched,
        } = &mut self.state
        else {
            return;
        };
        let (force, planned) = (reading.measured.force, reading.setpoint.force);
        let judged = T::of_sum(self.judged);
        *untouched = if force > self.forces.on {
            0
        } else {
            *untouched + 1
        };
        let count = &mut T::SaturationCount::default();
        if judged > self.forces.pressing {
            self.reference = judged.smaller(planned);
            self.state = State::contact(law);
        } else if *left == 0 {
            self.retract(Some(Fault::NoContact));
        } else if *untouched < law.motion.forget_ticks {
            // A stiff surface throws the tip back by most of its speed, for 10 ms and again: the
            // joint stands and presses until the bounces are over.
            for _ in 0..PRESSING_STEPS {
                self.reference = towards(self.reference, planned, self.forces.step);
                let more = T::of_sum(memory.force_integral).plus(self.forces.step, count);
                memory.force_integral = more.sum();
            }
        } else {
            *left -= 1;
            let turn = *turn;
            self.unload(memory, reading);
            self.turn(reading, turn);
        }
    }

    fn contact(
        &mut self,
        law: &HybridLaw<T>,
        memory: &mut HybridState<T>,
        reading: &mut Reading<'_, '_, T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        let planned = reading.setpoint.force;
        self.reference = towards(self.reference, planned, self.forces.step);
        let reached = self.reference == planned;
        let count = &mut T::SaturationCount::default();
        let shared = planned
            .minus(T::of_sum(self.share), count)
            .is_within(self.forces.step);
        let off = T::of_sum(self.judged).minus(planned, count);
        let State::Contact {
            below,
            settle_left,
            patience_left,
        } = &mut self.state
        else {
            return;
        };
        // Before the table begins a bounce is no loss.
        let force = if self.begun {
            reading.measured.force
        } else {
            T::of_sum(self.judged)
        };
        *below = self.forces.parted(*below, force);
        if *below >= law.motion.believed[1] {
            self.lose();
        } else if !(reached && shared) {
        } else if self.begun {
            self.state = State::Follow { below: *below };
        } else if *settle_left > 0 {
            *settle_left -= 1;
            // With the plan's force on it the link is bent as planned, and the angle of the first
            // touch means nothing any more.
            let touched = core::mem::take(&mut self.offset);
            if touched != T::ZERO {
                law.recount(memory, (reading.setpoint, touched), saturations);
                let [_, planned] = &mut reading.setpoint.motor;
                *planned = planned.angle_minus(touched);
            }
        } else if law.motion.settle_ticks == 0
            || off.is_within(planned.scaled(law.motion.judged_share, count))
        {
            self.begun = true;
            self.progress.begin();
            self.state = State::Follow { below: *below };
        } else if *patience_left > 0 {
            *patience_left -= 1;
        } else {
            self.retract(Some(Fault::ForceNotReached));
        }
        if let State::Follow { below } = self.state {
            self.follow(law, below, reading);
        }
    }

    fn follow(&mut self, law: &HybridLaw<T>, below: u32, reading: &Reading<'_, '_, T>) {
        let below = self.forces.parted(below, reading.measured.force);
        self.reference = reading.setpoint.force;
        self.share = self.reference.sum();
        self.state = State::Follow { below };
        if below >= law.motion.believed[1] {
            self.lose();
        } else if reading.cursor.at_end() {
            self.retract(None);
        }
    }

    /// There is no contact any more.
    fn lose(&mut self) {
        self.losses = self.losses.saturating_add(1);
        self.state = State::Lost {
            since: 0,
            touching: 0,
        };
    }

    fn lost(&mut self, law: &HybridLaw<T>, reading: &Reading<'_, '_, T>) {
        let State::Lost { since, touching } = &mut self.state else {
            return;
        };
        let force = reading.measured.force;
        *since += 1;
        *touching = self.forces.touched(*touching, force);
        let waited = *since;
        if self.begun {
            self.reference = reading.setpoint.force;
            self.share = self.reference.sum();
            if *touching > 0 {
                self.state = State::Follow { below: 0 };
            } else if waited >= law.motion.lost_ticks {
                self.retract(Some(Fault::ContactNotRegained));
            }
        } else if *touching >= law.motion.believed[0] {
            self.reference = force.smaller(reading.setpoint.force);
            self.state = State::contact(law);
        } else if waited >= law.motion.retry_ticks {
            if self.losses > LOSSES {
                self.retract(Some(Fault::NoContact));
            } else {
                self.state = self.approaching(law, reading);
            }
        }
    }

    fn lift(
        &mut self,
        law: &HybridLaw<T>,
        memory: &mut HybridState<T>,
        reading: &mut Reading<'_, '_, T>,
    ) {
        // A sensor that has failed may be the gauge.
        memory.without_gauge |= self
            .cause
            .is_some_and(|cause| cause.reaction() == Reaction::Stop);
        if !memory.free {
            // The gains change first.
            return;
        }
        let unloaded = self.unload(memory, reading);
        let free_at = self.forces.off;
        let rests = self.progress.rate == 0;
        let lift = self.turn_of(law, reading, law.motion.lift_turn.negative());
        let State::Retract { turn, lifted } = &mut self.state else {
            return;
        };
        let Some(turn) = *turn else {
            if !self.presses && rests {
                self.state = State::Hold;
            } else if unloaded && rests {
                *turn = Some(lift);
            }
            return;
        };
        let [since, all] = lifted;
        *all += 1;
        *since = if T::of_sum(self.judged) > free_at {
            0
        } else {
            *since + 1
        };
        if *since > law.motion.lift_ticks || *all > LIFT_MOST * law.motion.lift_ticks {
            self.state = State::Hold;
        } else {
            self.turn(reading, turn);
        }
    }

    /// The gains that belong to the state, without a step in the torque.
    fn choose_gains(
        &mut self,
        law: &HybridLaw<T>,
        memory: &mut HybridState<T>,
        reading: &mut Reading<'_, '_, T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        let free = match self.state {
            State::Contact { .. } | State::Follow { .. } => false,
            // On the table its own motion and the force integral bring the tip back sooner than
            // any change does: with the law of the air the 95th percentile of the force error at
            // 0.4 s is 0.78 N, with this 0.54 N, and pushing harder only makes it 0.67 N.
            State::Lost { .. } => !self.begun,
            _ => true,
        };
        if free != memory.free {
            let read = (&*reading.setpoint, reading.measured);
            let error = law.change(memory, free, read, saturations);
            self.turn(reading, error);
        }
    }

    /// The force that is wanted, and its share in joint 1's torque, in the setpoint; `planned` is
    /// the table's, N.
    fn want(
        &mut self,
        law: &HybridLaw<T>,
        reading: &mut Reading<'_, '_, T>,
        planned: T,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        self.plain = matches!(self.state, State::Follow { below: 0 })
            && self.progress.is_plain()
            && !self.paused
            && self.handover.is_over();
        if let State::Follow { .. } | State::Free = self.state {
            return;
        }
        let count = &mut saturations.force;
        let share = low_pass(
            &mut self.share,
            Some(law.motion.share),
            self.reference,
            count,
        );
        let missing = planned.minus(share, count);
        let count = &mut saturations.torque[0];
        let normal = reading.cursor.normal_angle(self.progress.part);
        let without = law.force_on_joint1(reading.setpoint, (normal, missing), count);
        let torque = &mut reading.setpoint.torque[0];
        *torque = torque.minus(without, count);
        reading.setpoint.force = self.reference;
    }

    /// Whether the table goes on by a tick.
    fn go_on(&mut self, law: &HybridLaw<T>, reading: &Reading<'_, '_, T>) -> bool {
        let runs = self.begun
            && !self.paused
            && !matches!(self.phase(), Phase::Retract | Phase::Hold | Phase::Park);
        let Progress { part, .. } = self.progress;
        let presses = self.presses;
        let goes = self.progress.tick(runs, law.motion.stop_ticks, || {
            if !presses {
                return 0;
            }
            let pressed = law.force_on_joint2(reading.setpoint, reading.setpoint.force);
            // Between the links, but for the root's slope.
            let [_, between] = reading.setpoint.motor;
            let turn = reading.cursor.turn(part);
            law.motion.slowed.longer((turn, between), pressed)
        });
        if reading.cursor.at_end() {
            self.progress.part = 0;
        }
        goes
    }
}

impl<T: TableScalar> State<T> {
    /// In contact, from now on.
    fn contact(law: &HybridLaw<T>) -> Self {
        Self::Contact {
            below: 0,
            settle_left: law.motion.settle_ticks,
            patience_left: law.motion.patience_ticks,
        }
    }
}

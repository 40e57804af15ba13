//! The one control tick: cursor -> setpoint -> law -> limiter -> torque.
//!
//! [`Controller::tick`] is called once a control period with what the sensors say
//! and returns what the drives get until the next tick. Firmware and simulator call
//! this very function. It allocates nothing, calls no libm function, and always returns finite torques within the limits.
//!
//! The hybrid law has a motion around it ([`crate::control::motion`]), which finds the surface before
//! the table begins and leaves it afterwards; the paper's law follows the table from the first tick.
//!
//! A [`Fault`] is latched: from then on the torques are zero until
//! [`Controller::restart`].

use crate::control::feedback::FeedbackLaw;
use crate::control::hybrid::{HybridLaw, HybridState};
use crate::control::law::{Law, LawParameters};
use crate::control::limiter::{LimitParameters, TorqueLimiter};
use crate::control::motion::Motion;
use crate::control::paper::{PaperLaw, PaperState};
use crate::fault::{Fault, Reaction};
use crate::model::ArmParameters;
use crate::number::{SiScalar, TableScalar};
use crate::phase::Phase;
use crate::signals::{Deviation, Formats, Measurement, Saturation, SaturationCounts};
use crate::table::{Cursor, Table, TableError};
use core::fmt;
use serde::{Deserialize, Serialize};

/// What the controller answers to a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command<T> {
    /// Torques (tau1, tau2) to hold until the next tick, N m.
    pub torque: [T; 2],
    /// Tick of the table that this command belongs to.
    pub tick: u32,
    /// How each joint's torque was limited in this tick.
    pub saturation: [Saturation; 2],
    /// Where the run is.
    pub phase: Phase,
    /// The latched fault, if any; the torques are then zero.
    pub fault: Option<Fault>,
}

/// All that a controller needs beside its table, in the tick's number type: prepared on
/// the host, so that a microcontroller without floating point can do without.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Coefficients<T: SiScalar> {
    /// Fingerprint of the arm that they are for.
    pub arm_fingerprint: u32,
    /// Tick rate that they are for, Hz.
    pub tick_rate_hz: u32,
    /// Formats of the signals.
    pub formats: Formats<T::Format>,
    law: Law<T>,
    limiter: TorqueLimiter<T>,
}

impl<T: SiScalar> Coefficients<T> {
    /// The coefficients for an arm at a tick rate, with signals of the given formats.
    pub fn new(
        arm: &ArmParameters,
        law: &LawParameters,
        limits: &LimitParameters,
        tick_rate_hz: u32,
        formats: &Formats<T::Format>,
    ) -> Self {
        Self {
            arm_fingerprint: arm.fingerprint(),
            tick_rate_hz,
            formats: *formats,
            law: Law::in_formats(law, arm, tick_rate_hz, formats),
            limiter: TorqueLimiter::in_formats(limits, tick_rate_hz, formats.torque),
        }
    }

    /// The law's coefficients.
    pub fn law(&self) -> &Law<T> {
        &self.law
    }
}

/// Why coefficients and a table do not go together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mismatch {
    /// The table is for another arm.
    Table(TableError),
    /// The coefficients are for another tick rate.
    TickRate {
        /// The coefficients', Hz.
        expected: u32,
        /// The table's, Hz.
        found: u32,
    },
    /// A column of the table may exceed its signal's format.
    Range {
        /// The column's position.
        column: usize,
    },
}

impl From<TableError> for Mismatch {
    fn from(error: TableError) -> Self {
        Self::Table(error)
    }
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Table(error) => error.fmt(f),
            Self::TickRate { expected, found } => write!(
                f,
                "coefficients are for {expected} Hz, the table for {found} Hz"
            ),
            Self::Range { column } => write!(
                f,
                "table column {column} may exceed its signal's fixed-point format"
            ),
        }
    }
}

impl core::error::Error for Mismatch {}

/// The law that acts, and what it remembers.
#[derive(Clone, Debug)]
enum Feedback<T: TableScalar> {
    Paper(PaperLaw<T>, PaperState<T::Sum>),
    Hybrid(HybridLaw<T>, HybridState<T>, Motion<T>),
}

impl<T: TableScalar> Feedback<T> {
    /// The law with nothing remembered.
    fn new(law: Law<T>, table: &Table<'_>) -> Self {
        match law {
            Law::Paper(law) => Self::Paper(law, PaperState::default()),
            Law::Hybrid(law) => {
                Self::Hybrid(law, HybridState::default(), Motion::new(table.presses()))
            }
        }
    }
}

/// What a controller gives.
#[derive(Clone, Copy, Debug)]
struct Given<T> {
    /// Torques (tau1, tau2), N m; unknown before the first tick, whose rates have no limit.
    torque: [T; 2],
    /// How they were limited.
    saturation: [Saturation; 2],
    /// The latched fault, for which there is no torque.
    fault: Option<Fault>,
}

impl<T: TableScalar> Given<T> {
    /// Nothing yet.
    const NOTHING: Self = Self {
        torque: [T::UNKNOWN; 2],
        saturation: [Saturation::None; 2],
        fault: None,
    };

    /// None for a fault.
    const fn none(fault: Option<Fault>) -> Self {
        Self {
            torque: [T::ZERO; 2],
            fault,
            ..Self::NOTHING
        }
    }
}

/// What a law's torques pass on their way to the drives.
struct Gate<'c, T: TableScalar> {
    limiter: &'c TorqueLimiter<T>,
    /// What was given at the tick before, and then at this one.
    given: &'c mut Given<T>,
    deviation: &'c mut Deviation<T>,
}

impl<T: TableScalar> Gate<'_, T> {
    /// One law's tick: gives the torques within the limits, or none and the fault for which there
    /// must be none. Notes how far from the plan the measurement is.
    #[inline]
    fn tick<L: FeedbackLaw<T>>(
        self,
        law: &L,
        state: &mut L::State,
        (setpoint, measured): (&L::Setpoint, &Measurement<T>),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        let sound = L::shows_in_torque(measured);
        let demand = law.update(state, setpoint, measured, saturations);
        let [torque1, torque2] = L::torque(&demand);
        L::note(&demand, setpoint, measured, self.deviation);
        let [drive1, drive2] = measured.drive.map(|limit| limit as u8);
        if sound
            && drive1 | drive2 == Saturation::None as u8
            && self.limiter.permits(self.given.torque, [torque1, torque2])
        {
            self.given.torque[0] = torque1;
            self.given.torque[1] = torque2;
            self.given.saturation = [Saturation::None; 2];
        } else {
            self.limited(law, state, demand, measured);
        }
    }

    /// A tick in which a torque is limited or undefined, or the first.
    #[expect(
        clippy::needless_pass_by_value,
        reason = "what is passed by reference is in memory in every tick"
    )]
    #[cold]
    #[inline(never)]
    fn limited<L: FeedbackLaw<T>>(
        self,
        law: &L,
        state: &mut L::State,
        demand: L::Demand,
        measured: &Measurement<T>,
    ) {
        let previous = self.given.torque;
        let limited = if L::reads_finite(measured) {
            let previous = previous[0].is_known().then_some(previous);
            self.limiter.limit(previous, L::torque(&demand))
        } else {
            Err(Fault::MeasurementNotFinite)
        };
        match limited {
            Ok((torque, saturation)) => {
                let any = [0, 1].map(|joint| saturation[joint].or(measured.drive[joint]));
                law.anti_windup(state, &demand, any);
                *self.given = Given {
                    torque,
                    saturation,
                    fault: None,
                };
            }
            Err(fault) => {
                // What is not finite may be in it.
                *state = L::State::default();
                *self.given = Given::none(Some(fault));
            }
        }
    }
}

/// The controller: coefficients, table cursor and state.
#[derive(Clone, Debug)]
pub struct Controller<'a, T: TableScalar> {
    feedback: Feedback<T>,
    limiter: TorqueLimiter<T>,
    table: Table<'a>,
    cursor: Cursor<'a, T>,
    given: Given<T>,
    /// What the law notes of it, the force the other way round.
    deviation: Deviation<T>,
    saturations: SaturationCounts<T::SaturationCount>,
}

impl<'a, T: TableScalar<Format = ()>> Controller<'a, T> {
    /// A controller in floating point at the table's first tick. The tick rate is the
    /// table's.
    ///
    /// # Errors
    /// [`TableError::Fingerprint`] if the table was planned for another arm.
    pub fn new(
        table: &Table<'a>,
        arm: &ArmParameters,
        law: &LawParameters,
        limits: &LimitParameters,
    ) -> Result<Self, TableError> {
        table.check_arm(arm.fingerprint())?;
        let rate = table.header().tick_rate_hz;
        let law = Law::in_formats(law, arm, rate, &Formats::default());
        let limiter = TorqueLimiter::new(limits, rate);
        Ok(Self::starting(law, limiter, table, table.cursor()))
    }
}

impl<'a, T: TableScalar> Controller<'a, T> {
    /// A controller in any number type at the table's first tick.
    ///
    /// # Errors
    /// [`Mismatch`] if table and coefficients do not go together.
    pub fn with(table: &Table<'a>, coefficients: &Coefficients<T>) -> Result<Self, Mismatch> {
        table.check_arm(coefficients.arm_fingerprint)?;
        let (expected, found) = (coefficients.tick_rate_hz, table.header().tick_rate_hz);
        if expected != found {
            return Err(Mismatch::TickRate { expected, found });
        }
        let cursor = table
            .cursor_in(&coefficients.formats)
            .map_err(|column| Mismatch::Range { column })?;
        Ok(Self::starting(
            coefficients.law,
            coefficients.limiter,
            table,
            cursor,
        ))
    }

    fn starting(
        law: Law<T>,
        limiter: TorqueLimiter<T>,
        table: &Table<'a>,
        cursor: Cursor<'a, T>,
    ) -> Self {
        let cursor = match law {
            Law::Paper(_) => cursor,
            Law::Hybrid(law) => cursor.with_pose(table, law.link2_length()),
        };
        Self {
            feedback: Feedback::new(law, table),
            limiter,
            table: *table,
            cursor,
            given: Given::NOTHING,
            deviation: Deviation::default(),
            saturations: SaturationCounts::default(),
        }
    }

    /// Back to the table's first tick, with nothing remembered, no fault and no saturation.
    pub fn restart(&mut self) {
        self.cursor.restart(&self.table);
        match &mut self.feedback {
            Feedback::Paper(_, state) => *state = PaperState::default(),
            Feedback::Hybrid(_, state, motion) => {
                *state = HybridState::default();
                motion.restart();
            }
        }
        self.given = Given::NOTHING;
        self.deviation = Deviation::default();
        self.saturations = SaturationCounts::default();
    }

    /// Goes on where `before` holds the same arm, in [`Phase::Hold`] or [`Phase::Park`], with this
    /// controller's table from its first tick: the first torque is the one that `before` gave last.
    /// Returns whether it can: the arm has to stand, with no fault, and both have to be hybrid.
    pub fn go_on_from(&mut self, before: &Controller<'_, T>) -> bool {
        if !before.phase().stands() || before.given.fault.is_some() {
            return false;
        }
        self.restart();
        let (Feedback::Hybrid(_, state, motion), Feedback::Hybrid(_, last, _)) =
            (&mut self.feedback, &before.feedback)
        else {
            return false;
        };
        *state = HybridState {
            without_gauge: last.without_gauge,
            torque_correction: last.torque_correction,
            ..HybridState::default()
        };
        motion.go_on_from(before.given.torque);
        self.given.torque = before.given.torque;
        true
    }

    /// Latches a fault that was found outside the controller, unless one is latched
    /// already: torques are zero from the next tick on.
    pub fn trip(&mut self, fault: Fault) {
        self.given.fault = self.given.fault.or(Some(fault));
    }

    /// Ends the run: the table stops, the force is taken away, the tip lifted off, and the arm
    /// stands; for `cause`, or, without one, by the operator's wish. The paper's law knows no such
    /// motion, and there a cause switches off.
    pub fn retract(&mut self, cause: Option<Fault>) {
        match &mut self.feedback {
            Feedback::Paper(..) => self.given.fault = self.given.fault.or(cause),
            Feedback::Hybrid(_, _, motion) => motion.retract(cause),
        }
    }

    /// Whether the law has a motion around it that can retract and pause: the paper's has none.
    pub fn has_motion(&self) -> bool {
        matches!(self.feedback, Feedback::Hybrid(..))
    }

    /// Lets the table stand where it is, or go on, without leaving the surface: what is called a
    /// feed hold. The paper's law goes on.
    pub fn pause(&mut self, paused: bool) {
        if let Feedback::Hybrid(_, _, motion) = &mut self.feedback {
            motion.pause(paused);
        }
    }

    /// Whether the table is to stand by the operator's wish.
    pub fn paused(&self) -> bool {
        match &self.feedback {
            Feedback::Paper(..) => false,
            Feedback::Hybrid(_, _, motion) => motion.paused(),
        }
    }

    /// Ticks that the table has.
    pub fn ticks(&self) -> u32 {
        self.table.header().ticks
    }

    /// Where the run is.
    pub fn phase(&self) -> Phase {
        match &self.feedback {
            Feedback::Paper(..) => Phase::Follow,
            Feedback::Hybrid(_, _, motion) => motion.phase(),
        }
    }

    /// Whether the table has begun.
    pub fn begun(&self) -> bool {
        match &self.feedback {
            Feedback::Paper(..) => true,
            Feedback::Hybrid(_, _, motion) => motion.begun(),
        }
    }

    /// Why the run was given up with the drives on, if it was.
    pub fn retract_cause(&self) -> Option<Fault> {
        match &self.feedback {
            Feedback::Paper(..) => None,
            Feedback::Hybrid(_, _, motion) => motion.cause(),
        }
    }

    /// Carries out the reaction to a fault that was found outside the controller, from the next
    /// tick on. Where there is no motion, hold and stop are off.
    pub fn react(&mut self, fault: Fault) {
        match fault.reaction() {
            Reaction::Limit => {}
            Reaction::Hold | Reaction::Stop => self.retract(Some(fault)),
            Reaction::Off => self.trip(fault),
        }
    }

    /// The latched fault, for which there is no torque.
    pub fn fault(&self) -> Option<Fault> {
        self.given.fault
    }

    /// True when the table's last tick has been reached; further ticks hold it.
    pub fn at_end(&self) -> bool {
        self.cursor.at_end()
    }

    /// What the law's force integral holds, N; for logs.
    pub fn force_integral(&self) -> T::Sum {
        match &self.feedback {
            Feedback::Paper(_, state) => state.integral,
            Feedback::Hybrid(_, state, _) => state.force_integral,
        }
    }

    /// How far from the plan the last tick's measurement was; zero while a fault is latched.
    #[inline]
    pub fn deviation(&self) -> Deviation<T> {
        if self.given.fault.is_some() {
            return Deviation::default();
        }
        let mut deviation = Deviation {
            force: self.deviation.force.negative(),
            ..self.deviation
        };
        if let Feedback::Hybrid(_, state, motion) = &self.feedback {
            deviation.angle = state.angle_error.unwrap_or_default();
            if !motion.on_plan() {
                // The wanted force is not the table's, whose moment is part of its torque,
                // and the link is bent by another one than planned.
                deviation.balance = T::ZERO;
                deviation.angle[1] = T::ZERO;
            }
        }
        deviation
    }

    /// How often each signal has saturated since the start.
    pub fn saturations(&self) -> &SaturationCounts<T::SaturationCount> {
        &self.saturations
    }

    /// One control period: torques for what was measured.
    #[inline]
    pub fn tick(&mut self, measured: &Measurement<T>) -> Command<T> {
        let tick = self.cursor.tick();
        if self.given.fault.is_none() {
            let gate = Gate {
                limiter: &self.limiter,
                given: &mut self.given,
                deviation: &mut self.deviation,
            };
            let counts = &mut self.saturations;
            // Each law goes on by itself, so that neither asks for what is the other's.
            match &mut self.feedback {
                Feedback::Paper(law, state) => {
                    let setpoint = self.cursor.setpoint();
                    self.cursor.advance();
                    gate.tick(law, state, (&setpoint, measured), counts);
                }
                Feedback::Hybrid(law, state, motion) => {
                    let read = (measured, &self.cursor);
                    let (setpoint, goes_on) = motion.tick(law, state, read, counts);
                    if goes_on {
                        self.cursor.advance();
                    }
                    gate.tick(law, state, (&setpoint, measured), counts);
                }
            }
        } else {
            self.go_on_without_torque();
        }
        Command {
            torque: self.given.torque,
            tick,
            saturation: self.given.saturation,
            phase: self.phase(),
            fault: self.given.fault,
        }
    }

    /// A tick of a controller with a fault: the table goes on.
    #[cold]
    #[inline(never)]
    fn go_on_without_torque(&mut self) {
        self.given = Given::none(self.given.fault);
        self.cursor.advance();
    }
}

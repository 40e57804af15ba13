//! The one control tick: cursor -> reference -> law -> guard -> torque.
//!
//! [`Controller::tick`] is called once a control period with what the sensors say
//! and returns what the drives get until the next tick. Firmware and simulator call
//! this very function. It allocates nothing, calls no libm function, and always returns finite torques within the limits.
//!
//! A [`Fault`] is latched: from then on the torques are zero until
//! [`Controller::restart`].

use crate::arm::ArmParameters;
use crate::guard::{Fault, Guard, LimitParameters, Limiting};
use crate::law::{Law, LawParameters, LawState, Measurement};
use crate::number::Number;
use crate::table::{Cursor, Reference, Table, TableError};

/// What the controller answers to a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command<T> {
    /// Torques (tau1, tau2) to hold until the next tick, N m.
    pub torque: [T; 2],
    /// Tick of the table that this command belongs to.
    pub tick: u32,
    /// The plan's values at this tick.
    pub reference: Reference<T>,
    /// How each joint's torque was limited in this tick.
    pub limiting: [Limiting; 2],
    /// The latched fault, if any; the torques are then zero.
    pub fault: Option<Fault>,
}

/// The controller: coefficients, table cursor and state.
#[derive(Clone, Debug)]
pub struct Controller<'a, T> {
    law: Law<T>,
    guard: Guard<T>,
    start: Cursor<'a, T>,
    cursor: Cursor<'a, T>,
    state: LawState<T>,
    previous: Option<[T; 2]>,
    fault: Option<Fault>,
}

impl<'a, T: Number> Controller<'a, T> {
    /// A controller at the table's first tick. The tick rate is the table's.
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
        let header = table.header();
        let cursor = table.cursor();
        Ok(Self {
            law: Law::new(law, arm, header.tick_rate_hz),
            guard: Guard::new(limits, header.tick_rate_hz),
            start: cursor.clone(),
            cursor,
            state: LawState::default(),
            previous: None,
            fault: None,
        })
    }

    /// Back to the table's first tick, with nothing remembered and no fault.
    pub fn restart(&mut self) {
        self.cursor = self.start.clone();
        self.state = LawState::default();
        self.previous = None;
        self.fault = None;
    }

    /// Latches a fault that was found outside the controller, unless one is latched
    /// already: torques are zero from the next tick on.
    pub fn trip(&mut self, fault: Fault) {
        self.fault = self.fault.or(Some(fault));
    }

    /// True when the table's last tick has been reached; further ticks hold it.
    pub fn at_end(&self) -> bool {
        self.cursor.at_end()
    }

    /// What the law remembers; for logs.
    pub fn state(&self) -> &LawState<T> {
        &self.state
    }

    /// One control period: torques for what was measured.
    // Always inlined, as `Cursor::reference` is and for the same reason.
    #[inline(always)]
    pub fn tick(&mut self, measured: &Measurement<T>) -> Command<T> {
        let tick = self.cursor.tick();
        let reference = self.cursor.reference();
        self.cursor.advance();
        if self.fault.is_none() && !measured.is_finite() {
            self.fault = Some(Fault::MeasurementNotFinite);
        }
        let mut torque = [T::ZERO; 2];
        let mut limiting = [Limiting::No; 2];
        if self.fault.is_none() {
            let proposal = self.law.propose(&mut self.state, &reference, measured);
            match self.guard.limit(self.previous, proposal.torque) {
                Ok((given, limited)) => {
                    torque = given;
                    limiting = limited;
                    let everything = [0, 1].map(|joint| limited[joint].or(measured.drive[joint]));
                    self.law.settle(&mut self.state, &proposal, everything);
                }
                Err(fault) => self.fault = Some(fault),
            }
        }
        self.previous = Some(torque);
        Command {
            torque,
            tick,
            reference,
            limiting,
            fault: self.fault,
        }
    }
}

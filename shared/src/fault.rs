//! Why the controller, or the supervisor around it, gives up: numbers and names that logs,
//! links and summaries carry.

use core::fmt;
use serde::{Deserialize, Serialize};

/// Why the controller gave up. Numbers are stable: logs and links carry them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "u8", try_from = "u8")]
#[repr(u8)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// A measurement was NaN or infinite.
    MeasurementNotFinite = 1,
    /// A torque was NaN or infinite at the last gate.
    TorqueNotFinite = 2,
    /// The emergency stop is pressed, or its wire is broken.
    EmergencyStop = 16,
    /// A drive reports a fault, or its wire is broken.
    Drive = 17,
    /// Sensors gave no new values for a control period.
    SensorsStale = 18,
    /// A tick was not over when the next one was due.
    TickOverrun = 19,
    /// The host fell silent while the arm was enabled.
    LinkTimeout = 20,
    /// A converter is at its rail: a wire is broken, or more is measured than its range.
    SensorRange = 21,
    /// An approach found no surface, or could not stay on it.
    NoContact = 32,
    /// The force on the surface did not come near the plan's before the table.
    ForceNotReached = 33,
    /// Contact was lost for too long.
    ContactNotRegained = 34,
}

impl Fault {
    /// Every fault.
    pub const ALL: [Self; 11] = [
        Self::MeasurementNotFinite,
        Self::TorqueNotFinite,
        Self::EmergencyStop,
        Self::Drive,
        Self::SensorsStale,
        Self::TickOverrun,
        Self::LinkTimeout,
        Self::SensorRange,
        Self::NoContact,
        Self::ForceNotReached,
        Self::ContactNotRegained,
    ];

    /// Stable number; 0 is left for "none".
    pub fn number(self) -> u8 {
        self as u8
    }

    /// Stable name in snake case, as `summary.json` shows it.
    pub fn name(self) -> &'static str {
        match self {
            Self::MeasurementNotFinite => "measurement_not_finite",
            Self::TorqueNotFinite => "torque_not_finite",
            Self::EmergencyStop => "emergency_stop",
            Self::Drive => "drive_fault",
            Self::SensorsStale => "sensors_stale",
            Self::TickOverrun => "tick_overrun",
            Self::LinkTimeout => "link_timeout",
            Self::SensorRange => "sensor_range",
            Self::NoContact => "no_contact",
            Self::ForceNotReached => "force_not_reached",
            Self::ContactNotRegained => "contact_not_regained",
        }
    }
}

impl From<Fault> for u8 {
    fn from(fault: Fault) -> Self {
        fault.number()
    }
}

impl TryFrom<u8> for Fault {
    type Error = &'static str;

    /// # Errors
    /// A text, for a number that no fault has.
    fn try_from(number: u8) -> Result<Self, Self::Error> {
        Self::ALL
            .into_iter()
            .find(|fault| fault.number() == number)
            .ok_or("no fault has this number")
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

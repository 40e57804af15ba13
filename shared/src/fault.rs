//! Why the controller, or the supervisor around it, gives up, and what is done about it: numbers
//! and names that logs, links and summaries carry.

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
    /// More than a control period has passed since the tick before.
    TicksLost = 22,
    /// An approach found no surface, or could not stay on it.
    NoContact = 32,
    /// The force on the surface did not come near the plan's before the table.
    ForceNotReached = 33,
    /// Contact was lost for too long.
    ContactNotRegained = 34,
    /// A motor's angle is too far from the planned one.
    PathDeviation = 48,
    /// A motor turns faster than the plan ever does.
    JointSpeed = 49,
    /// An encoder's count stepped farther than the motor can turn in a tick.
    EncoderStep = 50,
    /// An encoder shows no motion where there must be one: its cable is out, or the joint is jammed.
    EncoderFrozen = 51,
    /// The root moment is not the one that the law makes.
    RootMoment = 52,
    /// Root moment and contact force contradict each other.
    ForceBalance = 53,
    /// The contact force is too far from the planned one.
    ForceBand = 54,
    /// A converter's count stands still while the arm moves.
    SensorFrozen = 55,
    /// A stop was ordered, and a motor turns too fast all the same.
    StopNotObeyed = 56,
}

/// What is done about a fault, from the mildest to the hardest: by what still works.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reaction {
    /// The motion goes on; the cause may pass, and is shown.
    Limit,
    /// The table stops, the arm stands where it is, drives on, until the operator decides.
    Hold,
    /// A controlled stop, by the motors' encoders alone; then as [`Hold`](Self::Hold).
    Stop,
    /// Torques zero and drives disabled, in the same tick.
    Off,
}

impl Reaction {
    /// Stable name in snake case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Limit => "limit",
            Self::Hold => "hold",
            Self::Stop => "stop",
            Self::Off => "off",
        }
    }
}

impl fmt::Display for Reaction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Fault {
    /// Every fault.
    pub const ALL: [Self; 21] = [
        Self::MeasurementNotFinite,
        Self::TorqueNotFinite,
        Self::EmergencyStop,
        Self::Drive,
        Self::SensorsStale,
        Self::TickOverrun,
        Self::LinkTimeout,
        Self::SensorRange,
        Self::TicksLost,
        Self::NoContact,
        Self::ForceNotReached,
        Self::ContactNotRegained,
        Self::PathDeviation,
        Self::JointSpeed,
        Self::EncoderStep,
        Self::EncoderFrozen,
        Self::RootMoment,
        Self::ForceBalance,
        Self::ForceBand,
        Self::SensorFrozen,
        Self::StopNotObeyed,
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
            Self::TicksLost => "ticks_lost",
            Self::NoContact => "no_contact",
            Self::ForceNotReached => "force_not_reached",
            Self::ContactNotRegained => "contact_not_regained",
            Self::PathDeviation => "path_deviation",
            Self::JointSpeed => "joint_speed",
            Self::EncoderStep => "encoder_step",
            Self::EncoderFrozen => "encoder_frozen",
            Self::RootMoment => "root_moment",
            Self::ForceBalance => "force_balance",
            Self::ForceBand => "force_band",
            Self::SensorFrozen => "sensor_frozen",
            Self::StopNotObeyed => "stop_not_obeyed",
        }
    }

    /// What is done about it. A controlled stop needs encoders, drives, the operator's consent and
    /// a tick that can be relied on; without one of them there is only off.
    pub fn reaction(self) -> Reaction {
        match self {
            Self::LinkTimeout
            | Self::NoContact
            | Self::ForceNotReached
            | Self::ContactNotRegained => Reaction::Hold,
            Self::SensorsStale
            | Self::SensorRange
            | Self::PathDeviation
            | Self::JointSpeed
            | Self::RootMoment
            | Self::ForceBalance
            | Self::ForceBand
            | Self::SensorFrozen => Reaction::Stop,
            Self::MeasurementNotFinite
            | Self::TorqueNotFinite
            | Self::EmergencyStop
            | Self::Drive
            | Self::TickOverrun
            | Self::TicksLost
            | Self::EncoderStep
            | Self::EncoderFrozen
            | Self::StopNotObeyed => Reaction::Off,
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

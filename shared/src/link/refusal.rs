//! Why the microcontroller does not do what it was asked.

use crate::fault::Fault;
use crate::table::SlotError;
use core::fmt;
use serde::{Deserialize, Serialize};

/// Why the microcontroller does not do what it was asked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// Enabled, or in lock-step; the request needs a disabled arm.
    Busy,
    /// Not in lock-step; the request needs it.
    NotInLockStep,
    /// The slot's table is not usable.
    Table(SlotError),
    /// Neither slot's table is usable: slot A's reason, slot B's.
    NoTable(SlotError, SlotError),
    /// The setup in the firmware's image is damaged.
    NoSetup,
    /// A fault is latched; acknowledge it first.
    Latched(Fault),
    /// The cause of this fault is there.
    Cause(Fault),
    /// The arm is not where the table begins.
    AwayFromStart {
        /// Theta10, theta20, root slope less the table's, rad.
        deviation_rad: [f32; 3],
    },
    /// Where the joints are is not known; say so when the arm stands at its home pose.
    NotHomed,
    /// The table may ask for more torque than the limits and the drives allow.
    TooMuchTorque {
        /// Bound of the table's torques, N m.
        planned_nm: [f32; 2],
        /// What is allowed, N m.
        limit_nm: [f32; 2],
    },
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => f.write_str("enabled or in lock-step: disable, or stop lock-step, first"),
            Self::NotInLockStep => f.write_str("not in lock-step: start it first"),
            Self::Table(error) => write!(f, "the slot {error}"),
            Self::NoTable(a, b) => write!(f, "no usable table: slot A {a}, slot B {b}"),
            Self::NoSetup => f.write_str("the setup in the image is damaged: flash it again"),
            Self::Latched(fault) => {
                write!(
                    f,
                    "fault {} ({fault}) is latched: acknowledge it first",
                    fault.number()
                )
            }
            Self::Cause(fault) => write!(
                f,
                "the cause of fault {} ({fault}) is there",
                fault.number()
            ),
            Self::AwayFromStart { deviation_rad } => write!(
                f,
                "the arm is {deviation_rad:?} rad (theta10, theta20, root slope) from the table's first row"
            ),
            Self::NotHomed => f.write_str(
                "the joints' positions are not known since start or lock-step: put the arm in its home pose and say so (home)",
            ),
            Self::TooMuchTorque {
                planned_nm,
                limit_nm,
            } => write!(
                f,
                "the table asks for up to {planned_nm:?} N m, the limits and the drives allow {limit_nm:?}"
            ),
        }
    }
}

impl core::error::Error for Refusal {}

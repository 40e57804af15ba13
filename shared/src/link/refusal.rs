//! Why the microcontroller does not do what it was asked.

use crate::fault::Fault;
use crate::link::program::Program;
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
    /// A motor is not where the table begins; of a law whose gauge shows no slope.
    MotorsAwayFromStart {
        /// Motor angles m1, m2 less the table's, rad.
        deviation_rad: [f32; 2],
        /// How far either may be off, rad.
        allowed_rad: [f32; 2],
    },
    /// Not enabled; the request is about an enabled arm's run.
    NotEnabled,
    /// The paper's law follows its table from the first tick to the last: it can neither pause nor
    /// retract.
    NoMotion,
    /// The run is over or being ended: there is no table to stand or to go on.
    RunOver,
    /// Another table, or with other settings, than the host named.
    OtherProgram {
        /// What is there.
        found: Program,
        /// What was named.
        named: Program,
    },
    /// Enabled by another session than the one that wants to keep it so.
    OtherSession,
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
            Self::MotorsAwayFromStart {
                deviation_rad,
                allowed_rad,
            } => motors_away(f, deviation_rad, allowed_rad),
            Self::NotEnabled => f.write_str("not enabled: there is no run"),
            Self::NoMotion => f.write_str(
                "the paper's law can neither pause nor retract: disable, which switches the drives off",
            ),
            Self::OtherProgram { found, named } => other_program(f, found, named),
            Self::OtherSession => {
                f.write_str("another host enabled it, and keeps it enabled: end that one first")
            }
            Self::RunOver => f.write_str("the run is over or being ended: the table does not go on"),
        }
    }
}

/// Says what of a program is another one, and what mends it.
fn other_program(f: &mut fmt::Formatter<'_>, found: &Program, named: &Program) -> fmt::Result {
    let mut joiner = "";
    for (what, found, named) in [
        ("table", found.table_crc, named.table_crc),
        ("task", found.task_fingerprint, named.task_fingerprint),
        ("settings", found.setup_crc, named.setup_crc),
    ] {
        if found != named {
            write!(
                f,
                "{joiner}it has {what} {found:#010x}, asked for is {named:#010x}"
            )?;
            joiner = "; ";
        }
    }
    f.write_str(": flash it with the same files")
}

/// Names each motor that is farther off than is allowed, and how far.
fn motors_away(
    f: &mut fmt::Formatter<'_>,
    deviation_rad: &[f32; 2],
    allowed_rad: &[f32; 2],
) -> fmt::Result {
    let mut joiner = "";
    for ((joint, deviation), allowed) in (1..).zip(deviation_rad).zip(allowed_rad) {
        // What is not a number is not within the limit either.
        let within = deviation.abs() <= *allowed;
        if !within {
            write!(
                f,
                "{joiner}motor {joint} stands {deviation:.4} rad from the table's first row, {allowed:.4} are accepted"
            )?;
            joiner = "; ";
        }
    }
    Ok(())
}

impl core::error::Error for Refusal {}

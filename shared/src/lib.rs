//! The part of Flexor that runs everywhere: on the Cortex-M that drives the arm
//! and, unchanged, in the host's simulator. `no_std`, no allocation, no `unsafe`.
//!
//! Data flows one way, and a wing knows only those before it:
//!
//! | wing | responsible for |
//! |---|---|
//! | [`number`] | the scalar traits that let one source serve `f32`, `f64` and fixed point |
//! | [`signals`], [`fault`] | the words that everything shares: what is measured, planned, limited, wrong |
//! | [`model`] | the arm's data, its kinematics (eq. 12-13), its elastic link (eq. 24-27) |
//! | [`table`] | the feedforward table: format, writer, streaming cursor, slots in flash |
//! | [`control`] | the control law (eq. 18-20), torque limits, the one `tick` |
//! | [`link`] | messages between host and microcontroller |
//! | [`supervisor`] | when the drives may run; the tick as a board's interrupt runs it |
//!
//! # Conventions
//!
//! Plane problem in the inertial axes a1 (horizontal) and a2 (**down**). Angles
//! are in radians, from a1 towards a2. `theta10` is the angle of link 1 and
//! `theta20` that of link 2's *chord*, the straight line from joint 2 to the tip;
//! `theta21 = theta20 - theta10`. The deflection `w` is measured from the chord
//! and vanishes at both of its ends, so the tip's position is exactly that of a
//! rigid two-link arm. The contact force is that of the tip **on the surface**,
//! positive along the surface normal. SI units throughout; time on the
//! microcontroller is an integer number of ticks.
//!
//! Equation numbers are those of the paper "A Trajectory and Force Control of a
//! Manipulator with Elastic Links", corrected where `docs/model.md` says so.

#![no_std]

pub mod control;
pub mod fault;
pub mod link;
pub mod model;
pub mod number;
pub mod phase;
pub mod signals;
pub mod supervisor;
pub mod table;

/// CRC-32 (ISO-HDLC) of tables, link frames and fingerprints. A static: a local one builds
/// its table of 1 KiB on the stack.
static CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

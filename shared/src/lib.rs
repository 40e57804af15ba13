//! The part of Flexor that runs everywhere: on the Cortex-M that drives the arm
//! and, unchanged, in the host's simulator. `no_std`, no allocation, no `unsafe`.
//!
//! | module | responsible for |
//! |---|---|
//! | [`number`] | the scalar traits that let one source serve `f32`, `f64` and fixed point |
//! | [`fixed_point`] | the fixed-point scalar |
//! | [`trig`] | the sine that the control tick may use (a polynomial, no libm) |
//! | [`arm`] | the arm's data, its kinematics (eq. 12-13) and its fingerprint |
//! | [`beam`] | the elastic link as finite elements (eq. 24-27) |
//! | [`table`] | the feedforward table: format, writer, streaming cursor |
//! | [`law`] | the control law (eq. 18-20) |
//! | [`signals`] | the tick's signals: formats, saturations |
//! | [`guard`] | torque limits and the finite check behind everything |
//! | [`controller`] | the one `tick` that joins cursor, law and guard |
//! | [`sensing`] | from encoder and converter counts to a measurement |
//! | [`slot`] | the places in flash where a table may lie |
//! | [`safety`] | when the drives may be enabled, and when they must not stay so |
//! | [`board`] | what the tick needs from a board, as small traits |
//! | [`control`] | disarmed, armed or lock-step: the tick as the interrupt runs it |
//! | [`link`] | messages between host and microcontroller |
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

pub mod arm;
pub mod beam;
pub mod board;
pub mod control;
pub mod controller;
pub mod fixed_point;
pub mod guard;
pub mod law;
pub mod link;
pub mod number;
pub mod safety;
pub mod sensing;
pub mod signals;
pub mod slot;
pub mod table;
pub mod trig;

/// CRC-32 (ISO-HDLC) of tables, link frames and fingerprints. A static: a local one builds
/// its table of 1 KiB on the stack.
static CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

//! Controller and plant in lock-step: [`closed_loop`] with perfect readings and a rigid surface,
//! [`bench`](mod@bench) through the board's counts on the plant with everything that a real arm has.

#[cfg(feature = "bench")]
pub mod bench;
pub mod cases;
pub mod closed_loop;
pub mod start;

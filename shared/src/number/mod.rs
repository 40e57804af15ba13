//! The numbers that everything computes with.
//!
//! | file | responsible for |
//! |---|---|
//! | `scalar` | [`Scalar`], what the control tick computes with; [`SiScalar`], [`TableScalar`] |
//! | `bits` | how far a fixed-point number is shifted |
//! | `float` | that, in floating point |
//! | `real` | [`Real`], what model, planning and simulation compute with |
//! | [`fixed`] | the fixed-point scalar |
//! | [`sine`] | the sine that the control tick may use (a polynomial, no libm) |

mod bits;
pub mod fixed;
mod float;
mod real;
mod scalar;
pub mod sine;

pub use bits::Bits;
pub use real::Real;
pub use scalar::{Constant, Scalar, SiScalar, TableScalar};

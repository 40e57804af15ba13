//! What can be said of a loop, and of its numbers, without a board.

pub mod fixed_point;
#[cfg(all(feature = "stability", feature = "bench"))]
pub mod hybrid;
#[cfg(feature = "stability")]
pub mod stability;

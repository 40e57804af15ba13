//! What f32 and fixed point cost against f64.

pub mod accuracy;
mod bound;
pub mod exact;
pub mod range;
mod signal;
pub mod trial;

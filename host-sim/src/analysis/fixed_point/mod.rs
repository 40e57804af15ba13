//! What f32 and fixed point cost against f64.

pub mod accuracy;
pub mod exact;
pub mod range;

//! The user's files, checked; results as CSV and JSON.

pub mod config;
#[cfg(feature = "export")]
pub mod export;

//! The user's files, checked; results as CSV and JSON.

pub mod config;
pub mod export;

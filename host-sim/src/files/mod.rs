//! The user's files, checked; results as CSV, JSON and Parquet.

#[cfg(feature = "campaign")]
pub mod campaign_parquet;
#[cfg(feature = "campaign")]
pub mod campaign_rows;
#[cfg(feature = "campaign")]
pub mod campaign_summary;
pub mod config;
#[cfg(feature = "export")]
pub mod export;
#[cfg(feature = "campaign")]
pub mod ticks_parquet;

//! Campaigns: many runs of one scenario, each with values of its own, and what they show.

pub mod drivers;
pub mod findings;
pub mod identity;
pub mod merge;
pub mod record;
pub mod statistics;
pub mod verdict;

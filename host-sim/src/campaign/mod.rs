//! Campaigns: many runs of one scenario, each with values of its own, and what they show.

pub mod drivers;
pub mod identity;
pub mod record;
pub mod statistics;
pub mod verdict;

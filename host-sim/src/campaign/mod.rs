//! Campaigns: many runs of one scenario, each with values of its own, and what they show.
//!
//! | file | responsible for |
//! |---|---|
//! | `keys`, `distribution` | the numbers of a scenario: what each accepts and sets, how it is spread |
//! | `setup`, `scenario` | one arm with everything around it; how arms are drawn |
//! | `engine` | the runs: side by side, on all cores, in any order with the same results |
//! | `record`, `identity`, `merge` | what is kept of them, and what they are results of; shards put together |
//! | `statistics`, `drivers`, `findings` | what they show together, and which drawn value drives failure |
//! | `verdict` | whether that is what was asked |

pub mod distribution;
pub mod drivers;
pub mod engine;
pub mod findings;
pub mod identity;
pub mod keys;
pub mod merge;
pub mod record;
pub mod scenario;
pub mod setup;
pub mod statistics;
pub mod verdict;

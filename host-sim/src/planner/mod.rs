//! From a task to joint motion, deflection, torques and their table.

pub mod collocation;
pub mod limits;
pub mod path;
pub mod plan;
pub mod table_fit;

//! The simulated arm, one physical law a file. It knows the model and nothing of the planner.
//!
//! Two plants: [`Plant`], its tip held on a rigid surface, which stability is proved for, and
//! [`CompliantPlant`], the bench's, with everything that a real arm has.
//!
//! | file | law |
//! |---|---|
//! | `plant`, `parameters`, `friction`, `integrator`, `spread` | the rigid plant |
//! | `compliant`, `rest`, `step` | the bench's plant: its laws put together, start, step |
//! | `free_arm` | the arm's equations with the tip's force as an input |
//! | `surface`, `contact`, `bristle` | surface, one-sided contact, friction with pre-sliding |
//! | `joint` | friction, cogging, rotor, gear play |
//! | `drive`, `sensors`, `noise` | from command to torque, from motion to counts |
//! | `lanes`, `four_lanes`, `runge_kutta` | several plants at once, and their integration |

mod bristle;
mod compliant;
#[cfg(test)]
mod compliant_tests;
mod contact;
mod drive;
mod four_lanes;
mod free_arm;
mod friction;
pub mod integrator;
mod joint;
pub mod lanes;
mod noise;
mod parameters;
#[allow(clippy::module_inception)]
mod plant;
mod rest;
mod runge_kutta;
mod sensors;
pub mod spread;
mod step;
mod surface;

pub use compliant::{
    CompliantArm, CompliantError, CompliantParameters, CompliantPlant, CompliantReading, Outputs,
    RestState,
};
pub use contact::ContactParameters;
pub use drive::{DELAY_TICKS_MAX, Drive, DriveParameters};
pub use four_lanes::F64x4;
pub use joint::{Cogging, GearPlay, JointFriction, JointParameters};
pub use parameters::PlantParameters;
pub use plant::*;
pub use runge_kutta::STEP_TIMES_EIGENVALUE;
pub use sensors::{
    AnalogErrors, Channels, ConverterChannel, EncoderChannel, Sensed, SensorParameters, Sensors,
    Stimulus,
};
pub use surface::{SurfaceFeature, SurfaceProfile};

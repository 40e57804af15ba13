//! The bench's plant: an arm with everything that a real one has, one physical law a file.
//!
//! | file | law |
//! |---|---|
//! | `compliant`, `rest`, `step` | the bench's plant: its laws put together, start, step |
//! | `any_arm`, `free_arm` | the arm's equations with the tip's force as an input, with either model of its link |
//! | `pressed` | its smooth part alone, for linearisation |
//! | `surface`, `contact`, `bristle` | surface, one-sided contact, friction with pre-sliding |
//! | `joint` | friction, cogging, rotor, gear play |
//! | `drive`, `sensors`, `noise` | from command to torque, from motion to counts |
//! | `lanes`, `four_lanes`, `runge_kutta` | several plants at once, and their integration |

mod any_arm;
#[cfg(test)]
mod bent_tests;
mod bristle;
mod compliant;
#[cfg(test)]
mod compliant_tests;
mod contact;
mod drive;
mod four_lanes;
mod free_arm;
mod joint;
pub mod lanes;
mod noise;
mod pressed;
mod rest;
mod runge_kutta;
mod sensors;
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
pub use noise::RandomStream;
pub use pressed::{PressedArm, PressedPlane, PressedReading, Stuck};
pub use runge_kutta::STEP_TIMES_EIGENVALUE;
pub use sensors::{
    AnalogErrors, Channels, ConverterChannel, EncoderChannel, GaugeSignal, Sensed,
    SensorParameters, Sensors, Stimulus,
};
pub use surface::{SurfaceFeature, SurfaceProfile};

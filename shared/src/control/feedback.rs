//! What the controller wants of a control law, and the host of its coefficients.

use crate::number::Scalar;
use crate::signals::{Deviation, Measurement, Saturation, SaturationCounts};

/// What the controller's tick wants of a law. The tick is compiled for each law; which one acts
/// is asked once.
pub(super) trait FeedbackLaw<T: Scalar> {
    /// What it reads of the plan.
    type Setpoint;
    /// What it remembers.
    type State: Default;
    /// What it asks for.
    type Demand;

    /// True when all that it reads of the measurement is finite.
    fn reads_finite(measured: &Measurement<T>) -> bool;
    /// False when something that it reads is not finite and need not make a torque so.
    fn shows_in_torque(measured: &Measurement<T>) -> bool;
    /// The torques for a measurement; steps what is remembered on.
    fn update(
        &self,
        state: &mut Self::State,
        setpoint: &Self::Setpoint,
        measured: &Measurement<T>,
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) -> Self::Demand;
    /// The torques asked for, N m.
    fn torque(demand: &Self::Demand) -> [T; 2];
    /// Notes how far from the plan the measurement was: what the law knows of it beside its state,
    /// of the force the planned one less the measured.
    fn note(
        demand: &Self::Demand,
        setpoint: &Self::Setpoint,
        measured: &Measurement<T>,
        deviation: &mut Deviation<T>,
    );
    /// Takes back what pushed a joint farther into its limit.
    fn anti_windup(
        &self,
        state: &mut Self::State,
        demand: &Self::Demand,
        saturation: [Saturation; 2],
    );
}

/// What a law's coefficients are after rounding, for checks on the host.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficient {
    /// The key of `controller.toml` or `arm.toml` that it comes from.
    pub name: &'static str,
    /// What it should be.
    pub wanted: f64,
    /// What it is.
    pub is: f64,
}

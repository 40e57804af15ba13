//! The closed loop as it is sampled: plant with held torques, and the controller's own
//! law.
//!
//! At tick k the controller reads the plant *under the torque of the period before*
//! (contact force follows torque at once), and its command is held until the next tick:
//!
//! ```text
//! v_k     = C x_k + D u_(k-1)
//! w_(k+1), u_k = law(w_k, v_k)
//! x_(k+1) = Phi x_k + Gamma u_k
//! ```
//!
//! That is what [`crate::simulation::closed_loop`] simulates: force feedback acts with one tick of
//! delay through `D u_(k-1)`, all else at once. A delay of `d` ticks more, of which drive,
//! bus or computation may be made, lets `u_(k-d)` act; `d` need not be whole.
//!
//! The law's part is not written down here a second time: it is
//! [`flexor::control::PaperLaw::update`] itself, which is affine in what it remembers and
//! measures, evaluated on basis vectors.

use super::linear::{FORCE, Linear, SLOPE_RATE};
use crate::planner::plan::Plan;
use crate::plant::spread::PlantVariant;
use flexor::control::{PaperLaw, PaperParameters, PaperState};
use flexor::signals::{Measurement, SaturationCounts, Setpoint};
use nalgebra::DMatrix;

/// Numbers that the law remembers: filtered force error, integral, filtered slope rate.
pub const LAW_STATES: usize = 3;
/// Position of the integral among them.
const INTEGRAL: usize = 1;

/// The law as matrices, for deviations from the planned motion:
/// `w+ = a w + b v`, `u = c w + d v`, with `w` the law's memory, `v` the measured contact
/// force (N) and root slope rate (rad/s), `u` the torques (N m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearLaw {
    /// What is remembered of what was remembered.
    pub a: [[f64; LAW_STATES]; LAW_STATES],
    /// What is remembered of the measurement.
    pub b: [[f64; 2]; LAW_STATES],
    /// Torques from what was remembered.
    pub c: [[f64; LAW_STATES]; 2],
    /// Torques from the measurement.
    pub d: [[f64; 2]; 2],
    /// Whether the integral acts; without, it is a pole at 1 that moves nothing.
    pub integrates: bool,
}

impl LinearLaw {
    /// The law with `parameters` for `plan`'s arm, at the joint angles `angle` (rad) and
    /// `tick_rate_hz`.
    pub fn new(
        parameters: &PaperParameters,
        plan: &Plan,
        angle: [f64; 2],
        tick_rate_hz: u32,
    ) -> Self {
        let law = PaperLaw::<f64>::new(parameters, &plan.model.arm, tick_rate_hz);
        let setpoint = Setpoint {
            torque: [0.0; 2],
            force: 0.0,
            root_slope_rate: 0.0,
            normal_angle: plan.normal_angle(),
        };
        // Without gains on it the law leaves its memory of the error alone.
        let remembers_error =
            parameters.force_derivative_s != 0.0 || parameters.force_proportional != 0.0;
        // Everything zero but the angles gives zero: without a correction the moment arms'
        // dependence on the angles moves nothing.
        let respond = |memory: [f64; LAW_STATES], measured: [f64; 2]| {
            let mut state = PaperState {
                filtered_error: remembers_error.then_some(memory[0]),
                integral: memory[INTEGRAL],
                filtered_slope_rate: memory[2],
            };
            let measurement = Measurement {
                angle,
                root_slope: 0.0,
                root_slope_rate: measured[1],
                force: measured[0],
                ..Measurement::default()
            };
            let demand = law.update(
                &mut state,
                &setpoint,
                &measurement,
                &mut SaturationCounts::default(),
            );
            let remembered = [
                state.filtered_error.unwrap_or_default(),
                state.integral,
                state.filtered_slope_rate,
            ];
            (remembered, demand.torque)
        };
        let mut linear = Self {
            a: [[0.0; LAW_STATES]; LAW_STATES],
            b: [[0.0; 2]; LAW_STATES],
            c: [[0.0; LAW_STATES]; 2],
            d: [[0.0; 2]; 2],
            integrates: parameters.force_integral_per_s != 0.0,
        };
        for j in 0..LAW_STATES {
            let mut memory = [0.0; LAW_STATES];
            memory[j] = 1.0;
            let (remembered, torque) = respond(memory, [0.0; 2]);
            (0..LAW_STATES).for_each(|i| linear.a[i][j] = remembered[i]);
            (0..2).for_each(|i| linear.c[i][j] = torque[i]);
        }
        for j in 0..2 {
            let mut measured = [0.0; 2];
            measured[j] = 1.0;
            let (remembered, torque) = respond([0.0; LAW_STATES], measured);
            (0..LAW_STATES).for_each(|i| linear.b[i][j] = remembered[i]);
            (0..2).for_each(|i| linear.d[i][j] = torque[i]);
        }
        linear
    }
}

/// `parameters` with all four gains multiplied by `factor`.
pub fn with_gains_times(parameters: &PaperParameters, factor: f64) -> PaperParameters {
    PaperParameters {
        force_derivative_s: parameters.force_derivative_s * factor,
        force_proportional: parameters.force_proportional * factor,
        force_integral_per_s: parameters.force_integral_per_s * factor,
        slope_rate_nms_rad: parameters.slope_rate_nms_rad * factor,
        ..*parameters
    }
}

/// The plant between two ticks.
#[derive(Clone, Debug)]
struct Hold {
    /// State to state over a period.
    phi: DMatrix<f64>,
    /// What the torque does that acts from `part` of the period to its end.
    late: DMatrix<f64>,
    /// What the torque does that acts before.
    early: DMatrix<f64>,
}

/// The plant as the sampled controller meets it, at one point of the path.
#[derive(Clone, Debug)]
pub struct Sampled {
    /// Control period, s.
    pub period: f64,
    /// Unit of the velocities in the state, 1/s; see [`Linear`].
    unit: f64,
    /// The plant's linearisation with scaled velocities.
    linear: Linear,
    hold: Hold,
    /// The measured outputs, force and slope rate, of state and torque.
    measure: [Vec<f64>; 2],
    feed: [[f64; 2]; 2],
    /// The joint angles there, rad.
    angle: [f64; 2],
}

impl Sampled {
    /// Samples `linear` at `tick_rate_hz`.
    pub fn new(linear: &Linear, variant: &PlantVariant) -> Self {
        Self::at_rate(linear, variant.tick_rate_hz)
    }

    /// As [`new`](Self::new), at another rate.
    pub fn at_rate(linear: &Linear, tick_rate_hz: u32) -> Self {
        let unit = linear.unit();
        let scaled = linear.scaled(unit);
        let period = 1.0 / f64::from(tick_rate_hz);
        let rows = [FORCE, SLOPE_RATE];
        let angle = [
            linear.output[super::linear::ANGLE1],
            linear.output[super::linear::ANGLE2],
        ];
        Self {
            period,
            unit,
            hold: hold(&scaled, period, 0.0),
            measure: rows.map(|row| scaled.c.row(row).iter().copied().collect()),
            feed: rows.map(|row| [scaled.d[(row, 0)], scaled.d[(row, 1)]]),
            linear: scaled,
            angle,
        }
    }

    /// Joint angles at this point, rad.
    pub fn angle(&self) -> [f64; 2] {
        self.angle
    }

    /// Number of the plant's states.
    pub fn states(&self) -> usize {
        self.linear.a.nrows()
    }

    /// The same plant driven by two more states, 1 and a share of time that grows by
    /// `step` a tick: they add `drive[0] + share drive[1]` to the state at every tick and
    /// `offset[0] + share offset[1]` to the measured force and slope rate. Velocities in
    /// `drive` are in this plant's unit. Only for loops without further delay.
    pub(super) fn driven(&self, drive: [&[f64]; 2], offset: [[f64; 2]; 2], step: f64) -> Self {
        let n = self.states();
        let mut driven = self.clone();
        let mut phi = DMatrix::identity(n + 2, n + 2);
        phi.view_mut((0, 0), (n, n)).copy_from(&self.hold.phi);
        for (column, drive) in drive.iter().enumerate() {
            for (row, value) in drive.iter().enumerate() {
                phi[(row, n + column)] = *value;
            }
        }
        phi[(n + 1, n)] = step;
        let longer = |m: &DMatrix<f64>| m.clone().resize_vertically(n + 2, 0.0);
        driven.hold = Hold {
            phi,
            late: longer(&self.hold.late),
            early: longer(&self.hold.early),
        };
        for (v, row) in driven.measure.iter_mut().enumerate() {
            row.extend([offset[0][v], offset[1][v]]);
        }
        driven.linear.a = DMatrix::zeros(n + 2, n + 2);
        driven
    }

    /// What a constant rate `rate` of the state (velocities' rates in SI) adds to the
    /// state in a period.
    pub(super) fn driven_by(&self, rate: &[f64]) -> Vec<f64> {
        let n = self.states();
        let mut matrix = DMatrix::zeros(n + 1, n + 1);
        matrix.view_mut((0, 0), (n, n)).copy_from(&self.linear.a);
        for (i, rate) in rate.iter().enumerate() {
            matrix[(i, n)] = if i < n / 2 { *rate } else { *rate / self.unit };
        }
        let exponential = exp(matrix * self.period);
        exponential.column(n).rows(0, n).iter().copied().collect()
    }

    /// The measured force (N) as a row over the closed loop's state without delay.
    pub(super) fn force_row(&self) -> Vec<f64> {
        let mut row = self.measure[0].clone();
        row.extend(self.feed[0]);
        row
    }

    /// Unit of the velocities in the closed loop's state, 1/s.
    pub(super) fn velocity_unit(&self) -> f64 {
        self.unit
    }

    /// Matrix that takes the closed loop from tick to tick, its torques acting
    /// `delay_ticks` later than in the simulation. State: the plant's, with velocities
    /// scaled; the torques of the last ticks, newest first; the law's memory, without the integral where that does not act.
    pub fn closed_loop(&self, law: &LinearLaw, delay_ticks: f64) -> DMatrix<f64> {
        let whole = delay_ticks.max(0.0).floor();
        let part = delay_ticks.max(0.0) - whole;
        let whole = whole as usize;
        let fresh;
        let hold = if part == 0.0 {
            &self.hold
        } else {
            fresh = hold(&self.linear, self.period, part);
            &fresh
        };
        let n = self.states();
        // Torques remembered: u_(k-1) .. u_(k-1-whole), and w.
        let torques = n;
        let memory = n + 2 * (whole + 1);
        let kept: &[usize] = if law.integrates { &[0, 1, 2] } else { &[0, 2] };
        let size = memory + kept.len();
        let mut matrix = DMatrix::zeros(size, size);
        matrix.view_mut((0, 0), (n, n)).copy_from(&hold.phi);

        let held = torques + 2 * whole;
        let (measured, command) = self.rows(law, kept, held, size);
        for (row, i) in kept.iter().enumerate() {
            for column in 0..size {
                matrix[(memory + row, column)] =
                    (0..2).map(|v| law.b[*i][v] * measured[v][column]).sum();
            }
            for (at, j) in kept.iter().enumerate() {
                matrix[(memory + row, memory + at)] += law.a[*i][*j];
            }
        }
        // u_k is remembered, and acts now or later.
        for joint in 0..2 {
            for column in 0..size {
                matrix[(torques + joint, column)] = command[joint][column];
            }
            for older in 0..whole {
                matrix[(
                    torques + 2 * (older + 1) + joint,
                    torques + 2 * older + joint,
                )] = 1.0;
            }
            for row in 0..n {
                if whole == 0 {
                    for column in 0..size {
                        matrix[(row, column)] += hold.late[(row, joint)] * command[joint][column];
                    }
                } else {
                    matrix[(row, torques + 2 * (whole - 1) + joint)] += hold.late[(row, joint)];
                }
                matrix[(row, held + joint)] += hold.early[(row, joint)];
            }
        }
        matrix
    }

    /// The measurement (force, slope rate) and the torques u_k as rows over the closed loop's
    /// state of `size` numbers, in which the torques that are held are at `held` and the
    /// law's memory, of which `kept` is there, is last.
    fn rows(
        &self,
        law: &LinearLaw,
        kept: &[usize],
        held: usize,
        size: usize,
    ) -> ([Vec<f64>; 2], [Vec<f64>; 2]) {
        let (n, memory) = (self.states(), size - kept.len());
        let mut measured = [vec![0.0; size], vec![0.0; size]];
        for v in 0..2 {
            measured[v][..n].copy_from_slice(&self.measure[v]);
            measured[v][held] = self.feed[v][0];
            measured[v][held + 1] = self.feed[v][1];
        }
        let mut command = [vec![0.0; size], vec![0.0; size]];
        for (i, command) in command.iter_mut().enumerate() {
            for v in 0..2 {
                for (c, m) in command.iter_mut().zip(&measured[v]) {
                    *c += law.d[i][v] * m;
                }
            }
            for (at, j) in kept.iter().enumerate() {
                command[memory + at] += law.c[i][*j];
            }
        }
        (measured, command)
    }
}

/// `exp` of `[[a, b], [0, 0]] times`: state to state and torque to state.
fn exponential(linear: &Linear, time: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let n = linear.a.nrows();
    let mut matrix = DMatrix::zeros(n + 2, n + 2);
    matrix.view_mut((0, 0), (n, n)).copy_from(&linear.a);
    matrix.view_mut((0, n), (n, 2)).copy_from(&linear.b);
    let exponential = exp(matrix * time);
    (
        exponential.view((0, 0), (n, n)).into_owned(),
        exponential.view((0, n), (n, 2)).into_owned(),
    )
}

/// Matrix exponential: Taylor's series to degree 15, the matrix halved until its norm is
/// at most a half (the remainder is then below rounding) and the result squared as often.
pub(in crate::analysis) fn exp(matrix: DMatrix<f64>) -> DMatrix<f64> {
    let n = matrix.nrows();
    let norm = matrix
        .column_iter()
        .map(|column| column.iter().map(|x| x.abs()).sum())
        .fold(0.0, f64::max);
    let halvings = libm::log2(norm / 0.5).ceil().max(0.0);
    let first = matrix * libm::exp2(-halvings);
    let second = &first * &first;
    let third = &second * &first;
    let fourth = &second * &second;
    let mut factorial = 1.0;
    let weights: [f64; 16] = core::array::from_fn(|k| {
        factorial *= k.max(1) as f64;
        1.0 / factorial
    });
    let block = |k: usize| {
        let mut sum = &first * weights[k + 1] + &second * weights[k + 2] + &third * weights[k + 3];
        (0..n).for_each(|i| sum[(i, i)] += weights[k]);
        sum
    };
    let mut result = block(12);
    for k in [8, 4, 0] {
        result = result * &fourth + block(k);
    }
    for _ in 0..halvings as u32 {
        result = &result * &result;
    }
    result
}

fn hold(linear: &Linear, period: f64, part: f64) -> Hold {
    if part == 0.0 {
        let (phi, late) = exponential(linear, period);
        let early = DMatrix::zeros(phi.nrows(), 2);
        return Hold { phi, late, early };
    }
    let (before, early) = exponential(linear, part * period);
    let (after, late) = exponential(linear, (1.0 - part) * period);
    Hold {
        phi: &after * before,
        early: &after * early,
        late,
    }
}

//! From a plan to its table image: fits the splines of [`flexor::table`] and measures
//! what the controller will read back.

use crate::planner::plan::{Plan, PlanPoint};
use crate::text::four_digits;
use flexor::signals::{COLUMNS, Reference};
use flexor::table::{
    Header, PIECES_MAX, Piece, Table, TableError, TableWriter, image_bytes, scaling_for,
};

/// Share of a torque's peak that a table may miss the torque by, at most. On the paper's task
/// it is 1e-3 N m and moves the contact force of 2 N by some 2e-3 N. Of 400 random
/// arms with up to 12 elements all but 4 % got tables a hundred times better; one that is worse
/// than this follows a plan that the ticks do not resolve.
pub const TORQUE_SHARE: f64 = 1e-4;

/// Share of a torque's peak that the knots may leave, before rounding to f32. On the paper's
/// task it is 5e-6 N m, which moves the contact force by some 1e-5 N, less than what holding
/// the torque for 200 us costs (2e-5 N).
const KNOT_SHARE: f64 = 5e-7;

/// What a table may miss of the other columns, in units of what its knots may leave. Rounding
/// to f32 takes less than one on the paper's task; an outlier that takes a column's digits
/// takes more.
const SLACK: f64 = 100.0;

/// Segments are at most this long, ticks.
const SPACING_MAX: usize = 512;

/// Pieces are divided no farther than this, ticks.
const PIECE_MIN: usize = 32;

/// A table image and what it is worth.
#[derive(Clone, Debug)]
pub struct EncodedTable {
    /// The image, ready for flash.
    pub image: Vec<u8>,
    /// Largest torque error at any tick as the f32 controller reads it, N m.
    pub torque_error_max_nm: f64,
    /// Largest of both torques' errors as shares of their own peaks ([`task_peaks`]).
    pub torque_error_share: f64,
    /// Largest error of the angles and the root slope, rad.
    pub angle_error_max_rad: f64,
    /// Largest error of the root slope rate, rad/s.
    pub slope_rate_error_max_rad_s: f64,
}

/// Why a plan has no table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TableFitError {
    /// The table would command something else than the plan.
    #[error(
        "the feedforward table reproduces the planned {what} only to {} at t = {t_s:.4} s, {} is accepted (of a torque {TORQUE_SHARE:e} of its peak): the plan is too fast for the control period there; {} or fewer link2.elements make it slower",
        four_digits(*error),
        four_digits(*accepted),
        place.remedy()
    )]
    Inexact {
        /// The column.
        what: &'static str,
        /// Largest error, in the column's unit.
        error: f64,
        /// When, s from the path's start.
        t_s: f64,
        /// Largest error that is accepted.
        accepted: f64,
        /// In which part of the plan.
        place: Place,
    },
    /// The format cannot hold it.
    #[error("the plan does not fit the table format: {0}")]
    Format(#[from] TableError),
}

/// A part of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Its first hundredth.
    Start,
    /// What is between the ends.
    Middle,
    /// Its last hundredth.
    End,
}

impl Place {
    fn of(tick: usize, points: &[PlanPoint]) -> Self {
        let end = end_ticks(points);
        if tick < end {
            Self::Start
        } else if tick + end >= points.len() {
            Self::End
        } else {
            Self::Middle
        }
    }

    /// What makes a plan slower there.
    fn remedy(self) -> &'static str {
        match self {
            Self::Start => "a longer pre_actuation_s, for instance \"auto\",",
            Self::Middle => "a longer duration_s",
            Self::End => "a longer post_actuation_s, for instance \"auto\",",
        }
    }
}

/// Ticks that count as one end of a plan.
fn end_ticks(points: &[PlanPoint]) -> usize {
    points.len().div_ceil(100)
}

/// What a plan's torques (tau1, tau2) are measured by, N m: their largest magnitudes away
/// from the first and the last hundredth of the plan. Layers at the ends that stand out from
/// the task by orders of magnitude do not make errors in its midst look small.
pub fn task_peaks(plan: &Plan) -> [f64; 2] {
    /// A torque that is smaller than this in the other's peaks is rounding.
    const LEAST: f64 = 1e-6;
    let end = end_ticks(&plan.points);
    let inner = plan
        .points
        .get(end..plan.points.len() - end)
        .unwrap_or(&plan.points);
    let peaks = [0, 1].map(|joint| {
        let sizes = inner.iter().map(|point| point.torque[joint].abs());
        sizes.fold(0.0, f64::max)
    });
    peaks.map(|peak: f64| peak.max(LEAST * peaks[0].max(peaks[1])))
}

/// Largest errors that the table's knots may leave, column by column, SI. All change with
/// the units of the task: angles have none, rates that of the path's duration.
fn tolerance(plan: &Plan) -> Reference<f64> {
    Reference {
        torque: task_peaks(plan).map(|peak| KNOT_SHARE * peak),
        force: 1e-6 * plan.task.normal_force.largest(),
        angle: [1e-6, 1e-6],
        root_slope: 1e-6,
        root_slope_rate: 2e-4 / plan.task.path.duration,
        normal_angle: 1e-7,
    }
}

/// What the controller should read at every tick: torques in the middle of the
/// period for which they are held, but the last, which is held after the end, at the end;
/// the rest at the tick.
fn samples(plan: &Plan) -> Vec<[f64; COLUMNS]> {
    let half = 0.5 / f64::from(plan.tick_rate_hz);
    let mut sampler = plan.sampler();
    let normal_angle = plan.normal_angle();
    let held = plan.points.len() - 1;
    plan.points
        .iter()
        .enumerate()
        .map(|(tick, point)| {
            Reference {
                // Past its end a plan is extrapolated, and means nothing.
                torque: if tick < held {
                    sampler.at(point.t + half).torque
                } else {
                    point.torque
                },
                force: point.force.normal,
                angle: point.joint.angle,
                root_slope: point.root_slope,
                root_slope_rate: point.root_slope_rate,
                normal_angle,
            }
            .columns()
        })
        .collect()
}

/// Encodes `plan` with as few knots as keep torques to 5e-7 of their peaks, angles to 1e-6
/// rad and the slope rate to 2e-4 rad in the path's duration, before rounding to f32.
///
/// # Errors
/// [`TableFitError::Inexact`] for a plan that has parts too fast for a table, so that the
/// controller would read torques that are off by more than [`TORQUE_SHARE`] of their peaks,
/// or another column by more than is of no account; [`TableFitError::Format`] if the format
/// could not hold it.
pub fn fit_table(plan: &Plan) -> Result<EncodedTable, TableFitError> {
    let samples = samples(plan);
    let tolerance = tolerance(plan);
    let header = Header {
        arm_fingerprint: plan.model.arm.fingerprint(),
        task_fingerprint: plan.task_fingerprint(),
        tick_rate_hz: plan.tick_rate_hz,
        ticks: plan.ticks,
        first_tick: -(plan.pre_ticks.cast_signed()),
        scaling: [0; COLUMNS],
    };
    let image = write(&samples, &tolerance.columns(), header)?;
    let errors = errors(plan, &image)?;

    let peaks = task_peaks(plan);
    let accepted = Reference {
        torque: peaks.map(|peak| TORQUE_SHARE * peak),
        ..Reference::from_columns(tolerance.columns().map(|t| SLACK * t))
    };
    const WHAT: [&str; COLUMNS] = [
        "torque tau1 (N m)",
        "torque tau2 (N m)",
        "force (N)",
        "angle theta10 (rad)",
        "angle theta20 (rad)",
        "slope at link 2's root (rad)",
        "slope rate at link 2's root (rad/s)",
        "normal's direction (rad)",
    ];
    for (column, accepted) in accepted.columns().into_iter().enumerate() {
        let (error, tick) = errors[column];
        if !(error <= accepted) {
            return Err(TableFitError::Inexact {
                what: WHAT[column],
                error,
                t_s: plan.points[tick].t,
                accepted,
                place: Place::of(tick, &plan.points),
            });
        }
    }
    let worst = Reference::from_columns(errors.map(|(error, _)| error));
    let share = |joint: usize| {
        if worst.torque[joint] > 0.0 {
            worst.torque[joint] / peaks[joint]
        } else {
            0.0
        }
    };
    Ok(EncodedTable {
        image,
        torque_error_max_nm: worst.torque[0].max(worst.torque[1]),
        torque_error_share: share(0).max(share(1)),
        angle_error_max_rad: worst.angle[0].max(worst.angle[1]).max(worst.root_slope),
        slope_rate_error_max_rad_s: worst.root_slope_rate,
    })
}

/// The image of a table that reads as `samples`, one a tick, to `tolerance`; `header` but
/// for its scaling.
fn write(
    samples: &[[f64; COLUMNS]],
    tolerance: &[f64; COLUMNS],
    header: Header,
) -> Result<Vec<u8>, TableError> {
    let last = samples.len() - 1;
    let done = if goes_on(samples, tolerance) {
        divide(samples, tolerance, 0, last, PIECES_MAX)
    } else {
        let mut done = divide(&samples[..last], tolerance, 0, last - 1, PIECES_MAX - 1);
        done.push(Fitted::straight(samples, last - 1));
        done
    };

    let magnitude = |column: usize| {
        let knots = done.iter().flat_map(|piece| &piece.knots);
        knots.map(|k| k[column].abs()).fold(0.0, f64::max)
    };
    let header = Header {
        scaling: core::array::from_fn(|column| scaling_for(magnitude(column))),
        ..header
    };
    let pieces: Vec<_> = done.iter().map(Fitted::piece).collect();
    let mut image = vec![0; image_bytes(&pieces)];
    let mut writer = TableWriter::new(&mut image, &header, &pieces)?;
    for row in done.iter().flat_map(|piece| &piece.knots) {
        writer.row(&Reference::from_columns(*row))?;
    }
    writer.finish()?;
    Ok(image)
}

/// Whether the last sample continues those before it. Torques that change at the plan's end
/// have a kink there, as the last sample comes half a period after the one before it: on the
/// paper's task it would take a knot at every tick around it (5,648 bytes in all), where a piece
/// of its own takes 136 bytes (4,952).
fn goes_on(samples: &[[f64; COLUMNS]], tolerance: &[f64; COLUMNS]) -> bool {
    let Some([before @ .., last]) = samples.last_chunk::<5>() else {
        return true;
    };
    (0..COLUMNS).all(|column| {
        let [continued, _] = cubic(core::array::from_fn(|i| before[i][column]), 4.0);
        (continued - last[column]).abs() <= tolerance[column]
    })
}

/// Largest errors of the columns as the f32 controller reads them, with the ticks where.
///
/// Knows nothing of [`samples`], and does not rest on the plan between its ticks alone: a
/// torque is also wrong by as much as it is outside of what the plan's torques at the ticks
/// around it leave open.
fn errors(plan: &Plan, image: &[u8]) -> Result<[(f64, usize); COLUMNS], TableError> {
    let mut worst = [(0.0, 0); COLUMNS];
    let mut cursor = Table::open(image)?.cursor::<f32>();
    let mut sampler = plan.sampler();
    let normal_angle = plan.normal_angle();
    for (tick, point) in plan.points.iter().enumerate() {
        let planned = Reference {
            torque: match plan.points.get(tick + 1) {
                Some(next) => sampler.at(0.5 * (point.t + next.t)).torque,
                None => point.torque,
            },
            force: point.force.normal,
            angle: point.joint.angle,
            root_slope: point.root_slope,
            root_slope_rate: point.root_slope_rate,
            normal_angle,
        };
        let read = cursor.row().columns().map(f64::from);
        for (column, planned) in planned.columns().into_iter().enumerate() {
            let mut error = (read[column] - planned).abs();
            if column < 2 {
                error = error.max(outside(&plan.points, tick, column, read[column]));
            }
            if error.is_nan() {
                error = f64::INFINITY;
            }
            if error > worst[column].0 {
                worst[column] = (error, tick);
            }
        }
        cursor.advance();
    }
    Ok(worst)
}

/// How far a joint's `torque` for the period from `tick` is outside of what the plan's torques
/// at the ticks around leave open: their range from one before the period to one after it,
/// widened by their largest second difference. A parabola leaves the range of the period's
/// own ends by an eighth of that at most; plans that are noisy from tick to tick, as those
/// with 11 elements and no post-actuation, leave that by more than [`TORQUE_SHARE`], but not
/// this. The last torque is held at rest and has no room.
fn outside(points: &[PlanPoint], tick: usize, joint: usize, torque: f64) -> f64 {
    let last = points.len() - 1;
    let at = |tick: usize| points[tick.min(last)].torque[joint];
    if tick >= last {
        return (torque - at(last)).abs();
    }
    let around: [f64; 6] = core::array::from_fn(|i| at((tick + i).saturating_sub(2)));
    let bends = around.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs());
    let bend = bends.fold(0.0, f64::max);
    let range = &around[1..5];
    let least = range.iter().copied().fold(f64::INFINITY, f64::min);
    let most = range.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (least - bend - torque).max(torque - most - bend)
}

/// The stretch of `ticks` from `start` as one piece, or as the pieces of its halves, up
/// to `most` in all, where those have fewer rows together.
fn divide(
    samples: &[[f64; COLUMNS]],
    tolerance: &[f64; COLUMNS],
    start: usize,
    ticks: usize,
    most: usize,
) -> Vec<Fitted> {
    let whole = Fitted::new(samples, tolerance, start, ticks);
    // Two pieces have at least eight rows.
    if most < 2 || ticks < 2 * PIECE_MIN || whole.knots.len() <= 8 {
        return vec![whole];
    }
    let half = ticks / 2;
    let mut halves = divide(samples, tolerance, start, half, most - 1);
    halves.extend(divide(
        samples,
        tolerance,
        start + half,
        ticks - half,
        most - halves.len(),
    ));
    if halves.iter().map(|piece| piece.knots.len()).sum::<usize>() < whole.knots.len() {
        halves
    } else {
        vec![whole]
    }
}

/// A piece with its knots.
struct Fitted {
    /// First tick.
    start: usize,
    ticks: usize,
    knots: Vec<[f64; COLUMNS]>,
}

impl Fitted {
    /// The piece of `ticks` control periods from tick `start`, with few knots within
    /// the tolerance.
    fn new(
        samples: &[[f64; COLUMNS]],
        tolerance: &[f64; COLUMNS],
        start: usize,
        ticks: usize,
    ) -> Self {
        let mut segments = ticks.div_ceil(SPACING_MAX);
        loop {
            let fitted = Self {
                start,
                ticks,
                knots: fit(samples, start, ticks, segments),
            };
            if segments >= ticks || fitted.fits(samples, tolerance) {
                return fitted;
            }
            // The error falls with the fourth power of the number.
            segments = (segments + segments.div_ceil(4)).min(ticks);
        }
    }

    /// The period from `start` to the next tick, straight.
    fn straight(samples: &[[f64; COLUMNS]], start: usize) -> Self {
        let knot = |i: usize| {
            let at = i as f64 - 1.0;
            core::array::from_fn(|column| {
                let [from, to] = [samples[start][column], samples[start + 1][column]];
                from + at * (to - from)
            })
        };
        Self {
            start,
            ticks: 1,
            knots: (0..4).map(knot).collect(),
        }
    }

    fn piece(&self) -> Piece {
        Piece {
            ticks: self.ticks as u32,
            segments: self.segments() as u32,
        }
    }

    fn segments(&self) -> usize {
        self.knots.len() - 3
    }

    /// The splines' values at a tick of the piece.
    fn value(&self, tick: usize) -> [f64; COLUMNS] {
        let position = tick * self.segments();
        let segment = (position / self.ticks).min(self.segments() - 1);
        let u = (position - segment * self.ticks) as f64 / self.ticks as f64;
        let v = 1.0 - u;
        let basis = [
            v * v * v / 6.0,
            2.0 / 3.0 - u * u * (1.0 - u / 2.0),
            2.0 / 3.0 - v * v * (1.0 - v / 2.0),
            u * u * u / 6.0,
        ];
        core::array::from_fn(|column| {
            (0..4)
                .map(|j| basis[j] * self.knots[segment + j][column])
                .sum()
        })
    }

    /// True when the splines are within the tolerance at some sixteen ticks a segment.
    fn fits(&self, samples: &[[f64; COLUMNS]], tolerance: &[f64; COLUMNS]) -> bool {
        let stride = (self.ticks / self.segments() / 16).max(1);
        let within = |tick: usize| {
            let value = self.value(tick);
            let sample = &samples[self.start + tick];
            (0..COLUMNS).all(|i| (value[i] - sample[i]).abs() <= tolerance[i])
        };
        // From the end, where a layer is likeliest to refuse.
        (0..=self.ticks).rev().step_by(stride).all(within)
    }
}

/// Knots of the interpolating cubic splines with `segments` segments over the `ticks`
/// from `start`, with the samples' slopes at both ends.
fn fit(
    samples: &[[f64; COLUMNS]],
    start: usize,
    ticks: usize,
    segments: usize,
) -> Vec<[f64; COLUMNS]> {
    // Value and slope per tick of the cubic through the four samples around `x`.
    let sample = |x: f64, column: usize| {
        let first = ((x.floor() as usize).saturating_sub(1)).min(samples.len().saturating_sub(4));
        cubic(
            core::array::from_fn(|i| samples[first + i][column]),
            x - first as f64,
        )
    };
    let spacing = ticks as f64 / segments as f64;
    let mut knots = vec![[0.0; COLUMNS]; segments + 3];
    let mut upper = vec![0.0; segments + 1];
    let mut c = vec![0.0; segments + 1];
    for column in 0..COLUMNS {
        // Both pieces that meet at a tick get the same slope there.
        let slope = |tick: usize| {
            let x = tick as f64;
            0.5 * spacing * (sample(x, column)[1] + sample((x - 1e-9).max(0.0), column)[1])
        };
        let slopes = [slope(start), slope(start + ticks)];
        // c[j-1] + 4 c[j] + c[j+1] = 6 y[j], with the outermost knots eliminated by
        // (c[1] - c[-1]) / 2 = slope: tridiagonal, solved by elimination.
        for j in 0..=segments {
            let mut right = 6.0 * sample(start as f64 + j as f64 * spacing, column)[0];
            let (mut below, mut above) = (1.0, 1.0);
            if j == 0 {
                (below, above) = (0.0, 2.0);
                right += 2.0 * slopes[0];
            } else if j == segments {
                (below, above) = (2.0, 0.0);
                right -= 2.0 * slopes[1];
            }
            let before = j.checked_sub(1).map_or((0.0, 0.0), |i| (upper[i], c[i]));
            let pivot = 4.0 - below * before.0;
            upper[j] = above / pivot;
            c[j] = (right - below * before.1) / pivot;
        }
        for j in (0..segments).rev() {
            c[j] -= upper[j] * c[j + 1];
        }
        knots[0][column] = c[1] - 2.0 * slopes[0];
        knots[segments + 2][column] = c[segments - 1] + 2.0 * slopes[1];
        for (knot, c) in knots[1..].iter_mut().zip(&c) {
            knot[column] = *c;
        }
    }
    knots
}

/// Value and derivative at `x` of the cubic through `y` at 0, 1, 2 and 3.
fn cubic(y: [f64; 4], x: f64) -> [f64; 2] {
    let d1 = y[1] - y[0];
    let d2 = y[2] - 2.0 * y[1] + y[0];
    let d3 = y[3] - 3.0 * y[2] + 3.0 * y[1] - y[0];
    [
        y[0] + x * (d1 + (x - 1.0) / 2.0 * (d2 + (x - 2.0) / 3.0 * d3)),
        d1 + (2.0 * x - 1.0) / 2.0 * d2 + (3.0 * x * x - 6.0 * x + 2.0) / 6.0 * d3,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cubics_are_reproduced_exactly(
            c in proptest::array::uniform4(-1.0..1.0_f64),
            before in 0..20_usize,
            ticks in 20..400_usize,
            after in 0..20_usize,
            segments in 1..20_usize,
        ) {
            let last = before + ticks + after;
            let samples: Vec<_> = (0..=last)
                .map(|i| {
                    let x = i as f64 / last as f64;
                    [c[0] + x * (c[1] + x * (c[2] + x * c[3])); COLUMNS]
                })
                .collect();
            let knots = fit(&samples, before, ticks, segments);
            let fitted = Fitted { start: before, ticks, knots };
            for tick in 0..=ticks {
                let error = fitted.value(tick)[0] - samples[before + tick][0];
                prop_assert!(error.abs() < 1e-8, "{tick}: {error:e}");
            }
        }

        /// In other units a table has the same integers and other scalings.
        #[test]
        fn units_change_the_scaling_alone(
            unit in -20..20_i32, ticks in 20..2000_usize, waves in 0.1..5.0_f64, layer in -9.0..9.0_f64,
        ) {
            let encoded = |unit: f64| {
                let value = |tick: usize| {
                    let left = (ticks - tick) as f64;
                    (waves * left / ticks as f64).sin() + layer * (-left).exp()
                };
                let samples: Vec<_> = (0..=ticks).map(|tick| [unit * value(tick); COLUMNS]).collect();
                let header = Header {
                    arm_fingerprint: 1, task_fingerprint: 2, tick_rate_hz: 1000, ticks: ticks as u32, first_tick: 0,
                    scaling: [0; COLUMNS],
                };
                write(&samples, &[unit * 1e-6; COLUMNS], header).unwrap()
            };
            let (here, there) = (encoded(1.0), encoded(2_f64.powi(unit)));
            let scaling = |image: &[u8]| i32::from(Table::open(image).unwrap().header().scaling[0]);
            prop_assert_eq!(scaling(&there), scaling(&here) - unit);
            let rows = flexor::table::HEADER_BYTES;
            prop_assert!(there[rows..] == here[rows..]);
        }
    }
}

//! From a plan to its table image: fits the splines of [`flexor::table`] and measures
//! what the controller will read back.

use crate::planner::plan::Plan;
use flexor::signals::{COLUMNS, Reference};
use flexor::table::{
    Header, PIECES_MAX, Piece, Table, TableError, TableWriter, image_bytes, scaling_for,
};

/// Largest errors that the table's knots may leave, column by column, SI. A torque
/// error of 5e-6 N m moves the contact force by some 1e-5 N, less than what holding
/// the torque for 200 us costs (2e-5 N).
const TOLERANCE: Reference<f64> = Reference {
    torque: [5e-6, 5e-6],
    force: 1e-6,
    angle: [1e-6, 1e-6],
    root_slope: 1e-6,
    root_slope_rate: 1e-4,
    normal_angle: 1e-7,
};

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
    /// Largest error of the angles and the root slope, rad.
    pub angle_error_max_rad: f64,
    /// Largest error of the root slope rate, rad/s.
    pub slope_rate_error_max_rad_s: f64,
}

/// What the controller should read at every tick: torques in the middle of the
/// period for which they are held, the rest at the tick.
fn samples(plan: &Plan) -> Vec<[f64; COLUMNS]> {
    let half = 0.5 / f64::from(plan.tick_rate_hz);
    let mut sampler = plan.sampler();
    let normal_angle = plan.normal_angle();
    plan.points
        .iter()
        .map(|point| {
            Reference {
                torque: sampler.at(point.t + half).torque,
                force: plan.task.normal_force,
                angle: point.joint.angle,
                root_slope: point.root_slope,
                root_slope_rate: point.root_slope_rate,
                normal_angle,
            }
            .columns()
        })
        .collect()
}

/// Encodes `plan` with as few knots as keep torques to 5e-6 N m, angles to 1e-6 rad and
/// the slope rate to 1e-4 rad/s, before rounding to f32.
///
/// # Errors
/// None for a plan of this crate; [`TableError`] if the format could not hold it.
pub fn encode(plan: &Plan) -> Result<EncodedTable, TableError> {
    let samples = samples(plan);
    let done = divide(&samples, 0, samples.len() - 1, PIECES_MAX);

    let magnitude = |column: usize| {
        let knots = done.iter().flat_map(|piece| &piece.knots);
        knots.map(|k| k[column].abs()).fold(0.0, f64::max)
    };
    let header = Header {
        arm_fingerprint: plan.model.arm.fingerprint(),
        tick_rate_hz: plan.tick_rate_hz,
        ticks: plan.ticks,
        first_tick: -(plan.pre_ticks.cast_signed()),
        scaling: core::array::from_fn(|column| scaling_for(magnitude(column))),
    };
    let pieces: Vec<_> = done.iter().map(Fitted::piece).collect();
    let mut image = vec![0; image_bytes(&pieces)];
    let mut writer = TableWriter::new(&mut image, &header, &pieces)?;
    for row in done.iter().flat_map(|piece| &piece.knots) {
        writer.row(&Reference::from_columns(*row))?;
    }
    writer.finish()?;

    let mut worst = [0.0_f64; COLUMNS];
    let mut cursor = Table::open(&image)?.cursor::<f32>();
    for sample in &samples {
        let read = cursor.row().columns();
        for ((worst, read), sample) in worst.iter_mut().zip(read).zip(sample) {
            *worst = worst.max((f64::from(read) - sample).abs());
        }
        cursor.advance();
    }
    let worst = Reference::from_columns(worst);
    Ok(EncodedTable {
        image,
        torque_error_max_nm: worst.torque[0].max(worst.torque[1]),
        angle_error_max_rad: worst.angle[0].max(worst.angle[1]).max(worst.root_slope),
        slope_rate_error_max_rad_s: worst.root_slope_rate,
    })
}

/// The stretch of `ticks` from `start` as one piece, or as the pieces of its halves, up
/// to `most` in all, where those have fewer rows together.
fn divide(samples: &[[f64; COLUMNS]], start: usize, ticks: usize, most: usize) -> Vec<Fitted> {
    let whole = Fitted::new(samples, start, ticks);
    // Two pieces have at least eight rows.
    if most < 2 || ticks < 2 * PIECE_MIN || whole.knots.len() <= 8 {
        return vec![whole];
    }
    let half = ticks / 2;
    let mut halves = divide(samples, start, half, most - 1);
    halves.extend(divide(
        samples,
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
    fn new(samples: &[[f64; COLUMNS]], start: usize, ticks: usize) -> Self {
        let mut segments = ticks.div_ceil(SPACING_MAX);
        loop {
            let fitted = Self {
                start,
                ticks,
                knots: fit(samples, start, ticks, segments),
            };
            if segments >= ticks || fitted.fits(samples) {
                return fitted;
            }
            // The error falls with the fourth power of the number.
            segments = (segments + segments.div_ceil(4)).min(ticks);
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
    fn fits(&self, samples: &[[f64; COLUMNS]]) -> bool {
        let tolerance = TOLERANCE.columns();
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
    }
}

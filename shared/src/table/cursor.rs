//! Streams a table: one [`Setpoint`] a tick, in bounded time and memory.

use super::format::{Piece, Table};
use super::layout::{PIECE_BYTES, ROW_BYTES};
use crate::number::{Constant, Scalar, TableScalar};
use crate::signals::{COLUMNS, Formats, PoseSetpoint, Reference, Setpoint};

/// Table columns of all values.
const COLUMN: Reference<usize> = Reference::from_columns([0, 1, 2, 3, 4, 5, 6, 7]);

/// Streams a table: one [`Setpoint`] a tick, in bounded time and memory.
#[derive(Clone, Debug)]
pub struct Cursor<'a, T: TableScalar> {
    /// The pieces after the current one.
    pieces: &'a [[u8; PIECE_BYTES]],
    /// Rows from the current segment on.
    rows: &'a [[u8; ROW_BYTES]],
    column_scale: [T::ColumnScale; COLUMNS],
    ticks: u32,
    tick: u32,
    piece: Piece,
    /// Segments of the piece after the current one.
    segments_left: u32,
    /// Position in the current segment, in units of a segment divided by the piece's
    /// ticks: an integer, so it never drifts.
    phase: u32,
    /// One such unit.
    phase_unit: T::Reciprocal,
    /// What a law that reads the pose wants beside the columns.
    pose: Option<PoseScale<T>>,
    /// What the law reads, in the current segment.
    segment: Segment<T>,
}

/// How a pose is made of the columns.
#[derive(Clone, Copy, Debug)]
struct PoseScale<T: TableScalar> {
    /// Of theta10, theta20 and the root slope, as terms of motor 2's angle.
    terms: [T::ColumnScale; 3],
    /// Link 2's length: from a sine to a moment arm.
    link2_length: T::Gain,
}

/// The links of a plan at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Links<T> {
    /// theta10 and theta20, rad.
    pub(crate) angle: [T; 2],
    /// What they turn in a tick, rad.
    pub(crate) turn: [T; 2],
    /// Direction of the surface normal, rad.
    pub(crate) normal: T,
}

/// What a law reads of the plan, in one segment.
#[derive(Clone, Copy, Debug, Default)]
struct Segment<T> {
    torque: [Cubic<T>; 2],
    force: Cubic<T>,
    /// Of a pose the angles of the motors; else root slope rate and normal angle.
    own: [Cubic<T>; 2],
    /// Of a pose the moment arm at the segment's begin, and by how much it grows to its end.
    moment_arm: [T; 2],
}

impl<'a> Table<'a> {
    /// A cursor at tick 0, in floating point.
    pub fn cursor<T: TableScalar<Format = ()>>(&self) -> Cursor<'a, T> {
        let mut column_scale = [T::ColumnScale::default(); COLUMNS];
        for (column_scale, scaling) in column_scale.iter_mut().zip(self.header.scaling) {
            // Every scaling fits floating point.
            *column_scale = T::column_scale(scaling, ()).unwrap_or_default();
        }
        self.cursor_with(column_scale)
    }

    /// A cursor at tick 0 that gives each column in its format.
    ///
    /// # Errors
    /// The number of a column whose values may not fit its format.
    pub fn cursor_in<T: TableScalar>(
        &self,
        formats: &Formats<T::Format>,
    ) -> Result<Cursor<'a, T>, usize> {
        let scaling = &self.header.scaling;
        let of = |column: usize, format| T::column_scale(scaling[column], format).ok_or(column);
        let angle = |column: usize| T::angle_column_scale(scaling[column]).ok_or(column);
        let column_scale = Reference {
            torque: [of(0, formats.torque[0])?, of(1, formats.torque[1])?],
            force: of(2, formats.force)?,
            angle: [angle(3)?, angle(4)?],
            root_slope: of(5, formats.root_slope)?,
            root_slope_rate: of(6, formats.slope_rate)?,
            normal_angle: angle(7)?,
        };
        self.terms::<T>().ok_or(COLUMN.root_slope)?;
        Ok(self.cursor_with(column_scale.columns()))
    }

    /// Scales of theta10, theta20 and the root slope as terms of motor 2's angle, if it fits.
    fn terms<T: TableScalar>(&self) -> Option<[T::ColumnScale; 3]> {
        let [theta10, theta20] = COLUMN.angle;
        let scaling = [theta10, theta20, COLUMN.root_slope].map(|i| self.header.scaling[i]);
        // Two bits for the sum of three.
        let common = scaling[0].min(scaling[1]).min(scaling[2]).saturating_sub(2);
        let [a, b, c] = scaling.map(|scaling| T::angle_term_scale(scaling, common));
        Some([a?, b?, c?])
    }

    fn cursor_with<T: TableScalar>(
        &self,
        column_scale: [T::ColumnScale; COLUMNS],
    ) -> Cursor<'a, T> {
        let mut cursor = Cursor {
            pieces: &[],
            rows: &[],
            column_scale,
            ticks: 0,
            tick: 0,
            piece: Piece {
                ticks: 1,
                segments: 1,
            },
            segments_left: 0,
            phase: 0,
            phase_unit: T::reciprocal_of(1),
            pose: None,
            segment: Segment::default(),
        };
        cursor.restart(self);
        cursor
    }
}

impl<'a, T: TableScalar> Cursor<'a, T> {
    /// Goes to the first tick of the table that the cursor was made from.
    pub(crate) fn restart(&mut self, table: &Table<'a>) {
        self.pieces = table.pieces;
        self.rows = table.rows;
        self.ticks = table.header.ticks;
        self.tick = 0;
        self.enter();
    }

    /// The same, to be asked for [`pose`](Self::pose) instead of [`setpoint`](Self::setpoint);
    /// `table` is the one that it was made from, and `link2_length` makes moment arms of sines.
    #[must_use]
    pub fn with_pose(mut self, table: &Table<'a>, link2_length: T::Gain) -> Self {
        self.pose = Some(PoseScale {
            // There are none but where cursor_in() has refused the table.
            terms: table.terms::<T>().unwrap_or_default(),
            link2_length,
        });
        self.restart(table);
        self
    }

    /// Tick that [`setpoint`](Self::setpoint) is for, from 0 to the table's `ticks`.
    pub fn tick(&self) -> u32 {
        self.tick
    }

    /// True on the table's last tick, where the cursor stays.
    pub fn at_end(&self) -> bool {
        self.tick >= self.ticks
    }

    /// Begins the next piece; `rows` must start with it.
    fn enter(&mut self) {
        if let Some((piece, rest)) = self.pieces.split_first() {
            self.piece = Piece::decode(piece);
            self.pieces = rest;
            self.segments_left = self.piece.segments - 1;
            self.phase = 0;
            self.phase_unit = T::reciprocal_of(self.piece.ticks);
        }
        self.load();
    }

    /// Begins the segment whose rows come first.
    #[inline]
    fn load(&mut self) {
        // open() has made sure that every piece has its rows, so there are four here.
        if let Some(rows) = self.rows.first_chunk() {
            let cubic = |column: usize| Cubic::of(rows, column, self.column_scale[column]);
            self.segment.torque[0] = cubic(COLUMN.torque[0]);
            self.segment.torque[1] = cubic(COLUMN.torque[1]);
            self.segment.force = cubic(COLUMN.force);
            if let Some(pose) = &self.pose {
                self.segment.own = [cubic(COLUMN.angle[0]), pose.motor2(rows)];
                self.segment.moment_arm = pose.moment_arm(rows, &self.column_scale);
            } else {
                self.segment.own = [cubic(COLUMN.root_slope_rate), cubic(COLUMN.normal_angle)];
            }
        }
    }

    /// Goes on by one tick; stays at the end.
    #[inline]
    pub fn advance(&mut self) {
        let phase = self.phase + self.piece.segments;
        if phase < self.piece.ticks {
            self.phase = phase;
            self.tick += 1;
        } else {
            self.leave_segment(phase);
        }
    }

    /// Goes on to a tick in the next segment, `phase` after the current one's begin.
    #[cold]
    #[inline(never)]
    fn leave_segment(&mut self, phase: u32) {
        if self.at_end() {
            return;
        }
        self.tick += 1;
        self.phase = phase;
        if self.segments_left > 0 {
            self.segments_left -= 1;
            self.phase -= self.piece.ticks;
            self.rows = self.rows.get(1..).unwrap_or_default();
            self.load();
        } else if !self.pieces.is_empty() {
            self.rows = self.rows.get(4..).unwrap_or_default();
            self.enter();
        }
        // Else the very last segment is closed: its phase is the whole.
    }

    /// Position in the segment `part` of a tick after the current one. Where the next tick is in
    /// the next segment it goes no farther than this one's end.
    #[cold]
    fn between(&self, part: u32) -> T {
        let next = (self.phase + self.piece.segments).min(self.piece.ticks);
        let [here, there] = [self.phase, next].map(|phase| T::fraction(phase, self.phase_unit));
        let share = T::fraction(part, T::reciprocal_of(1 << 16));
        let step = there.minus_in_range(here).times_in_range::<1>(share);
        here.plus_in_range(step)
    }

    /// A column's value at the current tick.
    #[inline]
    fn value(&self, cubic: &Cubic<T>, column: usize, u: T) -> T {
        T::from_spline(cubic.at(u), self.column_scale[column])
    }

    /// What the paper's control law reads of the plan at the current tick.
    #[inline]
    pub fn setpoint(&self) -> Setpoint<T> {
        let u = T::fraction(self.phase, self.phase_unit);
        let segment = &self.segment;
        Setpoint {
            torque: [0, 1].map(|i| self.value(&segment.torque[i], COLUMN.torque[i], u)),
            force: self.value(&segment.force, COLUMN.force, u),
            root_slope_rate: self.value(&segment.own[0], COLUMN.root_slope_rate, u),
            normal_angle: self.value(&segment.own[1], COLUMN.normal_angle, u),
        }
    }

    /// Position in the segment `part` of a tick, in units of 2^-16, after the current one.
    #[inline]
    fn position(&self, part: u32) -> T {
        if part == 0 {
            T::fraction(self.phase, self.phase_unit)
        } else {
            self.between(part)
        }
    }

    /// What the hybrid control law reads of it, of a cursor [`with_pose`](Self::with_pose), `part`
    /// of a tick, in units of 2^-16, after the current one.
    ///
    /// The moment arm is exact at the ends of a segment and goes straight between them: over a
    /// segment in which link 2 turns by `a` rad it is off by a^2 / 8 of the link at most.
    #[inline]
    pub fn pose(&self, part: u32) -> PoseSetpoint<T> {
        let u = self.position(part);
        let segment = &self.segment;
        let [motor1, motor2] = &segment.own;
        // The terms of motor 2's angle have one scale.
        let terms = self.pose.as_ref().map(|pose| pose.terms[0]);
        let [begin, growth] = segment.moment_arm;
        PoseSetpoint {
            torque: [0, 1].map(|i| self.value(&segment.torque[i], COLUMN.torque[i], u)),
            force: self.value(&segment.force, COLUMN.force, u),
            motor: [
                self.value(motor1, COLUMN.angle[0], u),
                T::from_spline(motor2.at(u), terms.unwrap_or_default()),
            ],
            moment_arm: begin.plus_in_range(growth.times_in_range::<1>(u)),
        }
    }

    /// Direction of the surface normal where [`pose`](Self::pose) is, rad. Read anew from the
    /// table: few ticks want it.
    #[cold]
    pub(crate) fn normal_angle(&self, part: u32) -> T {
        let Some(rows) = self.rows.first_chunk() else {
            return T::ZERO;
        };
        let [normal] = self.values(rows, [COLUMN.normal_angle], self.position(part));
        normal
    }

    /// Where the links are, and what they turn in a tick at full speed, where
    /// [`pose`](Self::pose) is. Read anew from the table: few ticks want it.
    #[cold]
    pub(crate) fn links(&self, part: u32) -> Links<T> {
        let Some(rows) = self.rows.first_chunk() else {
            return Links::default();
        };
        let u = self.position(part);
        let [theta10, theta20] = COLUMN.angle;
        let columns = [theta10, theta20, COLUMN.normal_angle];
        let [angle1, angle2, normal] = self.values(rows, columns, u);
        Links {
            angle: [angle1, angle2],
            turn: self.turns(rows, u),
            normal,
        }
    }

    /// What the links turn in a tick at full speed, rad, where [`pose`](Self::pose) is.
    #[cold]
    pub(crate) fn turn(&self, part: u32) -> [T; 2] {
        match self.rows.first_chunk() {
            Some(rows) => self.turns(rows, self.position(part)),
            None => [T::ZERO; 2],
        }
    }

    /// The same at a position in the segment that begins with these rows.
    fn turns(&self, rows: &[[u8; ROW_BYTES]; 4], u: T) -> [T; 2] {
        let tick = T::fraction(self.piece.segments, self.phase_unit);
        COLUMN.angle.map(|column| {
            let scale = self.column_scale[column];
            let points = Cubic::points(rows, column, scale);
            let slope = Cubic::slope(points, u).times_in_range::<1>(tick);
            T::from_spline(slope, scale)
        })
    }

    /// Columns at a position in the segment that begins with these rows.
    fn values<const N: usize>(
        &self,
        rows: &[[u8; ROW_BYTES]; 4],
        columns: [usize; N],
        u: T,
    ) -> [T; N] {
        columns.map(|column| {
            let cubic = Cubic::of(rows, column, self.column_scale[column]);
            self.value(&cubic, column, u)
        })
    }

    /// All of the plan's values at the current tick: what a tick of the controller reads
    /// is less, see [`setpoint`](Self::setpoint) and [`pose`](Self::pose).
    pub fn row(&self) -> Reference<T> {
        let Some(rows) = self.rows.first_chunk() else {
            return Reference::default();
        };
        let u = T::fraction(self.phase, self.phase_unit);
        Reference::from_columns(core::array::from_fn(|column| {
            let column_scale = self.column_scale[column];
            T::from_spline(Cubic::of(rows, column, column_scale).at(u), column_scale)
        }))
    }
}

impl<T: TableScalar> PoseScale<T> {
    /// Motor 2's angle, `theta20 - theta10 + w'(0)`, in the segment that begins with these rows.
    #[inline]
    fn motor2(&self, rows: &[[u8; ROW_BYTES]; 4]) -> Cubic<T> {
        let [theta10, theta20] = COLUMN.angle;
        let points: [[T; 4]; 3] = [0, 1, 2].map(|term| {
            let column = [theta10, theta20, COLUMN.root_slope][term];
            Cubic::points(rows, column, self.terms[term])
        });
        Cubic::through([0, 1, 2, 3].map(|row| {
            let [theta10, theta20, slope] = points.map(|of_row| of_row[row]);
            theta20.minus_in_range(theta10).plus_in_range(slope)
        }))
    }

    /// Moment arm, `r2 sin(psi - theta20)`, at the begin of the segment that begins with these
    /// rows, and by how much it grows to its end.
    #[inline]
    fn moment_arm(
        &self,
        rows: &[[u8; ROW_BYTES]; 4],
        column_scale: &[T::ColumnScale; COLUMNS],
    ) -> [T; 2] {
        let ends = |column: usize| {
            let scale = column_scale[column];
            let points = Cubic::points(rows, column, scale);
            Cubic::ends(points).map(|end| T::from_spline(end, scale))
        };
        let (normal, theta20) = (ends(COLUMN.normal_angle), ends(COLUMN.angle[1]));
        // Its format holds both links' lengths together.
        let count = &mut T::SaturationCount::default();
        let [begin, end] = [0, 1].map(|i| {
            let sine = normal[i].angle_minus(theta20[i]).sine();
            sine.scaled(self.link2_length, count)
        });
        [begin, end.minus(begin, count)]
    }
}

/// A column in one segment: coefficients of 1, u, u^2, u^3.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cubic<T>([T; 4]);

impl<T: TableScalar> Cubic<T> {
    /// A column in the segment that begins with the first of these rows.
    #[inline]
    fn of(rows: &[[u8; ROW_BYTES]; 4], column: usize, column_scale: T::ColumnScale) -> Self {
        Self::through(Self::points(rows, column, column_scale))
    }

    /// Its control points.
    #[inline]
    fn points(rows: &[[u8; ROW_BYTES]; 4], column: usize, column_scale: T::ColumnScale) -> [T; 4] {
        rows.each_ref().map(|row| {
            let (words, _) = row.as_chunks::<4>();
            let raw = words.get(column).copied().unwrap_or_default();
            T::control_point(i32::from_le_bytes(raw), column_scale)
        })
    }
}

impl<T: Scalar> Cubic<T> {
    /// The uniform cubic B-spline's segment with four control points. With those up to K in
    /// magnitude no intermediate value, here or in [`at`](Self::at), exceeds 4.4 K.
    #[inline]
    fn through([a, b, c, d]: [T; 4]) -> Self {
        let sixth = T::constant(const { Constant::new(1.0 / 6.0, 0) });
        let steps = [
            b.minus_in_range(a),
            c.minus_in_range(b),
            d.minus_in_range(c),
        ];
        let bend = steps[1].minus_in_range(steps[0]);
        let bend_sixth = bend.times_in_range::<1>(sixth);
        let next_sixth = steps[2].minus_in_range(steps[1]).times_in_range::<1>(sixth);
        Self([
            b.plus_in_range(bend_sixth),
            c.minus_in_range(a).half(),
            bend.half(),
            next_sixth.minus_in_range(bend_sixth),
        ])
    }

    /// Values at 0 and 1 of the segment with these control points.
    #[inline]
    fn ends([a, b, c, d]: [T; 4]) -> [T; 2] {
        let sixth = T::constant(const { Constant::new(1.0 / 6.0, 0) });
        [[a, b, c], [b, c, d]].map(|[before, here, after]| {
            let steps = [here.minus_in_range(before), after.minus_in_range(here)];
            let bend = steps[1].minus_in_range(steps[0]);
            here.plus_in_range(bend.times_in_range::<1>(sixth))
        })
    }

    /// Growth a segment of the B-spline with these control points, at `u` in [0, 1]: the quadratic
    /// B-spline of their differences, so that with points up to K no intermediate value exceeds 4 K.
    fn slope([a, b, c, d]: [T; 4], u: T) -> T {
        let steps = [
            b.minus_in_range(a),
            c.minus_in_range(b),
            d.minus_in_range(c),
        ];
        let bend = steps[1].minus_in_range(steps[0]);
        let next = steps[2].minus_in_range(steps[1]);
        let more = next.half().minus_in_range(bend.half());
        let begin = steps[0].plus_in_range(bend.half());
        let grown = bend.plus_in_range(more.times_in_range::<1>(u));
        begin.plus_in_range(grown.times_in_range::<1>(u))
    }

    /// Value at `u` in [0, 1].
    #[inline]
    fn at(&self, u: T) -> T {
        let [c0, c1, c2, c3] = self.0;
        let sum = c2.plus_in_range(c3.times_in_range::<1>(u));
        let sum = c1.plus_in_range(sum.times_in_range::<1>(u));
        c0.plus_in_range(sum.times_in_range::<1>(u))
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::RAW_MAX;
    use super::*;
    use crate::number::SiScalar;
    use crate::number::fixed::{Exponent, Fixed};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_cubic_is_the_b_spline_in_every_number_type(
            raw in proptest::array::uniform4(-RAW_MAX..=RAW_MAX),
            part in 0..=1000_u32,
        ) {
            let u = f64::from(part) / 1000.0;
            let v = 1.0 - u;
            let basis = [
                v * v * v / 6.0,
                2.0 / 3.0 - u * u * (1.0 - u / 2.0),
                2.0 / 3.0 - v * v * (1.0 - v / 2.0),
                u * u * u / 6.0,
            ];
            let exact: f64 = basis.iter().zip(raw).map(|(b, k)| b * f64::from(k)).sum();
            let exact = exact / f64::from(RAW_MAX);
            fn read<T: TableScalar>(raw: [i32; 4], part: u32, format: T::Format) -> f64 {
                let column_scale = T::column_scale(30, format).unwrap();
                let cubic = Cubic::through(raw.map(|k| T::control_point(k, column_scale)));
                let u = T::fraction(part, T::reciprocal_of(1000));
                T::from_spline(cubic.at(u), column_scale).to_si(format)
            }
            prop_assert!((read::<f64>(raw, part, ()) - exact).abs() < 1e-14);
            prop_assert!((read::<f32>(raw, part, ()) - exact).abs() < 1e-6);
            let scale = Fixed::angle_column_scale(30).unwrap();
            let cubic = Cubic::through(raw.map(|k| Fixed::control_point(k, scale)));
            let u = Fixed::fraction(part, Fixed::reciprocal_of(1000));
            let error = Fixed::from_spline(cubic.at(u), scale).to_rad() - exact;
            prop_assert!(error.abs() < 6e-8, "angle: {error:e}");
            // 16 units of the control points' 2^-28 and, of coarser formats, one of their own.
            for exponent in [1, 2, 3, 6] {
                let format = Exponent(exponent);
                let error = read::<Fixed>(raw, part, format) - exact;
                prop_assert!(error.abs() < 6e-8 + 16.0 * format.unit(), "{exponent}: {error:e}");
            }
        }
    }
}

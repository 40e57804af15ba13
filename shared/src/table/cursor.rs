//! Streams a table: one [`Reference`] a tick, in bounded time and memory.

use super::format::{PIECE_BYTES, Piece, ROW_BYTES, Table};
use crate::number::{Constant, Scalar};
use crate::signals::{COLUMNS, Reference};

/// Columns whose cubics a cursor keeps: those that the control law reads. The others are
/// for logs and made when they are asked for (see [`Cursor::reference`]).
const KEPT: [usize; 5] = [0, 1, 2, 6, 7];

/// Streams a table: one [`Reference`] a tick, in bounded time and memory.
#[derive(Clone, Debug)]
pub struct Cursor<'a, T: Scalar> {
    /// The pieces after the current one.
    pieces: &'a [[u8; PIECE_BYTES]],
    /// Rows from the current segment on.
    rows: &'a [[u8; ROW_BYTES]],
    quantum: [T::Quantum; COLUMNS],
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
    /// The [`KEPT`] columns in the current segment.
    cubics: [Cubic<T>; KEPT.len()],
}

impl<'a> Table<'a> {
    /// A cursor at tick 0, in floating point.
    pub fn cursor<T: Scalar<Format = ()>>(&self) -> Cursor<'a, T> {
        let mut quantum = [T::Quantum::default(); COLUMNS];
        for (quantum, scaling) in quantum.iter_mut().zip(self.header.scaling) {
            // Every scaling fits floating point.
            *quantum = T::quantum(scaling, ()).unwrap_or_default();
        }
        self.cursor_with(quantum)
    }

    /// A cursor at tick 0 that gives each column in its format.
    ///
    /// # Errors
    /// The number of a column whose values may not fit its format.
    pub fn cursor_in<T: Scalar>(
        &self,
        formats: &Reference<T::Format>,
    ) -> Result<Cursor<'a, T>, usize> {
        let mut quantum = [T::Quantum::default(); COLUMNS];
        for (i, format) in formats.columns().into_iter().enumerate() {
            quantum[i] = T::quantum(self.header.scaling[i], format).ok_or(i)?;
        }
        Ok(self.cursor_with(quantum))
    }

    fn cursor_with<T: Scalar>(&self, quantum: [T::Quantum; COLUMNS]) -> Cursor<'a, T> {
        let mut cursor = Cursor {
            pieces: &[],
            rows: &[],
            quantum,
            ticks: 0,
            tick: 0,
            piece: Piece {
                ticks: 1,
                segments: 1,
            },
            segments_left: 0,
            phase: 0,
            phase_unit: T::reciprocal_of(1),
            cubics: [Cubic::default(); KEPT.len()],
        };
        cursor.restart(self);
        cursor
    }
}

impl<'a, T: Scalar> Cursor<'a, T> {
    /// Goes to the first tick of the table that the cursor was made from.
    pub(crate) fn restart(&mut self, table: &Table<'a>) {
        self.pieces = table.pieces;
        self.rows = table.rows;
        self.ticks = table.header.ticks;
        self.tick = 0;
        self.enter();
    }

    /// Tick that [`reference`](Self::reference) is for, from 0 to the table's `ticks`.
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
    #[inline(never)]
    fn load(&mut self) {
        for (position, column) in KEPT.into_iter().enumerate() {
            self.cubics[position] = self.cubic(column);
        }
    }

    /// A column in the current segment.
    #[inline(always)]
    fn cubic(&self, column: usize) -> Cubic<T> {
        // open() has made sure that every piece has its rows, so there are four here.
        let Some(window) = self.rows.first_chunk::<4>() else {
            return Cubic::default();
        };
        let quantum = self.quantum[column];
        // Row by row: a loop that the compiler keeps would be run for nobody, too.
        let [a, b, c, d] = window;
        Cubic::through([
            knot(a, column, quantum),
            knot(b, column, quantum),
            knot(c, column, quantum),
            knot(d, column, quantum),
        ])
    }

    /// Goes on by one tick; stays at the end.
    #[inline]
    pub fn advance(&mut self) {
        if self.at_end() {
            return;
        }
        self.tick += 1;
        self.phase += self.piece.segments;
        if self.phase < self.piece.ticks {
            return;
        }
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

    /// The plan's values at the current tick.
    // Always inlined: a caller that does not use all columns then does not pay for them.
    #[inline(always)]
    pub fn reference(&self) -> Reference<T> {
        let u = T::fraction(self.phase, self.phase_unit);
        // Not by a loop over the columns, nor by closures, which the compiler may leave as
        // functions: unused columns would not fall away.
        Reference {
            torque: [self.kept(0, u), self.kept(1, u)],
            force: self.kept(2, u),
            angle: [self.made(3, u), self.made(4, u)],
            root_slope: self.made(5, u),
            root_slope_rate: self.kept(3, u),
            normal_angle: self.kept(4, u),
        }
    }

    /// Value of the kept column at a position of [`KEPT`].
    #[inline(always)]
    fn kept(&self, at: usize, u: T) -> T {
        self.cubics[at].at(u).spline_signal(self.quantum[KEPT[at]])
    }

    /// Value of a column that is not kept.
    #[inline(always)]
    fn made(&self, column: usize, u: T) -> T {
        self.cubic(column).at(u).spline_signal(self.quantum[column])
    }
}

/// A row's knot in a column.
#[inline(always)]
fn knot<T: Scalar>(row: &[u8; ROW_BYTES], column: usize, quantum: T::Quantum) -> T {
    let (raw, _) = row.as_chunks::<4>();
    let raw = raw.get(column).map_or([0; 4], |bytes| *bytes);
    T::knot(i32::from_le_bytes(raw), quantum)
}

/// A column in one segment: coefficients of 1, u, u^2, u^3.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cubic<T>([T; 4]);

impl<T: Scalar> Cubic<T> {
    /// The uniform cubic B-spline's segment with four knots. With knots up to K in
    /// magnitude no intermediate value, here or in [`at`](Self::at), exceeds 4.4 K.
    #[inline(always)]
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

    /// Value at `u` in [0, 1].
    #[inline(always)]
    fn at(&self, u: T) -> T {
        let [c0, c1, c2, c3] = self.0;
        let sum = c2.plus_in_range(c3.times_in_range::<1>(u));
        let sum = c1.plus_in_range(sum.times_in_range::<1>(u));
        c0.plus_in_range(sum.times_in_range::<1>(u))
    }
}

#[cfg(test)]
mod tests {
    use super::super::format::RAW_MAX;
    use super::*;
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
            fn read<T: Scalar>(raw: [i32; 4], part: u32, format: T::Format) -> f64 {
                let quantum = T::quantum(30, format).unwrap();
                let cubic = Cubic::through(raw.map(|k| T::knot(k, quantum)));
                let u = T::fraction(part, T::reciprocal_of(1000));
                cubic.at(u).spline_signal(quantum).to_si(format)
            }
            prop_assert!((read::<f64>(raw, part, ()) - exact).abs() < 1e-14);
            prop_assert!((read::<f32>(raw, part, ()) - exact).abs() < 1e-6);
            // 16 units of the knots' 2^-28 and, of coarser formats, one of their own.
            for exponent in [1, 2, 3, 6] {
                let format = Exponent(exponent);
                let error = read::<Fixed>(raw, part, format) - exact;
                prop_assert!(error.abs() < 6e-8 + 16.0 * format.unit(), "{exponent}: {error:e}");
            }
        }
    }
}

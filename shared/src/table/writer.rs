//! Writes a table's image, row by row.

use crate::number::Real;
use crate::signals::{COLUMNS, Reference};
use crate::table::error::TableError;
use crate::table::format::{CRC_OFFSET, Header, Layout, Piece, TASK_OFFSET, checksum};
use crate::table::layout::{HEADER_BYTES, MAGIC, PIECE_BYTES, RAW_MAX, ROW_BYTES, VERSION};

/// Length in bytes of an image with these pieces.
pub fn image_bytes(pieces: &[Piece]) -> usize {
    let rows: usize = pieces.iter().map(|p| p.rows() as usize).sum();
    HEADER_BYTES + pieces.len() * PIECE_BYTES + rows * ROW_BYTES
}

/// Binary exponent with which values up to `magnitude` fill the stored integers:
/// the largest `s` within i8 for which `magnitude * 2^s <= RAW_MAX`.
pub fn scaling_for(magnitude: f64) -> i8 {
    let mut scaling = 60_i8;
    while scaling > -60 && magnitude * libm::ldexp(1.0, i32::from(scaling)) > f64::from(RAW_MAX) {
        scaling -= 1;
    }
    scaling
}

/// Writes a table image into a buffer, row by row.
///
/// ```
/// use flexor::model::ArmParameters;
/// use flexor::signals::Reference;
/// use flexor::table::{Header, Piece, Table, TableWriter, image_bytes, scaling_for};
///
/// // Ten ticks of constant torques. One spline segment has four knots; equal ones are a
/// // constant.
/// let pieces = [Piece { ticks: 10, segments: 1 }];
/// let header = Header {
///     arm_fingerprint: ArmParameters::PAPER.fingerprint(),
///     // Of what was planned: the planner's business.
///     task_fingerprint: 0,
///     tick_rate_hz: 1000,
///     ticks: 10,
///     first_tick: 0,
///     scaling: [scaling_for(5.0); 8],
/// };
/// let mut image = vec![0; image_bytes(&pieces)];
/// let mut writer = TableWriter::new(&mut image, &header, &pieces)?;
/// for _ in 0..pieces[0].rows() {
///     writer.row(&Reference { torque: [5.0, -0.5], ..Reference::default() })?;
/// }
/// writer.finish()?;
///
/// assert_eq!(Table::open(&image)?.header(), &header);
/// # Ok::<(), flexor::table::TableError>(())
/// ```
#[derive(Debug)]
pub struct TableWriter<'b> {
    buffer: &'b mut [u8],
    scaling: [i8; COLUMNS],
    /// Rows that belong to the pieces.
    rows: u32,
    next: usize,
}

impl<'b> TableWriter<'b> {
    /// Starts a table in `buffer`, whose length must be exactly [`image_bytes`] of the
    /// pieces.
    ///
    /// # Errors
    /// [`TableError::Length`] for another length, [`TableError::Field`] for a header
    /// or pieces that no reader would accept.
    pub fn new(
        buffer: &'b mut [u8],
        header: &Header,
        pieces: &[Piece],
    ) -> Result<Self, TableError> {
        if buffer.len() != image_bytes(pieces) {
            return Err(TableError::Length {
                expected: image_bytes(pieces),
                found: buffer.len(),
            });
        }
        let rows: u32 = pieces.iter().map(Piece::rows).sum();
        let mut at = 0;
        let mut put = |field: &[u8]| {
            buffer[at..at + field.len()].copy_from_slice(field);
            at += field.len();
        };
        put(&MAGIC);
        put(&VERSION.to_le_bytes());
        put(&(pieces.len().min(usize::from(u16::MAX)) as u16).to_le_bytes());
        put(&header.arm_fingerprint.to_le_bytes());
        put(&header.tick_rate_hz.to_le_bytes());
        put(&header.ticks.to_le_bytes());
        put(&header.first_tick.to_le_bytes());
        put(&rows.to_le_bytes());
        put(&(COLUMNS as u32).to_le_bytes());
        put(&header.scaling.map(i8::cast_unsigned));
        put(&(image_bytes(pieces) as u32).to_le_bytes());
        put(&[0; 4]); // the CRC's place
        put(&header.task_fingerprint.to_le_bytes());
        for piece in pieces {
            put(&piece.encode());
        }
        let next = at;
        Layout::decode(buffer)?;
        Ok(Self {
            buffer,
            scaling: header.scaling,
            rows,
            next,
        })
    }

    /// Appends a row of knots, in SI units. Values beyond the column's scaling
    /// saturate; [`scaling_for`] the largest magnitude prevents that.
    ///
    /// # Errors
    /// [`TableError::Field`] "rows" when the table is full already.
    pub fn row(&mut self, knots: &Reference<f64>) -> Result<(), TableError> {
        let error = self.wrong_rows(1);
        let row = self
            .buffer
            .get_mut(self.next..self.next + ROW_BYTES)
            .ok_or(error)?;
        let columns = knots.columns().into_iter().zip(self.scaling);
        for (bytes, (value, scaling)) in row.chunks_exact_mut(4).zip(columns) {
            let scaled = value * libm::ldexp(1.0, i32::from(scaling));
            let limit = f64::from(RAW_MAX);
            let raw = libm::rint(scaled).limited(-limit, limit) as i32;
            bytes.copy_from_slice(&raw.to_le_bytes());
        }
        self.next += ROW_BYTES;
        Ok(())
    }

    /// The error for `more` rows than have been written.
    fn wrong_rows(&self, more: i64) -> TableError {
        let missing = (self.buffer.len() - self.next) / ROW_BYTES;
        let rows = i64::from(self.rows);
        TableError::Field {
            name: "rows",
            found: rows - missing as i64 + more,
            accepted: [rows; 2],
        }
    }

    /// Completes the table with its checksum.
    ///
    /// # Errors
    /// [`TableError::Field`] "rows" when rows are missing.
    pub fn finish(self) -> Result<(), TableError> {
        if self.next != self.buffer.len() {
            return Err(self.wrong_rows(0));
        }
        let crc = checksum(self.buffer);
        self.buffer[CRC_OFFSET..TASK_OFFSET].copy_from_slice(&crc.to_le_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIECES: [Piece; 2] = [
        Piece {
            ticks: 31,
            segments: 9,
        },
        Piece {
            ticks: 7,
            segments: 1,
        },
    ];
    const ROWS: usize = 12 + 4;
    const LENGTH: usize = HEADER_BYTES + 2 * PIECE_BYTES + ROWS * ROW_BYTES;
    const HEADER: Header = Header {
        arm_fingerprint: 7,
        task_fingerprint: 9,
        tick_rate_hz: 5000,
        ticks: 38,
        first_tick: -3,
        scaling: [20; COLUMNS],
    };

    #[test]
    fn pieces_that_do_not_add_up_are_refused() {
        let mut buffer = [0; LENGTH];
        let wrong = Header {
            ticks: 39,
            ..HEADER
        };
        let error = TableWriter::new(&mut buffer, &wrong, &PIECES).unwrap_err();
        let expected = TableError::Field {
            name: "ticks of all pieces",
            found: 38,
            accepted: [39, 39],
        };
        assert_eq!(error, expected);
        let mut pieces = PIECES;
        pieces[1].segments = 0;
        pieces[0].segments = 10;
        let error = TableWriter::new(&mut buffer, &HEADER, &pieces).unwrap_err();
        let expected = TableError::Field {
            name: "segments of a piece",
            found: 0,
            accepted: [1, 7],
        };
        assert_eq!(error, expected);
    }

    #[test]
    fn the_writer_wants_exactly_its_rows() {
        let mut buffer = [0; LENGTH];
        assert!(TableWriter::new(&mut buffer[1..], &HEADER, &PIECES).is_err());
        let mut writer = TableWriter::new(&mut buffer, &HEADER, &PIECES).unwrap();
        for _ in 0..ROWS {
            writer.row(&Reference::default()).unwrap();
        }
        assert!(writer.row(&Reference::default()).is_err());
        let writer = TableWriter::new(&mut buffer, &HEADER, &PIECES).unwrap();
        assert!(writer.finish().is_err());
    }

    #[test]
    fn scaling_fills_the_integers() {
        for magnitude in [1e-12, 0.3, 1.0, 11.0, 1e9, 1e12] {
            let raw = magnitude * libm::ldexp(1.0, i32::from(scaling_for(magnitude)));
            assert!(raw <= f64::from(RAW_MAX), "{magnitude}: {raw}");
            assert!(raw > f64::from(RAW_MAX) / 2.0 || scaling_for(magnitude) == 60);
        }
        assert_eq!(scaling_for(0.0), 60);
    }
}

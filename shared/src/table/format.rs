//! The feedforward table's format, and the checked [`Table`] that reads it in place.
//!
//! A table is one little-endian image that is read in place, from flash or from
//! memory. Its rows are the **knots of cubic B-splines**, one spline a column. Splines
//! are twice continuously differentiable (no torque steps that would excite the
//! elastic modes), need four rows at a time and nothing remembered, and never leave
//! the range of their knots, which a range analysis can rely on.
//!
//! The motion is cut into **pieces** with evenly spaced knots each: close where the
//! plan has boundary layers of a few milliseconds, far apart elsewhere. A piece of
//! `ticks` control periods and `segments` spline segments has `segments + 3` rows; its
//! first tick is its first knot, its end the next piece's first tick. Between pieces
//! the splines are continuous with their first derivative.
//!
//! # Image
//!
//! | offset | type | field |
//! |---|---|---|
//! | 0 | `[u8; 4]` | magic, `FLXT` |
//! | 4 | u16 | format version, 2 |
//! | 6 | u16 | number of pieces, 1 to 64 |
//! | 8 | u32 | fingerprint of the arm ([`crate::model::ArmParameters::fingerprint`]) |
//! | 12 | u32 | tick rate, Hz |
//! | 16 | u32 | ticks: number of control periods in the motion |
//! | 20 | i32 | first tick: time of tick 0 in ticks, relative to the path's start (not positive) |
//! | 24 | u32 | rows, of all pieces together |
//! | 28 | u32 | columns, 8 |
//! | 32 | `[i8; 8]` | scaling: a column's stored integers are its values times 2^scaling |
//! | 40 | u32 | length of the whole image, bytes |
//! | 44 | u32 | CRC-32 (ISO-HDLC) of all other bytes |
//! | 48 | u32 | fingerprint of the task: of all that decides what was planned for that arm |
//! | 52 | `[[u32; 2]; pieces]` | ticks and segments of each piece |
//! | 52 + 8 pieces | `[[i32; 8]; rows]` | knots |
//!
//! At tick `t` of a piece, `i` and `u` are the whole and the fraction of
//! `t * segments / ticks`, and a column is `sum_j basis_j(u) knot[i + j]`, `j = 0..4`,
//! with the uniform cubic B-spline basis. The cursor turns the four knots of a segment
//! into the cubic's coefficients when it enters it. The torque columns hold at tick `k` what is
//! to be *held* from tick `k` to `k + 1`, the plan's value in the middle of that
//! period; at the last tick, which is held after the end, the plan's last. All other
//! columns are the plan at tick `k` itself.

use crate::CRC32;
use crate::signals::COLUMNS;
use crate::table::error::TableError;
use crate::table::layout::{HEADER_BYTES, MAGIC, PIECE_BYTES, PIECES_MAX, ROW_BYTES, VERSION};

/// Offset of the CRC in the header, which it does not cover.
pub(super) const CRC_OFFSET: usize = 44;
/// Offset of what follows the CRC.
pub(super) const TASK_OFFSET: usize = 48;

/// What a table's header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Fingerprint of the arm that the table was planned for.
    pub arm_fingerprint: u32,
    /// Fingerprint of the task that was planned, made by the planner: two tables with the same
    /// one are for the same motion, force and timing. The controller has no task to compare
    /// it with.
    pub task_fingerprint: u32,
    /// Tick rate, Hz.
    pub tick_rate_hz: u32,
    /// Number of control periods; references exist for ticks `0..=ticks`.
    pub ticks: u32,
    /// Time of tick 0 in ticks relative to the path's start; not positive.
    pub first_tick: i32,
    /// Per column, the binary exponent of its scaling.
    pub scaling: [i8; COLUMNS],
}

impl Header {
    /// Refuses values that no writer produces.
    fn check(&self) -> Result<(), TableError> {
        within("tick rate", self.tick_rate_hz, [1, i64::from(u32::MAX)])?;
        within("ticks", self.ticks, [1, i64::from(i32::MAX)])?;
        within("first tick", self.first_tick, [i64::from(i32::MIN), 0])
    }
}

/// A stretch of the motion with evenly spaced knots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Control periods.
    pub ticks: u32,
    /// Spline segments, at most as many.
    pub segments: u32,
}

impl Piece {
    /// Rows of the piece: a cubic segment needs four, each further one a row more.
    pub fn rows(&self) -> u32 {
        self.segments.saturating_add(3)
    }

    pub(super) fn encode(&self) -> [u8; PIECE_BYTES] {
        let mut bytes = [0; PIECE_BYTES];
        bytes[..4].copy_from_slice(&self.ticks.to_le_bytes());
        bytes[4..].copy_from_slice(&self.segments.to_le_bytes());
        bytes
    }

    pub(super) fn decode(bytes: &[u8; PIECE_BYTES]) -> Self {
        let [t0, t1, t2, t3, s0, s1, s2, s3] = *bytes;
        Self {
            ticks: u32::from_le_bytes([t0, t1, t2, t3]),
            segments: u32::from_le_bytes([s0, s1, s2, s3]),
        }
    }

    /// Ticks must count exactly in f32, and a knot is at least a tick long.
    fn check(&self) -> Result<(), TableError> {
        within("ticks of a piece", self.ticks, [1, 1 << 24])?;
        let ticks = i64::from(self.ticks);
        within("segments of a piece", self.segments, [1, ticks])
    }
}

/// Refuses a field outside the least and the largest that are `accepted`.
fn within(name: &'static str, found: impl Into<i64>, accepted: [i64; 2]) -> Result<(), TableError> {
    let found = found.into();
    let [least, most] = accepted;
    if (least..=most).contains(&found) {
        Ok(())
    } else {
        Err(TableError::Field {
            name,
            found,
            accepted,
        })
    }
}

/// Checksum of an image at least as long as the header.
pub(super) fn checksum(image: &[u8]) -> u32 {
    let mut digest = CRC32.digest();
    digest.update(&image[..CRC_OFFSET]);
    digest.update(&image[TASK_OFFSET..]);
    digest.finalize()
}

/// An image's parts, everything checked but the CRC.
pub(super) struct Layout<'a> {
    header: Header,
    crc: u32,
    pieces: &'a [[u8; PIECE_BYTES]],
    rows: &'a [[u8; ROW_BYTES]],
}

impl<'a> Layout<'a> {
    /// The parts of `image`.
    ///
    /// # Errors
    /// The first [`TableError`] found, the CRC's excepted.
    pub(super) fn decode(image: &'a [u8]) -> Result<Self, TableError> {
        let length = |expected| TableError::Length {
            expected,
            found: image.len(),
        };
        let fixed = image
            .first_chunk::<HEADER_BYTES>()
            .ok_or_else(|| length(HEADER_BYTES))?;
        fn field<const N: usize>(header: &[u8; HEADER_BYTES], at: usize) -> [u8; N] {
            let mut bytes = [0; N];
            bytes.copy_from_slice(&header[at..at + N]);
            bytes
        }
        let word = |at| u32::from_le_bytes(field(fixed, at));
        let half = |at| u16::from_le_bytes(field(fixed, at));

        let magic = field(fixed, 0);
        if magic != MAGIC {
            return Err(TableError::Magic { found: magic });
        }
        if half(4) != VERSION {
            return Err(TableError::Version { found: half(4) });
        }
        let stated = word(40) as usize;
        if image.len() != stated {
            return Err(length(stated));
        }
        let header = Header {
            arm_fingerprint: word(8),
            task_fingerprint: word(TASK_OFFSET),
            tick_rate_hz: word(12),
            ticks: word(16),
            first_tick: word(20).cast_signed(),
            scaling: field::<COLUMNS>(fixed, 32).map(u8::cast_signed),
        };
        let count = usize::from(half(6));
        let rest = &image[HEADER_BYTES..];
        let (pieces, rows) = rest
            .split_at_checked(count * PIECE_BYTES)
            .ok_or_else(|| length(HEADER_BYTES + count * PIECE_BYTES))?;
        let (pieces, _) = pieces.as_chunks();
        let (rows, odd) = rows.as_chunks();
        header.check()?;
        within("columns", word(28), [COLUMNS as i64; 2])?;
        within("pieces", half(6), [1, PIECES_MAX as i64])?;
        let total_rows = checked_rows(pieces, header.ticks)?;
        within("rows", word(24), [total_rows; 2])?;
        if !odd.is_empty() || rows.len() as i64 != total_rows {
            let bytes = (total_rows as usize).saturating_mul(ROW_BYTES);
            return Err(length(
                bytes.saturating_add(HEADER_BYTES + count * PIECE_BYTES),
            ));
        }
        Ok(Self {
            header,
            crc: word(CRC_OFFSET),
            pieces,
            rows,
        })
    }
}

/// Rows of all pieces, which must be in order and add up to `ticks`.
fn checked_rows(pieces: &[[u8; PIECE_BYTES]], ticks: u32) -> Result<i64, TableError> {
    let mut total_ticks = 0_i64;
    let mut total_rows = 0_i64;
    for piece in pieces.iter().map(Piece::decode) {
        piece.check()?;
        total_ticks += i64::from(piece.ticks);
        total_rows += i64::from(piece.rows());
    }
    within("ticks of all pieces", total_ticks, [i64::from(ticks); 2])?;
    Ok(total_rows)
}

/// A checked table, read in place.
///
/// ```
/// # use flexor::signals::Reference;
/// # use flexor::table::{Header, Piece, Table, TableWriter, image_bytes};
/// # let pieces = [Piece { ticks: 10, segments: 1 }];
/// # let header = Header {
/// #     arm_fingerprint: 7, task_fingerprint: 9, tick_rate_hz: 1000, ticks: 10, first_tick: 0,
/// #     scaling: [20; 8],
/// # };
/// # let mut image = vec![0; image_bytes(&pieces)];
/// # let mut writer = TableWriter::new(&mut image, &header, &pieces)?;
/// # for _ in 0..4 {
/// #     writer.row(&Reference { torque: [5.0, -0.5], ..Reference::default() })?;
/// # }
/// # writer.finish()?;
/// // `image` holds ten ticks of constant torques 5 N m and -0.5 N m.
/// let table = Table::open(&image)?;
/// let mut cursor = table.cursor::<f32>();
/// while !cursor.at_end() {
///     let [torque1, torque2] = cursor.setpoint().torque;
///     assert!((torque1 - 5.0).abs() < 1e-5 && (torque2 + 0.5).abs() < 1e-5);
///     cursor.advance();
/// }
/// assert_eq!(cursor.tick(), 10);
///
/// // A table that has suffered is refused.
/// image[60] ^= 1;
/// assert!(Table::open(&image).is_err());
/// # Ok::<(), flexor::table::TableError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Table<'a> {
    pub(super) header: Header,
    crc: u32,
    pub(super) pieces: &'a [[u8; PIECE_BYTES]],
    pub(super) rows: &'a [[u8; ROW_BYTES]],
}

impl<'a> Table<'a> {
    /// Checks `image`: header, length, pieces, CRC.
    ///
    /// # Errors
    /// The first [`TableError`] found.
    pub fn open(image: &'a [u8]) -> Result<Self, TableError> {
        let Layout {
            header,
            crc,
            pieces,
            rows,
        } = Layout::decode(image)?;
        let computed = checksum(image);
        if crc != computed {
            return Err(TableError::Crc {
                stored: crc,
                computed,
            });
        }
        Ok(Self {
            header,
            crc,
            pieces,
            rows,
        })
    }

    /// Length in bytes that the header of an image states, checked for magic and version
    /// only: where a table that begins at `region`'s first byte ends.
    ///
    /// # Errors
    /// [`TableError`] for another magic or version, and if `region` is shorter.
    pub fn stated_bytes(region: &[u8]) -> Result<usize, TableError> {
        let short = TableError::Length {
            expected: HEADER_BYTES,
            found: region.len(),
        };
        let (magic, rest) = region.split_first_chunk().ok_or(short)?;
        let (version, _) = rest.split_first_chunk().ok_or(short)?;
        let length = region
            .get(40..)
            .and_then(<[u8]>::first_chunk)
            .ok_or(short)?;
        if *magic != MAGIC {
            return Err(TableError::Magic { found: *magic });
        }
        let version = u16::from_le_bytes(*version);
        if version != VERSION {
            return Err(TableError::Version { found: version });
        }
        let expected = u32::from_le_bytes(*length) as usize;
        if expected > region.len() {
            return Err(TableError::Length {
                expected,
                found: region.len(),
            });
        }
        Ok(expected)
    }

    /// The image's checksum.
    pub fn crc(&self) -> u32 {
        self.crc
    }

    /// As [`open`](Self::open), and the table must be for the arm with `fingerprint`.
    ///
    /// # Errors
    /// The first [`TableError`] found.
    pub fn open_for(image: &'a [u8], fingerprint: u32) -> Result<Self, TableError> {
        let table = Self::open(image)?;
        table.check_arm(fingerprint)?;
        Ok(table)
    }

    /// Whether the table is for the arm with `fingerprint`.
    ///
    /// # Errors
    /// [`TableError::Fingerprint`] if it is not.
    pub fn check_arm(&self, fingerprint: u32) -> Result<(), TableError> {
        if self.header.arm_fingerprint == fingerprint {
            Ok(())
        } else {
            Err(TableError::Fingerprint {
                expected: fingerprint,
                found: self.header.arm_fingerprint,
            })
        }
    }

    /// The table's header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Bounds of the magnitudes of (tau1, tau2), N m: a spline stays within its knots. Looks
    /// at every row.
    pub fn torque_bound(&self) -> [f32; 2] {
        [0, 1].map(|column| {
            let largest = f64::from(self.knot_bound(column));
            libm::ldexp(largest, -i32::from(self.header.scaling[column])) as f32
        })
    }

    /// Whether a contact force is planned anywhere. Looks at every row.
    pub fn presses(&self) -> bool {
        self.knot_bound(2) > 0
    }

    /// The largest magnitude of a column's integers.
    fn knot_bound(&self, column: usize) -> u32 {
        let knots = self.rows.iter().map(|row| {
            let (raw, _) = row.as_chunks::<4>();
            let raw = raw.get(column).map_or([0; 4], |bytes| *bytes);
            i32::from_le_bytes(raw).unsigned_abs()
        });
        knots.max().unwrap_or(0)
    }

    /// The table's pieces, in order.
    pub fn pieces(&self) -> impl ExactSizeIterator<Item = Piece> + 'a {
        self.pieces.iter().map(Piece::decode)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signals::Reference;
    use crate::table::{TableWriter, scaling_for};
    use proptest::prelude::*;

    const PIECES: [Piece; 3] = [
        Piece {
            ticks: 6,
            segments: 6,
        },
        Piece {
            ticks: 25,
            segments: 3,
        },
        Piece {
            ticks: 7,
            segments: 1,
        },
    ];
    const ROWS: usize = 9 + 6 + 4;
    const LENGTH: usize = HEADER_BYTES + 3 * PIECE_BYTES + ROWS * ROW_BYTES;

    fn header() -> Header {
        Header {
            arm_fingerprint: 7,
            task_fingerprint: 0x89ab_cdef,
            tick_rate_hz: 5000,
            ticks: 38,
            first_tick: -3,
            scaling: [scaling_for(16.0); COLUMNS],
        }
    }

    /// What [`image`] holds at a tick.
    fn line(tick: f64, column: usize) -> f64 {
        tick / 10.0 * (column as f64 - 3.0) / 4.0 + 0.25
    }

    /// Knots of a straight line in every column: the spline is then that line.
    fn image() -> [u8; LENGTH] {
        let mut buffer = [0; LENGTH];
        let mut writer = TableWriter::new(&mut buffer, &header(), &PIECES).unwrap();
        let mut start = 0.0;
        for piece in PIECES {
            let spacing = f64::from(piece.ticks) / f64::from(piece.segments);
            for row in 0..piece.rows() {
                let tick = start + (f64::from(row) - 1.0) * spacing;
                let columns = core::array::from_fn(|i| line(tick, i));
                writer.row(&Reference::from_columns(columns)).unwrap();
            }
            start += f64::from(piece.ticks);
        }
        writer.finish().unwrap();
        buffer
    }

    #[test]
    fn a_line_comes_back_at_every_tick_and_the_end_is_held() {
        let image = image();
        let table = Table::open_for(&image, 7).unwrap();
        assert_eq!(*table.header(), header());
        assert!(table.pieces().eq(PIECES));
        let mut cursor = table.cursor::<f64>();
        for tick in 0..60_u32 {
            assert_eq!(cursor.tick(), tick.min(38));
            assert_eq!(cursor.at_end(), tick >= 38);
            let row = cursor.row();
            assert_eq!(cursor.setpoint(), row.setpoint(), "tick {tick}");
            for (i, value) in row.columns().into_iter().enumerate() {
                let line = line(f64::from(tick.min(38)), i);
                assert!(
                    (value - line).abs() < 1e-7,
                    "tick {tick} column {i}: {value} {line}"
                );
            }
            cursor.advance();
        }
    }

    #[test]
    fn torques_keep_within_the_bound_and_come_near_it() {
        let image = image();
        let table = Table::open_for(&image, 7).unwrap();
        let bound = table.torque_bound();
        let mut cursor = table.cursor::<f32>();
        let mut largest = [0.0_f32; 2];
        while !cursor.at_end() {
            for (largest, torque) in largest.iter_mut().zip(cursor.row().torque) {
                *largest = largest.max(torque.abs());
            }
            cursor.advance();
        }
        for (largest, bound) in largest.into_iter().zip(bound) {
            assert!(
                largest <= bound && bound < 2.0 * largest,
                "{largest} {bound}"
            );
        }
    }

    #[test]
    fn the_wrong_arm_is_refused() {
        let error = Table::open_for(&image(), 8).unwrap_err();
        assert_eq!(
            error,
            TableError::Fingerprint {
                expected: 8,
                found: 7
            }
        );
    }

    #[test]
    fn the_headers_bytes_are_as_documented() {
        let image = image();
        let word = |at: usize| u32::from_le_bytes(*image[at..].first_chunk().unwrap());
        assert_eq!(image[..8], *b"FLXT\x02\0\x03\0");
        assert_eq!([word(8), word(12), word(16)], [7, 5000, 38]);
        assert_eq!(word(20).cast_signed(), -3);
        assert_eq!([word(24), word(28)], [ROWS as u32, 8]);
        assert_eq!(image[32..40], [26; 8]);
        assert_eq!(word(40) as usize, LENGTH);
        assert_eq!(word(48), 0x89ab_cdef);
        let pieces: [u32; 6] = core::array::from_fn(|i| word(52 + 4 * i));
        assert_eq!(pieces, [6, 6, 25, 3, 7, 1]);
    }

    #[test]
    fn another_version_is_named() {
        let mut image = image();
        // Version 1 had no task, and everything else four bytes earlier.
        for version in [1_u16, 3] {
            image[4..6].copy_from_slice(&version.to_le_bytes());
            let expected = TableError::Version { found: version };
            assert_eq!(Table::open(&image).unwrap_err(), expected);
            assert_eq!(Table::stated_bytes(&image).unwrap_err(), expected);
        }
    }

    #[test]
    fn erased_flash_is_told_apart() {
        let error = Table::open(&[0xff; 4096]).unwrap_err();
        assert_eq!(error, TableError::Magic { found: [0xff; 4] });
    }

    proptest! {
        #[test]
        fn every_truncation_is_refused(length in 0..LENGTH) {
            prop_assert!(Table::open(&image()[..length]).is_err());
        }

        #[test]
        fn every_changed_byte_is_refused(at in 0..LENGTH, change in 1..=255_u8) {
            let mut image = image();
            image[at] ^= change;
            prop_assert!(Table::open(&image).is_err());
        }

        #[test]
        fn no_bytes_make_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200), keep: bool) {
            let mut image = image();
            // Half of the cases keep a good magic and version, to get past the first checks.
            let at = if keep { 6 } else { 0 };
            let end = (at + bytes.len()).min(LENGTH);
            image[at..end].copy_from_slice(&bytes[..end - at]);
            // And all get a good checksum, to get past the last one.
            let crc = checksum(&image);
            image[CRC_OFFSET..TASK_OFFSET].copy_from_slice(&crc.to_le_bytes());
            if let Ok(table) = Table::open(&image) {
                let mut cursor = table.cursor::<f32>();
                for _ in 0..100 {
                    assert_eq!(cursor.setpoint(), cursor.row().setpoint());
                    cursor.advance();
                }
            }
        }
    }
}

//! The feedforward table: format, writer and streaming cursor.
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
//! | 4 | u16 | format version, 1 |
//! | 6 | u16 | number of pieces, 1 to 64 |
//! | 8 | u32 | fingerprint of the arm ([`crate::arm::ArmParameters::fingerprint`]) |
//! | 12 | u32 | tick rate, Hz |
//! | 16 | u32 | ticks: number of control periods in the motion |
//! | 20 | i32 | first tick: time of tick 0 in ticks, relative to the path's start (not positive) |
//! | 24 | u32 | rows, of all pieces together |
//! | 28 | u32 | columns, 8 |
//! | 32 | `[i8; 8]` | scaling: a column's stored integers are its values times 2^scaling |
//! | 40 | u32 | length of the whole image, bytes |
//! | 44 | u32 | CRC-32 (ISO-HDLC) of all other bytes |
//! | 48 | `[[u32; 2]; pieces]` | ticks and segments of each piece |
//! | 48 + 8 pieces | `[[i32; 8]; rows]` | knots |
//!
//! At tick `t` of a piece, `i` and `u` are the whole and the fraction of
//! `t * segments / ticks`, and a column is `sum_j basis_j(u) knot[i + j]`, `j = 0..4`,
//! with the uniform cubic B-spline basis. The cursor turns the four knots of a segment
//! into the cubic's coefficients when it enters it. The torque columns hold at tick `k` what is
//! to be *held* from tick `k` to `k + 1`, the plan's value in the middle of that
//! period; at the last tick, which is held after the end, the plan's last. All other
//! columns are the plan at tick `k` itself.

use crate::CRC32;
use crate::number::{Constant, Number, Scalar};
use core::fmt;

/// Columns of a table, in the order of [`Reference::from_columns`].
pub const COLUMNS: usize = 8;
/// Bytes of one row.
pub const ROW_BYTES: usize = 4 * COLUMNS;
/// Bytes before the list of pieces.
pub const HEADER_BYTES: usize = 48;
/// Bytes of a piece's entry.
pub const PIECE_BYTES: usize = 8;
/// Most pieces of a table.
pub const PIECES_MAX: usize = 64;
/// Format version that this crate writes and reads.
pub const VERSION: u16 = 1;
/// First bytes of every image.
pub const MAGIC: [u8; 4] = *b"FLXT";
/// Largest magnitude of a stored integer: a bit is left free so that sums of two
/// cannot overflow.
pub const RAW_MAX: i32 = 1 << 30;

/// Offset of the CRC in the header, which it does not cover.
const CRC_OFFSET: usize = 44;

/// The plan's values at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reference<T> {
    /// Feedforward torques (tau1, tau2) to hold during the tick, N m.
    pub torque: [T; 2],
    /// Contact force along the surface normal, pressing positive, N.
    pub force: T,
    /// Angles (theta10, theta20), rad.
    pub angle: [T; 2],
    /// Slope of link 2 at its root against the chord, w'(0), rad.
    pub root_slope: T,
    /// Its rate, rad/s.
    pub root_slope_rate: T,
    /// Direction of the surface normal, from a1 towards a2, rad; a tip that presses
    /// pushes along it. pi/2 is straight down.
    pub normal_angle: T,
}

impl<T: Copy> Reference<T> {
    /// The reference with the given column values.
    #[inline]
    pub fn from_columns(columns: [T; COLUMNS]) -> Self {
        let [
            torque1,
            torque2,
            force,
            angle1,
            angle2,
            root_slope,
            root_slope_rate,
            normal_angle,
        ] = columns;
        Self {
            torque: [torque1, torque2],
            force,
            angle: [angle1, angle2],
            root_slope,
            root_slope_rate,
            normal_angle,
        }
    }

    /// The values in the order of the table's columns.
    pub fn columns(&self) -> [T; COLUMNS] {
        [
            self.torque[0],
            self.torque[1],
            self.force,
            self.angle[0],
            self.angle[1],
            self.root_slope,
            self.root_slope_rate,
            self.normal_angle,
        ]
    }
}

/// Why an image is not a usable table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableError {
    /// Shorter than its header or than its header says, or followed by other bytes.
    Length {
        /// Bytes that the image should have.
        expected: usize,
        /// Bytes that it has.
        found: usize,
    },
    /// Does not begin with [`MAGIC`]; erased flash, for one.
    Magic {
        /// What it begins with.
        found: [u8; 4],
    },
    /// Another format version.
    Version {
        /// The image's version.
        found: u16,
    },
    /// Checksum does not match: corrupted.
    Crc {
        /// Checksum in the header.
        stored: u32,
        /// Checksum of the bytes.
        computed: u32,
    },
    /// A field of the header, or of a piece, has a value that no writer produces.
    Field {
        /// Name of the field.
        name: &'static str,
        /// Its value.
        found: i64,
        /// The least and the largest that are accepted.
        accepted: [i64; 2],
    },
    /// Planned for another arm.
    Fingerprint {
        /// The arm at hand.
        expected: u32,
        /// The table's arm.
        found: u32,
    },
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Length { expected, found } => write!(
                f,
                "table image has {found} bytes where {expected} are expected: truncated or not a table"
            ),
            Self::Magic { found } => {
                write!(
                    f,
                    "table image begins with {found:02x?}, expected {MAGIC:02x?} (\"FLXT\")"
                )
            }
            Self::Version { found } => {
                write!(
                    f,
                    "table format version is {found}, this program reads {VERSION}"
                )
            }
            Self::Crc { stored, computed } => write!(
                f,
                "table checksum is {stored:#010x}, its bytes give {computed:#010x}: corrupted"
            ),
            Self::Field {
                name,
                found,
                accepted: [least, most],
            } => {
                write!(f, "table field '{name}' is {found}, {least} ")?;
                if most > least {
                    write!(f, "to {most} ")?;
                }
                f.write_str("is accepted: corrupted or not a table")
            }
            Self::Fingerprint { expected, found } => write!(
                f,
                "table was planned for arm {found:#010x}, this arm is {expected:#010x}: plan it again"
            ),
        }
    }
}

impl core::error::Error for TableError {}

/// What a table's header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Fingerprint of the arm that the table was planned for.
    pub arm_fingerprint: u32,
    /// Tick rate, Hz.
    pub tick_rate_hz: u32,
    /// Number of control periods; references exist for ticks `0..=ticks`.
    pub ticks: u32,
    /// Time of tick 0 in ticks relative to the path's start; not positive.
    pub first_tick: i32,
    /// Per column, the binary exponent of its scaling.
    pub scaling: [i8; COLUMNS],
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

    fn encode(&self) -> [u8; PIECE_BYTES] {
        let mut bytes = [0; PIECE_BYTES];
        bytes[..4].copy_from_slice(&self.ticks.to_le_bytes());
        bytes[4..].copy_from_slice(&self.segments.to_le_bytes());
        bytes
    }

    fn decode(bytes: &[u8; PIECE_BYTES]) -> Self {
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
        self.buffer[CRC_OFFSET..HEADER_BYTES].copy_from_slice(&crc.to_le_bytes());
        Ok(())
    }
}

/// Checksum of an image at least as long as the header.
fn checksum(image: &[u8]) -> u32 {
    let mut digest = CRC32.digest();
    digest.update(&image[..CRC_OFFSET]);
    digest.update(&image[HEADER_BYTES..]);
    digest.finalize()
}

/// An image's parts, everything checked but the CRC.
struct Layout<'a> {
    header: Header,
    crc: u32,
    pieces: &'a [[u8; PIECE_BYTES]],
    rows: &'a [[u8; ROW_BYTES]],
}

impl<'a> Layout<'a> {
    fn decode(image: &'a [u8]) -> Result<Self, TableError> {
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
        within("tick rate", header.tick_rate_hz, [1, i64::from(u32::MAX)])?;
        within("ticks", header.ticks, [1, i64::from(i32::MAX)])?;
        within("first tick", header.first_tick, [i64::from(i32::MIN), 0])?;
        within("columns", word(28), [COLUMNS as i64; 2])?;
        within("pieces", half(6), [1, PIECES_MAX as i64])?;
        let mut total_ticks = 0_i64;
        let mut total_rows = 0_i64;
        for piece in pieces.iter().map(Piece::decode) {
            piece.check()?;
            total_ticks += i64::from(piece.ticks);
            total_rows += i64::from(piece.rows());
        }
        within(
            "ticks of all pieces",
            total_ticks,
            [i64::from(header.ticks); 2],
        )?;
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

/// A checked table, read in place.
#[derive(Clone, Copy, Debug)]
pub struct Table<'a> {
    header: Header,
    crc: u32,
    pieces: &'a [[u8; PIECE_BYTES]],
    rows: &'a [[u8; ROW_BYTES]],
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
            let knots = self.rows.iter().map(|row| {
                let (raw, _) = row.as_chunks::<4>();
                let raw = raw.get(column).map_or([0; 4], |bytes| *bytes);
                i32::from_le_bytes(raw).unsigned_abs()
            });
            let largest = f64::from(knots.max().unwrap_or(0));
            libm::ldexp(largest, -i32::from(self.header.scaling[column])) as f32
        })
    }

    /// The table's pieces, in order.
    pub fn pieces(&self) -> impl ExactSizeIterator<Item = Piece> + 'a {
        self.pieces.iter().map(Piece::decode)
    }

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
    use super::*;
    use crate::fixed_point::{Exponent, Fixed};
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
            for (i, value) in cursor.reference().columns().into_iter().enumerate() {
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
            for (largest, torque) in largest.iter_mut().zip(cursor.reference().torque) {
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
    fn pieces_that_do_not_add_up_are_refused() {
        let mut buffer = [0; LENGTH];
        let wrong = Header {
            ticks: 39,
            ..header()
        };
        let error = TableWriter::new(&mut buffer, &wrong, &PIECES).unwrap_err();
        let expected = TableError::Field {
            name: "ticks of all pieces",
            found: 38,
            accepted: [39, 39],
        };
        assert_eq!(error, expected);
        let mut pieces = PIECES;
        pieces[2].segments = 0;
        pieces[1].segments = 4;
        let error = TableWriter::new(&mut buffer, &header(), &pieces).unwrap_err();
        let expected = TableError::Field {
            name: "segments of a piece",
            found: 0,
            accepted: [1, 7],
        };
        assert_eq!(error, expected);
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
    fn erased_flash_is_told_apart() {
        let error = Table::open(&[0xff; 4096]).unwrap_err();
        assert_eq!(error, TableError::Magic { found: [0xff; 4] });
    }

    #[test]
    fn the_writer_wants_exactly_its_rows() {
        let mut buffer = [0; LENGTH];
        assert!(TableWriter::new(&mut buffer[1..], &header(), &PIECES).is_err());
        let mut writer = TableWriter::new(&mut buffer, &header(), &PIECES).unwrap();
        for _ in 0..ROWS {
            writer.row(&Reference::default()).unwrap();
        }
        assert!(writer.row(&Reference::default()).is_err());
        let writer = TableWriter::new(&mut buffer, &header(), &PIECES).unwrap();
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
            image[CRC_OFFSET..HEADER_BYTES].copy_from_slice(&crc.to_le_bytes());
            if let Ok(table) = Table::open(&image) {
                let mut cursor = table.cursor::<f32>();
                for _ in 0..100 {
                    let _ = cursor.reference();
                    cursor.advance();
                }
            }
        }

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

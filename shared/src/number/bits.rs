//! How far a number is shifted: less than its own bits.
//!
//! As an enum, so that the compiler knows it: a core's shift by a register takes more than 31 for
//! something else than Rust does, and of a plain integer every shift masks the upper bits away first,
//! an instruction each, some twenty in a tick.

use serde::{Deserialize, Serialize};

/// A number of bits from 0 to 31.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
#[repr(u8)]
#[allow(missing_docs)]
#[rustfmt::skip]
pub enum Bits {
    #[default]
    B0, B1, B2, B3, B4, B5, B6, B7,
    B8, B9, B10, B11, B12, B13, B14, B15,
    B16, B17, B18, B19, B20, B21, B22, B23,
    B24, B25, B26, B27, B28, B29, B30, B31,
}

impl Bits {
    #[rustfmt::skip]
    const ALL: [Self; 32] = [
        Self::B0, Self::B1, Self::B2, Self::B3, Self::B4, Self::B5, Self::B6, Self::B7,
        Self::B8, Self::B9, Self::B10, Self::B11, Self::B12, Self::B13, Self::B14, Self::B15,
        Self::B16, Self::B17, Self::B18, Self::B19, Self::B20, Self::B21, Self::B22, Self::B23,
        Self::B24, Self::B25, Self::B26, Self::B27, Self::B28, Self::B29, Self::B30, Self::B31,
    ];

    /// So many, or 31 where there are more.
    pub const fn at_most(count: u8) -> Self {
        let count = if count < 31 { count } else { 31 };
        Self::ALL[count as usize]
    }

    /// How many, from 0 to 31.
    #[inline]
    pub const fn count(self) -> u32 {
        self as u32
    }
}

impl From<Bits> for u8 {
    fn from(bits: Bits) -> Self {
        bits as Self
    }
}

impl From<Bits> for i32 {
    fn from(bits: Bits) -> Self {
        Self::from(bits as u8)
    }
}

/// Why a number is none of bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooMany(u8);

impl core::fmt::Display for TooMany {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} bits; accepted: from 0 to 31", self.0)
    }
}

impl TryFrom<u8> for Bits {
    type Error = TooMany;

    fn try_from(count: u8) -> Result<Self, TooMany> {
        let found = Self::ALL.get(usize::from(count));
        found.copied().ok_or(TooMany(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_their_count() {
        for count in 0..32 {
            let bits = Bits::try_from(count).unwrap();
            assert_eq!((bits.count(), u8::from(bits)), (u32::from(count), count));
            assert_eq!(Bits::at_most(count), bits);
        }
        assert!(Bits::try_from(32).is_err());
        assert_eq!(Bits::at_most(u8::MAX), Bits::B31);
    }
}

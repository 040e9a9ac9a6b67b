//! Values as the bytes of a block or of what is kept beside it: little-endian, field by field.

use crate::checksum::crc32;
use crate::codes::{DriveCode, SensorCode};

/// Why a block is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockError {
    /// A word of the flash is damaged.
    Unreadable,
    /// No block here: erased flash or something else.
    Absent,
    /// Another version of the layout.
    Version(u16),
    /// Shorter than it says, or with bytes left over.
    Length,
    /// The checksum does not match: damaged.
    Checksum,
    /// A field holds a value that its type does not have.
    Value,
    /// Made for another sampling rate, Hz.
    SampleRate(u32),
    /// The integers of the converters do not give the physical limits.
    Mismatch,
    /// A value with which a signal could leave its format, or that leaves the servo without a limit.
    Range(&'static str),
    /// The design is not stable when sampled.
    Unstable,
    /// The buffer is too small to write it.
    NoRoom,
    /// Two blocks are kept, and nothing says which of them counts ([`crate::block_choice`]).
    Ambiguous,
    /// It exceeds the board's safety envelope ([`crate::safety_envelope`]).
    BeyondEnvelope(&'static str),
    /// The board has no safety envelope.
    NoEnvelope,
}

impl BlockError {
    /// What is wrong, in words.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::Unreadable => "a word of the flash is damaged",
            Self::Absent => "no block",
            Self::Version(_) => "another version of the layout",
            Self::Length => "cut off or with bytes left over",
            Self::Checksum => "checksum does not match",
            Self::Value => "a field holds an impossible value",
            Self::SampleRate(_) => "made for another sampling rate",
            Self::Mismatch => "integers contradict the physical limits",
            Self::Range(what) => what,
            Self::Unstable => "by its own figure the design is not stable when sampled",
            Self::NoRoom => "larger than the buffer",
            Self::Ambiguous => {
                "two blocks, and neither replaces the other: erase one, or bring one by command"
            }
            Self::BeyondEnvelope(what) => what,
            Self::NoEnvelope => "no safety envelope: nothing is driven without one",
        }
    }
}

/// A cursor over bytes to be written.
pub struct Writer<'a> {
    pub(crate) bytes: &'a mut [u8],
    pub(crate) at: usize,
}

impl<'a> Writer<'a> {
    /// At the beginning of these.
    pub fn new(bytes: &'a mut [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// Bytes written so far.
    #[must_use]
    pub fn at(&self) -> usize {
        self.at
    }

    pub(crate) fn put(&mut self, bytes: &[u8]) -> Result<(), BlockError> {
        let end = self.at.checked_add(bytes.len()).ok_or(BlockError::NoRoom)?;
        self.bytes
            .get_mut(self.at..end)
            .ok_or(BlockError::NoRoom)?
            .copy_from_slice(bytes);
        self.at = end;
        Ok(())
    }
}

/// A cursor over bytes to be read.
pub struct Reader<'a> {
    pub(crate) rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// At the beginning of these.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// Bytes that have not been read.
    #[must_use]
    pub fn left(&self) -> usize {
        self.rest.len()
    }

    pub(crate) fn take<const N: usize>(&mut self) -> Result<[u8; N], BlockError> {
        let (chunk, rest) = self
            .rest
            .split_first_chunk::<N>()
            .ok_or(BlockError::Length)?;
        self.rest = rest;
        Ok(*chunk)
    }
}

/// Bytes of the header of [`write_kept`].
pub(crate) const KEPT_HEADER_BYTES: usize = 8;

/// Writes a value that is kept beside the blocks: a magic, a version, the value, a checksum. Returns the
/// length.
///
/// # Errors
/// [`BlockError::NoRoom`].
pub fn write_kept(
    magic: [u8; 4],
    version: u16,
    value: &impl Wire,
    bytes: &mut [u8],
) -> Result<usize, BlockError> {
    let mut writer = Writer::new(bytes);
    writer.put(&magic)?;
    version.write(&mut writer)?;
    0u16.write(&mut writer)?;
    value.write(&mut writer)?;
    let checksum = crc32(writer.bytes.get(..writer.at).ok_or(BlockError::NoRoom)?);
    checksum.write(&mut writer)?;
    Ok(writer.at)
}

/// Reads what [`write_kept`] wrote at the beginning of `bytes`; what follows it does not matter.
///
/// # Errors
/// [`BlockError::Absent`] without the magic, [`BlockError::Version`], [`BlockError::Length`],
/// [`BlockError::Checksum`].
pub fn read_kept<T: Wire>(magic: [u8; 4], version: u16, bytes: &[u8]) -> Result<T, BlockError> {
    let mut reader = Reader::new(bytes);
    if reader.take::<4>().map_err(|_| BlockError::Absent)? != magic {
        return Err(BlockError::Absent);
    }
    let found = u16::read(&mut reader)?;
    if found != version {
        return Err(BlockError::Version(found));
    }
    let _reserved = u16::read(&mut reader)?;
    let value = T::read(&mut reader)?;
    let end = bytes.len() - reader.left();
    if u32::read(&mut reader)? != crc32(bytes.get(..end).ok_or(BlockError::Length)?) {
        return Err(BlockError::Checksum);
    }
    Ok(value)
}

/// What can stand in a block.
pub trait Wire: Sized {
    /// Writes the value.
    ///
    /// # Errors
    /// [`BlockError::NoRoom`].
    fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError>;
    /// Reads a value.
    ///
    /// # Errors
    /// [`BlockError::Length`], [`BlockError::Value`].
    fn read(from: &mut Reader<'_>) -> Result<Self, BlockError>;
}

macro_rules! wire_integers {
    ($($type:ty),*) => {$(
        impl Wire for $type {
            fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
                to.put(&self.to_le_bytes())
            }
            fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
                Ok(Self::from_le_bytes(from.take()?))
            }
        }
    )*};
}
wire_integers!(u8, u16, i16, u32, i32, i64);

macro_rules! wire_codes {
    ($($type:ty),*) => {$(
        impl Wire for $type {
            fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
                self.steps().write(to)
            }
            fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
                let steps = u32::read(from)?;
                if steps > Self::MOST.steps() { Err(BlockError::Value) } else { Ok(Self::new(steps)) }
            }
        }
    )*};
}
wire_codes!(SensorCode, DriveCode);

impl Wire for bool {
    fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
        u8::from(*self).write(to)
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
        match u8::read(from)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(BlockError::Value),
        }
    }
}

impl<T: Wire + Copy + Default, const N: usize> Wire for [T; N] {
    fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
        self.iter().try_for_each(|element| element.write(to))
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
        let mut out = [T::default(); N];
        for element in &mut out {
            *element = T::read(from)?;
        }
        Ok(out)
    }
}

macro_rules! wire_struct {
    ($type:ident $(<$(const $n:ident: $t:ty),*>)? { $($field:ident),* $(,)? }) => {
        impl $(<$(const $n: $t),*>)? $crate::wire::Wire for $type $(<$($n),*>)? {
            fn write(
                &self,
                to: &mut $crate::wire::Writer<'_>,
            ) -> Result<(), $crate::wire::BlockError> {
                let Self { $($field),* } = self;
                $($field.write(to)?;)*
                Ok(())
            }
            fn read(from: &mut $crate::wire::Reader<'_>) -> Result<Self, $crate::wire::BlockError> {
                Ok(Self { $($field: $crate::wire::Wire::read(from)?),* })
            }
        }
    };
}

pub(crate) use wire_struct;

//! Bytes of a binary file, read one after the other; whatever lies behind the end is an error with its place.

use crate::error::{Error, Result};

/// A place in the bytes of a file.
#[derive(Clone, Copy, Debug)]
pub struct Bytes<'a> {
    /// What the file is called in messages.
    pub place: &'a str,
    all: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Bytes<'a> {
    /// At the first byte.
    pub fn new(place: &'a str, all: &'a [u8], big_endian: bool) -> Self {
        Self {
            place,
            all,
            at: 0,
            big_endian,
        }
    }

    /// The same bytes in the other order.
    pub fn in_order(self, big_endian: bool) -> Self {
        Self { big_endian, ..self }
    }

    /// Whether the byte that counts most comes first.
    pub fn is_big_endian(&self) -> bool {
        self.big_endian
    }

    /// The place, counted from 0.
    pub fn at(&self) -> usize {
        self.at
    }

    /// Bytes behind the place.
    pub fn left(&self) -> usize {
        self.all.len() - self.at
    }

    /// An error here.
    pub fn wrong<T>(&self, what: impl std::fmt::Display) -> Result<T> {
        Err(Error::new(self.place, format!("byte {}: {what}", self.at)))
    }

    /// The next bytes; the error names them by `what` where the file ends before them.
    pub fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8]> {
        if count > self.left() {
            return self.wrong(format!(
                "{what} of {count} bytes, but the file ends after {}; is it cut off?",
                self.left()
            ));
        }
        let taken = &self.all[self.at..self.at + count];
        self.at += count;
        Ok(taken)
    }

    /// The next bytes as an array.
    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut array: [u8; N] = self.take(N, what)?.try_into().unwrap_or([0; N]);
        if self.big_endian {
            array.reverse();
        }
        Ok(array)
    }

    /// The next four bytes as a whole number.
    pub fn u32(&mut self, what: &str) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    /// The next eight bytes as a whole number.
    pub fn u64(&mut self, what: &str) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }
}

/// Kinds of numbers in binary files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl FileKind {
    /// Bytes of one.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// One number; `bytes` are as many as its size.
    pub fn number(self, bytes: &[u8], big_endian: bool) -> f64 {
        let mut eight = [0_u8; 8];
        let size = self.size().min(bytes.len());
        eight[..size].copy_from_slice(&bytes[..size]);
        if big_endian {
            eight[..size].reverse();
        }
        let whole = u64::from_le_bytes(eight);
        match self {
            Self::I8 => f64::from(whole as u8 as i8),
            Self::U8 => f64::from(whole as u8),
            Self::I16 => f64::from(whole as u16 as i16),
            Self::U16 => f64::from(whole as u16),
            Self::I32 => f64::from(whole as u32 as i32),
            Self::U32 => f64::from(whole as u32),
            Self::I64 => whole as i64 as f64,
            Self::U64 => whole as f64,
            Self::F32 => f64::from(f32::from_bits(whole as u32)),
            Self::F64 => f64::from_bits(whole),
        }
    }

    /// All numbers of some bytes.
    pub fn numbers(self, bytes: &[u8], big_endian: bool) -> Vec<f64> {
        bytes
            .chunks_exact(self.size())
            .map(|one| self.number(one, big_endian))
            .collect()
    }
}

//! Readers: the bytes of a file in, a [`Table`] of columns out. Which format it is follows from its first
//! bytes, then from its name.

#[cfg(feature = "arrow")]
mod arrow;
mod bytes;
pub mod delimited;
mod dialect;
pub mod foreign;
#[cfg(feature = "hdf5")]
mod hdf5;
mod header;
mod hints;
mod matlab5;
mod named_arrays;
mod numpy;
mod packed;
#[cfg(feature = "parquet")]
mod parquet;
#[cfg(feature = "spreadsheet")]
mod spreadsheet;
mod tdms;
mod text_encoding;
mod wav;
#[cfg(feature = "parquet")]
mod zstandard_pages;

use super::table::Table;
use crate::error::{Error, Result};

pub use hints::{FORMATS, Hints};

/// First bytes of HDF5, also where another header stands before them (MATLAB 7.3).
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// What a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Npy,
    Npz,
    Spreadsheet,
    Matlab5,
    Hdf5,
    Tdms,
    Parquet,
    Arrow,
    Wav,
    Text,
    /// Known, and not read.
    Refused(&'static str),
}

impl Format {
    /// The message of a build without its reader.
    fn needs_full_build(self) -> String {
        let name = match self {
            Self::Hdf5 => {
                "HDF5 or MATLAB 7.3 (`save -v7` in MATLAB writes a format that it reads)".to_owned()
            }
            Self::Arrow => "Feather".to_owned(),
            other => format!("{other:?}"),
        };
        format!(
            "this build of the program does not read {name}. `cargo install --path lab/cli --locked --features full` builds all readers"
        )
    }
}

fn format_of(place: &str, bytes: &[u8]) -> Format {
    let extension = place
        .rsplit_once('.')
        .map(|(_, extension)| extension.to_lowercase())
        .unwrap_or_default();
    let hdf5_at = |at: usize| bytes.get(at..).is_some_and(|rest| rest.starts_with(HDF5));
    match bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Format::Npy,
        [b'P', b'K', 3 | 5, ..] if extension == "xlsx" || extension == "xlsm" => {
            Format::Spreadsheet
        }
        [b'P', b'K', 3 | 5, ..] => Format::Npz,
        [b'T', b'D', b'S', b'm', ..] => Format::Tdms,
        [b'P', b'A', b'R', b'1', ..] => Format::Parquet,
        [b'A', b'R', b'R', b'O', b'W', b'1', ..] => Format::Arrow,
        [b'F', b'E', b'A', b'1', ..] => {
            Format::Refused("the first version of Feather; write it with a newer pandas or PyArrow")
        }
        [0xff, 0xff, 0xff, 0xff, ..] if extension.starts_with("arrow") => {
            Format::Refused("an Arrow stream; write an Arrow file (Feather)")
        }
        [b'R', b'I', b'F', b'F', ..] => Format::Wav,
        [0xd0, 0xcf, 0x11, 0xe0, ..] => {
            Format::Refused("an old Office file (XLS); save it as XLSX or CSV")
        }
        [0x1f, 0x8b, ..] => Format::Refused("compressed by gzip; unpack it first"),
        _ if hdf5_at(0) || hdf5_at(512) || hdf5_at(1024) || hdf5_at(2048) => Format::Hdf5,
        _ if matlab5::is_matlab5(bytes) => Format::Matlab5,
        // The reader of a file's name reports damaged first bytes.
        _ => match extension.as_str() {
            "npy" => Format::Npy,
            "npz" => Format::Npz,
            "mat" => Format::Matlab5,
            "h5" | "hdf5" | "hdf" => Format::Hdf5,
            "tdms" => Format::Tdms,
            "parquet" => Format::Parquet,
            "feather" | "arrow" => Format::Arrow,
            "wav" => Format::Wav,
            "xlsx" => Format::Spreadsheet,
            _ => Format::Text,
        },
    }
}

/// Reads the bytes of a file.
///
/// # Errors
/// One message with the place in the file, and what was expected.
pub fn read(place: &str, bytes: &[u8], hints: Hints) -> Result<Table> {
    if bytes.is_empty() {
        return Err(Error::new(place, format!("is empty; expected {FORMATS}")));
    }
    let table = match format_of(place, bytes) {
        Format::Npy => numpy::read_npy(place, bytes),
        Format::Npz => foreign::guarded(place, "NPZ", || numpy::read_npz(place, bytes)),
        Format::Matlab5 => matlab5::read(place, bytes),
        Format::Tdms => tdms::read(place, bytes),
        Format::Wav => foreign::guarded(place, "WAV", || wav::read(place, bytes)),
        #[cfg(feature = "hdf5")]
        Format::Hdf5 => foreign::guarded(place, "HDF5", || hdf5::read(place, bytes)),
        #[cfg(feature = "parquet")]
        Format::Parquet => foreign::guarded(place, "Parquet", || parquet::read(place, bytes)),
        #[cfg(feature = "arrow")]
        Format::Arrow => foreign::guarded(place, "Arrow", || arrow::read(place, bytes)),
        #[cfg(feature = "spreadsheet")]
        Format::Spreadsheet => foreign::guarded(place, "XLSX", || spreadsheet::read(place, bytes)),
        Format::Text => delimited::read(place, bytes, hints),
        Format::Refused(what) => Err(Error::new(place, format!("is {what}; expected {FORMATS}"))),
        #[allow(unreachable_patterns)]
        other => Err(Error::new(place, other.needs_full_build())),
    };
    table.and_then(Table::finite)
}

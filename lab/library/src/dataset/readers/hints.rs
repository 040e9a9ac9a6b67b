//! What a caller specifies for a reader, and which formats there are.

/// Formats that are read, for messages.
pub const FORMATS: &str = "CSV or other text in columns, NPY, NPZ, MATLAB (MAT), HDF5, TDMS, Parquet, Feather, XLSX or WAV";

/// What a file may say about itself that its name and bytes do not.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hints {
    /// Rows of text to leave out at the top.
    pub skip_rows: usize,
}

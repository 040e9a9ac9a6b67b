//! The files that `make.py` writes: by which library, what they hold, how they are to be read; and the ways
//! in which they are damaged.

use std::path::PathBuf;

/// A file that the library of its format wrote.
pub struct Written {
    /// Its name.
    pub file: &'static str,
    /// The library that wrote it.
    pub by: &'static str,
    /// What is particular about it.
    pub holds: &'static str,
    /// How far a number may be from the recording's, V and um: what the type of the numbers, or their digits,
    /// leave.
    pub tolerance: f64,
    /// Units that a person has to say.
    pub units: Option<[&'static str; 2]>,
    /// What its notes must say; or, where it cannot be read, the message.
    pub said: &'static [&'static str],
    /// It is of a kind that is refused.
    pub refused: bool,
}

const fn written(
    file: &'static str,
    by: &'static str,
    holds: &'static str,
    tolerance: f64,
    said: &'static [&'static str],
) -> Written {
    Written {
        file,
        by,
        holds,
        tolerance,
        units: None,
        said,
        refused: false,
    }
}

/// Every file.
pub const FILES: [Written; 42] = [
    written(
        "columns.npy",
        "NumPy",
        "a matrix, a column for each signal",
        1e-9,
        &["column 2 is taken for the drive"],
    ),
    written(
        "single_rows.npy",
        "NumPy",
        "32-bit floats, a row for each signal, in Fortran's order",
        1e-5,
        &["rows are the columns"],
    ),
    written("arrays.npz", "NumPy", "arrays by name", 1e-9, &[]),
    written(
        "compressed.npz",
        "NumPy",
        "compressed, whole numbers in mV and nm",
        1e-3,
        &["u = column `u [mv]`"],
    ),
    written(
        "vectors.mat",
        "SciPy",
        "MATLAB 5, vectors",
        1e-9,
        &["u = column `u`"],
    ),
    written(
        "compressed.mat",
        "SciPy",
        "MATLAB 5, a compressed matrix",
        1e-9,
        &["column `record(2)` is taken for the drive"],
    ),
    written(
        "simulink.mat",
        "SciPy",
        "MATLAB 5, structure with time, as Simulink logs",
        1e-9,
        &[],
    ),
    written(
        "controldesk.mat",
        "SciPy",
        "MATLAB 5, array of structs, as ControlDesk records",
        1e-4,
        &["Position [nm]"],
    ),
    written(
        "cells.mat",
        "SciPy",
        "MATLAB 5, cells",
        1e-9,
        &["column `log{2}` is taken for the drive"],
    ),
    written(
        "matlab73.mat",
        "h5py",
        "laid out as MATLAB 7.3 does, structs by reference",
        1e-9,
        &[],
    ),
    written(
        "groups.h5",
        "h5py",
        "groups, gzip and shuffle, big-endian floats, units as attributes",
        1e-3,
        &["y = column `position [nm]`"],
    ),
    written(
        "table.h5",
        "h5py",
        "a table in chunks, gzip and Fletcher-32",
        1e-9,
        &["column `data(2)` is taken for the drive"],
    ),
    written(
        "rate_of_file.h5",
        "h5py",
        "no time; the file has an attribute `sample_rate_hz`",
        1e-9,
        &["2000.000000 samples per second"],
    ),
    written(
        "rate_of_group.h5",
        "h5py",
        "no time; the group has an attribute `fs`, a whole number",
        1e-9,
        &["2000.000000 samples per second"],
    ),
    written(
        "period_of_dataset.h5",
        "h5py",
        "no time; each data set has an attribute `dt`",
        1e-9,
        &["2000.000000 samples per second"],
    ),
    written(
        "waveforms.tdms",
        "npTDMS",
        "waveforms in two segments",
        1e-9,
        &["2000.000000 samples per second"],
    ),
    written(
        "with_time.tdms",
        "npTDMS",
        "a channel of time, floats and whole numbers",
        1e-5,
        &["y = column `AI0 [pm]`"],
    ),
    written(
        "frame.parquet",
        "pandas",
        "Snappy, a column of text",
        1e-5,
        &["columns that hold no numbers are left aside: `comment`"],
    ),
    written(
        "stamped.parquet",
        "PyArrow",
        "gzip, time stamps, two groups of rows",
        1e-3,
        &["u = column `u [mv]`"],
    ),
    written(
        "zstd.parquet",
        "PyArrow",
        "Zstandard",
        1e-3,
        &["u = column `u [mv]`"],
    ),
    written(
        "second_pages.parquet",
        "PyArrow",
        "Zstandard, many pages of the second version",
        1e-3,
        &["u = column `u [mv]`"],
    ),
    written(
        "decimals.parquet",
        "PyArrow",
        "decimals as whole numbers",
        1e-5,
        &[],
    ),
    written(
        "lz4.parquet",
        "PyArrow",
        "LZ4",
        1e-3,
        &["u = column `u [mv]`"],
    ),
    Written {
        refused: true,
        ..written(
            "brotli.parquet",
            "PyArrow",
            "Brotli",
            0.0,
            &["compressed by BROTLI", "expected Snappy"],
        )
    },
    written(
        "frame.feather",
        "pandas",
        "LZ4, a column of text",
        1e-5,
        &["columns that hold no numbers are left aside: `comment`"],
    ),
    written(
        "batches.arrow",
        "PyArrow",
        "not compressed, time stamps, two batches",
        1e-3,
        &["u = column `u [mv]`"],
    ),
    Written {
        refused: true,
        ..written(
            "zstd.feather",
            "PyArrow",
            "Zstandard",
            0.0,
            &["compressed by Zstandard", "expected LZ4"],
        )
    },
    written(
        "book.xlsx",
        "openpyxl",
        "two sheets",
        1e-9,
        &["sheet `record` is read, of 2", "t = column `t [ms]`"],
    ),
    written(
        "floats.wav",
        "SciPy",
        "two channels of floats",
        1e-5,
        &["column 1 is taken for the drive"],
    ),
    Written {
        units: Some(["50V", "20um"]),
        ..written(
            "codes.wav",
            "SciPy",
            "two channels of 16-bit codes",
            2e-3,
            &["shares of full scale"],
        )
    },
    written("comma.csv", "pandas", "commas, names with units", 1e-9, &[]),
    written(
        "numbered_rows.csv",
        "pandas",
        "a first column that counts rows",
        1e-9,
        &[],
    ),
    written(
        "no_header.csv",
        "pandas",
        "no names",
        1e-9,
        &["column 2 is taken for the drive"],
    ),
    written(
        "quoted.csv",
        "pandas",
        "everything between quotation marks",
        1e-9,
        &[],
    ),
    written("exponents.csv", "pandas", "exponents", 1e-7, &[]),
    written(
        "byte_order_mark.csv",
        "pandas",
        "a byte-order mark, lines that end as on Windows",
        1e-9,
        &[],
    ),
    written("tabs.txt", "pandas", "tabs, UTF-16", 1e-9, &[]),
    written(
        "aligned.txt",
        "pandas",
        "columns aligned by spaces",
        1e-6,
        &[],
    ),
    written(
        "decimal_commas.csv",
        "pandas",
        "semicolons, decimal commas, Latin-1",
        1e-9,
        &["commas as decimal sign", "read as Latin-1"],
    ),
    written(
        "units_in_second_line.csv",
        "pandas",
        "names and units in two lines",
        1e-9,
        &["y = column `position [nm]`"],
    ),
    written(
        "time_of_day.csv",
        "pandas",
        "times of day",
        1e-9,
        &["t = column `time`"],
    ),
    written(
        "date_and_time.csv",
        "pandas",
        "dates with times of day",
        1e-9,
        &["t = column `time`"],
    ),
];

/// The files that are kept, or those that `cargo xtask python` has just had written.
pub fn folder() -> PathBuf {
    std::env::var_os("HYSTERON_FORMATS").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../library/tests/formats"),
        PathBuf::from,
    )
}

/// Damage of twelve kinds.
pub fn damaged(whole: &[u8]) -> [(&'static str, Vec<u8>); 12] {
    let n = whole.len();
    let cut = |to: usize| whole[..to].to_vec();
    let changed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = whole.to_vec();
        change(&mut bytes);
        bytes
    };
    [
        ("nothing left", Vec::new()),
        ("one byte left", cut(1)),
        ("40 bytes left", cut(40)),
        ("a quarter left", cut(n / 4)),
        ("half left", cut(n / 2)),
        ("the last quarter lost", cut(3 * n / 4)),
        ("the last byte lost", cut(n - 1)),
        ("another first byte", changed(&|b| b[0] ^= 0xff)),
        ("zeros from the middle on", changed(&|b| b[n / 2..].fill(0))),
        (
            "a bit of every 97th byte flipped",
            changed(&|b| (0..n).step_by(97).for_each(|i| b[i] ^= 1 << (i % 8))),
        ),
        ("upside down", changed(&|b| b.reverse())),
        (
            "17 bytes lost after a third",
            [&whole[..n / 3], &whole[n / 3 + 17..]].concat(),
        ),
    ]
}

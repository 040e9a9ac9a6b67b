//! Decoders that other people wrote: where one of them panics over damaged bytes, the file is refused like
//! any other that is damaged.
//!
//! Found by giving real files a few other bytes: a Parquet file with a negative offset ends in an assertion
//! of its decoder. A program that keeps its own panic hook asks [`is_decoding`] and stays silent then.

use crate::dataset::table::Table;
use crate::error::{Error, Result};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread is inside a decoder: what panics there becomes an error.
#[must_use]
pub fn is_decoding() -> bool {
    DECODING.get()
}

/// Runs a decoder.
pub(super) fn guarded(
    place: &str,
    format: &str,
    decode: impl FnOnce() -> Result<Table>,
) -> Result<Table> {
    DECODING.set(true);
    let read = catch_unwind(AssertUnwindSafe(decode));
    DECODING.set(false);
    read.unwrap_or_else(|_| {
        Err(Error::new(
            place,
            format!("cannot be read as {format}: its parts contradict each other; is it damaged?"),
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_a_damaged_file() {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !is_decoding() {
                usual(panic);
            }
        }));
        let refused =
            guarded("a.parquet", "Parquet", || panic!("a length below zero")).expect_err("refused");
        assert!(
            refused.to_string().contains("damaged") && !is_decoding(),
            "{refused}"
        );
    }
}

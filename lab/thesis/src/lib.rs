//! The thesis' experiments, played on the reference bench and identified from what the sensor read.
//!
//! # How it works
//! Each chapter is a module with one function that plays the experiments as the thesis describes them, identifies the models from those
//! noisy records, and hands back a [`Chapter`]: figures with their identifiers (those of `goals.toml`) and the sections of a report page.
//! Nothing here knows what would be a good figure; goals and the thesis' own figures are read from `goals.toml` for the report only.
//!
//! The constants of the bench are used by the simulation alone ([`hysteron_sim::bench`]); an identification sees only records, the
//! sampling rate and the limits of the drive.

mod bench_runs;
mod chapter;
mod chapter_3;
mod chapter_4;
mod chapter_5;
mod chapter_6;
mod chapter_7;
pub mod commissioning;
mod comparison;
pub mod coverage;
mod fair_tuning;
mod figures;
pub mod float_twin;
mod goals;
pub mod least_squares;
pub mod overview;
mod robustness;
pub mod surface_fit;

pub use bench_runs::{commission, run, sine_reference_um};
pub use chapter::{Chapter, Progress, Row};
pub use goals::{Goal, goals};

/// Chapters that can be reproduced here.
pub const CHAPTERS: [u32; 5] = [3, 4, 5, 6, 7];

/// Reproduces one chapter.
///
/// # Errors
/// A message if the chapter is not known or an identification fails.
pub fn chapter(number: u32, progress: Progress) -> Result<Chapter, String> {
    match number {
        3 => chapter_3::reproduce(progress),
        4 => chapter_4::reproduce(progress),
        5 => chapter_5::reproduce(progress),
        6 => chapter_6::reproduce(progress),
        7 => chapter_7::reproduce(progress),
        _ => Err(format!("chapter {number} has nothing to reproduce: choose from {CHAPTERS:?}")),
    }
}

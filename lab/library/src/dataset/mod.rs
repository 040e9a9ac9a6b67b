//! Data sets: records of drive and displacement with what is known about them.
//!
//! * [`Record`] holds the signals of one recording, [`Dataset`] the records of one actuator; [`Dataset::new`]
//!   checks them, and reports whatever is wrong with record and sample;
//! * [`readers`]: the bytes of one file of numbers as a [`table`] of named columns; [`recognise`]: which
//!   column is what, by names, [`units`] and [`behaviour`]; [`time_axis`]: even samples from stamps that need
//!   not be even; [`timing`]: when a drive acts; [`manifest`]: the `dataset.toml` of a folder;
//!   [`one_recording`]: which part of a single file is fitted and which judges, by `motion_sections`;
//!   [`reading`]: all of it together (feature `readers`). None of them opens a file: whoever calls hands in
//!   the bytes, or [`folder`] does (feature `files`).
//! * [`drive_variety`]: what the drives can show at all; [`reading_grid`]: the steps that a converter leaves
//!   in the readings. [`issue`]: what is wrong with records.
//!
//! The only timing convention inside the program is `hold_after_sample`: `y[k]` is sampled at `t[k]`, `u[k]`
//! acts from `t[k]` to `t[k+1]`.

#[cfg(feature = "readers")]
pub mod behaviour;
pub(crate) mod checks;
pub mod circumstances;
pub mod column_rules;
mod data_set;
pub mod drive_variety;
#[cfg(feature = "readers")]
mod even_signals;
#[cfg(feature = "files")]
pub mod folder;
pub mod holds;
pub mod issue;
pub mod issue_words;
mod made;
#[cfg(feature = "readers")]
pub mod manifest;
#[cfg(feature = "readers")]
mod motion_sections;
#[cfg(feature = "readers")]
pub mod one_recording;
mod one_timing;
mod overview;
#[cfg(feature = "readers")]
pub mod readers;
#[cfg(feature = "readers")]
pub mod reading;
pub mod reading_grid;
#[cfg(feature = "readers")]
pub mod recognise;
mod record;
#[cfg(feature = "readers")]
pub mod table;
#[cfg(feature = "readers")]
pub mod time_axis;
pub mod timing;
pub mod units;

pub use data_set::Dataset;
pub use record::{Periods, PlayedDrive, Record, Role};

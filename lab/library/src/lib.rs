//! Hysteron as a library: what a model of a piezoelectric actuator misses on recordings, the better model,
//! and the servo made from it.
//!
//! * [`dataset`]: records of drive and displacement; [`synthetic`]: simulated ones whose truth is known;
//! * [`identification`]: least squares over the whole chain, the noise floor;
//! * [`diagnosis`]: which physical effect is missing; [`analyse`](mod@analyse): the main job; [`outcome`]:
//!   what it comes to;
//! * [`mod@simulate`]: a model under any drive; [`servo`]: design, check and track; [`model_file`]: models as
//!   text;
//! * [`capture`]: the firmware's trace as a data set (feature `trace`).
//!
//! Nothing here opens a file, prints, or reads a clock: callers hand in bytes and arrays and get typed
//! results.
//!
//! ```
//! use hysteron::analyse::{Options, Start, analyse};
//! use hysteron::outcome::Verdict;
//! use hysteron::{Dataset, Record, Role, model_file::effects_named, watch::Unwatched};
//!
//! // Two recordings at 1 kHz of a stage that is linear but for a lag of its sensor; the second only judges.
//! let drive_v = |hz: f64| -> Vec<f64> {
//!     let turn = 0.002 * std::f64::consts::PI * hz;
//!     (0..2000).map(|k| 5.0 - 5.0 * (turn * f64::from(k)).cos()).collect()
//! };
//! let lagging_um = |drive_v: &[f64]| -> Vec<f64> {
//!     let mut reading_um = 0.0;
//!     let readings = drive_v.iter().enumerate().map(|(k, u)| {
//!         let now_um = reading_um + 1e-3 * (78.233 * (k * k) as f64).sin();
//!         reading_um += 0.4 * (0.1 * u - reading_um);
//!         now_um
//!     });
//!     readings.collect()
//! };
//! let record = |name: &str, hz: f64| {
//!     Record::new(name, 1000.0, drive_v(hz), lagging_um(&drive_v(hz))).from_virgin_state()
//! };
//! let records = vec![record("fitted", 20.0), record("judging", 33.0).with_role(Role::Validate)];
//! let dataset = Dataset::new("my stage", 0.0, 10.0, records)?;
//!
//! let found = analyse(&dataset, Start::Effects(&effects_named("gain")?), &Options::default(), &Unwatched)?;
//! // The equal periods of the drives show the noise, and the lag brings the error down to it.
//! let diagnosis = &found.diagnosis;
//! assert!(matches!(diagnosis.verdict, Verdict::Named | Verdict::Ambiguous), "{}", diagnosis.sentence);
//! assert!(found.last().error_um() < 0.01 * found.steps[0].judged.error_um());
//! # Ok::<(), hysteron::Error>(())
//! ```

pub mod analyse;
#[cfg(feature = "trace")]
pub mod capture;
pub mod dataset;
pub mod diagnosis;
pub mod effect_reference;
pub mod engineering;
pub mod error;
pub mod export;
pub mod figures;
pub mod identification;
pub mod identify;
pub mod model_file;
pub mod outcome;
mod parallel;
pub mod prediction;
pub mod quality;
pub mod replay;
pub mod response;
pub mod series;
pub mod servo;
pub mod several_axes;
pub mod simulate;
pub mod spectrum;
pub mod statistics;
pub mod synthetic;
pub mod toml_file;
pub mod watch;

pub use dataset::{Dataset, Record, Role};
pub use error::{Error, Result};

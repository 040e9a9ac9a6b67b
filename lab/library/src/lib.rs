//! Hysteron as a library: what a model of a piezoelectric actuator misses on recordings, the better model,
//! and the servo made from it.
//!
//! * [`Dataset`], [`Record`]: drive and displacement as they were recorded; [`simulate_case`]: simulated ones
//!   whose truth is known;
//! * [`analyse`](fn@analyse): the main job, from a model and recordings to an [`Outcome`];
//!   [`identify`](fn@identify) and [`add`]: effects of the caller's choice;
//! * [`Model`]: effects in the order of the chain; [`effects_named`], [`own_effect`]: [`Effect`]s by name
//!   and of one's own; [`to_toml`], [`from_toml`]: models as text; [`export`](fn@export): as MATLAB, Python
//!   or C;
//! * [`simulate`](fn@simulate): a model under any drive; [`replays`]: the saved model against whole
//!   recordings;
//! * [`servo`]: design, check and track.
//!
//! Nothing here opens a file, prints, or reads a clock: callers hand in bytes and arrays and get typed
//! results. What is not on this page is there for the programs of the project and may change.
//!
//! ```
//! use hysteron::{Dataset, Options, Record, Role, Start, Unwatched, Verdict, analyse, effects_named};
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

#[doc(hidden)]
pub mod analyse;
#[cfg(feature = "trace")]
#[doc(hidden)]
pub mod capture;
#[doc(hidden)]
pub mod dataset;
#[doc(hidden)]
pub mod diagnosis;
#[doc(hidden)]
pub mod effect_reference;
#[doc(hidden)]
pub mod engineering;
#[doc(hidden)]
pub mod error;
#[doc(hidden)]
pub mod export;
#[doc(hidden)]
pub mod figures;
#[doc(hidden)]
pub mod identification;
#[doc(hidden)]
pub mod identify;
#[doc(hidden)]
pub mod least_squares;
mod loop_figures;
#[doc(hidden)]
pub mod model_file;
#[doc(hidden)]
pub mod origin;
#[doc(hidden)]
pub mod outcome;
#[doc(hidden)]
mod parallel;
#[doc(hidden)]
pub mod phrases;
#[doc(hidden)]
pub mod prediction;
#[doc(hidden)]
pub mod quality;
#[doc(hidden)]
pub mod replay;
#[doc(hidden)]
pub mod response;
#[doc(hidden)]
pub mod rig_diagnosis;
#[doc(hidden)]
pub mod series;
pub mod servo;
#[doc(hidden)]
pub mod several_axes;
#[doc(hidden)]
pub mod simulate;
#[doc(hidden)]
pub mod spectrum;
#[doc(hidden)]
pub mod statistics;
#[doc(hidden)]
pub mod stepping;
#[doc(hidden)]
pub mod survey;
#[doc(hidden)]
pub mod sweep;
#[doc(hidden)]
pub mod synthetic;
#[doc(hidden)]
pub mod toml_file;
#[doc(hidden)]
pub mod watch;

pub use analyse::{NextExperiment, Options, Outcome, Start, analyse};
pub use dataset::{Dataset, Record, Role};
pub use diagnosis::policy::Policy;
pub use error::{Error, Result};
pub use export::{Language, export};
pub use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
pub use hysteron_sim::effect::{Effect, Overview};
pub use hysteron_sim::noise::WhiteNoise;
pub use hysteron_sim::waveform;
pub use identify::{Identification, add, identify};
pub use model_file::{effect_named, effects_named, from_toml, own_effect, to_toml};
pub use outcome::{Diagnosis, Evidence, Finding, Remainder, Verdict};
pub use replay::{Replay, replays};
pub use simulate::simulate;
pub use synthetic::case::{CaseOrder, SyntheticCase, simulate_case};
pub use watch::{Deadline, Unwatched, Watch, WatchEvent};

//! Servo design: from an identified model to the integers of the control tick, proved for the sampled loop.
//!
//! [`design()`] makes a [`ServoDesign`] for a model or refuses with the reason, [`check()`] proves it on
//! the model and [`follow`] shows it at work.
//!
//! ```
//! use hysteron::servo::{Demands, Reference, Work, check, design, follow, with_scheme};
//! use hysteron::{EffectInstance, Model, Overview, effect_named};
//!
//! let mut stage = Model::new(0.0, 100.0);
//! let overview = Overview::without_data(0.0, 100.0);
//! for (id, values) in [("gain", &[0.1][..]), ("vibration", &[4000.0, 0.4])] {
//!     stage.add(EffectInstance::new(effect_named(id)?, &overview, values));
//! }
//! let servo = design(&stage, &Demands { sensor_noise_um: 0.004, ..Demands::default() })?;
//! assert!(check(&servo, &stage)?.stable);
//! let reference = Reference::named("sine:10:4", servo.period_s())?;
//! let track = follow(&stage, &servo, &reference, "sine:10:4", &Work::default())?;
//! assert!(track.truth.rms_um < 0.02);
//! // The same stage without feedback, for comparison.
//! let open = with_scheme(&servo, "feedforward")?;
//! assert!(follow(&stage, &open, &reference, "sine:10:4", &Work::default()).is_ok());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[doc(hidden)]
pub mod amplifier_block;
#[doc(hidden)]
pub mod assessment;
#[doc(hidden)]
pub mod candidate;
#[doc(hidden)]
pub mod chain_plant;
#[doc(hidden)]
pub mod check;
#[doc(hidden)]
pub mod commands;
#[doc(hidden)]
pub mod creep;
#[doc(hidden)]
pub mod data_of_stage;
#[doc(hidden)]
pub mod design;
#[doc(hidden)]
pub mod disturbance;
#[doc(hidden)]
pub mod disturbance_observer;
#[doc(hidden)]
pub mod explanation;
#[doc(hidden)]
pub mod feedforward;
#[doc(hidden)]
pub mod from_rest;
#[doc(hidden)]
pub mod gain_adaptation;
#[doc(hidden)]
pub mod known;
#[doc(hidden)]
pub mod law;
#[doc(hidden)]
pub mod learned_feedforward;
#[doc(hidden)]
pub mod loop_margins;
#[doc(hidden)]
pub mod members;
#[doc(hidden)]
pub mod model;
#[doc(hidden)]
pub mod moving_mode;
#[doc(hidden)]
pub mod named_scheme;
#[doc(hidden)]
pub mod order;
#[doc(hidden)]
pub mod plant_set;
#[doc(hidden)]
pub mod predictor;
#[doc(hidden)]
pub mod quantise;
#[doc(hidden)]
pub mod recording;
#[doc(hidden)]
pub mod reference;
#[doc(hidden)]
pub mod regulator_loop;
#[doc(hidden)]
pub mod robust;
#[doc(hidden)]
pub mod sampled_loop;
#[doc(hidden)]
pub mod scheme_choice;
#[doc(hidden)]
pub mod schemes;
#[doc(hidden)]
pub mod sensor_lag;
#[doc(hidden)]
pub mod sliding_mode;
#[doc(hidden)]
pub mod stepping_contact;
#[doc(hidden)]
pub mod stepping_design;
#[doc(hidden)]
pub mod stepping_load;
#[doc(hidden)]
pub mod stepping_rig;
#[doc(hidden)]
pub mod thesis_conditions;
#[doc(hidden)]
pub mod thesis_schemes;
#[doc(hidden)]
pub mod track;
#[doc(hidden)]
pub mod tuning;
#[doc(hidden)]
mod value_ranges;
#[doc(hidden)]
pub mod window_fit;
#[doc(hidden)]
pub mod work;

pub use check::{CheckResult, check};
pub use commands::design;
pub use design::{Scheme, ServoDesign};
pub use named_scheme::with_scheme;
pub use order::DesignOrder;
pub use reference::Reference;
pub use track::TrackResult;
pub use tuning::Demands;
pub use work::{Work, follow};

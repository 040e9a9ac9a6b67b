//! Servo design: from an identified model to the integers of the control tick, proved for the sampled loop.
//!
//! * [`model`]: what a design knows of the actuator, and its linear part in continuous and sampled time;
//! * [`quantise`]: from f64 to the rows of the tick, once, with its error;
//! * [`window_fit`]: coefficients over the reference window by least squares in the frequency domain;
//! * [`thesis_schemes`]: the controllers of the thesis as printed, discretised exactly (Ch. 6 and 7), and the
//!   schemes they are compared with;
//! * [`sliding_mode`]: the sliding-mode family in predictor form, for any model and the period of delay;
//!   [`schemes`]: the schemes that a design chooses among;
//! * [`predictor`]: the observer-controller designed for the one-period delay, its margins and its trade-off;
//! * [`order`]: a servo for an identified chain, or the refusal; [`recording`]: what the data exclude;
//!   [`data_of_stage`]: whether they are of the model's stage; [`robust`]: the design for all that is left
//!   possible; [`plant_set`]: plants that are not the model;
//! * [`moving_mode`]: references where the first mode does not stay where it was recorded;
//! * [`learned_feedforward`]: the filters by which a periodic reference's correction is learned, and the
//!   proof that it converges;
//! * [`sensor_lag`]: the known lag of the sensor, which the reference is given too;
//! * [`gain_adaptation`]: bounds within which the gain of the model is corrected while it runs;
//! * [`disturbance_observer`], [`regulator_loop`]: schemes it is compared with, tuned under the same margins;
//! * [`design`]: a design as a file, and the choice of the best one; [`commands`]: check and track for an
//!   identified chain;
//! * `value_ranges`: what a value of a servo file may be;
//! * [`track`]: a design at work on an identified model ([`chain_plant`]);
//! * [`loop_margins`]: how far a loop is from the end of its stability on an actuator; [`from_rest`]: whether
//!   it comes to rest from a limit of its drive;
//! * [`check`]: sampled eigenvalues and the thesis' continuous conditions;
//! * [`amplifier_block`]: a design as the target keeps it.

pub mod amplifier_block;
pub mod chain_plant;
pub mod check;
pub mod commands;
pub mod data_of_stage;
pub mod design;
pub mod disturbance;
pub mod disturbance_observer;
pub mod from_rest;
pub mod gain_adaptation;
pub mod learned_feedforward;
pub mod loop_margins;
pub mod members;
pub mod model;
pub mod moving_mode;
pub mod order;
pub mod plant_set;
pub mod predictor;
pub mod quantise;
pub mod recording;
pub mod reference;
pub mod regulator_loop;
pub mod robust;
pub mod schemes;
pub mod sensor_lag;
pub mod sliding_mode;
pub mod thesis_schemes;
pub mod track;
mod value_ranges;
pub mod window_fit;
pub mod words;

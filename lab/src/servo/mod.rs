//! Servo design: from an identified model to the integers of the control tick, proved for the sampled loop.
//!
//! * [`model`]: what a design knows of the actuator, and its linear part in continuous and sampled time;
//! * [`quantise`]: from f64 to the rows of the tick, once, with its error;
//! * [`window_fit`]: coefficients over the reference window by least squares in the frequency domain;
//! * [`thesis_schemes`]: the controllers of the thesis, discretised exactly (Ch. 6 and 7), and the schemes they are compared with;
//! * [`predictor`]: the observer-controller designed for the one-period delay, its margins and its trade-off;
//! * [`disturbance_observer`], [`regulator_loop`]: schemes it is compared with, tuned under the same margins;
//! * [`fair_tuning`]: the two schemes of the thesis under one optimiser;
//! * [`comparison`]: other schemes under equal conditions; [`robustness`]: Ch. 7, Fig. 12;
//! * [`identify`]: the experiment from which a design gets its model;
//! * [`design`]: a design as a file, and the choice of the best one;
//! * [`reproduce`]: Chapters 6 and 7 on the bench;
//! * [`track`]: a design at work on an identified model;
//! * [`float_twin`]: the predictor in f64, an oracle for its integers;
//! * [`commands`]: what the program does with all this;
//! * [`figures`]: the figures of those chapters with ours;
//! * [`check`]: sampled eigenvalues and the thesis' continuous conditions.

pub mod check;
pub mod commands;
pub mod comparison;
pub mod design;
pub mod disturbance_observer;
pub mod fair_tuning;
pub mod figures;
pub mod float_twin;
pub mod identify;
pub mod model;
pub mod predictor;
pub mod quantise;
pub mod regulator_loop;
pub mod reproduce;
pub mod robustness;
pub mod thesis_schemes;
pub mod track;
pub mod window_fit;

//! The lab of Hysteron: data sets, identification, comparison, diagnosis, servo design, reproduction of the thesis, pages.
//!
//! * [`dataset`]: records and their manifest; [`plant`]: simulated ones with known effects;
//! * [`fit`]: least squares over the whole chain; [`floor`]: the noise; [`refine`]: finer hysteresis surfaces;
//! * [`diagnosis`]: which effect is missing; [`explain`]: the main job; [`score`]: how often it is right;
//! * [`capture`]: the target's trace as a data set; [`amplifier_block`]: a design as the target keeps it;
//! * [`report`]: pages to look at; [`cli`]: the command line; [`problem`]: errors as users see them.

pub mod amplifier_block;
pub mod capture;
pub mod cli;
pub mod dataset;
pub mod diagnosis;
pub mod experiment;
pub mod explain;
pub mod fit;
pub mod floor;
pub mod latent_force;
pub mod model_file;
pub mod plant;
pub mod plant_set;
pub mod problem;
pub mod refine;
pub mod report;
pub mod reproduce;
pub mod score;
pub mod servo;
pub mod statistics;

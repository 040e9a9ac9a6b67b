//! Which physical effect is missing, and how sure we are.
//!
//! * [`study`]: data, candidates and thresholds ([`policy`]) of one diagnosis, and the moves that make models;
//! * [`screening`] scores every candidate on the residual of a model without refitting it; [`resonances`] says where modes are looked for;
//! * [`search`] finds the set of effects that meets fitted and held-out records best ([`judgement`]);
//! * [`reduction`] takes back what the data do not need ([`decision`]) and asks the rest for rivals; [`loop_structures`] asks the loops, [`overdamped_mode`] a first mode that is a lag; [`path`] is
//!   the way there, for people;
//! * [`elsewhere`] asks what a model that was identified on other data lacks, or which of its values have changed;
//! * [`initial_states`] asks whether records begin as was said, [`drive_timing`] whether readings follow the drive of their own row, [`feedback`] whether a loop was closed while they were taken;
//! * [`verdict`] puts what came out into one of five words, [`words`] into sentences;
//! * [`residual_map`]: where in the drive a residual lives; [`latent_force`]: what would have to act to leave it;
//! * [`next_experiment`]: the drive on which two explanations differ most.

pub mod decision;
pub mod drive_timing;
pub mod elsewhere;
pub mod feedback;
pub mod initial_states;
pub mod judgement;
pub mod latent_force;
pub mod loop_structures;
pub mod next_experiment;
pub mod overdamped_mode;
pub mod path;
pub mod policy;
pub mod reduction;
pub mod residual_map;
pub mod resonances;
pub mod screening;
pub mod search;
pub mod searched_data;
pub mod study;
pub mod unanswered;
pub mod verdict;
pub mod words;

//! Which physical effect is missing, and how sure we are.
//!
//! * [`study`]: data, candidates and thresholds ([`policy`]) of one diagnosis, and the fits;
//! * [`screening`] scores every candidate on the residual of a model without refitting it; [`resonances`]
//!   says where modes are looked for;
//! * [`search`] extends models by moves, and every fitted one stays in the [`pool`]; [`prior`] does the same
//!   beside a prior model;
//! * [`selection`]: the simplest models that the data cannot reject, by their [`confidence_set`]; [`closure`]:
//!   single moves around these, so that what could stand in their place is in the pool;
//! * [`findings`]: what these models have in common and where they differ, with the evidence; [`verdict`]:
//!   the word for it; [`reporting`]: the typed outcome;
//! * [`path`]: the way from the start to the model at the end; [`words`]: sentences;
//! * [`residual_map`]: where in the drive a residual lives; [`latent_force`]: what would have to act to leave
//!   it;
//! * [`next_experiment`]: the drive on which two explanations differ most.

pub mod closure;
pub mod confidence_set;
pub mod findings;
pub mod judgement;
pub mod latent_force;
pub mod next_experiment;
pub mod path;
pub mod policy;
pub mod pool;
pub mod prior;
pub mod reporting;
pub mod residual_map;
pub mod resonances;
pub mod screening;
pub mod search;
pub mod searched_data;
pub mod selection;
pub mod study;
pub mod verdict;
pub mod words;

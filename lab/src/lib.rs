//! The lab of Hysteron: data sets, identification, comparison, diagnosis.
//!
//! * [`dataset`]: records and their manifest; * [`fit`]: least squares over the whole chain;
//! * [`report`]: pages to look at; [`problem`]: errors as users see them;
//! * [`servo`]: controllers designed from an identified model.

pub mod dataset;
pub mod experiment;
pub mod fit;
pub mod problem;
pub mod report;
pub mod reproduce;
pub mod servo;

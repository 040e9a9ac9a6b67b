//! Studies behind `docs/results`, on stages that the simulation does not share.
//!
//! Their examples print the tables of `docs/results`. Of each study and of each chapter of the thesis the tests
//! keep a sample. Neither the default build nor `cargo xtask quick` compiles this crate.

pub mod adaptation_study;
pub mod learning_study;
pub mod light_mode_study;
pub mod other_actuators;

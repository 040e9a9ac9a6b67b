//! Studies behind `docs/results`, on stages that the simulation does not share.
//!
//! Their examples print the tables of `docs/results`. Of each study and of each chapter of the thesis the tests
//! keep a sample. Neither the default build nor `cargo xtask quick` compiles this crate.

pub mod adaptation_study;
pub mod learning_study;
pub mod light_mode_study;
pub mod other_actuators;
pub mod published_stepping;
pub mod rig_diagnosis_study;
pub mod stick_slip_study;

/// The numbers of the stages of a study: `COUNT FIRST` on its command line, else 24 from 0 on.
#[must_use]
pub fn stages_asked_for() -> std::ops::Range<u64> {
    let mut numbers = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse::<u64>().ok());
    let (count, first) = (numbers.next().unwrap_or(24), numbers.next().unwrap_or(0));
    first..first + count
}

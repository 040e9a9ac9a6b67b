//! Tests of the library through its public items: one program, so that dependencies are linked once.

mod example;
mod exports;
mod faults;
mod formats;
mod how_it_was_recorded;
mod prediction;
mod replay;
mod several_axes;
mod slow_noise;
mod stages_written_by_hand;
mod text_files;
mod verdicts;

//! Tests of the library through its public items: one program, so that dependencies are linked once.

mod decision;
mod example;
mod formats;
mod how_it_was_recorded;
mod slow_noise;
mod stages_written_by_hand;
mod text_files;

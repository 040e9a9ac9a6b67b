//! Tests of the simulation across its files: one program, so that dependencies are linked once.

mod between_marks;
mod block_swap;
mod every_effect;
mod integer_hysteresis;
mod readme;
mod variations;
mod wide_codes;

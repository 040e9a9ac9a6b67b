//! Samples of the studies and of the thesis: one program, so that dependencies are linked once.

mod learned_feedforward;
mod light_mode;
mod other_actuators;
mod slow_adaptation;
mod thesis;

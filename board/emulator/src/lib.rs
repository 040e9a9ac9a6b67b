//! The firmware in the loop without hardware: the unmodified image runs on an emulated STM32H743 in virtual
//! time.
//!
//! [`board`] is the board around the part, [`converters`] its converters with the float plant behind them,
//! [`real_time_transfer`] is the probe's side of RTT, [`serial_line`] the far end of the serial port, [`run`]
//! puts them together and decodes the log, [`live_run`] serves programs outside. The emulated part counts
//! instructions, not cycles: what is measured here is function and instruction counts, never the timing of
//! hardware.

pub mod board;
pub mod converters;
pub mod live_run;
pub mod real_time_transfer;
pub mod run;
pub mod running_board;
pub mod serial_line;
pub mod serial_socket;

//! The emulated board as its programs use it.

pub mod running_board;
pub mod serial_socket;

//! The operator's side of the amplifier: what a program on the host does with the board's serial port.
//!
//! # How it works
//! [`port::Port`] carries bytes, over a cable or a socket; [`board::Board`] has the conversation: it asks,
//! tells and looks at `ERR?` after what it told, all in the General Command Set 2.0 (`hysteron_protocol`). On
//! that stand [`upload`] (a parameter block), [`update`] (another [`image`]), [`playing`] (a drive that is
//! played from rest, and what the recorder saw of it), [`watching`] (what a scope shows), [`scale`] (codes in
//! um and V), [`condition`] (how the board is, in words), [`fault`] (what an
//! operator does about a fault) and [`following`] (how well its closed loop followed).
//!
//! A board may be slower than its hardware, where it is emulated: nothing here reckons with the clock. What
//! is waited for is asked for again and again; the client gives up a board only when not a byte has come for
//! [`board::PATIENCE`].

pub mod board;
pub mod condition;
mod error;
pub mod fault;
pub mod following;
pub mod image;
pub mod playing;
pub mod port;
pub mod scale;
pub mod update;
pub mod upload;
pub mod watching;

pub use error::{Error, Result};

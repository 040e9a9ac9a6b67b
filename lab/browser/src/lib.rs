//! The lab as one page: what a browser's worker may ask of the library.
//!
//! A question is JSON with bytes behind it (the files that somebody dropped); an answer is JSON with columns
//! of numbers behind it. The same [`LabSession`] answers in a test on the host and in the browser:
//!
//! * [`session`]: the data, the model and the last explanation, and what is asked of them;
//! * [`recording`]: a data set from whatever files were dropped, with the roles that a person gave its
//!   records;
//! * [`answers`]: answers to the page, as plain structs;
//! * `servo`: design, margins and a reference followed, of the model at hand;
//! * [`asker`]: who receives every step and may cancel a question; [`served`]: the data set that a program
//!   was started with;
//! * `exports` (WebAssembly only): four functions over linear memory. No other file of the workspace exports
//!   any;
//! * `server` (elsewhere): the same questions over HTTP, for `hysteron lab`; `local_server`: a page for this
//!   machine alone, whose it is.
//!
//! The page itself is written by hand in `web/`; `cargo xtask lab` packs it and this module into one file.

pub mod answers;
pub mod asker;
#[cfg(target_arch = "wasm32")]
mod exports;
#[cfg(not(target_family = "wasm"))]
pub mod local_server;
pub mod recording;
pub mod served;
#[cfg(not(target_family = "wasm"))]
pub mod server;
mod servo;
pub mod session;

pub use session::LabSession;

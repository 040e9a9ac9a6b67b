//! The functions that the worker calls, over linear memory: `hysteron_reserve` makes room for a question,
//! `hysteron_ask` answers it and says how long the answer is, `hysteron_answer` says where it stands. While a
//! search goes on, the import `progress` receives every step.
//!
//! Unsafe code is confined to this file: three names that are exported and one function that is imported.
#![allow(unsafe_code)]

use crate::session::LabSession;
use std::cell::RefCell;

#[derive(Default)]
struct Desk {
    session: LabSession,
    question: Vec<u8>,
    answer: Vec<u8>,
}

thread_local! {
    static DESK: RefCell<Desk> = RefCell::default();
}

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Takes a text of `length` bytes at `text`; it does not keep the address.
    fn progress(text: *const u8, length: usize);
}

fn tell(text: &str) {
    // SAFETY: the page reads the bytes before it returns.
    unsafe { progress(text.as_ptr(), text.len()) }
}

/// Room for a question of `length` bytes; the address is valid until the next call.
#[unsafe(no_mangle)]
pub extern "C" fn hysteron_reserve(length: usize) -> *mut u8 {
    DESK.with_borrow_mut(|desk| {
        desk.answer = Vec::new();
        desk.question = vec![0; length];
        desk.question.as_mut_ptr()
    })
}

/// Answers the question and gives the length of the answer.
#[unsafe(no_mangle)]
pub extern "C" fn hysteron_ask() -> usize {
    std::panic::set_hook(Box::new(|what| {
        tell(&serde_json::json!({ "broken": what.to_string() }).to_string())
    }));
    DESK.with_borrow_mut(|desk| {
        let question = std::mem::take(&mut desk.question);
        desk.answer = desk.session.answer(&question, &tell);
        desk.answer.len()
    })
}

/// Where the answer stands; valid until the next call of `hysteron_reserve`.
#[unsafe(no_mangle)]
pub extern "C" fn hysteron_answer() -> *const u8 {
    DESK.with_borrow(|desk| desk.answer.as_ptr())
}

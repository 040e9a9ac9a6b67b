//! Who asks a question that takes long: a page, whether its engine is in it or behind it.

use crate::answers;
use hysteron::watch::{Watch, WatchEvent};

/// Who asked: receives every step of a search as JSON, and may cancel the question.
pub trait Asker: Sync {
    /// A step, as JSON.
    fn tell(&self, step: &str);

    /// Whether nobody waits for the answer any more.
    fn has_left(&self) -> bool {
        false
    }
}

impl<F: Fn(&str) + Sync> Asker for F {
    fn tell(&self, step: &str) {
        self(step);
    }
}

/// Hands the events of a search to who asked.
pub struct Teller<'a>(pub &'a dyn Asker);

impl Watch for Teller<'_> {
    fn event(&self, event: &WatchEvent<'_>) {
        self.0.tell(&answers::event(event).to_string());
    }

    fn stopped(&self) -> bool {
        self.0.has_left()
    }
}

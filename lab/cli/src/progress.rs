//! A line that says what is being done, on terminals only; while a search goes on, Ctrl-C asks for the best
//! result so far.

use hysteron::watch::{Watch, WatchEvent};
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Ctrl-C was pressed.
static STOP: AtomicBool = AtomicBool::new(false);
static HANDLER: Once = Once::new();

/// The line; it is gone when this is dropped.
pub struct Progress {
    bar: ProgressBar,
    every_event: bool,
    began: Instant,
    /// Percent of the budget that is used.
    used_percent: AtomicU64,
}

impl Progress {
    /// Starts it for work of which a part is worth nothing: Ctrl-C ends the program.
    pub fn start() -> Self {
        Self::with(false)
    }

    /// Starts it for a search: the first Ctrl-C asks for the best result so far, the second ends the program.
    /// With `every_event` each is a line of its own, with the seconds since the beginning.
    pub fn of_search(every_event: bool) -> Self {
        HANDLER.call_once(|| {
            // Where no handler can be set, Ctrl-C ends the program as it always does.
            let _ = ctrlc::set_handler(|| {
                if STOP.swap(true, Ordering::SeqCst) {
                    std::process::exit(130);
                }
                eprintln!("ending with what is known by now, which takes some seconds; once more to end at once");
            });
        });
        Self::with(every_event)
    }

    fn with(every_event: bool) -> Self {
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed:>4} {wide_msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        Self {
            bar,
            every_event,
            began: Instant::now(),
            used_percent: AtomicU64::new(0),
        }
    }

    /// Says what is being done now.
    pub fn say(&self, message: &str) {
        if self.every_event {
            eprintln!("{:7.2} s  {message}", self.began.elapsed().as_secs_f64());
        }
        let used = match self.used_percent.load(Ordering::Relaxed) {
            0 => String::new(),
            percent => format!("{percent} % of the budget  "),
        };
        self.bar.set_message(format!("{used}{message}"));
    }
}

impl Watch for Progress {
    fn event(&self, event: &WatchEvent<'_>) {
        if let WatchEvent::Used { share } = event {
            let percent = (100.0 * share).round() as u64;
            self.used_percent.store(percent, Ordering::Relaxed);
            return;
        }
        self.say(&event.to_string());
    }

    fn stopped(&self) -> bool {
        STOP.load(Ordering::SeqCst)
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

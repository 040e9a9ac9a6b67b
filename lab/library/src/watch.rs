//! What a long computation tells while it goes on, and how it is stopped.

use std::fmt;
use std::time::{Duration, Instant};

/// Told of every step of a search; may ask it to stop.
/// ```
/// use hysteron::{Deadline, Watch, WatchEvent};
/// use std::time::Duration;
///
/// /// Prints the models that are better than all before.
/// struct Prints;
///
/// impl Watch for Prints {
///     fn event(&self, event: &WatchEvent<'_>) {
///         if let WatchEvent::Tried { best: true, .. } = event {
///             println!("{event}");
///         }
///     }
/// }
///
/// // `analyse` takes either.
/// let within_a_minute = Deadline::new(&Prints, Duration::from_secs(60));
/// assert!(within_a_minute.time_used() < 1.0 && !within_a_minute.stopped());
/// ```
pub trait Watch: Sync {
    /// Something begins, or came out.
    fn event(&self, event: &WatchEvent<'_>);

    /// Whether the caller wants the best result so far.
    fn stopped(&self) -> bool {
        false
    }

    /// The share of the caller's time that is over: at one the answer is due.
    fn time_used(&self) -> f64 {
        0.0
    }
}

/// A watch for a caller who wants the answer within about so long.
pub struct Deadline<'w> {
    watch: &'w dyn Watch,
    began: Instant,
    within: Duration,
}

impl<'w> Deadline<'w> {
    /// Time that runs from now, beside another watch.
    #[must_use]
    pub fn new(watch: &'w dyn Watch, within: Duration) -> Self {
        Self {
            watch,
            began: Instant::now(),
            within,
        }
    }
}

impl Watch for Deadline<'_> {
    fn event(&self, event: &WatchEvent<'_>) {
        self.watch.event(event);
    }

    fn stopped(&self) -> bool {
        self.watch.stopped()
    }

    fn time_used(&self) -> f64 {
        self.began.elapsed().as_secs_f64() / self.within.as_secs_f64()
    }
}

/// Nobody watches.
pub struct Unwatched;

impl Watch for Unwatched {
    fn event(&self, _event: &WatchEvent<'_>) {}
}

/// What happens in a search.
#[derive(Clone, Debug)]
pub enum WatchEvent<'a> {
    /// A list of effects is fitted.
    Fitting {
        /// The effect that joins now.
        effect: &'a str,
    },
    /// Candidates are scored on what a model leaves.
    Scoring {
        /// How many.
        candidates: usize,
        /// Effects that have been added so far.
        beside: &'a [String],
    },
    /// A set of effects was fitted.
    Tried {
        /// What was added to the start.
        added: &'a [String],
        /// Error on fitted records, um RMS.
        identify_rms_um: f64,
        /// Error on held-out records, um RMS.
        validate_rms_um: Option<f64>,
        /// It is the best so far.
        best: bool,
    },
    /// So much of the budget is used.
    Used {
        /// The share, 0..1.
        share: f64,
    },
    /// A part of the work that has no figures of its own.
    Doing(
        /// What.
        &'static str,
    ),
}

impl fmt::Display for WatchEvent<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |ids: &[String]| {
            if ids.is_empty() {
                "the start".to_owned()
            } else {
                ids.join(", ").replace('_', " ")
            }
        };
        match self {
            Self::Fitting { effect } => write!(f, "fitting {}", effect.replace('_', " ")),
            Self::Scoring { candidates, beside } => write!(
                f,
                "scoring {candidates} candidate effects beside {}",
                list(beside)
            ),
            Self::Tried {
                added,
                identify_rms_um,
                validate_rms_um,
                best,
            } => {
                let error_um = validate_rms_um.unwrap_or(*identify_rms_um);
                write!(
                    f,
                    "{}{}: {:.3} nm",
                    if *best { "best so far: " } else { "" },
                    list(added),
                    1e3 * error_um
                )
            }
            Self::Used { share } => write!(f, "{:.0} % of the budget used", 100.0 * share),
            Self::Doing(what) => write!(f, "{what}"),
        }
    }
}

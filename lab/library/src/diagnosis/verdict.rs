//! The verdict: one of five words for what was found, and the reason where nothing can be decided. A function
//! of facts alone.

use serde::Serialize;

/// The verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing is missing that the data could show.
    AtFloor,
    /// These effects are missing: every simplest model that the data cannot reject has them.
    Named,
    /// As named; where it says "or" the simplest models differ.
    Ambiguous,
    /// The error is above the noise, and the simplest models share no effect.
    Unexplained,
    /// Nothing can be decided, for a [`Reason`].
    Undecidable,
}

impl Verdict {
    /// The word in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Verdict::AtFloor => "at_floor",
            Verdict::Named => "named",
            Verdict::Ambiguous => "ambiguous",
            Verdict::Unexplained => "unexplained",
            Verdict::Undecidable => "undecidable",
        }
    }
}

/// Why a verdict is undecidable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Nothing in the data shows the noise.
    NoiseUnknown,
    /// The error is below the noise: one of them is wrong.
    BelowTheNoise,
    /// The readings do not answer the drive.
    NotAnswered,
    /// Records do not begin in the specified state.
    InitialState,
    /// The readings respond to the drive of the same row, and the search was not repeated with this timing.
    SameSampleTiming,
    /// The drive is not held between its samples.
    RunsOnBetweenSamples,
    /// Somebody stopped the search.
    Stopped,
    /// The time was over before the search was.
    OutOfTime,
    /// All drives repeat one motion, on which loops, lags, delays and modes look alike.
    OneMotion,
    /// What survived its test has no value that the data fix.
    ValuesOpen,
    /// What is missing may be any of many effects, which the data do not distinguish.
    ManyAlternatives,
}

/// What a verdict is decided by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Facts {
    /// What is wrong with the recording, where that forbids an answer.
    pub blocked: Option<Reason>,
    /// Somebody stopped the search.
    pub stopped: bool,
    /// The search ended when its time was over.
    pub out_of_time: bool,
    /// All drives move at one speed between the same two voltages.
    pub one_motion: bool,
    /// The noise is known, or the model at the end leaves no more than its least bound.
    pub noise_known: bool,
    /// The error of the model at the end is below the noise.
    pub below_the_noise: bool,
    /// That error needs no further explanation.
    pub explained: bool,
    /// That error counts as the noise, also where the noise is known to some per cent only.
    pub at_the_noise: bool,
    /// A model with the names and nothing else leaves no more either.
    pub explained_by_names: bool,
    /// The model at the end got an effect whose own physics excludes its values.
    pub excluded: bool,
    /// Something is a name.
    pub named: bool,
    /// One of these is "A or B".
    pub either_or: bool,
    /// All of these are other values of effects of the start.
    pub other_values_only: bool,
    /// Something survived its test and is no name.
    pub open: bool,
    /// All of that is no name because the data fix none of its values.
    pub values_open: bool,
}

impl Facts {
    /// Why nothing, or not all, can be decided.
    #[must_use]
    pub fn reason(&self) -> Option<Reason> {
        // A name that no search tried to do without may be wrong, at the noise as well.
        let matters = self.named || self.open || !self.explained;
        self.blocked
            .or_else(|| self.stopped.then_some(Reason::Stopped))
            .or_else(|| self.below_the_noise.then_some(Reason::BelowTheNoise))
            .or_else(|| (self.out_of_time && matters).then_some(Reason::OutOfTime))
            .or_else(|| {
                let something = self.named || self.open || !self.nothing_is_missing();
                (self.one_motion && something).then_some(Reason::OneMotion)
            })
            .or_else(|| (!self.noise_known).then_some(Reason::NoiseUnknown))
            .or_else(|| {
                let why = if self.values_open {
                    Reason::ValuesOpen
                } else {
                    Reason::ManyAlternatives
                };
                (self.open && !self.named).then_some(why)
            })
    }

    /// The model at the end is at the noise, by the names alone: not by effects that may as well be others.
    fn nothing_is_missing(&self) -> bool {
        self.at_the_noise && self.explained_by_names && !self.excluded
    }

    /// What was found is no name: the search ended early, or no drive could tell names apart.
    #[must_use]
    pub fn names_nothing(&self) -> bool {
        matches!(
            self.reason(),
            Some(Reason::Stopped | Reason::OutOfTime | Reason::OneMotion)
        )
    }

    /// The word.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        match (self.named && !self.names_nothing(), self.reason()) {
            // Nothing is missing where other values reach the noise.
            (true, None) if self.other_values_only && self.at_the_noise => Verdict::AtFloor,
            (true, _) if self.either_or => Verdict::Ambiguous,
            (true, _) => Verdict::Named,
            (false, Some(_)) => Verdict::Undecidable,
            (false, None) if self.nothing_is_missing() => Verdict::AtFloor,
            (false, None) => Verdict::Unexplained,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All combinations of facts, with and without an issue that blocks.
    fn all() -> impl Iterator<Item = Facts> {
        (0..1u32 << 15).map(|bits| {
            let is = |bit: u32| bits >> bit & 1 == 1;
            Facts {
                blocked: is(0).then_some(Reason::NotAnswered),
                stopped: is(1),
                out_of_time: is(2),
                noise_known: is(3),
                below_the_noise: is(4),
                explained: is(5),
                at_the_noise: is(6),
                explained_by_names: is(7),
                excluded: is(8),
                named: is(9),
                either_or: is(10),
                other_values_only: is(11),
                open: is(12),
                one_motion: is(13),
                values_open: is(14),
            }
        })
    }

    /// A search that came to its end on a sound recording, at a noise that is known.
    const SOUND: Facts = Facts {
        blocked: None,
        stopped: false,
        out_of_time: false,
        noise_known: true,
        below_the_noise: false,
        explained: true,
        at_the_noise: true,
        explained_by_names: true,
        excluded: false,
        named: false,
        either_or: false,
        other_values_only: false,
        open: false,
        one_motion: false,
        values_open: false,
    };

    #[test]
    fn every_word_and_every_reason_has_its_facts() {
        let not_explained = Facts {
            explained: false,
            at_the_noise: false,
            explained_by_names: false,
            ..SOUND
        };
        let named = Facts {
            named: true,
            ..not_explained
        };
        let undecidable = |reason| (Verdict::Undecidable, Some(reason));
        for (facts, expected) in [
            (SOUND, (Verdict::AtFloor, None)),
            (not_explained, (Verdict::Unexplained, None)),
            (named, (Verdict::Named, None)),
            (
                Facts {
                    either_or: true,
                    ..named
                },
                (Verdict::Ambiguous, None),
            ),
            // Other values alone are a name above the noise only.
            (
                Facts {
                    other_values_only: true,
                    ..named
                },
                (Verdict::Named, None),
            ),
            (
                Facts {
                    named: true,
                    other_values_only: true,
                    ..SOUND
                },
                (Verdict::AtFloor, None),
            ),
            (
                Facts {
                    named: true,
                    ..SOUND
                },
                (Verdict::Named, None),
            ),
            // At the noise by what is no name.
            (
                Facts {
                    explained_by_names: false,
                    ..SOUND
                },
                (Verdict::Unexplained, None),
            ),
            (
                Facts {
                    excluded: true,
                    ..SOUND
                },
                (Verdict::Unexplained, None),
            ),
            (
                Facts {
                    open: true,
                    ..not_explained
                },
                undecidable(Reason::ManyAlternatives),
            ),
            (
                Facts {
                    open: true,
                    values_open: true,
                    ..not_explained
                },
                undecidable(Reason::ValuesOpen),
            ),
            // One motion shows that nothing is missing, and no name.
            (
                Facts {
                    one_motion: true,
                    ..SOUND
                },
                (Verdict::AtFloor, None),
            ),
            (
                Facts {
                    one_motion: true,
                    ..named
                },
                undecidable(Reason::OneMotion),
            ),
            (
                Facts {
                    one_motion: true,
                    ..not_explained
                },
                undecidable(Reason::OneMotion),
            ),
            (
                Facts {
                    one_motion: true,
                    open: true,
                    ..SOUND
                },
                undecidable(Reason::OneMotion),
            ),
            (
                Facts {
                    one_motion: true,
                    excluded: true,
                    ..SOUND
                },
                undecidable(Reason::OneMotion),
            ),
            (
                Facts {
                    noise_known: false,
                    ..not_explained
                },
                undecidable(Reason::NoiseUnknown),
            ),
            (
                Facts {
                    below_the_noise: true,
                    ..SOUND
                },
                undecidable(Reason::BelowTheNoise),
            ),
            (
                Facts {
                    out_of_time: true,
                    ..not_explained
                },
                undecidable(Reason::OutOfTime),
            ),
            // A search that ended early at the noise with nothing to name missed nothing.
            (
                Facts {
                    out_of_time: true,
                    ..SOUND
                },
                (Verdict::AtFloor, None),
            ),
            (
                Facts {
                    out_of_time: true,
                    open: true,
                    ..SOUND
                },
                undecidable(Reason::OutOfTime),
            ),
            (
                Facts {
                    out_of_time: true,
                    ..named
                },
                undecidable(Reason::OutOfTime),
            ),
            (
                Facts {
                    stopped: true,
                    ..named
                },
                undecidable(Reason::Stopped),
            ),
            (
                Facts {
                    blocked: Some(Reason::InitialState),
                    stopped: true,
                    ..not_explained
                },
                undecidable(Reason::InitialState),
            ),
            // What lowers the error by more than the issue stays a name beside it.
            (
                Facts {
                    blocked: Some(Reason::InitialState),
                    ..named
                },
                (Verdict::Named, Some(Reason::InitialState)),
            ),
        ] {
            assert_eq!((facts.verdict(), facts.reason()), expected, "{facts:?}");
        }
    }

    #[test]
    fn no_combination_of_facts_breaks_what_the_words_mean() {
        for facts in all() {
            let (verdict, reason) = (facts.verdict(), facts.reason());
            let is_name = matches!(verdict, Verdict::Named | Verdict::Ambiguous);
            let holds = match verdict {
                Verdict::AtFloor => facts.at_the_noise && reason.is_none(),
                Verdict::Unexplained => reason.is_none() && !facts.named && !facts.open,
                Verdict::Undecidable => reason.is_some(),
                Verdict::Named => facts.named && !facts.either_or,
                Verdict::Ambiguous => facts.named && facts.either_or,
            };
            assert!(holds, "{facts:?}: {verdict:?} {reason:?}");
            assert!(!(is_name && facts.names_nothing()), "{facts:?}");
            // Whoever stopped a search hears that, unless the recording itself forbids an answer.
            let stopped = facts.stopped && facts.blocked.is_none();
            assert_eq!(reason == Some(Reason::Stopped), stopped, "{facts:?}");
            assert!(
                facts.blocked.is_none() || reason == facts.blocked,
                "{facts:?}"
            );
        }
    }

    #[test]
    fn a_verdict_has_one_word_in_files_and_in_json() {
        for verdict in [
            Verdict::AtFloor,
            Verdict::Named,
            Verdict::Ambiguous,
            Verdict::Unexplained,
            Verdict::Undecidable,
        ] {
            let json = serde_json::to_string(&verdict).expect("a word");
            assert_eq!(json, format!("\"{}\"", verdict.word()));
        }
    }
}

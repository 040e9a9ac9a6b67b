//! Which of two kept blocks is in force.
//!
//! # How it works
//! A block that the board keeps goes where the one in force is not, and once it reads back the other one is
//! marked as replaced. A block that a probe flashes is not marked, whatever stands beside it, because
//! flashing erases the mark with the sector. So two blocks of which just one is marked say which counts; two
//! that differ without that say nothing, and a guess could be 100 V away from what somebody has in mind: then
//! none is in force.

/// A valid block in its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kept {
    /// What tells it from others ([`crate::parameter_block::fingerprint`]).
    pub fingerprint: u32,
    /// Another one was kept in its stead.
    pub replaced: bool,
}

/// What is in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// There is no valid block.
    Nothing,
    /// The one of this place, 0 or 1.
    Place(usize),
    /// Two blocks, and neither replaces the other.
    Ambiguous,
}

/// Chooses between the two places.
#[must_use]
pub fn choose(first: Option<Kept>, second: Option<Kept>) -> Choice {
    match (first, second) {
        (None, None) => Choice::Nothing,
        // The other one is damaged or absent: the last good one.
        (Some(_), None) => Choice::Place(0),
        (None, Some(_)) => Choice::Place(1),
        (Some(a), Some(b)) if a.replaced != b.replaced => Choice::Place(usize::from(a.replaced)),
        (Some(a), Some(b)) if a.fingerprint == b.fingerprint => Choice::Place(0),
        (Some(_), Some(_)) => Choice::Ambiguous,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_of_which_neither_replaces_the_other_is_ambiguous() {
        let kept = |fingerprint, replaced| {
            Some(Kept {
                fingerprint,
                replaced,
            })
        };
        assert_eq!(choose(None, None), Choice::Nothing);
        assert_eq!(
            (choose(kept(1, true), None), choose(None, kept(1, false))),
            (Choice::Place(0), Choice::Place(1))
        );
        assert_eq!(
            (
                choose(kept(1, true), kept(2, false)),
                choose(kept(1, false), kept(2, true))
            ),
            (Choice::Place(1), Choice::Place(0))
        );
        assert_eq!(
            (
                choose(kept(1, false), kept(2, false)),
                choose(kept(1, true), kept(2, true))
            ),
            (Choice::Ambiguous, Choice::Ambiguous)
        );
        assert_eq!(
            choose(kept(1, false), kept(1, false)),
            Choice::Place(0),
            "the same block twice"
        );
    }
}

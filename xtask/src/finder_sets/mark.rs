//! How an answer compares with what is true. A name too many is wrong, an "or" among many says little.

use super::answer::FinderAnswer;

/// An "or" of more effects than this says little.
const SET_MAX: usize = 3;
/// Structures of hysteresis: loops of any are what a model without hysteresis misses.
pub const LOOPS: [&str; 7] = [
    "hysteresis",
    "prandtl_ishlinskii",
    "modified_prandtl_ishlinskii",
    "maxwell_slip",
    "bouc_wen",
    "duhem",
    "activated_switching",
];

/// What is true of a case.
#[derive(Clone, Debug)]
pub enum CaseTruth {
    /// These effects are missing; the second list may be named beside them.
    Missing(Vec<String>, Vec<String>),
    /// What is missing is in no library.
    Outside,
    /// Nothing is missing.
    Nothing,
    /// Any of these does what was done to the recording; the second list belongs to the recording before
    /// that.
    Altered(Vec<String>, Vec<String>),
    /// Nobody knows.
    Unknown,
}

/// The mark of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Exactly what is true.
    Right,
    /// Within an "or".
    InSet,
    /// Within an "or" of more than three.
    LongOr,
    /// Nothing is named, and the fitted model leaves no more than the noise: nobody could.
    Absorbed,
    /// Not named, or not all of it.
    Missed,
    /// An "or" of which nothing is true.
    WrongOr,
    /// A single name that is not true.
    Wrong,
    /// Nothing to compare with.
    Unmarked,
}

impl Mark {
    /// The word in the results.
    pub fn word(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::InSet => "in set",
            Self::LongOr => "long or",
            Self::Absorbed => "absorbed",
            Self::Missed => "missed",
            Self::WrongOr => "wrong or",
            Self::Wrong => "wrong",
            Self::Unmarked => "-",
        }
    }
}

fn same(said: &str, of: &str) -> bool {
    said == of || (of == LOOPS[0] && LOOPS.contains(&said))
}

/// What is true stands among so many.
fn found(alternatives: usize) -> Mark {
    match alternatives {
        1 => Mark::Right,
        2..=SET_MAX => Mark::InSet,
        _ => Mark::LongOr,
    }
}

/// Marks an answer; `at_the_noise` says whether the fitted first model leaves no more than the noise, where
/// that is asked.
pub fn mark(
    answer: &FinderAnswer,
    truth: &CaseTruth,
    at_the_noise: impl FnOnce() -> Result<bool, String>,
) -> Result<Mark, String> {
    let wrong_where = |is_true: &dyn Fn(&String) -> bool| {
        let false_groups: Vec<&Vec<String>> = answer
            .groups
            .iter()
            .filter(|g| !g.iter().any(is_true))
            .collect();
        match false_groups.iter().map(|g| g.len()).min() {
            None => None,
            Some(1) => Some(Mark::Wrong),
            Some(_) => Some(Mark::WrongOr),
        }
    };
    let nothing_true = |_: &String| false;
    Ok(match truth {
        CaseTruth::Unknown => Mark::Unmarked,
        CaseTruth::Outside => match wrong_where(&nothing_true) {
            Some(wrong) => wrong,
            None if answer.verdict == "unexplained" => Mark::Right,
            None => Mark::Missed,
        },
        CaseTruth::Nothing => match wrong_where(&nothing_true) {
            Some(wrong) => wrong,
            None if !answer.changed.is_empty() => Mark::Wrong,
            None if answer.verdict == "at_floor" => Mark::Right,
            None => Mark::Missed,
        },
        CaseTruth::Missing(missing, also) => {
            let is_true = |id: &String| missing.iter().chain(also).any(|of| same(id, of));
            let holds = |of: &String, group: &&Vec<String>| group.iter().any(|said| same(said, of));
            let all_there = missing
                .iter()
                .all(|of| answer.groups.iter().any(|group| holds(of, &group)));
            let longest = answer.groups.iter().map(Vec::len).max().unwrap_or(0);
            match wrong_where(&is_true) {
                Some(wrong) => wrong,
                None if all_there => found(longest),
                None if answer.verdict == "at_floor" && at_the_noise()? => Mark::Absorbed,
                None => Mark::Missed,
            }
        }
        CaseTruth::Altered(right, own) => {
            let changed = answer.changed.iter().map(|id| vec![id.clone()]);
            let groups: Vec<Vec<String>> = answer.groups.iter().cloned().chain(changed).collect();
            let is_right = |id: &String| right.iter().any(|of| same(id, of));
            let is_own = |id: &String| {
                let loops = LOOPS.contains(&id.as_str());
                own.contains(id) || loops && own.iter().any(|of| LOOPS.contains(&of.as_str()))
            };
            let foreign = |g: &&Vec<String>| !g.iter().any(|id| is_right(id) || is_own(id));
            match groups.iter().find(|g| g.iter().any(is_right)) {
                // A name beside the right one that nothing was done for is wrong all the same.
                _ if groups.iter().any(|g| g.len() == 1 && foreign(&g)) => Mark::Wrong,
                Some(group) => found(group.len()),
                None if groups.iter().any(|g| foreign(&g)) => Mark::WrongOr,
                None if answer.verdict == "at_floor" && at_the_noise()? => Mark::Absorbed,
                None => Mark::Missed,
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marked(verdict: &str, groups: &[&[&str]], truth: &CaseTruth) -> Mark {
        let groups = groups
            .iter()
            .map(|g| g.iter().map(|id| (*id).to_owned()).collect())
            .collect();
        mark(
            &FinderAnswer {
                verdict: verdict.into(),
                groups,
                ..FinderAnswer::default()
            },
            truth,
            || Ok(true),
        )
        .unwrap()
    }

    #[test]
    fn a_name_too_many_is_wrong_and_a_long_or_says_little() {
        let missing = |ids: &[&str]| {
            CaseTruth::Missing(ids.iter().map(|id| (*id).to_owned()).collect(), Vec::new())
        };
        assert_eq!(
            marked("named", &[&["creep"]], &missing(&["creep"])),
            Mark::Right
        );
        assert_eq!(
            marked("named", &[&["bouc_wen"]], &missing(&["hysteresis"])),
            Mark::Right
        );
        assert_eq!(
            marked("named", &[&["creep"], &["delay"]], &missing(&["creep"])),
            Mark::Wrong
        );
        assert_eq!(
            marked("ambiguous", &[&["delay", "creep"]], &missing(&["creep"])),
            Mark::InSet
        );
        assert_eq!(
            marked("ambiguous", &[&["a", "b"]], &missing(&["creep"])),
            Mark::WrongOr
        );
        assert_eq!(
            marked(
                "ambiguous",
                &[&["a", "b", "c", "creep"]],
                &missing(&["creep"])
            ),
            Mark::LongOr
        );
        assert_eq!(
            marked("named", &[&["creep"]], &missing(&["creep", "delay"])),
            Mark::Missed
        );
        assert_eq!(
            marked("at_floor", &[], &missing(&["creep"])),
            Mark::Absorbed
        );
        assert_eq!(marked("at_floor", &[], &CaseTruth::Nothing), Mark::Right);
        assert_eq!(
            marked("unexplained", &[], &CaseTruth::Nothing),
            Mark::Missed
        );
        assert_eq!(
            marked("named", &[&["creep"]], &CaseTruth::Outside),
            Mark::Wrong
        );
        let altered = CaseTruth::Altered(vec!["delay".into()], vec!["creep".into()]);
        assert_eq!(
            marked("named", &[&["creep"], &["delay"]], &altered),
            Mark::Right
        );
        assert_eq!(
            marked("named", &[&["friction"], &["delay"]], &altered),
            Mark::Wrong
        );
        assert_eq!(
            marked("ambiguous", &[&["delay", "friction"]], &altered),
            Mark::InSet
        );
    }
}

//! The figures of the thesis and the goals that ours should reach, read from `goals.toml`.

use serde::Deserialize;

/// One line of `goals.toml`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Goal {
    /// Identifier.
    pub id: String,
    /// Chapter.
    pub chapter: u32,
    /// What is measured.
    pub item: String,
    /// Under which condition.
    pub condition: String,
    /// The author's measurement.
    pub thesis: Option<f64>,
    /// Ours should be at or below it.
    pub goal: Option<f64>,
    /// Unit.
    pub unit: String,
}

#[derive(Deserialize)]
struct Goals {
    row: Vec<Goal>,
}

/// The built-in goals, for tables that stand ours beside the thesis'.
///
/// # Errors
/// If the built-in file cannot be read, which a test excludes.
pub fn goals() -> Result<Vec<Goal>, toml::de::Error> {
    Ok(toml::from_str::<Goals>(include_str!("../goals.toml"))?.row)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_are_readable_and_unique() {
        let goals = goals().unwrap();
        let mut ids: Vec<_> = goals.iter().map(|g| g.id.clone()).collect();
        ids.sort();
        ids.dedup();
        assert_eq!(ids.len(), goals.len());
        assert!(goals.iter().any(|g| g.id == "ch3.erms"));
    }
}

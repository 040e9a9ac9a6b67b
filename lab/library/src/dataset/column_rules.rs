//! What the user says about the columns of a file: which is what, units and factors.

use super::units::Quantity;
use serde::Deserialize;
use std::collections::BTreeMap;

/// A column by its name or by its number, counted from 1.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(
    untagged,
    expecting = "expected the name of a column, or its number from 1"
)]
pub enum ColumnName {
    /// Counted from 1.
    Number(usize),
    /// As in the header; with a unit in brackets or as a suffix.
    Name(String),
}

/// One value for each signal of a record, where it is specified.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct PerColumn<T> {
    /// Of time.
    pub t: Option<T>,
    /// Of the drive.
    pub u: Option<T>,
    /// Of the displacement.
    pub y: Option<T>,
    /// Of the external force.
    pub force: Option<T>,
}

impl<T> Default for PerColumn<T> {
    fn default() -> Self {
        Self {
            t: None,
            u: None,
            y: None,
            force: None,
        }
    }
}

impl<T> PerColumn<T> {
    /// What is specified for a signal.
    #[must_use]
    pub fn get(&self, quantity: Quantity) -> Option<&T> {
        match quantity {
            Quantity::Time => self.t.as_ref(),
            Quantity::Drive => self.u.as_ref(),
            Quantity::Displacement => self.y.as_ref(),
            Quantity::Force => self.force.as_ref(),
        }
    }

    /// The place of what is specified for a signal, by its key `t`, `u`, `y` or `force`.
    pub fn by_key(&mut self, key: &str) -> Option<&mut Option<T>> {
        match key {
            "t" => Some(&mut self.t),
            "u" => Some(&mut self.u),
            "y" => Some(&mut self.y),
            "force" => Some(&mut self.force),
            _ => None,
        }
    }

    /// The same, with values of `self` before those of `other`.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            t: self.t.or(other.t),
            u: self.u.or(other.u),
            y: self.y.or(other.y),
            force: self.force.or(other.force),
        }
    }
}

/// Which column is what.
pub type Columns = PerColumn<ColumnName>;

/// What is known about the columns of a file beside what it says itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColumnRules {
    /// Which column is what.
    pub columns: Columns,
    /// Units by signal: `mV`, or a sensitivity `5 um/V`.
    pub unit: PerColumn<String>,
    /// Factors by signal, beside that of the unit.
    pub scale: PerColumn<f64>,
    /// Columns of further signals, by the name that effects of the user's own call them by.
    pub auxiliary: BTreeMap<String, ColumnName>,
}

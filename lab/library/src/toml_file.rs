//! TOML files whose first key says what they hold.

use crate::error::{Error, Result, line_of};
use serde::de::DeserializeOwned;

/// Reads a file of this schema; `place` is what it is called in messages.
///
/// # Errors
/// Another schema, said before its fields are looked at: a model in the place of a servo has other ones. Then
/// the line that is wrong.
pub fn with_schema<T: DeserializeOwned>(text: &str, place: &str, schema: &str) -> Result<T> {
    let table = toml::from_str::<toml::Table>(text).ok();
    let said = table
        .as_ref()
        .and_then(|table| table.get("schema")?.as_str());
    if let Some(other) = said.filter(|said| *said != schema) {
        return Err(Error::new(
            place,
            format!("schema = \"{other}\"; expected \"{schema}\""),
        ));
    }
    // For text of another kind altogether, as a recording in the place of a model, the error gives what was
    // expected.
    let expected = if table.is_none() {
        format!("; expected a TOML file that says schema = \"{schema}\"")
    } else {
        String::new()
    };
    toml::from_str(text).map_err(|e| {
        Error::new(
            format!("{place}: line {}", line_of(text, e.span())),
            format!("{}{expected}", e.message()),
        )
    })
}

//! TOML files whose first key says what they hold.

use crate::error::{Error, Result, line_of};
use serde::de::DeserializeOwned;

/// Reads a file of this schema; `place` is what it is called in messages.
///
/// # Errors
/// Another schema, said before its fields are looked at: a model in the place of a servo has other ones. Then the line that is wrong.
pub fn with_schema<T: DeserializeOwned>(text: &str, place: &str, schema: &str) -> Result<T> {
    let said = toml::from_str::<toml::Table>(text).ok().and_then(|table| table.get("schema")?.as_str().map(str::to_owned));
    if let Some(other) = said.filter(|said| said != schema) {
        return Err(Error::new(place, format!("schema = \"{other}\"; expected \"{schema}\"")));
    }
    toml::from_str(text).map_err(|e| Error::new(format!("{place}: line {}", line_of(text, e.span())), e.message()))
}

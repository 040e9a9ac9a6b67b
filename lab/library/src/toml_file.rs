//! TOML files whose first key says what they hold.

use crate::error::{Error, Result, line_of};
use serde::de::DeserializeOwned;

/// What files of a schema hold, for messages.
fn content_of(schema: &str) -> Option<&'static str> {
    Some(match schema.split('/').next()? {
        "hysteron.model" => "a model",
        "hysteron.servo" => "a servo",
        "hysteron.axes" => "a model of several axes",
        "hysteron.rig" => "a stick-slip rig",
        _ => return None,
    })
}

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
        let why = match (content_of(other), content_of(schema)) {
            (Some(found), Some(expected)) if found != expected => {
                format!(": this is {found}, not {expected}")
            }
            (Some(found), Some(_)) => format!(": {found} of another version, which is not read"),
            _ => String::new(),
        };
        return Err(Error::new(
            place,
            format!("schema = \"{other}\"; expected \"{schema}\"{why}"),
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

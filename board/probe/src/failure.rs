//! What went wrong, in one line.

/// What went wrong, in one line.
pub type Result<T> = std::result::Result<T, String>;

/// An error with all that stands behind it, in one line.
pub fn whole(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut behind = error.source();
    while let Some(cause) = behind {
        let words = cause.to_string();
        if !text.contains(&words) {
            text = format!("{}: {words}", text.trim_end_matches('.'));
        }
        behind = cause.source();
    }
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

//! `export`.

use crate::desk::Desk;
use hysteron::Result;
use hysteron::export::{Language, export as exported};
use std::path::{Path, PathBuf};

/// Writes a model as a function of another language.
pub fn export(
    model: &Path,
    language: &str,
    rate_hz: f64,
    out: Option<&Path>,
    force: bool,
) -> Result<bool> {
    let desk = Desk::new(force);
    let language = Language::named("--as", language)?;
    let read = desk.model(model)?;
    let out: PathBuf = out.map_or_else(
        || model.with_extension(language.extension()),
        Path::to_path_buf,
    );
    desk.target(Some(&out))?;
    let name = out.file_stem().map_or_else(
        || "model".into(),
        |stem| stem.to_string_lossy().into_owned(),
    );
    let text = exported(&read, language, rate_hz, &name)?;
    desk.write(&out, text.as_bytes())?;
    println!("{} for {rate_hz} samples per second", out.display());
    Ok(true)
}

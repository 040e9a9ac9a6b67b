//! `export`.

use crate::desk::Desk;
use crate::read_arguments::ReadArguments;
use crate::simulate::{initial, way};
use hysteron::export::{Language, export_from, inverse};
use hysteron::origin::sample_rate_hz;
use hysteron::{Error, Result};
use hysteron_sim::intersample::Intersample;
use std::path::{Path, PathBuf};

/// What is exported.
pub struct ExportRequest<'a> {
    /// The model.
    pub model: &'a Path,
    /// The language by its name.
    pub language: &'a str,
    /// Samples per second of the drive that the function takes.
    pub rate_hz: Option<f64>,
    /// Where it begins.
    pub initial: Option<&'a str>,
    /// The inverse of its loops in its place.
    pub inverse: bool,
}

/// Writes a model as a function of another language.
pub fn export(
    wanted: &ExportRequest,
    reading: &ReadArguments,
    out: Option<&Path>,
    force: bool,
) -> Result<bool> {
    let (desk, model) = (Desk::new(force), wanted.model);
    let language = Language::named("--as", wanted.language)?;
    let read = desk.model(model)?;
    if let (true, Some(option)) = (wanted.inverse, reading.as_words().first()) {
        return Err(Error::new(
            option,
            "has no effect with --inverse; leave it out",
        ));
    }
    let begins = initial(&desk, &read, wanted.initial, reading)?;
    let (way, rate_hz) = (
        way(&read, reading)?,
        wanted.rate_hz.unwrap_or_else(|| sample_rate_hz(&read)),
    );
    let out: PathBuf = out.map_or_else(
        || model.with_extension(language.extension()),
        Path::to_path_buf,
    );
    desk.target(Some(&out))?;
    let name = out.file_stem().map_or_else(
        || "model".into(),
        |stem| stem.to_string_lossy().into_owned(),
    );
    let text = if wanted.inverse {
        inverse(&read, language, rate_hz, &name)?
    } else {
        export_from(&read, language, rate_hz, &name, (&begins, way))?
    };
    desk.write(&out, text.as_bytes())?;
    if wanted.inverse {
        println!(
            "{}: inverse of the loops for {rate_hz} samples per second",
            out.display()
        );
        return Ok(true);
    }
    println!(
        "{} for {rate_hz} samples per second; {}",
        out.display(),
        way.in_words()
    );
    if language == Language::C && way.intersample == Intersample::BandLimited {
        println!(
            "  note: C runs straight between samples, since a band-limited drive depends on later ones"
        );
    }
    Ok(true)
}

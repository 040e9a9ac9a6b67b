//! `board record --probe`: the board plays the drive of an identification and its log, over the debug probe,
//! becomes a data set.
//!
//! `hysteron-probe record` does what needs the probe and leaves the log; what is made of it is what
//! `hysteron capture` makes.

use crate::capture::capture;
use crate::desk::Desk;
use clap::Parser;
use hysteron::{Error, Result};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Record over the debug probe: restart the board, condition its actuator, play the drive of an
/// identification, write a data set
#[derive(Debug, Parser)]
#[command(name = "hysteron board record", max_term_width = 100)]
struct Words {
    /// Folder to write, as `hysteron explain` takes it; the log stays beside it, as OUT.rtt
    out: PathBuf,
    /// The image that the board runs, an ELF file, as `cargo xtask firmware` builds it
    image: PathBuf,
    /// Over the debug probe; which one, where there are several: --probe=VID:PID or --probe=VID:PID:SERIAL
    #[arg(long, value_name = "PROBE", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    probe: Option<String>,
    /// How long the drive lasts, ticks
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(10_000..=72_000_000))]
    ticks: u32,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
}

/// Records with the program that `program` runs.
pub fn record(words: &[OsString], program: impl Fn(&[OsString]) -> ExitCode) -> ExitCode {
    let words = match Words::try_parse_from(words) {
        Ok(words) => words,
        Err(error) => {
            // Where printing fails, no way is left to report it.
            let _ = error.print();
            return if error.use_stderr() {
                ExitCode::from(2)
            } else {
                ExitCode::SUCCESS
            };
        }
    };
    let done = before(&words).and_then(|raw| {
        // Under another name until it is whole: a recording that fails leaves the log of the last one.
        let new = raw.with_extension("rtt.new");
        let ended = program(&for_probe(&words, &new));
        if ended != ExitCode::SUCCESS {
            return Ok(ended);
        }
        std::fs::rename(&new, &raw).map_err(|error| Error::new(raw.display(), error))?;
        capture(&words.image, &raw, &words.out, words.force).map(|_| ended)
    });
    done.unwrap_or_else(|problem| {
        eprintln!("error: {problem}");
        ExitCode::from(2)
    })
}

/// Sees that nothing is in the way of the files, before the board is touched; returns the log's name.
fn before(words: &Words) -> Result<PathBuf> {
    let desk = Desk::new(words.force);
    desk.bytes(&words.image, "the image that the board runs")?;
    desk.folder_to_be(&words.out, &["dataset.toml".to_string()])?;
    let raw = log_name(&words.out)?;
    if !words.force && raw.exists() {
        return Err(Error::new(
            raw.display(),
            "exists: the log of another recording; --force replaces it",
        ));
    }
    Ok(raw)
}

/// `OUT.rtt` beside the folder.
fn log_name(out: &Path) -> Result<PathBuf> {
    let mut name = out
        .file_name()
        .ok_or_else(|| Error::new(out.display(), "expected the name of a folder"))?
        .to_os_string();
    name.push(".rtt");
    Ok(out.with_file_name(name))
}

/// The words for `hysteron-probe`.
fn for_probe(words: &Words, raw: &Path) -> Vec<OsString> {
    let mut all: Vec<OsString> = vec![
        "record".into(),
        words.image.clone().into(),
        raw.into(),
        "--ticks".into(),
        words.ticks.to_string().into(),
    ];
    if let Some(which) = words.probe.as_ref().filter(|which| !which.is_empty()) {
        all.push(format!("--probe={which}").into());
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Words {
        Words::try_parse_from(text.split(' ')).expect("understood")
    }

    #[test]
    fn the_probe_s_program_is_told_what_it_needs() {
        let told = |text: &str| {
            for_probe(&words(text), Path::new("a/out.rtt"))
                .iter()
                .map(|w| w.to_string_lossy().into_owned())
                .collect::<Vec<_>>()
                .join(" ")
        };
        assert_eq!(
            told("record a/out x.elf --probe"),
            "record x.elf a/out.rtt --ticks 100000"
        );
        assert_eq!(
            told("record --probe=0483:374e a/out x.elf --ticks 40000"),
            "record x.elf a/out.rtt --ticks 40000 --probe=0483:374e"
        );
        assert_eq!(log_name(Path::new("a/out")), Ok(PathBuf::from("a/out.rtt")));
        assert!(log_name(Path::new("/")).is_err());
    }

    #[test]
    fn what_is_wrong_is_found_before_the_board_is_touched() {
        let untouched = |_: &[OsString]| -> ExitCode { panic!("the board is touched") };
        let with = |text: &str| {
            record(
                &text.split(' ').map(OsString::from).collect::<Vec<_>>(),
                untouched,
            )
        };
        for text in [
            "record out --probe",
            "record out no_such.elf --probe",
            "record out x.elf --probe --ticks 5",
            "record out x.elf --probe --port p",
        ] {
            assert_eq!(with(text), ExitCode::from(2), "{text}");
        }
    }
}

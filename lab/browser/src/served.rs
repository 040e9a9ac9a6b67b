//! What the program was started with: a data set that is at hand before anything is dropped.

use crate::recording::{Said, UploadedRecording};
use hysteron::Result;

/// A data set that is at hand before anything is dropped.
pub trait Served: Send + Sync {
    /// Reads it, with what a person says about its files.
    ///
    /// # Errors
    /// One message with file, row or field, and what was expected.
    fn read(&self, said: &Said) -> Result<UploadedRecording>;

    /// Its name.
    fn name(&self) -> String;

    /// The list of effects to start from that lies beside it.
    fn base_effects(&self) -> Option<String>;
}

/// A folder with `dataset.toml`, a manifest, or one file, with what the command line says about columns and
/// units.
#[cfg(not(target_family = "wasm"))]
pub struct OnDisk {
    /// Where it is.
    pub path: std::path::PathBuf,
    /// What the command line says.
    pub instructions: hysteron::dataset::reading::Instructions,
}

#[cfg(not(target_family = "wasm"))]
impl Served for OnDisk {
    fn read(&self, said: &Said) -> Result<UploadedRecording> {
        use hysteron::dataset::reading::Instructions;
        use hysteron::dataset::{folder, readers};
        // Entries of the page override those of the command line.
        let (in_page, typed) = (said.instructions(), self.instructions.wanted.clone());
        let instructions = Instructions {
            wanted: in_page.before(typed),
            sample_rate_hz: in_page.sample_rate_hz.or(self.instructions.sample_rate_hz),
            skip_rows: in_page.skip_rows.or(self.instructions.skip_rows),
            timing: in_page.timing.or(self.instructions.timing),
            intersample: in_page.intersample.or(self.instructions.intersample),
            rate_otherwise_hz: None,
        };
        let dataset = folder::load_as(&self.path, &instructions)?;
        let first = dataset.records.first().map(|record| record.source.clone());
        let hints = readers::Hints {
            skip_rows: instructions.skip_rows.unwrap_or(0),
        };
        let table = first
            .map(|source| {
                readers::read(
                    &source,
                    &folder::bytes(source.as_ref(), "the file of a record")?,
                    hints,
                )
            })
            .transpose()?;
        UploadedRecording::of(dataset, None, table.as_ref(), said)
    }

    fn name(&self) -> String {
        self.path.display().to_string()
    }

    fn base_effects(&self) -> Option<String> {
        let folder = if self.path.is_dir() {
            self.path.as_path()
        } else {
            self.path.parent()?
        };
        std::fs::read_to_string(folder.join("base_effects.txt")).ok()
    }
}

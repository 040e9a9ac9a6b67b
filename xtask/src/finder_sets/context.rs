//! What the sets share: the program that is asked, folders, files.

use crate::workspace::root;
use std::path::{Path, PathBuf};

/// What every set needs to know.
pub struct Context {
    /// The program that is asked.
    pub program: PathBuf,
    /// Names the results.
    pub label: String,
    /// Where data sets are made.
    pub folder: PathBuf,
    /// Other thresholds, as the program reads them.
    pub policy: Option<PathBuf>,
}

impl Context {
    /// The folder of a set, which is made.
    pub fn folder_of(&self, set: &str) -> Result<PathBuf, String> {
        let folder = self.folder.join(set);
        std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        Ok(folder)
    }
}

/// A folder of the data beside the project.
pub fn beside(path: &str) -> Result<PathBuf, String> {
    let folder = root().join("../shared/data").join(path);
    if folder.exists() {
        Ok(folder)
    } else {
        Err(format!(
            "{}: is not there; this set needs it",
            folder.display()
        ))
    }
}

/// Some of many, evenly spread.
pub fn spread<T>(mut all: Vec<T>, most: Option<usize>) -> Vec<T> {
    let (count, Some(most)) = (all.len(), most.filter(|most| *most < all.len())) else {
        return all;
    };
    let kept: Vec<usize> = (0..most)
        .map(|i| (2 * i + 1) * count / (2 * most))
        .collect();
    let mut at = 0;
    all.retain(|_| {
        at += 1;
        kept.contains(&(at - 1))
    });
    all
}

/// Copies a file that is not there yet.
pub fn copy(from: &Path, to: &Path) -> Result<(), String> {
    if to.exists() {
        return Ok(());
    }
    made(to)?;
    std::fs::copy(from, to)
        .map(drop)
        .map_err(|e| format!("{} to {}: {e}", from.display(), to.display()))
}

/// Writes a text.
pub fn write(to: &Path, text: &str) -> Result<(), String> {
    made(to)?;
    std::fs::write(to, text).map_err(|e| format!("{}: {e}", to.display()))
}

fn made(file: &Path) -> Result<(), String> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))
}

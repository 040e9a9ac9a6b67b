//! A file is written whole or not at all: into a neighbour first, which then takes the name in one step.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// Writes `bytes` to `path`. Whatever goes wrong, a file that was there before is intact and no partial file
/// is left.
///
/// # Errors
/// The folder does not exist or cannot be written; the disk is full.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A link stays one: what it points to is replaced.
    let behind = if path.is_symlink() {
        fs::canonicalize(path)?
    } else {
        path.to_path_buf()
    };
    let path = behind.as_path();
    let name = path
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "the path names no file"))?;
    remove_left_behind(path, name);
    let mut part_name = std::ffi::OsString::from(".");
    part_name.push(name);
    part_name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(part_name);
    let written = fs::File::create(&part)
        .and_then(|mut file| {
            file.write_all(bytes)?;
            file.sync_all()
        })
        .and_then(|()| fs::rename(&part, path));
    if written.is_err() {
        // The failure above is what the caller must hear of; the neighbour may not even exist.
        let _ = fs::remove_file(&part);
    }
    written
}

/// A neighbour that is older than this, s, is of no process that still writes it, where the system does not
/// say which processes there are.
const LEFT_BEHIND_S: u64 = 600;

/// Removes the neighbours of a file that processes left which were killed while they wrote it.
fn remove_left_behind(path: &Path, name: &OsStr) {
    let beside = path.parent().filter(|p| !p.as_os_str().is_empty());
    let Ok(entries) = fs::read_dir(beside.unwrap_or_else(|| Path::new("."))) else {
        return;
    };
    let begins = format!(".{}.", name.to_string_lossy());
    for entry in entries.flatten() {
        let found = entry.file_name().to_string_lossy().into_owned();
        let process = found
            .strip_prefix(&begins)
            .and_then(|rest| rest.strip_suffix(".part"))
            .and_then(|id| id.parse::<u32>().ok());
        if process.is_some_and(|id| is_gone(id, &entry)) {
            // Another run may have removed it already.
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Whether the process that wrote a file has ended.
fn is_gone(process: u32, file: &fs::DirEntry) -> bool {
    let processes = Path::new("/proc");
    if processes.join("self").exists() {
        return !processes.join(process.to_string()).exists();
    }
    let written = file.metadata().and_then(|known| known.modified());
    let age = written.ok().and_then(|at| at.elapsed().ok());
    age.is_some_and(|age| age.as_secs() > LEFT_BEHIND_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One of a process that was killed, and one of a process that writes.
    #[cfg(target_os = "linux")]
    #[test]
    fn the_next_write_removes_what_a_killed_process_left() {
        let folder = tempfile::tempdir().unwrap();
        // No process has the largest number.
        let dead = folder.path().join(format!(".page.html.{}.part", u32::MAX));
        let alive = folder.path().join(format!(".page.html.{}.part", 1));
        let other = folder.path().join(format!(".other.html.{}.part", u32::MAX));
        for left in [&dead, &alive, &other] {
            fs::write(left, "half").unwrap();
        }
        write_whole(&folder.path().join("page.html"), b"whole").unwrap();
        assert!(!dead.exists() && alive.exists() && other.exists());
    }

    #[test]
    fn a_failed_write_leaves_what_was_there() {
        let folder = std::env::temp_dir().join(format!("hysteron-whole-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let file = folder.join("page.html");
        write_whole(&file, b"first").unwrap();
        write_whole(&file, b"second").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"second");
        // A folder in the place of the file cannot be replaced.
        let taken = folder.join("taken");
        fs::create_dir_all(taken.join("inside")).unwrap();
        assert!(write_whole(&taken, b"x").is_err());
        assert!(write_whole(&folder.join("missing/page.html"), b"x").is_err());
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&file, taken.join("link")).unwrap();
            write_whole(&taken.join("link"), b"through").unwrap();
            assert!(taken.join("link").is_symlink());
            assert_eq!(fs::read(&file).unwrap(), b"through");
        }
        let left: Vec<_> = fs::read_dir(&folder)
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        assert_eq!(left.len(), 2, "{left:?}");
        fs::remove_dir_all(&folder).unwrap();
    }
}

//! Python in environments of its own, with packages from PyPI: what the check installs leaves the machine's
//! Python alone.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::debian;
use crate::workspace::{command, root};

/// The least release that the Python package asks for.
const ENOUGH: &str = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))";

/// Sees to a Python that can make virtual environments.
pub fn see_to_python() -> Result<(), String> {
    let there = || {
        Command::new("python3")
            .args(["-c", ENOUGH])
            .output()
            .is_ok_and(|output| output.status.success())
    };
    if !there() && debian::can_install() {
        println!("   no Python with virtual environments yet; installing Debian's python3-venv");
        debian::install(&["python3", "python3-venv"])?;
    }
    if there() {
        Ok(())
    } else {
        Err("needs Python 3.10 or newer with virtual environments: install python3-venv".into())
    }
}

/// An interpreter that has NumPy: the machine's, or one of an environment of its own.
pub fn with_numpy() -> Result<PathBuf, String> {
    let machines = PathBuf::from("python3");
    let there = Command::new(&machines)
        .args(["-c", "import numpy"])
        .output()
        .is_ok_and(|output| output.status.success());
    if there {
        Ok(machines)
    } else {
        kept("python/numpy", &["numpy"])
    }
}

/// Installs packages by their names, or what else `pip install` takes. Python compiles a module where it is
/// used; of the libraries of formats that is a small part.
pub fn install(python: &Path, packages: &[&str]) -> Result<(), String> {
    command(
        python,
        &[
            &[
                "-m",
                "pip",
                "install",
                "--quiet",
                "--no-compile",
                "--disable-pip-version-check",
            ],
            packages,
        ]
        .concat(),
        &root(),
        &[],
    )
}

/// An environment under `target` that holds nothing of earlier runs; its interpreter.
pub fn fresh(folder: &str) -> Result<PathBuf, String> {
    let folder = root().join("target").join(folder);
    if folder.exists() {
        std::fs::remove_dir_all(&folder)
            .map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    see_to_python()?;
    command(
        "python3",
        &["-m", "venv", &folder.to_string_lossy()],
        &root(),
        &[],
    )?;
    Ok(folder.join("bin/python"))
}

/// An environment under `target` with these packages, made once and again where the list has changed; its
/// interpreter.
pub fn kept(folder: &str, packages: &[&str]) -> Result<PathBuf, String> {
    let place = root().join("target").join(folder);
    let (python, installed, list) = (
        place.join("bin/python"),
        place.join("installed.txt"),
        packages.join("\n"),
    );
    if python.exists() && std::fs::read_to_string(&installed).is_ok_and(|text| text == list) {
        return Ok(python);
    }
    println!(
        "   installing {} from PyPI into {}",
        packages.join(", "),
        place.display()
    );
    let python = fresh(folder)?;
    install(&python, packages)?;
    std::fs::write(&installed, list)
        .map_err(|error| format!("{}: {error}", installed.display()))?;
    Ok(python)
}

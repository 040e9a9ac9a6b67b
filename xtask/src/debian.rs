//! Packages of the distribution, where the machine is a Debian and this is its superuser.

use std::process::Command;

use crate::workspace::{command, root};

/// Whether packages can be installed here.
pub fn can_install() -> bool {
    let output = |program: &str, argument: &str| {
        Command::new(program)
            .arg(argument)
            .output()
            .ok()
            .filter(|output| output.status.success())
    };
    output("id", "-u").is_some_and(|output| output.stdout.trim_ascii() == b"0")
        && output("apt-get", "--version").is_some()
}

/// Installs packages without what they only recommend.
pub fn install(packages: &[&str]) -> Result<(), String> {
    let quiet = [("DEBIAN_FRONTEND", "noninteractive")];
    // Package lists may be missing (a fresh container) or old; only an installation that fails is an error.
    if let Err(error) = command("apt-get", &["update", "-qq"], &root(), &quiet) {
        println!("   {error}");
    }
    let arguments = [
        &["install", "-y", "-qq", "--no-install-recommends"],
        packages,
    ]
    .concat();
    command("apt-get", &arguments, &root(), &quiet)
}

/// Sees to Octave, in which the tests run exported models.
pub fn see_to_octave() -> Result<(), String> {
    see_to(
        "octave-cli",
        "octave",
        "in which the tests run exported models",
    )
}

/// Sees to Valgrind, which counts instructions.
pub fn see_to_valgrind() -> Result<(), String> {
    see_to("valgrind", "valgrind", "which counts instructions")
}

/// Sees to a program of a package; `use_of_it` says what for.
fn see_to(program: &str, package: &str, use_of_it: &str) -> Result<(), String> {
    let there = || {
        Command::new(program)
            .arg("--version")
            .output()
            .is_ok_and(|output| output.status.success())
    };
    if !there() && can_install() {
        println!("   no {package} yet; installing it, {use_of_it}");
        install(&[package])?;
    }
    if there() {
        Ok(())
    } else {
        Err(format!("needs {package}, {use_of_it}: install {package}"))
    }
}

//! Finds or installs the browser in which the report's tests look at their pages.

use std::process::Command;

use crate::steps::{command, root};

const NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

fn starts(program: &str, argument: &str) -> bool {
    Command::new(program).arg(argument).output().is_ok_and(|output| output.status.success())
}

/// Sees to a browser. Without one the check goes on where it is not CI: the tests that need it say that they are skipped.
pub fn ensure() -> Result<(), String> {
    if let Some(name) = NAMES.iter().find(|name| starts(name, "--version")) {
        println!("   browser: {name}");
        return Ok(());
    }
    let superuser = Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0");
    if superuser && starts("apt-get", "--version") {
        println!("   no browser yet; installing chromium, in which the tests look at the reports");
        let quiet = [("DEBIAN_FRONTEND", "noninteractive")];
        // Package lists may be missing (a fresh container) or old; only an installation that fails matters.
        if let Err(error) = command("apt-get", &["update", "-qq"], &root(), &quiet) {
            println!("   {error}");
        }
        match command("apt-get", &["install", "-y", "-qq", "--no-install-recommends", "chromium"], &root(), &quiet) {
            Ok(()) => return Ok(()),
            Err(error) => println!("   {error}"),
        }
    }
    if std::env::var_os("CI").is_some() {
        return Err("CI needs a browser to look at the reports: install chromium".into());
    }
    println!("   no browser: the tests that look at the reports will be skipped. To run them, install chromium");
    Ok(())
}

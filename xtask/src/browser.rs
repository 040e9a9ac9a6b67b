//! Finds or installs the browser in which the report's tests look at their pages.

use std::process::Command;

use crate::debian;

const NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

fn starts(program: &str, argument: &str) -> bool {
    Command::new(program)
        .arg(argument)
        .output()
        .is_ok_and(|output| output.status.success())
}

/// Sees to a browser. Without one the check goes on where it is not CI: the tests that need it say that they
/// are skipped.
pub fn ensure() -> Result<(), String> {
    if let Some(name) = NAMES.iter().find(|name| starts(name, "--version")) {
        println!("   browser: {name}");
        return Ok(());
    }
    if debian::can_install() {
        println!("   no browser yet; installing chromium, in which the tests look at the reports");
        match debian::install(&["chromium"]) {
            Ok(()) => return Ok(()),
            Err(error) => println!("   {error}"),
        }
    }
    if std::env::var_os("CI").is_some() {
        return Err("CI needs a browser to look at the reports: install chromium".into());
    }
    println!(
        "   no browser: the tests that look at the reports will be skipped. To run them, install chromium"
    );
    Ok(())
}

//! Finds or installs a compiler for thumbv7em-none-eabihf.
//!
//! First rustup's target, the usual way. Where rustup cannot download (a closed build machine) the distribution's compiler is
//! taken, which brings the library's source beside it; the standard library's `core` is then built on the way.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::steps::{command, root};

/// The target of the firmware.
pub const TARGET: &str = "thumbv7em-none-eabihf";
const PACKAGES: [&str; 4] = ["rustc-web", "cargo-web", "rust-web-src", "lld-22"];

/// How the firmware is built on this machine.
pub enum Toolchain {
    /// rustup's compiler with its prebuilt target.
    Rustup,
    /// The distribution's compiler in /usr/bin, building `core` from its source.
    Distribution,
}

/// The image that `cargo xtask firmware` builds.
pub fn image() -> PathBuf {
    root().join("firmware/target").join(TARGET).join("release/hysteron-firmware")
}

/// The same with the chip's own converters.
pub fn on_chip_image() -> PathBuf {
    image().with_file_name("hysteron-firmware-on-chip")
}

fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

fn rustup_has_target() -> bool {
    output("rustup", &["target", "list", "--installed"]).is_some_and(|targets| targets.lines().any(|line| line.trim() == TARGET))
}

fn distribution_has_all() -> bool {
    Path::new("/usr/bin/cargo").exists()
        && output("/usr/bin/rustc", &["--print", "sysroot"])
            .is_some_and(|sysroot| Path::new(sysroot.trim()).join("lib/rustlib/src/rust/library/core/src/lib.rs").exists())
        && Path::new("/usr/bin/ld.lld-22").exists()
}

/// Finds a compiler for the target, installing one if there is none.
pub fn for_target() -> Result<Toolchain, String> {
    if rustup_has_target() {
        println!("   compiler: rustup's, target {TARGET} is installed");
        return Ok(Toolchain::Rustup);
    }
    if distribution_has_all() {
        println!("   compiler: the distribution's in /usr/bin, with its library source");
        return Ok(Toolchain::Distribution);
    }
    println!("   no compiler for {TARGET} yet; trying `rustup target add {TARGET}`");
    let added = Command::new("rustup").args(["target", "add", TARGET]).status();
    if added.is_ok_and(|status| status.success()) && rustup_has_target() {
        return Ok(Toolchain::Rustup);
    }
    println!("   rustup cannot download it here; trying the distribution's packages {}", PACKAGES.join(" "));
    let superuser = output("id", &["-u"]).is_some_and(|number| number.trim() == "0");
    if !superuser || output("apt-get", &["--version"]).is_none() {
        return Err(format!(
            "no compiler for {TARGET}. Either `rustup target add {TARGET}` (needs the network), or as root on Debian `apt-get install {}`",
            PACKAGES.join(" ")
        ));
    }
    let here = root();
    let quiet = [("DEBIAN_FRONTEND", "noninteractive")];
    // Package lists may be missing (a fresh container) or old; only an installation that fails is an error.
    if let Err(error) = command("apt-get", &["update", "-qq"], &here, &quiet) {
        println!("   {error}");
    }
    let mut arguments = vec!["install", "-y", "-qq", "--no-install-recommends"];
    arguments.extend(PACKAGES);
    command("apt-get", &arguments, &here, &quiet)?;
    if distribution_has_all() {
        Ok(Toolchain::Distribution)
    } else {
        Err("the distribution's packages are installed, but /usr/bin/rustc, its library source or ld.lld-22 is not where expected".into())
    }
}

impl Toolchain {
    /// Builds the image in `firmware/`, release profile.
    pub fn build(&self, folder: &Path, features: &[&str]) -> Result<(), String> {
        let mut arguments = vec!["build", "--release", "--target", TARGET];
        arguments.extend(features);
        match self {
            Self::Rustup => command(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()), &arguments, folder, &[]),
            Self::Distribution => {
                arguments.extend(["-Z", "build-std=core"]);
                // Set by the cargo that runs this program; the other compiler must not see it.
                let variables = [
                    ("RUSTC", "/usr/bin/rustc"),
                    ("RUSTC_BOOTSTRAP", "1"),
                    ("RUSTUP_TOOLCHAIN", ""),
                    ("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", "/usr/bin/ld.lld-22"),
                ];
                command("/usr/bin/cargo", &arguments, folder, &variables)
            }
        }
    }
}

//! Finds or installs a compiler for another target: that of the firmware, or WebAssembly.
//!
//! First rustup's target, the usual way. Where rustup cannot download (a closed build machine) the
//! distribution's compiler is taken, which brings the library's source beside it; the standard library is
//! then built on the way.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::debian;
use crate::workspace::{command, root};

/// A target, and how the distribution's compiler builds for it.
pub struct Target {
    name: &'static str,
    /// Parts of the standard library that are built.
    standard_library: &'static str,
    linker: (&'static str, &'static str),
}

/// The target of the firmware.
pub const FIRMWARE: Target = Target {
    name: "thumbv7em-none-eabihf",
    standard_library: "build-std=core",
    linker: (
        "CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER",
        "/usr/bin/ld.lld-22",
    ),
};
/// That of a browser.
pub const WEB_ASSEMBLY: Target = Target {
    name: "wasm32-unknown-unknown",
    standard_library: "build-std=std,panic_abort",
    linker: (
        "CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER",
        "/usr/bin/wasm-ld-22",
    ),
};

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
    root()
        .join("firmware/target")
        .join(FIRMWARE.name)
        .join("release/hysteron-firmware")
}

/// What the NUCLEO-H743ZI2 runs before any image.
pub fn boot_stage() -> PathBuf {
    image().with_file_name("hysteron-boot-stage")
}

/// The same with the chip's own converters.
pub fn on_chip_image() -> PathBuf {
    image().with_file_name("hysteron-firmware-on-chip")
}

/// That of another sampling rate, kHz.
pub fn image_at(rate_khz: u32) -> PathBuf {
    image().with_file_name(format!("hysteron-firmware-{rate_khz}khz"))
}

/// That of the NUCLEO-G474RE.
pub fn g474re_image() -> PathBuf {
    image().with_file_name("hysteron-firmware-nucleo-g474re")
}

fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

fn rustup_has(target: &Target) -> bool {
    output("rustup", &["target", "list", "--installed"])
        .is_some_and(|targets| targets.lines().any(|line| line.trim() == target.name))
}

fn distribution_has_all() -> bool {
    Path::new("/usr/bin/cargo").exists()
        && output("/usr/bin/rustc", &["--print", "sysroot"]).is_some_and(|sysroot| {
            Path::new(sysroot.trim())
                .join("lib/rustlib/src/rust/library/core/src/lib.rs")
                .exists()
        })
        && Path::new("/usr/bin/ld.lld-22").exists()
}

/// Finds a compiler for the target, installing one if it is missing.
pub fn for_target(target: &Target) -> Result<Toolchain, String> {
    let name = target.name;
    if rustup_has(target) {
        println!("   compiler: rustup's, target {name} is installed");
        return Ok(Toolchain::Rustup);
    }
    if distribution_has_all() {
        println!("   compiler: the distribution's in /usr/bin, with its library source");
        return Ok(Toolchain::Distribution);
    }
    println!("   no compiler for {name} yet; trying `rustup target add {name}`");
    let added = Command::new("rustup")
        .args(["target", "add", name])
        .status();
    if added.is_ok_and(|status| status.success()) && rustup_has(target) {
        return Ok(Toolchain::Rustup);
    }
    println!(
        "   rustup cannot download it here; trying the distribution's packages {}",
        PACKAGES.join(" ")
    );
    if !debian::can_install() {
        return Err(format!(
            "no compiler for {name}. Either `rustup target add {name}` (needs the network), or as root on Debian `apt-get install {}`",
            PACKAGES.join(" ")
        ));
    }
    debian::install(&PACKAGES)?;
    if distribution_has_all() {
        Ok(Toolchain::Distribution)
    } else {
        Err("the distribution's packages are installed, but /usr/bin/rustc, its library source or ld.lld-22 is not where expected".into())
    }
}

impl Toolchain {
    /// Builds what a folder has for a target, release profile.
    pub fn build(&self, target: &Target, folder: &Path, selection: &[&str]) -> Result<(), String> {
        self.build_with(target, folder, selection, &[])
    }

    /// Builds with these variables.
    pub fn build_with(
        &self,
        target: &Target,
        folder: &Path,
        selection: &[&str],
        variables: &[(&str, &str)],
    ) -> Result<(), String> {
        let mut arguments = vec!["build", "--release", "--target", target.name];
        arguments.extend(selection);
        match self {
            Self::Rustup => command(
                std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()),
                &arguments,
                folder,
                variables,
            ),
            Self::Distribution => {
                arguments.extend(["-Z", target.standard_library]);
                // Set by the cargo that runs this program; the other compiler must not see it.
                let own = [
                    ("RUSTC", "/usr/bin/rustc"),
                    ("RUSTC_BOOTSTRAP", "1"),
                    ("RUSTUP_TOOLCHAIN", ""),
                    target.linker,
                ];
                command(
                    "/usr/bin/cargo",
                    &arguments,
                    folder,
                    &[&own, variables].concat(),
                )
            }
        }
    }
}

//! `emulate`: the emulated board with its serial port on a socket.

use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;

use hysteron_core::parameter_block::read;
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::converters::World;
use hysteron_emulator::live_run::run_live;
use hysteron_emulator::serial_line::SharedLine;
use hysteron_sim::bench::{Bench, Variant};

use crate::serial_socket;

/// Ticks per second that the image is made for.
const SAMPLE_RATE_HZ: u32 = 20_000;
/// The block that was designed for the simulated stage.
const BENCH_BLOCK: &[u8] = include_bytes!("../../emulator/tests/p753.block");
/// Seed of the sensor's noise.
const SEED: u64 = 1;

/// What `emulate` is told.
#[derive(Debug, PartialEq, Eq)]
pub struct Options {
    address: SocketAddr,
    image: Option<PathBuf>,
    block: Option<PathBuf>,
}

impl Options {
    /// From the words behind `emulate`.
    pub fn read(words: &[&str]) -> Result<Self, String> {
        let mut options = Self { address: SocketAddr::from(([127, 0, 0, 1], 50_000)), image: None, block: None };
        let mut words = words.iter();
        while let Some(word) = words.next() {
            let mut value = || words.next().copied().ok_or_else(|| format!("`{word}` needs a value"));
            match *word {
                "--tcp" => {
                    let text = value()?;
                    options.address = text.parse().map_err(|_| format!("--tcp {text}: expected an address like 127.0.0.1:50000"))?;
                }
                "--image" => options.image = Some(value()?.into()),
                "--block" => options.block = Some(value()?.into()),
                other => return Err(format!("`{other}`: expected --tcp, --image or --block")),
            }
        }
        Ok(options)
    }
}

/// The image: the one that was named, or the one beside this program.
fn image(options: &Options) -> Result<PathBuf, String> {
    let path = match &options.image {
        Some(path) => path.clone(),
        None => std::env::current_exe().map_err(|error| error.to_string())?.with_file_name("hysteron-firmware.elf"),
    };
    if path.is_file() {
        Ok(path)
    } else {
        Err(format!("{}: there is no image; `cargo xtask board` puts it there, or name one with --image", path.display()))
    }
}

fn block(options: &Options) -> Result<Vec<u8>, String> {
    let Some(path) = &options.block else { return Ok(BENCH_BLOCK.to_vec()) };
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    read(&bytes, SAMPLE_RATE_HZ).map_err(|error| format!("{}: {}", path.display(), error.reason()))?;
    Ok(bytes)
}

/// Runs the board until the process is interrupted.
pub fn run(options: Options) -> Result<(), String> {
    let (image, block) = (image(&options)?, block(&options)?);
    let bench = Bench::reference().map_err(|error| format!("the simulated stage: {error}"))?;
    let listener = TcpListener::bind(options.address).map_err(|error| format!("{}: {error}", options.address))?;
    let address = listener.local_addr().map_err(|error| error.to_string())?;
    println!("the serial port is {address}");
    let _ = std::io::stdout().flush();

    let line = SharedLine::default();
    serial_socket::serve(listener, &line);
    let world = World::new(&bench, Variant::FULL, SEED).shared();
    if let Ok(mut world) = world.lock() {
        world.keeps_codes = false;
    }
    let board = NucleoBoard::with_plant(&world).map_err(|error| error.to_string())?;
    run_live(&image, board, Some(&block), &line, |level, text| {
        // The running trace is for programs that decode it.
        if !text.starts_with("trace [") {
            println!("{level:>5} {text}");
            let _ = std::io::stdout().flush();
        }
    })
    .map_err(|error| format!("{error:#}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_understood_or_the_word_is_named() {
        let options = Options::read(&["--tcp", "127.0.0.1:0", "--image", "a.elf"]).expect("options");
        assert_eq!((options.address.port(), options.image, options.block), (0, Some(PathBuf::from("a.elf")), None));
        for (words, named) in [(&["--tcp"][..], "--tcp"), (&["--tcp", "here"], "here"), (&["--fast"], "--fast")] {
            assert!(Options::read(words).expect_err("refused").contains(named), "{words:?}");
        }
    }

    #[test]
    fn a_block_that_is_none_is_refused_with_its_name() {
        let options = Options::read(&["--block", concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml")]).expect("options");
        assert!(block(&options).expect_err("refused").contains("Cargo.toml"));
        assert!(read(BENCH_BLOCK, SAMPLE_RATE_HZ).is_ok());
    }
}

//! `emulate`: the emulated board with its serial port on a socket, and what stands behind its converters.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use hysteron::model_file;
use hysteron::servo::amplifier_block::FrontEnd;
use hysteron::servo::chain_plant::ChainPlant;
use hysteron::servo::stepping_design::{SteppingDesign, SteppingOrder};
use hysteron::servo::{amplifier_block, stepping_rig};
use hysteron_core::codes::DriveCode;
use hysteron_core::parameter_block::read;
use hysteron_core::wire::BlockError;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::sample_rate_hz;
use hysteron_emulator::running_board::{serve_board, witness};
use hysteron_sim::bench::{Bench, Variant};
use hysteron_sim::stick_slip::{StickSlipActuator, StickSlipPlant};

/// The block that was designed for the simulated bench, for an image of 20 kHz.
const BENCH_BLOCK: &[u8] = include_bytes!("../../../tests/p753.block");
/// Seed of the sensor's noise.
const SEED: u64 = 1;
/// Noise of the sensor in front of a stage from a file, um RMS.
const STAGE_NOISE_UM: f64 = 0.002;

/// Arguments of `emulate`.
#[derive(Debug, PartialEq)]
pub struct Options {
    address: SocketAddr,
    image: Option<PathBuf>,
    block: Block,
    stage: Option<PathBuf>,
    stick_slip: Option<PathBuf>,
    front_end: Option<PathBuf>,
    noise_um: f64,
    truth: Option<PathBuf>,
}

/// What the flash holds.
#[derive(Debug, PartialEq, Eq)]
enum Block {
    /// What fits the stage: the bench's block for the bench, nothing for a stage from a file.
    Fitting,
    /// Nothing.
    Empty,
    /// A file's bytes.
    File(PathBuf),
}

impl Options {
    /// From the words behind `emulate`.
    pub fn read(words: &[&str]) -> Result<Self, String> {
        let mut options = Self {
            address: SocketAddr::from(([127, 0, 0, 1], 50_000)),
            image: None,
            block: Block::Fitting,
            stage: None,
            stick_slip: None,
            front_end: None,
            noise_um: STAGE_NOISE_UM,
            truth: None,
        };
        let mut words = words.iter();
        while let Some(word) = words.next() {
            let mut value = || {
                words
                    .next()
                    .copied()
                    .ok_or_else(|| format!("`{word}` needs a value"))
            };
            match *word {
                "--tcp" => {
                    let text = value()?;
                    options.address = text.parse().map_err(|_| {
                        format!("--tcp {text}: expected an address like 127.0.0.1:50000")
                    })?;
                }
                "--image" => options.image = Some(value()?.into()),
                "--block" => options.block = Block::File(value()?.into()),
                "--empty" => options.block = Block::Empty,
                "--stage" => options.stage = Some(value()?.into()),
                "--stick-slip" => options.stick_slip = Some(value()?.into()),
                "--front-end" => options.front_end = Some(value()?.into()),
                "--noise-nm" => {
                    let text = value()?;
                    let nanometres = text
                        .parse::<f64>()
                        .ok()
                        .filter(|nm| (0.0..=1000.0).contains(nm));
                    options.noise_um = 1e-3
                        * nanometres.ok_or_else(|| {
                            format!("--noise-nm {text}: expected a number from 0 to 1000")
                        })?;
                }
                "--truth" => options.truth = Some(value()?.into()),
                other => {
                    let known = "--tcp, --image, --block, --empty, --stage, --stick-slip, --front-end, --noise-nm or --truth";
                    return Err(format!("`{other}`: expected {known}"));
                }
            }
        }
        let bench = options.stage.is_none() && options.stick_slip.is_none();
        if bench && options.front_end.is_some() {
            return Err(
                "--front-end: the wiring of the simulated bench is fixed; it goes with --stage or --stick-slip"
                    .into(),
            );
        }
        if options.stage.is_some() && options.stick_slip.is_some() {
            return Err("--stick-slip: expected one stage, and --stage names another".into());
        }
        Ok(options)
    }
}

/// The image: the one that was named, or the one beside this program.
fn image(options: &Options) -> Result<PathBuf, String> {
    let path = match &options.image {
        Some(path) => path.clone(),
        None => std::env::current_exe()
            .map_err(|error| error.to_string())?
            .with_file_name("hysteron-firmware.elf"),
    };
    if path.is_file() {
        Ok(path)
    } else {
        Err(format!(
            "{}: there is no image; `cargo xtask board` puts it there, or name one with --image",
            path.display()
        ))
    }
}

/// What the flash holds, for an image of this sampling rate.
fn block(options: &Options, rate_hz: u32) -> Result<Option<Vec<u8>>, String> {
    let path = match &options.block {
        Block::Fitting if options.stick_slip.is_some() => {
            let (rig, order) = stick_slip(options)?;
            let parameters = SteppingDesign::new(&rig, &order)?
                .block()
                .map_err(|error| error.to_string())?;
            let bytes = amplifier_block::block(&parameters).map_err(|error| error.to_string())?;
            return Ok(Some(bytes));
        }
        Block::Fitting => {
            return Ok(
                (options.stage.is_none() && read(BENCH_BLOCK, rate_hz).is_ok())
                    .then(|| BENCH_BLOCK.to_vec()),
            );
        }
        Block::Empty => return Ok(None),
        Block::File(path) => path,
    };
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    read(&bytes, rate_hz).map_err(|error| match error {
        BlockError::SampleRate(made_for_hz) => format!(
            "{}: made for {made_for_hz} Hz; the image samples at {rate_hz} Hz",
            path.display()
        ),
        _ => format!("{}: {}", path.display(), error.reason()),
    })?;
    Ok(Some(bytes))
}

fn text(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// The stick-slip rig, and how it is wired.
fn stick_slip(options: &Options) -> Result<(StickSlipActuator, SteppingOrder), String> {
    let path = options.stick_slip.as_deref().unwrap_or(Path::new(""));
    let rig = stepping_rig::from_toml(&text(path)?, &path.display().to_string())
        .map_err(|error| error.to_string())?;
    let mut order = SteppingOrder::default();
    if let Some(path) = &options.front_end {
        order.front_end = FrontEnd::from_toml(&text(path)?, &path.display().to_string())
            .map_err(|error| error.to_string())?;
    }
    Ok((rig, order))
}

/// What stands behind the converters, sampled at this rate.
fn world(options: &Options, rate_hz: u32) -> Result<World, String> {
    if options.stick_slip.is_some() {
        let (rig, order) = stick_slip(options)?;
        let scale = order.front_end.scale(0.0, rig.drive_range_v);
        let plant = StickSlipPlant::at_rest(rig, 1.0 / f64::from(rate_hz));
        let mut world = World::with(Box::new(plant), scale, options.noise_um, SEED);
        world.encoder = true;
        world.period_ns = (1e9 / f64::from(rate_hz)).round() as u64;
        return Ok(world);
    }
    let Some(stage) = &options.stage else {
        let mut bench =
            Bench::reference().map_err(|error| format!("the simulated bench: {error}"))?;
        bench.converters.sample_rate_hz = rate_hz.into();
        return Ok(World::new(&bench, Variant::FULL, SEED));
    };
    let chain = model_file::from_toml(&text(stage)?, &stage.display().to_string())
        .map_err(|error| error.to_string())?;
    let front_end = match &options.front_end {
        Some(path) => FrontEnd::from_toml(&text(path)?, &path.display().to_string())
            .map_err(|error| error.to_string())?,
        None => FrontEnd::default(),
    };
    let scale = front_end.scale(chain.drive_min_v, chain.drive_max_v);
    let (low_v, high_v) = (
        scale.drive_v(DriveCode::new(0)),
        scale.drive_v(DriveCode::highest(scale.dac_bits)),
    );
    if low_v > chain.drive_min_v || high_v < chain.drive_max_v {
        let stage_v = format!("{} to {} V", chain.drive_min_v, chain.drive_max_v);
        return Err(format!(
            "{}: its drive is {stage_v}, the wiring gives {low_v} to {high_v:.3} V; expected --front-end",
            stage.display()
        ));
    }
    let period_s = 1.0 / f64::from(rate_hz);
    let mut world = World::with(
        Box::new(ChainPlant::at_rest(&chain, chain.drive_min_v, period_s)),
        scale,
        options.noise_um,
        SEED,
    );
    world.period_ns = (1e9 * period_s).round() as u64;
    Ok(world)
}

/// Runs the board until the process is interrupted.
pub fn run(options: Options) -> Result<(), String> {
    let image = image(&options)?;
    let rate_hz = sample_rate_hz(&image).map_err(|error| format!("{error:#}"))?;
    let block = block(&options, rate_hz)?;
    let mut world = world(&options, rate_hz)?;
    world.witness = options.truth.as_deref().map(witness).transpose()?;
    serve_board(world, &image, block.as_deref(), options.address)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_understood_or_the_word_is_named() {
        let options =
            Options::read(&["--tcp", "127.0.0.1:0", "--image", "a.elf"]).expect("options");
        assert_eq!(
            (options.address.port(), options.image, options.block),
            (0, Some(PathBuf::from("a.elf")), Block::Fitting)
        );
        for (words, named) in [
            (&["--tcp"][..], "--tcp"),
            (&["--tcp", "here"], "here"),
            (&["--fast"], "--fast"),
            (&["--noise-nm", "-1"], "--noise-nm"),
            (&["--front-end", "a"], "--stage"),
        ] {
            assert!(
                Options::read(words).expect_err("refused").contains(named),
                "{words:?}"
            );
        }
    }

    #[test]
    fn a_block_that_is_none_is_refused_with_its_name() {
        let options = Options::read(&[
            "--block",
            concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"),
        ])
        .expect("options");
        assert!(
            block(&options, 20_000)
                .expect_err("refused")
                .contains("Cargo.toml")
        );
        assert!(read(BENCH_BLOCK, 20_000).is_ok());
        let options = |words: &[&str]| Options::read(words).expect("options");
        assert_eq!(
            block(&options(&["--stage", "a.toml"]), 20_000),
            Ok(None),
            "a block for another stage fits none"
        );
        assert_eq!(block(&options(&["--empty"]), 20_000), Ok(None));
        assert_eq!(
            block(&options(&[]), 20_000).map(|block| block.map(|block| block.len())),
            Ok(Some(BENCH_BLOCK.len()))
        );
    }
}

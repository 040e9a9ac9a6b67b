//! Build and check chores: `cargo xtask check` is the test command of the project.
//!
//! `check` runs every step of [`steps`], announces each with its time, and stops at the first that fails.
//! What a step needs and the machine lacks is installed where that is possible ([`toolchain`]), and said
//! either way. No step is skipped silently: outside CI what is missing is named and the check fails; in CI
//! (`CI=true`) likewise.

mod board;
mod board_tune;
mod browser;
mod checks;
mod control_code;
mod cost;
mod debian;
mod dependency_licences;
mod dependency_tree;
mod emulated_board;
mod figures;
mod finder_sets;
mod house;
mod images;
mod lab_page;
mod library_alone;
mod measure;
mod mutants;
mod mutate;
mod packages;
mod pipython;
mod prose;
mod public_items;
mod python_package;
mod result_tables;
mod skipped_tests;
mod soak;
mod steps;
mod test_programs;
mod toolchain;
mod virtual_environment;
mod whole_circle;
mod workspace;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Build and check chores of Hysteron.
#[derive(Parser)]
#[command(bin_name = "cargo xtask")]
struct Program {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// Format, lints, unit tests, one explain: what an edit is tried with
    Quick,
    /// Format, lints, docs, tests, the firmware's cross-build, the emulated target: the test command
    Check,
    /// The check, then what takes long: 72 independent stages, mutations of the firmware
    Full,
    /// Where the processor time of the last chore went, by step and by program of tests
    Times,
    /// How large the sources are and how they hang together, crate by crate, and the table of `times`
    Measure {
        /// Of this revision instead of the checkout
        #[arg(long)]
        at: Option<String>,
        /// Lists long functions, long files and circles
        #[arg(long)]
        places: bool,
    },
    /// The steps that need only the host's toolchain
    Host,
    /// The steps of other targets, which `check` runs beside those of the host: `library`, `firmware`, `emulate`
    Targets,
    /// The library alone: what it depends on, its build for WebAssembly, and the lab page with its test
    Library,
    /// The Python package in a fresh environment, and the formats as their own libraries write them today
    Python,
    /// Builds the lab page, target/lab.html
    Lab,
    /// Builds the firmware's images and checks the binaries
    Firmware,
    /// Runs the tests of the images on the emulated STM32H743 (after `firmware`)
    Emulate,
    /// What an operator does with the emulated board: PIPython, `hysteron board tune` (after `board`)
    Operate,
    /// `hysteron board tune` in front of the independent stages of these seeds (after `board`)
    Tune {
        #[arg(required = true)]
        seeds: Vec<u64>,
    },
    /// Builds the operator's program `hysteron-board` and puts it with the image beside `hysteron` (after
    /// `firmware`)
    Board,
    /// Takes lines of safety out of the firmware, each once, and expects an emulated test to fail
    /// (firmware/mutations.toml)
    Mutate { names: Vec<String> },
    /// Changes every expression of the files that decide a fault or a name, one at a time, and stores how many
    /// changes the tests notice; benchmarks/results/mutants.csv, docs/results/figures.md
    Mutants {
        /// Of these files only, such as `guard`
        files: Vec<String>,
    },
    /// Runs the amplifier against an adversary for so many ticks, with every sum looked at, and stores what was
    /// seen; benchmarks/results/soak.csv, docs/results/figures.md
    Soak {
        #[arg(default_value_t = 1_000_000_000)]
        ticks: u64,
    },
    /// Stores what the notebook of examples/ prints (after `python`)
    Notebook,
    /// Words a sentence, banned words and long lines by file; a page that passes a limit fails
    Prose {
        /// A source fails too
        #[arg(long)]
        strict: bool,
        /// Lists each place in these files
        files: Vec<String>,
    },
    /// Workflows, citation and licences by the tools of their formats; what manifests lack
    House,
    /// Packs what is published and builds it from the packed files; nothing is uploaded
    Packages,
    /// How well a program finds what is missing, set by set; results in benchmarks/results
    FinderSets(finder_sets::Request),
    /// What each rule of the finder buys on planted cases, pairs and altered recordings;
    /// benchmarks/results/ablation.csv
    Ablate(finder_sets::ablation::Request),
    /// Measures how fast it is here and what a sample takes, and says what became worse;
    /// benchmarks/results/speed.csv and instructions.csv, docs/results/figures.md
    Figures,
    /// Writes the table of effects in docs/reference/list_of_effects.md, and that of formats in
    /// docs/reference/formats.md
    Readme,
    /// Writes the tables of docs/ that come from benchmarks/results
    Tables,
    /// Writes the list of what the library shows, lab/library/public_items.txt (after `host`)
    PublicItems,
}

fn main() -> ExitCode {
    let result = match Program::parse().chore {
        Chore::Quick => steps::run(steps::QUICK),
        Chore::Check => steps::check(),
        Chore::Full => steps::full(),
        Chore::Times => cost::print(),
        Chore::Measure { at, places } => measure::print(at.as_deref(), places),
        Chore::Host => steps::run(steps::HOST),
        Chore::Targets => steps::run_other_targets(),
        Chore::Library => steps::run(steps::LIBRARY),
        Chore::Python => steps::run(steps::PYTHON),
        Chore::Lab => lab_page::build(),
        Chore::Firmware => steps::run(steps::FIRMWARE),
        Chore::Emulate => steps::run(&steps::emulator()),
        Chore::Operate => steps::run(steps::OPERATOR),
        Chore::Tune { seeds } => board_tune::run_seeds(&seeds),
        Chore::Board => board::build(),
        Chore::Mutate { names } => mutate::run(&names),
        Chore::Mutants { files } => mutants::run(&files),
        Chore::Soak { ticks } => soak::run(ticks),
        Chore::Notebook => python_package::write_notebook(),
        Chore::Prose { strict, files } => prose::report(strict, &files),
        Chore::House => steps::run(steps::HOUSE),
        Chore::Packages => steps::run(steps::PACKAGES),
        Chore::FinderSets(request) => finder_sets::run(&request),
        Chore::Ablate(request) => finder_sets::ablation::run(&request),
        Chore::Figures => figures::write(),
        Chore::Readme => checks::write_tables(),
        Chore::Tables => result_tables::write(),
        Chore::PublicItems => public_items::write(),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("\n{message}");
            ExitCode::FAILURE
        }
    }
}

//! Build and check chores: `cargo xtask check` is the test command of the project.
//!
//! `check` runs every step of [`steps`], announces each with its time, and stops at the first that fails.
//! What a step needs and the machine lacks is installed where that is possible ([`toolchain`]), and said
//! either way. No step is skipped silently: outside CI what is missing is named and the check fails; in CI
//! (`CI=true`) likewise.

mod board;
mod board_tune;
mod browser;
mod control_code;
mod debian;
mod dependency_tree;
mod emulated_board;
mod finder_sets;
mod house;
mod lab_page;
mod library_alone;
mod mutate;
mod packages;
mod pipython;
mod prose;
mod public_items;
mod python_package;
mod result_tables;
mod steps;
mod test_programs;
mod toolchain;
mod virtual_environment;
mod whole_circle;

use std::process::ExitCode;

const USAGE: &str = "\
cargo xtask quick      format, lints, unit tests, one explain: what an edit is tried with
cargo xtask full       the check, then what takes long: 72 independent stages, mutations of the firmware
cargo xtask check      everything but that: format, lints, docs, tests, the firmware's cross-build, the emulated target
cargo xtask host       the steps that need only the host's toolchain
cargo xtask targets    the steps of other targets: `library`, `firmware` and `emulate`
cargo xtask library    the library alone: what it depends on, its build for WebAssembly, and the lab page with its test
cargo xtask python     the Python package in a fresh environment, and the formats as their own libraries write them today
cargo xtask lab        builds the lab page, target/lab.html
cargo xtask firmware   builds the firmware's images and checks the binaries
cargo xtask emulate    runs the tests of the images on the emulated STM32H743 (after `firmware`)
cargo xtask operate    what an operator does with the emulated board: PIPython, `hysteron board tune` (after `board`)
cargo xtask tune SEED.. `hysteron board tune` in front of these independent stages (after `board`)
cargo xtask board      builds the operator's program `hysteron-board` and puts it with the image beside `hysteron` (after `firmware`)
cargo xtask mutate [NAME..] takes lines of safety out of the firmware, each once, and expects an emulated test to fail (firmware/mutations.toml)
cargo xtask notebook   stores what the notebook of examples/ prints (after `python`)
cargo xtask prose [--strict] [FILE..] words a sentence, banned words and long lines by file; a page that passes a limit fails, with --strict a source too; of named files, each place
cargo xtask house      workflows, citation and licences by the tools of their formats; what manifests lack
cargo xtask packages   packs what is published and builds it from the packed files; nothing is uploaded
cargo xtask finder-sets [--program PATH] [--label NAME] [--sample N] [--table] [SET..] how well a program finds what is missing, set by set; results in benchmarks/results
cargo xtask ablate [--sample N] [RULE..] what each rule of the finder buys on planted cases, pairs and altered recordings; benchmarks/results/ablation.csv
cargo xtask readme     writes the table of effects in docs/reference/list_of_effects.md, and that of formats in docs/reference/formats.md
cargo xtask tables     writes the tables of docs/ that come from benchmarks/results
cargo xtask public-items writes the list of what the library shows, lab/library/public_items.txt (after `host`)";

fn main() -> ExitCode {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    if wanted == ["check"] {
        return ended(steps::check());
    }
    if wanted == ["full"] {
        return ended(steps::full());
    }
    if let Some(("ablate", arguments)) = wanted
        .split_first()
        .map(|(first, rest)| (first.as_str(), rest))
    {
        return ended(finder_sets::ablation::run(arguments));
    }
    if wanted == ["public-items"] {
        return ended(public_items::write());
    }
    if wanted == ["tables"] {
        return ended(result_tables::write());
    }
    if wanted == ["readme"] {
        return ended(steps::write_tables());
    }
    if wanted == ["notebook"] {
        return ended(python_package::write_notebook());
    }
    if wanted == ["board"] {
        return ended(board::build());
    }
    if wanted == ["lab"] {
        return ended(lab_page::build());
    }
    if let [first, seeds @ ..] = wanted.as_slice()
        && first == "tune"
        && !seeds.is_empty()
    {
        return ended(board_tune::run_seeds(
            &seeds.iter().map(String::as_str).collect::<Vec<_>>(),
        ));
    }
    if let [first, names @ ..] = wanted.as_slice()
        && first == "mutate"
    {
        return ended(mutate::run(names));
    }
    if let [first, rest @ ..] = wanted.as_slice()
        && first == "prose"
    {
        return ended(prose::report(rest));
    }
    if let [first, arguments @ ..] = wanted.as_slice()
        && first == "finder-sets"
    {
        return ended(finder_sets::run(arguments));
    }
    let steps = match wanted
        .iter()
        .map(String::as_str)
        .collect::<Vec<_>>()
        .as_slice()
    {
        [steps::OTHER_TARGETS] => steps::of_other_targets(),
        ["quick"] => steps::quick(),
        ["host"] => steps::host(),
        ["library"] => steps::library(),
        ["python"] => steps::python(),
        ["firmware"] => steps::firmware(),
        ["emulate"] => steps::emulator(),
        ["house"] => steps::house(),
        ["packages"] => steps::packages(),
        ["operate"] => steps::operator(),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    // The second line of a check is part of it, and has nothing to forget.
    let begun = if wanted == [steps::OTHER_TARGETS] {
        Ok(())
    } else {
        steps::forget_skipped_tests()
    };
    ended(begun.and_then(|()| steps::run(&steps)))
}

fn ended(result: Result<(), String>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("\n{message}");
            ExitCode::FAILURE
        }
    }
}

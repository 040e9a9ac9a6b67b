//! `cargo xtask finder-sets`: how well a program finds what is missing, set by set, and two programs beside
//! each other.
//!
//! Every case is one run of a built `hysteron`. A run appends its row to
//! `benchmarks/results/finder_<label>.csv`; a case that has a row is not run again, so that an interrupted
//! command goes on where it was. The table at the end has one block for each label with a file there;
//! `--table` runs nothing.

pub mod ablation;
mod altered;
mod answer;
mod case;
mod context;
mod front_ends;
mod invariance;
mod mark;
mod page;
mod planted;
mod recorded;
mod relaxation;
pub mod results;
mod table;
mod table_of_numbers;
mod true_effects;

use crate::workspace::{built, root};
use case::{CaseCheck, Set, SetCase};
use context::Context;
use results::Results;
use std::path::PathBuf;

/// All sets, in the order of the table.
pub const SETS: [Set; 14] = [
    Set {
        name: "planted",
        asked: "in set 98 %, wrong 0",
        cases: planted::shared,
    },
    Set {
        name: "all",
        asked: "in set 98 %, wrong 0",
        cases: planted::all,
    },
    Set {
        name: "nothing",
        asked: "named 5 %",
        cases: planted::nothing,
    },
    Set {
        name: "pairs",
        asked: "in set 97 %",
        cases: planted::pairs,
    },
    Set {
        name: "triples",
        asked: "in set 93 %",
        cases: planted::triples,
    },
    Set {
        name: "loops",
        asked: "in set 97 %, wrong 0",
        cases: planted::other_loops,
    },
    Set {
        name: "relaxation",
        asked: "in set 95 %, wrong 0",
        cases: relaxation::cases,
    },
    Set {
        name: "altered",
        asked: "in set 30 of 30, wrong 0",
        cases: altered::from_the_model,
    },
    Set {
        name: "altered_gain",
        asked: "in set 28 of 30, wrong 0",
        cases: altered::from_a_gain,
    },
    Set {
        name: "unaltered",
        asked: "named 0",
        cases: altered::unaltered,
    },
    Set {
        name: "recorded",
        asked: "each 10 s, median 5 s",
        cases: recorded::twelve,
    },
    Set {
        name: "speed",
        asked: "example 5 s, 20 Hz 8 s",
        cases: recorded::speed,
    },
    Set {
        name: "invariance",
        asked: "same names 98 %",
        cases: invariance::cases,
    },
    Set {
        name: "front_ends",
        asked: "equal",
        cases: front_ends::cases,
    },
];

/// What is run.
#[derive(clap::Args)]
pub struct Request {
    /// The program that is asked, by default the release build
    #[arg(long)]
    program: Option<PathBuf>,
    /// Names the results
    #[arg(long, default_value = "new")]
    label: String,
    /// Runs so many cases of each set
    #[arg(long)]
    sample: Option<usize>,
    /// Other thresholds
    #[arg(long)]
    policy: Option<PathBuf>,
    /// Writes the altered recordings into this folder and runs nothing
    #[arg(long)]
    write_altered: Option<PathBuf>,
    /// Runs nothing and prints the table
    #[arg(long)]
    table: bool,
    /// Runs no search: fits the true effects of each case that ran with this label, and lists where they fit
    /// better than the search's end
    #[arg(long)]
    true_effects: bool,
    /// Sets, by default all
    #[arg(value_parser = SETS.map(|set| set.name))]
    sets: Vec<String>,
}

/// The program that is asked: this one, or the release build.
fn program(named: Option<&PathBuf>) -> Result<PathBuf, String> {
    let program = named.cloned().unwrap_or_else(|| built("hysteron"));
    if program.exists() {
        Ok(program)
    } else {
        Err(format!(
            "{}: is not there; cargo build --release -p hysteron-cli, or --program PATH",
            program.display()
        ))
    }
}

/// Runs what is requested and prints the table.
pub fn run(request: &Request) -> Result<(), String> {
    if request.table {
        table::print(&SETS, &Results::all()?);
        return Ok(());
    }
    let context = Context {
        program: program(request.program.as_ref())?,
        label: request.label.clone(),
        folder: root().join("target/finder_sets"),
        policy: request.policy.clone(),
    };
    if let Some(folder) = &request.write_altered {
        return altered::write_all(&context, folder);
    }
    let mut results = Results::open(&context.label)?;
    let wanted =
        |set: &&Set| request.sets.is_empty() || request.sets.iter().any(|name| name == set.name);
    for set in SETS.iter().filter(wanted) {
        match (set.cases)(&context, request.sample) {
            Ok(cases) if request.true_effects => compare_truth(&context, set, &cases)?,
            Ok(cases) => run_set(&context, set, &cases, &mut results)?,
            // A set whose data are not here reports that; the others run.
            Err(problem) => println!("{:<12} not run: {problem}", set.name),
        }
    }
    if !request.true_effects {
        table::print(&SETS, &Results::all()?);
    }
    Ok(())
}

fn compare_truth(context: &Context, set: &Set, cases: &[SetCase]) -> Result<(), String> {
    let (mut lost, mut compared) = (0, 0);
    for case in cases {
        let better = true_effects::fit_better(case, context, set.name)?;
        compared += usize::from(better.is_some());
        lost += usize::from(better == Some(true));
    }
    println!(
        "{:<12} true effects fit better in {lost} of {compared}",
        set.name
    );
    Ok(())
}

fn run_set(
    context: &Context,
    set: &Set,
    cases: &[SetCase],
    results: &mut Results,
) -> Result<(), String> {
    for case in cases {
        if results.has(set.name, &case.name) {
            continue;
        }
        let row = match case.check {
            CaseCheck::FrontEnds => front_ends::compared(case, context, set.name)?,
            _ => case.run(context, set.name, results)?,
        };
        println!("{}", row.line());
        results.append(row)?;
    }
    Ok(())
}

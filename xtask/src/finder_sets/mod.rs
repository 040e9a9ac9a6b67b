//! `cargo xtask finder-sets`: how well a program finds what is missing, set by set, and two programs beside
//! each other.
//!
//! ```text
//! cargo xtask finder-sets [--program PATH] [--policy FILE] [--label NAME] [--sample N] [--table] [SET ...]
//! ```
//!
//! Every case is one run of a built `hysteron`. A run appends its row to
//! `benchmarks/results/finder_<label>.csv`; a case that has a row is not run again, so that an interrupted
//! command goes on where it was. The table at the end has one block for each label with a file there;
//! `--table` runs nothing.

pub mod ablation;
mod altered;
mod answer;
mod case;
mod front_ends;
mod invariance;
mod mark;
mod page;
mod planted;
mod recorded;
pub mod results;
mod table;
mod table_of_numbers;

use crate::steps::{built, root};
use case::SetCase;
use results::Results;
use std::path::{Path, PathBuf};

/// One set of cases.
pub struct Set {
    /// Its name on the command line and in the results.
    pub name: &'static str,
    /// What is asked of it.
    pub asked: &'static str,
    /// All its cases, or some of them.
    cases: fn(&Context, Option<usize>) -> Result<Vec<SetCase>, String>,
}

/// All sets, in the order of the table.
pub const SETS: [Set; 13] = [
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

/// What every set needs to know.
pub struct Context {
    program: PathBuf,
    label: String,
    /// Where data sets are made.
    folder: PathBuf,
    /// Other thresholds, as the program reads them.
    policy: Option<PathBuf>,
}

impl Context {
    /// The folder of a set, which is made.
    fn folder_of(&self, set: &str) -> Result<PathBuf, String> {
        let folder = self.folder.join(set);
        std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        Ok(folder)
    }
}

/// A folder of the data beside the project.
fn beside(path: &str) -> Result<PathBuf, String> {
    let folder = root().join("../shared/data").join(path);
    if folder.exists() {
        Ok(folder)
    } else {
        Err(format!(
            "{}: is not there; this set needs it",
            folder.display()
        ))
    }
}

/// Some of many, evenly spread.
fn spread<T>(mut all: Vec<T>, most: Option<usize>) -> Vec<T> {
    let (count, Some(most)) = (all.len(), most.filter(|most| *most < all.len())) else {
        return all;
    };
    let kept: Vec<usize> = (0..most)
        .map(|i| (2 * i + 1) * count / (2 * most))
        .collect();
    let mut at = 0;
    all.retain(|_| {
        at += 1;
        kept.contains(&(at - 1))
    });
    all
}

/// The value of an option, which is taken out of the arguments.
fn option_of(arguments: &mut Vec<String>, name: &str) -> Result<Option<String>, String> {
    let Some(at) = arguments.iter().position(|a| a == name) else {
        return Ok(None);
    };
    if at + 1 == arguments.len() {
        return Err(format!("{name} expects a value"));
    }
    Ok(arguments.drain(at..at + 2).next_back())
}

/// Runs what the arguments ask for and prints the table.
pub fn run(arguments: &[String]) -> Result<(), String> {
    let mut asked = arguments.to_vec();
    let mut option = |name: &str| option_of(&mut asked, name);
    let program = option("--program")?.map_or_else(|| built("hysteron"), PathBuf::from);
    let label = option("--label")?.unwrap_or_else(|| "new".into());
    let number = |text: String| {
        text.parse()
            .map_err(|_| format!("--sample {text}: expected a whole number"))
    };
    let sample: Option<usize> = option("--sample")?.map(number).transpose()?;
    let policy = option("--policy")?.map(PathBuf::from);
    let write_to = option("--write-altered")?;
    let only_table = asked
        .iter()
        .position(|a| a == "--table")
        .map(|at| asked.remove(at))
        .is_some();
    if let Some(unknown) = asked
        .iter()
        .find(|name| SETS.iter().all(|set| set.name != **name))
    {
        return Err(format!(
            "{unknown}: expected some of {}",
            SETS.map(|set| set.name).join(", ")
        ));
    }
    let context = Context {
        program,
        label,
        folder: root().join("target/finder_sets"),
        policy,
    };
    if let Some(folder) = write_to {
        return altered::write_all(&context, Path::new(&folder));
    }
    if !only_table {
        if !context.program.exists() {
            return Err(format!(
                "{}: is not there; cargo build --release -p hysteron-cli, or --program PATH",
                context.program.display()
            ));
        }
        let mut results = Results::open(&context.label)?;
        for set in SETS
            .iter()
            .filter(|set| asked.is_empty() || asked.iter().any(|name| name == set.name))
        {
            match (set.cases)(&context, sample) {
                Ok(cases) => run_set(&context, set, &cases, &mut results)?,
                // A set whose data are not here reports that; the others run.
                Err(problem) => println!("{:<12} not run: {problem}", set.name),
            }
        }
    }
    table::print(&Results::all()?);
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
        let row = case.run(context, set.name, results)?;
        println!("{}", row.line());
        results.append(row)?;
    }
    Ok(())
}

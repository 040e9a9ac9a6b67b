//! What a step costs, in seconds and in seconds of processor, and the table of the last chore.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use crate::workspace::root;

/// Since when a step is at work.
pub struct Stopwatch {
    begin: Instant,
    before_s: f64,
}

/// What a step took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    /// Seconds of the clock.
    pub seconds: f64,
    /// Seconds that all processors worked for programs that this one started and that have ended. They do not
    /// depend on what runs beside it. 0 where the system does not count them.
    pub processor_s: f64,
}

impl Stopwatch {
    /// Begins now.
    pub fn start() -> Self {
        Self {
            begin: Instant::now(),
            before_s: processor_of_children_s(),
        }
    }

    /// The cost so far.
    pub fn read(&self) -> Cost {
        Cost {
            seconds: self.begin.elapsed().as_secs_f64(),
            processor_s: processor_of_children_s() - self.before_s,
        }
    }
}

impl fmt::Display for Cost {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            out,
            "{:6.1} s  {:6.1} s of processor",
            self.seconds, self.processor_s
        )
    }
}

/// User and system time of children that have ended, from Linux.
fn processor_of_children_s() -> f64 {
    const TICKS_PER_S: f64 = 100.0;
    let status = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Behind the name of the program in brackets, which may hold blanks: proc(5), fields 16 and 17.
    let fields = status.rsplit_once(')').map_or("", |(_, fields)| fields);
    let ticks = fields.split_whitespace().skip(13).take(2);
    ticks.flat_map(str::parse::<f64>).sum::<f64>() / TICKS_PER_S
}

/// What a row of the table is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Share {
    /// A step of the chore.
    Step,
    /// Something inside a step: a build, a program of tests.
    Part,
}

const WORDS: [(Share, &str); 2] = [(Share::Step, "step"), (Share::Part, "part")];

fn file() -> PathBuf {
    root().join("target/times.txt")
}

/// Begins the table of another chore.
pub fn forget() {
    // Nothing to remove is as good.
    let _ = std::fs::remove_file(file());
}

/// Adds a row. Two lines of steps write to one file; a table that cannot be written fails no check.
pub fn keep(share: Share, name: &str, cost: Cost) {
    let word = WORDS
        .iter()
        .find(|(known, _)| *known == share)
        .map_or("", |(_, word)| word);
    let row = format!("{word}\t{name}\t{}\t{}\n", cost.seconds, cost.processor_s);
    let file = OpenOptions::new().create(true).append(true).open(file());
    if let Err(error) = file.and_then(|mut file| file.write_all(row.as_bytes())) {
        println!("   times.txt: {error}");
    }
}

type Costs = BTreeMap<(Share, String), Cost>;

/// Sums rows of the same name.
fn summed(text: &str) -> Costs {
    let mut costs = Costs::new();
    for line in text.lines() {
        let fields: Vec<&str> = line.split('\t').collect();
        let [word, name, seconds, processor_s] = fields[..] else {
            continue;
        };
        if let Some((share, _)) = WORDS.iter().find(|(_, known)| *known == word) {
            let cost = costs.entry((*share, name.to_owned())).or_default();
            cost.seconds += seconds.parse().unwrap_or(0.0);
            cost.processor_s += processor_s.parse().unwrap_or(0.0);
        }
    }
    costs
}

/// Steps of the last chore and their seconds of processor, the most expensive first.
fn sorted(costs: &Costs, share: Share) -> Vec<(&str, Cost)> {
    let of_share = costs.iter().filter(|((known, _), _)| *known == share);
    let mut rows: Vec<_> = of_share
        .map(|((_, name), cost)| (name.as_str(), *cost))
        .collect();
    rows.sort_by(|(_, a), (_, b)| b.processor_s.total_cmp(&a.processor_s));
    rows
}

/// Prints where the processor time of the last chore went: by step, then what the parts took of it.
pub fn print() -> Result<(), String> {
    let path = file();
    let text = std::fs::read_to_string(&path)
        .map_err(|error| format!("{}: {error}; no chore has run yet", path.display()))?;
    let costs = summed(&text);
    for (share, title) in [(Share::Step, "step"), (Share::Part, "of these")] {
        let rows = sorted(&costs, share);
        println!("\n| {title} | s of processor | s |\n|---|---:|---:|");
        for (name, cost) in &rows {
            println!("| {name} | {:.1} | {:.1} |", cost.processor_s, cost.seconds);
        }
        let processor_s: f64 = rows.iter().map(|(_, cost)| cost.processor_s).sum();
        println!("| all | {processor_s:.0} | |");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_one_name_are_summed_and_the_dearest_comes_first() {
        let text = "step\ta\t1\t2\nstep\tb\t1\t9\npart\tc\t1\t1\nstep\ta\t0.5\t3\ncut off";
        let costs = summed(text);
        let steps = sorted(&costs, Share::Step);
        assert_eq!(
            steps.iter().map(|row| row.0).collect::<Vec<_>>(),
            ["b", "a"]
        );
        assert_eq!((steps[1].1.seconds, steps[1].1.processor_s), (1.5, 5.0));
        assert_eq!(sorted(&costs, Share::Part).len(), 1);
    }

    #[test]
    fn a_child_that_works_is_counted() {
        let stopwatch = Stopwatch::start();
        let work = "i=0; while [ $i -lt 200000 ]; do i=$((i+1)); done";
        let ended = std::process::Command::new("sh").args(["-c", work]).status();
        assert!(ended.is_ok_and(|status| status.success()));
        assert!(stopwatch.read().processor_s > 0.0);
    }
}

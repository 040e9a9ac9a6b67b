//! One table of all sets, the labels beside each other.

use super::case::Set;
use super::results::{ResultRow, Results};
use std::fmt::Write as _;

/// Prints it.
pub fn print(sets: &[Set], all: &[Results]) {
    println!(
        "\n{:<13} {:<26} {:<10} {:>5}  {:<46} {:>7} {:>7} {:>9}",
        "set", "asked", "program", "cases", "got", "median", "most", "processor"
    );
    for set in sets {
        for results in all {
            let mut rows: Vec<&ResultRow> =
                results.rows.iter().filter(|r| r.set == set.name).collect();
            // The references of a comparison are no cases.
            rows.retain(|r| set.name != "invariance" || r.mark != "-");
            if rows.is_empty() {
                continue;
            }
            let (median_s, most_s, processor_s) = times(&rows);
            println!(
                "{:<13} {:<26} {:<10} {:>5}  {:<46} {median_s:>5.1} s {most_s:>5.1} s {processor_s:>7.1} s",
                set.name,
                set.asked,
                results.label,
                rows.len(),
                got(set, &rows)
            );
        }
    }
    ends(all);
}

/// Median and most seconds, and the median of the seconds of all processors.
fn times(rows: &[&ResultRow]) -> (f64, f64, f64) {
    let sorted = |of: fn(&ResultRow) -> f64| {
        let mut all: Vec<f64> = rows.iter().map(|r| of(r)).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let (wall, processor) = (sorted(|r| r.seconds), sorted(|r| r.processor_s));
    (
        wall[wall.len() / 2],
        wall[wall.len() - 1],
        processor[processor.len() / 2],
    )
}

fn got(set: &Set, rows: &[&ResultRow]) -> String {
    let count = |marks: &[&str]| {
        rows.iter()
            .filter(|r| marks.contains(&r.mark.as_str()))
            .count()
    };
    match set.name {
        "recorded" | "speed" => {
            let each: Vec<f64> = rows.iter().filter_map(|r| r.ends_um).collect();
            let mean = each.iter().map(|um| um.ln()).sum::<f64>() / each.len().max(1) as f64;
            format!("ends {:.2} nm in the geometric mean", 1e3 * mean.exp())
        }
        "invariance" => format!("{} the same names", count(&["same"])),
        "front_ends" => format!("{} equal", count(&["equal"])),
        "nothing" | "unaltered" => {
            let named = rows.iter().filter(|r| !r.said.is_empty()).count();
            format!(
                "{named} named something, {} at the noise",
                count(&["right"])
            )
        }
        _ => {
            let mut out = format!(
                "right {}, in set {}",
                count(&["right"]),
                count(&["right", "in set", "absorbed"])
            );
            for word in ["long or", "missed", "wrong or", "wrong"] {
                let _ = write!(out, ", {word} {}", count(&[word]));
            }
            out
        }
    }
}

/// Programs are compared on the recorded sets that both have.
fn ends(all: &[Results]) {
    let of = |results: &Results| -> Vec<(String, f64)> {
        results
            .rows
            .iter()
            .filter(|r| r.set == "recorded")
            .filter_map(|r| Some((r.case.clone(), r.ends_um?)))
            .collect()
    };
    for (i, one) in all.iter().enumerate() {
        for other in &all[i + 1..] {
            let (a, b) = (of(one), of(other));
            let ratios: Vec<f64> = a
                .iter()
                .filter_map(|(case, um)| {
                    b.iter()
                        .find(|(name, _)| name == case)
                        .map(|(_, other_um)| other_um / um)
                })
                .collect();
            if !ratios.is_empty() {
                let mean = (ratios.iter().map(|r| r.ln()).sum::<f64>() / ratios.len() as f64).exp();
                println!(
                    "recorded: the ends of {} are {mean:.3} times those of {}, over {} sets",
                    other.label,
                    one.label,
                    ratios.len()
                );
            }
        }
    }
}

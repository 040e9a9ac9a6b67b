//! The same recording written otherwise: the same names.

use super::case::{CaseCheck, CaseStart, SetCase};
use super::context::{Context, beside, copy, spread, write};
use super::mark::CaseTruth;
use super::planted::of_folder;
use super::table_of_numbers::NumberTable;
use std::path::{Path, PathBuf};

/// Planted cases that are written otherwise, each in four ways.
const WRITTEN: usize = 10;

/// Ways to write a data set.
#[derive(Clone, Copy)]
enum Way {
    /// Volts in millivolts, micrometres in nanometres.
    Units,
    /// Readings off by less than 1e-6 um.
    Rounded,
    /// Records in the other order.
    Records,
    /// Effects in the other order.
    Effects,
}

const WAYS: [(Way, &str); 4] = [
    (Way::Units, "units"),
    (Way::Rounded, "rounded"),
    (Way::Records, "records"),
    (Way::Effects, "effects"),
];

/// Each case as it is and in every way; a sample is so many of the pairs.
pub fn cases(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let folder = context.folder_of("invariance")?;
    let written = most.map_or(WRITTEN, |most| most.div_ceil(WAYS.len()).min(WRITTEN));
    let mut out = Vec::new();
    for reference in spread(of_folder(&beside("planted")?, "")?, Some(written)) {
        let CaseStart::Effects(from) = reference.start.clone() else {
            continue;
        };
        for (way, name) in WAYS {
            let into = folder.join(format!(
                "{}_{name}",
                reference
                    .data
                    .file_name()
                    .map_or_else(String::new, |n| n.to_string_lossy().into())
            ));
            let data = otherwise(&reference.data, &into, way)?;
            let mut effects: Vec<&str> = from.split(',').collect();
            if let Way::Effects = way {
                effects.reverse();
            }
            out.push(SetCase {
                name: format!("{} {name}", reference.name),
                data,
                start: CaseStart::Effects(effects.join(",")),
                check: CaseCheck::SameAs(reference.name.clone()),
                noise_um: None,
            });
        }
        let as_it_is = SetCase {
            check: CaseCheck::Names(CaseTruth::Unknown),
            ..reference
        };
        out.insert(out.len() - WAYS.len(), as_it_is);
    }
    Ok(out)
}

/// A data set written in another way, once.
fn otherwise(from: &Path, into: &Path, way: Way) -> Result<PathBuf, String> {
    let manifest = std::fs::read_to_string(from.join("dataset.toml"))
        .map_err(|e| format!("{}: {e}", from.display()))?;
    let (head, records) = manifest
        .split_once("[[record]]")
        .ok_or("a manifest without records")?;
    let mut records: Vec<&str> = records.split("[[record]]").map(str::trim).collect();
    for record in &records {
        let file = record
            .lines()
            .find_map(|l| l.strip_prefix("file = \"")?.strip_suffix('"'))
            .ok_or("a record without file")?;
        let (source, target) = (from.join(file), into.join(file));
        match way {
            Way::Records | Way::Effects => copy(&source, &target)?,
            Way::Units | Way::Rounded if target.exists() => {}
            Way::Units => {
                let mut table = NumberTable::read(&source)?;
                table.header = table
                    .header
                    .replacen("u_v", "u_mv", 1)
                    .replacen("y_um", "y_nm", 1);
                table
                    .rows
                    .iter_mut()
                    .for_each(|row| (row[1], row[2]) = (1e3 * row[1], 1e3 * row[2]));
                table.write(&target)?;
            }
            Way::Rounded => {
                let table = NumberTable::read(&source)?;
                let mut state = 1_u64;
                let off = |y: f64| y + 1e-6 * (uniform(&mut state) - 0.5);
                table
                    .with_readings(&table.readings_um().into_iter().map(off).collect::<Vec<_>>())
                    .write(&target)?;
            }
        }
    }
    if let Way::Records = way {
        records.reverse();
    }
    let records: String = records
        .iter()
        .map(|r| format!("[[record]]\n{r}\n\n"))
        .collect();
    write(&into.join("dataset.toml"), &format!("{head}{records}"))?;
    Ok(into.to_path_buf())
}

/// The next number between 0 and 1 of a generator that repeats itself exactly (Knuth's 64-bit linear
/// congruence).
fn uniform(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 53) as f64
}

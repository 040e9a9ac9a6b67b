//! Measured and modelled signals as text, for programs that draw or judge them themselves.
//!
//! One table a record, with the samples of its window. The first columns follow the timing of recordings (`u`
//! acts from `t` on), so that a table is a recording again. What a record has of its own, such as its
//! constant, is in the modelled displacement: measured less modelled is the residual that every figure is
//! computed from.

use crate::dataset::Record;
use crate::identification::fit::residual;
use hysteron_sim::chain::Model;

/// A model with the name of its columns: `modelled` makes `modelled_um` and `modelled_residual_um`.
pub type Named<'a> = (&'a str, &'a Model);

/// One record as comma-separated values: `t_s,u_v,y_um`, the force and the auxiliary signals that it has, and
/// for each model what it says the sensor reads and what that leaves, um.
#[must_use]
pub fn csv(record: &Record, models: &[Named]) -> String {
    let residuals: Vec<Vec<f64>> = models
        .iter()
        .map(|(_, model)| residual(model, record))
        .collect();
    let beside: Vec<(&str, &[f64])> =
        (record.force_n.iter().map(|values| ("force_n", &values[..])))
            .chain(
                record
                    .auxiliary
                    .iter()
                    .map(|signal| (signal.name.as_str(), &signal.values[..])),
            )
            .collect();
    let names = beside.iter().map(|(name, _)| format!(",{name}"));
    let names = names.chain(
        models
            .iter()
            .map(|(name, _)| format!(",{name}_um,{name}_residual_um")),
    );
    let mut text = format!("t_s,u_v,y_um{}\n", names.collect::<String>());
    for (row, k) in record.window.clone().enumerate() {
        let measured_um = record.displacement_um[k];
        text.push_str(&format!(
            "{:.9},{:.6},{measured_um:.6}",
            k as f64 * record.dt_s(),
            record.drive_v[k]
        ));
        beside
            .iter()
            .for_each(|(_, values)| text.push_str(&format!(",{}", values[k])));
        residuals.iter().for_each(|left_um| {
            text.push_str(&format!(
                ",{:.6},{:.6}",
                measured_um - left_um[row],
                left_um[row]
            ))
        });
        text.push('\n');
    }
    text
}

/// The name of a record's file: its own, without what a path could not take.
#[must_use]
pub fn file_name(record: &Record) -> String {
    let plain: String = record
        .name
        .chars()
        .map(|c| {
            if c.is_alphanumeric() || "-_.".contains(c) {
                c
            } else {
                '_'
            }
        })
        .collect();
    format!("{}.csv", plain.trim_end_matches(".csv"))
}

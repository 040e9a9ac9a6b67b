//! Numbers inside the page: columns of 16 or 32 bits, equal columns stored once.
//!
//! A column of 16 bits resolves 1/65534 of its own range, finer than a screen; columns that only rise (time,
//! frequency) get 32 bits so that samples stay apart when a reader zooms in. Short columns are written as
//! plain numbers.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::collections::HashMap;

/// Columns longer than this are packed.
const LONGEST_PLAIN: usize = 24;

/// The columns of a page.
#[derive(Debug, Default)]
pub(super) struct Columns {
    columns: Vec<Value>,
    known: HashMap<String, usize>,
}

impl Columns {
    /// Stores a column, or finds the one that is equal to it, and returns its number.
    pub(super) fn intern(&mut self, values: &[f64]) -> usize {
        let column = encode(values);
        *self.known.entry(column.to_string()).or_insert_with(|| {
            self.columns.push(column);
            self.columns.len() - 1
        })
    }

    /// All columns, in the order of their numbers.
    pub(super) fn into_json(self) -> Value {
        Value::Array(self.columns)
    }
}

fn encode(values: &[f64]) -> Value {
    if values.len() <= LONGEST_PLAIN {
        // serde_json writes what is not finite as null, which the script reads as a gap.
        return json!({ "plain": values });
    }
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let low = finite().fold(f64::INFINITY, f64::min);
    let high = finite().fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
    let rising = values.windows(2).all(|w| w[0] <= w[1]);
    let top = if rising { u32::MAX - 1 } else { 65534 };
    let scale = if high > low {
        f64::from(top) / (high - low)
    } else {
        0.0
    };
    let mut bytes = Vec::with_capacity(values.len() * if rising { 4 } else { 2 });
    for &value in values {
        // Casts from float saturate; the code above `top` marks a gap.
        let code = if value.is_finite() {
            ((value - low) * scale).round() as u32
        } else {
            top + 1
        };
        if rising {
            bytes.extend(code.to_le_bytes());
        } else {
            bytes.extend((code as u16).to_le_bytes());
        }
    }
    json!({
        "bits": if rising { 32 } else { 16 },
        "low": low,
        "high": high,
        "rising": rising,
        "packed": STANDARD.encode(bytes),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packing_keeps_values_within_half_a_code() {
        let mut values: Vec<f64> = (0..500).map(|i| f64::from(i).sin() * 3.0).collect();
        values[7] = f64::NAN;
        let packed = encode(&values);
        let bytes = STANDARD.decode(packed["packed"].as_str().unwrap()).unwrap();
        let (low, high) = (
            packed["low"].as_f64().unwrap(),
            packed["high"].as_f64().unwrap(),
        );
        for (i, pair) in bytes.chunks(2).enumerate() {
            let code = u16::from_le_bytes([pair[0], pair[1]]);
            if i == 7 {
                assert_eq!(code, 65535);
            } else {
                let back = low + (high - low) * f64::from(code) / 65534.0;
                assert!((back - values[i]).abs() <= (high - low) / 65534.0 * 0.501);
            }
        }
    }

    #[test]
    fn equal_columns_are_stored_once_and_gaps_are_null() {
        let mut columns = Columns::default();
        let time: Vec<f64> = (0..100).map(f64::from).collect();
        assert_eq!(columns.intern(&time), columns.intern(&time));
        let short = columns.intern(&[1.0, f64::NAN]);
        let json = columns.into_json();
        assert_eq!(json[0]["bits"], 32);
        assert_eq!(json[short]["plain"][1], Value::Null);
        assert_eq!(json.as_array().unwrap().len(), 2);
    }
}

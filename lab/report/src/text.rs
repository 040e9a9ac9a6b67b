//! Words and figures as they read on a page.

use std::fmt;

/// A displacement in the unit that reads best.
pub(super) fn nanometres(um: f64) -> String {
    if um.abs() >= 1.0 {
        format!("{} \u{b5}m", figure(um))
    } else {
        format!("{} nm", figure(1e3 * um))
    }
}

/// A share as percent.
pub(super) fn percent(share: f64) -> String {
    if share.is_finite() {
        format!("{:.0} %", 100.0 * share)
    } else {
        "unknown".to_owned()
    }
}

/// Three significant digits.
pub(super) fn figure(value: f64) -> String {
    format!("{:.3}", Significant(value))
}

/// Writes a number with as many significant digits as its precision says.
pub(super) struct Significant(pub(super) f64);

impl fmt::Display for Significant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, digits) = (self.0, f.precision().unwrap_or(3).max(1) as i32);
        if value == 0.0 {
            return f.write_str("0");
        }
        if !value.is_finite() {
            return f.write_str("unknown");
        }
        let exponent = value.abs().log10().floor() as i32;
        if (-4..7).contains(&exponent) {
            let decimals = (digits - 1 - exponent).max(0) as usize;
            f.write_str(&format!("{value:.decimals$}"))
        } else {
            let decimals = (digits - 1) as usize;
            f.write_str(&format!("{value:.decimals$e}"))
        }
    }
}

/// A record's role in words.
pub(super) fn role_words(role: &str) -> &str {
    match role {
        "identify" => "fitted",
        "validate" => "held out",
        "noise" => "at rest",
        other => other,
    }
}

/// An effect's identifier in words.
pub(super) fn effect_words(effect: &str) -> String {
    effect.replace('_', " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_keep_their_digits() {
        assert_eq!(figure(1234.5), "1234");
        assert_eq!(figure(12.345), "12.3");
        assert_eq!(figure(-0.012345), "-0.0123");
        assert_eq!(figure(3.0e-9), "3.00e-9");
        assert_eq!(figure(f64::NAN), "unknown");
        assert_eq!(format!("{:.6}", Significant(5352.0)), "5352.00");
        assert_eq!(nanometres(0.0045), "4.50 nm");
    }
}

//! Numbers and identifiers as they are read.

/// Nanometres with three figures.
#[must_use]
pub fn nm(um: f64) -> String {
    let value = 1e3 * um;
    if value > 0.0 && value < 0.005 {
        // Readings whose unit is larger than specified.
        format!("{value:.1e}")
    } else if value >= 100.0 {
        format!("{value:.0}")
    } else if value >= 10.0 {
        format!("{value:.1}")
    } else {
        format!("{value:.2}")
    }
}

/// An identifier as it is read.
#[must_use]
pub fn spoken(id: &str) -> String {
    id.replace('_', " ")
}

/// A list of identifiers as it is read.
#[must_use]
pub fn list(ids: &[String], joint: &str) -> String {
    match ids {
        [] => String::new(),
        [one] => spoken(one),
        [head @ .., last] => format!(
            "{} {joint} {}",
            head.iter()
                .map(|i| spoken(i))
                .collect::<Vec<_>>()
                .join(", "),
            spoken(last)
        ),
    }
}

/// A value with four figures.
#[must_use]
pub fn figure(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    if value.abs() >= 1e6 || value.abs() < 1e-4 {
        format!("{value:.3e}")
    } else {
        format!("{value:.digits$}")
    }
}

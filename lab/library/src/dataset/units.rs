//! Units as files write them: in brackets behind a name, as a suffix, as a word; and what a column's name
//! says it is.

use crate::error::{Error, Result};

/// What a signal of a record is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Time, s.
    Time,
    /// Drive, V.
    Drive,
    /// Displacement, um.
    Displacement,
    /// External force, N.
    Force,
}

impl Quantity {
    /// All of them, in the order t, u, y, force.
    pub const ALL: [Self; 4] = [Self::Time, Self::Drive, Self::Displacement, Self::Force];

    /// The key in manifests and on the command line.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Time => "t",
            Self::Drive => "u",
            Self::Displacement => "y",
            Self::Force => "force",
        }
    }

    /// What it is in words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Time => "time",
            Self::Drive => "drive",
            Self::Displacement => "displacement",
            Self::Force => "force",
        }
    }

    /// The unit inside the program.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Time => "s",
            Self::Drive => "V",
            Self::Displacement => "um",
            Self::Force => "N",
        }
    }

    /// The largest magnitude that a signal of an actuator may have, in the program's unit; beyond it columns
    /// or units are mistaken. Time may count from 1970.
    #[must_use]
    pub fn largest(self) -> f64 {
        match self {
            Self::Time => 1e11,
            Self::Drive => 1e6,
            Self::Displacement => 1e7,
            Self::Force => 1e9,
        }
    }

    fn dimension(self) -> Dimension {
        match self {
            Self::Time => Dimension::Time,
            Self::Drive => Dimension::Voltage,
            Self::Displacement => Dimension::Length,
            Self::Force => Dimension::Force,
        }
    }

    /// Words that a column of this quantity is called by; the first are the surest.
    fn names(self) -> &'static [&'static str] {
        match self {
            Self::Time => &[
                "t",
                "time",
                "zeit",
                "timestamp",
                "times",
                "seconds",
                "temps",
                "tiempo",
            ],
            Self::Drive => &[
                "u",
                "v",
                "voltage",
                "drive",
                "input",
                "padrag",
                "command",
                "cmd",
                "spannung",
                "excitation",
                "actuator",
                "piezo",
                "ao",
                "ao0",
                "ao1",
                "dac",
            ],
            Self::Displacement => &[
                "y",
                "x",
                "displacement",
                "position",
                "disp",
                "pos",
                "output",
                "sensor",
                "weg",
                "deflection",
                "measured",
                "stage",
                "ai",
                "ai0",
                "ai1",
                "adc",
            ],
            Self::Force => &["force", "f", "load", "kraft"],
        }
    }

    /// How well a column's name and unit fit, 0 not at all; a unit of another dimension speaks against it (a
    /// sensor may be read in volts).
    #[must_use]
    pub fn likeness(self, bare_name: &str, unit: Option<&str>) -> u32 {
        let lower = bare_name.to_lowercase();
        let mut tokens = lower
            .split(|c: char| !c.is_alphanumeric())
            .filter(|t| !t.is_empty());
        let head = tokens.next().unwrap_or_default();
        let known = |token: &str| self.names().contains(&token);
        let by_name = if known(head) {
            3
        } else {
            u32::from(tokens.any(known)) * 2
        };
        match unit.and_then(dimension_of) {
            Some(dimension) if dimension == self.dimension() => by_name + 2,
            Some(Dimension::Voltage) if self == Self::Displacement => by_name,
            // Stages are driven by forces too, and read in angles and accelerations.
            Some(Dimension::Force | Dimension::Current) if self == Self::Drive => by_name,
            Some(Dimension::Force | Dimension::Angle | Dimension::Acceleration)
                if self == Self::Displacement =>
            {
                by_name
            }
            Some(_) => 0,
            None => by_name,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Dimension {
    Time,
    Voltage,
    Length,
    Force,
    Angle,
    Acceleration,
    Current,
    Other,
}

impl Dimension {
    /// The unit of the factors of [`UNITS`].
    fn unit(self) -> &'static str {
        match self {
            Self::Time => "s",
            Self::Voltage => "V",
            Self::Length => "um",
            Self::Force => "N",
            Self::Angle => "rad",
            Self::Acceleration => "m/s2",
            Self::Current => "A",
            Self::Other => "",
        }
    }
}

/// The unit of a drive or a reading, in which the program keeps and prints it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct SignalUnits {
    /// Of the drive: V of a piezo.
    pub drive: String,
    /// Of the reading: um of a displacement.
    pub reading: String,
}

impl Default for SignalUnits {
    fn default() -> Self {
        Self {
            drive: "V".into(),
            reading: "um".into(),
        }
    }
}

/// Prefixes a thousand apart.
const PREFIXES: [&str; 7] = ["p", "n", "u", "m", "", "k", "M"];

/// A unit with the prefix that is so many steps of a thousand away from its own; the unit itself with a power
/// of ten where there is no such prefix.
fn prefixed(unit: &str, steps: i32) -> String {
    let own = PREFIXES.iter().position(|p| {
        !p.is_empty()
            && unit
                .strip_prefix(p)
                .is_some_and(|base| is_unit(base) && is_unit(unit) && base != "in")
    });
    let at = own.unwrap_or(4) as i32 + steps;
    let base = own.map_or(unit, |own| &unit[PREFIXES[own].len()..]);
    match usize::try_from(at).ok().and_then(|at| PREFIXES.get(at)) {
        Some(prefix) if entry(base).is_some() => format!("{prefix}{base}"),
        _ if steps == 0 => unit.to_owned(),
        _ => format!("1e{} {unit}", 3 * steps),
    }
}

impl SignalUnits {
    /// Whether these signals are of no ceramic: a structure that is pushed by a force, or one that is moved and
    /// whose force is read, has nothing of its loops and creep. A stage that follows a commanded position may.
    /// On a friction damper whose force is read, the held-out error goes from 16.7 to 10.6 kN, with 19 values
    /// in place of 49, and creep is not named.
    #[must_use]
    pub fn exclude_a_ceramic(&self) -> bool {
        match dimension_of(&self.drive) {
            Some(Dimension::Force) => true,
            Some(Dimension::Length | Dimension::Angle | Dimension::Acceleration) => {
                dimension_of(&self.reading) == Some(Dimension::Force)
            }
            _ => false,
        }
    }

    /// The same text in these units: sentences of the library are about a drive in V and a reading in um and
    /// nm.
    #[must_use]
    pub fn in_words(&self, text: &str) -> String {
        if *self == Self::default() {
            return text.to_owned();
        }
        let thousandth = prefixed(&self.reading, -1);
        let mut out = String::with_capacity(text.len());
        let mut word = String::new();
        let flush = |word: &mut String, out: &mut String| {
            out.push_str(match word.as_str() {
                "um" | "\u{b5}m" => &self.reading,
                "nm" => &thousandth,
                "V" => &self.drive,
                other => other,
            });
            word.clear();
        };
        for c in text.chars() {
            if c.is_alphanumeric() || c == '_' {
                word.push(c);
            } else {
                flush(&mut word, &mut out);
                out.push(c);
            }
        }
        flush(&mut word, &mut out);
        out
    }
}

/// A signal in a unit of its own, with the factor that brings it there from its column: a metric prefix in
/// which its span is between one and a thousand.
#[must_use]
pub fn own_unit(unit: &str, span: f64) -> (String, f64) {
    let Some((_, dimension, factor)) = entry(unit) else {
        return (unit.trim().to_owned(), 1.0);
    };
    let base = if *dimension == Dimension::Other {
        unit.trim()
    } else {
        dimension.unit()
    };
    let factor = if *dimension == Dimension::Other {
        1.0
    } else {
        *factor
    };
    let span = span * factor;
    // Compound units take no prefix, and lengths have theirs.
    let takes_prefix = matches!(
        dimension,
        Dimension::Voltage | Dimension::Force | Dimension::Angle | Dimension::Current
    );
    let steps = if takes_prefix && span > 0.0 {
        ((span.log10() / 3.0).floor() as i32).clamp(-4, 2)
    } else {
        0
    };
    (prefixed(base, steps), factor * 1000.0_f64.powi(-steps))
}

/// Whether a unit is one of voltage.
#[must_use]
pub fn is_voltage(unit: &str) -> bool {
    dimension_of(unit) == Some(Dimension::Voltage)
}

/// Whether a signal has a unit of its own: a drive that is no voltage, a reading that is no length.
#[must_use]
pub fn has_own_unit(quantity: Quantity, unit: &str) -> bool {
    let plain = !is_of_counts(unit) && !unit.contains("/V") && !unit.contains("/count");
    let other = dimension_of(unit)
        .is_some_and(|dimension| dimension != quantity.dimension() && dimension != Dimension::Time);
    matches!(quantity, Quantity::Drive | Quantity::Displacement) && plain && other
}

/// Units in lower case with `u` for micro, their dimension, and the factor to the program's unit.
const UNITS: &[(&str, Dimension, f64)] = &[
    ("s", Dimension::Time, 1.0),
    ("sec", Dimension::Time, 1.0),
    ("second", Dimension::Time, 1.0),
    ("seconds", Dimension::Time, 1.0),
    ("ms", Dimension::Time, 1e-3),
    ("msec", Dimension::Time, 1e-3),
    ("us", Dimension::Time, 1e-6),
    ("ns", Dimension::Time, 1e-9),
    ("min", Dimension::Time, 60.0),
    ("v", Dimension::Voltage, 1.0),
    ("volt", Dimension::Voltage, 1.0),
    ("volts", Dimension::Voltage, 1.0),
    ("mv", Dimension::Voltage, 1e-3),
    ("uv", Dimension::Voltage, 1e-6),
    ("kv", Dimension::Voltage, 1e3),
    ("um", Dimension::Length, 1.0),
    ("micron", Dimension::Length, 1.0),
    ("microns", Dimension::Length, 1.0),
    ("nm", Dimension::Length, 1e-3),
    ("pm", Dimension::Length, 1e-6),
    ("mm", Dimension::Length, 1e3),
    ("m", Dimension::Length, 1e6),
    ("in", Dimension::Length, 25_400.0),
    ("inch", Dimension::Length, 25_400.0),
    ("n", Dimension::Force, 1.0),
    ("mn", Dimension::Force, 1e-3),
    ("un", Dimension::Force, 1e-6),
    ("kn", Dimension::Force, 1e3),
    ("lbf", Dimension::Force, 4.448_221_615_260_5),
    ("kip", Dimension::Force, 4_448.221_615_260_5),
    ("rad", Dimension::Angle, 1.0),
    ("mrad", Dimension::Angle, 1e-3),
    ("urad", Dimension::Angle, 1e-6),
    ("nrad", Dimension::Angle, 1e-9),
    ("deg", Dimension::Angle, std::f64::consts::PI / 180.0),
    ("m/s2", Dimension::Acceleration, 1.0),
    ("m/s^2", Dimension::Acceleration, 1.0),
    ("a", Dimension::Current, 1.0),
    ("ma", Dimension::Current, 1e-3),
    ("c", Dimension::Other, 1.0),
    ("°c", Dimension::Other, 1.0),
    ("degc", Dimension::Other, 1.0),
    ("k", Dimension::Other, 1.0),
    ("hz", Dimension::Other, 1.0),
    ("%", Dimension::Other, 1.0),
    ("w", Dimension::Other, 1.0),
    ("bar", Dimension::Other, 1.0),
    ("sequence", Dimension::Other, 1.0),
];

/// What a column without a unit counts.
const COUNTS: [&str; 6] = ["count", "counts", "digit", "lsb", "bit", "1"];

fn normal(unit: &str) -> String {
    let inner = unit
        .trim()
        .trim_start_matches(['[', '(', '{'])
        .trim_end_matches([']', ')', '}'])
        .trim();
    inner.to_lowercase().replace(['µ', 'μ'], "u")
}

fn entry(unit: &str) -> Option<&'static (&'static str, Dimension, f64)> {
    let unit = normal(unit);
    UNITS.iter().find(|(name, ..)| *name == unit)
}

fn dimension_of(unit: &str) -> Option<Dimension> {
    entry(unit).map(|(_, dimension, _)| *dimension)
}

/// Whether a text is a unit, with or without brackets.
#[must_use]
pub fn is_unit(text: &str) -> bool {
    entry(text).is_some()
}

/// Whether a unit shows that a column is no signal of a record: a temperature, a current.
#[must_use]
pub fn is_of_something_else(unit: Option<&str>) -> bool {
    matches!(
        unit.and_then(dimension_of),
        Some(Dimension::Other | Dimension::Current)
    )
}

/// A column's name without its unit, and the unit: `t (ms)`, `u [mV]`, `pos_nm`, `y/um`, `C1 in V`,
/// `Drive V`.
#[must_use]
pub fn split_name(name: &str) -> (String, Option<String>) {
    let name = name.trim();
    let parts = |bare: &str, unit: &str| (bare.trim().to_owned(), Some(unit.trim().to_owned()));
    if let Some(rest) = name.strip_suffix([']', ')'])
        && let Some((bare, unit)) = rest.rsplit_once(['[', '('])
        // `data(2)` is the second column of an array.
        && !unit.trim().bytes().all(|b| b.is_ascii_digit())
    {
        return parts(bare, unit);
    }
    if let Some((bare, unit)) = name
        .rsplit_once(" in ")
        .or_else(|| name.strip_prefix("in ").map(|unit| ("", unit)))
        && is_unit(unit)
    {
        return parts(bare, unit);
    }
    for separator in ['/', '_', ' ', ','] {
        if let Some((bare, unit)) = name.rsplit_once(separator)
            && is_unit(unit)
            // `Channel A` is an input of an oscilloscope.
            && (separator != ' ' || dimension_of(unit) != Some(Dimension::Other) && normal(unit) != "a")
            && !bare.trim().is_empty()
        {
            return parts(bare, unit);
        }
    }
    (name.to_owned(), None)
}

/// Whether a text says what one count of a column without a unit means (`50V` of a full scale), which
/// contradicts a column that has one.
#[must_use]
pub fn is_of_counts(unit: &str) -> bool {
    unit.trim()
        .starts_with(|c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+'))
        && !unit.contains('/')
}

/// The factor that brings a column into the program's unit: of a unit (`mV`), or of a sensitivity (`5 um/V`:
/// one unit of the column is 5 um).
///
/// # Errors
/// Units that are not known, and units of something else.
pub fn factor(quantity: Quantity, unit: &str, place: &str, column: &str) -> Result<f64> {
    let text = unit.trim();
    let digits = text
        .find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '-' | '+')))
        .unwrap_or(text.len());
    let (number, rest) = text.split_at(digits);
    let (number, rest) = match rest.strip_prefix(['e', 'E']).map(|rest| {
        rest.split_at(
            rest.find(|c: char| !(c.is_ascii_digit() || c == '-' || c == '+'))
                .unwrap_or(rest.len()),
        )
    }) {
        Some((exponent, rest)) if !number.is_empty() && !exponent.is_empty() => {
            (format!("{number}e{exponent}"), rest)
        }
        _ => (number.to_owned(), rest),
    };
    let scale = match number.as_str() {
        "" | "+" => Some(1.0),
        "-" => Some(-1.0),
        number => number
            .parse::<f64>()
            .ok()
            .filter(|v| v.is_finite() && *v != 0.0),
    };
    let (numerator, denominator) = rest
        .split_once('/')
        .map_or((rest, None), |(above, below)| (above, Some(below.trim())));
    if let Some(below) = denominator.filter(|below| {
        dimension_of(below) != Some(Dimension::Voltage) && !COUNTS.contains(&normal(below).as_str())
    }) {
        return Err(Error::new(
            place,
            format!(
                "{column}: \"{text}\" is a sensitivity per \"{below}\"; expected one of the column's own unit, such as 5 um/V or 0.3 nm/count"
            ),
        ));
    }
    match (scale, entry(numerator)) {
        (Some(scale), Some((_, dimension, factor))) if *dimension == quantity.dimension() => {
            Ok(scale * factor)
        }
        _ => {
            let known: Vec<&str> = UNITS
                .iter()
                .filter(|(_, d, _)| *d == quantity.dimension())
                .map(|(name, ..)| *name)
                .collect();
            Err(Error::new(
                place,
                format!(
                    "{column}: unit \"{text}\" is not one of {} for {} ({})",
                    known.join(", "),
                    quantity.key(),
                    quantity.words()
                ),
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_found_however_they_are_written() {
        for (name, bare, unit) in [
            ("t (ms)", "t", Some("ms")),
            ("u [mV]", "u", Some("mV")),
            ("pos_nm", "pos", Some("nm")),
            ("y/um", "y", Some("um")),
            ("C1 in V", "C1", Some("V")),
            ("in s", "", Some("s")),
            ("Drive V", "Drive", Some("V")),
            ("Channel A", "Channel A", None),
            ("Coil mA", "Coil", Some("mA")),
            ("x_value", "x_value", None),
            ("data(2)", "data(2)", None),
        ] {
            assert_eq!(
                split_name(name),
                (bare.to_owned(), unit.map(str::to_owned)),
                "{name}"
            );
        }
    }

    #[test]
    fn factors_lead_to_volts_and_micrometres() {
        let of = |quantity, unit| factor(quantity, unit, "a.csv", "column 1");
        for (quantity, unit, expected) in [
            (Quantity::Time, "ms", 1e-3),
            (Quantity::Drive, "mV", 1e-3),
            (Quantity::Displacement, "µm", 1.0),
            (Quantity::Displacement, "m", 1e6),
            (Quantity::Displacement, "5 um/V", 5.0),
            (Quantity::Displacement, "-2.5e2nm/V", -0.25),
            (Quantity::Displacement, "-um/V", -1.0),
            (Quantity::Displacement, "-nm", -1e-3),
            (Quantity::Drive, "15V/V", 15.0),
        ] {
            assert!(
                (of(quantity, unit).unwrap() / expected - 1.0).abs() < 1e-12,
                "{unit}"
            );
        }
        assert!(
            has_own_unit(Quantity::Displacement, "V")
                && !has_own_unit(Quantity::Displacement, "5 um/V")
        );
        assert!(
            of(Quantity::Drive, "nm")
                .unwrap_err()
                .to_string()
                .contains("mv")
        );
        assert!(of(Quantity::Time, "0ms").is_err());
        assert!(of(Quantity::Displacement, "0.3 nm/count").is_ok());
        assert!(
            of(Quantity::Displacement, "5um/parsec")
                .unwrap_err()
                .to_string()
                .contains("per \"parsec\"")
        );
    }

    #[test]
    fn a_signal_keeps_its_own_unit_with_a_prefix_for_its_span() {
        for (unit, span, expected, factor) in [
            ("V", 0.43, "mV", 1e3),
            ("N", 380.0, "N", 1.0),
            ("kip", 0.1, "N", 4448.22),
            ("rad", 2e-5, "urad", 1e6),
            ("m/s2", 3.0, "m/s2", 1.0),
        ] {
            let (found, of) = own_unit(unit, span);
            assert_eq!(found, expected, "{unit}");
            assert!((of / factor - 1.0).abs() < 1e-5, "{unit}: {of}");
        }
        let units = SignalUnits {
            drive: "N".into(),
            reading: "mV".into(),
        };
        assert_eq!(
            units.in_words("13.2 nm of 430 um at 3 V (um/V), Vibration"),
            "13.2 uV of 430 mV at 3 N (mV/N), Vibration"
        );
        assert_eq!(SignalUnits::default().in_words("13.2 nm"), "13.2 nm");
    }

    #[test]
    fn a_structure_that_is_pushed_or_whose_force_is_read_is_no_ceramic() {
        let of = |drive: &str, reading: &str| {
            SignalUnits {
                drive: drive.into(),
                reading: reading.into(),
            }
            .exclude_a_ceramic()
        };
        assert!(of("N", "um") && of("um", "N") && of("in", "kip"));
        // A force that a clamped ceramic gives, and a stage with a servo of its own.
        assert!(!SignalUnits::default().exclude_a_ceramic() && !of("V", "N") && !of("um", "um"));
    }

    #[test]
    fn a_unit_speaks_louder_than_a_word() {
        assert!(Quantity::Drive.likeness("output", Some("V")) > 0);
        assert!(
            Quantity::Displacement.likeness("sensor", Some("um"))
                > Quantity::Displacement.likeness("output", Some("V"))
        );
        assert_eq!(Quantity::Displacement.likeness("x", Some("s")), 0);
        assert_eq!(Quantity::Drive.likeness("voltage", Some("°C")), 0);
    }
}

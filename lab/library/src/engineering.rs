//! The values of a model as an engineer reads them: hertz, damping, micrometres per volt, the width of loops,
//! creep by the decade.

use crate::identification::identifiability::CannotIdentify;
use crate::loop_figures::loop_figures;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{Place, creep, gain, sensor_filter};
use serde::Serialize;
use std::f64::consts::TAU;

/// One figure with its name.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// The effect.
    pub effect: String,
    /// What it is.
    pub name: String,
    /// Its value in the unit; none where the data do not determine it.
    pub value: Option<f64>,
    /// Its standard deviation, where it is known.
    pub std: Option<f64>,
    /// The unit.
    pub unit: String,
}

impl Figure {
    /// As it is printed: `620.0 +- 0.2 Hz`.
    #[must_use]
    pub fn text(&self) -> String {
        let unit = if self.unit == "1" {
            String::new()
        } else {
            format!(" {}", self.unit)
        };
        match (self.value, self.std.filter(|std| *std > 0.0)) {
            (None, _) => "not determined by this data".into(),
            (Some(value), None) => format!("{}{unit}", four(value)),
            (Some(value), Some(std)) => format!("{}{unit}", with_deviation(value, std)),
        }
    }
}

/// A value and its deviation as they are printed: two figures of the deviation, the value to the same place.
#[must_use]
pub fn rounded(value: f64, std: f64) -> [String; 2] {
    let place = std.abs().log10().floor() as i32 - 1;
    if (-9..0).contains(&place) {
        let decimals = place.unsigned_abs() as usize;
        [value, std].map(|number| format!("{number:.decimals$}"))
    } else {
        [value, std].map(four)
    }
}

/// The same with the sign between them.
pub(crate) fn with_deviation(value: f64, std: f64) -> String {
    rounded(value, std).join(" +- ")
}

/// A value with four figures.
pub(crate) fn four(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let before = value.abs().log10().floor() as i32;
    match before {
        -4..=5 => format!("{value:.*}", (3 - before).max(0) as usize),
        _ => format!("{value:.3e}"),
    }
}

/// The figures of a model, effect by effect in the order of the chain. `undetermined` are the values that the
/// data leave open.
#[must_use]
pub fn figures(model: &Model, undetermined: &[CannotIdentify]) -> Vec<Figure> {
    let open = |effect: &str, parameter: Option<&str>| {
        undetermined.iter().any(|one| match one {
            CannotIdentify::AnyOf { effect: other } => other == effect,
            CannotIdentify::SomeOf {
                effect: other,
                parameters,
            } => {
                other == effect
                    && parameter.is_some_and(|parameter| parameters.iter().any(|p| p == parameter))
            }
            CannotIdentify::MinorLoops | CannotIdentify::RateDependence { .. } => false,
        })
    };
    let mut out = Vec::new();
    for instance in &model.effects {
        let declaration = instance.effect.declaration();
        let id = instance.id.as_str();
        if declaration.place == Place::Hysteresis && id != gain::ID {
            if declaration.is_main()
                && let Some(loops) = loop_figures(model)
            {
                let figure = |name: &str, value: f64, unit: &str| Figure {
                    effect: id.into(),
                    name: name.into(),
                    value: (!open(id, None)).then_some(value),
                    std: None,
                    unit: unit.into(),
                };
                out.push(figure("gain over the range", loops.gain_um_v, "um/V"));
                out.push(figure("loop width", loops.width_pct, "%"));
            }
            continue;
        }
        if id == creep::ID {
            out.extend(creep_figures(instance, open(id, None)));
            continue;
        }
        for p in instance.parameters.iter().filter(|p| !p.parameter.fixed) {
            let name = p.parameter.name.as_str();
            let (name, unit, factor) = readable(id, name, &p.parameter.unit);
            out.push(Figure {
                effect: id.into(),
                name,
                value: (!open(id, Some(&p.parameter.name))).then_some(factor * p.value),
                std: p.std.map(|std| factor * std),
                unit,
            });
        }
    }
    out
}

/// A parameter's name without its unit, the unit that an engineer expects, and the factor to it.
fn readable(effect: &str, name: &str, unit: &str) -> (String, String, f64) {
    let suffixes = [
        "_rad_s", "_um_v", "_um_s", "_um_n", "_per_s", "_per_um2", "_per_um", "_v_s", "_hz", "_um",
        "_s", "_v",
    ];
    let plain = suffixes
        .iter()
        .find_map(|suffix| name.strip_suffix(suffix))
        .unwrap_or(name)
        .replace('_', " ");
    let cut_off = effect != sensor_filter::ID && plain == "bandwidth";
    let plain = if cut_off {
        "cut-off (-3 dB)".to_owned()
    } else {
        plain
    };
    match unit {
        "rad/s" => (plain, "Hz".into(), 1.0 / TAU),
        "s" if name == "delay_s" => (plain, "ms".into(), 1e3),
        _ => (plain, unit.into(), 1.0),
    }
}

/// The same for a parameter that is known by its name alone.
pub(crate) fn read_by_name(effect: &str, name: &str) -> (String, String, f64) {
    let units = [
        ("_rad_s", "rad/s"),
        ("_um_v", "um/V"),
        ("_um_s", "um/s"),
        ("_um_n", "um/N"),
        ("_per_s", "1/s"),
        ("_per_um2", "1/um2"),
        ("_per_um", "1/um"),
        ("_v_s", "V/s"),
        ("_hz", "Hz"),
        ("_um", "um"),
        ("_s", "s"),
        ("_v", "V"),
    ];
    let unit = units
        .iter()
        .find(|(suffix, _)| name.ends_with(suffix))
        .map_or("", |(_, unit)| unit);
    readable(effect, name, unit)
}

/// Creep by the decade of time, from the shortest to the longest of its time constants.
fn creep_figures(instance: &EffectInstance, open: bool) -> Vec<Figure> {
    let terms: Vec<(f64, f64, Option<f64>)> = instance
        .parameters
        .chunks_exact(2)
        .filter(|pair| pair[0].value != 0.0)
        .map(|pair| (pair[0].value, pair[1].value, pair[0].std))
        .collect();
    let (shortest, longest) = terms
        .iter()
        .fold((f64::INFINITY, 0.0_f64), |(a, b), (_, tau, _)| {
            (a.min(*tau), b.max(*tau))
        });
    if terms.is_empty() {
        return Vec::new();
    }
    let all: f64 = terms.iter().map(|(share, ..)| share).sum();
    let decades = (longest / shortest).log10() + 1.0;
    // A term that is known worse than its own size says nothing of the time from there on.
    let unknown =
        |(share, _, std): &&(f64, f64, Option<f64>)| std.is_some_and(|std| std > share.abs());
    let until = terms.iter().find(unknown).map(|(_, tau, _)| *tau);
    let std = terms
        .iter()
        .map(|(.., std)| std.map(|std| std * std))
        .sum::<Option<f64>>()
        .map(|sum: f64| 100.0 * sum.sqrt() / decades);
    let figure = |name: String, value: f64, std: Option<f64>, unit: &str, known: bool| Figure {
        effect: instance.id.clone(),
        name,
        value: (known && !open).then_some(value),
        std,
        unit: unit.into(),
    };
    let mut out = vec![figure(
        format!("creep from {} to {} s", four(shortest), four(longest)),
        100.0 * all / decades,
        std,
        "%/decade",
        until.is_none_or(|tau| tau > shortest),
    )];
    if let Some(tau) = until {
        out.push(figure(
            format!("creep from {} s on", four(tau)),
            0.0,
            None,
            "%/decade",
            false,
        ));
    }
    out
}

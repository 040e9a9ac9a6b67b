//! The values of a model as an engineer reads them: hertz, damping, micrometres per volt, the width of loops,
//! creep by its terms or, of many, by the decade, hum by its amplitudes.

use crate::identification::identifiability::CannotIdentify;
use crate::loop_figures::loop_figures;
use hysteron_sim::chain::{EffectInstance, Model, ParameterValue};
use hysteron_sim::effect::{Place, creep, gain, quantisation, sensor_filter};
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
            let is_open = |parameter: &str| open(id, Some(parameter));
            out.extend(creep_figures(instance, open(id, None), is_open));
            continue;
        }
        // The step of a converter is counted in the readings, not fitted.
        let is_printed = |p: &&ParameterValue| !p.parameter.fixed || id == quantisation::ID;
        for p in instance.parameters.iter().filter(is_printed) {
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
        if declaration.place == Place::Hum {
            out.extend(amplitudes(instance));
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
    let plain = match (effect, plain.as_str()) {
        _ if cut_off => "cut-off (-3 dB)".to_owned(),
        (quantisation::ID, "lsb") => "step".to_owned(),
        _ => plain,
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

/// The amplitudes of lines, of each pair of sine and cosine.
fn amplitudes(instance: &EffectInstance) -> impl Iterator<Item = Figure> {
    let value = |name: &str| {
        instance
            .parameters
            .iter()
            .find(|p| p.parameter.name == name)
    };
    instance.parameters.iter().filter_map(move |sine| {
        let of = sine.parameter.name.strip_prefix("sine_")?;
        let cosine = value(&format!("cosine_{of}"))?;
        let times = of
            .strip_suffix("_um")
            .map(|k| format!(" at {k} times the mains"));
        Some(Figure {
            effect: instance.id.clone(),
            name: format!("amplitude{}", times.unwrap_or_default()),
            value: Some(sine.value.hypot(cosine.value)),
            std: None,
            unit: sine.parameter.unit.clone(),
        })
    })
}

/// Terms of creep of which each is printed, where they are most of all; more approximate creep by the decade.
const TERMS_PRINTED: [&str; 3] = ["first", "second", "third"];

/// Creep by its terms or, of many, by the decade of time from the shortest to the longest of its time constants.
fn creep_figures(
    instance: &EffectInstance,
    open: bool,
    is_open: impl Fn(&str) -> bool,
) -> Vec<Figure> {
    let terms: Vec<&[ParameterValue]> = instance
        .parameters
        .chunks_exact(2)
        .filter(|pair| pair[0].value != 0.0)
        .collect();
    if terms.is_empty() {
        return Vec::new();
    }
    let figure = |name: String, value: Option<f64>, std: Option<f64>, unit: &str| Figure {
        effect: instance.id.clone(),
        name,
        value,
        std,
        unit: unit.into(),
    };
    // A term that is known worse than its own size says nothing of the time from there on.
    let is_unknown =
        |pair: &&&[ParameterValue]| pair[0].std.is_some_and(|std| std > pair[0].value.abs());
    let until = terms.iter().find(is_unknown).map(|pair| pair[1].value);
    let from_there_on = |tau_s: f64| {
        let name = format!("creep from {} s on", four(tau_s));
        figure(name, None, None, "%/decade")
    };
    let mut known = terms.clone();
    known.retain(|pair| !is_unknown(&pair));
    let few = TERMS_PRINTED.len();
    let each = if terms.len() <= few { &terms } else { &known };
    if each.len() <= few && 2 * each.len() > terms.len() {
        let of_term = |(ordinal, pair): (&&str, &&[ParameterValue])| {
            let of = |p: &ParameterValue, name: &str, factor: f64, unit: &str| {
                let name = match each.len() {
                    1 => name.to_owned(),
                    _ => format!("{ordinal} {name}"),
                };
                let value = (!open && !is_open(&p.parameter.name)).then_some(factor * p.value);
                figure(name, value, p.std.map(|std| factor * std), unit)
            };
            [
                of(&pair[0], "share", 100.0, "%"),
                of(&pair[1], "time constant", 1.0, "s"),
            ]
        };
        let printed = TERMS_PRINTED.iter().zip(each).flat_map(of_term);
        let more = until.filter(|_| each.len() < terms.len());
        return printed.chain(more.map(from_there_on)).collect();
    }
    let (shortest, longest) = terms.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), pair| {
        (a.min(pair[1].value), b.max(pair[1].value))
    });
    let all: f64 = terms.iter().map(|pair| pair[0].value).sum();
    let decades = (longest / shortest).log10() + 1.0;
    let std = terms
        .iter()
        .map(|pair| pair[0].std.map(|std| std * std))
        .sum::<Option<f64>>()
        .map(|sum: f64| 100.0 * sum.sqrt() / decades);
    let known = !open && until.is_none_or(|tau| tau > shortest);
    let mut out = vec![figure(
        format!("creep from {} to {} s", four(shortest), four(longest)),
        known.then_some(100.0 * all / decades),
        std,
        "%/decade",
    )];
    out.extend(until.map(from_there_on));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::effect::{Overview, by_id};

    /// A model of one effect with some of its values.
    fn one(id: &str, values: &[(&str, f64)]) -> Model {
        let mut model = Model::new(0.0, 100.0);
        let overview = Overview::without_data(0.0, 100.0);
        model.add(EffectInstance::new(by_id(id).unwrap(), &overview, &[]));
        for p in &mut model.effects[0].parameters {
            let known = values.iter().find(|(name, _)| *name == p.parameter.name);
            p.value = known.map_or(0.0, |(_, value)| *value);
            p.std = (known.is_some() && !p.parameter.fixed).then_some(0.001 * p.value);
        }
        model
    }

    fn text(model: &Model) -> String {
        let one = |figure: &Figure| format!("{} {}", figure.name, figure.text());
        let all: Vec<String> = figures(model, &[]).iter().map(one).collect();
        all.join(", ")
    }

    fn printed(id: &str, values: &[(&str, f64)]) -> String {
        text(&one(id, values))
    }

    fn terms_of_creep(fourth: f64, fourth_s: f64) -> [(&'static str, f64); 8] {
        [
            ("share_1", 0.02),
            ("time_constant_1_s", 0.05),
            ("share_2", 0.01),
            ("time_constant_2_s", 0.5),
            ("share_3", 0.02),
            ("time_constant_3_s", 5.0),
            ("share_4", fourth),
            ("time_constant_4_s", fourth_s),
        ]
    }

    #[test]
    fn few_terms_of_creep_are_printed_each_and_many_by_the_decade() {
        let terms = terms_of_creep(0.03, 50.0);
        for (count, expected) in [
            (2, "share 2.0000 +- 0.0020 %, time constant 0.05000 s"),
            (
                4,
                "second share 1.0000 +- 0.0010 %, second time constant 0.5000 s",
            ),
            (8, "creep from 0.05000 to 50.00 s 2.0000 +- 0.0011 %/decade"),
        ] {
            let text = printed("creep", &terms[..count]);
            assert!(text.contains(expected), "{text}");
        }
    }

    #[test]
    fn a_term_of_creep_that_is_not_known_hides_no_other() {
        let terms = terms_of_creep(0.0002, 60.0);
        let mut model = one("creep", &terms);
        model.effects[0].parameters[6].std = Some(0.01);
        let text = text(&model);
        assert!(text.starts_with("first share 2.0000 +- 0.0020 %"), "{text}");
        let expected =
            "third time constant 5.000 s, creep from 60.00 s on not determined by this data";
        assert!(text.ends_with(expected), "{text}");
    }

    #[test]
    fn hum_and_the_step_of_a_converter_are_printed() {
        let hum = [
            ("frequency_hz", 50.0),
            ("sine_um", 0.003),
            ("cosine_um", 0.004),
        ];
        let text = printed("mains_hum", &hum);
        assert!(text.contains("amplitude 0.005000 um"), "{text}");
        let text = printed(
            "hum_harmonics",
            &[("sine_3_um", 0.003), ("cosine_3_um", 0.004)],
        );
        assert!(
            text.contains("amplitude at 3 times the mains 0.005000 um"),
            "{text}"
        );
        assert_eq!(
            printed("quantisation", &[("lsb_um", 0.016)]),
            "step 0.01600 um"
        );
    }
}

//! Schemes by name: what `check --scheme` and `track --scheme` put in the place of a design's own.

use super::design::{SCHEMA, Scheme, ServoDesign};
use super::disturbance_observer;
use super::gain_adaptation::AdaptationDesign;
use super::order;
use super::regulator_loop;
use super::scheme_choice::SchemeChoice;
use super::thesis_schemes::PidGains;
use super::tuning::{Demands, PredictorTuning};

/// The schemes that `check --scheme` and `track --scheme` take besides the one of the design, by name, with
/// what each is.
pub const SCHEMES: [(&str, &str); 18] = [
    (
        "predictor",
        "Kalman observer one period ahead, hysteresis inverted: the default",
    ),
    (
        "predictor-learning",
        "predictor that learns the correction of a periodic reference",
    ),
    (
        "predictor-adaptive",
        "predictor that corrects the gain of its model slowly, within 20 %",
    ),
    (
        "predictor-learning-adaptive",
        "predictor with both, for a scan on a stage whose gain drifts",
    ),
    (
        "predictor-linear",
        "predictor without the inverse: all hysteresis is an unknown input",
    ),
    (
        "disturbance-observer",
        "nominal second-order model, everything else an observed disturbance",
    ),
    (
        "disturbance-observer-inverse",
        "disturbance observer behind the inverse of the hysteresis",
    ),
    (
        "pidsmoc",
        "the thesis' PID sliding-mode law on its sliding-mode observer (Ch. 7), hysteresis inverted",
    ),
    (
        "pidsmoc-linear",
        "the same without the inverse, as the thesis has it",
    ),
    (
        "pidsmc-alpha-beta",
        "the PID sliding-mode law on an alpha-beta filter (Ch. 6), hysteresis inverted",
    ),
    ("pidsmc-alpha-beta-linear", "the same without the inverse"),
    (
        "smcbl",
        "sliding mode with a boundary layer (Ch. 6, Eq. 45), hysteresis inverted; a steady error stays",
    ),
    ("smcbl-linear", "the same without the inverse"),
    (
        "pid",
        "PID on the error beside a feedforward, hysteresis inverted, as `design --scheme pid` designs it",
    ),
    ("pid-linear", "PID on the error alone, no model"),
    (
        "feedforward",
        "inverse of hysteresis, dynamics and creep, no feedback at all",
    ),
    ("feedforward-without-creep", "the same, creep not undone"),
    (
        "feedforward-pi-notch",
        "feedforward with a PI and a notch on the first mode",
    ),
];

/// Feedforward with the PI that is best on the cases of [`assess`](super::assessment::assess), with or without
/// a notch on the most lightly damped mode.
///
/// # Errors
/// If none keeps the margins.
pub fn plain_pi(design: &ServoDesign, notched: bool) -> Result<Scheme, String> {
    let linear = &design.model.linear;
    let notch = notched.then(|| regulator_loop::notch_for(linear));
    let found = regulator_loop::tune(linear, &Demands::default(), notch.as_ref());
    Ok(Scheme::Feedforward {
        gains: found
            .ok_or("no integral gain keeps the margins with this model")?
            .tuning,
        notch,
        creep_inverse: true,
    })
}

/// The same model under another scheme.
///
/// # Errors
/// If the name is not known.
pub fn with_scheme(design: &ServoDesign, name: &str) -> Result<ServoDesign, String> {
    let own = match &design.scheme {
        Scheme::Predictor { tuning, .. } => Some(*tuning),
        _ => design.beside,
    };
    let predictor = |hysteresis_inverse| Scheme::Predictor {
        tuning: own.unwrap_or(PredictorTuning::START),
        hysteresis_inverse,
    };
    let feedforward = |creep_inverse| Scheme::Feedforward {
        gains: PidGains {
            p: 0.0,
            i: 0.0,
            d: 0.0,
        },
        notch: None,
        creep_inverse,
    };
    let mut out = design.clone();
    out.schema = SCHEMA.into();
    out.beside = None;
    let learning = matches!(name, "predictor-learning" | "predictor-learning-adaptive");
    if !learning {
        out.learning = None;
    }
    out.adaptation = matches!(name, "predictor-adaptive" | "predictor-learning-adaptive")
        .then(|| AdaptationDesign::new(design.model.reach_um()));
    out.delayed = true;
    out.scheme = match name {
        "predictor"
        | "predictor-learning"
        | "predictor-adaptive"
        | "predictor-learning-adaptive" => predictor(true),
        "predictor-linear" => predictor(false),
        "feedforward" => feedforward(true),
        "feedforward-without-creep" => feedforward(false),
        "feedforward-pi-notch" => plain_pi(design, true)?,
        "disturbance-observer" | "disturbance-observer-inverse" => Scheme::DisturbanceObserver {
            gains: disturbance_observer::tune(&design.model.linear, &Demands::default())
                .ok_or("no disturbance observer keeps the margins with this model")?
                .tuning,
            hysteresis_inverse: name == "disturbance-observer-inverse",
        },
        _ => {
            let (family, inverse) = name
                .strip_suffix("-linear")
                .map_or((name, true), |family| (family, false));
            let choice = SchemeChoice::named(family).map_err(|_| {
                format!(
                    "scheme `{name}` is not known: choose from {}",
                    SCHEMES.map(|(name, _)| name).join(", ")
                )
            })?;
            order::scheme_without_recording(design, choice, inverse)?
        }
    };
    if learning && out.learning.is_none() {
        out.learning = Some(order::learning_without_recording(&out)?);
    }
    // What the design is already keeps its gains.
    Ok(if out.scheme_name() == design.scheme_name() {
        design.clone()
    } else {
        out
    })
}

#[cfg(test)]
mod tests {
    use super::super::order::DesignOrder;
    use super::*;
    use hysteron_sim::chain::{EffectInstance, Model};
    use hysteron_sim::effect::{Overview, by_id};

    #[test]
    #[cfg_attr(debug_assertions, ignore = "slow: release mode")]
    fn pid_is_one_scheme_whichever_command_designs_it() {
        let overview = Overview::without_data(0.0, 80.0);
        let mut chain = Model::new(0.0, 80.0);
        let effects: [(&str, &[f64]); 3] = [
            ("delay", &[4e-5]),
            ("hysteresis", &[9.0, 1.0, -2.0]),
            ("vibration", &[5_300.0, 0.6]),
        ];
        for (id, values) in effects {
            let effect = by_id(id).expect("an effect");
            chain.add(EffectInstance::new(effect, &overview, values));
        }
        let order = |scheme| DesignOrder {
            reference_hz: 40.0,
            sensor_noise_um: Some(0.003),
            scheme,
            ..DesignOrder::default()
        };
        let designed = |choice| order::design(&chain, &order(choice)).expect("a servo");
        let (pid, predictor) = (
            designed(SchemeChoice::Pid),
            designed(SchemeChoice::Predictor),
        );
        let named = with_scheme(&predictor, "pid").expect("a servo");
        assert_eq!((pid.scheme_name(), named.scheme_name()), ("pid", "pid"));
        assert_eq!(named.scheme, pid.scheme);
    }
}

//! The known lag of the sensor, by which the reference is made late too (core:
//! [`hysteron_core::sensor_lag`]).
//!
//! # Which lag is undone
//! A lag that is left makes the true position early by all of it, and no reading shows that. So the best value
//! that there is gets undone: the order's, one that the model holds fixed, one that the data distinguish from
//! the amplifier's ([`KNOWN`]), the data sheet's in the data set, and last the model's own. From drive and
//! reading alone a lag of the sensor looks much like one of the amplifier; where the last of these is taken
//! the explanation reports it.

use super::quantise::{QuantisationError, number};
use crate::dataset::Dataset;
use hysteron_core::sensor_lag::{LAG_FRACTION_BITS, SensorLag};
use hysteron_sim::chain::{Model, ParameterValue};
use hysteron_sim::effect::{amplifier_bandwidth, delay, sensor_bandwidth};
use std::f64::consts::TAU;

/// A bandwidth beside that of the amplifier is known where its standard deviation is at most this share of
/// it.
pub const KNOWN: f64 = 0.1;
/// Largest lag that is undone, periods of the loop.
pub const LARGEST_LAG_PERIODS: f64 = 20.0;
/// Of a sensor that is hardly late Tustin's rule would ring near half the sampling rate, and `a` and `b`
/// would not fit: `a` is not below this.
const LEAST_CARRIED: f64 = -0.33;

/// What is known of the sensor's lag.
#[derive(Clone, Debug, PartialEq)]
pub enum Known {
    /// This bandwidth, Hz, by the word or the data that are named.
    Bandwidth(f64, &'static str),
    /// This bandwidth, Hz, is the model's best, and this is why it may be another one.
    Doubtful(f64, String),
    /// The model reads without a lag.
    Ideal,
}

/// What a chain, the data set behind it and the order say of the sensor's bandwidth.
#[must_use]
pub fn known(chain: &Model, dataset: Option<&Dataset>, ordered_hz: Option<f64>) -> Known {
    if let Some(hz) = ordered_hz {
        return Known::Bandwidth(hz, "as ordered");
    }
    let in_chain = chain
        .effect(sensor_bandwidth::ID)
        .and_then(|e| e.parameters.first());
    let beside_amplifier = chain.effect(amplifier_bandwidth::ID).is_some();
    let spread = |p: &ParameterValue| p.std.map_or(f64::INFINITY, |std| std / p.value.abs());
    match in_chain {
        Some(p) if p.parameter.fixed => {
            return Known::Bandwidth(p.value, "as the model holds it");
        }
        Some(p) if beside_amplifier && spread(p) <= KNOWN => {
            return Known::Bandwidth(p.value, "as identified beside the amplifier's");
        }
        _ => {}
    }
    if let Some(hz) = dataset.and_then(|d| d.sensor_bandwidth_hz) {
        return Known::Bandwidth(hz, "from the data set");
    }
    let Some(p) = in_chain else {
        return Known::Ideal;
    };
    let why = match spread(p) {
        _ if !beside_amplifier => {
            "it could be the amplifier's, of which the model has none".to_owned()
        }
        spread if spread.is_finite() => format!("it is known to {:.0} % only", 100.0 * spread),
        _ => "it has no standard deviation".to_owned(),
    };
    Known::Doubtful(p.value, why)
}

/// The lag of a first-order low-pass at rest, s.
#[must_use]
pub fn lag_s(bandwidth_hz: f64) -> f64 {
    1.0 / (TAU * bandwidth_hz)
}

/// How late the lags and delays of a chain are together, s; `None` where it has none.
#[must_use]
pub fn of_chain_s(chain: &Model) -> Option<f64> {
    let first = |id: &str| chain.values(id).and_then(|values| values.first().copied());
    let lags = [amplifier_bandwidth::ID, sensor_bandwidth::ID]
        .into_iter()
        .filter_map(first)
        .map(lag_s);
    lags.chain(first(delay::ID)).reduce(|a, b| a + b)
}

/// The slowest sensor whose lag a loop with this period, s, undoes, Hz.
#[must_use]
pub fn least_bandwidth_hz(period_s: f64) -> f64 {
    1.0 / (TAU * LARGEST_LAG_PERIODS * period_s)
}

/// Coefficients `a` and `b` for a lag, periods.
fn coefficients(ticks: f64) -> (f64, f64) {
    let carried = ((2.0 * ticks - 1.0) / (2.0 * ticks + 1.0)).max(LEAST_CARRIED);
    // As late at rest, whatever `a` is.
    (carried, ticks * (1.0 - carried) - carried)
}

/// The integers of the tick for a lag, s, in a loop with this period, s.
///
/// # Errors
/// A lag beyond [`LARGEST_LAG_PERIODS`], or none.
pub fn quantised(lag_s: f64, period_s: f64) -> Result<SensorLag, QuantisationError> {
    let largest_s = LARGEST_LAG_PERIODS * period_s;
    if !(0.0..=largest_s).contains(&lag_s) {
        return Err(QuantisationError {
            what: "lag of the sensor, s".into(),
            value: lag_s,
            limit: largest_s,
        });
    }
    let (carried, before) = coefficients(lag_s / period_s);
    let bits = LAG_FRACTION_BITS as i32;
    Ok(SensorLag {
        carried: number("lag of the sensor", carried, bits)?,
        before: number("lag of the sensor", before, bits)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};
    use nalgebra::Complex;

    const PERIOD_S: f64 = 5e-5;
    const LARGEST_LAG_S: f64 = LARGEST_LAG_PERIODS * PERIOD_S;

    /// The integers as a filter, against the first-order low-pass that they stand for.
    #[test]
    fn the_reference_is_delayed_as_a_first_order_sensor_reads() {
        for bandwidth_hz in [
            200.0, 1000.0, 3000.0, 10_000.0, 12_640.0, 12_732.4, 15_000.0, 40_000.0, 1e6,
        ] {
            let lag = quantised(lag_s(bandwidth_hz), PERIOD_S).unwrap();
            assert!(lag.accepted(), "{bandwidth_hz}");
            let one = f64::from(1u32 << LAG_FRACTION_BITS);
            let (a, b) = (f64::from(lag.carried) / one, f64::from(lag.before) / one);
            let ticks = lag_s(bandwidth_hz) / PERIOD_S;
            for hz in [1.0, 10.0, 100.0, 500.0, 1000.0] {
                let back = Complex::from_polar(1.0, -TAU * hz * PERIOD_S);
                let filter = (1.0 - a - b + b * back) / (1.0 - a * back);
                let sensor = 1.0 / Complex::new(1.0, hz / bandwidth_hz);
                // Of the third order in the frequency for Tustin's rule, of the second where it would ring.
                let angle = TAU * hz * PERIOD_S;
                let allowed = ticks * angle.powi(3) / 12.0
                    + (0.25 * ticks * (1.02 - 4.0 * ticks)).max(0.0) * angle.powi(2)
                    + 1e-8;
                assert!(
                    (filter - sensor).norm() < 1.05 * allowed,
                    "{bandwidth_hz} {hz}: {} {allowed}",
                    (filter - sensor).norm()
                );
            }
        }
        assert!(
            quantised(1.1 * LARGEST_LAG_S, PERIOD_S).is_err()
                && quantised(f64::NAN, PERIOD_S).is_err()
                && quantised(-1e-6, PERIOD_S).is_err()
        );
        assert!(
            quantised(LARGEST_LAG_S, PERIOD_S).unwrap().accepted()
                && quantised(0.0, PERIOD_S).unwrap().accepted()
        );
    }

    fn chain(lags: &[(&str, f64, Option<f64>)]) -> Model {
        let overview = Overview::without_data(0.0, 80.0);
        let mut chain = Model::new(0.0, 80.0);
        for (id, hz, std) in lags {
            let mut effect = EffectInstance::new(by_id(id).unwrap(), &overview, &[*hz]);
            effect.parameters[0].std = *std;
            chain.effects.push(effect);
        }
        chain
    }

    #[test]
    fn the_best_value_of_a_lag_is_undone_and_doubts_are_named() {
        let hz = |known: Known| match known {
            Known::Bandwidth(hz, _) => Some(hz),
            _ => None,
        };
        let both = [
            ("amplifier_bandwidth", 9e3, Some(300.0)),
            ("sensor_bandwidth", 8e3, Some(400.0)),
        ];
        assert_eq!(hz(known(&chain(&both), None, None)), Some(8e3));
        let vague = [both[0], ("sensor_bandwidth", 8e3, Some(1000.0))];
        assert!(
            matches!(known(&chain(&vague), None, None), Known::Doubtful(hz, why)
                if hz == 8e3 && (why.contains("12 %") || why.contains("13 %")))
        );
        let alone = chain(&both[1..]);
        assert!(matches!(known(&alone, None, None), Known::Doubtful(hz, why)
                if hz == 8e3 && why.contains("amplifier's")));
        assert_eq!(hz(known(&alone, None, Some(7e3))), Some(7e3));
        let mut held = alone.clone();
        held.effects[0].parameters[0].parameter.fixed = true;
        assert_eq!(hz(known(&held, None, None)), Some(8e3));
        let all_s = of_chain_s(&chain(&[both[0], both[1], ("delay", 20e-6, None)])).unwrap();
        assert!(
            (all_s - (1.0 / (TAU * 9e3) + 1.0 / (TAU * 8e3) + 20e-6)).abs() < 1e-12
                && of_chain_s(&chain(&[])).is_none()
        );
        assert_eq!(known(&chain(&[]), None, None), Known::Ideal);
        assert_eq!(known(&chain(&both[..1]), None, None), Known::Ideal);
    }
}

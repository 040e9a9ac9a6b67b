//! Designs as front ends ask for them: without a recording, and beside a predictor for the same order.

use super::design::{Scheme, ServoDesign};
use super::known::ASSUMED_NOISE_UM;
use super::order::{self, DesignOrder};
use super::scheme_choice::SchemeChoice;
use super::schemes::{self, AtWork};
use super::tuning::Demands;
use hysteron_sim::chain::Model;

/// Designs a servo for an identified chain without a recording behind it, so that an unknown mode is reckoned
/// with everywhere ([`order::design`] takes the recording).
///
/// # Errors
/// A message that says what the model lacks, or which demand cannot be met.
pub fn design(chain: &Model, demands: &Demands) -> Result<ServoDesign, String> {
    let Demands {
        reference_hz,
        sensor_noise_um,
        sensitivity_peak,
        usual_margins,
        ..
    } = *demands;
    let sensor_noise_um = Some(sensor_noise_um);
    order::design(
        chain,
        &DesignOrder {
            reference_hz,
            sensor_noise_um,
            sensitivity_peak,
            usual_margins,
            ..DesignOrder::default()
        },
    )
}

/// Designs what was ordered, and what is to be expected of it: it follows sines on the model, with all that
/// the model has and no law knows. Where it is another scheme, a predictor for the same order stands beside it
/// on the same sines.
///
/// # Errors
/// As [`order::design`]; the explanation reports a refused predictor.
pub fn design_with_expected_errors(
    chain: &Model,
    order: &DesignOrder<'_>,
) -> Result<(ServoDesign, Vec<AtWork>), String> {
    let mut design = order::design(chain, order)?;
    let mut predictor = None;
    if order.scheme != SchemeChoice::Predictor {
        let order = DesignOrder {
            scheme: SchemeChoice::Predictor,
            ..*order
        };
        match order::design(chain, &order) {
            Ok(found) => {
                if let Scheme::Predictor { tuning, .. } = &found.scheme {
                    design.beside = Some(*tuning);
                }
                predictor = Some(found);
            }
            Err(refusal) => design.explanation.push(format!(
                "A predictor for the same order is refused: {refusal}."
            )),
        }
    }
    let designs: Vec<&ServoDesign> = std::iter::once(&design).chain(&predictor).collect();
    let frequencies_hz = [1.0 / 15.0, 1.0 / 3.0, 1.0].map(|share| share * order.reference_hz);
    let noise_um = design.sensor_noise_um.unwrap_or(ASSUMED_NOISE_UM);
    let rows = schemes::at_work(chain, &designs, &frequencies_hz, noise_um);
    design
        .explanation
        .insert(0, schemes::at_work_in_words(&rows));
    Ok((design, rows))
}

#[cfg(test)]
mod tests {
    use super::super::reference::Reference;
    use super::super::work::{Work, follow};
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};

    /// A sensor of 300 Hz is 0.53 ms late: left alone it would cost half the amplitude.
    #[test]
    #[cfg_attr(debug_assertions, ignore = "slow: release mode")]
    fn the_promise_on_a_stage_with_a_slow_sensor_is_what_is_found() {
        let overview = Overview::without_data(0.0, 80.0);
        let mut chain = Model::new(0.0, 80.0);
        let effects: [(&str, &[f64]); 3] = [
            ("hysteresis", &[9.0, 1.0, -2.0]),
            ("vibration", &[5_300.0, 0.6]),
            ("sensor_bandwidth", &[300.0]),
        ];
        for (id, values) in effects {
            let effect = by_id(id).expect("an effect");
            chain.add(EffectInstance::new(effect, &overview, values));
        }
        let (design, rows) =
            design_with_expected_errors(&chain, &DesignOrder::default()).expect("a servo");
        let row = rows.last().expect("a row for each frequency");
        let name = format!("sine:{}:{}", row.frequency_hz, row.amplitude_um);
        let reference = Reference::named(&name, design.period_s()).expect("a sine");
        let found = follow(&chain, &design, &reference, &name, &Work::default()).expect("a run");
        let (found_um, promised_um) = (found.truth.rms_um, row.true_rms_um);
        assert!(
            found_um < 1.5 * promised_um && promised_um < 1.5 * found_um,
            "{found_um} {promised_um}"
        );
        assert!(found_um < 0.01 * row.amplitude_um, "{found_um}");
    }
}

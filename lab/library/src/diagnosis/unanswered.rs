//! Do the readings answer the drive at all?
//!
//! A sensor that is not connected, a column of something else, an amplifier that is switched off: what is read has nothing of the drive. A search finds nothing
//! there, and "nothing is missing" would be the wrong thing to say; in one record of several it spoils what is fitted to all. So of each record is
//! asked what share of what its readings do beside a drift goes with anything that the drive does: with what the model makes of it, with the drive itself or with its
//! rate, which two together meet a lag of any phase.

use super::judgement::Judged;
use crate::dataset::{Dataset, Record};
use crate::identification::fit::rms;
use crate::identification::linearisation::measured;
use crate::identification::own_part::{Samples, orthonormalised, project_out_of};
use crate::parallel;
use hysteron_sim::chain::Model;
use nalgebra::{DMatrix, DVector};

/// Below this share of their squares readings do not answer.
const LEAST_SHARE: f64 = 0.01;
/// And the model leaves at least this share of what they do beside a drift: one that meets them in another way, by a force that was recorded, knows better.
const LEAVES: f64 = 0.98;
/// Of fewer samples more than this share goes with the drive by chance.
const SAMPLES_MIN: usize = 2000;

/// Readings that do not answer their drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Unanswered {
    /// The record.
    pub record: String,
    /// What the readings do beside a drift, um.
    pub moves_um: f64,
    /// Share of its squares that goes with the drive.
    pub share: f64,
}

/// The records whose readings do not answer the drive.
#[must_use]
pub fn records(dataset: &Dataset, judged: &Judged) -> Vec<Unanswered> {
    let both: Vec<(&Record, &Vec<f64>)> = dataset.records.iter().zip(&judged.residuals).filter(|(_, left)| !left.is_empty()).collect();
    parallel::map(&both, |(record, left)| of_record(&judged.model, record, left)).into_iter().flatten().collect()
}

fn of_record(model: &Model, record: &Record, left: &[f64]) -> Option<Unanswered> {
    let samples = Samples::counted(record);
    if samples.count() < SAMPLES_MIN {
        return None;
    }
    let places = DVector::from_iterator(samples.count(), samples.iter().map(|k| k as f64));
    let drift = [DVector::from_element(samples.count(), 1.0), places];
    let rate: Vec<f64> = (0..record.drive_v.len()).map(|k| record.drive_v[k] - record.drive_v[k.saturating_sub(1)]).collect();
    let of_the_drive = [&model.simulate(&record.drive()), &record.drive_v, &rate].map(|signal| samples.of(signal));
    let beside = |columns: &[DVector<f64>]| {
        let mut out = measured(record, &samples);
        project_out_of(&orthonormalised(&DMatrix::from_columns(columns)), &mut out);
        rms(out.as_slice())
    };
    let (moves_um, with_the_drive_um) = (beside(&drift), beside(&[&drift[..], &of_the_drive].concat()));
    let share = 1.0 - (with_the_drive_um / moves_um).powi(2);
    let drive_moves = record.counted().any(|k| record.drive_v[k] != record.drive_v[record.window.start]);
    (drive_moves && share < LEAST_SHARE && rms(left) > LEAVES * moves_um).then(|| Unanswered {
        record: record.name.clone(),
        moves_um,
        share,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Role;
    use crate::diagnosis::judgement::{Split, judge};
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};
    use hysteron_sim::noise::WhiteNoise;

    const SAMPLES: usize = 5000;

    fn wave(k: usize) -> f64 {
        5.0 - 4.0 * (0.011 * k as f64).cos()
    }

    /// Of readings in noise of 0.5 um, which are these beside it.
    fn found(readings_um: impl Fn(usize) -> f64, gain_um_v: f64) -> Vec<Unanswered> {
        let mut noise = WhiteNoise::new(0.5, 7);
        let readings = (0..SAMPLES).map(|k| readings_um(k) + noise.next_um()).collect();
        let record = Record::new("one", 10e3, (0..SAMPLES).map(wave).collect(), readings).with_role(Role::Identify);
        let dataset = Dataset::new("t", 0.0, 10.0, vec![record]).unwrap();
        let mut model = Model::new(0.0, 10.0);
        model.add(EffectInstance::new(by_id("gain").unwrap(), &Overview::without_data(0.0, 10.0), &[gain_um_v]));
        records(&dataset, &judge(model, &dataset, &Split::of(&dataset)))
    }

    #[test]
    fn noise_alone_and_a_drift_answer_nothing() {
        for readings in [|_| 3.0, |k: usize| 2e-4 * k as f64] {
            let found = found(readings, 1e-3);
            assert_eq!(found.len(), 1);
            assert!((found[0].moves_um - 0.5).abs() < 0.02 && found[0].share < 0.005, "{found:?}");
        }
    }

    /// A tenth of a micrometre in half a micrometre of noise, a stage that follows a quarter of a period late, and one that no model was fitted to.
    #[test]
    fn what_follows_the_drive_answers_it_however_late_and_small() {
        assert_eq!(found(|k| 0.035 * wave(k), 0.035), []);
        assert_eq!(found(|k| (0.011 * k as f64).sin(), 1e-3), []);
        assert_eq!(found(wave, 1e-3), []);
    }
}

//! Where a search begins that single effects would not bring to an end: with all modes of the measured responses
//! at once, and few records.

use super::fit::{Problem, rms};
use super::modal_start::modal_start;
use super::recordings::{AxesData, AxesRecord};
use super::structure::Described;
use crate::dataset::Role;

/// Modes of the responses that are tried: from a stage of one axis to what two hundred effects describe.
const MODES: [usize; 6] = [1, 2, 4, 8, 16, 32];
/// Twice as many are taken where they leave less than this share of the held-out error. On the mirror 16 leave
/// 0.87 of what 8 leave, and 32 leave 0.98 of that.
const MODES_ARE_WORTH: f64 = 0.9;
/// Records that are fitted beside all of the responses: the least, a middle and the greatest drive show what
/// depends on the amplitude.
const RECORDS_OF_SEARCH: usize = 3;

/// The linear model of the measured responses, where that has more effects than a search adds one by one.
pub(super) fn responses_beyond(problem: &Problem, effects_max: usize) -> Option<Described> {
    let mut best: Option<(Described, f64)> = None;
    for modes in MODES {
        let Ok(model) = modal_start(problem.data, modes) else {
            continue;
        };
        let error = rms(&problem.judged(&model.stage));
        if best
            .as_ref()
            .is_none_or(|(_, of)| error < MODES_ARE_WORTH * of)
        {
            best = Some((model, error));
        }
    }
    best.map(|(model, _)| model)
        .filter(|model| model.effects.len() > effects_max)
}

/// A data set with few of the fitted records, from that with the least drive to that with the most, and all that
/// judge.
pub(super) fn from_least_to_most_drive(data: &AxesData) -> AxesData {
    let squares = |record: &AxesRecord| -> f64 {
        let of_drive =
            |drive: &Vec<f64>| drive.iter().map(|u| u * u).sum::<f64>() / drive.len() as f64;
        record.drives.iter().map(of_drive).sum()
    };
    let mut fitted: Vec<&AxesRecord> = data
        .of_role(Role::Identify)
        .map(|(_, record)| record)
        .collect();
    fitted.sort_by(|a, b| squares(a).total_cmp(&squares(b)));
    let places = RECORDS_OF_SEARCH.min(fitted.len());
    let chosen = (0..places).map(|n| fitted[n * (fitted.len() - 1) / (places - 1).max(1)]);
    let judging = data.of_role(Role::Validate).map(|(_, record)| record);
    AxesData {
        records: chosen.chain(judging).cloned().collect(),
        ..data.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::several_axes::planted::{AxisPlant, planted_stage};

    #[test]
    fn a_search_begins_with_all_responses_where_single_effects_do_not_suffice() {
        let stage = planted_stage(AxisPlant::Coupling, 1);
        let problem = Problem::new(&stage.data);
        assert!(responses_beyond(&problem, 60).is_none());
        let model = responses_beyond(&problem, 8).expect("a model of the responses");
        let nothing = rms(&problem.judged(&Described::empty(&stage.data).stage));
        let left = rms(&problem.judged(&model.stage));
        assert!(left < 0.2 * nothing, "{left} of {nothing}");
    }

    #[test]
    fn few_records_have_the_least_and_the_greatest_drive() {
        let mut data = planted_stage(AxisPlant::Coupling, 1).data;
        let of_role = |role| move |record: &&AxesRecord| record.role == role;
        let first = data
            .records
            .iter()
            .find(of_role(Role::Identify))
            .unwrap()
            .clone();
        let judging = data.records.iter().filter(of_role(Role::Validate)).count();
        data.records.retain(|record| record.role == Role::Validate);
        for scale in [5.0, 1.0, 4.0, 2.0, 3.0] {
            let mut record = first.clone();
            record.name = scale.to_string();
            record.drives.iter_mut().flatten().for_each(|u| *u *= scale);
            data.records.push(record);
        }
        let few = from_least_to_most_drive(&data);
        let fitted = few.records.iter().filter(of_role(Role::Identify));
        let names: Vec<&str> = fitted.map(|record| record.name.as_str()).collect();
        assert_eq!(names, ["1", "3", "5"]);
        assert_eq!(few.records.len(), judging + RECORDS_OF_SEARCH);
    }
}

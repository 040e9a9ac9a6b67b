//! Does a saved model do what was reported of it? A file is explained, its model is written and read, and
//! compared and simulated on the same file with nothing specified.

use hysteron::Result;
use hysteron::analyse::{Options, Start, analyse};
use hysteron::dataset::reading::{Instructions, drive_of_file, from_file_as};
use hysteron::dataset::{Dataset, Role};
use hysteron::diagnosis::judgement::noise_floor_beside;
use hysteron::figures::fit_figures;
use hysteron::model_file::{effects_named, from_toml, to_toml};
use hysteron::origin::{Initial, Way, read_as_recorded};
use hysteron::phrases::nm;
use hysteron::statistics::rms;
use hysteron::watch::Watch;

/// An error is what was reported up to this factor.
pub const AS_REPORTED: f64 = 1.1;

/// What a saved model does on the file that it was found on.
#[derive(Clone, Debug)]
pub struct SavedModel {
    /// Its effects.
    pub effects: Vec<String>,
    /// Error that was reported: held out, or fitted where nothing is held out, um.
    pub reported_um: f64,
    /// Error of `compare` on the same samples, um.
    pub compared_um: f64,
    /// Error of `simulate` on the same samples, um.
    pub simulated_um: f64,
    /// Error of the replay of the whole file that was reported, um.
    pub replayed_um: f64,
    /// Error of `simulate` over the samples of the whole file that count, um.
    pub simulated_whole_um: f64,
    /// Share of the samples that judged inside the band.
    pub inside: f64,
    /// Median of half of the width of the band over the error of `simulate`.
    pub band_over_error: f64,
}

impl SavedModel {
    /// The heading of a table as CSV, errors in nm.
    pub const HEADING: &'static str = "tape,reported_nm,compared_nm,simulated_there_nm,replay_reported_nm,simulated_nm,inside_band_pct,half_band_over_error,effects";

    /// A row of it.
    #[must_use]
    pub fn row(&self, tape: &str) -> String {
        let times = |value: f64| {
            if value.is_nan() {
                "none".into()
            } else {
                format!("{value:.2}")
            }
        };
        format!(
            "{tape},{},{},{},{},{},{:.1},{},{}",
            nm(self.reported_um),
            nm(self.compared_um),
            nm(self.simulated_um),
            nm(self.replayed_um),
            nm(self.simulated_whole_um),
            100.0 * self.inside,
            times(self.band_over_error),
            self.effects.join(" ")
        )
    }

    /// Errors over what was reported: of `compare` and of `simulate` on the samples that judged, and of
    /// `simulate` over the whole file.
    #[must_use]
    pub fn over_reported(&self) -> [f64; 3] {
        [
            self.compared_um / self.reported_um,
            self.simulated_um / self.reported_um,
            self.simulated_whole_um / self.replayed_um,
        ]
    }
}

/// Explains a file from a list of effects, and judges the model that is saved.
///
/// # Errors
/// What is wrong with the file or the effects.
pub fn saved_model(
    place: &str,
    bytes: &[u8],
    rate_hz: Option<f64>,
    from: &str,
    watch: &dyn Watch,
) -> Result<SavedModel> {
    let typed = Instructions {
        sample_rate_hz: rate_hz,
        ..Instructions::default()
    };
    let given = from_file_as(place, bytes, &typed)?;
    let start = effects_named(from)?;
    let found = analyse(&given, Start::Effects(&start), &Options::default(), watch)?;
    let reported = found.figures(&given, 0.0);
    let model = from_toml(&to_toml(&found.model, "file")?, "model.toml")?;
    let known_hz = model
        .identified
        .as_deref()
        .map(|known| known.recorded.sample_rate_hz);
    let untold = Instructions {
        rate_otherwise_hz: known_hz,
        ..Instructions::default()
    };
    let again = from_file_as(place, bytes, &untold)?;
    let again = read_as_recorded(&model, &again).unwrap_or(again);
    let floor = noise_floor_beside(&model, &again);
    let compared = fit_figures(&model, &again, &floor, Vec::new(), &[], 0.0);
    let played = drive_of_file(place, bytes, &untold)?;
    let way = Way::told(&model, None, None);
    let (predicted, _) =
        Initial::AsRecorded.predict(&model, &played.file, &played.rows(), way, place)?;
    let measured = played.reading_um.unwrap_or_default();
    let off = |k: usize| measured[k] - predicted.reading_um[k];
    let judges = judging(&again);
    let left: Vec<f64> = judges.iter().map(|k| off(*k)).collect();
    let error_um = reported.validate_rms_um.unwrap_or(reported.identify_rms_um);
    let (mut widths, mut inside) = (Vec::new(), 0);
    for k in &judges {
        let half_um = predicted
            .half_band_um
            .as_ref()
            .map_or(f64::NAN, |band| band[*k]);
        widths.push(half_um / rms(&left));
        inside += usize::from(off(*k).abs() <= half_um);
    }
    widths.sort_by(f64::total_cmp);
    let whole = &again.records[again.records.len() - 1];
    let counts: Vec<f64> = (0..whole.drive_v.len()).map(off).collect();
    Ok(SavedModel {
        effects: model.effect_ids(),
        reported_um: error_um,
        compared_um: compared.validate_rms_um.unwrap_or(compared.identify_rms_um),
        simulated_um: rms(&left),
        replayed_um: reported
            .replays
            .first()
            .map_or(f64::NAN, |replay| replay.rms_um),
        simulated_whole_um: rms(&counts),
        inside: inside as f64 / judges.len().max(1) as f64,
        band_over_error: widths.get(widths.len() / 2).copied().unwrap_or(f64::NAN),
    })
}

/// The samples of a file that judge: of what is held out, or of what is fitted where nothing is.
fn judging(dataset: &Dataset) -> Vec<usize> {
    let of_role = |role: Role| dataset.records.iter().find(|record| record.role == role);
    let record = of_role(Role::Validate).or_else(|| of_role(Role::Identify));
    record.map_or_else(Vec::new, |record| record.counted().collect())
}

//! Why a design is as it is, or is refused, in the sentences that a servo file keeps.

use super::candidate::{
    Broken, Candidate, Scan, USUAL_GAIN_MARGIN_DB, USUAL_PEAK, USUAL_PHASE_MARGIN_DEG,
};
use super::data_of_stage::{LARGE_RESIDUAL, how_to_exclude};
use super::known::hertz;
use super::law::PredictorDesign;
use super::moving_mode::{ReferenceBand, with_first_mode_at};
use super::plant_set::PlantVariation;
use super::recording::ServoRecording;
use super::robust::Task;
use super::sampled_loop::decibels;
use super::scheme_choice::SchemeChoice;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::Place;

/// Another drive is worth recommending where it lets the expected error fall below this share.
const WORTH_RECORDING: f64 = 0.8;

/// What the model is not, said aloud.
pub(super) fn shortcomings(
    chain: &Model,
    recording: Option<&ServoRecording>,
    said: &mut Vec<String>,
) {
    if chain
        .effects
        .iter()
        .all(|e| e.effect.declaration().place != Place::Creep)
    {
        said.push(
            "CAUTION: the model has no creep: slow errors are left to the integral action.".into(),
        );
    }
    if let Some((recording, noise_um)) = recording.and_then(|r| Some((r, r.noise_um?)))
        && recording.residual_um > LARGE_RESIDUAL * noise_um
    {
        said.push(format!(
            "CAUTION: the model leaves {:.1} nm where the sensor's noise is {:.1} nm: something is missing in it, so that standard deviations are too small, or --data is of another stage.",
            1e3 * recording.residual_um,
            1e3 * noise_um
        ));
    }
}

/// Why no candidate is left.
fn refusal<T>(scan: &Scan<T>, recording: Option<&ServoRecording>, scheme: SchemeChoice) -> String {
    let instead = match scheme {
        SchemeChoice::Predictor => {
            "a lower --reference-hz or another --sensor-noise-um gives other tunings"
        }
        _ => "choose --scheme predictor, or compare others with `check --scheme NAME`",
    };
    let in_words = |(broken, times): &(Broken, f64)| {
        match broken {
        Broken::Member(name) => format!("{name} none of the tunings is stable; {instead}"),
        Broken::Limit(name) => format!("{name} every tuning could go on swinging between the limits of the drive; {instead}"),
        Broken::Sensitivity => "none of the tunings keeps the largest sensitivity; accept a larger --sensitivity-peak".to_owned(),
        Broken::Unknown { hz } => {
            format!(
                "a mode near {hz:.0} Hz, which the recording does not exclude, could make every tuning unstable; {}",
                how_to_exclude(recording, *hz, *times)
            )
        }
        Broken::Integers => "every tuning that holds needs gains beyond what the servo's integers hold: the first mode is too slow beside the sampling rate of the loop for a sensor as quiet; name a larger --sensor-noise-um, so that a slower observer is chosen".to_owned(),
    }
    };
    // The candidate that came furthest says what is in the way.
    let furthest = scan
        .candidates
        .iter()
        .filter_map(|c| Some((c.broken?, c.unknown.0)))
        .max_by_key(|(b, _)| match b {
            Broken::Member(_) => 0,
            Broken::Sensitivity => 1,
            Broken::Limit(_) => 2,
            Broken::Unknown { .. } => 3,
            Broken::Integers => 4,
        });
    format!(
        "no servo can be answered for: {}",
        furthest
            .as_ref()
            .map_or_else(|| "there is no candidate".into(), in_words)
    )
}
/// A scan in words.
pub(super) struct ScanWords<'a> {
    pub task: &'a Task<'a>,
    pub recording: Option<&'a ServoRecording>,
    pub scheme: SchemeChoice,
    pub inverse: bool,
}

impl ScanWords<'_> {
    /// The best candidate with why it is, or the refusal.
    pub(super) fn explain<'a, T: Clone>(
        &self,
        scan: &'a Scan<T>,
    ) -> Result<(&'a Candidate<T>, Vec<String>), String> {
        let chosen = scan
            .chosen(self.task.demands.usual_margins)
            .ok_or_else(|| refusal(scan, self.recording, self.scheme))?;
        let (Task { first, demands, .. }, good) = (
            self.task,
            scan.candidates
                .iter()
                .filter(|c| c.broken.is_none())
                .count(),
        );
        let mut out = vec![
            format!(
                "Of {} tunings {good} hold for every plant that is left possible; {} smallest expected error, {:.2} nm with nothing to follow: the root of the sum of the squares of {:.2} nm passed on of {:.2} nm of sensor noise, and of {:.2} nm at {} Hz and {:.2} nm at {} Hz let through of {} of {:.0} nm.",
                scan.candidates.len(),
                if self.task.demands.usual_margins && chosen.keeps_usual_margins() {
                    format!(
                        "of those with {}, this one has the",
                        usual_margins_in_words()
                    )
                } else {
                    "this one has the".to_owned()
                },
                1e3 * chosen.expected_um(),
                1e3 * chosen.noise_um,
                1e3 * demands.sensor_noise_um,
                1e3 * chosen.disturbance_um,
                demands.reference_hz,
                1e3 * chosen.slow_um,
                0.1 * demands.reference_hz,
                if self.inverse {
                    "a hysteresis model error"
                } else {
                    "a hysteresis that is not inverted"
                },
                1e3 * demands.model_error_um
            ),
            format!(
                "It holds with the gain from half to one and a half, up to a period more of delay, up to {} times the mass, the first mode up to {:.0} % off and {:.0} % less damped, and any missing response that is not excluded; nearest to its limit with one at {:.0} Hz ({:.0} % of what it can stand). {}.",
                mass_in_words(scan.mass_to),
                100.0 * first.frequency,
                100.0 * first.damping,
                chosen.unknown.1,
                100.0 * chosen.unknown.0,
                capital(&margins_in_words(chosen))
            ),
        ];
        if scan.mass_to < self.task.mass_to {
            out.push(format!(
                "CAUTION: no tuning that was tried holds up to {} times the mass: do not load the stage with more than {} times its moving mass without another design.",
                mass_in_words(self.task.mass_to),
                mass_in_words(scan.mass_to)
            ));
        }
        out.extend(self.price_of_margins(scan, chosen));
        let worth =
            |better: &&Candidate<T>| better.expected_um() < WORTH_RECORDING * chosen.expected_um();
        if let Some(better) = scan.best_if_recorded().filter(worth) {
            out.push(format!(
                "What limits it is a mode near {:.0} Hz that nothing excludes: {}, and the expected error falls to as little as {:.2} nm.",
                better.unknown.1,
                how_to_exclude(self.recording, better.unknown.1, better.unknown.0),
                1e3 * better.expected_um()
            ));
        }
        if let Some(better) = scan.best_in_other_integers().filter(worth) {
            out.push(format!(
                "A faster observer would come to {:.2} nm, but its gains have no place in the servo's integers: the first mode at {:.0} Hz is slow beside the sampling rate of the loop.",
                1e3 * better.expected_um(),
                hertz(&self.task.linear.first_mode)
            ));
        }
        Ok((chosen, out))
    }

    /// What the usual margins cost, or would cost where they are exceeded.
    fn price_of_margins<T: Clone>(&self, scan: &Scan<T>, chosen: &Candidate<T>) -> Option<String> {
        if !self.task.demands.usual_margins {
            return None;
        }
        let best = scan.best()?;
        let nm = |c: &Candidate<T>| 1e3 * c.expected_um();
        if chosen.keeps_usual_margins() {
            let differs = chosen.cost_um() > best.cost_um();
            return differs.then(|| {
                format!(
                    "With smaller margins the expected error is {:.2} nm ({}); --sensitivity-peak {:.2} takes it.",
                    nm(best),
                    margins_in_words(best),
                    0.005 + best.sensitivity_peak
                )
            });
        }
        Some(match scan.best_with_usual_margins() {
            Some(usual) => format!(
                "CAUTION: {} would raise the expected error by more than a third, to {:.2} nm; --sensitivity-peak {USUAL_PEAK} takes it.",
                usual_margins_in_words(),
                nm(usual)
            ),
            None => format!(
                "CAUTION: no tuning that holds has {}.",
                usual_margins_in_words()
            ),
        })
    }
}

/// A mass over the model's, rounded to what holds.
#[must_use]
pub fn mass_in_words(mass_to: f64) -> String {
    let shown = format!("{:.2}", (100.0 * mass_to).floor() / 100.0);
    shown.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn usual_margins_in_words() -> String {
    format!(
        "a sensitivity of at most {USUAL_PEAK}, a gain margin of {USUAL_GAIN_MARGIN_DB:.0} dB and a phase margin of {USUAL_PHASE_MARGIN_DEG:.0} degrees"
    )
}

/// Peak of the sensitivity, gain and phase margin of a candidate.
fn margins_in_words<T>(candidate: &Candidate<T>) -> String {
    let finite = |value: f64, text: String| {
        if value.is_finite() {
            text
        } else {
            "without a limit".to_owned()
        }
    };
    format!(
        "peak sensitivity {:.2}, gain margin {}, phase margin {}",
        candidate.sensitivity_peak,
        finite(
            candidate.gain_margin,
            format!("{:.1} dB", decibels(candidate.gain_margin))
        ),
        finite(
            candidate.phase_margin_deg,
            format!("{:.0} degrees", candidate.phase_margin_deg)
        )
    )
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().collect::<String>() + letters.as_str()
    })
}
/// What a reference becomes with the first mode where it was recorded and at both ends.
pub(super) fn where_the_mode_moves(task: &Task<'_>, chosen: &Candidate) -> String {
    let law = PredictorDesign::new(&task.linear, &chosen.tuning);
    let [lower, recorded, higher] = [-1.0, 0.0, 1.0].map(|way| {
        let moved = with_first_mode_at(&task.linear, 1.0 + way * task.mode_moves);
        let band = ReferenceBand::followed(
            &law,
            &PlantVariation::with_delay_s(task.delay_s).sampled(&moved),
            1.0,
        );
        format!(
            "{:.0} Hz ({:.2} times at most)",
            band.bandwidth_hz, band.peak
        )
    });
    format!(
        "The first mode at {:.0} Hz may move by {:.0} %: references are followed to {recorded} where it was recorded, to {lower} with it lower and {higher} with it higher; {:.2} of the sensor's noise becomes motion.",
        hertz(&task.linear.first_mode),
        100.0 * task.mode_moves,
        chosen.noise_um / task.demands.sensor_noise_um
    )
}

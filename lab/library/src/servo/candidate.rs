//! Candidates of a scan: which laws there are to choose among, what each is worth, and which is chosen.

use super::law::PredictorDesign;
use super::plant_set::PlantName;
use super::sampled_loop::decibels;
use super::tuning::{Demands, PredictorTuning};

/// Margins that a controller usually keeps: the largest sensitivity, ...
pub const USUAL_PEAK: f64 = 1.8;
/// ... the gain margin, dB, ...
pub const USUAL_GAIN_MARGIN_DB: f64 = 8.0;
/// ... and the phase margin, degrees (a peak of 1.8 alone leaves 7.0 dB and 32 degrees).
pub const USUAL_PHASE_MARGIN_DEG: f64 = 35.0;
/// The usual margins are kept where the cost stays below this factor.
const COST_OF_USUAL: f64 = 4.0 / 3.0;

/// Laws among which a scan chooses: each by its tuning, a few numbers.
pub trait Family: Sync {
    /// What one of them is tuned by.
    type Tuning: Clone + Send + Sync;

    /// What closes the loop; none where the tuning gives no linear law.
    fn law(&self, tuning: &Self::Tuning) -> Option<PredictorDesign>;

    /// Laws that have to be stable beside it, where it is one end of what a nonlinearity makes of it.
    fn beside(&self, _tuning: &Self::Tuning) -> Vec<PredictorDesign> {
        Vec::new()
    }

    /// Whether its gains have a place in the tick's integers.
    fn fits(&self, tuning: &Self::Tuning, law: &PredictorDesign) -> bool;

    /// The tunings of the grid.
    fn grid(&self, demands: &Demands) -> Vec<Self::Tuning>;

    /// Numbers of a tuning that are moved between the points of the grid.
    fn numbers(&self) -> usize;

    /// A tuning with one of its numbers multiplied.
    fn stepped(&self, tuning: &Self::Tuning, number: usize, by: f64) -> Self::Tuning;
}
/// Which condition a candidate breaks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Broken {
    /// Unstable on a member of the set.
    Member(PlantName),
    /// The peak of the sensitivity.
    Sensitivity,
    /// On a member of the set it may go on swinging between the limits of the drive.
    Limit(PlantName),
    /// A missing response that is not excluded, at this frequency.
    Unknown {
        /// Hz.
        hz: f64,
    },
    /// Nothing but that a gain has no place in the tick's integers.
    Integers,
}

/// A candidate with what it is worth.
#[derive(Clone, Debug)]
pub struct Candidate<T = PredictorTuning> {
    /// Its tuning.
    pub tuning: T,
    /// Noise passed on, um RMS.
    pub noise_um: f64,
    /// Model error let through at the highest frequency, um RMS.
    pub disturbance_um: f64,
    /// The same at a tenth of it.
    pub slow_um: f64,
    /// Largest sensitivity.
    pub sensitivity_peak: f64,
    /// The factor by which a reference is at most too large or too small where the first mode moves; one
    /// where it does not.
    pub reference_deviation: f64,
    /// The first condition that it breaks; none for a good one. Conditions in the order of the module's text.
    pub broken: Option<Broken>,
    /// Largest `|K S| W` and where, Hz.
    pub unknown: (f64, f64),
    /// Its gains have a place in the tick's integers.
    pub fits: bool,
    /// Gain margin upwards, as a factor; infinite where the phase never reaches -180 degrees.
    pub gain_margin: f64,
    /// Phase margin, degrees; infinite where the open loop stays below one.
    pub phase_margin_deg: f64,
}

impl<T> Candidate<T> {
    /// Expected error, um RMS.
    #[must_use]
    pub fn expected_um(&self) -> f64 {
        self.noise_um.hypot(self.disturbance_um).hypot(self.slow_um)
    }

    /// What the choice goes by, the less the better: the expected error, and the reference's deviation where
    /// the mode moves.
    #[must_use]
    pub fn cost_um(&self) -> f64 {
        self.expected_um() * self.reference_deviation
    }

    /// Whether it keeps the margins that a controller usually keeps.
    #[must_use]
    pub fn keeps_usual_margins(&self) -> bool {
        self.sensitivity_peak <= USUAL_PEAK
            && decibels(self.gain_margin) >= USUAL_GAIN_MARGIN_DB
            && self.phase_margin_deg >= USUAL_PHASE_MARGIN_DEG
    }
}

/// Whether a candidate breaks nothing and keeps the usual margins.
pub(super) fn holds_with_usual_margins<T>(candidate: &Candidate<T>) -> bool {
    holds(candidate) && candidate.keeps_usual_margins()
}

/// Whether a candidate breaks nothing.
pub(super) fn holds<T>(candidate: &Candidate<T>) -> bool {
    candidate.broken.is_none()
}

/// Whether it breaks at most the condition on what the recording does not exclude.
pub(super) fn holds_if_recorded<T>(candidate: &Candidate<T>) -> bool {
    candidate.fits && matches!(candidate.broken, None | Some(Broken::Unknown { .. }))
}

/// Outcome of a scan.
#[derive(Clone, Debug)]
pub struct Scan<T = PredictorTuning> {
    /// All candidates, by [`Candidate::cost_um`].
    pub candidates: Vec<Candidate<T>>,
    /// Mass over the model's up to which they were judged.
    pub mass_to: f64,
}

impl<T> Scan<T> {
    /// The best of those that break nothing.
    #[must_use]
    pub fn best(&self) -> Option<&Candidate<T>> {
        self.candidates.iter().find(|c| holds(c))
    }

    /// The best of those that also keep the usual margins.
    #[must_use]
    pub fn best_with_usual_margins(&self) -> Option<&Candidate<T>> {
        self.candidates.iter().find(|c| holds_with_usual_margins(c))
    }

    /// The one that a design takes: with the usual margins, where they are wanted and cheap.
    #[must_use]
    pub fn chosen(&self, usual_margins: bool) -> Option<&Candidate<T>> {
        let best = self.best()?;
        let usual = self
            .best_with_usual_margins()
            .filter(|usual| usual_margins && usual.cost_um() < COST_OF_USUAL * best.cost_um());
        Some(usual.unwrap_or(best))
    }

    /// The best of those that only the tick's integers keep from being taken.
    #[must_use]
    pub fn best_in_other_integers(&self) -> Option<&Candidate<T>> {
        self.candidates
            .iter()
            .find(|c| c.broken == Some(Broken::Integers))
    }

    /// The best of those that break at most the condition on what the recording does not exclude.
    #[must_use]
    pub fn best_if_recorded(&self) -> Option<&Candidate<T>> {
        self.candidates.iter().find(|c| holds_if_recorded(c))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_margins_are_kept_where_they_cost_less_than_a_third() {
        let candidate = |error_um: f64, sensitivity_peak: f64| Candidate {
            tuning: (),
            noise_um: error_um,
            disturbance_um: 0.0,
            slow_um: 0.0,
            sensitivity_peak,
            reference_deviation: 1.0,
            broken: None,
            unknown: (0.0, 0.0),
            fits: true,
            gain_margin: 3.0,
            phase_margin_deg: 40.0,
        };
        let taken = |usual_um: f64, wanted: bool| {
            let scan = Scan {
                candidates: vec![candidate(0.006, 2.4), candidate(usual_um, 1.7)],
                mass_to: 2.0,
            };
            scan.chosen(wanted).unwrap().sensitivity_peak
        };
        assert_eq!(
            [
                taken(0.0079, true),
                taken(0.0081, true),
                taken(0.0079, false)
            ],
            [1.7, 2.4, 2.4]
        );
        let small = Candidate {
            gain_margin: 2.4,
            ..candidate(0.006, 1.7)
        };
        assert!(
            !small.keeps_usual_margins()
                && !Candidate {
                    phase_margin_deg: 34.0,
                    ..candidate(0.006, 1.7)
                }
                .keeps_usual_margins()
        );
    }
}

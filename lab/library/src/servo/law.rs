//! The law in f64 as it closes the loop one period after a reading: what is quantised for the tick, and what
//! [`super::sampled_loop`] judges. Every scheme takes this form, whatever fills its rows.

use super::quantise::{OF_OUTPUT_ROW_MOST, OF_STATE_ROW_MOST, QuantisationError, number, row_um};
use super::window_fit::taps_response;
use hysteron_core::predictor_law::{self, PredictorParameters, STATE_ROW_FRACTION_BITS};
use nalgebra::{Complex, DMatrix, DVector};

/// States of the linear dynamics, the slope of the unknown input, and the unknown input.
pub(super) const STATES: usize = predictor_law::STATES + 2;

/// By how many halvings a state's unit may be larger: of 24 fraction bits, 16 are left.
const MOST_HALVINGS: i32 = 8;

/// The law in f64: what is quantised, and what the eigenvalues are taken of.
#[derive(Clone, Debug)]
pub struct PredictorDesign {
    /// Transition matrix of all states, the unknown input last.
    pub a: DMatrix<f64>,
    /// Input vector.
    pub b: DVector<f64>,
    /// Reading row.
    pub c: DVector<f64>,
    /// Observer gain (predictor form).
    pub l: DVector<f64>,
    /// Gain row, one for the unknown input.
    pub k: DVector<f64>,
    /// Feedforward over the reference window.
    pub feedforward: Vec<f64>,
    /// Sampling period, s.
    pub period_s: f64,
}

impl PredictorDesign {
    /// Transition of the law while all that it commands acts: `A - L c - B K`.
    #[must_use]
    pub fn transition(&self) -> DMatrix<f64> {
        &self.a - &self.l * self.c.transpose() + &self.b * -self.k.transpose()
    }

    /// Whether a reading reaches the drive, now or later.
    #[must_use]
    pub fn feeds_back(&self) -> bool {
        let transition = self.transition();
        let mut states = self.l.clone();
        (0..STATES).any(|_| {
            let reaches = self.k.dot(&states) != 0.0;
            states = &transition * &states;
            reaches
        })
    }

    /// Response of the feedforward at a frequency: what acts, over the reference of the same instant.
    #[must_use]
    pub fn feedforward_response(&self, hz: f64) -> Complex<f64> {
        taps_response(&self.feedforward, self.period_s, hz)
    }

    /// Rows of the tick, in units of the states in which they fit: as the model has them where they do, else
    /// multiplied by powers of two.
    ///
    /// A mode that is slow beside the sampling moves by little of its velocity over its frequency in one
    /// period: an observer that is as fast as the sampling then has large gains, and a control small ones.
    /// Counted in smaller pieces of velocity neither is.
    ///
    /// # Errors
    /// If a coefficient does not fit.
    pub fn quantised(&self) -> Result<PredictorParameters, QuantisationError> {
        self.rows_in_these_units().or_else(|_| {
            self.with_states_multiplied(&self.multipliers())
                .rows_in_these_units()
        })
    }

    /// The same law with each of the states of the linear dynamics in another unit.
    fn with_states_multiplied(&self, by: &[f64; predictor_law::STATES]) -> Self {
        let at = |i: usize| by.get(i).copied().unwrap_or(1.0);
        Self {
            a: DMatrix::from_fn(STATES, STATES, |i, j| self.a[(i, j)] * at(i) / at(j)),
            b: DVector::from_fn(STATES, |i, _| self.b[i] * at(i)),
            c: DVector::from_fn(STATES, |i, _| self.c[i] / at(i)),
            l: DVector::from_fn(STATES, |i, _| self.l[i] * at(i)),
            k: DVector::from_fn(STATES, |i, _| self.k[i] / at(i)),
            feedforward: self.feedforward.clone(),
            period_s: self.period_s,
        }
    }

    /// Powers of two, at most one so that no state leaves its range, with which the rows take least of their
    /// formats: from one on, the states' exponents one at a time, as long as that helps.
    fn multipliers(&self) -> [f64; predictor_law::STATES] {
        const LINEAR: usize = predictor_law::STATES;
        let taken = |exponents: &[i32; LINEAR]| -> f64 {
            let law = self.with_states_multiplied(&exponents.map(|e| 2f64.powi(e)));
            let row = |i: usize| {
                law.a
                    .row(i)
                    .iter()
                    .take(LINEAR)
                    .map(|c| c.abs())
                    .sum::<f64>()
                    + law.l[i].abs()
                    + law.b[i].abs()
            };
            let rows = (0..LINEAR).map(|i| row(i) / OF_STATE_ROW_MOST);
            let outputs = [
                law.c.lp_norm(1) / OF_STATE_ROW_MOST,
                law.k.rows(0, LINEAR).lp_norm(1) / OF_OUTPUT_ROW_MOST,
            ];
            // A high power: the fullest row counts, and of two that are full both.
            rows.chain(outputs).map(|share| share.powi(8)).sum()
        };
        let mut here = [0; LINEAR];
        let mut least = taken(&here);
        for _ in 0..LINEAR * MOST_HALVINGS as usize {
            let lower = (0..LINEAR).filter(|i| here[*i] > -MOST_HALVINGS).map(|i| {
                let mut near = here;
                near[i] -= 1;
                (taken(&near), near)
            });
            match lower.min_by(|a, b| a.0.total_cmp(&b.0)) {
                Some((less, near)) if less < least => (least, here) = (less, near),
                _ => break,
            }
        }
        here.map(|e| 2f64.powi(e))
    }

    fn rows_in_these_units(&self) -> Result<PredictorParameters, QuantisationError> {
        const LINEAR: usize = predictor_law::STATES;
        let (slope, unknown) = (LINEAR, LINEAR + 1);
        let mut state_rows = [hysteron_core::integer_row::Row::default(); LINEAR];
        for (i, row) in state_rows.iter_mut().enumerate() {
            // The unknown input acts as the drive does: its column is `b`.
            let mut coefficients: Vec<f64> = self.a.row(i).iter().take(LINEAR).copied().collect();
            coefficients.extend([self.l[i], self.b[i]]);
            *row = row_um(&format!("observer row {i}"), &coefficients)?;
        }
        let bits = STATE_ROW_FRACTION_BITS as i32;
        Ok(PredictorParameters {
            state_rows,
            unknown_gain: number("observer gain of the unknown input", self.l[unknown], bits)?,
            slope_gain: number("observer gain of its slope", self.l[slope], bits)?,
            reading_row: row_um("reading row", self.c.as_slice())?,
            // The last two entries of `K` belong to the unknown input and its slope, which the tick adds
            // itself.
            gain_row: row_um("control gain", self.k.as_slice())?,
            feedforward: row_um("feedforward", &self.feedforward)?,
        })
    }

    /// The law while its drive stands at a limit for part of every cycle: only a share of what it commands
    /// acts, which it knows, as it sees what really acts (the first harmonic of a saturation, Gelb and Vander
    /// Velde, Multiple-Input Describing Functions, 1968). A loop of which every share is stable has no
    /// oscillation that a limit could keep up; one of which some is not may be thrown into it, although it is
    /// stable within its limits.
    #[must_use]
    pub fn at_a_limit(&self, share: f64) -> Self {
        Self {
            k: &self.k * share,
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::{LinearModel, ModeModel};
    use super::super::sampled_loop::law_response;
    use super::super::tuning::PredictorTuning;
    use super::*;

    /// A light stage whose mode is slow beside the sampling, read with little noise: what is asked of the
    /// observer in units of the mode has no place in the tick, and in other units of its states has; it is
    /// the same law.
    #[test]
    fn a_law_that_does_not_fit_in_one_unit_of_its_states_fits_in_another() {
        let linear = LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: 2387.6,
                damping_ratio: 0.02,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        };
        let tuning = PredictorTuning {
            unknown_change_um: 0.05,
            force_noise_um: 5.0,
            sensor_noise_um: 0.0005,
            ..PredictorTuning::START
        };
        let law = PredictorDesign::new(&linear, &tuning);
        assert!(law.rows_in_these_units().is_err(), "{}", law.l);
        let integers = law.quantised().unwrap();
        // From the integers back: the answer of the drive to the reading is the same.
        let rows = integers
            .state_rows
            .map(|row| row.coefficients.map(|c| f64::from(c) / 2f64.powi(27)));
        let mut again = law.clone();
        for (i, row) in rows.iter().enumerate() {
            (0..predictor_law::STATES).for_each(|j| again.a[(i, j)] = row[j]);
            (again.l[i], again.b[i]) = (row[6], row[7]);
            again.a[(i, STATES - 1)] = row[7];
            again.c[i] = f64::from(integers.reading_row.coefficients[i]) / 2f64.powi(27);
            again.k[i] = f64::from(integers.gain_row.coefficients[i]) / 2f64.powi(24);
        }
        for hz in [10.0, 150.0, 380.0, 2000.0, 9000.0] {
            let [a, b] = [&law, &again].map(|law| law_response(law, hz));
            assert!((a - b).norm() < 1e-4 * a.norm(), "{hz} Hz: {a} {b}");
        }
        let multiplied = law.multipliers();
        assert!(
            multiplied.iter().all(|m| *m <= 1.0) && multiplied.iter().any(|m| *m < 1.0),
            "{multiplied:?}"
        );
    }
}

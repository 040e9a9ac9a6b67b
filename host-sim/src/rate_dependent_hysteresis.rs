//! Rate-dependent one-sided hysteresis (thesis Ch. 4, Eqs. 14, 16-18).
//!
//! Every coefficient of the surfaces `F` and `G` is a polynomial in the rate of the drive, `|u[k] - u[k-1]|`
//! times the sampling rate. The output is linear in the surfaces, so that the model is one rate-independent
//! operator per power of the rate, all with the same memory, weighted with that power.
//!
//! `G` need not vanish on `alpha = beta` here: at a given rate the surface also carries the lag of the
//! actuator, of one sign on the way up and of the other on the way down. At a reversal the rate is zero, and
//! there the surface of order zero, which does vanish, is left.

use crate::hysteresis_surface::{OneSidedHysteresis, Surfaces};

/// Surfaces in powers of the rate.
#[derive(Clone, Debug, PartialEq)]
pub struct RateSurfaces {
    /// `orders[j]` multiplies the `j`-th power of the rate over `reference_rate_v_s`.
    pub orders: Vec<Surfaces>,
    /// Rate at which the powers are one, V/s.
    pub reference_rate_v_s: f64,
}

/// The model walking along a drive.
#[derive(Clone, Debug)]
pub struct RateDependentHysteresis {
    operators: Vec<OneSidedHysteresis>,
    reference_rate_v_s: f64,
    sample_rate_hz: f64,
    last_drive_v: f64,
}

impl RateDependentHysteresis {
    /// Virgin, at the lower limit of the drive.
    #[must_use]
    pub fn virgin(
        surfaces: &RateSurfaces,
        lower_limit_v: f64,
        range_v: f64,
        sample_rate_hz: f64,
    ) -> Self {
        Self {
            operators: surfaces
                .orders
                .iter()
                .map(|s| OneSidedHysteresis::virgin(s.clone(), lower_limit_v, range_v))
                .collect(),
            reference_rate_v_s: surfaces.reference_rate_v_s,
            sample_rate_hz,
            last_drive_v: lower_limit_v,
        }
    }

    /// Takes the next drive voltage and returns the displacement, um.
    pub fn step(&mut self, drive_v: f64) -> f64 {
        let rate =
            (drive_v - self.last_drive_v).abs() * self.sample_rate_hz / self.reference_rate_v_s;
        self.last_drive_v = drive_v;
        let mut power = 1.0;
        let mut output = 0.0;
        for operator in &mut self.operators {
            output += power * operator.step(drive_v);
            power *= rate;
        }
        output
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;

    #[test]
    fn without_rate_terms_it_is_the_rate_independent_model() {
        let bench = Bench::reference().unwrap();
        let surfaces = Surfaces::from_thesis_powers(&bench.hysteresis.f, &bench.hysteresis.g, 80.0);
        let mut plain = OneSidedHysteresis::virgin(surfaces.clone(), 0.0, 80.0);
        let only_gain = Surfaces {
            g: vec![vec![0.0; 2]; 2],
            r: vec![0.0, 1.0],
        };
        let rate = RateSurfaces {
            orders: vec![surfaces, only_gain],
            reference_rate_v_s: 1000.0,
        };
        let mut dependent = RateDependentHysteresis::virgin(&rate, 0.0, 80.0, 1000.0);
        for drive in [10.0, 30.0, 50.0] {
            // 20 V in 1 ms is 20 times the reference rate; the second surface adds x there on the initial
            // curve.
            let expected = plain.step(drive);
            let step = if drive == 10.0 { 10.0 } else { 20.0 };
            assert!((dependent.step(drive) - expected - step * drive / 80.0).abs() < 1e-9);
        }
    }
}

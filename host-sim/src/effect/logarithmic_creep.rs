//! Logarithmic creep: after a step the displacement goes on with the logarithm of time, by the same share in
//! every decade.
//!
//! A step of one is answered by `1 + share log10(1 + t / onset)`: the law of the thesis (Ch. 2, Eq. 4) made
//! finite at `t = 0`, and, by superposition, of any drive. Since `log(1 + t / t0)` is the integral of `(1 -
//! exp(-t / tau)) exp(-t0 / tau)` over the logarithm of `tau`, it is a sum of first-order terms with weights
//! that are known: the trapezoidal rule, which converges exponentially here, gives them. Beyond
//! `settling_time_s` the creep ends.

use super::creep::stage_of_terms;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "logarithmic_creep";

/// Terms in a decade of time constants: the sum leaves the logarithm by less than 1e-4 of what creeps in a
/// decade.
const TERMS_PER_DECADE: f64 = 2.0;
/// Shortest time constant, as a share of the onset: what is left out below is `exp(-8)` of a decade's creep.
const SHORTEST: f64 = 1.0 / 8.0;

/// Creep with the logarithm of time, in two parameters.
pub struct LogarithmicCreep;

/// Shares and time constants of the terms that stand for the law, at most so many.
///
/// `values` are share per decade, onset and settling time, s.
#[must_use]
pub fn terms(values: &[f64], most: usize) -> Vec<(f64, f64)> {
    let [share_per_decade, onset_s, settling_s] =
        [0, 1, 2].map(|i| values.get(i).copied().unwrap_or(1.0));
    let shortest_s = SHORTEST * onset_s;
    let decades = (settling_s.max(10.0 * onset_s) / shortest_s).log10();
    let count = ((TERMS_PER_DECADE * decades).ceil() as usize + 1).clamp(2, most.max(2));
    let spacing = decades / (count - 1) as f64;
    let term = |i: usize| {
        let tau_s = shortest_s * 10f64.powf(i as f64 * spacing);
        // Half of the last interval: creep settles there.
        let weight = if i + 1 == count { 0.5 } else { 1.0 };
        (
            share_per_decade * spacing * weight * (-onset_s / tau_s).exp(),
            tau_s,
        )
    };
    (0..count).map(term).collect()
}

fn flat(values: &[f64]) -> Vec<f64> {
    terms(values, usize::MAX)
        .into_iter()
        .flat_map(|(share, tau_s)| [share, tau_s])
        .collect()
}

impl Effect for LogarithmicCreep {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics:
            "Domains of all activation energies go on switching: the displacement creeps by the same share in every decade of time."
            .into(),
            reference: "thesis Ch. 2, Eq. 4; Vieira, IBM J. Res. Dev. 30 (1986) 553-563".into(),
            experiment: "steps of several heights, each held for ten seconds or more".into(),
            fitting_rank: 4,
            equations: r"A step of one is answered by `1 + share_per_decade log10(1 + t / onset_s)` until about `settling_time_s`.

It is computed as the terms of `creep`. From `t_1 = onset_s / 8` to the larger of `settling_time_s` and `10 onset_s` there are `d` decades and `n = ceil(2 d) + 1` terms. They have `time_constant_i_s = t_1 10^(d (i - 1) / (n - 1))` and `share_i = share_per_decade d / (n - 1) exp(-onset_s / time_constant_i_s)`. The last share is half of that.",
            goes_by_ends: true,
            ..Declaration::on_request(Place::Creep)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let longest_s = overview.duration_s.max(1e-3);
        let shortest_s = 0.1 / overview.sample_rate_max_hz;
        vec![
            Parameter::linear("share_per_decade", "1", 0.0, 0.5, 0.005),
            Parameter::logarithmic("onset_s", "s", shortest_s, longest_s),
            Parameter::logarithmic("settling_time_s", "s", longest_s, 1e4 * longest_s).on_a_grid(),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let longest_s = overview.duration_s.max(1e-3);
        [1e-3, 1e-2, 0.1]
            .iter()
            .map(|share| vec![0.01, share * longest_s, 100.0 * longest_s])
            .collect()
    }

    fn doubt(&self, _model: &Model, values: &[f64]) -> Option<Doubt> {
        super::creep::only_from_before(values.iter().take(1).copied())
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(stage_of_terms(&flat(from.values), from.setting.dt_s))
    }

    fn free_motions(&self, _model: &Model, values: &[f64]) -> Vec<FreeMotion> {
        terms(values, usize::MAX)
            .iter()
            .map(|(_, tau_s)| FreeMotion {
                decay_per_s: 1.0 / tau_s,
                frequency_rad_s: 0.0,
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Oracle: the law itself, a step and a ramp after it, over seven decades.
        #[test]
        fn its_terms_are_the_logarithm(onset_exponent in -3.0f64..0.0, time_exponent in -4.0f64..2.0) {
            let (onset_s, t) = (10f64.powf(onset_exponent), 10f64.powf(time_exponent));
            let sum: f64 = terms(&[1.0, onset_s, 1e6], usize::MAX).iter().map(|(share, tau_s)| -share * (-t / tau_s).exp_m1()).sum();
            let law = (1.0 + t / onset_s).log10();
            // Of what creeps in a decade; the settling time cuts off t / 1e6 of it.
            prop_assert!((sum - law).abs() < 1.5e-3, "{sum} {law}");
        }

        #[test]
        fn fewer_terms_still_keep_to_it(time_exponent in -2.5f64..2.0) {
            let t = 10f64.powf(time_exponent);
            let few: f64 = terms(&[1.0, 0.01, 1e4], 10).iter().map(|(share, tau_s)| -share * (-t / tau_s).exp_m1()).sum();
            prop_assert!((few - (1.0 + t / 0.01).log10()).abs() < 0.02);
        }
    }
}

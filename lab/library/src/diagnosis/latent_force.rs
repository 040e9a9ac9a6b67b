//! The disturbance that would have to act on the modelled actuator to leave a residual, without a name for
//! it.
//!
//! A missing effect usually acts in front of the mechanics, and the residual then shows it blurred by the
//! vibration. The way back through the mode amplifies noise without bound, so each frequency is weighed by
//! how much of its power is more than noise (Wiener's filter); what cannot be distinguished from noise is
//! left out rather than guessed. The force is given as the displacement that it would cause at rest (force
//! divided by stiffness), in nm.

use crate::identification::noise_floor::periodogram;
use crate::statistics::mean;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::vibration;
use nalgebra::Complex;
use realfft::RealFftPlanner;

/// Frequencies over which the power of the residual is averaged, as a share of the frequency.
const AVERAGED_OVER: f64 = 0.1;
/// Way back through a mode beyond which nothing is amplified, times the static compliance.
const AMPLIFIED_MAX: f64 = 100.0;

/// Latent force at every sample, nm; empty where the residual is too short.
///
/// `noise_um` is the standard deviation of the noise; without it the noise is taken from the fastest quarter
/// of the spectrum.
#[must_use]
pub fn latent_force_nm(
    model: &Model,
    residual_um: &[f64],
    sample_rate_hz: f64,
    noise_um: Option<f64>,
) -> Vec<f64> {
    let n = residual_um.len();
    if n < 16 {
        return Vec::new();
    }
    // Mirrored, so that the ends meet without a jump.
    let mirrored: Vec<f64> = residual_um
        .iter()
        .chain(residual_um.iter().rev())
        .copied()
        .collect();
    let power = averaged(&periodogram(&mirrored));
    let noise_power = noise_um.map_or_else(|| mean(&power[power.len() * 3 / 4..]), |um| um * um);
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, back) = (
        planner.plan_fft_forward(2 * n),
        planner.plan_fft_inverse(2 * n),
    );
    let (mut spectrum, mut input) = (forward.make_output_vec(), mirrored);
    if forward.process(&mut input, &mut spectrum).is_err() {
        return Vec::new();
    }
    let bins = spectrum.len();
    for (bin, value) in spectrum.iter_mut().enumerate() {
        let more_than_noise = (1.0 - noise_power / power[bin].max(f64::MIN_POSITIVE)).max(0.0);
        let frequency_hz = bin as f64 * sample_rate_hz / (2 * n) as f64;
        *value *= more_than_noise * way_back(model, frequency_hz);
        // A real signal has real values at these two.
        if bin == 0 || bin + 1 == bins {
            value.im = 0.0;
        }
    }
    let mut out = back.make_output_vec();
    if back.process(&mut spectrum, &mut out).is_err() {
        return Vec::new();
    }
    let scale = 1e3 / (2 * n) as f64;
    out.truncate(n);
    out.iter_mut().for_each(|v| *v *= scale);
    out
}

/// Static compliance over that of the first mode at a frequency.
fn way_back(model: &Model, frequency_hz: f64) -> Complex<f64> {
    let Some(values) = model.values(vibration::ID) else {
        return Complex::new(1.0, 0.0);
    };
    let ratio = std::f64::consts::TAU * frequency_hz / values[0];
    let inverse = Complex::new(1.0 - ratio * ratio, 2.0 * values[1] * ratio);
    if inverse.norm() > AMPLIFIED_MAX {
        Complex::new(0.0, 0.0)
    } else {
        inverse
    }
}

/// A spectrum averaged over neighbours, the wider the higher the frequency.
fn averaged(power: &[f64]) -> Vec<f64> {
    let sums: Vec<f64> = std::iter::once(0.0)
        .chain(power.iter().scan(0.0, |sum, p| {
            *sum += p;
            Some(*sum)
        }))
        .collect();
    (0..power.len())
        .map(|bin| {
            let reach = (AVERAGED_OVER * bin as f64 / 2.0) as usize;
            let (from, to) = (bin - reach, (bin + reach + 1).min(power.len()));
            (sums[to] - sums[from]) / (to - from) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::{Drive, EffectInstance, InitialState};
    use hysteron_sim::effect::{Overview, by_id};

    #[test]
    fn a_force_in_front_of_the_mode_is_found_again() {
        let overview = Overview::without_data(0.0, 80.0);
        let mut model = Model::new(0.0, 80.0);
        model.add(EffectInstance::new(
            by_id("vibration").unwrap(),
            &overview,
            &[4000.0, 0.1],
        ));
        let force: Vec<f64> = (0..8000)
            .map(|k| 0.05 * (std::f64::consts::TAU * 300.0 * f64::from(k) / 20_000.0).sin())
            .collect();
        let drive = Drive::held(&force, 5e-5, InitialState::Virgin);
        let left: Vec<f64> = model.simulate(&drive);
        let found = latent_force_nm(&model, &left, 20_000.0, Some(1e-4));
        // The mode is two fifths of the way to its resonance: the residual alone is a fifth too large. A
        // sample is held half a period late.
        for k in 3000..5000 {
            let held = 0.5 * (force[k] + force[k - 1]);
            assert!(
                (found[k] - 1e3 * held).abs() < 2.5,
                "{k}: {} {}",
                found[k],
                1e3 * held
            );
        }
    }

    #[test]
    fn noise_gives_no_force() {
        let mut state = 1_u64;
        let noise: Vec<f64> = (0..4000)
            .map(|_| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                0.01 * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 12_f64.sqrt()
            })
            .collect();
        let force = latent_force_nm(&Model::new(0.0, 1.0), &noise, 1000.0, Some(0.01));
        assert!(
            crate::identification::fit::rms(&force) < 0.3 * 10.0,
            "{}",
            crate::identification::fit::rms(&force)
        );
    }
}

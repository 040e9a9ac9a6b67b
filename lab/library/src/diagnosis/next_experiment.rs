//! The next experiment: of several drives within the user's limits, the one on which two explanations predict
//! outputs that differ most.
//!
//! Both explanations are fitted models that meet the present data equally well. Each drive is played on both;
//! what a change of gain or offset could make up for is taken out of the difference, and what remains is
//! compared with the noise. The drives are the experiments that the effects declare as their best, made to
//! fit the limits of voltage, slew and time.

use hysteron_sim::chain::{Drive, InitialState, Model};
use hysteron_sim::effect::Overview;
use hysteron_sim::waveform::{concatenate, half_cosines, hold, samples_in, sine_burst, triangles};

/// What a drive must keep to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Lowest drive, V.
    pub drive_min_v: f64,
    /// Highest drive, V.
    pub drive_max_v: f64,
    /// Steepest slope, V/s.
    pub slope_max_v_s: f64,
    /// Longest duration, s.
    pub duration_max_s: f64,
    /// Sampling rate, Hz; slow drives are sampled more slowly.
    pub sample_rate_hz: f64,
}

impl Limits {
    /// Limits that the present data have kept to: nothing is asked of the amplifier or of the user's patience
    /// that was not done before.
    #[must_use]
    pub fn of(overview: &Overview) -> Self {
        Self {
            drive_min_v: overview.drive_min_v,
            drive_max_v: overview.drive_max_v,
            slope_max_v_s: overview.slope_max_v_s,
            duration_max_s: overview.duration_s,
            sample_rate_hz: overview.sample_rate_max_hz,
        }
    }
}

/// A drive that tells two explanations apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// What the drive is, in words.
    pub drive: &'static str,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// The drive from the virgin state, V; it begins and ends at the lower limit.
    pub drive_v: Vec<f64>,
    /// How far the two explanations are apart on it, um RMS.
    pub separation_um: f64,
}

/// Most samples of a proposed drive.
const SAMPLES_MAX: f64 = 60_000.0;
/// Two explanations are distinguished where they differ by so many standard errors.
const DECIDED: f64 = 5.0;
/// A measured slope may be exceeded by rounding only.
const SLOPE_TOLERANCE: f64 = 1.0 + 1e-9;

impl Proposal {
    /// Whether a recording of it would decide: the two are as far apart as its noise leaves to be seen of so
    /// many samples, and by more than the least difference that matters where models are compared. Where no
    /// noise is known, it may.
    #[must_use]
    pub fn decides(&self, noise_um: Option<f64>, least_um: f64) -> bool {
        let decided =
            |noise_um| self.separation_um * (self.drive_v.len() as f64).sqrt() > DECIDED * noise_um;
        noise_um.is_none_or(|noise_um| decided(noise_um) && self.separation_um > least_um)
    }

    /// What the drive decides and how well, for a reader. `noise_um` is the noise floor, if there is one.
    #[must_use]
    pub fn sentence(&self, a: &str, b: &str, noise_um: Option<f64>) -> String {
        let duration_s = self.drive_v.len() as f64 / self.sample_rate_hz;
        let separation_nm = 1e3 * self.separation_um;
        let against = match noise_um {
            Some(noise_um) if noise_um > 0.0 => {
                format!(", {:.2} x the noise", self.separation_um / noise_um)
            }
            _ => String::new(),
        };
        format!(
            "To tell {a} from {b}: {} for {duration_s:.3} s at {:.0} Hz, from the virgin state. On it the two fitted models differ by {separation_nm:.2} nm RMS{against}, \
             gain and offset left free.",
            self.drive, self.sample_rate_hz
        )
    }

    /// The drive as a table with a header, `t_s,u_v`.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut out = String::from("t_s,u_v\n");
        for (k, u) in self.drive_v.iter().enumerate() {
            out.push_str(&format!("{:.7},{u:.6}\n", k as f64 / self.sample_rate_hz));
        }
        out
    }
}

/// The drive on which `a` and `b` differ most, or none if no drive fits the limits.
#[must_use]
pub fn propose(a: &Model, b: &Model, limits: &Limits) -> Option<Proposal> {
    drives(limits)
        .into_iter()
        .map(|(drive, sample_rate_hz, drive_v)| {
            let separation_um = separation(a, b, &drive_v, sample_rate_hz);
            Proposal {
                drive,
                sample_rate_hz,
                drive_v,
                separation_um,
            }
        })
        .filter(|proposal| proposal.separation_um.is_finite())
        .max_by(|p, q| p.separation_um.total_cmp(&q.separation_um))
}

/// RMS difference of two models on a drive from the virgin state, gain and offset taken out.
#[must_use]
pub fn separation(a: &Model, b: &Model, drive_v: &[f64], sample_rate_hz: f64) -> f64 {
    let drive = Drive::held(drive_v, 1.0 / sample_rate_hz, InitialState::Virgin);
    let (a, b) = (a.simulate(&drive), b.simulate(&drive));
    let count = a.len().max(1) as f64;
    let mean_a = a.iter().sum::<f64>() / count;
    let mean = a.iter().zip(&b).map(|(a, b)| a - b).sum::<f64>() / count;
    let along: f64 = a
        .iter()
        .zip(&b)
        .map(|(a, b)| (a - mean_a) * (a - b - mean))
        .sum();
    let power: f64 = a.iter().map(|a| (a - mean_a).powi(2)).sum();
    let slope = if power > 0.0 { along / power } else { 0.0 };
    let rest = a
        .iter()
        .zip(&b)
        .map(|(a, b)| (a - b - mean - slope * (a - mean_a)).powi(2))
        .sum::<f64>();
    (rest / count).sqrt()
}

/// Drives that keep the limits: name, sampling rate, voltages.
fn drives(limits: &Limits) -> Vec<(&'static str, f64, Vec<f64>)> {
    let range_v = limits.drive_max_v - limits.drive_min_v;
    let usable = [
        range_v,
        limits.slope_max_v_s,
        limits.duration_max_s,
        limits.sample_rate_hz,
    ];
    if usable
        .iter()
        .any(|value| !(value.is_finite() && *value > 0.0))
    {
        return Vec::new();
    }
    let at = |share: f64| limits.drive_min_v + share * range_v;
    let rate_for = |duration_s: f64| (SAMPLES_MAX / duration_s).min(limits.sample_rate_hz);
    // The steepest point of a half cosine of height `range_v` is pi / 2 times its mean slope.
    let rise_s = |rate_hz: f64| {
        (std::f64::consts::FRAC_PI_2 * range_v / limits.slope_max_v_s).max(4.0 / rate_hz)
    };
    let mut out = Vec::new();

    let rate_hz = rate_for(limits.duration_max_s);
    let levels = [0.7, 0.3, 0.9, 0.5, 0.0].map(at);
    let rise = rise_s(rate_hz);
    let held_s = limits.duration_max_s / levels.len() as f64 - 2.0 * rise;
    if held_s > 0.0 {
        let mut parts = Vec::new();
        let mut from = limits.drive_min_v;
        for level in levels {
            parts.push(half_cosines(rate_hz, rise, &[from, level]));
            parts.push(hold(rate_hz, level, held_s));
            from = level;
        }
        out.push((
            "steps of several heights, each held",
            rate_hz,
            concatenate(&parts),
        ));
    }

    let vertices = [
        0.0, 0.4, 0.1, 0.7, 0.3, 0.55, 0.2, 1.0, 0.5, 0.85, 0.4, 0.75, 0.0,
    ]
    .map(at);
    let legs_v: Vec<f64> = vertices.windows(2).map(|v| (v[1] - v[0]).abs()).collect();
    let path_v: f64 = legs_v.iter().sum();
    let shortest_v = legs_v.iter().copied().fold(f64::INFINITY, f64::min);
    for (name, slope_v_s) in [
        (
            "slow triangles with nested reversals",
            path_v / limits.duration_max_s,
        ),
        (
            "fast triangles with nested reversals",
            // A leg has five samples, as half a period of the bursts does.
            (0.5 * limits.slope_max_v_s).min(0.2 * shortest_v * limits.sample_rate_hz),
        ),
    ] {
        let slope_v_s = slope_v_s.max(path_v / limits.duration_max_s);
        let rate_hz = rate_for(path_v / slope_v_s);
        out.push((name, rate_hz, triangles(rate_hz, slope_v_s, &vertices)));
    }

    // Bursts around the middle, as large as the slope allows; the frequencies end where a period has ten
    // samples.
    let rate_hz = limits.sample_rate_hz;
    let approach = half_cosines(rate_hz, rise_s(rate_hz), &[limits.drive_min_v, at(0.5)]);
    let back = half_cosines(rate_hz, rise_s(rate_hz), &[at(0.5), limits.drive_min_v]);
    for (name, share) in [
        ("large sine bursts of rising frequency", 0.45),
        ("small sine bursts of rising frequency", 0.1),
    ] {
        let mut parts = vec![approach.clone()];
        for frequency_hz in [1.0, 5.0, 20.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0] {
            let duration_s = 10.0 / frequency_hz;
            // The window adds a slope of its own, of at most pi / (10 cycles) of the sine's: a tenth of the
            // limit is left for it.
            let amplitude_v = (share * range_v)
                .min(0.9 * limits.slope_max_v_s / (std::f64::consts::TAU * frequency_hz));
            if frequency_hz <= rate_hz / 10.0 && duration_s < limits.duration_max_s / 10.0 {
                parts.push(sine_burst(
                    rate_hz,
                    frequency_hz,
                    amplitude_v,
                    at(0.5),
                    duration_s,
                ));
            }
        }
        parts.push(back.clone());
        parts.push(vec![limits.drive_min_v]);
        out.push((name, rate_hz, concatenate(&parts)));
    }

    out.retain(|(_, rate_hz, drive_v)| {
        let inside = |u: &f64| {
            (limits.drive_min_v - 1e-9 * range_v..=limits.drive_max_v + 1e-9 * range_v).contains(u)
        };
        let slope_v_s = drive_v
            .windows(2)
            .map(|v| (v[1] - v[0]).abs() * rate_hz)
            .fold(0.0, f64::max);
        drive_v.len() > 16
            && drive_v.len() <= samples_in(*rate_hz, limits.duration_max_s) + 16
            && drive_v.iter().all(inside)
            && slope_v_s <= limits.slope_max_v_s * SLOPE_TOLERANCE
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::by_id;

    const LIMITS: Limits = Limits {
        drive_min_v: 0.0,
        drive_max_v: 70.0,
        slope_max_v_s: 40_000.0,
        duration_max_s: 30.0,
        sample_rate_hz: 20_000.0,
    };

    fn model(effects: &[(&str, &[f64])]) -> Model {
        let overview = Overview {
            range_um: 10.0,
            gain_um_v: 0.14,
            ..Overview::without_data(0.0, 70.0)
        };
        let mut model = Model::new(0.0, 70.0);
        for (id, values) in effects {
            let mut instance = EffectInstance::new(by_id(id).unwrap(), &overview, values);
            for (parameter, value) in instance.parameters.iter_mut().zip(values.iter()) {
                parameter.value = *value;
            }
            model.add(instance);
        }
        model
    }

    #[test]
    fn every_drive_keeps_the_limits_and_comes_back() {
        for limits in [
            LIMITS,
            Limits {
                slope_max_v_s: 300.0,
                duration_max_s: 5.0,
                sample_rate_hz: 1000.0,
                drive_min_v: -90.0,
                drive_max_v: 90.0,
            },
            // Data with steps.
            Limits {
                slope_max_v_s: 1.4e6,
                ..LIMITS
            },
        ] {
            let drives = drives(&limits);
            assert!(drives.len() >= 2, "{}", drives.len());
            for (name, rate_hz, drive_v) in drives {
                assert!(drive_v.len() > 100, "{name}: {}", drive_v.len());
                let last = drive_v.last().unwrap();
                assert!(
                    (last - limits.drive_min_v).abs() < 1e-6,
                    "{name} ends at {last} V"
                );
                assert!(
                    drive_v.len() as f64 / rate_hz < 1.05 * limits.duration_max_s,
                    "{name}"
                );
            }
        }
        assert!(
            drives(&Limits {
                duration_max_s: f64::NAN,
                ..LIMITS
            })
            .is_empty()
        );
        assert!(
            drives(&Limits {
                drive_max_v: 0.0,
                ..LIMITS
            })
            .is_empty()
        );
    }

    #[test]
    fn a_slow_effect_is_told_by_holds_and_a_lag_by_fast_drives() {
        let gain: (&str, &[f64]) = ("gain", &[0.14]);
        let plain = model(&[gain]);
        let creep = model(&[gain, ("creep", &[0.0, 0.1, 0.02, 1.0, 0.0, 5.0, 0.0, 10.0])]);
        let held = propose(&plain, &creep, &LIMITS).unwrap();
        assert_eq!(held.drive, "steps of several heights, each held");
        let lag = model(&[gain, ("sensor_bandwidth", &[800.0])]);
        let fast = propose(&plain, &lag, &LIMITS).unwrap();
        assert!(
            fast.drive.contains("fast") || fast.drive.contains("bursts"),
            "{}",
            fast.drive
        );
        assert!(fast.separation_um > 0.01);
        let sentence = fast.sentence("delay", "sensor_bandwidth", Some(0.005));
        assert!(
            sentence.contains("x the noise") && sentence.contains(fast.drive),
            "{sentence}"
        );
    }

    /// Lags in front of and behind a stage without loops commute; behind loops they do not.
    #[test]
    fn what_commutes_is_decided_by_no_drive() {
        let lags = |stage: (&str, &[f64])| {
            ["amplifier_bandwidth", "sensor_bandwidth"].map(|lag| model(&[stage, (lag, &[800.0])]))
        };
        let [amplifier, sensor] = lags(("gain", &[0.14]));
        let straight = propose(&amplifier, &sensor, &LIMITS).unwrap();
        assert!(
            !straight.decides(Some(0.005), 0.001) && straight.decides(None, 0.001),
            "{}",
            straight.separation_um
        );
        let loops: &[f64] = &[10.0, 1.2, -1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let [amplifier, sensor] = lags(("hysteresis", loops));
        let looped = propose(&amplifier, &sensor, &LIMITS).unwrap();
        assert!(
            looped.decides(Some(0.005), 0.001),
            "{}",
            looped.separation_um
        );
        // A drive on which the two differ by less than what is left of the data decides nothing.
        assert!(!looped.decides(Some(0.005), 2.0 * looped.separation_um));
    }

    #[test]
    fn a_mere_gain_cannot_be_told_by_any_drive() {
        let proposal = propose(
            &model(&[("gain", &[0.14])]),
            &model(&[("gain", &[0.15])]),
            &LIMITS,
        )
        .unwrap();
        assert!(proposal.separation_um < 1e-9, "{}", proposal.separation_um);
        assert!(proposal.csv().starts_with("t_s,u_v\n0.0000000,0.000000\n"));
    }
}

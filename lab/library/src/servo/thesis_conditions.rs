//! The thesis' continuous conditions for its schemes, beside the eigenvalues of the sampled loop that decide.

use super::model::NominalModel;
use super::sampled_loop::used_poles;
use super::thesis_schemes::{
    AlphaBeta, ControllerGains, Estimator, ObserverGains, ReachingGains, SlidingModeLaw,
};
use nalgebra::{Complex, DMatrix};
use serde::Serialize;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Roots of a polynomial, coefficients in descending powers, by the eigenvalues of its companion matrix,
/// sorted by real part.
#[must_use]
pub fn roots(coefficients: &[f64]) -> Vec<Complex<f64>> {
    let Some((leading, rest)) = coefficients.split_first() else {
        return Vec::new();
    };
    let n = rest.len();
    if *leading == 0.0 || n == 0 {
        return Vec::new();
    }
    // Scaled to s = scale * p so that the companion matrix is balanced.
    let scale = rest
        .iter()
        .enumerate()
        .map(|(i, c)| (c / leading).abs().powf(1.0 / (i + 1) as f64))
        .fold(0.0, f64::max);
    if scale == 0.0 {
        return vec![Complex::new(0.0, 0.0); n];
    }
    let mut companion = DMatrix::zeros(n, n);
    for (i, c) in rest.iter().enumerate() {
        companion[(0, i)] = -c / leading / scale.powi(i as i32 + 1);
        if i + 1 < n {
            companion[(i + 1, i)] = 1.0;
        }
    }
    let mut out: Vec<Complex<f64>> = companion
        .complex_eigenvalues()
        .iter()
        .map(|z| z * scale)
        .collect();
    // A few Newton steps on the polynomial itself.
    for z in &mut out {
        for _ in 0..3 {
            let (mut value, mut slope) = (Complex::new(0.0, 0.0), Complex::new(0.0, 0.0));
            for c in coefficients {
                slope = slope * *z + value;
                value = value * *z + *c;
            }
            if slope.norm() > 0.0 {
                *z -= value / slope;
            }
        }
    }
    out.sort_by(|x, y| x.re.total_cmp(&y.re).then(x.im.total_cmp(&y.im)));
    out
}

/// Sliding surface parameter of the observer for a constant unknown input: the real root of Ch. 7, Eq. (19);
/// the largest if there are three.
#[must_use]
pub fn sliding_surface_parameter(model: &NominalModel, gains: &ObserverGains) -> f64 {
    let b2 = model.b2();
    roots(&[1.0, model.a22() - b2 * gains.d, b2 * gains.p, -b2 * gains.i])
        .into_iter()
        .filter(|z| z.im.abs() <= 1e-6 * z.norm().max(1.0))
        .map(|z| z.re)
        .fold(f64::NAN, f64::max)
}

/// Roots of Ch. 7, Eq. (21): reachability of the observer's sliding surface.
#[must_use]
pub fn observer_reachability(model: &NominalModel, gains: &ObserverGains) -> Vec<Complex<f64>> {
    let b2 = model.b2();
    roots(&[
        1.0,
        b2 * gains.d + sliding_surface_parameter(model, gains),
        b2 * gains.p,
        b2 * gains.i,
    ])
}

/// Poles of Ch. 7, Eq. (26): the observer itself.
#[must_use]
pub fn observer_poles(model: &NominalModel, gains: &ObserverGains) -> Vec<Complex<f64>> {
    let b2 = model.b2();
    roots(&[1.0, b2 * gains.d - model.a22(), b2 * gains.p, b2 * gains.i])
}

/// Frequency response of Ch. 7, Eq. (26), `G_3 = G_4`.
#[must_use]
pub fn observer_response(
    model: &NominalModel,
    gains: &ObserverGains,
    omega_rad_s: f64,
) -> Complex<f64> {
    let (b2, s) = (model.b2(), Complex::new(0.0, omega_rad_s));
    let numerator = s * s * (b2 * gains.d) + s * (model.a21() + b2 * gains.p) + b2 * gains.i;
    numerator
        / (s * s * s + s * s * (b2 * gains.d - model.a22()) + s * (b2 * gains.p) + b2 * gains.i)
}

/// Cut-off of the observer's `G_3` (Ch. 7, Eq. 26): from where it falls below 3 dB for good, Hz.
#[must_use]
pub fn observer_cutoff_hz(nominal: &NominalModel, gains: &ObserverGains) -> f64 {
    let magnitude = |hz: f64| observer_response(nominal, gains, TAU * hz).norm();
    let highest = 10_000.0;
    let steps = (0..400).map(|i| highest * 0.98_f64.powi(i));
    let mut beyond = highest;
    for hz in steps {
        if magnitude(hz) >= FRAC_1_SQRT_2 {
            // Between here and the step above.
            let (mut low, mut high) = (hz, beyond);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if magnitude(middle) >= FRAC_1_SQRT_2 {
                    low = middle
                } else {
                    high = middle
                }
            }
            return low;
        }
        beyond = hz;
    }
    0.0
}

/// Roots of Ch. 6, 3.2 (Ch. 7, Eq. 30), reachability of the controller's sliding surface, and `-m`, the
/// sliding motion.
#[must_use]
pub fn controller_poles(model: &NominalModel, gains: &ControllerGains) -> Vec<Complex<f64>> {
    let b2 = model.b2();
    let mut out = roots(&[b2 * gains.d + 1.0, b2 * gains.p, b2 * gains.i]);
    out.push(Complex::new(-gains.m, 0.0));
    out
}

/// Poles of Ch. 6, Eqs. (40)-(41): PIDSMC with the continuous alpha-beta filter; `T` is the period of the
/// filter.
#[must_use]
pub fn alpha_beta_loop_poles(
    model: &NominalModel,
    gains: &ControllerGains,
    filter: &AlphaBeta,
    period_s: f64,
) -> Vec<Complex<f64>> {
    let (a21, a22, b2) = (model.a21(), model.a22(), model.b2());
    let (xi, w, t) = (
        filter.damping_ratio,
        filter.natural_frequency_rad_s,
        period_s,
    );
    let ControllerGains { m, p, i, d } = *gains;
    let w2 = w * w;
    roots(&[
        1.0,
        2.0 * xi * w - a22,
        w2 - a21 - 2.0 * a22 * xi * w + b2 * d * w2 + 2.0 * b2 * d * xi * w * m
            - b2 * d * t * m * w2,
        m * w2 + b2 * p * w2 - a21 * t * w2 + b2 * d * m * w2 + 2.0 * b2 * p * xi * w * m
            - b2 * p * t * m * w2,
        b2 * i * w2 + b2 * p * m * w2 + 2.0 * b2 * i * xi * w * m - b2 * i * t * m * w2,
        b2 * i * m * w2,
    ])
}

/// Frequency response of Ch. 7, Eq. (34), `G_6`: displacement per unknown input, um/V.
#[must_use]
pub fn unknown_input_response(
    model: &NominalModel,
    o: &ObserverGains,
    c: &ControllerGains,
    omega_rad_s: f64,
) -> Complex<f64> {
    let (a21, a22, b2, s) = (
        model.a21(),
        model.a22(),
        model.b2(),
        Complex::new(0.0, omega_rad_s),
    );
    let numerator = s * s * s * (1.0 + b2 * c.d)
        + s * s * (c.m + b2 * c.p + b2 * c.d * c.m + b2 * o.d)
        + s * (a21 + b2 * c.p * c.m + b2 * c.i + b2 * o.p)
        + b2 * c.i * c.m
        + b2 * o.i;
    let controller = (s + c.m) * (s * s * (b2 * c.d + 1.0) + s * (b2 * c.p) + b2 * c.i);
    let observer = s * s * s + s * s * (b2 * o.d - a22) + s * (b2 * o.p) + b2 * o.i;
    s * b2 * numerator / (controller * observer)
}

/// Gains in the thesis' units, and what its rules say of them: the cut-off of `G_3` and the attenuation of
/// the unknown input, `G_6`.
#[must_use]
pub fn gains_in_words(
    nominal: &NominalModel,
    estimator: &Estimator,
    controller: &ControllerGains,
    reaching: &ReachingGains,
    reference_hz: f64,
) -> Vec<String> {
    let ControllerGains { m, p, i, d } = *controller;
    let reached = match reaching {
        ReachingGains::Pid if d == 0.0 => format!(
            "P_c = {p:.3e} V s/um, I_c = {i:.3} V/um, D_c = 0 (it would only rescale the others)"
        ),
        ReachingGains::Pid => {
            format!("P_c = {p:.3e} V s/um, I_c = {i:.3} V/um, D_c = {d:.1e} V s^2/um")
        }
        ReachingGains::Switching { eta_v } => format!("eta = {eta_v:.2} V"),
        ReachingGains::BoundaryLayer { eta_v, delta_um_s } => {
            format!("eta = {eta_v:.2} V, delta = {delta_um_s:.0} um/s")
        }
    };
    let estimated = match estimator {
        Estimator::Pidsmo(o) => format!(
            "P_o = {:.2} V/um, I_o = {:.0} V/(um s), D_o = {:.2e} V s/um",
            o.p, o.i, o.d
        ),
        Estimator::AlphaBeta(f) => {
            format!(
                "alpha-beta filter of {:.0} Hz, damping ratio {:.2}",
                f.natural_frequency_rad_s / TAU,
                f.damping_ratio
            )
        }
    };
    let mut out = vec![format!("m_c = {m:.0} 1/s, {reached}; {estimated}.")];
    if let (Estimator::Pidsmo(o), ReachingGains::Pid) = (estimator, reaching) {
        out.push(format!(
            "The observer's G_3 is cut off at {:.0} Hz (Ch. 7, Eq. 26). Of the unknown input {:.2} nm/V get through at {reference_hz:.0} Hz in continuous time (G_6, Ch. 7, Eq. 34).",
            observer_cutoff_hz(nominal, o),
            1e3 * unknown_input_response(nominal, o, controller, TAU * reference_hz).norm()
        ));
    }
    out
}

/// Sampled eigenvalues and the thesis' conditions for a sliding-mode scheme.
#[derive(Clone, Debug, Serialize)]
pub struct SlidingModeCheck {
    /// Largest magnitude of the sampled eigenvalues below one.
    pub stable: bool,
    /// Sampled eigenvalues `[re, im]`.
    pub sampled_poles: Vec<[f64; 2]>,
    /// The thesis' continuous conditions.
    pub continuous: ContinuousConditions,
}

/// The thesis' continuous conditions: they say nothing of delay and sampling.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ContinuousConditions {
    /// Controller: roots of Ch. 7, Eq. (30), and `-m_c`.
    pub controller: Vec<[f64; 2]>,
    /// Observer: poles of Ch. 7, Eq. (26) (empty for a filter).
    pub observer: Vec<[f64; 2]>,
    /// Reachability of the observer's surface: roots of Ch. 7, Eq. (21) (empty for a filter).
    pub reachability: Vec<[f64; 2]>,
    /// Closed loop: Ch. 6, Eqs. (40)-(41) with a filter; observer and controller together with the PIDSMO.
    pub closed_loop: Vec<[f64; 2]>,
    /// Sliding surface parameter `m_o` (Ch. 7, Eq. 19).
    pub m_o: Option<f64>,
    /// All of them in the left half plane.
    pub satisfied: bool,
}

/// Complex numbers as pairs.
#[must_use]
pub fn pairs(values: &[Complex<f64>]) -> Vec<[f64; 2]> {
    values.iter().map(|z| [z.re, z.im]).collect()
}

/// Checks a sliding-mode scheme with PID, with or without the period of delay, against the nominal model.
#[must_use]
pub fn sliding_mode(
    model: &NominalModel,
    estimator: &Estimator,
    gains: &ControllerGains,
    delayed: bool,
) -> SlidingModeCheck {
    let law = SlidingModeLaw::new(model, estimator, gains, &ReachingGains::Pid);
    let eigenvalues = used_poles(&law.closed_loop(model, usize::from(delayed)));
    let controller = controller_poles(model, gains);
    let (observer, reachability, closed_loop, m_o) = match estimator {
        Estimator::Pidsmo(o) => {
            let poles = observer_poles(model, o);
            let all = controller.iter().chain(&poles).copied().collect();
            (
                poles,
                observer_reachability(model, o),
                all,
                Some(sliding_surface_parameter(model, o)),
            )
        }
        Estimator::AlphaBeta(f) => (
            Vec::new(),
            Vec::new(),
            alpha_beta_loop_poles(model, gains, f, super::model::SAMPLING_PERIOD_S),
            None,
        ),
    };
    let satisfied = controller
        .iter()
        .chain(&observer)
        .chain(&reachability)
        .chain(&closed_loop)
        .all(|z| z.re < 0.0)
        && m_o.is_none_or(|m| m > 0.0);
    SlidingModeCheck {
        stable: eigenvalues.iter().all(|z| z.norm() < 1.0),
        sampled_poles: pairs(&eigenvalues),
        continuous: ContinuousConditions {
            controller: pairs(&controller),
            observer: pairs(&observer),
            reachability: pairs(&reachability),
            closed_loop: pairs(&closed_loop),
            m_o,
            satisfied,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL: NominalModel = NominalModel::THESIS;

    fn close(found: &[Complex<f64>], printed: &[(f64, f64)], tolerance: f64) {
        assert_eq!(found.len(), printed.len());
        for (re, im) in printed {
            assert!(
                found
                    .iter()
                    .any(|z| (z.re - re).abs() <= tolerance && (z.im - im).abs() <= tolerance),
                "{re} {im} not in {found:?}"
            );
        }
    }

    #[test]
    fn poles_of_chapter_6() {
        let poles = alpha_beta_loop_poles(
            &MODEL,
            &ControllerGains::THESIS_SLIDING,
            &AlphaBeta::THESIS_CHAPTER_6,
            5e-5,
        );
        close(
            &poles,
            &[
                (-7606.45, 0.0),
                (-1919.21, 5237.84),
                (-1919.21, -5237.84),
                (-1413.45, 0.0),
                (-15.02, 0.0),
            ],
            0.006,
        );
        let poles = alpha_beta_loop_poles(
            &MODEL,
            &ControllerGains::THESIS_CHAPTER_6,
            &AlphaBeta::THESIS_CHAPTER_6,
            5e-5,
        );
        close(
            &poles,
            &[
                (-7779.32, 0.0),
                (-1435.37, 5296.74),
                (-1435.37, -5296.74),
                (-1111.65, 1529.75),
                (-1111.65, -1529.75),
            ],
            0.006,
        );
    }

    /// Discriminant of Ch. 7, Eq. (20): negative means that the sliding surface parameter is unique.
    fn discriminant(model: &NominalModel, gains: &ObserverGains) -> f64 {
        let (b, c, d) = (
            model.a22() - model.b2() * gains.d,
            model.b2() * gains.p,
            -model.b2() * gains.i,
        );
        18.0 * b * c * d - 4.0 * b.powi(3) * d + b * b * c * c - 4.0 * c.powi(3) - 27.0 * d * d
    }

    #[test]
    fn observer_of_chapter_7() {
        let gains = ObserverGains::THESIS_SLIDING;
        assert!((sliding_surface_parameter(&MODEL, &gains) - 502.82).abs() < 0.006);
        assert!(discriminant(&MODEL, &gains) < 0.0);
        // The thesis prints -38.8 +- 5.20e3 i and -429. The roots add up to -(B2 D_o + m_o) = -506.68, so the
        // pair is at -38.79.
        let found = observer_reachability(&MODEL, &gains);
        close(
            &found,
            &[(-38.79, 5193.61), (-38.79, -5193.61), (-429.10, 0.0)],
            0.006,
        );
        let sum: f64 = found.iter().map(|z| z.re).sum();
        assert!((sum + MODEL.b2() * gains.d + 502.82).abs() < 0.006, "{sum}");
    }

    #[test]
    fn responses_of_chapter_7() {
        let response = |g: &ObserverGains, hz: f64| observer_response(&MODEL, g, TAU * hz).norm();
        let estimation = ObserverGains::THESIS_ESTIMATION;
        assert!((response(&estimation, 718.0) - std::f64::consts::FRAC_1_SQRT_2).abs() < 1e-3);
        assert!((1..700).all(|hz| response(&estimation, f64::from(hz)) < 1.01));
        let loop_gains = ObserverGains::THESIS_PIDSMOC;
        let peak = (1..1200)
            .map(|hz| response(&loop_gains, f64::from(hz)))
            .fold(0.0, f64::max);
        assert!((peak - 1.86).abs() < 0.006, "{peak}");
        assert!((response(&loop_gains, 1187.0) - std::f64::consts::FRAC_1_SQRT_2).abs() < 2e-3);
        for (hz, nm) in [
            (1.0, 0.41),
            (10.0, 3.95),
            (50.0, 12.3),
            (100.0, 17.5),
            (150.0, 22.8),
            (300.0, 42.3),
        ] {
            let found = 1e3
                * unknown_input_response(
                    &MODEL,
                    &loop_gains,
                    &ControllerGains::THESIS_PIDSMOC,
                    TAU * hz,
                )
                .norm();
            assert!(
                (found - nm).abs() < 0.006 * nm.max(1.0),
                "{hz} Hz: {found} {nm}"
            );
        }
    }

    #[test]
    fn the_cut_off_is_the_one_of_the_thesis_gains() {
        let cutoff = |gains| observer_cutoff_hz(&NominalModel::THESIS, &gains);
        assert!(
            (cutoff(ObserverGains::THESIS_ESTIMATION) - 718.0).abs() < 1.0,
            "{}",
            cutoff(ObserverGains::THESIS_ESTIMATION)
        );
        assert!((cutoff(ObserverGains::THESIS_PIDSMOC) - 1187.0).abs() < 2.0);
    }

    #[test]
    fn the_thesis_gains_are_unstable_with_a_period_of_delay() {
        let check = |delayed| {
            sliding_mode(
                &MODEL,
                &Estimator::Pidsmo(ObserverGains::THESIS_PIDSMOC),
                &ControllerGains::THESIS_PIDSMOC,
                delayed,
            )
        };
        assert!(check(false).stable);
        assert!(!check(true).stable);
        assert!(check(true).continuous.satisfied);
    }

    #[test]
    fn a_filter_brings_no_pole_of_its_own_at_one() {
        for filter in [
            AlphaBeta::THESIS_CHAPTER_6,
            AlphaBeta {
                discrete: true,
                ..AlphaBeta::THESIS_CHAPTER_6
            },
        ] {
            let found = sliding_mode(
                &MODEL,
                &Estimator::AlphaBeta(filter),
                &ControllerGains::THESIS_CHAPTER_6,
                false,
            );
            assert!(found.stable, "{:?}", found.sampled_poles);
        }
    }
}

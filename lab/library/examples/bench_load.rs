//! The load case of the second bench beside the thesis' printed one: which stiffness of the load's contact
//! gives the printed ratios of loaded to unloaded errors.
//!
//! The thesis' schemes run with its gains and without delay, as it ran them, at 50, 100 and 150 Hz (Ch. 7,
//! Table I). For each stiffness: the ratio of the RMS errors with and without load, and how far their
//! logarithms are from the printed ones in the mean.
//!
//! ```text
//! cargo run --release -p hysteron --example bench_load -- [STIFFNESS_N_M ...]
//! ```

use hysteron::servo::design::{ServoDesign, thesis_scheme};
use hysteron::servo::model::{ActuatorModel, LinearModel, ModeModel};
use hysteron_sim::bench::{Bench, Variant};
use hysteron_sim::closed_loop::Experiment;
use hysteron_sim::waveform;

/// Printed RMS errors (Ch. 7, Table I) without and with load, um, at 50, 100 and 150 Hz.
const PRINTED: [(&str, [f64; 3], [f64; 3]); 2] = [
    ("pidsmoc", [0.051, 0.086, 0.138], [0.054, 0.101, 0.150]),
    (
        "pidsmc-alpha-beta",
        [0.094, 0.196, 0.329],
        [0.148, 0.250, 0.342],
    ),
];
const FREQUENCIES_HZ: [f64; 3] = [50.0, 100.0, 150.0];

/// A scheme of the thesis needs no model; only the limits of the drive are read.
fn design(bench: &Bench, scheme: &str) -> ServoDesign {
    let first_mode = ModeModel {
        natural_frequency_rad_s: 5352.0,
        damping_ratio: 0.7876,
    };
    let model = ActuatorModel {
        drive_min_v: bench.drive_min_v,
        drive_max_v: bench.drive_max_v,
        g_um: vec![vec![0.0, -10.0], vec![10.0, 0.0]],
        r_um: vec![0.0],
        linear: LinearModel {
            first_mode,
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        },
        creep: Vec::new(),
        creep_pair: None,
    };
    ServoDesign::new(
        thesis_scheme(scheme).expect("a scheme of the thesis"),
        &model,
        false,
    )
}

fn error_um(bench: &Bench, scheme: &str, frequency_hz: f64, loaded: bool) -> f64 {
    let fs = bench.converters.sample_rate_hz;
    let mut reference = waveform::sine(
        fs,
        frequency_hz,
        5.0,
        bench.reference_offset_um,
        -std::f64::consts::FRAC_PI_2,
        0.7,
    );
    waveform::grow_from_zero(&mut reference, fs);
    let variant = Variant {
        loaded,
        ..Variant::PLAIN
    };
    let parameters = design(bench, scheme)
        .parameters(bench.converter_scale().parameters())
        .expect("the printed gains fit");
    let experiment = Experiment {
        substeps: 10,
        ..Experiment::new(bench, variant, 5)
    };
    experiment
        .follow(&parameters, &reference)
        .true_error(waveform::samples_in(fs, 0.4))
        .rms_um
}

fn main() {
    let given: Vec<f64> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let stiffnesses = if given.is_empty() {
        vec![3e6, 5e6, 1e7, 3e7, 1e9]
    } else {
        given
    };
    let bench = Bench::domains().expect("the bench's file");
    println!(
        "{:>10} {:<18} {:>24} {:>24} {:>24}",
        "N/m", "scheme", "50 Hz", "100 Hz", "150 Hz"
    );
    for stiffness in stiffnesses {
        let mut loaded = bench.clone();
        if let Some(domains) = &mut loaded.domains {
            domains.structure.load_contact_n_m = stiffness;
        }
        let mut miss = 0.0;
        for (scheme, without, with) in PRINTED {
            let mut cells = String::new();
            for (k, hz) in FREQUENCIES_HZ.iter().enumerate() {
                let (bare_um, loaded_um) = (
                    error_um(&bench, scheme, *hz, false),
                    error_um(&loaded, scheme, *hz, true),
                );
                let (ratio, printed) = (loaded_um / bare_um, with[k] / without[k]);
                miss += (ratio / printed).ln().powi(2) / 6.0;
                cells.push_str(&format!(
                    " {:>7.0}/{:>5.0} {ratio:>5.2} ({printed:.2})",
                    1e3 * loaded_um,
                    1e3 * bare_um
                ));
            }
            println!("{stiffness:>10.1e} {scheme:<18}{cells}");
        }
        println!(
            "{stiffness:>10.1e} mean distance of the logarithms {:.3}",
            miss.sqrt()
        );
    }
}

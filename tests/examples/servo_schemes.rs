//! Every scheme that a design chooses among, on stages that the simulation does not share: prints the tables
//! that belong to `docs/reference/servo_schemes.md`.
//!
//!     cargo run --release -p hysteron-tests --example servo_schemes [STAGES [FIRST_SEED]]
//!
//! Each stage is recorded with the multisine that a design recommends and identified once with a fixed set of
//! effects; every scheme is designed from that model and that recording.

use hysteron::model_file::effects_named;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::schemes::SchemeChoice;
use hysteron::watch::Unwatched;
use hysteron_tests::independent_stage::{StageChange, StageTruth};
use hysteron_tests::servo_study::{FREQUENCIES_HZ, StudyRecording, at_work, record};

/// Schemes with and without the hysteresis inverted.
const SCHEMES: [(SchemeChoice, bool); 7] = [
    (SchemeChoice::Predictor, true),
    (SchemeChoice::Pidsmoc, true),
    (SchemeChoice::PidsmcAlphaBeta, true),
    (SchemeChoice::Pidsmoc, false),
    (SchemeChoice::PidsmcAlphaBeta, false),
    (SchemeChoice::Smcbl, true),
    (SchemeChoice::Pid, true),
];

/// From here on the PIDSMOC has to be better than PIDSMC with the alpha-beta filter, Hz.
const FAST_HZ: f64 = 50.0;

fn main() {
    let numbers: Vec<u64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let (stages, first) = (numbers.first().copied().unwrap_or(24), numbers.get(1).copied().unwrap_or(100));
    let name = |(choice, inverse): (SchemeChoice, bool)| format!("{}{}", choice.name(), if inverse { "" } else { ", no inverse" });
    println!("RMS error of the true position in nm at {} Hz", FREQUENCIES_HZ.map(|hz| hz.to_string()).join(" / "));
    println!("| stage | first mode | noise, nm | {} |", SCHEMES.map(name).join(" | "));
    println!("|---|---|---|{}", "---|".repeat(SCHEMES.len()));
    let (mut unstable, mut refused, mut worse) = ([0; SCHEMES.len()], [0; SCHEMES.len()], Vec::new());
    for seed in first..first + stages {
        let truth = StageTruth::drawn(seed);
        let dataset = record(&truth, StudyRecording::Wideband);
        let effects = effects_named("hysteresis,initial_curve,vibration,second_mode,creep").expect("known effects");
        let chain = hysteron::identify::identify(&dataset, &effects, &Unwatched).expect("finite").model;
        let mut cells = Vec::new();
        let mut errors = Vec::new();
        for (nth, (scheme, inverse)) in SCHEMES.into_iter().enumerate() {
            let order = DesignOrder { recording: Some(&dataset), scheme, inverse, usual_margins: false, ..DesignOrder::default() };
            match order::design(&chain, &order) {
                Err(reason) => {
                    refused[nth] += 1;
                    eprintln!("{seed} {}: {reason}", name((scheme, inverse)));
                    cells.push("refused".to_owned());
                    errors.push(None);
                }
                Ok(design) => {
                    let work = at_work(&truth, StageChange::NONE, &design);
                    let nm = work.errors.iter().map(|e| format!("{:.1}", 1e3 * e.rms_um)).collect::<Vec<_>>().join(" / ");
                    unstable[nth] += u32::from(work.unstable);
                    cells.push(format!("{nm}{}", if work.unstable { " UNSTABLE" } else { "" }));
                    errors.push(Some(work.errors));
                }
            }
        }
        for (pidsmoc, filter) in [(1, 2), (3, 4)] {
            let (Some(ours), Some(theirs)) = (&errors[pidsmoc], &errors[filter]) else { continue };
            for ((hz, ours), theirs) in FREQUENCIES_HZ.iter().zip(ours).zip(theirs).filter(|((hz, _), _)| **hz >= FAST_HZ) {
                if ours.rms_um >= theirs.rms_um {
                    worse.push(format!("stage {seed}, {hz} Hz, {}", name(SCHEMES[pidsmoc])));
                }
            }
        }
        println!(
            "| {seed} | {:.0} Hz, {:.3} | {:.1} | {} |",
            truth.first_mode.frequency_hz,
            truth.first_mode.damping_ratio,
            1e3 * truth.noise_um,
            cells.join(" | ")
        );
    }
    println!();
    for (nth, scheme) in SCHEMES.into_iter().enumerate() {
        let stable = stages as u32 - refused[nth] - unstable[nth];
        println!("{}: {stable} stable, {} refused, {} unstable", name(scheme), refused[nth], unstable[nth]);
    }
    println!(
        "PIDSMOC not better than PIDSMC with the alpha-beta filter at {FAST_HZ} Hz and above: {}",
        if worse.is_empty() { "nowhere".into() } else { worse.join("; ") }
    );
}

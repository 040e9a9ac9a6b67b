//! Every scheme that a design chooses among, on stages that the simulation does not share: prints the tables
//! that belong to `docs/reference/servo_schemes.md`.
//!
//!     cargo run --release --workspace --example servo_schemes -- [STAGES [FIRST_SEED]] [--csv FILE]
//!
//! Each stage is recorded with the multisine that a design recommends and identified once with a fixed set of
//! effects; every scheme is designed from that model and that recording.

use hysteron::model_file::effects_named;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::scheme_choice::SchemeChoice;
use hysteron::watch::Unwatched;
use hysteron_tests::independent_stage::{StageChange, StageTruth};
use hysteron_tests::servo_study::{FREQUENCIES_HZ, StudyRecording, at_work, record};
use std::fmt::Write as _;
use std::process::ExitCode;

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

/// RMS errors of the true position by frequency, um, and whether the loop is unstable; none where refused.
type Answer = Option<([f64; FREQUENCIES_HZ.len()], bool)>;

fn name((choice, inverse): (SchemeChoice, bool)) -> String {
    format!(
        "{}{}",
        choice.name(),
        if inverse { "" } else { ", no inverse" }
    )
}

/// What each scheme does on a stage; refusals are printed with their reasons.
fn answers(truth: &StageTruth, seed: u64) -> [Answer; SCHEMES.len()] {
    let dataset = record(truth, StudyRecording::Wideband);
    let effects = effects_named("hysteresis,initial_curve,vibration,second_mode,creep")
        .expect("known effects");
    let chain = hysteron::identify::identify(&dataset, &effects, &Unwatched)
        .expect("finite")
        .model;
    SCHEMES.map(|(scheme, inverse)| {
        let order = DesignOrder {
            recording: Some(&dataset),
            scheme,
            inverse,
            usual_margins: false,
            ..DesignOrder::default()
        };
        match order::design(&chain, &order) {
            Err(reason) => {
                eprintln!("{seed} {}: {reason}", name((scheme, inverse)));
                None
            }
            Ok(design) => {
                let work = at_work(truth, StageChange::NONE, &design);
                Some((
                    std::array::from_fn(|f| work.errors[f].rms_um),
                    work.unstable,
                ))
            }
        }
    })
}

fn in_words(answer: &Answer) -> String {
    answer.map_or("refused".into(), |(errors, unstable)| {
        let nm = errors.map(|um| format!("{:.1}", 1e3 * um)).join(" / ");
        format!("{nm}{}", if unstable { " UNSTABLE" } else { "" })
    })
}

/// The middle of some errors, um.
fn median(mut errors: Vec<f64>) -> Option<f64> {
    errors.sort_by(f64::total_cmp);
    errors.get(errors.len() / 2).copied()
}

/// A row for each scheme: how many stages it controls, and the middle of its errors there.
fn summary(stages: &[[Answer; SCHEMES.len()]]) -> String {
    let at = FREQUENCIES_HZ
        .map(|hz| format!("median_nm_at_{hz}_hz"))
        .join(",");
    let mut out = format!("scheme,stages,stable,refused,unstable,{at}\n");
    for (nth, scheme) in SCHEMES.into_iter().enumerate() {
        let of_scheme: Vec<&Answer> = stages.iter().map(|answers| &answers[nth]).collect();
        let stable: Vec<[f64; FREQUENCIES_HZ.len()]> = of_scheme
            .iter()
            .filter_map(|a| a.filter(|a| !a.1))
            .map(|a| a.0)
            .collect();
        let refused = of_scheme.iter().filter(|answer| answer.is_none()).count();
        let medians: [String; FREQUENCIES_HZ.len()] = std::array::from_fn(|f| {
            median(stable.iter().map(|errors| errors[f]).collect())
                .map_or(String::new(), |um| format!("{:.1}", 1e3 * um))
        });
        let unstable = of_scheme.len() - refused - stable.len();
        let _ = writeln!(
            out,
            "\"{}\",{},{},{refused},{unstable},{}",
            name(scheme),
            of_scheme.len(),
            stable.len(),
            medians.join(",")
        );
    }
    out
}

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let csv = match arguments.iter().position(|argument| argument == "--csv") {
        Some(at) if at + 1 < arguments.len() => arguments.drain(at..at + 2).next_back(),
        _ => None,
    };
    let numbers: Option<Vec<u64>> = arguments
        .iter()
        .map(|argument| argument.parse().ok())
        .collect();
    let Some(numbers) = numbers.filter(|numbers| numbers.len() <= 2) else {
        eprintln!(
            "expected [STAGES [FIRST_SEED]] [--csv FILE], found {}",
            arguments.join(" ")
        );
        return ExitCode::from(2);
    };
    let (stages, first) = (
        numbers.first().copied().unwrap_or(24),
        numbers.get(1).copied().unwrap_or(100),
    );
    println!(
        "RMS error of the true position in nm at {} Hz",
        FREQUENCIES_HZ.map(|hz| hz.to_string()).join(" / ")
    );
    println!(
        "| stage | first mode | noise, nm | {} |",
        SCHEMES.map(name).join(" | ")
    );
    println!("|---|---|---|{}", "---|".repeat(SCHEMES.len()));
    let (mut all, mut worse) = (Vec::new(), Vec::new());
    for seed in first..first + stages {
        let truth = StageTruth::drawn(seed);
        let answers = answers(&truth, seed);
        for (pidsmoc, filter) in [(1, 2), (3, 4)] {
            let (Some((ours, _)), Some((theirs, _))) = (&answers[pidsmoc], &answers[filter]) else {
                continue;
            };
            for ((hz, ours), theirs) in FREQUENCIES_HZ
                .iter()
                .zip(ours)
                .zip(theirs)
                .filter(|((hz, _), _)| **hz >= FAST_HZ)
            {
                if ours >= theirs {
                    worse.push(format!("stage {seed}, {hz} Hz, {}", name(SCHEMES[pidsmoc])));
                }
            }
        }
        println!(
            "| {seed} | {:.0} Hz, {:.3} | {:.1} | {} |",
            truth.first_mode.frequency_hz,
            truth.first_mode.damping_ratio,
            1e3 * truth.noise_um,
            answers.each_ref().map(in_words).join(" | ")
        );
        all.push(answers);
    }
    let summary = summary(&all);
    println!("\n{summary}");
    println!(
        "PIDSMOC not better than PIDSMC with the alpha-beta filter at {FAST_HZ} Hz and above: {}",
        if worse.is_empty() {
            "nowhere".into()
        } else {
            worse.join("; ")
        }
    );
    if let Some(file) = csv
        && let Err(error) = std::fs::write(&file, summary)
    {
        eprintln!("{file}: {error}");
        return ExitCode::from(2);
    }
    ExitCode::SUCCESS
}

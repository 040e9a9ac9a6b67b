//! From three kinds of recording to a servo at work on stages that the simulation does not share: prints the
//! table that belongs to `docs/results/servo_from_data.md`.
//!
//!     cargo run --release --workspace --example servo_from_data [STAGES [FIRST_SEED]]
//!
//! Models are kept in target/servo_from_data and used again: a design is then judged in seconds. Delete them
//! to identify anew.

use hysteron_research::stages_asked_for;
use hysteron_tests::independent_stage::{StageChange, StageTruth};
use hysteron_tests::servo_study::{
    FREQUENCIES_HZ, StudyAtWork, StudyRecording, at_work, designed, designed_with_the_truth,
    kept_model, record,
};

fn nm(work: &StudyAtWork) -> String {
    work.errors
        .iter()
        .map(|e| format!("{:.1}", 1e3 * e.rms_um))
        .collect::<Vec<_>>()
        .join(" / ")
}

/// A figure that is the largest so far, and where it was found.
#[derive(Default)]
struct Largest {
    value: f64,
    place: String,
}

impl Largest {
    fn take(&mut self, value: f64, place: impl FnOnce() -> String) {
        if value > self.value {
            *self = Self {
                value,
                place: place(),
            };
        }
    }
}

fn main() {
    println!(
        "| stage | first mode | second mode | noise, nm | best with the truth, nm | usual | target's own | wideband |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let (mut stable, mut refused, mut unstable) = (0, 0, 0);
    // Of each kind of recording, nm; and of the wideband one over the best with the truth.
    let mut errors_nm: [Largest; StudyRecording::ALL.len()] = Default::default();
    let mut ratio = Largest::default();
    for seed in stages_asked_for() {
        let truth = StageTruth::drawn(seed);
        let second = truth.second_mode.expect("has one");
        let mut cells = Vec::new();
        let mut best = String::new();
        for (recording, error_nm) in StudyRecording::ALL.into_iter().zip(&mut errors_nm) {
            let mut wideband = None;
            let dataset = record(&truth, recording);
            let chain = kept_model(&truth, recording, &dataset);
            let cell = match designed(&chain, &dataset) {
                Err(reason) => {
                    refused += 1;
                    eprintln!("{seed} {}: {reason}", recording.name());
                    "refused".into()
                }
                Ok(design) => {
                    let work = at_work(&truth, StageChange::NONE, &design);
                    *(if work.unstable {
                        &mut unstable
                    } else {
                        &mut stable
                    }) += 1;
                    eprintln!(
                        "{seed} {}: {}",
                        recording.name(),
                        design.explanation.join(" ")
                    );
                    for (hz, error) in FREQUENCIES_HZ.iter().zip(&work.errors) {
                        error_nm.take(1e3 * error.rms_um, || format!("stage {seed} at {hz} Hz"));
                    }
                    let cell = format!(
                        "{}{}",
                        nm(&work),
                        if work.unstable { " UNSTABLE" } else { "" }
                    );
                    wideband = Some(work);
                    cell
                }
            };
            cells.push(cell);
            if recording == StudyRecording::Wideband {
                let known = designed_with_the_truth(&truth, &chain)
                    .map(|d| at_work(&truth, StageChange::NONE, &d));
                if let (Some(known), Some(work)) = (&known, &wideband) {
                    for ((hz, of_work), of_known) in
                        FREQUENCIES_HZ.iter().zip(&work.errors).zip(&known.errors)
                    {
                        ratio.take(of_work.rms_um / of_known.rms_um, || {
                            format!("stage {seed} at {hz} Hz")
                        });
                    }
                }
                best = known.as_ref().map_or("none".into(), nm);
            }
        }
        println!(
            "| {seed} | {:.0} Hz, {:.3} | {:.0} Hz, {:.3}, {:.1} % | {:.1} | {best} | {} |",
            truth.first_mode.frequency_hz,
            truth.first_mode.damping_ratio,
            second.frequency_hz,
            second.damping_ratio,
            100.0 * second.share,
            1e3 * truth.noise_um,
            cells.join(" | ")
        );
    }
    println!("\n{stable} stable, {refused} refused, {unstable} unstable");
    for (recording, largest) in StudyRecording::ALL.iter().zip(&errors_nm) {
        println!(
            "{}: at most {:.1} nm ({})",
            recording.name(),
            largest.value,
            largest.place
        );
    }
    println!(
        "wideband over the best with the truth: at most {:.2} ({})",
        ratio.value, ratio.place
    );
}

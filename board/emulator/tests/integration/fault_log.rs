//! The log of faults outlives the supply.

use crate::common;

use common::{best_parameters, block, run_on, typed_back, world};
use hysteron_core::firmware_update::H743ZI;
use hysteron_core::guard::Fault;
use hysteron_core::kept_events::{Event, record};
use hysteron_emulator::board::SafetyLine;
use hysteron_emulator::run::{Injection, MILLISECOND, Outcome, Script};

/// Where the records stand: half of the journal's sector.
const RECORDS: u64 = (H743ZI.journal + H743ZI.sector_bytes / 2) as u64;
const PLACES: u32 = H743ZI.sector_bytes / 2 / 32;

/// The interlock opens for 20 ms at these instants, ms; the supply fails at `lost_ms`. The log half a second
/// later, the newest fault first.
fn log_behind_a_loss(
    flash: Vec<(u64, Vec<u8>)>,
    opens_ms: &[u64],
    lost_ms: u64,
) -> (Vec<String>, Outcome) {
    let line = |closed| Injection::Line {
        line: SafetyLine::Interlock,
        closed,
    };
    let injections = opens_ms
        .iter()
        .flat_map(|ms| [(*ms, line(false)), (ms + 20, line(true))])
        .chain([(lost_ms, Injection::SupplyLost)]);
    let script = Script {
        block: Some(block(&best_parameters())),
        flash,
        serial: opens_ms
            .iter()
            .map(|ms| ((ms + 200) * MILLISECOND, b"INI 1\n".to_vec()))
            .chain([((lost_ms + 200) * MILLISECOND, b"LOG?\n".to_vec())])
            .collect(),
        injections: injections
            .map(|(ms, injection)| (ms * MILLISECOND, injection))
            .collect(),
        peeks: vec![((lost_ms - 1) * MILLISECOND, RECORDS + 64 * 32)],
        ..Script::listening((lost_ms + 500) * MILLISECOND)
    };
    let outcome = run_on(&world(), script);
    let log = typed_back(&outcome)
        .lines()
        .filter(|line| line.trim_start().starts_with("START="))
        .map(|line| line.trim().to_string())
        .collect();
    (log, outcome)
}

#[test]
fn faults_are_kept_over_a_loss_of_the_supply() {
    let (log, outcome) = log_behind_a_loss(Vec::new(), &[60, 400], 900);
    assert_eq!((outcome.resets, log.len()), (1, 2), "{log:?}");
    let tick = |line: &String| -> u32 {
        line.split(['=', ' '])
            .nth(3)
            .and_then(|tick| tick.parse().ok())
            .unwrap_or(0)
    };
    // The ticks begin some milliseconds behind the start, 20 of them in each.
    for (line, ms) in log.iter().zip([400, 60]) {
        assert!(
            line.starts_with("START=1 ") && line.contains("FAULT=14 "),
            "{log:?}"
        );
        assert!(
            (ms * 20 - 400..=ms * 20 + 2).contains(&tick(line)),
            "{log:?}"
        );
    }
}

#[test]
fn a_full_log_is_erased_at_rest_and_the_newest_are_written_again() {
    let full = (0..PLACES)
        .flat_map(|number| {
            record(
                number,
                Event {
                    start: 7,
                    tick: number,
                    fault: Fault::SensorStuck as u32,
                },
            )
        })
        .collect();
    let (log, outcome) = log_behind_a_loss(vec![(RECORDS, full)], &[60], 4_000);
    assert_eq!(log.len(), 64, "{log:?}");
    assert!(
        log[0].starts_with("START=8 ") && log[0].contains("FAULT=14 "),
        "{log:?}"
    );
    // 63 of the old ones stand behind it.
    assert!(
        log[63].starts_with(&format!("START=7 TICK={} ", PLACES - 63)),
        "{log:?}"
    );
    assert_eq!(outcome.peeked, [0xFFFF_FFFF], "place 64 is free again");
}

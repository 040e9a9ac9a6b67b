//! Loops that stop being stable while they are closed: another load, another gain, a filter that takes the
//! phase away, behind amplifiers of different current limits. Each must be a fault within 20 ms.

mod plant;

use hysteron_core::amplifier::{Amplifier, Mode};
use hysteron_core::amplifier_command::Command;
use hysteron_core::filter_design::{FilterSetting, Notch};
use hysteron_core::guard::Fault;
use hysteron_core::reference_generator::Waveform;
use hysteron_core::signal::Micrometres;
use hysteron_core::signal_filter::{FilteredSignal, Place};
use plant::{Bench, Dice, LIMIT_UM, RATE_HZ, parameters};
use std::collections::BTreeMap;

/// What a changed loop came to.
struct Swing {
    fault: Option<Fault>,
    /// From the first error beyond the limit to the fault, s.
    stopped_after_s: f64,
    /// Largest error of the last 0.3 s where the loop is still closed, um.
    last_um: f64,
}

/// Closes the loop on the stage of the block and changes it once it has settled.
fn run(current_a: f64, seed: u64) -> Swing {
    let parameters = parameters();
    let mut dice = Dice(seed * 7919 + 17);
    (0..8).for_each(|_| _ = dice.share());
    let mut bench = Bench::new(current_a, seed);
    let mut amplifier = Amplifier::new(parameters);
    amplifier
        .command(Command::Arm { tested: false })
        .expect("at rest");
    for command in [
        Command::RequireConditioning(false),
        Command::Hold {
            drive: Some(hysteron_core::signal::Volts::from_num(30)),
        },
    ] {
        amplifier.command(command).expect("accepted");
    }
    let tick = |amplifier: &mut Amplifier, bench: &mut Bench| {
        let sample = amplifier.tick(Some(bench.reading()), false);
        bench.advance(sample.dac_code);
        bench.position_um
    };
    for _ in 0..6_000 {
        tick(&mut amplifier, &mut bench);
    }
    let aim_um = f64::from(
        amplifier
            .parameters()
            .servo
            .converters
            .position(bench.reading()),
    ) / 2f64.powi(24);
    let stay = Command::Reference {
        waveform: Waveform::Constant,
        offset: Micrometres::from_num(aim_um),
    };
    amplifier.command(stay).expect("within the range");
    amplifier.command(Command::Enable).expect("armed");
    for _ in 0..4_000 {
        tick(&mut amplifier, &mut bench);
    }
    assert_eq!(amplifier.mode(), Mode::Closed, "{:?}", amplifier.fault());

    let kind = seed % 4;
    if kind != 3 && kind != 0 {
        bench.gain_um_v *= dice.decades(0.7, 1.8);
        bench.natural_rad_s *= dice.decades(0.6, 1.1);
        bench.damping *= dice.decades(0.01, 2.0);
    }
    if kind != 3 && kind != 1 {
        let hz = |hz: f64| (hz * 1000.0) as u32;
        let filter = FilterSetting {
            notches: [
                Notch {
                    frequency_millihertz: hz(dice.decades(20.0, 3_000.0)),
                    width_millihertz: hz(dice.decades(3.0, 2_000.0)),
                },
                Notch::OFF,
            ],
            low_pass_millihertz: hz(dice.decades(20.0, 8_000.0)),
        };
        for place in [Place::Notch1, Place::LowPass] {
            let row = filter.row(place, RATE_HZ).expect("a filter");
            amplifier.set_filter(FilteredSignal::Sensor, place, &row);
        }
    }
    // An error that stays within its limit for the guard's time does not belong to a swing yet.
    let (mut first, mut quiet, mut last_um) = (None, 0, 0.0f64);
    for k in 0..20_000u32 {
        let error_um = (tick(&mut amplifier, &mut bench) - aim_um).abs();
        if amplifier.mode() == Mode::Fault {
            let from = first.unwrap_or(k);
            return Swing {
                fault: amplifier.fault(),
                stopped_after_s: f64::from(k - from) / f64::from(RATE_HZ),
                last_um: 0.0,
            };
        }
        if error_um > LIMIT_UM {
            first.get_or_insert(k);
            quiet = 0;
        } else {
            quiet += 1;
            first = first.filter(|_| quiet <= parameters.guard.tracking_ticks);
        }
        if k >= 14_000 {
            last_um = last_um.max(error_um);
        }
    }
    Swing {
        fault: None,
        stopped_after_s: 0.0,
        last_um,
    }
}

#[test]
fn a_loop_that_swings_is_stopped_within_20_ms() {
    let mut stopped = 0;
    for current_a in [0.02, 0.06, 0.2] {
        let (mut faults, mut worst_s, mut left_um) = (BTreeMap::new(), 0.0f64, 0.0f64);
        for seed in 0..100 {
            let swing = run(current_a, seed);
            if let Some(fault) = swing.fault {
                *faults.entry(fault.name()).or_insert(0) += 1;
                stopped += 1;
            }
            worst_s = worst_s.max(swing.stopped_after_s);
            left_um = left_um.max(swing.last_um);
        }
        println!(
            "{} mA: {faults:?} of 100; at most {:.1} ms; largest error of what goes on {left_um:.3} um",
            current_a * 1e3,
            worst_s * 1e3
        );
        assert!(worst_s <= 0.02, "{worst_s}");
        assert!(left_um <= LIMIT_UM, "{left_um}");
    }
    assert!(stopped > 100, "{stopped}: too few of them swung");
}

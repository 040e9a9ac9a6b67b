//! An adversary in front of the amplifier: commands, filters, blocks, loads and troubles of the sensor in any
//! order. Whatever it does, the drive keeps its limits, moves only where somebody asked for it, never swings,
//! and every stop has a name.

mod plant;

use hysteron_core::amplifier::{Amplifier, Command, ENDLESS_TICKS, Mode};
use hysteron_core::codes::SensorCode;
use hysteron_core::filter_design::{FilterSetting, Notch};
use hysteron_core::guard::Fault;
use hysteron_core::reference_generator::Waveform;
use hysteron_core::signal::{Micrometres, Volts};
use hysteron_core::signal_filter::{FilteredSignal, Place};
use plant::{Bench, Dice, LIMIT_UM, RATE_HZ, parameters};
use std::collections::BTreeMap;

/// What the sensor gives instead of its reading.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trouble {
    None,
    Silent,
    Stuck,
    Shifted,
    Railed,
}

fn micrometres(dice: &mut Dice, low: f64, high: f64) -> Micrometres {
    Micrometres::from_num(dice.within(low, high))
}

fn volts(dice: &mut Dice, low: f64, high: f64) -> Volts {
    Volts::from_num(dice.within(low, high))
}

fn command(dice: &mut Dice) -> Command {
    let increment = |hz: f64| (hz / f64::from(RATE_HZ) * 2f64.powi(32)) as u32;
    let ticks = dice.decades(1.0, 60_000.0) as u32;
    match dice.within(0.0, 17.0) as u32 {
        0 | 1 => Command::Enable,
        2 => Command::Disable,
        3 => Command::Disarm,
        4 => Command::Arm { tested: true },
        5 | 6 => Command::Arm { tested: false },
        7 | 8 => Command::Clear,
        9 => Command::RequireConditioning(dice.share() < 0.3),
        10 => Command::Condition {
            cycle_ticks: ticks,
            rest_ticks: 1_200,
        },
        11 => Command::Hold {
            drive: (dice.share() < 0.8).then(|| volts(dice, -20.0, 120.0)),
        },
        12 => Command::Play {
            waveform: Waveform::Multisine {
                tones: std::array::from_fn(|_| {
                    let hz = dice.decades(0.5, 400.0);
                    (increment(hz), volts(dice, 0.0, 12.0), 0)
                }),
            },
            offset: volts(dice, 10.0, 60.0),
            ticks: if dice.share() < 0.1 {
                ENDLESS_TICKS
            } else {
                ticks
            },
        },
        13 => Command::Identify { ticks },
        14 => Command::Reference {
            waveform: Waveform::QuasiStep {
                height: micrometres(dice, -4.0, 4.0),
                delay_ticks: 0,
                duration_ticks: ticks,
            },
            offset: micrometres(dice, 0.0, 9.0),
        },
        15 => Command::Reference {
            waveform: Waveform::Constant,
            offset: micrometres(dice, -2.0, 12.0),
        },
        _ => Command::Reference {
            waveform: Waveform::Multisine {
                tones: std::array::from_fn(|_| {
                    let hz = dice.decades(0.5, 150.0);
                    (increment(hz), micrometres(dice, 0.0, 1.0), 0)
                }),
            },
            offset: micrometres(dice, 3.0, 7.0),
        },
    }
}

/// What brings the amplifier one step nearer to a closed loop, where most can go wrong.
fn next_step(dice: &mut Dice, amplifier: &Amplifier) -> Command {
    match amplifier.mode() {
        Mode::Fault => Command::Clear,
        _ if !amplifier.armed() => Command::Arm {
            tested: dice.share() < 0.1,
        },
        _ if amplifier.conditioning_required() && !amplifier.conditioned() => {
            Command::RequireConditioning(false)
        }
        Mode::Rest => Command::Hold {
            drive: Some(volts(dice, 10.0, 60.0)),
        },
        Mode::Playing => Command::Enable,
        Mode::Closed => Command::Reference {
            waveform: Waveform::QuasiStep {
                height: micrometres(dice, -3.0, 3.0),
                delay_ticks: 0,
                duration_ticks: dice.decades(100.0, 10_000.0) as u32,
            },
            offset: Micrometres::from_bits(amplifier.servo().reference().to_bits()),
        },
    }
}

fn filter(dice: &mut Dice, amplifier: &mut Amplifier) {
    let millihertz = |hz: f64| (hz * 1000.0) as u32;
    let setting = FilterSetting {
        notches: [
            Notch {
                frequency_millihertz: millihertz(dice.decades(10.0, 8_000.0)),
                width_millihertz: millihertz(dice.decades(1.0, 2_000.0)),
            },
            Notch::OFF,
        ],
        low_pass_millihertz: millihertz(dice.decades(10.0, 8_000.0)),
    };
    let setting = if dice.share() < 0.5 {
        FilterSetting::OFF
    } else {
        setting
    };
    let signal = if dice.share() < 0.5 {
        FilteredSignal::SetPoint
    } else {
        FilteredSignal::Sensor
    };
    let place = if dice.share() < 0.5 {
        Place::Notch1
    } else {
        Place::LowPass
    };
    let row = setting.row(place, RATE_HZ).expect("a filter");
    let _ = amplifier.command(Command::Filter { signal, place, row });
}

/// Runs the adversary for so many ticks; which faults it provoked, and how many ticks the loop was closed.
fn run(seed: u64, ticks: u32) -> (BTreeMap<&'static str, u32>, u32) {
    let block = parameters();
    let c = block.servo.converters;
    let rest = block.guard.rest_code;
    let mut dice = Dice(seed);
    let mut bench = Bench::new(dice.decades(0.02, 0.2), seed);
    let healthy = (bench.gain_um_v, bench.natural_rad_s, bench.damping);
    let mut amplifier = Amplifier::new(block);
    let (mut trouble, mut until, mut last_reading) = (Trouble::None, 0, SensorCode::new(0));
    let (mut faults, mut closed) = (BTreeMap::new(), 0);
    let (mut code, mut was, mut next_action) = (rest, None::<Fault>, 0);
    // A spell of large errors, and for how long they have been small.
    let (mut spell, mut quiet) = (None, 0u32);
    // Nobody has asked for a motion since the amplifier came to rest or was stopped.
    let mut is_asked = false;
    for tick in 0..ticks {
        if tick >= until {
            trouble = Trouble::None;
        }
        if tick >= next_action {
            next_action = tick + dice.decades(5.0, 4_000.0) as u32;
            match dice.within(0.0, 20.0) as u32 {
                0 => filter(&mut dice, &mut amplifier),
                1 => {
                    bench.gain_um_v = healthy.0 * dice.decades(0.7, 1.8);
                    bench.natural_rad_s = healthy.1 * dice.decades(0.6, 1.1);
                    bench.damping = healthy.2 * dice.decades(0.01, 2.0);
                }
                2 | 3 => (bench.gain_um_v, bench.natural_rad_s, bench.damping) = healthy,
                4 => {
                    let kinds = [
                        Trouble::Silent,
                        Trouble::Stuck,
                        Trouble::Shifted,
                        Trouble::Railed,
                    ];
                    trouble = kinds[dice.within(0.0, 4.0) as usize];
                    until = tick + dice.decades(1.0, 400.0) as u32;
                }
                5 => {
                    let mut other = *amplifier.parameters();
                    other.guard.tracking_error -= dice.within(0.0, 1000.0) as i32;
                    let _ = amplifier.swap(&other);
                }
                6 => amplifier.refuse(Fault::EmergencyStop),
                _ => {
                    let wanted = if dice.share() < 0.7 {
                        next_step(&mut dice, &amplifier)
                    } else {
                        command(&mut dice)
                    };
                    let accepted = amplifier.command(wanted).is_ok();
                    is_asked = match wanted {
                        Command::Disable | Command::Disarm => false,
                        Command::Enable
                        | Command::Play { .. }
                        | Command::Hold { .. }
                        | Command::Condition { .. }
                        | Command::Identify { .. }
                        | Command::Arm { tested: true } => is_asked || accepted,
                        _ => is_asked,
                    };
                }
            }
        }
        let honest = bench.reading();
        let reading = match trouble {
            Trouble::None => Some(honest),
            Trouble::Silent => None,
            Trouble::Stuck => Some(last_reading),
            Trouble::Shifted => Some(honest + 9_000),
            Trouble::Railed => Some(SensorCode::new(65_535)),
        };
        last_reading = reading.unwrap_or(last_reading);
        let before = code;
        let sample = amplifier.tick(reading, dice.share() < 1e-6);
        code = sample.dac_code;
        bench.advance(code);

        assert!(
            (c.dac_code_min..=c.dac_code_max).contains(&code)
                && code.abs_diff(before) <= c.slew_codes,
            "seed {seed}, tick {tick}: {before} to {code}"
        );
        let (mode, fault) = (amplifier.mode(), amplifier.fault());
        assert_eq!(
            mode == Mode::Fault,
            fault.is_some(),
            "every stop has a name"
        );
        if fault != was {
            if let Some(fault) = fault {
                *faults.entry(fault.name()).or_insert(0) += 1;
            }
            was = fault;
        }
        if matches!(mode, Mode::Rest | Mode::Fault) {
            is_asked = false;
        }
        if !is_asked {
            assert!(
                code.abs_diff(rest) <= before.abs_diff(rest),
                "seed {seed}, tick {tick}: {before} to {code} in {mode:?}, and nobody asked for it"
            );
        }
        if !amplifier.powered() {
            assert_eq!(
                code,
                code.min(before).max(rest),
                "without power towards rest only"
            );
        }
        let error_um = f64::from(sample.reference) / 2f64.powi(24)
            - f64::from(
                amplifier
                    .parameters()
                    .servo
                    .converters
                    .position(last_reading),
            ) / 2f64.powi(24);
        if mode != Mode::Closed {
            (spell, quiet) = (None, 0);
            continue;
        }
        closed += 1;
        if error_um.abs() > LIMIT_UM {
            let first = *spell.get_or_insert(tick);
            quiet = 0;
            assert!(
                tick - first <= 2 * 100,
                "seed {seed}, tick {tick}: swings since {first}"
            );
        } else {
            quiet += 1;
            spell = spell.filter(|_| quiet <= 100);
        }
    }
    (faults, closed)
}

fn attack(seeds: std::ops::Range<u64>, ticks: u32) {
    let (mut all, mut closed) = (BTreeMap::new(), 0);
    for seed in seeds {
        let (faults, ticks_closed) = run(seed * 104_729 + 1, ticks);
        closed += ticks_closed;
        for (name, count) in faults {
            *all.entry(name).or_insert(0) += count;
        }
    }
    println!("{closed} ticks closed; {all:#?}");
    let expected = [
        "tracking error",
        "sensor jump",
        "sensor silent",
        "emergency stop",
    ];
    assert!(
        expected.iter().all(|name| all.contains_key(name)),
        "{all:?}"
    );
    assert!(closed > ticks / 10, "{closed} ticks closed");
}

#[test]
fn an_adversary_neither_moves_nor_swings_the_stage() {
    attack(0..8, 125_000);
}

mod long {
    #[test]
    #[ignore = "10^7 ticks, for cargo xtask full"]
    fn an_adversary_of_ten_million_ticks_neither_moves_nor_swings_the_stage() {
        super::attack(100..120, 500_000);
    }
}

//! Codes of 18 and 20 bits: the image reads frames that are as long as its block says, fills the whole
//! register of the drive's converter, and does what the host does, to the last bit.

use crate::common;

use common::{assert_texts, best_parameters, block, host_run, image, lines, run_on, samples};
use hysteron_core::codes::SensorCode;
use hysteron_core::parameter_block::{AmplifierParameters, verify};
use hysteron_core::servo_parameters::ConverterParameters;
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Script, run};
use hysteron_sim::bench::{Bench, Variant};

/// The tick at which the loop is closed: the conditioning is over by then.
const ENABLE_TICK: u32 = 22_300;
const TICKS: u32 = 30_000;

/// The bench with converters of so many bits over the same spans.
fn bench(adc_bits: u8, dac_bits: u8) -> Bench {
    let mut bench = Bench::reference().expect("the bench");
    (bench.converters.adc_bits, bench.converters.dac_bits) = (adc_bits.into(), dac_bits.into());
    bench
}

/// The best servo with the converters of such a bench, and the same limits of guard and drive in its codes.
fn parameters(bench: &Bench) -> AmplifierParameters {
    let mut out = best_parameters();
    let narrow = out.servo.converters;
    let wide = bench.converter_scale().parameters();
    let (adc, dac) = (
        wide.adc_bits - narrow.adc_bits,
        wide.dac_bits - narrow.dac_bits,
    );
    out.servo.converters = ConverterParameters {
        slew_codes: narrow.slew_codes << dac,
        noise_shaping: narrow.noise_shaping,
        ..wide
    };
    let rail = out.guard.adc_code_min.steps() << adc;
    out.guard.adc_code_min = SensorCode::new(rail);
    out.guard.adc_code_max = SensorCode::highest(wide.adc_bits) - rail;
    out.guard.jump_codes <<= adc;
    out.guard.ramp_codes <<= dac;
    out.guard.rest_code = wide.dac_code_min;
    assert_eq!(verify(&out, 20_000), Ok(()));
    out
}

fn agrees_with_the_host(adc_bits: u8, dac_bits: u8) {
    let bench = bench(adc_bits, dac_bits);
    let parameters = parameters(&bench);
    let commands = [
        (99, "arm untested"),
        (100, "condition"),
        (ENABLE_TICK, "reference sine 10000 5000 5600"),
        (ENABLE_TICK + 1, "enable"),
    ];
    let world = World::new(&bench, Variant::FULL, 7).shared();
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (
                2 * MILLISECOND,
                [b"trace 31 1\n".to_vec(), lines(&commands)].concat(),
            ),
            (u64::from(TICKS) * 50_000, b"status\n".to_vec()),
        ],
        ..Script::listening(u64::from(TICKS) * 50_000 + 20 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (target, lost) = samples(&outcome);
    assert_eq!(
        (lost, outcome.malformed, outcome.resets),
        (0, 0, 0),
        "{:?}",
        outcome.messages
    );
    let status = outcome.texts_with("status").last().expect("a status");
    assert!(status.contains("overruns: 0"), "{status}");

    let host = host_run(
        &parameters,
        &mut World::new(&bench, Variant::FULL, 7),
        &commands,
        TICKS as usize,
    );
    let target: Vec<_> = target
        .iter()
        .filter(|sample| sample.tick >= 100 && sample.tick < TICKS)
        .collect();
    assert_eq!(target.len(), (TICKS - 100) as usize);
    for (ours, theirs) in target.iter().zip(&host[100..]) {
        assert_eq!(**ours, *theirs);
    }

    // The converters saw what the trace says, and all bits of it are used.
    let closed = &host[ENABLE_TICK as usize + 1000..];
    let seen = &world.lock().expect("the world").codes;
    let sent: Vec<_> = closed
        .iter()
        .map(|sample| (sample.adc_code, sample.dac_code))
        .collect();
    // A code that was written in a tick acts from the next edge on.
    let acted: Vec<_> = seen.windows(2).map(|pair| (pair[0].0, pair[1].1)).collect();
    assert!(
        acted.windows(sent.len()).any(|window| *window == sent[..]),
        "what was sent is what acted"
    );
    let bits_of = |codes: &mut dyn Iterator<Item = u32>| {
        codes.fold((0, u32::MAX), |(any, all), code| (any | code, all & code))
    };
    for (bits, (any, all)) in [
        (
            adc_bits,
            bits_of(&mut sent.iter().map(|(adc, _)| adc.steps())),
        ),
        (
            dac_bits,
            bits_of(&mut sent.iter().map(|(_, dac)| dac.steps())),
        ),
    ] {
        let low = (1 << (bits - 1)) - 1;
        assert_eq!(
            (any & low, all & low),
            (low, 0),
            "no bit of {bits} stands still: {any:#x} {all:#x}"
        );
    }
    println!(
        "{adc_bits} and {dac_bits} bits: {} ticks to the last bit",
        target.len()
    );
}

#[test]
fn a_sensor_of_18_bits_and_a_drive_of_20() {
    agrees_with_the_host(18, 20);
}

#[test]
fn both_of_20_bits() {
    agrees_with_the_host(20, 20);
}

#[test]
fn a_sensor_whose_frames_no_converter_has_is_refused() {
    let script = Script {
        block: Some(block(&parameters(&bench(17, 20)))),
        ..Script::listening(220 * MILLISECOND)
    };
    let outcome = run(&image(), NucleoBoard::new().expect("a board"), script).expect("a run");
    assert_texts(
        &outcome,
        "block A refused: integers contradict the physical limits",
        1,
    );
}

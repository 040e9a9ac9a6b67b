//! A sensor that is bent is straight to everything behind the control interrupt.

use crate::common;

use common::{best_parameters, block, run_on, samples, world};
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_emulator::run::{MILLISECOND, Script, bench_envelope, envelope_bytes};

#[test]
fn readings_are_corrected_as_the_envelope_says() {
    let parameters = best_parameters();
    let mut sensor_corrections = [0; 15];
    for (nth, correction) in (1i16..).zip(&mut sensor_corrections) {
        // 2 % of the codes in the middle.
        *correction = 20 * nth * (16 - nth);
    }
    let bent = SafetyEnvelope {
        sensor_corrections,
        ..bench_envelope()
    };
    let world = world();
    let script = Script {
        block: Some(block(&parameters)),
        envelope: Some(envelope_bytes(&bent)),
        commands: vec![(2 * MILLISECOND, b"trace 31 1\n".to_vec())],
        serial: vec![(
            20 * MILLISECOND,
            b"ARM 1 2\nSVA 1 20\nSVA 1 60\nSVA 1 100\n".to_vec(),
        )],
        ..Script::listening(300 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (samples, lost) = samples(&outcome);
    let world = world.lock().expect("the world");
    let table = bent
        .linearisation(parameters.servo.converters.adc_bits)
        .expect("a correction");
    let mut corrected = Vec::new();
    for sample in &samples {
        let (raw, _) = world.codes[sample.tick as usize];
        assert_eq!(
            sample.adc_code,
            table.straighten(raw),
            "tick {}",
            sample.tick
        );
        corrected.push(sample.adc_code.abs_diff(raw));
    }
    assert_eq!(lost, 0);
    // From rest to the upper half of the range.
    let (least, most) = (corrected.iter().min(), corrected.iter().max());
    assert!(
        least < Some(&700) && most > Some(&1_200),
        "{least:?} to {most:?}"
    );
}

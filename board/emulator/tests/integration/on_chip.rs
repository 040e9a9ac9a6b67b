//! The image with the chip's own converters: its registers are set up as the reference manual asks, and
//! without conversions it rests.
//!
//! Not modelled by the emulated part: the ADC's synchronous clock (so its calibration never ends and it is
//! never enabled), its hardware trigger, and the DAC, whose registers are stored and nothing more. A
//! converter that never answers must be a silent sensor; what is not shown here is that the ADC is calibrated
//! and enabled, that it samples at the edge, and that a code is latched there.

use crate::common;

use common::{assert_texts, block, image_named, parameters};
use hysteron_core::guard::Fault;
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_core::servo_parameters::ConverterParameters;
use hysteron_emulator::board::NucleoBoard;
use hysteron_emulator::run::{MILLISECOND, Outcome, Script, bench_envelope, envelope_bytes, run};
use hysteron_sim::bench::Bench;
use rigless::mcu::Mcu;
use rigless::soc::Layout;
use rigless::soc::stm32h743::generated::{adc3, adc3_common, dac, tim2};

fn register<L: Layout>(outcome: &Outcome, instance: &str, register: L) -> u64 {
    outcome
        .board
        .mcu
        .bus()
        .registers(instance)
        .expect("an instance")
        .get(register)
}

/// 12 bits of the same drives.
fn on_chip_envelope(bench: &Bench) -> Vec<u8> {
    let scale = bench.converter_scale();
    let (lowest, highest) = (
        scale.dac_code(scale.drive_min_v),
        scale.dac_code(scale.drive_max_v),
    );
    envelope_bytes(&SafetyEnvelope {
        dac_bits: 12,
        drive_min: lowest,
        drive_max: highest,
        safe_code: lowest,
        ..bench_envelope()
    })
}

#[test]
fn its_registers_are_set_up_and_a_silent_converter_rests() {
    let mut bench = Bench::reference().expect("the bench");
    bench.converters.dac_bits = 12;
    let mut parameters = parameters();
    parameters.servo.converters = ConverterParameters {
        slew_codes: 146,
        ..bench.converter_scale().parameters()
    };
    parameters.guard.rest_code = parameters.servo.converters.dac_code_min;
    parameters.physical.slew_limit_v_s = 100_000;
    let script = Script {
        block: Some(block(&parameters)),
        envelope: Some(on_chip_envelope(&bench)),
        commands: vec![(180 * MILLISECOND, b"enable\nclear\n".to_vec())],
        ..Script::listening(220 * MILLISECOND)
    };
    let outcome = run(
        &image_named("hysteron-firmware-on-chip"),
        NucleoBoard::new().expect("a board"),
        script,
    )
    .expect("a run");
    assert_texts(&outcome, "front end on-chip ADC1 and DAC1", 1);
    // The timer's update is its trigger output (CR2.MMS = 2).
    assert_eq!(register(&outcome, "TIM2", tim2::Register::Cr2) >> 4 & 7, 2);
    // The ADC runs at the bus clock over 4 (CKMODE = 3), powered (ADVREGEN), with its calibration (ADCALLIN)
    // behind it.
    assert_eq!(
        register(&outcome, "ADC12_Common", adc3_common::Register::Ccr) >> 16 & 3,
        3
    );
    let control = register(&outcome, "ADC1", adc3::Register::Cr);
    assert_eq!(
        (
            control >> 28 & 3,
            control >> 31,
            control >> 16 & 1,
            control >> 8 & 3
        ),
        (1, 0, 1, 2),
        "{control:#x}"
    );
    // Rising edges of trigger 11 convert channel 15, 16 bits, the newest word kept.
    let configuration = register(&outcome, "ADC1", adc3::Register::Cfgr);
    assert_eq!(
        (
            configuration >> 10 & 3,
            configuration >> 5 & 31,
            configuration >> 2 & 7,
            configuration >> 12 & 1
        ),
        (1, 11, 0, 1)
    );
    assert_eq!(register(&outcome, "ADC1", adc3::Register::Sqr1), 15 << 6);
    assert_eq!(register(&outcome, "ADC1", adc3::Register::Pcsel), 1 << 15);
    assert_eq!(
        register(&outcome, "ADC1", adc3::Register::Smpr2) >> 15 & 7,
        3,
        "16.5 cycles"
    );
    // DAC1 channel 1 is enabled, its trigger (TSEL = 2) on, and it holds rest.
    let control = register(&outcome, "DAC", dac::Register::Cr);
    assert_eq!(
        (control & 1, control >> 1 & 1, control >> 2 & 15),
        (1, 1, 2),
        "{control:#x}"
    );
    assert_eq!(
        register(&outcome, "DAC", dac::Register::Dhr12r1),
        u64::from(parameters.guard.rest_code.steps())
    );
    assert_eq!(
        outcome
            .texts_with(&format!("mode fault: {}", Fault::SensorSilent.name()))
            .count(),
        1,
        "{:?}",
        outcome.messages
    );
    assert_texts(&outcome, "refused at tick", 2);
    assert_eq!(outcome.resets, 0);
    println!("without a model: {:?}", outcome.without_model);
}

#[test]
fn a_block_for_other_converters_is_refused() {
    let mut bench = Bench::reference().expect("the bench");
    bench.converters.dac_bits = 12;
    let envelope = Some(on_chip_envelope(&bench));
    let script = Script {
        block: Some(block(&parameters())),
        envelope,
        ..Script::listening(220 * MILLISECOND)
    };
    let outcome = run(
        &image_named("hysteron-firmware-on-chip"),
        NucleoBoard::new().expect("a board"),
        script,
    )
    .expect("a run");
    assert_texts(
        &outcome,
        "block A refused: integers contradict the physical limits",
        1,
    );
    assert_eq!(
        register(&outcome, "DAC", dac::Register::Cr) & 1,
        0,
        "the output is not enabled"
    );
}

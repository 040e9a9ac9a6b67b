//! What converters with more bits bring to the closed loop: the same servo on the same bench, with a sensor
//! whose noise hides the codes and with one whose does not.

use hysteron_core::parameter_block::{AmplifierParameters, read};
use hysteron_core::servo_parameters::{ConverterParameters, NO_SLEW_LIMIT, ServoParameters};
use hysteron_sim::bench::{Bench, Converters, Variant};
use hysteron_sim::closed_loop::Experiment;
use std::f64::consts::TAU;

/// The best design for the bench, a predictor over the inverse of the hysteresis.
fn best() -> AmplifierParameters {
    read(
        include_bytes!("../../../board/emulator/tests/p753.block"),
        20_000,
    )
    .expect("a valid block")
}

/// RMS of the true error, nm, at a constant reference and along 5 um at 10 Hz, behind the first 0.5 s.
fn errors_nm(adc_bits: u8, dac_bits: u8, noise_um: f64) -> [f64; 2] {
    let mut bench = Bench::reference().expect("the bench");
    bench.converters = Converters {
        adc_bits: adc_bits.into(),
        dac_bits: dac_bits.into(),
        sensor_noise_um: noise_um,
        ..bench.converters
    };
    let narrow = best().servo;
    let converters = ConverterParameters {
        slew_codes: NO_SLEW_LIMIT,
        noise_shaping: narrow.converters.noise_shaping,
        ..bench.converter_scale().parameters()
    };
    let servo = ServoParameters {
        converters,
        ..narrow
    };
    [0.0, 5.0].map(|amplitude_um| {
        let reference_um: Vec<f64> = (0..30_000)
            .map(|k| 5.6 + amplitude_um * (TAU * 10.0 * f64::from(k) / 20_000.0).sin())
            .collect();
        1e3 * Experiment::new(&bench, Variant::FULL, 7)
            .follow(&servo, &reference_um)
            .true_error(10_000)
            .rms_um
    })
}

#[test]
fn finer_codes_bring_what_the_noise_of_the_sensor_leaves_of_them() {
    println!(
        "| noise of the sensor, nm RMS | bits of sensor, drive | at rest, nm | 5 um at 10 Hz, nm |\n|---|---|---|---|"
    );
    // The bench's own noise, and two quieter sensors; most that is left of the error at rest.
    for (noise_um, most) in [(0.0013, 1.0), (0.0002, 0.97), (0.00005, 0.65)] {
        let [narrow, .., wide] =
            [(16, 16), (16, 20), (18, 16), (18, 20), (20, 20)].map(|(adc_bits, dac_bits)| {
                let [rest_nm, sine_nm] = errors_nm(adc_bits, dac_bits, noise_um);
                println!(
                    "| {:.2} | {adc_bits}, {dac_bits} | {rest_nm:.3} | {sine_nm:.3} |",
                    noise_um * 1e3
                );
                rest_nm
            });
        assert!(
            wide < most * narrow,
            "{wide} nm, where 16 bits give {narrow} nm"
        );
    }
}

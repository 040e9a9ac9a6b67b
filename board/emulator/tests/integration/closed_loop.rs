//! The unmodified image closes the loop around the float plant: what it reads and drives is what the host's
//! simulation of the same core and plant gives, to the last bit.

use crate::common;

use common::{
    assert_same_bits, best_parameters, block, host_run, last_status, lines, number, run_paced,
    samples,
};
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Script};
use hysteron_sim::bench::{Bench, Variant};

/// Frequencies, mHz, of the sines of 5 um.
const SINES_MHZ: [u32; 5] = [1_000, 10_000, 50_000, 100_000, 150_000];
const FIRST_TICK: u32 = 22_300;
/// 10.1 s in all.
const TICKS_EACH: u32 = 36_000;
/// What the slowest tick may take, in instructions from the edge of the interrupt to its end; waiting for the
/// converters included. 3,178 measured with rustup's rustc 1.95; compilers differ by some per cent.
const MOST_INSTRUCTIONS: u64 = 3_200;
/// What the part of it that is not the converters and the queues may take.
const MOST_TICK_INSTRUCTIONS: u64 = 1_400;

#[test]
fn sines_agree_with_the_host_to_the_last_bit() {
    let bench = Bench::reference().expect("the bench");
    let parameters = best_parameters();
    let mut commands = vec![
        (99, "arm untested".to_string()),
        (100, "condition".to_string()),
    ];
    for (nth, millihertz) in (0u32..).zip(SINES_MHZ) {
        commands.push((
            FIRST_TICK + nth * TICKS_EACH,
            format!("reference sine {millihertz} 5000 5600"),
        ));
        if nth == 0 {
            commands.push((FIRST_TICK + 1, "enable".to_string()));
        }
    }
    let commands: Vec<(u32, &str)> = commands
        .iter()
        .map(|(at, text)| (*at, text.as_str()))
        .collect();
    let ticks = FIRST_TICK + TICKS_EACH * SINES_MHZ.len() as u32;

    let world = World::new(&bench, Variant::FULL, 7).shared();
    let script = Script {
        block: Some(block(&parameters)),
        commands: vec![
            (
                2 * MILLISECOND,
                [b"trace 31 1\n".to_vec(), lines(&commands)].concat(),
            ),
            // Largest values count from here: the tick that zeroes the sensor, at rest, is a long one.
            (
                u64::from(FIRST_TICK) * 50_000 + 20 * MILLISECOND,
                b"status\n".to_vec(),
            ),
            (u64::from(ticks) * 50_000, b"status\n".to_vec()),
        ],
        ..Script::listening(u64::from(ticks) * 50_000 + 20 * MILLISECOND)
    };
    let outcome = run_paced(&world, script);
    let others: Vec<_> = outcome
        .messages
        .iter()
        .filter(|message| !message.text.starts_with("trace ["))
        .collect();
    let (target, lost) = samples(&outcome);
    println!(
        "{} samples, {lost} lost, {} malformed; {} instructions in {} ms",
        target.len(),
        outcome.malformed,
        outcome.end.1,
        outcome.end.0 / MILLISECOND
    );
    for message in &others {
        println!("{:>12} {} {}", message.at_ns, message.level, message.text);
    }
    assert_eq!((lost, outcome.malformed, outcome.resets), (0, 0, 0));

    let mut twin = World::new(&bench, Variant::FULL, 7);
    let host = host_run(&parameters, &mut twin, &commands, ticks as usize);
    assert_same_bits(&target, &host);

    // And it is a servo: steady tracking error of what the sensor reads, over the last half of each sine.
    for (nth, millihertz) in (0..).zip(SINES_MHZ) {
        let from = (FIRST_TICK + nth * TICKS_EACH + TICKS_EACH / 2) as usize;
        let to = (FIRST_TICK + (nth + 1) * TICKS_EACH) as usize;
        let zero = converter_zero(&parameters, &host[..FIRST_TICK as usize]);
        let square: f64 = host[from..to]
            .iter()
            .map(|sample| {
                (f64::from(sample.adc_code) * bench.adc_lsb_um()
                    - zero
                    - f64::from(sample.reference) / f64::from(1 << 24))
                .powi(2)
            })
            .sum();
        println!(
            "{:>6} Hz: {:.4} um RMS of the sensor's reading, noise included",
            f64::from(millihertz) / 1e3,
            (square / (to - from) as f64).sqrt()
        );
    }

    let status = last_status(&outcome);
    let number = |name| number(status, name);
    assert_eq!(
        (number("lost_samples"), number("overruns")),
        (0, 0),
        "{status}"
    );
    // A timer count is two instructions; the interrupt is raised 200 counts after the edge.
    let instructions = (number("slowest_counts") - 200) * 2;
    println!(
        "slowest interrupt: {instructions} instructions, entry to end, with converters and the trace at full rate"
    );
    println!(
        "guard, reference, servo and sample of a tick: {} instructions at most, {} on the mean of the last 256",
        number("most_tick_cycles"),
        number("recent_tick_cycles")
    );
    assert!(
        instructions <= MOST_INSTRUCTIONS,
        "{instructions} instructions, more than {MOST_INSTRUCTIONS}"
    );
    assert!(number("most_tick_cycles") <= MOST_TICK_INSTRUCTIONS);
}

/// Position at code 0, um, as the sensor was zeroed: from the last readings of the conditioning.
fn converter_zero(
    parameters: &hysteron_core::parameter_block::AmplifierParameters,
    before: &[hysteron_core::trace_frame::TraceSample],
) -> f64 {
    let end = 100 + 2000 + 20_000;
    let mean = before[end - 1024..end]
        .iter()
        .map(|sample| f64::from(sample.adc_code))
        .sum::<f64>()
        / 1024.0;
    mean * parameters.servo.converters.adc_step as f64 / 2f64.powi(40)
}

//! The image boots on the emulated part, and its 20 kHz beat is exact in virtual time.

use crate::common;

use common::run_on;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Outcome, Script};
use hysteron_sim::bench::{Bench, Variant};
use rigless::mcu::Mcu;
use rigless::soc::Layout;
use rigless::soc::stm32h743::generated::{exti, gpioa, pwr, rcc, tim2};

#[test]
fn the_image_boots_beats_at_20_khz_and_rests_without_a_block() {
    let until_ns = 105 * MILLISECOND;
    let bench = Bench::reference().expect("the bench");
    let world = World::new(&bench, Variant::PLAIN, 1).shared();
    let mut script = Script::listening(until_ns);
    for status in 0..18 {
        script
            .commands
            .push(((10 + 5 * status) * MILLISECOND, b"status\n".to_vec()));
    }
    let outcome = run_on(&world, script);
    println!(
        "end {:?}, without a model: {:?}",
        outcome.end, outcome.without_model
    );
    let boot: Vec<_> = outcome.texts_with("hysteron ").collect();
    assert_eq!(boot.len(), 1, "boots once: {:?}", outcome.messages);
    assert!(
        boot[0].contains("core 400000000 Hz, control 20000 Hz"),
        "{}",
        boot[0]
    );
    assert_eq!((outcome.malformed, outcome.resets), (0, 0));
    assert!(
        outcome.texts_with("mode fault: parameter block").count() == 1,
        "{:?}",
        outcome.messages
    );

    let counts: Vec<(u64, u64)> = outcome
        .messages
        .iter()
        .filter_map(|message| {
            let rest = message.text.split("ticks: ").nth(1)?;
            Some((message.at_ns, rest.split(',').next()?.parse().ok()?))
        })
        .collect();
    assert!(counts.len() >= 15, "reports: {:?}", outcome.messages);
    // TIM2 beats every 50 us; a report is written within the millisecond after the probe asked.
    for (at_ns, ticks) in &counts {
        let since_first_ns = (at_ns - counts[0].0) as i64;
        let deviation = (ticks - counts[0].1) as i64 - since_first_ns / 50_000;
        assert!(deviation.abs() <= 20, "{counts:?}");
    }
    lines_of_the_converters(&outcome);
    lines_of_the_bench(&outcome);
    let world = world.lock().expect("the world");
    let rest = bench.converter_scale().dac_code(bench.drive_min_v);
    // The converters saw every edge: the beat began at most 5 ms after the start and is exact.
    let expected = until_ns / 50_000;
    assert!(
        (expected - 100..=expected).contains(&(world.codes.len() as u64)),
        "{} edges",
        world.codes.len()
    );
    assert!(
        world.codes.iter().all(|(_, acting)| *acting == rest),
        "always the safe output"
    );
    assert!(
        world.lowest_between_edges >= rest,
        "the clamp goes only when the register holds rest: {}",
        world.lowest_between_edges
    );
}

fn register<L: Layout>(outcome: &Outcome, instance: &str, register: L) -> u64 {
    outcome
        .board
        .mcu
        .bus()
        .registers(instance)
        .expect("an instance")
        .get(register)
}

/// The emulated timer does not move pins, so what moves CNV and LDAC is asserted as registers (RM0433, 39.4
/// and 11.4).
fn lines_of_the_converters(outcome: &Outcome) {
    let timer = |name| register(outcome, "TIM2", name);
    // It runs, up, not divided, not one pulse only; its update is its trigger output, and no other timer is
    // its master.
    assert_eq!(timer(tim2::Register::Cr1) & 0x7F, 1);
    assert_eq!(
        (
            timer(tim2::Register::Psc),
            timer(tim2::Register::Cr2) >> 4 & 7,
            timer(tim2::Register::Smcr)
        ),
        (0, 2, 0)
    );
    // 200 MHz: 50 us, CNV high for 500 ns, the interrupt after 1 us. LDAC stays low until the sensor's
    // converter has converted: no edge disturbs it.
    assert_eq!(timer(tim2::Register::Arr), 9_999);
    assert_eq!(
        (
            timer(tim2::Register::Ccr1),
            timer(tim2::Register::Ccr3),
            timer(tim2::Register::Ccr4)
        ),
        (100, 140, 200)
    );
    // Output compare: channel 1 high below its count (PWM mode 1), channel 3 low (PWM mode 2); both on and
    // not inverted.
    assert_eq!(timer(tim2::Register::Ccmr1Output) >> 4 & 7, 6);
    assert_eq!(timer(tim2::Register::Ccmr2Output) >> 4 & 7, 7);
    assert_eq!(timer(tim2::Register::Ccer) & 0xFFF, 0x101);
    assert_eq!(
        timer(tim2::Register::Dier) & 0x1F,
        1 << 4,
        "compare 4 alone raises the interrupt"
    );
    // PA0 and PB10 are the timer's (alternate function 1), PC9 is an output, PA5 and PA6 are SPI1's, PC10 and
    // PC12 SPI3's.
    let mode = |port, pin: u64| register(outcome, port, gpioa::Register::Moder) >> (2 * pin) & 3;
    let low = |port, pin: u64| register(outcome, port, gpioa::Register::Afrl) >> (4 * pin) & 15;
    let high =
        |port, pin: u64| register(outcome, port, gpioa::Register::Afrh) >> (4 * (pin - 8)) & 15;
    assert_eq!(
        [
            mode("GPIOA", 0),
            mode("GPIOA", 5),
            mode("GPIOA", 6),
            mode("GPIOB", 10)
        ],
        [2; 4]
    );
    assert_eq!(
        [mode("GPIOC", 10), mode("GPIOC", 12), mode("GPIOC", 9)],
        [2, 2, 1]
    );
    assert_eq!(
        [
            low("GPIOA", 0),
            low("GPIOA", 5),
            low("GPIOA", 6),
            high("GPIOB", 10)
        ],
        [1, 5, 5, 1]
    );
    assert_eq!([high("GPIOC", 10), high("GPIOC", 12)], [6; 2]);
    // All of them push and pull.
    for (port, pins) in [
        ("GPIOA", 1 | 1 << 5),
        ("GPIOB", 1 << 10),
        ("GPIOC", 1 << 9 | 1 << 10 | 1 << 12),
    ] {
        assert_eq!(
            register(outcome, port, gpioa::Register::Otyper) & pins,
            0,
            "{port}"
        );
    }
}

/// The safety inputs float up, so that a broken wire stops, and the voltage detector and the clock security
/// system are armed (RM0433, 6.8.1, 8.7.2, 20.6.1 and 20.6.19).
fn lines_of_the_bench(outcome: &Outcome) {
    let port = |name, pin: u64| register(outcome, "GPIOE", name) >> (2 * pin) & 3;
    for pin in [0, 10, 12] {
        assert_eq!(
            (
                port(gpioa::Register::Moder, pin),
                port(gpioa::Register::Pupdr, pin)
            ),
            (0, 1),
            "PE{pin}"
        );
    }
    assert_eq!(port(gpioa::Register::Moder, 14), 1, "enable");
    let control = register(outcome, "PWR", pwr::Register::Cr1);
    assert_eq!((control >> 4 & 1, control >> 5 & 7), (1, 6), "2.76 V");
    assert_eq!(
        register(outcome, "RCC", rcc::Register::Cr) >> 19 & 1,
        1,
        "HSECSSON"
    );
    let line = |name| register(outcome, "EXTI", name) >> 16 & 1;
    assert_eq!(
        (
            line(exti::Register::Rtsr1),
            line(exti::Register::Ftsr1),
            line(exti::Register::Cpuimr1)
        ),
        (1, 0, 1)
    );
}

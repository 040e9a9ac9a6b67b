//! What the servo's tick costs, on the target itself: most and typical counts of the cycle counter, with the
//! hysteresis' memory full.
//!
//! # How it works
//! The servo of the reference actuator (observer-controller, hysteresis inverted inside the loop) is called
//! with readings that force the longest ways through its code; every call of [`ServoTick::tick`] is timed
//! with the processor's cycle counter, less the cost of reading that. The log carries one line for each case:
//! `tick cost NAME most N typical N pairs N`. On a board these are cycles; on the emulated part, run at one
//! instruction a cycle, they are instructions. There is no sample clock here and no converter.
#![no_std]
#![no_main]

use core::hint::black_box;

use cortex_m::peripheral::DWT;
use hysteron_core::amplifier::Amplifier;
use hysteron_core::amplifier_command::Command;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::gain_adaptation::{AdaptationParameters, MOST};
use hysteron_core::integer_row::Row;
use hysteron_core::learned_feedforward::{LearningParameters, SETTLING_TICKS};
use hysteron_core::one_sided_hysteresis::STACK_CAPACITY;
use hysteron_core::parameter_block::{AmplifierParameters, read};
use hysteron_core::reference_generator::Waveform;
use hysteron_core::servo_parameters::{
    ActuatorParameters, ConverterParameters, NO_SLEW_LIMIT, ServoParameters,
};
use hysteron_core::servo_tick::ServoTick;
use hysteron_core::signal::Micrometres;
use hysteron_firmware::board;
use rtt_target::{ChannelMode, rtt_init};

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    defmt::error!("panic");
    loop {
        cortex_m::asm::nop();
    }
}

/// The block that the emulated target's tests close the loop with.
static BLOCK: &[u8] = include_bytes!("../../../board/emulator/tests/p753.block");

/// Counts of one case.
struct Cost {
    most: u32,
    sum: u32,
    ticks: u32,
}

impl Cost {
    const NONE: Self = Self {
        most: 0,
        sum: 0,
        ticks: 0,
    };

    fn tick(
        &mut self,
        servo: &mut ServoTick,
        adc_code: SensorCode,
        reference: i32,
        empty: u32,
    ) -> DriveCode {
        let (adc_code, reference) = (black_box(adc_code), black_box(reference));
        let begin = DWT::cycle_count();
        let code = timed(servo, adc_code, reference);
        self.take(begin, empty);
        code
    }

    fn take(&mut self, begin: u32, empty: u32) {
        let cycles = DWT::cycle_count().wrapping_sub(begin).saturating_sub(empty);
        self.most = self.most.max(cycles);
        self.sum = self.sum.wrapping_add(cycles);
        self.ticks += 1;
        board::feed_watchdog();
    }

    fn say(&self, name: &str, servo: &ServoTick) {
        let pairs = servo
            .hysteresis()
            .map_or(0, |hysteresis| hysteresis.stored_pairs());
        defmt::info!(
            "tick cost {=str} most {=u32} typical {=u32} pairs {=usize}",
            name,
            self.most,
            self.sum / self.ticks.max(1),
            pairs
        );
    }
}

/// As the control interrupt calls it.
#[inline(never)]
fn timed(servo: &mut ServoTick, adc_code: SensorCode, reference: i32) -> DriveCode {
    servo.tick(adc_code, Micrometres::from_bits(reference))
}

/// As the control interrupt calls it: guard, reference, servo and the sample for the trace.
#[inline(never)]
fn timed_amplifier(amplifier: &mut Amplifier, adc_code: SensorCode) -> DriveCode {
    amplifier.tick(Some(adc_code), false).dac_code
}

/// As the control interrupt calls it: another block takes over.
#[inline(never)]
fn timed_swap(amplifier: &mut Amplifier, block: &AmplifierParameters) -> bool {
    amplifier.swap(block).is_ok()
}

/// The part of it whose cost depends on the memory of the hysteresis.
#[inline(never)]
fn timed_exchange(servo: &mut ServoTick, parameters: &ServoParameters) {
    servo.exchange(parameters);
}

/// One mode (thesis Ch. 5: 5352 rad/s, damping ratio 0.79), at a period of 50 us.
struct Mode {
    position: i32,
    velocity: i32,
}

impl Mode {
    fn step(&mut self, applied: i32) {
        self.velocity += ((i64::from(applied - self.position) * 4_693
            - i64::from(self.velocity) * 27_623)
            >> 16) as i32;
        self.position += self.velocity;
    }

    /// What the sensor's converter gives, with a little noise.
    fn code(&self, c: &ConverterParameters, tick: u32) -> SensorCode {
        code_at(c, self.position) + (tick.wrapping_mul(2_654_435_761) >> 30)
    }
}

fn code_at(c: &ConverterParameters, position: i32) -> SensorCode {
    SensorCode::new(
        (i64::from(position - c.adc_zero) / (c.adc_step >> 16).max(1)).clamp(0, 65_535) as u32,
    )
}

/// Fills the memory: a drive that swings around the middle of the range, less at every turn.
fn fill(servo: &mut ServoTick, turns: u32) {
    let c = servo.parameters().converters;
    let (low, high) = (c.dac_code_min, c.dac_code_max);
    let step = high.abs_diff(low) / (2 * turns + 4);
    servo.open_loop(high);
    for turn in 1..=turns {
        servo.open_loop(if turn % 2 == 1 {
            low + turn * step
        } else {
            high - turn * step
        });
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let channels =
        rtt_init! { up: { 0: { size: 4096, mode: ChannelMode::NoBlockSkip, name: "defmt" } } };
    rtt_target::set_defmt_channel(channels.up.0);
    if let Some(mut core) = cortex_m::Peripherals::take() {
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();
    }
    if let Ok(parameters) = read(BLOCK, 20_000) {
        // Without the slew limit, so that a leap over the whole memory is one tick.
        let mut leaping = parameters.servo;
        leaping.converters.slew_codes = NO_SLEW_LIMIT;
        measure(ServoTick::new(leaping));
        measure_amplifier(Amplifier::new(parameters));
        measure_conditioning(Amplifier::new(parameters));
    }
    defmt::info!("tick cost done");
    loop {
        board::feed_watchdog();
    }
}

/// Filters whose products are none of them nothing: what they are made for does not change the count.
const LEARNING: LearningParameters = LearningParameters {
    learning: Row {
        coefficients: [1 << 15; 64],
    },
    robustness: Row {
        coefficients: [1 << 22; 64],
    },
    error_limit: 1 << 24,
    point_limit: 1 << 14,
    periods_per_halving: 2,
    most_halvings: 3,
};

/// Bounds that let every window change the gain.
const ADAPTATION: AdaptationParameters = AdaptationParameters {
    most: MOST,
    most_step: MOST / 40,
    error_limit: i32::MAX,
    least_motion: 1 << 8,
};

/// Two turns more than there is room for, so that the memory is full whatever the direction.
const TURNS: u32 = 2 * STACK_CAPACITY as u32 + 2;

fn measure(fresh: ServoTick) {
    let begin = DWT::cycle_count();
    let empty = DWT::cycle_count().wrapping_sub(begin);
    let c = fresh.parameters().converters;
    let code_at = |position: i32| code_at(&c, position);

    // A closed loop that follows a triangle of 0.1 um: the memory stays full.
    let mut servo = fresh.clone();
    fill(&mut servo, TURNS);
    servo.enable();
    let mut typical = Cost::NONE;
    let middle = servo.applied().to_bits();
    let mut plant = Mode {
        position: middle,
        velocity: 0,
    };
    for k in 0..600u32 {
        let phase = (k % 200) as i32;
        let reference = middle + (phase.min(200 - phase) - 50) * 16_777;
        let applied = servo.applied().to_bits();
        typical.tick(&mut servo, plant.code(&c, k), reference, empty);
        plant.step(applied);
    }
    typical.say("follow", &servo);

    // The same with the triangle's correction learned, from the third period on.
    let mut parameters = *fresh.parameters();
    parameters.learning = Some(LEARNING);
    let mut servo = ServoTick::new(parameters);
    fill(&mut servo, TURNS);
    servo.repeat(Some(200));
    servo.enable();
    let mut learning = Cost::NONE;
    let middle = servo.applied().to_bits();
    let mut plant = Mode {
        position: middle,
        velocity: 0,
    };
    for k in 0..1200u32 {
        let phase = (k % 200) as i32;
        let reference = middle + (phase.min(200 - phase) - 50) * 16_777;
        let applied = servo.applied().to_bits();
        if k == 600 {
            learning = Cost::NONE;
        }
        learning.tick(&mut servo, plant.code(&c, k), reference, empty);
        plant.step(applied);
    }
    learning.say("learn", &servo);

    // The same with the gain adapted: every window changes it.
    let mut parameters = *fresh.parameters();
    parameters.adaptation = Some(ADAPTATION);
    let mut servo = ServoTick::new(parameters);
    fill(&mut servo, TURNS);
    servo.enable();
    let mut adapting = Cost::NONE;
    let middle = servo.applied().to_bits();
    let mut plant = Mode {
        position: middle,
        velocity: 0,
    };
    for k in 0..6000u32 {
        let phase = (k % 200) as i32;
        let reference = middle + (phase.min(200 - phase) - 50) * 16_777;
        let applied = servo.applied().to_bits();
        adapting.tick(&mut servo, plant.code(&c, k), reference, empty);
        plant.step(applied);
    }
    adapting.say("adapt", &servo);
    let adapted = servo.adaptation().map_or(0, |adaptation| adaptation.gain());
    defmt::info!("adapted gain {=i32}", adapted);

    jump(&fresh, None, empty).say("jump", &servo);
    jump(&fresh, Some(LEARNING), empty).say("jump while learning", &servo);

    // A reversal at every tick: the stack closes a pair, and drops one, each time.
    let mut servo = fresh.clone();
    fill(&mut servo, TURNS);
    servo.enable();
    let mut chatter = Cost::NONE;
    let middle = servo.applied().to_bits();
    for k in 0..400i32 {
        let away = (400 - k) * 4000 * if k % 2 == 0 { 1 } else { -1 };
        chatter.tick(&mut servo, code_at(middle + away), middle, empty);
    }
    chatter.say("chatter", &servo);

    // Another model of the hysteresis, for which the whole memory is evaluated again.
    let mut exchange = Cost::NONE;
    for k in 0..8 {
        let mut servo = fresh.clone();
        fill(&mut servo, TURNS - (k & 1));
        servo.enable();
        servo.tick(code_at(middle), Micrometres::from_bits(middle));
        servo.tick(code_at(middle), Micrometres::from_bits(middle));
        let mut parameters = *fresh.parameters();
        if let ActuatorParameters::OneSidedHysteresis { surfaces, .. } = &mut parameters.actuator {
            surfaces.f[0] += 1;
        }
        let parameters = black_box(parameters);
        let begin = DWT::cycle_count();
        timed_exchange(&mut servo, &parameters);
        exchange.take(begin, empty);
        if k == 7 {
            exchange.say("exchange", &servo);
        }
    }
}

/// One tick from the full memory to far beyond it, up and down, and every step between.
fn jump(fresh: &ServoTick, learning: Option<LearningParameters>, empty: u32) -> Cost {
    let mut parameters = *fresh.parameters();
    parameters.learning = learning;
    let c = parameters.converters;
    let code_at = |position: i32| code_at(&c, position);
    let mut cost = Cost::NONE;
    for k in 0..64i32 {
        let mut servo = ServoTick::new(parameters);
        fill(&mut servo, TURNS - (k as u32 & 1));
        servo.repeat(learning.map(|_| 200));
        servo.enable();
        let middle = servo.applied().to_bits();
        let rest_ticks = if learning.is_some() {
            200 + SETTLING_TICKS + 2
        } else {
            2
        };
        for _ in 0..rest_ticks {
            servo.tick(code_at(middle), Micrometres::from_bits(middle));
        }
        let away = (k / 2 - 16) << 20;
        for _ in 0..12 {
            cost.tick(
                &mut servo,
                code_at(middle - 8 * away),
                middle + 4 * away,
                empty,
            );
        }
    }
    cost
}

/// The same while a conditioning is played: its last tick judges it and zeroes the sensor.
#[inline(never)]
fn measure_conditioning(mut amplifier: Amplifier) {
    let begin = DWT::cycle_count();
    let empty = DWT::cycle_count().wrapping_sub(begin);
    let c = amplifier.parameters().servo.converters;
    let _ = amplifier.command(Command::Arm { tested: false });
    let _ = amplifier.command(Command::Condition {
        cycle_ticks: 2000,
        rest_ticks: 1200,
    });
    let mut plant = Mode {
        position: 0,
        velocity: 0,
    };
    let mut cost = Cost::NONE;
    for k in 0..3300u32 {
        let applied = amplifier.servo().applied().to_bits();
        let adc_code = black_box(plant.code(&c, k));
        let begin = DWT::cycle_count();
        timed_amplifier(&mut amplifier, adc_code);
        cost.take(begin, empty);
        plant.step(applied);
    }
    cost.say("amplifier conditions", amplifier.servo());
    defmt::info!("conditioned {=bool}", amplifier.conditioned());
}

/// The whole of what the control interrupt does between its converters, following a sine of 5 um at 150 Hz.
fn measure_amplifier(mut amplifier: Amplifier) {
    let begin = DWT::cycle_count();
    let empty = DWT::cycle_count().wrapping_sub(begin);
    let c = amplifier.parameters().servo.converters;
    let tones = [((150u64 << 32) / 20_000, 5), (0, 0), (0, 0), (0, 0)]
        .map(|(increment, um)| (increment as u32, Micrometres::from_num(um), 0));
    let reference = Command::Reference {
        waveform: Waveform::Multisine { tones },
        offset: Micrometres::from_bits(94_000_000),
    };
    // There is no stage here whose memory could be another one.
    let _ = amplifier.command(Command::Arm { tested: false });
    let _ = amplifier.command(Command::RequireConditioning(false));
    let (_, _) = (
        amplifier.command(reference),
        amplifier.command(Command::Enable),
    );
    let mut plant = Mode {
        position: 0,
        velocity: 0,
    };
    let (mut start, mut follow) = (Cost::NONE, Cost::NONE);
    for k in 0..3000u32 {
        let applied = amplifier.servo().applied().to_bits();
        let adc_code = black_box(plant.code(&c, k));
        let begin = DWT::cycle_count();
        timed_amplifier(&mut amplifier, adc_code);
        if k < 1500 {
            start.take(begin, empty)
        } else {
            follow.take(begin, empty)
        };
        plant.step(applied);
    }
    start.say("amplifier begins", amplifier.servo());
    follow.say("amplifier follows", amplifier.servo());
    // The same block: all that a swap looks at and copies, and no memory.
    let mut swap = Cost::NONE;
    let block = black_box(*amplifier.parameters());
    let begin = DWT::cycle_count();
    let swapped = black_box(timed_swap(&mut amplifier, &block));
    swap.take(begin, empty);
    if swapped {
        swap.say("swap", amplifier.servo());
    }
    defmt::info!("mode {=u8}", amplifier.mode() as u8);
}

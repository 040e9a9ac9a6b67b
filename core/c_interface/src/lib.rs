//! The integer servo behind five C functions (`hysteron_servo.h`): the block that `hysteron design --block`
//! writes, then a code of the drive for every code of the sensor. The bits are those of the board and of the
//! simulation, since the tick is the same.
//!
//! The servo alone: guard, arming and watch of the output stay with the program around it.
//!
//! Unsafe code is confined to the names that are exported; pointers are references that may be null.
#![cfg_attr(target_os = "none", no_std)]
#![allow(unsafe_code)]

use core::mem::{MaybeUninit, align_of, size_of};

use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::parameter_block::{BLOCK_BYTES, read};
use hysteron_core::servo_tick::ServoTick;
use hysteron_core::signal::{Micrometres, Quantity};
use hysteron_core::wire::BlockError;

/// Words of 64 bits that the header keeps for a servo, which has 11,920 bytes.
const WORDS: usize = 1536;
const _: () = assert!(size_of::<Servo>() <= 8 * WORDS && align_of::<Servo>() <= 8);

/// One servo, in memory that the caller owns.
#[repr(C)]
pub struct Servo(ServoTick);

/// What is wrong with a block, as the header numbers it.
fn number(problem: BlockError) -> i32 {
    match problem {
        BlockError::Absent => 2,
        BlockError::Version(_) => 3,
        BlockError::Length | BlockError::Checksum => 4,
        BlockError::SampleRate(_) => 5,
        _ => 6,
    }
}

/// Begins with a block, the loop open; 0, or what is wrong (1: a null pointer). The block is read from an array
/// of [`BLOCK_BYTES`], of which the rest may be anything.
#[unsafe(no_mangle)]
pub extern "C" fn hysteron_servo_init(
    memory: Option<&mut MaybeUninit<Servo>>,
    block: Option<&[u8; BLOCK_BYTES]>,
    sample_rate_hz: u32,
) -> i32 {
    let (Some(memory), Some(block)) = (memory, block) else {
        return 1;
    };
    match read(block, sample_rate_hz) {
        Ok(parameters) => {
            memory.write(Servo(ServoTick::new(parameters.servo)));
            0
        }
        Err(problem) => number(problem),
    }
}

/// Takes note of an open-loop drive, for the memory of the hysteresis; gives the code within the limits.
#[unsafe(no_mangle)]
pub extern "C" fn hysteron_servo_open_loop(servo: Option<&mut Servo>, code: u32) -> u32 {
    servo.map_or(0, |Servo(servo)| {
        servo.open_loop(DriveCode::new(code)).steps()
    })
}

/// Closes the loop at the next tick, from the drive and the position that are there.
#[unsafe(no_mangle)]
pub extern "C" fn hysteron_servo_enable(servo: Option<&mut Servo>) {
    if let Some(Servo(servo)) = servo {
        servo.enable();
    }
}

/// One sampling period: the sensor's code and the reference two periods ahead, um with 24 fraction bits; gives
/// the drive's code.
#[unsafe(no_mangle)]
pub extern "C" fn hysteron_servo_tick(
    servo: Option<&mut Servo>,
    sensor_code: u32,
    reference_ahead: i32,
) -> u32 {
    servo.map_or(0, |Servo(servo)| {
        let reference = Micrometres::of_bits(reference_ahead);
        servo.tick(SensorCode::new(sensor_code), reference).steps()
    })
}

/// Ticks and values at a limit since the beginning: drive, hysteresis, format.
#[unsafe(no_mangle)]
pub extern "C" fn hysteron_servo_counters(servo: Option<&Servo>, counters: Option<&mut [u32; 3]>) {
    if let (Some(Servo(servo)), Some(counters)) = (servo, counters) {
        let found = servo.counters();
        *counters = [
            found.limited_ticks,
            found.unreachable_ticks,
            found.saturated_values,
        ];
    }
}

/// Nothing in the tick panics; a controller without an operating system needs a handler to link.
#[cfg(target_os = "none")]
#[panic_handler]
fn stop(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}

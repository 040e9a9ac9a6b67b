//! A program in C, linked with the library, gives the codes of the servo in Rust over 10^6 ticks.

use std::path::{Path, PathBuf};
use std::process::Command;

use hysteron::servo::amplifier_block::{FrontEnd, amplifier_parameters, block};
use hysteron::servo::order::{DesignOrder, design};
use hysteron::servo::scheme_choice::SchemeChoice;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::parameter_block::BLOCK_BYTES;
use hysteron_core::servo_tick::ServoTick;
use hysteron_core::signal::{Micrometres, Quantity};
use hysteron_tests::readers::loops_and_mode;

const TICKS: u32 = 1_000_000;

/// Prints the FNV-1a sum of the codes every hundredth of the way, then the counters. The stage is a line:
/// what it does is the same in both languages, and reaches the limits.
const MAIN: &str = r#"
#include "hysteron_servo.h"
#include <stdio.h>
static hysteron_servo servo;
static uint8_t block[HYSTERON_BLOCK_BYTES];
int main(void) {
    FILE *file = fopen("block.bin", "rb");
    if (!file || fread(block, 1, sizeof block, file) == 0) return 1;
    if (hysteron_servo_init(&servo, block, 20001) != 5) return 2;
    int32_t problem = hysteron_servo_init(&servo, block, 20000);
    if (problem) return 10 + problem;
    uint64_t sum = 0xcbf29ce484222325u, random = 1;
    uint32_t code = 9362, counters[3];
    for (uint32_t k = 0; k < 1000000; k++) {
        random = random * 6364136223846793005u + 1442695040888963407u;
        uint32_t sensor = 4369 + code / 2 + (uint32_t)(random >> 61);
        int32_t reference = (int32_t)((k / 4000 % 2 ? 12u : 4u) << 24) - (int32_t)(k % 4000 * 20000);
        if (k == 100) hysteron_servo_enable(&servo);
        code = k < 100 ? hysteron_servo_open_loop(&servo, 9362 + k) : hysteron_servo_tick(&servo, sensor, reference);
        sum = (sum ^ code) * 0x100000001b3u;
        if (k % 10000 == 9999) printf("%llx\n", (unsigned long long)sum);
    }
    hysteron_servo_counters(&servo, counters);
    printf("%u %u %u\n", counters[0], counters[1], counters[2]);
    return 0;
}
"#;

/// The library that cargo built beside this test.
fn library() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let built = std::fs::read_dir(test.parent().unwrap()).unwrap();
    let named = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        name.starts_with("libhysteron_c") && name.ends_with(".a")
    };
    let changed = |path: &PathBuf| path.metadata().unwrap().modified().unwrap();
    let found = built.map(|entry| entry.unwrap().path()).filter(named);
    found.max_by_key(changed).expect("the static library")
}

fn run(folder: &Path, program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap_or_else(|error| panic!("{program}: {error}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{program}: {} {said}",
        output.status
    );
    String::from_utf8(output.stdout).unwrap()
}

/// What the program in C prints, by the servo in Rust.
fn expected(mut servo: ServoTick) -> String {
    let mut lines = String::new();
    let (mut sum, mut random) = (0xcbf2_9ce4_8422_2325u64, 1u64);
    let mut code = DriveCode::new(9362);
    for k in 0..TICKS {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let sensor = SensorCode::new(4369 + code.steps() / 2 + (random >> 61) as u32);
        let base = if k / 4000 % 2 == 1 { 12 } else { 4 } << 24;
        let reference = Micrometres::of_bits(base - (k % 4000 * 20_000) as i32);
        if k == 100 {
            servo.enable();
        }
        code = if k < 100 {
            servo.open_loop(DriveCode::new(9362 + k))
        } else {
            servo.tick(sensor, reference)
        };
        sum = (sum ^ u64::from(code.steps())).wrapping_mul(0x100_0000_01b3);
        if k % 10_000 == 9_999 {
            lines += &format!("{sum:x}\n");
        }
    }
    let found = servo.counters();
    assert!(found.limited_ticks > 0, "no limit was reached");
    lines
        + &format!(
            "{} {} {}\n",
            found.limited_ticks, found.unreachable_ticks, found.saturated_values
        )
}

#[test]
fn a_program_in_c_gives_the_codes_of_the_servo() {
    let chain = loops_and_mode(0.6);
    let folder = tempfile::tempdir().unwrap();
    let header = Path::new(env!("CARGO_MANIFEST_DIR")).join("hysteron_servo.h");
    std::fs::copy(header, folder.path().join("hysteron_servo.h")).unwrap();
    std::fs::write(folder.path().join("main.c"), MAIN).unwrap();
    let library = library();
    let words = "-std=c99 -pedantic -Wall -Wextra -Werror -O1 main.c -o servo";
    let mut arguments: Vec<&str> = words.split(' ').collect();
    arguments.extend([library.to_str().unwrap(), "-lpthread", "-ldl", "-lm"]);
    run(folder.path(), "cc", &arguments);
    let mut compared = 0;
    for scheme in SchemeChoice::ALL {
        let order = DesignOrder {
            scheme,
            ..DesignOrder::default()
        };
        // The thesis's own schemes are not designed for every stage.
        let Ok(servo) = design(&chain, &order) else {
            continue;
        };
        let parameters = amplifier_parameters(&servo, &FrontEnd::default()).unwrap();
        let mut bytes = block(&parameters).unwrap();
        bytes.resize(BLOCK_BYTES, 0xff);
        std::fs::write(folder.path().join("block.bin"), bytes).unwrap();
        let printed = run(folder.path(), "./servo", &[]);
        assert_eq!(printed, expected(ServoTick::new(parameters.servo)));
        compared += 1;
    }
    assert!(compared >= 3, "{compared} schemes were compared");
}

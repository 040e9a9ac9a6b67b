//! A host that chose a timeout and falls silent: the drive goes to rest with a fault of its own, whatever
//! channel the host spoke on.

use crate::common;

use common::{block, parameters, run_on, samples, world};
use hysteron_core::amplifier::Mode;
use hysteron_core::guard::Fault;
use hysteron_emulator::run::{MILLISECOND, Script};

const TIMEOUT_MS: u64 = 50;

#[test]
fn a_host_that_falls_silent_is_missed_while_the_drive_is_live() {
    let world = world();
    let mut parameters = parameters();
    parameters.guard.healthy_ticks = 100;
    // The timeout is there from 4 ms on, the next line comes at 90 ms: the power stage is off by then.
    let mut commands = vec![(
        4 * MILLISECOND,
        format!("trace 31 1\nconditioning waived\narm untested\ntimeout {TIMEOUT_MS}\n")
            .into_bytes(),
    )];
    commands.push((
        90 * MILLISECOND,
        b"arm untested\nreference constant 3000\nenable\n".to_vec(),
    ));
    commands.extend((1..6).map(|nth| ((90 + 20 * nth) * MILLISECOND, b"status\n".to_vec())));
    commands.push((400 * MILLISECOND, b"clear\narm untested\nenable\n".to_vec()));
    // From the probe's last line, at 190 ms, the serial port is the host; it is heard last at 270 ms.
    let serial = (0..5)
        .map(|nth| ((190 + 20 * nth) * MILLISECOND, b"ERR?\n".to_vec()))
        .collect();
    let script = Script {
        block: Some(block(&parameters)),
        commands,
        serial,
        ..Script::listening(480 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let switched: Vec<(u64, bool)> = outcome
        .enabled
        .iter()
        .map(|(at_ns, on)| (at_ns / MILLISECOND, *on))
        .collect();
    assert!(
        matches!(
            switched[..],
            [(4..=7, true), (54..=59, false), (90..=93, true), ..]
        ),
        "unattended at rest, it is switched off: {switched:?}"
    );
    let (samples, _) = samples(&outcome);
    let began_ns = world.lock().expect("the world").began_ns();
    let ms = |tick: u32| (u64::from(tick) * 50_000 + began_ns) as f64 / MILLISECOND as f64;
    let lost = samples
        .iter()
        .find(|sample| sample.flags as u8 == Mode::Fault as u8)
        .expect("a fault");
    assert_eq!(
        lost.flags,
        Mode::Fault as u16 | (Fault::HostLost as u16) << 8,
        "named"
    );
    let since = ms(lost.tick) - 270.0;
    println!(
        "host lost {since:.2} ms after its last line was given to the serial port; timeout {TIMEOUT_MS} ms"
    );
    assert!(
        (TIMEOUT_MS as f64..TIMEOUT_MS as f64 + 3.0).contains(&since),
        "{since}"
    );
    let before = samples
        .iter()
        .find(|sample| sample.tick + 1 == lost.tick)
        .expect("the tick before");
    assert_eq!(before.flags, Mode::Closed as u16);
    assert_eq!(
        before.dac_code,
        lost.dac_code + parameters.guard.ramp_codes,
        "on the way to rest in the very tick"
    );
    let rest = samples
        .iter()
        .find(|sample| ms(sample.tick) > 390.0)
        .expect("traced");
    assert_eq!(
        (rest.dac_code, rest.flags),
        (parameters.guard.rest_code, lost.flags),
        "rests, and stays"
    );
    // A line is a sign of life, `clear` itself too; and silent again it is lost again.
    let after: Vec<u16> = samples
        .iter()
        .filter(|sample| ms(sample.tick) > 402.0)
        .map(|sample| sample.flags)
        .collect();
    assert_eq!(after.first(), Some(&(Mode::Closed as u16)));
    assert_eq!(after.last(), Some(&lost.flags));
}

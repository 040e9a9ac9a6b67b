//! The probe that is meant, and the chip behind it.

use crate::failure::{Result, whole};
use probe_rs::probe::DebugProbeSelector;
use probe_rs::probe::list::{Accessibility, Lister, ProbeListItem};
use probe_rs::{Core, MemoryInterface, Permissions, Session};

/// As probe-rs names the chip.
const CHIP: &str = "STM32H743ZITx";
/// DBGMCU_IDC, whose lowest 12 bits are the device (RM0433, 60.5.8).
const DEVICE_IDENTITY: u64 = 0x5C00_1000;
/// STM32H742, H743, H750 and H753.
const DEVICE: u32 = 0x450;
/// FLASH_OPTSR_CUR, whose bits 15 to 8 are the read protection (RM0433, 4.9.8).
const OPTION_STATUS: u64 = 0x5200_201C;
/// No read protection.
const UNPROTECTED: u32 = 0xAA;
/// What to do where no probe can be used.
const NO_ACCESS: &str = "may not be opened by this user; on Linux copy the udev rules of https://probe.rs/docs/getting-started/probe-setup";

/// Writes the probes of this machine, one to a line.
pub fn list() -> Result<()> {
    let probes = Lister::new().list_all_with_access();
    if probes.is_empty() {
        return Err(none_found());
    }
    for ProbeListItem {
        info,
        accessibility,
    } in probes
    {
        let note = if accessibility == Accessibility::PermissionDenied {
            format!(" ({NO_ACCESS})")
        } else {
            String::new()
        };
        println!("{info}{note}");
    }
    Ok(())
}

fn none_found() -> String {
    "no debug probe was found: is the board's USB cable (ST-LINK, CN1) in, and does it carry data?"
        .into()
}

/// The one probe of those that are there which is meant.
///
/// # Errors
/// No probe is there, or there are several and the user has not specified which.
fn choose<P>(mut probes: Vec<P>, name: impl Fn(&P) -> String) -> Result<P> {
    match probes.len() {
        0 => Err(none_found()),
        1 => Ok(probes.remove(0)),
        _ => {
            let names: Vec<String> = probes.iter().map(name).collect();
            Err(format!(
                "{} debug probes are here: {}; say which with --probe=VID:PID:SERIAL",
                names.len(),
                names.join(", ")
            ))
        }
    }
}

/// A session with the chip, which goes on as it was.
///
/// # Errors
/// No probe, several, one that cannot be opened; no chip behind it, or another one; a chip whose flash is
/// protected.
pub fn connect(selector: Option<&str>) -> Result<Session> {
    let lister = Lister::new();
    let wanted = match selector {
        Some(text) => {
            let wrong = |_| {
                format!(
                    "--probe={text}: expected VID:PID or VID:PID:SERIAL, as `hysteron-probe list` shows them"
                )
            };
            Some(text.parse::<DebugProbeSelector>().map_err(wrong)?)
        }
        None => None,
    };
    let probes = lister.list_with_access(wanted.as_ref());
    if let (Some(text), true) = (selector, probes.is_empty()) {
        return Err(format!(
            "no debug probe {text} was found; `hysteron-probe list` shows those that are here"
        ));
    }
    let ProbeListItem {
        info,
        accessibility,
    } = choose(probes, |probe| probe.info.to_string())?;
    if accessibility == Accessibility::PermissionDenied {
        return Err(format!("{info}: {NO_ACCESS}"));
    }
    let probe = lister
        .open(&info)
        .map_err(|error| format!("{info}: cannot be opened: {}", whole(&error)))?;
    let mut session = probe.attach(CHIP, Permissions::default()).map_err(|error| {
        format!("no STM32H743ZI answers behind {info}: {}; is the board powered, and no other debugger attached?", whole(&error))
    })?;
    let mut core = session.core(0).map_err(|error| whole(&error))?;
    right_chip(&mut core)?;
    drop(core);
    Ok(session)
}

fn register(core: &mut Core, address: u64) -> Result<u32> {
    core.read_word_32(address)
        .map_err(|error| format!("the chip does not give {address:#010x}: {}", whole(&error)))
}

fn right_chip(core: &mut Core) -> Result<()> {
    identified(register(core, DEVICE_IDENTITY)?)?;
    unprotected(register(core, OPTION_STATUS)?)
}

/// Whether the device is the right one.
fn identified(identity: u32) -> Result<()> {
    let device = identity & 0xFFF;
    if device == DEVICE {
        return Ok(());
    }
    Err(format!(
        "the chip calls itself device {device:#05x}; expected {DEVICE:#05x}, an STM32H743. Nothing was written"
    ))
}

/// Whether its flash can be read and written.
fn unprotected(options: u32) -> Result<()> {
    let protection = options >> 8 & 0xFF;
    if protection == UNPROTECTED {
        return Ok(());
    }
    Err(format!(
        "the chip's flash is read-protected (RDP {protection:#04x}): it has to be unlocked first, which erases all of it, parameter blocks included; STM32CubeProgrammer does that. Nothing was written"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_probe_is_taken_and_with_several_all_are_named() {
        let name = |probe: &&str| (*probe).to_string();
        assert!(
            choose(Vec::<&str>::new(), name)
                .expect_err("none")
                .contains("no debug probe")
        );
        assert_eq!(choose(vec!["a"], name), Ok("a"));
        let several = choose(vec!["ST-Link 1", "ST-Link 2"], name).expect_err("two");
        assert!(
            several.contains("ST-Link 1, ST-Link 2") && several.contains("--probe"),
            "{several}"
        );
    }

    #[test]
    fn another_chip_and_a_locked_one_are_named() {
        // Revision V of an STM32H743, and an STM32F767.
        assert_eq!(identified(0x2003_6450), Ok(()));
        assert!(
            identified(0x1000_6451)
                .expect_err("another")
                .contains("0x451")
        );
        assert_eq!(unprotected(0x1406_AAF0), Ok(()));
        for level in [0x55, 0xCC, 0x00] {
            assert!(
                unprotected(0x1406_00F0 | level << 8)
                    .expect_err("locked")
                    .contains("read-protected"),
                "{level:#x}"
            );
        }
    }

    #[test]
    fn a_selector_that_is_none_is_refused_before_a_probe_is_looked_for() {
        let refused = connect(Some("the blue one"))
            .map(drop)
            .expect_err("no selector");
        assert!(
            refused.contains("the blue one") && refused.contains("VID:PID"),
            "{refused}"
        );
        let missing = connect(Some("ffff:ffff:none"))
            .map(drop)
            .expect_err("no such probe");
        assert!(missing.contains("ffff:ffff:none"), "{missing}");
    }
}

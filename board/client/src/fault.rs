//! Faults by their numbers and names, and what an operator does about each.

use hysteron_core::guard::Fault;

/// The name of a fault by its number, as `DIA? 2` has it.
#[must_use]
pub fn fault_name(number: f64) -> &'static str {
    Fault::from_number(number as u8).map_or("none", Fault::name)
}

/// What an operator does about a fault, by its name.
#[must_use]
pub fn what_to_do(fault: &str) -> &'static str {
    let found = Fault::ALL
        .iter()
        .find(|(_, name)| *name == fault)
        .map(|(fault, _)| *fault);
    match found {
        Some(Fault::SensorSilent) => {
            "The sensor's converter does not answer: look at its supply and cable, then clear (INI)."
        }
        Some(Fault::SensorOutOfRange) => {
            "The sensor is at its end or its cable is open: look at both, then clear (INI)."
        }
        Some(Fault::SensorStuck) => {
            "The sensor gives the same value again and again: look at its supply and cable, then clear (INI)."
        }
        Some(Fault::SensorJump) => {
            "The sensor jumped further than the stage can: look for a loose contact, then clear (INI)."
        }
        Some(Fault::TrackingError) => {
            "The stage did not follow its reference: is it blocked, its amplifier off, the reference too fast? Then clear (INI)."
        }
        Some(Fault::DriveSlew) => {
            "The servo asked for faster drives than the amplifier gives: a slower reference, or a new design; then clear (INI)."
        }
        Some(Fault::Overrun) => {
            "A control tick came late, which must not be: clear (INI), and report it if it comes again."
        }
        Some(Fault::ParameterBlock) => {
            "No valid parameter block is in the flash: `hysteron board upload` or `hysteron board tune` brings one."
        }
        Some(Fault::Watchdog) => {
            "The program had stopped and was restarted: clear (INI), and report it if it comes again."
        }
        Some(Fault::BrownOut) => "The supply had failed: look at it, then clear (INI).",
        Some(Fault::HardFault) => {
            "The processor had stopped on an error and was restarted: clear (INI), and report it."
        }
        Some(Fault::ClockLost) => {
            "The board's crystal had stopped: clear (INI); if it comes again the board needs repair."
        }
        Some(Fault::EmergencyStop) => "The emergency stop is open: close it, then clear (INI).",
        Some(Fault::Interlock) => "The interlock is open: close it, then clear (INI).",
        Some(Fault::AmplifierNotReady) => {
            "The amplifier says that it is not ready: look at it, then clear (INI)."
        }
        Some(Fault::HostLost) => {
            "No line came for as long as the host had allowed: clear (INI), condition (ATZ), and go on."
        }
        Some(Fault::SupplyLow) => {
            "The board's supply had fallen below 2.8 V: look at it, then clear (INI)."
        }
        Some(Fault::DriveSilent) => {
            "The drive's converter does not take its code: look at its supply, its cable and its references, then clear (INI) and arm (ARM 1 1)."
        }
        Some(Fault::SensorDoesNotMove) => {
            "The drive changed and the sensor did not: is the amplifier on and connected, the stage free, the sensor's cable in? Then clear (INI)."
        }
        Some(Fault::SensorReversed) => {
            "The sensor falls when the drive rises: exchange its two wires, or its sign in the front end, then clear (INI)."
        }
        Some(Fault::GainDiffers) => {
            "The stage moved much less or more than the block says: look at the amplifier's gain, the sensor's range and which block is in use, then clear (INI)."
        }
        Some(Fault::SensorDrifts) => {
            "The sensor did not come back with the drive: let it warm up, look for a loose mount, then clear (INI)."
        }
        Some(Fault::SensorNoisy) => {
            "The sensor has more noise than the motion that the self-test looks for: look at its cable and shield, then clear (INI)."
        }
        Some(Fault::RangeNotReached) => {
            "The conditioning did not reach both ends of the drive: clear (INI), and report it."
        }
        Some(Fault::DriveCurrent) => {
            "The drive asked for more current than the envelope allows: a slower or smaller wave, then clear (INI)."
        }
        Some(Fault::BeyondEnvelope) => {
            "A drive left the board's safety envelope and was held at its end: clear (INI), and report it."
        }
        Some(Fault::NoEnvelope) => {
            "The board has no safety envelope and drives nothing: `hysteron board envelope FILE` brings one."
        }
        Some(Fault::OutputDiffers) => {
            "The amplifier's output is not the drive that was written: look at its gain, its supply, its cable and which block is in use, then clear (INI) and arm (ARM 1 1)."
        }
        Some(Fault::OutputWhileOff) => {
            "The amplifier's output moves though its power stage is switched off: look at the relay or the enable input before you go near it, then clear (INI) and arm (ARM 1 1)."
        }
        Some(Fault::MonitorOutOfRange) => {
            "The cable of the amplifier's voltage monitor is open or shorted: look at it, then clear (INI) and arm (ARM 1 1)."
        }
        Some(Fault::DriveNotHeld) => {
            "The drive's converter holds another code than was written: look at its cable (SDO) and its supply, then clear (INI) and arm (ARM 1 1)."
        }
        Some(Fault::PartTooHot) => {
            "The board is too hot: look at its cooling, wait (DIA? 18 has its temperature), then clear (INI) and arm (ARM 1 1)."
        }
        Some(Fault::AmplifierTooHot) => {
            "The amplifier is too hot or its temperature sensor is open: let it cool, look at its fan and the cable, then clear (INI)."
        }
        Some(Fault::SetPointOpen) => {
            "The analogue set point is open or shorted: look at its cable and source, then clear (INI) and arm (ARM 1 1)."
        }
        Some(Fault::UpdateRolledBack) => {
            "The new image did not run for a healthy second and the one before it is back: look at LOG?, then clear (INI)."
        }
        Some(Fault::LoopSwings) => {
            "The loop swung: another load, a filter or a block that does not suit the stage? Take it back, then clear (INI)."
        }
        Some(Fault::KeptSettings) => {
            "The settings that were kept cannot be used, and those of a new board are in force: clear (INI), set them and keep them (WPA 100)."
        }
        Some(Fault::Stalled) => {
            "The slider does not move with the saw-teeth: look for what jams or loads it, then clear (INI) and arm (ARM 1 1)."
        }
        Some(Fault::EndOfTravel) => {
            "The slider is at an end of its travel: clear (INI), arm (ARM 1 1), close the loop and move it back."
        }
        None => "firmware/README.md, Faults, says what sees it and how it comes back.",
    }
}

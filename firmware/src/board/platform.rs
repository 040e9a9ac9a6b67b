//! What a board is to the rest of the firmware.

use cortex_m::peripheral::SCB;
use embassy_stm32::interrupt::Interrupt;
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::iwdg::Iwdg;
use embassy_stm32::pac::usart::Lpuart;
use embassy_stm32::usart::{Config as SerialConfig, ConfigError, Uart};
use embassy_stm32::{Config, Peripherals};
use hysteron_core::guard::Fault;
use hysteron_firmware_shared::flash_read::FlashInterface;

use crate::board::light::Light;
use crate::front_end::FrontEnd;

/// Control ticks per second, which build.rs has from the environment.
pub const SAMPLE_RATE_HZ: u32 = match u32::from_str_radix(env!("HYSTERON_SAMPLE_RATE_HZ"), 10) {
    Ok(rate_hz) => rate_hz,
    Err(_) => panic!("build.rs gives a number"),
};

/// Whether temperatures are read at this sampling rate: there must be time for a conversion within a period.
pub const TEMPERATURES_ARE_READ: bool = SAMPLE_RATE_HZ <= 20_000;

/// What a board is to the firmware. The sample clock is TIM2 and the tasks' clock TIM5 on every board.
#[allow(async_fn_in_trait)] // one executor runs all tasks: nobody asks whether a future is `Send`
pub trait Platform: FlashInterface {
    /// Bytes of the log on its way to the probe.
    const LOG_BYTES: usize;
    /// Samples that the recorder keeps; a power of two.
    const RECORDED_SAMPLES: u32;
    /// Points of a wave table.
    const WAVE_POINTS: usize;
    /// Whether a period has time for a swap, some 3,750 instructions before the tick.
    const SWAPS: bool;
    /// Whether a period has time for a swap that evaluates the whole memory of the hysteresis anew: some
    /// 13,000 instructions before the tick.
    const SWAPS_HYSTERESIS: bool;
    /// Sensor and drive.
    type Converters: FrontEnd;
    /// The lines that make a bench safe.
    const LINES: Lines;
    /// The lights of the board.
    const LIGHTS: &'static [Light];
    /// The independent watchdog.
    const WATCHDOG: Iwdg;
    /// The serial port's interrupt.
    const SERIAL_INTERRUPT: Interrupt;
    /// Names and addresses of the two places of a parameter block: sectors that no code occupies, in a bank
    /// that no code is in.
    const BLOCKS: [(&'static str, u32); 2];
    /// Address and length of the bank of the flash that is written while the program runs; no code of the
    /// image is in it.
    const DATA_BANK: (u32, u32);
    /// The sector of the settings that the operator keeps.
    const KEPT_SETTINGS: u32;
    /// The sector of the safety envelope.
    const ENVELOPE: u32;
    /// Bytes of a sector; the last 32 of a block's are the mark that another one replaces it.
    const SECTOR_BYTES: u32;
    /// Another such sector, which the board check may write.
    const SPARE_SECTOR: u32;
    /// The first address behind the flash.
    const BEYOND_FLASH: u32;
    /// The brown-out level that [`Platform::write_protection`] sets.
    const BROWN_OUT_LEVEL: &'static str;

    /// Switches the crystal on; whether it runs.
    fn crystal_runs() -> bool;
    /// Switches caches on that the part leaves off.
    fn use_caches(control: &mut SCB);
    /// The clock tree, for the HAL.
    fn clock_tree() -> Config;
    /// Lets a crystal that stops raise the NMI.
    fn watch_crystal();
    /// What an NMI stops for; `None`: it has been noted, and the program goes on.
    fn cause_of_nmi() -> Option<Fault>;
    /// The clock of TIM2.
    fn clock_sample_timer();
    /// The clocks of the ports of [`Platform::LINES`], read back.
    fn clock_lines();
    /// The clocks of the ports of [`Platform::LIGHTS`], read back.
    fn clock_lights();
    /// What the reset flags say; clears them.
    fn reset_cause() -> ResetCause;

    /// The part's temperature of a code of its sensor, tenths of a degree Celsius; `None` on a board that reads
    /// none.
    fn part_decicelsius(_code: u16) -> Option<i32> {
        None
    }

    /// The serial port that the debugger on the board makes a virtual COM port of.
    ///
    /// # Errors
    /// The HAL's: a speed that the port cannot have.
    fn serial_port(
        peripherals: Peripherals,
        config: SerialConfig,
    ) -> Result<Uart<'static, Blocking>, ConfigError>;
    /// Its registers.
    fn serial_registers() -> Lpuart;

    /// Erases the sector at `address`, one of [`Platform::BLOCKS`], and writes `bytes` to its beginning,
    /// without ever holding up the tasks.
    ///
    /// # Errors
    /// The flash refused it, or does not answer.
    async fn write_sector(address: u32, bytes: &[u8]) -> Result<(), &'static str>;
    /// Programs 32 bytes of zeros at `address`, which is erased.
    ///
    /// # Errors
    /// The flash refused it, or does not answer.
    async fn write_mark(address: u32) -> Result<(), &'static str>;
    /// What the option bytes protect: 1 the brown-out level is high enough, 2 the watchdog starts with the
    /// supply, 3 both.
    fn protection() -> u32;
    /// Writes them, everything else as it is.
    ///
    /// # Errors
    /// They were not taken.
    async fn write_protection() -> Result<(), &'static str>;

    /// Starts the detector of the supply's voltage; it needs some 50 us.
    fn start_supply_detector();
    /// Whether the supply is too low.
    fn supply_is_low() -> bool;
    /// Lets a supply that falls stop the drive from now on.
    fn watch_supply();
}

/// The lines that make a bench safe: a port and numbers of its pins.
pub struct Lines {
    /// All of them are pins of this port.
    pub port: Gpio,
    /// Input: a contact to ground that opens to stop.
    pub emergency_stop: usize,
    /// Input: the same.
    pub interlock: usize,
    /// Input: the amplifier's output that conducts to ground while it is ready.
    pub amplifier_ready: usize,
    /// Output: lets the amplifier's power stage work.
    pub enable: usize,
    /// Output: high with the marked point of a wave table.
    pub trigger: usize,
}

/// What reset the part, as far as its flags tell.
#[derive(Clone, Copy)]
pub struct ResetCause {
    /// The independent watchdog.
    pub watchdog: bool,
    /// The program itself.
    pub software: bool,
    /// The supply fell and came back, and was not switched on.
    pub brown_out: bool,
}

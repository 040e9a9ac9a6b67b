//! Hysteron's firmware for the STM32H743ZI (NUCLEO-H743ZI2).
//!
//! A hardware timer beats at 20 kHz ([`sample_clock`]); its compare interrupt, the only one at the highest priority, runs the
//! control tick ([`control`]). Everything else runs in Embassy tasks below it and can never delay it: the critical sections of
//! this image mask every priority but that one ([`critical_section_below_control`]).
#![no_std]
#![no_main]

mod board;
mod control;
mod critical_section_below_control;
mod fault;
mod itcm;
mod sample_clock;

use embassy_executor::Spawner;
use embassy_time::{Duration, Ticker};
use rtt_target::{ChannelMode, rtt_init};

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let channels = rtt_init! {
        up: { 0: { size: 16384, mode: ChannelMode::NoBlockSkip, name: "defmt" } }
        down: { 0: { size: 1024, name: "commands" } }
    };
    rtt_target::set_defmt_channel(channels.up.0);

    let peripherals = board::init();
    let clocks = board::clocks(&peripherals);
    defmt::info!(
        "hysteron {=str}: core {=u32} Hz, control {=u32} Hz",
        env!("CARGO_PKG_VERSION"),
        clocks.core_hz,
        sample_clock::SAMPLE_RATE_HZ
    );
    sample_clock::start(clocks.timer_hz);

    let mut ticker = Ticker::every(Duration::from_millis(5));
    loop {
        ticker.next().await;
        defmt::info!("ticks {=u32}", control::ticks());
    }
}

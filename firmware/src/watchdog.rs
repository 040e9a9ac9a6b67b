//! The watchdog restarts a program whose ticks or tasks have stopped. What feeds it also judges an image on
//! trial.

use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use hysteron_core::guard::Fault;

use crate::board::{Board, Platform};
use crate::{control, fault, lights, serial_port, task_clock, temperature, update, update_state};

/// Watchdog period: 32 kHz / 16 counts down from this in 50 ms.
const WATCHDOG_COUNTS: u16 = 100;
/// Periods of the tasks' clock between two feedings: 10 ms.
const WATCH_PERIODS: u64 = 10;

/// Feedings in a row, each behind ticks that went on and were not late, with a serial port that answers, that make an image healthy: 1 s.
const HEALTHY_FEEDINGS: u32 = 100;
/// An image on trial that has not been healthy after so many is restarted, and so rolled back: 10 s.
const MOST_TRIAL_FEEDINGS: u32 = 1_000;

/// Starts the watchdog and feeds it as long as ticks and tasks go on.
pub async fn watch() {
    Board::WATCHDOG.kr().write(|w| w.set_key(Key::START));
    Board::WATCHDOG.kr().write(|w| w.set_key(Key::ENABLE));
    Board::WATCHDOG.pr().write(|w| w.set_pr(Pr::DIVIDE_BY16));
    Board::WATCHDOG.rlr().write(|w| w.set_rl(WATCHDOG_COUNTS));
    let mut last = control::ticks();
    lights::show(&control::state());
    let (mut overruns, mut healthy, mut of_trial) = (control::overruns(), 0, 0);
    loop {
        task_clock::periods(WATCH_PERIODS).await;
        let state = control::state();
        lights::show(&state);
        temperature::watch();
        let ticks = state.ticks as u32;
        if ticks != last {
            Board::WATCHDOG.kr().write(|w| w.set_key(Key::RESET));
        }
        if update_state::is_on_trial() {
            let went_on = ticks != last
                && control::overruns() == overruns
                // Without it nobody could bring another image.
                && serial_port::is_alive();
            healthy = if went_on { healthy + 1 } else { 0 };
            of_trial += 1;
            if healthy == HEALTHY_FEEDINGS {
                update::healthy();
            } else if of_trial == MOST_TRIAL_FEEDINGS {
                fault::stop(Fault::UpdateRolledBack);
            }
        }
        overruns = control::overruns();
        last = ticks;
    }
}

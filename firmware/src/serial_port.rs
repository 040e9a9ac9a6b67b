//! The serial port (the virtual COM port of the NUCLEO's debugger): the General Command Set over 115200 baud,
//! 8N1.
//!
//! # How it works
//! The port's interrupt ([`crate::serial_line`]) takes bytes as they come, and lets a stop byte act at once.
//! One task makes lines of them, which wait in [`LINES`], and forgets a line of which bytes are missing. The
//! other task obeys them one after the other and sends the answers. Its work comes in pieces
//! ([`Session::next`]), between which the first has its turn. The port's interrupt is far below the control
//! interrupt.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_futures::yield_now;
use embassy_stm32::Peripherals;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::usart::Config;
use embassy_sync::blocking_mutex::ThreadModeMutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::signal::Signal;
use hysteron_core::amplifier_command::Command;
use hysteron_core::command_lines::{Received, STOP_BYTE};
use hysteron_core::line_input::Arrived;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_protocol::session::{Outcome, Piece, Session, Step};
use hysteron_protocol::{DIALECT, Lines};
use static_cell::StaticCell;

use crate::board::{Board, Platform};
use crate::control::{self, Reply, Source};
use crate::serial_device::{Target, WAVES};
use crate::serial_line::{self, SerialLine};
use crate::{command_port, settings, task_clock};

/// The line's speed after a start, unless the operator kept another, bit/s.
const BAUD: u32 = 115_200;
/// Periods of the tasks' clock that an answer of the amplifier takes at most: far more than the ticks of a
/// full queue.
const MOST_PERIODS: u32 = 100;

static LINES: ThreadModeMutex<RefCell<Lines>> =
    ThreadModeMutex::new(RefCell::new(Lines::of(DIALECT)));
static LINE_CAME: Signal<ThreadModeRawMutex, ()> = Signal::new();
static TOO_LONG: Signal<ThreadModeRawMutex, ()> = Signal::new();
static NO_ROOM: Signal<ThreadModeRawMutex, ()> = Signal::new();
static INCOMPLETE: Signal<ThreadModeRawMutex, ()> = Signal::new();
static REPLY: Signal<ThreadModeRawMutex, Reply> = Signal::new();
/// Turns that the tasks have had: of the first since the last look, of the other since the start.
static RECEIVING_TURNS: AtomicU32 = AtomicU32::new(0);
static OBEYING_TURNS: AtomicU32 = AtomicU32::new(0);
static SESSION: StaticCell<Session<Target>> = StaticCell::new();

/// Opens the port: what [`obeying`] needs.
pub fn open(
    peripherals: Peripherals,
    parameters: AmplifierParameters,
) -> Option<(SerialLine, &'static mut Session<Target>)> {
    Board::SERIAL_INTERRUPT.set_priority(Priority::P8);
    let mut config = Config::default();
    let baud = settings::kept_settings().map_or(BAUD, |kept| kept.baud);
    config.baudrate = baud;
    match Board::serial_port(peripherals, config) {
        Ok(port) => {
            let line = SerialLine::open(port, baud);
            let session = SESSION.init_with(|| Session::new(Target, parameters, &WAVES));
            Some((line, session))
        }
        Err(_) => {
            defmt::error!("the serial port cannot be set up");
            None
        }
    }
}

/// Whether the port can be spoken to: it is set up, its tasks have had their turns, and the one that takes
/// bytes has answered the last call. Calls it again.
pub fn is_alive() -> bool {
    let answered = RECEIVING_TURNS.swap(0, Ordering::Relaxed) > 0;
    serial_line::CAME.signal(());
    answered && OBEYING_TURNS.load(Ordering::Relaxed) > 0
}

/// Takes what became of a command of this port.
pub fn take(reply: Reply) {
    REPLY.signal(reply);
}

/// Makes lines of what comes.
#[embassy_executor::task]
pub async fn receiving() {
    loop {
        serial_line::CAME.wait().await;
        let mut stop_came = false;
        while let Some(arrived) = serial_line::INPUT.take() {
            stop_came |= arrived == Arrived::Byte(STOP_BYTE);
            let (received, came) = LINES.lock(|lines| {
                let mut lines = lines.borrow_mut();
                let before = lines.waiting();
                let received = match arrived {
                    Arrived::Byte(byte) => lines.receive(&[byte]),
                    Arrived::Loss => {
                        lines.lose();
                        Received::default()
                    }
                };
                (received, lines.waiting() > before)
            });
            if came || received.stop || received.no_room > 0 {
                control::hear_host();
            }
            // The byte has acted in the interrupt.
            if received.stop && arrived != Arrived::Byte(STOP_BYTE) {
                command_port::stop();
            }
            if received.too_long > 0 {
                TOO_LONG.signal(());
            }
            if received.no_room > 0 {
                NO_ROOM.signal(());
            }
            if received.incomplete > 0 {
                INCOMPLETE.signal(());
            }
        }
        let stop_waited = serial_line::stop_waits();
        if serial_line::all_taken() && stop_waited && !stop_came {
            // The byte found no room: what waits came before it all the same.
            LINES.lock(|lines| lines.borrow_mut().receive(&[STOP_BYTE]));
        }
        RECEIVING_TURNS.fetch_add(1, Ordering::Relaxed);
        LINE_CAME.signal(());
    }
}

/// Obeys them.
#[embassy_executor::task]
pub async fn obeying(mut port: SerialLine, session: &'static mut Session<Target>) {
    let mut piece = Piece::new();
    loop {
        LINE_CAME.wait().await;
        OBEYING_TURNS.store(1, Ordering::Relaxed);
        while let Some(line) = LINES.lock(|lines| lines.borrow_mut().next()) {
            // Read before the line is obeyed: a stop that comes from here on ends what it began.
            let stops = command_port::stops();
            if TOO_LONG.try_take().is_some() {
                session.too_long();
            }
            if NO_ROOM.try_take().is_some() {
                session.overrun();
            }
            if INCOMPLETE.try_take().is_some() {
                session.lost_bytes();
            }
            session.obey(&line.bytes, line.before_stop || serial_line::stop_waits());
            loop {
                match session.next(&mut piece) {
                    Step::Done => break,
                    Step::Send => port.send(&piece).await,
                    Step::Command(command) => {
                        let outcome = submit(command, stops).await;
                        session.outcome(outcome);
                    }
                    Step::Work => yield_now().await,
                }
            }
            // Nothing of this port has moved the drive since; the probe may have.
            if port.restart_is_asked() && control::drive_rests() {
                cortex_m::peripheral::SCB::sys_reset();
            }
            port.take_baud();
        }
    }
}

/// Gives a command to the amplifier, unless it was stopped since, and waits for what becomes of it.
async fn submit(command: Command, stops: u32) -> Outcome {
    REPLY.reset();
    match command_port::submit_unless_stopped(Source::Serial, command, stops) {
        None => return Outcome::Stopped,
        Some(false) => return Outcome::NoRoom,
        Some(true) => {}
    }
    for _ in 0..MOST_PERIODS {
        task_clock::next().await;
        if let Some(reply) = REPLY.try_take() {
            return match reply.outcome {
                control::Outcome::Refused(refusal) => Outcome::Refused(refusal),
                control::Outcome::CannotWait(_) => Outcome::NoRoom,
                control::Outcome::Done => Outcome::Done(reply.tick),
                control::Outcome::Stopped(_) => Outcome::Stopped,
            };
        }
        if command_port::stops() != stops {
            // Commands from before the stop still arrive within a period.
            task_clock::periods(2).await;
            return Outcome::Stopped;
        }
    }
    Outcome::NoRoom
}

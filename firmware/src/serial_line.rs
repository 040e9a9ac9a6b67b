//! The serial port's interrupt: bytes in and out, and what goes wrong on the line.
//!
//! # How it works
//! The interrupt alone reads the receiver. A byte with a framing or noise error, and what an overrun cost, is
//! put into [`INPUT`] as a loss, so that the task forgets the line it was in; so is a byte for which there is
//! no room. A stop byte acts here, before the queue, however full that is and whatever the tasks do. What is
//! sent stands in [`Outgoing`] until its last stop bit has gone.

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use critical_section::Mutex;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::usart::Lpuart;
use embassy_stm32::usart::Uart;
use embassy_sync::blocking_mutex::raw::{CriticalSectionRawMutex, ThreadModeRawMutex};
use embassy_sync::signal::Signal;
use hysteron_core::command_lines::STOP_BYTE;
use hysteron_core::line_input::LineInput;

use crate::board::{Board, Platform};
use crate::command_port;

/// Bytes that wait for the task that makes lines of them: 22 ms at 115200 bit/s.
const INPUT_BYTES: usize = 256;
/// Bytes that are sent at once.
const OUTPUT_BYTES: usize = 192;

/// What has come.
pub static INPUT: LineInput<INPUT_BYTES> = LineInput::new();
/// Something has come and the line is silent, or half of the room is used.
pub static CAME: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// A stop byte has acted here and is not yet among the lines: those that wait came before it.
static STOP_WAITS: AtomicBool = AtomicBool::new(false);

/// The line's speed, bit/s, and what is asked of the port once what is being sent has gone.
static BAUD: AtomicU32 = AtomicU32::new(0);
static BAUD_CHANGED: Signal<ThreadModeRawMutex, u32> = Signal::new();
static RESTART: Signal<ThreadModeRawMutex, ()> = Signal::new();

/// The line's speed, bit/s.
pub fn baud() -> u32 {
    BAUD.load(Ordering::Relaxed)
}

/// Changes it, once what is being sent has gone.
pub fn set_baud(baud: u32) {
    BAUD_CHANGED.signal(baud);
}

/// Restarts the part, once what is being sent has gone.
pub fn restart() {
    RESTART.signal(());
}

/// Whether the lines that wait came before a stop.
pub fn stop_waits() -> bool {
    STOP_WAITS.load(Ordering::Relaxed)
}

/// Whether everything that came has been taken; then no stop waits any more.
pub fn all_taken() -> bool {
    critical_section::with(|_| {
        let all = INPUT.waiting() == 0;
        if all {
            STOP_WAITS.store(false, Ordering::Relaxed);
        }
        all
    })
}

struct Outgoing {
    bytes: heapless::Vec<u8, OUTPUT_BYTES>,
    sent: usize,
}

static OUTGOING: Mutex<RefCell<Outgoing>> = Mutex::new(RefCell::new(Outgoing {
    bytes: heapless::Vec::new(),
    sent: 0,
}));
static GONE: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Something is being sent.
static SENDS: AtomicBool = AtomicBool::new(false);

fn registers() -> Lpuart {
    Board::serial_registers()
}

/// The port, set up and switched on.
pub struct SerialLine(Uart<'static, Blocking>);

impl SerialLine {
    /// Lets the interrupt have the port, which has this speed.
    pub fn open(port: Uart<'static, Blocking>, baud: u32) -> Self {
        BAUD.store(baud, Ordering::Relaxed);
        registers().cr3().modify(|w| w.set_eie(true));
        registers().cr1().modify(|w| {
            w.set_rxneie(true);
            w.set_idleie(true);
        });
        // SAFETY: the handler shares atomics and what stands behind critical sections.
        unsafe { Board::SERIAL_INTERRUPT.enable() };
        Self(port)
    }

    /// Sends bytes, and returns when the last one has gone.
    pub async fn send(&mut self, bytes: &[u8]) {
        for part in bytes.chunks(OUTPUT_BYTES) {
            GONE.reset();
            critical_section::with(|section| {
                let mut outgoing = OUTGOING.borrow_ref_mut(section);
                outgoing.bytes.clear();
                let _ = outgoing.bytes.extend_from_slice(part);
                outgoing.sent = 0;
                SENDS.store(true, Ordering::Relaxed);
                registers().cr1().modify(|w| w.set_txeie(true));
            });
            GONE.wait().await;
        }
    }

    /// Whether somebody has asked for a restart since the last look.
    pub fn restart_is_asked(&self) -> bool {
        RESTART.try_take().is_some()
    }

    /// Takes another speed that was asked for, between two bytes and while the port is off. Where the port
    /// cannot have it the speed stays.
    pub fn take_baud(&mut self) {
        let Some(baud) = BAUD_CHANGED.try_take() else {
            return;
        };
        critical_section::with(|_| {
            registers().cr1().modify(|w| w.set_ue(false));
            if self.0.set_baudrate(baud).is_ok() {
                BAUD.store(baud, Ordering::Relaxed);
            }
            registers().cr1().modify(|w| w.set_ue(true));
        });
    }
}

/// What the port's interrupt does.
pub fn on_interrupt() {
    let port = registers();
    loop {
        let status = port.isr().read();
        let garbled = status.fe() || status.ne() || status.pe();
        if garbled || status.ore() || status.idle() {
            port.icr().write(|w| {
                w.set_fe(status.fe());
                w.set_ne(status.ne());
                w.set_pe(status.pe());
                w.set_ore(status.ore());
                w.set_idle(status.idle());
            });
        }
        if status.rxne() {
            let byte = port.rdr().read().0 as u8;
            if byte == STOP_BYTE && !garbled {
                STOP_WAITS.store(true, Ordering::Relaxed);
                command_port::stop();
            }
            INPUT.put((!garbled).then_some(byte));
        }
        if status.ore() {
            INPUT.put(None);
        }
        if status.idle() || INPUT.waiting() >= INPUT_BYTES / 2 {
            CAME.signal(());
        }
        if !status.rxne() {
            break;
        }
    }
    if SENDS.load(Ordering::Relaxed) {
        critical_section::with(|section| {
            go_on_sending(port, &mut OUTGOING.borrow_ref_mut(section))
        });
    }
}

fn go_on_sending(port: Lpuart, outgoing: &mut Outgoing) {
    while port.isr().read().txe()
        && let Some(byte) = outgoing.bytes.get(outgoing.sent)
    {
        port.tdr().write(|w| w.0 = u32::from(*byte));
        outgoing.sent += 1;
    }
    let all = outgoing.sent >= outgoing.bytes.len();
    // With nothing left to give, the end of the last byte is what is waited for.
    let gone = all && port.isr().read().tc();
    port.cr1().modify(|w| {
        w.set_txeie(!all);
        w.set_tcie(all && !gone);
    });
    if gone {
        SENDS.store(false, Ordering::Relaxed);
        GONE.signal(());
    }
}

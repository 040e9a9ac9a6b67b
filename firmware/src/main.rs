//! Hysteron's firmware: starts what the library has, and hands it its interrupts and faults.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use embassy_executor::{SpawnError, SpawnToken, Spawner};
use hysteron_core::amplifier::Amplifier;
use hysteron_core::codes::DriveCode;
use hysteron_core::command_schedule::CommandSchedule;
use hysteron_core::guard::Fault;
use hysteron_core::output_limit::OutputLimit;
use hysteron_core::output_monitor::OutputMonitor;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::set_point::SetPoint;
use hysteron_core::trace_frame::PackedSample;
use hysteron_firmware::board::{self, Board, Converters, Platform, SAMPLE_RATE_HZ};
use hysteron_firmware::control::{self, COMMAND_QUEUE, Control, Reply, SAMPLE_QUEUE, Scheduled};
use hysteron_firmware::front_end::{CodeBits, FrontEnd, Wiring};
use hysteron_firmware::ring::{Consumer, Producer, Ring};
use hysteron_firmware::{
    command_port, command_tasks, event_log, fault, lights, option_bytes, recorder, safety_lines,
    sample_clock, serial_line, serial_port, settings, stack, supply, telemetry, trace_tasks,
    update, watchdog,
};
use rtt_target::{ChannelMode, rtt_init};
use static_cell::StaticCell;

static SAMPLES: StaticCell<Ring<PackedSample, SAMPLE_QUEUE>> = StaticCell::new();
static COMMANDS: StaticCell<Ring<Scheduled, COMMAND_QUEUE>> = StaticCell::new();
static REPLIES: StaticCell<Ring<Reply, COMMAND_QUEUE>> = StaticCell::new();

/// What the image says of itself.
#[cfg(feature = "nucleo-h743zi")]
#[used]
#[unsafe(link_section = ".image_header")]
static HEADER: hysteron_core::firmware_update::ImageHeader = update::HEADER;

#[unsafe(no_mangle)]
#[unsafe(link_section = ".control_code")]
extern "C" fn TIM2() {
    control::on_interrupt();
}

#[cfg_attr(feature = "nucleo-h743zi", unsafe(export_name = "USART3"))]
#[cfg_attr(feature = "nucleo-g474re", unsafe(export_name = "LPUART1"))]
extern "C" fn serial_interrupt() {
    serial_line::on_interrupt();
}

#[cfg_attr(feature = "nucleo-h743zi", unsafe(export_name = "PVD_AVD"))]
#[cfg_attr(feature = "nucleo-g474re", unsafe(export_name = "PVD_PVM"))]
extern "C" fn supply_interrupt() {
    fault::stop(Fault::SupplyLow)
}

#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    if let Some(cause) = Board::cause_of_nmi() {
        fault::stop(cause)
    }
}

#[cortex_m_rt::exception]
unsafe fn HardFault(_: &cortex_m_rt::ExceptionFrame) -> ! {
    fault::stop(Fault::HardFault)
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    fault::stop(Fault::HardFault)
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    stack::paint();
    let channels = rtt_init! {
        up: { 0: { size: Board::LOG_BYTES, mode: ChannelMode::NoBlockSkip, name: "defmt" } }
        down: { 0: { size: 1024, name: "commands" } }
    };
    rtt_target::set_defmt_channel(channels.up.0);

    let peripherals = board::init(stack::guard);
    let clocks = board::clocks(&peripherals);
    defmt::info!(
        "hysteron {=str}: core {=u32} Hz, control {=u32} Hz, front end {=str}",
        env!("CARGO_PKG_VERSION"),
        clocks.core_hz,
        SAMPLE_RATE_HZ,
        Converters::NAME
    );

    event_log::begin(|found| update::kept_events(found));
    let rolled_back = update::load();
    let envelope = settings::load_envelope();
    let kept_are_refused = !settings::load_kept(SAMPLE_RATE_HZ);
    let block = settings::load(SAMPLE_RATE_HZ);
    let refused = match (&envelope, &block) {
        (None, _) => Some(Fault::NoEnvelope),
        (Some(_), Err(_)) => Some(Fault::ParameterBlock),
        (Some(_), Ok(_)) => None,
    };
    let rest = envelope.map_or(DriveCode::new(0), |envelope| envelope.safe_code);
    let parameters =
        block.unwrap_or_else(|_| settings::safe_parameters(SAMPLE_RATE_HZ, rest, Converters::BITS));
    let c = &parameters.servo.converters;
    // What a decoder needs to turn codes into um and V, in the formats of the parameter block.
    defmt::info!(
        "converters {=i32} {=i64} {=i32} {=i64} {=u32} {=u32} {=u32}",
        c.adc_zero,
        c.adc_step,
        c.dac_zero,
        c.dac_step,
        c.dac_code_min.steps(),
        c.dac_code_max.steps(),
        SAMPLE_RATE_HZ
    );
    supply::watch();
    option_bytes::say();
    safety_lines::start();
    lights::start();
    let bits = CodeBits::of(&parameters);
    let mut front_end =
        Converters::new(bits, envelope.as_ref().map(Wiring::of).unwrap_or_default());
    // Until somebody has said which code is rest the drive's converter stays as it left its reset.
    let drives = refused.is_none();
    front_end.start(drives.then_some(parameters.guard.rest_code));
    if drives {
        fault::remember_rest(parameters.guard.rest_code, bits);
    }

    let (sample_producer, sample_consumer) = SAMPLES.init(Ring::new()).split();
    let (command_producer, command_consumer) = COMMANDS.init(Ring::new()).split();
    let (reply_producer, reply_consumer) = REPLIES.init(Ring::new()).split();
    hand_over(
        parameters,
        refused,
        Ends {
            front_end,
            samples: sample_producer,
            commands: command_consumer,
            replies: reply_producer,
        },
        kept_are_refused,
        clocks.core_hz / SAMPLE_RATE_HZ / 2 * 3,
        rolled_back,
    );
    command_port::open(command_producer);
    telemetry::begin(&parameters);
    if let Some((line, session)) = serial_port::open(peripherals, parameters) {
        spawn(spawner, serial_port::receiving());
        spawn(spawner, serial_port::obeying(line, session));
    }
    spawn(spawner, trace_tasks::trace(sample_consumer));
    spawn(spawner, trace_tasks::read_out());
    spawn(spawner, command_tasks::commands(channels.down.0));
    spawn(spawner, command_tasks::reports(reply_consumer));
    spawn(spawner, settings::keeper(SAMPLE_RATE_HZ));
    spawn(spawner, command_tasks::protector());
    spawn(spawner, update::updater());
    sample_clock::start(clocks.timer_hz, Converters::INTERRUPT_AFTER_NS);
    watchdog::watch().await;
}

/// What the interrupt gets beside the amplifier.
struct Ends {
    front_end: Converters,
    samples: Producer<PackedSample, SAMPLE_QUEUE>,
    commands: Consumer<Scheduled, COMMAND_QUEUE>,
    replies: Producer<Reply, COMMAND_QUEUE>,
}

/// Makes the amplifier and hands it to the interrupt. Not a part of the task above: an amplifier takes 13
/// KiB, and what a task holds is static.
#[inline(never)]
fn hand_over(
    parameters: AmplifierParameters,
    refused: Option<Fault>,
    ends: Ends,
    kept_are_refused: bool,
    late_cycles: u32,
    rolled_back: bool,
) {
    let mut amplifier = Amplifier::new(parameters);
    if rolled_back {
        amplifier.refuse(Fault::UpdateRolledBack);
    }
    if let Some(cause) = fault::cause_of_last_restart() {
        defmt::error!("last restart: {=str}", cause.name());
        amplifier.refuse(cause);
    }
    if kept_are_refused | !settings::filter(&mut amplifier, SAMPLE_RATE_HZ) {
        amplifier.refuse(Fault::KeptSettings);
    }
    if let Some(fault) = refused {
        amplifier.refuse_for_good(fault);
    }
    if let Some(envelope) = settings::envelope() {
        amplifier.limit_current(envelope.mean_square_codes(amplifier.parameters()));
        if !envelope.closes_untested {
            amplifier.require_test();
        }
        if let Some(input) = envelope.set_point() {
            amplifier.wire_input(SetPoint::new(input));
        }
        if let Some(monitor) = envelope.monitor(SAMPLE_RATE_HZ) {
            amplifier.watch_output(OutputMonitor::new(monitor));
        }
    }
    if !fault::cycle_counter_runs() {
        defmt::error!("the cycle counter does not run: ticks that are skipped cannot be found");
        amplifier.refuse(Fault::Overrun);
    }
    let Ends {
        front_end,
        samples,
        commands,
        replies,
    } = ends;
    let sensor_bits = amplifier.parameters().servo.converters.adc_bits;
    let linearisation =
        settings::envelope().and_then(|envelope| envelope.linearisation(sensor_bits));
    let limit = settings::envelope()
        .filter(|_| refused.is_none())
        .map(|envelope| OutputLimit::new(&envelope, amplifier.parameters()));
    control::hand_over(Control {
        front_end,
        amplifier,
        samples,
        commands,
        replies,
        recorder: recorder::Recorder::new(),
        schedule: CommandSchedule::default(),
        tick: 0,
        overrun: false,
        late_cycles,
        last_cycles: None,
        has_monitor: settings::envelope().is_some_and(|envelope| envelope.monitor_span_uv > 0),
        has_set_point: settings::envelope().is_some_and(|envelope| envelope.set_point_span_nm > 0),
        linearisation,
        limit,
        turns: 0,
        latched: None,
    });
}

/// Spawns a task.
fn spawn<S>(spawner: Spawner, task: Result<SpawnToken<S>, SpawnError>) {
    match task {
        Ok(task) => spawner.spawn(task),
        Err(_) => defmt::error!("a task has no room"),
    }
}

//! What the serial port's session sees of this target.

use core::sync::atomic::AtomicI32;

use hysteron_core::command_text::BlockPiece;
use hysteron_core::filter_design::FilterSetting;
use hysteron_core::firmware_update::{AuthenticationCode, ImageHeader};
use hysteron_core::guard::Fault;
use hysteron_core::kept_settings::KeptSettings;
use hysteron_core::loop_telemetry::{LoopFigures, ResonanceWatch};
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_core::trace_frame::TraceSample;
use hysteron_protocol::device::{
    Brought, Device, DeviceDiagnosis, DeviceEvent, Moving, UpdateRefusal, UpdateState, View,
};
use hysteron_protocol::session::WAVE_TABLES;

use crate::board::{Board, Platform};
use crate::{
    control, event_log, option_bytes, recorder, serial_line, settings, telemetry, temperature,
    update, update_state,
};

const WAVE_MEMORY: usize = WAVE_TABLES * Board::WAVE_POINTS;
/// The wave tables, um with 24 fraction bits. Nothing initialises this memory; a table's length says how much
/// of it counts.
#[unsafe(link_section = ".bulk.waves")]
pub static WAVES: [AtomicI32; WAVE_MEMORY] = [const { AtomicI32::new(0) }; WAVE_MEMORY];

/// This target.
pub struct Target;

impl Device for Target {
    #[inline(never)]
    fn view(&self) -> View {
        // All of one tick; for how long the error has been small is the trace task's, some ticks old.
        let (state, on_target_ticks) = (control::state(), telemetry::on_target_ticks());
        View {
            tick: state.ticks,
            mode: state.status.mode,
            fault: state.status.fault,
            adc_code: state.adc_code,
            dac_code: state.dac_code,
            monitor_code: control::monitor_code(),
            set_point_code: control::set_point_code(),
            input: control::input_state(),
            reference: state.reference,
            travel: state.travel.get().copied(),
            adc_zero: state.adc_zero,
            zeroed: state.zeroed,
            conditioned: state.conditioned,
            powered: state.powered,
            armed: state.armed,
            conditioning_required: state.conditioning_required,
            on_target_ticks,
        }
    }

    fn set_tolerance(&mut self, tolerance: i32) {
        telemetry::set_tolerance(tolerance);
    }

    fn recorder_room(&self) -> u32 {
        recorder::ROOM
    }

    fn record(&mut self, every_ticks: u32) {
        recorder::begin(every_ticks);
    }

    fn recorded(&self) -> u32 {
        recorder::recorded()
    }

    fn end_recording(&mut self) {
        recorder::end();
    }

    fn record_from_command(&mut self, every_ticks: u32) {
        recorder::begin_from_command(every_ticks);
    }

    fn begin_block(&mut self, bytes: u32) -> Result<(), &'static str> {
        settings::begin(bytes)
    }

    fn take_block(&mut self, piece: &BlockPiece) -> Result<(), &'static str> {
        settings::take(piece)
    }

    fn keep_block(&mut self) -> Result<(), Moving> {
        settings::keep().map_err(|_| Moving)
    }

    fn keep_envelope(&mut self, fingerprint: u32) -> Result<(), Moving> {
        settings::keep_envelope(fingerprint).map_err(|_| Moving)
    }

    fn envelope(&self) -> Option<SafetyEnvelope> {
        settings::envelope()
    }

    fn event(&self, before_last: u32) -> Option<DeviceEvent> {
        let event = event_log::event(before_last)?;
        Some(DeviceEvent {
            start: event.start,
            tick: event.tick,
            fault: Fault::from_number(event.fault as u8)?,
        })
    }

    fn swap_block(&mut self) {
        settings::swap();
    }

    fn kept_settings(&self) -> Option<KeptSettings> {
        settings::kept_settings()
    }

    fn keep_settings(&mut self, settings: &KeptSettings) -> Result<(), Moving> {
        settings::keep_settings(settings).map_err(|_| Moving)
    }

    fn brought(&self) -> Brought {
        settings::brought()
    }

    fn restart(&mut self) -> Result<(), Moving> {
        let is_writing = settings::is_keeping() || update_state::is_busy();
        if control::drive_rests() && !is_writing {
            Ok(serial_line::restart())
        } else {
            Err(Moving)
        }
    }

    fn image(&self) -> Option<ImageHeader> {
        update::running()
    }

    fn update(&self) -> UpdateState {
        update_state::state()
    }

    fn begin_update(&mut self, bytes: u32) -> Result<(), UpdateRefusal> {
        update::begin(bytes)
    }

    fn take_update(&mut self, piece: &BlockPiece) -> Result<bool, UpdateRefusal> {
        update::take(piece)
    }

    fn commit_update(&mut self, code: &AuthenticationCode) -> Result<bool, UpdateRefusal> {
        update::commit(code)
    }

    fn take_sensor_filter(&mut self, filter: &FilterSetting) -> Result<(), &'static str> {
        settings::take_sensor_filter(filter)
    }

    fn host_timeout(&self) -> u32 {
        control::host_timeout()
    }

    fn set_host_timeout(&mut self, ticks: u32) {
        control::set_host_timeout(ticks);
    }

    fn baud(&self) -> u32 {
        serial_line::baud()
    }

    fn set_baud(&mut self, baud: u32) {
        serial_line::set_baud(baud);
    }

    fn diagnosis(&self) -> DeviceDiagnosis {
        let (railed_ticks, limited_ticks) = telemetry::railed_and_limited_ticks();
        let (block_generation, block_checksum) = settings::in_use();
        DeviceDiagnosis {
            railed_ticks,
            limited_ticks,
            saturated_values: control::saturated_values(),
            overruns: control::overruns(),
            lost_samples: control::lost_samples(),
            block_generation,
            block_checksum,
            protection: option_bytes::protection(),
            adapted_gain_millionths: control::adapted_gain_millionths(),
            part_decicelsius: temperature::decicelsius(),
            amplifier_decicelsius: temperature::amplifier_decicelsius(),
        }
    }

    fn loop_figures(&self) -> LoopFigures {
        telemetry::loop_figures()
    }

    fn resonance_watch(&self) -> ResonanceWatch {
        telemetry::resonance_watch()
    }

    fn listen(&mut self, watch: ResonanceWatch) -> Result<(), &'static str> {
        telemetry::listen(watch)
    }

    fn sample(&self, nth: u32) -> Option<TraceSample> {
        recorder::sample(nth)
    }
}

//! The converters of the SPI front end, with the float plant behind them, in virtual time.
//!
//! # How it works
//! Each SPI word carries its instant. The first read of the sensor fixes the phase of the sample clock's
//! edges; from then on every edge that has passed carries the plant over one period under the code that
//! acted, and only then lets the code that was written before act. The plant, the noise and the order of both
//! are those of the host's simulation, so the codes can be compared bit by bit.
//!
//! The drive's converter wakes up, from power and from the part's reset (RESET on NRST, as the wiring page
//! has it), with its output clamped to ground and code 0, the lowest drive, in its register; a clamp that is
//! removed before the register was written shows. A code that is written while the sample clock does not beat
//! acts when its frame ends, because the firmware then holds LDAC low; so does one that is written
//! [`by_hand_ns`] or more after the last reading, when only a handler of faults still writes.

use std::sync::{Arc, Mutex};

use hysteron_core::codes::{DriveCode, MOST_BITS, SensorCode};
use hysteron_sim::bench::{Bench, Variant};
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::stepping_loop::encoder_code;
use rigless::chip::Timeline;
use rigless::chip::spi::Peer;

/// The sample clock's period at the usual sampling rate, ns.
pub const PERIOD_NS: u64 = 50_000;

/// Silence of the target, in periods, after which its next read begins a new phase of the sample clock: a
/// restart takes milliseconds.
const RESTARTED_PERIODS: u64 = 8;

/// Time since the last reading after which a frame acts when it ends, because a handler of faults holds LDAC
/// low: three fifths of the period, and no less than a tick takes from its reading to its frame.
fn by_hand_ns(period_ns: u64) -> u64 {
    (period_ns * 3 / 5).max(8_500)
}

/// What is wrong with the sensor, and when (edges, from included, to excluded).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorTrouble {
    /// First edge.
    pub from: u64,
    /// First edge after it.
    pub to: u64,
    /// What it reads then.
    pub kind: Trouble,
}

/// Kinds of trouble.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// The code of the edge before.
    Stuck,
    /// The cable is off: the line floats high.
    Disconnected,
    /// So many codes more than the honest one, as from a scale that has slipped.
    Shifted(u32),
}

/// Kinds of trouble with the amplifier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OutputTrouble {
    /// Its gain over the right one; 0: it is dead.
    Gain(f64),
    /// The cable of its voltage monitor is off; a resistor brings the part's input to ground.
    CableOpen,
    /// Its power stage stays on, whatever the enable output says.
    RelayWelded,
}

/// Plant, sensor and the codes between them and the target.
pub struct World {
    scale: ConverterScale,
    plant: Box<dyn Plant + Send>,
    noise: WhiteNoise,
    acting_code: DriveCode,
    written_code: DriveCode,
    /// The drive's output is clamped to ground, which is this code.
    clamped: bool,
    /// The drive's register is two's complement, as it is behind its reset.
    twos_complement: bool,
    ground_code: DriveCode,
    /// No edge has come since the last reset.
    waiting_for_beat: bool,
    /// The sample clock's period, ns.
    pub period_ns: u64,
    first_edge_ns: Option<u64>,
    began_ns: Option<u64>,
    /// The lowest code that acted without waiting for an edge.
    pub lowest_between_edges: DriveCode,
    last_read_ns: Option<u64>,
    edges: u64,
    last_code: SensorCode,
    /// The sensor reads the code that acted in the last period: a wire instead of an actuator.
    pub wire: bool,
    /// The sensor is an encoder, whose counts have the step of the sensor's codes.
    pub encoder: bool,
    /// Troubles of the sensor.
    pub troubles: Vec<SensorTrouble>,
    /// Edges at which the drive's converter loses its supply and gets it again: clamped to ground, its
    /// register empty.
    pub converter_brown_outs: Vec<u64>,
    /// What is wrong with the amplifier from which edge on.
    pub output_trouble: Option<(u64, OutputTrouble)>,
    /// From this edge on the register of the drive's converter keeps what it has.
    pub register_stuck_from: Option<u64>,
    /// What the drive's converter is asked for by the frame before.
    asked: bool,
    output_v: f64,
    /// At each edge: the code that the sensor gave and the code that acts from it on.
    pub codes: Vec<(SensorCode, DriveCode)>,
    /// Whether `codes` are kept: not in a run without an end.
    pub keeps_codes: bool,
    /// Receives every edge: the sensor's code, the code that acts from it on, and the true position, um.
    pub witness: Option<Witness>,
}

/// Receives every edge.
pub type Witness = Box<dyn FnMut(SensorCode, DriveCode, f64) + Send>;

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("World")
            .field("edges", &self.edges)
            .field("acting_code", &self.acting_code)
            .finish_non_exhaustive()
    }
}

/// The world as the converters and the test share it.
pub type SharedWorld = Arc<Mutex<World>>;

impl World {
    /// A virgin actuator of the bench, its drive at rest, with this seed of noise.
    #[must_use]
    pub fn new(bench: &Bench, variant: Variant, seed: u64) -> Self {
        let mut world = Self::with(
            Box::new(bench.plant(variant)),
            bench.converter_scale(),
            bench.converters.sensor_noise_um,
            seed,
        );
        world.period_ns = (1e9 * bench.sampling_period_s()).round() as u64;
        world
    }

    /// Any plant at rest between converters of this scale, with this noise of the sensor, um RMS. It advances by
    /// [`PERIOD_NS`] from edge to edge, unless [`World::period_ns`] says otherwise.
    #[must_use]
    pub fn with(
        plant: Box<dyn Plant + Send>,
        scale: ConverterScale,
        noise_um: f64,
        seed: u64,
    ) -> Self {
        let rest = scale.dac_code(scale.drive_min_v);
        Self {
            plant,
            noise: WhiteNoise::new(noise_um, seed),
            scale,
            acting_code: rest,
            written_code: rest,
            clamped: false,
            twos_complement: false,
            ground_code: ConverterScale {
                drive_min_v: f64::NEG_INFINITY,
                drive_max_v: f64::INFINITY,
                ..scale
            }
            .dac_code(0.0),
            waiting_for_beat: true,
            period_ns: PERIOD_NS,
            first_edge_ns: None,
            began_ns: None,
            lowest_between_edges: DriveCode::MOST,
            last_read_ns: None,
            edges: 0,
            last_code: SensorCode::default(),
            wire: false,
            encoder: false,
            troubles: Vec::new(),
            converter_brown_outs: Vec::new(),
            output_trouble: None,
            register_stuck_from: None,
            asked: false,
            output_v: 0.0,
            codes: Vec::new(),
            keeps_codes: true,
            witness: None,
        }
    }

    /// Shared with converters.
    #[must_use]
    pub fn shared(self) -> SharedWorld {
        Arc::new(Mutex::new(self))
    }

    /// One edge of the sample clock: the period before it ends, the code written in it begins to act, the
    /// sensor is sampled.
    pub fn edge(&mut self) -> SensorCode {
        if self.edges > 0 {
            self.output_v = self.amplifier_gain() * self.scale.drive_v(self.acting_code);
            self.plant.advance(self.output_v, 0.0);
        }
        if self.converter_brown_outs.contains(&self.edges) {
            (self.clamped, self.written_code) = (true, DriveCode::default());
        }
        let next = self.output_code();
        let acted = std::mem::replace(&mut self.acting_code, next);
        let honest = if self.wire {
            self.over_the_wire(acted)
        } else {
            let reading_um = self.plant.sensor_um() + self.noise.next_um();
            if self.encoder {
                encoder_code(reading_um, self.scale.adc_lsb_um)
            } else {
                self.scale.adc_code(reading_um)
            }
        };
        let now = self.edges;
        let trouble = self
            .troubles
            .iter()
            .find(|trouble| (trouble.from..trouble.to).contains(&now));
        let code = match trouble.map(|trouble| trouble.kind) {
            None => honest,
            Some(Trouble::Stuck) => self.last_code,
            Some(Trouble::Disconnected) => SensorCode::highest(self.scale.adc_bits),
            Some(Trouble::Shifted(codes)) => honest + codes,
        };
        self.last_code = code;
        if self.keeps_codes {
            self.codes.push((code, self.acting_code));
        }
        if let Some(witness) = &mut self.witness {
            witness(code, self.acting_code, self.plant.displacement_um());
        }
        self.edges += 1;
        code
    }

    /// What the register gives: ground while it is clamped.
    fn output_code(&self) -> DriveCode {
        let sign = 1 << (self.scale.dac_bits - 1);
        match (self.clamped, self.twos_complement) {
            (true, _) => self.ground_code,
            (false, true) => DriveCode::new(self.written_code.steps() ^ sign),
            (false, false) => self.written_code,
        }
    }

    /// Gain of the amplifier over the right one.
    fn amplifier_gain(&self) -> f64 {
        match self.output_trouble {
            Some((from, OutputTrouble::Gain(gain))) if self.edges >= from => gain,
            _ => 1.0,
        }
    }

    /// What the amplifier's voltage monitor gives the part, mV: -30..150 V over 3.3 V; 0 V while its power
    /// stage is not enabled.
    #[must_use]
    pub fn monitor_mv(&self, is_enabled: bool) -> u32 {
        let trouble = self.output_trouble.filter(|(from, _)| self.edges >= *from);
        let output_v = match trouble {
            Some((_, OutputTrouble::CableOpen)) => return 0,
            Some((_, OutputTrouble::RelayWelded)) => self.output_v,
            _ if is_enabled => self.output_v,
            _ => 0.0,
        };
        ((output_v + 30.0) / 180.0 * 3300.0)
            .round()
            .clamp(0.0, 3300.0) as u32
    }

    /// The sensor's code of a drive that a wire brings there: the same share of its range.
    fn over_the_wire(&self, acted: DriveCode) -> SensorCode {
        SensorCode::new(acted.steps() << self.scale.adc_bits >> self.scale.dac_bits)
    }

    /// Takes a code that acts from the next edge on.
    pub fn write(&mut self, code: DriveCode) {
        self.written_code = code;
    }

    /// The drive's converter wakes up: clamped to ground, its register empty.
    pub fn wake_converter(&mut self, now_ns: u64) {
        self.pass_edges(now_ns);
        (self.clamped, self.written_code, self.waiting_for_beat) =
            (true, DriveCode::default(), true);
        self.twos_complement = true;
        self.acting_code = self.ground_code;
    }

    /// The instant of the first edge, ns.
    #[must_use]
    pub fn began_ns(&self) -> u64 {
        self.began_ns.unwrap_or(0)
    }

    /// Lets the edges before an instant pass.
    fn pass_edges(&mut self, now_ns: u64) {
        let Some(first) = self.first_edge_ns else {
            return;
        };
        while first + self.edges * self.period_ns < now_ns {
            self.edge();
        }
    }

    /// A frame of the drive's converter that ends at an instant.
    /// What the converter's SDO gives meanwhile.
    fn frame(&mut self, word: u32, now_ns: u64) -> u32 {
        self.pass_edges(now_ns);
        let register = self.written_code.steps() << (MOST_BITS - self.scale.dac_bits);
        let given = if std::mem::replace(&mut self.asked, word >> 20 == 9) {
            register
        } else {
            0
        };
        let stuck = self
            .register_stuck_from
            .is_some_and(|from| self.edges >= from);
        match word >> 20 {
            1 if stuck => {}
            // The register has 20 bits; a code of fewer is their upper ones.
            1 => {
                self.written_code =
                    DriveCode::new((word & 0xF_FFFF) >> (MOST_BITS - self.scale.dac_bits))
            }
            // Output on ground, or three-state: bits 2 and 3. Bit 4: what the register holds means.
            2 => {
                self.clamped = word & 0b1100 != 0;
                self.twos_complement = word & 1 << 4 == 0;
            }
            _ => return given,
        }
        let by_hand = self
            .last_read_ns
            .is_none_or(|last| now_ns.saturating_sub(last) >= by_hand_ns(self.period_ns));
        if self.waiting_for_beat || by_hand {
            self.acting_code = self.output_code();
            // What has acted in between is seen at the next edge, however short it was.
            self.lowest_between_edges = self.lowest_between_edges.min(self.acting_code);
        }
        given
    }

    /// The converters' scale.
    #[must_use]
    pub fn scale(&self) -> &ConverterScale {
        &self.scale
    }

    /// Whether the drive's output is clamped to ground.
    #[must_use]
    pub fn clamped(&self) -> bool {
        self.clamped
    }

    /// The code that acts now.
    #[must_use]
    pub fn acting_code(&self) -> DriveCode {
        self.acting_code
    }

    /// Lets all edges up to an instant pass and returns the sensor's code of the last one.
    fn read_at(&mut self, now_ns: u64) -> SensorCode {
        self.began_ns.get_or_insert(now_ns);
        let mut first = *self.first_edge_ns.get_or_insert(now_ns);
        if self
            .last_read_ns
            .is_some_and(|last| now_ns.saturating_sub(last) > RESTARTED_PERIODS * self.period_ns)
        {
            // The part has restarted and its sample clock beats in another phase: this read is at an edge.
            let passed = (now_ns.saturating_sub(first) + self.period_ns / 2) / self.period_ns;
            first = now_ns.saturating_sub(passed * self.period_ns);
            self.first_edge_ns = Some(first);
        }
        self.last_read_ns = Some(now_ns);
        self.waiting_for_beat = false;
        // The interrupt's latency is far below half a period.
        let passed = (now_ns.saturating_sub(first) + self.period_ns / 2) / self.period_ns + 1;
        while self.edges < passed {
            self.edge();
        }
        self.last_code
    }
}

/// The sensor's converter.
#[derive(Debug)]
pub struct SensorConverter {
    world: SharedWorld,
}

rigless::store!(SensorConverter {
    values: [],
    parts: [],
    built: [world]
});

impl SensorConverter {
    /// On this world.
    #[must_use]
    pub fn new(world: &SharedWorld) -> Self {
        Self {
            world: Arc::clone(world),
        }
    }
}

impl Peer for SensorConverter {
    fn transfer(&mut self, _: u32, _: u8, context: &mut Timeline<'_, '_>) -> u32 {
        self.world
            .lock()
            .map_or(0, |mut world| world.read_at(context.now().0).steps())
    }
}

/// The drive's converter: 24-bit words, of which the top four bits choose the register and the others are its
/// code of 20 bits.
#[derive(Debug)]
pub struct DriveConverter {
    world: SharedWorld,
}

rigless::store!(DriveConverter {
    values: [],
    parts: [],
    built: [world]
});

impl DriveConverter {
    /// On this world.
    #[must_use]
    pub fn new(world: &SharedWorld) -> Self {
        if let Ok(mut world) = world.lock() {
            world.wake_converter(0);
        }
        Self {
            world: Arc::clone(world),
        }
    }
}

impl Peer for DriveConverter {
    fn transfer(&mut self, mosi: u32, bits: u8, context: &mut Timeline<'_, '_>) -> u32 {
        if bits == 24
            && let Ok(mut world) = self.world.lock()
        {
            return world.frame(mosi, context.now().0);
        }
        0
    }

    fn restarted(&mut self, context: &mut Timeline<'_, '_>) {
        if let Ok(mut world) = self.world.lock() {
            world.wake_converter(context.now().0);
        }
    }
}

//! An adversary in front of the amplifier: commands, filters, blocks, loads, troubles of the sensor and of the
//! output, and a host that leaves, in any order. Whatever it does, the drive keeps its limits, moves only where
//! somebody asked for it, never swings, every stop has a name, and every tick is in the trace. Behind a fault
//! a second amplifier that has just started gets the same readings and commands: once both are conditioned,
//! they do the same in every tick, and end in the same state.

mod plant;

use hysteron_core::amplifier::{Amplifier, Mode};
use hysteron_core::amplifier_command::{Command, ENDLESS_TICKS};
use hysteron_core::codes::SensorCode;
use hysteron_core::filter_design::{FilterSetting, Notch};
use hysteron_core::guard::Fault;
use hysteron_core::host_watch::{HostWatch, Missed};
use hysteron_core::output_monitor::{MonitorParameters, OutputMonitor};
use hysteron_core::parameter_block::{AmplifierParameters, verify};
use hysteron_core::reference_generator::Waveform;
use hysteron_core::self_test::STEP_MILLIVOLTS;
use hysteron_core::servo_parameters::LawParameters;
use hysteron_core::servo_tick::Counters;
use hysteron_core::signal::{Micrometres, Volts};
use hysteron_core::signal_filter::{FilteredSignal, Place};
use hysteron_core::trace_frame::{Channels, ReadBlock, TraceBlock, TraceSample};
use plant::{Bench, Dice, LIMIT_UM, RATE_HZ, parameters};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// What the sensor, or the monitor of the output, gives instead of its reading.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trouble {
    None,
    Silent,
    Stuck,
    Shifted,
    Railed,
    Reversed,
    Dead,
    Weak,
    Noisy,
    Drifting,
    OutputDead,
    MonitorOpen,
}

impl Trouble {
    const ALL: [Self; 11] = [
        Self::Silent,
        Self::Stuck,
        Self::Shifted,
        Self::Railed,
        Self::Reversed,
        Self::Dead,
        Self::Weak,
        Self::Noisy,
        Self::Drifting,
        Self::OutputDead,
        Self::MonitorOpen,
    ];

    /// A self-test or a conditioning finds it.
    fn is_slow(self) -> bool {
        use Trouble::{Dead, Drifting, Noisy, Reversed, Weak};
        matches!(self, Reversed | Dead | Weak | Noisy | Drifting)
    }

    fn reading(
        self,
        honest: SensorCode,
        last: SensorCode,
        tick: u32,
        dice: &mut Dice,
    ) -> Option<SensorCode> {
        const MIDDLE: u32 = 20_000;
        let (code, noise) = (honest.steps(), dice.within(0.0, 4.0) as u32);
        let code = match self {
            Self::None | Self::OutputDead | Self::MonitorOpen => code,
            Self::Silent => return None,
            Self::Stuck => last.steps(),
            Self::Shifted => code + 9_000,
            Self::Railed => 65_535,
            Self::Reversed => 50_000 - code.min(49_000),
            Self::Dead => MIDDLE + noise,
            Self::Weak => MIDDLE + code / 4,
            Self::Noisy => code + 500 * noise,
            Self::Drifting => code + tick % 200_000 / 8,
        };
        Some(SensorCode::new(code.min(65_535)))
    }

    fn monitored(self, output_v: f64) -> Option<u16> {
        let code = |volts: f64| ((volts - MONITOR_ZERO_V) / MONITOR_SPAN_V * 65_536.0) as u16;
        Some(match self {
            Self::OutputDead => code(-100.0),
            Self::MonitorOpen => u16::MAX,
            _ => code(output_v),
        })
    }
}

fn micrometres(dice: &mut Dice, low: f64, high: f64) -> Micrometres {
    Micrometres::from_num(dice.within(low, high))
}

fn volts(dice: &mut Dice, low: f64, high: f64) -> Volts {
    Volts::from_num(dice.within(low, high))
}

fn command(dice: &mut Dice) -> Command {
    let increment = |hz: f64| (hz / f64::from(RATE_HZ) * 2f64.powi(32)) as u32;
    let ticks = dice.decades(1.0, 60_000.0) as u32;
    match dice.within(0.0, 17.0) as u32 {
        0 | 1 => Command::Enable,
        2 => Command::Disable,
        3 => Command::Disarm,
        4 => Command::Arm { tested: true },
        5 | 6 => Command::Arm { tested: false },
        7 | 8 => Command::Clear,
        9 => Command::RequireConditioning(dice.share() < 0.3),
        10 => Command::Condition {
            cycle_ticks: ticks,
            rest_ticks: 1_200,
        },
        11 => Command::Hold {
            drive: (dice.share() < 0.8).then(|| volts(dice, -20.0, 120.0)),
        },
        12 => Command::Play {
            waveform: Waveform::Multisine {
                tones: std::array::from_fn(|_| {
                    let hz = dice.decades(0.5, 400.0);
                    (increment(hz), volts(dice, 0.0, 12.0), 0)
                }),
            },
            offset: volts(dice, 10.0, 60.0),
            ticks: if dice.share() < 0.1 {
                ENDLESS_TICKS
            } else {
                ticks
            },
        },
        13 => Command::Identify { ticks },
        14 => Command::Reference {
            waveform: Waveform::QuasiStep {
                height: micrometres(dice, -4.0, 4.0),
                delay_ticks: 0,
                duration_ticks: ticks,
            },
            offset: micrometres(dice, 0.0, 9.0),
        },
        15 => Command::Reference {
            waveform: Waveform::Constant,
            offset: micrometres(dice, -2.0, 12.0),
        },
        _ => Command::Reference {
            waveform: Waveform::Multisine {
                tones: std::array::from_fn(|_| {
                    let hz = dice.decades(0.5, 150.0);
                    (increment(hz), micrometres(dice, 0.0, 1.0), 0)
                }),
            },
            offset: micrometres(dice, 3.0, 7.0),
        },
    }
}

/// What brings the amplifier one step nearer to a closed loop, where most can go wrong; it is armed behind a
/// self-test in this share of cases.
fn next_step(dice: &mut Dice, amplifier: &Amplifier, tested: f64) -> Command {
    match amplifier.mode() {
        Mode::Fault => Command::Clear,
        _ if !amplifier.armed() => Command::Arm {
            tested: dice.share() < tested,
        },
        _ if amplifier.conditioning_required() && !amplifier.conditioned() => {
            Command::RequireConditioning(false)
        }
        Mode::Rest => Command::Hold {
            drive: Some(volts(dice, 10.0, 60.0)),
        },
        Mode::Playing => Command::Enable,
        Mode::Closed => Command::Reference {
            waveform: Waveform::QuasiStep {
                height: micrometres(dice, -3.0, 3.0),
                delay_ticks: 0,
                duration_ticks: dice.decades(100.0, 10_000.0) as u32,
            },
            offset: Micrometres::from_bits(amplifier.servo().reference().to_bits()),
        },
    }
}

fn filter(dice: &mut Dice) -> Command {
    let millihertz = |hz: f64| (hz * 1000.0) as u32;
    let setting = FilterSetting {
        notches: [
            Notch {
                frequency_millihertz: millihertz(dice.decades(10.0, 8_000.0)),
                width_millihertz: millihertz(dice.decades(1.0, 2_000.0)),
            },
            Notch::OFF,
        ],
        low_pass_millihertz: millihertz(dice.decades(10.0, 8_000.0)),
    };
    let setting = if dice.share() < 0.5 {
        FilterSetting::OFF
    } else {
        setting
    };
    let signal = if dice.share() < 0.5 {
        FilteredSignal::SetPoint
    } else {
        FilteredSignal::Sensor
    };
    let place = if dice.share() < 0.5 {
        Place::Notch1
    } else {
        Place::LowPass
    };
    let row = setting.row(place, RATE_HZ).expect("a filter");
    Command::Filter { signal, place, row }
}

/// What is seen beside the faults, in this order in [`Seen::counts`].
const COUNTS: [&str; 8] = [
    "ticks",
    "ticks with the loop closed",
    "ticks at a limit of the drive",
    "values held at the end of their format",
    "blocks taken in place of another",
    "recoveries beside a fresh start",
    "ticks beside a fresh start with the same result",
    "samples read back from the trace",
];

/// What a run has seen.
#[derive(Default)]
struct Seen {
    counts: [u64; COUNTS.len()],
    faults: BTreeMap<&'static str, u64>,
}

impl Seen {
    fn count(&mut self, what: &str, more: u64) {
        let place = COUNTS.iter().position(|name| *name == what);
        self.counts[place.expect("a name of COUNTS")] += more;
    }

    fn of(&self, what: &str) -> u64 {
        let named = COUNTS.iter().zip(self.counts);
        named
            .filter(|(name, _)| **name == what)
            .map(|(_, count)| count)
            .sum()
    }

    fn add(&mut self, other: Self) {
        for (sum, more) in self.counts.iter_mut().zip(other.counts) {
            *sum += more;
        }
        for (name, more) in other.faults {
            *self.faults.entry(name).or_insert(0) += more;
        }
    }
}

/// Faults of lines and parts that the firmware looks at.
const FROM_OUTSIDE: [Fault; 6] = [
    Fault::EmergencyStop,
    Fault::Interlock,
    Fault::AmplifierNotReady,
    Fault::SupplyLow,
    Fault::DriveSilent,
    Fault::DriveNotHeld,
];

/// Faults that the adversary provokes in the amplifier itself: the first five within 10^6 ticks, all within
/// 10^7.
const PROVOKED: [Fault; 17] = [
    Fault::SensorSilent,
    Fault::SensorOutOfRange,
    Fault::SensorJump,
    Fault::TrackingError,
    Fault::LoopSwings,
    Fault::SensorStuck,
    Fault::Overrun,
    Fault::HostLost,
    Fault::SensorDoesNotMove,
    Fault::SensorReversed,
    Fault::GainDiffers,
    Fault::SensorDrifts,
    Fault::SensorNoisy,
    Fault::DriveCurrent,
    Fault::OutputDiffers,
    Fault::OutputWhileOff,
    Fault::MonitorOutOfRange,
];

/// The voltage monitor reads -150 to 250 V.
const MONITOR_ZERO_V: f64 = -150.0;
const MONITOR_SPAN_V: f64 = 400.0;

/// What an amplifier has on its board, behind every start alike.
fn on_its_board(block: AmplifierParameters) -> Amplifier {
    let mut amplifier = Amplifier::new(block);
    // 30 V: the bench's amplifier may come so far behind where its current is at its limit.
    let monitor = MonitorParameters::new(
        (MONITOR_ZERO_V * 1e6) as i32,
        (MONITOR_SPAN_V * 1e6) as u32,
        0,
        30_000,
        2_000,
        RATE_HZ,
    );
    amplifier.watch_output(OutputMonitor::new(monitor));
    let codes_per_volt = f64::from(block.servo.converters.dac_codes_per_volt) / 65_536.0;
    amplifier.limit_current((0.4 * codes_per_volt).powi(2) as u64);
    amplifier
}

/// An amplifier that started where another one had recovered.
struct Fresh {
    amplifier: Amplifier,
    /// Conditioned, so that from now on every sample is the same.
    is_compared: bool,
    /// It has closed its loop since, which begins what watches and filters a loop anew.
    has_closed: bool,
    until: u32,
}

struct Adversary {
    dice: Dice,
    bench: Bench,
    amplifier: Amplifier,
    fresh: Option<Fresh>,
    host: HostWatch,
    /// The sections of both filters that are in force.
    filters: Vec<Command>,
    /// Cleared at rest, and nothing asked for since.
    is_recovered: bool,
    /// Nobody has asked for a motion since the amplifier came to rest or was stopped.
    is_asked: bool,
    seen: Seen,
}

impl Adversary {
    /// Gives both amplifiers a command, which do the same with it; whether they took it.
    fn command(&mut self, command: Command) -> bool {
        let was_stopped = self.amplifier.mode() == Mode::Fault;
        let answer = self.amplifier.command(command);
        if let Some(fresh) = &mut self.fresh {
            assert_eq!(answer, fresh.amplifier.command(command), "{command:?}");
        }
        match command {
            Command::Filter { .. } => self.filters.push(command),
            Command::Clear => {
                self.is_recovered |= was_stopped
                    && answer.is_ok()
                    && self.amplifier.drive_rests()
                    && !self.amplifier.powered();
            }
            Command::RequireConditioning(_) => {}
            _ => self.is_recovered &= answer.is_err(),
        }
        self.is_asked = match command {
            Command::Disable | Command::Disarm => false,
            Command::Enable
            | Command::Play { .. }
            | Command::Hold { .. }
            | Command::Condition { .. }
            | Command::Identify { .. }
            | Command::Arm { tested: true } => self.is_asked || answer.is_ok(),
            _ => self.is_asked,
        };
        answer.is_ok()
    }

    fn refuse(&mut self, fault: Fault) {
        self.amplifier.refuse(fault);
        self.is_recovered = false;
        if let Some(fresh) = &mut self.fresh {
            fresh.amplifier.refuse(fault);
        }
    }

    /// A block with other limits or other gains in place of the present one.
    fn swap(&mut self) {
        let mut other = parameters();
        other.guard.tracking_error -= self.dice.within(0.0, 1000.0) as i32;
        if let LawParameters::Predictor(law) = &mut other.servo.law {
            law.unknown_gain = (f64::from(law.unknown_gain) * self.dice.within(0.5, 1.0)) as i32;
        }
        assert_eq!(verify(&other, RATE_HZ), Ok(()));
        let answer = self.amplifier.swap(&other);
        if let Some(fresh) = &mut self.fresh {
            assert_eq!(answer, fresh.amplifier.swap(&other));
        }
        self.seen.count(COUNTS[4], answer.is_ok().into());
    }

    /// Puts a fresh start beside an amplifier that has recovered; both are conditioned first.
    fn start_beside(&mut self, tick: u32) {
        let mut fresh = on_its_board(*self.amplifier.parameters());
        for filter in &self.filters {
            assert_eq!(fresh.command(*filter), Ok(()));
        }
        let required = Command::RequireConditioning(self.amplifier.conditioning_required());
        assert_eq!(fresh.command(required), Ok(()));
        self.fresh = Some(Fresh {
            amplifier: fresh,
            is_compared: false,
            has_closed: false,
            until: tick + 10_000 + self.dice.decades(100.0, 20_000.0) as u32,
        });
        self.seen.count("recoveries beside a fresh start", 1);
    }

    /// The end of a comparison: whatever the amplifiers hold is the same, but for what counts since the
    /// start.
    fn compare(&mut self, fresh: &Fresh, seed: u64) {
        if !fresh.has_closed {
            return;
        }
        let state = |amplifier: &Amplifier| {
            let all = format!("{amplifier:#?}");
            // Partial sums of loops that were wiped out stand beyond the length of the memory.
            let left_out = [
                "    tick: ",
                "        healthy: ",
                "                    dropped_loops: ",
                "                    largest_dropped_loop: ",
                "                        share: ",
                "                        output: ",
                "                    remainder: ",
            ];
            // A section of a filter that is off keeps its past, and does not look at it.
            let mut is_past = false;
            let lines = all.lines().filter(|line| {
                is_past |= line.ends_with(" past: [");
                let is_left_out = is_past || left_out.iter().any(|begin| line.starts_with(begin));
                is_past &= !line.ends_with("],");
                !is_left_out
            });
            lines.map(str::to_owned).collect::<Vec<_>>()
        };
        let (ours, fresh) = (state(&self.amplifier), state(&fresh.amplifier));
        let others: Vec<_> = ours.iter().zip(&fresh).filter(|(a, b)| a != b).collect();
        assert!(
            ours.len() == fresh.len() && others.is_empty(),
            "seed {seed}: {others:?}"
        );
    }
}

/// Runs the adversary for so many ticks.
fn run(seed: u64, ticks: u32) -> Seen {
    let block = parameters();
    let c = block.servo.converters;
    let rest = block.guard.rest_code;
    let mut dice = Dice(seed);
    let bench = Bench::new(dice.decades(0.02, 0.2), seed);
    let healthy = (bench.gain_um_v, bench.natural_rad_s, bench.damping);
    let mut all = Adversary {
        dice,
        bench,
        amplifier: on_its_board(block),
        fresh: None,
        host: HostWatch::new(RATE_HZ),
        filters: Vec::new(),
        is_recovered: false,
        is_asked: false,
        seen: Seen::default(),
    };
    all.host.set_timeout(0, 30_000);
    let (mut trouble, mut until, mut last_reading) = (Trouble::None, 0, SensorCode::new(0));
    let (mut code, mut was, mut next_action) = (rest, None::<Fault>, 0);
    // A spell of large errors, and for how long they have been small.
    let (mut spell, mut quiet) = (None, 0u32);
    let (mut trace, mut sent) = (TraceBlock::new(Channels::ALL, 1), Vec::new());
    let mut counted = Counters::default();
    for tick in 0..ticks {
        if tick >= until {
            trouble = Trouble::None;
        }
        let is_conditioning = all.fresh.as_ref().is_some_and(|fresh| !fresh.is_compared);
        if is_conditioning {
            // A fault is both's; another begin is of no use.
            if all.amplifier.mode() == Mode::Fault {
                all.fresh = None;
            } else if !all.amplifier.armed() {
                all.command(Command::Arm { tested: false });
                let cycle_ticks = all.dice.decades(3_000.0, 6_000.0) as u32;
                all.command(Command::Condition {
                    cycle_ticks,
                    rest_ticks: 1_200,
                });
            } else if all.amplifier.conditioned() && all.amplifier.mode() == Mode::Rest {
                all.fresh.as_mut().expect("there is one").is_compared = true;
            }
        } else if all.fresh.as_ref().is_some_and(|fresh| tick > fresh.until) {
            let fresh = all.fresh.take().expect("there is one");
            all.compare(&fresh, seed);
        } else if all.is_recovered && all.fresh.is_none() && tick > until {
            all.is_recovered = false;
            all.start_beside(tick);
        } else if tick >= next_action {
            next_action = tick + all.dice.decades(5.0, 4_000.0) as u32;
            // One in a hundred spells of the host is too long.
            let silent_for = if all.dice.share() < 1e-2 { 40_000 } else { 0 };
            all.host.hear(tick);
            next_action += silent_for;
            match all.dice.within(0.0, 20.0) as u32 {
                0 => {
                    let wanted = filter(&mut all.dice);
                    all.command(wanted);
                }
                1 => {
                    all.bench.gain_um_v = healthy.0 * all.dice.decades(0.7, 1.8);
                    all.bench.natural_rad_s = healthy.1 * all.dice.decades(0.6, 1.1);
                    all.bench.damping = healthy.2 * all.dice.decades(0.01, 2.0);
                }
                2 | 3 => {
                    let bench = &mut all.bench;
                    (bench.gain_um_v, bench.natural_rad_s, bench.damping) = healthy;
                }
                4 => {
                    trouble =
                        Trouble::ALL[all.dice.within(0.0, Trouble::ALL.len() as f64) as usize];
                    // What a self-test finds lasts as long as it takes to clear the jump and to arm.
                    let [least, most] = if trouble.is_slow() {
                        [20_000.0, 60_000.0]
                    } else {
                        [1.0, 400.0]
                    };
                    until = tick + all.dice.decades(least, most) as u32;
                }
                5 => all.swap(),
                6 => {
                    let which = all.dice.within(0.0, FROM_OUTSIDE.len() as f64) as usize;
                    all.refuse(FROM_OUTSIDE[which]);
                }
                _ => {
                    let tested = if trouble.is_slow() { 0.9 } else { 0.1 };
                    let wanted = if all.dice.share() < 0.7 {
                        next_step(&mut all.dice, &all.amplifier, tested)
                    } else {
                        command(&mut all.dice)
                    };
                    all.command(wanted);
                }
            }
        }
        match all
            .host
            .missed(tick, all.amplifier.mode(), all.amplifier.powered())
        {
            None => {}
            Some(Missed::Stop) => all.refuse(Fault::HostLost),
            Some(Missed::SwitchOff) => _ = all.command(Command::Disarm),
        }
        let honest = all.bench.reading();
        let reading = trouble.reading(honest, last_reading, tick, &mut all.dice);
        last_reading = reading.unwrap_or(last_reading);
        let monitored = trouble.monitored(all.bench.drive_v);
        let overrun = all.dice.share() < 1e-6;
        let before = code;
        all.amplifier.inspect_output(monitored);
        let sample = all.amplifier.tick(reading, overrun);
        if let Some(fresh) = &mut all.fresh {
            fresh.amplifier.inspect_output(monitored);
            let same = TraceSample {
                tick,
                ..fresh.amplifier.tick(reading, overrun)
            };
            assert_eq!(
                (same.dac_code, same.flags),
                (sample.dac_code, sample.flags),
                "seed {seed}, tick {tick}: a fresh start does otherwise"
            );
            if fresh.is_compared {
                fresh.has_closed |= fresh.amplifier.mode() == Mode::Closed;
                assert_eq!(
                    same, sample,
                    "seed {seed}, tick {tick}: a fresh start does otherwise"
                );
                all.seen
                    .count("ticks beside a fresh start with the same result", 1);
            }
        }
        code = sample.dac_code;
        all.bench.advance(code);

        assert_eq!(sample.packed().unpacked(), sample);
        assert_eq!(sample.tick, tick, "no tick is left out");
        sent.push(sample);
        let read_back = &mut all.seen;
        trace.push(&sample, 0, |bytes| {
            let block = ReadBlock::read(bytes).expect("what was packed is read");
            assert!(
                block.samples().eq(sent.drain(..)),
                "seed {seed}, tick {tick}"
            );
            read_back.count("samples read back from the trace", u64::from(bytes[12]));
        });
        let counters = all.amplifier.servo().counters();
        let more = |now: u32, before: u32| u64::from(now.saturating_sub(before));
        let limited = more(counters.limited_ticks, counted.limited_ticks);
        all.seen.count("ticks at a limit of the drive", limited);
        let held = more(counters.saturated_values, counted.saturated_values);
        all.seen
            .count("values held at the end of their format", held);
        counted = counters;
        all.seen.count("ticks", 1);

        assert!(
            (c.dac_code_min..=c.dac_code_max).contains(&code)
                && code.abs_diff(before) <= c.slew_codes,
            "seed {seed}, tick {tick}: {before} to {code}"
        );
        let (mode, fault) = (all.amplifier.mode(), all.amplifier.fault());
        assert_eq!(
            mode == Mode::Fault,
            fault.is_some(),
            "every stop has a name"
        );
        // The current is that of the code which leaves in this tick; the next one is on its way to rest.
        let leaves = fault == Some(Fault::DriveCurrent) && was.is_none();
        if fault != was {
            if let Some(fault) = fault {
                assert!(!fault.name().is_empty());
                *all.seen.faults.entry(fault.name()).or_insert(0) += 1;
            }
            was = fault;
        }
        if matches!(mode, Mode::Rest | Mode::Fault) {
            all.is_asked = false;
        }
        all.is_recovered &= mode == Mode::Rest;
        if !all.is_asked && !leaves {
            assert!(
                code.abs_diff(rest) <= before.abs_diff(rest),
                "seed {seed}, tick {tick}: {before} to {code} in {mode:?}, and nobody asked for it"
            );
        }
        if !all.amplifier.powered() && mode == Mode::Playing {
            // The self-test's step, which shows that the power stage is off.
            let away = i64::from(c.drive(code).abs_diff(c.drive(rest)));
            assert!(
                away <= (STEP_MILLIVOLTS << 22) / 1000,
                "{code} without power"
            );
        } else if !all.amplifier.powered() {
            assert_eq!(
                code,
                code.min(before).max(rest),
                "without power towards rest only"
            );
        }
        let converters = &all.amplifier.servo().parameters().converters;
        let error_um = f64::from(sample.reference) / 2f64.powi(24)
            - f64::from(converters.position(last_reading)) / 2f64.powi(24);
        if mode != Mode::Closed {
            (spell, quiet) = (None, 0);
            continue;
        }
        all.seen.count("ticks with the loop closed", 1);
        if error_um.abs() > LIMIT_UM {
            let first = *spell.get_or_insert(tick);
            quiet = 0;
            assert!(
                tick - first <= 2 * 100,
                "seed {seed}, tick {tick}: swings since {first}"
            );
        } else {
            quiet += 1;
            spell = spell.filter(|_| quiet <= 100);
        }
    }
    all.seen
}

/// Runs of so many ticks in all, on every core.
fn attack(first_seed: u64, ticks: u64) -> Seen {
    const RUN: u32 = 500_000;
    let runs = ticks.div_ceil(RUN.into());
    let each = ticks.div_ceil(runs) as u32;
    let next = AtomicU64::new(0);
    let work = || {
        let mut seen = Seen::default();
        loop {
            let run_number = next.fetch_add(1, Ordering::Relaxed);
            if run_number >= runs {
                return seen;
            }
            seen.add(run((first_seed + run_number) * 104_729 + 1, each));
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut all = Seen::default();
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        for worker in workers {
            all.add(
                worker
                    .join()
                    .unwrap_or_else(|cause| std::panic::resume_unwind(cause)),
            );
        }
    });
    for (name, count) in COUNTS.iter().zip(all.counts) {
        println!("soak;{name},{count}");
    }
    for (name, count) in &all.faults {
        println!("soak;fault: {name},{count}");
    }
    assert_eq!(all.of("ticks"), runs * u64::from(each));
    assert!(all.of("ticks with the loop closed") > ticks / 20);
    assert!(all.of("ticks beside a fresh start with the same result") > ticks / 50);
    all
}

#[test]
fn an_adversary_neither_moves_nor_swings_the_stage() {
    let seen = attack(0, 2_000_000);
    let expected = FROM_OUTSIDE.iter().chain(&PROVOKED[..5]);
    for fault in expected {
        assert!(seen.faults.contains_key(fault.name()), "{}", fault.name());
    }
}

mod long {
    use super::*;

    #[test]
    #[ignore = "10^7 ticks, for cargo xtask full; cargo xtask soak runs 10^9"]
    fn an_adversary_of_many_ticks_neither_moves_nor_swings_the_stage() {
        let wanted = std::env::var("HYSTERON_SOAK_TICKS");
        let seen = attack(
            100,
            wanted.map_or(10_000_000, |ticks| ticks.parse().expect("ticks")),
        );
        for fault in FROM_OUTSIDE.iter().chain(&PROVOKED) {
            assert!(seen.faults.contains_key(fault.name()), "{}", fault.name());
        }
    }
}

//! A drive from -20 to 120 V, recorded from rest at 0 V on a stage by other equations: what the one-sided
//! surfaces, which count from -20 V, make of its history, and the servo that is designed from that.

use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::reference::Reference;
use hysteron::servo::work::{Work, follow_plant};
use hysteron::{
    Dataset, Options, Record, Role, Start, Unwatched, WhiteNoise, analyse, effects_named,
};
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::waveform;

const PERIOD_S: f64 = 5e-5;
const NOISE_UM: f64 = 0.002;
const RANGE_V: [f64; 2] = [-20.0, 120.0];
const PLAYS: usize = 48;
/// Widest play, V: the first rise from 0 V and the loops across it differ.
const WIDEST_V: f64 = 60.0;

/// Plays behind a curved drive, and a mode at 700 Hz; virgin at 0 V.
#[derive(Default)]
struct Stage {
    plays_v: Vec<f64>,
    position_um: f64,
    velocity_um_s: f64,
}

impl Stage {
    fn force_um(&mut self, drive_v: f64) -> f64 {
        self.plays_v.resize(PLAYS, 0.0);
        let curved_v = drive_v * (1.0 + 0.0012 * drive_v);
        let (mut through, mut weights) = (0.0, 0.0);
        for (nth, play) in self.plays_v.iter_mut().enumerate() {
            let half_v = WIDEST_V * (nth as f64 + 0.5) / PLAYS as f64;
            *play = play.max(curved_v - half_v).min(curved_v + half_v);
            let weight = (-half_v / 25.0).exp();
            (through, weights) = (through + weight * *play, weights + weight);
        }
        0.1 * (0.7 * curved_v + 0.3 * through / weights)
    }
}

impl Plant for Stage {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        const SUBSTEPS: usize = 20;
        let (omega, damping_ratio) = (std::f64::consts::TAU * 700.0, 0.2);
        let (force_um, dt) = (
            self.force_um(drive_v) + external_um,
            PERIOD_S / SUBSTEPS as f64,
        );
        for _ in 0..SUBSTEPS {
            let pull = omega * omega * (force_um - self.position_um)
                - 2.0 * damping_ratio * omega * self.velocity_um_s;
            self.velocity_um_s += dt * pull;
            self.position_um += dt * self.velocity_um_s;
        }
    }

    fn displacement_um(&self) -> f64 {
        self.position_um
    }

    fn sensor_um(&self) -> f64 {
        self.position_um
    }
}

/// Growing triangles to both sides of 0 V, smaller ones inside, and a multisine about the middle.
fn recording() -> Dataset {
    let rate_hz = 1.0 / PERIOD_S;
    let mut drive_v = vec![0.0; 1000];
    let growing = [
        0.0, 24.0, -4.0, 48.0, -8.0, 72.0, -12.0, 96.0, -16.0, 120.0, -20.0, 0.0,
    ];
    let inside = [0.0, 84.0, -4.0, 60.0, -20.0, 108.0, 0.0, 36.0, -20.0, 50.0];
    for vertices in [&growing[..], &inside[..]] {
        drive_v.extend(waveform::triangles(rate_hz, 4000.0, vertices));
    }
    drive_v.extend((0..24_000).map(|k| {
        let phase = |hz: f64| (std::f64::consts::TAU * hz * f64::from(k) * PERIOD_S).sin();
        50.0 + 31.0 * phase(37.0) + 19.0 * phase(111.0) + 9.0 * phase(411.0)
    }));
    drive_v.extend(waveform::triangles(rate_hz, 4000.0, &[50.0, 0.0]));
    drive_v.extend([0.0; 2000]);
    let (mut stage, mut noise) = (Stage::default(), WhiteNoise::new(NOISE_UM, 3));
    let reading_um: Vec<f64> = drive_v
        .iter()
        .map(|u| {
            let reading_um = stage.sensor_um() + noise.next_um();
            stage.advance(*u, 0.0);
            reading_um
        })
        .collect();
    let samples = drive_v.len();
    let whole = Record::new("run", rate_hz, drive_v, reading_um);
    let part = |name: &str, role, window| Record {
        name: name.into(),
        role,
        window,
        ..whole.clone()
    };
    let records = vec![
        part("fitted", Role::Identify, 1000..samples - 14_000),
        part("held out", Role::Validate, samples - 14_000..samples - 2000),
        part("rest", Role::Noise, samples - 1500..samples),
    ];
    Dataset::new("bipolar", RANGE_V[0], RANGE_V[1], records).unwrap()
}

#[test]
fn a_drive_across_zero_is_explained_and_controlled() {
    let dataset = recording();
    let start = effects_named("gain").unwrap();
    let found = analyse(
        &dataset,
        Start::Effects(&start),
        &Options::default(),
        &Unwatched,
    )
    .unwrap();
    let error_um = found.last().error_um();
    println!("{}: {:.2} nm", found.diagnosis.sentence, 1e3 * error_um);
    assert!(error_um < 2.0 * NOISE_UM, "{error_um} um");
    let design = order::design(
        &found.model,
        &DesignOrder {
            reference_hz: 50.0,
            recording: Some(&dataset),
            ..DesignOrder::default()
        },
    )
    .unwrap();
    assert_eq!(
        [design.model.drive_min_v, design.model.drive_max_v],
        RANGE_V
    );
    // Counted from -20 V: the drive goes from -11 to 76 V.
    let reference = Reference::named("sine:20:4:5", design.period_s()).unwrap();
    let work = Work {
        sensor_noise_um: Some(NOISE_UM),
        ..Work::default()
    };
    let mut stage = Stage::default();
    let track = follow_plant(
        &mut stage,
        "the stage",
        &design,
        &reference,
        "sine:20:4:5",
        &work,
    )
    .unwrap();
    println!("{:?}", track.truth);
    assert!(track.truth.rms_um < 2.0 * NOISE_UM, "{:?}", track.truth);
    assert_eq!(track.saturated_ticks, 0);
}

#[test]
fn a_drive_below_the_stated_limit_is_refused() {
    let dataset = recording();
    let records = dataset.records;
    let refused = Dataset::new("bipolar", 0.0, 120.0, records)
        .unwrap_err()
        .to_string();
    assert!(refused.contains("outside drive_min_v = 0"), "{refused}");
}

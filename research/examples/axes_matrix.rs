//! One law with matrices for all axes of a stage, beside one loop an axis and beside decoupled loops; and more
//! drives than axes within limits. Prints the tables of the servos in `docs/results/several_axes.md`.
//!
//!     cargo run --release -p hysteron-research --example axes_matrix -- [STAGES [FIRST_SEED]] [--csv FILE]

use hysteron::several_axes::decoupling::{AxesServo, Decoupling, with_hidden_coupling};
use hysteron::several_axes::loop_check::{AxesLaw, CheckedStage, SENSITIVITY_MAX, Sine, track};
use hysteron::several_axes::matrix_law::{AxesDemands, MatrixServo, gain_at_rest};
use hysteron::several_axes::planted::{AxisPlant, planted_stage};
use hysteron_sim::several_axes::{DrivePath, ModalStage};
use std::fmt::Write as _;

/// Sampling period of the planted stages, s.
const DT_S: f64 = 1.0 / 6400.0;
const DEMANDS: AxesDemands = AxesDemands {
    reference_hz: 20.0,
    amplitude: 1.0,
    noise: 0.001,
    sensitivity_peak: SENSITIVITY_MAX,
};
/// Share by which every drive also moves the modes of the others, known to a design that can know it.
const KNOWN_COUPLING: f64 = 0.2;
/// What the design does not know: a further share, and natural frequencies.
const HIDDEN_COUPLING: f64 = 0.1;
const HIDDEN_FREQUENCY: f64 = 1.02;
const PLANTS: [AxisPlant; 3] = [
    AxisPlant::SensorCoupling,
    AxisPlant::ModeOfOneDrive,
    AxisPlant::Delay,
];

/// A scheme, and whether its model has the couplings.
#[derive(Clone, Copy)]
enum Scheme {
    Integral(Decoupling),
    Pidsmoc(bool),
}

const SCHEMES: [Scheme; 4] = [
    Scheme::Integral(Decoupling::Static),
    Scheme::Integral(Decoupling::Modal),
    Scheme::Pidsmoc(false),
    Scheme::Pidsmoc(true),
];

impl Scheme {
    fn name(self) -> String {
        match self {
            Self::Integral(decoupling) => format!("integral; {} decoupling", decoupling.name()),
            Self::Pidsmoc(true) => "PIDSMOC; matrices".into(),
            Self::Pidsmoc(false) => "PIDSMOC; one loop an axis".into(),
        }
    }

    /// The law, and the multiplications of its tick.
    fn design(self, stage: &ModalStage) -> Option<(Box<dyn AxesLaw>, f64)> {
        match self {
            Self::Integral(decoupling) => {
                let servo = AxesServo::design(stage, decoupling, DT_S).ok()?;
                // Two matrices, and six products of a channel.
                let axes = servo.channels.len() as f64;
                Some((Box::new(servo), 2.0 * axes * axes + 6.0 * axes))
            }
            Self::Pidsmoc(coupled) => {
                let known = if coupled {
                    stage.clone()
                } else {
                    uncoupled(stage)
                };
                let servo = MatrixServo::design(&known, stage, DT_S, &DEMANDS).ok()?;
                let products = servo.products() as f64;
                Some((Box::new(servo), products))
            }
        }
    }
}

/// Every axis with its own drive, mode and sensor alone.
fn uncoupled(stage: &ModalStage) -> ModalStage {
    let axes = stage.sensors.len();
    let mut alone = stage.clone();
    alone.modes.truncate(axes);
    for (axis, mode) in alone.modes.iter_mut().enumerate() {
        let others = |shares: &mut [f64]| {
            (shares.iter_mut().enumerate())
                .filter(|(n, _)| *n != axis)
                .for_each(|(_, share)| *share = 0.0);
        };
        others(&mut mode.of_drives);
        others(&mut mode.of_sensors);
    }
    alone
}

/// Largest factor on the gain of all drives at which the loop is stable, up to five.
fn borne_gain(law: &dyn AxesLaw, stage: &ModalStage) -> f64 {
    let is_stable = |factor: &f64| {
        let mut louder = stage.clone();
        let shares = louder.modes.iter_mut().flat_map(|mode| &mut mode.of_drives);
        shares.for_each(|share| *share *= factor);
        CheckedStage::new(&louder, DT_S).spectral_radius(law) < 1.0
    };
    let factors = (20..=100).map(|n| 0.05 * f64::from(n));
    factors.take_while(is_stable).last().unwrap_or(0.0)
}

/// Own error and crosstalk of the worst axis, %.
fn errors_pct(law: &dyn AxesLaw, stage: &ModalStage) -> [f64; 2] {
    let moved = (0..stage.sensors.len()).map(|axis| {
        let sine = Sine {
            axis,
            amplitude: DEMANDS.amplitude,
            hz: DEMANDS.reference_hz,
            turns: 8.0,
        };
        let track = track(law, stage, &sine);
        [100.0 * track.own, 100.0 * track.crosstalk]
    });
    moved.fold([0.0; 2], |worst, pair| {
        [worst[0].max(pair[0]), worst[1].max(pair[1])]
    })
}

/// Sensitivity, borne gain, unknown input let through in per cent, errors in per cent on the stage and on
/// one that the design does not know, and products.
fn figures(scheme: Scheme, stage: &ModalStage) -> Option<[f64; 8]> {
    let (law, products) = scheme.design(stage)?;
    let law = law.as_ref();
    let checked = CheckedStage::new(stage, DT_S);
    let open = gain_at_rest(stage).singular_values().max();
    let mut hidden = with_hidden_coupling(stage, HIDDEN_COUPLING);
    (hidden.modes.iter_mut()).for_each(|mode| mode.frequency_hz *= HIDDEN_FREQUENCY);
    let [own, others] = errors_pct(law, stage);
    let [own_hidden, others_hidden] = errors_pct(law, &hidden);
    Some([
        checked.check(law).sensitivity_peak,
        borne_gain(law, stage),
        100.0 * checked.lets_through(law, DEMANDS.reference_hz) / open,
        own,
        others,
        own_hidden,
        others_hidden,
        products,
    ])
}

fn median(figures: &[f64]) -> f64 {
    let mut sorted = figures.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Largest amplitude of the first axis with an error of all axes below 5 %, by what one volt of its own drive
/// makes of it at the limit.
fn reach(law: &dyn AxesLaw, stage: &ModalStage, limit: f64, hz: f64) -> f64 {
    let own = gain_at_rest(stage)[(0, 0)].abs() * limit;
    let follows = |share: &f64| {
        let sine = Sine {
            axis: 0,
            amplitude: share * own,
            hz,
            turns: 4.0,
        };
        let moved = track(law, stage, &sine);
        moved.own.max(moved.crosstalk) < 0.05
    };
    let shares = (1..=60).map(|n| 0.05 * f64::from(n));
    shares.take_while(follows).last().unwrap_or(0.0)
}

/// Reach with three drives, and with a fourth.
fn reaches(seed: u64, hz: f64) -> Option<[f64; 2]> {
    const LIMIT_V: f64 = 50.0;
    let planted = planted_stage(AxisPlant::SensorCoupling, seed).stage;
    let three = with_hidden_coupling(&planted, KNOWN_COUPLING);
    let mut four = three.clone();
    four.drives.push(DrivePath {
        plays: three.drives[0].plays.clone(),
        ..DrivePath::default()
    });
    four.feedthrough.iter_mut().for_each(|row| row.push(0.0));
    for (mode, share) in four.modes.iter_mut().zip([0.6, -0.4, 0.3]) {
        mode.of_drives.push(share);
    }
    let [three, four] = [&three, &four].map(|stage| {
        let mut law = MatrixServo::design(stage, stage, DT_S, &DEMANDS).ok()?;
        law.limits = Some([-LIMIT_V, LIMIT_V]);
        Some(reach(&law, stage, LIMIT_V, hz))
    });
    Some([three?, four?])
}

/// What a law of two axes takes.
fn print_two_axes(seed: u64) {
    let mut two = with_hidden_coupling(
        &planted_stage(AxisPlant::SensorCoupling, seed).stage,
        KNOWN_COUPLING,
    );
    two.drives.truncate(2);
    two.sensors.truncate(2);
    two.modes.truncate(2);
    two.feedthrough = vec![vec![0.0; 2]; 2];
    for mode in &mut two.modes {
        mode.of_drives.truncate(2);
        mode.of_sensors.truncate(2);
    }
    if let Ok(law) = MatrixServo::design(&two, &two, DT_S, &DEMANDS) {
        // A coefficient is four bytes; a state has its fraction beside it.
        println!(
            "two axes: {} products, {} bytes of coefficients and states",
            law.products(),
            4 * law.products() + 8 * law.states()
        );
    }
}

fn main() -> std::io::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let numbers: Vec<u64> = arguments.iter().map_while(|a| a.parse().ok()).collect();
    let first = numbers.get(1).copied().unwrap_or(101);
    let seeds = first..first + numbers.first().copied().unwrap_or(5);
    let mut table = "stages,scheme,designed,sensitivity,gain borne,let through %,own %,others %,own hidden %,others hidden %,products\n".to_owned();
    for plant in PLANTS {
        for scheme in SCHEMES {
            let all: Vec<[f64; 8]> = (seeds.clone())
                .filter_map(|seed| {
                    let planted = planted_stage(plant, seed).stage;
                    figures(scheme, &with_hidden_coupling(&planted, KNOWN_COUPLING))
                })
                .collect();
            let column = |n: usize| median(&all.iter().map(|row| row[n]).collect::<Vec<_>>());
            let _ = writeln!(
                table,
                "{},{},{} of {},{:.2},{:.2},{:.1},{:.2},{:.2},{:.2},{:.2},{:.0}",
                plant.name(),
                scheme.name(),
                all.len(),
                seeds.end - seeds.start,
                column(0),
                column(1),
                column(2),
                column(3),
                column(4),
                column(5),
                column(6),
                column(7)
            );
        }
    }
    println!("{table}");
    for hz in [5.0, 20.0, 50.0] {
        let all: Vec<[f64; 2]> = (seeds.clone())
            .filter_map(|seed| reaches(seed, hz))
            .collect();
        let column = |n: usize| median(&all.iter().map(|row| row[n]).collect::<Vec<_>>());
        println!(
            "reach of an axis at {hz} Hz over that of its own drive: three drives {:.2}, four {:.2}",
            column(0),
            column(1)
        );
    }
    print_two_axes(seeds.start);
    match arguments
        .iter()
        .position(|a| a == "--csv")
        .and_then(|n| arguments.get(n + 1))
    {
        Some(file) => std::fs::write(file, table),
        None => Ok(()),
    }
}

//! What `design` promises against what `track` finds, on drawn models with and without a lag of the sensor
//! that is named: prints a table.
//!
//!     cargo run --release --workspace --example servo_promise -- [MODELS]
//!
//! The promise is the error of the true position on a sine of the highest frequency of references. `track`
//! follows the same sine with the servo as its file has it, read back from text.

use hysteron::servo::commands::design_with_expected_errors;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::order::DesignOrder;
use hysteron::servo::reference::Reference;
use hysteron::servo::work::{Work, follow};
use hysteron::{EffectInstance, Model, Overview, effect_named};
use hysteron_sim::noise::WhiteNoise;

/// Lags of the sensor, Hz; none for an ideal one.
const SENSORS_HZ: [Option<f64>; 3] = [None, Some(300.0), Some(2000.0)];
/// The promise is to be within this factor of what is found.
const WITHIN: f64 = 1.5;

/// A model, drawn by its number.
fn drawn(nth: u64, sensor_hz: Option<f64>) -> Model {
    let mut normal = WhiteNoise::new(1.0, nth + 1);
    let mut near = |value: f64, spread: f64| value * (spread * normal.next_um()).exp();
    let overview = Overview::without_data(0.0, 80.0);
    let mut model = Model::new(0.0, 80.0);
    let mut add = |id: &str, values: &[f64]| {
        let effect = effect_named(id).expect("an effect");
        model.add(EffectInstance::new(effect, &overview, values));
    };
    if nth % 3 == 1 {
        add("delay", &[near(3e-5, 0.3)]);
    }
    if nth % 4 == 2 {
        add("amplifier_bandwidth", &[near(3000.0, 0.3)]);
    }
    add(
        "hysteresis",
        &[near(8.0, 0.2), near(1.0, 0.3), -near(1.5, 0.3)],
    );
    add("vibration", &[near(5500.0, 0.3), near(0.2, 0.8).min(0.9)]);
    if nth % 2 == 1 {
        add("creep", &[0.01, near(1.0, 0.5)]);
    }
    if let Some(hz) = sensor_hz {
        add("sensor_bandwidth", &[hz]);
    }
    model
}

fn main() {
    let models = std::env::args().nth(1).and_then(|n| n.parse().ok());
    println!(
        "| model | sensor, Hz | the scan reckons, nm | promised, nm | found, nm | found over promised |"
    );
    println!("|---|---|---|---|---|---|");
    let (mut inside, mut all) = (0, 0);
    for nth in 0..models.unwrap_or(10u64) {
        for sensor_hz in SENSORS_HZ {
            let model = drawn(nth, sensor_hz);
            let order = DesignOrder::default();
            let sensor = sensor_hz.map_or_else(|| "ideal".into(), |hz| format!("{hz:.0}"));
            let (design, rows) = match design_with_expected_errors(&model, &order) {
                Ok(found) => found,
                Err(why) => {
                    println!("| {nth} | {sensor} | refused: {why} ||||");
                    continue;
                }
            };
            let row = rows.last().expect("a row for each frequency");
            let text = toml::to_string(&design).expect("a file");
            let design: ServoDesign = toml::from_str(&text).expect("a servo");
            let name = format!("sine:{}:{}", row.frequency_hz, row.amplitude_um);
            let reference = Reference::named(&name, design.period_s()).expect("a sine");
            let found = follow(&model, &design, &reference, &name, &Work::default());
            let found_um = found.expect("within the travel").truth.rms_um;
            let ratio = found_um / row.true_rms_um;
            all += 1;
            inside += usize::from((1.0 / WITHIN..=WITHIN).contains(&ratio));
            println!(
                "| {nth} | {sensor} | {:.2} | {:.2} | {:.2} | {ratio:.3} |",
                1e3 * design
                    .chosen
                    .map_or(f64::NAN, |chosen| chosen.expected_um()),
                1e3 * row.true_rms_um,
                1e3 * found_um
            );
        }
    }
    println!("\n{inside} of {all} within a factor of {WITHIN}.");
}

//! scratch
use hysteron::servo::{design, float_twin, reproduce, thesis_schemes::*};
use hysteron_sim::bench::*;
fn main() {
    let bench = Bench::reference().unwrap();
    let which = std::env::args().nth(1).unwrap_or_default();
    if which == "f" {
        for v in [Variant::PLAIN, Variant::FULL] {
            let c = reproduce::commission(&bench, v).unwrap();
            for l in &c.design.explanation {
                println!("{l}");
            }
            for (hz, a) in [(1.0, 5.0), (10.0, 5.0), (50.0, 5.0), (150.0, 5.0), (500.0, 4.0)] {
                let (r, _) = reproduce::sine_reference_um(&bench, hz, a);
                println!("{v:?} {hz} {:?}", float_twin::integer_difference_um(&bench, v, &c.design, &r, 7).unwrap());
            }
            println!("{}", toml::to_string(&c.design).unwrap().len());
        }
        return;
    }
    if which == "t" {
        let (r10, f) = reproduce::sine_reference_um(&bench, 10.0, 5.0);
        let (r100, _) = reproduce::sine_reference_um(&bench, 100.0, 5.0);
        let run = |s: design::Scheme| {
            let d = reproduce::without_model(&bench, s);
            let a = reproduce::run(&bench, Variant::PLAIN, &d, &r10, 7).unwrap();
            let b = reproduce::run(&bench, Variant::PLAIN, &d, &r100, 7).unwrap();
            let st = reproduce::run(&bench, Variant::PLAIN, &d, &reproduce::quasi_step_um(20000.0, 3.0), 7).unwrap();
            let dv: Vec<f64> = st.drive_v[40000..].windows(2).map(|w| (w[1] - w[0]).powi(2)).collect();
            (
                a.sensor_error(f).rms_um,
                b.sensor_error(f).rms_um,
                reproduce::steady_um(&st),
                st.sensor_error(0).rms_um,
                (dv.iter().sum::<f64>() / dv.len() as f64).sqrt(),
            )
        };
        for p in [1.0, 2.0, 4.0, 6.0, 8.0] {
            for i in [30e3, 55.1e3, 80e3, 120e3] {
                println!("pid {p} {i} {:?}", run(design::Scheme::Pid { gains: PidGains { p, i, d: 1e-8 }, notch: None }));
            }
        }
        if let Some(design::Scheme::SlidingMode { nominal, estimator, controller, .. }) = design::thesis_scheme("pidsm-chapter-6") {
            for eta in [4.0, 7.0, 10.0, 15.0, 20.0] {
                println!(
                    "sm {eta} {:?}",
                    run(design::Scheme::SlidingMode { nominal, estimator, controller, reaching: ReachingGains::Switching { eta_v: eta } })
                );
            }
            for eta in [20.0, 50.0, 122.0] {
                for delta in [60e3, 120e3, 250e3, 500e3] {
                    println!(
                        "bl {eta} {delta} {:?}",
                        run(design::Scheme::SlidingMode {
                            nominal,
                            estimator,
                            controller,
                            reaching: ReachingGains::BoundaryLayer { eta_v: eta, delta_um_s: delta }
                        })
                    );
                }
            }
        }
        return;
    }
    let rows = if which == "6" { reproduce::rows_of_chapter_6(&bench) } else { reproduce::rows_of_chapter_7(&bench, &|_| ()) };
    for r in rows {
        println!("{:45} {:10.5} {} | {}", r.id, r.ours, r.unit, r.note);
    }
}

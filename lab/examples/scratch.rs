//! scratch
use hysteron::dataset::*;
use hysteron::fit::*;
use hysteron_sim::chain::*;
use hysteron_sim::effect::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let d = match Dataset::load(std::path::Path::new(&args[1])) {
        Ok(d) => d,
        Err(e) => {
            eprintln!("{e}");
            std::process::exit(2)
        }
    };
    let o = d.overview();
    println!("{o:?}");
    let mut m = Model::new(d.drive_min_v, d.drive_max_v);
    for id in args[2].split(',') {
        let e = by_id(id).unwrap();
        m.add(EffectInstance::new(e, &o, &[]));
    }
    let ids = d.with_role(Role::Identify);
    let t = std::time::Instant::now();
    let mut f = fit(&m, &d, &ids, Effort::default());
    println!("fit {:?} iterations {} rms {:.6}", t.elapsed(), f.iterations, f.rms_um);
    let un = estimate_uncertainty(&mut f.model, &d, &ids);
    println!("{:?} {un:?}", t.elapsed());
    for e in &f.model.effects {
        for p in &e.parameters {
            println!("  {} {} = {:.6} +- {:.2e}", e.id, p.parameter.name, p.value, p.std.unwrap_or(0.0));
        }
    }
    for (_i, r) in d.records.iter().enumerate() {
        let x = residual(&f.model, r);
        println!(
            "{} {:?} rms {:.6} = {:.4}% max {:.5}",
            r.name,
            r.role,
            rms(&x),
            100.0 * rms(&x) / r.range_um(),
            x.iter().fold(0.0f64, |m, v| m.max(v.abs()))
        );
    }
    if let Some(out) = args.get(3) {
        use std::fmt::Write;
        for r in &d.records {
            let x = residual(&f.model, r);
            let mut s = String::new();
            for (j, k) in r.window.clone().enumerate() {
                writeln!(s, "{},{},{},{}", k as f64 * r.dt_s(), r.drive_v[k.max(1) - 1], r.displacement_um[k], x[j]).unwrap();
            }
            std::fs::write(format!("{out}_{}.csv", r.name), s).unwrap();
        }
    }
}

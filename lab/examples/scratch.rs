//! scratch
use hysteron::servo::{identify, reproduce};
use hysteron_sim::bench::*;
fn main() {
    let bench = Bench::reference().unwrap();
    let which = std::env::args().nth(1).unwrap_or_default();
    if which == "i" {
        for v in [Variant::PLAIN, Variant::FULL] {
            let t0 = std::time::Instant::now();
            let i = identify::on_bench(&bench, v, 5).unwrap();
            println!(
                "{v:?} {:?} rms {:.6}\n steps {:?}\n {:?} {:?}",
                t0.elapsed(),
                i.rms_um,
                i.steps,
                i.model.linear,
                i.chain.values("creep")
            );
            let _ = std::io::Write::flush(&mut std::io::stdout());
        }
        return;
    }
    let rows = if which == "6" { reproduce::chapter_6(&bench) } else { reproduce::chapter_7(&bench) };
    for r in rows {
        println!("{:45} {:10.5} {} | {}", r.id, r.ours, r.unit, r.note);
    }
}

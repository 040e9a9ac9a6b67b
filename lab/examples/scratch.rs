//! scratch
use hysteron::servo::identify;
use hysteron_sim::bench::*;
fn main() {
    let bench = Bench::reference().unwrap();
    for v in [Variant::PLAIN, Variant::FULL, Variant{loaded:true,..Variant::FULL}] {
        let t0 = std::time::Instant::now();
        let i = identify::on_bench(&bench, v, 5).unwrap();
        println!("{v:?} {:?} rms {:.6}\n steps {:?}\n {:?}", t0.elapsed(), i.rms_um, i.steps, i.model.linear);
    }
}

//! scratch
use hysteron::dataset::*; use hysteron::diagnosis::{growth::*,refit::*,verdict::*}; use hysteron::floor::*; use hysteron_sim::effect::*;
fn main(){
 let args:Vec<String>=std::env::args().collect();
 let d=match Dataset::load(std::path::Path::new(&args[1])){Ok(d)=>d,Err(e)=>{eprintln!("{e}");std::process::exit(2)}};
 let t=std::time::Instant::now();
 let fl=noise_floor(&d);
 let quiet=args.len()>3;
 let w=Workbench{dataset:&d,overview:d.overview(),split:Split::of(&d),candidates:registry(),floor_um:fl.rms_um,progress:&|s:&str| if !quiet {eprintln!("{:?} {s}",t.elapsed())}};
 let effects:Vec<_>=args[2].split(',').map(|i|by_id(i).unwrap()).collect();
 let base=w.build(&effects);
 let g=w.grow(base);
 let di=diagnose(&g,&fl,&d,&w.split);
 for s in &g.steps { println!("  {:?} -{:?} id {:.6} val {:.6} | {}",s.added,s.removed,s.judged.identify_rms_um,s.judged.validate_rms_um.unwrap_or(0.0),s.why); }
 if !quiet { println!("floor {:?}",fl);
 for r in &g.rounds { println!("  tied {:?}",r.tied); for f in &r.finalists { let s=&r.screening.scores[f.score]; println!("     {:20} share {:.3} p {:.4} padj {:.4} id {:.6} val {:.6} {:?}",f.id,s.share,s.p_value,s.p_adjusted,f.judged.identify_rms_um,f.judged.validate_rms_um.unwrap_or(0.0),f.improvement);} for s in &r.screening.scores { print!(" {}:{:.3}/{:.4}",s.id,s.share,s.p_value);} println!(); } }
 println!("{:?} {:?} ratio {:.3} {:.2}s",di.verdict,di.named,di.residual_rms_after_um.validate.unwrap()/fl.rms_um.unwrap_or(1.0),t.elapsed().as_secs_f64());
}

//! The thesis' experiments, played on two simulated benches and identified from what the sensor read.
//!
//! # How it works
//! Each chapter is a module with one function that plays the experiments as the thesis describes them,
//! identifies the models from those noisy records, and hands back a [`Chapter`]: figures with their
//! identifiers, the runs by which anything was chosen, and the sections of a report page. No chapter knows
//! what would be a good figure; [`scoreboard`] stands the printed results beside them.
//!
//! The constants of a bench are used by the simulation alone ([`hysteron_sim::bench`]); an identification
//! sees only records, the sampling rate and the limits of the drive. The reference bench follows the thesis'
//! equations, the bench of domains other ones: what is met there is met on a plant that is not the model.

mod bench_runs;
mod chapter;
mod chapter_3;
mod chapter_4;
mod chapter_5;
mod chapter_6;
mod chapter_7;
pub mod commissioning;
mod comparison;
pub mod coverage;
pub mod estimators;
mod figures;
pub mod float_twin;
pub mod least_squares;
pub mod overview;
mod robustness;
pub mod scoreboard;
pub mod surface_fit;

pub use bench_runs::{commission, run, sine_reference_um};
pub use chapter::{Chapter, ChapterProgress, ChapterRow, ErrorPair, RunKey};

use hysteron_sim::bench::Bench;

/// A bench on which chapters 4 to 7 are played; the actuator of chapter 3 is another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlayedOn {
    /// The thesis' equations.
    Reference,
    /// Domains, modes of a structure, nonlinear creep, coloured noise.
    Domains,
}

impl PlayedOn {
    /// Both.
    pub const BOTH: [Self; 2] = [Self::Reference, Self::Domains];

    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::Domains => "domains",
        }
    }

    /// The bench.
    ///
    /// # Errors
    /// If its built-in file cannot be read, which a test excludes.
    pub fn bench(self) -> Result<Bench, String> {
        match self {
            Self::Reference => Bench::reference(),
            Self::Domains => Bench::domains(),
        }
        .map_err(|e| e.to_string())
    }
}

/// Chapters that can be reproduced here.
pub const CHAPTERS: [u32; 5] = [3, 4, 5, 6, 7];

/// Reproduces one chapter on a bench.
///
/// # Errors
/// A message if the chapter is not known or an identification fails.
pub fn chapter(number: u32, on: PlayedOn, progress: ChapterProgress) -> Result<Chapter, String> {
    let bench = on.bench()?;
    match number {
        3 => chapter_3::reproduce(progress),
        4 => chapter_4::reproduce(&bench, progress),
        5 => chapter_5::reproduce(&bench, progress),
        6 => Ok(chapter_6::reproduce(&bench, progress)),
        7 => Ok(chapter_7::reproduce(&bench, progress)),
        _ => Err(format!(
            "chapter {number} has nothing to reproduce: choose from {CHAPTERS:?}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use hysteron_sim::effect::registry;

    /// Where the thesis has what an effect is: chapter and equation, read off the thesis. What is not listed
    /// is not in the thesis.
    const CITED: &[(&str, &str)] = &[
        ("gain", "Ch. 6, Eq. 3"),
        ("hysteresis", "Ch. 4, Eqs. 12-15"),
        ("initial_curve", "Ch. 4, Eqs. 1, 10, 12-14"),
        ("rate_dependence", "Ch. 4, Eqs. 16-17"),
        ("rate_dependent_surfaces", "Ch. 4, Eqs. 14, 16-18"),
        ("rate_dependent_prandtl_ishlinskii", "Ch. 2, 3.1.3"),
        ("inverse_preisach", "Ch. 2, 3.1.4"),
        ("polynomial_loop", "Ch. 2, 3.1.1"),
        ("bipolar", "Ch. 8, future work 2"),
        ("two_sided", "Ch. 8, future work 2"),
        ("maxwell_slip", "Ch. 2, Eq. 3"),
        ("bouc_wen", "Ch. 2, 3.1.5"),
        ("load_force", "Ch. 2, Eq. 11"),
        ("friction", "Ch. 3, Eqs. 1-6"),
        ("vibration", "Ch. 5, Eq. 12"),
        ("mass_change", "Ch. 7, loaded case"),
        ("creep", "Ch. 2, Eqs. 4-5; Ch. 5, Eqs. 13 and 17"),
        ("creep_operators", "Ch. 2, 3.2.1"),
        ("creep_pole_pair", "Ch. 5, Eqs. 13 and 17"),
        ("logarithmic_creep", "Ch. 2, Eq. 4"),
    ];

    #[test]
    fn every_effect_cites_the_equation_that_it_is() {
        for effect in registry() {
            let declared = effect.declaration();
            let cited = CITED
                .iter()
                .find(|(id, _)| *id == declared.id)
                .map(|(_, place)| *place);
            match cited {
                Some(place) => {
                    assert!(
                        declared.reference.starts_with(&format!("thesis {place}")),
                        "{}: {}",
                        declared.id,
                        declared.reference
                    )
                }
                None => assert!(
                    !declared.reference.contains("thesis"),
                    "{} is not in the list: {}",
                    declared.id,
                    declared.reference
                ),
            }
        }
    }
}

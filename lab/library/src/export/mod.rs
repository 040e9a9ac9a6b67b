//! A model to take away: a function that simulates it, in MATLAB, NumPy or C, the inverse of its loops, and its
//! linear part as a state space.
//!
//! Every export is written from the blocks of a model at one sampling period ([`hysteron_sim::block`]), so
//! that it reads what the program reads. What a block does stands once, in [`hysteron_sim::law`]; `laws`
//! prints it in the words of a language. An effect whose stage has no blocks is refused by name.

mod c;
mod inverse;
mod language;
mod laws;
mod matlab;
mod python;
mod state_space;
mod text;

pub use inverse::inverse;
pub use language::Language;

use crate::dataset::timing::Timing;
use crate::error::{Error, Result};
use crate::origin::{Initial, Way};
use hysteron_sim::block_chain::BlockChain;
use hysteron_sim::chain::Model;
use hysteron_sim::intersample::Intersample;
use text::{Exported, cannot, identifier};

/// The text of a model in a language, at a sampling rate; `name` is what its function is called.
///
/// # Errors
/// A rate that is no positive number; an effect that no block describes.
/// ```
/// use hysteron::{EffectInstance, Language, Model, Overview, effect_named, export};
///
/// let mut model = Model::new(0.0, 100.0);
/// model.add(EffectInstance::new(effect_named("gain")?, &Overview::without_data(0.0, 100.0), &[0.1]));
/// assert!(export(&model, Language::Python, 20_000.0, "stage")?.contains("def "));
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn export(
    model: &Model,
    language: Language,
    sample_rate_hz: f64,
    name: &str,
) -> Result<String> {
    let way = Way::told(model, None, None);
    export_from(
        model,
        language,
        sample_rate_hz,
        name,
        (&Initial::AsRecorded, way),
    )
}

/// The same with where it begins and when its drive acts.
///
/// # Errors
/// As [`export`].
pub fn export_from(
    model: &Model,
    language: Language,
    sample_rate_hz: f64,
    name: &str,
    (initial, way): (&Initial, Way),
) -> Result<String> {
    if !(sample_rate_hz.is_finite() && sample_rate_hz > 0.0) {
        return Err(Error::new(
            "--rate-hz",
            format!("{sample_rate_hz}; expected a positive number"),
        ));
    }
    let name = identifier(name);
    if language == Language::StateSpace {
        return state_space::text(model, sample_rate_hz);
    }
    let intersample = match (language, way.intersample) {
        // Sample by sample the future is not known.
        (Language::C, Intersample::BandLimited) => Intersample::Linear,
        (_, intersample) => intersample,
    };
    let chain = BlockChain::of(model, 1.0 / sample_rate_hz, intersample)
        .map_err(|refused| cannot(&refused))?;
    let (start, near_v) = initial.to_carry(model);
    let exported = Exported {
        chain: &chain,
        model,
        name: &name,
        shifted: way.timing == Timing::HoldBeforeSample && intersample == Intersample::Hold,
        start: &start,
        near_v,
    };
    Ok(match language {
        Language::Matlab => matlab::text(&exported),
        Language::Python => python::text(&exported),
        Language::C | Language::StateSpace => c::text(&exported),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_function_has_a_reserved_name() {
        let named = ["for", "my stage", "2nd", "stage"].map(identifier);
        assert_eq!(named, ["model_for", "my_stage", "model_2nd", "stage"]);
    }
}

//! Actuators that are no piezo are not told effects of ceramics (all of them: the example of the same name).

use hysteron::analyse::{Options, Start, analyse};
use hysteron::model_file::effects_named;
use hysteron::watch::Unwatched;
use hysteron_research::other_actuators::{ActuatorKind, claims_of_ceramics, recorded};

#[test]
fn a_voice_coil_is_told_no_effect_of_ceramics() {
    let gain = effects_named("gain").unwrap();
    let found = analyse(
        &recorded(ActuatorKind::VoiceCoil, 2),
        Start::Effects(&gain),
        &Options::default(),
        &Unwatched,
    )
    .unwrap();
    let d = &found.diagnosis;
    let of_ceramics = claims_of_ceramics(ActuatorKind::VoiceCoil, d);
    assert!(of_ceramics.is_empty(), "{of_ceramics:?}: {}", d.sentence);
    // A field that is weaker off its middle is in no library: the remainder is reported.
    assert!(
        d.remainder.times_noise.is_some_and(|times| times > 5.0),
        "{}",
        d.sentence
    );
    // Its coil and its flexures are seen all the same.
    assert!(
        found.last().error_um() < 0.05 * found.steps[0].judged.error_um(),
        "{}",
        found.diagnosis.sentence
    );
    assert!(
        found.model.effect("vibration").is_some(),
        "{:?}",
        found.model.effect_ids()
    );
}

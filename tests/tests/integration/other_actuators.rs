//! Actuators that are no piezo are not told effects of ceramics (all of them: the example of the same name).

use hysteron::analyse::{Options, Start, analyse};
use hysteron::model_file::effects_named;
use hysteron::outcome::Verdict;
use hysteron::watch::Unwatched;
use hysteron_tests::other_actuators::{Kind, recorded};

#[test]
fn a_voice_coil_is_told_no_effect_of_ceramics() {
    let gain = effects_named("gain").unwrap();
    let found = analyse(&recorded(Kind::VoiceCoil, 2), Start::Effects(&gain), &Options::default(), &Unwatched).unwrap();
    assert_eq!(found.diagnosis.verdict, Verdict::Unexplained, "{}", found.diagnosis.sentence);
    // Its coil and its flexures are seen all the same.
    assert!(found.last().error_um() < 0.05 * found.steps[0].judged.error_um(), "{}", found.diagnosis.sentence);
    assert!(found.model.effect("vibration").is_some(), "{:?}", found.model.effect_ids());
}

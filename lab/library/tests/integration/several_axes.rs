//! Stages of three drives and three sensors whose truth is known. `hysteron axes score` runs more of them.

use hysteron::Unwatched;
use hysteron::several_axes::finder::AxesPolicy;
use hysteron::several_axes::planted::{AxisPlant, planted_stage};

#[test]
fn what_was_planted_is_named_in_its_channel() {
    for (plant, seed) in [
        // Beside five effects only two together lower the error of this one.
        (AxisPlant::Coupling, 3),
        (AxisPlant::ModeOfOneDrive, 1),
        (AxisPlant::Friction, 1),
        (AxisPlant::ActuatorHysteresis, 1),
    ] {
        let judged = planted_stage(plant, seed)
            .search(&AxesPolicy::default(), &Unwatched)
            .unwrap();
        assert!(
            judged.named,
            "{plant:?}: {} is not among {:?}",
            judged.truth, judged.found
        );
        assert!(judged.wrong.is_empty(), "{plant:?}: {:?}", judged.wrong);
        // The noise is 1 % of the readings, of a mean of four periods.
        assert!(
            judged.times_noise < 1.1,
            "{plant:?}: {}",
            judged.times_noise
        );
    }
}

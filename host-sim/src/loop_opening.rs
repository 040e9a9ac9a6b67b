//! What speaks against the values of an effect: loops that do not open are none of domains, and what stands
//! at the end of its range acts for something larger.

use crate::physics::{
    Doubt, EffectInstance, Model, Opening, ParameterValue, Place, Setting, Signals,
};

/// Loops that open by less than this share of their height are none of domain switching: of the hardest
/// ceramics they open by some per cent (Fleming and Leang, 2014, Ch. 1).
pub(crate) const OF_DOMAINS: f64 = 0.003;
/// Inputs on each branch at which loops are looked at.
const BRANCH: usize = 200;
/// So slow that nothing of the loops depends on the rate.
const DT_S: f64 = 1.0;

impl Model {
    /// What speaks against the values of an effect.
    #[must_use]
    pub fn doubt(&self, id: &str) -> Option<Doubt> {
        let e = self.effect(id)?;
        let declaration = e.effect.declaration();
        let closed = match declaration.opening {
            Opening::NotNeeded => None,
            Opening::OfItself => closed_because(self),
            Opening::OfModified => declaration
                .modifies
                .and_then(|main| self.ruled_out_because(main))
                .map(|_| "it belongs to loops, and there are none".into()),
        };
        closed
            .or_else(|| at_a_limit_because(e))
            .map(Doubt::RuledOut)
            .or_else(|| e.effect.doubt(self, &e.values()))
    }

    /// Why the model's values contradict the physics of an effect.
    #[must_use]
    pub fn ruled_out_because(&self, id: &str) -> Option<String> {
        match self.doubt(id)? {
            Doubt::RuledOut(because) => Some(because),
            Doubt::Unlikely(_) => None,
        }
    }
}

/// A value so near to an end of its range, as a share of that end, stands at it.
const AT_THE_END: f64 = 0.999;

/// Why an effect is not what its values say: one that may have either sign is as large as the effect allows,
/// so the data ask for more than its physics gives. A value of one sign may end where it has no effect, and a
/// ratio where the data show no more of it.
fn at_a_limit_because(e: &EffectInstance) -> Option<String> {
    let is_at_an_end = |value: &&ParameterValue| {
        let (parameter, value) = (&value.parameter, value.value);
        let (lower, upper) = (parameter.lower, parameter.upper);
        !parameter.fixed
            && lower < 0.0
            && upper > 0.0
            && (value > AT_THE_END * upper || value < AT_THE_END * lower)
    };
    let value = e.parameters.iter().find(is_at_an_end)?;
    Some(format!(
        "its {} of {:.3e} {} stands at the end of its range: something larger acts that it stands in for",
        value.parameter.name.replace('_', " "),
        value.value,
        value.parameter.unit
    ))
}

/// Why the loops of a model are none: they do not open.
fn closed_because(model: &Model) -> Option<String> {
    let (opening_um, height_um) = widest_opening_and_height_um(model);
    (opening_um < OF_DOMAINS * height_um).then(|| {
        format!(
            "its loops open by {:.2} % of their height, those of domains by 10 to 20 %; it is a curve without memory in front of what moves, or what else goes \
             slowly on its own way while the drive moves",
            100.0 * opening_um / height_um
        )
    })
}

/// How far the rising and the falling branch over the whole range are apart where they are farthest, and how
/// high they are, um.
pub(crate) fn widest_opening_and_height_um(model: &Model) -> (f64, f64) {
    let mut loops = model.clone();
    loops.effects.retain(|e| {
        let declaration = e.effect.declaration();
        declaration.is_main()
            || (declaration.place == Place::Hysteresis && declaration.modifies.is_some())
    });
    let (from_v, to_v) = (model.drive_min_v, model.drive_max_v);
    let rise = (0..BRANCH).map(|k| from_v + (to_v - from_v) * k as f64 / BRANCH as f64);
    let fall = (0..BRANCH).map(|k| to_v + (from_v - to_v) * k as f64 / BRANCH as f64);
    // The first rise is that of the initial curve; a reading stands at the end of the interval before it.
    let drive_v: Vec<f64> = rise
        .clone()
        .chain(fall)
        .chain(rise)
        .chain([to_v, to_v])
        .collect();
    let setting = Setting {
        signals: Signals {
            drive_v: &drive_v,
            ..Signals::default()
        },
        ..Setting::of_held_drive(from_v, to_v, DT_S)
    };
    let (mut at_rest, mut read) = (loops.virgin_drive_v(), drive_v.clone());
    for (_, mut stage) in loops.stages(&setting) {
        at_rest = stage.settle(at_rest);
        stage.run(0, &mut read);
    }
    read.insert(0, at_rest);
    let (falling, rising) = (
        &read[1 + BRANCH..2 * BRANCH + 2],
        &read[1 + 2 * BRANCH..3 * BRANCH + 2],
    );
    let opening_um = rising
        .iter()
        .zip(falling.iter().rev())
        .map(|(up, down)| (up - down).abs())
        .fold(0.0, f64::max);
    (opening_um, (rising[BRANCH] - rising[0]).abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{Overview, by_id, model_of};

    /// Share of its height by which Prandtl-Ishlinskii's operator of these weights opens.
    fn opens_by(weights_um: &[f64]) -> f64 {
        let overview = Overview::without_data(0.0, 100.0);
        let model = model_of(&overview, &[("prandtl_ishlinskii", weights_um)]);
        let (opening_um, height_um) = widest_opening_and_height_um(&model);
        opening_um / height_um
    }

    #[test]
    fn a_play_without_a_threshold_does_not_open() {
        let plays = by_id("prandtl_ishlinskii")
            .unwrap()
            .parameters(&Overview::without_data(0.0, 100.0))
            .len();
        let mut weights_um = vec![0.0; plays];
        weights_um[0] = 1.0;
        assert!(opens_by(&weights_um) < 1e-12);
        weights_um[1] = 1.0;
        assert!(opens_by(&weights_um) > 0.02);
    }

    #[test]
    fn a_bend_at_the_end_of_its_range_is_none() {
        let overview = Overview::without_data(0.0, 100.0);
        let bent = |share: f64| {
            let mut model = model_of(&overview, &[("gain", &[0.1]), ("sensor_nonlinearity", &[])]);
            let value = &mut model.effects[1].parameters[0];
            value.value = share * value.parameter.lower;
            model.ruled_out_because("sensor_nonlinearity").is_some()
        };
        assert!(bent(1.0) && !bent(0.9));
    }
}

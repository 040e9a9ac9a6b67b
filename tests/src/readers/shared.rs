//! What the readers share: the form of one, and a stage.

use hysteron::{EffectInstance, Model, Overview, effect_named};

/// A whole input: what it is called, and its bytes.
pub type Whole = (String, Vec<u8>);

/// One reader.
pub struct Target {
    /// What it reads.
    pub name: &'static str,
    /// Inputs that it accepts.
    pub wholes: Vec<Whole>,
    /// Reads an input of this name, and uses what is accepted.
    pub read: fn(&str, &[u8]) -> bool,
}

pub(super) fn target(
    name: &'static str,
    wholes: Vec<Whole>,
    read: fn(&str, &[u8]) -> bool,
) -> Target {
    Target { name, wholes, read }
}

pub(super) fn text(name: &str, text: &str) -> Vec<Whole> {
    vec![(name.to_owned(), text.as_bytes().to_vec())]
}

pub(super) fn with_text(bytes: &[u8], read: impl FnOnce(&str) -> bool) -> bool {
    std::str::from_utf8(bytes).is_ok_and(read)
}

/// Loops and a mode.
#[must_use]
pub fn loops_and_mode(damping_ratio: f64) -> Model {
    let overview = Overview::without_data(0.0, 80.0);
    let mut model = Model::new(0.0, 80.0);
    for (id, values) in [
        ("hysteresis", &[9.0, 1.0, -2.0][..]),
        ("vibration", &[5_300.0, damping_ratio]),
    ] {
        let effect = effect_named(id).expect("an effect");
        model.add(EffectInstance::new(effect, &overview, values));
    }
    model
}

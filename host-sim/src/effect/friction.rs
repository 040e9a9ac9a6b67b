//! Friction of the guide in presliding: an elastic bristle that slips at the break-away force.
//!
//! All quantities are force-equivalent displacements (force divided by the stiffness of the actuator). The bristle carries
//! `z`, which grows by `stiffness` per micrometre of motion and is limited to `+-break_away`; the mechanism rests where the piezo
//! force balances spring and bristle. Where the model has inertia, the vibration stage takes the bristle in: it then holds the moving
//! mass, and a small motion inside the presliding range sees it as an additional spring.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;

/// Elastic-plastic friction element between the piezo force and the structure.
pub struct Friction;

/// The bristle between guide and stage.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bristle {
    break_away_um: f64,
    stiffness: f64,
    displacement: f64,
    bristle: f64,
}

impl Bristle {
    /// The bristle of `model`, if it has one.
    pub(super) fn of(model: &Model) -> Option<Self> {
        model.values("friction").map(|values| Self { break_away_um: values[0], stiffness: values[1], displacement: 0.0, bristle: 0.0 })
    }

    /// Follows a displacement and returns the force-equivalent that the bristle holds back.
    pub(super) fn follow(&mut self, displacement: f64) -> f64 {
        self.bristle = self.after(displacement - self.displacement);
        self.displacement = displacement;
        self.bristle
    }

    /// Factor by which a stuck bristle raises the natural frequency.
    pub(super) fn stiffening(&self) -> f64 {
        (1.0 + self.stiffness).sqrt()
    }

    /// What the bristle would hold after a further motion: Dahl's law, exact for a motion in one direction.
    pub(super) fn after(&self, motion: f64) -> f64 {
        if motion == 0.0 || self.break_away_um <= 0.0 {
            return self.bristle.clamp(-self.break_away_um, self.break_away_um);
        }
        let slipping = self.break_away_um.copysign(motion);
        slipping + (self.bristle - slipping) * (-self.stiffness * motion.abs() / self.break_away_um).exp()
    }

    /// Rest position for a force, without any inertia.
    pub(super) fn balance(&mut self, force: f64) -> f64 {
        let unbalanced = force - self.displacement - self.bristle;
        // x + z(x) = force: the bristle only stiffens, so Newton's steps from the stuck solution stay on one side and converge fast.
        let mut motion = unbalanced / (1.0 + self.stiffness);
        for _ in 0..6 {
            let bristle = self.after(motion);
            let slope = 1.0
                + if self.break_away_um > 0.0 { self.stiffness * (1.0 - bristle / self.break_away_um.copysign(unbalanced)) } else { 0.0 };
            motion += (force - self.displacement - motion - bristle) / slope;
        }
        self.bristle = self.after(motion);
        self.displacement += motion;
        self.displacement
    }

    /// Relaxed at a displacement.
    pub(super) fn relax(&mut self, displacement: f64) {
        self.displacement = displacement;
        self.bristle = 0.0;
    }
}

struct FrictionStage {
    bristle: Bristle,
}

impl Stage for FrictionStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.bristle.balance(input)
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.bristle.relax(input);
        input
    }
}

impl Effect for Friction {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "friction".into(),
            physics: "Dry friction in the guide holds the stage at every reversal until the force breaks it away.".into(),
            reference: "thesis Ch. 3, Eqs. 1-6 (presliding); Dupont et al., IEEE Trans. Autom. Control 47 (2002)".into(),
            place: Place::Friction,
            modifies: Some("vibration"),
            experiment: "small slow triangles around several positions: plateaus behind each reversal".into(),
            candidate: true,
            one_sided: true,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![
            Parameter::linear("break_away_um", "um", 0.0, 0.5 * overview.range_um, 1e-4 * overview.range_um.max(1e-6)),
            Parameter::logarithmic("bristle_stiffness", "1", 1e-2, 50.0),
        ]
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let mut out = Vec::new();
        for share in [0.002, 0.01] {
            for stiffness in [0.3, 1.0, 4.0, 12.0] {
                out.push(vec![share * overview.range_um, stiffness]);
            }
        }
        out
    }
    fn stage<'a>(&self, model: &Model, _values: &[f64], _setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        // With inertia in the model the bristle acts on the moving mass, not on the force in front of it.
        if model.effect("vibration").is_some() {
            return None;
        }
        Bristle::of(model).map(|bristle| Box::new(FrictionStage { bristle }) as Box<dyn Stage + 'a>)
    }
}

//! Friction of the guide in presliding: an elastic bristle that slips at the break-away force.
//!
//! All quantities are force-equivalent displacements (force divided by the stiffness of the actuator). The bristle carries
//! `z`, which grows by `stiffness` per micrometre of motion and is limited to `+-break_away`; the mechanism rests where the piezo
//! force balances spring and bristle.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;

/// Elastic-plastic friction element between the piezo force and the structure.
pub struct Friction;

struct FrictionStage {
    break_away_um: f64,
    stiffness: f64,
    displacement: f64,
    bristle: f64,
}

impl Stage for FrictionStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        // Sticking: x + z = input with z = z_0 + stiffness (x - x_0).
        let stuck = (input - self.bristle + self.stiffness * self.displacement) / (1.0 + self.stiffness);
        let bristle = self.bristle + self.stiffness * (stuck - self.displacement);
        self.bristle = bristle.clamp(-self.break_away_um, self.break_away_um);
        self.displacement = input - self.bristle;
        self.displacement
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.displacement = input;
        self.bristle = 0.0;
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
            modifies: None,
            experiment: "small slow triangles around several positions: plateaus behind each reversal".into(),
            candidate: true,
            one_sided: true,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![
            Parameter::linear("break_away_um", "um", 0.0, 0.5 * overview.range_um, 1e-4 * overview.range_um.max(1e-6)),
            Parameter::logarithmic("bristle_stiffness", "1", 1e-3, 1e4),
        ]
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let mut out = Vec::new();
        for share in [0.002, 0.01] {
            for stiffness in [0.3, 1.0, 5.0, 30.0] {
                out.push(vec![share * overview.range_um, stiffness]);
            }
        }
        out
    }
    fn stage<'a>(&self, _model: &Model, values: &[f64], _setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(FrictionStage { break_away_um: values[0], stiffness: values[1], displacement: 0.0, bristle: 0.0 }))
    }
}

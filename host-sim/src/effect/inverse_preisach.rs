//! Preisach hysteresis identified inversely: surfaces that give the drive from the displacement, so that the
//! inverse costs no search.
//!
//! The surfaces are those of [`crate::hysteresis_surface`], in V over the share of a span of displacement;
//! the displacement to a drive, which a model has to give, is found by [`crate::hysteresis_inverse`].

use crate::block::Block;
use crate::hysteresis_inverse::HysteresisInverse;
use crate::hysteresis_surface::{OneSidedHysteresis, Surfaces, loop_terms};
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "inverse_preisach";

/// Degree of the loop surface.
const DEGREE: usize = 4;
/// Terms of the first rise.
const CURVE: usize = 2;
/// Span of displacement over which the surfaces count, in units of what is read.
const SPAN: f64 = 1.25;

/// Displacement as the input of a Preisach model, the drive as its output.
pub struct InversePreisach;

#[derive(Clone)]
struct InverseStage {
    inverse: HysteresisInverse,
    lower_limit_v: f64,
}

impl InverseStage {
    fn new(model: &Model, values: &[f64]) -> Self {
        let (span_um, terms) = values
            .split_first()
            .map_or((1.0, &[][..]), |(span, terms)| (*span, terms));
        let (loops, curve) =
            terms.split_at(crate::hysteresis_surface::coefficient_count(DEGREE).min(terms.len()));
        let operator =
            OneSidedHysteresis::virgin(Surfaces::from_legendre(DEGREE, loops, curve), 0.0, span_um);
        Self {
            inverse: HysteresisInverse::new(operator, 0.0, span_um),
            lower_limit_v: model.drive_min_v,
        }
    }
}

impl Stage for InverseStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        // What the inverse calls the drive is the displacement here.
        self.inverse.step(input - self.lower_limit_v).drive_v
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let surfaces = self.inverse.model().surfaces();
        Ok(vec![Block::LoopsSolved {
            g: surfaces.g.clone(),
            r: surfaces.r.clone(),
            lower: self.lower_limit_v,
            span: self.inverse.range_v(),
        }])
    }
}

impl Loops for InverseStage {}

impl Effect for InversePreisach {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The drive depends on the extrema of the displacement so far: the loops read the other way round.".into(),
            reference: "thesis Ch. 2, 3.1.4; Croft, Shed and Devasia, J. Dyn. Syst. Meas. Control 123 (2001) 35-43".into(),
            experiment: "slow triangles of several heights with nested reversals".into(),
            tried_for_loops: LoopsTried::Never,
            equations: r"The model of `hysteresis` and `initial_curve` with the roles turned round: the drive above `drive_min_v`, V, is the output of the surfaces `g_i_j_v`, `r_i_v` for the input `Y = y / span_um`.

`y` is what takes that output to the drive, found with the memory of the displacements so far; beyond `0 <= y <= span_um` it stays at that end.",
            // 371 ns, and 4 ns of `hysteresis` (`benchmarks/results/speed.csv`).
            lasts_steps: Some(85),
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.drive_range_v().max(1e-6);
        let volts = |name: String| Parameter::linear(name, "V", -1e6, 1e6, step);
        let span = Parameter::linear("span_um", "um", 1e-9, 1e9, 1.0).fixed();
        let loops = loop_terms(DEGREE).map(|(i, j)| volts(format!("g_{i}_{j}_v")));
        std::iter::once(span)
            .chain(loops)
            .chain((0..CURVE).map(|k| volts(format!("r_{k}_v"))))
            .collect()
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        // A straight line with the loops of a piezo turned round: the drive lags behind the displacement the
        // other way.
        let span_um = SPAN * overview.range_um.max(1e-6);
        let scale = span_um / overview.gain_um_v.abs().max(1e-12);
        let mut terms = vec![0.0; crate::hysteresis_surface::coefficient_count(DEGREE) + CURVE];
        (terms[0], terms[1], terms[2]) = (scale, -0.1 * scale, 0.1 * scale);
        vec![std::iter::once(span_um).chain(terms).collect()]
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(InverseStage::new(from.model, from.values)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::effect::model_of;
    use crate::loop_inverse::LoopInverse;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// Oracle: the surfaces themselves, stepped along the displacement, are the inverse.
        #[test]
        fn its_inverse_is_its_own_operator(desired in proptest::collection::vec(0.5f64..9.0, 1..20)) {
            let overview = Overview { range_um: 10.0, gain_um_v: 0.125, ..Overview::without_data(0.0, 80.0) };
            let values = InversePreisach.starts(&overview).remove(0);
            let model = model_of(&overview, &[(ID, &values)]);
            let mut inverse = LoopInverse::from_model(&model, 1e-3).unwrap();
            let mut operator = OneSidedHysteresis::virgin(Surfaces::from_legendre(DEGREE, &values[1..11], &values[11..]), 0.0, values[0]);
            for y in desired {
                let (answer, drive_v) = (inverse.step(y), operator.step(y));
                if answer.saturated || !(0.0..80.0).contains(&drive_v) {
                    break;
                }
                prop_assert!((answer.drive_v - drive_v).abs() < 1e-6 * 80.0, "{} {drive_v}", answer.drive_v);
            }
        }
    }
}

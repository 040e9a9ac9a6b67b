//! Backlash: a gap in the train between actuator and stage, which has to be crossed at every reversal before
//! the stage moves.
//!
//! The stage takes the force-equivalent displacement as a play operator does: pulled at one side of the gap,
//! pushed at the other, and at rest between. Of a stage that follows at once dry friction with a stiff
//! bristle does the same; in front of a mode the gap comes first, and nothing holds the mass.

use crate::block::Block;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "backlash";

/// A gap in front of the structure.
pub struct Backlash;

struct BacklashStage {
    half_gap_um: f64,
    taken_along_um: f64,
}

impl Stage for BacklashStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.taken_along_um = self
            .taken_along_um
            .max(input - self.half_gap_um)
            .min(input + self.half_gap_um);
        self.taken_along_um
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Gap {
            half: self.half_gap_um,
        }])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.taken_along_um = input;
        input
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        // But for the gap, of which a drive spends little time in the middle, the stage goes along.
        Some(Box::new(PassedOn))
    }
}

impl Effect for Backlash {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "A gap between actuator and stage has to be crossed at every reversal before the stage moves.".into(),
            reference: "Tao and Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities (1996), Ch. 2".into(),
            experiment: "small slow triangles around several positions: nothing moves behind each reversal, over one and the same way"
            .into(),
            one_sided: true,
            picture: Picture {
                against: Against::TimeSinceTurn,
                caption: "A gap holds the stage still just after the drive turns, over the same way each time.",
            },
            planted: Planted::Never,
            equations: r"`y[k] = min(max(y[k-1], x[k] - gap_um / 2), x[k] + gap_um / 2)`. At rest `y = x`.",
            ..Declaration::at(Place::Friction)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![Parameter::linear(
            "gap_um",
            "um",
            0.0,
            0.5 * overview.range_um,
            1e-4 * overview.range_um.max(1e-6),
        )]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        [0.002, 0.01, 0.04]
            .iter()
            .map(|share| vec![share * overview.range_um])
            .collect()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(BacklashStage {
            half_gap_um: 0.5 * from.values[0].max(0.0),
            taken_along_um: 0.0,
        }))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.06 * case.strength])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_behind_a_gap_moves_once_it_is_crossed() {
        let mut stage = BacklashStage {
            half_gap_um: 0.5,
            taken_along_um: 0.0,
        };
        let behind: Vec<f64> = [0.4, 2.0, 1.5, 1.0, 0.0, 0.6, 1.2]
            .into_iter()
            .map(|input| stage.step(0, input))
            .collect();
        assert_eq!(behind, [0.0, 1.5, 1.5, 1.5, 0.5, 0.5, 0.7]);
        assert_eq!(
            (stage.settle(3.0), stage.step(0, 3.4), stage.step(0, 3.6)),
            (3.0, 3.0, 3.1)
        );
    }
}

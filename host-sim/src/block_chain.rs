//! The blocks of a whole model at one sampling period, in the order of its chain.

use crate::block::Block;
use crate::chain::{Drive, InitialState, Model};
use crate::intersample::Intersample;

/// Why a model has no blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoBlocks {
    /// The effect in whose stage the reason lies.
    pub effect: String,
    /// The reason, behind "because".
    pub why: &'static str,
}

/// A block in its place.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The effect whose stage it is part of.
    pub effect: String,
    /// It goes in sub-intervals.
    pub fine: bool,
    /// What it computes.
    pub block: Block,
}

/// A model at one sampling period.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockChain {
    /// Sampling period, s.
    pub dt_s: f64,
    /// What the drive does between samples.
    pub intersample: Intersample,
    /// Sub-intervals in a period.
    pub substeps: usize,
    /// The drive at which a virgin actuator rests, V.
    pub virgin_v: f64,
    /// Lower limit of the drive, V.
    pub drive_min_v: f64,
    /// Upper limit of the drive, V.
    pub drive_max_v: f64,
    /// The blocks in the order of the chain.
    pub blocks: Vec<Placed>,
}

impl BlockChain {
    /// The blocks of a model at a sampling period, in front of the sensor's rounding, for a drive that does
    /// this between its samples.
    ///
    /// # Errors
    /// The first effect that has none, and why.
    pub fn of(model: &Model, dt_s: f64, intersample: Intersample) -> Result<Self, NoBlocks> {
        let model = &*model.before_rounding();
        let mut blocks = Vec::new();
        let drive = Drive {
            intersample,
            ..Drive::held(&[], dt_s, InitialState::Virgin)
        };
        let substeps = model.substeps_for(&drive);
        for (effect, fine) in model.order_with_fineness(&drive) {
            let instance = &model.effects[effect];
            let setting = model.setting(&drive, if fine { substeps } else { 1 });
            let Some(stage) = instance.stage(model, &setting) else {
                continue;
            };
            let of_stage = stage.blocks().map_err(|why| NoBlocks {
                effect: instance.id.clone(),
                why,
            })?;
            let acts = |block: &Block| !matches!(block, Block::Linear(l) if l.rest.is_empty() && l.before == 0.0 && l.through == 1.0);
            blocks.extend(of_stage.into_iter().filter(acts).map(|block| Placed {
                effect: instance.id.clone(),
                fine,
                block,
            }));
        }
        Ok(Self {
            dt_s,
            intersample,
            substeps,
            virgin_v: model.virgin_drive_v(),
            drive_min_v: model.drive_min_v,
            drive_max_v: model.drive_max_v,
            blocks,
        })
    }

    /// Whether it takes a measured force.
    #[must_use]
    pub fn takes_force(&self) -> bool {
        self.blocks.iter().any(|placed| match &placed.block {
            Block::Force { .. } => true,
            Block::Written(written) => {
                let part = |c: char| !(c.is_ascii_alphanumeric() || c == '_');
                [&written.output, &written.derivatives]
                    .iter()
                    .any(|lines| lines.split(part).any(|word| word == "force"))
            }
            _ => false,
        })
    }
}

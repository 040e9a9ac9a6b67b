//! Duhem hysteresis: the slope of the displacement depends on the direction of the drive.

use crate::block::Block;
use crate::physics::*;

/// Coleman-Hodgdon form of the Duhem model.
pub struct Duhem;

#[derive(Clone)]
struct DuhemStage {
    approach: f64,
    slope_um: f64,
    elastic_um: f64,
    output: f64,
    last: f64,
    range: DriveRange,
}

impl DuhemStage {
    fn new(model: &Model, values: &[f64]) -> Self {
        Self {
            approach: values[0],
            slope_um: values[1],
            elastic_um: values[2],
            output: 0.0,
            last: 0.0,
            range: model.drive_range(),
        }
    }
}

impl Stage for DuhemStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let x = self.range.share(input);
        let change = x - self.last;
        // w' = approach |x'| (slope x - w) + elastic x': linear in w along a monotone piece, with a straight
        // x.
        let e = (-self.approach * change.abs()).exp();
        let sign = change.signum();
        if change != 0.0 && self.approach > 1e-9 {
            let forcing = (self.elastic_um - self.slope_um) * sign / self.approach;
            self.output = self.slope_um * x
                + forcing
                + (self.output - self.slope_um * self.last - forcing) * e;
        } else {
            self.output += self.elastic_um * change;
        }
        self.last = x;
        self.output
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Duhem {
            approach: self.approach,
            slope: self.slope_um,
            elastic: self.elastic_um,
            lower: self.range.lower_v,
            span: self.range.span_v,
        }])
    }
}

impl Loops for DuhemStage {}

impl Effect for Duhem {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "duhem".into(),
            physics: "Rising and falling drive approach one line from two sides.".into(),
            reference: "Coleman and Hodgdon, Int. J. Eng. Sci. 24 (1986) 897-919".into(),
            experiment: "slow sines of several amplitudes".into(),
            equations: r"With `X = (x - drive_min_v) / (drive_max_v - drive_min_v)`: `y' = approach |X'| (slope_um X - y) + elastic_um X'`.

Over a straight `X`, with `D = X[k] - X[k-1]` and `f = (elastic_um - slope_um) sign(D) / approach`: `y[k] = slope_um X[k] + f + (y[k-1] - slope_um X[k-1] - f) exp(-approach |D|)`; where `approach` is below 1e-9
`y[k] = y[k-1] + elastic_um D`. At rest one step from `X = 0`, `y = 0`.",
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        vec![
            Parameter::linear("approach", "1", 0.0, 200.0, 0.02),
            Parameter::linear("slope_um", "um", -1e6, 1e6, step),
            Parameter::linear("elastic_um", "um", -1e6, 1e6, step),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let scale = overview.gain_um_v * overview.drive_range_v();
        vec![vec![3.0, scale, 0.7 * scale]]
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(DuhemStage::new(from.model, from.values)))
    }
}

//! Bouc-Wen hysteresis: one state that follows the drive and saturates.

use crate::block::Block;
use crate::physics::*;

/// Linear displacement less a Bouc-Wen state.
pub struct BoucWen;

#[derive(Clone)]
struct BoucWenStage {
    gain_um: f64,
    alpha_um: f64,
    beta: f64,
    gamma: f64,
    state: f64,
    last: f64,
    range: DriveRange,
}

impl BoucWenStage {
    fn new(model: &Model, values: &[f64]) -> Self {
        Self {
            gain_um: values[0],
            alpha_um: values[1],
            beta: values[2],
            gamma: values[3],
            state: 0.0,
            last: 0.0,
            range: model.drive_range(),
        }
    }
}

impl Stage for BoucWenStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let x = self.range.share(input);
        let change = x - self.last;
        // With |h| of one sign the equation is linear in h; stepping it in small pieces keeps the sign
        // changes right.
        let pieces = ((change.abs() * 200.0).ceil() as usize).clamp(1, 400);
        let piece = change / pieces as f64;
        for _ in 0..pieces {
            let rate = self.beta * piece.abs() + self.gamma * piece * self.state.signum();
            let middle = self.state + 0.5 * (self.alpha_um * piece - rate * self.state);
            let rate = self.beta * piece.abs() + self.gamma * piece * middle.signum();
            self.state += self.alpha_um * piece - rate * middle;
        }
        self.last = x;
        self.gain_um * x - self.state
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::BoucWen {
            gain: self.gain_um,
            alpha: self.alpha_um,
            beta: self.beta,
            gamma: self.gamma,
            lower: self.range.lower_v,
            span: self.range.span_v,
        }])
    }
}

impl Loops for BoucWenStage {}

impl Effect for BoucWen {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "bouc_wen".into(),
            physics: "One hysteretic state follows the drive and saturates: a smooth loop from four numbers.".into(),
            reference: "thesis Ch. 2, 3.1.5; Low and Guo, J. Microelectromech. Syst. 4 (1995) 230-237".into(),
            experiment: "slow sines of several amplitudes".into(),
            equations: r"With `X = (x - drive_min_v) / (drive_max_v - drive_min_v)`: `y = gain_um X - h`, `h' = alpha_um X' - beta |X'| h - gamma X' |h|`.

The step `X[k] - X[k-1]` is divided into `N = min(max(ceil(200 |X[k] - X[k-1]|), 1), 400)` pieces `p`, each by the rule of the middle: with `f(h) = beta |p| + gamma p sign(h)`,
`m = h + (alpha_um p - f(h) h) / 2`, then `h = h + alpha_um p - f(m) m`. At rest one step from `X = 0`, `h = 0`.",
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        vec![
            Parameter::linear("gain_um", "um", -1e6, 1e6, step),
            Parameter::linear("alpha_um", "um", -1e6, 1e6, step),
            Parameter::linear("beta", "1", 0.0, 100.0, 0.02),
            Parameter::linear("gamma", "1", -100.0, 100.0, 0.02),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let scale = overview.gain_um_v * overview.drive_range_v();
        vec![vec![1.1 * scale, 0.4 * scale, 2.0, 0.5]]
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(BoucWenStage::new(from.model, from.values)))
    }
}

//! Transport delay of the drive.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;
use std::collections::VecDeque;

/// The drive acts later than it was commanded.
pub struct Delay;

struct DelayStage {
    line: VecDeque<f64>,
    late_share: f64,
}

impl Stage for DelayStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.line.push_back(input);
        let late = self.line.pop_front().unwrap_or(input);
        let early = self.line.front().copied().unwrap_or(input);
        // The mean over the interval of the held drive that changes inside it.
        self.late_share * late + (1.0 - self.late_share) * early
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.line.iter_mut().for_each(|v| *v = input);
        input
    }
}

impl Effect for Delay {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "delay".into(),
            physics: "Converters and computation take time: the drive acts a fixed time after it was written.".into(),
            reference: "Franklin, Powell, Workman, Digital Control of Dynamic Systems (1998)".into(),
            place: Place::Delay,
            modifies: None,
            experiment: "a multisine: phase that falls in proportion to frequency at flat gain".into(),
            candidate: true,
            one_sided: true,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let dt_s = 1.0 / overview.sample_rate_max_hz;
        vec![Parameter::linear("delay_s", "s", 0.0, 200.0 * dt_s, 0.05 * dt_s)]
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let dt_s = 1.0 / overview.sample_rate_max_hz;
        vec![vec![0.5 * dt_s], vec![2.0 * dt_s], vec![5.0 * dt_s]]
    }
    fn stage<'a>(&self, model: &Model, values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        let intervals = (values[0] / setting.dt_s).max(0.0);
        let whole = intervals.floor();
        let line = std::iter::repeat_n(model.drive_min_v, whole as usize + 1).collect();
        Some(Box::new(DelayStage { line, late_share: intervals - whole }))
    }
    fn substeps(&self, dt_s: f64) -> usize {
        // The mean over a fast period is as good as the delay itself; in a slow one the motion is over before the period is.
        if dt_s > 60e-6 { super::substeps_inside_period(dt_s).max(2) } else { 1 }
    }
}

//! Rate-independent hysteresis with memory: the classical Preisach model and, with the initial ascending
//! curve, the one-sided model.
//!
//! The stage holds the surfaces of [`crate::hysteresis_surface`]. `initial_curve`, `rate_dependence`,
//! `rate_dependent_surfaces`, `bipolar` and `two_sided` are properties of this stage: it reads their values
//! from the model.

use super::play_operators::PlayOperators;
use super::rate_dependent_surfaces::RateOrders;
use super::two_sided::TwoSidedMemory;
use super::{bipolar, rate_dependence};
use crate::block::Block;
use crate::hysteresis_coefficients::CoefficientWalk;
pub use crate::hysteresis_surface::degree_of;
use crate::hysteresis_surface::{OneSidedHysteresis, Surfaces, coefficient_count, loop_terms};
use crate::physics::*;
use std::sync::Arc;

/// Identifier in files and on the command line.
pub const ID: &str = id::HYSTERESIS;

/// Classical Preisach hysteresis in polynomial surfaces.
pub struct Hysteresis {
    /// Degree of the loop surface `G`.
    pub degree: usize,
}

impl Default for Hysteresis {
    /// Degree 4, as in the thesis (Ch. 4, Eq. 15).
    fn default() -> Self {
        Self { degree: 4 }
    }
}

#[derive(Clone)]
struct HysteresisStage {
    operator: OneSidedHysteresis,
    plays: Option<PlayOperators>,
    rate_orders: Option<RateOrders>,
    two_sided: Option<TwoSidedMemory>,
    /// What operator and plays give where the memory begins, um.
    zero_um: f64,
    drive: HeldDrive,
    output_um: f64,
}

/// The drive as the hysteresis sees it: where it stands, and how fast it got there.
#[derive(Clone)]
struct HeldDrive {
    lower_limit_v: f64,
    range_v: f64,
    rate: Option<rate_dependence::RateLaw>,
    /// Something beside that law asks for the rate.
    by_rate: bool,
    last_drive_v: f64,
    dt_s: f64,
    /// Intervals in a sampling period, and how many have passed since the drive changed.
    substeps: usize,
    unchanged: usize,
}

impl HeldDrive {
    fn from_model(model: &Model, setting: &Setting) -> Self {
        let lower_limit_v = bipolar::lower_limit_v(model);
        Self {
            lower_limit_v,
            range_v: model.drive_max_v - lower_limit_v,
            rate: rate_dependence::RateLaw::from_model(model),
            by_rate: model.effect(id::RATE_DEPENDENT_SURFACES).is_some(),
            last_drive_v: lower_limit_v,
            dt_s: setting.dt_s,
            substeps: setting.substeps,
            unchanged: setting.substeps,
        }
    }

    fn asks_rate(&self) -> bool {
        self.rate.is_some() || self.by_rate
    }

    /// In units of the drive range above its lower limit.
    fn normalised(&self, drive_v: f64) -> f64 {
        (drive_v - self.lower_limit_v) / self.range_v
    }

    /// The drive at an input in those units, V.
    fn at(&self, x: f64) -> f64 {
        self.lower_limit_v + self.range_v * x
    }

    /// Takes the drive of the next interval and returns its rate in V/s, or `None` if the output stays what
    /// it was.
    fn next(&mut self, drive_v: f64) -> Option<f64> {
        if drive_v == self.last_drive_v {
            self.unchanged += 1;
            // A held drive has the rate of its sample until the next one.
            if !self.asks_rate() || self.unchanged < self.substeps {
                return None;
            }
        }
        // Over a held sample the rate is that of successive samples; a drive that moves inside a period has
        // its own.
        let intervals = if self.unchanged + 1 >= self.substeps {
            self.substeps
        } else {
            1
        };
        if drive_v != self.last_drive_v {
            self.unchanged = 0;
        }
        let rate_v_s = (drive_v - self.last_drive_v).abs() / (self.dt_s * intervals as f64);
        self.last_drive_v = drive_v;
        Some(rate_v_s)
    }

    fn settle(&mut self, drive_v: f64) {
        self.last_drive_v = drive_v;
        self.unchanged = self.substeps;
    }
}

impl Stage for HysteresisStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        if let Some(rate_v_s) = self.drive.next(input) {
            self.output_um = self.rate_independent(input);
            if let Some(law) = self.drive.rate {
                self.output_um = law.apply(self.output_um, self.curve_at_maximum_um(), rate_v_s);
            }
            if let Some(orders) = &mut self.rate_orders {
                self.output_um += orders.step(self.drive.normalised(input), rate_v_s);
            }
        }
        self.output_um
    }
    fn run(&mut self, from: usize, signal: &mut [f64]) {
        // A rate is one of every step.
        let plain = !self.drive.asks_rate() && self.two_sided.is_none();
        let Some(last_v) = signal.last().copied().filter(|_| plain) else {
            signal
                .iter_mut()
                .enumerate()
                .for_each(|(k, value)| *value = self.step(from + k, *value));
            return;
        };
        signal
            .iter_mut()
            .for_each(|value| *value = self.drive.normalised(*value));
        let inputs = self.plays.is_some().then(|| signal.to_vec());
        self.operator.run(signal);
        if let (Some(plays), Some(inputs)) = (&mut self.plays, inputs) {
            plays.add_to(signal, &inputs);
        }
        self.drive.settle(last_v);
        self.output_um = signal[signal.len() - 1];
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let surfaces = self.operator.surfaces();
        let drive = &self.drive;
        Ok(vec![Block::Loops {
            g: surfaces.g.clone(),
            r: surfaces.r.clone(),
            plays: self
                .plays
                .as_ref()
                .map_or_else(Vec::new, PlayOperators::plays),
            rate: drive.asks_rate().then(|| {
                let rate = drive.rate.unwrap_or_default();
                let orders = self.rate_orders.as_ref();
                rate.as_block(drive.dt_s, drive.substeps, orders)
            }),
            first_ways: self
                .two_sided
                .as_ref()
                .map(|memory| memory.as_block(self.zero_um)),
            lower: drive.lower_limit_v,
            span: drive.range_v,
        }])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.drive.settle(input);
        self.output_um = self.rate_independent(input);
        if let Some(orders) = &mut self.rate_orders {
            orders.step(self.drive.normalised(input), 0.0);
        }
        self.output_um
    }
}

impl Loops for HysteresisStage {
    fn bends_v(&self, rising: bool) -> Vec<f64> {
        let stack = self.operator.stack();
        let remembered = stack
            .pairs()
            .iter()
            .map(|pair| if rising { pair.maximum } else { pair.minimum });
        let open = stack.open_maximum().filter(|_| rising);
        let bends = remembered
            .chain(open)
            .chain(self.plays.iter().flat_map(|plays| plays.bends(rising)));
        bends
            .chain(self.two_sided.iter().map(|memory| memory.extremum(rising)))
            .map(|x| self.drive.at(x))
            .collect()
    }
}

impl HysteresisStage {
    fn new(model: &Model, values: &[f64], setting: &Setting) -> Self {
        let remnant = model.values(id::INITIAL_CURVE).unwrap_or_default();
        let surfaces = Surfaces::from_legendre(degree_of(values.len()), values, &remnant);
        let drive = HeldDrive::from_model(model, setting);
        let mut stage = Self {
            two_sided: TwoSidedMemory::from_model(model, &surfaces),
            operator: OneSidedHysteresis::virgin(surfaces, drive.lower_limit_v, drive.range_v),
            plays: PlayOperators::from_model(model),
            rate_orders: RateOrders::from_model(model),
            drive,
            zero_um: 0.0,
            output_um: 0.0,
        };
        if stage.two_sided.is_some() {
            let zero_v = model.virgin_drive_v();
            stage.zero_um = stage.rate_independent(zero_v);
            if let Some(orders) = &mut stage.rate_orders {
                orders.step(stage.drive.normalised(zero_v), 0.0);
            }
        }
        stage
    }

    fn rate_independent(&mut self, drive_v: f64) -> f64 {
        let x = self.drive.normalised(drive_v);
        let loops_um =
            self.operator.step(drive_v) + self.plays.as_mut().map_or(0.0, |plays| plays.step(x));
        match &mut self.two_sided {
            Some(memory) => loops_um - self.zero_um + memory.step(x),
            None => loops_um,
        }
    }

    /// Where the initial ascending curve was left, or is.
    fn curve_at_maximum_um(&self) -> f64 {
        let maximum = self.operator.stack().global_maximum();
        self.operator.initial_curve_at_maximum()
            + self
                .plays
                .as_ref()
                .map_or(0.0, |plays| plays.initial_ascending_curve(maximum))
    }
}

/// Surfaces and play operators, with the contribution of every coefficient apart.
struct Contributions {
    walk: CoefficientWalk,
    plays: Option<PlayOperators>,
}

impl Contributions {
    /// At the next input, in the place of those at the last: of the loop surface, the initial curve and the
    /// play operators, in this order.
    fn step(&mut self, x: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend_from_slice(self.walk.step(x));
        if let Some(plays) = &mut self.plays {
            plays.step(x);
            out.extend(plays.positions());
        }
    }

    /// Contributions to the initial ascending curve where it was left, or is.
    fn curve_at_maximum(&self) -> Vec<f64> {
        let mut out = self.walk.initial_curve_at_maximum();
        if let Some(plays) = &self.plays {
            out.extend(plays.initial_ascending_curves(self.walk.global_maximum()));
        }
        out
    }
}

impl Effect for Hysteresis {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Domain switching makes the displacement depend on the extrema of the drive so far: loops that close and nest.".into(),
            reference: "thesis Ch. 4, Eqs. 12-15 with F(M) = G(M, 0); Mayergoyz, Mathematical Models of Hysteresis (1991)".into(),
            experiment: "slow triangles of several heights with nested reversals".into(),
            fitting_rank: 1,
            starts_combine: true,
            beside: Some(id::GAIN),
            opening: Opening::OfItself,
            picture: Picture {
                against: Against::Drive,
                caption: "An error that depends on the branch: first rise, later rises and falls go different ways at the same voltage.",
            },
            comes_with: &[id::INITIAL_CURVE],
            equations: r"With `X = (x - low) / (drive_max_v - low)`, where `low = drive_min_v`, or `lower_limit_v` of `bipolar`:

- loop surface `G(X, Z) = (X - Z) sum g_i_j_um P_i(X) P_j(Z)` over all `i + j < degree`; `n` coefficients make the least degree with `degree (degree + 1) / 2 >= n`;
- `P_k` is the Legendre polynomial shifted to 0..1: `P_0 = 1`, `P_1 = 2 X - 1`, `(n + 1) P_{n+1} = (2 n + 1) (2 X - 1) P_n - n P_{n-1}`;
- initial curve `F(X) = G(X, 0) + R(X)`, where `R` is that of `initial_curve`, or zero.

**Memory.** Pairs of extrema `(M_1, m_1), (M_2, m_2), ..` with `M_1 > M_2 > ..` and `m_1 < m_2 < ..`, an open maximum `M` while the input falls, and the last input, which is 0 at first.
A new input `X`

1. above the last one: if there is an open maximum, it and the last input become the newest pair (the 129th is dropped), and no maximum is open. Then the newest pair is removed for as
   long as `X >= M` of it;
2. below the last one: if no maximum is open, the last input becomes it. Then, for as long as `X <= m` of the newest pair, the open maximum becomes `M` of that pair and the pair is removed;
3. equal to it: nothing changes.

**Output.** Without a pair and an open maximum `y = F(X)`. Otherwise `y = F(M_1) - sum_k [G(M_k, m_k) - G(N_k, m_k)]`, where `N_k` is the maximum behind `m_k`: `M_{k+1}`, then the open maximum, or
`X` while the input rises on the last pair; less `G(M, X)` where a maximum `M` is open. Without a pair `M_1` is the open maximum.

At rest the memory is that of one rise from 0 to `X`. The output is a force-equivalent displacement, um. `play_operators` add to it, then `rate_dependence` acts.",
            ..Declaration::at(Place::Hysteresis)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        loop_terms(self.degree)
            .map(|(i, j)| Parameter::linear(format!("g_{i}_{j}_um"), "um", -1e6, 1e6, step))
            .collect()
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        // A loop of 15 % of the range, as piezo stacks have: on the way down from x less is lost at first
        // than near zero.
        let mut values = vec![0.0; coefficient_count(self.degree)];
        let scale = overview.gain_um_v * overview.drive_range_v();
        values[0] = scale;
        if self.degree > 1 {
            values[1] = 0.12 * scale;
            values[2] = -0.12 * scale;
        }
        // Around that loop every coefficient is a direction.
        let moved = |k: usize| {
            values
                .iter()
                .enumerate()
                .map(|(i, v)| if i == k { v + 0.05 * scale } else { *v })
                .collect()
        };
        std::iter::once(values.clone())
            .chain((0..values.len()).map(moved))
            .collect()
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(HysteresisStage::new(
            from.model,
            from.values,
            from.setting,
        )))
    }

    fn by_coefficient(&self, from: &Build) -> Option<Box<dyn ByCoefficient>> {
        Some(Box::new(CoefficientWalker::from_model(
            from.model,
            from.setting,
        )?))
    }

    fn with_parameters(&self, count: usize) -> Option<Arc<dyn Effect>> {
        let degree = degree_of(count);
        (coefficient_count(degree) == count).then(|| Arc::new(Self { degree }) as Arc<dyn Effect>)
    }
}

/// Surfaces and play operators walking along the drive, every coefficient apart.
struct CoefficientWalker {
    /// Of each effect how many coefficients it has, and how far they stand from one another among its
    /// parameters.
    counts: [(&'static str, usize, usize); 3],
    contributions: Contributions,
    drive: HeldDrive,
    present: Vec<f64>,
}

impl CoefficientWalker {
    /// Of the hysteresis in `model`; `None` without one, or where the surfaces act through the virgin part of
    /// two-sided hysteresis as well.
    fn from_model(model: &Model, setting: &Setting) -> Option<Self> {
        if model.effect(id::TWO_SIDED).is_some() {
            return None;
        }
        let count = |id: &str| model.effect(id).map_or(0, |e| e.parameters.len());
        let loops = model.effect(ID)?.parameters.len();
        let curve = count(id::INITIAL_CURVE);
        // Of each play operator its weight, the first of its two values.
        let plays = count(id::PLAY_OPERATORS) / 2;
        Some(Self {
            counts: [
                (ID, loops, 1),
                (id::INITIAL_CURVE, curve, 1),
                (id::PLAY_OPERATORS, plays, 2),
            ],
            contributions: Contributions {
                walk: CoefficientWalk::virgin(degree_of(loops), curve),
                plays: PlayOperators::from_model(model),
            },
            drive: HeldDrive::from_model(model, setting),
            present: Vec::new(),
        })
    }

    fn next(&mut self, drive_v: f64) {
        let Some(rate_v_s) = self.drive.next(drive_v) else {
            return;
        };
        self.contributions
            .step(self.drive.normalised(drive_v), &mut self.present);
        if let Some(law) = self.drive.rate {
            // The law is linear in what it is applied to.
            let curve = self.contributions.curve_at_maximum();
            self.present
                .iter_mut()
                .zip(curve)
                .for_each(|(value, curve)| *value = law.apply(*value, curve, rate_v_s));
        }
    }
}

impl ByCoefficient for CoefficientWalker {
    fn coefficients(&self) -> Vec<(&'static str, usize)> {
        self.counts
            .iter()
            .flat_map(|(id, count, apart)| (0..*count).map(|i| (*id, i * *apart)))
            .collect()
    }

    fn settle(&mut self, input: f64, row: &mut [f64]) {
        self.drive.settle(input);
        self.contributions
            .step(self.drive.normalised(input), &mut self.present);
        row.copy_from_slice(&self.present);
    }

    fn run(&mut self, inputs: &[f64], block: &mut [f64]) {
        let lanes = self.present.len().max(1);
        for (drive_v, row) in inputs.iter().zip(block.chunks_exact_mut(lanes)) {
            self.next(*drive_v);
            row.copy_from_slice(&self.present);
        }
    }
}

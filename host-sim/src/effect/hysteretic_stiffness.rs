//! A spring part of which slips inside: the restoring force of Bouc and Wen.
//!
//! Of the stiffness a share `s` is hysteretic: `x` from where the stage stands without voltage, the force is
//! `(1 - s) x + s h`, with `h' = x' - beta |x'| |h|^(n-1) h - gamma x' |h|^n`. While the mass moves one way,
//! `h` depends on the way alone; with `n = 1`, where it stands unless a model file says otherwise, it is an
//! exponential of it.

use super::force_balance::RestingPlace;
use crate::balance_law::ForceLines;
use crate::law::deeper;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "hysteretic_stiffness";

/// Share of the spring with a memory.
pub struct HystereticStiffness;

/// The force beside that of the straight spring; its memory is `h`.
#[derive(Clone, Copy, Debug)]
struct BoucWenSpring {
    share: f64,
    beta: f64,
    gamma: f64,
    exponent: f64,
    neutral_um: f64,
}

/// A hardening element is followed up to this power of e over one way: no recording has a loop that grows so.
const GROWS_MOST: f64 = 50.0;
/// Ways are followed in parts over which the element changes by no more than this share of where it tends,
/// where it is no exponential.
const PART: f64 = 0.05;
const PARTS_MAX: f64 = 400.0;

impl BoucWenSpring {
    /// The element after a way.
    fn after(&self, h: f64, way_um: f64) -> f64 {
        if way_um == 0.0 {
            return h;
        }
        let side = 1.0_f64.copysign(way_um);
        let (mut h, mut left_um) = (h * side, way_um.abs());
        if self.exponent == 1.0 {
            if h < 0.0 {
                // Unloading, up to where nothing is held; an element that recovers nothing on the way stays
                // below.
                let rate = self.beta - self.gamma;
                let ahead = tends(h, rate, left_um);
                if ahead <= 0.0 {
                    return side * ahead;
                }
                let to_zero_um = if rate.abs() * -h < 1e-9 {
                    -h
                } else {
                    (-rate * h).ln_1p() / rate
                };
                (h, left_um) = (0.0, (left_um - to_zero_um).max(0.0));
            }
            return side * tends(h, self.beta + self.gamma, left_um);
        }
        let rate =
            |h: f64| 1.0 - (self.beta * h.signum() + self.gamma) * h.abs().powf(self.exponent);
        let steepness = (self.beta.abs() + self.gamma.abs()).powf(1.0 / self.exponent);
        let parts = (left_um * steepness / PART).ceil().clamp(1.0, PARTS_MAX);
        let part_um = left_um / parts;
        for _ in 0..parts as usize {
            let middle = h + 0.5 * part_um * rate(h);
            h += part_um * rate(middle);
        }
        side * h
    }
}

/// Where `dh = (1 - rate h) dx` comes from `h` over a way.
#[inline]
fn tends(h: f64, rate: f64, way_um: f64) -> f64 {
    let angle = (rate * way_um).max(-GROWS_MOST);
    h + way_um * (1.0 - rate * h) * mean_decay(angle)
}

/// [`tends`] from `h` over `longer`, as [`crate::law`] writes.
fn tends_in_lines(rate: f64) -> String {
    format!(
        "angle = max({rate:e} * longer, -{GROWS_MOST:e})\nmean = 1 - 0.5 * angle\nif abs(angle) > 1e-8\n  mean = -expm1(-angle) / angle\n\
         tends = h + longer * (1 - {rate:e} * h) * mean\n"
    )
}

/// Angle below which eight terms of the series are exact to 3e-14.
const SHORT: f64 = 0.1;

/// `(1 - exp(-a)) / a`. Most ways are short, and their series has no long chain of products.
#[inline]
fn mean_decay(a: f64) -> f64 {
    if a.abs() > SHORT {
        return -(-a).exp_m1() / a;
    }
    let square = a * a;
    let low = (1.0 - a * 0.5) + square * (1.0 / 6.0 - a * (1.0 / 24.0));
    let high = (1.0 / 120.0 - a * (1.0 / 720.0)) + square * (1.0 / 5040.0 - a * (1.0 / 40320.0));
    low + square * square * high
}

impl RestoringForce for BoucWenSpring {
    fn held(&self, memory: f64, way: Travel) -> (f64, f64) {
        let h = self.after(memory, way.to_um - way.from_um);
        (self.share * (h - (way.to_um - self.neutral_um)), h)
    }
    fn at_rest(&self, at_um: f64) -> (f64, f64) {
        self.held(
            0.0,
            Travel {
                from_um: self.neutral_um,
                to_um: at_um,
                speed_um: 0.0,
            },
        )
    }
    fn stiffening(&self, memory: f64, _swing_um: f64) -> f64 {
        // It gets stiffer than it is at the beginning only where it unloads, or hardens.
        let steep = (self.gamma - self.beta)
            .abs()
            .max(-(self.beta + self.gamma));
        let held = if self.exponent == 1.0 {
            memory.abs()
        } else {
            memory.abs().powf(self.exponent)
        };
        self.share * (steep * held).max(0.0)
    }
    fn lines(&self) -> ForceLines {
        let Self {
            share,
            beta,
            gamma,
            exponent,
            neutral_um,
        } = self;
        let mut after =
            String::from("side = 1\nif way < 0\n  side = -1\nh = h * side\nlonger = abs(way)\n");
        if *exponent == 1.0 {
            let unloads = beta - gamma;
            let below_zero = format!(
                "if abs({unloads:e} * h) < 1e-9\n  recovers = -h\nelse\n  recovers = log1p(max({:e} * h, -1)) / {:e}\n",
                -unloads,
                // Not taken where it is nothing.
                if unloads == 0.0 { 1.0 } else { unloads }
            );
            after += &format!(
                "if h < 0\n{}  if tends <= 0\n    h = tends\n    longer = 0\n  else\n{}    h = 0\n    longer = max(longer - recovers, 0)\n",
                deeper(&tends_in_lines(unloads), 1),
                deeper(&below_zero, 2),
            );
            after += &tends_in_lines(beta + gamma);
            after += "h = side * tends\n";
        } else {
            let steepness = (beta.abs() + gamma.abs()).powf(1.0 / exponent);
            let rate = |of: &str| {
                format!(
                    "turned = {gamma:e} + {beta:e}\nif {of} < 0\n  turned = {gamma:e} - {beta:e}\nbends = 1 - turned * pow(abs({of}), {exponent:e})\n"
                )
            };
            after += &format!(
                "parts = min(max(ceil(longer * {:e}), 1), {PARTS_MAX:e})\nfor part < parts\n{}  halfway = h + 0.5 * longer / parts * bends\n{}  h = h + longer / parts * bends\nh = side * h\n",
                steepness / PART,
                deeper(&rate("h"), 1),
                deeper(&rate("halfway"), 1),
            );
        }
        after += &format!("kept = h\ngiven = {share:e} * (h - (place - {neutral_um:e}))\n");
        let steep = (gamma - beta).abs().max(-(beta + gamma)).max(0.0);
        ForceLines {
            held: format!("h = memory\nway = place - came\n{after}"),
            at_rest: format!("h = 0\nway = place - {neutral_um:e}\n{after}"),
            stiffening: format!(
                "stiff = stiff + {:e} * pow(abs(memory), {exponent:e})\n",
                share * steep
            ),
            remembers: true,
        }
    }
}

impl Effect for HystereticStiffness {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Part of the spring slips inside: the force on the moving mass depends on where it turned last.".into(),
            reference: "Wen, J. Eng. Mech. Div. ASCE 102 (1976) 249-263; Noel and Schoukens, hysteretic benchmark (2016)".into(),
            modifies: Some(id::VIBRATION),
            experiment: "the same multisine or sweep around the resonance at several amplitudes, and slow sines".into(),
            beside: Some(id::VIBRATION),
            costly: true,
            picture: Picture {
                against: Against::Displacement,
                caption: "A force that depends on where the motion turned last.",
            },
            // Well damped stages, as the sets have them, show little of it beside the loops of a piezo.
            planted: Planted::Never,
            comes_with: &[id::VIBRATION],
            equations: r"A force in the balance of the mode of `vibration`, as in `nonlinear_stiffness`: `N = share (h - y)`, with `h' = y' - beta_per_um |y'| |h|^(exponent - 1) h - gamma_per_um y' |h|^exponent`.",
            ..Declaration::at(Place::Friction)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let per_um = 1.0 / overview.range_um.max(1e-6);
        vec![
            Parameter::linear("share", "1", 0.0, 0.98, 0.01),
            Parameter::linear("beta_per_um", "1/um", 0.0, 500.0 * per_um, 0.1 * per_um),
            Parameter::linear(
                "gamma_per_um",
                "1/um",
                -500.0 * per_um,
                500.0 * per_um,
                0.1 * per_um,
            ),
            Parameter::linear("exponent", "1", 0.5, 10.0, 0.05).fixed(),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let per_um = 1.0 / overview.range_um.max(1e-6);
        // Loops alone, loops that soften or harden, and loops that are closed early.
        let shapes = [(2.0, 0.0), (5.0, 5.0), (5.0, -5.0), (10.0, 0.0)];
        shapes
            .iter()
            .map(|(beta, gamma)| vec![0.1, beta * per_um, gamma * per_um, 1.0])
            .collect()
    }

    fn restoring_force(&self, from: &Build) -> Option<Box<dyn RestoringForce>> {
        let neutral_um = from.model.neutral_um(from.setting);
        Some(Box::new(BoucWenSpring {
            share: from.values[0],
            beta: from.values[1],
            gamma: from.values[2],
            exponent: from.values[3],
            neutral_um,
        }))
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        RestingPlace::without_inertia(self, from)
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        let per_um = 1.0 / case.stage.overview.range_um;
        Some(vec![
            case.about(0.1 * case.strength),
            4.0 * per_um,
            0.0,
            1.0,
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The equation of the spring by small steps of the way.
    fn by_euler(spring: &BoucWenSpring, mut h: f64, way_um: f64) -> f64 {
        let steps = 200_000;
        let step = way_um / f64::from(steps);
        for _ in 0..steps {
            h += step
                - (spring.beta * step.abs() * h.signum() + spring.gamma * step)
                    * h.abs().powf(spring.exponent);
        }
        h
    }

    #[test]
    fn a_way_is_the_sum_of_its_steps() {
        for (beta, gamma, exponent) in [
            (0.8, -1.1, 1.0),
            (2.0, 0.0, 1.0),
            (0.5, 0.5, 1.0),
            (0.6, 0.2, 2.0),
            (0.4, -0.1, 1.5),
        ] {
            let spring = BoucWenSpring {
                share: 0.5,
                beta,
                gamma,
                exponent,
                neutral_um: 0.0,
            };
            for h in [-0.7, -0.01, 0.0, 0.3] {
                for way_um in [0.05, 1.3, -2.0] {
                    let (found, expected) = (spring.after(h, way_um), by_euler(&spring, h, way_um));
                    assert!(
                        (found - expected).abs() < 1e-3 * expected.abs().max(0.1),
                        "{spring:?} {h} {way_um}: {found} {expected}"
                    );
                }
            }
        }
    }
}

//! A spring that stiffens, or softens, with its deflection.
//!
//! The force is a polynomial of the displacement from where the stage stands without voltage. A spring that
//! gives way holds no less than the load at which it does: beyond, its force stays what it is there.

use super::force_balance::RestingPlace;
use crate::balance_law::ForceLines;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "nonlinear_stiffness";

/// Powers of the displacement beside the first in the force of the spring.
pub struct NonlinearStiffness;

/// The force beside that of the straight spring.
#[derive(Clone, Copy, Debug)]
struct Spring {
    /// Of the second, third and fifth power, in units of the spring's own stiffness.
    powers: [f64; 3],
    neutral_um: f64,
    /// Deflections between which the whole spring does not give way, um.
    low_um: f64,
    high_um: f64,
}

impl Spring {
    fn new(powers: [f64; 3], neutral_um: f64) -> Self {
        let mut spring = Self {
            powers,
            neutral_um,
            low_um: f64::NEG_INFINITY,
            high_um: f64::INFINITY,
        };
        (spring.low_um, spring.high_um) = (-spring.gives_way_at(-1.0), spring.gives_way_at(1.0));
        spring
    }

    /// Slope of the force beside the straight spring.
    fn slope(&self, deflection_um: f64) -> f64 {
        let [second, third, fifth] = self.powers;
        let square = deflection_um * deflection_um;
        2.0 * second * deflection_um + 3.0 * third * square + 5.0 * fifth * square * square
    }

    /// The least deflection to a side at which the whole spring no longer gets stronger, um: where one power
    /// alone would undo the straight spring sets the scale, a hundredth of it the step.
    fn gives_way_at(&self, side: f64) -> f64 {
        let [second, third, fifth] = self.powers;
        let alone = [
            (2.0 * second * side, 1.0),
            (3.0 * third, 2.0),
            (5.0 * fifth, 4.0),
        ];
        let reach_um = alone
            .iter()
            .filter(|(slope, _)| *slope < 0.0)
            .map(|(slope, power)| (-slope).powf(-1.0 / power))
            .fold(0.0, f64::max);
        let gives_way = |um: f64| self.slope(side * um) <= -1.0;
        // Others hold it together for a while, at most until the highest of those that undo it has outgrown
        // them.
        let steps = (1..=GIVING_WAY_STEPS).map(|k| f64::from(k) * 0.01 * reach_um);
        let Some(mut behind) = steps
            .into_iter()
            .find(|um| gives_way(*um))
            .filter(|_| reach_um > 0.0)
        else {
            return f64::INFINITY;
        };
        let mut before = behind - 0.01 * reach_um;
        for _ in 0..60 {
            let middle = 0.5 * (before + behind);
            if gives_way(middle) {
                behind = middle
            } else {
                before = middle
            }
        }
        before
    }
}

/// A spring that does not give way within four times the deflection at which one of its powers alone would is
/// held by the others.
const GIVING_WAY_STEPS: u16 = 400;

impl RestoringForce for Spring {
    fn held(&self, _memory: f64, way: Travel) -> (f64, f64) {
        let deflection = way.to_um - self.neutral_um;
        let inside = deflection.clamp(self.low_um, self.high_um);
        let [second, third, fifth] = self.powers;
        let square = inside * inside;
        // Beyond, the straight spring's rise is subtracted.
        (
            square * (second + inside * (third + fifth * square)) - (deflection - inside),
            0.0,
        )
    }
    fn stiffening(&self, _memory: f64, swing_um: f64) -> f64 {
        let at = |um: f64| self.slope(um.clamp(self.low_um, self.high_um));
        at(swing_um - self.neutral_um)
            .max(at(-swing_um - self.neutral_um))
            .max(0.0)
    }
    fn lines(&self) -> ForceLines {
        let [second, third, fifth] = self.powers;
        let neutral = self.neutral_um;
        // No language has the same word for what is endless.
        let [low, high] = [self.low_um, self.high_um].map(|um| um.clamp(-1e300, 1e300));
        let inside =
            format!("inside = min(max(away, {low:e}), {high:e})\nsquared = inside * inside\n");
        let held = format!(
            "away = place - {neutral:e}\n{inside}given = squared * ({second:e} + inside * ({third:e} + {fifth:e} * squared)) - (away - inside)\n"
        );
        let slope = |side: &str, to: &str| {
            format!(
                "away = {side}SWING - {neutral:e}\n{inside}{to} = 2 * {second:e} * inside + 3 * {third:e} * squared + 5 * {fifth:e} * squared * squared\n"
            )
        };
        ForceLines {
            at_rest: held.clone(),
            held,
            stiffening: format!(
                "{}{}stiff = stiff + max(max(ahead, behind), 0)\n",
                slope("", "ahead"),
                slope("-", "behind")
            ),
            remembers: false,
        }
    }
}

impl Effect for NonlinearStiffness {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics:
            "The flexure gets stiffer or softer with its deflection, so the moving mass swings faster or slower the further it swings."
            .into(),
            reference: "Duffing oscillator: Kovacic and Brennan, The Duffing Equation (2011); Wigren and Schoukens, ECC (2013) 2933-2938"
            .into(),
            modifies: Some(id::VIBRATION),
            experiment: "the same multisine or sweep around the resonance at several amplitudes".into(),
            starts_combine: true,
            beside: Some(id::VIBRATION),
            picture: Picture {
                against: Against::Displacement,
                caption: "A force that grows faster, or more slowly, than the displacement.",
            },
            // Well damped stages, as the sets have them, show little of it beside the loops of a piezo.
            planted: Planted::Never,
            comes_with: &[id::VIBRATION],
            equations: r"A force in the balance of the mode of `vibration`, as the displacement that it makes at rest: `y'' / w^2 + 2 damping_ratio y' / w + y + N = x`, with `N = quadratic_per_um d^2 + cubic_per_um2 d^3 + fifth_per_um4 d^5` and
`d` the displacement from where the stage stands without voltage. Where the whole spring would get weaker (`1 + N'` below 0) `N` and the straight spring together keep the force that they have there. The straight part is exact over an
interval; `N` is followed in pieces of it as a parabola (Simpson's nodes, three trials).",
            ..Declaration::at(Place::Friction)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        // At a swing through half the range each power counts as much as the straight spring at most ten
        // times over.
        let half_um = 0.5 * overview.range_um.max(1e-6);
        let power = |name: &str, unit: &str, order: i32| {
            let unit_size = half_um.powi(1 - order);
            Parameter::linear(
                name,
                unit,
                -10.0 * unit_size,
                10.0 * unit_size,
                0.01 * unit_size,
            )
        };
        vec![
            power("quadratic_per_um", "1/um", 2),
            power("cubic_per_um2", "1/um^2", 3),
            power("fifth_per_um4", "1/um^4", 5).fixed(),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let half_um = 0.5 * overview.range_um.max(1e-6);
        vec![
            vec![0.02 / half_um, 0.0, 0.0],
            vec![0.0, 0.02 / (half_um * half_um), 0.0],
        ]
    }

    fn restoring_force(&self, from: &Build) -> Option<Box<dyn RestoringForce>> {
        let value = |k: usize| from.values.get(k).copied().unwrap_or(0.0);
        Some(Box::new(Spring::new(
            [value(0), value(1), value(2)],
            from.model.neutral_um(from.setting),
        )))
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        RestingPlace::without_inertia(self, from)
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        let half_um = 0.5 * case.stage.overview.range_um;
        Some(vec![
            0.0,
            case.about(0.05 * case.strength) / (half_um * half_um),
            0.0,
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_softening_spring_holds_the_load_at_which_it_gives_way() {
        let spring = Spring::new([0.0, -1.0 / 3.0, 0.0], 2.0);
        assert!((spring.high_um - 1.0).abs() < 1e-9 && (spring.low_um + 1.0).abs() < 1e-9);
        let whole = |um: f64| {
            um - 2.0
                + spring
                    .held(
                        0.0,
                        Travel {
                            from_um: 0.0,
                            to_um: um,
                            speed_um: 0.0,
                        },
                    )
                    .0
        };
        assert!((whole(3.0) - 2.0 / 3.0).abs() < 1e-9);
        assert!((whole(9.0) - whole(3.0)).abs() < 1e-9 && (whole(-7.0) + whole(3.0)).abs() < 1e-9);
        let held_together = Spring::new([-0.5, 1.0, 0.0], 0.0);
        assert_eq!(
            (held_together.low_um, held_together.high_um),
            (f64::NEG_INFINITY, f64::INFINITY)
        );
    }
}

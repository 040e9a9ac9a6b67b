//! A damper whose force does not grow in proportion to the velocity: with its square as in turbulent flow,
//! with none of it as in dry friction.

use crate::balance_law::ForceLines;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "nonlinear_damping";

/// A power of the velocity in the force of the damper.
pub struct NonlinearDamping;

/// A force of `force_um` where the velocity over the natural frequency is `at_um`, with this power of it
/// between.
#[derive(Clone, Copy, Debug)]
struct Damper {
    force_um: f64,
    exponent: f64,
    at_um: f64,
}

/// Share of the reference velocity below which a power less than one is smoothed: what turns at once at zero
/// velocity is no function there.
const SMOOTHED: f64 = 1e-3;

impl RestoringForce for Damper {
    fn held(&self, memory: f64, way: Travel) -> (f64, f64) {
        let speed = way.speed_um / self.at_um;
        (
            self.force_um
                * speed
                * (speed * speed + SMOOTHED * SMOOTHED).powf(0.5 * (self.exponent - 1.0)),
            memory,
        )
    }
    fn at_rest(&self, _at_um: f64) -> (f64, f64) {
        (0.0, 0.0)
    }
    fn stiffening(&self, _memory: f64, swing_um: f64) -> f64 {
        // A damper turns a state over no faster than by its slope.
        let speed = swing_um / self.at_um;
        let slope = self.force_um.abs() / self.at_um
            * (speed * speed + SMOOTHED * SMOOTHED).powf(0.5 * (self.exponent - 1.0));
        slope * slope
    }
    fn lines(&self) -> ForceLines {
        let Self {
            force_um,
            exponent,
            at_um,
        } = self;
        let power = 0.5 * (exponent - 1.0);
        let smooth = |of: &str| {
            format!(
                "fast = {of} / {at_um:e}\ntimes = pow(fast * fast + {:e}, {power:e})\n",
                SMOOTHED * SMOOTHED
            )
        };
        ForceLines {
            held: format!("{}given = {force_um:e} * fast * times\n", smooth("SPEED")),
            at_rest: "given = 0\n".into(),
            stiffening: format!(
                "{}stiff = stiff + pow({:e} * times, 2)\n",
                smooth("SWING"),
                force_um.abs() / at_um
            ),
            remembers: false,
        }
    }
}

impl Effect for NonlinearDamping {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The damper holds the moving mass with a power of its velocity: the square in a flow, none of it in dry friction."
            .into(),
            reference: "Elliott, Ghandchi Tehrani and Langley, Phil. Trans. R. Soc. A 373 (2015) 20140402".into(),
            modifies: Some(id::VIBRATION),
            experiment: "the same multisine or sweep around the resonance at several amplitudes".into(),
            one_sided: true,
            beside: Some(id::VIBRATION),
            picture: Picture {
                against: Against::Rate,
                caption: "A force that does not grow in proportion to the velocity.",
            },
            // Well damped stages, as the sets have them, show little of it beside the loops of a piezo.
            planted: Planted::Never,
            comes_with: &[id::VIBRATION],
            equations: r"A force in the balance of the mode of `vibration`, as in `nonlinear_stiffness`: `N = force_um s (s^2 + 10^-6)^((exponent - 1) / 2)`, with `s = y' / w / at_um`.",
            ..Declaration::at(Place::Friction)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let half_um = 0.5 * overview.range_um.max(1e-6);
        vec![
            Parameter::linear("force_um", "um", 0.0, 5.0 * half_um, 1e-3 * half_um),
            Parameter::linear("exponent", "1", 0.0, 3.0, 0.05),
            Parameter::linear("at_um", "um", 1e-9, 1e9, 0.01 * half_um).fixed(),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let half_um = 0.5 * overview.range_um.max(1e-6);
        [2.0, 0.2]
            .iter()
            .map(|exponent| vec![0.005 * half_um, *exponent, half_um])
            .collect()
    }

    fn restoring_force(&self, from: &Build) -> Option<Box<dyn RestoringForce>> {
        Some(Box::new(Damper {
            force_um: from.values[0],
            exponent: from.values[1],
            at_um: from.values[2],
        }))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        let half_um = 0.5 * case.stage.overview.range_um;
        Some(vec![
            case.about(0.05 * case.strength) * half_um,
            2.0,
            half_um,
        ])
    }
}

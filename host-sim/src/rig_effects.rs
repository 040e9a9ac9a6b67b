//! What a stick-slip rig may have beyond the model of chapter 3: seventeen effects, each with one or two values.
//!
//! All values are zero in a rig without any, and a zero changes nothing. What acts between the piezo's drive
//! and the platform is an [`Element`], what acts between the slider and its reading a [`SliderSensor`]. Forces
//! on the slider and changes of the contact enter the equations of motion ([`crate::stick_slip`]).

use std::collections::VecDeque;

/// Standard gravity, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.80665;

/// Strengths of all effects. A share is a relative change: 0.1 is ten per cent more.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RigEffects {
    /// Another preload of the contact: friction and stiffness grow with the normal force.
    pub preload_share: f64,
    /// Another coefficient of friction.
    pub friction_share: f64,
    /// Another stiffness of the contact.
    pub contact_stiffness_share: f64,
    /// Another mass of the slider.
    pub slider_mass_share: f64,
    /// The direction of travel points upward by this angle, rad.
    pub tilt_rad: f64,
    /// A spring between slider and frame, N/um, relaxed where the recording begins.
    pub guide_stiffness_n_um: f64,
    /// Viscous friction between slider and frame, N s/um.
    pub guide_viscosity_n_s_um: f64,
    /// Viscous friction between platform and slider, N s/um.
    pub contact_viscosity_n_s_um: f64,
    /// Friction at rest above that of sliding.
    pub stribeck_share: f64,
    /// Velocity at which that has fallen to 1/e, um/s.
    pub stribeck_velocity_um_s: f64,
    /// Friction that grows along the travel, 1/um.
    pub wear_per_um: f64,
    /// Another gain of the piezo element.
    pub element_gain_share: f64,
    /// Stroke at full drive that goes through play operators, um.
    pub element_loops_um: f64,
    /// Creep of the piezo element in each decade of time.
    pub element_creep_share: f64,
    /// Another scale of the sensor.
    pub sensor_scale_share: f64,
    /// Lag of the sensor, s.
    pub sensor_lag_s: f64,
    /// Half the play between slider and sensor, um.
    pub sensor_slip_um: f64,
    /// Dead time between drive and reading, s.
    pub delay_s: f64,
}

/// One value of an effect.
#[derive(Clone, Copy, Debug)]
pub struct RigParameter {
    /// Its name in files.
    pub name: &'static str,
    /// Its unit; empty for a share.
    pub unit: &'static str,
    /// Values from which a fit begins. The first is a usual size.
    pub guesses: &'static [f64],
    /// Least and greatest value that its physics allows.
    pub range: [f64; 2],
    /// Where it stands.
    pub place: fn(&mut RigEffects) -> &mut f64,
}

impl RigParameter {
    /// Its value.
    #[must_use]
    pub fn value(&self, effects: &RigEffects) -> f64 {
        *(self.place)(&mut effects.clone())
    }
}

/// An effect: one physical cause.
#[derive(Debug)]
pub struct RigEffect {
    /// Its name.
    pub id: &'static str,
    /// Its physics in a sentence.
    pub sentence: &'static str,
    /// Its values, the strength first.
    pub parameters: &'static [RigParameter],
}

/// The declaration of a parameter by the field that holds it.
macro_rules! parameter {
    ($field:ident, $unit:literal, $guesses:expr, $range:expr) => {
        RigParameter {
            name: stringify!($field),
            unit: $unit,
            guesses: &$guesses,
            range: $range,
            place: |effects| &mut effects.$field,
        }
    };
}

/// All effects.
pub static RIG_EFFECTS: [RigEffect; 17] = [
    RigEffect {
        id: "preload",
        sentence: "another normal force scales friction and stiffness of the contact",
        parameters: &[parameter!(preload_share, "", [0.2, -0.2], [-0.9, 4.0])],
    },
    RigEffect {
        id: "friction",
        sentence: "another coefficient of friction scales the Coulomb force",
        parameters: &[parameter!(friction_share, "", [0.2, -0.2], [-0.9, 4.0])],
    },
    RigEffect {
        id: "contact_stiffness",
        sentence: "another stiffness of the contact, at the same Coulomb force",
        parameters: &[parameter!(
            contact_stiffness_share,
            "",
            [0.2, -0.2],
            [-0.9, 4.0]
        )],
    },
    RigEffect {
        id: "slider_mass",
        sentence: "another mass of the slider",
        parameters: &[parameter!(slider_mass_share, "", [0.2, -0.2], [-0.9, 4.0])],
    },
    RigEffect {
        id: "tilt",
        sentence: "a part of the slider's weight, m g sin(tilt), acts along the travel",
        parameters: &[parameter!(tilt_rad, "rad", [0.01, -0.01], [-0.1, 0.1])],
    },
    RigEffect {
        id: "guide_stiffness",
        sentence: "a spring pulls the slider back to where the recording begins",
        parameters: &[parameter!(
            guide_stiffness_n_um,
            "N/um",
            [2e-4, 2e-3],
            [0.0, 0.1]
        )],
    },
    RigEffect {
        id: "guide_viscosity",
        sentence: "a viscous force of the guide brakes the slider",
        parameters: &[parameter!(
            guide_viscosity_n_s_um,
            "N s/um",
            [3e-6, 3e-5],
            [0.0, 1e-3]
        )],
    },
    RigEffect {
        id: "contact_viscosity",
        sentence: "a viscous force of the contact grows with the sliding velocity",
        parameters: &[parameter!(
            contact_viscosity_n_s_um,
            "N s/um",
            [1e-6, 5e-6],
            [0.0, 1e-3]
        )],
    },
    RigEffect {
        id: "stribeck",
        sentence: "friction at rest is larger than friction in motion (Stribeck)",
        parameters: &[
            parameter!(stribeck_share, "", [0.2, 0.2], [0.0, 2.0]),
            parameter!(stribeck_velocity_um_s, "um/s", [400.0, 3000.0], [20.0, 3e4]),
        ],
    },
    RigEffect {
        id: "wear",
        sentence: "worn surfaces change the friction along the travel",
        parameters: &[parameter!(
            wear_per_um,
            "1/um",
            [3e-3, -3e-3],
            [-0.05, 0.05]
        )],
    },
    RigEffect {
        id: "element_gain",
        sentence: "the piezo element extends further, or less far, at the same drive",
        parameters: &[parameter!(
            element_gain_share,
            "",
            [0.05, -0.05],
            [-0.5, 0.5]
        )],
    },
    RigEffect {
        id: "element_hysteresis",
        sentence: "the loops of the piezo element are wider, or narrower",
        parameters: &[parameter!(element_loops_um, "um", [0.5, -0.5], [-5.0, 5.0])],
    },
    RigEffect {
        id: "element_creep",
        sentence: "the piezo element creeps: it extends by the same share in each decade of time",
        parameters: &[parameter!(element_creep_share, "", [0.01], [0.0, 0.2])],
    },
    RigEffect {
        id: "sensor_scale",
        sentence: "the sensor reads more, or less, per micrometre",
        parameters: &[parameter!(
            sensor_scale_share,
            "",
            [0.02, -0.02],
            [-0.5, 0.5]
        )],
    },
    RigEffect {
        id: "sensor_lag",
        sentence: "the sensor follows as a filter of first order",
        parameters: &[parameter!(sensor_lag_s, "s", [1e-4, 5e-4], [0.0, 5e-3])],
    },
    RigEffect {
        id: "sensor_slip",
        sentence: "the sensor's target slips on the slider: readings follow behind a play",
        parameters: &[parameter!(sensor_slip_um, "um", [0.05, 0.5], [0.0, 5.0])],
    },
    RigEffect {
        id: "delay",
        sentence: "readings come later than the drive",
        parameters: &[parameter!(delay_s, "s", [1e-4, 5e-4], [0.0, DELAY_MAX_S])],
    },
];

/// All values with the effect of each.
pub fn parameters() -> impl Iterator<Item = &'static RigParameter> {
    RIG_EFFECTS.iter().flat_map(|effect| effect.parameters)
}

/// Longest dead time, s.
const DELAY_MAX_S: f64 = 5e-3;
/// Half widths of the play operators, as shares of the drive's range.
const PLAYS: [f64; 4] = [0.05, 0.1, 0.2, 0.3];
/// Time constants of creep, two in a decade, s.
const CREEP_S: [f64; 6] = [0.003, 0.01, 0.03, 0.1, 0.3, 1.0];

/// What the effects make of the piezo element: its displacement from the loops of the model on.
#[derive(Clone, Debug)]
pub struct Element {
    effects: RigEffects,
    range_v: f64,
    plays: [f64; PLAYS.len()],
    creep_um: [f64; CREEP_S.len()],
    /// Share of the way that a creeping part goes in a period.
    gone: [f64; CREEP_S.len()],
    delay: Delay,
}

impl Element {
    /// At rest at 0 V.
    #[must_use]
    pub fn at_rest(effects: RigEffects, range_v: f64, period_s: f64) -> Self {
        Self {
            effects,
            range_v,
            plays: [0.0; PLAYS.len()],
            creep_um: [0.0; CREEP_S.len()],
            gone: CREEP_S.map(|tau_s| 1.0 - (-period_s / tau_s).exp()),
            delay: Delay::at_rest(effects.delay_s / period_s),
        }
    }

    /// The displacement at rest for a drive, where the model's loops make so much of it, um.
    pub fn step(&mut self, drive_v: f64, loops_um: f64) -> f64 {
        let effects = &self.effects;
        let mut um = loops_um * (1.0 + effects.element_gain_share);
        if effects.element_loops_um != 0.0 {
            let at = drive_v / self.range_v;
            for (play, half) in self.plays.iter_mut().zip(PLAYS) {
                *play = play.max(at - half).min(at + half);
            }
            let behind = self.plays.iter().sum::<f64>() / PLAYS.len() as f64 - at;
            um += effects.element_loops_um * behind;
        }
        if effects.element_creep_share != 0.0 {
            for (creep, gone) in self.creep_um.iter_mut().zip(self.gone) {
                *creep += gone * (loops_um - *creep);
            }
            // Two of them in a decade.
            um += 0.5 * effects.element_creep_share * self.creep_um.iter().sum::<f64>();
        }
        self.delay.step(um)
    }
}

/// A dead time of any number of periods, with straight lines between the samples.
#[derive(Clone, Debug)]
struct Delay {
    late: VecDeque<f64>,
    share: f64,
}

impl Delay {
    fn at_rest(periods: f64) -> Self {
        let whole = periods.max(0.0).floor();
        Self {
            late: VecDeque::from(vec![0.0; whole as usize + 1]),
            share: periods.max(0.0) - whole,
        }
    }

    fn step(&mut self, value: f64) -> f64 {
        self.late.push_back(value);
        let before = self.late.pop_front().unwrap_or(value);
        let now = self.late.front().copied().unwrap_or(value);
        now + self.share * (before - now)
    }
}

/// What the effects make of the slider's reading.
#[derive(Clone, Debug)]
pub struct SliderSensor {
    effects: RigEffects,
    period_s: f64,
    slipped_um: f64,
    before_um: f64,
    reading_um: f64,
}

impl SliderSensor {
    /// Zeroed where the slider is at rest.
    #[must_use]
    pub fn at_rest(effects: RigEffects, period_s: f64) -> Self {
        Self {
            effects,
            period_s,
            slipped_um: 0.0,
            before_um: 0.0,
            reading_um: 0.0,
        }
    }

    /// The reading at the next sample, um.
    pub fn step(&mut self, slider_um: f64) -> f64 {
        let half_um = self.effects.sensor_slip_um;
        self.slipped_um = (self.slipped_um)
            .max(slider_um - half_um)
            .min(slider_um + half_um);
        let now_um = self.slipped_um;
        let lag_s = self.effects.sensor_lag_s;
        self.reading_um = if lag_s > 0.0 {
            // Exact for straight lines between the samples.
            let periods = self.period_s / lag_s;
            let kept = (-periods).exp();
            let of_ramp = (1.0 - kept) / periods;
            kept * self.reading_um + (1.0 - of_ramp) * now_um + (of_ramp - kept) * self.before_um
        } else {
            now_um
        };
        self.before_um = now_um;
        self.reading_um * (1.0 + self.effects.sensor_scale_share)
    }
}

impl RigEffects {
    /// Factor of the Coulomb force at a position of the slider and a sliding velocity.
    #[must_use]
    pub fn friction_factor(&self, slider_um: f64, velocity_um_s: f64) -> f64 {
        /// A surface does not wear until nothing is left.
        const LEAST: f64 = 0.05;
        let mut factor = (1.0 + self.wear_per_um * slider_um).max(LEAST);
        if self.stribeck_share != 0.0 {
            let ratio = velocity_um_s / self.stribeck_velocity_um_s.max(1.0);
            factor *= 1.0 + self.stribeck_share * (-ratio * ratio).exp();
        }
        factor
    }

    /// The friction depends on where and how fast the slider moves.
    #[must_use]
    pub fn has_varying_friction(&self) -> bool {
        self.wear_per_um != 0.0 || self.stribeck_share != 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_loop::Plant;
    use crate::stick_slip::{StickSlipActuator, StickSlipPlant};
    use crate::waveform;

    const FS: f64 = 20_000.0;

    /// A rig whose effects have these sizes of their first guesses.
    fn rig(effects: &[&RigEffect], size: f64) -> StickSlipActuator {
        let mut rig = StickSlipActuator::thesis(0.0635);
        for parameter in effects.iter().flat_map(|effect| effect.parameters) {
            *(parameter.place)(&mut rig.effects) = size * parameter.guesses[0];
        }
        rig
    }

    fn reading_um(rig: &StickSlipActuator) -> Vec<f64> {
        let drive_v = waveform::saw_tooth(FS, 80.0, 60.0, 1.0, 5);
        rig.simulate(&drive_v, FS).reading_um
    }

    #[test]
    fn every_effect_changes_the_reading_and_its_zero_does_not() {
        let without = reading_um(&StickSlipActuator::thesis(0.0635));
        for effect in &RIG_EFFECTS {
            let mut zero = rig(&[effect], 1.0);
            *(effect.parameters[0].place)(&mut zero.effects) = 0.0;
            assert_eq!(reading_um(&zero), without, "{}", effect.id);
            let with = reading_um(&rig(&[effect], 1.0));
            let largest =
                (with.iter().zip(&without)).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
            println!("{}: {:.0} nm", effect.id, 1e3 * largest);
            assert!(
                (0.01..20.0).contains(&largest),
                "{}: {largest} um",
                effect.id
            );
        }
    }

    #[test]
    fn a_small_strength_changes_little() {
        let without = reading_um(&StickSlipActuator::thesis(0.0635));
        for parameter in parameters().filter(|p| p.name != "stribeck_velocity_um_s") {
            let mut rig = StickSlipActuator::thesis(0.0635);
            *(parameter.place)(&mut rig.effects) = 1e-4 * parameter.guesses[0];
            let largest = (reading_um(&rig).iter().zip(&without))
                .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
            assert!(largest < 0.01, "{}: {largest} um", parameter.name);
        }
    }

    #[test]
    fn the_plant_has_the_effects_of_the_simulation() {
        let all: Vec<&RigEffect> = RIG_EFFECTS.iter().collect();
        let rig = rig(&all, 0.7);
        let drive_v = waveform::saw_tooth(FS, 80.0, 60.0, 1.0, 4);
        let simulated = rig.simulate(&drive_v, FS).reading_um;
        let mut plant = StickSlipPlant::at_rest(rig, 1.0 / FS);
        for (u, y) in drive_v.iter().zip(&simulated) {
            assert!((plant.sensor_um() - y).abs() < 1e-9, "{y}");
            plant.advance(*u, 0.0);
        }
    }
}

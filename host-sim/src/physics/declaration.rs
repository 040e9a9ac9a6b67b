//! What an effect declares about itself, as data.

use std::f64::consts::TAU;

/// Where an effect stands in the chain from drive to measurement, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// Transport delay of the drive.
    Delay,
    /// Bandwidth of the amplifier.
    AmplifierBandwidth,
    /// Slew limit of the amplifier.
    AmplifierSlew,
    /// Output limits of the amplifier.
    AmplifierSaturation,
    /// Charge that leaks from the piezo.
    Charge,
    /// Drive to force-equivalent displacement.
    Hysteresis,
    /// Force-equivalent displacement by the state of polarisation.
    PiezoelectricCoefficient,
    /// External force.
    LoadForce,
    /// Friction of the guide.
    Friction,
    /// Structural modes.
    Vibration,
    /// Slow following of the displacement.
    Creep,
    /// Motion that has no cause in the drive.
    Drift,
    /// Characteristic of the sensor.
    SensorNonlinearity,
    /// Bandwidth of the sensor.
    SensorBandwidth,
    /// Lines in the sensor signal.
    Hum,
    /// Resolution of the converter.
    Quantisation,
}

impl Place {
    /// All places with the names that files use, in the order of the chain.
    pub const NAMES: [(&'static str, Place); 16] = [
        ("delay", Place::Delay),
        ("amplifier_bandwidth", Place::AmplifierBandwidth),
        ("amplifier_slew", Place::AmplifierSlew),
        ("amplifier_saturation", Place::AmplifierSaturation),
        ("charge", Place::Charge),
        ("hysteresis", Place::Hysteresis),
        ("piezoelectric_coefficient", Place::PiezoelectricCoefficient),
        ("load_force", Place::LoadForce),
        ("friction", Place::Friction),
        ("vibration", Place::Vibration),
        ("creep", Place::Creep),
        ("drift", Place::Drift),
        ("sensor_nonlinearity", Place::SensorNonlinearity),
        ("sensor_bandwidth", Place::SensorBandwidth),
        ("hum", Place::Hum),
        ("quantisation", Place::Quantisation),
    ];
}

/// How a parameter is varied when it is estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Steps of this size matter.
    Linear(f64),
    /// Positive; relative steps matter.
    Logarithmic,
}

/// One parameter of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, with its unit as a suffix.
    pub name: String,
    /// Unit as printed.
    pub unit: String,
    /// Least value.
    pub lower: f64,
    /// Greatest value.
    pub upper: f64,
    /// How it is varied.
    pub scale: Scale,
    /// Not estimated unless asked for.
    pub fixed: bool,
    /// What it is expected to lie within without any data: the standard deviation of a prior around zero, in
    /// steps that matter. So it stays what it is where a file tells the steps.
    pub expected_steps: Option<f64>,
    /// Its value was chosen before any data, as one of a grid: what another choice could do is no evidence of
    /// a missing effect.
    pub of_a_grid: bool,
}

impl Parameter {
    /// A parameter for which steps of `step` matter.
    #[must_use]
    pub fn linear(name: impl Into<String>, unit: &str, lower: f64, upper: f64, step: f64) -> Self {
        Self::varied(name.into(), unit, (lower, upper), Scale::Linear(step))
    }

    /// A positive parameter that is varied by ratios. Data that reach no further than `lower` leave it there.
    #[must_use]
    pub fn logarithmic(name: impl Into<String>, unit: &str, lower: f64, upper: f64) -> Self {
        Self::varied(name.into(), unit, (lower, upper), Scale::Logarithmic)
    }

    /// Data may reach no further than a limit; bounds never cross.
    fn varied(name: String, unit: &str, (lower, upper): (f64, f64), scale: Scale) -> Self {
        Self {
            name,
            unit: unit.into(),
            lower,
            upper: upper.max(lower),
            scale,
            fixed: false,
            expected_steps: None,
            of_a_grid: false,
        }
    }

    /// What it is of, without its unit, and how much one of its unit is in SI's: a frequency is one quantity in
    /// Hz and in rad/s.
    #[must_use]
    pub fn quantity(&self) -> (&str, f64) {
        match self.unit.as_str() {
            "Hz" => (self.name.trim_end_matches("_hz"), TAU),
            "rad/s" => (self.name.trim_end_matches("_rad_s"), 1.0),
            _ => (&self.name, 1.0),
        }
    }

    /// This parameter, where it is varied by steps, expected within so many of zero where data do not say it.
    #[must_use]
    pub fn expected_within(mut self, steps: f64) -> Self {
        self.expected_steps = Some(steps);
        self
    }

    /// This parameter, kept at its value.
    #[must_use]
    pub fn fixed(mut self) -> Self {
        self.fixed = true;
        self
    }

    /// This parameter, kept at its value on a grid that was chosen before any data.
    #[must_use]
    pub fn on_a_grid(mut self) -> Self {
        (self.fixed, self.of_a_grid) = (true, true);
        self
    }
}

/// What an effect says about itself: everything that is a property and no computation.
#[derive(Clone, Debug, PartialEq)]
pub struct Declaration {
    /// Identifier on the command line and in files.
    pub id: String,
    /// One sentence of physics.
    pub physics: String,
    /// Where it is described.
    pub reference: String,
    /// What it computes, so that a reader can compute the same: symbols by the names of its parameters, and
    /// how it is discretised, in Markdown. `docs/reference/effects.md` explains the notation.
    pub equations: &'static str,
    /// Place in the chain.
    pub place: Place,
    /// The effect whose stage takes this one in, if any.
    pub modifies: Option<&'static str>,
    /// The experiment that shows it best.
    pub experiment: String,
    /// The picture that shows it in a residual.
    pub picture: Picture,
    /// Whether it may be looked for in a residual.
    pub candidate: bool,
    /// The effect can only act in the direction of its start values (a delay cannot be negative).
    pub one_sided: bool,
    /// Its starts are coefficients of one linear form, which is looked for as a whole.
    pub starts_combine: bool,
    /// Place in the order in which a list of effects is fitted one after the other: those on which others
    /// build come first.
    pub fitting_rank: usize,
    /// The effect that a model must have for this one to make sense in it.
    pub beside: Option<&'static str>,
    /// It is looked for only where the drives move at more than one speed.
    pub needs_several_speeds: bool,
    /// Nothing of it can be seen without a measured force.
    pub needs_force: bool,
    /// A walk of it takes much longer than of any other effect: a search leaves it out where the signatures
    /// of others hardly change.
    pub costly: bool,
    /// It reads what moves inside a sampling period, and must see that motion: the modes in front of it then
    /// go in sub-intervals too.
    pub follows_motion: bool,
    /// Behind what moves inside sampling periods it goes in whole periods, if all that stand behind it do: it
    /// is known from where the motion stands at their ends.
    pub goes_by_ends: bool,
    /// Which loops have to open for the effect to be real.
    pub opening: Opening,
    /// An actuator with it that was never driven rests at 0 V, not at the lower limit of the drive.
    pub virgin_at_zero: bool,
    /// When its loops are tried in the place of another structure's.
    pub tried_for_loops: LoopsTried,
    /// Steps of another stage that one of its own takes as long as; without a number, the parameters say it.
    pub lasts_steps: Option<u64>,
    /// In which sets of synthetic cases it is hidden.
    pub planted: Planted,
    /// Effects that an actuator which has this one has with it.
    pub comes_with: &'static [&'static str],
    /// Names of the signals, beside drive and force, that have to be recorded for it.
    pub auxiliary: Vec<String>,
    /// It takes part of what was recorded, so that it cannot be simulated where the drive is not known
    /// beforehand.
    pub follows_record: bool,
    /// The text that defines an effect which is not built in.
    pub definition: Option<String>,
}

impl Declaration {
    /// An effect at this place that is looked for in residuals and hidden alone.
    #[must_use]
    pub fn at(place: Place) -> Self {
        Self {
            id: String::new(),
            physics: String::new(),
            reference: String::new(),
            equations: "",
            place,
            modifies: None,
            experiment: String::new(),
            picture: Picture {
                against: Against::Drive,
                caption: "Averaged over the drive, by branch.",
            },
            candidate: true,
            one_sided: false,
            starts_combine: false,
            fitting_rank: 9,
            beside: None,
            needs_several_speeds: false,
            needs_force: false,
            costly: false,
            follows_motion: false,
            goes_by_ends: false,
            opening: Opening::NotNeeded,
            virgin_at_zero: false,
            tried_for_loops: LoopsTried::AtFirst,
            lasts_steps: None,
            planted: Planted::Alone,
            comes_with: &[],
            auxiliary: Vec::new(),
            follows_record: false,
            definition: None,
        }
    }

    /// An effect at this place that only a user asks for.
    #[must_use]
    pub fn on_request(place: Place) -> Self {
        Self {
            candidate: false,
            planted: Planted::Never,
            ..Self::at(place)
        }
    }

    /// A structure of loops that only a user asks for.
    #[must_use]
    pub fn of_loops() -> Self {
        Self {
            fitting_rank: 1,
            opening: Opening::OfItself,
            ..Self::on_request(Place::Hysteresis)
        }
    }

    /// It stands for the hysteresis of the chain, or in place of it: a chain has one of these.
    #[must_use]
    pub fn is_main(&self) -> bool {
        self.place == Place::Hysteresis && self.modifies.is_none()
    }

    /// Its loops are tried in the place of another structure's at this time of a search.
    #[must_use]
    pub fn is_tried_for_loops(&self, at: LoopsTried) -> bool {
        self.tried_for_loops == at && self.is_main()
    }
}

/// When loops are tried in the place of another structure's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopsTried {
    /// Never: they have no memory, or only add parameters to another structure.
    Never,
    /// Once there is a structure.
    AtFirst,
    /// Once there are loops, or nothing else helps, far above the noise: they take much longer.
    FarAbove,
}

/// Which loops of a model have to open for an effect to be real.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opening {
    /// None.
    NotNeeded,
    /// Its own.
    OfItself,
    /// Those of the effect that it modifies.
    OfModified,
}

/// In which sets of synthetic cases an effect is hidden.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Planted {
    /// In none.
    Never,
    /// Alone.
    Alone,
    /// Alone, and beside every other of these.
    InPairs,
}

/// The picture in which an effect is seen at a glance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// What a residual is drawn against.
    pub against: Against,
    /// What to see there, in a sentence.
    pub caption: &'static str,
}

/// What a residual is drawn against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Against {
    /// Logarithm of the time since the last turn, while the drive stands still.
    TimeHeld,
    /// Logarithm of the time since the last turn.
    TimeSinceTurn,
    /// Drive, by branch.
    Drive,
    /// Displacement, by branch.
    Displacement,
    /// Where the modelled reading lies within a step of the converter.
    WithinStep,
    /// Signed rate of the drive.
    Rate,
    /// Measured external force.
    Force,
    /// Plain time.
    Time,
    /// Frequency.
    Frequency,
}

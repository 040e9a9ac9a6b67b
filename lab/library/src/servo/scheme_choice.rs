//! The schemes that a design may be asked for, by their names.

/// A scheme by its name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SchemeChoice {
    /// Kalman observer and linear-quadratic surface for the sampled model.
    #[default]
    Predictor,
    /// PIDSMC on the PIDSMO (thesis Ch. 7).
    Pidsmoc,
    /// PIDSMC on the continuous alpha-beta filter (thesis Ch. 6).
    PidsmcAlphaBeta,
    /// Sliding mode with a boundary layer on the alpha-beta filter (thesis Ch. 6, Eq. 45).
    Smcbl,
    /// PID on the tracking error; with the hysteresis inverted, beside a feedforward.
    Pid,
}

impl SchemeChoice {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Predictor,
        Self::Pidsmoc,
        Self::PidsmcAlphaBeta,
        Self::Smcbl,
        Self::Pid,
    ];

    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Predictor => "predictor",
            Self::Pidsmoc => "pidsmoc",
            Self::PidsmcAlphaBeta => "pidsmc-alpha-beta",
            Self::Smcbl => "smcbl",
            Self::Pid => "pid",
        }
    }

    /// The scheme of a name.
    ///
    /// # Errors
    /// The names that there are.
    pub fn named(name: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|choice| choice.name() == name);
        known.ok_or_else(|| {
            format!(
                "scheme `{name}` is not known; expected one of {}",
                Self::ALL.map(Self::name).join(", ")
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_its_scheme() {
        assert!(
            SchemeChoice::ALL
                .into_iter()
                .all(|choice| SchemeChoice::named(choice.name()) == Ok(choice))
        );
        assert!(
            SchemeChoice::named("lqg")
                .unwrap_err()
                .contains("pidsmc-alpha-beta")
        );
    }
}

//! The electromechanical model of a piezo (thesis Ch. 2, Eqs. 6-11): where the hysteresis is, and why a
//! charge drive does not see it.
//!
//! # Equations
//! The voltage across the piezo is that of a hysteretic element and that of its linear part in series, `u =
//! u_h + u_p` (6). The charge passes both: `q = H(u_h)` (7) and `q = C u_p + q_p` (8), with `q_p = T y` (9).
//! The force is `F = T u_p` (10), and the mechanics answer with `y` (11), here at rest: `y = (F - F_e) / k`.
//!
//! # Two drives
//! A *voltage* amplifier fixes `u`, so `u_h` and with it `H` are in the way from the drive to the force:
//! loops. A *charge* amplifier fixes `q`; then `u_p = (q - T y) / C` holds whatever `H` does, and
//! displacement and force are linear in the charge. But charge leaks through the insulation, `q' = i - u /
//! R`: what is held sinks back.
//!
//! `H` is the generalised Maxwell model: elements that stretch and then slip, in parallel, as charges over
//! voltage.

/// The piezo: linear part, hysteretic elements, leakage.
#[derive(Clone, Debug, PartialEq)]
pub struct Electromechanical {
    /// Capacitance `C`, F.
    pub capacitance_f: f64,
    /// Transformation ratio `T`, N/V or C/m.
    pub ratio_n_v: f64,
    /// Stiffness at the end-effector, N/m.
    pub stiffness_n_m: f64,
    /// Elements of `H`: capacitance, F, and the charge at which each slips, C. The last one may never slip.
    pub elements: Vec<(f64, f64)>,
    /// Insulation resistance, ohm.
    pub leakage_ohm: f64,
}

impl Electromechanical {
    /// A stack that moves about 9 um at 100 V, with four hysteretic elements.
    #[must_use]
    pub fn stack(leakage_ohm: f64) -> Self {
        Self {
            capacitance_f: 1.8e-6,
            ratio_n_v: 5.0,
            stiffness_n_m: 4.5e7,
            elements: vec![
                (4e-6, 8e-6),
                (4e-6, 2e-5),
                (3e-6, 3e-5),
                (4e-6, f64::INFINITY),
            ],
            leakage_ohm,
        }
    }
}

/// What the amplifier fixes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// A voltage, V.
    Voltage(f64),
    /// A charge that has been supplied since the beginning, C; it leaks.
    Charge(f64),
}

/// The piezo with its state: charges in the elements of `H`, and what has leaked.
#[derive(Clone, Debug)]
pub struct ElectromechanicalState {
    model: Electromechanical,
    element_c: Vec<f64>,
    hysteretic_v: f64,
    leaked_c: f64,
}

impl ElectromechanicalState {
    /// Never driven.
    #[must_use]
    pub fn virgin(model: &Electromechanical) -> Self {
        Self {
            element_c: vec![0.0; model.elements.len()],
            model: model.clone(),
            hysteretic_v: 0.0,
            leaked_c: 0.0,
        }
    }

    /// Charges of the elements once the hysteretic voltage has gone to a value.
    fn charges_at(&self, hysteretic_v: f64) -> impl Iterator<Item = f64> + '_ {
        let change_v = hysteretic_v - self.hysteretic_v;
        self.model
            .elements
            .iter()
            .zip(&self.element_c)
            .map(move |((c, slips), q)| (q + c * change_v).clamp(-slips, *slips))
    }

    /// Charge per volt of the linear part with the mechanics at rest: `C + T^2 / k`.
    fn linear_f(&self) -> f64 {
        self.model.capacitance_f + self.model.ratio_n_v.powi(2) / self.model.stiffness_n_m
    }

    /// One interval of a drive with an external force, N; the displacement at its end, m.
    pub fn step(&mut self, drive: Drive, external_n: f64, dt_s: f64) -> f64 {
        let m = &self.model;
        // q = linear_f u_p - T F_e / k in either case.
        let bias_c = m.ratio_n_v * external_n / m.stiffness_n_m;
        let linear_f = self.linear_f();
        let charge_of = |linear_v: f64| linear_f * linear_v - bias_c;
        let hysteretic_v = match drive {
            // H(u_h) = q(u - u_h): one side rises with u_h, the other falls, so bisection between bounds that
            // hold the root.
            Drive::Voltage(u) => root(
                |v| self.charges_at(v).sum::<f64>() - charge_of(u - v),
                self.hysteretic_v,
                u,
            ),
            Drive::Charge(supplied_c) => {
                let charge_c = supplied_c - self.leaked_c;
                let guess_v = self.hysteretic_v
                    + charge_c
                        / m.elements
                            .iter()
                            .map(|(c, _)| c)
                            .sum::<f64>()
                            .max(f64::MIN_POSITIVE);
                root(
                    |v| self.charges_at(v).sum::<f64>() - charge_c,
                    self.hysteretic_v,
                    guess_v,
                )
            }
        };
        let charges: Vec<f64> = self.charges_at(hysteretic_v).collect();
        let linear_v = match drive {
            Drive::Voltage(u) => u - hysteretic_v,
            Drive::Charge(supplied_c) => (supplied_c - self.leaked_c + bias_c) / linear_f,
        };
        self.element_c = charges;
        self.hysteretic_v = hysteretic_v;
        if matches!(drive, Drive::Charge(_)) {
            self.leaked_c += dt_s * (hysteretic_v + linear_v) / self.model.leakage_ohm;
        }
        (self.model.ratio_n_v * linear_v - external_n) / self.model.stiffness_n_m
    }
}

/// Where a function that rises takes the value zero, by widening from two guesses and bisection.
fn root(f: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    let (mut low, mut high) = (a.min(b), a.max(b));
    let mut width = (high - low).max(1e-6);
    for _ in 0..60 {
        if f(low) <= 0.0 && f(high) >= 0.0 {
            break;
        }
        (low, high) = (
            if f(low) > 0.0 { low - width } else { low },
            if f(high) < 0.0 { high + width } else { high },
        );
        width *= 2.0;
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if f(middle) < 0.0 {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piezo() -> Electromechanical {
        Electromechanical::stack(1e15)
    }

    /// Up to a drive and back: displacement by branch at half of the way, and the whole travel.
    fn opening_and_travel(drive: impl Fn(f64) -> Drive) -> (f64, f64) {
        let mut state = ElectromechanicalState::virgin(&piezo());
        let mut go = |from: i32, to: i32| -> Vec<f64> {
            let way = (to - from).signum();
            (1..=(to - from).abs())
                .map(|k| state.step(drive(f64::from(from + way * k) / 200.0), 0.0, 1e-4))
                .collect()
        };
        go(0, 200);
        let (down, up) = (go(200, 0), go(0, 200));
        ((down[99] - up[99]).abs(), up[199] - down[199])
    }

    #[test]
    fn a_voltage_drive_shows_loops_and_a_charge_drive_none() {
        let (opening, travel) = opening_and_travel(|share| Drive::Voltage(100.0 * share));
        assert!(opening > 0.03 * travel, "{opening:e} {travel:e}");
        let (opening, travel) = opening_and_travel(|share| Drive::Charge(1.5e-4 * share));
        assert!(
            travel > 1e-6 && opening < 1e-6 * travel,
            "{opening:e} {travel:e}"
        );
    }

    /// Oracle: the balance of Eqs. 6 to 11, written out again from what came out.
    #[test]
    fn charges_and_voltages_balance() {
        let model = piezo();
        let mut state = ElectromechanicalState::virgin(&model);
        for (k, u) in [20.0, 60.0, 35.0, 80.0, 10.0, 45.0].into_iter().enumerate() {
            let external_n = 3.0 * k as f64;
            let y = state.step(Drive::Voltage(u), external_n, 1e-4);
            let linear_v = (model.stiffness_n_m * y + external_n) / model.ratio_n_v;
            let charge_c = model.capacitance_f * linear_v + model.ratio_n_v * y;
            assert!(
                (state.element_c.iter().sum::<f64>() - charge_c).abs() < 1e-12,
                "{k}"
            );
            assert!((linear_v + state.hysteretic_v - u).abs() < 1e-9);
        }
    }

    #[test]
    fn charge_that_is_held_leaks() {
        let model = Electromechanical {
            leakage_ohm: 1e6,
            elements: vec![(1e-5, f64::INFINITY)],
            ..piezo()
        };
        let mut state = ElectromechanicalState::virgin(&model);
        let first = state.step(Drive::Charge(1e-4), 0.0, 1e-3);
        let mut last = first;
        (0..2000).for_each(|_| last = state.step(Drive::Charge(1e-4), 0.0, 1e-3));
        // Without slip the two capacitances are in series behind the resistance: a first-order lag.
        let series_f = 1.0
            / (1.0 / 1e-5
                + 1.0 / (model.capacitance_f + model.ratio_n_v.powi(2) / model.stiffness_n_m));
        let expected = (-2.0 / (1e6 * series_f)).exp();
        assert!(
            (last / first - expected).abs() < 2e-3,
            "{} {expected}",
            last / first
        );
    }
}

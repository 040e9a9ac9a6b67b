//! Which column is what: as specified, else by names and units, else by behaviour; a note reports every
//! assumption.

use super::behaviour::{
    correlation, counts_samples, drive_among, is_constant, noise_share, rises_evenly,
};
use super::column_rules::{ColumnName, ColumnRules};
use super::table::{Column, Table};
use super::units::{
    Quantity, SignalUnits, factor, has_own_unit, is_of_counts, is_of_something_else, is_voltage,
    own_unit,
};
use crate::error::{Error, Result};
use hysteron_sim::effect::AuxiliarySignal;

/// The signals of a record in the program's units.
#[derive(Clone, Debug)]
pub struct RecordedSignals {
    /// Time, s.
    pub t_s: Option<Vec<f64>>,
    /// Drive, V.
    pub u_v: Vec<f64>,
    /// Displacement, um.
    pub y_um: Vec<f64>,
    /// Time of the displacement, s, where it has one of its own.
    pub t_of_y_s: Option<Vec<f64>>,
    /// Force, N.
    pub force_n: Option<Vec<f64>>,
    /// Further signals, as the file has them.
    pub auxiliary: Vec<AuxiliarySignal>,
    /// The units of drive and displacement.
    pub units: SignalUnits,
    /// What was assumed.
    pub notes: Vec<String>,
}

/// How a column came to be a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum How {
    Said,
    Name,
    Behaviour,
}

#[derive(Clone, Copy, Debug)]
struct Found {
    at: usize,
    how: How,
}

/// The largest magnitude of a signal whose unit nobody knows.
const LARGEST_SIGNAL: f64 = 1e12;
/// Two signals whose times differ by less than so many samples are channels that are read one after the
/// other.
const CHANNELS_IN_TURN: f64 = 2.0;

/// The signals of a record.
///
/// # Errors
/// A column that is not there, with the nearest name; a unit that is not known; columns that cannot be
/// distinguished.
pub fn signals(table: &Table, wanted: &ColumnRules) -> Result<RecordedSignals> {
    let mut choice = Choice {
        table,
        found: [None; 4],
        auxiliary: Vec::new(),
        notes: table.notes.clone(),
    };
    for (name, column) in &wanted.auxiliary {
        let at = table.place_of(column, &format!("--auxiliary or [record.auxiliary] {name}"))?;
        if hysteron_sim::effect::expression::is_given(name) {
            return Err(
                choice.wrong(format!("--auxiliary or [record.auxiliary] {name}: expressions know that name already; expected another"))
            );
        }
        if let Some(row) = table.columns[at]
            .values
            .iter()
            .position(|v| v.abs() > LARGEST_SIGNAL)
        {
            return Err(choice.wrong(format!(
                "row {}, {}: {:e}; expected at most {LARGEST_SIGNAL:e}",
                table.line_of(row),
                table.columns[at].called(),
                table.columns[at].values[row]
            )));
        }
        choice.auxiliary.push(at);
    }
    for quantity in Quantity::ALL {
        choice.found[quantity as usize] = choice.said(quantity, wanted.columns.get(quantity))?;
    }
    choice.time_by_name_or_behaviour();
    choice.force_by_name();
    choice.drive_and_response()?;
    choice.finish(wanted)
}

/// Time and drive of a file that need not have a displacement, with what was assumed.
///
/// # Errors
/// When either column is missing.
pub fn time_and_drive(table: &Table, wanted: &ColumnRules) -> Result<(Vec<f64>, Vec<f64>)> {
    let mut choice = Choice {
        table,
        found: [None; 4],
        auxiliary: Vec::new(),
        notes: Vec::new(),
    };
    for quantity in Quantity::ALL {
        choice.found[quantity as usize] = choice.said(quantity, wanted.columns.get(quantity))?;
    }
    choice.time_by_name_or_behaviour();
    if choice.of(Quantity::Drive).is_none() {
        let best = choice
            .by_name(Quantity::Drive)
            .first()
            .copied()
            .or_else(|| choice.unused().first().copied());
        choice.found[Quantity::Drive as usize] = best.map(|at| Found { at, how: How::Name });
    }
    let pick = |quantity: Quantity| -> Result<Vec<f64>> {
        let found = choice.of(quantity);
        let at = found
            .ok_or_else(|| {
                Error::new(
                    &table.place,
                    format!("no column for {}; expected t and u", quantity.key()),
                )
            })?
            .at;
        choice.scaled(quantity, at, wanted)
    };
    Ok((pick(Quantity::Time)?, pick(Quantity::Drive)?))
}

/// Whether a column is a temperature by its name or its unit.
fn is_temperature(column: &Column) -> bool {
    let by_unit = |unit: &str| ["°c", "degc", "celsius"].contains(&unit.to_lowercase().as_str());
    let name = column.name.to_lowercase();
    let mut words = name.split(|c: char| !c.is_alphanumeric());
    words.any(|word| ["temp", "temperature"].contains(&word))
        || column.unit.as_deref().is_some_and(by_unit)
}

struct Choice<'a> {
    table: &'a Table,
    found: [Option<Found>; 4],
    /// Columns that were said to be further signals, in the order of their names.
    auxiliary: Vec<usize>,
    notes: Vec<String>,
}

impl Choice<'_> {
    fn of(&self, quantity: Quantity) -> Option<Found> {
        self.found[quantity as usize]
    }

    fn column(&self, at: usize) -> &Column {
        &self.table.columns[at]
    }

    fn wrong(&self, message: String) -> Error {
        Error::new(&self.table.place, message)
    }

    fn is_used(&self, at: usize) -> bool {
        self.auxiliary.contains(&at) || self.found.iter().flatten().any(|found| found.at == at)
    }

    /// What was specified for a column.
    fn said(&self, quantity: Quantity, wanted: Option<&ColumnName>) -> Result<Option<Found>> {
        let key = quantity.key();
        let Some(wanted) = wanted else {
            return Ok(None);
        };
        let at = self
            .table
            .place_of(wanted, &format!("--columns or [record.columns] {key}"))?;
        if self.auxiliary.contains(&at) {
            return Err(self.wrong(format!(
                "{} is specified as {key} and as auxiliary; expected one of them",
                self.column(at).called()
            )));
        }
        if let Some(other) = self
            .found
            .iter()
            .position(|found| found.is_some_and(|f| f.at == at))
        {
            let other = Quantity::ALL[other].key();
            return Err(self.wrong(format!(
                "{} is specified as {other} and as {key}; expected one of them",
                self.column(at).called()
            )));
        }
        Ok(Some(Found { at, how: How::Said }))
    }

    /// The column of this name or number; `said` is where it was asked for.
    /// Columns that could be a quantity by name and unit, the likeliest first; those that are as likely
    /// follow in the order of the file.
    fn by_name(&self, quantity: Quantity) -> Vec<usize> {
        let likeness =
            |at: usize| quantity.likeness(&self.column(at).name, self.column(at).unit.as_deref());
        let free =
            (0..self.table.columns.len()).filter(|at| !self.is_used(*at) && likeness(*at) > 0);
        let mut candidates: Vec<usize> = free.collect();
        candidates.sort_by_key(|at| std::cmp::Reverse(likeness(*at)));
        candidates
    }

    fn unused(&self) -> Vec<usize> {
        let is_signal = |at: &usize| {
            let column = self.column(*at);
            !self.is_used(*at)
                && !is_of_something_else(column.unit.as_deref())
                && !is_constant(&column.values)
        };
        (0..self.table.columns.len()).filter(is_signal).collect()
    }

    fn time_by_name_or_behaviour(&mut self) {
        if self.of(Quantity::Time).is_some() {
            return;
        }
        let named = self.by_name(Quantity::Time);
        let rising: Vec<usize> = (0..self.table.columns.len())
            .filter(|at| !self.is_used(*at) && rises_evenly(&self.column(*at).values))
            .collect();
        let may_be_time = |at: &usize| {
            let column = self.column(*at);
            let otherwise = [Quantity::Drive, Quantity::Force]
                .iter()
                .any(|q| q.likeness(&column.name, column.unit.as_deref()) > 0);
            let y = Quantity::Displacement.likeness(&column.name, column.unit.as_deref());
            // `X` and `x-axis` are what oscilloscopes call time.
            !otherwise
                && (y == 0
                    || (column.unit.is_none() && column.name.to_lowercase().starts_with('x')))
        };
        let by_behaviour = || {
            let candidates: Vec<usize> = rising.iter().copied().filter(may_be_time).collect();
            candidates
                .iter()
                .copied()
                .find(|at| !counts_samples(&self.column(*at).values))
                .or(candidates.first().copied())
        };
        let found = match named.first() {
            Some(&at) => Some(Found { at, how: How::Name }),
            None => by_behaviour().map(|at| Found {
                at,
                how: How::Behaviour,
            }),
        };
        if let Some(at) = found.filter(|f| f.how == How::Behaviour).map(|f| f.at)
            && self.column(at).unit.is_none()
            && counts_samples(&self.column(at).values)
        {
            self.notes.push(format!(
                "{} counts samples and is no time",
                self.column(at).called()
            ));
            return;
        }
        self.found[Quantity::Time as usize] = found;
    }

    fn force_by_name(&mut self) {
        if self.of(Quantity::Force).is_none() {
            // What is called a drive or a displacement and is a force drives the stage, or is read of it.
            let called_otherwise = |at: &usize| {
                let likeness = |quantity: Quantity| quantity.likeness(&self.column(*at).name, None);
                likeness(Quantity::Drive).max(likeness(Quantity::Displacement))
                    > likeness(Quantity::Force)
            };
            let best = self
                .by_name(Quantity::Force)
                .into_iter()
                .find(|at| !called_otherwise(at));
            // Something else by its name: `load` may also be the load of a processor.
            self.found[Quantity::Force as usize] = best.map(|at| Found { at, how: How::Name });
        }
    }

    /// Drive and displacement, together: what one is narrows down what the other may be.
    fn drive_and_response(&mut self) -> Result<()> {
        let alone = |choice: &Self, quantity: Quantity| -> Option<usize> {
            let named = choice.by_name(quantity);
            let likeness = |at: usize| {
                quantity.likeness(&choice.column(at).name, choice.column(at).unit.as_deref())
            };
            match named[..] {
                [] => None,
                [only] => Some(only),
                [best, next, ..] => (likeness(best) > likeness(next)).then_some(best),
            }
        };
        self.force_as_response();
        // What is sure by its name goes first; a sensor in volts is no second drive.
        for quantity in [
            Quantity::Displacement,
            Quantity::Drive,
            Quantity::Displacement,
        ] {
            if self.of(quantity).is_none()
                && let Some(at) = alone(self, quantity)
            {
                self.found[quantity as usize] = Some(Found { at, how: How::Name });
            }
        }
        match (self.of(Quantity::Drive), self.of(Quantity::Displacement)) {
            (Some(_), Some(_)) => {}
            (Some(drive), None) => self.companion(Quantity::Displacement, drive.at)?,
            (None, Some(response)) => self.companion(Quantity::Drive, response.at)?,
            (None, None) => self.pair()?,
        }
        self.say_contradiction();
        Ok(())
    }

    /// Of a displacement and a force alone, as of a damper on a testing machine, one drives and the other is
    /// read.
    fn force_as_response(&mut self) {
        let (Some(force), None, None) = (
            self.of(Quantity::Force),
            self.of(Quantity::Drive),
            self.of(Quantity::Displacement),
        ) else {
            return;
        };
        // A drive that stands still is one all the same.
        if !self.by_name(Quantity::Drive).is_empty() {
            return;
        }
        let [other] = self.unused()[..] else { return };
        let judged = drive_among(&self.column(other).values, &self.column(force.at).values);
        let (drive, response) = if judged.first_is_drive {
            (other, force.at)
        } else {
            (force.at, other)
        };
        self.found[Quantity::Force as usize] = None;
        self.found[Quantity::Drive as usize] = Some(Found {
            at: drive,
            how: How::Behaviour,
        });
        self.found[Quantity::Displacement as usize] = Some(Found {
            at: response,
            how: How::Behaviour,
        });
        self.notes.push(format!(
            "{}{} drives, because {}; {} is read",
            if judged.is_sure { "" } else { "doubtful: " },
            self.column(drive).called(),
            judged.why,
            self.column(response).called()
        ));
    }

    /// What could be a quantity: by name if any, else whatever is left that moves and is no time.
    fn candidates(&self, quantity: Quantity) -> Vec<usize> {
        let named = self.by_name(quantity);
        if named.is_empty() {
            self.unused()
                .into_iter()
                .filter(|at| !rises_evenly(&self.column(*at).values))
                .collect()
        } else {
            named
        }
    }

    /// The column that moves with a known one: the closest, and of drives that are as close the smoothest.
    fn companion(&mut self, quantity: Quantity, known: usize) -> Result<()> {
        let candidates = self.candidates(quantity);
        let named = !self.by_name(quantity).is_empty();
        let with =
            |at: usize| correlation(&self.column(at).values, &self.column(known).values).abs();
        let rank = |at: &usize| {
            let close = (with(*at) * 20.0).round();
            let smooth = if quantity == Quantity::Drive {
                -noise_share(&self.column(*at).values)
            } else {
                0.0
            };
            (close, smooth)
        };
        // Of equals the first.
        let best = candidates.iter().copied().rev().max_by(|a, b| {
            let (a, b) = (rank(a), rank(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let Some(best) = best else {
            return Err(self.missing(quantity));
        };
        if candidates.len() > 1 {
            let others: Vec<String> = candidates
                .iter()
                .filter(|at| **at != best)
                .map(|at| self.column(*at).called_with_number())
                .collect();
            self.notes.push(format!(
                "{} columns may be the {}: {} is taken (correlation {:.3} with {}), not {}",
                candidates.len(),
                quantity.words(),
                self.column(best).called_with_number(),
                with(best),
                self.column(known).called(),
                others.join(", ")
            ));
        }
        self.found[quantity as usize] = Some(Found {
            at: best,
            how: if named { How::Name } else { How::Behaviour },
        });
        Ok(())
    }

    /// Two columns of which neither is known: those that move together most, and which of them leads.
    fn pair(&mut self) -> Result<()> {
        let (drives, responses) = (
            self.candidates(Quantity::Drive),
            self.candidates(Quantity::Displacement),
        );
        let pairs = drives
            .iter()
            .flat_map(|&u| responses.iter().map(move |&y| (u, y)))
            .filter(|(u, y)| u != y);
        let close = |pair: &(usize, usize)| {
            correlation(&self.column(pair.0).values, &self.column(pair.1).values).abs()
        };
        let pair = pairs.min_by(|a, b| {
            (close(b) * 100.0)
                .round()
                .total_cmp(&(close(a) * 100.0).round())
        });
        let Some((first, second)) = pair else {
            return Err(self.missing(if drives.is_empty() {
                Quantity::Drive
            } else {
                Quantity::Displacement
            }));
        };
        let by_name = !self.by_name(Quantity::Drive).is_empty()
            && !self.by_name(Quantity::Displacement).is_empty();
        let judged = drive_among(&self.column(first).values, &self.column(second).values);
        let (u, y) = if judged.first_is_drive || by_name {
            (first, second)
        } else {
            (second, first)
        };
        let how = if by_name { How::Name } else { How::Behaviour };
        self.found[Quantity::Drive as usize] = Some(Found { at: u, how });
        self.found[Quantity::Displacement as usize] = Some(Found { at: y, how });
        if !by_name {
            self.notes.push(format!(
                "{}{} is taken for the drive, because {}; {} for the displacement",
                if judged.is_sure { "" } else { "doubtful: " },
                self.column(u).called(),
                judged.why,
                self.column(y).called()
            ));
        }
        let left: Vec<String> = self
            .unused()
            .iter()
            .map(|at| self.column(*at).called())
            .collect();
        if !left.is_empty() {
            self.notes.push(format!("left aside: {}", left.join(", ")));
        }
        Ok(())
    }

    /// Names may be wrong: what moves first and is smooth is a drive, whatever it is called.
    fn say_contradiction(&mut self) {
        let (Some(u), Some(y)) = (self.of(Quantity::Drive), self.of(Quantity::Displacement)) else {
            return;
        };
        if u.how == How::Behaviour
            || y.how == How::Behaviour
            || (u.how == How::Said && y.how == How::Said)
        {
            return;
        }
        let judged = drive_among(&self.column(u.at).values, &self.column(y.at).values);
        if judged.is_sure && !judged.first_is_drive && judged.why.contains(" and ") {
            self.notes.push(format!(
                "{} is taken for the drive by its name, but {} behaves like one: {}; are they exchanged?",
                self.column(u.at).called(),
                self.column(y.at).called(),
                judged.why
            ));
        }
    }

    fn missing(&self, quantity: Quantity) -> Error {
        let names: Vec<String> = self.table.columns.iter().map(Column::called).collect();
        // What holds text in places is left aside, and may be the one.
        let aside: Vec<&str> = self
            .notes
            .iter()
            .filter(|note| note.contains("holds no numbers"))
            .map(String::as_str)
            .collect();
        self.wrong(format!(
            "no column for {} ({}) found among {} of numbers ({}){}{}; say which: --columns t=1,u=2,y=3, or [record.columns] in dataset.toml",
            quantity.key(),
            quantity.words(),
            names.len(),
            names.join(", "),
            if aside.is_empty() { "" } else { "; " },
            aside.join("; ")
        ))
    }

    /// A column in the program's unit.
    fn scaled(&self, quantity: Quantity, at: usize, wanted: &ColumnRules) -> Result<Vec<f64>> {
        let factor = self.factor(quantity, at, wanted)?;
        let column = self.column(at);
        let values: Vec<f64> = column.values.iter().map(|v| v * factor).collect();
        let limit = quantity.largest();
        match values.iter().position(|v| v.is_nan() || v.abs() > limit) {
            None => Ok(values),
            Some(row) => Err(self.wrong(format!(
                "row {}, {}: {:e} {unit} for the {}; expected at most {limit:e} {unit}: are column and unit right?",
                self.table.line_of(row),
                column.called(),
                values[row],
                quantity.words(),
                unit = quantity.unit()
            ))),
        }
    }

    fn factor(&self, quantity: Quantity, at: usize, wanted: &ColumnRules) -> Result<f64> {
        let column = self.column(at);
        let scale = wanted.scale.get(quantity).copied();
        let unit = wanted.unit.get(quantity);
        let of_unit = match (unit, &column.unit, scale) {
            (Some(unit), Some(own), _) if is_of_counts(unit) => {
                return Err(self.wrong(format!(
                    "{}: \"{unit}\" said of a column in {own}; expected a unit, or a sensitivity such as {unit}/V of a sensor in volts",
                    column.called()
                )));
            }
            (Some(unit), ..) if has_own_unit(quantity, unit) => self.own_unit(at, unit).1,
            (None, Some(unit), None) if has_own_unit(quantity, unit) => {
                // The channel of an oscilloscope reads a sensor; what is called an output is one.
                if quantity == Quantity::Displacement
                    && is_voltage(unit)
                    && quantity.likeness(&column.name, None) == 0
                {
                    return Err(self.wrong(format!(
                        "{} is the displacement in volts; what a volt means is needed: --units y=5um/V for 5 um per volt, or unit = {{ y = \"5 \
                         um/V\" }} in dataset.toml; --units y=V to keep volts",
                        column.called()
                    )));
                }
                self.own_unit(at, unit).1
            }
            (Some(unit), ..) => factor(quantity, unit, &self.table.place, &column.called())?,
            // A factor alone brings any unit to the program's.
            (None, Some(unit), Some(_)) => {
                factor(quantity, unit, &self.table.place, &column.called()).unwrap_or(1.0)
            }
            (None, Some(unit), None) => {
                factor(quantity, unit, &self.table.place, &column.called())?
            }
            (None, None, _) => 1.0,
        };
        Ok(of_unit * scale.unwrap_or(1.0))
    }

    /// The unit that a column which is no voltage, or no length, keeps, and the factor to it.
    fn own_unit(&self, at: usize, unit: &str) -> (String, f64) {
        own_unit(
            unit,
            crate::statistics::peak_to_peak(&self.column(at).values),
        )
    }

    /// The unit in which a signal is kept.
    fn unit_of(&self, quantity: Quantity, at: usize, wanted: &ColumnRules) -> String {
        let said = wanted.unit.get(quantity).or(self
            .column(at)
            .unit
            .as_ref()
            .filter(|_| wanted.scale.get(quantity).is_none()));
        match said {
            Some(unit) if has_own_unit(quantity, unit) => self.own_unit(at, unit).0,
            _ => quantity.unit().to_owned(),
        }
    }

    /// Says what was assumed, and hands the signals over.
    fn finish(mut self, wanted: &ColumnRules) -> Result<RecordedSignals> {
        let taken: Vec<(Quantity, Found)> = Quantity::ALL
            .into_iter()
            .filter_map(|q| Some((q, self.of(q)?)))
            .collect();
        let unit_is_open = |(quantity, found): &(Quantity, Found)| {
            let column = self.column(found.at);
            column.unit.is_none()
                && wanted.unit.get(*quantity).is_none()
                && wanted.scale.get(*quantity).is_none()
        };
        let plain = |found: &Found| found.how != How::Behaviour;
        let assumed = taken.iter().any(|(_, found)| !plain(found))
            || taken.iter().any(unit_is_open)
            || !self.notes.is_empty();
        let foreign = taken.iter().any(|(q, f)| {
            self.factor(*q, f.at, wanted)
                .is_ok_and(|factor| factor != 1.0)
        });
        if assumed || foreign {
            let parts: Vec<String> = taken
                .iter()
                .map(|pair| {
                    let (quantity, found) = pair;
                    let column = self.column(found.at);
                    let said = wanted.unit.get(*quantity).cloned();
                    let unit = match (said, &column.unit) {
                        (Some(said), _) => format!(" in {said}"),
                        (None, _) if unit_is_open(pair) => {
                            format!(", unit not said: taken as {}", quantity.unit())
                        }
                        _ => String::new(),
                    };
                    let how = if found.how == How::Behaviour && *quantity == Quantity::Time {
                        ", rising evenly"
                    } else {
                        ""
                    };
                    let called = column.called_with_number();
                    format!("{} = {called}{how}{unit}", quantity.key())
                })
                .collect();
            let by_number: Vec<String> = taken
                .iter()
                .map(|(q, found)| format!("{}={}", q.key(), self.column(found.at).number))
                .collect();
            // The note gives what was recognised, so that a line that is copied changes nothing.
            self.notes.push(format!(
                "columns: {}; to say it otherwise: --columns {} (and --units, as u=V,y=um), or columns and unit in dataset.toml",
                parts.join("; "),
                by_number.join(",")
            ));
        }
        let (Some(u), Some(y)) = (self.of(Quantity::Drive), self.of(Quantity::Displacement)) else {
            return Err(self.missing(Quantity::Drive));
        };
        if y.how != How::Said {
            self.note_other_sensors(y.at);
        }
        self.note_temperatures();
        let t_of_y_s = self.second_time(y.at, wanted)?;
        let t_s = self
            .of(Quantity::Time)
            .map(|t| self.scaled(Quantity::Time, t.at, wanted))
            .transpose()?;
        let force_n = self
            .of(Quantity::Force)
            .map(|f| self.scaled(Quantity::Force, f.at, wanted))
            .transpose()?;
        let named = wanted.auxiliary.keys().zip(&self.auxiliary);
        let auxiliary = named
            .map(|(name, at)| AuxiliarySignal {
                name: name.clone(),
                values: self.column(*at).values.clone(),
            })
            .collect();
        let units = SignalUnits {
            drive: self.unit_of(Quantity::Drive, u.at, wanted),
            reading: self.unit_of(Quantity::Displacement, y.at, wanted),
        };
        if units.reading != Quantity::Displacement.unit() {
            self.notes.push(format!(
                "{} is no displacement: it is kept in {}; for a sensor whose volts mean micrometres: --units y=5um/V",
                self.column(y.at).called(),
                units.reading
            ));
        }
        let signals = RecordedSignals {
            auxiliary,
            units,
            u_v: self.scaled(Quantity::Drive, u.at, wanted)?,
            y_um: self.scaled(Quantity::Displacement, y.at, wanted)?,
            t_s,
            t_of_y_s,
            force_n,
            notes: std::mem::take(&mut self.notes),
        };
        self.check_lengths(&signals)?;
        Ok(signals)
    }

    /// Columns that are called a displacement too, where no note names them yet.
    fn note_other_sensors(&mut self, y: usize) {
        for at in self.by_name(Quantity::Displacement) {
            let other = self.column(at).called();
            if !is_constant(&self.column(at).values)
                && !self.notes.iter().any(|n| n.contains(&other))
            {
                self.notes.push(format!(
                    "{other} may be the displacement as well: {} is taken; to take the other: --columns y={}",
                    self.column(y).called(),
                    self.column(at).number
                ));
            }
        }
    }

    fn note_temperatures(&mut self) {
        let is_free = |at: &usize| !self.is_used(*at);
        let free = (0..self.table.columns.len()).filter(is_free);
        let found = free.map(|at| self.column(at)).filter(|c| is_temperature(c));
        let notes: Vec<String> = found
            .map(|column| {
                format!(
                    "{} looks like a temperature; --auxiliary temperature={} gives it to effects of your own",
                    column.called(),
                    column.number
                )
            })
            .collect();
        self.notes.extend(notes);
    }

    /// The time column that stands before the displacement, where it is another than that of the drive
    /// (oscilloscopes with two channels).
    fn second_time(&mut self, y: usize, wanted: &ColumnRules) -> Result<Option<Vec<f64>>> {
        let (Some(t), Some(u)) = (self.of(Quantity::Time), self.of(Quantity::Drive)) else {
            return Ok(None);
        };
        let others: Vec<usize> = (0..self.table.columns.len())
            .filter(|at| !self.is_used(*at) && rises_evenly(&self.column(*at).values))
            .filter(|at| self.column(*at).values.len() == self.column(y).values.len())
            .filter(|at| {
                !counts_samples(&self.column(*at).values)
                    || counts_samples(&self.column(t.at).values)
            })
            .filter(|at| {
                self.column(*at).unit.is_none()
                    || Quantity::Time.likeness("", self.column(*at).unit.as_deref()) > 0
            })
            .collect();
        let before = others.iter().copied().rfind(|at| *at < y);
        let Some(second) = before.or(others.first().copied()) else {
            return Ok(None);
        };
        let (first, mut of_u) = (self.scaled(Quantity::Time, t.at, wanted)?, t.at);
        // The time of a signal stands before it.
        let (mut time_u, mut time_y) = (first, self.scaled(Quantity::Time, second, wanted)?);
        if y < second && second < u.at {
            std::mem::swap(&mut time_u, &mut time_y);
            of_u = second;
        }
        let step = (time_u[time_u.len() - 1] - time_u[0]) / (time_u.len() - 1).max(1) as f64;
        let same = time_u.len() == time_y.len()
            && time_u
                .iter()
                .zip(&time_y)
                .all(|(a, b)| (a - b).abs() < 0.01 * step);
        let (a, b) = (
            self.column(of_u).called(),
            self.column(if of_u == second { t.at } else { second })
                .called(),
        );
        if same {
            self.notes
                .push(format!("two columns of time that agree: {a}, {b}"));
            return Ok(None);
        }
        // A scope writes the time of a signal before it. Where no signal stands between two columns of time
        // and they are apart by the same on every row, rows were counted from two moments, as seconds from
        // the start and of the day; less than a sample or two apart are channels that are read in turn.
        let between = |signal: usize| (signal > t.at.min(second)) && (signal < t.at.max(second));
        let apart = time_y[0] - time_u[0];
        let by_the_same = time_u.len() == time_y.len()
            && time_u
                .iter()
                .zip(&time_y)
                .all(|(u, y)| (y - u - apart).abs() < 0.01 * step);
        if by_the_same && apart.abs() >= CHANNELS_IN_TURN * step && !between(u.at) && !between(y) {
            self.notes.push(format!("two columns of time of one clock, {apart:.6} s apart on every row: {a} is taken, {b} not"));
            return Ok(None);
        }
        self.found[Quantity::Time as usize] = Some(Found {
            at: of_u,
            how: How::Behaviour,
        });
        self.notes.push(format!("two columns of time: {a} for the drive, {b} for the displacement, which is interpolated to the first"));
        Ok(Some(time_y))
    }

    fn check_lengths(&self, signals: &RecordedSignals) -> Result<()> {
        let samples = signals.u_v.len();
        let lengths = [
            (Quantity::Time, signals.t_s.as_ref().map(Vec::len)),
            (
                Quantity::Displacement,
                signals.t_of_y_s.is_none().then_some(signals.y_um.len()),
            ),
            (Quantity::Force, signals.force_n.as_ref().map(Vec::len)),
        ];
        if let Some(signal) = signals
            .auxiliary
            .iter()
            .find(|signal| signal.values.len() != samples)
        {
            return Err(self.wrong(format!(
                "the drive has {samples} numbers, {} {}; expected as many",
                signal.name,
                signal.values.len()
            )));
        }
        for (quantity, length) in lengths {
            if let Some(length) = length.filter(|length| *length != samples) {
                return Err(self.wrong(format!(
                    "the drive has {samples} numbers, the {} {length}; expected as many (is the file cut off?)",
                    quantity.words()
                )));
            }
        }
        Ok(())
    }
}

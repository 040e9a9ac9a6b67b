//! The picture of its own kind for each effect: creep over the time since the drive stopped, a sensor's
//! nonlinearity over the displacement on both branches, a line over frequency, and so on.
//!
//! [`View`] says which abscissa shows an effect best; the traces are averaged over it, so that noise falls
//! away and a law stands out.

use super::explain_report::{EvidenceReport, EvidenceTrace, RecordReport};
use super::page::{CurveRole, PageBlock, Plot, Series, Width};
use super::text::{effect_words, percent, role_words};
use hysteron::diagnosis::residual_map::{Branch, branches};
use hysteron::spectrum::amplitude_density;
use hysteron_sim::effect::Against;

/// At most this many records are drawn for an effect.
const MOST_RECORDS: usize = 6;
/// Bins of the averages.
const BINS: usize = 60;
/// At most this many holds are drawn in one plot.
const MOST_HOLDS: usize = 6;
/// Bins over time, where structure is finer.
const TIME_BINS: usize = 280;

/// The abscissa that shows an effect best.
#[derive(Clone, Copy, Debug, PartialEq)]
enum View {
    /// Logarithm of the time since the last turn, while the drive stands still.
    TimeHeld,
    /// Logarithm of the time since the last turn.
    TimeSinceTurn,
    /// Drive, by branch.
    Drive,
    /// Displacement, by branch.
    Displacement,
    /// Where the modelled reading lies within a step of the converter.
    WithinStep {
        /// The step, um.
        step_um: f64,
    },
    /// Signed rate of the drive.
    Rate,
    /// Measured external force.
    Force,
    /// Plain time.
    Time,
    /// Frequency.
    Frequency,
}

impl View {
    fn of(evidence: &EvidenceReport) -> Self {
        match evidence.against {
            Against::TimeHeld => Self::TimeHeld,
            Against::TimeSinceTurn => Self::TimeSinceTurn,
            Against::Drive => Self::Drive,
            Against::Displacement => Self::Displacement,
            Against::WithinStep => Self::WithinStep {
                step_um: evidence.reading_step_um,
            },
            Against::Rate => Self::Rate,
            Against::Force => Self::Force,
            Against::Time => Self::Time,
            Against::Frequency => Self::Frequency,
        }
    }

    fn axis(self) -> (&'static str, &'static str, bool) {
        match self {
            Self::TimeHeld => ("time since the drive stopped", "s", true),
            Self::TimeSinceTurn => ("time since the last turn", "s", true),
            Self::Drive => ("drive", "V", false),
            Self::Displacement => ("displacement", "um", false),
            Self::WithinStep { .. } => ("modelled reading from the middle of a step", "nm", false),
            Self::Rate => ("rate of the drive", "V/s", false),
            Self::Force => ("external force", "N", false),
            Self::Time => ("time", "s", false),
            Self::Frequency => ("frequency", "Hz", true),
        }
    }
}

/// The plots for one effect, records in which its signature moves most first.
pub(super) fn evidence_plots(
    evidence: &EvidenceReport,
    records: &[RecordReport],
) -> Vec<PageBlock> {
    let view = View::of(evidence);
    let power = |trace: &EvidenceTrace| trace.predicted_um.iter().map(|p| p * p).sum::<f64>();
    let mut traces: Vec<&EvidenceTrace> = evidence
        .traces
        .iter()
        .filter(|t| t.record < records.len() && power(t) > 0.0)
        .collect();
    traces.sort_by(|a, b| {
        let mean = |t: &EvidenceTrace| power(t) / t.predicted_um.len() as f64;
        mean(b).total_cmp(&mean(a))
    });
    let width = if traces.len() == 1 {
        Width::Full
    } else {
        Width::Half
    };
    traces
        .into_iter()
        .take(MOST_RECORDS)
        .enumerate()
        .map(|(number, trace)| {
            let record = &records[trace.record];
            let mut plot = trace_plot(view, trace, record);
            let over_time = plot.series.is_empty();
            if over_time {
                plot = trace_plot(View::Time, trace, record);
            }
            plot = plot.width(width).height_px(250);
            plot.title = format!(
                "{} in {} ({}): {} of the residual's power",
                effect_words(&evidence.effect),
                record.name,
                role_words(&record.role),
                percent(share(trace)),
            );
            if over_time {
                plot.caption = "Over time: the drive of this record does not show the effect in its own kind of picture.".to_owned();
            } else if number == 0 {
                plot.caption.clone_from(&evidence.caption);
            }
            PageBlock::Plot(plot)
        })
        .collect()
}

/// Share of the residual's power that the prediction takes away; not below zero.
fn share(trace: &EvidenceTrace) -> f64 {
    let pairs = || trace.residual_um.iter().zip(&trace.predicted_um);
    let before: f64 = pairs().map(|(r, _)| r * r).sum();
    let after: f64 = pairs().map(|(r, p)| (r - p) * (r - p)).sum();
    (1.0 - after / before).max(0.0)
}

fn trace_plot(view: View, trace: &EvidenceTrace, record: &RecordReport) -> Plot {
    let (label, unit, log) = view.axis();
    let mut plot = Plot::new("").x_axis(label, unit).log(log, false);
    let every_sample = trace.samples.is_empty() || trace.samples.len() == record.t_s.len();
    if view == View::Frequency && every_sample {
        let curve = |values: &[f64]| {
            let spectrum = amplitude_density(values, record.sample_rate_hz);
            let density = spectrum.density.iter().map(|d| 1e3 * d).collect();
            (spectrum.frequency_hz, density)
        };
        let (x, y) = curve(&trace.residual_um);
        plot.series.push(Series::points(
            "what the residual does",
            CurveRole::Residual,
            x,
            y,
        ));
        let (x, y) = curve(&trace.predicted_um);
        plot.series.push(Series::line(
            "what the signature predicts",
            CurveRole::Model,
            x,
            y,
        ));
        plot.y.log = true;
        return plot.y_axis("amplitude density", "nm/rtHz");
    }
    plot = plot.y_axis("residual", "nm");
    let low_v = record.u_v.iter().copied().fold(f64::INFINITY, f64::min);
    let high_v = record.u_v.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let branch = branches(&record.u_v, record.sample_rate_hz, high_v - low_v);
    let length = trace.residual_um.len().min(trace.predicted_um.len());
    let sample = |i: usize| {
        if every_sample {
            i
        } else {
            trace.samples.get(i).copied().unwrap_or(i)
        }
    };
    let abscissa = |i: usize| -> Option<f64> {
        let k = sample(i);
        let (_, age_s) = *branch.get(k)?;
        let u_v = *record.u_v.get(k)?;
        match view {
            View::TimeHeld | View::TimeSinceTurn => (age_s > 0.0).then(|| age_s.log10()),
            View::Drive => Some(u_v),
            View::Displacement => record.y_um.get(k).copied(),
            View::WithinStep { step_um } => {
                let modelled_um = record.y_um.get(k)? - trace.residual_um.get(i)?;
                Some(1e3 * (modelled_um - (modelled_um / step_um).round() * step_um))
            }
            View::Rate => Some((u_v - record.u_v[k.saturating_sub(1)]) * record.sample_rate_hz),
            View::Force => record.force_n.get(k).copied(),
            View::Time => record.t_s.get(k).copied(),
            View::Frequency => record.t_s.get(k).copied(),
        }
    };
    if view == View::Frequency {
        // Scattered samples have no spectrum; time is what is left.
        plot = plot.x_axis("time", "s").log(false, false);
    }
    let by_branch = matches!(view, View::Drive | View::Displacement);
    let groups: &[(&str, &[Branch], CurveRole, CurveRole)] = if by_branch {
        &[
            (
                ", first rise",
                &[Branch::FirstRise],
                CurveRole::Other3,
                CurveRole::Other3,
            ),
            (
                ", rising",
                &[Branch::Rising],
                CurveRole::Other1,
                CurveRole::Other1,
            ),
            (
                ", falling",
                &[Branch::Falling],
                CurveRole::Other2,
                CurveRole::Other2,
            ),
        ]
    } else {
        &[(
            "",
            &[
                Branch::FirstRise,
                Branch::Rising,
                Branch::Falling,
                Branch::Held,
            ],
            CurveRole::Residual,
            CurveRole::Model,
        )]
    };
    if view == View::TimeHeld {
        add_holds(&mut plot, trace, record, &branch, sample);
        return plot;
    }
    let over_time = matches!(view, View::Time | View::Frequency);
    let bins = if over_time { TIME_BINS } else { BINS };
    for &(name, on, dots, line) in groups {
        let chosen: Vec<(f64, usize)> = (0..length)
            .filter(|&i| branch.get(sample(i)).is_some_and(|(b, _)| on.contains(b)))
            .filter_map(|i| abscissa(i).filter(|x| x.is_finite()).map(|x| (x, i)))
            .collect();
        let (x, residual, predicted) = binned(&chosen, trace, bins, over_time);
        let x: Vec<f64> = if view == View::TimeSinceTurn {
            x.iter().map(|x| 10f64.powf(*x)).collect()
        } else {
            x
        };
        if x.is_empty() {
            continue;
        }
        plot.series.push(Series::points(
            format!(
                "{}{name}",
                if name.is_empty() {
                    "what the residual does"
                } else {
                    "residual"
                }
            ),
            dots,
            x.clone(),
            residual,
        ));
        plot.series.push(Series::line(
            format!(
                "{}{name}",
                if name.is_empty() {
                    "what the signature predicts"
                } else {
                    "signature"
                }
            ),
            line,
            x,
            predicted,
        ));
    }
    plot
}

/// One pair of curves for each of the longest holds: averaged over holds, steps up and steps down would
/// cancel.
fn add_holds(
    plot: &mut Plot,
    trace: &EvidenceTrace,
    record: &RecordReport,
    branch: &[(Branch, f64)],
    sample: impl Fn(usize) -> usize,
) {
    let length = trace.residual_um.len().min(trace.predicted_um.len());
    let mut holds: Vec<Vec<(f64, usize)>> = Vec::new();
    let mut level_v = f64::NAN;
    for i in 0..length {
        let k = sample(i);
        let (Some(&(on, age_s)), Some(&u_v)) = (branch.get(k), record.u_v.get(k)) else {
            continue;
        };
        if on != Branch::Held || !(age_s.is_finite() && age_s > 0.0) {
            level_v = f64::NAN;
        } else if u_v == level_v {
            if let Some(hold) = holds.last_mut() {
                hold.push((age_s.log10(), i));
            }
        } else {
            level_v = u_v;
            holds.push(vec![(age_s.log10(), i)]);
        }
    }
    holds.retain(|hold| hold.len() > BINS / 4);
    holds.sort_by_key(|hold| std::cmp::Reverse(hold.len()));
    for hold in holds.iter().take(MOST_HOLDS) {
        let (x, residual, predicted) = binned(hold, trace, BINS / 2, false);
        let x: Vec<f64> = x.iter().map(|x| 10f64.powf(*x)).collect();
        plot.series.push(Series::points(
            "what the residual does",
            CurveRole::Residual,
            x.clone(),
            residual,
        ));
        plot.series.push(Series::line(
            "what the signature predicts",
            CurveRole::Model,
            x,
            predicted,
        ));
    }
}

/// Samples in a bin on average from which an empty one is no accident: these samples are left out.
const FILLED: usize = 4;

/// Bin centres and the means of residual and prediction, nm, over the bins that hold samples. With `gaps`
/// not a number where samples are left out, so that lines end there.
fn binned(
    chosen: &[(f64, usize)],
    trace: &EvidenceTrace,
    bins: usize,
    gaps: bool,
) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let low = chosen.iter().map(|c| c.0).fold(f64::INFINITY, f64::min);
    let high = chosen.iter().map(|c| c.0).fold(f64::NEG_INFINITY, f64::max);
    let mut out = (Vec::new(), Vec::new(), Vec::new());
    if low >= high {
        return out;
    }
    let mut sums = vec![(0usize, 0.0, 0.0, 0.0); bins];
    for &(x, i) in chosen {
        let (r, p) = (trace.residual_um[i], trace.predicted_um[i]);
        if !(x.is_finite() && r.is_finite() && p.is_finite()) {
            continue;
        }
        let bin = (((x - low) / (high - low) * bins as f64) as usize).min(bins - 1);
        let sum = &mut sums[bin];
        *sum = (sum.0 + 1, sum.1 + x, sum.2 + r, sum.3 + p);
    }
    let gaps = gaps && chosen.len() >= FILLED * bins;
    for (bin, &(samples, x, r, p)) in sums.iter().enumerate() {
        if samples == 0 && gaps && sums[bin - 1].0 > 0 {
            out.0
                .push(low + (bin as f64 + 0.5) / bins as f64 * (high - low));
            out.1.push(f64::NAN);
            out.2.push(f64::NAN);
        }
        if samples > 0 {
            let samples = samples as f64;
            out.0.push(x / samples);
            out.1.push(1e3 * r / samples);
            out.2.push(1e3 * p / samples);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::effect::Effect;

    #[test]
    fn a_line_over_time_ends_where_samples_are_left_out() {
        let samples: Vec<usize> = (0..4000).filter(|k| !(1500..2500).contains(k)).collect();
        let over_time = |k: &usize| (*k as f64, *k);
        let chosen: Vec<(f64, usize)> = samples.iter().map(over_time).collect();
        let trace = EvidenceTrace {
            residual_um: vec![1.0; 4000],
            predicted_um: vec![1.0; 4000],
            ..EvidenceTrace::default()
        };
        let (x, _, predicted) = binned(&chosen, &trace, TIME_BINS, true);
        let gaps: Vec<f64> = (0..x.len())
            .filter(|i| predicted[*i].is_nan())
            .map(|i| x[i])
            .collect();
        assert!(
            matches!(gaps[..], [at] if (1500.0..2500.0).contains(&at)),
            "{gaps:?}"
        );
    }

    #[test]
    fn creep_is_drawn_over_the_logarithm_of_time_since_the_step() {
        let rate = 200.0;
        let u_v: Vec<f64> = (0..2000)
            .map(|k| if k < 100 { 0.0 } else { 30.0 })
            .collect();
        let law: Vec<f64> = (0..2000)
            .map(|k| {
                if k > 100 {
                    0.01 * (f64::from(k - 100) / rate).log10()
                } else {
                    0.0
                }
            })
            .collect();
        let record = RecordReport {
            name: "hold".into(),
            role: "validate".into(),
            sample_rate_hz: rate,
            t_s: (0..2000).map(|k| f64::from(k) / rate).collect(),
            y_um: u_v.clone(),
            u_v,
            ..RecordReport::default()
        };
        let creep = hysteron_sim::effect::creep::Creep::default()
            .declaration()
            .picture;
        let evidence = EvidenceReport {
            effect: "creep".into(),
            against: creep.against,
            caption: creep.caption.into(),
            reading_step_um: 0.0,
            traces: vec![EvidenceTrace {
                residual_um: law.clone(),
                predicted_um: law,
                ..EvidenceTrace::default()
            }],
        };
        let plots = evidence_plots(&evidence, &[record]);
        let PageBlock::Plot(plot) = &plots[0] else {
            panic!("a plot was expected");
        };
        assert!(plot.x.log);
        assert!(plot.title.contains("100 %"), "{}", plot.title);
        // The mean residual rises by 10 nm a decade.
        let late: Vec<(f64, f64)> = plot.series[0]
            .x
            .iter()
            .zip(&plot.series[0].y)
            .filter(|(x, _)| **x > 0.1)
            .map(|(x, y)| (x.log10(), *y))
            .collect();
        let (first, last) = (late[0], late[late.len() - 1]);
        let slope = (last.1 - first.1) / (last.0 - first.0);
        assert!((slope - 10.0).abs() < 0.5, "{slope}");
    }
}

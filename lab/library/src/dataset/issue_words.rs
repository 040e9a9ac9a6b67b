//! Issues in words: the one place where they become sentences.

use super::issue::{Issue, IssueKind};
use crate::phrases::{figure, list, nm};

/// An issue as a sentence without its full stop.
#[must_use]
pub fn sentence(issue: &Issue) -> String {
    let what = of_kind(&issue.kind);
    issue
        .record
        .as_ref()
        .map_or_else(|| what.clone(), |record| format!("{record}: {what}"))
}

/// A kind as a sentence without its full stop.
pub(crate) fn of_kind(kind: &IssueKind) -> String {
    match kind {
        IssueKind::NotAnswered { moves_um, coherence, by_chance } => format!(
            "the readings do not answer the drive (coherence {coherence:.2} at most, by chance up to {by_chance:.2}; they move by {} nm RMS). Look at the \
             sensor, the amplifier and the choice of columns (--columns)",
            nm(*moves_um)
        ),
        IssueKind::NothingInCommon { share } => format!(
            "drive and displacement have nothing in common: the model takes {:.2} % of the squares of the readings. Look at the sensor, the amplifier and \
             the choice of columns (--columns), and record 4000 samples or more",
            100.0 * share
        ),
        IssueKind::RangeEnds { reading_um, highest, share, .. } => format!(
            "{:.1} % of the readings stand at exactly {} um, their {}, while the drive moves: the range of the sensor ends there. They are left out \
             of every fit and figure",
            100.0 * share,
            figure(*reading_um),
            if *highest { "highest" } else { "lowest" }
        ),
        IssueKind::OutliersReplaced { samples: 1, first_sample, farthest_um } => format!(
            "1 reading stands alone, {farthest_um:.3} um beside its neighbours (sample {first_sample}). It is interpolated and counts in no figure"
        ),
        IssueKind::OutliersReplaced { samples, first_sample, farthest_um } => format!(
            "{samples} readings stand alone, up to {farthest_um:.3} um beside their neighbours (the first is sample {first_sample}). They are \
             interpolated and count in no figure"
        ),
        IssueKind::OutliersLeftOut { samples, places, first_sample, last_sample } => {
            let where_ = if first_sample == last_sample {
                format!("sample {first_sample}")
            } else {
                format!("samples {first_sample} to {last_sample}")
            };
            let more = match places - 1 {
                0 => String::new(),
                1 => ", and in one more place".into(),
                n => format!(", and in {n} more places"),
            };
            format!("readings stand out together, {where_}{more}. The {samples} there are left out of every fit and figure")
        }
        IssueKind::OutliersKept { samples, first_sample } => {
            format!("{samples} readings stand out (the first is sample {first_sample}), too many for disturbances. They are kept")
        }
        IssueKind::SameSampleTiming { not_needed, assumed_um, same_sample_um } => {
            let without = if not_needed.is_empty() { String::new() } else { format!(" without {}", list(not_needed, "and")) };
            format!(
                "displacement responds to the drive of the same row, so `hold_before_sample` is used (error {} nm{without} instead of {} nm). To \
                 override: --timing hold_after_sample",
                nm(*same_sample_um),
                nm(*assumed_um)
            )
        }
        IssueKind::RunsOnBetweenSamples { intersample, held_um, runs_on_um } => format!(
            "the drive is not held between its samples, so `{intersample}` is used (error {} nm instead of {} nm). To override: --intersample hold",
            nm(*runs_on_um),
            nm(*held_um)
        ),
        IssueKind::TimingInReadings { jumps } => {
            let how = match jumps {
                None => "y[k] follows u[k] much better than u[k-1]".to_owned(),
                Some(jumps) => format!("y[k] moves in the row in which u[k] jumps ({jumps} of them)"),
            };
            format!("{how}, so `hold_before_sample` is used. To override: timing = \"hold_after_sample\", --timing hold_after_sample")
        }
        IssueKind::LeadsTheDrive {} => {
            "y[k] follows u[k] much better than u[k-1], but a drive acts only after the sample at its instant. If y was read after u was \
             written, specify timing = \"hold_before_sample\""
                .into()
        }
        IssueKind::DisplacementUnit { span_um } if *span_um > 1.0 => {
            format!("the displacement spans {span_um:.0} um; is its column in another unit?")
        }
        IssueKind::DisplacementUnit { span_um } => format!("the displacement spans {span_um:.2e} um; is its column in another unit?"),
        IssueKind::Gain { gain_um_v } if *gain_um_v < 0.0 => {
            format!("the displacement falls where the drive rises ({gain_um_v:.3} um/V). Is the sign of a column inverted?")
        }
        IssueKind::Gain { gain_um_v } => {
            let units = if *gain_um_v < 1.0 { "u=mV, y=mm" } else { "u=kV, y=nm" };
            format!("the displacement changes by {} um/V. Is drive or displacement in another unit (--units {units})?", figure(*gain_um_v))
        }
        IssueKind::NotFollowed { from_s, to_s, parts } => {
            let others = if *parts > 1 { format!(", and in {} further parts", parts - 1) } else { String::new() };
            format!(
                "the readings no longer follow the drive from {from_s:.3} to {to_s:.3} s{others}: was the sensor's target lost, or a cable? They are left \
                 out of every fit and figure"
            )
        }
        IssueKind::GainDiffers { gain_um_v, fitted_um_v } => format!(
            "it answers its drive with {gain_um_v:.3e} um/V, what is fitted with {fitted_um_v:.3e} um/V. Is a column of it in another unit, or is its sign \
             inverted?"
        ),
        IssueKind::BeyondFitted { fitted_v: [low_v, high_v], share } => format!(
            "its drive leaves what was fitted, {low_v:.1} to {high_v:.1} V, in {:.0} % of its samples; the error there is that of an extrapolation",
            100.0 * share
        ),
        IssueKind::TimeUnit { period_s } => format!("samples come {period_s} s apart; is the column of time in another unit?"),
        IssueKind::InitialState { specified_um, unknown_um } => format!(
            "the record does not begin in the specified state: from there the error is {} nm, from an unknown state {} nm with the same effects. \
             Specify `initial_state = \"unknown\"`",
            nm(*specified_um),
            nm(*unknown_um)
        ),
        IssueKind::SensorOffset { specified_um, fitted_um } => format!(
            "the sensor's zero is off: the error is {} nm, with a fitted constant {} nm. Specify `offset = \"fit\"`",
            nm(*specified_um),
            nm(*fitted_um)
        ),
        IssueKind::SensorJump { at_s, by_um, .. } => format!(
            "the reading jumps {} by about {} nm at {at_s:.4} s and stays there: a target that slipped, or a counter that lost steps. The readings behind \
             it count without the jump; to keep them, end one record there and begin another (from_s, to_s)",
            if *by_um < 0.0 { "down" } else { "up" },
            nm(by_um.abs())
        ),
        IssueKind::RememberedHistory { until_s, left_s } => format!(
            "the record begins inside the range of its drive in an unknown state and has been through all of it after {until_s:.3} s. Until then its \
             loops remember what no sample shows. Begin with a cycle over the whole range{}",
            if left_s > until_s { ", or leave that time out (from_s)" } else { "" }
        ),
        IssueKind::ClosedLoop { later_samples, correlation, by_chance } => {
            let later = match later_samples {
                0 => "in the same sample".into(),
                1 => "one sample later".into(),
                n => format!("{n} samples later"),
            };
            format!(
                "the drive answers the noise of the readings {later} (correlation {correlation:.2}, by chance up to {by_chance:.2}): a loop was \
                 closed while recording, which biases the values towards its controller. Record with the loop open"
            )
        }
        IssueKind::GivenTwice { same_as } => format!(
            "holds the same readings as {same_as}, sample by sample. A recording given twice shows no noise and judges nothing; leave one out"
        ),
        IssueKind::RestWithoutNoise { in_steps: true } => {
            "all readings of this rest are one code of the converter: the noise is below its step".into()
        }
        IssueKind::RestWithoutNoise { in_steps: false } => {
            "all readings of this rest are the same and show no noise. It is left out".into()
        }
        IssueKind::NothingJudges {} => "no record has role = \"identify\": those to validate are fitted, and nothing judges".into(),
        IssueKind::NotAtRest { moves_v } => format!("role = \"noise\" expects a record at rest, but the drive moves by {moves_v:.3} V"),
        IssueKind::PeriodsDiffer { period_s, drive_v, differs_v } => format!(
            "period_s = {period_s} expects equal periods, but the drive, which moves by {drive_v:.3} V RMS, differs by {differs_v:.3} V RMS from one to \
             the next"
        ),
        IssueKind::RepeatDiffers { repeat_of, drive_v, differs_v } => format!(
            "repeat_of = \"{repeat_of}\" expects the same drive, but the drive, which moves by {drive_v:.3} V RMS, differs by {differs_v:.3} V RMS \
             between them"
        ),
    }
}

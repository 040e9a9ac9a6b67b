//! A trace of the target becomes a data set: the measurement that the next identification works from.
//!
//! # How it works
//! The raw bytes of the log channel are decoded with the image's own string table. Blocks of the trace are
//! checked one by one ([`hysteron_core::trace_frame`]); runs of ticks without a gap become records. The
//! target's drive code of tick k acts from tick k+1 on, so the data set's `u[k]` is the code of the tick
//! before. What is torn or foreign is counted and said; what was whole is kept.

use defmt_decoder::{DecodeError, Table};
use hysteron_core::trace_frame::{Channels, ReadBlock, TraceSample};

use crate::error::{Error, Result};

/// Least samples of a record; shorter runs between gaps are dropped.
const LEAST_SAMPLES: usize = 200;

/// Least samples at a constant drive that make a record of the noise.
const LEAST_REST_SAMPLES: usize = 2000;

/// Samples at a constant drive after which a run counts as begun at rest.
const SETTLED_SAMPLES: usize = 50;

/// What a capture came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CaptureSummary {
    /// Records written, with their samples.
    pub records: Vec<(String, usize)>,
    /// Ticks that the target lost because its queue was full.
    pub lost_on_target: u32,
    /// Gaps in the sequence of ticks.
    pub gaps: usize,
    /// Log frames that could not be decoded, and blocks that were damaged.
    pub damaged: usize,
}

/// The converters as the image reports them at start.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Converters {
    adc_step_um: f64,
    adc_zero_um: f64,
    dac_step_v: f64,
    dac_zero_v: f64,
    drive_min_v: f64,
    drive_max_v: f64,
    sample_rate_hz: f64,
}

impl Converters {
    /// From the line `converters ADC_ZERO ADC_STEP DAC_ZERO DAC_STEP CODE_MIN CODE_MAX RATE`, in the integers
    /// of the parameter block.
    fn from_line(line: &str) -> Option<Self> {
        let numbers: Vec<f64> = line
            .strip_prefix("converters ")?
            .split(' ')
            .map(|word| word.parse().ok())
            .collect::<Option<_>>()?;
        let [
            adc_zero,
            adc_step,
            dac_zero,
            dac_step,
            code_min,
            code_max,
            rate,
        ] = numbers.try_into().ok()?;
        let (dac_zero_v, dac_step_v) = (dac_zero / 2f64.powi(22), dac_step / 2f64.powi(38));
        Some(Self {
            adc_zero_um: adc_zero / 2f64.powi(24),
            adc_step_um: adc_step / 2f64.powi(40),
            dac_zero_v,
            dac_step_v,
            drive_min_v: dac_zero_v + code_min * dac_step_v,
            drive_max_v: dac_zero_v + code_max * dac_step_v,
            sample_rate_hz: rate,
        })
    }
}

/// One run of ticks without a gap.
struct Run {
    decimation: u16,
    samples: Vec<TraceSample>,
}

/// The files of a data set, by name.
pub type DatasetFiles = Vec<(String, Vec<u8>)>;

/// Decodes the bytes `raw` of a log by the image `elf` that wrote it into the files of a data set.
///
/// # Errors
/// The image has no string table, or the log holds no usable trace.
pub fn capture(elf: &[u8], raw: &[u8]) -> Result<(CaptureSummary, DatasetFiles)> {
    let table = Table::parse(elf)
        .map_err(|error| Error::new("image", format!("is no image with a log table: {error}")))?
        .ok_or_else(|| {
            Error::new(
                "image",
                "has no .defmt section; expected the image that was flashed",
            )
        })?;
    let mut summary = CaptureSummary::default();
    let (converters, runs) = decode(&table, raw, &mut summary);
    let converters = converters.ok_or_else(|| {
        Error::new(
            "log",
            "has no line `converters ..`: the log must begin with the target's start",
        )
    })?;
    let finest = runs
        .iter()
        .filter(|run| run.samples.len() >= LEAST_SAMPLES)
        .map(|run| run.decimation)
        .min();
    let Some(finest) = finest else {
        return Err(Error::new(
            "log",
            format!(
                "holds no run of {LEAST_SAMPLES} ticks without a gap ({} damaged)",
                summary.damaged
            ),
        ));
    };
    let rate_hz = converters.sample_rate_hz / f64::from(finest);
    let mut files = DatasetFiles::new();
    let mut manifest = format!(
        "name = \"capture\"\ndrive_min_v = {:?}\ndrive_max_v = {:?}\ntiming = \"hold_after_sample\"\nsensor_lsb_um = {:?}\n",
        converters.drive_min_v, converters.drive_max_v, converters.adc_step_um
    );
    let kept = runs
        .iter()
        .filter(|run| run.decimation == finest && run.samples.len() >= LEAST_SAMPLES);
    for (nth, run) in kept.enumerate() {
        let mut add = |name: String, text: String, samples: usize| {
            summary.records.push((name.clone(), samples));
            files.push((name, text.into_bytes()));
        };
        // What the run begins with at a constant drive shows the sensor's noise.
        let at_rest = run
            .samples
            .iter()
            .take_while(|sample| Some(sample.dac_code) == run.samples.first().map(|s| s.dac_code))
            .count();
        if at_rest >= LEAST_REST_SAMPLES {
            let name = format!("run_{}_noise.csv", nth + 1);
            let rest = Run {
                decimation: run.decimation,
                samples: run.samples.iter().take(at_rest).copied().collect(),
            };
            manifest.push_str(&format!(
                "\n[[record]]\nfile = \"{name}\"\nsample_rate_hz = {rate_hz:?}\nrole = \"noise\"\ninitial_state = \"settled\"\noffset = \"fit\"\n"
            ));
            add(name, csv(&rest, &converters, rate_hz), at_rest - 1);
        }
        // The last part validates; what lies before it still drives the model, so both records are the whole
        // run.
        let file = format!("run_{}.csv", nth + 1);
        let samples = run.samples.len() - 1;
        let middle_s = (samples as f64 * 0.6).floor() / rate_hz;
        let state = if at_rest >= SETTLED_SAMPLES.min(run.samples.len()) {
            "settled"
        } else {
            "unknown"
        };
        for (role, window) in [
            ("identify", format!("to_s = {middle_s:?}")),
            ("validate", format!("from_s = {middle_s:?}")),
        ] {
            manifest.push_str(&format!(
                "\n[[record]]\nfile = \"{file}\"\nname = \"run_{}_{role}\"\nsample_rate_hz = {rate_hz:?}\nrole = \"{role}\"\ninitial_state = \"{state}\"\noffset = \"fit\"\n{window}\n",
                nth + 1
            ));
        }
        add(file, csv(run, &converters, rate_hz), samples);
    }
    files.push(("dataset.toml".into(), manifest.into_bytes()));
    Ok((summary, files))
}

/// Columns t, u, y: `u[k]` acts from `t[k]` on, so it is the code that was computed one tick earlier.
fn csv(run: &Run, c: &Converters, rate_hz: f64) -> String {
    let mut text = String::from("t,u,y\n");
    for (k, pair) in run.samples.windows(2).enumerate() {
        let [before, now] = pair else { continue };
        let drive_v = c.dac_zero_v + f64::from(before.dac_code) * c.dac_step_v;
        let position_um = c.adc_zero_um + f64::from(now.adc_code) * c.adc_step_um;
        text.push_str(&format!(
            "{:.6},{drive_v:.7},{position_um:.7}\n",
            k as f64 / rate_hz
        ));
    }
    text
}

fn decode(
    table: &Table,
    bytes: &[u8],
    summary: &mut CaptureSummary,
) -> (Option<Converters>, Vec<Run>) {
    let mut decoder = table.new_stream_decoder();
    decoder.received(bytes);
    let (mut converters, mut runs): (Option<Converters>, Vec<Run>) = (None, Vec::new());
    loop {
        match decoder.decode() {
            Ok(frame) => {
                let text = frame.display_message().to_string();
                if let Some(found) = Converters::from_line(&text) {
                    converters.get_or_insert(found);
                } else if let Some(list) = text
                    .strip_prefix("trace [")
                    .and_then(|rest| rest.strip_suffix(']'))
                {
                    let content: Option<Vec<u8>> =
                        list.split(", ").map(|byte| byte.parse().ok()).collect();
                    match content.as_deref().map(ReadBlock::read) {
                        Some(Ok(block)) => take(&block, &mut runs, summary),
                        _ => summary.damaged += 1,
                    }
                }
            }
            Err(DecodeError::UnexpectedEof) => break,
            Err(DecodeError::Malformed) => {
                summary.damaged += 1;
                if !table.encoding().can_recover() {
                    break;
                }
            }
        }
    }
    (converters, runs)
}

fn take(block: &ReadBlock<'_>, runs: &mut Vec<Run>, summary: &mut CaptureSummary) {
    summary.lost_on_target = summary.lost_on_target.max(block.lost_ticks);
    if !block.channels.has(Channels::CODES) {
        return;
    }
    for sample in block.samples() {
        let decimation = block.decimation;
        match runs.last_mut() {
            Some(run)
                if run.decimation == decimation
                    && run.samples.last().is_some_and(|last| {
                        last.tick.wrapping_add(u32::from(decimation)) == sample.tick
                    }) =>
            {
                run.samples.push(sample);
            }
            last => {
                if last.is_some_and(|run| run.decimation == decimation) {
                    summary.gaps += 1;
                }
                runs.push(Run {
                    decimation,
                    samples: vec![sample],
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_of_converters_is_understood() {
        let line = format!(
            "converters {} {} {} {} 9362 46811 20000",
            -(1i64 << 24),
            (15i64 << 40) >> 16,
            -20i64 << 22,
            (140i64 << 38) >> 16
        );
        let found = Converters::from_line(&line).expect("understood");
        assert!(
            (found.adc_zero_um + 1.0).abs() < 1e-9 && (found.drive_max_v - 80.0).abs() < 0.003,
            "{found:?}"
        );
        assert_eq!(Converters::from_line("converters 1 2"), None);
    }

    #[test]
    fn what_is_no_image_is_said() {
        let problem = capture(b"no image", b"").expect_err("no image");
        assert!(problem.to_string().contains("is no image"), "{problem}");
    }
}

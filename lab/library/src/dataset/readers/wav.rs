//! WAV: channels of a sound card or of a data logger that writes such files.

use crate::dataset::table::{Column, Table};
use crate::error::{Error, Result};
use hound::{SampleFormat, WavReader};

/// Most channels.
const CHANNELS_MAX: u16 = 64;

/// Reads all channels; whole numbers become shares of full scale, from -1 to 1.
pub fn read(place: &str, bytes: &[u8]) -> Result<Table> {
    let fail =
        |e: hound::Error| Error::new(place, format!("cannot be read as WAV: {e}; is it cut off?"));
    let reader = WavReader::new(bytes).map_err(fail)?;
    let spec = reader.spec();
    if spec.channels == 0
        || spec.channels > CHANNELS_MAX
        || spec.sample_rate == 0
        || !(1..=32).contains(&spec.bits_per_sample)
    {
        return Err(Error::new(
            place,
            format!(
                "has {} channels of {} bits at {} Hz; expected 1 to {CHANNELS_MAX} of 1 to 32, is the file damaged?",
                spec.channels, spec.bits_per_sample, spec.sample_rate
            ),
        ));
    }
    let values: Vec<f64> = match spec.sample_format {
        SampleFormat::Float => reader
            .into_samples::<f32>()
            .map(|v| v.map(f64::from))
            .collect::<std::result::Result<_, _>>()
            .map_err(fail)?,
        SampleFormat::Int => {
            let full_scale = 2_f64.powi(i32::from(spec.bits_per_sample) - 1);
            let share =
                |v: std::result::Result<i32, hound::Error>| v.map(|v| f64::from(v) / full_scale);
            reader
                .into_samples::<i32>()
                .map(share)
                .collect::<std::result::Result<_, _>>()
                .map_err(fail)?
        }
    };
    let channels = usize::from(spec.channels);
    let column = |c: usize| {
        Column::new(
            c + 1,
            "",
            values.iter().skip(c).step_by(channels).copied().collect(),
        )
    };
    let mut table = Table {
        place: place.to_owned(),
        sample_rate_hz: Some(f64::from(spec.sample_rate)),
        ..Table::default()
    };
    table.columns = (0..channels).map(column).collect();
    if spec.sample_format == SampleFormat::Int {
        table.notes.push("values are shares of full scale, -1 to 1; say what full scale is: --units u=100V,y=20um".into());
    }
    Ok(table)
}

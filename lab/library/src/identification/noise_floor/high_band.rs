//! The least that the noise can be: what readings have above everything that the drive excites.
//!
//! White noise has the same density everywhere. Where the drive has none, what a reading has is noise; noise
//! that is not white has more at low frequencies, so that this is a lower bound.

use super::estimate::{FloorEstimate, FloorEvidence};
use crate::dataset::Record;
use realfft::RealFftPlanner;

/// The band, as shares of half the sampling rate.
const BAND: (f64, f64) = (0.6, 0.95);
/// The drive must have less than this share of the power that the reading has in the band.
const DRIVE_MAX: f64 = 0.1;
/// Densities of white noise in the two halves of the band differ by less than this factor.
const FLAT: f64 = 1.4;
/// Least samples for a spectrum whose leakage is far below the noise.
const SAMPLES_MIN: usize = 1024;

/// What the upper end of the spectrum of a record shows; `None` where the drive reaches there.
pub(super) fn of_record(record: &Record, gain_um_v: f64) -> Option<FloorEstimate> {
    if record.window.len() < SAMPLES_MIN {
        return None;
    }
    let reading = density_in_band(&record.displacement_um[record.window.clone()])?;
    let drive = density_in_band(&record.drive_v[record.window.clone()])? * gain_um_v * gain_um_v;
    let free_of_drive = drive < DRIVE_MAX * reading;
    free_of_drive.then(|| {
        FloorEstimate::new(
            FloorEvidence::HighBand,
            vec![record.name.clone()],
            reading.sqrt(),
            record.window.len(),
        )
    })
}

/// RMS of white noise in the column of a drive that has nothing else there, V; `None` where the band is not
/// flat.
pub(super) fn drive_noise_v(record: &Record) -> Option<f64> {
    if record.window.len() < SAMPLES_MIN {
        return None;
    }
    let drive_v = &record.drive_v[record.window.clone()];
    let middle = 0.5 * (BAND.0 + BAND.1);
    let (low, high) = (
        density_between(drive_v, (BAND.0, middle))?,
        density_between(drive_v, (middle, BAND.1))?,
    );
    (low.max(high) < FLAT * low.min(high)).then(|| (0.5 * (low + high)).sqrt())
}

/// Mean square that white noise of the density in the band would have.
fn density_in_band(signal: &[f64]) -> Option<f64> {
    density_between(signal, BAND)
}

/// The same between two shares of half the sampling rate, by the median of the ordinates: lines do not count.
fn density_between(signal: &[f64], band: (f64, f64)) -> Option<f64> {
    let n = signal.len();
    // The second power of a Hann window: what leaks from far away falls with the fifth power of the distance.
    let window = |k: usize| {
        (std::f64::consts::PI * (k as f64 + 0.5) / n as f64)
            .sin()
            .powi(4)
    };
    let mean = signal.iter().sum::<f64>() / n as f64;
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(n);
    let mut input: Vec<f64> = signal
        .iter()
        .enumerate()
        .map(|(k, v)| (v - mean) * window(k))
        .collect();
    let mut output = transform.make_output_vec();
    transform.process(&mut input, &mut output).ok()?;
    let power: f64 = (0..n).map(|k| window(k).powi(2)).sum();
    let bin = |share: f64| (share * output.len() as f64) as usize;
    let mut ordinates: Vec<f64> = output[bin(band.0)..bin(band.1)]
        .iter()
        .map(|c| c.norm_sqr() / power)
        .collect();
    ordinates.sort_by(f64::total_cmp);
    // Exponentially distributed ordinates: the mean is the median over ln 2.
    ordinates
        .get(ordinates.len() / 2)
        .map(|median| median / std::f64::consts::LN_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_noise_is_seen_above_a_large_slow_motion_and_not_where_the_drive_reaches() {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(0.002, 4);
        let slow: Vec<f64> = (0..20_000)
            .map(|k| 40.0 * (0.02 * k as f64).sin())
            .collect();
        let reading: Vec<f64> = slow.iter().map(|u| 0.4 * u + noise.next_um()).collect();
        let found = of_record(&Record::new("r", 10_000.0, slow, reading), 0.4).unwrap();
        assert!(
            (found.rms_um / 0.002 - 1.0).abs() < 0.05,
            "{}",
            found.rms_um
        );
        let mut wide = hysteron_sim::noise::WhiteNoise::new(1.0, 5);
        let drive: Vec<f64> = (0..20_000).map(|_| wide.next_um()).collect();
        let reading = drive.iter().map(|u| 0.4 * u).collect();
        assert!(of_record(&Record::new("r", 10_000.0, drive, reading), 0.4).is_none());
    }
}

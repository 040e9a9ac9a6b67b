//! What leaves the control interrupt at every tick, and how blocks of it look on the wire.
//!
//! # How it works
//! The interrupt puts one [`TraceSample`] a tick into a queue. A task packs every n-th of them into blocks
//! ([`TraceBlock`]), chosen channels only, and hands each block to the log. On the wire (little-endian):
//!
//! | bytes | what |
//! |---|---|
//! | 1 | version, [`VERSION`] |
//! | 1 | channels, a mask of [`Channels`] |
//! | 2 | decimation n |
//! | 4 | sequence number of the first sample: the tick it belongs to |
//! | 4 | ticks lost so far because the queue was full |
//! | 1 | samples |
//! | .. | the chosen channels of each sample, in the order of [`Channels`] |
//! | 4 | CRC-32 of all that |
//!
//! Codes are 20 bits each, the sensor's lowest; mode and fault are 2 and 6 bits.
//!
//! A reader finds every loss: sequence numbers that do not follow, and the count.

use crate::checksum::crc32;
use crate::codes::{DriveCode, MOST_BITS, SensorCode};
use heapless::Vec;

/// Version of the block's layout.
pub const VERSION: u8 = 2;
/// Samples in a full block.
pub const BLOCK_SAMPLES: usize = 16;
const HEADER_BYTES: usize = 13;
const CHECKSUM_BYTES: usize = 4;
/// Bytes of both codes.
pub const CODE_BYTES: usize = 5;
/// Bytes of the largest block.
pub const BLOCK_BYTES: usize = HEADER_BYTES + BLOCK_SAMPLES * 18 + CHECKSUM_BYTES;

/// One tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceSample {
    /// Tick since the start.
    pub tick: u32,
    /// ADC code read at this tick.
    pub adc_code: SensorCode,
    /// DAC code computed at this tick; it acts from the next tick on.
    pub dac_code: DriveCode,
    /// Reference at this tick, um with 24 fraction bits.
    pub reference: i32,
    /// Force-equivalent displacement of the code, um with 24 fraction bits (V with 22 for a direct actuator).
    pub applied: i32,
    /// Estimate of the unknown input, um with 24 fraction bits (V with 22 for the PIDSMO).
    pub unknown_input: i32,
    /// Mode (low byte) and fault (high byte).
    pub flags: u16,
}

/// A tick as it is kept and queued, 24 bytes: mode and fault have the bits that the codes leave free.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PackedSample {
    tick: u32,
    /// Sensor's code, and the mode above it.
    sensor: u32,
    /// Drive's code, and the fault above it.
    drive: u32,
    reference: i32,
    applied: i32,
    unknown_input: i32,
}

const CODE_MASK: u32 = (1 << MOST_BITS) - 1;

impl TraceSample {
    /// Packed.
    #[inline(always)]
    #[must_use]
    pub fn packed(&self) -> PackedSample {
        PackedSample {
            tick: self.tick,
            sensor: self.adc_code.steps() | u32::from(self.flags & 0xFF) << MOST_BITS,
            drive: self.dac_code.steps() | u32::from(self.flags >> 8) << MOST_BITS,
            reference: self.reference,
            applied: self.applied,
            unknown_input: self.unknown_input,
        }
    }
}

impl PackedSample {
    /// As it was.
    #[must_use]
    pub fn unpacked(&self) -> TraceSample {
        TraceSample {
            tick: self.tick,
            adc_code: SensorCode::new(self.sensor & CODE_MASK),
            dac_code: DriveCode::new(self.drive & CODE_MASK),
            reference: self.reference,
            applied: self.applied,
            unknown_input: self.unknown_input,
            flags: (self.sensor >> MOST_BITS) as u16 | ((self.drive >> MOST_BITS) as u16) << 8,
        }
    }
}

/// Both codes in 40 bits, the sensor's lowest.
#[must_use]
pub fn code_bytes(sensor: SensorCode, drive: DriveCode) -> [u8; CODE_BYTES] {
    let [a, b, c, d, e, ..] =
        (u64::from(sensor.steps()) | u64::from(drive.steps()) << MOST_BITS).to_le_bytes();
    [a, b, c, d, e]
}

/// The codes of [`code_bytes`].
#[must_use]
pub fn codes_of(bytes: [u8; CODE_BYTES]) -> (SensorCode, DriveCode) {
    let [a, b, c, d, e] = bytes;
    let both = u64::from_le_bytes([a, b, c, d, e, 0, 0, 0]);
    (
        SensorCode::new(both as u32 & CODE_MASK),
        DriveCode::new((both >> MOST_BITS) as u32 & CODE_MASK),
    )
}

/// Which channels of a sample are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channels(pub u8);

impl Channels {
    /// ADC and DAC codes.
    pub const CODES: Self = Self(1);
    /// Reference.
    pub const REFERENCE: Self = Self(2);
    /// Force-equivalent displacement of the code.
    pub const APPLIED: Self = Self(4);
    /// Unknown input.
    pub const UNKNOWN_INPUT: Self = Self(8);
    /// Mode and fault.
    pub const FLAGS: Self = Self(16);
    /// All of them.
    pub const ALL: Self = Self(31);

    /// Whether all channels of `other` are among these.
    #[must_use]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    const fn sample_bytes(self) -> usize {
        let mut bytes = 0;
        bytes += if self.has(Self::CODES) { CODE_BYTES } else { 0 };
        bytes += if self.has(Self::REFERENCE) { 4 } else { 0 };
        bytes += if self.has(Self::APPLIED) { 4 } else { 0 };
        bytes += if self.has(Self::UNKNOWN_INPUT) { 4 } else { 0 };
        bytes + if self.has(Self::FLAGS) { 1 } else { 0 }
    }
}

/// Packs samples into blocks.
#[derive(Clone, Debug)]
pub struct TraceBlock {
    channels: Channels,
    decimation: u16,
    samples: u8,
    next_tick: u32,
    bytes: Vec<u8, BLOCK_BYTES>,
}

impl TraceBlock {
    /// Empty; takes every `decimation`-th tick (0 counts as 1).
    #[must_use]
    pub fn new(channels: Channels, decimation: u16) -> Self {
        Self {
            channels: Channels(channels.0 & Channels::ALL.0),
            decimation: decimation.max(1),
            samples: 0,
            next_tick: 0,
            bytes: Vec::new(),
        }
    }

    /// Takes a sample. A block ends when it is full or when ticks are missing before this sample; it is then
    /// handed to `send`.
    pub fn push(&mut self, sample: &TraceSample, lost_ticks: u32, mut send: impl FnMut(&[u8])) {
        if !sample.tick.is_multiple_of(u32::from(self.decimation)) {
            return;
        }
        if self.samples > 0 && sample.tick != self.next_tick {
            self.finish(&mut send);
        }
        if self.samples == 0 {
            self.bytes.clear();
            let _ = self.bytes.extend_from_slice(&[VERSION, self.channels.0]);
            let _ = self.bytes.extend_from_slice(&self.decimation.to_le_bytes());
            let _ = self.bytes.extend_from_slice(&sample.tick.to_le_bytes());
            let _ = self.bytes.extend_from_slice(&lost_ticks.to_le_bytes());
            let _ = self.bytes.push(0);
        }
        let c = self.channels;
        if c.has(Channels::CODES) {
            let _ = self
                .bytes
                .extend_from_slice(&code_bytes(sample.adc_code, sample.dac_code));
        }
        for (channel, value) in [
            (Channels::REFERENCE, sample.reference),
            (Channels::APPLIED, sample.applied),
            (Channels::UNKNOWN_INPUT, sample.unknown_input),
        ] {
            if c.has(channel) {
                let _ = self.bytes.extend_from_slice(&value.to_le_bytes());
            }
        }
        if c.has(Channels::FLAGS) {
            // Two bits of mode, six of fault.
            let _ = self
                .bytes
                .push((sample.flags & 3) as u8 | ((sample.flags >> 8) << 2) as u8);
        }
        self.samples += 1;
        self.next_tick = sample.tick.wrapping_add(u32::from(self.decimation));
        if usize::from(self.samples) == BLOCK_SAMPLES {
            self.finish(&mut send);
        }
    }

    /// Sends what has been gathered.
    pub fn finish(&mut self, send: &mut impl FnMut(&[u8])) {
        if self.samples == 0 {
            return;
        }
        if let Some(count) = self.bytes.get_mut(HEADER_BYTES - 1) {
            *count = self.samples;
        }
        let checksum = crc32(&self.bytes);
        let _ = self.bytes.extend_from_slice(&checksum.to_le_bytes());
        send(&self.bytes);
        self.samples = 0;
    }
}

/// Why bytes are not a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TraceError {
    /// Shorter or longer than its header says.
    Length,
    /// Another version of the layout.
    Version(u8),
    /// The checksum does not match.
    Checksum,
}

/// A block as read.
#[derive(Clone, Copy, Debug)]
pub struct ReadBlock<'a> {
    /// Channels that are in it; the others read as zero.
    pub channels: Channels,
    /// Ticks from one sample to the next.
    pub decimation: u16,
    /// Ticks lost on the target when it was begun.
    pub lost_ticks: u32,
    first_tick: u32,
    samples: &'a [u8],
}

impl<'a> ReadBlock<'a> {
    /// Reads a block.
    ///
    /// # Errors
    /// [`TraceError`].
    pub fn read(bytes: &'a [u8]) -> Result<Self, TraceError> {
        let Some((content, checksum)) = bytes.split_last_chunk::<CHECKSUM_BYTES>() else {
            return Err(TraceError::Length);
        };
        let Some((
            &[
                version,
                channels,
                d0,
                d1,
                t0,
                t1,
                t2,
                t3,
                l0,
                l1,
                l2,
                l3,
                count,
            ],
            samples,
        )) = content.split_first_chunk::<HEADER_BYTES>()
        else {
            return Err(TraceError::Length);
        };
        if version != VERSION {
            return Err(TraceError::Version(version));
        }
        if crc32(content) != u32::from_le_bytes(*checksum) {
            return Err(TraceError::Checksum);
        }
        let channels = Channels(channels);
        if samples.len() != usize::from(count) * channels.sample_bytes() {
            return Err(TraceError::Length);
        }
        Ok(Self {
            channels,
            decimation: u16::from_le_bytes([d0, d1]),
            first_tick: u32::from_le_bytes([t0, t1, t2, t3]),
            lost_ticks: u32::from_le_bytes([l0, l1, l2, l3]),
            samples,
        })
    }

    /// Its samples.
    pub fn samples(&self) -> impl Iterator<Item = TraceSample> + '_ {
        let (channels, decimation, first) =
            (self.channels, u32::from(self.decimation), self.first_tick);
        self.samples
            .chunks_exact(channels.sample_bytes().max(1))
            .zip(0u32..)
            .map(move |(bytes, k)| {
                let mut sample = TraceSample {
                    tick: first.wrapping_add(k.wrapping_mul(decimation)),
                    ..TraceSample::default()
                };
                let mut rest = bytes;
                if channels.has(Channels::CODES) {
                    (sample.adc_code, sample.dac_code) = codes_of(take(&mut rest));
                }
                for (channel, value) in [
                    (Channels::REFERENCE, &mut sample.reference),
                    (Channels::APPLIED, &mut sample.applied),
                    (Channels::UNKNOWN_INPUT, &mut sample.unknown_input),
                ] {
                    if channels.has(channel) {
                        *value = i32::from_le_bytes(take(&mut rest));
                    }
                }
                if channels.has(Channels::FLAGS) {
                    let [flags] = take::<1>(&mut rest);
                    sample.flags = u16::from(flags & 3) | u16::from(flags >> 2) << 8;
                }
                sample
            })
    }
}

fn take<const N: usize>(rest: &mut &[u8]) -> [u8; N] {
    let Some((chunk, tail)) = rest.split_first_chunk::<N>() else {
        return [0; N];
    };
    *rest = tail;
    *chunk
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    fn sample(tick: u32) -> TraceSample {
        TraceSample {
            tick,
            adc_code: SensorCode::new(tick.wrapping_mul(7919) & 0xF_FFFF ^ 0x5_a5a5),
            dac_code: DriveCode::new(0xF_FFFF - tick),
            reference: tick as i32 * -3,
            applied: tick as i32 * 7,
            unknown_input: -1 - tick as i32,
            flags: 0x0102,
        }
    }

    #[test]
    fn what_goes_in_comes_out_and_gaps_are_seen() {
        let mut blocks: Vec<Vec<u8>> = Vec::new();
        let mut block = TraceBlock::new(Channels::ALL, 1);
        let ticks: Vec<u32> = (100..140).chain(150..155).collect();
        for &tick in &ticks {
            block.push(&sample(tick), 0, |bytes| blocks.push(bytes.to_vec()));
        }
        block.finish(&mut |bytes: &[u8]| blocks.push(bytes.to_vec()));
        let read: Vec<TraceSample> = blocks
            .iter()
            .flat_map(|bytes| {
                ReadBlock::read(bytes)
                    .expect("whole")
                    .samples()
                    .collect::<Vec<_>>()
            })
            .collect();
        assert_eq!(
            read,
            ticks.iter().map(|&tick| sample(tick)).collect::<Vec<_>>()
        );
        assert_eq!(blocks.len(), 4); // 16, 16, 8 before the gap, 5 after
    }

    #[test]
    fn a_sample_takes_24_bytes_and_comes_back_whole() {
        assert_eq!(size_of::<PackedSample>(), 24);
        for (fault, _) in crate::guard::Fault::ALL {
            for (mode, code) in [(0, 0), (1, 0xF_FFFF), (2, 0x5_5555), (3, 0xA_AAAA)] {
                let whole = TraceSample {
                    adc_code: SensorCode::new(code),
                    dac_code: DriveCode::new(!code & 0xF_FFFF),
                    flags: mode | (fault as u16) << 8,
                    ..sample(code)
                };
                assert_eq!(whole.packed().unpacked(), whole);
                let mut sent = Vec::new();
                let mut block = TraceBlock::new(Channels::ALL, 1);
                block.push(&whole, 0, |bytes| sent = bytes.to_vec());
                block.finish(&mut |bytes: &[u8]| sent = bytes.to_vec());
                assert_eq!(
                    ReadBlock::read(&sent).expect("whole").samples().next(),
                    Some(whole)
                );
            }
        }
    }

    #[test]
    fn every_damage_is_seen() {
        let mut whole = Vec::new();
        let mut block = TraceBlock::new(Channels(Channels::CODES.0 | Channels::FLAGS.0), 2);
        for tick in 0..32 {
            block.push(&sample(tick), 9, |bytes| whole = bytes.to_vec());
        }
        let read = ReadBlock::read(&whole).expect("whole");
        assert_eq!(
            (read.lost_ticks, read.decimation, read.samples().count()),
            (9, 2, 16)
        );
        for bit in 0..whole.len() * 8 {
            let mut damaged = whole.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(ReadBlock::read(&damaged).is_err(), "bit {bit}");
        }
        for length in 0..whole.len() {
            assert!(ReadBlock::read(&whole[..length]).is_err());
        }
    }
}

//! Damaged inputs: one that a reader accepts, changed at random.

use crate::readers::{Target, Whole};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::panic::catch_unwind;

/// Numbers at which readers go wrong.
const NUMBERS: [&str; 16] = [
    "0",
    "-0.0",
    "-1",
    "1e-320",
    "1e308",
    "-1e308",
    "inf",
    "nan",
    "9223372036854775807",
    "18446744073709551616",
    "4294967296",
    "0.1",
    "1e-9",
    "1e9",
    "",
    "\"a\"",
];

/// An input with one to four changes.
fn damaged(target: &Target, seed: u64) -> Whole {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (name, whole) = &target.wholes[random.random_range(0..target.wholes.len())];
    let mut bytes = whole.clone();
    // Most have one change: more than that is refused for the first of them.
    for _ in 0..[1, 1, 1, 2, 4][random.random_range(0..5)] {
        damage(&mut bytes, &mut random);
    }
    (name.clone(), bytes)
}

/// Reads a damaged input for each seed, and how many were accepted.
///
/// # Panics
/// Where a reader does, with the seed.
#[must_use]
pub fn accepted(target: &Target, seeds: std::ops::Range<u64>) -> usize {
    let is_accepted = |seed: &u64| {
        let (name, bytes) = damaged(target, *seed);
        catch_unwind(|| (target.read)(&name, &bytes))
            .unwrap_or_else(|_| panic!("{}: a panic in {name}, seed {seed}", target.name))
    };
    seeds.filter(is_accepted).count()
}

fn damage(bytes: &mut Vec<u8>, random: &mut Pcg64Mcg) {
    if bytes.is_empty() {
        bytes.push(random.random());
        return;
    }
    let at = random.random_range(0..bytes.len());
    match random.random_range(0..10) {
        0 => bytes[at] ^= 1 << random.random_range(0..8),
        1 => bytes.truncate(at),
        2 | 3 => replace_number(bytes, at, random),
        8 | 9 => replace_digit(bytes, at, random),
        4 => {
            // A length or a count of 32 bits.
            let value: u32 = [0, 1, u32::MAX, 1 << 31, random.random()][random.random_range(0..5)];
            let end = bytes.len().min(at + 4);
            bytes[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
        }
        5 => {
            let piece = line_at(bytes, at);
            let copy = bytes[piece.clone()].to_vec();
            bytes.splice(piece.end..piece.end, copy);
        }
        6 => {
            let piece = line_at(bytes, at);
            bytes.drain(piece);
        }
        _ => {
            let [from, to] = [
                line_at(bytes, at),
                line_at(bytes, random.random_range(0..bytes.len())),
            ];
            let moved = bytes[from].to_vec();
            bytes.splice(to, moved);
        }
    }
}

/// Puts another number where the next one stands.
fn replace_number(bytes: &mut Vec<u8>, at: usize, random: &mut Pcg64Mcg) {
    let is_of_number = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
    let Some(from) = bytes[at..]
        .iter()
        .position(u8::is_ascii_digit)
        .map(|k| at + k)
    else {
        return;
    };
    let length = bytes[from..]
        .iter()
        .take_while(|byte| is_of_number(byte))
        .count();
    let number = NUMBERS[random.random_range(0..NUMBERS.len())];
    bytes.splice(from..from + length, number.bytes());
}

/// Another digit for the next one: most numbers stay in their range.
fn replace_digit(bytes: &mut [u8], at: usize, random: &mut Pcg64Mcg) {
    if let Some(digit) = bytes[at..].iter_mut().find(|byte| byte.is_ascii_digit()) {
        *digit = b"0123456789"[random.random_range(0..10)];
    }
}

/// The line around a byte, with its end.
fn line_at(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    let from = bytes[..at]
        .iter()
        .rposition(|byte| *byte == b'\n')
        .map_or(0, |k| k + 1);
    let to = bytes[at..]
        .iter()
        .position(|byte| *byte == b'\n')
        .map_or(bytes.len(), |k| at + k + 1);
    from..to
}

//! CRC-32 (IEEE 802.3, reflected), a nibble at a time: small, and fast enough below the control interrupt.

const fn nibble_table() -> [u32; 16] {
    let mut table = [0; 16];
    let mut nibble = 0;
    while nibble < 16 {
        let mut value = nibble as u32;
        let mut bit = 0;
        while bit < 4 {
            value = if value & 1 == 1 {
                (value >> 1) ^ 0xEDB8_8320
            } else {
                value >> 1
            };
            bit += 1;
        }
        table[nibble] = value;
        nibble += 1;
    }
    table
}

static TABLE: [u32; 16] = nibble_table();

/// CRC-32 of bytes that come in pieces.
#[derive(Clone, Copy, Debug)]
pub struct Crc32(u32);

impl Crc32 {
    /// Of no bytes yet.
    #[must_use]
    pub const fn new() -> Self {
        Self(u32::MAX)
    }

    /// Takes the next bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        let step = |crc: u32, nibble: u32| {
            TABLE
                .get(((crc ^ nibble) & 15) as usize)
                .copied()
                .unwrap_or(0)
                ^ (crc >> 4)
        };
        self.0 = bytes.iter().fold(self.0, |crc, byte| {
            let crc = step(crc, u32::from(*byte));
            step(crc, u32::from(*byte >> 4))
        });
    }

    /// That of all that came.
    #[must_use]
    pub const fn value(self) -> u32 {
        !self.0
    }
}

impl Default for Crc32 {
    fn default() -> Self {
        Self::new()
    }
}

/// CRC-32 of bytes.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let mut sum = Crc32::new();
    sum.update(bytes);
    sum.value()
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_standard_check_value() {
        assert_eq!(super::crc32(b"123456789"), 0xCBF4_3926);
        let mut sum = super::Crc32::new();
        [&b"1234"[..], b"", b"56789"]
            .into_iter()
            .for_each(|piece| sum.update(piece));
        assert_eq!(sum.value(), 0xCBF4_3926);
    }
}

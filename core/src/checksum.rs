//! CRC-32 (IEEE 802.3, reflected), a nibble at a time: small, and fast enough below the control interrupt.

const fn nibble_table() -> [u32; 16] {
    let mut table = [0; 16];
    let mut nibble = 0;
    while nibble < 16 {
        let mut value = nibble as u32;
        let mut bit = 0;
        while bit < 4 {
            value = if value & 1 == 1 { (value >> 1) ^ 0xEDB8_8320 } else { value >> 1 };
            bit += 1;
        }
        table[nibble] = value;
        nibble += 1;
    }
    table
}

static TABLE: [u32; 16] = nibble_table();

/// CRC-32 of bytes.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, nibble: u32| TABLE.get(((crc ^ nibble) & 15) as usize).copied().unwrap_or(0) ^ (crc >> 4);
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        let crc = step(crc, u32::from(*byte));
        step(crc, u32::from(*byte >> 4))
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_standard_check_value() {
        assert_eq!(super::crc32(b"123456789"), 0xCBF4_3926);
    }
}

//! An image as the board takes it over the line, the bytes of the running image's place in flash, and the key
//! under which it takes it.

use hysteron_core::firmware_update::{
    AuthenticationCode, H743ZI, HEADER_BYTES, HEADER_OFFSET, ImageHeader, KEY_BYTES, UpdateKey,
    WORD_BYTES,
};
use object::elf::{EM_ARM, PT_LOAD};
use object::read::elf::{ElfFile32, FileHeader, ProgramHeader};

/// A key or an authentication code of 32 hexadecimal digits.
#[must_use]
pub fn key_bytes(text: &str) -> Option<[u8; KEY_BYTES]> {
    let text = text.trim();
    let digits = (text.len() == 2 * KEY_BYTES && text.bytes().all(|c| c.is_ascii_hexdigit()))
        .then(|| u128::from_str_radix(text, 16).ok())?;
    digits.map(u128::to_be_bytes)
}

/// The boot stage's sector: the boot stage of an ELF file, and the key behind it.
///
/// # Errors
/// Why the file is no boot stage.
pub fn boot_sector(file: &[u8], key: &UpdateKey) -> Result<Vec<u8>, String> {
    const BEGIN: u32 = 0x0800_0000;
    let mut bytes = flash_of(file, BEGIN, H743ZI.key - BEGIN)?;
    bytes.resize((H743ZI.key - BEGIN) as usize, 0xFF);
    bytes.extend(key.word());
    Ok(bytes)
}

/// What an ELF file puts into the flash from an address on, where there is room for so many bytes.
fn flash_of(file: &[u8], begin: u32, room: u32) -> Result<Vec<u8>, String> {
    let elf: ElfFile32 = ElfFile32::parse(file).map_err(|_| "is no 32-bit ELF file".to_string())?;
    let endian = elf.endian();
    if elf.elf_header().e_machine(endian) != EM_ARM {
        return Err("is for another processor than an Arm Cortex-M".into());
    }
    let mut bytes = Vec::new();
    for segment in elf.elf_program_headers() {
        let (address, length) = (segment.p_paddr(endian), segment.p_filesz(endian));
        if segment.p_type(endian) != PT_LOAD || length == 0 {
            continue;
        }
        let data = segment
            .data(endian, file)
            .map_err(|()| "is cut off".to_string())?;
        let from = address
            .checked_sub(begin)
            .filter(|from| u64::from(*from) + u64::from(length) <= u64::from(room));
        let Some(from) = from else {
            return Err(format!(
                "is for other places in flash ({address:#010x}, {length} bytes)"
            ));
        };
        let (from, to) = (from as usize, from as usize + data.len());
        if bytes.len() < to {
            bytes.resize(to, 0xFF);
        }
        if let Some(place) = bytes.get_mut(from..to) {
            place.copy_from_slice(data);
        }
    }
    Ok(bytes)
}

/// An image of this project for the NUCLEO-H743ZI2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirmwareImage {
    /// Its bytes, filled to whole flash words.
    pub bytes: Vec<u8>,
    /// What it says of itself.
    pub header: ImageHeader,
}

impl FirmwareImage {
    /// From the ELF file that `cargo xtask firmware` builds.
    ///
    /// # Errors
    /// Why it is no image of this board.
    pub fn from_elf(file: &[u8]) -> Result<Self, String> {
        Self::from_bytes(flash_of(file, H743ZI.running, H743ZI.image_bytes)?)
    }

    /// What the board asks for before it takes the image.
    #[must_use]
    pub fn signed(&self, key: &UpdateKey) -> AuthenticationCode {
        let mut authentication = key.authenticate();
        for word in self.bytes.as_chunks().0 {
            authentication.update(word);
        }
        authentication.code()
    }

    /// From the bytes of the flash.
    ///
    /// # Errors
    /// They are no image of this project.
    pub fn from_bytes(mut bytes: Vec<u8>) -> Result<Self, String> {
        bytes.resize(bytes.len().next_multiple_of(WORD_BYTES), 0xFF);
        let at = HEADER_OFFSET as usize;
        let header = bytes.get(at..at + HEADER_BYTES).and_then(ImageHeader::read);
        match header {
            Some((length, header))
                if length as usize <= bytes.len() && bytes.len() <= H743ZI.image_bytes as usize =>
            {
                Ok(Self { bytes, header })
            }
            _ => Err("has no header of an image that can be updated over the line".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat() -> Vec<u8> {
        let mut bytes = vec![0xA5; 2000];
        bytes[0x400..0x404].copy_from_slice(&2000u32.to_le_bytes());
        bytes[0x404..0x40C].copy_from_slice(b"HYSTERON");
        bytes
    }

    #[test]
    fn bytes_with_a_header_are_an_image_of_whole_words() {
        let image = FirmwareImage::from_bytes(flat()).expect("an image");
        assert_eq!(image.bytes.len(), 2016);
        assert_eq!(&image.bytes[2000..], &[0xFF; 16]);
    }

    #[test]
    fn a_code_depends_on_every_byte_and_on_the_key() {
        let bytes = |text: &str| key_bytes(text).map(UpdateKey::new);
        let key = bytes("000102030405060708090a0b0c0d0e0f\n").expect("a key");
        let image = FirmwareImage::from_bytes(flat()).expect("an image");
        let mut other = image.clone();
        other.bytes[1999] ^= 1;
        let signed = image.signed(&key);
        assert_ne!(signed, other.signed(&key));
        assert_ne!(signed, image.signed(&UpdateKey::new([0; KEY_BYTES])));
        for text in ["", "00", "+00102030405060708090a0b0c0d0e0f"] {
            assert_eq!(bytes(text), None);
        }
    }

    #[test]
    fn what_is_no_image_is_refused_with_the_reason() {
        let mut longer = flat();
        longer[0x400..0x404].copy_from_slice(&3000u32.to_le_bytes());
        for bytes in [vec![0; 100], vec![0; 4000], longer, vec![0xA5; 400_000]] {
            assert!(FirmwareImage::from_bytes(bytes).is_err());
        }
        assert!(
            FirmwareImage::from_elf(b"#!/bin/sh").is_err_and(|why| why.contains("no 32-bit ELF"))
        );
    }
}

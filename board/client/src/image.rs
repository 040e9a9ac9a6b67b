//! An image as the board takes it over the line: the bytes of the running image's place in flash.

use hysteron_core::checksum::crc32;
use hysteron_core::firmware_update::{
    H743ZI, HEADER_BYTES, HEADER_OFFSET, ImageHeader, WORD_BYTES,
};
use object::elf::{EM_ARM, PT_LOAD};
use object::read::elf::{ElfFile32, FileHeader, ProgramHeader};

/// An image of this project for the NUCLEO-H743ZI2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirmwareImage {
    /// Its bytes, filled to whole flash words.
    pub bytes: Vec<u8>,
    /// CRC-32 of them.
    pub checksum: u32,
    /// What it says of itself.
    pub header: ImageHeader,
}

impl FirmwareImage {
    /// From the ELF file that `cargo xtask firmware` builds.
    ///
    /// # Errors
    /// Why it is no image of this board.
    pub fn from_elf(file: &[u8]) -> Result<Self, String> {
        let elf: ElfFile32 =
            ElfFile32::parse(file).map_err(|_| "is no 32-bit ELF file".to_string())?;
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
            let from = address.checked_sub(H743ZI.running).filter(|from| {
                u64::from(*from) + u64::from(length) <= u64::from(H743ZI.image_bytes)
            });
            let Some(from) = from else {
                return Err(format!(
                    "is for other places in flash than the program's ({address:#010x}, {length} bytes)"
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
        Self::from_bytes(bytes)
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
                Ok(Self {
                    checksum: crc32(&bytes),
                    bytes,
                    header,
                })
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
        assert_eq!(
            (image.bytes.len(), image.checksum),
            (2016, crc32(&image.bytes))
        );
        assert_eq!(&image.bytes[2000..], &[0xFF; 16]);
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

//! An image before it is flashed: is it one of this project, for this chip, and does it stay where it may?

use crate::failure::Result;
use object::elf::{EM_ARM, PT_LOAD};
use object::read::elf::{ElfFile32, FileHeader, ProgramHeader};
use object::{Object, ObjectSection, ObjectSymbol};
use std::ops::Range;
use std::path::Path;

/// Flash for the program: three sectors of bank 1 of the STM32H743ZI, behind the boot stage (RM0433, 4.3;
/// `memory.x`). The boot stage and the parameter blocks in bank 2 are not touched.
pub const PROGRAM_FLASH: Range<u64> = 0x0802_0000..0x0808_0000;
/// Flash of the boot stage, which starts the program: the first sector.
const BOOT_FLASH: Range<u64> = 0x0800_0000..0x0802_0000;
/// Where a stack begins: at the end of the DTCM or of the AXI SRAM. Images for other boards have it
/// elsewhere, because they have other memories.
const STACKS: [u64; 2] = [0x2002_0000, 0x2408_0000];
/// What an image of this project answers `*IDN?` with.
const IDENTIFICATION: &[u8] = b"HYSTERON";
/// The log's control block, which the probe reads.
const CONTROL_BLOCK: &str = "_SEGGER_RTT";

/// What a file holds.
#[derive(Debug, PartialEq)]
pub struct Image {
    /// Bytes that go into the flash.
    pub flash_bytes: u64,
    /// The highest address that is written, and one more.
    pub flash_end: u64,
    /// Where the log's control block will be.
    pub log_address: u64,
}

/// Reads an image and looks at it.
///
/// # Errors
/// The file cannot be read, is no ELF image for a Cortex-M, none of this project, or would be written where
/// it must not.
pub fn read(path: &Path) -> Result<(Image, Vec<u8>)> {
    let named = path.display();
    let bytes = std::fs::read(path).map_err(|error| format!("{named}: {error}"))?;
    let image = inspect(&bytes).map_err(|what| format!("{named}: {what}"))?;
    Ok((image, bytes))
}

/// Reads the boot stage; the bytes that go into the flash.
///
/// # Errors
/// As of [`read`].
pub fn read_boot_stage(path: &Path) -> Result<u64> {
    let named = path.display();
    let bytes = std::fs::read(path).map_err(|error| format!("{named}: {error}"))?;
    let wanted = "expected the boot stage that `cargo xtask firmware` builds";
    let loaded = parse(&bytes, wanted)
        .and_then(|file| Loaded::of(&file, &bytes, &BOOT_FLASH, "the boot stage's flash", wanted));
    Ok(loaded.map_err(|what| format!("{named}: {what}"))?.bytes)
}

fn parse<'d>(bytes: &'d [u8], wanted: &str) -> Result<ElfFile32<'d>> {
    let file: ElfFile32 =
        ElfFile32::parse(bytes).map_err(|_| format!("is no 32-bit ELF file; {wanted}"))?;
    if file.elf_header().e_machine(file.endian()) != EM_ARM {
        return Err(format!(
            "is for another processor than an Arm Cortex-M; {wanted}"
        ));
    }
    Ok(file)
}

/// What of a file goes into the flash.
struct Loaded {
    bytes: u64,
    end: u64,
    /// The project's name stands in it.
    is_ours: bool,
}

impl Loaded {
    /// Segments that all stay within a range of the flash, with vectors at its beginning.
    fn of(
        file: &ElfFile32,
        content: &[u8],
        flash: &Range<u64>,
        named: &str,
        wanted: &str,
    ) -> Result<Self> {
        let endian = file.endian();
        let mut loaded = Self {
            bytes: 0,
            end: flash.start,
            is_ours: false,
        };
        let mut head = None;
        for segment in file.elf_program_headers() {
            let (address, length) = (
                u64::from(segment.p_paddr(endian)),
                u64::from(segment.p_filesz(endian)),
            );
            if segment.p_type(endian) != PT_LOAD || length == 0 {
                continue;
            }
            let end = address + length;
            if address < flash.start || end > flash.end {
                let range = format!("{:#010x} to {:#010x}", flash.start, flash.end);
                return Err(format!(
                    "would be written to {address:#010x}..{end:#010x}; {named} of an STM32H743ZI is {range}"
                ));
            }
            let data = segment
                .data(endian, content)
                .map_err(|()| "is cut off: a segment reaches beyond the file".to_string())?;
            if address == flash.start {
                head = data.first_chunk::<8>().copied();
            }
            loaded.is_ours |= data
                .windows(IDENTIFICATION.len())
                .any(|window| window == IDENTIFICATION);
            loaded.bytes += length;
            loaded.end = loaded.end.max(end);
        }
        let Some([a, b, c, d, e, f, g, h]) = head else {
            return Err(format!(
                "has no vector table at {:#010x}; {wanted}",
                flash.start
            ));
        };
        let (stack, reset) = (
            u64::from(u32::from_le_bytes([a, b, c, d])),
            u64::from(u32::from_le_bytes([e, f, g, h])),
        );
        if !STACKS.contains(&stack) || reset & 1 == 0 || !flash.contains(&reset) {
            return Err(format!(
                "begins with a stack at {stack:#010x} and a program at {reset:#010x}, which is not for a NUCLEO-H743ZI2; {wanted}"
            ));
        }
        Ok(loaded)
    }
}

/// Looks at the bytes of an image.
pub fn inspect(bytes: &[u8]) -> Result<Image> {
    const WANTED: &str = "expected the image that `cargo xtask firmware` builds";
    let file = parse(bytes, WANTED)?;
    let loaded = Loaded::of(&file, bytes, &PROGRAM_FLASH, "the program's flash", WANTED)?;
    let has_log_table = file
        .section_by_name(".defmt")
        .is_some_and(|section| section.size() > 0);
    let log = file
        .symbols()
        .find(|symbol| symbol.name() == Ok(CONTROL_BLOCK))
        .map(|symbol| symbol.address());
    match log {
        Some(log_address) if loaded.is_ours && has_log_table => Ok(Image {
            flash_bytes: loaded.bytes,
            flash_end: loaded.end,
            log_address,
        }),
        _ => Err(format!(
            "is a program for a Cortex-M, but none of this project; {WANTED}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A word, little-endian.
    fn word(value: u32) -> [u8; 4] {
        value.to_le_bytes()
    }

    /// An ELF header for a machine with one segment at an address: 52 bytes of header, 32 of segment, then
    /// the content.
    fn elf(machine: u16, address: u32, content: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0x7f, b'E', b'L', b'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        bytes.extend(2u16.to_le_bytes());
        bytes.extend(machine.to_le_bytes());
        for field in [1, address, 52, 0, 0x0500_0400] {
            bytes.extend(word(field));
        }
        for field in [52u16, 32, 1, 40, 0, 0] {
            bytes.extend(field.to_le_bytes());
        }
        let length = content.len() as u32;
        for field in [1, 84, address, address, length, length, 5, 4] {
            bytes.extend(word(field));
        }
        bytes.extend(content);
        bytes
    }

    fn vectors(stack: u32, reset: u32) -> Vec<u8> {
        [word(stack), word(reset)].concat()
    }

    #[test]
    fn what_is_no_image_for_this_chip_is_refused_with_the_reason() {
        let good = vectors(0x2002_0000, 0x0802_0401);
        let cut = {
            let mut bytes = elf(EM_ARM, 0x0802_0000, &good);
            bytes.truncate(bytes.len() - 1);
            bytes
        };
        for (bytes, why) in [
            (b"#!/bin/sh\n".to_vec(), "no 32-bit ELF"),
            (Vec::new(), "no 32-bit ELF"),
            (elf(62, 0x0802_0000, &good), "another processor"),
            (elf(EM_ARM, 0x081C_0000, &good), "0x081c0000"),
            (elf(EM_ARM, 0x0807_FFFC, &good), "0x0807fffc..0x08080004"),
            (
                elf(EM_ARM, 0x2000_0000, &good),
                "would be written to 0x20000000",
            ),
            (elf(EM_ARM, 0x0802_0400, &good), "no vector table"),
            (
                elf(EM_ARM, 0x0802_0000, &vectors(0x1000_0000, 0x0802_0401)),
                "not for a NUCLEO-H743ZI2",
            ),
            // The NUCLEO-G474RE's: it would drive the pins of another board.
            (
                elf(EM_ARM, 0x0802_0000, &vectors(0x2001_3000, 0x0802_0401)),
                "not for a NUCLEO-H743ZI2",
            ),
            (
                elf(EM_ARM, 0x0802_0000, &vectors(0x2002_0000, 0x0802_0400)),
                "not for a NUCLEO-H743ZI2",
            ),
            (elf(EM_ARM, 0x0802_0000, &good), "none of this project"),
            (cut, "cut off"),
        ] {
            let refused = inspect(&bytes).expect_err(why);
            assert!(refused.contains(why), "expected `{why}` in: {refused}");
        }
    }

    #[test]
    fn the_image_of_this_checkout_is_taken_and_no_part_of_it_is() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../firmware/target/thumbv7em-none-eabihf/release/hysteron-firmware");
        if !path.is_file() {
            println!(
                "skipped: `cargo xtask firmware` has not built {}",
                path.display()
            );
            return;
        }
        let other = path.with_file_name("hysteron-firmware-nucleo-g474re");
        if other.is_file() {
            assert!(
                read(&other)
                    .expect_err("another board's")
                    .contains("the program's flash")
            );
        }
        let stage = path.with_file_name("hysteron-boot-stage");
        if stage.is_file() {
            assert!(read_boot_stage(&stage).expect("a boot stage") < 128 * 1024);
            assert!(
                read(&stage)
                    .expect_err("no program")
                    .contains("the program's flash")
            );
            assert!(
                read_boot_stage(&path)
                    .expect_err("no boot stage")
                    .contains("the boot stage's flash")
            );
        }
        let (image, bytes) = read(&path).expect("an image");
        assert!(
            image.flash_bytes > 100_000 && image.flash_end <= PROGRAM_FLASH.end,
            "{image:?}"
        );
        assert!(
            (0x2000_0000..0x2408_0000).contains(&image.log_address),
            "{image:?}"
        );
        for length in [10, 60, 1000, bytes.len() / 2] {
            assert!(inspect(&bytes[..length]).is_err(), "{length}");
        }
    }
}

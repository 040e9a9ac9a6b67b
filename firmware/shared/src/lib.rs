//! What the images and the boot stage share. It knows no board and takes no interrupt.
#![no_std]

mod control_code;
#[cfg(feature = "stm32h743zi")]
pub mod flash_end;
pub mod flash_read;

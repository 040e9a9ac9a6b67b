//! Panic and hard fault: the end of a run. Both stop here with the reason; the safe output is set first.

use core::panic::PanicInfo;

#[panic_handler]
fn panic(information: &PanicInfo) -> ! {
    defmt::error!("panic: {}", defmt::Display2Format(information));
    cortex_m::peripheral::SCB::sys_reset()
}

//! Copies the control interrupt's code to its own memory, before anything else runs: the compiler's helpers
//! (`memcpy` and the like) live there too, and even the runtime's own start may call them. cortex-m-rt calls
//! `__pre_init` before it sets up memory.

core::arch::global_asm!(
    ".section .text.copy_control_code, \"ax\", %progbits",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    "ldr r0, =__control_code_start",
    "ldr r1, =__control_code_end",
    "ldr r2, =__control_code_load",
    "2:",
    "cmp r0, r1",
    "beq 3f",
    "ldr r3, [r2]",
    "str r3, [r0]",
    "adds r0, #4",
    "adds r2, #4",
    "b 2b",
    "3:",
    "dsb",
    "isb",
    "bx lr",
    ".ltorg",
);

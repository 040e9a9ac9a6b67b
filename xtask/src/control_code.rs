//! Checks of the control interrupt's machine code, from the binary.
//!
//! # How it works
//! Beginning at the interrupt's handler, the check follows every Thumb-2 instruction (literal pools are
//! skipped by the `$d`/`$t` mapping symbols), and every function that is called in turn. It fails on
//!
//! * an instruction of the floating-point unit (coprocessors 10 and 11);
//! * an undefined instruction, which is what an abort compiles to, if a jump or the instruction before it
//!   leads there (the entry of a jump table for a value that no `enum` has is counted apart: only corrupted
//!   memory has it);
//! * a call or jump that leaves the section: panics, formatting, logging and allocation all live in flash, so
//!   none of them is reachable;
//! * a call through a register, whose destination the binary does not tell;
//! * a stack frame of a size that the binary does not tell, and functions that call each other in a circle.
//!
//! So the stack that the interrupt takes is bounded: the deepest sum of frames along calls, each frame taken
//! as everything that its function ever pushes.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

const HANDLER: &str = "TIM2";
const SECTION: &str = ".control_code";

/// What the check found.
pub struct CodeFigures {
    /// Bytes of code that the interrupt can reach.
    pub control_code_bytes: u64,
    /// Functions among them.
    pub control_functions: usize,
    /// Jump tables whose entry for a value that no `enum` has is an abort: reached by corrupted memory only.
    pub impossible_cases: usize,
    /// Bytes of stack that the interrupt takes at most, what the processor stores at its entry included.
    pub stack_bytes: u64,
    /// Bytes in flash: code, constants, initial values.
    pub flash_bytes: u64,
    /// Bytes of static data in RAM.
    pub ram_bytes: u64,
}

/// The section with the interrupt's code, and what the symbols say of it.
struct Code<'a> {
    file: &'a object::File<'a>,
    bytes: &'a [u8],
    range: Range<u64>,
    /// Start of every function, with its size (0: unknown) and name.
    functions: BTreeMap<u64, (u64, String)>,
    /// Where data (`true`) or instructions (`false`) begin.
    kinds: BTreeMap<u64, bool>,
    handler: u64,
}

impl<'a> Code<'a> {
    fn read(file: &'a object::File<'a>, elf: &Path) -> Result<Self, String> {
        let section = file
            .section_by_name(SECTION)
            .ok_or_else(|| format!("{}: no section {SECTION}", elf.display()))?;
        let bytes = section.data().map_err(|error| error.to_string())?;
        let range = section.address()..section.address() + section.size();
        let (mut functions, mut kinds): (BTreeMap<u64, (u64, String)>, BTreeMap<u64, bool>) =
            Default::default();
        let mut handler = None;
        for symbol in file
            .symbols()
            .filter(|symbol| range.contains(&(symbol.address() & !1)))
        {
            let name = symbol.name().unwrap_or_default();
            if name.starts_with("$d") || name.starts_with("$t") {
                kinds.insert(symbol.address(), name.starts_with("$d"));
            } else if symbol.kind() == SymbolKind::Text {
                let start = symbol.address() & !1;
                if name == HANDLER {
                    handler = Some(start);
                }
                let entry = functions.entry(start).or_insert((0, String::new()));
                if symbol.size() >= entry.0 {
                    *entry = (symbol.size(), name.to_owned());
                }
            }
        }
        let handler = handler.ok_or_else(|| format!("{HANDLER} is not in {SECTION}"))?;
        Ok(Self {
            file,
            bytes,
            range,
            functions,
            kinds,
            handler,
        })
    }

    fn halfword(&self, address: u64) -> u16 {
        let at = (address - self.range.start) as usize;
        self.bytes
            .get(at..at + 2)
            .map_or(0, |pair| u16::from_le_bytes([pair[0], pair[1]]))
    }

    fn is_data(&self, at: u64) -> bool {
        self.kinds
            .range(..=at)
            .next_back()
            .is_some_and(|(_, is_data)| *is_data)
    }

    /// Addresses and name of the function that begins at `start`.
    fn function(&self, start: u64) -> Option<(Range<u64>, &str)> {
        let (size, name) = self.functions.get(&start)?;
        let next = || {
            self.functions
                .range(start + 1..)
                .next()
                .map_or(self.range.end, |(next, _)| *next)
        };
        Some((start..if *size > 0 { start + size } else { next() }, name))
    }
}

/// What the walk through one function has met.
#[derive(Default)]
struct Walk {
    /// Destinations of jumps inside the function.
    jumps: BTreeSet<u64>,
    /// Destinations in its jump tables.
    table_jumps: BTreeSet<u64>,
    /// Undefined instructions.
    aborts: Vec<u64>,
    /// Functions that it calls or ends in.
    calls: Vec<u64>,
    /// Bytes that all its instructions together take from the stack.
    frame_bytes: u64,
    complaints: Vec<String>,
}

impl Walk {
    /// Through all instructions of a function.
    fn through(code: &Code<'_>, body: &Range<u64>) -> Self {
        let mut walk = Self::default();
        let mut falls_through = true;
        let mut at = body.start;
        while at < body.end {
            if code.is_data(at) {
                at += 2;
            } else if code.halfword(at) >> 11 < 0b11101 {
                falls_through = walk.narrow(at, code.halfword(at), falls_through);
                at += 2;
            } else {
                falls_through = walk.wide(code, body, at);
                at += 4;
            }
        }
        walk
    }

    /// An instruction of 16 bits; whether the next one can follow it.
    fn narrow(&mut self, at: u64, instruction: u16, comes_here: bool) -> bool {
        if instruction & 0xFE00 == 0xB400 {
            self.frame_bytes += 4 * u64::from((instruction & 0x1FF).count_ones());
        } else if instruction & 0xFF80 == 0xB080 {
            self.frame_bytes += 4 * u64::from(instruction & 0x7F);
        } else if instruction & 0xFF00 == 0xDE00 {
            // Behind code that never comes here the compiler leaves one; whether a jump leads to it is known
            // at the end.
            if comes_here {
                self.jumps.insert(at);
            }
            self.aborts.push(at);
        } else if instruction & 0xFF80 == 0x4780 {
            self.complaints
                .push(format!("a call through a register at {at:#x}"));
        } else if instruction & 0xFF87 == 0x4700 && instruction != 0x4770 {
            // The linker's bridges for destinations out of a branch's reach end like this.
            self.complaints
                .push(format!("a jump through a register at {at:#x}"));
        } else if instruction & 0xF000 == 0xD000 && instruction & 0x0F00 < 0x0E00 {
            self.jumps
                .insert(relative(at, (i64::from(instruction as u8 as i8)) << 1));
        } else if instruction & 0xF800 == 0xE000 {
            self.jumps
                .insert(relative(at, i64::from(((instruction << 5) as i16) >> 4)));
        } else if instruction & 0xF500 == 0xB100 {
            self.jumps.insert(relative(
                at,
                i64::from((instruction >> 9 & 1) << 6 | (instruction >> 3 & 0x1F) << 1),
            ));
        }
        // B, BX, POP {.., pc}; conditional ones in an IT block are taken as ends too only when no abort
        // follows them.
        !(instruction & 0xF800 == 0xE000
            || instruction & 0xFF87 == 0x4700
            || instruction & 0xFF00 == 0xBD00)
    }

    /// An instruction of 32 bits; whether the next one can follow it.
    fn wide(&mut self, code: &Code<'_>, body: &Range<u64>, at: u64) -> bool {
        let (first, second) = (code.halfword(at), code.halfword(at + 2));
        if first & 0xEC00 == 0xEC00 && matches!(second >> 8 & 0xF, 10 | 11) {
            self.complaints
                .push(format!("a floating-point instruction at {at:#x}"));
        }
        match frame_bytes(first, second) {
            Ok(bytes) => self.frame_bytes += bytes,
            Err(()) => self
                .complaints
                .push(format!("a stack frame of unknown size at {at:#x}")),
        }
        // BL, and B with the same range (a tail call, or a jump within the function).
        if first & 0xF800 == 0xF000 && matches!(second & 0xD000, 0xD000 | 0x9000) {
            let target = branch_target(at, first, second);
            let is_call = second & 0xD000 == 0xD000;
            if body.contains(&target) && !is_call {
                self.jumps.insert(target);
            } else if code.range.contains(&target) {
                self.calls.push(target);
            } else {
                self.complaints.push(format!(
                    "leaves the section for {} at {at:#x}",
                    owner(code.file, target)
                ));
            }
            return is_call;
        }
        if first & 0xF800 == 0xF000 && second & 0xD000 == 0x8000 && first & 0x0380 != 0x0380 {
            self.jumps.insert(conditional_target(at, first, second));
        } else if first & 0xFFF0 == 0xE8D0 && second & 0xFFE0 == 0xF000 {
            self.jump_table(code, body, at, second & 0x10 != 0);
            return false;
        }
        true
    }

    /// TBB and TBH: the table stands behind the instruction, marked as data.
    fn jump_table(&mut self, code: &Code<'_>, body: &Range<u64>, at: u64, is_wide: bool) {
        let mut entry = at + 4;
        while entry < body.end && code.is_data(entry) {
            let pair = code.halfword(entry);
            for offset in if is_wide {
                vec![pair]
            } else {
                vec![pair & 0xFF, pair >> 8]
            } {
                self.table_jumps.insert(at + 4 + 2 * u64::from(offset));
            }
            entry += 2;
        }
    }
}

/// Walks the interrupt's code in the image.
pub fn check(elf: &Path) -> Result<CodeFigures, String> {
    let bytes = std::fs::read(elf).map_err(|error| format!("{}: {error}", elf.display()))?;
    let file =
        object::File::parse(&*bytes).map_err(|error| format!("{}: {error}", elf.display()))?;
    let code = Code::read(&file, elf)?;
    let (mut waiting, mut seen) = (vec![code.handler], BTreeSet::new());
    let mut frames = BTreeMap::new();
    let mut complaints = Vec::new();
    let mut impossible_cases = 0;
    while let Some(start) = waiting.pop() {
        if !seen.insert(start) {
            continue;
        }
        let Some((body, name)) = code.function(start) else {
            complaints.push(format!("a call to {start:#x}, which is no function"));
            continue;
        };
        let mut walk = Walk::through(&code, &body);
        for abort in &walk.aborts {
            if walk.jumps.contains(abort) {
                walk.complaints
                    .push(format!("an abort at {abort:#x} can be reached"));
            } else if walk.table_jumps.contains(abort) {
                impossible_cases += 1;
            }
        }
        complaints.extend(
            walk.complaints
                .iter()
                .map(|complaint| format!("{name}: {complaint}")),
        );
        waiting.extend(&walk.calls);
        frames.insert(start, (walk.frame_bytes, walk.calls));
    }
    let stack_bytes = deepest(&frames, code.handler, &mut Vec::new()).unwrap_or_else(|start| {
        complaints.push(format!("{} calls itself", owner(&file, start)));
        0
    });
    if !complaints.is_empty() {
        complaints.truncate(20);
        return Err(format!(
            "the control interrupt's code is not clean:\n  {}",
            complaints.join("\n  ")
        ));
    }
    let size_of = |wanted: &[&str]| -> u64 {
        wanted
            .iter()
            .filter_map(|name| file.section_by_name(name))
            .map(|s| s.size())
            .sum()
    };
    Ok(CodeFigures {
        control_code_bytes: seen
            .iter()
            .filter_map(|start| code.functions.get(start))
            .map(|(size, _)| size)
            .sum(),
        control_functions: seen.len(),
        impossible_cases,
        stack_bytes: ENTRY_BYTES + stack_bytes,
        flash_bytes: size_of(&[
            ".vector_table",
            ".start_code",
            ".control_code",
            ".text",
            ".rodata",
            ".data",
        ]),
        ram_bytes: size_of(&[".data", ".bss", ".uninit"]),
    })
}

/// What the processor stores at the entry of an interrupt at most: 26 words with the floating-point unit's,
/// and one that aligns them (Armv7-M, B1.5.7).
const ENTRY_BYTES: u64 = 27 * 4;

/// Bytes that an instruction of 32 bits takes from the stack.
///
/// # Errors
/// The instruction does not tell.
fn frame_bytes(first: u16, second: u16) -> Result<u64, ()> {
    let immediate = u32::from(first >> 10 & 1) << 11
        | u32::from(second >> 12 & 7) << 8
        | u32::from(second & 0xFF);
    Ok(match (first, second) {
        // STMDB and STRD with the stack pointer written back, STR before it.
        (0xE92D, _) => 4 * u64::from(second.count_ones()),
        (0xE96D, _) => 4 * u64::from(second & 0xFF),
        (0xF84D, _) if second & 0x0F00 == 0x0D00 => u64::from(second & 0xFF),
        // SUB and SUBW from the stack pointer.
        (0xF1AD | 0xF5AD, _) if second & 0x8F00 == 0x0D00 => match immediate >> 10 {
            0 if immediate >> 8 == 0 => u64::from(immediate),
            0 => return Err(()),
            _ => u64::from((0x80 | immediate & 0x7F).rotate_right(immediate >> 7)),
        },
        (0xF2AD | 0xF6AD, _) if second & 0x8F00 == 0x0D00 => u64::from(immediate),
        (0xEBAD, _) if second & 0x0F00 == 0x0D00 => return Err(()),
        _ => 0,
    })
}

/// The deepest stack from a function on.
///
/// # Errors
/// A function that comes back to itself.
fn deepest(
    frames: &BTreeMap<u64, (u64, Vec<u64>)>,
    start: u64,
    above: &mut Vec<u64>,
) -> Result<u64, u64> {
    if above.contains(&start) {
        return Err(start);
    }
    let Some((bytes, calls)) = frames.get(&start) else {
        return Ok(0);
    };
    above.push(start);
    let mut deepest_call = 0;
    for call in calls.iter().collect::<BTreeSet<_>>() {
        deepest_call = deepest(frames, *call, above)?.max(deepest_call);
    }
    above.pop();
    Ok(bytes + deepest_call)
}

/// Destination of a branch by `offset` from where the program counter reads.
fn relative(at: u64, offset: i64) -> u64 {
    at.wrapping_add(4).wrapping_add_signed(offset)
}

/// Destination of the wide conditional branch (T3).
fn conditional_target(at: u64, first: u16, second: u16) -> u64 {
    let (first, second) = (u32::from(first), u32::from(second));
    let offset = (first >> 10 & 1) << 20
        | (second >> 11 & 1) << 19
        | (second >> 13 & 1) << 18
        | (first & 0x3F) << 12
        | (second & 0x7FF) << 1;
    relative(at, i64::from(((offset << 11) as i32) >> 11))
}

/// Destination of BL (T1) and B (T4).
fn branch_target(at: u64, first: u16, second: u16) -> u64 {
    let (first, second) = (u32::from(first), u32::from(second));
    let sign = first >> 10 & 1;
    let i1 = 1 ^ (second >> 13 & 1) ^ sign;
    let i2 = 1 ^ (second >> 11 & 1) ^ sign;
    let offset = sign << 24 | i1 << 23 | i2 << 22 | (first & 0x3FF) << 12 | (second & 0x7FF) << 1;
    let offset = ((offset << 7) as i32) >> 7;
    at.wrapping_add(4).wrapping_add_signed(i64::from(offset))
}

fn owner(file: &object::File<'_>, address: u64) -> String {
    file.symbols()
        .find(|symbol| symbol.kind() == SymbolKind::Text && (symbol.address() & !1) == address)
        .and_then(|symbol| symbol.name().ok().map(str::to_owned))
        .unwrap_or_else(|| format!("{address:#x}"))
}

#[cfg(test)]
mod tests {
    use super::{branch_target, deepest, frame_bytes};
    use std::collections::BTreeMap;

    #[test]
    fn branches_go_where_the_manual_says() {
        // F000 F800: BL to the next instruction; F7FF FFFE: BL to itself (Arm ARM v7-M, A7.7.18).
        assert_eq!(branch_target(0x100, 0xF000, 0xF800), 0x104);
        assert_eq!(branch_target(0x100, 0xF7FF, 0xFFFE), 0x100);
        assert_eq!(branch_target(0x100, 0xF000, 0xB800), 0x104);
    }

    #[test]
    fn frames_are_what_the_instructions_take() {
        // push.w {r4-r11, lr}; str r0, [sp, #-8]!; strd r0, r1, [sp, #-16]!; sub.w sp, sp, #1024;
        // subw sp, sp, #1028; sub.w sp, sp, r0; add.w sp, sp, #1024.
        let takes = [
            (0xE92D, 0x4FF0, Ok(36)),
            (0xF84D, 0x0D08, Ok(8)),
            (0xE96D, 0x0104, Ok(16)),
            (0xF5AD, 0x6D80, Ok(1024)),
            (0xF2AD, 0x4D04, Ok(1028)),
            (0xEBAD, 0x0D00, Err(())),
            (0xF50D, 0x6D80, Ok(0)),
        ];
        for (first, second, bytes) in takes {
            assert_eq!(
                frame_bytes(first, second),
                bytes,
                "{first:04X} {second:04X}"
            );
        }
        let frames = BTreeMap::from([(0, (8, vec![1, 2])), (1, (100, vec![2])), (2, (16, vec![]))]);
        assert_eq!(deepest(&frames, 0, &mut Vec::new()), Ok(124));
        let circle = BTreeMap::from([(0, (8, vec![1])), (1, (8, vec![0]))]);
        assert_eq!(deepest(&circle, 0, &mut Vec::new()), Err(0));
    }
}

//! No damaged input ends in a panic, and what is accepted can be used.

use hysteron_tests::random_input::accepted;
use hysteron_tests::readers::targets;
use std::ops::Range;

/// Files in a compression that no reader here undoes: refused whole.
const REFUSED: [&str; 2] = ["brotli.parquet", "zstd.feather"];

fn read_all(seeds: &Range<u64>) {
    for target in targets() {
        for (name, bytes) in &target.wholes {
            assert_ne!(
                (target.read)(name, bytes),
                REFUSED.contains(&name.as_str()),
                "{}: {name} as it is",
                target.name
            );
        }
        let (found, inputs) = (accepted(&target, seeds.clone()), seeds.clone().count());
        // Damage that is always refused, or never, reaches nothing.
        assert!(
            (inputs / 20..inputs - inputs / 20).contains(&found),
            "{}: {found} of {inputs} were accepted",
            target.name
        );
    }
}

#[test]
fn every_reader_refuses_damaged_inputs_or_uses_them() {
    read_all(&(0..200));
}

mod long {
    use super::read_all;

    /// What a reader takes before it looks: a length in a damaged header asks for no memory.
    const MOST_MEMORY_KB: u64 = 300_000;

    fn peak_kb() -> u64 {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kb = line.and_then(|rest| rest.split_whitespace().next()?.parse().ok());
        kb.unwrap_or(0)
    }

    #[test]
    #[ignore = "a minute and a half: `cargo xtask full`"]
    fn many_damaged_inputs() {
        read_all(&(1_000..31_000));
        assert!(peak_kb() < MOST_MEMORY_KB, "{} KB", peak_kb());
    }
}

//! The `hysteron` program.
fn main() {}

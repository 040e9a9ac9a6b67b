//! Build and check chores.
fn main() {}

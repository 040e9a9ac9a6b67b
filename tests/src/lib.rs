//! Tests that cross the rooms of Hysteron.

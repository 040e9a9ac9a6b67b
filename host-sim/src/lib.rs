//! Float plant of Hysteron: physical effects and their chain.

//! The example recordings that the lab page and the program carry with them.

/// The files of `hidden_effect` by their names; its truth stays out.
pub const HIDDEN_EFFECT: [(&str, &str); 10] = [
    (
        "base_effects.txt",
        include_str!("hidden_effect/base_effects.txt"),
    ),
    ("dataset.toml", include_str!("hidden_effect/dataset.toml")),
    ("hold.csv", include_str!("hidden_effect/hold.csv")),
    ("hold2.csv", include_str!("hidden_effect/hold2.csv")),
    ("multisine.csv", include_str!("hidden_effect/multisine.csv")),
    ("rest.csv", include_str!("hidden_effect/rest.csv")),
    ("sines.csv", include_str!("hidden_effect/sines.csv")),
    ("stair.csv", include_str!("hidden_effect/stair.csv")),
    ("stair2.csv", include_str!("hidden_effect/stair2.csv")),
    (
        "validation.csv",
        include_str!("hidden_effect/validation.csv"),
    ),
];

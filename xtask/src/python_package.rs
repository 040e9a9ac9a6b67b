//! The Python package: its wheel, installed into a fresh virtual environment and tried there against the
//! program; and the formats of other libraries, written by them for the tests of library and program.

use std::path::Path;

use crate::dependency_tree::packages;
use crate::test_programs;
use crate::virtual_environment::{fresh, install, kept};
use crate::workspace::{AS_TESTED, built, cargo, command, emptied, root};

/// What the tests of package and formats use: the builder of wheels, a checker of types, the libraries of the
/// formats that are read, and the cluster of a survey, and what runs a notebook.
const TOOLS: [&str; 12] = [
    "maturin",
    "mypy",
    "numpy",
    "scipy",
    "h5py",
    "npTDMS",
    "pyarrow",
    "pandas",
    "openpyxl",
    "dask[distributed]",
    "nbclient",
    "ipykernel",
];

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Each package with its features.
const WITH_FEATURES: &str = "{p} {f}";

/// A package with other features than the tests' would be built once more for the wheel, and so would all that
/// stands on it.
fn shares_what_the_tests_have_built() -> Result<(), String> {
    let of_the_tests = packages(
        &[
            "--workspace",
            "--features",
            "hysteron-cli/full",
            "--edges",
            "normal,build,dev",
        ],
        WITH_FEATURES,
    )?;
    let of_the_wheel = packages(
        &["--package", "hysteron-python", "--edges", "normal,build"],
        WITH_FEATURES,
    )?;
    let others: Vec<&str> = of_the_wheel
        .difference(&of_the_tests)
        .map(String::as_str)
        .collect();
    if others.is_empty() {
        Ok(())
    } else {
        Err(format!(
            "the wheel has other features than the workspace: give lab/python/Cargo.toml those of {}",
            others.join(", ")
        ))
    }
}

/// The wheel against the program.
pub fn test() -> Result<(), String> {
    shares_what_the_tests_have_built()?;
    test_programs::build(AS_TESTED)?;
    let tools = kept("python/tools", &TOOLS)?;
    let wheels = emptied("python/wheels")?;
    let out = text(&wheels);
    let maturin = [
        "-m",
        "maturin",
        "build",
        "--quiet",
        "--release",
        "--manifest-path",
        "lab/python/Cargo.toml",
        "--out",
        &out,
    ];
    command(&tools, &maturin, &root(), &[])?;
    command(
        &tools,
        &["-m", "mypy", "--strict", "lab/python/hysteron"],
        &root(),
        &[],
    )?;
    let python = fresh("python/fresh")?;
    let wheel = std::fs::read_dir(&wheels)
        .ok()
        .and_then(|mut files| files.next()?.ok())
        .ok_or("no wheel was built")?;
    install(&python, &[&text(&wheel.path())])?;
    install(
        &tools,
        &["--force-reinstall", "--no-deps", &text(&wheel.path())],
    )?;
    let program = text(&built("hysteron"));
    command(
        &python,
        &[
            "-m",
            "unittest",
            "--quiet",
            "lab/python/tests/test_package.py",
        ],
        &root(),
        &[("HYSTERON", &program)],
    )?;
    command(
        &tools,
        &[
            "-m",
            "unittest",
            "--quiet",
            "lab/python/tests/test_survey.py",
        ],
        &root(),
        &[],
    )?;
    notebook(&tools, &[])
}

/// Runs the notebook of the examples in the environment that has the wheel.
fn notebook(tools: &Path, variables: &[(&str, &str)]) -> Result<(), String> {
    // Its kernel is looked for beside the interpreter, not among those of the user.
    let kernels = text(&tools.with_file_name("../share/jupyter"));
    let variables = [
        variables,
        &[
            ("JUPYTER_PATH", kernels.as_str()),
            ("PYTHONWARNINGS", "ignore::DeprecationWarning"),
        ],
    ]
    .concat();
    command(
        tools,
        &[
            "-m",
            "unittest",
            "--quiet",
            "lab/python/tests/test_notebook.py",
        ],
        &root(),
        &variables,
    )
}

/// Stores what the notebook prints now, with the wheel of the last `cargo xtask python`.
pub fn write_notebook() -> Result<(), String> {
    notebook(
        &kept("python/tools", &TOOLS)?,
        &[("HYSTERON_WRITE_NOTEBOOK", "1")],
    )
}

/// Library and program on files that the libraries of their formats have just written, whole and damaged.
pub fn formats() -> Result<(), String> {
    let folder = emptied("python/formats")?;
    command(
        &kept("python/tools", &TOOLS)?,
        &["lab/library/tests/formats/make.py", &text(&folder)],
        &root(),
        &[],
    )?;
    let test = [
        &["test", "--quiet"],
        AS_TESTED,
        &["--test", "integration", "formats::"],
    ]
    .concat();
    cargo(&test, &root(), &[("HYSTERON_FORMATS", &text(&folder))])
}

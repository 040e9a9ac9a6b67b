//! What is published: complete manifests, in an order in which each package finds those that it needs, packed
//! and built from the packed files alone.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

use crate::workspace::{cargo, root};

#[derive(Deserialize)]
struct Workspace {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    version: String,
    description: Option<String>,
    license: Option<String>,
    repository: Option<String>,
    readme: Option<String>,
    documentation: Option<String>,
    rust_version: Option<String>,
    keywords: Vec<String>,
    categories: Vec<String>,
    /// Registries; none where the package is not published, absent for any.
    publish: Option<Vec<String>>,
    dependencies: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    req: String,
    kind: Option<String>,
    path: Option<String>,
}

/// Manifests with a lock file of their own.
const OTHER_WORKSPACES: [&str; 2] = ["firmware", "board/probe"];

/// The registry takes five keywords and five categories.
const MOST_WORDS: usize = 5;

impl Package {
    fn is_published(&self) -> bool {
        self.publish.is_none()
    }

    /// What its manifest lacks.
    fn faults(&self) -> Vec<String> {
        let texts = [
            ("description", &self.description),
            ("license", &self.license),
            ("repository", &self.repository),
        ];
        let texts_of_published = [
            ("readme", &self.readme),
            ("documentation", &self.documentation),
            ("rust-version", &self.rust_version),
        ];
        let lists = [
            ("keywords", &self.keywords),
            ("categories", &self.categories),
        ];
        let mut faults: Vec<String> = Vec::new();
        let mut lacks =
            |what: &str| faults.push(format!("{}: {what} is missing in its manifest", self.name));
        texts
            .iter()
            .filter(|(_, text)| text.is_none())
            .for_each(|(what, _)| lacks(what));
        if self.is_published() {
            texts_of_published
                .iter()
                .filter(|(_, text)| text.is_none())
                .for_each(|(what, _)| lacks(what));
            lists
                .iter()
                .filter(|(_, words)| words.is_empty() || words.len() > MOST_WORDS)
                .for_each(|(what, _)| lacks(what));
            for dependency in self
                .dependencies
                .iter()
                .filter(|other| other.path.is_some() && other.kind.as_deref() != Some("dev"))
            {
                if dependency.req == "*" {
                    faults.push(format!(
                        "{}: its dependency {} has a path and no version",
                        self.name, dependency.name
                    ));
                }
            }
        }
        faults
    }
}

fn workspace(folder: &str) -> Result<Workspace, String> {
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .current_dir(root().join(folder))
        .output()
        .map_err(|error| format!("cargo metadata: {error}"))?;
    if !output.status.success() {
        return Err(format!(
            "cargo metadata in {folder}: {}",
            String::from_utf8_lossy(&output.stderr)
        ));
    }
    serde_json::from_slice(&output.stdout)
        .map_err(|error| format!("cargo metadata in {folder}: {error}"))
}

/// The published packages, each behind those that it needs to be built or tested.
fn in_order(packages: &[Package]) -> Result<Vec<&Package>, String> {
    let mut left: Vec<&Package> = packages
        .iter()
        .filter(|package| package.is_published())
        .collect();
    let published: BTreeSet<&str> = left.iter().map(|package| package.name.as_str()).collect();
    let (mut order, mut placed) = (Vec::new(), BTreeSet::new());
    while !left.is_empty() {
        let is_ready = |package: &&Package| {
            package.dependencies.iter().all(|other| {
                other.path.is_none()
                    || placed.contains(other.name.as_str())
                    || (other.kind.as_deref() == Some("dev") && other.req == "*")
            })
        };
        let (ready, later): (Vec<&Package>, Vec<&Package>) =
            left.iter().partition(|package| is_ready(package));
        if ready.is_empty() {
            let needs = |package: &Package| {
                let missing = package.dependencies.iter().filter(|other| {
                    other.path.is_some() && !published.contains(other.name.as_str())
                });
                missing
                    .map(|other| other.name.clone())
                    .collect::<Vec<_>>()
                    .join(", ")
            };
            let waiting: Vec<String> = later
                .iter()
                .map(|package| format!("{} (unpublished: {})", package.name, needs(package)))
                .collect();
            return Err(format!("no order to publish: {}", waiting.join("; ")));
        }
        placed.extend(ready.iter().map(|package| package.name.as_str()));
        order.extend(ready);
        left = later;
    }
    Ok(order)
}

/// One address and one version everywhere, also where a manifest cannot inherit them.
fn agree(packages: &[Package]) -> Vec<String> {
    let mut faults = Vec::new();
    let first = packages
        .first()
        .map(|package| (&package.repository, &package.version));
    for package in packages {
        if first.is_some_and(|(repository, version)| {
            *repository != package.repository || *version != package.version
        }) {
            faults.push(format!(
                "{}: repository or version differs from the workspace's",
                package.name
            ));
        }
    }
    let repository = packages
        .first()
        .and_then(|package| package.repository.clone())
        .unwrap_or_default();
    for file in ["lab/python/pyproject.toml", "CITATION.cff"] {
        let text = std::fs::read_to_string(root().join(file)).unwrap_or_default();
        if !text.contains(&repository) {
            faults.push(format!(
                "{file}: expected the workspace's repository {repository}"
            ));
        }
    }
    faults
}

/// Manifests, without building.
///
/// # Errors
/// What they lack.
pub fn manifests() -> Result<(), String> {
    let here = workspace(".")?;
    let mut packages = here.packages;
    for folder in OTHER_WORKSPACES {
        packages.extend(workspace(folder)?.packages);
    }
    let mut faults = agree(&packages);
    packages
        .iter()
        .for_each(|package| faults.extend(package.faults()));
    if !faults.is_empty() {
        return Err(faults.join("\n"));
    }
    let order = in_order(&packages)?;
    println!(
        "   published in this order: {}",
        order
            .iter()
            .map(|package| package.name.as_str())
            .collect::<Vec<_>>()
            .join(", ")
    );
    Ok(())
}

/// Packs every published package and builds it from the packed files; nothing is uploaded.
///
/// # Errors
/// What cannot be packed or built.
pub fn check() -> Result<(), String> {
    manifests()?;
    let here = workspace(".")?;
    let order = in_order(&here.packages)?;
    forget_packed_before()?;
    let mut arguments = vec!["package", "--quiet", "--locked", "--allow-dirty"];
    order
        .iter()
        .for_each(|package| arguments.extend(["--package", package.name.as_str()]));
    cargo(&arguments, &root(), &[])
}

/// Cargo keeps unpacked and built packages by their version. With the same version it would build the packed
/// files of the last run.
fn forget_packed_before() -> Result<(), String> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| std::env::home_dir().map(|home| home.join(".cargo")));
    let registries = ["src", "cache", "index"]
        .into_iter()
        .filter_map(|part| Some(home.as_ref()?.join("registry").join(part)));
    // The registry of packed files has no host, and its folders begin with the hyphen behind that.
    let unpacked = registries.flat_map(|folder| begin_with(&folder, "-"));
    let built = begin_with(&root().join("target/debug/.fingerprint"), "hysteron");
    for path in unpacked.chain(built) {
        let removed = if path.is_dir() {
            std::fs::remove_dir_all(&path)
        } else {
            std::fs::remove_file(&path)
        };
        removed.map_err(|error| format!("{}: {error}", path.display()))?;
    }
    Ok(())
}

/// What a folder holds whose name begins so; nothing where there is no such folder.
fn begin_with(folder: &Path, beginning: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let is_so = |path: &PathBuf| {
        path.file_name()
            .is_some_and(|name| name.to_string_lossy().starts_with(beginning))
    };
    entries.filter(is_so).collect()
}

//! Files beside the sources: workflows, citation, licences. Each is judged by the tool of its format, in a virtual environment of their own.

use crate::steps::{command, root};
use crate::virtual_environment::kept;

/// Schemas that come with the tool, an audit of workflows, and the REUSE tool; all work without a network.
const TOOLS: [&str; 3] = ["check-jsonschema", "zizmor", "reuse"];

/// Workflows and citation, then the licence of every file.
///
/// # Errors
/// What a tool finds.
pub fn lint() -> Result<(), String> {
    let python = kept("python/house", &TOOLS)?;
    let tool = |name: &str, arguments: &[&str]| command(python.with_file_name(name), arguments, &root(), &[]);
    let mut workflows: Vec<String> = std::fs::read_dir(root().join(".github/workflows"))
        .map_err(|error| format!(".github/workflows: {error}"))?
        .filter_map(|file| Some(format!(".github/workflows/{}", file.ok()?.file_name().to_str()?)))
        .collect();
    workflows.sort();
    let files: Vec<&str> = workflows.iter().map(String::as_str).collect();
    tool("check-jsonschema", &[&["--builtin-schema", "vendor.github-workflows"], &files[..]].concat())?;
    tool("check-jsonschema", &["--builtin-schema", "vendor.citation-file-format", "CITATION.cff"])?;
    tool("zizmor", &[&["--offline", "--quiet"], &files[..]].concat())?;
    tool("reuse", &["lint", "--quiet"])
}

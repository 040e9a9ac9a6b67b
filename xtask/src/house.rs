//! Files beside the sources: workflows, citation, licences. Each is judged by the tool of its format, in a
//! virtual environment of their own.

use crate::virtual_environment::kept;
use crate::workspace::{command, root};

/// Schemas that come with the tool, an audit of workflows, and the REUSE tool; all work without a network.
const TOOLS: [&str; 3] = ["check-jsonschema", "zizmor", "reuse"];

/// Workflows and citation, then the licence of every file.
///
/// # Errors
/// What a tool finds.
pub fn lint() -> Result<(), String> {
    let python = kept("python/house", &TOOLS)?;
    let tool = |name: &str, arguments: &[&str]| {
        command(python.with_file_name(name), arguments, &root(), &[])
    };
    let mut workflows: Vec<String> = std::fs::read_dir(root().join(".github/workflows"))
        .map_err(|error| format!(".github/workflows: {error}"))?
        .filter_map(|file| {
            Some(format!(
                ".github/workflows/{}",
                file.ok()?.file_name().to_str()?
            ))
        })
        .collect();
    workflows.sort();
    for file in &workflows {
        let text = std::fs::read_to_string(root().join(file))
            .map_err(|error| format!("{file}: {error}"))?;
        let faults = unknown_names(&text);
        if !faults.is_empty() {
            return Err(faults
                .iter()
                .map(|fault| format!("{file}: {fault}"))
                .collect::<Vec<_>>()
                .join("\n"));
        }
    }
    let files: Vec<&str> = workflows.iter().map(String::as_str).collect();
    tool(
        "check-jsonschema",
        &[&["--builtin-schema", "vendor.github-workflows"], &files[..]].concat(),
    )?;
    tool(
        "check-jsonschema",
        &[
            "--builtin-schema",
            "vendor.citation-file-format",
            "CITATION.cff",
        ],
    )?;
    tool("zizmor", &[&["--offline", "--quiet"], &files[..]].concat())?;
    tool("reuse", &["lint", "--quiet"])
}

/// Names that nothing in a workflow defines, which neither schema nor audit looks for: jobs in `needs`, keys
/// of a matrix, identifiers of steps.
fn unknown_names(workflow: &str) -> Vec<String> {
    let jobs: Vec<(&str, &str)> = split_jobs(workflow);
    let mut faults = Vec::new();
    for (job, text) in &jobs {
        let needs = text
            .lines()
            .filter_map(|line| line.strip_prefix("    needs:"));
        for name in needs
            .flat_map(|list| list.split(['[', ']', ',', ' ']))
            .filter(|name| !name.is_empty())
        {
            if !jobs.iter().any(|(other, _)| *other == name) {
                faults.push(format!("job `{job}` needs `{name}`, which is not a job"));
            }
        }
        for (context, definition) in [("matrix.", ""), ("steps.", "id: ")] {
            for name in text
                .split("${{")
                .skip(1)
                .filter_map(|rest| rest.split_once("}}"))
                .flat_map(|(inside, _)| names_in(inside, context))
            {
                let defined = if definition.is_empty() {
                    format!("{name}:")
                } else {
                    format!("{definition}{name}")
                };
                if !text
                    .split([' ', '{'])
                    .collect::<Vec<_>>()
                    .join(" ")
                    .contains(&format!(" {defined}"))
                {
                    faults.push(format!(
                        "job `{job}` uses `{context}{name}`, which it does not define"
                    ));
                }
            }
        }
    }
    faults
}

/// Jobs by name, each with its text: two blanks before the name, more before what belongs to it.
fn split_jobs(workflow: &str) -> Vec<(&str, &str)> {
    let Some((_, jobs)) = workflow.split_once("\njobs:\n") else {
        return Vec::new();
    };
    let mut found: Vec<(&str, usize, usize)> = Vec::new();
    let mut at = 0;
    for line in jobs.split_inclusive('\n') {
        let name = line
            .strip_prefix("  ")
            .filter(|rest| !rest.starts_with([' ', '#']))
            .and_then(|rest| rest.trim_end().strip_suffix(':'));
        if let Some(name) = name {
            found.push((name, at, at));
        }
        at += line.len();
        if let Some(last) = found.last_mut() {
            last.2 = at;
        }
    }
    found
        .into_iter()
        .map(|(name, from, to)| (name, &jobs[from..to]))
        .collect()
}

/// What follows a context such as `matrix.` in an expression.
fn names_in<'a>(expression: &'a str, context: &'a str) -> impl Iterator<Item = &'a str> {
    let is_part = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    expression
        .split(context)
        .skip(1)
        .filter_map(move |rest| rest.split(|c: char| !is_part(c)).next())
}

#[cfg(test)]
mod tests {
    use super::unknown_names;

    const RELEASE: &str = include_str!("../../.github/workflows/release.yml");

    #[test]
    fn a_misspelt_job_or_key_of_a_matrix_is_found() {
        assert_eq!(unknown_names(RELEASE), Vec::<String>::new());
        let job = RELEASE.replace("needs: [program, wheel", "needs: [programme, wheel");
        assert_eq!(
            unknown_names(&job),
            ["job `publish` needs `programme`, which is not a job"]
        );
        let key = RELEASE.replacen("${{ matrix.system }}", "${{ matrix.sistem }}", 1);
        assert_eq!(
            unknown_names(&key),
            ["job `program` uses `matrix.sistem`, which it does not define"]
        );
        let step = RELEASE.replacen("${{ github.token }}", "${{ steps.made.outputs.token }}", 1);
        assert_eq!(
            unknown_names(&step),
            ["job `publish` uses `steps.made`, which it does not define"]
        );
    }
}

//! Pages for `man`, from the text of `--help`.

use crate::desk::Desk;
use clap::Command;
use hysteron::{Error, Result};
use std::path::Path;

/// A page for a command, then for each below it: the name of its file and its text.
fn pages(command: &Command) -> std::io::Result<Vec<(String, Vec<u8>)>> {
    let name = command.get_display_name().unwrap_or(command.get_name());
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut page)?;
    let mut all = vec![(format!("{name}.1"), page)];
    let shown = command.get_subcommands().filter(|c| !c.is_hide_set());
    for below in shown {
        all.extend(pages(below)?);
    }
    Ok(all)
}

/// Writes the pages of a program into a folder.
pub fn write_manual(program: Command, folder: &Path, force: bool) -> Result<bool> {
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let pages = pages(&program)
        .map_err(|error| Error::new("manual", format!("cannot be laid out: {error}")))?;
    let desk = Desk::new(force);
    let names: Vec<String> = pages.iter().map(|(name, _)| name.clone()).collect();
    desk.folder(folder, &names)?;
    for (name, page) in &pages {
        desk.write(&folder.join(name), page)?;
    }
    println!("{} pages in {}", pages.len(), folder.display());
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Arg;

    #[test]
    fn every_command_that_is_shown_has_a_page_with_its_options() {
        let quick =
            Command::new("quick").arg(Arg::new("rate").long("rate-hz").help("samples a second"));
        let worker = Command::new("worker").hide(true);
        let mut program = Command::new("tool").subcommands([quick, worker]);
        program.build();
        let pages = pages(&program).expect("pages");
        let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
        assert!(
            names.contains(&"tool.1") && names.contains(&"tool-quick.1"),
            "{names:?}"
        );
        assert!(!names.contains(&"tool-worker.1"), "{names:?}");
        let page = String::from_utf8_lossy(&pages[1].1).into_owned();
        assert!(
            page.contains("rate\\-hz") && page.contains("samples a second"),
            "{page}"
        );
    }
}

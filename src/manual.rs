//! `quadrant completions` and `quadrant man`: what a packager installs beside the command, made from the command line itself.

use std::fs;
use std::path::Path;

use anyhow::Context;
use clap::CommandFactory;
use clap_mangen::Man;

use crate::cli::{Cli, CompletionsOptions, ManOptions};
use crate::exit::{Kind, Outcome};
use crate::output::say;

/// Prints a shell's completion script.
pub fn completions(options: &CompletionsOptions) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(options.shell, &mut Cli::command(), "quadrant", &mut script);
    say(String::from_utf8_lossy(&script).trim_end());
    Ok(())
}

/// Writes the manual pages: `quadrant.1` and one for each subcommand.
pub fn man(options: &ManOptions) -> Outcome {
    let folder = &options.out;
    let shown = folder.display();
    fs::create_dir_all(folder)
        .with_context(|| format!("{shown}: cannot be made"))
        .environment()?;
    let mut command = Cli::command().disable_help_subcommand(true);
    command.build();
    let pages = pages(&command, folder).environment()?;
    say(&format!("{pages} manual pages: {shown}"));
    Ok(())
}

/// The pages of a command and of those below it; hidden ones are nobody's to call, and have none.
fn pages(command: &clap::Command, folder: &Path) -> anyhow::Result<usize> {
    let mut count = 1;
    for below in command.get_subcommands().filter(|sub| !sub.is_hide_set()) {
        count += pages(below, folder)?;
    }
    let man = Man::new(command.clone())
        .source(concat!("quadrant ", env!("CARGO_PKG_VERSION")))
        .manual("Quadrant");
    let mut page = Vec::new();
    man.render(&mut page)?;
    let file = folder.join(man.get_filename());
    fs::write(&file, tidy(&String::from_utf8_lossy(&page)))
        .with_context(|| format!("{}: cannot be written", file.display()))?;
    Ok(count)
}

/// A page without the line breaks beside its empty lines, which say nothing there and are warned of.
fn tidy(page: &str) -> String {
    let lines: Vec<&str> = page.lines().collect();
    let at = |index: Option<usize>| index.and_then(|index| lines.get(index)).copied();
    let mut tidy = String::with_capacity(page.len());
    for (index, line) in lines.iter().enumerate() {
        let beside = [at(index.checked_sub(1)), at(Some(index + 1))];
        if *line == ".br"
            && beside
                .iter()
                .flatten()
                .any(|line| matches!(*line, ".sp" | ""))
        {
            continue;
        }
        tidy += line;
        tidy.push('\n');
    }
    tidy
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_break_beside_an_empty_line_is_left_out_and_others_stay() {
        assert_eq!(tidy("a\n.br\n.sp\n.br\nb\n.br\nc\n"), "a\n.sp\nb\n.br\nc\n");
        assert_eq!(tidy("a\n.br\n\n.br\nb\n"), "a\n\nb\n");
    }

    #[test]
    fn the_command_line_keeps_its_own_rules() {
        Cli::command().debug_assert();
    }
}

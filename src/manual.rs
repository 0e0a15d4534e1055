//! What the program says of itself: shell completions, manual pages, the reference of its files.

use std::fs;
use std::path::Path;

use anyhow::Context;
use clap::CommandFactory;
use clap_mangen::Man;

use console::exit::{Kind, Outcome};
use console::output::say;

use crate::cli::{Cli, CompletionsOptions, ManOptions, ReferenceOptions};
use crate::reference;

/// Columns of the help in the book.
const BOOK_COLUMNS: usize = 100;

/// Prints a shell's completion script.
///
/// # Errors
/// None.
pub fn completions(options: &CompletionsOptions) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(options.shell, &mut Cli::command(), "quadrant", &mut script);
    say(String::from_utf8_lossy(&script).trim_end());
    Ok(())
}

/// Writes the manual pages: `quadrant.1` and one for each subcommand.
///
/// # Errors
/// They cannot be written.
pub fn man(options: &ManOptions) -> Outcome {
    let folder = &options.out;
    let shown = folder.display();
    fs::create_dir_all(folder)
        .with_context(|| format!("{shown}: cannot be made"))
        .environment()?;
    let mut command = Cli::command()
        .disable_help_subcommand(true)
        .term_width(BOOK_COLUMNS);
    command.build();
    let pages = if options.markdown {
        book_pages(&command, folder)
    } else {
        pages(&command, folder)
    };
    say(&format!("{} manual pages: {shown}", pages.environment()?));
    Ok(())
}

/// Prints the page of a file in the reference, or its schema.
///
/// # Errors
/// None.
pub fn reference(options: &ReferenceOptions) -> Outcome {
    let files = reference::settings_files().into_iter();
    let mut named = files.filter(|(name, ..)| *name == options.file);
    if let Some((_, introduction, schema)) = named.next() {
        let text = match options.schema {
            true => schema.json(),
            false => reference::page(introduction, &schema),
        };
        say(text.trim_end());
    }
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

/// A page of the book for each command that is not hidden.
fn book_pages(command: &clap::Command, folder: &Path) -> anyhow::Result<usize> {
    let mut count = 0;
    for below in command.get_subcommands().filter(|sub| !sub.is_hide_set()) {
        let name = below.get_bin_name().unwrap_or(below.get_name());
        let help = below.clone().render_long_help().to_string();
        let lines: Vec<&str> = help.lines().map(str::trim_end).collect();
        let page = format!(
            "# `{name}`\n\n<!-- Made from the command line: `quadrant man --markdown --out docs/reference/commands`. -->\n\n```text\n{}\n```\n",
            lines.join("\n").trim_end()
        );
        let file = folder.join(format!("{}.md", name.replace(' ', "-")));
        fs::write(&file, page).with_context(|| format!("{}: cannot be written", file.display()))?;
        count += 1 + book_pages(below, folder)?;
    }
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

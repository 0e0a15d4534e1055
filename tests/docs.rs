//! The book: its links, its contents, its lines, and what it names of the code.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::root;

/// Longest line of prose, in characters; tables, code and lines without a space to break at may be longer.
const COLUMNS: usize = 120;

/// Files below a folder whose names end so, without build output.
fn files(folder: &Path, endings: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).expect("a folder").flatten() {
            let path = entry.path();
            let name = entry.file_name().to_string_lossy().into_owned();
            if path.is_dir() {
                if !["target", "runs", ".git"].contains(&name.as_str()) {
                    folders.push(path);
                }
            } else if endings.iter().any(|ending| name.ends_with(ending)) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The pages of the book.
fn pages() -> Vec<PathBuf> {
    files(&root().join("docs"), &[".md"])
}

/// The pages and the README.
fn documents() -> Vec<PathBuf> {
    let mut documents = pages();
    documents.push(root().join("README.md"));
    documents
}

/// Name of a file from the top of the sources, for messages.
fn shown(path: &Path) -> String {
    let short = path.strip_prefix(root()).unwrap_or(path);
    short.display().to_string()
}

/// Lines outside fenced code, each with its number from 1.
fn outside_code(text: &str) -> Vec<(usize, &str)> {
    let mut in_code = false;
    let mut lines = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            in_code = !in_code;
        } else if !in_code {
            lines.push((index + 1, line));
        }
    }
    lines
}

/// Text between backticks, outside fenced code.
fn code_spans(text: &str) -> Vec<String> {
    let prose: Vec<&str> = outside_code(text).iter().map(|(_, line)| *line).collect();
    let prose = prose.join("\n");
    prose
        .split('`')
        .skip(1)
        .step_by(2)
        .map(|span| span.replace('\n', " "))
        .collect()
}

/// Targets of links and pictures: what is in round brackets behind square ones.
fn links(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (number, line) in outside_code(text) {
        for (index, _) in line.match_indices("](") {
            let rest = &line[index + 2..];
            let target = rest.split(')').next().unwrap_or_default();
            found.push((number, target.to_string()));
        }
    }
    found
}

/// The name under which a heading can be linked to, as mdBook and GitHub make it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter_map(|c| match c {
        c if c.is_alphanumeric() || c == '_' || c == '-' => Some(c.to_ascii_lowercase()),
        c if c.is_whitespace() => Some('-'),
        _ => None,
    });
    kept.collect()
}

fn anchors(text: &str) -> BTreeSet<String> {
    outside_code(text)
        .into_iter()
        .filter(|(_, line)| line.starts_with('#'))
        .map(|(_, line)| anchor(line.trim_start_matches('#')))
        .collect()
}

#[test]
fn every_link_of_the_book_leads_somewhere() {
    let mut broken = Vec::new();
    let mut seen = 0;
    for document in documents() {
        let text = read(&document);
        for (number, target) in links(&text) {
            if target.contains("://") || target.starts_with("mailto:") {
                continue;
            }
            seen += 1;
            let (file, fragment) = target.split_once('#').unwrap_or((target.as_str(), ""));
            let folder = document.parent().expect("a folder");
            let path = match file {
                "" => document.clone(),
                file => folder.join(file),
            };
            let good = if !path.exists() {
                false
            } else if fragment.is_empty() {
                true
            } else {
                anchors(&read(&path)).contains(fragment)
            };
            if !good {
                broken.push(format!("{}:{number}: {target}", shown(&document)));
            }
        }
    }
    assert!(seen > 100, "{seen} links");
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn every_page_is_in_the_summary_and_the_summary_names_no_page_twice() {
    let docs = root().join("docs");
    let summary = read(&docs.join("SUMMARY.md"));
    let named: Vec<String> = links(&summary)
        .into_iter()
        .map(|(_, target)| target)
        .collect();
    let once: BTreeSet<&String> = named.iter().collect();
    assert_eq!(once.len(), named.len(), "a page stands twice in SUMMARY.md");
    let there: BTreeSet<String> = pages()
        .iter()
        .filter_map(|page| Some(page.strip_prefix(&docs).ok()?.display().to_string()))
        .filter(|page| page != "SUMMARY.md")
        .collect();
    let named: BTreeSet<String> = named.into_iter().collect();
    assert_eq!(named, there);
}

#[test]
fn no_line_of_prose_is_over_120_columns() {
    let mut long = Vec::new();
    for document in documents() {
        for (number, line) in outside_code(&read(&document)) {
            let is_table = line.trim_start().starts_with('|');
            let is_picture = line.starts_with("![");
            // What a test runs stays on one line.
            let is_comment = line.starts_with("<!-- ");
            // One link or word alone has no place to break at.
            let breaks = line.trim().trim_start_matches("- ").contains(' ') && !is_link(line);
            if line.chars().count() > COLUMNS && !is_table && !is_picture && !is_comment && breaks {
                long.push(format!("{}:{number}", shown(&document)));
            }
        }
    }
    assert!(long.is_empty(), "{}", long.join("\n"));
}

/// Whether a line is a link and hardly more.
fn is_link(line: &str) -> bool {
    let link: usize = line
        .split_once('[')
        .and_then(|(_, rest)| Some(rest.split_once(')')?.0.chars().count()))
        .unwrap_or(0);
    line.contains("](") && link + 20 > line.trim().chars().count()
}

/// Whoever uses a machine needs neither sources nor tests; whoever changes it finds them on the developers' pages.
#[test]
fn pages_for_users_name_no_sources_and_no_tests() {
    let developers = root().join("docs/developers");
    let mut named = Vec::new();
    for page in documents() {
        if page.starts_with(&developers) {
            continue;
        }
        for span in code_spans(&read(&page)) {
            // An address such as `[::1]` is none.
            let is_item = span.contains("::") && !span.contains("[::");
            if is_item || span.contains(".rs") {
                named.push(format!("{}: `{span}`", shown(&page)));
            }
        }
    }
    assert!(named.is_empty(), "{}", named.join("\n"));
}

/// Sources of Rust, with their text.
fn rust_sources() -> Vec<(PathBuf, String)> {
    let sources = files(&root(), &[".rs"]).into_iter();
    sources.map(|path| (path.clone(), read(&path))).collect()
}

#[test]
fn every_source_and_every_test_that_a_developers_page_names_is_there() {
    let sources = rust_sources();
    let test_exists = |file: Option<&str>, name: &str| {
        let name = name.trim_end_matches("()");
        let start = name.strip_suffix('…').unwrap_or(name);
        let call = if start == name {
            format!("fn {start}(")
        } else {
            format!("fn {start}")
        };
        let in_file = |path: &Path| {
            let is = |file: &str| {
                let places = ["tests", "tests/processes"];
                let mut places = places.iter();
                places.any(|place| path.ends_with(format!("{place}/{file}.rs")))
            };
            file.is_none_or(is)
        };
        let mut files = sources.iter().filter(|(path, _)| in_file(path));
        match start {
            "*" => files.next().is_some(),
            _ => files.any(|(_, text)| text.contains(&call)),
        }
    };
    let mut missing = Vec::new();
    for page in pages() {
        if !page.starts_with(root().join("docs/developers")) {
            continue;
        }
        for span in code_spans(&read(&page)) {
            let is_path = span.ends_with(".rs") || span.ends_with(".py") || span.ends_with('/');
            let good = if span.contains(' ') {
                true
            } else if is_path && span.contains('/') && !span.starts_with(['/', '<']) {
                root().join(&span).exists()
            } else if let Some((module, name)) = span.split_once("::") {
                // A test of `tests/`, or an item of the code.
                let is_test = name == "*" || name.ends_with('…') || name.matches('_').count() > 2;
                !is_test || test_exists(Some(module), name)
            } else if span.ends_with('…') && span.contains('_') {
                test_exists(None, &span)
            } else {
                true
            };
            if !good {
                missing.push(format!("{}: `{span}`", shown(&page)));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

/// Help texts, messages and comments that send their reader to a page.
#[test]
fn every_page_that_the_sources_name_is_there() {
    let endings = [".rs", ".toml", ".yml", ".py", ".service", ".slice", "run"];
    let mut missing = Vec::new();
    for file in files(&root(), &endings) {
        // A shell script of this PC, or a program that was built.
        let Ok(text) = fs::read_to_string(&file) else {
            continue;
        };
        for (index, _) in text.match_indices("docs/") {
            let name: String = text[index..]
                .chars()
                .take_while(|c| c.is_ascii_alphanumeric() || "/-_.".contains(*c))
                .collect();
            let Some((page, _)) = name.split_once(".md") else {
                continue;
            };
            let page = format!("{page}.md");
            if !root().join(&page).exists() {
                missing.push(format!("{}: {page}", shown(&file)));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

/// Names of the libraries that a manifest lists, those of the workspace left out.
fn named_libraries(manifest: &str) -> Vec<String> {
    let mut section = "";
    let mut names = Vec::new();
    for line in manifest.lines() {
        if let Some(header) = line.strip_prefix('[') {
            section = header.trim_end_matches(']');
        } else if section.ends_with("dependencies") && section != "workspace.dependencies" {
            let name = line.split(['.', ' ', '=']).next().unwrap_or_default();
            if !name.is_empty() && !name.starts_with('#') {
                names.push(name.to_string());
            }
        }
    }
    names
}

#[test]
fn every_direct_dependency_has_a_line() {
    let manifests = files(&root(), &["Cargo.toml"]);
    let own: BTreeSet<String> = manifests
        .iter()
        .filter_map(|path| {
            let text = read(path);
            let (_, after) = text.split_once("\nname = \"")?;
            Some(after.split('"').next()?.to_string())
        })
        .collect();
    let named: BTreeSet<String> = manifests
        .iter()
        .flat_map(|path| named_libraries(&read(path)))
        .filter(|name| !own.contains(name))
        .collect();
    let page = read(&root().join("docs/developers/dependencies.md"));
    let lines = page.lines().filter_map(|line| line.strip_prefix("| `"));
    let described: BTreeSet<String> = lines
        .filter_map(|line| Some(line.split('`').next()?.to_string()))
        .collect();
    assert_eq!(named, described);
}

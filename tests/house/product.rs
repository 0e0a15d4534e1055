//! The sources of a crate as they are built: without blank lines, comments, and what only tests have.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::sources;

/// Lines of code of a crate, by its sources.
pub struct Product {
    root: PathBuf,
    code: BTreeMap<PathBuf, Vec<String>>,
}

impl Product {
    /// Reads the crate whose folder this is.
    pub fn of(krate: &Path) -> Product {
        let root = krate.join("src");
        let (mut all, mut of_tests) = (BTreeMap::new(), BTreeSet::new());
        for (path, text) in sources(&root) {
            let (code, tests) = code(&text);
            let mut inner = path.with_extension("");
            if inner.ends_with("lib") || inner.ends_with("main") {
                inner.pop();
            }
            of_tests.extend(tests.into_iter().map(|name| inner.join(name)));
            all.insert(path, code);
        }
        all.retain(|path, _| {
            let file = path.with_extension("");
            !file.ancestors().any(|part| of_tests.contains(part))
        });
        Product { root, code: all }
    }

    /// The lines of code of each source.
    pub fn files(&self) -> &BTreeMap<PathBuf, Vec<String>> {
        &self.code
    }

    /// How many there are.
    pub fn lines(&self) -> usize {
        self.code.values().map(Vec::len).sum()
    }

    /// Modules at the top of the crate that lead back to themselves by what they use; a module is its file and its folder.
    pub fn circles(&self) -> Vec<String> {
        let uses = self.uses();
        let reached = |from: &String| {
            let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
            while let Some(module) = open.pop() {
                for used in uses.get(module).into_iter().flatten() {
                    if reached.insert(used.clone()) {
                        open.push(used);
                    }
                }
            }
            reached
        };
        uses.keys()
            .filter(|module| reached(module).contains(*module))
            .cloned()
            .collect()
    }

    /// Which modules at the top each of them names, a name that the crate's root passes on counted where it is from.
    fn uses(&self) -> BTreeMap<String, BTreeSet<String>> {
        let path_of = |file: &Path| -> Vec<String> {
            let inner = file
                .strip_prefix(&self.root)
                .expect("below src")
                .with_extension("");
            let parts = inner.iter().map(|part| part.to_string_lossy().into_owned());
            parts.collect()
        };
        let modules: BTreeSet<String> = self
            .code
            .keys()
            .map(|file| path_of(file).remove(0))
            .collect();
        let passed_on = self.passed_on();
        let mut uses: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for (file, code) in &self.code {
            let path = path_of(file);
            let own = &path[0];
            if ["lib", "main"].contains(&own.as_str()) {
                continue;
            }
            for line in code {
                for name in names_at_the_top(line, path.len()) {
                    let module = modules.get(&name).or_else(|| passed_on.get(&name));
                    if let Some(module) = module.filter(|module| *module != own) {
                        uses.entry(own.clone()).or_default().insert(module.clone());
                    }
                }
            }
        }
        uses
    }

    /// The names that the crate's root passes on, each with the module that it is from.
    fn passed_on(&self) -> BTreeMap<String, String> {
        let text = self.code.get(&self.root.join("lib.rs"));
        let text = text.map(|code| code.join(" ")).unwrap_or_default();
        let mut passed_on = BTreeMap::new();
        for of in text.split("pub use ").skip(1) {
            let of = of.split(';').next().unwrap_or_default();
            if let Some((module, names)) = of.split_once("::") {
                let names =
                    names.split(|letter: char| !(letter.is_alphanumeric() || letter == '_'));
                passed_on.extend(names.map(|name| (name.to_owned(), module.to_owned())));
            }
        }
        passed_on
    }
}

/// The names of the crate's root in a line of a module so deep.
fn names_at_the_top(line: &str, depth: usize) -> Vec<String> {
    let word = |text: &str| -> String {
        let letters = text.chars();
        letters
            .take_while(|letter| letter.is_alphanumeric() || *letter == '_')
            .collect()
    };
    let mut names = Vec::new();
    for prefix in ["crate::".to_owned(), "super::".repeat(depth)] {
        for (at, _) in line.match_indices(&prefix) {
            if line[..at].ends_with("super::") {
                continue;
            }
            match line[at + prefix.len()..].strip_prefix('{') {
                Some(group) => names.extend(group.split(", ").map(word)),
                None => names.push(word(&line[at + prefix.len()..])),
            }
        }
    }
    names
}

/// The lines of code of a source, and the names of the modules below it that only tests have. As rustfmt sets it, an item ends with a
/// bracket below its first letter.
fn code(text: &str) -> (Vec<String>, Vec<String>) {
    let (mut code, mut tests) = (Vec::new(), Vec::new());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let trimmed = line.trim();
        if !trimmed.starts_with("#[cfg(test)]") && !trimmed.starts_with("#[cfg(all(test") {
            if !trimmed.is_empty() && !trimmed.starts_with("//") {
                code.push(trimmed.to_owned());
            }
            continue;
        }
        let indent = line.len() - line.trim_start().len();
        let mut item = lines
            .by_ref()
            .skip_while(|line| line.trim().starts_with("#["));
        let first = item.next().unwrap_or_default().trim();
        match first.strip_suffix(';') {
            Some(short) => tests.extend(short.split("mod ").nth(1).map(str::to_owned)),
            None if first.ends_with('}') => {}
            None => {
                let ends = |line: &str| {
                    line.len() > indent
                        && line.trim_start().len() == line.len() - indent
                        && line[indent..].starts_with('}')
                };
                let _ = item.find(|line| ends(line));
            }
        }
    }
    (code, tests)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_is_what_is_neither_blank_nor_a_comment_nor_for_tests() {
        let text = "//! A page.\n\nuse a::B;\n\n#[cfg(test)]\nmod of_tests;\n\nfn a() {\n    // why\n    b();\n}\n\n#[cfg(test)]\n#[allow(x)]\nmod \
                    tests {\n    fn c() {\n    }\n}\nfn d() {}\n";
        let (lines, tests) = code(text);
        assert_eq!(lines, ["use a::B;", "fn a() {", "b();", "}", "fn d() {}"]);
        assert_eq!(tests, ["of_tests"]);
        assert_eq!(names_at_the_top("use crate::{a, b::C};", 1), ["a", "b"]);
        assert_eq!(names_at_the_top("use super::d::E;", 1), ["d"]);
        assert!(names_at_the_top("use super::d::E;", 2).is_empty());
        assert_eq!(names_at_the_top("let x = super::super::f(1);", 2), ["f"]);
    }
}

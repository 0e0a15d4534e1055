//! Programs of others that check what this product makes for them. Where one is missing its check is left out, and reports it;
//! where `QUADRANT_TOOLS=required` (.ci/run), it must be there.

use std::path::PathBuf;
use std::process::{Command, Output};

/// The program of this name, in PATH.
pub fn tool(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&path)
        .map(|folder| folder.join(name))
        .find(|file| file.is_file());
    if found.is_none() {
        let required = std::env::var("QUADRANT_TOOLS").is_ok_and(|value| value == "required");
        assert!(!required, "{name} is missing");
        eprintln!("{name} is missing: its check is left out");
    }
    found
}

/// Runs a command to its end; what it reported must be seen where it fails.
pub fn output(command: &mut Command) -> Output {
    let output = command
        .output()
        .unwrap_or_else(|e| panic!("{command:?}: {e}"));
    assert!(
        output.status.success(),
        "{command:?} ended with {}:\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// What it says on standard output.
pub fn says(command: &mut Command) -> String {
    String::from_utf8_lossy(&output(command).stdout).into_owned()
}

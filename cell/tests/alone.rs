//! A cell by `quadrant-cell` alone: it runs, and says what it is without.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn quadrant_cell(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_quadrant-cell"));
    command.current_dir(root()).args(arguments);
    command.output().expect("quadrant-cell")
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn cell() -> String {
    format!("alone-{}", std::process::id())
}

#[test]
fn a_program_runs_to_its_end_and_leaves_its_log_without_a_report() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let program = "machines/xy/programs/circle-r25-f3000.ngc";
    let shown = out.display().to_string();
    let run = quadrant_cell(&[
        "run",
        "machines/xy",
        program,
        "--cell",
        &cell(),
        "--out",
        &shown,
    ]);
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{said}");
    assert!(out.join("run.mcap").exists(), "{said}");
    assert!(!out.join("report.json").exists());
}

#[test]
fn what_only_a_desk_can_do_is_refused_before_anything_starts() {
    let program = "machines/xy/programs/circle-r25-f3000.ngc";
    for option in ["--web", "--view", "--metrics", "--learn"] {
        let run = quadrant_cell(&["run", "machines/xy", program, "--cell", &cell(), option]);
        let said = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{option}: {said}");
        assert!(
            said.contains(option) && said.contains("`quadrant`"),
            "{said}"
        );
    }
}

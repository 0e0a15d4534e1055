//! Real programs that none of us wrote: each is interpreted, or refused with a reason and a place. Runs only where the
//! collection lies beside the workspace; its README tells what LinuxCNC's interpreter makes of each file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::common::mill;
use path::geometry::AxisVector;
use program::{Program, load};

fn collection() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/programs");
    folder.is_dir().then_some(folder)
}

/// (straight feeds, arc feeds) by file name, from the table in the README. Its arcs are the lines of `rs274 -g` that hold
/// ARC_FEED, comments that name that word included: these are taken off.
fn expected_counts(folder: &Path) -> BTreeMap<String, (u32, u32)> {
    let readme = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let name = cells.get(1)?.to_string();
        let (lines, arcs): (u32, u32) = (cells.get(4)?.parse().ok()?, cells.get(5)?.parse().ok()?);
        let text = std::fs::read_to_string(folder.join(&name)).ok()?;
        let named = text
            .lines()
            .filter(|line| line.contains("ARC_FEED"))
            .count();
        Some((name, (lines, arcs - u32::try_from(named).ok()?)))
    };
    readme.lines().filter_map(row).collect()
}

/// Straight and arc feeds of more than zero length are what both interpreters must agree on.
fn counts(program: &Program) -> (u32, u32) {
    (program.straight_feeds, program.arc_feeds)
}

#[test]
fn every_foreign_program_is_interpreted_as_linuxcnc_does_or_refused_with_a_place() {
    let Some(folder) = collection() else {
        eprintln!("no ../shared/programs beside the workspace: nothing to check");
        return;
    };
    let expected = expected_counts(&folder);
    assert!(expected.len() > 40, "the README's table was not understood");
    let (mut wrong, mut refused) = (Vec::new(), Vec::new());
    for (name, expected) in &expected {
        match load(&folder.join(name), &mill(5000.0), AxisVector::zeros()) {
            Ok(program) => {
                let found = counts(&program);
                println!(
                    "{name}: interpreted, {} lines, {} arcs, README {expected:?}",
                    found.0, found.1
                );
                assert_eq!(program.path.first_break(), None, "{name}");
                if found != *expected {
                    wrong.push(format!("{name}: found {found:?}, LinuxCNC {expected:?}"));
                }
            }
            Err(error) => {
                let first = &error.problems[0];
                println!(
                    "{name}: refused, {:?} {}: {}",
                    first.place, first.found, first.right
                );
                assert!(first.place.is_some(), "{error}");
                refused.push(name.clone());
            }
        }
    }
    println!("{} refused: {}", refused.len(), refused.join(", "));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

//! The house rules: who may use whom, held by reading the sources.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::root;

const PROCESS_CRATES: [&str; 4] = ["planner", "servo", "plant-sim", "monitor"];

/// Names in the `[dependencies]` table of a crate.
fn dependencies(krate: &str) -> Vec<String> {
    let text = fs::read_to_string(root().join(krate).join("Cargo.toml")).expect("Cargo.toml");
    let (_, after) = text.split_once("[dependencies]").expect("[dependencies]");
    let table = after.split("\n[").next().unwrap_or_default();
    table
        .lines()
        .filter_map(|line| line.split(['.', ' ', '=']).next())
        .filter(|name| !name.is_empty() && !name.starts_with('#'))
        .map(str::to_string)
        .collect()
}

/// All Rust sources below a folder.
fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = fs::read_to_string(&path).expect("a source");
                found.push((path, text));
            }
        }
    }
    found
}

fn crates() -> Vec<&'static str> {
    vec![
        "bus",
        "control",
        "program",
        "planner",
        "servo",
        "plant-sim",
        "monitor",
        "rehearsal",
        "remote",
    ]
}

#[test]
fn only_bus_names_iceoryx2() {
    for krate in crates().into_iter().filter(|k| *k != "bus") {
        assert!(
            !dependencies(krate)
                .iter()
                .any(|d| d.starts_with("iceoryx2")),
            "{krate}"
        );
        for (path, text) in sources(&root().join(krate).join("src")) {
            assert!(
                !text.contains("iceoryx2::"),
                "{} names iceoryx2",
                path.display()
            );
        }
    }
    for (path, text) in sources(&root().join("src")) {
        assert!(
            !text.contains("iceoryx2::"),
            "{} names iceoryx2",
            path.display()
        );
    }
}

/// The network is one crate's business, and that crate knows nothing of cells: what is not built with the feature `remote` has no
/// network code at all.
#[test]
fn only_remote_names_zenoh_and_it_enters_no_cell() {
    for krate in crates().into_iter().filter(|k| *k != "remote") {
        assert!(!dependencies(krate).iter().any(|d| d == "zenoh"), "{krate}");
        let uses = dependencies(krate).iter().any(|d| d == "remote");
        assert!(!uses, "{krate} uses remote");
    }
    for (path, text) in sources(&root().join("src")) {
        assert!(!text.contains("zenoh::"), "{} names zenoh", path.display());
    }
    assert!(!dependencies("remote").iter().any(|d| d == "bus"));
    let manifest = fs::read_to_string(root().join("remote/Cargo.toml")).expect("Cargo.toml");
    assert!(manifest.contains("zenoh = { workspace = true, optional = true }"));
    let manifest = fs::read_to_string(root().join("Cargo.toml")).expect("Cargo.toml");
    let features = manifest.split("[features]").nth(1).unwrap_or_default();
    let table = features.split("\n[").next().unwrap_or_default();
    let on = table.lines().any(|line| line.starts_with("default"));
    assert!(!on, "remote is not on by default");
}

#[test]
fn control_has_no_processes_no_clock_and_no_files() {
    let allowed = ["libm", "nalgebra", "thiserror"];
    for dependency in dependencies("control") {
        assert!(
            allowed.contains(&dependency.as_str()),
            "control depends on {dependency}"
        );
    }
    let forbidden = [
        "std::fs",
        "std::net",
        "std::process",
        "std::thread",
        "std::time::Instant",
        "SystemTime",
        "std::env",
        "println!",
    ];
    for (path, text) in sources(&root().join("control/src")) {
        let product = text.split("#[cfg(test)]").next().unwrap_or_default();
        for word in forbidden {
            assert!(!product.contains(word), "{} uses {word}", path.display());
        }
    }
}

#[test]
fn the_plant_shares_no_model_with_its_controller() {
    assert!(
        !dependencies("plant-sim")
            .iter()
            .any(|d| d == "control" || d == "program")
    );
    for krate in ["control", "servo", "planner", "program"] {
        assert!(
            !dependencies(krate).iter().any(|d| d == "plant-sim"),
            "{krate}"
        );
    }
}

#[test]
fn no_process_crate_depends_on_another() {
    for krate in PROCESS_CRATES {
        for other in PROCESS_CRATES.into_iter().filter(|o| *o != krate) {
            assert!(
                !dependencies(krate).iter().any(|d| d == other),
                "{krate} depends on {other}"
            );
        }
    }
}

#[test]
fn every_service_has_one_writer() {
    let writers = [
        ("feedback_writer(", "plant-sim"),
        ("instruments_writer(", "plant-sim"),
        ("operator_server(", "plant-sim"),
        ("window_writer(", "planner"),
        ("planner_writer(", "planner"),
        ("command_writer(", "servo"),
        ("roster_writer(", "src"),
    ];
    for (call, owner) in writers {
        let mut folders: Vec<PathBuf> = crates()
            .into_iter()
            .filter(|k| *k != "bus")
            .map(|k| root().join(k).join("src"))
            .collect();
        folders.push(root().join("src"));
        let using: Vec<PathBuf> = folders
            .iter()
            .flat_map(|folder| sources(folder))
            .filter(|(_, text)| text.contains(call))
            .map(|(path, _)| path)
            // The ping-pong of the bench writes into a cell of its own.
            .filter(|path| !path.starts_with(root().join("src/bench")))
            .collect();
        let [only] = using.as_slice() else {
            panic!("{call} stands in {using:?}: one writer each");
        };
        let expected = if owner == "src" {
            root().join("src")
        } else {
            root().join(owner).join("src")
        };
        assert!(
            only.starts_with(&expected),
            "{call} stands in {}",
            only.display()
        );
    }
}

#[test]
fn only_the_machine_side_and_the_launcher_read_or_copy_the_plant_file() {
    let may = [
        root().join("src/check.rs"),
        root().join("src/run.rs"),
        root().join("src/up.rs"),
        root().join("src/run_dir.rs"),
        root().join("src/bench/circles.rs"),
        root().join("src/bench/faults/trial.rs"),
        root().join("src/tune/bench.rs"),
        root().join("src/soak.rs"),
    ];
    // A rehearsal is a cell: it hands the plant to the machine side.
    let others = crates().into_iter();
    for krate in others.filter(|k| !["plant-sim", "rehearsal"].contains(k)) {
        for (path, text) in sources(&root().join(krate).join("src")) {
            assert!(
                !text.contains("PlantFile"),
                "{} reads the plant file",
                path.display()
            );
            let product = text.split("#[cfg(test)]").next().unwrap_or_default();
            let code = product
                .lines()
                .filter(|l| !l.trim_start().starts_with("//"))
                .any(|l| l.contains("plant.toml"));
            assert!(!code, "{} names plant.toml", path.display());
        }
    }
    for (path, text) in sources(&root().join("src")) {
        let reads = text.contains("PlantFile") || text.contains("\"plant.toml\"");
        assert!(
            !reads || may.contains(&path),
            "{} reads the plant file",
            path.display()
        );
    }
}

#[test]
fn results_do_not_hang_on_fused_arithmetic_or_a_native_processor() {
    for krate in ["bus", "control", "program", "planner", "servo", "plant-sim"] {
        for (path, text) in sources(&root().join(krate).join("src")) {
            let product = text.split("#[cfg(test)]").next().unwrap_or_default();
            for word in [
                ".mul_add(",
                ".sin()",
                ".cos()",
                ".exp()",
                ".powf(",
                ".atan2(",
                ".hypot(",
                ".tan()",
                ".ln()",
            ] {
                assert!(
                    !product.contains(word),
                    "{} uses {word}: libm gives the same bits everywhere",
                    path.display()
                );
            }
        }
    }
    assert!(
        !root().join(".cargo/config.toml").exists(),
        "no target-cpu settings"
    );
}

#[test]
fn code_that_runs_in_a_scan_refuses_to_panic_by_lint() {
    for file in [
        "bus/src/member.rs",
        "bus/src/page.rs",
        "bus/src/port.rs",
        "bus/src/window.rs",
        "control/src/backlash.rs",
        "control/src/changeover.rs",
        "control/src/disturbance_observer.rs",
        "control/src/envelope.rs",
        "control/src/feed_forward.rs",
        "control/src/follow_up.rs",
        "control/src/guards.rs",
        "control/src/inverse_dynamics.rs",
        "control/src/jog.rs",
        "control/src/learned_table.rs",
        "control/src/maxwell_slip.rs",
        "control/src/prediction.rs",
        "control/src/prediction.rs",
        "control/src/profile.rs",
        "control/src/reversal.rs",
        "control/src/trigger.rs",
        "control/src/velocity_loop.rs",
        "control/src/window.rs",
        "planner/src/planner.rs",
        "planner/src/run.rs",
        "plant-sim/src/axis.rs",
        "plant-sim/src/digest.rs",
        "plant-sim/src/drive.rs",
        "plant-sim/src/friction.rs",
        "plant-sim/src/machine_side.rs",
        "plant-sim/src/mechanics.rs",
        "plant-sim/src/run.rs",
        "plant-sim/src/saved.rs",
        "plant-sim/src/winding.rs",
        "plant-sim/src/window_book.rs",
        "servo/src/compensation.rs",
        "servo/src/controller.rs",
        "servo/src/even_rows.rs",
        "servo/src/held.rs",
        "servo/src/manual.rs",
        "servo/src/run.rs",
    ] {
        let text = fs::read_to_string(root().join(file)).expect(file);
        for lint in [
            "clippy::unwrap_used",
            "clippy::expect_used",
            "clippy::panic",
            "clippy::indexing_slicing",
        ] {
            assert!(text.contains(lint), "{file} does not deny {lint}");
        }
    }
}

/// A step of the system's time (a clock that is set, daylight saving) is nothing to a scan: time is CLOCK_MONOTONIC alone.
#[test]
fn nothing_but_the_name_of_a_run_directory_hangs_on_the_system_time() {
    let clocks = [
        "SystemTime",
        "CLOCK_REALTIME",
        "ClockId::Realtime",
        "UNIX_EPOCH",
        "gettimeofday",
    ];
    for krate in crates() {
        for (path, text) in sources(&root().join(krate).join("src")) {
            for clock in clocks {
                assert!(!text.contains(clock), "{} uses {clock}", path.display());
            }
        }
    }
    for (path, text) in sources(&root().join("src")) {
        let uses = clocks.iter().any(|clock| text.contains(clock));
        let may = path.ends_with("src/run_dir.rs");
        assert!(!uses || may, "{} uses the system time", path.display());
    }
    let realtime = fs::read_to_string(root().join("bus/src/realtime.rs")).expect("a source");
    assert!(realtime.contains("ClockId::Monotonic"));
}

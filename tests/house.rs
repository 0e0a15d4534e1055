//! The house rules: who may use whom, held by reading the sources.

mod product;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use product::Product;
use serde_json::Value;

use crate::support::root;

/// The crates whose code runs inside a scan, and those that it is made of.
const IN_A_SCAN: [&str; 9] = [
    "bus",
    "machine",
    "path",
    "loops",
    "program",
    "planner",
    "servo",
    "master",
    "plant-sim",
];

/// What lives while axes may move.
const CELL: [&str; 16] = [
    "bus",
    "quadrant-console",
    "machine",
    "path",
    "loops",
    "program",
    "planner",
    "servo",
    "master",
    "plant-sim",
    "fieldbus",
    "logic",
    "quadrant-logic",
    "monitor",
    "launcher",
    "quadrant-cell",
];

/// What asks, shows and prepares.
const DESK: [&str; 9] = [
    "audit", "esi", "operator", "prepare", "report", "remote", "view", "tune", "quadrant",
];

/// What breaks, judges and studies.
const LAB: [&str; 3] = ["lab", "model", "page-model"];

/// Folders of the crates that have another name than their folder.
const FOLDERS: [(&str, &str); 6] = [
    ("quadrant-console", "console"),
    ("quadrant-cell", "cell"),
    ("quadrant", "."),
    ("quadrant-logic", "logic/sdk"),
    ("model", "lab/model"),
    ("page-model", "lab/page-model"),
];

/// Where the sources of a crate are.
fn folder(krate: &str) -> PathBuf {
    let other = FOLDERS.iter().find(|(name, _)| *name == krate);
    root().join(other.map_or(krate, |(_, folder)| folder))
}

/// Names in the `[dependencies]` table of a crate.
fn dependencies(krate: &str) -> Vec<String> {
    let text = fs::read_to_string(folder(krate).join("Cargo.toml")).expect("Cargo.toml");
    let after = text
        .split_once("[dependencies]")
        .map_or("", |(_, after)| after);
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
            } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with("tests.rs") {
                let text = fs::read_to_string(&path).expect("a source");
                found.push((path, text));
            }
        }
    }
    found
}

fn crates() -> impl Iterator<Item = &'static str> {
    let all = CELL.into_iter().chain(DESK).chain(LAB);
    all.filter(|krate| *krate != "quadrant")
}

/// The packages of the workspace, as Cargo describes them.
fn metadata() -> Vec<Value> {
    let metadata = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--no-deps",
            "--offline",
            "--format-version",
            "1",
        ])
        .current_dir(root())
        .output()
        .expect("cargo metadata");
    let metadata: Value = serde_json::from_slice(&metadata.stdout).expect("its JSON");
    metadata["packages"].as_array().expect("packages").clone()
}

/// Names of the packages, each with the names of all crates that it builds with.
fn packages() -> Vec<(String, Vec<String>)> {
    let text = |of: &Value| of["name"].as_str().expect("a name").to_owned();
    let uses = |package: &Value| {
        let all = package["dependencies"].as_array().expect("dependencies");
        // What only tests use binds nobody.
        let built = all.iter().filter(|used| used["kind"] != "dev");
        built.map(text).collect()
    };
    metadata()
        .iter()
        .map(|package| (text(package), uses(package)))
        .collect()
}

/// The README's first command names no program.
#[test]
fn cargo_run_means_quadrant() {
    let packages = metadata();
    let default_runs = packages.iter().filter_map(|of| of["default_run"].as_str());
    assert_eq!(default_runs.collect::<Vec<_>>(), ["quadrant"]);
}

/// Languages of a fenced block that rustdoc builds and runs.
const RUNS: [&str; 4] = ["", "rust", "no_run", "should_panic"];

/// Whether a source has a fenced block that rustdoc runs.
fn has_example(text: &str) -> bool {
    let lines = text.lines().map(str::trim_start);
    let fences = lines.filter_map(|line| {
        line.strip_prefix("//")?
            .trim_start_matches(['/', '!', ' '])
            .strip_prefix("```")
    });
    // Each second one closes what the one before opened.
    fences
        .step_by(2)
        .any(|language| RUNS.contains(&language.trim()))
}

/// Test executables and runs of rustdoc that would be empty are switched off in the manifests: nothing there is left out unseen.
#[test]
fn a_target_whose_tests_are_switched_off_has_none() {
    for package in metadata() {
        for target in package["targets"].as_array().expect("targets") {
            let main = PathBuf::from(target["src_path"].as_str().expect("a path"));
            let is_lib = target["kind"][0] == "lib";
            let of_lib = |path: &Path| path.file_name() != Some("main.rs".as_ref());
            let folder = main.parent().expect("a folder");
            if !folder.ends_with("src") {
                continue;
            }
            let all = sources(folder);
            let own = all
                .iter()
                .filter(|(path, _)| *path == main || is_lib && of_lib(path));
            for (path, text) in own {
                let path = path.display();
                let has_tests = text.contains("#[test]") || text.contains("#[cfg(test)]");
                assert!(target["test"] == true || !has_tests, "{path}");
                assert!(
                    !is_lib || target["doctest"] == true || !has_example(text),
                    "{path}"
                );
            }
        }
    }
}

/// A cell stands without what asks and shows, and both without what breaks them.
#[test]
fn no_crate_of_the_cell_uses_the_desk_or_the_lab_and_none_of_the_desk_the_lab() {
    let packages = packages();
    let part = |krate: &str| {
        let parts = [&CELL[..], &DESK, &LAB];
        parts.iter().position(|part| part.contains(&krate))
    };
    for (krate, uses) in &packages {
        let own = part(krate).unwrap_or_else(|| panic!("{krate} is in no part of the house"));
        for used in uses {
            let other = part(used);
            assert!(
                other.is_none_or(|other| other <= own),
                "{krate} uses {used}"
            );
        }
    }
    let all = CELL.iter().chain(&DESK).chain(&LAB);
    for krate in all {
        assert!(packages.iter().any(|(name, _)| name == krate), "{krate}");
    }
}

/// Else `cargo test` would build nearly everything once more after `cargo build`.
#[test]
fn libraries_have_the_same_features_in_the_build_and_in_the_tests() {
    let built = features(&["-e", "normal,build"]);
    let tested = features(&["--workspace", "-e", "normal,build,dev"]);
    let others: Vec<&String> = built.difference(&tested).collect();
    assert!(others.is_empty(), "other features in the tests: {others:?}");
}

/// Each library of a build with its features.
fn features(of: &[&str]) -> BTreeSet<String> {
    let tree = tree(&[of, &["--prefix", "none", "-f", "{p} {f}"]].concat());
    tree.lines()
        .map(|line| line.trim_end_matches(" (*)").to_string())
        .collect()
}

/// What `cargo tree` prints.
fn tree(arguments: &[&str]) -> String {
    let tree = Command::new(env!("CARGO"))
        .args(["tree", "--locked"])
        .args(arguments)
        .current_dir(root())
        .output()
        .expect("cargo tree");
    assert!(tree.status.success(), "{tree:?}");
    String::from_utf8_lossy(&tree.stdout).into_owned()
}

/// What a controller PC runs has no network, page, picture or terminal of its own.
#[test]
fn a_cell_alone_is_built_without_http_tls_plots_and_terminal() {
    let alone = ["-p", "quadrant-cell", "-e", "normal", "--prefix", "none"];
    let tree = tree(&alone);
    let names = tree.lines().filter_map(|line| line.split(' ').next());
    let names: Vec<&str> = names.collect();
    assert!(names.contains(&"launcher"), "{tree}");
    for other in ["axum", "hyper", "tokio", "rustls", "plotters", "ratatui"] {
        assert!(!names.contains(&other), "{other}");
    }
}

/// The plant shares no model with its controller, and processes do not use each other.
#[test]
fn each_process_uses_only_what_it_is_made_of() {
    let of_processes = [
        ("path", &[][..]),
        ("loops", &["path"]),
        ("machine", &["bus"]),
        ("quadrant-console", &["bus"]),
        ("program", &["bus", "machine", "path"]),
        ("planner", &["bus", "machine", "path", "program"]),
        ("servo", &["bus", "machine", "path", "loops"]),
        ("master", &["bus", "machine", "path", "loops"]),
        ("plant-sim", &["bus", "machine", "master"]),
        ("fieldbus", &["bus", "machine", "master"]),
        ("monitor", &["bus", "machine"]),
    ];
    let packages = packages();
    for (krate, allowed) in of_processes {
        let found = packages.iter().find(|(name, _)| name == krate);
        let (_, uses) = found.expect(krate);
        let own = uses.iter().filter(|used| CELL.contains(&used.as_str()));
        for used in own {
            assert!(allowed.contains(&used.as_str()), "{krate} uses {used}");
        }
    }
}

/// The command line is thin.
#[test]
fn the_root_package_has_at_most_1500_lines() {
    let lines = sources(&root().join("src"));
    let lines: usize = lines.iter().map(|(_, text)| text.lines().count()).sum();
    assert!(lines <= 1500, "{lines} lines in src/");
}

/// Lines of code that one head can hold. A change that needs more says why in docs/developers/decisions.md.
#[test]
fn cell_and_desk_keep_their_budgets_of_lines() {
    let lines = |krate: &&str| Product::of(&folder(krate)).lines();
    let cell: usize = CELL.iter().map(lines).sum();
    let desk: usize = DESK.iter().map(lines).sum();
    println!("cell {cell}, desk {desk}");
    assert!(cell <= 71_600, "the cell has {cell} lines of code");
    assert!(desk <= 37_500, "the desk has {desk} lines of code");
}

fn opens_itself(line: &str) -> bool {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    line.match_indices("File::open(")
        .any(|(at, _)| !line[..at].ends_with(is_name))
}

/// Others may have put a pipe, a device or a link in the place of a file: `bus::files` opens none of these and waits for nobody. Beside it
/// new files are made, which nobody had before.
#[test]
fn files_that_are_there_already_are_opened_in_one_place() {
    const LINES_OF_AN_OPEN: usize = 8;
    let apart = [
        ("esi/src/text.rs", "has no part of the cell; looks before"),
        (
            "machine/src/whole_file.rs",
            "a folder, to be written to the disk",
        ),
        (
            "remote/src/orders/identity.rs",
            "knows nothing of a cell; does not wait, and looks at what it opened",
        ),
        (
            "view/src/scope.rs",
            "a table goes where one wants it, also into a pipe",
        ),
        ("view/src/web/token.rs", "/dev/urandom"),
    ];
    let mut by_themselves = BTreeSet::new();
    for krate in CELL.iter().chain(&DESK) {
        for (file, code) in Product::of(&folder(krate)).files() {
            let opens = code.iter().enumerate().any(|(at, line)| {
                let has_options =
                    line.contains("OpenOptions::new()") || line.contains("File::options()");
                let statement = code.iter().skip(at).take(LINES_OF_AN_OPEN);
                let mut good = statement.map(|line| {
                    let good = ["create_new(true)", "open_regular(", "open_unlinked("];
                    good.iter().any(|good| line.contains(good))
                });
                opens_itself(line) || has_options && !good.any(|good| good)
            });
            if opens {
                let name = file.strip_prefix(root()).expect("below the root");
                by_themselves.insert(name.display().to_string());
            }
        }
    }
    let apart: BTreeSet<String> = apart.map(|(file, _)| file.to_owned()).into();
    assert_eq!(by_themselves, apart, "what opens files by itself");
}

/// A reader of one module need not know those that use it.
#[test]
fn no_modules_of_a_crate_use_each_other_in_a_circle() {
    for krate in CELL.iter().chain(&["report"]) {
        let circles = Product::of(&folder(krate)).circles();
        assert!(circles.is_empty(), "{krate}: {circles:?}");
    }
}

/// What sends wrong samples is in the lab, whose command is not built with the others.
#[test]
fn nothing_that_drives_a_machine_can_send_wrong_samples() {
    for krate in crates().filter(|k| !LAB.contains(k)) {
        for (path, text) in sources(&folder(krate).join("src")) {
            let names = text.contains("lab::") || text.contains("Corruptor");
            assert!(!names, "{} names the lab", path.display());
        }
    }
    for krate in ["servo", "planner", "master"] {
        for (path, text) in sources(&folder(krate).join("src")) {
            assert!(!text.contains("FaultScript"), "{}", path.display());
        }
    }
    for (path, text) in sources(&root().join("src")) {
        assert!(!text.contains("lab::"), "{}", path.display());
    }
}

/// In the lab one file names it: the floor of `bench ipc`, which is what iceoryx2 takes without `bus`.
#[test]
fn only_bus_names_iceoryx2() {
    for krate in crates().filter(|k| *k != "bus") {
        assert!(
            krate == "lab"
                || !dependencies(krate)
                    .iter()
                    .any(|d| d.starts_with("iceoryx2")),
            "{krate}"
        );
        let floor = folder("lab").join("src/bench/ipc/bare.rs");
        for (path, text) in sources(&folder(krate).join("src")) {
            if path == floor {
                continue;
            }
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
    for krate in crates().filter(|k| *k != "remote") {
        assert!(!dependencies(krate).iter().any(|d| d == "zenoh"), "{krate}");
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

/// The bus is one crate's business. Its library starts a segment up, and is in no cycle: who is not built with the feature `ethercat`
/// has none of it.
#[test]
fn only_the_start_up_of_the_fieldbus_names_ethercrab() {
    for krate in crates().filter(|k| *k != "fieldbus") {
        let uses = dependencies(krate);
        assert!(!uses.iter().any(|d| d.starts_with("ethercrab")), "{krate}");
    }
    let start_up = root().join("fieldbus/src/start_up");
    for (path, text) in sources(&root()) {
        let may = path.starts_with(&start_up) || path.ends_with("tests/house.rs");
        assert!(may || !text.contains("ethercrab::"), "{}", path.display());
    }
}

/// Drive files are judged before anything runs, and what exchanges cycles knows nothing of them.
#[test]
fn nothing_that_runs_in_a_scan_reads_drive_files() {
    for krate in IN_A_SCAN {
        let uses = dependencies(krate);
        assert!(!uses.iter().any(|used| used == "fieldbus"), "{krate}");
    }
    for (path, text) in sources(&root().join("fieldbus/src/link")) {
        assert!(!text.contains("drive_file"), "{}", path.display());
    }
}

#[test]
fn path_and_loops_have_no_processes_no_clock_and_no_files() {
    let allowed = ["bytemuck", "libm", "nalgebra", "path", "thiserror"];
    for krate in ["path", "loops"] {
        for dependency in dependencies(krate) {
            assert!(
                allowed.contains(&dependency.as_str()),
                "{krate} depends on {dependency}"
            );
        }
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
    let of = |krate: &str| sources(&folder(krate).join("src"));
    for (path, text) in of("path").into_iter().chain(of("loops")) {
        let product = text.split("#[cfg(test)]").next().unwrap_or_default();
        for word in forbidden {
            assert!(!product.contains(word), "{} uses {word}", path.display());
        }
    }
}

#[test]
fn every_service_has_one_writer() {
    let writers = [
        ("feedback_writer(", "master"),
        ("instruments_writer(", "master"),
        ("bus_cycle_writer(", "master"),
        ("operator_server(", "master"),
        ("window_writer(", "planner"),
        ("planner_writer(", "planner"),
        ("command_writer(", "servo"),
        ("roster_writer(", "launcher"),
    ];
    for (call, owner) in writers {
        let folders = crates().filter(|k| *k != "bus");
        let using: Vec<PathBuf> = folders
            .flat_map(|krate| sources(&folder(krate).join("src")))
            .filter(|(_, text)| text.contains(call))
            .map(|(path, _)| path)
            // The ping-pong of the bench writes into a cell of its own.
            .filter(|path| !path.starts_with(root().join("lab/src/bench")))
            .collect();
        let [only] = using.as_slice() else {
            panic!("{call} stands in {using:?}: one writer each");
        };
        let expected = root().join(owner).join("src");
        assert!(
            only.starts_with(&expected),
            "{call} stands in {}",
            only.display()
        );
    }
}

/// The controller knows nothing of the simulated machine but what its encoders and drives show.
#[test]
fn only_the_simulated_drives_the_launcher_and_the_lab_know_the_plant_file() {
    for krate in crates().filter(|k| !["plant-sim", "launcher", "lab"].contains(k)) {
        for (path, text) in sources(&folder(krate).join("src")) {
            // The tuner's bench copies it for the simulated machine, unread; a new machine gets one, and `check` reads it.
            let copies = path.ends_with("tune/src/bench.rs")
                || path
                    .components()
                    .any(|part| part.as_os_str() == "new_machine")
                || path.ends_with("tune/src/new_machine.rs");
            let product = text.split("#[cfg(test)]").next().unwrap_or_default();
            let mut code = product
                .lines()
                .filter(|l| !l.trim_start().starts_with("//"));
            let names = code.any(|l| l.contains("PlantFile") || l.contains("plant.toml"));
            assert!(copies || !names, "{} names the plant file", path.display());
        }
    }
}

#[test]
fn results_do_not_depend_on_fused_arithmetic_or_a_native_processor() {
    for krate in IN_A_SCAN {
        for (path, text) in sources(&folder(krate).join("src")) {
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
    let config = fs::read_to_string(root().join(".cargo/config.toml")).expect("config.toml");
    for word in ["rustflags", "target-cpu", "target-feature"] {
        assert!(!config.contains(word), ".cargo/config.toml sets {word}");
    }
}

#[test]
fn crates_that_run_in_a_scan_refuse_to_panic_by_lint() {
    for krate in [
        "bus",
        "path",
        "loops",
        "planner",
        "servo",
        "master",
        "plant-sim",
        "fieldbus",
    ] {
        let text = fs::read_to_string(root().join(krate).join("src/lib.rs")).expect(krate);
        let (_, denied) = text.split_once("deny(").expect(krate);
        for lint in ["unwrap_used", "expect_used", "panic", "indexing_slicing"] {
            let lint = format!("clippy::{lint}");
            assert!(denied.contains(&lint), "{krate} does not deny {lint}");
        }
    }
}

/// A step of the system's time (a clock that is set, daylight saving) is nothing to a scan: time is CLOCK_MONOTONIC alone.
#[test]
fn nothing_but_name_and_age_of_run_directories_depends_on_the_system_time() {
    let clocks = [
        "SystemTime",
        "CLOCK_REALTIME",
        "ClockId::Realtime",
        "UNIX_EPOCH",
        "gettimeofday",
    ];
    for krate in crates() {
        for (path, text) in sources(&folder(krate).join("src")) {
            let may = ["run_dir.rs", "retention.rs"]
                .iter()
                .any(|file| path.ends_with(Path::new("launcher/src").join(file)));
            let used = clocks.iter().find(|clock| text.contains(**clock));
            assert!(may || used.is_none(), "{} uses {used:?}", path.display());
        }
    }
    let realtime = fs::read_to_string(root().join("bus/src/realtime.rs")).expect("a source");
    assert!(realtime.contains("ClockId::Monotonic"));
}

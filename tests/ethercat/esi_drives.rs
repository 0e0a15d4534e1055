//! Drives of vendors' ESI files: each becomes a drive file with one command, and a cell brings it into operation with that.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::segment::{MASTER, Network, enabled_steps, program};
use crate::support::{quadrant, root};

/// What no ESI file tells. The drives of `segment.py --esi` take 60FF for increments a second.
const SCALING: [(&str, &str); 5] = [
    ("position_increments = 0", "position_increments = 1000000"),
    ("velocity_units = 0", "velocity_units = 1000000"),
    ("rated_torque_nm = 0.0", "rated_torque_nm = 34.1"),
    ("direction = 0", "direction = 1"),
    ("dead_time_scans = 0", "dead_time_scans = 2"),
];

/// A drive on the cable.
struct Found {
    place: usize,
    name: String,
    product: String,
    revision: String,
}

fn esi_files() -> Vec<PathBuf> {
    let named = std::env::var_os("QUADRANT_ESI").map(PathBuf::from);
    let folder = named.unwrap_or_else(|| root().join("../shared/esi"));
    let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|end| end == "xml"))
        .filter_map(|path| path.canonicalize().ok())
        // A device without a mailbox is no drive.
        .filter(|path| fs::read_to_string(path).is_ok_and(|text| text.contains("<CoE")))
        .collect();
    files.sort();
    if files.is_empty() {
        let shown = folder.display();
        eprintln!(
            "SKIPPED: no ESI files in {shown}: put some into a folder that QUADRANT_ESI names"
        );
    }
    files
}

/// Who is on the cable.
fn scan(network: &Network) -> Vec<Found> {
    let output = network.quadrant(&["bus", "scan", MASTER, "--json"]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{errors}");
    let json: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let slaves = json["slaves"].as_array().expect("slaves");
    let found = slaves.iter().map(|slave| Found {
        place: slave["place"].as_u64().expect("a place") as usize,
        name: slave["name"].to_string(),
        product: slave["product_code"].to_string(),
        revision: slave["revision"].to_string(),
    });
    found.collect()
}

/// `quadrant bus …` in a folder; what it printed.
fn bus(folder: &Path, arguments: &[&str]) -> Result<String, String> {
    let mut command = quadrant();
    command.current_dir(folder).arg("bus").args(arguments);
    let output = command.output().expect("running quadrant");
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

/// A machine of one axis whose drive is at this place, all others left alone.
fn machine_of(folder: &Path, found: &Found, count: usize, drive: &str) {
    let text = fs::read_to_string(root().join("machines/xy-ethercat/machine.toml"));
    let text = text.expect("the machine file");
    let mut parts = text.split("[[axis]]");
    let (head, axis) = (
        parts.next().expect("a head"),
        parts.next().expect("an axis"),
    );
    let others: Vec<String> = (0..count)
        .filter(|place| *place != found.place)
        .map(|place| place.to_string())
        .collect();
    let others = format!("standby = true\nother_slaves = [{}]", others.join(", "));
    let modes = [("csv", "velocity"), ("cst", "torque"), ("csp", "position")];
    let operates = |(mode, _): &&(&str, &str)| drive.contains(&format!("operate = \"{mode}\""));
    let (_, mode) = modes.iter().find(operates).expect("a mode");
    let drive_line = format!("file = \"drives/x.toml\"\nslave = {}", found.place);
    let made = format!("{head}[[axis]]{axis}")
        .replace("standby = true", &others)
        .replace("file = \"drives/am-m.toml\"", &drive_line)
        .replace(
            "drive_mode = \"velocity\"",
            &format!("drive_mode = \"{mode}\""),
        );
    fs::write(folder.join("machine.toml"), made).expect("writing");
}

/// From the ESI file to a run that ends well.
fn boots(
    network: &Network,
    esi: &Path,
    found: &Found,
    count: usize,
    mode: &[&str],
) -> Result<String, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let esi = esi.to_str().expect("a path");
    let drive = "drives/x.toml";
    let identity = ["--product", &found.product, "--revision", &found.revision];
    let mut arguments = vec!["drive-file", esi, "--out", drive];
    arguments.extend(identity);
    arguments.extend(mode);
    let made = bus(folder.path(), &arguments)?;
    let path = folder.path().join(drive);
    let mut text = fs::read_to_string(&path).expect("the drive file");
    for (empty, filled) in SCALING {
        assert!(text.contains(empty), "{esi}: no {empty:?}");
        text = text.replace(empty, filled);
    }
    fs::write(&path, &text).expect("writing");
    bus(folder.path(), &["check", drive, "--esi", esi])?;
    machine_of(folder.path(), found, count, &text);
    let program = program(folder.path());
    let output = network.run(folder.path(), &program);
    let printed = String::from_utf8_lossy(&output.stderr);
    if output.status.success() {
        Ok(made.lines().next().unwrap_or_default().into())
    } else {
        Err(format!("{:?}: {printed}", output.status.code()))
    }
}

#[test]
fn every_drive_of_an_esi_file_runs_with_the_drive_file_that_one_command_makes_of_it() {
    let files = esi_files();
    if files.is_empty() {
        return;
    }
    let Some(network) = Network::new() else {
        return;
    };
    let mut failed = Vec::new();
    for esi in &files {
        let file = esi.file_name().unwrap_or_default().to_string_lossy();
        let path = esi.to_str().expect("a path");
        let drives = {
            let _segment = network.segment(&["--esi", path]);
            scan(&network)
        };
        // In the mode that suits best, and in the one that every drive has.
        let modes: [&[&str]; 2] = [&[], &["--mode", "csp"]];
        for (found, mode) in drives
            .iter()
            .flat_map(|found| modes.map(|mode| (found, mode)))
        {
            let segment = network.segment(&["--esi", path]);
            let outcome = boots(&network, esi, found, drives.len(), mode);
            let enabled = enabled_steps(&segment.end());
            match outcome {
                Ok(made) if enabled > 0 => eprintln!("{file}: {made}"),
                // A boot loader is no drive; its file says so.
                Err(why) if why.contains("is it the boot loader of a drive?") => {
                    eprintln!("{file}: {why}");
                }
                Ok(_) => failed.push(format!("{file}: {}: was never enabled", found.name)),
                Err(why) => failed.push(format!("{file}: {}: {why}", found.name)),
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

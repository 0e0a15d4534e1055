//! Cells over a bus with foreign drives: the same motion on every run, whoever of the bus is killed; drives that vanish, fault or lose
//! their power.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::{Duration, Instant};

use crate::segment::{Network, Segment, machine};
use crate::support::root;

/// A circle of R10 with F3000 from where the axes are.
const CIRCLE: &str = "G21 G90 G17\nG1 X10 Y0 F3000\nG3 X10 Y0 I-10 J0\nG2 X10 Y0 I-10 J0\nM2\n";

fn circle(folder: &Path) -> PathBuf {
    let path = folder.join("circle.ngc");
    fs::write(&path, CIRCLE).expect("writing");
    path
}

/// A run in lockstep that has ended.
struct Done {
    output: Output,
    report: serde_json::Value,
}

impl Done {
    fn text(&self, pointer: &str) -> String {
        let value = self.report.pointer(pointer);
        let value = value.and_then(serde_json::Value::as_str);
        value.unwrap_or_else(|| panic!("no {pointer}")).to_string()
    }

    fn printed(&self) -> String {
        String::from_utf8_lossy(&self.output.stderr).into_owned()
            + &String::from_utf8_lossy(&self.output.stdout)
    }
}

/// Runs the circle over a segment with these options.
fn run(network: &Network, options: &[&str], faults: Option<&str>) -> Done {
    let _segment: Segment = network.segment(options);
    let machine = machine(&[], &[]);
    let program = circle(machine.path());
    let out = machine.path().join("run");
    let cell = crate::support::unique_cell();
    let shown = |path: &Path| path.to_string_lossy().into_owned();
    let (folder, program, out_name) = (shown(machine.path()), shown(&program), shown(&out));
    let mut arguments = vec![
        "run", &folder, &program, "--out", &out_name, "--cell", &cell,
    ];
    let script = machine.path().join("script.toml");
    let script_name = shown(&script);
    if let Some(faults) = faults {
        fs::write(&script, faults).expect("writing");
        arguments.extend(["--faults", &script_name]);
    }
    let output = network.quadrant(&arguments);
    let report = fs::read_to_string(out.join("report.json"));
    let report = report.unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    Done {
        output,
        report: serde_json::from_str(&report).expect("report.json"),
    }
}

#[test]
fn three_foreign_drives_run_a_circle_and_every_run_is_the_same_to_the_bit() {
    let Some(network) = Network::new() else {
        return;
    };
    let first = run(&network, &["--drives", "3"], None);
    assert_eq!(
        first.text("/outcome/kind"),
        "completed",
        "{}",
        first.printed()
    );
    let again = run(&network, &["--drives", "3"], None);
    for digest in ["/digest", "/motion_digest"] {
        assert_eq!(first.text(digest), again.text(digest), "{digest}");
    }
}

#[test]
fn the_owner_of_the_bus_is_killed_forty_times_and_no_command_is_another_one() {
    let Some(network) = Network::new() else {
        return;
    };
    let undisturbed = run(&network, &["--drives", "3"], None);
    let kills = "[restart]\nrestarts_max = 1000\n\
        [[fault]]\nat = { scan = 700 }\nprocess = \"fieldbus\"\ndo = \"kill\"\nrestart_after_scans = 20\n\
        repeat = { times = 20, every_scans = 60 }\n\
        [[fault]]\nat = { scan = 730 }\nprocess = \"fieldbus-b\"\ndo = \"kill\"\nrestart_after_scans = 20\n\
        repeat = { times = 20, every_scans = 60 }\n";
    let killed = run(&network, &["--drives", "3"], Some(kills));
    assert_eq!(
        killed.text("/outcome/kind"),
        "completed",
        "{}",
        killed.printed()
    );
    assert_eq!(
        killed.text("/motion_digest"),
        undisturbed.text("/motion_digest")
    );
    let again = run(&network, &["--drives", "3"], Some(kills));
    assert_eq!(killed.text("/digest"), again.text("/digest"));
}

#[test]
fn a_drive_that_vanishes_faults_or_loses_its_power_stops_the_others_in_that_scan_by_name() {
    let Some(network) = Network::new() else {
        return;
    };
    for (order, words) in [
        ("enabled+900 drop 1", "drive does not answer, axis Y"),
        ("enabled+900 fault 0", "drive fault 1001h"),
        (
            "enabled+900 sto 2 on",
            "drive is off, or did not come on in time, axis Z",
        ),
    ] {
        let done = run(&network, &["--drives", "3", "--at", order], None);
        assert_eq!(done.output.status.code(), Some(1), "{order}");
        let printed = done.printed();
        assert!(printed.contains(words), "{order}: {printed}");
        // Frame and scan count from the same enabling: the drives are on some scans after the start.
        let scan = printed.split("tripped in scan ").nth(1).expect("a trip");
        let scan: u64 = scan
            .split(':')
            .next()
            .and_then(|n| n.parse().ok())
            .expect("a scan");
        assert!((900..=910).contains(&scan), "{order}: scan {scan}");
    }
}

/// Waits until `quadrant status --json` of a cell shows this.
fn await_status(
    network: &Network,
    cell: &str,
    what: &str,
    shows: impl Fn(&serde_json::Value) -> bool,
) {
    let started = Instant::now();
    loop {
        let status = network.quadrant(&["status", "--json", "--cell", cell]);
        let status = serde_json::from_slice(&status.stdout).unwrap_or_default();
        if shows(&status) {
            return;
        }
        assert!(
            started.elapsed() < Duration::from_secs(30),
            "{what} in vain: {status}"
        );
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn mode(status: &serde_json::Value) -> &str {
    status["mode"].as_str().unwrap_or_default()
}

/// Gives an order that is taken.
fn order(network: &Network, cell: &str, words: &[&str]) {
    let mut arguments = words.to_vec();
    arguments.extend(["--cell", cell]);
    let done = network.quadrant(&arguments);
    let printed = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{words:?}: {printed}");
}

/// Without a standby the drives stop by themselves; the process is started again, and an operator has the program go on.
#[test]
fn a_bus_without_a_standby_is_started_again_and_the_program_goes_on_from_its_place() {
    let Some(network) = Network::new() else {
        return;
    };
    let _segment = network.segment(&["--drives", "3"]);
    let machine = machine(&[("standby = true", "standby = false")], &[]);
    let program = circle(machine.path());
    let cell = crate::support::unique_cell();
    let shown = |path: &Path| path.to_string_lossy().into_owned();
    let (folder, program, out) = (
        shown(machine.path()),
        shown(&program),
        shown(&machine.path().join("up")),
    );
    let mut up = network
        .command(env!("CARGO_BIN_EXE_quadrant"))
        .args([
            "up", &folder, "--pace", "lockstep", "--out", &out, "--cell", &cell,
        ])
        .current_dir(root())
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("a cell");
    await_status(&network, &cell, "starting", |status| {
        mode(status) == "disabled"
    });
    order(&network, &cell, &["enable"]);
    order(&network, &cell, &["load", &program]);
    order(&network, &cell, &["override", "10"]);
    await_status(&network, &cell, "enabling", |status| {
        mode(status) == "ready"
    });
    order(&network, &cell, &["start"]);
    await_status(&network, &cell, "starting the program", |status| {
        mode(status) == "enabled"
    });
    let pid = |status: &serde_json::Value| {
        let processes = status["processes"].as_array().cloned().unwrap_or_default();
        let owner = processes
            .iter()
            .find(|process| process["process"] == "fieldbus");
        owner.and_then(|owner| owner["pid"].as_i64())
    };
    let status = network.quadrant(&["status", "--json", "--cell", &cell]);
    let status: serde_json::Value = serde_json::from_slice(&status.stdout).expect("JSON");
    let owner = pid(&status).unwrap_or_else(|| panic!("no fieldbus in {status}"));
    crate::support::send(owner as i32, libc::SIGKILL);
    await_status(&network, &cell, "tripping", |status| {
        mode(status) == "tripped"
    });
    await_status(&network, &cell, "starting the bus", |status| {
        pid(status).is_some_and(|new| new != owner)
    });
    order(&network, &cell, &["enable"]);
    await_status(&network, &cell, "enabling again", |status| {
        mode(status) == "enabled"
    });
    order(&network, &cell, &["override", "100"]);
    order(&network, &cell, &["resume"]);
    await_status(&network, &cell, "finishing", |status| {
        mode(status) == "ready"
    });
    order(&network, &cell, &["down"]);
    assert!(up.wait().expect("its end").success());
    let report = fs::read_to_string(machine.path().join("up/001-circle/report.json"));
    let report: serde_json::Value = serde_json::from_str(&report.expect("a report")).expect("JSON");
    assert_eq!(report["outcome"]["kind"], "completed");
}

//! `quadrant bus scan` and `quadrant bus sdo` on a segment, and `quadrant doctor` on its interface.

use std::process::Output;

use serde_json::Value;

use crate::segment::{MASTER, Network, enabled_steps, machine};
use crate::support::{dead_time_line, dead_time_of, unique_cell};

fn stdout(output: &Output) -> String {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{errors}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The one line of a refusal with exit status 3.
fn refusal(output: &Output) -> String {
    let printed = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{printed}");
    assert_eq!(printed.lines().count(), 1, "{printed}");
    printed
}

#[test]
fn a_scan_lists_who_is_on_the_cable_and_enables_nothing() {
    let Some(network) = Network::new() else {
        return;
    };
    let segment = network.segment(&["--drives", "3", "--units", "M,M,S-S", "--io", "1"]);
    let table = stdout(&network.quadrant(&["bus", "scan", MASTER]));
    assert!(table.starts_with("4 slaves on ecat-master"), "{table}");
    for line in table.lines() {
        assert!(line.chars().count() <= 100, "{line}");
    }
    for words in [
        "Before the scan places 0, 1, 2, 3 were in INIT",
        "Process data of places 0, 2, 3:",
        "6040 controlword /16",
        "not known: it has no mailbox",
    ] {
        assert!(table.contains(words), "no {words:?} in {table}");
    }

    let json = stdout(&network.quadrant(&["bus", "scan", MASTER, "--json"]));
    let json: Value = serde_json::from_str(&json).expect("JSON");
    let slaves = json["slaves"].as_array().expect("slaves");
    assert_eq!(slaves.len(), 4);
    // The scan before left them there.
    assert_eq!(slaves[0]["al_state_before"], "PRE-OP");
    assert_eq!(slaves[0]["product_code"], 3);
    assert_eq!(slaves[0]["profile"], 402);
    assert_eq!(slaves[0]["receive"][0]["index"], 0x1600);
    assert_eq!(slaves[0]["receive"][0]["size_bits"], 160);
    assert_eq!(slaves[1]["profile"], Value::Null);
    assert_eq!(enabled_steps(&segment.end()), 0);
}

#[test]
fn a_scan_tells_how_drives_keep_time() {
    let Some(network) = Network::new() else {
        return;
    };
    let clocks = ["--drives", "3", "--drift-ppm", "0,40,-25", "--io", "3"];
    let segment = network.live_segment(&clocks);
    let table = stdout(&network.quadrant(&["bus", "scan", MASTER, "--dc"]));
    let head = "place     delay       off  can";
    assert!(table.contains(head), "{table}");
    for line in table.lines() {
        assert!(line.chars().count() <= 100, "{line}");
    }
    let json = stdout(&network.quadrant(&["bus", "scan", MASTER, "--dc", "--json"]));
    let json: Value = serde_json::from_str(&json).expect("JSON");
    for place in 0..3 {
        let slave = &json["slaves"][place];
        let sync = &slave["sync"];
        assert_eq!(slave["cable_delay_ns"], 300 * place, "{json}");
        assert_eq!(sync["kinds"], 5, "{json}");
        assert_eq!(sync["cycle_min_ns"], 1_000_000, "{json}");
        assert_eq!(sync["error_limit"], 9, "{json}");
        let off_ns = sync["clock_off_ns"].as_i64().expect("a number");
        assert!(off_ns.abs() < 5_000, "{off_ns}: {json}");
    }
    // Without a mailbox it tells nothing.
    assert_eq!(json["slaves"][3]["sync"]["kinds"], Value::Null, "{json}");
    drop(segment);
}

#[test]
fn an_object_is_read_and_written_and_a_refusal_is_in_words() {
    let Some(network) = Network::new() else {
        return;
    };
    let segment = network.segment(&["--drives", "2"]);
    let sdo = |arguments: &[&str]| {
        let mut all = vec!["bus", "sdo", MASTER];
        all.extend(arguments);
        network.quadrant(&all)
    };
    assert_eq!(
        stdout(&sdo(&["1", "1C12:1"])),
        "1C12:1 = 5632, 0x1600, 16 bits\n"
    );
    // A number that the drive takes, and has afterwards.
    let before = stdout(&sdo(&["1", "2300:20"]));
    let written = stdout(&sdo(&["1", "2300:20", "1"]));
    assert!(
        written.contains("2300:20 now:    1, 0x"),
        "{before}{written}"
    );

    let line = refusal(&sdo(&["0", "6075", "1"]));
    assert!(
        line.contains("writing 6075") && line.contains("can only be read"),
        "{line}"
    );
    let line = refusal(&sdo(&["0", "6099:1"]));
    assert!(
        line.contains("reading 6099:1") && line.contains("no such object"),
        "{line}"
    );
    let line = refusal(&sdo(&["5", "6064"]));
    assert!(line.contains("2 answer, at places 0 to 1"), "{line}");
    let line = refusal(&sdo(&["0", "1C12:1", "70000"]));
    assert!(
        line.contains("16 bits, which hold -32768 to 65535"),
        "{line}"
    );
    assert_eq!(sdo(&["0", "nonsense"]).status.code(), Some(2));
    assert_eq!(enabled_steps(&segment.end()), 0);
}

#[test]
fn a_scan_is_refused_while_a_cell_drives_the_segment_and_the_cell_goes_on() {
    let Some(network) = Network::new() else {
        return;
    };
    let folder = machine(&[], &[]);
    let program = folder.path().join("long.ngc");
    std::fs::write(&program, "G1 X10 F600\nG4 P20\nM2\n").expect("writing");
    let segment = network.segment(&["--drives", "3"]);
    let mut run = network.command(env!("CARGO_BIN_EXE_quadrant"));
    let mut run = run
        .arg("run")
        .args([folder.path(), &program])
        .arg("--out")
        .arg(folder.path().join("run"))
        .args(["--cell", &unique_cell()])
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("a run");
    while !segment.is_driven() {
        assert!(run.try_wait().expect("the run").is_none(), "it is over");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let line = refusal(&network.quadrant(&["bus", "scan", MASTER]));
    assert!(
        line.contains("another quadrant process drives this segment"),
        "{line}"
    );
    assert_eq!(run.wait().expect("the run").code(), Some(0));
    assert!(enabled_steps(&segment.end()) > 0);
}

#[test]
fn without_a_segment_a_scan_says_what_is_missing() {
    let Some(network) = Network::new() else {
        return;
    };
    let line = refusal(&network.quadrant(&["bus", "scan", MASTER]));
    assert!(line.contains("no slave answers"), "{line}");
    let line = refusal(&network.quadrant(&["bus", "scan", "eth77"]));
    assert!(
        line.contains("there is no such network interface"),
        "{line}"
    );
    let mut command = network.command("setpriv");
    let output = command
        .args(["--bounding-set=-all", "--inh-caps=-all", "--"])
        .args([env!("CARGO_BIN_EXE_quadrant"), "bus", "scan", MASTER])
        .output()
        .expect("setpriv");
    let line = refusal(&output);
    assert!(line.contains("setcap"), "{line}");
}

#[test]
fn the_doctor_looks_at_the_interface_of_a_machine() {
    let Some(network) = Network::new() else {
        return;
    };
    let judged = |named: &str| {
        let output = network.quadrant(&["doctor", named, "--seconds", "1", "--json"]);
        let json: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let findings = json["findings"].as_array().expect("findings").clone();
        let of = findings.into_iter().find(|finding| {
            finding["what"]
                .as_str()
                .is_some_and(|what| what.starts_with("network "))
        });
        of.expect("a finding")
    };
    let found = judged("machines/xy-ethercat");
    assert_eq!(
        (&found["what"], &found["grade"]),
        (&"network link".into(), &"ok".into())
    );
    let found = judged("eth77");
    assert_eq!(found["grade"], "must-be-changed");
    network.set_link(&[MASTER, "down"]);
    let found = judged(MASTER);
    assert_eq!(found["change"][0], "ip link set ecat-master up");
}

#[test]
fn tune_finds_the_dead_time_of_foreign_drives_and_says_what_to_write_where() {
    let Some(network) = Network::new() else {
        return;
    };
    let folder = machine(&[], &[]);
    for (options, right) in [
        (["--drives", "3"].as_slice(), 2.0),
        (&["--drives", "3", "--delay-frames", "1"], 3.0),
    ] {
        let segment = network.segment(options);
        let mut tune = network.command(env!("CARGO_BIN_EXE_quadrant"));
        let line = dead_time_line(tune.arg("tune").arg(folder.path()).arg("--dry-run"));
        println!("{options:?}: {line}");
        for axis in ["X", "Y", "Z"] {
            let found = dead_time_of(&line, axis);
            assert!((found - right).abs() <= 0.25, "{right} scans: {line}");
        }
        let write = "right is [scan] dead_time_scans = 3 in the machine file and [scaling] dead_time_scans = 3 in drives/am-m.toml";
        assert_eq!(line.ends_with(write), right == 3.0, "{line}");
        assert!(enabled_steps(&segment.end()) > 0);
    }
}

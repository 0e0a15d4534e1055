//! Segments and files that do not belong together: each is refused in one line that says what to do, and nothing is enabled.

use std::process::Output;

use crate::segment::{
    DRIVE_FILE, MASTER, Network, enabled_steps, machine, program, set_drive_keys,
};

/// A wrong configuration.
struct Wrong {
    what: &'static str,
    /// Options of the segment; none where no segment runs.
    segment: Option<&'static [&'static str]>,
    machine: &'static [(&'static str, &'static str)],
    drive: &'static [(&'static str, &'static str)],
    status: i32,
    /// What the line has to say: what is wrong, and what to do.
    says: &'static [&'static str],
}

const THREE: Option<&[&str]> = Some(&["--drives", "3"]);

const SDO_END: &str = "[option_codes]";
/// The Z axis of the machine file up to its drive, and with another one.
const Z_BEFORE: &str = "name = \"Z\"
travel_min_mm = -200.0
travel_max_mm = 200.0
rapid_mm_s = 100.0
acceleration_mm_s2 = 2000.0
quick_stop_mm_s2 = 5000.0
following_error_limit_mm = 2.0
lead_mm = 62.83185307
drive_mode = \"velocity\"

[axis.drive]
file = \"drives/am-m.toml\"";
const Z_AFTER: &str = "name = \"Z\"
travel_min_mm = -200.0
travel_max_mm = 200.0
rapid_mm_s = 100.0
acceleration_mm_s2 = 2000.0
quick_stop_mm_s2 = 5000.0
following_error_limit_mm = 2.0
lead_mm = 62.83185307
drive_mode = \"velocity\"

[axis.drive]
file = \"drives/am-s.toml\"";

const SEGMENTS: [Wrong; 13] = [
    Wrong {
        what: "the revision differs",
        segment: Some(&["--drives", "3", "--revision", "1:0x20000"]),
        machine: &[],
        drive: &[],
        status: 3,
        says: &[
            "axis Y (place 1 on the cable)",
            "revision 0x00020000",
            "--revision",
        ],
    },
    Wrong {
        what: "the product differs",
        segment: Some(&["--drives", "3", "--product", "2:0x99"]),
        machine: &[],
        drive: &[],
        status: 3,
        says: &["axis Z", "product 0x00000099", "make a drive file"],
    },
    Wrong {
        what: "the drives stand in another order",
        segment: Some(&["--drives", "3", "--units", "M,M,S-S", "--swap", "0:2"]),
        machine: &[(Z_BEFORE, Z_AFTER)],
        drive: &[],
        status: 3,
        says: &[
            "axis X",
            "such a drive is at place 2",
            "`slave` in [axis.drive]",
        ],
    },
    Wrong {
        what: "a slave too many",
        segment: Some(&["--drives", "4"]),
        machine: &[],
        drive: &[],
        status: 3,
        says: &[
            "4 slaves on the cable, 3 in the machine file",
            "bus.other_slaves",
        ],
    },
    Wrong {
        what: "a slave too few",
        segment: Some(&["--drives", "2"]),
        machine: &[],
        drive: &[],
        status: 3,
        says: &[
            "2 slaves on the cable, 3 in the machine file",
            "cable is loose",
        ],
    },
    Wrong {
        what: "a slave without a mailbox between the drives",
        segment: Some(&["--drives", "3", "--io", "1"]),
        machine: &[],
        drive: &[],
        status: 3,
        says: &["4 slaves on the cable", "bus.other_slaves"],
    },
    Wrong {
        what: "the fixed PDO lacks an entry",
        segment: Some(&["--drives", "3", "--short-map", "1"]),
        machine: &[],
        drive: &[],
        status: 3,
        says: &[
            "axis Y",
            "1600 has 7 entries, in its drive file 8",
            "quadrant bus scan",
        ],
    },
    Wrong {
        what: "an object of another size",
        segment: THREE,
        machine: &[],
        drive: &[(
            SDO_END,
            "[[start_up.sdo]]\nindex = 0x2A40\nsub = 1\nbits = 8\nvalue = 1\n\n[option_codes]",
        )],
        status: 3,
        says: &["axis X", "writing 2A40:1 = 1", "has 32 bits", "bits = 32"],
    },
    Wrong {
        what: "an object that is not there",
        segment: THREE,
        machine: &[],
        drive: &[(
            SDO_END,
            "[[start_up.sdo]]\nindex = 0x6065\nbits = 32\nvalue = 1000\n\n[option_codes]",
        )],
        status: 3,
        says: &[
            "axis X",
            "writing 6065",
            "no such object",
            "take it out of [[start_up.sdo]]",
        ],
    },
    Wrong {
        what: "an object that can only be read",
        segment: THREE,
        machine: &[],
        drive: &[(
            SDO_END,
            "[[start_up.sdo]]\nindex = 0x6075\nbits = 32\nvalue = 1000\n\n[option_codes]",
        )],
        status: 3,
        says: &[
            "axis X",
            "writing 6075",
            "can only be read",
            "take it out of [[start_up.sdo]]",
        ],
    },
    Wrong {
        what: "no interpolation time",
        segment: THREE,
        machine: &[],
        drive: &[("interpolation_time = false", "interpolation_time = true")],
        status: 3,
        says: &["axis X", "60C2:1", "interpolation_time = false"],
    },
    Wrong {
        what: "no following error window",
        segment: THREE,
        machine: &[],
        drive: &[(
            "interpolation_time = false",
            "interpolation_time = false\nfollowing_error_window = true",
        )],
        status: 3,
        says: &["axis X", "6065", "following_error_window = false"],
    },
    Wrong {
        what: "a watchdog that cannot be set",
        segment: Some(&["--drives", "3", "--watchdog-fixed", "2"]),
        machine: &[],
        drive: &[],
        status: 3,
        says: &["axis Z", "watchdog", "cannot be used"],
    },
];

const FILES: [Wrong; 5] = [
    Wrong {
        what: "two axes on one slave",
        segment: None,
        machine: &[(
            "file = \"drives/am-m.toml\"",
            "file = \"drives/am-m.toml\"\nslave = 1",
        )],
        drive: &[],
        status: 2,
        says: &["machine.toml:", "slave", "1"],
    },
    Wrong {
        what: "torque commanded to a drive in position mode",
        segment: None,
        machine: &[("drive_mode = \"velocity\"", "drive_mode = \"torque\"")],
        drive: &[("operate = \"csv\"", "operate = \"csp\"")],
        status: 2,
        says: &["drive_mode must be \"position\"", "mode.operate = \"csp\""],
    },
    Wrong {
        what: "a mode that the drive has not",
        segment: None,
        machine: &[],
        drive: &[(
            "supported = [\"csp\", \"csv\", \"cst\"]",
            "supported = [\"csp\", \"cst\"]",
        )],
        status: 2,
        says: &["am-m.toml:", "mode.operate = \"csv\"", "csp"],
    },
    Wrong {
        what: "a drive that coasts at a quick stop",
        segment: None,
        machine: &[],
        drive: &[(SDO_END, "[option_codes]\nquick_stop = 0")],
        status: 2,
        says: &["am-m.toml:", "605A", "coasts", "set it to 6"],
    },
    Wrong {
        what: "another dead time",
        segment: None,
        machine: &[("dead_time_scans = 2 ", "dead_time_scans = 3 ")],
        drive: &[],
        status: 2,
        says: &["scan.dead_time_scans = 3", "make them the same"],
    },
];

/// The line that a refused run prints.
fn refusal(what: &str, output: &Output) -> String {
    let printed = String::from_utf8_lossy(&output.stderr);
    let told = |line: &&str| line.starts_with("quadrant: ") || line.contains("ERROR");
    let mut lines = printed.lines().filter(told);
    let line = lines.next().unwrap_or_else(|| panic!("{what}: {printed}"));
    assert_eq!(lines.next(), None, "{what}: {printed}");
    line.into()
}

fn judge(wrong: &Wrong, output: &Output) -> String {
    let line = refusal(wrong.what, output);
    assert_eq!(
        output.status.code(),
        Some(wrong.status),
        "{}: {line}",
        wrong.what
    );
    for part in wrong.says {
        assert!(
            line.contains(part),
            "{}: no {part:?} in: {line}",
            wrong.what
        );
    }
    line
}

fn refused(network: &Network, wrong: &Wrong) {
    let folder = machine(wrong.machine, wrong.drive);
    let program = program(folder.path());
    let segment = wrong.segment.map(|options| network.segment(options));
    let output = network.run(folder.path(), &program);
    let line = judge(wrong, &output);
    eprintln!("{} | {line} | {}", wrong.what, wrong.status);
    if let Some(segment) = segment {
        assert_eq!(
            enabled_steps(&segment.end()),
            0,
            "{}: a drive was enabled",
            wrong.what
        );
    }
}

fn all_refused(wrongs: &[Wrong]) {
    let Some(network) = Network::new() else {
        return;
    };
    for wrong in wrongs {
        refused(&network, wrong);
    }
}

#[test]
fn a_segment_that_is_not_the_one_of_the_files_is_refused_with_what_to_do_and_nothing_is_enabled() {
    all_refused(&SEGMENTS);
}

#[test]
fn files_that_contradict_each_other_are_refused_before_the_cable_is_touched() {
    all_refused(&FILES);
}

#[test]
fn without_a_segment_a_link_or_an_interface_the_run_says_what_is_missing() {
    let Some(network) = Network::new() else {
        return;
    };
    let wrong = |what, machine, says| Wrong {
        what,
        segment: None,
        machine,
        drive: &[],
        status: 3,
        says,
    };
    let nobody = wrong("no segment", &[], &["no slave answers", "powered"]);
    refused(&network, &nobody);
    let elsewhere = wrong(
        "no such interface",
        &[("interface = \"ecat-master\"", "interface = \"eth77\"")],
        &[
            "eth77",
            "there are ecat-drives, ecat-master",
            "[bus] interface",
        ],
    );
    refused(&network, &elsewhere);
    network.set_link(&[MASTER, "down"]);
    let down = wrong("the interface is off", &[], &["ip link set ecat-master up"]);
    refused(&network, &down);
    network.set_link(&[MASTER, "up"]);
    network.set_link(&["ecat-drives", "down"]);
    let unplugged = wrong("nothing is plugged in", &[], &["no link", "cable"]);
    refused(&network, &unplugged);
}

#[test]
fn without_the_right_to_open_raw_sockets_the_run_says_how_to_get_it() {
    let Some(network) = Network::new() else {
        return;
    };
    let folder = machine(&[], &[]);
    let program = program(folder.path());
    let out = folder.path().join("run");
    let mut command = network.command("setpriv");
    let output = command
        .args(["--bounding-set=-all", "--inh-caps=-all", "--"])
        .arg(env!("CARGO_BIN_EXE_quadrant"))
        .arg("run")
        .args([folder.path(), &program])
        .arg("--out")
        .arg(&out)
        .args(["--cell", &crate::support::unique_cell()])
        .output()
        .expect("setpriv");
    let wrong = Wrong {
        what: "no right",
        segment: None,
        machine: &[],
        drive: &[],
        status: 3,
        says: &["privilege", "setcap"],
    };
    eprintln!("no right | {} | 3", judge(&wrong, &output));
}

#[test]
fn a_slave_without_a_mailbox_that_the_machine_file_names_is_left_alone() {
    let Some(network) = Network::new() else {
        return;
    };
    let other = [("standby = true", "standby = true\nother_slaves = [1]")];
    let folder = machine(&other, &[]);
    // X stands before the other slave, Y and Z behind it.
    let keys = [0, 2, 3].map(|slave| format!("{DRIVE_FILE}\nslave = {slave}"));
    set_drive_keys(folder.path(), keys.each_ref().map(String::as_str));
    let program = program(folder.path());
    let segment = network.segment(&["--drives", "3", "--io", "1"]);
    let output = network.run(folder.path(), &program);
    let printed = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{printed}");
    assert!(enabled_steps(&segment.end()) > 0);
}

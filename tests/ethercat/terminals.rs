//! A terminal behind the drives, through real processes: its inputs stop the machine, a program's outputs arrive, and whatever happens to
//! the bus, both have the values that the machine file names.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use crate::cells::{await_status, mode, order, up};
use crate::runs::{Done, kills_of_owners};
use crate::segment::{MASTER, Network, Segment, machine};
use crate::support::unique_cell;

/// What `io_terminal.py` is: 8 inputs, 8 outputs, an analogue value each way, a counter.
fn terminal_file() -> String {
    let mut text = String::from(
        "[identity]\nvendor = 0\nproduct_code = 0x106\nrevision = 2\nname = \"DIO8 AIO1 CNT1\"\n[process_data]\n",
    );
    let bits = |index: u32| {
        let bits = (1..=8).map(|sub| format!("{{ index = {index}, sub = {sub}, bits = 1 }}"));
        bits.collect::<Vec<_>>().join(", ")
    };
    let word = |index: u32| format!("{{ index = {index}, sub = 1, bits = 16 }}");
    for (key, index, entries) in [
        ("receive", 0x1600, bits(0x7000)),
        ("receive", 0x1601, word(0x7010)),
        ("transmit", 0x1A00, bits(0x6000)),
        ("transmit", 0x1A01, word(0x6010)),
        ("transmit", 0x1A02, word(0x6020)),
    ] {
        text += &format!("[[process_data.{key}]]\nindex = {index}\nentries = [{entries}]\n");
    }
    for number in 1..=8 {
        for (number, way, index) in [(number, "input", 0x6000), (number + 8, "output", 0x7000)] {
            let sub = (number - 1) % 8 + 1;
            text += &format!(
                "[[channel]]\nnumber = {number}\ndirection = \"{way}\"\nindex = {index}\nsub = {sub}\n"
            );
        }
    }
    let volts = "kind = \"float\"\nsigned = true\nscale = 0.00030517578125\nunit = \"V\"\n";
    for (number, way, index, kind) in [
        (17, "input", 0x6010, volts),
        (18, "output", 0x7010, volts),
        (20, "input", 0x6020, "kind = \"counter\"\n"),
    ] {
        text += &format!(
            "[[channel]]\nnumber = {number}\ndirection = \"{way}\"\nindex = {index}\nsub = 1\n{kind}"
        );
    }
    text
}

const SIGNALS: &str = r#"
[[signal]]
name = "chain"
lost = 0
default = 1
from = { terminal = 3, channel = 1 }
to = { input = 5 }
[[signal]]
name = "level"
kind = "float"
lost = -1
from = { terminal = 3, channel = 17 }
to = { analog_input = 0 }
[[signal]]
name = "parts"
kind = "int"
from = { terminal = 3, channel = 20 }
to = { analog_input = 1 }
[[signal]]
name = "lamp"
from = { output = 2 }
to = { terminal = 3, channel = 9 }
[[signal]]
name = "running"
from = { state = "program-runs" }
to = { terminal = 3, channel = 16 }
[[signal]]
name = "valve"
kind = "float"
from = { analog_output = 1 }
to = { terminal = 3, channel = 18 }
"#;

const CHAIN: &str = "[functions]\nemergency_stop = \"chain\"\n";

/// machines/xy-ethercat with the terminal at place 3.
fn with_terminal(more: &str) -> TempDir {
    let terminal = "standby = true\n[[bus.terminal]]\nslave = 3\nfile = \"terminals/dio.toml\"\n";
    let folder = machine(&[("standby = true\n", terminal)], &[]);
    fs::create_dir(folder.path().join("terminals")).expect("a folder");
    fs::write(folder.path().join("terminals/dio.toml"), terminal_file()).expect("writing");
    let file = folder.path().join("machine.toml");
    let text = fs::read_to_string(&file).expect("machine.toml");
    fs::write(file, text + SIGNALS + more).expect("writing");
    folder
}

fn segment(network: &Network, more: &[&str]) -> Segment {
    let mut options = vec!["--drives", "3", "--terminal", "3", "--input", "3:0"];
    options.extend(more);
    network.segment(&options)
}

/// Runs a program in lockstep, with a fault script.
pub fn ran(network: &Network, machine: &TempDir, program: &str, faults: Option<&str>) -> Done {
    let shown = |name: &str| machine.path().join(name).to_string_lossy().into_owned();
    let (folder, file, out, script) = (shown("."), shown("p.ngc"), shown("run"), shown("f.toml"));
    fs::write(&file, program).expect("writing");
    let _ = fs::remove_dir_all(&out);
    let cell = unique_cell();
    let mut arguments = vec!["run", &folder, &file, "--out", &out, "--cell", &cell];
    if let Some(faults) = faults {
        fs::write(&script, faults).expect("writing");
        arguments.extend(["--faults", &script, "--with-drives"]);
    }
    let output = network.quadrant(&arguments);
    let report = fs::read_to_string(Path::new(&out).join("report.json"));
    let report = report.unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    Done {
        output,
        report: serde_json::from_str(&report).expect("report.json"),
    }
}

/// Runs a program to its end, which says this.
fn says(
    (network, machine): (&Network, &TempDir),
    (program, faults): (&str, Option<&str>),
    words: &str,
) -> Done {
    let done = ran(network, machine, program, faults);
    let kind = done.text("/outcome/kind");
    assert_eq!(kind, "completed", "{}", done.printed());
    let events = machine.path().join("run/events.jsonl");
    let events = fs::read_to_string(events).expect("events");
    assert!(events.contains(words), "{events}");
    done
}

#[test]
fn an_input_of_a_terminal_that_opens_or_a_terminal_that_vanishes_trips_the_machine_in_that_scan() {
    let Some(network) = Network::new() else {
        return;
    };
    let machine = with_terminal(CHAIN);
    let program = "G21 G90\nG1 X60 F3000\nG1 X-60\nM2\n";
    for fault in ["enabled+900 input 3 0 off", "enabled+900 drop 3"] {
        let _segment = segment(&network, &["--at", fault]);
        let done = ran(&network, &machine, program, None);
        let printed = done.printed();
        assert_eq!(done.output.status.code(), Some(1), "{fault}: {printed}");
        assert!(
            printed.contains("the emergency-stop chain is open"),
            "{fault}: {printed}"
        );
        let scan = printed.split("tripped in scan ").nth(1).expect("a trip");
        let scan = scan.split(':').next().and_then(|n| n.parse().ok());
        let scan: u64 = scan.expect("a scan");
        assert!((900..=910).contains(&scan), "{fault}: scan {scan}");
    }
}

/// Outputs, a value, three parts counted over the end of 16 bits; the input shows what the output is.
const SPEAKS: &str = "G21 G90\nM64 P2\nM68 E1 Q2.5\nG4 P0.1\nM66 E0 L0\n#1=#5399\nM65 P2\nG4 P0.1\n\
    M64 P2\nG4 P0.1\nM65 P2\nG4 P0.1\nM64 P2\nG1 X5 F3000\nG1 X0\nM66 E1 L0\n#2=#5399\n(DEBUG,level #1 parts #2)\nM2\n";

#[test]
fn a_program_commands_a_terminal_and_reads_it_and_no_output_changes_when_the_owner_of_the_bus_is_killed()
 {
    let Some(network) = Network::new() else {
        return;
    };
    let machine = with_terminal("");
    let mut runs = Vec::new();
    let kills = kills_of_owners(700, 10);
    for faults in [None, None, Some(kills.as_str())] {
        let segment = segment(&network, &[]);
        let done = says(
            (&network, &machine),
            (SPEAKS, faults),
            "level 2.500000 parts 65537.000000",
        );
        runs.push((
            segment.order("outputs 3"),
            done.text("/motion_digest"),
            done.text("/digest"),
        ));
    }
    assert_eq!(runs[0], runs[1]);
    assert_eq!((&runs[0].0, &runs[0].1), (&runs[2].0, &runs[2].1));
    // Each change once: the lamp and 2.5 V as 0x2000, and while the program runs the last of the outputs.
    let sent: Vec<&str> = runs[0].0.split(' ').collect();
    let lamps = sent.iter().filter(|bytes| bytes.starts_with("81")).count();
    assert_eq!(lamps, 3 + 1, "{sent:?}");
    assert!(sent.contains(&"810020"), "{sent:?}");
}

#[test]
fn signals_of_a_terminal_that_vanishes_have_the_values_for_it_and_a_program_can_go_on() {
    let Some(network) = Network::new() else {
        return;
    };
    let machine = with_terminal("");
    let _segment = segment(&network, &["--at", "enabled+500 drop 3"]);
    let program = "G21 G90\nM66 P5 L3 Q1\n#1=#5399\nM66 P5 L4 Q5\n#2=#5399\nM66 E0 L0\n#3=#5399\nG1 X5 F3000\n\
                   (DEBUG,chain #1 #2 level #3)\nM2\n";
    says(
        (&network, &machine),
        (program, None),
        "chain 1.000000 0.000000 level -1.000000",
    );
}

#[test]
fn a_terminal_that_lost_its_power_comes_back_when_the_drives_are_to_be_switched_on() {
    let Some(network) = Network::new() else {
        return;
    };
    let machine = with_terminal(CHAIN);
    let segment = segment(&network, &[]);
    let folder = machine.path().to_string_lossy().into_owned();
    let scan = network.quadrant(&["bus", "scan", MASTER, "--machine", &folder]);
    let scan = String::from_utf8_lossy(&scan.stdout).into_owned();
    assert!(scan.contains("place 3: terminal DIO8 AIO1 CNT1"), "{scan}");
    assert!(scan.contains("chain from channel 1"), "{scan}");
    let out = machine.path().join("up").to_string_lossy().into_owned();
    let cell = unique_cell();
    let mut up = up(&network, [&folder, &out, &cell]);
    let await_mode = |what: &str, wanted: &str| {
        await_status(&network, &cell, what, |status| mode(status) == wanted);
    };
    await_mode("starting", "disabled");
    order(&network, &cell, &["enable"]);
    await_mode("enabling", "ready");
    segment.order("power-cycle 3");
    await_mode("tripping", "tripped");
    let enable = |what: &str| {
        let done = network.quadrant(&["enable", "--cell", &cell]);
        let printed = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.success(), what.is_empty(), "{printed}");
        assert!(printed.contains(what), "{printed}");
    };
    // It starts the bus again, with the terminal.
    enable("emergency-stop chain");
    let mut tries = 0;
    while !network
        .quadrant(&["enable", "--cell", &cell])
        .status
        .success()
    {
        tries += 1;
        assert!(tries < 100, "the terminal does not come back");
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    await_mode("enabling again", "ready");
    order(&network, &cell, &["down"]);
    assert!(up.wait().expect("its end").success());
}

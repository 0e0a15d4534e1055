//! What real drives latch and count: homing by switch and index, a probe at their touch-probe inputs, and absolute encoders whose zero is
//! not the machine's.

use std::fs;
use std::path::Path;

use bus::sample::AnswerOutcome;
use monitor::log::{RunLog, Sample};
use tempfile::TempDir;

use crate::runs::kills_of_owners;
use crate::segment::{DRIVE_FILE, MASTER, Network, Segment, is_enabled, machine, set_drive_keys};
use crate::support::unique_cell;

/// The drive file with the inputs and the touch-probe unit that `segment.py --touch` gives its drives.
const DRIVE: &[(&str, &str)] = &[
    (
        "    { index = 0x60B1, bits = 32 },  # velocity offset\n",
        "    { index = 0x60B1, bits = 32 },\n    { index = 0x60B8, bits = 16 },\n",
    ),
    (
        "    { index = 0x2401, sub = 1, bits = 16 },  # winding temperature\n",
        "    { index = 0x2401, sub = 1, bits = 16 },\n    { index = 0x60FD, bits = 32 },\n    { index = 0x60B9, bits = 16 },\n    \
         { index = 0x60BA, bits = 32 },\n    { index = 0x60BB, bits = 32 },\n    { index = 0x60BC, bits = 32 },\n",
    ),
];

/// A turn of the motor, in mm at the table.
const TURN_MM: f64 = 62.831_853_07;

/// The shipped machine over such drives, keys added to the drives of its axes, and tables behind them.
fn machine_with(keys: [&str; 3], end: &str) -> TempDir {
    let folder = machine(&[], DRIVE);
    let keys = keys.map(|keys| format!("{DRIVE_FILE}\n{}", keys.trim_end()));
    set_drive_keys(folder.path(), keys.each_ref().map(String::as_str));
    let file = folder.path().join("machine.toml");
    let text = fs::read_to_string(&file).expect("the machine file");
    fs::write(&file, text + end).expect("writing");
    folder
}

/// Runs a program in lockstep, owners of the bus killed or not.
fn run(network: &Network, folder: &Path, [program, orders]: [&str; 2], faults: bool) {
    let name = |file: &str| folder.join(file).to_string_lossy().into_owned();
    for (file, text) in [("program.ngc", program), ("orders.toml", orders)] {
        fs::write(folder.join(file), text).expect("writing");
    }
    let (machine, cell) = (folder.to_string_lossy(), unique_cell());
    let (program, orders, out) = (name("program.ngc"), name("orders.toml"), name("run"));
    let script = name("faults.toml");
    let mut arguments = vec![
        "run", &machine, &program, "--orders", &orders, "--out", &out, "--cell", &cell,
    ];
    if faults {
        fs::write(&script, kills_of_owners(350, 400)).expect("writing");
        arguments.extend(["--faults", &script, "--with-drives"]);
    }
    let done = network.quadrant(&arguments);
    let printed = String::from_utf8_lossy(&done.stderr) + String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success(), "{printed}");
}

/// Where the places of drives were when their last step in operation was made, in mm.
fn last_places(record: &str) -> [f64; 3] {
    let mut places = [f64::NAN; 3];
    let rows = record.lines();
    for row in rows.filter(|row| is_enabled(row)) {
        let cells: Vec<&str> = row.split(',').collect();
        let (Some(drive), Some(place)) = (number(cells.get(4)), number(cells.get(8))) else {
            continue;
        };
        places[drive as usize] = place * 1e-5;
    }
    places
}

fn number(text: Option<&&str>) -> Option<f64> {
    text.and_then(|text| text.parse().ok())
}

fn segment(network: &Network, options: &[&str]) -> Segment {
    network.segment(&[&["--drives", "3"], options].concat())
}

#[test]
fn axes_are_homed_by_the_switch_and_the_index_of_their_drives_and_an_absolute_one_has_its_zero() {
    let Some(network) = Network::new() else {
        return;
    };
    for faults in [false, true] {
        let folder = machine_with(
            [
                "input_bits = [2]\nfirst_input = 3\n[axis.homing]\nmethod = \"switch-index\"\nswitch_input = 3\nsearch_mm_s = 80\n\
             latch_mm_s = 20\nposition_mm = -125.0\nrest_mm = -100.0\n",
                "[axis.homing]\nmethod = \"index\"\nsearch_mm_s = 30\nlatch_mm_s = 30\nposition_mm = 1.5\nrest_mm = 30.0\n",
                "zero_mm = 12.25\n",
            ],
            "",
        );
        let segment = segment(
            &network,
            &[
                "--touch",
                "0:switch=-10000000",
                "--sim",
                "1:q0_rad=1",
                "--sim",
                "2:q0_rad=0.5",
            ],
        );
        let orders =
            "[[order]]\nscan = 300\norder = \"home\"\n[[order]]\nscan = 9000\norder = \"resume\"\n";
        run(
            &network,
            folder.path(),
            ["G21 G90 F3000\nG1 X-90 Y25 Z20\nG4 P0.3\nM2\n", orders],
            faults,
        );
        let places = last_places(&segment.end());
        // The index behind the switch is that of two turns below zero; the first one below its start is that of the other axis.
        let expected = [-90.0 + 125.0 - 2.0 * TURN_MM, 25.0 - 1.5, 20.0 - 12.25];
        for (place, expected) in places.into_iter().zip(expected) {
            assert!((place - expected).abs() < 0.005, "{places:?}, {expected}");
        }
    }
}

#[test]
fn a_drive_homes_by_itself_whoever_owns_the_bus_meanwhile() {
    let Some(network) = Network::new() else {
        return;
    };
    for faults in [false, true] {
        let folder = machine_with(["[axis.homing]\nmethod = \"drive\"\n", "", ""], "");
        let segment = segment(&network, &["--touch", "0:switch=-1000000"]);
        let orders =
            "[[order]]\nscan = 300\norder = \"home\"\n[[order]]\nscan = 3000\norder = \"resume\"\n";
        let program = "G21 G90 F3000\nG1 X20\nG4 P0.3\nM2\n";
        run(&network, folder.path(), [program, orders], faults);
        // The switch, as far as the drive went on in a cycle, is the zero of the machine.
        let [place, ..] = last_places(&segment.end());
        assert!((place - (20.0 - 10.0)).abs() < 0.05, "{place} mm");
    }
}

/// A probe whose contact is an input of the drive of X.
const PROBE: &str = "[[signal]]\nname = \"touch\"\nfrom = { drive = \"X\", bit = 16 }\n[functions]\nprobe = \"touch\"\n[program]\nprobe = true\n";

/// Trips of two touches of X at 30 mm, one each way, in nm.
fn trips(network: &Network, keys: &str, faults: bool) -> Vec<i64> {
    let folder = machine_with([keys, "", ""], PROBE);
    let _segment = segment(network, &["--touch", "0:contact=3000000"]);
    let program = "G21 G90\nG38.2 X60 F613\nG1 X35 F900\nG38.4 X0 F613\nM2\n";
    run(network, folder.path(), [program, ""], faults);
    let mut trips = Vec::new();
    let mut last = 0;
    for sample in RunLog::open(&folder.path().join("run")).expect("a log") {
        let Ok(Sample::Feedback(feedback)) = sample else {
            continue;
        };
        let answer = feedback.answer;
        if answer.outcome == AnswerOutcome::Given as u32 && answer.number != last {
            last = answer.number;
            trips.push(answer.tripped[0]);
        }
    }
    trips
}

#[test]
fn a_probe_trips_where_the_drive_latched_it_and_as_an_input_within_the_way_of_a_scan() {
    let Some(network) = Network::new() else {
        return;
    };
    for faults in [false, true] {
        let latched = trips(&network, "probe_edge = \"rising\"\n", faults);
        // Turns of the motor are 710 rad to 113 in the drive file: a tenth of a millionth.
        assert_eq!(latched, [29_999_997, 29_999_997]);
    }
    let shown = trips(&network, "", false);
    assert_eq!(shown.len(), 2);
    for trip in shown {
        // 613 mm/min are 10.2 µm a scan.
        assert!((trip - 30_000_000).abs() < 10_300, "{trip}");
    }
}

#[test]
fn a_drive_holds_the_limit_of_its_torque() {
    let Some(network) = Network::new() else {
        return;
    };
    let folder = machine_with(["torque_limit_percent = 150.0\n", "", ""], "");
    let file = folder.path().join("machine.toml");
    let text = fs::read_to_string(&file).expect("the machine file");
    let weaker = text.replace("peak_torque_nm = 76.5", "peak_torque_nm = 50.0");
    fs::write(&file, &weaker).expect("writing");
    let _segment = segment(&network, &["--touch", "0:switch=0"]);
    run(&network, folder.path(), ["G4 P0.1\nM2\n", ""], false);
    for (place, object, limit) in [
        ("0", "60E0", 1500),
        ("0", "60E1", 1500),
        ("1", "60E0", 2243),
    ] {
        let shown = network.quadrant(&["bus", "sdo", MASTER, place, object]);
        let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
        assert!(shown.contains(&format!("= {limit},")), "{shown}");
    }
}

#[test]
fn what_a_drive_cannot_latch_and_inputs_that_nobody_is_are_refused() {
    let Some(network) = Network::new() else {
        return;
    };
    let unlatched = machine(&[], &[]);
    let file = unlatched.path().join("machine.toml");
    let text = fs::read_to_string(&file).expect("the machine file");
    let refused = |folder: &Path, keys: &str, end: &str, words: &str| {
        let edited = text.replacen(DRIVE_FILE, &format!("{DRIVE_FILE}\n{keys}"), 1) + end;
        fs::write(folder.join("machine.toml"), edited).expect("writing");
        let check = network.quadrant(&["check", &folder.to_string_lossy()]);
        let printed = String::from_utf8_lossy(&check.stderr).into_owned();
        assert_eq!(check.status.code(), Some(2), "{keys}: {printed}");
        assert!(printed.contains(words), "{keys}: {printed}");
    };
    let latching = machine(&[], DRIVE);
    let index = "[axis.homing]\nmethod = \"index\"\n";
    refused(
        unlatched.path(),
        index,
        "",
        "homing by index needs 60B8, 60B9 and 60BC",
    );
    let switch = "[axis.homing]\nmethod = \"switch\"\nswitch_input = 5\n";
    let words = "homing.switch_input = 5: no drive ([axis.drive] input_bits) and no signal";
    refused(latching.path(), switch, "", words);
    let edge = "probe_edge = \"falling\"\n";
    refused(
        latching.path(),
        edge,
        "",
        "needs the signal of the contact as well",
    );
    let words = "drive.probe_edge needs 60B8, 60B9, and 60BA (rising) or 60BB (falling)";
    let end = PROBE.replace("drive = \"X\", bit = 16", "output = 1");
    refused(unlatched.path(), edge, &end, words);
    let words = "drive.encoder_turns = 4: its encoder shows the same again after 251.3 mm, and the axis has a travel of 400.0 mm";
    refused(unlatched.path(), "encoder_turns = 4\n", "", words);
    let words = "is 51.15 N·m, and motor.peak_torque_nm = 76.5: the machine counts on more than the drive may give; make it 51.15 at most";
    refused(unlatched.path(), "torque_limit_percent = 150\n", "", words);
    let both = "zero_mm = 3\n[axis.homing]\nmethod = \"drive\"\n";
    refused(
        unlatched.path(),
        both,
        "",
        "goes with an absolute encoder alone",
    );
}

//! Digital inputs of drives (object 60FD): those that the machine file names are inputs of the machine, all are in what observers get.

use std::fs;
use std::path::Path;

use bus::drive_page::{Inputs, Outputs, SlaveWiring, Wiring};
use bytemuck::Zeroable;
use fieldbus::drives::{Cia402Drives, Wire, WireAnswer};
use fieldbus::setups;
use machine::Machine;
use master::{DriveCommand, Drives};
use tempfile::TempDir;

const INPUT_BYTES: u16 = 24;
const SLAVES: u16 = 3;
/// Where 60FD is in the inputs of a drive, in place of its fault word.
const AT: usize = 16;

/// machines/xy-ethercat, text of its files replaced.
fn folder(machine_edits: &[(&str, &str)], drive_edits: &[(&str, &str)]) -> TempDir {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy-ethercat");
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("drives")).expect("a folder");
    for (name, edits) in [
        ("machine.toml", machine_edits),
        ("drives/am-m.toml", drive_edits),
    ] {
        let mut text = fs::read_to_string(shipped.join(name)).expect("a shipped file");
        for (what, by) in edits {
            assert!(text.contains(what), "{name} has no {what:?}");
            text = text.replacen(what, by, 1);
        }
        fs::write(folder.path().join(name), text).expect("writing");
    }
    folder
}

/// 60FD in place of the drive's fault word.
const MAPPED: &[(&str, &str)] = &[("index = 0x2600, sub = 1", "index = 0x60FD")];
/// The tables of the drives of X and Y.
const FILE: &str = "file = \"drives/am-m.toml\"\n";

/// The machine file with these keys for the drive of X, and for that of Y.
fn keys(of_x: &str, of_y: &str) -> [(String, String); 1] {
    let shipped =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy-ethercat/machine.toml");
    let text = fs::read_to_string(shipped).expect("a shipped file");
    let mut parts = text.splitn(3, FILE);
    let mut part = || parts.next().expect("three axes").to_string();
    let edited = [&part(), FILE, of_x, &part(), FILE, of_y, &part()].concat();
    [(text, edited)]
}

fn with(of_x: &str, of_y: &str, drive_edits: &[(&str, &str)]) -> TempDir {
    let edits = keys(of_x, of_y);
    let edits = edits
        .each_ref()
        .map(|(what, by)| (what.as_str(), by.as_str()));
    folder(&edits, drive_edits)
}

/// Slaves in OP that show these inputs, or answer no more.
struct Shows {
    wiring: Wiring,
    digital: [u32; SLAVES as usize],
    answer: WireAnswer,
}

impl Wire for Shows {
    fn wiring(&self) -> &Wiring {
        &self.wiring
    }

    fn exchange(&mut self, _outputs: &Outputs, inputs: &mut Inputs) -> WireAnswer {
        for (place, digital) in self.digital.iter().enumerate() {
            inputs.slaves[place].answered = 1;
            inputs.slaves[place].al_status = 8;
            let at = place * usize::from(INPUT_BYTES) + AT;
            inputs.image[at..at + 4].copy_from_slice(&digital.to_le_bytes());
        }
        inputs.round_trip_ns = 81_000;
        inputs.counts.sent += 1;
        self.answer
    }

    fn start_again(&mut self) {}

    fn pause(&self) {}
}

fn shows(digital: [u32; SLAVES as usize], answer: WireAnswer) -> Shows {
    let mut wiring = Wiring::zeroed();
    wiring.slave_count = SLAVES.into();
    for (place, slave) in (0..SLAVES).zip(&mut wiring.slaves) {
        slave.inputs_at = place * INPUT_BYTES;
        slave.input_bytes = INPUT_BYTES;
        slave.outputs_at = SLAVES * INPUT_BYTES + place * 20;
        slave.output_bytes = 20;
        assert_ne!(*slave, SlaveWiring::default());
    }
    Shows {
        wiring,
        digital,
        answer,
    }
}

fn drives(folder: &TempDir, wire: Shows) -> Cia402Drives<Shows> {
    let machine = Machine::load(folder.path()).expect("machine.toml");
    let setups = setups::load(&machine, &folder.path().join("machine.toml"));
    let setups = setups.expect("drive files").expect("[bus]");
    let mut drives = Cia402Drives::new(&machine, &setups, wire).expect("drives");
    drives.exchange(&[DriveCommand::Disabled; 3]);
    drives
}

#[test]
fn inputs_of_drives_are_the_inputs_of_the_machine_that_its_file_names() {
    let folder = with(
        "input_bits = [16, 2]\nfirst_input = 8\n",
        "input_bits = [31]\nfirst_input = 63\n",
        MAPPED,
    );
    let digital = [1 << 16, 1 << 31, u32::MAX];
    let seen = drives(&folder, shows(digital, WireAnswer::Answered));
    assert_eq!(seen.inputs().digital, 1 << 8 | 1 << 63);
    let second = drives(&folder, shows([1 << 2, 0, 0], WireAnswer::Answered));
    assert_eq!(second.inputs().digital, 1 << 9);
    let cycle = seen.bus_cycle().expect("a bus");
    assert_eq!(cycle.inputs[..3], digital.map(u64::from));
    assert_eq!((cycle.slaves_operational, cycle.slave_count), (3, 3));
    assert_eq!((cycle.answered, cycle.round_trip_ns), (1, 81_000));
}

#[test]
fn a_new_master_is_shown_once_which_drives_were_without_power_since_the_one_before_saw_them() {
    let folder = folder(&[], MAPPED);
    let of_start_up = |nonce, restarted: [u32; 3]| {
        let mut wire = shows([0; 3], WireAnswer::Answered);
        wire.wiring.nonce = nonce;
        for (slave, restarted) in wire.wiring.slaves.iter_mut().zip(restarted) {
            slave.restarted = restarted;
        }
        drives(&folder, wire)
    };
    let shown = |drives: &mut Cia402Drives<Shows>| {
        drives.exchange(&[DriveCommand::Disabled; 3]);
        [0, 1, 2].map(|axis| drives.feedback(axis).restarted)
    };
    let mut first = of_start_up(7, [1, 1, 1]);
    assert_eq!(shown(&mut first), [false; 3], "nobody had seen them before");
    let mut state = vec![0; first.state_bytes()];
    first.save(&mut state);
    for (nonce, restarted) in [(7, [1, 1, 1]), (8, [0, 1, 0])] {
        let mut next = of_start_up(nonce, restarted);
        next.restore(&state).expect("a saved state");
        assert_eq!(shown(&mut next), [false, nonce == 8, false]);
        assert_eq!(shown(&mut next), [false; 3]);
    }
}

#[test]
fn a_bus_that_is_down_shows_no_input_and_nobody_in_operation() {
    let folder = with("input_bits = [0]\n", "", MAPPED);
    let down = drives(&folder, shows([1, 1, 1], WireAnswer::Down));
    assert_eq!(down.inputs().digital, 0);
    let cycle = down.bus_cycle().expect("a bus");
    assert_eq!(cycle.inputs, [0; bus::sample::MAX_AXES]);
    assert_eq!((cycle.slaves_operational, cycle.answered), (0, 0));
    assert_eq!((cycle.round_trip_ns, cycle.clock_offset_ns), (0, 0));
}

#[test]
fn inputs_that_two_drives_share_or_that_no_drive_sends_are_refused() {
    let refusal = |folder: &TempDir| match Machine::load(folder.path()) {
        Err(error) => error.to_string(),
        Ok(machine) => {
            let file = folder.path().join("machine.toml");
            format!("{:#}", setups::load(&machine, &file).expect_err("refused"))
        }
    };
    let shared = with(
        "input_bits = [0, 1]\n",
        "input_bits = [5]\nfirst_input = 1\n",
        MAPPED,
    );
    let words = refusal(&shared);
    assert!(
        words.contains("digital input 1, which is one of axis X"),
        "{words}"
    );
    let beyond = with("input_bits = [0, 1]\nfirst_input = 63\n", "", MAPPED);
    let words = refusal(&beyond);
    assert!(
        words.contains("digital input 64: the last one is 63"),
        "{words}"
    );
    let no_bit = with("input_bits = [32]\n", "", MAPPED);
    let words = refusal(&no_bit);
    assert!(words.contains("input_bits"), "{words}");
    let unmapped = with("input_bits = [0]\n", "", &[]);
    let words = refusal(&unmapped);
    assert!(words.contains("needs 60FD"), "{words}");
}

//! Signals of drives and terminals: which bits they are, what devices that vanish or fall silent show, and what is refused.

use std::cell::RefCell;
use std::fs;
use std::path::Path;
use std::rc::Rc;

use bus::drive_page::{Inputs, Outputs, Wiring};
use bytemuck::Zeroable;
use fieldbus::drives::{Cia402Drives, Wire, WireAnswer};
use fieldbus::setups::{self, Setups};
use fieldbus::terminal_file;
use machine::Machine;
use master::{DriveCommand, Drives};
use tempfile::TempDir;

/// Eight switches each way, an analogue value each way, a counter; process data without a mailbox.
const TERMINAL: &str = r#"
[identity]
vendor = 0
product_code = 0x106
revision = 2
name = "DIO8"
[process_data]
[[process_data.receive]]
index = 0x1600
entries = [{ index = 0x7000, sub = 1, bits = 8 }]
[[process_data.receive]]
index = 0x1601
entries = [{ index = 0x7010, sub = 1, bits = 16 }, { index = 0x7011, bits = 8, value = 0x5A }]
[[process_data.transmit]]
index = 0x1A00
entries = [{ index = 0x6000, sub = 1, bits = 3 }, { bits = 5 }]
[[process_data.transmit]]
index = 0x1A01
entries = [{ index = 0x6010, bits = 16 }, { index = 0x6020, bits = 16 }]
[[channel]]
number = 1
direction = "input"
index = 0x6000
sub = 1
first_bit = 2
[[channel]]
number = 2
direction = "input"
kind = "float"
index = 0x6010
signed = true
scale = 0.00030517578125
unit = "V"
[[channel]]
number = 3
direction = "input"
kind = "counter"
index = 0x6020
[[channel]]
number = 11
direction = "output"
index = 0x7000
sub = 1
first_bit = 7
[[channel]]
number = 12
direction = "output"
kind = "float"
index = 0x7010
sub = 1
signed = true
scale = 0.00030517578125
"#;

const SIGNALS: &str = r#"
[[signal]]
name = "door"
lost = 0
default = 1
from = { terminal = 3, channel = 1 }
[[signal]]
name = "pressure"
kind = "float"
from = { terminal = 3, channel = 2 }
[[signal]]
name = "parts"
kind = "int"
from = { terminal = 3, channel = 3 }
[[signal]]
name = "lamp"
lost = 1
from = { output = 0 }
to = { terminal = 3, channel = 11 }
[[signal]]
name = "valve"
kind = "float"
lost = -5
from = { analog_output = 0 }
to = { terminal = 3, channel = 12 }
[[signal]]
name = "switch_of_x"
from = { drive = "X", bit = 3 }
[[signal]]
name = "horn"
lost = 1
from = { state = "tripped" }
to = { drive = "Y", bit = 17 }
"#;

const DOOR: usize = 0;
const PRESSURE: usize = 1;
const PARTS: usize = 2;
const SWITCH_OF_X: usize = 5;

fn edited(text: &str, edits: &[(&str, &str)]) -> String {
    let mut text = text.to_string();
    for (what, by) in edits {
        assert!(text.contains(what), "no {what:?}");
        text = text.replacen(what, by, 1);
    }
    text
}

/// machines/xy-ethercat with a terminal behind its drives, and 60FD and 60FE:1 in what they exchange.
fn folder(signals: &[(&str, &str)], terminal: &[(&str, &str)], drive: &[(&str, &str)]) -> TempDir {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy-ethercat");
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: String| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(path, text).expect("writing");
    };
    let read = |name: &str| fs::read_to_string(shipped.join(name)).expect("a shipped file");
    let standby = "standby = true\n";
    let with = format!("{standby}[[bus.terminal]]\nslave = 3\nfile = \"terminals/dio8.toml\"\n");
    let machine = edited(&read("machine.toml"), &[(standby, &with)]);
    write("machine.toml", machine + &edited(SIGNALS, signals));
    write("terminals/dio8.toml", edited(TERMINAL, terminal));
    write("drives/am-m.toml", edited(&read("drives/am-m.toml"), drive));
    folder
}

/// 60FD in place of the drive's fault word, 60FE:1 in place of its last number.
const MAPPED: &[(&str, &str)] = &[
    ("index = 0x2600, sub = 1", "index = 0x60FD"),
    (
        "    { index = 0x60B2, bits = 16 },",
        "    { index = 0x60B2, bits = 16 },\n    { index = 0x60FE, sub = 1, bits = 32, value = 0x80000001 },",
    ),
];

fn loaded(folder: &TempDir) -> (Machine, anyhow::Result<Setups>) {
    let machine = Machine::load(folder.path()).expect("machine.toml");
    let setups = setups::load(&machine, &folder.path().join("machine.toml"));
    (machine, setups.map(|setups| setups.expect("[bus]")))
}

const INPUT_BYTES: u16 = 24;
const OUTPUT_BYTES: u16 = 24;
/// Where 60FD is in the inputs of a drive, 60FE:1 in its outputs.
const INPUTS_AT: usize = 16;

/// What a segment shows and gets, in the hands of a test.
struct Segment {
    /// Inputs of the terminal.
    own: [u8; 5],
    digital_x: u32,
    answer: WireAnswer,
    /// What the terminal says of its state; it counts for the working counter while it is in OP.
    al_status: u16,
    sent: Outputs,
    started_again: u32,
}

/// Three drives in OP, then a terminal.
struct Shows {
    wiring: Wiring,
    segment: Rc<RefCell<Segment>>,
}

impl Wire for Shows {
    fn wiring(&self) -> &Wiring {
        &self.wiring
    }

    fn exchange(&mut self, outputs: &Outputs, inputs: &mut Inputs) -> WireAnswer {
        let mut segment = self.segment.borrow_mut();
        segment.sent = *outputs;
        for slave in &mut inputs.slaves[..4] {
            (slave.answered, slave.al_status) = (1, 8);
        }
        inputs.slaves[3].answered = u16::from(segment.al_status != 0);
        inputs.slaves[3].al_status = segment.al_status;
        inputs.working_counter = if segment.al_status == 8 { 12 } else { 9 };
        inputs.image[INPUTS_AT..INPUTS_AT + 4].copy_from_slice(&segment.digital_x.to_le_bytes());
        let at = usize::from(self.wiring.slaves[3].inputs_at);
        inputs.image[at..at + 5].copy_from_slice(&segment.own);
        segment.answer
    }

    fn start_again(&mut self) {
        self.segment.borrow_mut().started_again += 1;
    }

    fn pause(&self) {}
}

fn shows() -> Shows {
    let mut wiring = Wiring::zeroed();
    wiring.slave_count = 4;
    for (place, slave) in (0..4).zip(&mut wiring.slaves) {
        slave.inputs_at = place * INPUT_BYTES;
        slave.input_bytes = INPUT_BYTES;
        slave.outputs_at = 4 * INPUT_BYTES + place * OUTPUT_BYTES;
        slave.output_bytes = OUTPUT_BYTES;
        slave.working_counter = 3;
    }
    (wiring.slaves[3].input_bytes, wiring.slaves[3].output_bytes) = (5, 4);
    let segment = Segment {
        own: [0b100, 0x00, 0x40, 0xFE, 0xFF],
        digital_x: 1 << 3,
        answer: WireAnswer::Answered,
        al_status: 8,
        sent: Outputs::zeroed(),
        started_again: 0,
    };
    let segment = Rc::new(RefCell::new(segment));
    Shows { wiring, segment }
}

const OFF: [DriveCommand; 3] = [DriveCommand::Disabled; 3];

fn drives(folder: &TempDir) -> (Cia402Drives<Shows>, Rc<RefCell<Segment>>) {
    let (machine, setups) = loaded(folder);
    let setups = setups.expect("good files");
    let wire = shows();
    let segment = Rc::clone(&wire.segment);
    let mut drives = Cia402Drives::new(&machine, &setups, wire).expect("drives");
    drives.exchange(&OFF);
    (drives, segment)
}

/// What the terminal is sent, and the 60FE:1 of Y.
fn sent(image: &[u8]) -> ([u8; 4], u32) {
    let at = usize::from(4 * INPUT_BYTES + 3 * OUTPUT_BYTES);
    let of_y = usize::from(4 * INPUT_BYTES + OUTPUT_BYTES) + INPUTS_AT;
    (
        image[at..at + 4].try_into().expect("4 bytes"),
        u32::from_le_bytes(image[of_y..of_y + 4].try_into().expect("4 bytes")),
    )
}

#[test]
fn signals_are_the_bits_that_the_files_say_and_outputs_have_a_value_for_a_silent_master() {
    let folder = folder(&[], &[], MAPPED);
    let (mut drives, segment) = drives(&folder);
    assert_eq!(drives.signal(DOOR), Some(1.0));
    assert_eq!(drives.signal(PRESSURE), Some(5.0));
    assert_eq!(drives.signal(PARTS), Some(65_534.0));
    assert_eq!(drives.signal(SWITCH_OF_X), Some(1.0));
    assert_eq!(drives.signal(3), None);
    // Nobody has commanded anything: that is as if nobody did any more.
    let silent = ([0x80, 0x00, 0xC0, 0x5A], 0x8002_0001);
    assert_eq!(sent(&segment.borrow().sent.image), silent);
    drives.command_signals(&[0.0, 0.0, 0.0, 0.0, 10.0, 0.0, 0.0]);
    drives.exchange(&OFF);
    assert_eq!(
        sent(&segment.borrow().sent.image),
        ([0x00, 0xFF, 0x7F, 0x5A], 0x8000_0001)
    );
    assert_eq!(sent(&segment.borrow().sent.silent), silent);
    drives.command_signals(&[0.0, 0.0, 0.0, 1.0, -2.5, 0.0, 1.0]);
    drives.exchange(&OFF);
    assert_eq!(
        sent(&segment.borrow().sent.image),
        ([0x80, 0x00, 0xE0, 0x5A], 0x8002_0001)
    );
}

#[test]
fn a_terminal_that_leaves_or_falls_silent_is_lost_and_its_counter_begins_anew() {
    let folder = folder(&[], &[], MAPPED);
    let (mut drives, segment) = drives(&folder);
    segment.borrow_mut().own = [0, 0, 0, 4, 0];
    drives.exchange(&OFF);
    assert_eq!(drives.signal(PARTS), Some(65_540.0));
    // Another master goes on counting.
    let mut saved = vec![0; drives.state_bytes()];
    drives.save(&mut saved);
    let (mut other, of_other) = self::drives(&folder);
    other.restore(&saved).expect("a state");
    of_other.borrow_mut().own = [0, 0, 0, 6, 0];
    other.exchange(&OFF);
    assert_eq!(other.signal(PARTS), Some(65_542.0));
    assert!(drives.restore(&saved[..16]).is_err());
    // One that does not answer is lost in that scan; drives go on.
    for al_status in [0, 4, 0x14] {
        segment.borrow_mut().al_status = al_status;
        drives.exchange(&OFF);
        assert_eq!(drives.signal(DOOR), None, "{al_status}");
        assert_eq!(drives.signal(PARTS), None, "{al_status}");
        assert_eq!(drives.signal(SWITCH_OF_X), Some(1.0), "{al_status}");
    }
    // It is looked for again when somebody wants the drives on.
    assert_eq!(segment.borrow().started_again, 0);
    drives.want_back();
    assert_eq!(segment.borrow().started_again, 1);
    segment.borrow_mut().al_status = 8;
    drives.exchange(&OFF);
    assert_eq!(drives.signal(PARTS), Some(4.0));
    drives.want_back();
    assert_eq!(segment.borrow().started_again, 1);
    // A few cycles without an answer are none.
    let (machine, _) = loaded(&folder);
    segment.borrow_mut().answer = WireAnswer::Missed;
    for scan in 1..=machine.missed_cycles_max() {
        drives.exchange(&OFF);
        let known = scan < machine.missed_cycles_max();
        assert_eq!(drives.signal(DOOR).is_some(), known, "{scan}");
    }
    segment.borrow_mut().answer = WireAnswer::Answered;
    drives.exchange(&OFF);
    assert!(drives.signal(DOOR).is_some());
    segment.borrow_mut().answer = WireAnswer::Down;
    drives.exchange(&OFF);
    assert_eq!(
        (drives.signal(DOOR), drives.signal(SWITCH_OF_X)),
        (None, None)
    );
}

#[test]
fn each_place_on_the_cable_is_said_with_its_signals() {
    let (machine, setups) = loaded(&folder(&[], &[], MAPPED));
    let places = setups.expect("good files").places_in_words(&machine);
    let words: Vec<&str> = places.iter().map(|(_, words)| words.as_str()).collect();
    assert!(words[0].ends_with(": switch_of_x from bit 3"), "{words:?}");
    assert!(words[1].ends_with(": horn to bit 17"), "{words:?}");
    assert_eq!(
        words[3],
        "terminal DIO8, 3 inputs and 2 outputs: door from channel 1, pressure from channel 2, parts from channel 3, \
         lamp to channel 11, valve to channel 12"
    );
}

#[test]
fn signals_at_what_no_device_has_are_refused_by_name() {
    let refused = |signals: &[(&str, &str)], drive: &[(&str, &str)]| {
        let (_, setups) = loaded(&folder(signals, &[], drive));
        format!("{:#}", setups.expect_err("refused"))
    };
    for (signals, drive, words) in [
        (
            &[("channel = 1 ", "channel = 9 ")][..],
            MAPPED,
            "signal \"door\": from: terminal 3 (DIO8) has no channel 9: it has 1, 2, 3, 11, 12",
        ),
        (
            &[("channel = 1 ", "channel = 11 ")],
            MAPPED,
            "channel 11 of terminal 3 (DIO8) is an output, and named as input",
        ),
        (
            &[(
                "to = { terminal = 3, channel = 11 }",
                "to = { terminal = 3, channel = 1 }",
            )],
            MAPPED,
            "channel 1 of terminal 3 (DIO8) is an input, and named as output",
        ),
        (
            &[("channel = 1 ", "channel = 2 ")],
            MAPPED,
            "has the kind float, the signal bool",
        ),
        (
            &[],
            &MAPPED[1..],
            "signal \"switch_of_x\": from: bit 3 needs 60FD",
        ),
        (
            &[],
            &MAPPED[..1],
            "signal \"horn\": to: bit 17 needs 60FE:1",
        ),
    ] {
        let said = refused(signals, drive);
        assert!(said.contains(words), "{words}: {said}");
    }
    let of_machine = |signals: &[(&str, &str)]| {
        let folder = folder(signals, &[], MAPPED);
        Machine::load(folder.path())
            .expect_err("refused")
            .to_string()
    };
    let said = of_machine(&[("terminal = 3, channel = 1 ", "terminal = 2, channel = 1 ")]);
    assert!(
        said.contains("there is no [[bus.terminal]] with slave = 2"),
        "{said}"
    );
    let said = of_machine(&[("channel = 12", "channel = 11")]);
    assert!(said.contains("one place, one signal"), "{said}");
}

#[test]
fn a_terminal_file_that_contradicts_itself_is_refused_by_line() {
    for (edits, words) in [
        (
            &[("number = 2\n", "number = 1\n")][..],
            "number = 1: is there twice",
        ),
        (
            &[("first_bit = 2", "first_bit = 3")],
            "does not fit into 6000:1 of 3 bits",
        ),
        (
            &[("first_bit = 7", "first_bit = 7\nbits = 2")],
            "does not fit into 7000:1 of 8 bits",
        ),
        (
            &[("kind = \"counter\"", "kind = \"int\"\nscale = 2.0")],
            "kind = \"int\" has none",
        ),
        (
            &[("index = 0x6020\n", "index = 0x6021\n")],
            "process_data.transmit does not have",
        ),
        (
            &[("index = 0x1A01", "index = 0x1601")],
            "PDOs that a device receives are",
        ),
        (
            &[(
                "[process_data]\n",
                "[process_data]\nmapping = \"written\"\n",
            )],
            "no [mailbox] with pdo_config",
        ),
        (
            &[(
                "[[channel]]",
                "[[sdo]]\nindex = 0x8000\nbits = 8\nvalue = 1\n[[channel]]",
            )],
            "no [mailbox] through which",
        ),
        (
            &[("index = 0x7010\nsub = 1\n", "index = 0x7000\nsub = 1\n")],
            "has bits of channel 11",
        ),
        (&[("scale = 0.00030517578125", "scale = 0")], "scale = 0"),
        (
            &[("kind = \"counter\"", "kind = \"real\"")],
            "kind = \"real\" has 32",
        ),
    ] {
        let text = edited(TERMINAL, edits);
        let error = terminal_file::parse("t.toml", &text, |_, _| ()).expect_err(words);
        assert!(error.to_string().contains(words), "{words}: {error}");
    }
}

//! A spindle behind a CiA 402 drive: what it is told and what becomes of it, in each mode that is told a speed.

use std::cell::RefCell;
use std::fs;
use std::path::Path;
use std::rc::Rc;

use bus::drive_page::{Inputs, Outputs, SlaveWiring, Wiring};
use bus::sample::{Levels, MAX_AXES, SpindleCommand};
use bytemuck::Zeroable;
use fieldbus::drives::{Cia402Drives, Wire, WireAnswer};
use fieldbus::setups;
use machine::Machine;
use master::{DriveCommand, Drives};
use tempfile::TempDir;

const AXES: u16 = 3;
const AXIS_BYTES: (u16, u16) = (20, 26);
/// Bytes of the spindle's process data, out and in: enough for each mode.
const OUT_BYTES: u16 = 8;
const IN_BYTES: u16 = 14;
/// Increments of its encoder in a turn of the motor, and what a target of 60FF at 60 rev/min is.
const COUNTS: f64 = 65_536.0;

/// How its drive is told a speed: word, value of 6060, target, actual value, their bits.
type Told = (&'static str, i8, u16, u16, u32);
const CSV: Told = ("csv", 9, 0x60FF, 0x606C, 32);
const PROFILE: Told = ("profile-velocity", 3, 0x60FF, 0x606C, 32);
const CONVERTER: Told = ("velocity", 2, 0x6042, 0x6044, 16);

fn drive_file((word, _, target, actual, bits): Told) -> String {
    let shipped =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy-ethercat/drives/am-m.toml");
    let text = fs::read_to_string(shipped).expect("a shipped file");
    let (head, rest) = text.split_once("[mode]").expect("its mode");
    let (_, tail) = rest.split_once("[start_up]").expect("its start-up");
    let (units, rpm) = if bits == 16 { (1, 1) } else { (65_536, 60) };
    let pad = if bits == 16 {
        "    { bits = 16 },\n"
    } else {
        ""
    };
    format!(
        "{head}[mode]\noperate = \"{word}\"\n[scaling]\nposition_increments = 65_536\nvelocity_units = {units}\n\
         velocity_rpm = {rpm}\nrated_torque_nm = 5.0\ndirection = 1\ndead_time_scans = 2\n\
         [process_data]\nreceive_mapping = \"fixed\"\ntransmit_mapping = \"fixed\"\n[process_data.limits]\n\
         [[process_data.receive]]\nindex = 0x1600\nentries = [\n    {{ index = 0x6040, bits = 16 }},\n    {{ index = 0x6060, bits = 8 }},\n\
             {{ bits = 8 }},\n    {{ index = {target}, bits = {bits} }},\n{pad}]\n\
         [[process_data.transmit]]\nindex = 0x1A00\nentries = [\n    {{ index = 0x6041, bits = 16 }},\n    {{ index = 0x6061, bits = 8 }},\n\
             {{ bits = 8 }},\n    {{ index = 0x603F, bits = 16 }},\n    {{ index = 0x6064, bits = 32 }},\n    {{ index = {actual}, bits = {bits} }},\n{pad}]\n\
         [start_up]{tail}"
    )
}

fn folder(told: Told, encoder: u32, of_bus: &str) -> TempDir {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy-ethercat");
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("drives")).expect("a folder");
    let read = |name: &str| fs::read_to_string(shipped.join(name)).expect("a shipped file");
    let write = |name: &str, text: &str| {
        fs::write(folder.path().join(name), text).expect("writing");
    };
    write("drives/am-m.toml", &read("drives/am-m.toml"));
    write("drives/spindle.toml", &drive_file(told));
    let bus = format!(
        "standby = true\n[bus.spindle]\nfile = \"drives/spindle.toml\"\nslave = 3\n{of_bus}"
    );
    let spindle = format!(
        "\n[spindle]\nspeed_max_rpm = 6000.0\nramp_rpm_s = 6000.0\nencoder_counts_per_turn = {encoder}\n"
    );
    let text = read("machine.toml").replacen("standby = true\n", &bus, 1) + &spindle;
    write("machine.toml", &text);
    folder
}

/// The drive of the spindle, as the standard has it.
#[derive(Default)]
struct Spindle {
    statusword: u16,
    controlword: u16,
    turns: f64,
    turns_s: f64,
    code: u16,
    /// Most that the speed changed in a cycle, in turns/s.
    most_step: f64,
    gone: bool,
    /// Its power stage is off, whatever it is told.
    sto: bool,
}

impl Spindle {
    fn walk(&mut self, word: u16) {
        let rises = word & 0x80 != 0 && self.controlword & 0x80 == 0;
        self.controlword = word;
        if self.code != 0 {
            self.statusword = 0x0218;
            if rises {
                self.code = 0;
                self.statusword = 0x0250;
            }
            return;
        }
        if self.sto {
            self.statusword = 0x0250;
            return;
        }
        self.statusword = match (word & 0x0F, self.statusword) {
            (0x0F, 0x0233 | 0x1237) => 0x1237,
            (0x07 | 0x0F, 0x0231 | 0x0233 | 0x1237) => 0x0233,
            (0x06, _) => 0x0231,
            _ => 0x0250,
        };
    }

    /// A cycle of 1 ms; `target` in turns/s.
    fn step(&mut self, target: f64, mode: i8) {
        let is_on = self.statusword == 0x1237;
        // A converter follows its target once its ramp runs.
        let runs = is_on && (mode != 2 || self.controlword & 0x70 == 0x70);
        if self.sto {
            self.turns += self.turns_s * 1e-3;
            return;
        }
        let wanted = if runs { target } else { 0.0 };
        let most = if mode == 9 { f64::INFINITY } else { 0.1 };
        let step = (wanted - self.turns_s).clamp(-most, most);
        self.most_step = self.most_step.max(step.abs());
        self.turns_s += step;
        self.turns += self.turns_s * 1e-3;
    }
}

#[derive(Clone)]
struct Segment {
    wiring: Wiring,
    told: Told,
    spindle: Rc<RefCell<Spindle>>,
}

impl Segment {
    fn new(told: Told) -> Segment {
        let mut wiring = Wiring::zeroed();
        wiring.slave_count = u32::from(AXES) + 1;
        let (axis_out, axis_in) = AXIS_BYTES;
        for (place, slave) in (0..=AXES).zip(&mut wiring.slaves) {
            let is_spindle = place == AXES;
            *slave = SlaveWiring {
                serial: 0,
                restarted: 0,
                address: 0x1000 + place,
                inputs_at: place * axis_in,
                input_bytes: if is_spindle { IN_BYTES } else { axis_in },
                outputs_at: 400 + place * axis_out,
                output_bytes: if is_spindle { OUT_BYTES } else { axis_out },
                working_counter: 0,
            };
        }
        Segment {
            wiring,
            told,
            spindle: Rc::default(),
        }
    }
}

impl Wire for Segment {
    fn wiring(&self) -> &Wiring {
        &self.wiring
    }

    fn exchange(&mut self, outputs: &Outputs, inputs: &mut Inputs) -> WireAnswer {
        let mut spindle = self.spindle.borrow_mut();
        let (_, mode, _, _, bits) = self.told;
        for (place, slave) in self.wiring.slaves().iter().enumerate() {
            let is_spindle = place == usize::from(AXES);
            inputs.slaves[place].answered = u32::from(!(is_spindle && spindle.gone)) as _;
            inputs.slaves[place].al_status = 8;
            let out = &outputs.image[usize::from(slave.outputs_at)..];
            let own = &mut inputs.image[usize::from(slave.inputs_at)..];
            let word = u16::from_le_bytes([out[0], out[1]]);
            if !is_spindle {
                let statusword: u16 = match word & 0x0F {
                    0x0F => 0x1237,
                    0x07 => 0x0233,
                    0x06 => 0x0231,
                    _ => 0x0250,
                };
                own[..2].copy_from_slice(&statusword.to_le_bytes());
                own[2] = 9;
                continue;
            }
            spindle.walk(word);
            let target = match bits {
                16 => f64::from(i16::from_le_bytes([out[4], out[5]])) / 60.0,
                _ => f64::from(i32::from_le_bytes([out[4], out[5], out[6], out[7]])) / COUNTS,
            };
            spindle.step(target, mode);
            own[..2].copy_from_slice(&spindle.statusword.to_le_bytes());
            own[2] = mode as u8;
            own[4..6].copy_from_slice(&spindle.code.to_le_bytes());
            let counts = (spindle.turns * COUNTS).floor() as i64 as i32;
            own[6..10].copy_from_slice(&counts.to_le_bytes());
            let actual = match bits {
                16 => (spindle.turns_s * 60.0).round() as i32,
                _ => (spindle.turns_s * COUNTS).round() as i32,
            };
            own[10..14].copy_from_slice(&actual.to_le_bytes());
        }
        WireAnswer::Answered
    }

    fn start_again(&mut self) {}

    fn pause(&self) {}
}

fn drives(folder: &TempDir, segment: Segment) -> Cia402Drives<Segment> {
    let machine = Machine::load(folder.path()).expect("machine.toml");
    let setups = setups::load(&machine, &folder.path().join("machine.toml"));
    let setups = setups.expect("drive files").expect("[bus]");
    Cia402Drives::new(&machine, &setups, segment).expect("drives")
}

struct Bench {
    drives: Cia402Drives<Segment>,
    spindle: Rc<RefCell<Spindle>>,
    _folder: TempDir,
}

impl Bench {
    fn new(told: Told, encoder: u32, of_bus: &str) -> Bench {
        let folder = folder(told, encoder, of_bus);
        let segment = Segment::new(told);
        let spindle = segment.spindle.clone();
        let drives = drives(&folder, segment);
        Bench {
            drives,
            spindle,
            _folder: folder,
        }
    }

    fn scans(&mut self, command: SpindleCommand, rpm: f64, count: u32) {
        self.scans_as(command, rpm, 0.0, DriveCommand::Disabled, count);
    }

    fn scans_as(
        &mut self,
        command: SpindleCommand,
        rpm: f64,
        deg: f64,
        axes: DriveCommand,
        count: u32,
    ) {
        for _ in 0..count {
            self.drives.command_levels(&Levels {
                spindle: command as u32,
                spindle_rpm: rpm,
                orientation_deg: deg,
                ..Levels::default()
            });
            self.drives.exchange(&[axes; MAX_AXES]);
        }
    }

    fn rpm(&self) -> f64 {
        self.drives.auxiliary().spindle_rpm
    }

    fn is_on(&self) -> bool {
        self.spindle.borrow().statusword == 0x1237
    }
}

#[test]
fn it_comes_to_its_speed_both_ways_and_its_drive_is_off_while_it_stands() {
    for told in [CSV, PROFILE, CONVERTER] {
        let (word, ..) = told;
        let mut bench = Bench::new(told, 0, "");
        bench.scans(SpindleCommand::Stop, 0.0, 50);
        assert!(!bench.is_on(), "{word}");
        // 6000 rev/min/s, and some scans until the drive is on.
        bench.scans(SpindleCommand::Turn, 1200.0, 230);
        assert!(
            (bench.rpm() - 1200.0).abs() < 1.5,
            "{word}: {}",
            bench.rpm()
        );
        bench.scans(SpindleCommand::Turn, -600.0, 330);
        assert!((bench.rpm() + 600.0).abs() < 1.5, "{word}: {}", bench.rpm());
        assert_eq!(bench.drives.auxiliary().spindle_turns, 0.0, "{word}");
        bench.scans(SpindleCommand::Stop, 0.0, 40);
        assert!(bench.is_on(), "{word}: it brakes under power");
        bench.scans(SpindleCommand::Stop, 0.0, 120);
        assert!(
            bench.is_on() && bench.rpm() == 0.0,
            "{word}: a tap may follow"
        );
        bench.scans(SpindleCommand::Stop, 0.0, 2_000);
        assert!(!bench.is_on() && bench.rpm() == 0.0, "{word}");
        // The ramp of the machine file: 0.1 turns/s a scan.
        let most = bench.spindle.borrow().most_step;
        assert!(most < 0.1 + 1.0 / 60.0 + 1e-9, "{word}: {most}");
    }
}

#[test]
fn a_gear_turns_the_motor_faster_than_the_spindle() {
    let mut bench = Bench::new(CSV, 4096, "motor_turns = 2.5\n");
    bench.scans(SpindleCommand::Turn, 600.0, 200);
    let motor = bench.spindle.borrow().turns_s;
    assert!((motor - 25.0).abs() < 1e-3, "{motor}");
    assert!((bench.rpm() - 600.0).abs() < 0.1);
    let (turns, of_motor) = (
        bench.drives.auxiliary().spindle_turns,
        bench.spindle.borrow().turns,
    );
    assert!((turns * 2.5 - of_motor).abs() < 1e-3, "{turns} {of_motor}");
}

#[test]
fn it_stands_at_the_angle_of_its_encoder_and_turns_on_from_there() {
    for told in [CSV, PROFILE] {
        let (word, ..) = told;
        let mut bench = Bench::new(told, 65_536, "");
        bench.scans(SpindleCommand::Turn, 900.0, 300);
        for deg in [0.0, 90.0, -45.0, 359.0, 179.9] {
            let (orient, off) = (SpindleCommand::Orient, DriveCommand::Disabled);
            bench.scans_as(orient, 0.0, deg, off, 5);
            assert!(!bench.drives.auxiliary().oriented, "{word}: {deg}");
            bench.scans_as(orient, 0.0, deg, off, 2500);
            assert!(bench.drives.auxiliary().oriented, "{word}: {deg}");
            let turns = bench.spindle.borrow().turns;
            let off_deg = libm::remainder(turns - deg / 360.0, 1.0) * 360.0;
            assert!(off_deg.abs() < 0.5, "{word}: {deg}: {off_deg}");
            assert!(bench.is_on(), "{word}: it holds its angle");
        }
        bench.scans(SpindleCommand::Turn, -300.0, 200);
        assert!((bench.rpm() + 300.0).abs() < 1.5 && !bench.drives.auxiliary().oriented);
    }
}

#[test]
fn without_an_encoder_it_is_never_at_its_angle() {
    let mut bench = Bench::new(CSV, 0, "");
    bench.scans(SpindleCommand::Turn, 900.0, 300);
    bench.scans_as(
        SpindleCommand::Orient,
        0.0,
        0.0,
        DriveCommand::Disabled,
        3000,
    );
    assert!(!bench.drives.auxiliary().oriented);
    assert_eq!(bench.rpm(), 0.0);
}

#[test]
fn a_fault_of_its_drive_is_shown_with_its_code_and_reset_when_drives_are_switched_on() {
    for told in [CSV, CONVERTER] {
        let (word, ..) = told;
        let mut bench = Bench::new(told, 0, "");
        bench.scans(SpindleCommand::Turn, 900.0, 300);
        bench.spindle.borrow_mut().code = 0x2310;
        bench.scans(SpindleCommand::Turn, 900.0, 3);
        assert_eq!(bench.drives.auxiliary().spindle_code, 0x2310, "{word}");
        // Nothing resets it but the order to switch drives on, also where that is over before the reset is.
        bench.scans(SpindleCommand::Stop, 0.0, 300);
        assert_eq!(bench.drives.auxiliary().spindle_code, 0x2310, "{word}");
        let on = DriveCommand::SwitchOn;
        bench.scans_as(SpindleCommand::Stop, 0.0, 0.0, on, 2);
        bench.scans(SpindleCommand::Stop, 0.0, 100);
        assert_eq!(bench.drives.auxiliary().spindle_code, 0, "{word}");
        assert!(!bench.is_on(), "{word}: it stays off until it is to turn");
        bench.scans(SpindleCommand::Turn, 900.0, 300);
        assert!((bench.rpm() - 900.0).abs() < 1.5, "{word}: {}", bench.rpm());
    }
}

#[test]
fn a_drive_that_answers_no_more_is_a_fault_and_one_that_comes_back_starts_from_rest() {
    let mut bench = Bench::new(CSV, 0, "");
    bench.scans(SpindleCommand::Turn, 900.0, 300);
    bench.spindle.borrow_mut().gone = true;
    bench.scans(SpindleCommand::Turn, 900.0, 3);
    assert_ne!(bench.drives.auxiliary().spindle_code, 0);
    // Nobody knows, so it does not stand.
    assert!(bench.rpm() > 800.0, "{}", bench.rpm());
    *bench.spindle.borrow_mut() = Spindle::default();
    bench.scans(SpindleCommand::Turn, 900.0, 20);
    assert!(bench.rpm() < 130.0, "{}", bench.rpm());
    bench.scans(SpindleCommand::Turn, 900.0, 300);
    assert!((bench.rpm() - 900.0).abs() < 1.5);
    assert!(bench.spindle.borrow().most_step < 0.11);
}

#[test]
fn a_drive_that_goes_off_by_itself_is_a_fault_and_starts_by_an_order_alone() {
    let mut bench = Bench::new(CSV, 0, "");
    bench.scans(SpindleCommand::Turn, 900.0, 300);
    bench.spindle.borrow_mut().sto = true;
    bench.scans(SpindleCommand::Turn, 900.0, 3);
    assert_ne!(bench.drives.auxiliary().spindle_code, 0);
    bench.spindle.borrow_mut().sto = false;
    bench.scans(SpindleCommand::Turn, 900.0, 100);
    assert!(!bench.is_on(), "nobody has ordered it");
    assert_ne!(bench.drives.auxiliary().spindle_code, 0);
    bench.scans(SpindleCommand::Stop, 0.0, 1);
    assert_eq!(bench.drives.auxiliary().spindle_code, 0);
    bench.scans(SpindleCommand::Turn, 900.0, 400);
    assert!((bench.rpm() - 900.0).abs() < 1.5, "{}", bench.rpm());
}

#[test]
fn a_new_master_finds_its_angle_as_the_one_before_left_it() {
    let mut bench = Bench::new(CSV, 65_536, "");
    bench.scans(SpindleCommand::Turn, 3000.0, 1000);
    let mut state = vec![0; bench.drives.state_bytes()];
    bench.drives.save(&mut state);
    let before = bench.drives.auxiliary().spindle_turns;
    let folder = folder(CSV, 65_536, "");
    let segment = Segment {
        spindle: bench.spindle.clone(),
        ..Segment::new(CSV)
    };
    let mut next = drives(&folder, segment);
    next.restore(&state).expect("a saved state");
    let after = next.auxiliary().spindle_turns;
    let truly = bench.spindle.borrow().turns;
    assert!(
        after >= before && (after - truly).abs() < 0.1,
        "{before} {after} {truly}"
    );
    assert_eq!(
        next.auxiliary().spindle_rpm,
        0.0,
        "it has stopped by itself"
    );
}

#[test]
fn what_a_spindle_cannot_be_driven_by_is_refused_with_what_to_write() {
    let refusal = |folder: &TempDir| match Machine::load(folder.path()) {
        Err(error) => error.to_string(),
        Ok(machine) => {
            let setups = setups::load(&machine, &folder.path().join("machine.toml"));
            format!("{:#}", setups.expect_err("refused"))
        }
    };
    let edited = |from: &str, to: &str, name: &str| {
        let folder = folder(CONVERTER, 0, "");
        let path = folder.path().join(name);
        let text = fs::read_to_string(&path).expect("a file");
        assert!(text.contains(from), "{text}");
        fs::write(path, text.replacen(from, to, 1)).expect("writing");
        refusal(&folder)
    };
    let machine = "machine.toml";
    for (from, to, name, says) in [
        ("slave = 3", "slave = 1", machine, "is the place of axis Y"),
        (
            "\n[spindle]\nspeed_max_rpm = 6000.0\nramp_rpm_s = 6000.0\nencoder_counts_per_turn = 0\n",
            "",
            machine,
            "goes with [spindle] alone",
        ),
        (
            "drives/spindle.toml",
            "../spindle.toml",
            machine,
            "must be a path below the folder",
        ),
        (
            "speed_max_rpm = 6000.0",
            "speed_max_rpm = 40000.0",
            machine,
            "is 40000 units of its drive, whose target velocity (6042) holds 32767 at most",
        ),
        (
            "file = \"drives/am-m.toml\"",
            "file = \"drives/spindle.toml\"",
            machine,
            "which is for spindles ([bus.spindle]): an axis is driven in csv, cst or csp",
        ),
        (
            "operate = \"velocity\"",
            "operate = \"csp\"",
            "drives/spindle.toml",
            "mode csp needs it",
        ),
    ] {
        let said = edited(from, to, name);
        assert!(said.contains(says), "{from} -> {to}: {said}");
    }
    let blind = folder(CONVERTER, 4096, "");
    let path = blind.path().join("drives/spindle.toml");
    let text = fs::read_to_string(&path).expect("a file");
    let text = text.replace("{ index = 0x6064, bits = 32 }", "{ bits = 32 }");
    fs::write(path, text).expect("writing");
    let said = refusal(&blind);
    assert!(said.contains("needs 6064 (actual position)"), "{said}");
}

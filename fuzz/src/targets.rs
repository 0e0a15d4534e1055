//! What is done with each input: everything that the product does with such a file before anything moves by it.

use std::io::Write;
use std::sync::LazyLock;

use bus::sample::PATH_AXES;
use machine::Machine;
use master::{DriveCommand, Drives};
use path::window::{PlannedSetpoint, WindowRequest};
use plant_sim::plant_file::PlantFile;
use plant_sim::script::{faults as fault_script, orders as order_script};

pub use super::samples::samples;

/// One target: its name, and what it does with an input.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: [Target; 7] = [
    ("program", program),
    ("machine", machine),
    ("plant", plant),
    ("faults", faults),
    ("orders", orders),
    ("log", log),
    ("samples", samples),
];

/// Longest text that is tried: what is wrong with a long one is wrong with a short one.
const TEXT_BYTES_MAX: usize = 8192;
/// Windows that are planned along a program.
const WINDOWS_MAX: usize = 20;
/// Elements of a path that is planned along.
const ELEMENTS_MAX: usize = 500;

/// A machine that comes with the product.
pub fn shipped(name: &str) -> Machine {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let beside = [folder.join("machines"), folder.join("../machines")];
    let found = beside.iter().find(|machines| machines.exists());
    Machine::load(&found.expect("machines/").join(name)).expect("a shipped machine")
}

static MACHINES: LazyLock<[Machine; 3]> =
    LazyLock::new(|| ["xy", "xyz-mill", "xzb-pivot"].map(shipped));

fn text(data: &[u8]) -> String {
    let data = data.get(..TEXT_BYTES_MAX).unwrap_or(data);
    String::from_utf8_lossy(data).into_owned()
}

/// The first byte picks the machine.
fn split(data: &[u8]) -> (&'static Machine, String) {
    let (which, rest) = data.split_first().unwrap_or((&0, &[]));
    (&MACHINES[usize::from(*which) % MACHINES.len()], text(rest))
}

/// A part program in LinuxCNC's or Fanuc's language: read, interpreted, and planned along for a while.
pub fn program(data: &[u8]) {
    let (machine, mut text) = split(data);
    // The first byte picks the language too.
    if data.first().is_some_and(|byte| *byte >= 0x80) {
        text.insert_str(0, "\u{1d}fanuc\u{1d}");
    }
    let Ok(program) = program::resume_from(machine, &[0; PATH_AXES], "fuzz", &text) else {
        return;
    };
    assert!(program.path.is_finite());
    assert_eq!(program.path.first_break(), None);
    if program.path.elements.len() > ELEMENTS_MAX {
        return;
    }
    let Ok(mut windows) = planner::window_planner(machine, program.path, program.start) else {
        return;
    };
    let mut setpoints: Vec<PlannedSetpoint> = Vec::new();
    let mut state = path::profile::PathState::default();
    for index in 0..WINDOWS_MAX {
        let request = WindowRequest {
            intended_setpoints: machine.intended_setpoints(),
            repeats_start: index == 0,
            ..WindowRequest::default()
        };
        let outcome = windows.plan(&state, &request, &mut setpoints);
        let Ok(outcome) = outcome else {
            return;
        };
        let last = outcome.intended_setpoints.saturating_sub(1) as usize;
        let Some(reached) = setpoints.get(last) else {
            return;
        };
        state = reached.state;
        if outcome.ends_program {
            return;
        }
    }
}

/// A machine file: checked, and made into what planner and servos need of it.
pub fn machine(data: &[u8]) {
    let Ok(machine) = Machine::parse("fuzz", &text(data)) else {
        return;
    };
    let _ = machine.shape();
    let _ = planner::motion_limits(&machine);
    for axis in 0..machine.axes.len() {
        let _ = servo::ServoSettings::new(&machine, axis);
    }
}

/// A plant file: checked, and made into drives that are driven for some scans.
pub fn plant(data: &[u8]) {
    let Ok(plant) = PlantFile::parse("fuzz", &text(data)) else {
        return;
    };
    let machine = &MACHINES[0];
    let Ok(mut drives) = plant.drives(machine) else {
        return;
    };
    let command = DriveCommand::Velocity {
        velocity_mm_s: 10.0,
        torque_offset_nm: 0.1,
    };
    for _ in 0..3 {
        drives.exchange(&[command; 2]);
    }
    let mut saved = vec![0; drives.state_bytes()];
    drives.save(&mut saved);
    let _ = drives.restore(&saved);
}

/// A fault script.
pub fn faults(data: &[u8]) {
    let (machine, text) = split(data);
    let _ = fault_script::parse("fuzz", &text, machine);
}

/// A file of orders.
pub fn orders(data: &[u8]) {
    let (machine, text) = split(data);
    let _ = order_script::parse("fuzz", &text, machine);
}

/// A log: opened and read to its end.
pub fn log(data: &[u8]) {
    use rustix::fs::{MemfdFlags, memfd_create};
    use std::os::fd::AsRawFd;
    let Ok(file) = memfd_create("fuzz", MemfdFlags::CLOEXEC) else {
        return;
    };
    let mut file = std::fs::File::from(file);
    if file.write_all(data).is_err() {
        return;
    }
    let path = format!("/proc/self/fd/{}", file.as_raw_fd());
    let path = std::path::Path::new(&path);
    let _ = monitor::log::read_only(path);
    let Ok(mut reader) = monitor::log::Reader::open(path) else {
        return;
    };
    while let Ok(Some(_)) = reader.next_sample() {}
    let _ = (reader.digest(), reader.end(), reader.cut());
}

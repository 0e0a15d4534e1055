//! What the tests share.

pub use lab::staying;
pub use lab::stock::{self, AT_SPEED_SHARE, new_machine};

use std::path::Path;

use bus::sample::{Feedback, Mode, OperatorRequest, Order};
use machine::Machine;
use plant_sim::plant_file::PlantFile;

/// The mill with a spindle and a tool changer.
pub fn mill_with_spindle() -> (Machine, PlantFile) {
    let (mut machine, mut plant) = load("xyz-mill");
    stock::equip(&mut machine, &mut plant);
    (machine, plant)
}

/// A machine that comes with the product, and its plant; programs begin at its zero.
pub fn load(name: &str) -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../machines")
        .join(name);
    let mut machine = Machine::load(&folder).expect("machine.toml");
    machine.program.work_offset_mm.clear();
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

/// Scans in a row, up to this one, in which the machine has waited for its operator, if it was so many before.
pub fn waited(scans: u64, feedback: &Feedback) -> u64 {
    let on = feedback.mode == Mode::Enabled as u32;
    let waits = !on && feedback.mode != Mode::Finished as u32 || feedback.hold == 1;
    if waits { scans + 1 } else { 0 }
}

/// What an operator orders to go on.
pub fn going_on(feedback: &Feedback) -> OperatorRequest {
    let on = feedback.mode == Mode::Enabled as u32;
    order(if on { Order::Resume } else { Order::Enable }, 0.0)
}

/// A fault: a process is killed in a scan, and started again so many later.
pub fn kill(who: &str, scan: u64, after: u64) -> String {
    format!(
        "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{who}\"\ndo = \"kill\"\nrestart_after_scans = {after}\n"
    )
}

/// An order without an axis.
pub fn order(order: Order, value: f64) -> OperatorRequest {
    OperatorRequest {
        order: order as u32,
        value,
        ..OperatorRequest::default()
    }
}

/// An order to one axis.
pub fn axis_order(order: Order, axis: usize, value: f64) -> OperatorRequest {
    OperatorRequest {
        axis: axis as u32,
        ..self::order(order, value)
    }
}

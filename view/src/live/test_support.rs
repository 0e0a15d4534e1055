//! A machine and samples for the tests beside.

use bus::sample::{Feedback, Mode, ProgramState, WindowId};
use bytemuck::Zeroable;
use machine::Machine;

use super::model::Model;
use super::state::Shown;

/// `machines/xy`.
pub fn machine() -> Machine {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    Machine::load(&root.join("machines/xy/machine.toml")).expect("the machine file")
}

/// A feedback of two axes in motion on the path.
pub fn running(scan: u64) -> Feedback {
    Feedback {
        scan,
        visible_from: scan,
        window: WindowId {
            checksum: 1,
            sequence: 1,
            incarnation: 1,
        },
        mode: Mode::Enabled as u32,
        program: ProgramState::Running as u32,
        cause_axis: u32::MAX,
        override_percent: 100,
        axis_count: 2,
        ..Feedback::zeroed()
    }
}

/// The end of a look: what was seen is shown.
pub fn look(model: &mut Model) {
    model.shown = Shown::of(model);
}

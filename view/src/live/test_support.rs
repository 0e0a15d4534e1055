//! A machine and samples for the tests beside.

use std::path::{Path, PathBuf};

use bus::sample::{
    AxisCommand, Feedback, Instruments, Mode, PlannerStatus, ProgramState, Roster, WindowId,
};
use bytemuck::Zeroable;
use machine::Machine;
use program::{Modes, SHORT_ELEMENTS, load_if_short};

use super::dro::ProgramTimes;
use super::model::Model;
use super::state::Shown;
use crate::spoilt::Spoiler;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// `machines/xy`.
pub fn machine() -> Machine {
    Machine::load(&root().join("machines/xy/machine.toml")).expect("the machine file")
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

/// The model knows the program that is run.
pub fn with_program(model: &mut Model) {
    let file = root().join("machines/xy/programs/circle-r25-f3000.ngc");
    let start = running(0).program_start;
    let program = load_if_short(&model.machine, &start, &file, SHORT_ELEMENTS, &[]);
    let program = program.expect("a program").expect("a short one");
    let modes = Modes::of(&model.machine, &start, &file).expect("its states");
    model.course = Some(ProgramTimes::new(&model.machine, &program.path, modes));
    model.program = Some(program);
}

/// Takes the sample of this number, of each kind in turn, with wrong numbers.
pub fn take_spoilt(model: &mut Model, number: u64, spoiler: &mut Spoiler) {
    match number % 5 {
        0 => {
            let hash = model.program.as_ref().map(|program| program.source_hash);
            let sound = Feedback {
                program_hash: hash.unwrap_or_default(),
                ..running(200_000 + number)
            };
            model.feedback(&spoiler.feedback(&sound));
        }
        1 => model.command(&spoiler.spoilt(&AxisCommand::zeroed())),
        2 => model.instruments(&spoiler.spoilt(&Instruments::zeroed())),
        3 => model.roster(&spoiler.spoilt(&Roster::zeroed())),
        _ => model.planner = Some(spoiler.spoilt(&PlannerStatus::zeroed())),
    }
}

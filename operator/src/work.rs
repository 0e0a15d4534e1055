//! What is read of a cell's program, and the state whose work coordinates hold: for the readout, and for a jog to one of its places.

use std::path::Path;

use bus::cell::CellPaths;
use bus::sample::{Auxiliaries, Feedback, ProgramState};
use machine::{KeptTexts, Machine};
use program::{Modal, Modes, Program, SHORT_ELEMENTS, modal_at_start};

use super::Client;
use console::exit::Failure;
use launcher::children::children_of;

/// The machine with what the run of this feedback began with.
pub fn machine_of_run(machine: &Machine, place: &CellPaths, feedback: &Feedback) -> Machine {
    if feedback.load == 0 {
        // The one program of a run: the machine file has what it began with.
        return machine.clone();
    }
    let run = (feedback.load, feedback.run);
    let shown = &feedback.auxiliary;
    let kept = match place.parameters(run.0, run.1).exists() {
        true => KeptTexts::of_run(place, run, machine, shown),
        false => KeptTexts::now(place, machine, shown),
    };
    let mut known = machine.clone();
    // What cannot be read leaves the program unknown, for its hash is another.
    if let Ok(kept) = kept {
        let _ = known.take_kept(kept);
    }
    known
}

/// The program that the tags of this feedback belong to, if `file` is it; none of one that cannot be read, is very long or is
/// another program by now.
pub fn program_behind(file: &Path, machine: &Machine, feedback: &Feedback) -> Option<Program> {
    let start = &feedback.program_start;
    let read = program::load_if_short(machine, start, file, SHORT_ELEMENTS, &[]).ok();
    read.flatten()
        .filter(|program| program.source_hash == feedback.program_hash)
}

/// Its states; none where it is another by now.
pub fn modes_behind(file: &Path, machine: &Machine, feedback: &Feedback) -> Option<Modes> {
    let modes = Modes::of(machine, &feedback.program_start, file).ok()?;
    (modes.source_hash() == feedback.program_hash).then_some(modes)
}

/// The state that the next program or typed-in block begins with; none where what is kept of it cannot be read.
pub fn next_start(machine: &Machine, place: &CellPaths, shown: &Auxiliaries) -> Option<Modal> {
    let mut machine = machine.clone();
    let kept = KeptTexts::now(place, &machine, shown).ok()?;
    machine.take_kept(kept).ok()?;
    Some(modal_at_start(&machine))
}

impl Client {
    /// The state in whose coordinates the readout has the axes.
    pub(super) fn state_of_readout(&self, now: &Feedback) -> Result<Modal, Failure> {
        let place = &self.cell.place;
        let state = match ProgramState::from_wire(now.program) {
            Some(ProgramState::Running) => self.state_of_run(now),
            _ => next_start(&self.machine, place, &now.auxiliary),
        };
        let is_known = |state: &Modal| program::work_place(&self.machine, now, state).is_some();
        state.filter(is_known).ok_or_else(|| {
            self.fails(
                "jog refused: work coordinates are not known here, as the readout shows: `--to-machine` names places of the machine",
            )
        })
    }

    fn state_of_run(&self, now: &Feedback) -> Option<Modal> {
        let started_with = || {
            let mut children = children_of(self.cell.page.launcher_pid()).into_iter();
            children.find_map(|child| child.program)
        };
        let file = self.cell.place.program(now.load).or_else(started_with)?;
        let machine = machine_of_run(&self.machine, &self.cell.place, now);
        program_behind(&file, &machine, now)?;
        modes_behind(&file, &machine, now)?.in_force(now).cloned()
    }
}

//! What a planner sees of its cell, and the same over the bus.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::rc::Rc;
use std::time::Duration;

use bus::cell::{CellError, CellPaths};
use bus::files::open_unlinked;
use bus::member::{Boundaries, Member, Pace};
use bus::messages::{MessageWriter, ProgramMessage};
use bus::port::{Reader, WindowWriter, Writer};
use bus::sample::{Auxiliaries, Feedback, PlannerStatus, Setpoint, WindowHeader};
use bus::service::SCAN_DEPTH;
use bus::user_codes::{self, CallEnd, UserCall};
use machine::settings_file::SettingsFileError;
use machine::{KeptTexts, Machine};

use crate::kept_parameters::{Keeper, Left};
use crate::kept_places::KeptPlaces;
use crate::place::Place;
use crate::program_text::ProgramText;
use crate::questions::{KEPT_BYTES, KeptAnswer, kept_in};

/// From one look at a user M-code to the next, in lockstep.
const USER_CODE_LOOK: Duration = Duration::from_millis(1);

/// How far a user M-code is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum UserCode {
    /// It runs, or is about to.
    Runs,
    /// It has run to a good end.
    Good,
    /// It has not, for this reason: the program must not go on.
    Failed(String),
}

/// What a planner sees of its cell. Shared memory, queues and faulty decorators implement it.
pub trait PlannerPorts {
    /// Waits for the newest feedback that asks the planner; none when it is time to leave.
    fn next_feedback(&mut self) -> Option<Feedback>;

    /// The program that was loaded into the cell under this number; none if there is none.
    fn program(&mut self, load: u32) -> Option<ProgramText>;

    /// The last place of a program from which a planner can map this element, of those that were kept; none without one.
    fn place_before(&mut self, program_hash: u64, element: u32) -> Option<Place> {
        let _ = (program_hash, element);
        None
    }

    /// Keeps a place for planners after this one. The tool is at the element `tool`.
    fn keep_place(&mut self, place: &Place, tool: u32) {
        let _ = (place, tool);
    }

    /// What the machine has answered in this run of this program, as planners before this one have kept it.
    fn answers(&mut self, load: u32, run: u32) -> Vec<KeptAnswer> {
        let _ = (load, run);
        Vec::new()
    }

    /// Keeps an answer for planners after this one; false if it could not.
    fn keep_answer(&mut self, load: u32, run: u32, answer: &KeptAnswer) -> bool {
        let _ = (load, run, answer);
        false
    }

    /// What programs and operators have kept, and what the master shows: what a run (load and run) begins with, or what the next one would;
    /// none where the machine file holds it.
    ///
    /// # Errors
    /// They cannot be read.
    fn parameters(
        &mut self,
        run: Option<(u32, u32)>,
        machine: &Machine,
        shown: &Auxiliaries,
    ) -> Result<Option<KeptTexts>, SettingsFileError> {
        let _ = (run, machine, shown);
        Ok(None)
    }

    /// Keeps the modes that a run leaves to the next one.
    ///
    /// # Errors
    /// They cannot be kept.
    fn keep_modes(&mut self, run: u32, modes: &str) -> Result<(), String> {
        let _ = (run, modes);
        Ok(())
    }

    /// Keeps the tool in the spindle over the end of the cell, on a machine as this planner began with it.
    fn keep_tool(&mut self, machine: &Machine, tool: u32) {
        let _ = (machine, tool);
    }

    /// Keeps what a program leaves that has come to its end on this machine.
    ///
    /// # Errors
    /// It cannot be kept.
    fn keep(&mut self, machine: &Machine, left: &Left) -> Result<(), String> {
        let _ = (machine, left);
        Ok(())
    }

    /// Has a user M-code run, once, whoever asks how often.
    fn user_code(&mut self, call: &UserCall) -> UserCode {
        let _ = call;
        UserCode::Good
    }

    /// Writes what the program says where readers find it.
    fn write_messages(&mut self, load: u32, run: u32, messages: &[ProgramMessage]) {
        let _ = (load, run, messages);
    }

    /// Publishes a window, before the status of the same scan.
    fn publish_window(&mut self, header: &WindowHeader, setpoints: &[Setpoint]);

    /// Publishes what the planner has to report of a scan; every scan that asks gets one.
    fn publish_status(&mut self, status: &PlannerStatus);

    /// Reports that the planner is done with the scan.
    fn answered(&mut self, scan: u64);
}

/// The ports of a planner process: shared memory, and the cell's folder of programs.
#[derive(Debug)]
pub struct BusPorts {
    member: Rc<Member>,
    feedback: Reader<Feedback>,
    windows: WindowWriter,
    status: Writer<PlannerStatus>,
    boundaries: Boundaries,
    last: Option<u64>,
    paths: CellPaths,
    places: KeptPlaces,
    keeper: Keeper,
    messages: MessageWriter,
}

impl BusPorts {
    /// Opens the ports of the planner, which is asked once in so many scans; `stays` where programs come and go.
    ///
    /// # Errors
    /// [`CellError::Transport`], also if the cell has a planner already.
    pub fn open(member: Rc<Member>, period_scans: u32, stays: bool) -> Result<BusPorts, CellError> {
        let bus = &member.bus;
        let paths = CellPaths::new(&member.slot.cell)?;
        Ok(BusPorts {
            feedback: bus.feedback_reader(SCAN_DEPTH)?,
            windows: bus.window_writer()?,
            status: bus.planner_writer()?,
            boundaries: Boundaries::every(
                u64::from(period_scans),
                member.slot.pace == Pace::Lockstep,
            ),
            last: member.slot.after_scan,
            places: KeptPlaces::of_cell(&paths),
            keeper: Keeper::of_cell(paths.clone(), stays),
            messages: MessageWriter::new(paths.messages()),
            paths,
            member,
        })
    }
}

/// Writes an answer at its place, over one that was not written whole.
fn write_answer(file: &Path, answer: &KeptAnswer) -> io::Result<()> {
    let mut options = File::options();
    options.create(true).write(true).truncate(false);
    let open = open_unlinked(file, &mut options)?;
    let at = u64::from(answer.index) * KEPT_BYTES as u64;
    open.write_all_at(bytemuck::bytes_of(answer), at)
}

impl PlannerPorts for BusPorts {
    fn next_feedback(&mut self) -> Option<Feedback> {
        loop {
            let signal = self.member.page.planner_signal();
            let feedback = self
                .member
                .next_feedback(signal, &mut self.feedback, self.last)?;
            self.last = Some(feedback.scan);
            if feedback.last == 1 || self.boundaries.asks(feedback.scan) {
                return Some(*feedback);
            }
        }
    }

    fn program(&mut self, load: u32) -> Option<ProgramText> {
        self.paths.program(load).map(ProgramText::File)
    }

    fn place_before(&mut self, program_hash: u64, element: u32) -> Option<Place> {
        self.places.before(program_hash, element)
    }

    fn keep_place(&mut self, place: &Place, tool: u32) {
        self.places.keep(place, tool);
    }

    fn answers(&mut self, load: u32, run: u32) -> Vec<KeptAnswer> {
        self.paths.forget_runs_before(run);
        let bytes = fs::read(self.paths.answers(load, run));
        kept_in(&bytes.unwrap_or_default())
    }

    fn keep_answer(&mut self, load: u32, run: u32, answer: &KeptAnswer) -> bool {
        let file = self.paths.answers(load, run);
        write_answer(&file, answer)
            .inspect_err(|error| tracing::error!("{}: {error}", file.display()))
            .is_ok()
    }

    fn parameters(
        &mut self,
        run: Option<(u32, u32)>,
        machine: &Machine,
        shown: &Auxiliaries,
    ) -> Result<Option<KeptTexts>, SettingsFileError> {
        self.keeper.read(run, machine, shown)
    }

    fn keep_modes(&mut self, run: u32, modes: &str) -> Result<(), String> {
        let kept = self.keeper.keep_modes(run, modes);
        kept.map_err(|error| format!("{error}: the modes are not kept"))
    }

    fn keep_tool(&mut self, machine: &Machine, tool: u32) {
        if let Err(error) = self.keeper.keep_tool(machine, tool) {
            tracing::warn!(
                "{error}: a cell after this one does not know that tool {tool} is in the spindle"
            );
        }
    }

    fn keep(&mut self, machine: &Machine, left: &Left) -> Result<(), String> {
        let kept = self.keeper.keep(machine, left);
        kept.map_err(|error| format!("{error}: the parameters are not kept"))
    }

    fn user_code(&mut self, call: &UserCall) -> UserCode {
        if let Err(error) = user_codes::call(&self.paths, call) {
            return UserCode::Failed(format!("M{} cannot be asked for: {error}", call.code));
        }
        loop {
            match user_codes::ended(&self.paths, call.id) {
                Ok(Some(CallEnd { failed: None, .. })) => return UserCode::Good,
                Ok(Some(CallEnd {
                    failed: Some(why), ..
                })) => {
                    return UserCode::Failed(format!("line {}: {why}", call.line));
                }
                Ok(None) if self.member.slot.pace != Pace::Lockstep => return UserCode::Runs,
                // In lockstep it takes no time of the machine, so that the run is the same every time.
                Ok(None) if self.member.launcher_lives() && !self.member.ending() => {
                    std::thread::sleep(USER_CODE_LOOK);
                }
                Ok(None) => return UserCode::Runs,
                Err(error) => {
                    return UserCode::Failed(format!("M{}: {error}", call.code));
                }
            }
        }
    }

    fn write_messages(&mut self, load: u32, run: u32, messages: &[ProgramMessage]) {
        if let Err(error) = self.messages.write(load, run, messages) {
            tracing::warn!("messages of the program are lost: {error}");
        }
    }

    fn publish_window(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        if !self.windows.send(header, setpoints) {
            tracing::warn!(sequence = header.id.sequence, "a window could not be sent");
        }
    }

    fn publish_status(&mut self, status: &PlannerStatus) {
        self.status.send(status);
    }

    fn answered(&mut self, scan: u64) {
        self.member.answered(scan);
    }
}

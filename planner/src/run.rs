//! The planner as a process. At each period boundary: wake, read feedback, plan, publish a window or nothing new.

use std::path::PathBuf;
use std::rc::Rc;

use bus::member::{Member, MemberError, Slot};
use bus::realtime::Priority;
use bus::sample::{Cause, ProgramEvent};
use machine::Machine;
use machine::settings_file::SettingsFileError;

use crate::planner::Planner;
use crate::ports::{BusPorts, PlannerPorts, UserCode};
use crate::program_text::ProgramText;

/// How a planner is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its slot in the cell.
    pub slot: Slot,
    /// Part program; without one it reads those that are loaded into the cell, one after the other.
    pub program: Option<PathBuf>,
}

/// Why a planner cannot take part.
#[derive(Debug, thiserror::Error)]
pub enum PlannerError {
    /// The cell refuses it.
    #[error(transparent)]
    Member(#[from] MemberError),
    /// The machine file, or a script, cannot be read.
    #[error(transparent)]
    File(#[from] SettingsFileError),
}

/// Plans until the run or the cell ends.
///
/// # Errors
/// [`PlannerError`].
pub fn run(options: &Options) -> Result<(), PlannerError> {
    run_over(options, |ports, _, _| Ok(ports))
}

/// The same over ports that `decorate` makes of the process's own.
///
/// # Errors
/// [`PlannerError`].
pub fn run_over<P: PlannerPorts>(
    options: &Options,
    decorate: impl FnOnce(BusPorts, &Rc<Member>, &Machine) -> Result<P, PlannerError>,
) -> Result<(), PlannerError> {
    let machine = Machine::load(&options.slot.machine)?;
    let member = Member::enter(options.slot.clone(), "planner", &machine.shape())?;
    let member = Rc::new(member);
    let period_scans = machine.scan.interpolation_period_scans;
    let ports = BusPorts::open(Rc::clone(&member), period_scans, options.program.is_none())
        .map_err(MemberError::Cell)?;
    let mut planner = match &options.program {
        Some(path) => {
            let program = ProgramText::File(path.clone());
            Planner::of(&machine, program, options.slot.incarnation)
        }
        None => Planner::idle(&machine, options.slot.incarnation),
    };
    let mut ports = decorate(ports, &member, &machine)?;
    member.ready(Priority::Planner);
    while cycle(&mut planner, &mut ports) {}
    Ok(())
}

/// One period of a planner; false when it is time to leave.
pub fn cycle(planner: &mut Planner, ports: &mut impl PlannerPorts) -> bool {
    let Some(feedback) = ports.next_feedback().filter(|feedback| feedback.last == 0) else {
        return false;
    };
    if feedback.load != planner.loaded() {
        let kept =
            planner.take_kept(ports.parameters(None, planner.machine(), &feedback.auxiliary));
        let program = ports.program(feedback.load).filter(|_| kept);
        planner.load(program, &feedback);
    }
    ports.keep_tool(planner.machine(), feedback.auxiliary.tool);
    if planner.is_other_run(&feedback) {
        let run = Some((feedback.load, feedback.run));
        planner.take_kept(ports.parameters(run, planner.machine(), &feedback.auxiliary));
        planner.begin_run(ports.answers(feedback.load, feedback.run), &feedback);
    }
    if let Some(answer) = planner.new_answer(&feedback)
        && ports.keep_answer(feedback.load, feedback.run, &answer)
    {
        planner.take_answer(answer);
    }
    if let Some(element) = planner.wants_place(&feedback)
        && let Some(place) = ports.place_before(feedback.program_hash, element)
    {
        planner.take_place(place);
    }
    let decision = planner.scan(&feedback);
    if !decision.messages.is_empty() {
        ports.write_messages(feedback.load, feedback.run, decision.messages);
    }
    let modes = decision.modes.as_ref();
    let are_kept = modes.is_none_or(|modes| ports.keep_modes(feedback.run, modes));
    if let Some((header, setpoints)) = decision.window.as_ref().filter(|_| are_kept) {
        ports.publish_window(header, setpoints);
    }
    let mut status = decision.status;
    let kept = decision.left.as_ref();
    let kept = kept.map(|left| ports.keep(decision.machine, left));
    let user_code = decision
        .user_call
        .as_ref()
        .map(|call| ports.user_code(call));
    // What has to come before an event is not done: it is not asked for.
    if kept == Some(false) || user_code.is_some_and(|code| code != UserCode::Good) {
        status.event = ProgramEvent::default();
    }
    if kept == Some(false) || !are_kept || user_code == Some(UserCode::Failed) {
        status.cause = Cause::Planner as u32;
    }
    ports.publish_status(&status);
    ports.answered(feedback.scan);
    let needed_from = planner.needed_from(&feedback);
    for place in planner.new_places() {
        ports.keep_place(&place, needed_from);
    }
    true
}

//! The planner as a process. At each period boundary: wake, read feedback, plan, publish a window or nothing new.

use std::path::PathBuf;
use std::rc::Rc;

use bus::member::{Member, MemberError, Slot};
use bus::realtime::Priority;
use bus::sample::{Cause, Feedback, ProgramEvent};
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
    take_up(planner, ports, &feedback);
    let decision = planner.scan(&feedback);
    if !decision.messages.is_empty() {
        ports.write_messages(feedback.load, feedback.run, decision.messages);
    }
    let modes = decision.modes.as_ref();
    let mut failed = modes.and_then(|modes| ports.keep_modes(feedback.run, modes).err());
    if let Some((header, setpoints)) = decision.window.as_ref().filter(|_| failed.is_none()) {
        ports.publish_window(header, setpoints);
    }
    let mut status = decision.status;
    if let Some(left) = &decision.left
        && let Err(why) = ports.keep(decision.machine, left)
    {
        // What has to come before an event is not done: it is not asked for.
        status.event = ProgramEvent::default();
        failed = Some(why);
    }
    if let Some(call) = &decision.user_call {
        match ports.user_code(call) {
            UserCode::Good => {}
            UserCode::Runs => status.event = ProgramEvent::default(),
            UserCode::Failed(why) => {
                status.event = ProgramEvent::default();
                failed = Some(why);
            }
        }
    }
    if let Some(why) = failed {
        planner.give_up(why);
        status.cause = Cause::Planner as u32;
    }
    if let Some(trouble) = planner.new_trouble() {
        ports.write_messages(feedback.load, feedback.run, &[trouble]);
    }
    ports.publish_status(&status);
    ports.answered(feedback.scan);
    let needed_from = planner.needed_from(&feedback);
    for place in planner.new_places() {
        ports.keep_place(&place, needed_from);
    }
    true
}

/// Takes what has changed since the feedback before: program, run, answer, and a place to read on from.
fn take_up(planner: &mut Planner, ports: &mut impl PlannerPorts, feedback: &Feedback) {
    if feedback.load != planner.load {
        let load = feedback.load;
        let kept = ports.parameters(None, &planner.machine, &feedback.auxiliary);
        let program = planner.take_kept(kept).and_then(|()| {
            let none = || format!("the cell has no program of number {load}");
            ports.program(load).ok_or_else(none)
        });
        planner.load(program, feedback);
    }
    ports.keep_tool(&planner.machine, feedback.auxiliary.tool);
    if planner.is_other_run(feedback) {
        let run = Some((feedback.load, feedback.run));
        let kept = ports.parameters(run, &planner.machine, &feedback.auxiliary);
        if let Err(why) = planner.take_kept(kept) {
            planner.give_up(why);
        }
        planner.begin_run(ports.answers(feedback.load, feedback.run), feedback);
    }
    if let Some(answer) = planner.new_answer(feedback)
        && ports.keep_answer(feedback.load, feedback.run, &answer)
    {
        planner.take_answer(answer);
    }
    if let Some(element) = planner.wants_place(feedback)
        && let Some(place) = ports.place_before(feedback.program_hash, element)
    {
        planner.take_place(place);
    }
}

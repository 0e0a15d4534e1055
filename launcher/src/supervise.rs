//! The launcher's loop: it watches the group, restarts who is lost, and stops it in order when asked to or when it has to.

use std::time::{Duration, Instant};

use bus::member::Pace;
use bus::port::OperatorClient;
use bus::sample::{Cause, Feedback, Job, Mode, OperatorRequest, Order, ProgramState};
use bus::signal_page::CellPhase;
use control::path::Path;
use machine::{AfterLoss, Machine, Restart};
use plant_sim::script::faults::FaultScript;

use crate::events::{Event, Events};
use crate::exit;
use crate::fault_injector::FaultInjector;
use crate::group::{Death, Group, LEAVE_LIMIT, LEAVE_LIMIT_AFTER_MACHINE};
use crate::hangs::Hangs;
use crate::progress::{LOOK_EVERY, Progress};
use crate::service_manager;
use crate::session::Session;
use crate::signals::Signals;
use crate::supervisor::{Supervisor, Verdict};
use crate::view::View;

/// So long the machine may take to come to rest once it was told to.
const STOP_LIMIT: Duration = Duration::from_secs(15);
/// The longest wait while somebody is being started, or a fault script may ask for something.
const LOOK_OFTEN: Duration = Duration::from_millis(1);

/// How a supervised group ended.
#[derive(Debug)]
pub struct Ending {
    /// The last feedback that was seen.
    pub last: Option<Feedback>,
    /// Who died.
    pub deaths: Vec<Death>,
    /// Times that somebody interrupted it.
    pub interruptions: u32,
    /// The master left by itself; it was not killed.
    pub in_order: bool,
    /// Names of the axes.
    pub axes: Vec<String>,
}

/// The launcher's own looks into the cell; made before the scans begin, so that it sees also the shortest run.
pub struct Watch {
    progress: Progress,
    operator: OperatorClient,
}

impl Watch {
    /// Looks on; with a bar for the one program of a run.
    pub fn new(group: &Group, machine: &Machine, bar: bool) -> anyhow::Result<Watch> {
        let mut progress = Progress::new(
            group.bus.feedback_reader(1)?,
            group.bus.planner_reader(1)?,
            machine.scan_period_s(),
            bar,
        );
        // A reader is connected from its first look on.
        progress.look(None);
        Ok(Watch {
            progress,
            operator: group.bus.operator_client()?,
        })
    }
}

/// What is supervised.
pub struct Subject<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// The path of the one program of a run, for the progress bar.
    pub path: Option<&'a Path>,
    /// What is to go wrong.
    pub faults: Option<FaultScript>,
    /// The programs of a cell that stays up.
    pub session: Option<Session>,
    /// The live view in this terminal.
    pub view: Option<View>,
}

/// Watches the group until its master has ended, and stops it in order when asked to or when it has to.
pub fn supervise(
    group: &mut Group,
    subject: Subject<'_>,
    mut watch: Watch,
    signals: &Signals,
    events: &mut Events,
) -> Ending {
    let Subject {
        machine,
        path,
        faults,
        mut session,
        mut view,
    } = subject;
    let axes: Vec<String> = machine.axes.iter().map(|axis| axis.name.clone()).collect();
    let mut deaths: Vec<Death> = Vec::new();
    let mut supervisor = Supervisor::new(machine);
    let mut desk = faults.map(FaultInjector::new);
    let mut ends = false;
    let mut hangs = Hangs::default();
    let mut hinted: Option<String> = None;
    let cell = group.cell_name().to_string();
    let realtime = group.pace() == Pace::Realtime;
    let mut stop_since: Option<Instant> = None;
    let mut tripped = false;
    let machine_place = group.place_of(Job::Master, 0, 0).unwrap_or_default();
    while (group.lives(Job::Master) || supervisor.is_due(machine_place)) && signals.count() < 2 {
        let often = desk.is_some() || supervisor.is_busy(group);
        let limit = if often { LOOK_OFTEN } else { LOOK_EVERY };
        group.wait(Some(signals.descriptor()), limit);
        group.greet();
        if let Some(view) = &mut view {
            view.look();
        }
        let newest = watch.progress.look(path).copied();
        group.newest_scan = newest.map_or(0, |feedback| feedback.scan);
        if let Some(feedback) = newest {
            let is_tripped = feedback.mode == Mode::Tripped as u32;
            if is_tripped && !tripped {
                let how = stop_words(&feedback, &axes);
                tracing::error!("{how}");
                events.write(&Event::of_cell(feedback.scan, "trip", Some(how)));
            }
            tripped = is_tripped;
            if let Some(session) = &mut session {
                session.look(&feedback, group.page.recorded_scans(), events);
                let recorder = group.place_of(Job::Monitor, 0, 0).unwrap_or_default();
                let given_up = !group.lives(Job::Monitor) && !supervisor.is_due(recorder);
                if session.is_another(&feedback) && given_up {
                    // Whatever kept it from writing may have passed.
                    supervisor.try_anew(recorder);
                }
            }
        }
        if realtime {
            for process in hangs.end(group) {
                events.write(&Event {
                    process: Some(&process),
                    ..Event::of_cell(group.newest_scan, "hangs", Some("killed".into()))
                });
            }
        }
        let mut died = group.reap();
        note_deaths(&died, group.newest_scan, events);
        for death in died.iter_mut().filter(|d| !d.status.success()) {
            match supervisor.judge(group, death) {
                Verdict::Restarts => death.replaced = true,
                Verdict::GoesOn => {}
                Verdict::Ends => ends = true,
            }
        }
        deaths.extend(died);
        supervisor.start_due(group);
        for (process, pid) in group.admit_ready() {
            tracing::info!("{process} started anew");
            events.write(&Event {
                process: Some(&process),
                pid: Some(pid),
                ..Event::of_cell(group.newest_scan, "restarted", None)
            });
        }
        let waits = newest.filter(|_| deaths.iter().any(|death| death.replaced));
        let hint = waits.and_then(|feedback| match session {
            None => waits_for(&feedback, &machine.restart, &cell),
            Some(_) => lost_in(&feedback, &cell),
        });
        if hint != hinted && !supervisor.is_busy(group) {
            if let Some(hint) = &hint {
                tracing::warn!("{hint}");
            }
            hinted = hint;
        }
        if let Some(desk) = &mut desk {
            ends |= serve_faults(desk, group, &supervisor, events, &mut deaths);
        }
        let why = if signals.count() > 0 {
            Some("interrupted")
        } else if ends {
            Some("a process is lost for good")
        } else {
            None
        };
        if let Some(why) = why
            && stop_since.is_none()
            && stop(group, &watch.operator, session.is_some())
        {
            stop_since = Some(Instant::now());
            service_manager::stopping();
            events.write(&Event::of_cell(group.newest_scan, "stop", Some(why.into())));
            let again = if signals.count() > 0 {
                "again"
            } else {
                "twice"
            };
            tracing::info!(
                "{why}: the tool comes to rest on the path (Ctrl-C {again} stops at once)"
            );
        }
        if stop_since.is_some_and(|since| since.elapsed() > STOP_LIMIT) {
            tracing::error!(
                "not at rest {} s after it was told to stop",
                STOP_LIMIT.as_secs()
            );
            break;
        }
    }
    drop(view);
    service_manager::stopping();
    let in_order = !group.lives(Job::Master);
    if in_order {
        let machine_lost = |d: &Death| d.is_untimely(Job::Master) && !d.replaced;
        let limit = if deaths.iter().any(machine_lost) {
            group.page.set_phase(CellPhase::Ending);
            LEAVE_LIMIT_AFTER_MACHINE
        } else {
            LEAVE_LIMIT
        };
        let before = signals.count();
        let left = group.wait_until_left(limit, &|| signals.count() > before);
        note_deaths(&left, group.newest_scan, events);
        deaths.extend(left);
    } else {
        tracing::warn!("stopped at once");
        group.kill();
    }
    watch.progress.look(path);
    watch.progress.finish();
    let last = watch.progress.newest().copied();
    if let (Some(session), Some(last)) = (&mut session, &last) {
        // Whoever looks for the cell now finds none; its last report is still being made.
        group.page.set_phase(CellPhase::Ending);
        if in_order {
            session.finish(last, signals, events);
        }
    }
    if let Some(last) = &last {
        let how = stop_words(last, &axes);
        events.write(&Event::of_cell(last.scan, "ended", Some(how)));
    }
    Ending {
        last,
        deaths,
        interruptions: signals.count(),
        in_order,
        axes,
    }
}

/// What a machine that does not go on by itself waits for, in words.
fn waits_for(feedback: &Feedback, restart: &Restart, cell: &str) -> Option<String> {
    let orders = match Mode::from_wire(feedback.mode)? {
        Mode::Tripped if restart.servo == AfterLoss::Wait => {
            format!("`quadrant resume --cell {cell}` returns to the path and goes on")
        }
        Mode::Disabled if feedback.program != ProgramState::Begun as u32 => {
            format!("the drives are off: `quadrant enable --cell {cell}`")
        }
        Mode::Disabled => format!(
            "the drives are off: `quadrant enable --cell {cell}`, then `quadrant resume --cell {cell}`"
        ),
        Mode::Enabled if feedback.hold == 1 => {
            format!("the machine is in hold: `quadrant resume --cell {cell}` goes on")
        }
        _ => return None,
    };
    Some(format!("{orders}; Ctrl-C ends the run"))
}

/// The same of a cell that stays up, where a process was lost; what an operator waits for he knows himself.
fn lost_in(feedback: &Feedback, cell: &str) -> Option<String> {
    let cause = Cause::from_wire(feedback.cause)?;
    let begun = feedback.program == ProgramState::Begun as u32;
    let then = if begun {
        format!("`quadrant resume --cell {cell}` returns to the path and goes on")
    } else {
        format!("`quadrant enable --cell {cell}` makes it ready")
    };
    match (Mode::from_wire(feedback.mode)?, cause) {
        (Mode::Tripped, Cause::ServoLost | Cause::Watchdog) => Some(then),
        (Mode::Disabled, Cause::MasterLost) if begun => Some(format!(
            "the drives are off: `quadrant enable --cell {cell}`, then {then}"
        )),
        (Mode::Disabled, Cause::MasterLost) => Some(then),
        _ => None,
    }
}

/// Does what the master asks for in the name of a fault script, as long as it asks; whether a process was lost without
/// which the run is to end.
fn serve_faults(
    desk: &mut FaultInjector,
    group: &mut Group,
    supervisor: &Supervisor,
    events: &mut Events,
    deaths: &mut Vec<Death>,
) -> bool {
    let mut ends = false;
    loop {
        match desk.serve(group, supervisor) {
            Ok(Some(served)) => {
                if let Some((scan, word, process)) = &served.event {
                    events.write(&Event {
                        process: Some(process),
                        ..Event::of_cell(*scan, word, Some("by the fault script".into()))
                    });
                }
                let for_good = |d: &Death| d.job == Job::Planner && !d.replaced;
                ends |= served.death.as_ref().is_some_and(for_good);
                deaths.extend(served.death);
            }
            Ok(None) => return ends,
            Err(error) => {
                tracing::error!("{}", exit::words(&error));
                return true;
            }
        }
    }
}

/// Says who died untimely.
fn note_deaths(deaths: &[Death], scan: u64, events: &mut Events) {
    for death in deaths.iter().filter(|death| !death.status.success()) {
        tracing::error!("{} {}", death.name, death.words());
        events.write(&Event {
            process: Some(&death.name),
            ..Event::of_cell(scan, "died", Some(death.words()))
        });
    }
}

/// Asks the master to come to rest on the path, and a cell that stays up to end then; false if the order could not be
/// sent.
fn stop(group: &Group, operator: &OperatorClient, stays: bool) -> bool {
    let order = if stays { Order::Down } else { Order::Stop };
    let order = OperatorRequest {
        order: order as u32,
        ..OperatorRequest::default()
    };
    let sent = operator.send(order).is_some();
    group.page.master_signal().raise();
    sent
}

/// Why and where the machine stopped.
pub fn stop_words(feedback: &Feedback, axes: &[String]) -> String {
    let cause = Cause::from_wire(feedback.cause).map_or("an unknown cause", Cause::words);
    let axis = axes
        .get(feedback.cause_axis as usize)
        .map_or(String::new(), |name| format!(", axis {name}"));
    match Mode::from_wire(feedback.mode) {
        Some(Mode::Tripped) => format!(
            "the machine tripped in scan {}: {cause}{axis}",
            feedback.cause_scan
        ),
        Some(mode) if feedback.cause != 0 => {
            format!(
                "the machine is {} in scan {}: {cause}",
                mode.word(),
                feedback.scan
            )
        }
        Some(mode) => format!("the machine is {} in scan {}", mode.word(), feedback.scan),
        None => format!(
            "the machine is in an unknown mode in scan {}",
            feedback.scan
        ),
    }
}

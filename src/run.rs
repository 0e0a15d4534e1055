//! `quadrant run`: check everything, start the group, supervise it, stop it, write the report.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use bus::cell::CellPlace;
use bus::fault_file::{self, FaultScript};
use bus::machine::learned::{Learned, learned_file};
use bus::machine::{AfterLoss, Restart, machine_file};
use bus::member::Pace;
use bus::order_file;
use bus::page::CellPhase;
use bus::port::OperatorClient;
use bus::sample::{Cause, Feedback, Job, Mode, OperatorRequest, Order};

use crate::check::{self, Checked};
use crate::cli::{CleanOptions, RunOptions};
use crate::events::{Event, Events};
use crate::exit::{Failure, Kind, Outcome};
use crate::fault_desk::FaultDesk;
use crate::group::{Death, Group, LEAVE_LIMIT, LEAVE_LIMIT_AFTER_MACHINE, Plan};
use crate::hangs::Hangs;
use crate::output::say;
use crate::progress::{LOOK_EVERY, Progress};
use crate::run_dir::{RunDir, Sources, default_folder, program_name};
use crate::signals::Signals;
use crate::supervisor::{Supervisor, Verdict};
use crate::{doctor, exit, learn, logs, report};

/// So long the machine may take to come to rest once it was told to.
const STOP_LIMIT: Duration = Duration::from_secs(15);
/// The longest wait while somebody is being started, or a fault script may ask for something.
const LOOK_OFTEN: Duration = Duration::from_millis(1);
/// Members of a dead launcher get so long to stop on the path and leave.
const MEMBERS_PATIENCE: Duration = Duration::from_secs(10);

/// Runs a program on a machine.
pub fn run(options: &RunOptions) -> Outcome {
    logs::init_launcher();
    program_name(&options.program).input()?;
    let checked = check::load(&options.machine, Some(&options.program)).input()?;
    if let Some(orders) = &options.orders {
        order_file::load(orders, &checked.machine).input()?;
    }
    let faults = options
        .faults
        .as_deref()
        .map(|path| load_faults(path, &checked))
        .transpose()
        .input()?;
    let cell_name = options.cell.as_deref().unwrap_or(&checked.machine.name);
    let place = CellPlace::new(cell_name).input()?;
    let signals = Signals::catch().environment()?;
    let cell = place.own(MEMBERS_PATIENCE).environment()?;
    if cell.leftovers > 0 {
        tracing::info!(
            "removed {} files that a crashed run had left of cell {cell_name}",
            cell.leftovers
        );
    }
    let machine_path = machine_file(&options.machine);
    let folder = options
        .out
        .clone()
        .unwrap_or_else(|| default_folder(&checked.machine.name, &options.program));
    let learned_path = learned_file(&machine_path);
    let taught = (!options.no_learned).then(|| Learned::beside(&machine_path, &checked.machine));
    let taught = taught.transpose().input()?.flatten();
    if let Some(taught) = &taught {
        for axis in taught.outdated(&checked.machine) {
            tracing::warn!(
                "{}: axis {axis} has other settings now: what it had learned is not used",
                learned_path.display()
            );
        }
    }
    let run_dir = RunDir::make(
        &folder,
        &Sources {
            machine: &machine_path,
            plant: &machine_path.with_file_name("plant.toml"),
            program: &options.program,
            learned: taught.is_some().then_some(learned_path.as_path()),
            orders: options.orders.as_deref(),
            faults: options.faults.as_deref(),
        },
    )
    .environment()?;
    // What runs is what was copied: checked once more, in case someone edited it meanwhile.
    let mut checked = match check::load(&run_dir.machine, Some(&run_dir.program)) {
        Ok(checked) => checked,
        Err(error) => {
            let _ = std::fs::remove_dir_all(&run_dir.folder);
            return Err(Failure::Input(error));
        }
    };
    let (faults, fault_blocks) = match faults {
        Some((script, blocks)) => {
            script.restart.apply(&mut checked.machine.restart);
            (Some(script), blocks)
        }
        None => (None, Vec::new()),
    };
    if options.pace() == Pace::Realtime {
        doctor::say_what_realtime_lacks();
    }
    let plan = Plan {
        machine_file: run_dir.machine.clone(),
        plant_file: run_dir.plant.clone(),
        program: run_dir.program.clone(),
        out: run_dir.folder.clone(),
        pace: options.pace(),
        answer_limit_s: options.answer_limit,
        orders: run_dir.orders.clone(),
        faults: run_dir.faults.clone(),
        fault_blocks,
    };
    let mut group = match Group::start(cell, &checked.machine, &plan, &|| signals.count() > 0) {
        Ok(group) => group,
        Err(_) if signals.count() > 0 => return Err(Failure::Interrupted),
        Err(error) => return Err(Failure::Environment(error)),
    };
    let mut events = Events::create(&run_dir.folder).environment()?;
    for (process, pid) in group.living() {
        events.write(&Event {
            process: Some(process),
            pid: Some(pid),
            ..Event::of_cell(0, "started", None)
        });
    }
    let watch = Watch::new(&group, &checked).environment()?;
    group.begin();
    let ending = supervise(&mut group, &checked, faults, watch, &signals, &mut events);
    drop(group);
    let made = report::make(&run_dir.folder);
    conclude(ending, made, &run_dir.folder)?;
    if options.learn {
        // Only a run that went well gets here.
        let lines = learn::learn(&run_dir.folder, &machine_path, &checked.machine).environment()?;
        say(&format!("Learned, {}:", learned_path.display()));
        for line in lines {
            say(&format!("  {line}"));
        }
    }
    Ok(())
}

/// Reads a fault script; with it, where the blocks that it names begin on the path (line and element).
fn load_faults(path: &Path, checked: &Checked) -> anyhow::Result<(FaultScript, Vec<(u32, u32)>)> {
    let mut script = fault_file::load(path, &checked.machine)?;
    let elements = checked.program.as_ref().map(|p| p.path.elements.as_slice());
    let mut blocks = Vec::new();
    script.resolve_blocks(|line| {
        let at = elements?.iter().position(|element| element.line >= line)?;
        let element = u32::try_from(at).ok()?;
        blocks.push((line, element));
        Some(element)
    })?;
    Ok((script, blocks))
}

/// How a supervised run ended.
#[derive(Debug)]
struct Ending {
    last: Option<Feedback>,
    deaths: Vec<Death>,
    interruptions: u32,
    /// The machine side left by itself; it was not killed.
    in_order: bool,
    axes: Vec<String>,
}

/// The launcher's own looks into the cell; made before the scans begin, so that it sees also the shortest run.
struct Watch {
    progress: Progress,
    operator: OperatorClient,
}

impl Watch {
    fn new(group: &Group, checked: &Checked) -> anyhow::Result<Watch> {
        let mut progress = Progress::new(
            group.bus.feedback_reader(1)?,
            group.bus.planner_reader(1)?,
            checked.machine.scan_period_s(),
        );
        // A reader is connected from its first look on.
        progress.look(None);
        Ok(Watch {
            progress,
            operator: group.bus.operator_client()?,
        })
    }
}

/// Watches the group until its machine side has ended, and stops it in order when asked to or when it has to.
fn supervise(
    group: &mut Group,
    checked: &Checked,
    faults: Option<FaultScript>,
    mut watch: Watch,
    signals: &Signals,
    events: &mut Events,
) -> Ending {
    let axes: Vec<String> = checked
        .machine
        .axes
        .iter()
        .map(|axis| axis.name.clone())
        .collect();
    let path = checked.program.as_ref().map(|p| &p.path);
    let mut deaths: Vec<Death> = Vec::new();
    let mut supervisor = Supervisor::new(&checked.machine);
    let mut desk = faults.map(FaultDesk::new);
    let mut ends = false;
    let mut hangs = Hangs::default();
    let mut hinted: Option<String> = None;
    let cell = group.cell_name().to_string();
    let realtime = group.pace() == Pace::Realtime;
    let mut stop_since: Option<Instant> = None;
    let mut tripped = false;
    let machine_place = group.place_of(Job::Machine, 0, 0).unwrap_or_default();
    while (group.lives(Job::Machine) || supervisor.is_due(machine_place)) && signals.count() < 2 {
        let often = desk.is_some() || supervisor.is_busy(group);
        let limit = if often { LOOK_OFTEN } else { LOOK_EVERY };
        group.wait(Some(signals.descriptor()), limit);
        group.greet();
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
        let hint = waits.and_then(|feedback| waits_for(&feedback, &checked.machine.restart, &cell));
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
            && stop(group, &watch.operator)
        {
            stop_since = Some(Instant::now());
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
    let in_order = !group.lives(Job::Machine);
    if in_order {
        let machine_lost = |d: &Death| d.is_untimely(Job::Machine) && !d.replaced;
        let limit = if deaths.iter().any(machine_lost) {
            group.page.set_phase(CellPhase::Ending);
            LEAVE_LIMIT_AFTER_MACHINE
        } else {
            LEAVE_LIMIT
        };
        let left = group.wait_until_left(limit);
        note_deaths(&left, group.newest_scan, events);
        deaths.extend(left);
    } else {
        tracing::warn!("stopped at once");
        group.kill();
    }
    watch.progress.look(path);
    watch.progress.finish();
    let last = watch.progress.newest().copied();
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

/// Does what the machine side asks for in the name of a fault script, as long as it asks; whether a process was lost without
/// which the run is to end.
fn serve_faults(
    desk: &mut FaultDesk,
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

/// Asks the machine side to come to rest on the path; false if the order could not be sent.
fn stop(group: &Group, operator: &OperatorClient) -> bool {
    let order = OperatorRequest {
        order: Order::Stop as u32,
        ..OperatorRequest::default()
    };
    let sent = operator.send(order).is_some();
    group.page.machine_bell().ring();
    sent
}

fn conclude(ending: Ending, made: anyhow::Result<String>, folder: &Path) -> Outcome {
    match &made {
        Ok(text) => {
            say(text);
            say(&format!("Run directory: {}", folder.display()));
        }
        Err(error) => {
            let why = exit::words(error);
            tracing::error!("no report could be made of {}: {why}", folder.display());
        }
    }
    if ending.interruptions > 1 {
        return Err(Failure::Interrupted);
    }
    if !ending.in_order {
        return Err(Failure::Stopped(anyhow!(
            "the machine did not come to rest in order"
        )));
    }
    if let Some(death) = ending
        .deaths
        .iter()
        .find(|d| !d.status.success() && !d.replaced)
    {
        if death.status.code() == Some(3) {
            return Err(Failure::Environment(anyhow!(
                "{} could not go on",
                death.name
            )));
        }
        let end = ending.last.as_ref();
        let end = end.map_or(String::new(), |f| {
            format!(": {}", stop_words(f, &ending.axes))
        });
        return Err(Failure::Stopped(anyhow!(
            "{} {}{end}",
            death.name,
            death.words()
        )));
    }
    let last = ending
        .last
        .ok_or_else(|| Failure::Environment(anyhow!("no scan ever ran")))?;
    match Mode::from_wire(last.mode) {
        Some(Mode::Stopped | Mode::Disabled) if ending.interruptions > 0 && last.cause == 0 => {
            Err(Failure::Interrupted)
        }
        Some(Mode::Finished) => {
            made.map_err(Failure::Environment)?;
            Ok(())
        }
        _ => Err(Failure::Stopped(anyhow!(
            "{}",
            stop_words(&last, &ending.axes)
        ))),
    }
}

/// Why and where the machine stopped.
fn stop_words(feedback: &Feedback, axes: &[String]) -> String {
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

/// `quadrant clean`: removes what a crash left of a cell.
pub fn clean(options: &CleanOptions) -> Outcome {
    logs::init_launcher();
    let place = CellPlace::new(&options.cell).input()?;
    let cell = place.own(Duration::ZERO).environment()?;
    say(&format!(
        "cell {}: {} files removed",
        options.cell, cell.leftovers
    ));
    Ok(())
}

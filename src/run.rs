//! `quadrant run`: check everything, start the group, supervise it, stop it, write the report.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use bus::cell::CellPlace;
use bus::machine::learned::{Learned, learned_file};
use bus::machine::machine_file;
use bus::member::Pace;
use bus::order_file;
use bus::page::CellPhase;
use bus::port::OperatorClient;
use bus::sample::{Cause, Feedback, Job, Mode, OperatorRequest, Order};

use crate::check::{self, Checked};
use crate::cli::{CleanOptions, RunOptions};
use crate::events::{Event, Events};
use crate::exit::{Failure, Kind, Outcome};
use crate::group::{Death, Group, LEAVE_LIMIT, LEAVE_LIMIT_AFTER_MACHINE, Plan};
use crate::output::say;
use crate::progress::{LOOK_EVERY, Progress};
use crate::run_dir::{RunDir, Sources, default_folder, program_name};
use crate::signals::Signals;
use crate::{doctor, exit, learn, logs, report};

/// So long the machine may take to come to rest once it was told to.
const STOP_LIMIT: Duration = Duration::from_secs(15);
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
        },
    )
    .environment()?;
    // What runs is what was copied: checked once more, in case someone edited it meanwhile.
    let checked = match check::load(&run_dir.machine, Some(&run_dir.program)) {
        Ok(checked) => checked,
        Err(error) => {
            let _ = std::fs::remove_dir_all(&run_dir.folder);
            return Err(Failure::Input(error));
        }
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
    let ending = supervise(&mut group, &checked, watch, &signals, &mut events);
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
    let mut stop_since: Option<Instant> = None;
    let mut tripped = false;
    while group.lives(Job::Machine) && signals.count() < 2 {
        group.wait(Some(signals.descriptor()), LOOK_EVERY);
        let newest = watch.progress.look(path).copied();
        group.newest_scan = newest.map_or(0, |feedback| feedback.scan);
        if let Some(feedback) = newest
            && feedback.mode == Mode::Tripped as u32
            && !tripped
        {
            tripped = true;
            let how = stop_words(&feedback, &axes);
            events.write(&Event::of_cell(feedback.scan, "trip", Some(how)));
        }
        let died = group.reap();
        note_deaths(&died, group.newest_scan, events);
        deaths.extend(died);
        let why = if signals.count() > 0 {
            Some("interrupted")
        } else if deaths.iter().any(|d| d.is_untimely(Job::Planner)) {
            Some("planner lost")
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
        let limit = if deaths.iter().any(|d| d.is_untimely(Job::Machine)) {
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
    if let Some(death) = ending.deaths.iter().find(|d| !d.status.success()) {
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
            feedback.scan
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

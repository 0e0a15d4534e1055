//! `quadrant run`: check everything, start the group, supervise it, stop it, write the report.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{anyhow, bail};
use bus::cell::{CellError, CellPaths, Ownership};
use bus::member::Pace;
use bus::sample::RunOutcome;
use machine::{LogLevel, Machine, machine_file};
use plant_sim::script::faults::{self, Fault, FaultScript};
use plant_sim::script::orders;

use crate::check::{self, Checked, Depth};
use crate::desk::{self, Desk};
use crate::events::Events;
use crate::group::{Group, Plan};
use crate::observers::{Observer, Observers};
use crate::options::{CleanOptions, RunOptions};
use crate::retention::Retention;
use crate::run_dir::{RunDir, Sources, default_folder, program_name};
use crate::supervise::{Ending, Subject, Watch, supervise};
use crate::{disk_room, origin, service_manager, training};
use console::exit::{Failure, Kind, Outcome};
use console::output::{self, say};
use console::signals::Signals;
use console::{exit, logs};

/// Members of a dead launcher get so long to stop on the path and leave.
const MEMBERS_PATIENCE: Duration = Duration::from_secs(10);

/// A process that has ended holds its lock for a moment.
const CLEAN_PATIENCE: Duration = Duration::from_millis(500);

/// What a fault script may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Injection {
    /// Kill and stop processes.
    KillsAndStops,
    /// Also have processes send wrong, late or no samples: they must be able to.
    WrongSamples,
}

/// A run that went well.
#[derive(Debug)]
pub struct Completed {
    /// Its run directory.
    pub folder: PathBuf,
    /// The machine file it was started with.
    pub machine_file: PathBuf,
    /// What that file says.
    pub machine: Machine,
}

/// Runs a program on a machine.
///
/// # Errors
/// Nothing was started, or the run did not complete.
pub fn run(
    options: &RunOptions,
    injection: Injection,
    desk: Option<Desk<'_>>,
) -> Result<Completed, Failure> {
    logs::init_launcher();
    output::never_wait();
    let learns = [
        ("--learn", options.learn),
        ("--learn-path", options.learn_path),
    ];
    if let Some((name, _)) = learns.iter().find(|(_, given)| *given && desk.is_none()) {
        let refused = "is of `quadrant`: this command runs cells alone";
        return Err(anyhow!("{name}: {refused}")).input();
    }
    let (checked, faults) = check_all(options, injection)?;
    let cell_name = options.start.cell.as_ref();
    let place = CellPaths::new(cell_name.unwrap_or(&checked.machine.name)).input()?;
    let signals = Signals::catch().environment()?;
    let cell = own(&place).environment()?;
    let observers = desk::observers(desk)?;
    let machine_path = machine_file(&options.start.machine);
    if let Some(mut retention) = Retention::of_run(&checked.machine) {
        retention.apply();
    }
    let (run_dir, mut checked) = make_run_dir(options, &machine_path, &checked)?;
    let (faults, fault_blocks) = faults.unzip();
    if let Some(script) = &faults {
        script.restart.apply(&mut checked.machine.restart);
    }
    if let Some(desk) = desk.filter(|_| options.start.pace() == Pace::Realtime) {
        (desk.say_what_realtime_lacks)();
    }
    let level = options.start.level(&checked.machine);
    let sends = |script: &FaultScript| script.faults.iter().any(|f| f.action.is_of_samples());
    let plan = Plan {
        wrong_samples: faults.as_ref().is_some_and(sends),
        level,
        fault_blocks: fault_blocks.unwrap_or_default(),
        single_block: options.single_block,
        start_line: options.from_line,
        ..Plan::of(&run_dir, options.start.pace(), options.start.answer_limit)
    };
    let started = origin::note(&place, &machine_path).environment();
    let started = started.and_then(|()| start(cell, &checked.machine, &plan, &signals));
    let mut group = started.inspect_err(|_| run_dir.discard())?;
    let mut events = make_events(&run_dir, level)?;
    note_started(&group, &mut events);
    let in_terminal = observers.iter().any(Observer::is_in_terminal);
    let watch = Watch::new(&group, &checked.machine, !in_terminal).environment()?;
    group.begin();
    service_manager::ready();
    let shown = options.program.display();
    service_manager::status(&format!("cell {} runs {shown}", place.name()));
    let subject = Subject {
        machine: &checked.machine,
        faults,
        session: None,
        observers: Observers::start(observers, place.name(), checked.machine.restart)
            .environment()?,
    };
    let ending = supervise(&mut group, subject, watch, &signals, &mut events);
    drop(group);
    if let Some(Err(error)) = ending.ended.as_ref().map(|of| of.note(&run_dir.folder)) {
        tracing::warn!("{}: {error}", run_dir.folder.display());
    }
    let made = (level.has_samples() && desk.is_some()).then(|| desk::report(&run_dir.folder));
    conclude(ending, made, &run_dir.folder)?;
    Ok(Completed {
        folder: run_dir.folder,
        machine_file: machine_path,
        machine: checked.machine,
    })
}

/// Opens the events of a run, if they are kept.
///
/// # Errors
/// They cannot be written.
pub fn make_events(run_dir: &RunDir, level: LogLevel) -> Result<Events, Failure> {
    match level {
        LogLevel::Off => Events::nowhere().environment(),
        _ => Events::create(&run_dir.folder).environment(),
    }
}

/// A fault script; with it, where the blocks that it names begin on the path (line and element).
type Faults = (FaultScript, Vec<(u32, u32)>);

/// Reads and checks all files, before anything is written or started.
fn check_all(
    options: &RunOptions,
    injection: Injection,
) -> Result<(Checked, Option<Faults>), Failure> {
    program_name(&options.program).input()?;
    let program = Some(options.program.as_path());
    let checked = check::load_in(
        &options.start.machine,
        program,
        Depth::Beginning,
        options.of_program.dialect,
    )
    .input()?;
    for remark in checked.remarks() {
        tracing::warn!("{}: {remark}", options.start.machine.display());
    }
    for note in checked.notes() {
        tracing::warn!("{}: {note}", options.program.display());
    }
    if let Some(line) = options.from_line {
        check::start_line(&checked.machine, &options.program, checked.start, line).input()?;
    }
    if let Some(orders) = &options.orders {
        orders::load(orders, &checked.machine).input()?;
    }
    let two_motors = checked.machine.gantries().next().is_some();
    if options.learn_path && two_motors {
        let refused =
            "--learn-path: learns only where each axis has one motor, and the machine has a gantry";
        return Err(anyhow!(refused)).input();
    }
    let faults = options.faults.as_deref();
    if let Some(path) = faults.filter(|_| checked.machine.bus.is_some() && !options.with_drives) {
        let refused = "the drives of this machine are on a bus, and a fault may let them stop hard: --with-drives says that it may";
        return Err(anyhow!("--faults {}: {refused}", path.display())).input();
    }
    let faults = faults.map(|path| load_faults(path, &checked, injection));
    Ok((checked, faults.transpose().input()?))
}

fn make_run_dir(
    options: &RunOptions,
    machine_path: &Path,
    checked: &Checked,
) -> Result<(RunDir, Checked), Failure> {
    let machine = &checked.machine;
    let default = || default_folder(&machine.name, &options.program);
    let folder = options.start.out.clone().unwrap_or_else(default);
    let level = options.start.level(machine);
    let seconds = || checked.seconds().filter(|_| level.has_samples());
    disk_room::check(&folder, machine, level, seconds).environment()?;
    let program = checked.program.as_ref().filter(|_| options.learn);
    let program = program.map(|program| format!("{:016x}", program.source_hash));
    let without = options.start.no_learned;
    let trained = training::trained(machine_path, machine, without, program.as_deref());
    let trained = trained.input()?;
    let along_path = training::along_path(machine_path, checked, options).input()?;
    let sources = Sources {
        machine: machine_path,
        plant: &machine_path.with_file_name("plant.toml"),
        program: Some(&options.program),
        dialect: options.of_program.dialect,
        learned: trained.as_deref(),
        learned_path: along_path.as_deref(),
        orders: options.orders.as_deref(),
        faults: options.faults.as_deref(),
    };
    make_checked(&folder, &sources)
}

/// Makes a run directory. What runs is what was copied there: it is checked once more, in case someone edited it meanwhile.
///
/// # Errors
/// It cannot be made, or what was copied is not right.
pub fn make_checked(folder: &Path, sources: &Sources<'_>) -> Result<(RunDir, Checked), Failure> {
    let run_dir = RunDir::make(folder, sources).environment()?;
    // Where the axes start has been judged, or waits for a jog.
    let program = run_dir.program.as_deref();
    match check::load_changed(&run_dir.machine, program, Depth::Beginning, |_| Ok(())) {
        Ok(checked) => Ok((run_dir, checked)),
        Err(error) => {
            let _ = std::fs::remove_dir_all(&run_dir.folder);
            Err(Failure::Input(error))
        }
    }
}

/// Takes the cell, once what is left of a crashed one has gone.
pub fn own(place: &CellPaths) -> Result<Ownership, CellError> {
    let cell = place.own(MEMBERS_PATIENCE)?;
    if cell.leftovers > 0 {
        tracing::info!(
            "removed {} files that a crashed run had left of cell {}",
            cell.leftovers,
            place.name()
        );
    }
    Ok(cell)
}

/// Starts the group, unless somebody interrupts it.
pub fn start(
    cell: Ownership,
    machine: &Machine,
    plan: &Plan,
    signals: &Signals,
) -> Result<Group, Failure> {
    let interrupted = || signals.count() > 0;
    Group::start(cell, machine, plan, &interrupted).map_err(|error| match interrupted() {
        true => Failure::Interrupted,
        false => Failure::Environment(error),
    })
}

/// Writes down who was started.
pub fn note_started(group: &Group, events: &mut Events) {
    for (process, pid) in group.living() {
        events.note_started(process, pid, 0, "started");
    }
}

fn load_faults(path: &Path, checked: &Checked, injection: Injection) -> anyhow::Result<Faults> {
    let mut script = faults::load(path, &checked.machine)?;
    let sends = |fault: &&Fault| fault.action.is_of_samples();
    if injection == Injection::KillsAndStops
        && let Some(fault) = script.faults.iter().find(sends)
    {
        bail!(
            "{}:{}: drop, delay and corrupt make a process send wrong samples: only `quadrant-lab run` does that",
            path.display(),
            fault.line
        );
    }
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

fn conclude(ending: Ending, made: Option<anyhow::Result<String>>, folder: &Path) -> Outcome {
    let shown = folder.display();
    match &made {
        None => say(&format!(
            "Without a log (--log), so without a report. Run directory: {shown}"
        )),
        Some(Ok(text)) => say(&format!("{text}\nRun directory: {shown}")),
        Some(Err(error)) => {
            let why = exit::words(error);
            tracing::error!("no report could be made of {shown}: {why}");
        }
    }
    if ending.interruptions > 1 {
        return Err(Failure::Interrupted);
    }
    let stop = &ending.stop;
    if !ending.in_order {
        return Err(Failure::stopped(
            "the machine did not come to rest in order",
        ));
    }
    if let Some(death) = ending.deaths.iter().find(|d| d.is_loss()) {
        if death.status.code() == Some(3) {
            return Err(Failure::environment(format!(
                "{} could not go on",
                death.name
            )));
        }
        let end = ending.last.map_or(String::new(), |_| format!(": {stop}"));
        let words = death.words();
        return Err(Failure::stopped(format!("{} {words}{end}", death.name)));
    }
    if ending.files_removed {
        let what = "files of the cell were removed";
        return Err(Failure::stopped(format!("{what}: {stop}")));
    }
    let ended = ending.ended;
    let ended = ended.ok_or_else(|| Failure::environment("no scan ever ran"))?;
    match ended.outcome {
        RunOutcome::Interrupted if ending.interruptions > 0 => Err(Failure::Interrupted),
        RunOutcome::Completed => {
            made.transpose().map_err(Failure::Environment)?;
            Ok(())
        }
        _ => Err(Failure::stopped(ending.stop)),
    }
}

/// `quadrant clean`: removes what a crash left of a cell.
pub fn clean(options: &CleanOptions) -> Outcome {
    logs::init_launcher();
    let place = CellPaths::new(&options.cell).input()?;
    let cell = place.own(CLEAN_PATIENCE).environment()?;
    let (name, files) = (&options.cell, cell.leftovers);
    say(&format!("cell {name}: {files} files removed"));
    Ok(())
}

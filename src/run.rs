//! `quadrant run`: check everything, start the group, supervise it, stop it, write the report.

use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;
use bus::cell::{CellError, CellPlace, Ownership};
use bus::fault_file::{self, FaultScript};
use bus::machine::learned::learned_file;
use bus::machine::{Machine, machine_file};
use bus::member::Pace;
use bus::order_file;
use bus::sample::Mode;

use crate::check::{self, Checked};
use crate::cli::{CleanOptions, RunOptions};
use crate::events::{Event, Events};
use crate::exit::{Failure, Kind, Outcome};
use crate::group::{Group, Plan};
use crate::output::say;
use crate::run_dir::{RunDir, Sources, default_folder, program_name};
use crate::signals::Signals;
use crate::supervise::{Ending, Subject, Watch, stop_words, supervise};
use crate::view::{self, View};
use crate::{doctor, exit, learn, logs, metrics, report, service_manager};

/// Members of a dead launcher get so long to stop on the path and leave.
const MEMBERS_PATIENCE: Duration = Duration::from_secs(10);

/// Runs a program on a machine.
pub fn run(options: &RunOptions) -> Outcome {
    logs::init_launcher();
    program_name(&options.program).input()?;
    if options.view {
        view::check().input()?;
    }
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
    let cell = own(&place).environment()?;
    let metrics = options.metrics.map(metrics::listen);
    let metrics = metrics.transpose().environment()?;
    let machine_path = machine_file(&options.machine);
    let folder = options
        .out
        .clone()
        .unwrap_or_else(|| default_folder(&checked.machine.name, &options.program));
    let taught = learn::taught(&machine_path, &checked.machine, options.no_learned).input()?;
    let run_dir = RunDir::make(
        &folder,
        &Sources {
            machine: &machine_path,
            plant: &machine_path.with_file_name("plant.toml"),
            program: Some(&options.program),
            learned: taught.as_deref(),
            orders: options.orders.as_deref(),
            faults: options.faults.as_deref(),
        },
    )
    .environment()?;
    // What runs is what was copied: checked once more, in case someone edited it meanwhile.
    let mut checked = match check::load(&run_dir.machine, run_dir.program.as_deref()) {
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
        metrics,
    };
    let mut group = start(cell, &checked.machine, &plan, &signals)?;
    let mut events = Events::create(&run_dir.folder).environment()?;
    note_started(&group, &mut events);
    let watch = Watch::new(&group, &checked.machine, !options.view).environment()?;
    group.begin();
    service_manager::ready();
    let shown = options.program.display();
    service_manager::status(&format!("cell {cell_name} runs {shown}"));
    let subject = Subject {
        machine: &checked.machine,
        path: checked.program.as_ref().map(|program| &program.path),
        faults,
        session: None,
        view: options
            .view
            .then(|| View::open(cell_name))
            .transpose()
            .environment()?,
    };
    let ending = supervise(&mut group, subject, watch, &signals, &mut events);
    drop(group);
    let made = report::make(&run_dir.folder);
    conclude(ending, made, &run_dir.folder)?;
    if options.learn {
        // Only a run that went well gets here.
        let lines = learn::learn(&run_dir.folder, &machine_path, &checked.machine).environment()?;
        say(&format!(
            "Learned, {}:",
            learned_file(&machine_path).display()
        ));
        for line in lines {
            say(&format!("  {line}"));
        }
    }
    Ok(())
}

/// Takes the cell, once what is left of a crashed one has gone.
pub fn own(place: &CellPlace) -> Result<Ownership, CellError> {
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
    Group::start(cell, machine, plan, &interrupted).map_err(|error| {
        if interrupted() {
            Failure::Interrupted
        } else {
            Failure::Environment(error)
        }
    })
}

/// Writes down who was started.
pub fn note_started(group: &Group, events: &mut Events) {
    for (process, pid) in group.living() {
        events.write(&Event {
            process: Some(process),
            pid: Some(pid),
            ..Event::of_cell(0, "started", None)
        });
    }
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

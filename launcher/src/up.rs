//! `quadrant up`: start the group and stay; programs are loaded and started from other terminals.

use std::path::Path;

use bus::cell::CellPaths;
use bus::member::Pace;
use bus::sample::Job;
use machine::{Machine, machine_file};

use crate::check::Checked;
use crate::desk::{self, Desk};
use crate::group::{Death, Plan};
use crate::observers::Observers;
use crate::options::{StartOptions, UpOptions};
use crate::retention::Retention;
use crate::run::{make_checked, make_events, note_started, own, start};
use crate::run_dir::{RunDir, Sources, dated_folder};
use crate::session::Session;
use crate::supervise::{Ending, Subject, Watch, supervise};
use crate::{check, disk_room, origin, service_manager, training};
use console::exit::{Failure, Kind, Outcome};
use console::logs;
use console::output::{self, say};
use console::signals::Signals;

/// Starts the group of a machine and stays until it is ordered to end.
pub fn up(UpOptions { start: options }: &UpOptions, desk: Option<Desk<'_>>) -> Outcome {
    logs::init_launcher();
    output::never_wait();
    let checked = check::load_wherever_it_stands(&options.machine).input()?;
    for remark in checked.remarks() {
        tracing::warn!("{}: {remark}", options.machine.display());
    }
    let cell_name = options.cell.as_deref().unwrap_or(&checked.machine.name);
    let place = CellPaths::new(cell_name).input()?;
    let signals = Signals::catch().environment()?;
    let cell = own(&place).environment()?;
    let observers = desk::observers(desk)?;
    let machine_path = machine_file(&options.machine);
    let mut retention = Retention::of_cell(&checked.machine, options.out.as_deref());
    retention.apply();
    let (run_dir, mut checked) = make_folder(options, &machine_path, &checked, cell_name)?;
    let folder = run_dir.folder.clone();
    checked.machine.restart = checked.machine.restart.of_staying();
    if let Some(desk) = desk.filter(|_| options.pace() == Pace::Realtime) {
        (desk.say_what_realtime_lacks)();
    }
    let level = options.level(&checked.machine);
    let records = level.has_samples();
    let plan = Plan {
        level,
        ..Plan::of(&run_dir, options.pace(), options.answer_limit)
    };
    let started = origin::note(&place, &machine_path).environment();
    let started = started.and_then(|()| start(cell, &checked.machine, &plan, &signals));
    let mut group = started.inspect_err(|_| run_dir.discard())?;
    let mut events = make_events(&run_dir, level)?;
    if records {
        let shown = std::path::absolute(&run_dir.folder).environment()?;
        std::fs::write(place.runs_file(), shown.as_os_str().as_encoded_bytes()).environment()?;
    }
    note_started(&group, &mut events);
    let watch = Watch::new(&group, &checked.machine, false).environment()?;
    group.begin();
    service_manager::ready();
    service_manager::status(&format!("cell {cell_name} is up"));
    say_up(cell_name, &checked.machine, records, &folder);
    if records {
        say(&retention.words());
        retention.show(&place);
    }
    let subject = Subject {
        machine: &checked.machine,
        faults: None,
        session: Some(Session::new(
            &folder,
            &place,
            retention,
            records && desk.is_some(),
        )),
        observers: Observers::start(observers, cell_name, checked.machine.restart).environment()?,
    };
    let ending = supervise(&mut group, subject, watch, &signals, &mut events);
    drop(group);
    conclude(&ending, cell_name)
}

/// Makes the folder of the cell.
fn make_folder(
    options: &StartOptions,
    machine_path: &Path,
    checked: &Checked,
    cell_name: &str,
) -> Result<(RunDir, Checked), Failure> {
    let trained = training::trained(machine_path, &checked.machine, options.no_learned, None);
    let trained = trained.input()?;
    let folder = options.out.clone();
    let folder = folder.unwrap_or_else(|| dated_folder(&format!("{cell_name}-up")));
    let sources = Sources {
        machine: machine_path,
        plant: &machine_path.with_file_name("plant.toml"),
        program: None,
        dialect: None,
        learned: trained.as_deref(),
        learned_path: None,
        orders: None,
        faults: None,
    };
    let level = options.level(&checked.machine);
    disk_room::check(&folder, &checked.machine, level, || None).environment()?;
    make_checked(&folder, &sources)
}

/// Says that the cell is up, and what can be done with it.
fn say_up(cell_name: &str, machine: &Machine, records: bool, folder: &Path) {
    let homes = machine.axes.iter().any(|axis| axis.homing.is_some());
    let home = if homes { " | home" } else { "" };
    let logs = if records {
        "Every program that is started leaves a run directory"
    } else {
        "No program leaves a log (--log); what the cell was made of is"
    };
    say(&format!(
        "Cell {cell_name} is up, its drives are off. From any other terminal:\n  \
         quadrant enable{home} | load PROGRAM | start | hold | resume | stop | jog AXIS DISTANCE | status | monitor | down\n\
         {logs} in {}",
        folder.display()
    ));
}

fn conclude(ending: &Ending, cell: &str) -> Outcome {
    if !ending.in_order {
        return Err(match ending.interruptions {
            0 | 1 => Failure::stopped("the machine did not come to rest in order"),
            _ => Failure::Interrupted,
        });
    }
    let needed = |job| matches!(job, Job::Master | Job::Planner);
    let mut lost = ending.deaths.iter().filter(|d| needed(d.job));
    if let Some(death) = lost.find(|d| d.is_loss()) {
        return Err(Failure::stopped(format!(
            "{} {}",
            death.name,
            death.words()
        )));
    }
    let stop = &ending.stop;
    if ending.files_removed {
        let what = "files of the cell were removed";
        return Err(Failure::stopped(format!("{what}: {stop}")));
    }
    if ending.last.is_none_or(|last| last.last == 0) {
        let what = "the master left before it was told to";
        return Err(Failure::stopped(format!("{what}: {stop}")));
    }
    say(&format!("Cell {cell} is down"));
    let no_room = |death: &&Death| death.job == Job::Monitor && death.status.code() == Some(3);
    if ending.deaths.iter().any(|death| no_room(&death)) {
        let what = "the recorder could not go on: a log is not whole, as was said above";
        return Err(Failure::environment(what));
    }
    if ending.interruptions > 0 {
        return Err(Failure::Interrupted);
    }
    Ok(())
}

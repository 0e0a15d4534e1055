//! `quadrant run`: check everything, start the group, supervise it, stop it, write the report.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use bus::cell::CellPlace;
use bus::machine::machine_file;
use bus::member::Pace;
use bus::sample::{Cause, Feedback, Job, Mode, OperatorRequest, Order};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::check::{self, Checked};
use crate::cli::{CleanOptions, RunOptions};
use crate::exit::{Failure, Kind, Outcome};
use crate::group::{Death, Group, Plan};
use crate::progress::{LOOK_EVERY, Progress};
use crate::run_dir::{RunDir, Sources, default_folder};
use crate::signals::Signals;
use crate::{doctor, logs, report};

/// Members of a dead launcher get so long to stop on the path and leave.
const MEMBERS_PATIENCE: Duration = Duration::from_secs(10);

/// Runs a program on a machine.
pub fn run(options: &RunOptions) -> Outcome {
    logs::init_launcher();
    let checked = check::load(&options.machine, Some(&options.program)).input()?;
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
    let run_dir = RunDir::make(
        &folder,
        &Sources {
            machine: &machine_path,
            plant: &machine_path.with_file_name("plant.toml"),
            program: &options.program,
        },
    )
    .environment()?;
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
    };
    let mut group = match Group::start(cell, &checked.machine, &plan, &|| signals.count() > 0) {
        Ok(group) => group,
        Err(_) if signals.count() > 0 => return Err(Failure::Interrupted),
        Err(error) => return Err(Failure::Environment(error)),
    };
    let ending = supervise(&mut group, &checked, &signals).environment()?;
    drop(group);
    let made = report::make(&run_dir.folder);
    conclude(ending, made, &run_dir.folder)
}

/// How a supervised run ended.
#[derive(Debug)]
struct Ending {
    last: Option<Feedback>,
    deaths: Vec<Death>,
    interruptions: u32,
    axes: Vec<String>,
}

fn supervise(group: &mut Group, checked: &Checked, signals: &Signals) -> anyhow::Result<Ending> {
    let mut progress = Progress::new(
        group.bus.feedback_reader(1)?,
        group.bus.planner_reader(1)?,
        checked.machine.scan_period_s(),
    );
    let operator = group.bus.operator_client()?;
    let mut deaths: Vec<Death> = Vec::new();
    let mut stopping: Option<Instant> = None;
    let mut interruptions = 0;
    let path = checked
        .program
        .as_ref()
        .map(|p| p.path.clone())
        .unwrap_or_default();
    while group.lives(Job::Machine) {
        wait(group, signals);
        progress.look(&path);
        for death in group.reap() {
            if !death.status.success() {
                tracing::error!("{} {}", death.name, death.words());
            }
            deaths.push(death);
        }
        interruptions = signals.count();
        let planner_lost = !group.lives(Job::Planner) && group.lives(Job::Machine);
        if (interruptions > 0 || planner_lost) && stopping.is_none() {
            let order = OperatorRequest {
                order: Order::Stop as u32,
                ..OperatorRequest::default()
            };
            if operator.send(order).is_some() {
                stopping = Some(Instant::now());
            }
            group.page.machine_bell().ring();
            if interruptions > 0 {
                tracing::info!(
                    "interrupted: the tool comes to rest on the path (Ctrl-C again stops at once)"
                );
            }
        }
        if interruptions > 1 {
            tracing::warn!("stopped at once");
            break;
        }
    }
    if interruptions > 1 {
        deaths.extend(group.kill());
    } else {
        if !deaths
            .iter()
            .all(|d| d.job != Job::Machine || d.status.success())
        {
            group.page.set_phase(bus::page::CellPhase::Ending);
        }
        deaths.extend(group.wait_until_left());
    }
    progress.look(&path);
    progress.finish();
    Ok(Ending {
        last: progress.newest().copied(),
        deaths,
        interruptions,
        axes: checked
            .machine
            .axes
            .iter()
            .map(|a| a.name.clone())
            .collect(),
    })
}

/// Sleeps until a process ends, a signal comes or it is time to look.
fn wait(group: &Group, signals: &Signals) {
    let signal = signals.descriptor();
    let mut fds: Vec<PollFd<'_>> = group
        .descriptors()
        .map(|fd| PollFd::new(fd, PollFlags::IN))
        .collect();
    fds.push(PollFd::from_borrowed_fd(signal, PollFlags::IN));
    let limit = Timespec {
        tv_sec: 0,
        tv_nsec: i64::from(LOOK_EVERY.subsec_nanos()),
    };
    let _ = poll(&mut fds, Some(&limit));
}

fn conclude(ending: Ending, made: anyhow::Result<String>, folder: &Path) -> Outcome {
    match &made {
        Ok(text) => {
            println!("{text}");
            println!("Run directory: {}", folder.display());
        }
        Err(error) => tracing::error!("no report could be made of {}: {error:#}", folder.display()),
    }
    if let Some(death) = ending.deaths.iter().find(|d| !d.status.success())
        && ending.interruptions == 0
    {
        if death.status.code() == Some(3) {
            return Err(Failure::Environment(anyhow!(
                "{} could not go on",
                death.name
            )));
        }
        let end = ending.last.as_ref().map_or(String::new(), |f| {
            format!(": {}", stop_words(f, &ending.axes))
        });
        return Err(Failure::Stopped(anyhow!(
            "{} {}{end}",
            death.name,
            death.words()
        )));
    }
    if ending.interruptions > 0 {
        return Err(Failure::Interrupted);
    }
    let last = ending
        .last
        .ok_or_else(|| Failure::Environment(anyhow!("no scan ever ran")))?;
    match Mode::from_wire(last.mode) {
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
    println!("cell {}: {} files removed", options.cell, cell.leftovers);
    Ok(())
}

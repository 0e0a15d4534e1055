//! `quadrant check` and `quadrant plan`: everything that can be known before anything starts.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::ControlFlow;
use std::path::Path;

use anyhow::{Context, bail};
use control::totals::{ProgramWalk, Totals};
use control::window::{PlannedSetpoint, WindowPlanner};
use machine::{Machine, machine_file};
use plant_sim::plant_file::PlantFile;
use program::Program;

use crate::exit::{Failure, Kind, Outcome};
use crate::logs;
use crate::options::{CheckOptions, PlanOptions};
use crate::output::say;

/// What was checked.
#[derive(Debug)]
pub struct Checked {
    /// The machine.
    pub machine: Machine,
    /// The simulated machine.
    pub plant: PlantFile,
    /// The program, expanded from where the simulated machine is at the start.
    pub program: Option<Program>,
}

/// Reads and checks machine, plant and program.
///
/// # Errors
/// Whatever is wrong with them, for people.
pub fn load(machine: &Path, program: Option<&Path>) -> anyhow::Result<Checked> {
    let path = machine_file(machine);
    let machine = Machine::load(&path)?;
    let plant_path = path.with_file_name("plant.toml");
    let plant = PlantFile::load(&plant_path)?;
    let start = plant
        .start(&machine)
        .with_context(|| format!("{} and {}", path.display(), plant_path.display()))?;
    let limits = planner::motion_limits(&machine);
    limits.with_context(|| path.display().to_string())?;
    program::tool_at(&machine, &start).with_context(|| plant_path.display().to_string())?;
    let program = program
        .map(|file| program::load_from(&machine, &start, file))
        .transpose()?;
    let checked = Checked {
        machine,
        plant,
        program,
    };
    if checked.program.is_some() {
        checked.planner()?;
    }
    Ok(checked)
}

impl Checked {
    /// A planner of windows along the program.
    ///
    /// # Errors
    /// The path cannot be planned within the limits.
    pub fn planner(&self) -> anyhow::Result<WindowPlanner> {
        let Some(program) = &self.program else {
            bail!("no program was named");
        };
        let course = planner::course(&self.machine, program.clone());
        let (windows, _) = course.with_context(|| program.name.clone())?;
        Ok(windows)
    }

    /// Plans the whole program as the planner process would, window by window.
    ///
    /// # Errors
    /// As [`Checked::planner`].
    pub fn walk(
        &self,
        each: impl FnMut(&PlannedSetpoint) -> ControlFlow<()>,
    ) -> anyhow::Result<Totals> {
        let walk = ProgramWalk {
            feed_override: 1.0,
            setpoints_per_window: self.machine.scan.interpolation_period_scans,
        };
        let totals = walk.walk(&mut self.planner()?, each)?;
        if let Some(fault) = &totals.fault {
            bail!("the plan breaks its own limits: {fault}; this is a defect of quadrant");
        }
        Ok(totals)
    }
}

/// `quadrant check`.
pub fn check(options: &CheckOptions) -> Outcome {
    logs::init_launcher();
    let checked = load(&options.machine, options.program.as_deref()).input()?;
    let machine = &checked.machine;
    say(&format!(
        "machine {}: {} axes ({}), scan {} µs, interpolation period {} scans: good",
        machine.name,
        machine.axes.len(),
        machine
            .axes
            .iter()
            .map(|axis| axis.name.as_str())
            .collect::<Vec<_>>()
            .join(" "),
        machine.scan.period_us,
        machine.scan.interpolation_period_scans
    ));
    note_dead_time(&checked);
    if checked.program.is_some() {
        let totals = checked.walk(|_| ControlFlow::Continue(())).input()?;
        print_totals(&checked, &totals);
    }
    Ok(())
}

/// A simulated machine with another dead time than the controller reckons with is a test of robustness, or a mistake.
fn note_dead_time(checked: &Checked) {
    let reckoned = checked.machine.scan.dead_time_scans;
    let simulated = checked.plant.drive.dead_time_scans;
    if reckoned != simulated {
        say(&format!(
            "  dead time: the controller reckons with {reckoned} scans ([scan] dead_time_scans), the simulated drives have {simulated} \
             ([drive] dead_time_scans in plant.toml)"
        ));
    }
}

/// `quadrant plan`.
pub fn plan(options: &PlanOptions) -> Outcome {
    logs::init_launcher();
    let checked = load(&options.machine, Some(&options.program)).input()?;
    let totals = match &options.csv {
        Some(file) => write_csv(&checked, file)?,
        None => checked.walk(|_| ControlFlow::Continue(())).input()?,
    };
    print_totals(&checked, &totals);
    Ok(())
}

fn write_csv(checked: &Checked, file: &Path) -> Result<Totals, Failure> {
    let named = || format!("{}: cannot be written", file.display());
    let program = checked.program.as_ref();
    let mut out = BufWriter::new(File::create(file).with_context(named).environment()?);
    let axes = &checked.machine.axes;
    let columns: Vec<String> = axes
        .iter()
        .map(|a| format!("{}_{}", a.name.to_lowercase(), a.kind.unit()))
        .collect();
    writeln!(
        out,
        "scan,line,element,distance_mm,path_velocity_mm_s,{}",
        columns.join(",")
    )
    .with_context(named)
    .environment()?;
    let mut scan = 0u64;
    let mut result = Ok(());
    let totals = checked
        .walk(|setpoint| {
            let state = &setpoint.state;
            let line = program
                .and_then(|p| p.path.line_of(state.element as usize))
                .unwrap_or(0);
            result = write!(
                out,
                "{scan},{line},{},{:.9},{:.6}",
                state.element, state.distance_mm, state.speed_mm_s
            )
            .and_then(|()| {
                for (axis, position) in axes.iter().zip(setpoint.position_increments) {
                    write!(out, ",{:.6}", position as f64 * axis.increment_mm())?;
                }
                writeln!(out)
            });
            scan += 1;
            if result.is_ok() {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            }
        })
        .input()?;
    result
        .and_then(|()| out.flush())
        .with_context(named)
        .environment()?;
    Ok(totals)
}

fn print_totals(checked: &Checked, totals: &Totals) {
    let Some(program) = &checked.program else {
        return;
    };
    say(&format!(
        "program {}: {} elements, {:.3} mm, {:.3} s, {} setpoints: good",
        program.name,
        program.path.elements.len(),
        totals.distance_mm,
        totals.time_s,
        totals.setpoints
    ));
    for (index, axis) in checked.machine.axes.iter().enumerate() {
        let unit = axis.kind.unit();
        let share = |shares: &[f64]| shares.get(index).copied().unwrap_or(0.0) * 100.0;
        say(&format!(
            "  axis {}: at most {:5.1} % of {} {unit}/s, {:5.1} % of {} {unit}/s²",
            axis.name,
            share(&totals.shares.velocity),
            axis.rapid_mm_s,
            share(&totals.shares.acceleration),
            axis.acceleration_mm_s2
        ));
    }
    print_rapids(checked);
    if let Some(speed_mm_s) = totals.speed_limited_by_window_mm_s {
        say(&format!(
            "  path speed limited to {speed_mm_s:.1} mm/s: braking from more does not fit a window"
        ));
    }
    let acts = |event: &&program::Event| planner::acts_on(&checked.machine, &event.kind);
    if let Some(event) = program.events.iter().find(|event| !acts(event)) {
        say(&format!(
            "  line {}: S and M3 to M5 are read and not acted on: no spindle is driven",
            event.line
        ));
    }
    for note in &program.notes {
        say(&format!("  {}", note.shown()));
    }
}

/// The rapids that are travelled at least heat, and how near they take the motors to their rating.
fn print_rapids(checked: &Checked) {
    let Ok(planner) = checked.planner() else {
        return;
    };
    let moves = planner.speed_map().moves();
    if moves.is_empty() {
        return;
    }
    let of_axes = checked
        .machine
        .axes
        .iter()
        .enumerate()
        .map(|(index, axis)| {
            let shares = moves.iter().filter_map(|of| of.rms_share.get(index));
            let most = shares.copied().fold(0.0, f64::max);
            format!("{} {:.1} %", axis.name, most * 100.0)
        });
    let of_axes: Vec<String> = of_axes.collect();
    say(&format!(
        "  {} rapids at least heat: motors at most at {} of their continuous rating",
        moves.len(),
        of_axes.join(", ")
    ));
}

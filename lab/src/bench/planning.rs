//! `quadrant-lab bench planning`: how many blocks a second are planned on one core, and what a window takes of its period.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, anyhow};
use bus::sample::PATH_AXES;
use hdrhistogram::Histogram;
use machine::{Machine, machine_file};
use path::window::WindowPlanner;
use planner::ProgramText;
use plant_sim::plant_file::PlantFile;
use program::{Piece, Progress, Reading, Setup};

use super::figures::Figures;
use super::runs;
use super::windows::Windows;
use crate::faceted;
use crate::options::PlanningOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;

/// Times that each program is read and planned; the fastest counts: whatever else the PC does takes time, nothing gives any.
const ROUNDS: usize = 5;
/// Programs of more elements are planned, but their windows are not: for these a path is held whole.
const WINDOWS_ELEMENTS_MAX: u64 = 500_000;
/// The most windows of a program that are made.
const WINDOWS_MAX: u64 = 50_000;
/// Lines that are read at a time.
const LINES_AT_A_TIME: usize = 256;
/// Longest time that a window is told from a longer one, in ns.
const LONGEST_NS: u64 = 10_000_000_000;

/// Reads and plans programs, on one core.
///
/// # Errors
/// A machine or a program that is wrong.
pub fn planning(options: &PlanningOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let path = machine_file(&options.machine);
    let machine = Machine::load(&path).input()?;
    let plant = PlantFile::load(&path.with_file_name("plant.toml")).input()?;
    let start = plant.start(&machine).input()?;
    let scratch = runs::scratch().environment()?;
    let mut programs = options.programs.clone();
    if programs.is_empty() {
        let file = scratch.path().join("faceted.ngc");
        std::fs::write(&file, faceted::program(0.05, 0.001, "G64 P0.01", 3)).environment()?;
        programs.push(file);
    }
    let period_us = f64::from(machine.scan.period_us * machine.scan.interpolation_period_scans);
    say(&format!(
        "planning on {}, one core, fastest of {ROUNDS} rounds; a window's period is {period_us} µs, a scan's {} µs",
        machine.name, machine.scan.period_us
    ));
    say(
        "    elements   read/s (floor)   planned/s   ratio |  windows    mean     99 %   worst µs | worst of a period",
    );
    for program in &programs {
        if signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        let measured = measure(&machine, start, program);
        let measured = measured.with_context(|| program.display().to_string());
        let measured = measured.input()?;
        say(&measured.line(program, period_us));
        measured.note(period_us, figures);
    }
    Ok(())
}

/// The grain of the clock, in s: no time is shorter.
const CLOCK_S: f64 = 1e-9;

/// What became of one program.
struct Measured {
    elements: u64,
    reading_s: f64,
    planning_s: f64,
    windows: Option<Histogram<u64>>,
}

impl Measured {
    fn note(&self, period_us: f64, figures: &mut Figures) {
        let per_s = |seconds: f64| self.elements as f64 / seconds;
        figures.add(
            "planning",
            "blocks planned a second",
            per_s(self.planning_s),
            "1/s",
        );
        figures.beside("blocks read", per_s(self.reading_s));
        if let Some(windows) = &self.windows {
            figures.add(
                "planning",
                "longest window",
                windows.max() as f64 * 1e-3,
                "µs",
            );
            figures.beside("its period", period_us);
        }
    }

    fn line(&self, program: &Path, period_us: f64) -> String {
        let per_s = |seconds: f64| self.elements as f64 / seconds;
        let windows = self.windows.as_ref().map_or(String::new(), |windows| {
            let us = |ns: u64| ns as f64 * 1e-3;
            format!(
                "{:9} {:7.1} {:8.1} {:10.1} | {:.1} %",
                windows.len(),
                windows.mean() * 1e-3,
                us(windows.value_at_quantile(0.99)),
                us(windows.max()),
                100.0 * us(windows.max()) / period_us
            )
        });
        format!(
            "{:12} {:16.0} {:11.0} {:7.2} |{windows}  {}",
            self.elements,
            per_s(self.reading_s),
            per_s(self.planning_s),
            self.planning_s / self.reading_s,
            program.display()
        )
    }
}

fn measure(machine: &Machine, start: [i64; PATH_AXES], file: &Path) -> anyhow::Result<Measured> {
    let text = ProgramText::File(file.to_path_buf());
    let (mut reading_s, mut together_s, mut elements) = (f64::INFINITY, f64::INFINITY, 0);
    for _ in 0..ROUNDS {
        let began = Instant::now();
        read(machine, &start, file)?;
        reading_s = reading_s.min(began.elapsed().as_secs_f64());
        let began = Instant::now();
        let survey = planner::survey(machine, &text, start, u64::MAX, |_| ())?;
        together_s = together_s.min(began.elapsed().as_secs_f64());
        elements = survey.elements;
    }
    let windows = if elements <= WINDOWS_ELEMENTS_MAX {
        let program = program::load_from(machine, &start, file, &[])?;
        let (mut planner, _) = planner::course(machine, program)?;
        Some(windows(machine, &mut planner)?)
    } else {
        None
    };
    Ok(Measured {
        elements,
        reading_s,
        // On a busy PC reading alone may have taken longer.
        planning_s: (together_s - reading_s).max(CLOCK_S),
        windows,
    })
}

/// Reads a program to its end and forgets it.
fn read(machine: &Machine, start: &[i64], file: &Path) -> anyhow::Result<()> {
    let tool = program::tool_at(machine, start)?;
    let setup = Setup {
        rehearsed: true,
        ..Setup::of(machine)
    };
    let mut reading = Reading::open(file, &Arc::new(setup), tool)?;
    let mut piece = Piece::default();
    while let Progress::More = reading.read(LINES_AT_A_TIME, &mut piece)? {
        piece = Piece::default();
    }
    Ok(())
}

/// How long each window of a program takes, in ns.
fn windows(machine: &Machine, planner: &mut WindowPlanner) -> anyhow::Result<Histogram<u64>> {
    let mut times_ns = Histogram::new_with_max(LONGEST_NS, 3)?;
    let mut windows = Windows::new(machine, planner);
    while times_ns.len() < WINDOWS_MAX {
        if !windows.go_on()? {
            break;
        }
        let began = Instant::now();
        windows.plan()?;
        times_ns.saturating_record(began.elapsed().as_nanos() as u64);
    }
    if times_ns.is_empty() {
        return Err(anyhow!("no window"));
    }
    Ok(times_ns)
}

//! `quadrant-lab bench circles`: quadrant protrusions on a grid of radii and feeds, for each way of compensating them.

mod comparison;
mod measured;
pub(crate) mod methods;

use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::{Context, anyhow};
use machine::{Machine, machine_file};

use self::comparison::{Comparison, MethodPoints, Point};
use self::measured::{Condition, Line, Measured, csv};
use self::methods::{METHODS, Method, NEVER_WORSE_UM, REFERENCE};
use super::figures::Figures;
use super::lanes::in_order;
use super::progress::progress_bar;
use super::runs::{self, Runs};
use crate::options::CirclesOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;
use launcher::check;

/// Everything that is to be run, checked before anything starts.
struct Bench {
    machine: Machine,
    /// Circles that methods learn from before the grid.
    training: PathBuf,
    methods: Vec<(&'static Method, PathBuf)>,
    conditions: Vec<(Condition, PathBuf)>,
}

/// Measures the grid, prints the table and writes CSV and plot where asked to.
pub fn circles(options: &CirclesOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let scratch = runs::scratch().environment()?;
    let bench = Bench::prepare(options, scratch.path()).input()?;
    if let Some(out) = &options.out {
        let named = || format!("{}: cannot be made", out.display());
        fs::create_dir_all(out).with_context(named).environment()?;
    }
    let runs = Runs {
        scratch: &scratch,
        signals: &signals,
    };
    bench.teach(&runs)?;
    let lines = bench.run(&runs, options)?;
    bench.print_summary(&lines);
    for line in &lines {
        let Condition {
            radius_mm,
            feed_mm_min,
        } = line.condition;
        let what = format!(
            "R{radius_mm} F{feed_mm_min}, {}, worst reversal",
            line.method
        );
        figures.add("circles", what, line.measured.worst_um(), "µm");
    }
    if let Some(out) = &options.out {
        let file = out.join("circles.csv");
        let named = || format!("{}: cannot be written", file.display());
        fs::write(&file, csv(&bench.machine.name, &lines))
            .with_context(named)
            .environment()?;
        let plot = out.join("circles.svg");
        comparison::draw(&plot, &bench.comparison(&lines)).environment()?;
        say(&format!("{} and {}", file.display(), plot.display()));
    }
    Ok(())
}

impl Bench {
    /// Writes machine files and programs and checks them all.
    fn prepare(options: &CirclesOptions, folder: &Path) -> anyhow::Result<Bench> {
        let machine = Machine::load(&options.machine)?;
        let has_model = machine
            .axes
            .iter()
            .all(|axis| axis.model.is_some_and(|model| model.table.is_some()));
        let names: Vec<&str> = if options.methods.is_empty() {
            if !has_model {
                say("methods that need [axis.model] are left out: `quadrant tune` identifies it");
            }
            let usable = METHODS.iter().filter(|m| has_model || !m.needs_model);
            usable.map(|method| method.name).collect()
        } else {
            options.methods.iter().map(String::as_str).collect()
        };
        let mut methods: Vec<(&'static Method, PathBuf)> = Vec::new();
        for name in names {
            let method = Method::of(name).with_context(|| format!("no method {name:?}"))?;
            if methods.iter().all(|(other, _)| other.name != name) {
                let variant = variant(&options.machine, &folder.join(name), method)?;
                methods.push((method, variant));
            }
        }
        let mut conditions: Vec<(Condition, PathBuf)> = Vec::new();
        for &radius_mm in &options.radii {
            for &feed_mm_min in &options.feeds {
                let condition = Condition {
                    radius_mm,
                    feed_mm_min,
                };
                if conditions.iter().any(|(other, _)| *other == condition) {
                    continue;
                }
                within_limits(&machine, condition)?;
                let program = folder.join(format!("r{radius_mm}-f{feed_mm_min}.ngc"));
                fs::write(&program, circle(condition, options))
                    .with_context(|| program.display().to_string())?;
                check::load(&options.machine, Some(&program), check::Depth::Whole)
                    .with_context(|| format!("R{radius_mm} F{feed_mm_min}"))?;
                conditions.push((condition, program));
            }
        }
        for (method, variant) in &methods {
            check::load(variant, None, check::Depth::Whole)
                .with_context(|| format!("method {}", method.name))?;
        }
        let training = folder.join("training.ngc");
        fs::write(&training, circles_to_learn_from(&conditions, options))
            .with_context(|| training.display().to_string())?;
        Ok(Bench {
            machine,
            training,
            methods,
            conditions,
        })
    }

    /// Lets the methods that learn learn, from a few circles of the grid.
    fn teach(&self, runs: &Runs) -> Result<(), Failure> {
        for (method, machine) in &self.methods {
            for _ in 0..method.passes {
                runs.learn(machine, &self.training)?;
            }
        }
        Ok(())
    }

    /// Runs everything, condition by condition, printing each row of the table once it is whole.
    fn run(&self, runs: &Runs, options: &CirclesOptions) -> Result<Vec<Line>, Failure> {
        say(&format!(
            "worst protrusion or undercut on the table, µm; {}, cw and ccw, two turns each, from {}°",
            options.machine.display(),
            options.start_deg
        ));
        self.print_head();
        let count = self.methods.len();
        let total = count * self.conditions.len();
        let bar = progress_bar(total as u64);
        let lanes = (options.jobs as usize).min(total);
        let mut lines = Vec::new();
        let work = |index: usize, lane: usize, _: &AtomicBool| {
            if lanes > 1 {
                stay_on_one(lane);
            }
            self.one(runs, index, lane)
        };
        let done = |found: &[Measured]| {
            bar.inc(1);
            let done = lines.len() / count;
            while let Some(row) = self.row(lines.len() / count, found) {
                bar.suspend(|| self.print_row(&row));
                lines.extend(row);
            }
            let at = self.conditions.get(done);
            bar.set_message(at.map_or(String::new(), |(c, _)| {
                format!("R{} F{}", c.radius_mm, c.feed_mm_min)
            }));
        };
        let ended = in_order(lanes, total, work, done);
        bar.finish_and_clear();
        ended.map(|_| lines)
    }

    /// One run of the grid.
    fn one(&self, runs: &Runs, index: usize, lane: usize) -> Result<Measured, Failure> {
        let count = self.methods.len();
        let place = self
            .methods
            .get(index % count)
            .zip(self.conditions.get(index / count));
        let ((method, machine), (condition, program)) =
            place.context("a run outside the grid").environment()?;
        let named = |error: anyhow::Error| {
            error.context(format!(
                "{} at R{} F{}",
                method.name, condition.radius_mm, condition.feed_mm_min
            ))
        };
        let report = runs
            .report(machine, program, lane)
            .map_err(|failure| match failure {
                Failure::Stopped(error) => Failure::Stopped(named(error)),
                Failure::Environment(error) => Failure::Environment(named(error)),
                other => other,
            })?;
        Measured::of(&report).map_err(named).environment()
    }

    /// All methods at one condition, once all are there.
    fn row(&self, condition_index: usize, found: &[Measured]) -> Option<Vec<Line>> {
        let count = self.methods.len();
        let (condition, _) = self.conditions.get(condition_index)?;
        let found = found.get(condition_index * count..(condition_index + 1) * count)?;
        let mut lines = Vec::new();
        for ((method, _), measured) in self.methods.iter().zip(found) {
            lines.push(Line {
                method: method.name,
                condition: *condition,
                measured: measured.clone(),
                worse_um: None,
            });
        }
        let reference = lines.iter().find(|line| line.method == REFERENCE);
        if let Some(reference_um) = reference.map(|line| line.measured.worst_um()) {
            for line in lines
                .iter_mut()
                .filter(|line| !["none", REFERENCE].contains(&line.method))
            {
                line.worse_um = Some(line.measured.worst_um() - reference_um);
            }
        }
        Some(lines)
    }

    fn print_head(&self) {
        let words: Vec<Vec<&str>> = self
            .methods
            .iter()
            .map(|(method, _)| method.name.split('-').collect())
            .collect();
        let tall = words.iter().map(Vec::len).max().unwrap_or(1);
        for level in 0..tall {
            let first = if level + 1 == tall {
                "  radius feed"
            } else {
                ""
            };
            let cells = words.iter().map(|words| {
                let missing = tall - words.len();
                let word = level.checked_sub(missing).and_then(|i| words.get(i));
                format!("{:>14}", word.copied().unwrap_or(""))
            });
            say(format!("{first:<17}{}", cells.collect::<String>()).trim_end());
        }
    }

    fn print_row(&self, row: &[Line]) {
        let Some(first) = row.first() else { return };
        let Condition {
            radius_mm,
            feed_mm_min,
        } = first.condition;
        let cells = row.iter().map(|line| {
            let mark = if is_worse(line) { '!' } else { ' ' };
            format!("{:>13.1}{mark}", line.measured.worst_um())
        });
        let name = format!("  R{radius_mm:<6} F{feed_mm_min:<7}");
        say(format!("{name:<17}{}", cells.collect::<String>()).trim_end());
    }

    fn print_summary(&self, lines: &[Line]) {
        let of = |name: &str| -> Vec<&Line> {
            lines.iter().filter(|line| line.method == name).collect()
        };
        let mean = |name: &str| {
            let of = of(name);
            of.iter().map(|l| l.measured.worst_um()).sum::<f64>() / of.len().max(1) as f64
        };
        let worst = |name: &str| {
            of(name)
                .iter()
                .map(|l| l.measured.worst_um())
                .fold(0.0, f64::max)
        };
        let uncompensated = mean("none");
        let row = |title: &str, cell: &dyn Fn(&str) -> String| {
            let cells = self
                .methods
                .iter()
                .map(|(method, _)| format!("{:>13} ", cell(method.name)));
            say(format!("  {title:<15}{}", cells.collect::<String>()).trim_end());
        };
        row("mean", &|name| format!("{:.1}", mean(name)));
        row("worst", &|name| format!("{:.1}", worst(name)));
        if uncompensated > 0.0 {
            row("mean/none", &|name| {
                format!("{:+.0} %", (mean(name) / uncompensated - 1.0) * 100.0)
            });
        }
        let harm: Vec<String> = lines
            .iter()
            .filter(|line| is_worse(line))
            .map(|line| {
                format!(
                    "{} at R{} F{} by {:.1} µm",
                    line.method,
                    line.condition.radius_mm,
                    line.condition.feed_mm_min,
                    line.worse_um.unwrap_or(0.0)
                )
            })
            .collect();
        if !self.methods.iter().any(|(m, _)| m.name == REFERENCE) {
            say(&format!(
                "  never worse than {REFERENCE}: not judged, {REFERENCE} was not run"
            ));
        } else if harm.is_empty() {
            say(&format!(
                "  never worse than {REFERENCE} by more than {NEVER_WORSE_UM} µm: kept everywhere"
            ));
        } else {
            say(&format!(
                "  ! worse than {REFERENCE} by more than {NEVER_WORSE_UM} µm: {}",
                harm.join(", ")
            ));
        }
    }

    /// What the plot shows.
    fn comparison(&self, lines: &[Line]) -> Comparison {
        let point = |line: &Line| Point {
            radius_mm: line.condition.radius_mm,
            feed_mm_min: line.condition.feed_mm_min,
            protrusion_um: line.measured.protrusion_um(),
            undercut_um: line.measured.undercut_um(),
            harms: is_worse(line),
        };
        Comparison {
            title: format!("Quadrant errors of {}", self.machine.name),
            methods: self
                .methods
                .iter()
                .map(|(method, _)| MethodPoints {
                    name: method.name.into(),
                    points: lines
                        .iter()
                        .filter(|line| line.method == method.name)
                        .map(point)
                        .collect(),
                })
                .collect(),
        }
    }
}

fn is_worse(line: &Line) -> bool {
    line.worse_um.is_some_and(|um| um > NEVER_WORSE_UM)
}

/// Keeps this thread, and the runs it starts, on one of the processors.
fn stay_on_one(lane: usize) {
    let processors = bus::realtime::processors();
    if let Some(&processor) = processors.get(lane % processors.len().max(1)) {
        bus::realtime::stay_on_all(&[processor]);
    }
}

/// A circle faster than the machine may be would be run slower, and compared as what it is not.
fn within_limits(machine: &Machine, condition: Condition) -> anyhow::Result<()> {
    let Condition {
        radius_mm,
        feed_mm_min,
    } = condition;
    let speed_mm_s = feed_mm_min / 60.0;
    let acceleration_mm_s2 = speed_mm_s * speed_mm_s / radius_mm;
    for axis in machine
        .axes
        .iter()
        .filter(|a| ["X", "Y"].contains(&a.name.as_str()))
    {
        if speed_mm_s > axis.rapid_mm_s {
            return Err(anyhow!(
                "R{radius_mm} F{feed_mm_min}: {speed_mm_s:.1} mm/s: axis {} goes at most {} mm/s",
                axis.name,
                axis.rapid_mm_s
            ));
        }
        if acceleration_mm_s2 > axis.acceleration_mm_s2 {
            return Err(anyhow!(
                "R{radius_mm} F{feed_mm_min}: v²/R = {acceleration_mm_s2:.0} mm/s²: axis {} accelerates with at most {} mm/s²",
                axis.name,
                axis.acceleration_mm_s2
            ));
        }
    }
    Ok(())
}

/// A copy of the machine whose axes compensate by `method`.
fn variant(machine: &Path, folder: &Path, method: &Method) -> anyhow::Result<PathBuf> {
    let file = machine_file(machine);
    let named = || file.display().to_string();
    let text = machine::snapshot(&file).with_context(named)?;
    let changed = method
        .apply(&text)
        .with_context(|| format!("{}: method {}", file.display(), method.name))?;
    fs::create_dir_all(folder)?;
    fs::write(folder.join("machine.toml"), changed)?;
    let plant = file.with_file_name("plant.toml");
    fs::copy(&plant, folder.join("plant.toml")).with_context(|| plant.display().to_string())?;
    Ok(folder.to_path_buf())
}

/// A circle from the middle, one from the end and one from the beginning of the grid, one after the other.
fn circles_to_learn_from(conditions: &[(Condition, PathBuf)], options: &CirclesOptions) -> String {
    let last = conditions.len().saturating_sub(1);
    let chosen = [last / 2, last, 0]
        .into_iter()
        .filter_map(|at| conditions.get(at));
    let circles: String = chosen
        .map(|(condition, _)| circle(*condition, options).replace("M2\n", ""))
        .collect();
    circles + "M2\n"
}

/// Two turns counter-clockwise, two clockwise.
fn circle(condition: Condition, options: &CirclesOptions) -> String {
    let Condition {
        radius_mm,
        feed_mm_min,
    } = condition;
    let angle = options.start_deg * PI / 180.0;
    let (i, j) = (-radius_mm * libm::cos(angle), -radius_mm * libm::sin(angle));
    let (x, y) = (options.centre.0 - i, options.centre.1 - j);
    let turns = |g: &str| format!("{g} X{x:.6} Y{y:.6} I{i:.6} J{j:.6} F{feed_mm_min}\n").repeat(2);
    format!(
        "G21 G17 G90 G94\nG0 X{x:.6} Y{y:.6}\nG4 P0.2\n{}G4 P0.2\n{}G4 P0.2\nM2\n",
        turns("G3"),
        turns("G2")
    )
}

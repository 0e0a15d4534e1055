//! `quadrant plan`: how long a program takes, where its time goes, and its setpoints.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::time_use::{TimeTable, TimeUse};
use anyhow::{Context, anyhow};
use audit::Totals;
use path::path_part::PathPart;
use path::window::{PlannedSetpoint, WindowPlanner};

use crate::check::print_totals;
use crate::options::PlanOptions;
use crate::walk::{walk, walk_long};
use console::exit::{Failure, Kind, Outcome};
use console::logs;
use console::output::say;
use launcher::check::{self, Checked, Depth};
use program::SHORT_ELEMENTS;

use long_dwells::LongDwells;
use picture::Picture;
use what_if::WhatIf;

mod long_dwells;
mod picture;
mod table;
mod what_if;

/// `quadrant plan`.
pub fn plan(options: &PlanOptions) -> Outcome {
    logs::init_launcher();
    let what_if = WhatIf::of(&options.what_if).input()?;
    let dialect = options.of_program.dialect;
    let program = Some(options.program.as_path());
    let checked = check::load_in(&options.machine, program, Depth::Beginning, dialect).input()?;
    if checked.long.is_some() && (options.blocks.is_some() || options.svg.is_some()) {
        let what = format!(
            "{}: has more than {SHORT_ELEMENTS} elements: --blocks and --svg are for shorter ones; --csv writes every scan of it",
            options.program.display()
        );
        return Err(anyhow!(what)).input();
    }
    let (totals, table) = plan_as_is(&checked, options)?;
    say_all(&checked, &totals, table.as_ref());
    if options.what_if.is_empty() {
        return Ok(());
    }
    let mut changed = check::load_changed(
        &options.machine,
        Some(&options.program),
        Depth::Beginning,
        |machine| {
            machine.program.dialect = dialect.unwrap_or(machine.program.dialect);
            what_if.apply(machine)
        },
    )
    .input()?;
    if let Some(program) = &mut changed.program {
        what_if.apply_to_path(program);
    }
    let (of_changed, table) = time(&changed, &options.program, &mut |_, _| Ok(())).input()?;
    say(&format!(
        "what if {}: {:.3} s instead of {:.3} s, {:+.1} %",
        options.what_if.join(", "),
        of_changed.time_s,
        totals.time_s,
        (of_changed.time_s / totals.time_s - 1.0) * 100.0
    ));
    say_all(&changed, &of_changed, table.as_ref());
    Ok(())
}

/// What a program comes to, and where its time goes; of a long one the first alone.
fn say_all(checked: &Checked, totals: &Totals, table: Option<&TimeTable>) {
    print_totals(checked, totals);
    if let Some(table) = table {
        table::print(checked, table);
    }
}

/// Plans with the machine's own limits, and writes the files that are asked for.
fn plan_as_is(checked: &Checked, options: &PlanOptions) -> Result<Planned, Failure> {
    let mut csv = match &options.csv {
        Some(file) => Some(SetpointFile::create(checked, file)?),
        None => None,
    };
    let mut picture = options.svg.as_ref().map(|_| Picture::of(checked));
    let mut each = |path: &PathPart, setpoint: &PlannedSetpoint| {
        if let Some(picture) = &mut picture {
            picture.setpoint(setpoint);
        }
        match &mut csv {
            Some(csv) => csv.setpoint(path, setpoint),
            None => Ok(()),
        }
    };
    // Only a file has a row for each scan of a dwell.
    let each_scan = options.csv.is_some();
    let (totals, table) = match each_scan {
        true => time_scan_by_scan(checked, &options.program, &mut each).input()?,
        false => time(checked, &options.program, &mut each).input()?,
    };
    if let Some(csv) = csv {
        csv.finish()?;
    }
    if let (Some(file), Some(table)) = (&options.blocks, &table) {
        let named = || format!("{}: cannot be written", file.display());
        table::write_blocks(checked, table, file)
            .with_context(named)
            .environment()?;
    }
    if let (Some(file), Some(picture)) = (&options.svg, picture) {
        picture.draw(checked, &totals, file).environment()?;
    }
    Ok((totals, table))
}

/// What is done with each setpoint.
type Each<'a> = &'a mut dyn FnMut(&PathPart, &PlannedSetpoint) -> anyhow::Result<()>;
/// What a program comes to, and where its time goes; none of that of a long one.
type Planned = (Totals, Option<TimeTable>);

/// Plans a program, and finds where its time goes. However long its dwells are, they take no longer than a short one.
fn time(checked: &Checked, file: &Path, each: Each<'_>) -> anyhow::Result<Planned> {
    let Some(mut program) = checked.program.clone() else {
        return time_scan_by_scan(checked, file, each);
    };
    let period_s = checked.machine.scan_period_s();
    let dwells = LongDwells::shorten(&mut program, period_s);
    let windows = checked.planner_along(program)?;
    let (mut totals, mut table) = time_along(checked, windows, each)?;
    dwells.give_back(&mut totals, &mut table, period_s);
    Ok((totals, Some(table)))
}

/// The same with each scan of each dwell.
fn time_scan_by_scan(checked: &Checked, file: &Path, each: Each<'_>) -> anyhow::Result<Planned> {
    if checked.long.is_some() {
        let (totals, _) = walk_long(checked, file, each)?;
        return Ok((totals, None));
    }
    let (totals, table) = time_along(checked, checked.planner()?, each)?;
    Ok((totals, Some(table)))
}

fn time_along(
    checked: &Checked,
    mut windows: WindowPlanner,
    each: Each<'_>,
) -> anyhow::Result<(Totals, TimeTable)> {
    let mut time_use = TimeUse::new(windows.limits().clone());
    let totals = walk(checked, &mut windows, u64::MAX, |path, setpoint| {
        time_use.setpoint(path, setpoint);
        each(path, setpoint)
    })?;
    Ok((totals, time_use.finish(windows.path())))
}

/// The setpoints of every scan, as CSV.
struct SetpointFile<'a> {
    checked: &'a Checked,
    file: &'a Path,
    out: BufWriter<File>,
    scan: u64,
}

impl<'a> SetpointFile<'a> {
    fn create(checked: &'a Checked, file: &'a Path) -> Result<Self, Failure> {
        let named = || format!("{}: cannot be written", file.display());
        let mut out = BufWriter::new(File::create(file).with_context(named).environment()?);
        let axes = checked.machine.program_axes().iter();
        let columns: Vec<String> = axes
            .map(|a| format!("{}_{}", a.name.to_lowercase(), a.kind.unit()))
            .collect();
        let columns = columns.join(",");
        writeln!(
            out,
            "scan,line,element,distance_mm,path_velocity_mm_s,{columns}"
        )
        .with_context(named)
        .environment()?;
        Ok(Self {
            checked,
            file,
            out,
            scan: 0,
        })
    }

    fn setpoint(&mut self, path: &PathPart, setpoint: &PlannedSetpoint) -> anyhow::Result<()> {
        let state = &setpoint.state;
        let line = path.get(state.element).map_or(0, |element| element.line);
        let mut row = || -> std::io::Result<()> {
            write!(
                self.out,
                "{},{line},{},{:.9},{:.6}",
                self.scan, state.element, state.distance_mm, state.speed_mm_s
            )?;
            let axes = self.checked.machine.program_axes();
            for (axis, position) in axes.iter().zip(setpoint.position_increments) {
                write!(self.out, ",{:.6}", position as f64 * axis.increment_mm())?;
            }
            writeln!(self.out)
        };
        row().with_context(|| format!("{}: cannot be written", self.file.display()))?;
        self.scan += 1;
        Ok(())
    }

    fn finish(mut self) -> Result<(), Failure> {
        let named = || format!("{}: cannot be written", self.file.display());
        self.out.flush().with_context(named).environment()
    }
}

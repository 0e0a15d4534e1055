//! `quadrant check`: a machine and, if given, a program; starts nothing.

use crate::options::CheckOptions;
use crate::walk::{walk, walk_long};
use audit::Totals;
use console::exit::{Kind, Outcome};
use console::logs;
use console::output::say;
use launcher::check::{Checked, Depth, load_in};
use program::Program;

/// `check` plans so many setpoints one by one, in some tenths of a second; the time of what comes behind them follows from the speed map.
const JUDGED_SETPOINTS: u64 = 300_000;

/// `quadrant check`.
pub fn check(options: &CheckOptions) -> Outcome {
    logs::init_launcher();
    // A long program is read to its end as it is planned.
    let program = options.program.as_deref();
    let mut checked = load_in(
        &options.machine,
        program,
        Depth::Beginning,
        options.of_program.dialect,
    )
    .input()?;
    let mut of_long = None;
    if let (Some(_), Some(file)) = (&checked.long, program) {
        let (totals, survey) = walk_long(&checked, file, |_, _| Ok(())).input()?;
        (of_long, checked.long) = (Some(totals), Some(survey));
    }
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
    for (place, words) in &checked.places {
        say(&format!("  place {place} on the cable: {words}"));
    }
    for axis in 0..machine.axes.len() {
        if let Some(words) = machine.geometry_in_words(axis) {
            say(&format!("  {words}"));
        }
    }
    print_remarks(&checked);
    if checked.program.is_some() {
        let mut windows = checked.planner().input()?;
        let totals = walk(&checked, &mut windows, JUDGED_SETPOINTS, |_, _| Ok(())).input()?;
        print_totals(&checked, &totals);
    }
    if let Some(totals) = of_long {
        print_totals(&checked, &totals);
    }
    Ok(())
}

/// Says what of the machine was accepted with a remark.
fn print_remarks(checked: &Checked) {
    for remark in checked.remarks() {
        say(&format!("  {remark}"));
    }
    if checked.plant.is_none() {
        say(
            "  a program is checked from the machine's zero: where the axes are, the drives say when they are started",
        );
    }
}

/// Says what of the program was accepted with a remark.
fn print_notes(checked: &Checked) {
    for note in checked.notes() {
        say(&format!("  {note}"));
    }
}

/// Says what a planned program comes to.
pub fn print_totals(checked: &Checked, totals: &Totals) {
    let short = checked.program.as_ref().map(|program| &program.name);
    let long = checked.long.as_ref().map(|survey| &survey.name);
    let Some(name) = short.or(long) else {
        return;
    };
    say(&format!(
        "program {name}: {} elements, {:.3} mm, {:.3} s, {} setpoints: good",
        totals.elements, totals.distance_mm, totals.time_s, totals.setpoints
    ));
    for (index, axis) in checked.machine.program_axes().iter().enumerate() {
        let unit = axis.kind.unit();
        let share = |shares: &[f64]| shares.get(index).copied().unwrap_or(0.0) * 100.0;
        let jerk = axis.jerk_mm_s3.map_or(String::new(), |limit| {
            let share = share(&totals.shares.jerk);
            format!(", {share:5.1} % of {limit} {unit}/s³")
        });
        say(&format!(
            "  axis {}: at most {:5.1} % of {} {unit}/s, {:5.1} % of {} {unit}/s²{jerk}",
            axis.name,
            share(&totals.shares.velocity),
            axis.rapid_mm_s,
            share(&totals.shares.acceleration),
            axis.acceleration_mm_s2
        ));
    }
    if totals.judged_setpoints < totals.setpoints {
        say(&format!(
            "  (of the first {} setpoints; `quadrant plan` judges all)",
            totals.judged_setpoints
        ));
    }
    print_rapids(checked);
    if let Some(speed_mm_s) = totals.speed_limited_by_window_mm_s {
        say(&format!(
            "  path speed limited to {speed_mm_s:.1} mm/s: braking from more does not fit a window"
        ));
    }
    if let Some(speed_mm_s) = totals.speed_limited_by_look_ahead_mm_s {
        say(&format!(
            "  path speed limited to {speed_mm_s:.3} mm/s where blocks are shortest: no more of them are read ahead"
        ));
    }
    if let Some(program) = &checked.program {
        print_in_step(checked, program);
    }
    print_notes(checked);
}

/// What threads and taps need of their path and their speed.
fn print_in_step(checked: &Checked, program: &Program) {
    let Ok((windows, events)) = planner::course(&checked.machine, program.clone()) else {
        return;
    };
    for need in planner::needs_in_step(&checked.machine, &windows, &events.passes) {
        say(&format!("  {need}"));
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

//! `quadrant-lab bench simulation`: whole cells in this one process, and what of a scan is physics and what control.

use std::time::Instant;

use super::figures::Figures;
use super::scans::{Scans, Subject};
use crate::cell::InProcessCell;
use crate::options::{Part, SimulationOptions};
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;

/// Runs them, and each part by itself over the same scans.
///
/// # Errors
/// The machine or the program is wrong, or the program has fewer scans.
pub fn simulation(options: &SimulationOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let subject = Subject::load(&options.machine).input()?;
    let count = options.scans as usize;
    let scans = Scans::timed(&subject, count).input()?;
    let period = subject.machine.scan.interpolation_period_scans as usize;
    let mut whole_us = f64::INFINITY;
    let mut parts_us = [f64::INFINITY; Part::ALL.len()];
    for _ in 0..options.rounds {
        if signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        whole_us = whole_us.min(whole(&subject, count).environment()?);
        for (us, part) in parts_us.iter_mut().zip(Part::ALL) {
            let times = match part {
                Part::Planning => count / period.max(1),
                _ => count,
            };
            let took = scans.run(part, times).environment()?;
            *us = us.min(took.as_secs_f64() * 1e6 / count as f64);
        }
    }
    let [servo_us, master_us, physics_us, planning_us] = parts_us;
    let control_us = servo_us + master_us + planning_us;
    let axes = subject.machine.axes.len();
    say(&format!(
        "simulation: {} with {}, {count} scans of {axes} axes in this process, fastest of {} rounds",
        subject.machine.name,
        subject.program().0,
        options.rounds
    ));
    let period_us = f64::from(subject.machine.scan.period_us);
    say(&format!(
        "  whole cell     {whole_us:7.2} µs a scan   {:.0} scans/s, {:.0} x real time",
        1e6 / whole_us,
        period_us / whole_us
    ));
    say(&format!("  physics        {physics_us:7.2} µs"));
    say(&format!(
        "  control        {control_us:7.2} µs   servos {servo_us:.2}, master {master_us:.2}, planning {planning_us:.2}"
    ));
    say(&format!(
        "  the rest       {:7.2} µs   samples handed on, and what a part finds colder than by itself",
        whole_us - physics_us - control_us
    ));
    say(&format!(
        "  ratio          {:7.2}      to physics alone",
        whole_us / physics_us
    ));
    figures.add(
        "simulation",
        format!("a scan of {axes} axes in one process"),
        whole_us,
        "µs",
    );
    figures.beside("physics alone", physics_us);
    figures.add("simulation", "of it control", control_us, "µs");
    figures.add("simulation", "scans a second", 1e6 / whole_us, "1/s");
    figures.beside("physics alone", 1e6 / physics_us);
    Ok(())
}

/// A whole cell, in µs a scan.
fn whole(subject: &Subject, count: usize) -> anyhow::Result<f64> {
    let (name, text) = subject.program();
    let mut cell = InProcessCell::new(&subject.machine, &subject.plant, name, text)?;
    let began = Instant::now();
    let mut done = 0;
    while done < count && std::hint::black_box(cell.scan()).is_some() {
        done += 1;
    }
    Ok(began.elapsed().as_secs_f64() * 1e6 / done.max(1) as f64)
}

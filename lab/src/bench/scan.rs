//! `quadrant-lab bench scan`: instructions and time of the parts of a scan, each by itself, and whether the instructions are those that
//! are expected.

mod callgrind;
mod kept;

use std::time::Duration;

use anyhow::anyhow;

use super::figures::Figures;
use super::scans::{Scans, Subject};
use crate::options::{BenchScanPartOptions, Part, ScanOptions};
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;
use kept::Kept;

/// Rounds for the times; the fastest counts.
const ROUNDS: usize = 5;
/// Scans that are timed; as many before them are not.
const TIMED_SCANS: usize = 4000;
/// Windows that are timed.
const TIMED_WINDOWS: usize = 800;
/// Scans that are counted, behind as many that are not.
const COUNTED_SCANS: usize = 1000;
/// Windows that are counted, behind as many that are not.
const COUNTED_WINDOWS: usize = 400;
/// A count may be off by so much.
const TOLERANCE: f64 = 0.02;

/// What a part cost.
#[derive(Debug, Clone, Copy)]
struct Cost {
    part: Part,
    time_us: f64,
    /// None where they cannot be counted.
    instructions: Option<f64>,
}

/// Measures, and compares or renews what is kept where it is asked to.
///
/// # Errors
/// A part cannot be measured, or a count is off.
pub fn scan(options: &ScanOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let subject = Subject::load(&options.machine).input()?;
    let counter = callgrind::version();
    if counter.is_none() {
        say(callgrind::MISSING);
        if options.renew {
            return Err(anyhow!("nothing can be counted")).environment();
        }
    }
    let mut costs = Vec::new();
    let is_asked = |part: &Part| options.part.is_none_or(|only| only == *part);
    for part in Part::ALL.into_iter().filter(is_asked) {
        if signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        let instructions = match counter {
            Some(_) => Some(callgrind::instructions(options, &subject, part).environment()?),
            None => None,
        };
        costs.push(Cost {
            part,
            time_us: time_us(&subject, part).environment()?,
            instructions,
        });
    }
    print(&subject, &costs, figures);
    if options.renew {
        return Kept::of(&subject.machine.name, &costs)
            .write(&options.counts)
            .environment();
    }
    if counter.is_none() {
        return Ok(());
    }
    let kept = match Kept::read(&options.counts) {
        Ok(kept) => kept,
        // Nobody has asked for it.
        Err(_) if !options.check => return Ok(()),
        Err(error) => return Err(error).input(),
    };
    compare(options, &kept, &subject, &costs, figures)
}

/// The part alone, so often; for callgrind.
///
/// # Errors
/// It cannot be made.
pub fn part(options: &BenchScanPartOptions) -> Outcome {
    let subject = Subject::load(&options.machine).input()?;
    if options.part == Part::Planning {
        return subject.planning(options.times).environment().map(|_| ());
    }
    let scans = Scans::of(&subject, options.prepared).environment()?;
    scans.run(options.part, options.times).environment()?;
    Ok(())
}

/// Of one of them, in µs: what the second half of a run takes, and so without what is cold at its start.
fn time_us(subject: &Subject, part: Part) -> anyhow::Result<f64> {
    let counted = match part {
        Part::Planning => TIMED_WINDOWS,
        _ => TIMED_SCANS,
    };
    let prepared = match part {
        Part::Planning => 1,
        _ => 2 * counted,
    };
    let scans = Scans::timed(subject, prepared)?;
    let (mut half, mut all) = (Duration::MAX, Duration::MAX);
    for _ in 0..ROUNDS {
        half = half.min(scans.run(part, counted)?);
        all = all.min(scans.run(part, 2 * counted)?);
    }
    let of = counted * Scans::in_a_scan(&subject.machine, part);
    Ok(all.saturating_sub(half).as_secs_f64() * 1e6 / of as f64)
}

fn what(subject: &Subject, part: Part) -> String {
    match part {
        Part::Servo => "a servo's scan".into(),
        Part::Master => format!("the master's scan, {} axes", subject.machine.axes.len()),
        Part::Physics => format!("a simulated scan, {} axes", subject.machine.axes.len()),
        Part::Planning => "a window of the planner".into(),
    }
}

fn print(subject: &Subject, costs: &[Cost], figures: &mut Figures) {
    say(&format!(
        "scan: {} with {}; fastest of {ROUNDS} rounds; instructions of callgrind",
        subject.machine.name,
        subject.program().0
    ));
    say("                                  µs   instructions");
    for cost in costs {
        let what = what(subject, cost.part);
        let counted = cost.instructions.map(|count| format!("{count:14.0}"));
        let counted = counted.unwrap_or_else(|| format!("{:>14}", "-"));
        say(&format!("  {what:<28} {:7.2} {counted}", cost.time_us));
        figures.add("scan", &what, cost.time_us, "µs");
        if let Some(count) = cost.instructions {
            figures.add("scan", format!("{what}, instructions"), count, "");
        }
    }
}

/// Each count beside the one that is kept.
fn compare(
    options: &ScanOptions,
    kept: &Kept,
    subject: &Subject,
    costs: &[Cost],
    figures: &mut Figures,
) -> Outcome {
    let mut off = Vec::new();
    if kept.machine != subject.machine.name {
        let (theirs, ours) = (&kept.machine, &subject.machine.name);
        let file = options.counts.display();
        return Err(anyhow!("{file}: are counts of {theirs}, not of {ours}")).input();
    }
    for cost in costs {
        let Some((now, then)) = cost.instructions.zip(kept.of_part(cost.part)) else {
            off.push(format!("{}: nothing is kept", cost.part.word()));
            continue;
        };
        figures.add(
            "scan",
            format!("{}, instructions", cost.part.word()),
            now,
            "",
        );
        figures.beside("as kept", then);
        if (now / then - 1.0).abs() > TOLERANCE {
            let percent = 100.0 * (now / then - 1.0);
            off.push(format!(
                "{}: {now:.0} instructions, {percent:+.1} % beside the {then:.0} that are kept",
                cost.part.word()
            ));
        }
    }
    let file = options.counts.display();
    if off.is_empty() {
        let within = 100.0 * TOLERANCE;
        say(&format!("all instructions are within {within} % of {file}"));
        return Ok(());
    }
    off.iter().for_each(|line| say(&format!("  {line}")));
    say(&format!(
        "where that is meant: quadrant-lab bench scan --renew writes {file} anew"
    ));
    match options.check {
        true => Err(Failure::Stopped(anyhow!(
            "instructions of a scan are not those of {file}"
        ))),
        false => Ok(()),
    }
}

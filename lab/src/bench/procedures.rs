//! `quadrant-lab bench procedures`: every procedure of an operator, interrupted in every step by whatever can come; whether the machine
//! can be moved again, as it says.
//!
//! The table has a cell for each procedure, each of its steps in a first turn and a second, the beginning of the step and its middle,
//! and each order, trip, fault of a drive and death. As many seeds as it has cells take each cell once; a seed draws besides what
//! comes later, while an operator recovers, and what he wants.
//!
//! | rule | in words |
//! |---|---|
//! | liveness | K scans after what came last the machine is on; homed if it says so; a jog and a block end exactly where they say. An order that is refused says why; what that says can be done, and then the order is taken |
//! | end | a program that goes on ends where it says |
//! | refusals | an order that is refused changes nothing |
//! | trips | nothing trips that nothing has happened to |
//! | stored energy | the motors of a gantry that stands do not pull against each other |

mod interruptions;
mod machines;
mod operator;
mod run;
mod table;
mod tally;
mod trial;

use std::sync::Mutex;
use std::time::Instant;

use super::campaign::{Asked, Campaign, Line, Lines, each_found, each_seed};
use super::figures::Figures;
use crate::options::ProceduresOptions;
use console::exit::{Kind, Outcome};
use console::output::say;
use machine::Machine;
use tally::{Found, Tally};
use trial::{Table, Verdict};

/// Seeds between two lines of progress.
const PROGRESS_SEEDS: u64 = 1000;
/// Its name.
pub(super) const NAME: &str = "procedures";

/// Runs the seeds, or a part of them; as many as the table has cells, if no number is given.
pub(super) fn procedures(options: &ProceduresOptions, figures: &mut Figures) -> Outcome {
    let machine = Machine::load(&options.machine);
    let machine = machine.map_err(anyhow::Error::from).input()?;
    let table = Table::new(&options.machine, options.of.jobs).input()?;
    let seeds = options.seeds.unwrap_or(table.cells());
    let asked = Asked {
        bench: NAME,
        folder: &options.machine,
        program: None,
        seed: 0,
        from: options.of.from,
        count: seeds,
    };
    let campaign = Campaign::of(&asked, &machine).input()?;
    let lines = Lines::create(&campaign, options.of.lines.as_deref()).environment()?;
    if options.verbose {
        for (name, stages, cells) in table.summary() {
            say(&format!(
                "{name:<42}{stages:>5} steps in two turns{cells:>7} cells"
            ));
        }
    }
    let started = Instant::now();
    let tally = run_all(options, seeds, &table, &lines).environment()?;
    let elapsed_s = started.elapsed().as_secs_f64();
    let per_minute = tally.seeds as f64 / elapsed_s * 60.0;
    say(&format!(
        "in {elapsed_s:.1} s: {per_minute:.0} seeds per minute"
    ));
    figures.add(
        NAME,
        "procedures interrupted and recovered",
        per_minute,
        "1/min",
    );
    tally.conclude(&campaign)
}

/// Every seed of the part.
fn run_all(
    options: &ProceduresOptions,
    seeds: u64,
    table: &Table,
    lines: &Lines<'_>,
) -> anyhow::Result<Tally> {
    let started = Instant::now();
    let tally = Mutex::new(Tally::default());
    let one = |seed: u64| -> anyhow::Result<()> {
        let verdict = table.judge(seed, options.verbose);
        if options.verbose {
            tell(seed, &verdict);
        }
        let found = Found::of(&verdict, table.cells());
        lines.write(seed, &found)?;
        let mut tally = tally.lock().unwrap_or_else(|e| e.into_inner());
        tally.take(seed, &found);
        if tally.seeds.is_multiple_of(PROGRESS_SEEDS) {
            let (done, all) = (tally.seeds, options.of.part.share(seeds));
            let rate = done as f64 / started.elapsed().as_secs_f64();
            let violated = tally.violated();
            say(&format!(
                "{done:>7} of {all} seeds, {rate:.0} seeds/s, {violated} violated"
            ));
        }
        Ok(())
    };
    each_seed(&options.of, seeds, one)?;
    Ok(tally.into_inner().unwrap_or_else(|e| e.into_inner()))
}

/// The lines of all parts of a campaign.
///
/// # Errors
/// A line that is none of this bench, or a violation in one.
pub(super) fn merge(campaign: &Campaign, lines: Vec<Line>) -> Outcome {
    let mut tally = Tally::default();
    each_found(lines, |seed, found: &Found| tally.take(seed, found)).input()?;
    tally.conclude(campaign)
}

/// What a seed stands for and what became of it.
fn tell(seed: u64, verdict: &Verdict) {
    let mut text = format!("seed {seed}, cell {}: {}", verdict.cell, verdict.words);
    for line in &verdict.told {
        text += &format!("\n  {line}");
    }
    text += match &verdict.violation {
        Some(what) => format!("\n  VIOLATION: {what}"),
        None => format!("\n  recovered, {} scans", verdict.scans),
    }
    .as_str();
    say(&text);
}

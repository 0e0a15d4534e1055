//! The table, and what a seed draws from it.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use plant_sim::script::rng::Rng;

use super::interruptions::Interruption;
use super::operator::Operator;
use super::run::{Prepared, Stage};
use super::table::PROCEDURES;

/// What comes later comes at most so many scans after what came before it.
const LATER_SCANS: u64 = 1_500;
/// In the first pass through the table something more comes in one of so many cells, and in later passes.
const MORE_IN: [u64; 2] = [3, 2];

/// A cell of the table: a procedure, one of its steps in one of two turns, the beginning of the step or its middle, and what comes.
#[derive(Debug, Clone, Copy)]
struct Place {
    procedure: usize,
    stage: usize,
    middle: bool,
    interruption: usize,
}

/// All procedures with all their steps.
pub struct Table {
    procedures: Vec<Prepared>,
    cells: Vec<Place>,
    /// Neighbouring seeds are this far apart in the table.
    stride: u64,
}

/// What became of a seed.
pub struct Verdict {
    pub procedure: &'static str,
    pub cell: u64,
    /// How many came between.
    pub interruptions: u64,
    pub scans: u64,
    /// See [`Operator::on_after`].
    pub on_after: u64,
    pub strain_percent: Option<[f64; 2]>,
    pub violation: Option<String>,
    /// What it stands for.
    pub words: String,
    /// What was ordered.
    pub told: Vec<String>,
}

impl Table {
    /// Runs every procedure twice, undisturbed; so many at a time.
    ///
    /// # Errors
    /// One that does not come to its end.
    pub fn new(mill: &Path, jobs: u64) -> anyhow::Result<Table> {
        let next = AtomicUsize::new(0);
        let found: Mutex<Vec<(usize, anyhow::Result<Prepared>)>> = Mutex::default();
        std::thread::scope(|threads| {
            for _ in 0..jobs {
                threads.spawn(|| {
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        let Some(procedure) = PROCEDURES.get(index) else {
                            return;
                        };
                        let prepared = Prepared::new(procedure, mill);
                        let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
                        found.push((index, prepared));
                    }
                });
            }
        });
        let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        found.sort_by_key(|(index, _)| *index);
        let procedures = found.into_iter().map(|(_, prepared)| prepared);
        let procedures = procedures.collect::<anyhow::Result<Vec<_>>>()?;
        let mut cells = Vec::new();
        for (procedure, prepared) in procedures.iter().enumerate() {
            for (stage, of) in prepared.stages.iter().enumerate() {
                let moments: &[bool] = if of.has_middle() {
                    &[false, true]
                } else {
                    &[false]
                };
                for middle in moments {
                    cells.extend((0..prepared.interruptions.len()).map(|interruption| Place {
                        procedure,
                        stage,
                        middle: *middle,
                        interruption,
                    }));
                }
            }
        }
        Ok(Table {
            stride: stride(cells.len() as u64),
            procedures,
            cells,
        })
    }

    /// How many cells it has.
    pub fn cells(&self) -> u64 {
        self.cells.len() as u64
    }

    /// Each procedure with its steps in both turns and its cells.
    pub fn summary(&self) -> impl Iterator<Item = (&'static str, usize, usize)> {
        self.procedures.iter().enumerate().map(|(index, of)| {
            let cells = self.cells.iter().filter(|cell| cell.procedure == index);
            (of.procedure.name, of.stages.len(), cells.count())
        })
    }

    /// Its cell of a seed, and which pass through the table it is.
    fn cell(&self, seed: u64) -> (u64, u64) {
        let number = seed.saturating_sub(1);
        let (pass, place) = (number / self.cells(), number % self.cells());
        let cell = u128::from(place) * u128::from(self.stride) % u128::from(self.cells());
        (cell as u64, pass)
    }

    /// Runs a seed. The first pass through the table is the table itself; behind it a middle is anywhere in its step.
    pub fn judge(&self, seed: u64, tells: bool) -> Verdict {
        let (cell, pass) = self.cell(seed);
        let place = self.cells[cell as usize];
        let prepared = &self.procedures[place.procedure];
        let stage = &prepared.stages[place.stage];
        let what = prepared.interruptions[place.interruption];
        // Neighbouring seeds are to have nothing in common.
        let mut rng = Rng::new(Rng::new(seed).bits());
        let offset = match (place.middle, pass) {
            (false, _) => 0,
            (true, 0) => stage.scans / 2,
            (true, _) => rng.within(1, stage.scans - 1),
        };
        let mut later = Vec::new();
        while later.len() < 2 && rng.one_in(MORE_IN[pass.min(1) as usize]) {
            let more = rng.pick(&prepared.interruptions).copied();
            later.extend(more.map(|what| (rng.below(LATER_SCANS), what)));
        }
        let goes_on = rng.one_in(2);
        let again = prepared.procedure.homes || rng.one_in(3);
        let words = words(prepared, stage, offset, what, &later, goes_on);
        let interruptions = 1 + later.len() as u64;
        let mut operator = Operator::new(prepared, stage.run.clone(), later, tells);
        let begun = operator.run.cell.now.scan;
        let recovered = (0..offset)
            .try_for_each(|_| operator.run.advance().map(drop))
            .and_then(|()| operator.suffers_and_recovers(what, &mut rng, goes_on, again));
        Verdict {
            procedure: prepared.procedure.name,
            cell,
            interruptions,
            scans: operator.run.cell.now.scan.saturating_sub(begun),
            on_after: operator.on_after,
            strain_percent: operator.strain_percent,
            violation: recovered.err(),
            words,
            told: operator.told.unwrap_or_default(),
        }
    }
}

fn words(
    prepared: &Prepared,
    stage: &Stage,
    offset: u64,
    what: Interruption,
    later: &[(u64, Interruption)],
    goes_on: bool,
) -> String {
    let turn = ["first", "second"][stage.turn];
    let mut words = format!(
        "{}, {turn} time, step {}, scan {offset} of {}: {what:?}",
        prepared.procedure.name, stage.number, stage.scans
    );
    for (scans, what) in later {
        words += &format!(", {scans} scans later {what:?}");
    }
    words + if goes_on { "; then it is to go on" } else { "" }
}

/// About the golden section of the table, and without a divisor in common with it: every seed is far from the one before.
fn stride(cells: u64) -> u64 {
    let divides = |mut a: u64, mut b: u64| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let from = (cells as f64 * 0.618) as u64;
    (from.max(1)..)
        .find(|of| divides(*of, cells) == 1)
        .unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::stride;

    #[test]
    fn as_many_seeds_as_there_are_cells_take_each_cell_once() {
        for cells in [1, 2, 7, 720, 1001, 40_320] {
            let stride = stride(cells);
            let mut taken: Vec<u64> = (0..cells).map(|place| place * stride % cells).collect();
            taken.sort_unstable();
            assert_eq!(taken, (0..cells).collect::<Vec<_>>());
        }
    }
}

//! What became of all seeds together.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::anyhow;
use serde::{Deserialize, Serialize};

use super::operator::K_SCANS;
use super::trial::Verdict;
use crate::bench::campaign::{Campaign, to_keep};
use console::exit::{Failure, Outcome};
use console::output::say;

/// The most failing seeds that are printed.
const FAILURES_SHOWN: usize = 20;

/// What became of one seed, as far as the totals need it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Found {
    procedure: String,
    /// Its cell of the table, and how many that has.
    cell: u64,
    cells: u64,
    interruptions: u64,
    scans: u64,
    on_after: u64,
    strain_percent: Option<[f64; 2]>,
    violation: Option<String>,
}

impl Found {
    pub fn of(verdict: &Verdict, cells: u64) -> Found {
        let violation = verdict.violation.as_ref();
        Found {
            procedure: verdict.procedure.to_owned(),
            cell: verdict.cell,
            cells,
            interruptions: verdict.interruptions,
            scans: verdict.scans,
            on_after: verdict.on_after,
            strain_percent: verdict.strain_percent.map(|of| of.map(to_keep)),
            violation: violation.map(|what| format!("{}: {what}", verdict.words)),
        }
    }
}

/// Of one procedure.
#[derive(Debug, Default)]
struct Of {
    seeds: u64,
    interruptions: u64,
    on_after: u64,
    strain_percent: Option<[f64; 2]>,
}

/// All seeds together.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub seeds: u64,
    scans: u64,
    cells: u64,
    covered: BTreeSet<u64>,
    procedures: BTreeMap<String, Of>,
    failures: BTreeMap<u64, String>,
}

impl Tally {
    pub fn take(&mut self, seed: u64, found: &Found) {
        self.seeds += 1;
        self.scans += found.scans;
        self.cells = found.cells;
        self.covered.insert(found.cell);
        let of = self.procedures.entry(found.procedure.clone()).or_default();
        of.seeds += 1;
        of.interruptions += found.interruptions;
        of.on_after = of.on_after.max(found.on_after);
        if let Some(percents) = found.strain_percent {
            let most = of.strain_percent.get_or_insert([0.0; 2]);
            for (most, percent) in most.iter_mut().zip(percents) {
                *most = most.max(percent);
            }
        }
        if let Some(what) = &found.violation {
            if self.failures.len() < FAILURES_SHOWN {
                say(&format!("  seed {seed}: {what}"));
            }
            self.failures.insert(seed, what.clone());
        }
    }

    /// Seeds that violate a rule.
    pub fn violated(&self) -> usize {
        self.failures.len()
    }

    /// Prints the totals.
    ///
    /// # Errors
    /// A rule was violated.
    pub fn conclude(&self, campaign: &Campaign) -> Outcome {
        for (name, of) in &self.procedures {
            let strain = of.strain_percent.map_or_else(String::new, |[between, against]| {
                format!(
                    "; standing, {between:.1} % of rated torque between its motors, {against:.1} % against each other"
                )
            });
            let Of {
                seeds,
                interruptions,
                on_after,
                ..
            } = of;
            say(&format!(
                "  {name:<42}{seeds:>7} times, {interruptions:>7} interruptions, on after {on_after} scans at most{strain}"
            ));
        }
        let (covered, cells) = (self.covered.len() as u64, self.cells);
        let all = if covered == cells {
            ", all of them"
        } else {
            ""
        };
        say(&format!(
            "{} seeds, {:.1} million scans: {covered} of {cells} cells of the table{all}; K is {K_SCANS} scans",
            self.seeds,
            self.scans as f64 * 1e-6,
        ));
        if self.failures.is_empty() {
            say("No rule was violated.");
            return Ok(());
        }
        let machine = &campaign.machine;
        for (seed, what) in self.failures.iter().take(FAILURES_SHOWN) {
            say(&format!("seed {seed}: {what}"));
            say(&format!(
                "  quadrant-lab bench procedures {machine} --from {seed} --seeds 1 -v"
            ));
        }
        let (count, seeds) = (self.failures.len(), self.seeds);
        let what = anyhow!("{count} of {seeds} seeds violate a rule");
        Err(Failure::Stopped(what))
    }
}

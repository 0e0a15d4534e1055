//! What became of all seeds together.

use std::collections::BTreeMap;

use anyhow::anyhow;
use bus::sample::Mode;
use serde::{Deserialize, Serialize};

use super::seed::{Scenario, kind_of};
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
    runs: u64,
    scans: u64,
    trips: u64,
    stops: u64,
    missed: u64,
    obeyed: u64,
    finished: bool,
    /// In a trip, from the path, in mm.
    deviation_mm: f64,
    /// Whose faults have fired, and what they did.
    fired: Vec<(String, String)>,
    violations: Vec<String>,
}

impl Found {
    pub fn of(scenario: &Scenario, verdict: &Verdict) -> Found {
        let shown = &verdict.shown;
        let faults = scenario.faults.faults.iter().zip(&verdict.fired);
        let fired = faults.filter(|(_, fired)| **fired).map(|(fault, _)| {
            let (whose, what) = kind_of(fault.process.job, &fault.action);
            (whose.to_owned(), what.to_owned())
        });
        let violations = verdict.violations.iter();
        Found {
            runs: verdict.runs,
            scans: shown.scans * verdict.runs,
            trips: shown.trips.into(),
            stops: shown.stops.len() as u64,
            missed: shown.missed.into(),
            obeyed: verdict.obeyed.len() as u64,
            finished: shown.mode == Some(Mode::Finished),
            deviation_mm: to_keep(shown.deviation_mm),
            fired: fired.collect(),
            violations: violations
                .map(|violation| format!("scan {}: {}", violation.scan, violation.what))
                .collect(),
        }
    }
}

/// All seeds together.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub seeds: u64,
    pub runs: u64,
    scans: u64,
    trips: u64,
    stops: u64,
    missed: u64,
    finished: u64,
    obeyed: u64,
    kinds: BTreeMap<(String, String), u64>,
    deviation_mm: f64,
    failures: BTreeMap<u64, Vec<String>>,
}

impl Tally {
    pub fn take(&mut self, seed: u64, found: &Found) {
        self.seeds += 1;
        self.runs += found.runs;
        self.scans += found.scans;
        self.trips += found.trips;
        self.stops += found.stops;
        self.missed += found.missed;
        self.obeyed += found.obeyed;
        self.finished += u64::from(found.finished);
        self.deviation_mm = self.deviation_mm.max(found.deviation_mm);
        for kind in &found.fired {
            *self.kinds.entry(kind.clone()).or_default() += 1;
        }
        if !found.violations.is_empty() {
            if self.failures.len() < FAILURES_SHOWN {
                say(&format!("  seed {seed}: {}", found.violations.join("; ")));
            }
            self.failures.insert(seed, found.violations.clone());
        }
    }

    /// Seeds that violate an invariant.
    pub fn violated(&self) -> usize {
        self.failures.len()
    }

    /// Prints the totals.
    ///
    /// # Errors
    /// An invariant was violated.
    pub fn conclude(&self, campaign: &Campaign) -> Outcome {
        say(&format!(
            "{} seeds: {} runs, {:.1} million scans judged",
            self.seeds,
            self.runs,
            self.scans as f64 * 1e-6,
        ));
        say(&format!(
            "{} finished; {} stops on the path; {} trips, at most {:.3} mm from the path; {} missed scans; {} orders that the machine asked for",
            self.finished, self.stops, self.trips, self.deviation_mm, self.missed, self.obeyed
        ));
        for ((whose, what), count) in &self.kinds {
            say(&format!("  {whose:<13}{what:<8}{count:>7}"));
        }
        if self.failures.is_empty() {
            say("No invariant was violated.");
            return Ok(());
        }
        let Campaign {
            machine, program, ..
        } = campaign;
        let program = program.as_ref();
        let program = program.map_or_else(String::new, |path| format!(" --program {path}"));
        for (seed, words) in self.failures.iter().take(FAILURES_SHOWN) {
            say(&format!("seed {seed}: {}", words.join("; ")));
            say(&format!(
                "  quadrant-lab bench faults {machine}{program} --from {seed} --seeds 1 -v"
            ));
        }
        Err(Failure::Stopped(anyhow!(
            "{} of {} seeds violate an invariant",
            self.failures.len(),
            self.seeds
        )))
    }
}

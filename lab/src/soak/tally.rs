//! What came of the faults, counted.

use std::collections::BTreeMap;
use std::fmt::Write;

/// Numbers that were measured.
#[derive(Debug, Clone, Default)]
pub struct Spread(Vec<f64>);

impl Spread {
    /// One more.
    pub fn add(&mut self, value: f64) {
        self.0.push(value);
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The value that this share of them does not exceed; 0 if there are none.
    pub fn quantile(&self, share: f64) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let rank = libm::ceil(share * sorted.len() as f64) as usize;
        sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
    }

    /// p50, p99 and largest, in this many places.
    fn words(&self, places: usize) -> String {
        if self.0.is_empty() {
            return format!("{:>8} {:>8} {:>8}", "-", "-", "-");
        }
        let [a, b, c] = [0.5, 0.99, 1.0].map(|share| self.quantile(share));
        format!("{a:>8.places$} {b:>8.places$} {c:>8.places$}")
    }
}

/// Faults of one kind.
#[derive(Debug, Clone, Default)]
struct Row {
    faults: u64,
    reactions: BTreeMap<&'static str, u64>,
    /// Scans from the fault until every process that was killed was in the roster again.
    restart_scans: Spread,
    /// The same in ms.
    restart_ms: Spread,
    /// Scans from the fault until the machine moved on, the cell whole.
    whole_scans: Spread,
}

/// All of them.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    rows: BTreeMap<&'static str, Row>,
    /// From their cause until commands had returned, in ms.
    returned: BTreeMap<&'static str, Spread>,
    /// From a kill until the kernel tells of it, in ms.
    pub notification_ms: Spread,
    /// A process that does nothing, from its start until it is reaped, in ms.
    pub process_ms: Spread,
}

/// What one fault came to.
#[derive(Debug, Clone, Copy)]
pub struct Came {
    /// What was done.
    pub kind: &'static str,
    /// What the machine did.
    pub reaction: &'static str,
    /// Scans and ms until who was killed was back, if anybody was and is.
    pub restart: Option<(f64, f64)>,
    /// Scans until the cell was whole and moved, if it was.
    pub whole_scans: Option<f64>,
}

impl Tally {
    /// One more.
    pub fn add(&mut self, came: &Came) {
        let row = self.rows.entry(came.kind).or_default();
        row.faults += 1;
        *row.reactions.entry(came.reaction).or_default() += 1;
        if let Some((scans, ms)) = came.restart {
            row.restart_scans.add(scans);
            row.restart_ms.add(ms);
        }
        if let Some(scans) = came.whole_scans {
            row.whole_scans.add(scans);
        }
    }

    /// A command returned so long after its cause.
    pub fn returned(&mut self, what: &'static str, ms: f64) {
        self.returned.entry(what).or_default().add(ms);
    }

    /// The table.
    pub fn words(&self) -> String {
        let mut text = format!(
            "{:<34} {:>7}   {:^26}   {:^26}   {:^26}\n{:<34} {:>7}   {:>8} {:>8} {:>8}   {:>8} {:>8} {:>8}   {:>8} {:>8} {:>8}\n",
            "fault",
            "times",
            "restarted, scans",
            "restarted, ms",
            "moves on, scans",
            "",
            "",
            "p50",
            "p99",
            "max",
            "p50",
            "p99",
            "max",
            "p50",
            "p99",
            "max",
        );
        for (kind, row) in &self.rows {
            let _ = writeln!(
                text,
                "{kind:<34} {:>7}   {}   {}   {}",
                row.faults,
                row.restart_scans.words(0),
                row.restart_ms.words(1),
                row.whole_scans.words(0)
            );
            for (reaction, times) in &row.reactions {
                let _ = writeln!(text, "    {times:>5} × {reaction}");
            }
        }
        for (what, ms) in &self.returned {
            let _ = writeln!(
                text,
                "{what:<34} {:>7}   {:>26}   {}",
                ms.count(),
                "",
                ms.words(1)
            );
        }
        let _ = writeln!(
            text,
            "floor: {:<27} {:>7}   {:>26}   {}",
            "reported by the kernel",
            self.notification_ms.count(),
            "",
            self.notification_ms.words(2)
        );
        let _ = write!(
            text,
            "floor: {:<27} {:>7}   {:>26}   {}",
            "a bare process, start to end",
            self.process_ms.count(),
            "",
            self.process_ms.words(2)
        );
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_occurred() {
        let mut spread = Spread::default();
        (1..=100).for_each(|value| spread.add(f64::from(value)));
        assert_eq!(spread.quantile(0.5), 50.0);
        assert_eq!(spread.quantile(0.99), 99.0);
        assert_eq!(spread.quantile(1.0), 100.0);
        assert_eq!(Spread::default().quantile(0.5), 0.0);
    }
}

//! The recorder of a simulated cell: what it takes while it lives is measured as the report measures a log, and what the measurement
//! says is held against what the run was. It writes no file.

use ::report::measure::Analysis;
use bus::sample::{Feedback, Job, MAX_AXES, Mode};
use machine::Machine;
use monitor::log::Sample;
use path::geometry::Path;
use path::path_part::PathPart;

use crate::cell::Published;
use crate::invariants::Violation;

/// A recorder that was killed over a sample has taken it or not.
const OVER_A_SAMPLE: u64 = MAX_AXES as u64 + 2;

/// What a recorder takes of one run.
pub struct Recording {
    analysis: Analysis,
    roster: Option<u64>,
    lived: bool,
    /// Scans that nobody took: the first and the last of each gap, those at the end among them.
    gaps: Vec<(u64, u64)>,
    /// Samples of these scans.
    not_taken: u64,
    /// Commands that nobody made in these scans. Of an axis whose drive is off the recorder cannot tell them from those it missed.
    not_made: u64,
    /// Commands that somebody may have made and no drive took: the recorder cannot tell them from those that were not made.
    not_driven: u64,
    /// All three of the gap that is open.
    open: [u64; 3],
    deaths: u64,
    first: Option<u64>,
    last: Option<Feedback>,
}

impl Recording {
    /// Of a program's path on a machine.
    pub fn new(machine: &Machine, path: &PathPart) -> Recording {
        let elements = (path.first()..path.end()).filter_map(|element| path.get(element).cloned());
        let path = Path {
            elements: elements.collect(),
        };
        Recording {
            analysis: Analysis::new(machine.clone(), path),
            roster: None,
            lived: true,
            gaps: Vec::new(),
            not_taken: 0,
            not_made: 0,
            not_driven: 0,
            open: [0; 3],
            deaths: 0,
            first: None,
            last: None,
        }
    }

    /// Takes a scan, if there is a recorder.
    pub fn take(&mut self, published: &Published<'_>) {
        let scan = published.feedback.scan;
        self.first.get_or_insert(scan);
        let lives = published.roster.living(Job::Monitor, 0, 0).is_some();
        self.deaths += u64::from(self.lived && !lives);
        if !lives {
            match self.gaps.last_mut() {
                Some((_, last)) if !self.lived => *last = scan,
                _ => self.gaps.push((scan, scan)),
            }
            let mut axes = [false; MAX_AXES];
            for command in published.commands {
                if let Some(axis) = axes.get_mut(command.axis as usize) {
                    *axis = true;
                }
            }
            let made = axes.iter().filter(|made| **made).count() as u64;
            let missed = |feedback: &Feedback| -> u64 {
                let axes = feedback.axes().iter();
                axes.map(|axis| u64::from(axis.missed_scans)).sum()
            };
            let before = self.last.as_ref().map_or(0, missed);
            let driven = !matches!(
                Mode::from_wire(published.feedback.mode),
                Some(Mode::Disabled | Mode::Tripped)
            );
            let open = [
                2 + made,
                (published.feedback.axes().len() as u64).saturating_sub(made),
                if driven {
                    missed(published.feedback).saturating_sub(before)
                } else {
                    made
                },
            ];
            for (sum, more) in self.open.iter_mut().zip(open) {
                *sum += more;
            }
            self.lived = false;
            self.last = Some(*published.feedback);
            return;
        }
        let [not_taken, not_made, not_driven] = std::mem::take(&mut self.open);
        // Of a beginning that nobody took the report tells, which knows the parts of the log.
        if self.roster.is_some() {
            self.not_taken += not_taken;
            self.not_made += not_made;
            self.not_driven += not_driven;
        }
        if self.roster != Some(published.roster.version) || !self.lived {
            self.roster = Some(published.roster.version);
            let roster = Box::new(*published.roster);
            self.analysis.take(Sample::Roster(roster));
        }
        self.lived = true;
        let feedback = Box::new(*published.feedback);
        self.analysis.take(Sample::Feedback(feedback));
        let instruments = Box::new(*published.instruments);
        self.analysis.take(Sample::Instruments(instruments));
        for command in published.commands {
            self.analysis.take(Sample::Command(Box::new(*command)));
        }
        self.last = Some(*published.feedback);
    }

    /// The run has ended: what is said of it and is not so. `masters` have been lost: what they had not said nobody knows.
    pub fn end(self, masters_lost: bool) -> Vec<Violation> {
        let measured = self.analysis.finish();
        let last = self.last.map_or(0, |feedback| feedback.scan);
        let mut violations = Vec::new();
        let mut say = |what: String| violations.push(Violation { scan: last, what });
        let lost = measured.samples_lost;
        let slack = self.deaths * OVER_A_SAMPLE;
        let is_counted = lost + self.not_driven + slack >= self.not_taken
            && lost <= self.not_taken + self.not_made + slack;
        // Over the restart of a master nobody can tell which samples there were.
        let is_fine = is_counted || masters_lost && lost <= self.not_taken + slack;
        if !is_fine {
            let words = format!(
                "{lost} samples are called lost, {} were not recorded",
                self.not_taken
            );
            say(words);
        }
        // Those at both ends are told by the report, too.
        let inside = self
            .gaps
            .iter()
            .filter(|(first, end)| Some(*first) > self.first && *end < last);
        let inside: Vec<(u64, u64)> = inside.copied().collect();
        if !masters_lost && measured.missing_scans != inside {
            say(format!(
                "scans {:?} are called missing, those of {inside:?} are",
                measured.missing_scans
            ));
        }
        let finished = self.last.is_some_and(|f| f.mode == Mode::Finished as u32);
        let is_said = measured.is_completed();
        if self.lived && finished != is_said {
            say(format!(
                "the end is called {:?}, the machine is finished: {finished}",
                measured.ended
            ));
        }
        violations
    }
}

//! Everybody who judges a run of the simulation, and what they know of its disturbances.

use bus::sample::{Job, MAX_AXES};
use machine::Machine;
use plant_sim::script::faults::{Action, Fault, Trigger};

use super::seed::lasts;
use crate::cell::{InProcessCell, Published, Script};
use crate::invariants::{Course, Judge, Shown, Violation, is_driver_dead};
use crate::liveness::Liveness;
use crate::promises::Promises;
use crate::recording::Recording;
use crate::tampering::{FORGOTTEN_SCANS, Kind, Tampering};

/// A process that died by itself takes part again within so many scans, or was given up: the longest back-off and its start.
const RESTARTS_SCANS: u64 = 1100;
/// After a fault is over, and with a window sent since, a servo needs so many scans to be a standby again.
const READY_SCANS: u64 = 12;

/// When a servo's fault is over, and the scan of the first window sent since.
type Recovery = (u64, Option<u64>);

/// Which axes go on as if nothing had happened.
struct Cover {
    standby: bool,
    supervised: bool,
    /// Since when each servo is right again: a fault's end, and whether a window was sent since.
    recovers: [[Option<Recovery>; 2]; MAX_AXES],
    /// From then on the axis has been without a servo that could go on.
    lost: [bool; MAX_AXES],
}

impl Cover {
    fn new(standby: bool, supervised: bool) -> Cover {
        Cover {
            standby,
            supervised,
            recovers: [[None; 2]; MAX_AXES],
            lost: [false; MAX_AXES],
        }
    }

    /// A fault of a servo has fired in `scan`.
    fn strike(&mut self, fault: &Fault, scan: u64) {
        let (axis, role) = (fault.process.axis as usize, fault.process.role as usize);
        let peer_is_well = match self.recovers[axis][1 - role] {
            None => true,
            Some((over, window)) => {
                scan >= over && window.is_some_and(|sent| scan >= sent + READY_SCANS)
            }
        };
        // A standby is one only after it has run along for some scans.
        if !self.standby || !peer_is_well || scan < READY_SCANS {
            self.lost[axis] = true;
        }
        let dies = self.supervised && matches!(fault.action, Action::Kill { .. });
        // When it is replaced, and whether, the rules say.
        let over = if dies {
            u64::MAX
        } else {
            scan + lasts(&fault.action)
        };
        let before = self.recovers[axis][role].map_or(0, |(over, _)| over);
        self.recovers[axis][role] = Some((over.max(before), None));
        // The other one may have gone on from what it said.
        if matches!(fault.action, Action::Spoil { .. }) {
            let peer = &mut self.recovers[axis][1 - role];
            let before = peer.map_or(0, |(over, _)| over);
            *peer = Some((over.max(before), None));
        }
    }

    fn window_sent(&mut self, scan: u64) {
        for (over, window) in self.recovers.iter_mut().flatten().flatten() {
            if scan >= *over {
                window.get_or_insert(scan);
            }
        }
    }
}

/// What disturbs a run, as far as it is known.
struct Disturbances<'a> {
    faults: &'a [Fault],
    fired: Vec<Option<u64>>,
    supervised: bool,
    last_order: u64,
    tampering: Option<Tampering>,
}

impl<'a> Disturbances<'a> {
    fn new(faults: &'a [Fault], script: &Script) -> Disturbances<'a> {
        Disturbances {
            faults,
            fired: vec![None; faults.len()],
            supervised: script.supervised,
            last_order: script.orders.last().map_or(0, |order| order.scan),
            tampering: script.tampering,
        }
    }

    /// Whether what is damaged on its way has met the samples of this scan, or its consequences last.
    fn is_tampered(&self, scan: u64) -> bool {
        self.tampering.is_some_and(|tampering| {
            (tampering.from..tampering.until() + FORGOTTEN_SCANS).contains(&scan)
        })
    }

    /// The same of samples of a kind that their readers believe.
    fn is_lied_to(&self, kind: Kind, scan: u64) -> bool {
        let lies = |tampering: Tampering| tampering.resealed && tampering.kind == kind;
        self.tampering.is_some_and(lies) && self.is_tampered(scan)
    }

    /// Notes what has fired meanwhile.
    fn look(&mut self, cell: &InProcessCell, mut strikes: impl FnMut(&Fault, u64)) {
        for (index, fault) in self.faults.iter().enumerate() {
            if self.fired[index].is_some() {
                continue;
            }
            self.fired[index] = cell.fired(index);
            if let (Some(at), Job::Servo) = (self.fired[index], fault.process.job) {
                strikes(fault, at);
            }
        }
    }

    /// The last scan that is disturbed: by what fired, by what is to fire in a scan of its own, by an order.
    fn until(&self) -> u64 {
        let all = self.faults.iter().zip(&self.fired);
        let ends = all.filter_map(|(fault, fired)| {
            let at = match (fired, fault.at) {
                (Some(at), _) => *at,
                (None, Trigger::Scan(at)) => at,
                (None, _) => return None,
            };
            let dies = self.supervised && matches!(fault.action, Action::Kill { .. });
            Some(
                at + if dies {
                    RESTARTS_SCANS
                } else {
                    lasts(&fault.action)
                },
            )
        });
        let tampering = self.tampering.map_or(0, |tampering| tampering.until());
        ends.max().unwrap_or(0).max(self.last_order).max(tampering)
    }

    fn has_lied(&self, axis: usize) -> bool {
        let of_axis = |fault: &Fault| {
            let process = fault.process;
            process.job == Job::Servo && process.axis as usize == axis
        };
        let corrupts =
            |fault: &Fault| matches!(fault.action, Action::Corrupt { .. } | Action::Spoil { .. });
        let mut all = self.faults.iter().zip(&self.fired);
        all.any(|(fault, fired)| fired.is_some() && of_axis(fault) && corrupts(fault))
    }

    /// Whether a fault is why this axis had no command in a scan.
    fn explains(&self, missed: u64, axis: usize) -> bool {
        if self.is_tampered(missed) {
            return true;
        }
        let mut all = self.faults.iter().zip(&self.fired);
        all.any(|(fault, at)| {
            fault.process.job == Job::Servo
                && fault.process.axis as usize == axis
                && at.is_some_and(|at| (at..=at + lasts(&fault.action)).contains(&missed))
        })
    }
}

/// Everybody who judges a run.
pub struct Judges<'a> {
    disturbances: Disturbances<'a>,
    cover: Cover,
    judge: Judge<'a>,
    /// Whether it goes on.
    pub liveness: Liveness<'a>,
    /// Whether answers hold.
    pub promises: Promises,
    recording: Option<Recording>,
    /// Axes whose servo has died, in the scan before.
    driverless: [bool; MAX_AXES],
}

impl<'a> Judges<'a> {
    /// Of a run of this script.
    pub fn new(
        machine: &'a Machine,
        course: &'a Course,
        faults: &'a [Fault],
        script: &Script,
    ) -> Judges<'a> {
        let standby = machine.axes.iter().all(|axis| axis.standby);
        // What is made otherwise than it is sent shows here as it was made.
        let as_made = faults.iter().all(|fault| !fault.action.is_of_samples());
        let records = as_made && script.tampering.is_none() && !faults.is_empty();
        Judges {
            disturbances: Disturbances::new(faults, script),
            cover: Cover::new(standby, script.supervised),
            judge: Judge::new(machine, course),
            liveness: Liveness::new(machine),
            promises: Promises::default(),
            recording: records.then(|| Recording::new(machine, &course.path)),
            driverless: [false; MAX_AXES],
        }
    }

    /// Takes a scan; whether a window was sent in it.
    pub fn take(&mut self, published: &Published<'_>) -> bool {
        let feedback = published.feedback;
        let (disturbances, cover) = (&self.disturbances, &mut self.cover);
        self.promises.take(feedback);
        let obeyed = published.obeyed.iter();
        obeyed.for_each(|order| self.promises.obeyed(*order));
        if let Some(recording) = &mut self.recording {
            recording.take(published);
        }
        if disturbances.is_tampered(feedback.scan) {
            cover.lost = [true; MAX_AXES];
        }
        if disturbances.is_lied_to(Kind::Feedback, feedback.scan) {
            self.judge.forget_executed();
        }
        if disturbances.is_lied_to(Kind::Roster, feedback.scan) {
            self.liveness.believe_that_all_are_lost();
        }
        let driverless = self.driverless;
        self.judge.take(published, |missed, axis| {
            let explained = driverless[axis] || disturbances.explains(missed, axis);
            cover.lost[axis] && explained
        });
        for (index, axis) in feedback.axes().iter().enumerate() {
            self.driverless[index] = is_driver_dead(published.roster, index, axis);
        }
        let all_lie = disturbances.is_lied_to(Kind::Feedback, feedback.scan);
        self.liveness.take(published, disturbances.until(), |axis| {
            all_lie || disturbances.has_lied(axis)
        });
        !published.windows.is_empty()
    }

    /// Takes what of the script has fired by this scan.
    pub fn look(&mut self, cell: &InProcessCell, scan: u64, window_sent: bool) {
        let cover = &mut self.cover;
        self.disturbances
            .look(cell, |fault, at| cover.strike(fault, at));
        if window_sent {
            cover.window_sent(scan);
        }
    }

    /// Whether the machine has come no further for as long as it may take.
    pub fn rests(&self) -> bool {
        self.liveness.rests(self.disturbances.until())
    }

    /// The run has ended: what it has shown, what must not be, and what has fired.
    pub fn end(mut self, cell: &InProcessCell) -> (Shown, Vec<Violation>, Vec<bool>) {
        // What killed the master for good fired in a scan that nobody was asked in.
        self.disturbances.look(cell, |_, _| {});
        let (shown, mut violations) = self.judge.end();
        violations.extend(self.liveness.end());
        violations.extend(self.promises.end());
        let (faults, fired) = (self.disturbances.faults, self.disturbances.fired);
        let fired: Vec<bool> = fired.iter().map(Option::is_some).collect();
        if let Some(recording) = self.recording {
            let mut struck = faults.iter().zip(&fired);
            let is_masters = |fault: &Fault| fault.process.job == Job::Master;
            let masters_lost = struck.any(|(fault, fired)| *fired && is_masters(fault));
            violations.extend(recording.end(masters_lost));
        }
        if shown.trips > 0 && !self.cover.lost.iter().any(|lost| *lost) {
            violations.push(Violation {
                scan: shown.scans,
                what: "the machine tripped although every fault was covered".into(),
            });
        }
        (shown, violations, fired)
    }
}

//! What a run was like, measured on the stream of its samples: the same code for samples from the wire and from the
//! log, and the same result however the channels were interleaved ([`align`]).
//!
//! Everything about the path is measured on the *table* as the bench's instruments saw it, in the terms of
//! ISO 230-4:2022 (circular tests) and ISO 230-1 (contour deviations); where an arm stands in for Y, on the part.

pub mod align;
pub mod arc;
pub mod axis;
pub mod contour;
pub mod faults;
pub mod fit;
pub mod prediction;
pub mod reversal;
pub mod series;

#[cfg(test)]
mod tests;

use bus::machine::Machine;
use bus::sample::{Cause, Feedback, Mode, WindowId};
use control::kinematics::Kinematics;
use control::path::{AxisVector, MAX_AXES, Path};

use crate::log::Sample;
use align::{Aligner, ScanSet};
use arc::{ArcMeter, ArcResult};
use axis::{AxisMeter, LimitCounts, LimitsAudit};
use faults::{FaultResult, Faults, ProcessResult};
use reversal::{ReversalMeter, ReversalResult};
use series::Statistics;

/// How a run ended, as the samples tell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// The program is done and the machine in position.
    Completed,
    /// Stopped by the operator, at rest on the path.
    Interrupted,
    /// Stopped for a reason.
    Stopped(String),
}

/// Everything that was measured.
#[derive(Debug, Clone)]
pub struct Measurements {
    /// How it ended.
    pub outcome: Outcome,
    /// Scans from the first to the last feedback.
    pub scans: u64,
    /// Scan period, in s.
    pub scan_period_s: f64,
    /// Per axis, in order.
    pub axes: Vec<AxisMeter>,
    /// Distance of the table from the programmed path, in mm.
    pub contour_error_mm: Statistics,
    /// Every run of arcs on one circle, in order of travel.
    pub arcs: Vec<ArcResult>,
    /// Every change of direction of a command, in order of time.
    pub reversals: Vec<ReversalResult>,
    /// Setpoints beyond a limit.
    pub limits: LimitCounts,
    /// Windows that were voided.
    pub windows_voided: u64,
    /// Windows the planner published.
    pub windows: u64,
    /// Samples missing in the stream.
    pub samples_lost: u64,
    /// Scans skipped because the machine side itself was late.
    pub overrun_scans: u32,
    /// The machine side's own digest, in hexadecimal; none without instruments.
    pub motion_digest: Option<String>,
    /// Who took part.
    pub processes: Vec<ProcessResult>,
    /// What befell them.
    pub faults: Vec<FaultResult>,
}

/// The measurement of one run, fed sample by sample.
pub struct Analysis {
    machine: Machine,
    path: Path,
    kinematics: Kinematics,
    aligner: Aligner,
    axes: Vec<AxisMeter>,
    audit: LimitsAudit,
    contour_mm: Statistics,
    arcs: ArcMeter,
    reversals: Vec<ReversalMeter>,
    faults: Faults,
    /// Backlash compensation asked for in the scan before, in mm: in force in this one.
    backlash_mm: AxisVector,
    /// Axes whose command of the scan before is in the stream.
    commanded: [bool; MAX_AXES],
    /// Whether the stream has the instruments of the scan before.
    instrumented: bool,
    first_scan: Option<u64>,
    last: Option<Feedback>,
    on_path: bool,
    voided: WindowId,
    windows_voided: u64,
    windows: u64,
    samples_lost: u64,
    motion_digest: Option<u128>,
}

impl Analysis {
    /// Begins the measurement of a run of `path` on `machine`.
    pub fn new(machine: Machine, path: Path) -> Self {
        let period_s = machine.scan_period_s();
        let kinematics = program::kinematics_of(&machine);
        let increments_mm: Vec<f64> = machine.axes.iter().map(|a| a.increment_mm()).collect();
        Analysis {
            aligner: Aligner::new(machine.axes.len()),
            axes: machine.axes.iter().map(AxisMeter::of).collect(),
            audit: LimitsAudit::new(&machine),
            contour_mm: Statistics::default(),
            arcs: ArcMeter::new(&path, &kinematics, period_s),
            reversals: increments_mm
                .iter()
                .map(|increment_mm| ReversalMeter::new(*increment_mm))
                .collect(),
            faults: Faults::new(&machine),
            backlash_mm: AxisVector::zeros(),
            commanded: [false; MAX_AXES],
            instrumented: false,
            first_scan: None,
            last: None,
            on_path: false,
            voided: WindowId::NONE,
            windows_voided: 0,
            windows: 0,
            samples_lost: 0,
            motion_digest: None,
            machine,
            path,
            kinematics,
        }
    }

    /// Takes the next sample of any channel.
    pub fn take(&mut self, sample: Sample) {
        match sample {
            Sample::Feedback(sample) => self.aligner.feedback(sample),
            Sample::Instruments(sample) => self.aligner.instruments(sample),
            Sample::Command(sample) => self.aligner.command(sample),
            Sample::Window(_) => self.windows += 1,
            Sample::Roster(roster) => self.faults.roster(&roster),
            Sample::Planner(_) | Sample::Event(_) => {}
        }
        while let Some(set) = self.aligner.next_whole() {
            self.scan(&set);
        }
    }

    /// Ends the measurement.
    pub fn finish(mut self) -> Measurements {
        while let Some(set) = self.aligner.next_of_rest() {
            self.scan(&set);
        }
        let arcs = self.arcs.finish();
        let mut reversals: Vec<ReversalResult> = self
            .reversals
            .into_iter()
            .enumerate()
            .flat_map(|(axis, meter)| meter.finish(axis, &self.machine, &self.path, &arcs))
            .collect();
        reversals.sort_by_key(|reversal| (reversal.scan, reversal.axis));
        let last_scan = self.last.as_ref().map(|feedback| feedback.scan);
        let (processes, faults) = self.faults.finish();
        Measurements {
            outcome: outcome(&self.machine, self.last.as_ref(), &faults),
            scans: match (self.first_scan, last_scan) {
                (Some(first), Some(last)) => last - first + 1,
                _ => 0,
            },
            scan_period_s: self.machine.scan_period_s(),
            axes: self.axes,
            contour_error_mm: self.contour_mm,
            arcs,
            reversals,
            limits: self.audit.counts,
            windows_voided: self.windows_voided,
            windows: self.windows,
            samples_lost: self.samples_lost + self.aligner.late(),
            overrun_scans: self.last.map_or(0, |feedback| feedback.overrun_scans),
            motion_digest: self.motion_digest.map(crate::digest::hex),
            processes,
            faults,
        }
    }

    /// One scan, all channels.
    fn scan(&mut self, set: &ScanSet) {
        if let Some(instruments) = &set.instruments {
            self.motion_digest = Some(
                u128::from(instruments.motion_digest_high) << 64
                    | u128::from(instruments.motion_digest_low),
            );
        }
        let Some(feedback) = set.feedback.as_deref() else {
            self.samples_lost += u64::from(set.instruments.is_some());
            return;
        };
        self.count_losses(set, feedback);
        self.first_scan.get_or_insert(feedback.scan);
        if feedback.voided != self.voided && !feedback.voided.is_none() {
            self.windows_voided += 1;
        }
        self.voided = feedback.voided;
        let drives_on = !matches!(Mode::from_wire(feedback.mode), Some(Mode::Disabled) | None);
        self.on_path |= !feedback.window.is_none();
        for (index, axis) in self.axes.iter_mut().enumerate() {
            let command = set.command(index);
            if let Some(feedback) = feedback.axes().get(index) {
                axis.take(set.scan, feedback, command, drives_on);
            }
            if let (Some(command), Some(meter)) = (command, self.reversals.get_mut(index)) {
                meter.take(command);
            }
        }
        self.audit.take(feedback);
        let contour_mm = self.path_deviation(set, feedback, drives_on);
        self.faults.scan(feedback, contour_mm);
        for (index, backlash_mm) in self.backlash_mm.iter_mut().enumerate() {
            if let Some(command) = set.command(index) {
                *backlash_mm = command.state.backlash_mm;
            }
            if let Some(commanded) = self.commanded.get_mut(index) {
                *commanded = set.command(index).is_some();
            }
        }
        self.last = Some(*feedback);
    }

    /// Contour error of the scan's instrument samples, and the arcs' share of them; the largest, in mm.
    fn path_deviation(&mut self, set: &ScanSet, feedback: &Feedback, drives_on: bool) -> f64 {
        let Some(instruments) = set.instruments.as_deref() else {
            return 0.0;
        };
        if !self.on_path || !drives_on {
            return 0.0;
        }
        let count = (instruments.subsamples as usize).min(bus::sample::MAX_SUBSAMPLES);
        let at = |rows: &[[f64; bus::sample::MAX_SUBSAMPLES]; MAX_AXES], sub: usize| {
            AxisVector::from_fn(|axis, _| {
                let used = axis < self.axes.len();
                let row = rows.get(axis).filter(|_| used);
                row.and_then(|row| row.get(sub)).copied().unwrap_or(0.0)
            })
        };
        let mut largest_mm = 0.0f64;
        let executing = !feedback.window.is_none();
        self.arcs.scan(feedback, executing);
        for sub in 0..count {
            // From here on everything is in the coordinates of the program: where the axes had the tool on the part.
            let table = self.kinematics.tool(&at(&instruments.table_mm, sub));
            let motor = at(&instruments.motor_mm, sub) - self.backlash_mm;
            let motor = self.kinematics.tool(&motor);
            if let Some(error_mm) = contour::error_mm(&self.path, &feedback.tag, &table) {
                self.contour_mm.take(error_mm);
                largest_mm = largest_mm.max(error_mm);
            }
            let share = (sub + 1) as f64 / count as f64;
            self.arcs.sample(set.scan as f64 + share, &table, &motor);
        }
        largest_mm
    }

    fn count_losses(&mut self, set: &ScanSet, feedback: &Feedback) {
        // Judged one scan later: nobody waits for the instruments of a run's last scan.
        let instrumented = std::mem::replace(&mut self.instrumented, set.instruments.is_some());
        let Some(last) = &self.last else { return };
        self.samples_lost += u64::from(!instrumented);
        if feedback.incarnation == last.incarnation {
            self.samples_lost += feedback.scan.saturating_sub(last.scan + 1);
        }
        if feedback.scan != last.scan + 1 {
            return;
        }
        for (axis, commanded) in feedback.axes().iter().zip(self.commanded) {
            // The drive took a command that the stream does not have.
            let taken = axis.command_scan == last.scan && last.scan > 0;
            self.samples_lost += u64::from(taken && !commanded);
        }
    }
}

fn outcome(machine: &Machine, last: Option<&Feedback>, faults: &[FaultResult]) -> Outcome {
    let Some(last) = last else {
        return Outcome::Stopped("the log holds no feedback".into());
    };
    match Mode::from_wire(last.mode) {
        Some(Mode::Finished) => Outcome::Completed,
        // An operator stops a machine, and so does the launcher when the planner is gone.
        Some(Mode::Stopped) => match faults.iter().find(|fault| fault.process == "planner") {
            Some(fault) => Outcome::Stopped(format!(
                "planner {} in scan {}; the machine came to rest on the path",
                fault.kind, fault.scan
            )),
            None if last.cause != 0 => {
                let cause = Cause::from_wire(last.cause).unwrap_or(Cause::BadFeedback);
                Outcome::Stopped(cause.words().into())
            }
            None => Outcome::Interrupted,
        },
        // Whoever switched the drives off ended the run so.
        Some(Mode::Disabled) if last.cause == 0 && last.last == 1 => Outcome::Interrupted,
        Some(Mode::Tripped) => {
            let cause = Cause::from_wire(last.cause).unwrap_or(Cause::BadFeedback);
            let axis = machine.axes.get(last.cause_axis as usize);
            let whose = axis.map_or(String::new(), |axis| format!("axis {}: ", axis.name));
            Outcome::Stopped(format!("{whose}{}", cause.words()))
        }
        mode => Outcome::Stopped(format!(
            "the log ends at scan {} with the machine {}",
            last.scan,
            mode.map_or("in an unknown mode", Mode::word)
        )),
    }
}

//! What a run was like, measured on the stream of its samples: the same code for samples from the wire and from the
//! log, and the same result however the channels were interleaved (`align`).
//!
//! Everything about the path is measured on the *table* as the bench's instruments saw it, in the terms of
//! ISO 230-4:2022 (circular tests) and ISO 230-1 (contour deviations); where an arm is in for Y, on the part.
//!
//! **Scans that are missing** (the recorder was dead, or its queue overflowed) are never bridged. What is judged scan by scan
//! (contour error, following error, torque) is of the scans that are there. What needs several scans in a row (limits,
//! reversals, predictions) begins again behind the gap: no change of direction is seen across it. An arc is measured on what is
//! there of it and says how much is missing ([`arc`]); a quadrant whose window has a gap is not measured, for its peak may be
//! what is missing.

pub mod arc;
pub mod auxiliary;
pub mod axis;
pub mod ball_bar;
pub mod contour_parts;
pub mod faults;
pub mod fit;
pub mod outcome;
pub mod prediction;
pub mod reversal;
mod run_path;
pub mod series;
pub mod travelled;

#[cfg(test)]
mod fault_tests;
#[cfg(test)]
mod gap_tests;
#[cfg(test)]
mod tests;

use bus::sample::{Cause, Feedback, Instruments, MAX_AXES, Mode, WindowId};
use machine::Machine;
use path::geometry::AxisVector;
use path::kinematics::Kinematics;

use crate::align::{Aligner, ScanSet};
use arc::{ArcMeter, ArcResult};
use auxiliary::{AuxiliaryEvent, AuxiliaryMeter};
use axis::blocks::{BlockMeter, BlockPeaks};
use axis::{AxisMeter, LimitCounts, LimitsAudit};
use ball_bar::BallBar;
use contour_parts::{ContourParts, ContourPartsMeter};
use faults::{FaultResult, Faults, ProcessResult, Seen};
use monitor::ended::Ended;
use monitor::log::Sample;
use reversal::{ReversalMeter, ReversalResult};
pub use run_path::RunPath;
use series::Statistics;
use travelled::Travelled;

/// Gaps that are listed; what is missing beyond them is counted only.
const GAPS_MAX: usize = 1000;

/// Everything that was measured.
#[derive(Debug, Clone)]
pub struct Measurements {
    /// How it ended, as its last feedback says it; none where a log ends before. The log of a run in a cell that stays up does.
    pub ended: Option<Ended>,
    /// Scan and mode of the last feedback.
    pub last: Option<(u64, Option<Mode>)>,
    /// Scans from the first to the last feedback.
    pub scans: u64,
    /// Scan period, in s.
    pub scan_period_s: f64,
    /// Per axis, in order.
    pub axes: Vec<AxisMeter>,
    /// Distance of the table from the programmed path, in mm.
    pub contour_error_mm: Statistics,
    /// Where it comes from.
    pub contour_parts: ContourParts,
    /// Where the tool was, and how far off the path.
    pub travelled: Travelled,
    /// Peaks of every block that was travelled, by line of the program, in order.
    pub blocks: Vec<(u32, BlockPeaks)>,
    /// Every run of arcs on one circle, in order of travel.
    pub arcs: Vec<ArcResult>,
    /// Every circle that was travelled both ways.
    pub ball_bars: Vec<BallBar>,
    /// Every change of direction of a command, in order of time.
    pub reversals: Vec<ReversalResult>,
    /// How many more there were.
    pub reversals_not_listed: u64,
    /// Setpoints beyond a limit.
    pub limits: LimitCounts,
    /// Windows that were voided.
    pub windows_voided: u64,
    /// Windows the planner published.
    pub windows: u64,
    /// Samples missing in the stream: feedbacks, instruments and commands, each for itself.
    pub samples_lost: u64,
    /// Scans of which the stream has no feedback although there was one: first and last of each gap, in order.
    pub missing_scans: Vec<(u64, u64)>,
    /// Scans skipped because the master itself was late.
    pub overrun_scans: u32,
    /// The master's own digest, in hexadecimal; none without instruments.
    pub motion_digest: Option<String>,
    /// Who took part.
    pub processes: Vec<ProcessResult>,
    /// What befell them.
    pub faults: Vec<FaultResult>,
    /// What happened beside the axes.
    pub auxiliary: Vec<AuxiliaryEvent>,
}

impl Measurements {
    /// Whether the last feedback shows the program done, and the machine in position.
    pub fn is_completed(&self) -> bool {
        let mode = self.last.and_then(|(_, mode)| mode);
        mode == Some(Mode::Finished)
    }
}

/// The measurement of one run, fed sample by sample.
pub struct Analysis {
    machine: Machine,
    path: RunPath,
    kinematics: Kinematics,
    aligner: Aligner,
    axes: Vec<AxisMeter>,
    audit: LimitsAudit,
    contour_mm: Statistics,
    contour_parts: ContourPartsMeter,
    travelled: Travelled,
    blocks: BlockMeter,
    arcs: ArcMeter,
    reversals: Vec<ReversalMeter>,
    faults: Faults,
    auxiliary: AuxiliaryMeter,
    /// Backlash compensation asked for in the scan before, in mm: in force in this one.
    backlash_mm: [f64; MAX_AXES],
    /// Axes whose command of the scan before is in the stream.
    commanded: [bool; MAX_AXES],
    has_instruments: bool,
    /// Whether the stream has the instruments of the scan before.
    instrumented: bool,
    /// What the stream has of scans whose feedback is missing, since the last feedback: instruments, commands of each axis.
    orphans: (u64, [u64; MAX_AXES]),
    /// Scan whose commands `backlash_mm` is from.
    backlash_scan: Option<u64>,
    missing_scans: Vec<(u64, u64)>,
    begins_at: u64,
    overrun_before: u32,
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
    pub fn new(machine: Machine, path: impl Into<RunPath>) -> Self {
        let path = path.into();
        let period_s = machine.scan_period_s();
        let kinematics = program::kinematics_of(&machine);
        let increments_mm: Vec<f64> = machine.axes.iter().map(|a| a.increment_mm()).collect();
        Analysis {
            aligner: Aligner::new(machine.axes.len()),
            axes: machine
                .axes
                .iter()
                .map(|axis| AxisMeter::of(axis, period_s))
                .collect(),
            audit: LimitsAudit::new(&machine),
            contour_mm: Statistics::default(),
            contour_parts: ContourPartsMeter::new(&kinematics, &increments_mm, period_s),
            travelled: Travelled::default(),
            blocks: BlockMeter::default(),
            arcs: ArcMeter::new(path.whole(), &kinematics, period_s),
            reversals: increments_mm
                .iter()
                .map(|increment_mm| ReversalMeter::new(*increment_mm))
                .collect(),
            faults: Faults::new(&machine),
            auxiliary: AuxiliaryMeter::default(),
            backlash_mm: [0.0; MAX_AXES],
            commanded: [false; MAX_AXES],
            has_instruments: true,
            instrumented: false,
            orphans: (0, [0; MAX_AXES]),
            backlash_scan: None,
            missing_scans: Vec::new(),
            begins_at: 0,
            overrun_before: 0,
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

    /// Says that the stream has no instruments: none are missing.
    pub fn without_instruments(&mut self) {
        self.has_instruments = false;
    }

    /// Says in which scan the run began: in a cell that stays up, what was before is none of it.
    pub fn begins_at(&mut self, scan: u64) {
        self.begins_at = scan;
        self.faults.begins_at(scan);
    }

    /// Takes the next sample of any channel.
    pub fn take(&mut self, sample: Sample) {
        match sample {
            Sample::Feedback(sample) => self.aligner.feedback(sample),
            Sample::Instruments(sample) => self.aligner.instruments(sample),
            Sample::Command(sample) => self.aligner.command(sample),
            Sample::Window(_) => self.windows += 1,
            Sample::Roster(roster) => self.faults.roster(&roster),
            Sample::BusCycle(_) | Sample::Signals(_) | Sample::Planner(_) | Sample::Event(_) => {}
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
        let (arcs, ball_bars) = self.arcs.finish();
        let ball_bars = ball_bars.finish(|axis| lead_mm(&self.machine, &self.kinematics, axis));
        let not_listed = self.reversals.iter().map(ReversalMeter::not_listed);
        let reversals_not_listed = not_listed.sum();
        let mut reversals: Vec<ReversalResult> = self
            .reversals
            .into_iter()
            .enumerate()
            // A second motor turns round with its axis; where no program moves an axis, no block made it turn.
            .take(self.machine.program_axes().len())
            .flat_map(|(axis, meter)| meter.finish(axis, &self.machine, self.path.whole(), &arcs))
            .collect();
        reversals.sort_by_key(|reversal| (reversal.scan, reversal.index));
        let last_scan = self.last.as_ref().map(|feedback| feedback.scan);
        let (processes, faults) = self.faults.finish();
        Measurements {
            ended: ended(&self.machine, self.last.as_ref()),
            last: self.last.map(|of| (of.scan, Mode::from_wire(of.mode))),
            scans: match (self.first_scan, last_scan) {
                (Some(first), Some(last)) => last - first + 1,
                _ => 0,
            },
            scan_period_s: self.machine.scan_period_s(),
            axes: self.axes,
            contour_error_mm: self.contour_mm,
            contour_parts: self.contour_parts.finish(),
            travelled: self.travelled,
            blocks: self.blocks.finish(),
            arcs,
            ball_bars,
            reversals,
            reversals_not_listed,
            limits: self.audit.counts,
            windows_voided: self.windows_voided,
            windows: self.windows,
            samples_lost: self.samples_lost + self.aligner.late(),
            missing_scans: self.missing_scans,
            overrun_scans: self.last.map_or(0, |last| {
                last.overrun_scans.saturating_sub(self.overrun_before)
            }),
            motion_digest: self.motion_digest.map(monitor::digest::hex),
            processes,
            faults,
            auxiliary: self.auxiliary.finish(),
        }
    }

    /// One scan, all channels.
    fn scan(&mut self, set: &ScanSet) {
        if let Some(instruments) = &set.instruments {
            // Zero is in a log that has not all of a sample: its recorder has noted the digest.
            self.motion_digest = Some(instruments.motion_digest())
                .filter(|digest| *digest != 0)
                .or(self.motion_digest);
        }
        let Some(feedback) = set.feedback.as_deref() else {
            self.orphans.0 += u64::from(set.instruments.is_some());
            for (index, orphans) in self.orphans.1.iter_mut().enumerate() {
                *orphans += u64::from(set.command(index).is_some());
            }
            self.take_backlash(set);
            return;
        };
        self.count_losses(set, feedback);
        let follows = self
            .last
            .as_ref()
            .is_none_or(|last| feedback.scan == last.scan + 1);
        if !follows {
            self.reversals.iter_mut().for_each(ReversalMeter::interrupt);
            self.contour_parts.interrupt();
        }
        if self.first_scan.is_none() && self.begins_at > 0 {
            self.overrun_before = feedback.overrun_scans;
            for (axis, feedback) in self.axes.iter_mut().zip(feedback.axes()) {
                axis.missed_before = feedback.missed_scans;
            }
        }
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
                self.contour_parts.command(index, command.position);
            }
        }
        self.take_drops(set, feedback);
        for pair in self.machine.gantries().filter(|_| drives_on) {
            if let Some(axis) = self.axes.get_mut(pair.follower) {
                axis.skew_mm.take(self.machine.skew_mm(&pair, feedback));
            }
        }
        self.audit.take(feedback);
        self.auxiliary.take(feedback);
        let contour_mm = self.path_deviation(set, feedback, drives_on, follows);
        if self.on_path && drives_on {
            self.take_block(set, feedback, contour_mm);
        }
        let seen = self.seen(set, feedback, contour_mm);
        self.faults.scan(feedback, &seen);
        self.take_backlash(set);
        for (index, commanded) in self.commanded.iter_mut().enumerate() {
            *commanded = set.command(index).is_some();
        }
        self.last = Some(*feedback);
    }

    /// How far axes with a weight have dropped by this scan.
    fn take_drops(&mut self, set: &ScanSet, feedback: &Feedback) {
        let Some(seen) = &set.instruments else {
            return;
        };
        let (mode, cause) = (feedback.mode, feedback.cause);
        let stop = (Mode::from_wire(mode), Cause::from_wire(cause));
        let axes = self.axes.iter_mut().zip(feedback.axes()).zip(&seen.axes);
        for ((axis, shown), seen_axis) in axes {
            if let Some(meter) = &mut axis.drop {
                let samples = seen.subsamples as usize;
                let table_mm = seen_axis.table_mm.iter().take(samples).copied();
                meter.take(stop, shown, table_mm);
            }
        }
    }

    /// The scan's share of the block that its command is in; off the path it is none's.
    fn take_block(&mut self, set: &ScanSet, feedback: &Feedback, contour_mm: f64) {
        if feedback.tag.is_off_path() {
            return;
        }
        let Some(line) = self.path.line_to_list(feedback.tag.element) else {
            return;
        };
        let errors = (0..self.axes.len()).map(|axis| {
            let command = set.command(axis);
            command.map_or(0.0, |command| command.following_error_mm)
        });
        self.blocks.take(line, contour_mm, errors);
    }

    /// Places of all motors as those of the axes that the program names.
    fn of_program(&self, motors_mm: [f64; MAX_AXES]) -> AxisVector {
        self.machine.to_program_axes(motors_mm).into()
    }

    /// Where an instrument saw the tables of these axes in a subsample.
    fn tables(&self, seen: &Instruments, sub: usize) -> AxisVector {
        self.of_program(seen.places_mm(sub, |axis| &axis.table_mm))
    }

    /// The same of the motors, without the compensation in force.
    fn motors(&self, seen: &Instruments, sub: usize) -> AxisVector {
        let mut motors_mm = seen.places_mm(sub, |axis| &axis.motor_mm);
        for (motor_mm, backlash_mm) in motors_mm.iter_mut().zip(&self.backlash_mm) {
            *motor_mm -= backlash_mm;
        }
        self.of_program(motors_mm)
    }

    /// The backlash compensation that is in force in the next scan.
    fn take_backlash(&mut self, set: &ScanSet) {
        for (index, backlash_mm) in self.backlash_mm.iter_mut().enumerate() {
            if let Some(command) = set.command(index) {
                *backlash_mm = command.compensation_mm;
            }
        }
        if (0..self.axes.len()).all(|axis| set.command(axis).is_some()) {
            self.backlash_scan = Some(set.scan);
        }
    }

    /// What the instruments saw of the tool at the end of this scan, for whoever follows a fault.
    fn seen(&mut self, set: &ScanSet, feedback: &Feedback, contour_mm: f64) -> Seen {
        let Some(instruments) = set.instruments.as_deref() else {
            return Seen {
                contour_mm,
                ..Seen::default()
            };
        };
        let table = self.tables(instruments, instruments.last().unwrap_or(0));
        let tool_mm = self.kinematics.tool(&table);
        let left = if feedback.tag.is_off_path() {
            &feedback.interrupted_at
        } else {
            &feedback.tag
        };
        Seen {
            contour_mm,
            tool_mm: Some(tool_mm),
            from_path_mm: self.path.error_mm(left, &tool_mm).filter(|_| self.on_path),
        }
    }

    /// Contour error of the scan's instrument samples, and the arcs' share of them; the largest, in mm.
    fn path_deviation(
        &mut self,
        set: &ScanSet,
        feedback: &Feedback,
        drives_on: bool,
        follows: bool,
    ) -> f64 {
        if !drives_on {
            self.arcs.leave();
        }
        let Some(instruments) = set.instruments.as_deref() else {
            return 0.0;
        };
        if !self.on_path || !drives_on {
            return 0.0;
        }
        let count = (instruments.subsamples as usize).min(bus::sample::MAX_SUBSAMPLES);
        let mut largest_mm = 0.0f64;
        let mut last_mm = None;
        let executing = !feedback.window.is_none();
        // Behind a gap the motor side is not known before the compensation in force is.
        let whole = follows || self.backlash_scan == feedback.scan.checked_sub(1);
        if whole {
            self.arcs.scan(feedback, executing);
        }
        for sub in 0..count {
            // From here on everything is in the coordinates of the program: where the axes had the tool on the part.
            let table = self.kinematics.tool(&self.tables(instruments, sub));
            let motor = self.kinematics.tool(&self.motors(instruments, sub));
            if let Some(error_mm) = self.path.error_mm(&feedback.tag, &table) {
                self.contour_mm.take(error_mm);
                largest_mm = largest_mm.max(error_mm);
                last_mm = Some(table);
            }
            let share = (sub + 1) as f64 / count as f64;
            if whole {
                self.arcs.sample(set.scan as f64 + share, &table, &motor);
            }
        }
        if let Some(tool_mm) = last_mm {
            let error = travelled::Error {
                mm: largest_mm,
                scan: feedback.scan,
                line: self.path.line(&feedback.tag).unwrap_or(0),
            };
            self.travelled.take(tool_mm, error);
        }
        // Tripped, in a jog and on the return to path no axis is to follow the path.
        let left = feedback.window.is_none() && !feedback.interrupted_at.is_off_path();
        if whole && !left && !feedback.tag.is_off_path() {
            self.take_contour_parts(set, feedback, instruments);
        }
        largest_mm
    }

    /// Where the deviation at the end of the scan comes from, if the commands of all axes are known.
    fn take_contour_parts(&mut self, set: &ScanSet, feedback: &Feedback, seen: &Instruments) {
        let Some(last) = seen.last() else {
            return;
        };
        let (table, motor) = (self.tables(seen, last), self.motors(seen, last));
        let mut commanded = [0.0; MAX_AXES];
        let of_axes = commanded.iter_mut().zip(&self.machine.axes).enumerate();
        for (index, (place, axis)) in of_axes {
            let Some(command) = set.command(index) else {
                return;
            };
            *place = command.position as f64 * axis.increment_mm();
        }
        let commanded = self.of_program(commanded);
        let mut nearest = |axes: &AxisVector| {
            let tool = self.kinematics.tool(axes);
            self.path.nearest(&feedback.tag, &tool)
        };
        if let (Some(table), Some(motor), Some(setpoint)) =
            (nearest(&table), nearest(&motor), nearest(&commanded))
        {
            self.contour_parts.take(&contour_parts::Reading {
                table,
                motor,
                setpoint,
                axes: commanded,
            });
        }
    }

    fn count_losses(&mut self, set: &ScanSet, feedback: &Feedback) {
        // Judged one scan later: nobody waits for the instruments of a run's last scan.
        let instrumented = std::mem::replace(&mut self.instrumented, set.instruments.is_some());
        let (orphan_instruments, orphan_commands) =
            std::mem::replace(&mut self.orphans, (0, [0; MAX_AXES]));
        let Some(last) = &self.last else {
            self.samples_lost += orphan_instruments;
            return;
        };
        if feedback.incarnation != last.incarnation {
            // A master that was restarted goes on at a later scan: nobody knows which there were.
            return;
        }
        self.samples_lost += u64::from(!instrumented && self.has_instruments);
        let missing = feedback.scan.saturating_sub(last.scan + 1);
        if missing > 0 && self.missing_scans.len() < GAPS_MAX {
            self.missing_scans.push((last.scan + 1, feedback.scan - 1));
        }
        self.samples_lost += missing;
        if self.has_instruments {
            self.samples_lost += missing.saturating_sub(orphan_instruments);
        }
        let known = self.commanded.into_iter().zip(orphan_commands);
        let axes = feedback.axes().iter().zip(last.axes());
        for ((axis, before), (commanded, orphans)) in axes.zip(known) {
            // Commands up to the one that acts now, which the drive took; the first scan of a run takes none.
            let first = (last.scan + u64::from(commanded)).max(1);
            let scans = feedback.scan.saturating_sub(first);
            let up_to_now =
                (axis.command_scan.saturating_add(1).min(feedback.scan)).saturating_sub(first);
            let missed = axis.missed_scans.saturating_sub(before.missed_scans);
            let taken = up_to_now.min(scans.saturating_sub(missed.into()));
            self.samples_lost += taken.saturating_sub(orphans);
        }
    }
}

/// Lead of the axis that moves a coordinate of the program, in mm; none where coordinates are not axes.
fn lead_mm(machine: &Machine, kinematics: &Kinematics, axis: usize) -> Option<f64> {
    let cartesian = *kinematics == Kinematics::Cartesian;
    let axis = machine.axes.get(axis).filter(|_| cartesian)?;
    Some(axis.lead_mm)
}

fn ended(machine: &Machine, last: Option<&Feedback>) -> Option<Ended> {
    last.and_then(|last| Ended::told(machine, last, last.run))
}

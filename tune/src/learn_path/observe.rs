//! Goes through the log of a run once and gathers what it shows along the path; or why it is none to learn from.

use std::path::Path as FilePath;

use crate::path_learning::{Pass, PassScan};
use crate::recording::InStep;
use ::report::contour::begins_mm;
use ::report::measure::RunPath;
use anyhow::{bail, ensure};
use bus::sample::{Feedback, Mode, PathTag};
use loops::path_correction::{Knot, PathCorrection};
use machine::learned_path::{LEARNED_PATH_ROWS_MAX, LearnedPath};
use machine::{Axis, Machine, PositionFeedback};
use monitor::log::{LOG_FILE, Reader, Sample, part_files};
use path::geometry::{AxisVector, Feed, Path};
use path::kinematics::Kinematics;

/// What a log showed.
pub(crate) struct Observed {
    /// Name of the program's file.
    pub program: String,
    pub program_hash: u64,
    /// Elements that the tool passed, and the path's length before each, in mm.
    pub elements: Vec<(u32, f64)>,
    pub pass: Pass,
}

/// One scan as the log has it.
struct Seen {
    tag: PathTag,
    command_mm: AxisVector,
    motor_mm: AxisVector,
    scale_mm: AxisVector,
}

/// Gathers a pass that ran with this correction.
pub(crate) fn observe(
    run_dir: &FilePath,
    machine: &Machine,
    in_force: Option<&LearnedPath>,
) -> anyhow::Result<Observed> {
    ensure!(
        program::kinematics_of(machine) == Kinematics::Cartesian,
        "learns along the path only where each axis moves the tool in a straight line of its own"
    );
    ensure!(
        machine.axes.iter().all(Axis::has_letter),
        "learns along the path only where each axis has a letter and one motor"
    );
    let Some(RunPath::Whole(path)) = ::report::run_path(run_dir)? else {
        bail!("the program has too many elements to be learned along its path");
    };
    let log = run_dir.join(LOG_FILE);
    let parts = part_files(run_dir)?.len();
    ensure!(
        parts == 1,
        "{}: the log is in {parts} parts: nothing is learned along the path: run again",
        run_dir.display()
    );
    let mut reader = Reader::open(&log)?;
    let program = reader.info().program.clone();
    let mut gathering = Gathering::new(machine);
    while let Some(sample) = reader.next_sample()? {
        gathering.take(sample)?;
    }
    ensure!(
        reader.cut().is_none(),
        "{}: is not whole: nothing is learned along the path: run again",
        log.display()
    );
    let starts = begins_mm(&path);
    let program_hash = gathering.program_hash;
    let scans = gathering.finish()?;
    let elements = elements(&starts, &scans);
    let corrections = corrections(machine, in_force);
    let pass = pass(machine, path, &starts, &scans, &corrections)?;
    Ok(Observed {
        program,
        program_hash,
        elements,
        pass,
    })
}

/// From the first element that the tool was on to the last.
fn elements(starts: &[f64], scans: &[Seen]) -> Vec<(u32, f64)> {
    let of = |seen: Option<&Seen>| seen.map_or(0, |seen| seen.tag.element);
    let (first, last) = (of(scans.first()), of(scans.last()));
    let known = |element: u32| Some((element, *starts.get(element as usize)?));
    (first..=last).filter_map(known).collect()
}

fn corrections(machine: &Machine, in_force: Option<&LearnedPath>) -> Vec<PathCorrection> {
    let of_axis = |axis: usize| {
        let knots = in_force.map_or(&[][..], |path| &path.knots);
        let knots = knots.iter().map(|knot| Knot {
            place_mm: knot.place_mm,
            speed_mm_s: knot.speed_mm_s,
            correction_mm: knot.correction_mm.get(axis).copied().unwrap_or(0.0),
        });
        PathCorrection::new(0, Vec::new(), knots.collect())
    };
    (0..machine.axes.len()).map(of_axis).collect()
}

/// The scans on the path, each with its errors.
fn pass(
    machine: &Machine,
    path: Path,
    starts: &[f64],
    scans: &[Seen],
    corrections: &[PathCorrection],
) -> anyhow::Result<Pass> {
    let scan_s = machine.scan_period_s();
    let place_mm = |seen: &Seen| {
        let start_mm = starts.get(seen.tag.element as usize).copied();
        start_mm.unwrap_or(0.0) + seen.tag.distance_mm
    };
    let offsets_mm = offsets_mm(machine, scans)?;
    let feeds: Vec<bool> = path
        .elements
        .iter()
        .map(|element| element.feed != Feed::Rapid && !element.is_dwell())
        .collect();
    let mut path = RunPath::from(path);
    let next = scans.iter().skip(1).map(Some).chain([None]);
    let scans = scans.iter().zip(next).map(|(seen, next)| {
        let here_mm = place_mm(seen);
        let speed_mm_s = next.map_or(0.0, |next| (place_mm(next) - here_mm) / scan_s);
        let tool_mm = seen.scale_mm - offsets_mm;
        let nearest = path.nearest(&seen.tag, &tool_mm);
        let (error_mm, behind_mm) = nearest.map_or((AxisVector::zeros(), 0.0), |nearest| {
            let along = nearest.tangent * nearest.across_mm.dot(&nearest.tangent);
            let behind_mm = (seen.command_mm - tool_mm).dot(&nearest.tangent);
            (along - nearest.across_mm, behind_mm)
        });
        let correction_mm = AxisVector::from_fn(|axis, _| {
            let of_axis = corrections.get(axis);
            of_axis.map_or(0.0, |of| of.value_mm(here_mm, speed_mm_s))
        });
        PassScan {
            place_mm: here_mm,
            feeds: feeds
                .get(seen.tag.element as usize)
                .copied()
                .unwrap_or(false),
            command_mm: seen.command_mm,
            error_mm,
            behind_mm,
            correction_mm,
        }
    });
    Ok(Pass::new(scan_s, machine.axes.len(), scans.collect()))
}

/// What each scale shows beside its motor's encoder whichever way the axis goes, in mm: they have no common zero, unless the axis
/// is controlled by its scale.
fn offsets_mm(machine: &Machine, scans: &[Seen]) -> anyhow::Result<AxisVector> {
    let mut offsets_mm = AxisVector::zeros();
    for ((index, axis), offset_mm) in machine.axes.iter().enumerate().zip(offsets_mm.iter_mut()) {
        let of = |vector: &AxisVector| vector.get(index).copied().unwrap_or(0.0);
        let mut ways = [(0.0, 0.0); 2];
        let mut has_scale = false;
        for (seen, next) in scans.iter().zip(scans.iter().skip(1)) {
            let step_mm = of(&next.command_mm) - of(&seen.command_mm);
            has_scale |= of(&seen.scale_mm) != of(&seen.motor_mm);
            let [down, up] = &mut ways;
            let way = if step_mm > 0.0 { up } else { down };
            if step_mm != 0.0 {
                way.0 += of(&seen.scale_mm) - of(&seen.motor_mm);
                way.1 += 1.0;
            }
        }
        ensure!(
            has_scale,
            "axis {} shows no table scale: what the motor's encoder shows is not where the table is, and nothing is learned along the path",
            axis.name
        );
        let means = ways.iter().filter(|(_, count)| *count > 0.0);
        let means: Vec<f64> = means.map(|(sum_mm, count)| sum_mm / count).collect();
        if axis.feedback == PositionFeedback::Motor && !means.is_empty() {
            *offset_mm = means.iter().sum::<f64>() / means.len() as f64;
        }
    }
    Ok(offsets_mm)
}

/// Brings the channels together and judges whether the run is one to learn from.
struct Gathering<'a> {
    machine: &'a Machine,
    in_step: InStep,
    scans: Vec<Seen>,
    last_scan: Option<u64>,
    epoch: Option<u32>,
    program_hash: u64,
    /// The tool has come to the end of the path.
    over: bool,
}

impl Gathering<'_> {
    fn new(machine: &Machine) -> Gathering<'_> {
        Gathering {
            machine,
            in_step: InStep::new(machine.axes.len()),
            scans: Vec::new(),
            last_scan: None,
            epoch: None,
            program_hash: 0,
            over: false,
        }
    }

    fn take(&mut self, sample: Sample) -> anyhow::Result<()> {
        if let Sample::Roster(roster) = &sample {
            let mut members = roster.participants.iter().filter(|of| of.job != 0);
            ensure!(
                members.all(|of| of.incarnation <= 1),
                "a process of this run was replaced: nothing is learned along the path: run again"
            );
        }
        match self.in_step.take(sample) {
            Some(feedback) => self.scan(&feedback),
            None => Ok(()),
        }
    }

    /// One scan of which everything is there.
    fn scan(&mut self, feedback: &Feedback) -> anyhow::Result<()> {
        if feedback.window.is_none() || feedback.mode == Mode::Finished as u32 {
            self.over |= !self.scans.is_empty();
            return Ok(());
        }
        let refuse = |why: &str| {
            anyhow::anyhow!(
                "{why} in scan {}: nothing is learned along the path: run again",
                feedback.scan
            )
        };
        if self.over || *self.epoch.get_or_insert(feedback.epoch) != feedback.epoch {
            return Err(refuse("the tool had left the path"));
        }
        if feedback.override_percent != 100 || feedback.hold != 0 {
            return Err(refuse("a hold or a feed override"));
        }
        if self.last_scan.is_some_and(|last| feedback.scan != last + 1) {
            return Err(refuse("scans are missing"));
        }
        self.last_scan = Some(feedback.scan);
        self.program_hash = feedback.program_hash;
        let tag = self.in_step.commands().next().map(|command| command.tag);
        let Some(tag) = tag.filter(|tag| !tag.is_off_path()) else {
            return Err(refuse("the tool was off the path"));
        };
        if feedback.axes().iter().any(|axis| axis.missed_in_a_row > 0) {
            return Err(refuse("a servo was late"));
        }
        let positions = |of: &dyn Fn(usize) -> i64| {
            let mut mm = AxisVector::zeros();
            for ((index, axis), mm) in self
                .machine
                .program_axes()
                .iter()
                .enumerate()
                .zip(mm.iter_mut())
            {
                *mm = of(index) as f64 * axis.increment_mm();
            }
            mm
        };
        let axis = |index: usize| feedback.axes().get(index);
        let command = |index: usize| self.in_step.commands().nth(index);
        let seen = Seen {
            tag,
            command_mm: positions(&|index| command(index).map_or(0, |of| of.position)),
            motor_mm: positions(&|index| axis(index).map_or(0, |of| of.motor_position)),
            scale_mm: positions(&|index| axis(index).map_or(0, |of| of.scale_position)),
        };
        self.scans.push(seen);
        ensure!(
            self.scans.len() <= LEARNED_PATH_ROWS_MAX,
            "the program takes more than {LEARNED_PATH_ROWS_MAX} scans: it is too long to be learned along its path"
        );
        Ok(())
    }

    fn finish(self) -> anyhow::Result<Vec<Seen>> {
        ensure!(
            self.scans.len() > 1,
            "the log shows no motion along a path: nothing is learned"
        );
        Ok(self.scans)
    }
}

//! What must hold in every feedback, whatever dies: judged scan by scan, of the samples alone.

use std::collections::VecDeque;

use bus::sample::{AxisFeedback, Cause, Feedback, Mode, PathTag};
use machine::{Machine, WithinPeriod};
use path::geometry::Path;

/// Violations kept in words; more are counted only.
const WORDS_MAX: usize = 40;
/// Scans back that a command's place on the path is known for.
const TAGS_KEPT: usize = 2048;

/// Bounds of one axis, in increments and scans.
#[derive(Debug, Clone)]
struct Bounds {
    name: String,
    increment_mm: f64,
    /// Most increments per scan.
    step: f64,
    /// Most change of that per scan.
    step_change: f64,
    low: f64,
    high: f64,
}

/// The last command of an axis.
#[derive(Debug, Clone, Copy, Default)]
struct Commanded {
    /// It was the master's own.
    is_own: bool,
    scan: u64,
}

/// What the machine did since it was last asked ([`Judge::reactions`]).
#[derive(Debug, Clone, Copy, Default)]
pub struct Reactions {
    /// A master came back with its drives off.
    pub disabled: bool,
    /// All axes braked together.
    pub tripped: bool,
    /// The drives braked by themselves: the master was stalled, or their bus was silent. The machine waited for its operator.
    pub stalled: bool,
    /// The tool came to rest on the path, a window in force.
    pub rested: bool,
    /// Another controller's command was taken.
    pub took_over: bool,
    /// Scans were overrun.
    pub overrun_scans: u32,
    /// Scans without a command.
    pub missed_scans: u32,
}

/// Whether the drives have braked by themselves in a trip of this cause: the machine waits for its operator.
pub fn braked_alone(cause: u32) -> bool {
    let causes = [Cause::Stalled, Cause::DriveLost, Cause::DriveOff];
    causes.iter().any(|of| *of as u32 == cause)
}

/// How a run has ended that nobody ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finish {
    /// Its program is done.
    Done,
    /// The master was starved, or drives on a bus were left without frames, and the machine tripped for that.
    Starved,
    /// Otherwise: a violation.
    Broken,
}

/// Judges the feedbacks of one run.
#[derive(Debug)]
pub struct Judge {
    bounds: Vec<Bounds>,
    /// The program's path, where setpoints lie on it to the increment.
    path: Option<Path>,
    end: Vec<i64>,
    before: Option<Feedback>,
    /// Last steps of the command positions, in increments per scan, and over how many scans.
    steps: Vec<Option<(f64, f64)>>,
    /// Who has commanded the axes last, and for which scan.
    commanded: Vec<Commanded>,
    /// Where on the path the setpoints of the last scans are.
    tags: VecDeque<(u64, PathTag)>,
    ends: bool,
    watchdog_scans: u32,
    /// The trip that the machine is in is that of a master which was late, and its feedback shows by how much; or of drives on a bus
    /// that were left without frames.
    is_starved: bool,
    /// The PC stalled while the machine was tripped: its drives have switched off by themselves.
    stalled_in_trip: bool,
    /// What was done to the cell may leave drives on a bus without frames.
    pub drives_are_left: bool,
    /// Drives on a bus stand where they stand, and come on once the run has begun.
    starts_anywhere: bool,
    /// They have not been on yet.
    comes_on: bool,
    /// Since they were last taken.
    pub reactions: Reactions,
    /// In words.
    pub violations: Vec<String>,
    /// All of them.
    pub violation_count: u64,
    /// Feedbacks judged.
    pub judged: u64,
    /// Feedbacks that were not seen (this process was late).
    pub unseen: u64,
    /// Largest distance of a commanded point from its place on the path, in increments.
    pub off_path_increments_max: f64,
}

impl Reactions {
    /// In words; `early`: the next fault came before it was over, `ended`: so did the end of the run.
    pub fn words(self, early: bool, ended: bool) -> &'static str {
        match self {
            _ if early => "(another fault before it was over)",
            r if r.disabled => "drives off, enabled and resumed by the operator",
            r if r.stalled => "drives braked by themselves, enabled and resumed by the operator",
            r if r.tripped => "all axes braked together, went back to the path and on",
            r if r.rested && !ended => "rested on the path and went on",
            r if r.took_over => "standby took over, motion undisturbed",
            _ if ended => "the program was done meanwhile",
            r if r.overrun_scans > 0 => "scans overrun, counted, went on",
            r if r.missed_scans > 0 => "scans missed, counted, went on",
            _ => "motion undisturbed",
        }
    }
}

impl Judge {
    /// For a run of `path` on `machine`.
    pub fn new(machine: &Machine, path: &Path) -> Judge {
        let period_s = machine.scan_period_s();
        let bounds: Vec<Bounds> = machine
            .axes
            .iter()
            .map(|axis| {
                let increment_mm = axis.increment_mm();
                Bounds {
                    name: axis.name.clone(),
                    increment_mm,
                    step: axis.rapid_mm_s * period_s / increment_mm * (1.0 + 1e-9) + 1.0,
                    step_change: axis.acceleration_mm_s2 * period_s * period_s / increment_mm
                        * (1.0 + 1e-9)
                        + 2.0,
                    low: axis.travel_min_mm / increment_mm - 1.0,
                    high: axis.travel_max_mm / increment_mm + 1.0,
                }
            })
            .collect();
        let straight = machine.kinematics.is_none()
            && machine.interpolation.within_period == WithinPeriod::Exact;
        let end = path.end().unwrap_or_else(path::geometry::AxisVector::zeros);
        let end = end.iter().zip(&bounds);
        let end = end.map(|(mm, axis)| libm::round(mm / axis.increment_mm) as i64);
        Judge {
            end: if straight { end.collect() } else { Vec::new() },
            path: straight.then(|| path.clone()),
            steps: vec![None; bounds.len()],
            commanded: vec![Commanded::default(); bounds.len()],
            bounds,
            before: None,
            tags: VecDeque::new(),
            ends: false,
            watchdog_scans: machine.scan.watchdog_scans,
            is_starved: false,
            stalled_in_trip: false,
            drives_are_left: false,
            starts_anywhere: machine.bus.is_some(),
            comes_on: machine.bus.is_some(),
            reactions: Reactions::default(),
            violations: Vec::new(),
            violation_count: 0,
            judged: 0,
            unseen: 0,
            off_path_increments_max: 0.0,
        }
    }

    /// The run is being ended from outside: the machine may stop.
    pub fn may_stop(&mut self) {
        self.ends = true;
    }

    /// What the machine did since the last time.
    pub fn reactions(&mut self) -> Reactions {
        std::mem::take(&mut self.reactions)
    }

    /// The newest feedback.
    pub fn newest(&self) -> Option<&Feedback> {
        self.before.as_ref()
    }

    /// Notes a violation.
    pub fn violated(&mut self, words: String) {
        self.violation_count += 1;
        if self.violations.len() < WORDS_MAX {
            self.violations.push(words);
        }
    }

    /// Takes one feedback, in order.
    pub fn take(&mut self, feedback: &Feedback) {
        self.judged += 1;
        let scan = feedback.scan;
        let Some(mode) = Mode::from_wire(feedback.mode) else {
            self.violated(format!(
                "scan {scan}: mode {} does not exist",
                feedback.mode
            ));
            return;
        };
        if let Some(before) = self.before.take() {
            let restarted = feedback.incarnation > before.incarnation;
            if scan <= before.scan {
                self.violated(format!("scan {scan} comes after scan {}", before.scan));
            }
            self.unseen += scan.saturating_sub(before.scan + 1);
            let gap = scan > before.scan + 1;
            if !gap {
                self.transition(feedback, mode, &before, restarted);
            }
            self.react(feedback, mode, &before, restarted);
            if gap || restarted {
                self.forget();
            } else {
                self.command_positions(feedback, mode, &before);
            }
        } else if mode != Mode::Enabled && scan == 0 && !self.starts_anywhere {
            self.violated(format!("the run begins {}", mode.word()));
        }
        self.travel(feedback, mode);
        if mode == Mode::Disabled {
            self.stands_by_encoders(feedback);
        }
        self.note_tag(feedback, mode);
        self.before = Some(*feedback);
    }

    fn forget(&mut self) {
        self.steps.iter_mut().for_each(|step| *step = None);
        self.commanded.fill(Commanded::default());
        self.tags.clear();
    }

    fn transition(&mut self, feedback: &Feedback, mode: Mode, before: &Feedback, restarted: bool) {
        let Some(from) = Mode::from_wire(before.mode) else {
            return;
        };
        let late_scans = feedback.overrun_scans.saturating_sub(before.overrun_scans);
        if from == Mode::Tripped && late_scans >= self.watchdog_scans {
            self.stalled_in_trip = true;
        }
        let allowed = match (from, mode) {
            (a, b) if a == b => true,
            // Drives that have braked by themselves take a while to come on again.
            (Mode::Tripped, Mode::Disabled) if braked_alone(before.cause) => true,
            (Mode::Tripped, Mode::Disabled) | (Mode::Disabled, Mode::Enabled)
                if self.stalled_in_trip =>
            {
                true
            }
            (_, Mode::Disabled) => restarted,
            (Mode::Disabled, Mode::Enabled) => feedback.hold == 1 || self.comes_on,
            (Mode::Enabled, Mode::Finished | Mode::Tripped) => true,
            (Mode::Tripped, Mode::Enabled) => true,
            (Mode::Enabled, Mode::Stopping | Mode::Stopped) => self.ends,
            // Also a machine at rest trips when a servo is lost or the master stalls.
            (Mode::Stopping, Mode::Stopped | Mode::Tripped) => self.ends,
            (Mode::Stopped, Mode::Tripped) => self.ends,
            _ => false,
        };
        if !allowed || restarted && mode != Mode::Disabled {
            self.violated(format!(
                "scan {}: {} after {}",
                feedback.scan,
                mode.word(),
                from.word()
            ));
        }
        if mode == Mode::Enabled {
            self.stalled_in_trip = false;
            self.comes_on = false;
        }
        if mode == Mode::Tripped && from != Mode::Tripped {
            // A machine that was stalled itself waits for its operator.
            self.is_starved =
                feedback.cause == Cause::Stalled as u32 && late_scans >= self.watchdog_scans;
            if feedback.cause == Cause::Stalled as u32 && !self.is_starved {
                self.violated(format!(
                    "scan {}: tripped by a stall, and the master was {late_scans} scans late",
                    feedback.scan
                ));
            }
            let lost =
                [Cause::ServoLost, Cause::Watchdog, Cause::Stalled].map(|cause| cause as u32);
            let silent = self.drives_are_left
                && feedback.cause != Cause::Stalled as u32
                && braked_alone(feedback.cause);
            self.is_starved |= silent;
            if !lost.contains(&feedback.cause) && !silent {
                let why = Cause::from_wire(feedback.cause).map_or("an unknown cause", Cause::words);
                let axis = self.bounds.get(feedback.cause_axis as usize);
                let axis = axis.map_or("none", |axis| axis.name.as_str());
                self.violated(format!(
                    "scan {}: tripped, axis {axis}: {why}",
                    feedback.scan
                ));
            }
        }
    }

    fn react(&mut self, feedback: &Feedback, mode: Mode, before: &Feedback, restarted: bool) {
        let reactions = &mut self.reactions;
        reactions.disabled |= restarted;
        reactions.tripped |= mode == Mode::Tripped;
        reactions.stalled |= mode == Mode::Tripped && braked_alone(feedback.cause);
        reactions.rested |=
            mode == Mode::Enabled && !feedback.window.is_none() && feedback.at_rest == 1;
        let controller = |axis: &AxisFeedback| (axis.taken_role, axis.taken_incarnation);
        let mut pairs = feedback.axes().iter().zip(before.axes());
        reactions.took_over |=
            !restarted && pairs.any(|(now, then)| controller(now) != controller(then));
        reactions.overrun_scans += feedback.overrun_scans.saturating_sub(before.overrun_scans);
        if !restarted {
            let pairs = feedback.axes().iter().zip(before.axes());
            reactions.missed_scans += pairs
                .map(|(now, then)| now.missed_scans.saturating_sub(then.missed_scans))
                .sum::<u32>();
        }
    }

    /// Steps of the command positions within what velocity and acceleration allow; commanded points on the path.
    fn command_positions(&mut self, feedback: &Feedback, mode: Mode, before: &Feedback) {
        let commanded = |mode| {
            matches!(
                mode,
                Mode::Enabled | Mode::Stopping | Mode::Finished | Mode::Stopped
            )
        };
        // In the scan in which a trip ends the command position goes from the encoder's place to the command's.
        let judged = commanded(mode) && Mode::from_wire(before.mode).is_some_and(commanded);
        if !judged {
            self.steps.iter_mut().for_each(|step| *step = None);
            return;
        }
        let pairs = feedback.axes().iter().zip(before.axes()).enumerate();
        for (index, (now, then)) in pairs {
            let (Some(bounds), Some(last)) = (self.bounds.get(index), self.steps.get_mut(index))
            else {
                continue;
            };
            let Some(commanded) = self.commanded.get_mut(index) else {
                continue;
            };
            let way = now.command_position.saturating_sub(then.command_position) as f64;
            let since = commanded.scan.max(then.command_scan);
            *commanded = Commanded {
                is_own: now.command_scan == then.command_scan && (way != 0.0 || commanded.is_own),
                scan: since,
            };
            // An axis whose servo is silent is brought to rest along the window by the master itself.
            let at = match commanded.is_own && way != 0.0 {
                true => feedback.scan.saturating_sub(1),
                false => now.command_scan,
            };
            let scans = at.saturating_sub(since) as f64;
            let mut broken = None;
            if scans == 0.0 {
                if way != 0.0 {
                    broken = Some(format!(
                        "its command position moved by {way} increments without a command"
                    ));
                }
            } else {
                commanded.scan = at;
                let step = way / scans;
                if step.abs() > bounds.step {
                    broken = Some(format!(
                        "{step:.0} increments a scan, limit {:.0}",
                        bounds.step
                    ));
                }
                if let Some((last_step, last_scans)) = *last {
                    // Mean steps over several scans: their centres lie that far apart.
                    let apart = (scans + last_scans) / 2.0;
                    let change = (step - last_step).abs();
                    if change > bounds.step_change * apart {
                        broken = Some(format!(
                            "step changes by {change:.0} increments, limit {:.0}",
                            bounds.step_change * apart
                        ));
                    }
                }
                *last = Some((step, scans));
            }
            if let Some(words) = broken {
                let words = format!("scan {}: axis {}: {words}", feedback.scan, bounds.name);
                self.violated(words);
            }
        }
        self.on_path(feedback);
    }

    fn note_tag(&mut self, feedback: &Feedback, mode: Mode) {
        let on = matches!(mode, Mode::Enabled | Mode::Stopping)
            && !feedback.window.is_none()
            && !feedback.tag.is_off_path();
        if on && self.path.is_some() {
            self.tags.push_back((feedback.scan, feedback.tag));
            if self.tags.len() > TAGS_KEPT {
                self.tags.pop_front();
            }
        }
    }

    fn on_path(&mut self, feedback: &Feedback) {
        let Some(path) = &self.path else { return };
        let mut worst = None;
        for (index, (axis, bounds)) in feedback.axes().iter().zip(&self.bounds).enumerate() {
            // The tag tells where the servo's command lies, not the master's own.
            if self.commanded.get(index).is_some_and(|axis| axis.is_own) {
                continue;
            }
            let tag = self
                .tags
                .iter()
                .rev()
                .find(|(scan, _)| *scan == axis.command_scan);
            let Some((_, tag)) = tag else { continue };
            if self.starts_anywhere && tag.element == 0 {
                // The way to where the program begins.
                continue;
            }
            let Some(element) = path.elements.get(tag.element as usize) else {
                continue;
            };
            let point = element.point(tag.distance_mm);
            let Some(mm) = point.get(index) else { continue };
            let off = (axis.command_position as f64 - mm / bounds.increment_mm).abs();
            self.off_path_increments_max = self.off_path_increments_max.max(off);
            if off > 1.0 {
                worst = Some((bounds.name.clone(), off));
            }
        }
        if let Some((axis, off)) = worst {
            self.violated(format!(
                "scan {}: axis {axis} is commanded {off:.1} increments off the path",
                feedback.scan
            ));
        }
    }

    fn travel(&mut self, feedback: &Feedback, mode: Mode) {
        let mut outside = None;
        for (axis, bounds) in feedback.axes().iter().zip(&self.bounds) {
            let command_position = axis.command_position as f64;
            if mode != Mode::Disabled && !(bounds.low..=bounds.high).contains(&command_position) {
                outside = Some(bounds.name.clone());
            }
        }
        if let Some(axis) = outside {
            self.violated(format!(
                "scan {}: axis {axis} is commanded out of its travel",
                feedback.scan
            ));
        }
    }

    fn stands_by_encoders(&mut self, feedback: &Feedback) {
        let differs = feedback.axes().iter().any(|axis| {
            ![axis.motor_position, axis.scale_position].contains(&axis.command_position)
        });
        if differs {
            self.violated(format!(
                "scan {}: drives off, and a command position is not where the encoder is",
                feedback.scan
            ));
        }
    }

    /// The run has ended: finished, with every command position at the programmed end, to the increment; or in the trip of a
    /// master that was late, which is a stop as it is documented. What it is to end with.
    pub fn finish(&mut self) -> Finish {
        let Some(last) = self.before else {
            self.violated("no feedback was ever seen".into());
            return Finish::Broken;
        };
        if last.mode == Mode::Tripped as u32 && self.is_starved {
            return Finish::Starved;
        }
        if last.mode != Mode::Finished as u32 {
            let mode = Mode::from_wire(last.mode).map_or("in an unknown mode", Mode::word);
            self.violated(format!("the run ended {mode} in scan {}", last.scan));
            return Finish::Broken;
        }
        let command_positions: Vec<i64> = last.axes().iter().map(|a| a.command_position).collect();
        let end = self.end.get(..command_positions.len()).unwrap_or_default();
        if !end.is_empty() && command_positions != end {
            self.violated(format!(
                "the program ends at {end:?}, the command positions at {command_positions:?}"
            ));
        }
        Finish::Done
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use bus::sample::WindowId;
    use bytemuck::Zeroable;
    use path::geometry::{AxisVector, Element, Feed};

    use super::*;

    fn judge() -> Judge {
        let folder = std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let machine = Machine::load(&folder.join("machine.toml")).expect("the machine");
        let mut end = AxisVector::zeros();
        end[0] = 10.0;
        let line = Element::line(1, AxisVector::zeros(), end, Feed::Rapid);
        let elements = vec![line];
        Judge::new(&machine, &Path { elements })
    }

    /// Along the line at 10 mm/s: 10 µm a scan.
    fn at(scan: u64) -> Feedback {
        let mut feedback = Feedback::zeroed();
        feedback.scan = scan;
        feedback.mode = Mode::Enabled as u32;
        feedback.incarnation = 1;
        feedback.axis_count = 2;
        feedback.window = WindowId {
            checksum: 1,
            sequence: 1,
            incarnation: 1,
        };
        feedback.tag.distance_mm = scan as f64 * 0.01;
        for axis in &mut feedback.axes {
            axis.command_scan = scan.saturating_sub(1);
        }
        feedback.axes[0].command_position = scan.saturating_sub(1) as i64 * 10_000;
        feedback
    }

    fn verdict(change: impl Fn(u64, &mut Feedback)) -> u64 {
        let mut judge = judge();
        for scan in 0..20 {
            let mut feedback = at(scan);
            change(scan, &mut feedback);
            judge.take(&feedback);
        }
        judge.violation_count
    }

    #[test]
    fn motion_along_the_path_is_no_violation() {
        assert_eq!(verdict(|_, _| {}), 0);
    }

    #[test]
    fn a_command_position_off_the_path_is_seen() {
        assert!(verdict(|scan, f| f.axes[1].command_position = i64::from(scan > 9) * 3) > 0);
        assert_eq!(
            verdict(|scan, f| f.axes[1].command_position = i64::from(scan > 9)),
            0
        );
    }

    #[test]
    fn a_step_of_speed_is_seen_and_one_over_missed_scans_is_not() {
        // 5000 mm/s² is 5000 increments of change in a scan.
        let jump = |scan: u64, f: &mut Feedback| f.tag.distance_mm += f64::from(u8::from(scan > 9));
        let with = |by: i64| {
            verdict(move |scan, f| {
                jump(scan, f);
                f.tag = PathTag::OFF_PATH;
                f.axes[0].command_position += i64::from(scan > 9) * by;
            })
        };
        assert!(with(6_000) > 0);
        assert_eq!(with(4_000), 0);
        let missed = verdict(|scan, f| {
            if (8..12).contains(&scan) {
                f.axes[0].command_scan = 6;
                f.axes[0].command_position = 60_000;
            }
        });
        assert_eq!(missed, 0);
    }

    #[test]
    fn modes_change_only_as_documented() {
        let into = |mode: Mode, cause: Cause| {
            verdict(move |scan, f| {
                if scan > 9 {
                    f.mode = mode as u32;
                    f.cause = cause as u32;
                }
            })
        };
        assert_eq!(into(Mode::Tripped, Cause::ServoLost), 0);
        assert!(into(Mode::Tripped, Cause::BadValue) > 0);
        assert!(into(Mode::Jogging, Cause::None) > 0);
        assert!(into(Mode::Disabled, Cause::None) > 0);
        assert!(into(Mode::Stopping, Cause::None) > 0);
    }

    #[test]
    fn a_run_may_end_in_the_trip_of_a_master_that_was_late_and_in_no_other() {
        let watchdog_scans = judge().watchdog_scans;
        for (cause, late_scans, finish, violations) in [
            (Cause::Stalled, watchdog_scans, Finish::Starved, 0),
            (Cause::Stalled, watchdog_scans - 1, Finish::Broken, 2),
            (Cause::ServoLost, watchdog_scans, Finish::Broken, 1),
            (Cause::FollowingError, 0, Finish::Broken, 2),
        ] {
            let mut judge = judge();
            for scan in 0..20 {
                let mut feedback = at(scan);
                if scan > 9 {
                    feedback.mode = Mode::Tripped as u32;
                    feedback.cause = cause as u32;
                    feedback.overrun_scans = late_scans;
                }
                judge.take(&feedback);
            }
            assert_eq!(judge.finish(), finish, "{cause:?} {late_scans}");
            let words = &judge.violations;
            assert_eq!(judge.violation_count, violations, "{cause:?} {words:?}");
        }
    }

    #[test]
    fn drives_on_a_bus_may_be_lost_only_where_they_were_left_without_frames() {
        for (are_left, finish, violations) in
            [(true, Finish::Starved, 0), (false, Finish::Broken, 2)]
        {
            let mut judge = judge();
            judge.drives_are_left = are_left;
            for scan in 0..20 {
                let mut feedback = at(scan);
                if scan > 9 {
                    feedback.mode = Mode::Tripped as u32;
                    feedback.cause = Cause::DriveLost as u32;
                }
                judge.take(&feedback);
            }
            assert_eq!(judge.finish(), finish);
            assert_eq!(judge.violation_count, violations, "{:?}", judge.violations);
        }
    }

    #[test]
    fn a_run_that_does_not_end_at_the_programmed_point_is_seen() {
        for (command_position, count) in [(10_000_000, 0), (10_000_001, 1)] {
            let mut judge = judge();
            let mut last = at(0);
            last.axes[0].command_position = command_position;
            last.tag.distance_mm = 10.0;
            judge.take(&last);
            last.scan = 1;
            last.mode = Mode::Finished as u32;
            judge.take(&last);
            judge.finish();
            assert_eq!(judge.violation_count, count, "{:?}", judge.violations);
        }
    }
}

//! What must hold of a run under soak: every feedback by the judge of all runs (`invariants::Feedbacks`), and beside it what a soak
//! knows: which modes follow each other when nobody orders a stop, which trips its faults may cause, and how such a run may end.

use bus::sample::{AxisFeedback, Cause, Feedback, Mode};
use machine::Machine;

use crate::invariants::{Course, Feedbacks, Violations};

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
    machine: Machine,
    course: Course,
    /// Of the feedbacks alone.
    pub feedbacks: Feedbacks,
    ends: bool,
    /// The trip that the machine is in is that of a master which was late, and its feedback shows by how much; or of drives on a bus
    /// that were left without frames.
    is_starved: bool,
    /// The PC stalled while the machine was tripped: its drives have switched off by themselves.
    stalled_in_trip: bool,
    /// What was done to the cell may leave drives on a bus without frames.
    pub drives_are_left: bool,
    /// Drives on a bus stand where they stand, come on once the run has begun, and have not been on yet.
    comes_on: bool,
    /// Since they were last taken.
    pub reactions: Reactions,
    /// What must not be.
    pub violations: Violations,
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
    /// For a run of this course on `machine`.
    pub fn new(machine: &Machine, course: Course) -> Judge {
        Judge {
            feedbacks: Feedbacks::new(machine),
            machine: machine.clone(),
            course,
            ends: false,
            is_starved: false,
            stalled_in_trip: false,
            drives_are_left: false,
            comes_on: machine.bus.is_some(),
            reactions: Reactions::default(),
            violations: Violations::default(),
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
        self.feedbacks.newest()
    }

    /// Takes one feedback, in order.
    pub fn take(&mut self, feedback: &Feedback) {
        let before = self.newest().copied();
        let (course, found) = (&self.course, &mut self.violations);
        let Some(mode) = self.feedbacks.take(course, feedback, found) else {
            return;
        };
        if let Some(before) = before {
            let restarted = feedback.incarnation > before.incarnation;
            if feedback.scan <= before.scan + 1 {
                self.transition(feedback, mode, &before, restarted);
            }
            self.react(feedback, mode, &before, restarted);
        } else if mode != Mode::Enabled && feedback.scan == 0 && !self.comes_on {
            found.say(0, format!("the run begins {}", mode.word()));
        }
    }

    fn transition(&mut self, feedback: &Feedback, mode: Mode, before: &Feedback, restarted: bool) {
        let Some(from) = Mode::from_wire(before.mode) else {
            return;
        };
        let watchdog_scans = self.machine.scan.watchdog_scans;
        let late_scans = feedback.overrun_scans.saturating_sub(before.overrun_scans);
        if from == Mode::Tripped && late_scans >= watchdog_scans {
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
            let words = format!("{} after {}", mode.word(), from.word());
            self.violations.say(feedback.scan, words);
        }
        if mode == Mode::Enabled {
            self.stalled_in_trip = false;
            self.comes_on = false;
        }
        if mode == Mode::Tripped && from != Mode::Tripped {
            // A machine that was stalled itself waits for its operator.
            self.is_starved =
                feedback.cause == Cause::Stalled as u32 && late_scans >= watchdog_scans;
            if feedback.cause == Cause::Stalled as u32 && !self.is_starved {
                let words =
                    format!("tripped by a stall, and the master was {late_scans} scans late");
                self.violations.say(feedback.scan, words);
            }
            let lost =
                [Cause::ServoLost, Cause::Watchdog, Cause::Stalled].map(|cause| cause as u32);
            let silent = self.drives_are_left
                && feedback.cause != Cause::Stalled as u32
                && braked_alone(feedback.cause);
            self.is_starved |= silent;
            if !lost.contains(&feedback.cause) && !silent {
                let why = Cause::from_wire(feedback.cause).map_or("an unknown cause", Cause::words);
                let axis = self.machine.axis_name(feedback.cause_axis as usize);
                let words = format!("tripped, axis {axis}: {why}");
                self.violations.say(feedback.scan, words);
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

    /// The run has ended: finished, with every command position at the programmed end, to the increment; or in the trip of a
    /// master that was late, which is a stop as it is documented. What it is to end with.
    pub fn finish(&mut self) -> Finish {
        let found = &mut self.violations;
        let Some(last) = self.feedbacks.newest() else {
            found.say(0, "no feedback was ever seen".into());
            return Finish::Broken;
        };
        if last.mode == Mode::Tripped as u32 && self.is_starved {
            return Finish::Starved;
        }
        if last.mode != Mode::Finished as u32 {
            let mode = Mode::from_wire(last.mode).map_or("in an unknown mode", Mode::word);
            found.say(last.scan, format!("the run ended {mode}"));
            return Finish::Broken;
        }
        self.feedbacks.end(&self.course, found);
        Finish::Done
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use bus::sample::{PathTag, WindowId};
    use bytemuck::Zeroable;
    use plant_sim::plant_file::PlantFile;

    use super::*;

    fn judge() -> Judge {
        let folder = std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let mut machine = Machine::load(&folder).expect("the machine");
        machine.program.work_offset_mm.clear();
        let plant = PlantFile::load(&folder.join("plant.toml")).expect("the plant");
        let course = Course::of(&machine, &plant, "line.ngc", "G21 G90\nG0 X10\nM2\n");
        Judge::new(&machine, course.expect("a course"))
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
        let axis = &mut feedback.axes[0];
        axis.command_position = scan.saturating_sub(1) as i64 * 10_000;
        axis.motor_position = axis.command_position;
        feedback
    }

    /// Has it judge that motion, with this change of each feedback.
    fn judged(mut judge: Judge, change: impl Fn(u64, &mut Feedback)) -> Judge {
        for scan in 0..20 {
            let mut feedback = at(scan);
            change(scan, &mut feedback);
            judge.take(&feedback);
        }
        judge
    }

    /// The same with this mode and cause from the middle on, the master so many scans late.
    fn judged_in(judge: Judge, mode: Mode, cause: Cause, late_scans: u32) -> Judge {
        judged(judge, |scan, f| {
            if scan > 9 {
                f.mode = mode as u32;
                f.cause = cause as u32;
                f.overrun_scans = late_scans;
            }
        })
    }

    #[test]
    fn a_step_of_speed_is_seen_and_one_over_missed_scans_is_not() {
        let found =
            |change: &dyn Fn(u64, &mut Feedback)| judged(judge(), change).violations.0.len();
        assert_eq!(found(&|_, _| {}), 0);
        // 5000 mm/s² is 5000 increments of change in a scan.
        let with = |by: i64| {
            found(&|scan, f| {
                f.tag = PathTag::OFF_PATH;
                f.axes[0].command_position += i64::from(scan > 9) * by;
            })
        };
        assert!(with(6_000) > 0);
        assert_eq!(with(4_000), 0);
        let missed = found(&|scan, f| {
            if (8..12).contains(&scan) {
                f.axes[0].command_scan = 6;
                f.axes[0].command_position = 60_000;
            }
        });
        assert_eq!(missed, 0);
    }

    #[test]
    fn modes_change_only_as_documented() {
        let into = |mode, cause| judged_in(judge(), mode, cause, 0).violations.0.len();
        assert_eq!(into(Mode::Tripped, Cause::ServoLost), 0);
        assert!(into(Mode::Tripped, Cause::BadValue) > 0);
        assert!(into(Mode::Jogging, Cause::None) > 0);
        assert!(into(Mode::Disabled, Cause::None) > 0);
        assert!(into(Mode::Stopping, Cause::None) > 0);
    }

    #[test]
    fn a_run_may_end_in_the_trip_of_a_late_master_or_of_drives_left_without_frames_and_in_no_other()
    {
        let watchdog_scans = judge().machine.scan.watchdog_scans;
        for (cause, late_scans, drives_are_left, finish, violations) in [
            (Cause::Stalled, watchdog_scans, false, Finish::Starved, 0),
            (Cause::Stalled, watchdog_scans - 1, false, Finish::Broken, 2),
            (Cause::ServoLost, watchdog_scans, false, Finish::Broken, 1),
            (Cause::FollowingError, 0, false, Finish::Broken, 2),
            (Cause::DriveLost, 0, true, Finish::Starved, 0),
            (Cause::DriveLost, 0, false, Finish::Broken, 2),
        ] {
            let mut judge = judge();
            judge.drives_are_left = drives_are_left;
            let mut judge = judged_in(judge, Mode::Tripped, cause, late_scans);
            assert_eq!(judge.finish(), finish, "{cause:?} {late_scans}");
            let words = &judge.violations.0;
            assert_eq!(judge.violations.0.len(), violations, "{cause:?} {words:?}");
        }
    }
}

//! Invariants of feedbacks, for a soak of real processes, which does not see all of them, and for a cell in one process.
//!
//! | name | in words | tolerance |
//! |---|---|---|
//! | order | scans come one after the other, in modes that there are | none |
//! | steps | command positions keep speed and acceleration of their axis, over scans without a command too | 1 increment a scan, 2 of its change |
//! | path | an axis that its servo commands is where the tag of that scan says | 1 increment; axes that follow another one: of the setpoints |
//! | travel | no axis is commanded out of its travel | 1 increment |
//! | encoders | with open loops the command positions follow the encoders | none |
//! | drives off | nothing moves without drives | 20 µm of springs that relax |
//! | speeds | no axis is faster than its rapid speed; commands are numbers | 5 %, 5 mm/s of the drive's overshoot |
//! | hold | in hold at rest no command position moves | 3 interpolation periods, in which a window may come into force |
//! | braking | after a trip all axes come to rest by their quick stops | 0.06 s; an axis below 0.5 mm/s stands |
//! | end | a program that is done leaves the command positions at its end | none |
//!
//! Drives on a bus move on while nobody asks them: of their own motion (drives off, speeds, braking) nothing is judged.

use std::collections::VecDeque;

use bus::sample::{AxisFeedback, Feedback, MAX_AXES, Mode, PathTag};
use machine::{Axis, Machine, PositionFeedback, WithinPeriod};

use super::{Course, Violations};

/// Scans back that a command's place on the path is known for.
const TAGS_KEPT: usize = 2048;
/// In hold at rest a window that was on its way may still come into force for so many periods.
const HOLD_PERIODS: u32 = 3;
/// A drive's own overshoot: share of the rapid speed, and mm/s.
const OVERSHOOT: (f64, f64) = (0.05, 5.0);
/// Braking may take longer than the quick stop of the speeds: torque, screw, the controller's last scan, in s.
const BRAKING_SLACK_S: f64 = 0.06;
/// Speed below which an axis stands, in mm/s.
const STANDS_MM_S: f64 = 0.5;
/// An axis without drive relaxes by no more, in µm.
const RELAXES_UM: f64 = 20.0;

/// What is known of an axis from the feedbacks before.
#[derive(Debug, Clone, Copy, Default)]
struct Known {
    /// The last step of its command position, in increments per scan, and over how many scans.
    step: Option<(f64, f64)>,
    /// The last command was the master's own.
    is_own: bool,
    /// The scan that it was for.
    commanded: u64,
    /// Command position less encoder, while the drives are off.
    deviation: i64,
}

/// Judges the feedbacks of one run.
#[derive(Debug)]
pub struct Feedbacks {
    machine: Machine,
    known: [Known; MAX_AXES],
    before: Option<Feedback>,
    /// Where on the path the setpoints of the last scans are.
    tags: VecDeque<(u64, PathTag)>,
    /// Encoders when the drives went off.
    off_at: Option<[i64; MAX_AXES]>,
    held_scans: u32,
    /// All axes have to stand from this scan on, once they did not.
    stands_from: Option<u64>,
    /// Feedbacks judged.
    pub judged: u64,
    /// Feedbacks that were not seen.
    pub unseen: u64,
    /// Largest distance of a commanded point from its place on the path, in increments.
    pub off_path_increments_max: f64,
}

/// A position as the loop of an axis sees it, in increments.
pub(super) fn encoder(settings: &Axis, axis: &AxisFeedback) -> i64 {
    match settings.feedback {
        PositionFeedback::Scale => axis.scale_position,
        PositionFeedback::Motor => axis.motor_position,
    }
}

/// How long the slowest quick stop takes from the speeds of a feedback, in s.
pub(super) fn braking_s(machine: &Machine, feedback: &Feedback) -> f64 {
    let axes = feedback.axes().iter().zip(&machine.axes);
    let stops = axes.map(|(axis, settings)| fastest_mm_s(axis) / settings.quick_stop_mm_s2);
    stops.fold(0.0, f64::max)
}

/// The larger one of speed and commanded speed of an axis.
pub(super) fn fastest_mm_s(axis: &AxisFeedback) -> f64 {
    let commanded_mm_s = axis.velocity_command_mm_s.abs();
    axis.velocity_mm_s.abs().max(commanded_mm_s)
}

/// Whether the command positions follow setpoints.
fn is_commanded(mode: u32) -> bool {
    matches!(
        Mode::from_wire(mode),
        Some(Mode::Enabled | Mode::Stopping | Mode::Finished | Mode::Stopped)
    )
}

impl Feedbacks {
    /// Of a run on this machine.
    pub fn new(machine: &Machine) -> Feedbacks {
        Feedbacks {
            machine: machine.clone(),
            known: Default::default(),
            before: None,
            tags: VecDeque::new(),
            off_at: None,
            held_scans: 0,
            stands_from: None,
            judged: 0,
            unseen: 0,
            off_path_increments_max: 0.0,
        }
    }

    /// The newest feedback.
    pub fn newest(&self) -> Option<&Feedback> {
        self.before.as_ref()
    }

    /// Takes one feedback, in order; the mode it is in, if there is such a mode.
    pub fn take(
        &mut self,
        course: &Course,
        feedback: &Feedback,
        found: &mut Violations,
    ) -> Option<Mode> {
        self.judged += 1;
        let scan = feedback.scan;
        let Some(mode) = Mode::from_wire(feedback.mode) else {
            found.say(scan, format!("mode {} does not exist", feedback.mode));
            return None;
        };
        let before = self.before.replace(*feedback);
        if let Some(before) = before.filter(|before| scan <= before.scan) {
            found.say(scan, format!("it comes after scan {}", before.scan));
        }
        let expected = before.map_or(scan, |before| before.scan + 1);
        self.unseen += scan.saturating_sub(expected);
        let is_next = |of: &Feedback| scan == expected && feedback.incarnation == of.incarnation;
        let next_to = before.filter(is_next);
        if next_to.is_none() {
            self.forget(scan > expected);
        }
        if let Some(before) = &next_to {
            self.hold(before, feedback, found);
            self.steps(before, feedback, found);
            if is_commanded(before.mode) && is_commanded(feedback.mode) {
                self.path(course, feedback, found);
            }
        }
        self.travel(feedback, found);
        self.encoders(next_to.as_ref(), feedback, found);
        if self.machine.bus.is_none() {
            self.drives_off(feedback, found);
            self.speeds(feedback, found);
            self.braking(next_to.as_ref(), feedback, found);
        }
        self.note_tag(feedback);
        Some(mode)
    }

    /// Some feedbacks were not seen (a `gap`), or another master begins.
    fn forget(&mut self, gap: bool) {
        for known in &mut self.known {
            let deviation = known.deviation;
            *known = Known {
                deviation,
                ..Known::default()
            };
        }
        self.tags.clear();
        self.off_at.take_if(|_| gap);
        (self.held_scans, self.stands_from) = (0, None);
    }

    fn steps(&mut self, before: &Feedback, feedback: &Feedback, found: &mut Violations) {
        // In the scan in which a trip ends the command position goes from the encoder's place to the command's.
        if !is_commanded(before.mode) || !is_commanded(feedback.mode) {
            self.known.iter_mut().for_each(|known| known.step = None);
            return;
        }
        let period_s = self.machine.scan_period_s();
        let axes = feedback.axes().iter().zip(before.axes());
        let known = self.known.iter_mut().zip(&self.machine.axes);
        for ((now, then), (known, settings)) in axes.zip(known) {
            let increment_mm = settings.increment_mm();
            let way = now.command_position.saturating_sub(then.command_position) as f64;
            let since = known.commanded.max(then.command_scan);
            known.is_own = now.command_scan == then.command_scan && (way != 0.0 || known.is_own);
            // An axis whose servo is silent is brought to rest along the window by the master itself.
            let at = match known.is_own && way != 0.0 {
                true => feedback.scan.saturating_sub(1),
                false => now.command_scan,
            };
            known.commanded = at.max(since);
            let mut say = |words: String| {
                found.say(feedback.scan, format!("axis {}: {words}", settings.name));
            };
            let scans = at.saturating_sub(since) as f64;
            if scans == 0.0 {
                if way != 0.0 {
                    say(format!(
                        "its command position moved by {way} increments without a command"
                    ));
                }
                continue;
            }
            let step = way / scans;
            let most = settings.rapid_mm_s * period_s / increment_mm * (1.0 + 1e-9) + 1.0;
            if step.abs() > most {
                say(format!("{step:.0} increments a scan, limit {most:.0}"));
            }
            let last = known.step.replace((step, scans));
            let Some((last_step, last_scans)) = last else {
                continue;
            };
            let change_max = settings.acceleration_mm_s2 * period_s * period_s / increment_mm;
            // Mean steps over several scans: their centres lie that far apart.
            let most = (change_max * (1.0 + 1e-9) + 2.0) * (scans + last_scans) / 2.0;
            let change = (step - last_step).abs();
            if change > most {
                say(format!(
                    "step changes by {change:.0} increments, limit {most:.0}"
                ));
            }
        }
    }

    fn note_tag(&mut self, feedback: &Feedback) {
        let moves = [Mode::Enabled as u32, Mode::Stopping as u32].contains(&feedback.mode);
        // On a bus the first element is the way to where the program begins.
        let begins = self.machine.bus.is_some() && feedback.tag.element == 0;
        if moves && !feedback.window.is_none() && !feedback.tag.is_off_path() && !begins {
            self.tags.push_back((feedback.scan, feedback.tag));
            if self.tags.len() > TAGS_KEPT {
                self.tags.pop_front();
            }
        }
    }

    fn path(&mut self, course: &Course, feedback: &Feedback, found: &mut Violations) {
        if self.machine.interpolation.within_period != WithinPeriod::Exact {
            return;
        }
        let setpoints = course.limits.setpoints();
        let known = self.known.iter().zip(self.machine.program_axes());
        for (index, (axis, (known, settings))) in feedback.axes().iter().zip(known).enumerate() {
            // The tag tells where the servo's command lies, not the master's own.
            if known.is_own {
                continue;
            }
            let mut tags = self.tags.iter().rev();
            let tag = tags.find(|(scan, _)| *scan <= axis.command_scan);
            let Some((_, tag)) = tag.filter(|(scan, _)| *scan == axis.command_scan) else {
                continue;
            };
            let Some(element) = course.path.get(tag.element) else {
                continue;
            };
            let point = setpoints.kinematics.axes(&element.point(tag.distance_mm));
            let most = match setpoints.follow_master(element) {
                true => setpoints.off_place_increments(),
                false => 1.0,
            };
            let Some(mm) = point.get(index) else { continue };
            let off = (axis.command_position as f64 - mm / settings.increment_mm()).abs();
            self.off_path_increments_max = self.off_path_increments_max.max(off);
            if off > most {
                let words = format!(
                    "axis {} is commanded {off:.1} increments off the path",
                    settings.name
                );
                found.say(feedback.scan, words);
            }
        }
    }

    fn travel(&self, feedback: &Feedback, found: &mut Violations) {
        for (axis, settings) in feedback.axes().iter().zip(&self.machine.axes) {
            let increment_mm = settings.increment_mm();
            let low = settings.travel_min_mm / increment_mm - 1.0;
            let high = settings.travel_max_mm / increment_mm + 1.0;
            if feedback.mode != Mode::Disabled as u32
                && !(low..=high).contains(&(axis.command_position as f64))
            {
                let words = format!("axis {} is commanded out of its travel", settings.name);
                found.say(feedback.scan, words);
            }
        }
    }

    /// In a trip, and over a restart, the command position is the encoder's; where the drives were switched off it stays as far from
    /// the encoder as it was.
    fn encoders(&mut self, before: Option<&Feedback>, feedback: &Feedback, found: &mut Violations) {
        let was = before.map(|before| before.mode);
        let (off, tripped) = (Mode::Disabled as u32, Mode::Tripped as u32);
        let is_off = feedback.mode == off;
        let is_tripped = feedback.mode == tripped && was == Some(tripped);
        let known = self.known.iter_mut().zip(&self.machine.axes);
        for (axis, (known, settings)) in feedback.axes().iter().zip(known) {
            let deviation = axis
                .command_position
                .saturating_sub(encoder(settings, axis));
            let may_be = match was {
                // It is switched off in this scan.
                Some(mode) if mode != off && mode != tripped && is_off => deviation,
                Some(mode) if mode == off => known.deviation,
                _ => 0,
            };
            if (is_off || is_tripped) && deviation != may_be {
                let words = format!(
                    "axis {}: open loop, command position {deviation} increments off its encoder: {may_be}",
                    settings.name
                );
                found.say(feedback.scan, words);
            }
            known.deviation = if is_off { deviation } else { 0 };
        }
    }

    fn drives_off(&mut self, feedback: &Feedback, found: &mut Violations) {
        if feedback.mode != Mode::Disabled as u32 {
            self.off_at = None;
            return;
        }
        let axes = || feedback.axes().iter().zip(&self.machine.axes);
        let off_at = self.off_at.get_or_insert_with(|| {
            let mut at = [0; MAX_AXES];
            let encoders = axes().map(|(axis, settings)| encoder(settings, axis));
            at.iter_mut().zip(encoders).for_each(|(at, is)| *at = is);
            at
        });
        for ((axis, settings), at) in axes().zip(off_at) {
            let moved = encoder(settings, axis).saturating_sub(*at) as f64;
            let moved_um = moved * settings.increment_mm() * 1e3;
            if moved_um.abs() > RELAXES_UM {
                let words = format!(
                    "axis {}: moved {moved_um} µm with the drives off",
                    settings.name
                );
                found.say(feedback.scan, words);
            }
        }
    }

    fn speeds(&self, feedback: &Feedback, found: &mut Violations) {
        for (axis, settings) in feedback.axes().iter().zip(&self.machine.axes) {
            let (velocity, command) = (axis.velocity_mm_s, axis.velocity_command_mm_s);
            let most = settings.rapid_mm_s * (1.0 + OVERSHOOT.0) + OVERSHOOT.1;
            if velocity.is_nan() || velocity.abs() > most || !command.is_finite() {
                let words = format!(
                    "axis {}: {velocity} mm/s, commanded {command}: at most {most}",
                    settings.name
                );
                found.say(feedback.scan, words);
            }
        }
    }

    fn hold(&mut self, before: &Feedback, feedback: &Feedback, found: &mut Violations) {
        let is_held = feedback.hold == 1 && feedback.mode == Mode::Enabled as u32;
        let periods = self.machine.scan.interpolation_period_scans * HOLD_PERIODS;
        let mut axes = feedback.axes().iter().zip(before.axes());
        let moves = axes.any(|(is, was)| is.command_position != was.command_position);
        if is_held && moves && self.held_scans > periods {
            found.say(feedback.scan, "the command moves in hold".into());
        }
        let rests = is_held && feedback.at_rest == 1;
        self.held_scans = if rests { self.held_scans + 1 } else { 0 };
    }

    fn braking(&mut self, before: Option<&Feedback>, feedback: &Feedback, found: &mut Violations) {
        let tripped = Mode::Tripped as u32;
        if feedback.mode != tripped {
            self.stands_from = None;
        } else if before.is_some_and(|before| before.mode != tripped) {
            let longest_s = braking_s(&self.machine, feedback) + BRAKING_SLACK_S;
            let scans = libm::ceil(longest_s / self.machine.scan_period_s()) as u64;
            self.stands_from = Some(feedback.scan + scans);
        }
        let mut axes = feedback.axes().iter();
        let Some(from) = self.stands_from else { return };
        if axes.all(|axis| axis.velocity_mm_s.abs() < STANDS_MM_S) {
            self.stands_from = None;
        } else if feedback.scan > from {
            let words =
                format!("an axis still moves after a trip: all were to stand by scan {from}");
            found.say(feedback.scan, words);
        }
    }

    /// The run has ended: where its program is done, every command position is at the programmed end.
    pub fn end(&self, course: &Course, found: &mut Violations) {
        let finished = |of: &&Feedback| of.mode == Mode::Finished as u32;
        let Some(last) = self.newest().filter(finished) else {
            return;
        };
        let axes = last.axes().iter().zip(self.machine.program_axes());
        for ((axis, settings), end) in axes.zip(&course.end) {
            let off = axis.command_position.saturating_sub(*end);
            if off != 0 {
                let words = format!(
                    "axis {}: ends {off} increments off the programmed end",
                    settings.name
                );
                found.say(last.scan, words);
            }
        }
    }
}

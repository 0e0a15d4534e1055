//! Windows of motion in step with the spindle: threads, whose place follows the measured angle, and taps, which the spindle follows.
//!
//! Both are windows as all others: intended motion, then braking to rest along the path. A thread's are planned from the angle and the
//! speed that the newest feedback shows, and override and hold do not count in it. A tap's are those of an axis that never asks more
//! than the spindle can do; the master lets the spindle follow it, also in the tail.

use std::collections::VecDeque;

use bus::sample::{Feedback, MAX_WINDOW_SETPOINTS};
use machine::{Axis, Machine, SPINDLE_RAMP_SHARE};
use path::geometry::{Element, Feed};
use path::path_part::PathPart;
use path::profile::PathState;
use path::spindle_following::{FollowingSettings, FollowingState, SpindlePlace};
use path::window::{PlanError, PlannedSetpoint, WindowOutcome, WindowPlanner, WindowRequest};
use program::{Event, EventKind};

use crate::course::window_setpoints;
use crate::error::EventError;

/// Setpoints of a window that neither move as intended nor brake: the last two are the same, one is for rounding.
const REST_SETPOINTS: u32 = 4;

/// A direction whose share along an axis is this near to 1 is the axis': 0.05 µm aside in a tap of 30 mm.
const SAME_DIRECTION: f64 = 1e-12;

/// An element that is travelled in step with the spindle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pass {
    /// Index of the element.
    pub element: u32,
    /// Line of the program.
    pub line: u32,
    /// Along it for one turn, in mm.
    pub mm_per_turn: f64,
    /// A tap: the spindle follows it, and not the other way round.
    pub tap: bool,
}

impl Pass {
    /// What its motion may do on a machine, with windows that end at rest.
    pub fn settings(
        &self,
        element: &Element,
        windows: &WindowPlanner,
        machine: &Machine,
    ) -> FollowingSettings {
        let mut settings = FollowingSettings::of(element, windows.limits());
        let spindle = machine.spindle.unwrap_or_default();
        if self.tap {
            let ramp_mm_s2 = spindle.ramp_rpm_s / 60.0 * self.mm_per_turn;
            let most = SPINDLE_RAMP_SHARE * ramp_mm_s2;
            settings.acceleration_mm_s2 = settings.acceleration_mm_s2.min(most);
            let fastest = spindle.speed_max_rpm / 60.0 * self.mm_per_turn;
            settings.speed_mm_s = settings.speed_mm_s.min(fastest);
        }
        let used = machine.intended_setpoints() + REST_SETPOINTS;
        let braking = window_setpoints(machine).saturating_sub(used);
        let braking_s = f64::from(braking) * settings.scan_period_s;
        let stops = settings.acceleration_mm_s2 * braking_s;
        settings.speed_mm_s = settings.speed_mm_s.min(stops);
        settings
    }
}

/// The pass that motion from this state is in, or begins, and how far along it the state is.
pub fn pass_from(
    passes: &VecDeque<Pass>,
    path: &PathPart,
    state: &PathState,
    until_element: u32,
) -> Option<(Pass, f64)> {
    let on = path.get(state.element)?;
    let behind = state.distance_mm >= on.length_mm && state.is_at_rest();
    if !behind {
        return pass_of(passes, state.element).map(|pass| (pass, state.distance_mm));
    }
    if state.dwell_remaining_scans > 0 {
        return None;
    }
    let mut next = state.element.checked_add(1)?;
    // Elements without a length are left out before.
    while !acts(path.get(next)?) {
        next += 1;
    }
    if next >= until_element {
        return None;
    }
    pass_of(passes, next).map(|pass| (pass, 0.0))
}

fn acts(element: &Element) -> bool {
    element.is_dwell() || element.length_mm > 0.0
}

/// The first element of a pass behind the one of this state: no other window goes there.
pub fn first_pass_behind(passes: &VecDeque<Pass>, state: &PathState) -> u32 {
    let behind = passes.partition_point(|pass| pass.element <= state.element);
    passes.get(behind).map_or(u32::MAX, |pass| pass.element)
}

/// The pass of an element, of passes in their order.
pub fn pass_of(passes: &VecDeque<Pass>, element: u32) -> Option<Pass> {
    let index = passes
        .binary_search_by_key(&element, |pass| pass.element)
        .ok()?;
    passes.get(index).copied()
}

/// What is remembered of the pass under way: the turn whose index its thread begins at. Forgotten, another turn does as well.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InStep {
    begins: Option<(u32, f64)>,
}

/// The spindle as a feedback shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Turning {
    /// Angle in the sense that it turns, in turns.
    turns: f64,
    turns_s: f64,
}

impl Turning {
    fn of(feedback: &Feedback) -> Turning {
        let auxiliary = &feedback.auxiliary;
        let sign = if auxiliary.levels.spindle_rpm < 0.0 {
            -1.0
        } else {
            1.0
        };
        Turning {
            turns: sign * auxiliary.spindle_turns,
            turns_s: (sign * auxiliary.spindle_rpm / 60.0).max(0.0),
        }
    }

    fn after(&self, time_s: f64) -> f64 {
        self.turns + self.turns_s * time_s
    }
}

/// What a window in step is planned with.
#[derive(Debug)]
pub struct Request<'a> {
    /// What is asked of every window.
    pub window: &'a WindowRequest,
    /// What was measured.
    pub feedback: &'a Feedback,
    /// Scan of its first setpoint.
    pub first_scan: u64,
    /// The machine.
    pub machine: &'a Machine,
}

impl InStep {
    /// Fills `setpoints` with the window of a pass that follows `from`.
    ///
    /// # Errors
    /// The state is not on the pass.
    pub fn plan(
        &mut self,
        windows: &WindowPlanner,
        (pass, distance_mm): (Pass, f64),
        from: &PathState,
        request: &Request<'_>,
        setpoints: &mut Vec<PlannedSetpoint>,
    ) -> Result<WindowOutcome, PlanError> {
        setpoints.clear();
        let wrong = || PlanError::State {
            element: pass.element,
            distance_mm,
            speed_mm_s: from.speed_mm_s,
        };
        let element = windows.path().get(pass.element);
        let element = element.ok_or_else(wrong)?;
        let settings = pass.settings(element, windows, request.machine);
        let mut state = FollowingState {
            distance_mm,
            speed_mm_s: from.speed_mm_s,
        };
        let at = |state: &FollowingState| {
            let state = PathState {
                element: pass.element,
                distance_mm: state.distance_mm,
                speed_mm_s: state.speed_mm_s,
                ..PathState::default()
            };
            windows.setpoint(&state).ok_or_else(wrong)
        };
        let mut before = at(&state)?;
        let asked = self.asked(&pass, element, &settings, &state, request);
        let mut done = false;
        let intended = request.window.intended_setpoints as usize;
        while setpoints.len() < intended && !done {
            if !(request.window.repeats_start && setpoints.is_empty()) {
                asked.step(&settings, &mut state, setpoints.len());
            }
            before = at(&state)?;
            setpoints.push(before);
            done = settings.is_done(&state);
        }
        let intended_setpoints = setpoints.len() as u32;
        let last = before.state;
        let ends_program = done
            && windows.is_end(&last)
            && !windows.is_held_back(&last, request.window.until_element);
        loop {
            settings.brake(&mut state);
            let setpoint = at(&state)?;
            setpoints.push(setpoint);
            let same = setpoint.position_increments == before.position_increments;
            if state.is_at_rest() && same {
                break;
            }
            before = setpoint;
            if setpoints.len() >= MAX_WINDOW_SETPOINTS {
                setpoints.clear();
                return Err(PlanError::DoesNotStop {
                    element: pass.element,
                    braking_setpoints_max: MAX_WINDOW_SETPOINTS as u32 - intended_setpoints,
                });
            }
        }
        Ok(WindowOutcome {
            intended_setpoints,
            setpoint_count: setpoints.len() as u32,
            ends_program,
        })
    }

    /// What the setpoints of a window are asked to do.
    fn asked(
        &mut self,
        pass: &Pass,
        element: &Element,
        settings: &FollowingSettings,
        state: &FollowingState,
        request: &Request<'_>,
    ) -> Asked {
        let blocked = request.feedback.auxiliary.blocked == 1;
        if pass.tap {
            let feed_mm_s = match element.feed {
                Feed::PathMmS(feed_mm_s) => feed_mm_s,
                Feed::Rapid => settings.speed_mm_s,
            };
            let share = if request.window.hold || request.window.feed_override.is_nan() {
                0.0
            } else {
                request.window.feed_override.clamp(0.0, 1.0)
            };
            return Asked::Speed(feed_mm_s * share);
        }
        if blocked {
            return Asked::Speed(0.0);
        }
        let spindle = Turning::of(request.feedback);
        let ahead = request.first_scan.saturating_sub(request.feedback.scan);
        let first_s = ahead as f64 * settings.scan_period_s;
        let turn = self.turn(pass, settings, state, spindle.after(first_s), &spindle);
        Asked::Spindle {
            spindle,
            first_s,
            turn,
            mm_per_turn: pass.mm_per_turn,
        }
    }

    /// The turn whose index belongs to the start of the pass: the one already taken, or the first that can be met.
    fn turn(
        &mut self,
        pass: &Pass,
        settings: &FollowingSettings,
        state: &FollowingState,
        turns: f64,
        spindle: &Turning,
    ) -> f64 {
        let run_in_mm = settings.run_in_mm(spindle.turns_s * pass.mm_per_turn);
        let place_mm = |turn: f64| (turns - turn) * pass.mm_per_turn;
        if let Some((element, turn)) = self.begins
            && element == pass.element
            && (!state.is_at_rest() || place_mm(turn) <= state.distance_mm - 0.5 * run_in_mm)
        {
            return turn;
        }
        let turn = if state.is_at_rest() {
            libm::ceil(turns - (state.distance_mm - run_in_mm) / pass.mm_per_turn)
        } else {
            libm::round(turns - state.distance_mm / pass.mm_per_turn)
        };
        self.begins = Some((pass.element, turn));
        turn
    }
}

/// What the setpoints of one window are asked to do.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Asked {
    /// A speed of their own, in mm/s.
    Speed(f64),
    /// To follow the spindle.
    Spindle {
        spindle: Turning,
        /// From the measurement to the first setpoint, in s.
        first_s: f64,
        turn: f64,
        mm_per_turn: f64,
    },
}

impl Asked {
    fn step(&self, settings: &FollowingSettings, state: &mut FollowingState, setpoint: usize) {
        match *self {
            Asked::Speed(speed_mm_s) => settings.go(state, speed_mm_s),
            Asked::Spindle {
                spindle,
                first_s,
                turn,
                mm_per_turn,
            } => {
                let time_s = first_s + setpoint as f64 * settings.scan_period_s;
                let place = SpindlePlace {
                    distance_mm: (spindle.after(time_s) - turn) * mm_per_turn,
                    speed_mm_s: spindle.turns_s * mm_per_turn,
                };
                settings.follow(state, &place);
            }
        }
    }
}

/// The place on the element of a tap that is nearest to where the axes stand, in mm along it.
pub fn distance_on(
    windows: &WindowPlanner,
    pass: &Pass,
    increments: &[i64; bus::sample::PATH_AXES],
) -> Option<f64> {
    let element = windows.path().get(pass.element)?;
    let limits = windows.limits();
    let (start, tangent) = (element.start(), element.tangent(0.0));
    let mut distance_mm = 0.0;
    let axes = increments.iter().zip(limits.axes());
    for ((increments, axis), (start_mm, share)) in axes.zip(start.iter().zip(&tangent)) {
        distance_mm += (*increments as f64 * axis.increment_mm - start_mm) * share;
    }
    Some(distance_mm.clamp(0.0, element.length_mm))
}

/// A number without the last bits of its arithmetic.
fn shown(value: f64) -> f64 {
    libm::round(value * 1e6) / 1e6
}

/// Which elements are in step, as they are read.
#[derive(Debug, Clone, Default)]
pub struct Steps {
    axes: Vec<Axis>,
    kinematics: bool,
    /// A spindle at its speed may be so much faster.
    faster: f64,
    line: u32,
    /// Way for a turn, of the tap or the thread under way, in mm.
    tap_mm: Option<f64>,
    thread_mm: Option<f64>,
    /// The next element begins at rest.
    ended: bool,
}

impl Steps {
    /// None yet, on a machine.
    pub fn new(machine: &Machine) -> Steps {
        let spindle = machine.spindle.unwrap_or_default();
        Steps {
            axes: machine.axes.clone(),
            kinematics: machine.kinematics.is_some(),
            faster: 1.0 + spindle.at_speed_percent / 100.0,
            ..Steps::default()
        }
    }

    /// The next event.
    ///
    /// # Errors
    /// Motion that cannot be in step.
    pub fn read(&mut self, event: &Event) -> Result<(), EventError> {
        self.line = event.line;
        match event.kind {
            EventKind::SpindleFollowed(_) if self.thread_mm.is_some() => {
                return Err(self.refuse(
                    "a thread that tapers (E and L of G76)".into(),
                    "leave E and L out: the corner to a taper cannot be cut in step".into(),
                ));
            }
            EventKind::SpindleFollowed(mm) if self.tap_mm.is_none() => self.thread_mm = Some(mm),
            EventKind::SpindleReleased => self.ended |= self.thread_mm.take().is_some(),
            EventKind::SpindleCoupled(mm) => self.tap_mm = Some(mm),
            EventKind::SpindleUncoupled => self.ended |= self.tap_mm.take().is_some(),
            _ => {}
        }
        Ok(())
    }

    fn refuse(&self, found: String, right: String) -> EventError {
        EventError {
            line: self.line,
            found,
            right,
        }
    }

    /// Whether a thread or a tap was begun and is not done.
    pub fn is_under_way(&self) -> bool {
        self.tap_mm.is_some() || self.thread_mm.is_some() || self.ended
    }

    /// Whether one ended before the element that was met.
    pub fn take_ended(&mut self) -> bool {
        std::mem::take(&mut self.ended)
    }

    /// The pass that an element is.
    ///
    /// # Errors
    /// An axis is too slow for it: a thread goes as fast as the spindle turns, within what counts as its speed.
    pub fn meet(&self, number: u32, element: &Element) -> Result<Option<Pass>, EventError> {
        let Some(mm_per_turn) = self.thread_mm.or(self.tap_mm) else {
            return Ok(None);
        };
        let Feed::PathMmS(feed_mm_s) = element.feed else {
            return Ok(None);
        };
        if element.length_mm <= 0.0 {
            return Ok(None);
        }
        if self.kinematics {
            let right = "no machine with [kinematics] does that".into();
            return Err(self.refuse("a motion in step with the spindle".into(), right));
        }
        for (axis, share) in self.axes.iter().zip(&element.tangent(0.0)) {
            let speed_mm_s = feed_mm_s * self.faster * share.abs();
            if speed_mm_s > axis.rapid_mm_s {
                let rpm = shown(60.0 * feed_mm_s / mm_per_turn);
                let most_rpm = libm::floor(rpm * axis.rapid_mm_s / speed_mm_s);
                let mm_per_turn = shown(mm_per_turn);
                let found = format!(
                    "{mm_per_turn} mm for each turn at S{rpm}: up to {speed_mm_s:.1} mm/s of axis {}, which goes at {} mm/s",
                    axis.name, axis.rapid_mm_s
                );
                return Err(self.refuse(found, format!("at most S{most_rpm}, or a finer pitch")));
            }
        }
        Ok(Some(Pass {
            element: number,
            line: element.line,
            mm_per_turn,
            tap: self.tap_mm.is_some(),
        }))
    }

    /// The axis that a tap goes along, and 1 or -1 for its way; none of what does not move in the tap.
    ///
    /// # Errors
    /// It goes along more than one.
    pub fn axis_of(&self, element: &Element) -> Result<Option<(u32, f64)>, EventError> {
        if element.length_mm <= 0.0 || self.tap_mm.is_none() {
            return Ok(None);
        }
        let tangent = element.tangent(0.0);
        let mut along = tangent.iter().zip(&self.axes).enumerate();
        // Along a tilted tool the others have what rounding leaves.
        let along = along.find(|(_, (share, _))| (share.abs() - 1.0).abs() < SAME_DIRECTION);
        match along {
            Some((axis, (share, _))) => Ok(Some((axis as u32, share.signum()))),
            None => Err(self.refuse(
                "a tap along more than one axis".into(),
                "rigid tapping goes along one axis".into(),
            )),
        }
    }
}

/// What the passes of a program need, a line for each kind of them, for people.
pub fn needs(machine: &Machine, windows: &WindowPlanner, passes: &VecDeque<Pass>) -> Vec<String> {
    let mut lines: Vec<(u32, String)> = Vec::new();
    for pass in passes {
        let Some(element) = windows.path().get(pass.element) else {
            continue;
        };
        let settings = pass.settings(element, windows, machine);
        let Feed::PathMmS(feed_mm_s) = element.feed else {
            continue;
        };
        let speed_mm_s = feed_mm_s.min(settings.speed_mm_s);
        let rpm = 60.0 * speed_mm_s / pass.mm_per_turn;
        let pitch = shown(pass.mm_per_turn);
        let text = if pass.tap {
            let slower = if speed_mm_s < feed_mm_s {
                ", slower than programmed: it must come to rest within a window"
            } else {
                ""
            };
            format!(
                "tap of {pitch} mm a turn at up to {rpm:.0} rev/min, {:.2} s to its speed{slower}",
                speed_mm_s / settings.acceleration_mm_s2
            )
        } else {
            format!(
                "thread of {pitch} mm a turn at {rpm:.0} rev/min, in step from {:.3} mm after its start to {:.3} mm before its end",
                settings.run_in_mm(speed_mm_s),
                settings.run_out_mm(speed_mm_s)
            )
        };
        if !lines
            .iter()
            .any(|(line, said)| *line == pass.line && *said == text)
        {
            lines.push((pass.line, text));
        }
    }
    let shown = lines.into_iter();
    shown
        .map(|(line, text)| format!("line {line}: {text}"))
        .collect()
}

#[cfg(test)]
mod tests;

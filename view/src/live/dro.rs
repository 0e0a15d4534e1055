//! The digital readout: what an operator reads while a program runs, and between two. Data alone; others draw it.

use bus::sample::{Feedback, ProgramState};
use machine::offsets_file::WORK_OFFSETS;
use machine::{AxisKind, Machine};
use path::geometry::{AxisVector, Element, Feed, Path, Shape};
use path::kinematics::Kinematics;
use program::Modes;
use remote::state::{AxisState, Readout};

use super::model::Model;
use super::state::{round, rounded};

/// Half of the last digit that is shown, in mm or degrees.
const HALF_A_DIGIT: f64 = 0.5e-4;

/// What is known of a program for the readout.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramTimes {
    /// Its states along the path.
    pub modes: Modes,
    /// Time to the beginning of each element at full speed, in s.
    begins_s: Vec<f64>,
    total_s: f64,
}

impl ProgramTimes {
    /// Of a path and its states.
    pub fn new(machine: &Machine, path: &Path, modes: Modes) -> ProgramTimes {
        let mut total_s = 0.0;
        let times = path.elements.iter().map(|element| {
            let begins_s = total_s;
            total_s += duration_s(machine, element);
            begins_s
        });
        let begins_s = times.collect();
        ProgramTimes {
            modes,
            begins_s,
            total_s,
        }
    }

    /// Time that is left from a place, at an override: without what speeding up, braking and stops take.
    fn left_s(&self, element: u32, done: f64, override_percent: u32) -> Option<f64> {
        let begins_s = *self.begins_s.get(element as usize)?;
        let behind = self.begins_s.get(element as usize + 1);
        let ends_s = behind.copied().unwrap_or(self.total_s);
        let left_s = self.total_s - (begins_s + (ends_s - begins_s) * done.clamp(0.0, 1.0));
        (override_percent > 0).then(|| left_s * 100.0 / f64::from(override_percent))
    }
}

/// What an element takes at full speed.
fn duration_s(machine: &Machine, element: &Element) -> f64 {
    let time_s = match (&element.shape, element.feed) {
        (Shape::Dwell { seconds, .. }, _) => *seconds,
        (_, Feed::PathMmS(feed_mm_s)) => element.length_mm / feed_mm_s,
        (shape, Feed::Rapid) => {
            let way = shape.end() - shape.start();
            let axes = way.iter().zip(&machine.axes);
            axes.fold(0.0, |longest: f64, (way, axis)| {
                longest.max(way.abs() / axis.rapid_mm_s)
            })
        }
    };
    if time_s.is_finite() { time_s } else { 0.0 }
}

/// The readout of what is known of a cell; its coordinates are put to the axes.
pub fn of(model: &Model, axes: &mut [AxisState]) -> Readout {
    let (block_line, block_text) = model.block().unzip();
    let mut readout = Readout {
        block_line,
        block_text: block_text.map(String::from),
        time_left_is_estimate: true,
        ..Readout::default()
    };
    let Some(feedback) = &model.feedback else {
        return readout;
    };
    let (machine, auxiliary) = (&model.machine, &feedback.auxiliary);
    readout.tool = Some(auxiliary.tool);
    readout.spindle_rpm = Some(rounded(auxiliary.spindle_rpm, 3));
    readout.programmed_spindle_rpm = Some(rounded(auxiliary.levels.spindle_rpm, 3));
    // Where axes are those of the program.
    let is_plain = program::kinematics_of(machine) == Kinematics::Cartesian;
    if is_plain {
        readout.feed_mm_min = Some(speed_mm_min(model, AxisKind::Linear));
    }
    for (axis, length_mm) in axes.iter_mut().zip(auxiliary.tool_offset) {
        axis.tool_length_mm = Some(rounded(length_mm, 6));
    }
    let named = machine.program_axes().len();
    let runs = model.program_state() == Some(ProgramState::Running);
    let modal = if runs {
        let course = model.course.as_ref();
        course.and_then(|course| course.modes.in_force(feedback))
    } else {
        model.next_start.as_ref()
    };
    if let Some(modal) = modal {
        let offset = WORK_OFFSETS.get(modal.work_offset);
        readout.work_offset = offset.map(|name| (*name).into());
        readout.active_codes.clone_from(&modal.codes);
        readout.feed_word = modal.feed;
        readout.speed_word = Some(modal.speed);
        if let Some(work) = program::work_place(machine, feedback, modal) {
            for (axis, value) in axes.iter_mut().take(named).zip(work.iter()) {
                axis.work_mm = Some(without_sign_of_nothing(*value));
            }
        }
    }
    let elements = model.program.as_ref().map(|of| &of.path.elements);
    let element = elements.and_then(|all| all.get(feedback.tag.element as usize));
    if let Some(element) = element.filter(|_| runs) {
        along_the_path(&mut readout, model, feedback, element);
        let way = way_to_go(model, feedback, element).filter(|_| is_plain);
        if let Some(way) = way {
            for (axis, value) in axes.iter_mut().take(named).zip(way.iter()) {
                axis.distance_to_go_mm = Some(without_sign_of_nothing(*value));
            }
        }
    }
    readout
}

/// What can be said of the block that is travelled.
fn along_the_path(readout: &mut Readout, model: &Model, feedback: &Feedback, element: &Element) {
    let programmed = match element.feed {
        _ if matches!(element.shape, Shape::Dwell { .. }) => None,
        Feed::Rapid => {
            readout.rapid = Some(true);
            None
        }
        Feed::PathMmS(feed_mm_s) => {
            readout.rapid = Some(false);
            Some(rounded(feed_mm_s * 60.0, 3))
        }
    };
    if readout.feed_mm_min.is_some() && moves_rotary_axes_alone(&model.machine, element) {
        readout.feed_mm_min = None;
        readout.feed_deg_min = Some(speed_mm_min(model, AxisKind::Rotary));
        readout.programmed_feed_deg_min = programmed;
    } else {
        readout.programmed_feed_mm_min = programmed;
    }
    let done = match element.length_mm > 0.0 {
        true => feedback.tag.distance_mm / element.length_mm,
        false => 0.0,
    };
    let left_s = model
        .course
        .as_ref()
        .and_then(|course| course.left_s(feedback.tag.element, done, feedback.override_percent));
    readout.time_left_s = round(left_s, 1);
}

/// From the command to the end of the block.
fn way_to_go(model: &Model, feedback: &Feedback, element: &Element) -> Option<AxisVector> {
    let elements = model.program.as_ref()?.path.elements.iter();
    let of_block = elements
        .skip(feedback.tag.element as usize)
        .take_while(|other| other.line == element.line);
    Some(of_block.last()?.end() - program::commanded(&model.machine, feedback))
}

/// What is less than half of the last digit that is shown is nothing, and nothing has no sign.
fn without_sign_of_nothing(value: f64) -> f64 {
    if value.abs() < HALF_A_DIGIT {
        0.0
    } else {
        rounded(value, 6)
    }
}

/// Whether a block moves rotary axes and no slide: its feed is in degrees then.
fn moves_rotary_axes_alone(machine: &Machine, element: &Element) -> bool {
    let way = element.end() - element.start();
    let moves = |kind: AxisKind| {
        let mut axes = machine.axes.iter().zip(way.iter());
        axes.any(|(axis, way)| axis.kind == kind && *way != 0.0)
    };
    moves(AxisKind::Rotary) && !moves(AxisKind::Linear)
}

/// Speed of the axes of a kind together, in mm/min or degrees/min.
fn speed_mm_min(model: &Model, kind: AxisKind) -> f64 {
    let axes = model.machine.program_axes().iter().zip(&model.axes);
    let of_kind = axes.filter(|(axis, _)| axis.kind == kind);
    let square: f64 = of_kind.map(|(_, of)| of.now.velocity_mm_s.powi(2)).sum();
    rounded(square.sqrt() * 60.0, 1)
}

//! The digital readout: what an operator reads while a program runs, and between two. Data alone; others draw it.

use bus::sample::{Feedback, ProgramState};
use machine::offsets_file::WORK_OFFSETS;
use machine::{AxisKind, Machine};
use path::geometry::{Element, Feed, Path, Shape};
use path::kinematics::Kinematics;
use program::Modes;

use super::model::Model;

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

/// The readout. What cannot be known is none.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Dro {
    /// Of each axis: where it is commanded to be, in the coordinates of the program, in mm or degrees.
    pub work: Vec<Option<f64>>,
    /// Of each axis: the way to the end of the block, signed, in mm or degrees.
    pub distance_to_go: Vec<Option<f64>>,
    /// The work offset in force.
    pub work_offset: Option<&'static str>,
    /// What the length of the tool takes off along each axis.
    pub tool_length: Option<Vec<f64>>,
    /// Feed of the block, in mm/min; none in rapid.
    pub programmed_feed_mm_min: Option<f64>,
    /// Only rotary axes move in the block: both feeds are in degrees/min.
    pub is_feed_of_rotary: bool,
    /// The block is in rapid.
    pub rapid: Option<bool>,
    /// Speed of the tool, in mm/min; of linear axes.
    pub feed_mm_min: Option<f64>,
    /// F as the program has it, in its unit.
    pub feed_word: Option<f64>,
    /// S as the program has it.
    pub speed_word: Option<f64>,
    /// Codes in force.
    pub active_codes: Vec<String>,
    /// Estimate of the time that the program still takes.
    pub time_left_s: Option<f64>,
}

impl Dro {
    /// Unit of both feeds.
    pub fn feed_unit(&self) -> &'static str {
        if self.is_feed_of_rotary {
            "deg/min"
        } else {
            "mm/min"
        }
    }
}

/// The readout of what is known of a cell.
pub fn of(model: &Model) -> Dro {
    let Some(feedback) = &model.feedback else {
        return Dro::default();
    };
    let machine = &model.machine;
    let axes = machine.axes.len();
    let mut dro = Dro {
        work: vec![None; axes],
        distance_to_go: vec![None; axes],
        ..Dro::default()
    };
    // Where axes are those of the program.
    let is_plain = program::kinematics_of(machine) == Kinematics::Cartesian;
    if is_plain {
        dro.feed_mm_min = Some(speed_mm_min(model, AxisKind::Linear));
    }
    let applied = feedback.auxiliary.tool_offset.iter();
    dro.tool_length = Some(applied.take(axes).copied().collect());
    let runs = model.program_state() == Some(ProgramState::Running);
    let modal = if runs {
        let course = model.course.as_ref();
        course.and_then(|course| course.modes.in_force(feedback))
    } else {
        model.next_start.as_ref()
    };
    if let Some(modal) = modal {
        dro.work_offset = WORK_OFFSETS.get(modal.work_offset).copied();
        dro.active_codes.clone_from(&modal.codes);
        dro.feed_word = modal.feed;
        dro.speed_word = Some(modal.speed);
        if let Some(work) = program::work_place(machine, feedback, modal) {
            let named = dro.work.iter_mut().take(machine.program_axes().len());
            for (slot, value) in named.zip(work.iter()) {
                *slot = Some(without_sign_of_nothing(*value));
            }
        }
    }
    if runs && !feedback.tag.is_off_path() {
        along_the_path(&mut dro, model, feedback, is_plain);
    }
    dro
}

/// What can be said of the block that is travelled.
fn along_the_path(dro: &mut Dro, model: &Model, feedback: &Feedback, is_plain: bool) {
    let Some(program) = &model.program else {
        return;
    };
    let elements = &program.path.elements;
    let at = feedback.tag.element as usize;
    let Some(element) = elements.get(at) else {
        return;
    };
    if is_plain && moves_rotary_axes_alone(&model.machine, element) {
        dro.is_feed_of_rotary = true;
        dro.feed_mm_min = Some(speed_mm_min(model, AxisKind::Rotary));
    }
    match element.feed {
        _ if matches!(element.shape, Shape::Dwell { .. }) => {}
        Feed::Rapid => dro.rapid = Some(true),
        Feed::PathMmS(feed_mm_s) => {
            dro.rapid = Some(false);
            dro.programmed_feed_mm_min = Some(feed_mm_s * 60.0);
        }
    }
    let of_block = elements
        .iter()
        .skip(at)
        .take_while(|other| other.line == element.line);
    if is_plain && let Some(last) = of_block.last() {
        let way = last.end() - program::commanded(&model.machine, feedback);
        let named = model.machine.program_axes().len();
        for (slot, value) in dro.distance_to_go.iter_mut().take(named).zip(way.iter()) {
            *slot = Some(without_sign_of_nothing(*value));
        }
    }
    let done = match element.length_mm > 0.0 {
        true => feedback.tag.distance_mm / element.length_mm,
        false => 0.0,
    };
    let course = model.course.as_ref();
    dro.time_left_s = course
        .and_then(|course| course.left_s(feedback.tag.element, done, feedback.override_percent));
}

/// What is less than half of the last digit that is shown is nothing, and nothing has no sign.
fn without_sign_of_nothing(value: f64) -> f64 {
    if value.abs() < HALF_A_DIGIT {
        0.0
    } else {
        value
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
    square.sqrt() * 60.0
}

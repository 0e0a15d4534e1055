//! What a program comes to on a machine, read to its end or as far as is asked for, in bounded memory.

use bus::sample::PATH_AXES;
use machine::Machine;
use program::{Note, Setup};

use crate::ahead::Course;
use crate::error::AheadError;
use crate::program_text::ProgramText;

/// What a program comes to.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// Its name.
    pub name: String,
    /// Elements of its path.
    pub elements: u64,
    /// Length of its path, in mm.
    pub length_mm: f64,
    /// What was accepted with a remark.
    pub notes: Vec<Note>,
    /// All of it was read.
    pub is_whole: bool,
}

/// Reads a program from these command positions, in increments, plans its path and forgets it, up to about so many elements.
///
/// # Errors
/// The first thing that is wrong with it, or that the machine cannot do.
pub fn survey(
    machine: &Machine,
    text: &ProgramText,
    start: [i64; PATH_AXES],
    elements_max: u64,
    mut progress: impl FnMut(u64),
) -> Result<Survey, AheadError> {
    let setup = Setup {
        rehearsed: true,
        ..Setup::of(machine)
    };
    let mut course = Course::new(machine, text, start, None, setup)?;
    while !course.is_over() && u64::from(course.windows.path().end()) < elements_max {
        course.read_on(course.windows.path().end(), false);
        course.places.clear();
        course.events.forget(u32::MAX);
        course.events.forget_messages();
        course.events.forget_passes(u32::MAX);
        progress(u64::from(course.windows.path().end()));
    }
    if let Some(refused) = course.refusal() {
        return Err(refused);
    }
    let path = course.windows.path();
    Ok(Survey {
        name: text.name(),
        elements: u64::from(path.end()),
        length_mm: path.length_mm(),
        notes: course.notes(),
        is_whole: course.is_whole(),
    })
}

//! What a program comes to on a machine, read to its end or as far as is asked for, in bounded memory.

use bus::sample::PATH_AXES;
use machine::Machine;
use path::window::WindowPlanner;
use program::{Note, Setup};

use crate::ahead::Course;
use crate::course::AHEAD_ELEMENTS;
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

/// A program that is read as it is planned, and forgotten behind: its length takes no memory.
#[derive(Debug)]
pub struct Streamed {
    course: Course,
}

impl Streamed {
    /// Nothing read yet of a program from these command positions, in increments.
    ///
    /// # Errors
    /// It cannot be read, or not from there.
    pub fn new(
        machine: &Machine,
        text: &ProgramText,
        start: [i64; PATH_AXES],
    ) -> Result<Streamed, AheadError> {
        let setup = Setup {
            rehearsed: true,
            ..Setup::of(machine)
        };
        let course = Course::new(machine, text, start, None, setup)?;
        Ok(Streamed { course })
    }

    /// Elements that are read.
    pub fn elements(&self) -> u64 {
        u64::from(self.course.windows.path().end())
    }

    /// Windows along it, as far as it is read.
    pub fn windows(&mut self) -> &mut WindowPlanner {
        &mut self.course.windows
    }

    /// Reads on, if not enough is known ahead of this element, and forgets what is behind it.
    ///
    /// # Errors
    /// The first thing that is wrong with it, or that the machine cannot do.
    pub fn read_on(&mut self, element: u32) -> Result<(), AheadError> {
        let course = &mut self.course;
        // Blocks that move nothing may be many.
        loop {
            course.read_on(element, false);
            let wanted = element.saturating_add(AHEAD_ELEMENTS / 2);
            if course.is_over() || course.windows.path().end() > wanted {
                break;
            }
        }
        course.places.clear();
        course.events.forget(u32::MAX);
        course.events.forget_messages();
        course.events.forget_passes(u32::MAX);
        course.refusal().map_or(Ok(()), Err)
    }

    /// What it comes to under this name, as far as it is read.
    pub fn survey(&self, name: String) -> Survey {
        Survey {
            name,
            elements: self.elements(),
            length_mm: self.course.windows.path().length_mm(),
            notes: self.course.notes(),
            is_whole: self.course.is_whole(),
        }
    }
}

/// Reads a program from these command positions, in increments, plans its path and forgets it, up to about so many elements.
///
/// # Errors
/// As [`Streamed::read_on`].
pub fn survey(
    machine: &Machine,
    text: &ProgramText,
    start: [i64; PATH_AXES],
    elements_max: u64,
    mut progress: impl FnMut(u64),
) -> Result<Survey, AheadError> {
    let mut streamed = Streamed::new(machine, text, start)?;
    while !streamed.course.is_over() && streamed.elements() < elements_max {
        streamed.read_on(streamed.course.windows.path().end())?;
        progress(streamed.elements());
    }
    Ok(streamed.survey(text.name()))
}

//! The elements of a program for who goes along its path once, and programs that are short enough to be held whole.

use std::path::Path as FilePath;
use std::sync::Arc;

use machine::Machine;
use path::geometry::Path;

use crate::bundle::read_program;
use crate::error::ResumeError;
use crate::program::{Piece, Program, Setup};
use crate::question::Answer;
use crate::reading::{Progress, Reading};
use crate::resume::load_from;
use crate::setup::tool_at;

/// Programs of at most so many elements are held whole by who wants to see all of one: some 20 MB.
pub const SHORT_ELEMENTS: u64 = 30_000;

/// Lines that are done at a time.
const BLOCKS_AT_A_TIME: usize = 256;
/// Larger files are read as they are, without the subroutines of other files that they call: in a run's folder these are part of them.
const BUNDLED_BYTES: u64 = 4 << 20;
/// Elements to either side of the place that are at hand.
const NEAR: u32 = 64;

/// Reads and interprets a program file if its path has at most so many elements, with what a machine has answered to what the program
/// asks; none of a longer one. Its memory is bounded either way.
///
/// # Errors
/// [`ResumeError`]; of a longer program only what is met so far. An answer is none to what is asked.
pub fn load_if_short(
    machine: &Machine,
    increments: &[i64],
    file: &FilePath,
    elements_max: u64,
    answers: &[Answer],
) -> Result<Option<Program>, ResumeError> {
    let mut along = Along::open(machine, increments, file, answers)?;
    // What is wrong is found again below, with everything else that is.
    while let Ok(Progress::More) = along.read() {
        along.near.elements.clear();
        if along.reading.elements_made() > elements_max {
            return Ok(None);
        }
    }
    load_from(machine, increments, file, answers).map(Some)
}

/// The path of a program near the place that somebody has come to.
#[derive(Debug, Clone)]
pub struct Along {
    reading: Reading,
    piece: Piece,
    near: Path,
    first: u32,
    over: bool,
}

impl Along {
    /// At the start of a program file, on a machine with its command positions at these increments, with what the machine has answered to
    /// what the program asks; what comes behind the last answer is assumed.
    ///
    /// # Errors
    /// [`ResumeError`].
    pub fn open(
        machine: &Machine,
        increments: &[i64],
        file: &FilePath,
        answers: &[Answer],
    ) -> Result<Along, ResumeError> {
        let start = tool_at(machine, increments)?;
        let setup = Arc::new(Setup::rehearsed(machine, answers));
        let is_small = std::fs::metadata(file).is_ok_and(|of| of.len() <= BUNDLED_BYTES);
        let reading = if is_small {
            let text = read_program(file, &machine.subroutine_folders, machine.program.dialect)?;
            Reading::of_text(&file.display().to_string(), &text, &setup, start)?
        } else {
            Reading::open(file, &setup, start)?
        };
        Ok(Along {
            reading,
            piece: Piece::default(),
            near: Path::default(),
            first: 0,
            over: false,
        })
    }

    /// Hash of everything that its geometry depends on.
    pub fn source_hash(&self) -> u64 {
        self.reading.source_hash()
    }

    fn read(&mut self) -> Result<Progress, ResumeError> {
        let read = self.reading.read(BLOCKS_AT_A_TIME, &mut self.piece);
        self.near.elements.append(&mut self.piece.elements);
        self.piece.events.clear();
        self.piece.messages.clear();
        self.over = !matches!(read, Ok(Progress::More));
        Ok(read?)
    }

    /// The elements near this one, and the number of the first of them. Nobody goes back by more than a few elements.
    pub fn near(&mut self, element: u32) -> (&Path, u32) {
        let end = |along: &Along| along.first + along.near.elements.len() as u32;
        while !self.over && end(self) <= element.saturating_add(NEAR) {
            // What is wrong with it ended the run there.
            let _ = self.read();
            let behind = element.saturating_sub(NEAR).saturating_sub(self.first) as usize;
            let behind = behind.min(self.near.elements.len());
            self.near.elements.drain(..behind);
            self.first += behind as u32;
        }
        (&self.near, self.first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_goes_along_a_program_sees_its_elements_and_holds_few_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("long.ngc");
        let blocks = (1..=9000).map(|n| format!("G1 X{} F600\n", n % 7));
        std::fs::write(&file, blocks.collect::<String>() + "M2\n").unwrap();
        let machines = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let mut machine = Machine::load(&machines).unwrap();
        machine.program.work_offset_mm.clear();
        let whole = load_if_short(&machine, &[0; bus::sample::PATH_AXES], &file, 9000, &[])
            .unwrap()
            .unwrap();
        assert_eq!(
            load_if_short(&machine, &[0; bus::sample::PATH_AXES], &file, 8000, &[]).unwrap(),
            None
        );
        let mut along = Along::open(&machine, &[0; bus::sample::PATH_AXES], &file, &[]).unwrap();
        for element in (0..9000u32).step_by(37) {
            let (near, first) = along.near(element);
            assert!(near.elements.len() < 1000);
            let here = &near.elements[(element - first) as usize];
            assert_eq!(here, &whole.path.elements[element as usize]);
        }
        assert!(along.near(9001).0.elements.len() < 1000);
    }
}

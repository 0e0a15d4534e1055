//! The state of a program along its path, for who shows it.

use std::collections::VecDeque;
use std::path::Path as FilePath;
use std::sync::Arc;

use machine::Machine;
use path::geometry::AxisVector;

use crate::bundle::read_program;
use crate::compensation::WAITING_MAX;
use crate::error::ResumeError;
use crate::interpreter::Interpreter;
use crate::meaning::Modal;
use crate::program::{Piece, Setup};
use crate::reading::{Progress, Reading};
use crate::setup::tool_at;

/// The state that the next program begins with.
pub fn modal_at_start(machine: &Machine) -> Modal {
    let setup = Arc::new(Setup::of(machine));
    Interpreter::new(&setup, AxisVector::zeros()).modal()
}

/// The states of a program, by its elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Modes {
    /// The first element in which a state is in force.
    changes: Vec<(u64, Arc<Modal>)>,
    /// What happens between elements: its line, the element that it comes before, and the state there. Blocks that move nothing leave
    /// their state here alone.
    happenings: Vec<(u32, u64, Arc<Modal>)>,
    /// Behind so many elements nothing is known: the program asks the machine there, is refused, or is at its end.
    elements: u64,
    source_hash: u64,
}

impl Modes {
    /// Of a program on a machine with its command positions at these increments, up to what it asks the machine.
    ///
    /// # Errors
    /// [`ResumeError`].
    pub fn of(
        machine: &Machine,
        increments: &[i64],
        file: &FilePath,
    ) -> Result<Modes, ResumeError> {
        let start = tool_at(machine, increments)?;
        let setup = Arc::new(Setup::of(machine));
        let text = read_program(file, &machine.subroutine_folders, machine.program.dialect)?;
        let mut reading = Reading::of_text(&file.display().to_string(), &text, &setup, start)?;
        let mut modes = Modes {
            changes: vec![(0, Arc::new(reading.modal()))],
            happenings: vec![],
            elements: 0,
            source_hash: reading.source_hash(),
        };
        let mut piece = Piece::default();
        // Beside a contour an element comes out some blocks later than its own.
        let mut recent: VecDeque<(u32, Arc<Modal>)> = VecDeque::new();
        loop {
            let first = reading.elements_made();
            let read = reading.read(1, &mut piece);
            let Piece {
                elements, events, ..
            } = std::mem::take(&mut piece);
            if !matches!(read, Ok(Progress::More)) && reading.question().is_some() {
                break;
            }
            let modal = reading.modal();
            let now = match modes.changes.last() {
                Some((_, last)) if **last == modal => Arc::clone(last),
                _ => Arc::new(modal),
            };
            if recent.len() >= WAITING_MAX {
                recent.pop_front();
            }
            recent.push_back((reading.line_read(), Arc::clone(&now)));
            for (element, number) in elements.iter().zip(first..) {
                let mut of_block = recent.iter().rev();
                let found = of_block.find(|(line, _)| *line == element.line);
                modes.change(number, found.map_or(&now, |(_, modal)| modal));
            }
            if elements.is_empty() {
                modes.change(first, &now);
            }
            let happened = events.iter();
            let happened = happened.map(|of| (of.line, of.before_element as u64, Arc::clone(&now)));
            modes.happenings.extend(happened);
            modes.elements = reading.elements_made();
            if !matches!(read, Ok(Progress::More)) {
                break;
            }
        }
        Ok(modes)
    }

    fn change(&mut self, first: u64, modal: &Arc<Modal>) {
        match self.changes.last_mut() {
            Some((_, last)) if *last == *modal => {}
            Some((at, last)) if *at == first => *last = Arc::clone(modal),
            _ => self.changes.push((first, Arc::clone(modal))),
        }
    }

    /// The state in an element; none where it is not known.
    pub fn at(&self, element: u32) -> Option<&Modal> {
        let element = u64::from(element);
        if element >= self.elements {
            return None;
        }
        let behind = self.changes.partition_point(|(first, _)| *first <= element);
        let (_, modal) = self.changes.get(behind.checked_sub(1)?)?;
        Some(modal)
    }

    /// The state where the program waits in a line, at the end of an element or before it; none where that is not known.
    pub fn where_it_waits(&self, element: u32, line: u32) -> Option<&Modal> {
        let element = u64::from(element);
        let near = |at: u64| at == element || at == element + 1;
        let mut happenings = self.happenings.iter();
        let found = happenings.find(|(of, at, _)| *of == line && near(*at));
        found.map(|(_, _, modal)| modal.as_ref())
    }

    /// Hash of everything that the geometry depends on.
    pub fn source_hash(&self) -> u64 {
        self.source_hash
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beside_a_contour_each_element_has_the_state_of_its_own_block() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("beside.ngc");
        let text = "G21 G90 T1 M6\nF250\nG41 D1\nG1 X20 Y5\nF2000\nX30\nF700\nX30 Y30\nG40\nG1 X40 Y40\nM2\n";
        std::fs::write(&file, text).unwrap();
        let machine = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
        let machine = Machine::load(&machine).unwrap();
        let modes = Modes::of(&machine, &[0; bus::sample::PATH_AXES], &file).unwrap();
        let feeds = [0, 1].map(|element| modes.at(element).unwrap().feed);
        assert_eq!(feeds, [Some(250.0), Some(2000.0)]);
    }

    #[test]
    fn each_element_has_the_state_that_its_own_block_is_read_in() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("modes.ngc");
        let text = "G21 G90 G54\nG0 X1\nG55\nG10 L2 P2 X5\nG1 X1 F600\nG91\nG92 X0\nG1 X2\nM2\n";
        std::fs::write(&file, text).unwrap();
        let machine = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let mut machine = Machine::load(&machine).unwrap();
        machine.program.work_offset_mm.clear();
        let modes = Modes::of(&machine, &[0; bus::sample::PATH_AXES], &file).unwrap();
        let codes = |element| modes.at(element).unwrap().codes.join(" ");
        assert!(
            codes(0).starts_with("G0 G17 G21 G40 G49 G54"),
            "{}",
            codes(0)
        );
        assert!(
            codes(1).starts_with("G1 G17 G21 G40 G49 G55"),
            "{}",
            codes(1)
        );
        assert!(
            codes(2).contains("G91") && codes(2).contains("G92"),
            "{}",
            codes(2)
        );
        let at = |element, x_mm: f64| {
            let mut place = AxisVector::zeros();
            place[0] = x_mm;
            modes
                .at(element)
                .unwrap()
                .in_program(&place, &AxisVector::zeros())[0]
        };
        assert_eq!((at(0, 1.0), at(1, 6.0), at(2, 8.0)), (1.0, 1.0, 2.0));
        assert_eq!(modes.at(3), None);
    }
}

//! G61, G61.1 and G64: how exactly the path is travelled.

use super::*;
use path::geometry::PathTolerance;

impl Interpreter {
    /// P and Q of a block with G64.
    pub(super) fn begin_rounding(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        for (said, letter) in ['P', 'Q'].into_iter().enumerate() {
            let Some(word) = words.value(letter) else {
                continue;
            };
            let tolerance_mm = word.value * self.unit_mm();
            if !(0.0..=TOLERANCE_MAX_MM).contains(&tolerance_mm) {
                return word.refuse("a tolerance is 0 to 5 mm");
            }
            if let Some(kept) = self.modes.path_words.get_mut(said) {
                *kept = Some(tolerance_mm);
            }
        }
        if self.modes.path_words == [None; 2] && self.setup.tolerance_mm <= 0.0 {
            let text = "G64 without P follows the exact path here: [path] tolerance_mm of the machine file says how far it may leave it";
            self.note(line, text);
        }
        Ok(())
    }

    /// How far the path may be left now.
    pub(super) fn tolerance(&self) -> PathTolerance {
        if self.modes.path_control != 640 {
            return PathTolerance::EXACT;
        }
        let [corner_mm, chord_mm] = self.modes.path_words;
        let corner_mm = corner_mm.unwrap_or(self.setup.tolerance_mm);
        PathTolerance {
            corner_mm,
            chord_mm: chord_mm.unwrap_or(corner_mm),
        }
    }

    /// The tolerance of a motion, and whether the tool rests before it: in G61.1 it does before and after each.
    pub(super) fn path_mode(&mut self) -> (PathTolerance, bool) {
        let stops = self.modes.path_control == 611;
        let stopped = std::mem::replace(&mut self.stops_exactly, stops);
        (self.tolerance(), stops || stopped)
    }
}

/// The largest tolerance, in mm.
const TOLERANCE_MAX_MM: f64 = 5.0;

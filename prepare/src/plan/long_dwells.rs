//! Dwells of hours: nothing happens in their scans, so most of them are counted and not planned.

use crate::time_use::{BlockTime, Cause, SlowPlace, TimeTable};
use audit::Totals;
use path::geometry::Shape;
use program::Program;

/// Scans of a dwell that are planned; those above them are all the same.
const PLANNED_SCANS: f64 = 1000.0;

/// What was taken away of the dwells of a program: the line of each and the scans.
pub(super) struct LongDwells(Vec<(u32, u64)>);

impl LongDwells {
    /// Takes away what is above a thousand scans, in whole scans.
    pub fn shorten(program: &mut Program, period_s: f64) -> Self {
        let mut taken = Vec::new();
        for element in &mut program.path.elements {
            let Shape::Dwell { seconds, .. } = &mut element.shape else {
                continue;
            };
            let above = (*seconds / period_s - PLANNED_SCANS).floor();
            if above > 0.0 {
                *seconds -= above * period_s;
                taken.push((element.line, above as u64));
            }
        }
        Self(taken)
    }

    /// Gives it back to what the program comes to.
    pub fn give_back(&self, totals: &mut Totals, table: &mut TimeTable, period_s: f64) {
        for (line, scans) in &self.0 {
            let time_s = *scans as f64 * period_s;
            totals.setpoints += scans;
            totals.time_s += time_s;
            let rests = |place: &&mut SlowPlace| place.line == *line && place.cause == Cause::Rest;
            if let Some(place) = table.places.iter_mut().find(rests) {
                place.time_s += time_s;
                place.lost_s += time_s;
            }
            let of_line = |block: &&mut BlockTime| block.line == *line;
            if let Some(block) = table.blocks.iter_mut().find(of_line) {
                block.time_s += time_s;
            }
        }
    }
}

//! A whole file checked in bounded memory: all its mistakes, and what it makes of what length.

use std::path::Path;
use std::sync::Arc;

use path::geometry::AxisVector;

use crate::error::ProgramError;
use crate::program::{Note, Piece, ProgramEnd, Setup};
use crate::reading::{PIECE_ELEMENTS, Reading};
use crate::route::Counts;

/// So many lines make a piece.
const PIECE_LINES: usize = 1_000;

/// What a program is, without its path.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Hash of everything that the geometry depends on.
    pub source_hash: u64,
    /// Lines that were done, as often as they were done.
    pub lines: u64,
    /// Elements of the path.
    pub elements: u64,
    /// Things that happen along it.
    pub events: u64,
    /// Comments that say something.
    pub messages: u64,
    /// Straight feeds: blocks of G1, and the ways down of drilling cycles.
    pub straight_feeds: u32,
    /// Blocks that made an arc feed (G2, G3).
    pub arc_feeds: u32,
    /// Length of the path, in mm (degrees where only rotary axes move).
    pub length_mm: f64,
    /// Lowest and highest position of each axis on it; none without a path.
    pub bounds: Option<(AxisVector, AxisVector)>,
    /// What was accepted with a remark; one per kind, for its first line.
    pub notes: Vec<Note>,
    /// How it ends.
    pub end: ProgramEnd,
}

/// Reads a file to its end, for a machine that is at rest at `start` (machine coordinates). `sink` sees every piece, in order, up to the
/// first mistake.
///
/// # Errors
/// All mistakes of single blocks, at most twenty, as [`crate::interpret`] finds them.
pub fn check_file(
    file: &Path,
    setup: &Arc<Setup>,
    start: AxisVector,
    sink: &mut dyn FnMut(&mut Piece),
) -> Result<Summary, ProgramError> {
    let (name, source_hash, mut execution) = Reading::open(file, setup, start)?.into_parts();
    let mut lines = 0;
    let mut length_mm = 0.0;
    let mut bounds = None;
    let mut ended = false;
    while !ended {
        let enough = execution.interpreter.route.output.elements_made() + PIECE_ELEMENTS;
        for _ in 0..PIECE_LINES {
            lines += 1;
            execution.interpreter.route.output.begin_block();
            ended = execution.checks_line();
            execution.check_made();
            if ended || execution.interpreter.route.output.elements_made() >= enough {
                break;
            }
        }
        if execution.is_sound() {
            let piece = &mut execution.interpreter.route.output.piece;
            for element in &piece.elements {
                length_mm += element.length_mm;
                widen(&mut bounds, element.bounds());
            }
            sink(piece);
        }
        let piece = &mut execution.interpreter.route.output.piece;
        piece.elements.clear();
        piece.events.clear();
        piece.messages.clear();
    }
    execution.finish(&name)?;
    execution.interpreter.note_open();
    let end = execution.end;
    let output = execution.interpreter.route.output;
    let Counts {
        elements,
        events,
        messages,
        ..
    } = output.counts;
    Ok(Summary {
        source_hash,
        lines,
        elements,
        events,
        messages,
        straight_feeds: output.straight_feeds,
        arc_feeds: output.arc_feeds,
        length_mm,
        bounds,
        notes: output.notes.by_line(),
        end,
    })
}

fn widen(bounds: &mut Option<(AxisVector, AxisVector)>, (low, high): (AxisVector, AxisVector)) {
    *bounds = Some(match bounds {
        Some((lowest, highest)) => (lowest.inf(&low), highest.sup(&high)),
        None => (low, high),
    });
}

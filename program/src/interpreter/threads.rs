//! The words of motions in step with the spindle: G33, G33.1 and G76.

use super::*;
use crate::threading::{Move, Threading};

/// The most passes at full depth (H of G76).
const SPRING_PASSES_MAX: f64 = 1_000.0;

impl Interpreter {
    /// The motion of a block in step with the spindle.
    pub(super) fn in_step(
        &mut self,
        line: u32,
        words: &Words,
        motion: InStep,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        if words.first_of(AXIS_LETTERS).is_none() {
            let right = "say where to, such as Z-10";
            return refuse(offset, format!("{motion} without a place"), right);
        }
        self.check_speed_is_constant(motion, offset)?;
        if self.modes.spindle.direction == 0 || self.modes.spindle.speed <= 0.0 {
            let found = format!("{motion} with a spindle that stands");
            let right = "S and M3 or M4 before it: the motion follows the spindle";
            return refuse(offset, found, right);
        }
        if motion == InStep::Thread {
            let moves = self.thread(words, offset)?;
            return self.follow_spindle(line, words, &moves, offset);
        }
        let Some(k) = words.value('K') else {
            let right = "K: the way for each turn of the spindle";
            return refuse(offset, format!("{motion} without K"), right);
        };
        let (to, mm_per_rev) = (self.target(words)?, k.value * self.unit_mm());
        if mm_per_rev <= 0.0 {
            let found = format!("a motion of {mm_per_rev} mm for each turn of the spindle");
            return refuse(k.offset, found, "K, the way for each turn, is above 0");
        }
        let there = Move::Synchronised { to, mm_per_rev };
        if motion == InStep::Line {
            return self.follow_spindle(line, words, &[there], offset);
        }
        self.rigid_tap(line, words, there, mm_per_rev, offset)
    }

    /// G33.1: there, the spindle reversed, back, and the spindle as before.
    fn rigid_tap(
        &mut self,
        line: u32,
        words: &Words,
        there: Move,
        mm_per_rev: f64,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let back = Move::Synchronised {
            to: self.position,
            mm_per_rev,
        };
        let faster = words.value('I');
        if let Some(word) = faster.filter(|word| word.value <= 0.0) {
            let right = "how many times as fast the spindle turns on the way back: above 0";
            return word.refuse(right);
        }
        let Spindle {
            speed: speed_rpm,
            direction,
        } = self.modes.spindle;
        self.event(line, EventKind::SpindleCoupled(mm_per_rev));
        self.follow_spindle(line, words, &[there], offset)?;
        if let Some(word) = faster {
            self.set_speed(line, speed_rpm * word.value);
        }
        self.turn_spindle(line, -direction);
        self.follow_spindle(line, words, &[back], offset)?;
        if faster.is_some() {
            self.set_speed(line, speed_rpm);
        }
        self.turn_spindle(line, direction);
        self.event(line, EventKind::SpindleUncoupled);
        Ok(())
    }

    /// The passes of G76.
    fn thread(&self, words: &Words, offset: usize) -> Result<Vec<Move>, Refusal> {
        let (number, _, _) = self.modes.plane;
        if number != 18 {
            let found = format!("G76 in G{number}");
            let right = "threads are cut in the plane ZX: G18 before it";
            return refuse(offset, found, right);
        }
        if let Some(word) = words.first_of("XYABCUVW") {
            let found = format!("{word} in G76");
            let right =
                "G76 cuts along Z from where the tool is: put other axes into a block before it";
            return refuse(word.offset, found, right);
        }
        let [Some(x_axis), Some(z_axis)] = ['X', 'Z'].map(|letter| self.setup.axis_index(letter))
        else {
            let right = "threads are cut along Z at a depth of X: this machine has not both";
            return refuse(offset, "G76", right);
        };
        let value = |letter: char| words.value(letter).map(|word| word.value);
        let needed = |letter: char, what: &str| {
            value(letter).ok_or_else(|| Refusal::new(offset, format!("G76 without {letter}"), what))
        };
        // Along X, as X itself.
        let across = |letter, what| needed(letter, what).map(|length| self.radius_of(length));
        let whole = |letter, most: f64| words.whole(letter, "a whole number", 0.0..=most);
        let tapers = whole('L', 3.0)?.unwrap_or(0);
        let thread = Threading {
            from: self.position,
            end: self.target(words)?,
            x_axis,
            z_axis,
            pitch_mm: self.unit_mm() * needed('P', "the pitch of the thread")?,
            unit_mm: self.unit_mm(),
            crest: across('I', "from the tool to the crest of the thread")?,
            first_cut: across('J', "the depth of the first cut")?,
            depth: across('K', "the full depth of the thread")?,
            degression: value('R').unwrap_or(1.0),
            slide_deg: value('Q').unwrap_or(0.0),
            spring_passes: whole('H', SPRING_PASSES_MAX)?.unwrap_or(0),
            taper_mm: value('E').unwrap_or(0.0) * self.unit_mm(),
            tapers_in: tapers & 1 != 0,
            tapers_out: tapers & 2 != 0,
        };
        let moves = thread.moves();
        moves.map_err(|(letter, wrong)| wrong.at(words.place(letter, offset)))
    }

    /// Makes moves; those in step with the spindle go as fast as it turns.
    fn follow_spindle(
        &mut self,
        line: u32,
        words: &Words,
        moves: &[Move],
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let mut pitch_mm = None;
        let mut refusals = Vec::new();
        for step in moves {
            let (to, wanted, feed) = match *step {
                Move::Rapid(to) => (to, None, Feed::Rapid),
                Move::Synchronised { to, mm_per_rev } => {
                    self.output.straight_feeds += 1;
                    let mm_s = mm_per_rev * self.modes.spindle.speed / 60.0;
                    (to, Some(mm_per_rev), Feed::PathMmS(mm_s))
                }
            };
            if wanted != pitch_mm {
                pitch_mm = wanted;
                self.in_step_event(line, wanted);
            }
            let from = self.position;
            let shape = Shape::Line { from, to };
            if let Err(outside) = self.go(line, words, vec![shape], feed, offset)
                && refusals.is_empty()
            {
                refusals = outside;
            }
        }
        if pitch_mm.is_some() {
            self.in_step_event(line, None);
        }
        if_none(refusals)
    }

    fn in_step_event(&mut self, line: u32, mm_per_rev: Option<f64>) {
        let kind = mm_per_rev.map_or(EventKind::SpindleReleased, EventKind::SpindleFollowed);
        self.event(line, kind);
    }
}

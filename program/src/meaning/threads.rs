//! The words of motions in step with the spindle: G33, G33.1 and G76.

use super::{Acts, Cause, EventKind, Feed, Refusal, State, refuse};
use crate::letters::AXIS_LETTERS;
use crate::state::Spindle;
use crate::threading::{InStep, Move, Threading};

/// The most passes at full depth (H of G76).
const SPRING_PASSES_MAX: f64 = 1_000.0;

impl State {
    /// What a block in step with the spindle makes: parts, of which none is begun where the one before leaves the travel.
    pub fn in_step(&self, cause: Cause, motion: InStep) -> Result<Vec<Acts>, Refusal> {
        let words = cause.words;
        if words.first_of(AXIS_LETTERS).is_none() {
            let right = "say where to, such as Z-10";
            return cause.refuse(format!("{motion} without a place"), right);
        }
        self.check_speed_is_constant(motion, cause.offset)?;
        let Spindle { speed, direction } = self.in_force.spindle;
        if direction == 0 || speed <= 0.0 {
            let found = format!("{motion} with a spindle that stands");
            let right = "S and M3 or M4 before it: the motion follows the spindle";
            return cause.refuse(found, right);
        }
        if motion == InStep::Thread {
            return Ok(vec![followed(&self.thread(cause)?, speed)]);
        }
        let Some(k) = words.value('K') else {
            let right = "K: the way for each turn of the spindle";
            return cause.refuse(format!("{motion} without K"), right);
        };
        let (to, mm_per_rev) = (self.target(words)?, k.value * self.in_force.unit_mm());
        if mm_per_rev <= 0.0 {
            let found = format!("a motion of {mm_per_rev} mm for each turn of the spindle");
            return refuse(k.offset, found, "K, the way for each turn, is above 0");
        }
        let there = Move::Synchronised { to, mm_per_rev };
        if motion == InStep::Line {
            return Ok(vec![followed(&[there], speed)]);
        }
        self.rigid_tap(cause, there, mm_per_rev)
    }

    /// G33.1: there, the spindle reversed, back, and the spindle as before.
    fn rigid_tap(&self, cause: Cause, there: Move, mm_per_rev: f64) -> Result<Vec<Acts>, Refusal> {
        let to = self.position;
        let back = Move::Synchronised { to, mm_per_rev };
        let faster = cause.words.value('I');
        if let Some(word) = faster.filter(|word| word.value <= 0.0) {
            let right = "how many times as fast the spindle turns on the way back: above 0";
            return word.refuse(right);
        }
        let Spindle { speed, direction } = self.in_force.spindle;
        let speed_back = faster.map_or(speed, |word| speed * word.value);
        let turn = |speed: f64, direction: i32| {
            let mut acts = Acts::default();
            if faster.is_some() {
                acts.event(EventKind::SpindleSpeedRpm(speed));
            }
            acts.event(EventKind::of_spindle(direction));
            acts
        };
        let mut begin = Acts::default();
        begin.event(EventKind::SpindleCoupled(mm_per_rev));
        let mut end = turn(speed, direction);
        end.event(EventKind::SpindleUncoupled);
        Ok(vec![
            begin,
            followed(&[there], speed),
            turn(speed_back, -direction),
            followed(&[back], speed_back),
            end,
        ])
    }

    /// The passes of G76.
    fn thread(&self, cause: Cause) -> Result<Vec<Move>, Refusal> {
        let Cause { words, offset, .. } = cause;
        let (number, _, _) = self.in_force.plane;
        if number != 18 {
            let found = format!("G76 in G{number}");
            let right = "threads are cut in the plane ZX: G18 before it";
            return cause.refuse(found, right);
        }
        if let Some(word) = words.first_of("XYABCUVW") {
            let found = format!("{word} in G76");
            let right =
                "G76 cuts along Z from where the tool is: put other axes into a block before it";
            return refuse(word.offset, found, right);
        }
        let [Some(x_axis), Some(z_axis)] =
            ['X', 'Z'].map(|letter| self.equipment.axis_index(letter))
        else {
            let right = "threads are cut along Z at a depth of X: this machine has not both";
            return cause.refuse("G76", right);
        };
        let value = |letter: char| words.value(letter).map(|word| word.value);
        let needed = |letter: char, what: &str| {
            value(letter).ok_or_else(|| Refusal::new(offset, format!("G76 without {letter}"), what))
        };
        // Along X, as X itself.
        let across =
            |letter, what| needed(letter, what).map(|length| self.in_force.radius_of(length));
        let whole = |letter, most: f64| words.whole(letter, "a whole number", 0.0..=most);
        let tapers = whole('L', 3.0)?.unwrap_or(0);
        let unit_mm = self.in_force.unit_mm();
        let thread = Threading {
            from: self.position,
            end: self.target(words)?,
            x_axis,
            z_axis,
            pitch_mm: unit_mm * needed('P', "the pitch of the thread")?,
            unit_mm,
            crest: across('I', "from the tool to the crest of the thread")?,
            first_cut: across('J', "the depth of the first cut")?,
            depth: across('K', "the full depth of the thread")?,
            degression: value('R').unwrap_or(1.0),
            slide_deg: value('Q').unwrap_or(0.0),
            spring_passes: whole('H', SPRING_PASSES_MAX)?.unwrap_or(0),
            taper_mm: value('E').unwrap_or(0.0) * unit_mm,
            tapers_in: tapers & 1 != 0,
            tapers_out: tapers & 2 != 0,
        };
        let moves = thread.moves();
        moves.map_err(|(letter, wrong)| wrong.at(cause.place(letter)))
    }
}

/// Moves of which those in step with the spindle go as fast as it turns.
fn followed(moves: &[Move], speed_rpm: f64) -> Acts {
    let mut acts = Acts::default();
    let mut pitch_mm = None;
    for step in moves {
        let (to, wanted, feed) = match *step {
            Move::Rapid(to) => (to, None, Feed::Rapid),
            Move::Synchronised { to, mm_per_rev } => {
                let feed = Feed::PathMmS(mm_per_rev * speed_rpm / 60.0);
                (to, Some(mm_per_rev), feed)
            }
        };
        if wanted != pitch_mm {
            pitch_mm = wanted;
            acts.event(in_step_event(wanted));
        }
        acts.go(to, feed);
    }
    if pitch_mm.is_some() {
        acts.event(in_step_event(None));
    }
    acts
}

fn in_step_event(mm_per_rev: Option<f64>) -> EventKind {
    mm_per_rev.map_or(EventKind::SpindleReleased, EventKind::SpindleFollowed)
}

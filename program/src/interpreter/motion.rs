//! The motion of a block: which of its words moves, and by which way the route goes on.

use path::geometry::{AxisVector, Shape};

use super::{Done, Group, Interpreter, Words, base, refuse};
use crate::codes::shown_code;
use crate::compensation::Way;
use crate::letters::AXIS_LETTERS;
use crate::meaning::{Cause, Leg, PLACES, ProfileReading, goes_home_first, is_turning};
use crate::reader::Word;
use crate::splines::Curve;
use crate::state::Motion;
use crate::straight::Straight;

impl Interpreter {
    /// Does a block of straight motion; false, and nothing done, if it needs more than that or is refused.
    pub fn straight(&mut self, line: u32, block: &Straight) -> bool {
        if !self.state_known || !self.splines.is_idle() {
            return false;
        }
        let Some(leg) = self.state.straight(block) else {
            return false;
        };
        self.route.go_straight(&mut self.state, line, &leg)
    }

    /// The motion of a block, if it has one.
    pub(super) fn travel(&mut self, line: u32, words: &Words) -> Done {
        let axis_word = words.first_in(PLACES);
        // The R of M19 is an angle of the spindle.
        let code = words.code(Group::Motion);
        let orients = code.is_none() && matches!(words.code(Group::Spindle), Some((190, _)));
        let circle_word = words.first_of(if orients { "IJK" } else { "IJKR" });
        let word = code.map(|(_, word)| word).or(axis_word).or(circle_word);
        let Some(offset) = word.map(|word| word.offset) else {
            return Ok(());
        };
        if code.is_some_and(|(number, _)| is_turning(number)) {
            // Done behind the block, by the lines of its profile.
            return Ok(());
        }
        let cause = Cause::new(line, words, offset);
        self.route.check_motion(&self.state, offset)?;
        let motion = self.state.in_force().motion();
        match motion {
            _ if matches!(code, Some((53, _))) => {
                let (curve, plane) = self.splines.close(&mut self.state, cause)?;
                return self.go_along(cause, &curve, plane);
            }
            Motion::Cycle(_) => return self.drill(cause, motion),
            Motion::Spline(spline) => {
                let curve = self.splines.curve(&self.state, cause, spline)?;
                return match curve {
                    Some((curve, plane)) => self.go_along(cause, &curve, plane),
                    None => Ok(()),
                };
            }
            Motion::InStep(motion) => {
                for part in self.state.in_step(cause, motion)? {
                    self.route.perform_each(&mut self.state, cause, part)?;
                }
                return Ok(());
            }
            Motion::Probe(number) if axis_word.is_none() && code.is_some() => {
                let found = format!("G{} without an axis word", shown_code(number));
                return cause.refuse(found, "where to, such as G38.2 Z-10");
            }
            _ if axis_word.is_none() && circle_word.is_none() => return Ok(()),
            _ => {}
        }
        let target = self.state.target(words)?;
        self.state.owe(AxisVector::zeros());
        if motion == Motion::Line
            && let Some(of_corner) = self.corner.take()
        {
            let (corner, ahead) = &*of_corner;
            return self.round_corner(cause, target, *corner, ahead);
        }
        if let Motion::Probe(number) = motion {
            return self.probe(cause, target, number);
        }
        let leg = self.change(line, |state, acts| state.leg(cause, target, acts))?;
        self.follow(cause, leg)
    }

    /// Goes along a motion of the program, and counts it if it is fed.
    pub(super) fn follow(&mut self, cause: Cause, leg: Leg) -> Done {
        match leg.way {
            Way::Rapid => {}
            Way::Line => self.route.output.straight_feeds += 1,
            Way::Arc(_) => self.route.output.arc_feeds += 1,
        }
        self.route.follow(&mut self.state, cause, leg)
    }

    /// G40, G41, G42, G41.1 and G42.1.
    pub(super) fn radius_words(&mut self, line: u32, words: &Words) -> Done {
        let Some((number, word)) = words.code(Group::CutterCompensation) else {
            return Ok(());
        };
        if number == 400 {
            return self.leave_contour(line, words, word.offset);
        }
        let offset = word.offset;
        if self.route.is_beside() {
            let code = shown_code(number);
            let found = format!("G{code} while the radius compensation is on");
            return refuse(offset, found, "G40 before it");
        }
        let cause = Cause::new(line, words, offset);
        let start = self.change(line, |state, acts| state.radius_words(cause, number, acts))?;
        if let Some(start) = start {
            self.route.begin_beside(&mut self.state, start);
        }
        Ok(())
    }

    /// Ends the radius compensation, if one is on.
    pub(super) fn leave_contour(&mut self, line: u32, words: &Words, offset: usize) -> Done {
        let cause = Cause::new(line, words, offset);
        self.route.leave_contour(&mut self.state, cause)
    }

    /// The same at the end of a program that does not say so.
    pub fn end_contour(&mut self) -> Done {
        self.leave_contour(self.line, &Words::default(), 0)
    }

    /// The code of the block that is done once; its axis words are no motion.
    pub(super) fn once(&mut self, line: u32, words: &mut Words) -> Done {
        let Some((number, word)) = words.code(Group::Once) else {
            return Ok(());
        };
        let offset = word.offset;
        if goes_home_first(words) {
            let text = "G28 or G30 takes the words of the axes, and G0 or G1 is the mode behind it, as on Fanuc's controls; LinuxCNC refuses that";
            self.note(line, text);
        }
        let cause = Cause::new(line, words, offset);
        match number {
            40 => return Ok(()),
            280 => self.go_home(cause, base::HOME_28)?,
            300 => self.go_home(cause, base::HOME_30)?,
            531 => {
                let turned = self.state.along_plane(cause)?;
                self.route.go_rapid(&mut self.state, cause, turned)?;
            }
            _ => self.state.set_once(number, cause)?,
        }
        words.remove(AXIS_LETTERS);
        words.remove("IJKR");
        Ok(())
    }

    /// G28 and G30: over the place that the words name, then the axes that they name (or all) to the place that is kept.
    fn go_home(&mut self, cause: Cause, first: u32) -> Done {
        let named = cause.words.first_of(AXIS_LETTERS);
        let over = named.map(|_| self.state.over_home(cause.words));
        if let Some(over) = over {
            self.route.go_rapid(&mut self.state, cause, over)?;
        }
        let home = self.state.home(first, cause, over);
        self.route.go_rapid(&mut self.state, cause, home)
    }

    /// The holes of a block of a cycle.
    fn drill(&mut self, cause: Cause, motion: Motion) -> Done {
        let Some(repeats) = self.state.holes_in_steps(cause.words)? else {
            return self.drill_block(cause, motion);
        };
        let mut words = cause.words.clone();
        words.remove("L");
        let single = Cause::new(cause.line, &words, cause.offset);
        for _ in 0..repeats {
            self.drill_block(single, motion)?;
        }
        Ok(())
    }

    fn drill_block(&mut self, cause: Cause, motion: Motion) -> Done {
        let Motion::Cycle(cycle) = motion else {
            return Ok(());
        };
        let block = self.drilling.block(&self.state, cause, cycle)?;
        if self.drilling.only_keeps {
            return Ok(());
        }
        let feed = self.state.feed(self.state.position(), cause.offset)?;
        let output = &self.route.output;
        output.check_room(block.steps_max(), cause.offset)?;
        let acts = self.state.drilled(&block, feed);
        self.route.perform_all(&mut self.state, cause, acts)
    }

    /// Goes along a curve.
    fn go_along(&mut self, cause: Cause, curve: &Curve, plane: [usize; 2]) -> Done {
        let position = self.state.position();
        let end = curve.end().put_into(*position, plane);
        let shapes: Vec<Shape> = curve
            .shapes(position, plane)
            .map_err(|wrong| wrong.at(cause.offset))?;
        let feed = self.state.feed_along(cause, &shapes, &end)?;
        self.route.go(&mut self.state, cause, shapes, feed)
    }

    /// The moves of a cycle along a profile.
    pub fn turn(&mut self, line: u32, words: &Words, word: Word, reading: &ProfileReading) -> Done {
        let offset = word.offset;
        let cause = Cause::new(line, words, offset);
        let cuts = self.state.cuts(cause, reading)?;
        // The words of the cycle are no places of single moves.
        let no_words = Words::default();
        let plain = Cause::new(line, &no_words, offset);
        for cut in cuts {
            let (leg, motion) = self.state.leg_of_cut(cut, offset)?;
            self.state.move_by(motion);
            self.follow(plain, leg)?;
        }
        Ok(())
    }
}

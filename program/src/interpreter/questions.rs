//! Words that ask the machine: G38.2 to G38.5 and M66.

use bus::sample::{ANALOG_INPUTS, AskedInput, DIGITAL_INPUTS, InputWait};

use super::*;
use crate::compensation::Way;
use crate::question::{Answer, Question};

/// Longest wait for an input, in s: a day.
const WAIT_S_MAX: f64 = 86_400.0;

/// Why an answer is none to what was asked.
fn other_question() -> Refusal {
    let right = "what the machine has answered is kept for one program: load it again";
    Refusal::new(0, "an answer to another question", right)
}

impl Interpreter {
    /// The motion of a probing block: up to the trip, or to its end.
    pub(super) fn probe(
        &mut self,
        line: u32,
        words: &Words,
        target: AxisVector,
        number: u32,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        if self.modes.feed_mode == FeedMode::InverseTime {
            let right = "G94: how long the motion takes is not known";
            return refuse(offset, "probing in G93", right);
        }
        let feed = self.feed(&target, offset)?;
        let from = self.tool_place();
        let before = self.output.mark();
        let elements_before = self.output.elements_made();
        self.output.straight_feeds += 1;
        let way = self.straight_to(target);
        self.run_move(line, words, target, (way, Way::Line, feed), offset)?;
        let made = self.output.elements_made() > elements_before;
        let made = made.then(|| self.output.piece.elements.last().cloned());
        let made = made.flatten();
        let element = made.unwrap_or_else(|| {
            // It is where it is to go: the contact there decides.
            let shape = Shape::Line { from, to: target };
            Element::new(line, shape, feed, &self.rotary)
        });
        self.output.take_back(&before);
        let (away, must) = (number >= 384, number.is_multiple_of(2));
        self.event(line, EventKind::Probe { away, must });
        self.output.happen_behind_next(line, EventKind::ProbeEnd);
        let question = Question::Probe {
            line,
            element,
            away,
            must,
        };
        Ok(self.ask(question)?)
    }

    /// M66.
    pub(super) fn await_input(
        &mut self,
        line: u32,
        words: &Words,
        offset: usize,
    ) -> Result<(), Refusal> {
        let whole =
            |letter: char, most: usize| words.whole(letter, "a whole number", 0.0..=most as f64);
        let digital = whole('P', DIGITAL_INPUTS - 1)?;
        let analog = whole('E', ANALOG_INPUTS - 1)?;
        let (Some(number), true) = (digital.or(analog), digital.is_none() || analog.is_none())
        else {
            let right =
                "one input: P for a digital one, E for an analogue one, such as M66 P0 L3 Q5";
            return refuse(offset, "M66", right);
        };
        let wait = whole('L', InputWait::ALL.len() - 1)?.unwrap_or(0);
        let wait = InputWait::ALL.get(wait as usize).copied();
        let wait = wait.unwrap_or(InputWait::Immediate);
        if analog.is_some() && wait != InputWait::Immediate {
            let right = "an analogue input is read at once: L0";
            return refuse(offset, "M66 E with L", right);
        }
        let timeout_s = words.value('Q').map_or(0.0, |q| q.value);
        if wait != InputWait::Immediate && !(timeout_s > 0.0 && timeout_s <= WAIT_S_MAX) {
            let right = "the longest wait in seconds, above 0, such as M66 P0 L3 Q5";
            return refuse(offset, format!("Q{timeout_s}"), right);
        }
        let asked = AskedInput {
            number,
            analog: analog.is_some(),
            wait,
        };
        self.event(line, EventKind::AwaitInput { asked, timeout_s });
        self.ask(Question::Input { line, asked })
    }

    /// Asks; goes on at once where the answer is known already, or is assumed.
    fn ask(&mut self, question: Question) -> Result<(), Refusal> {
        let known = self.setup.answers.get(self.answers_taken).copied();
        match known {
            Some(answer) => self.take_answer(&question, answer),
            None if self.setup.answers_assumed || self.setup.rehearsed => {
                let line = question.line();
                if self.setup.rehearsed {
                    let text = "what the machine answers is not known yet: from here on this is read as if a probe tripped at the end of its motion and an input were as the program waits for it";
                    self.note(line, text);
                }
                self.take_answer(&question, question.assumed())
            }
            None => {
                self.asked = Some(question);
                Ok(())
            }
        }
    }

    /// What the program asks now and nobody has answered.
    pub fn asked(&self) -> Option<&Question> {
        self.asked.as_ref()
    }

    /// How many answers the program has had.
    pub fn answers_taken(&self) -> usize {
        self.answers_taken
    }

    /// The answer to what it asks.
    pub fn answer(&mut self, answer: Answer) -> Result<(), Refusal> {
        match self.asked.take() {
            Some(question) => self.take_answer(&question, answer),
            None => Err(other_question()),
        }
    }

    fn take_answer(&mut self, question: &Question, answer: Answer) -> Result<(), Refusal> {
        self.answers_taken += 1;
        match (question, answer) {
            (Question::Probe { element, .. }, Answer::Tripped { at, rests }) => {
                self.probed(element, at, rests, true);
                self.log_probe(element.line);
            }
            (
                Question::Probe {
                    must: true, away, ..
                },
                Answer::Missed { .. },
            ) => {
                let found = if *away {
                    "a probe that kept its contact to the end of its motion"
                } else {
                    "a probe that made no contact to the end of its motion"
                };
                let right = "G38.3 and G38.5 go on then, with 0 in #5070";
                return refuse(0, found, right);
            }
            (Question::Probe { element, .. }, Answer::Missed { rests }) => {
                self.probed(element, rests, rests, false);
            }
            (Question::Input { .. }, Answer::Input(value)) => {
                self.parameters.set(base::INPUT, value);
            }
            _ => return Err(other_question()),
        }
        Ok(())
    }

    /// The way of the probe as it was, and where the program is behind it.
    fn probed(&mut self, way: &Element, at: AxisVector, rests: AxisVector, tripped: bool) {
        let from = way.point(0.0);
        let shape = Shape::Line { from, to: rests };
        let element = Element::new(way.line, shape, way.feed, &self.rotary);
        self.output.add(element);
        self.position = rests;
        let mut place = self.in_program(&at);
        for (index, component) in place.iter_mut().enumerate() {
            *component /= self.unit_of(index);
        }
        self.set_vector(base::PROBED, place);
        let tripped = f64::from(u8::from(tripped));
        self.parameters.set(base::PROBED + 9, tripped);
    }
}

//! What a program asks the machine (G38.2 to G38.5 and M66), and what becomes of the answers.

use bus::sample::AskedInput;
use path::geometry::{AxisVector, Element, Shape};
use serde::{Deserialize, Serialize};

use super::{EventKind, Interpreter, base};
use crate::compensation::Way;
use crate::meaning::{Cause, Leg};
use crate::program::ProgramEnd;
use crate::question::{Answer, Question};
use crate::refusal::{Done, Refusal, wrong};
use crate::state::FeedMode;

/// What a program asks.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Questions {
    /// The question that nobody has answered.
    #[serde(skip)]
    asked: Option<Question>,
    /// How many answers there were.
    taken: usize,
    /// How many of them were assumed, of a program that is read beside its machine.
    #[serde(skip)]
    assumed: usize,
    /// Between PROBEOPEN and PROBECLOSE.
    logs_probes: bool,
}

/// So many answers are assumed: a program that asks on is one that waits for its machine.
const ASSUMED_MAX: usize = 10_000;

impl Questions {
    /// From here on what a probe finds is written into the log, or no longer.
    pub fn log_probes(&mut self, logs: bool) {
        self.logs_probes = logs;
    }
}

/// Why an answer is none to what was asked.
fn other_question() -> Refusal {
    let right = "what the machine has answered is kept for one program: load it again";
    Refusal::new(0, "an answer to another question", right)
}

impl Interpreter {
    /// The motion of a probing block: up to the trip, or to its end.
    pub(super) fn probe(&mut self, cause: Cause, to: AxisVector, number: u32) -> Done {
        if self.state.in_force().feed_mode == FeedMode::InverseTime {
            let right = "G94: how long the motion takes is not known";
            return cause.refuse("probing in G93", right);
        }
        let line = cause.line;
        let feed = self.state.feed(&to, cause.offset)?;
        let shapes = self.state.straight_to(to);
        let element = shapes.first().cloned();
        let before = self.route.output.mark();
        let elements_before = self.route.output.elements_made();
        let leg = Leg {
            to,
            shapes,
            way: Way::Line,
            feed,
        };
        self.follow(cause, leg)?;
        let output = &mut self.route.output;
        let made = output.elements_made() > elements_before;
        let made = output.piece.elements.last().filter(|_| made).cloned();
        // Where it is where it is to go, the contact there decides.
        let rotary = &self.state.equipment().rotary;
        let at_rest = element.map(|shape| Element::new(line, shape, feed, rotary));
        output.take_back(&before);
        let (away, must) = (number >= 384, number.is_multiple_of(2));
        self.event(line, EventKind::Probe { away, must });
        let output = &mut self.route.output;
        output.happen_behind_next(line, EventKind::ProbeEnd);
        let Some(element) = made.or(at_rest) else {
            return Ok(());
        };
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
        asked: AskedInput,
        timeout_s: f64,
    ) -> Result<(), Refusal> {
        self.event(line, EventKind::AwaitInput { asked, timeout_s });
        self.ask(Question::Input { line, asked })
    }

    /// Asks; goes on at once where the answer is known already, or is assumed.
    fn ask(&mut self, question: Question) -> Result<(), Refusal> {
        let setup = self.state.equipment();
        let known = setup.answers.get(self.questions.taken).copied();
        let rehearsed = setup.rehearsed;
        if known.is_none() && !setup.answers_assumed && !rehearsed {
            self.questions.asked = Some(question);
            return Ok(());
        }
        if known.is_none() && rehearsed {
            let text = "what the machine answers is not known yet: from here on this is read as if a probe tripped at the end of its motion and an input were as the program waits for it";
            self.note(question.line(), text);
            self.questions.assumed += 1;
            if self.questions.assumed > ASSUMED_MAX {
                let text = "asks again and again: whether that ends is up to what the machine answers, and nothing behind it was looked at";
                self.note(question.line(), text);
                // For who checks it, it ends here.
                self.ended = Some(ProgramEnd::M2(question.line()));
            }
        }
        self.take_answer(&question, known.unwrap_or_else(|| question.assumed()))
    }

    /// Whether it is read beside its machine.
    pub fn is_rehearsed(&self) -> bool {
        self.state.equipment().rehearsed
    }

    /// What the program asks now and nobody has answered.
    pub fn asked(&self) -> Option<&Question> {
        self.questions.asked.as_ref()
    }

    /// How many answers the program has had.
    pub fn answers_taken(&self) -> usize {
        self.questions.taken
    }

    /// The answer to what it asks.
    pub fn answer(&mut self, answer: Answer) -> Result<(), Refusal> {
        match self.questions.asked.take() {
            Some(question) => self.take_answer(&question, answer),
            None => Err(other_question()),
        }
    }

    fn take_answer(&mut self, question: &Question, answer: Answer) -> Result<(), Refusal> {
        self.questions.taken += 1;
        match (question, answer) {
            (Question::Probe { element, .. }, Answer::Tripped { at, rests }) => {
                self.probed(element, at, rests, true);
                self.log_probe(element.line);
            }
            (Question::Probe { must, away, .. }, Answer::Missed { .. }) if *must => {
                let found = if *away {
                    "a probe that kept its contact to the end of its motion"
                } else {
                    "a probe that made no contact to the end of its motion"
                };
                return wrong(found, "G38.3 and G38.5 go on then, with 0 in #5070");
            }
            (Question::Probe { element, .. }, Answer::Missed { rests }) => {
                self.probed(element, rests, rests, false);
            }
            (Question::Input { .. }, Answer::Input(value)) => {
                self.state.own_parameters().set(base::INPUT, value);
            }
            _ => return Err(other_question()),
        }
        Ok(())
    }

    /// The way of the probe as it was, and where the program is behind it.
    fn probed(&mut self, way: &Element, at: AxisVector, rests: AxisVector, tripped: bool) {
        let from = way.point(0.0);
        let shape = Shape::Line { from, to: rests };
        let rotary = &self.state.equipment().rotary;
        let element = Element::new(way.line, shape, way.feed, rotary);
        self.route.output.add(element);
        self.state.probed(at, rests, tripped);
    }

    /// Writes into the log where a probe has tripped, if that is wanted: nine numbers, in the coordinates and unit of the program.
    fn log_probe(&mut self, line: u32) {
        if self.questions.logs_probes {
            let parameters = self.state.parameters();
            let numbers = base::PROBED..base::PROBED + 9;
            let shown = numbers.map(|number| format!("{:.6}", parameters.get(number)));
            let text = shown.collect::<Vec<_>>().join(" ");
            self.route.output.say(line, true, text);
        }
    }
}

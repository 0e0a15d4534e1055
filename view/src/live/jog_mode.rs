//! Jogging by keys: a held key moves an axis as long as the terminal repeats it.
//!
//! A terminal tells of a key when it is pressed and again and again while it is held, and nothing when it is let go. So the order is
//! renewed with each repetition, and the axis comes to rest when they stop. The first repetition comes late: so long a tap moves.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use console::exit::Failure;
use machine::{AxisKind, Increment, Machine, Manual};
use operator::{Click, Clicks, Client, Eyes, JogAsked, JogSender};
use ratatui::crossterm::event::KeyCode;

use super::words::{Tone, failure_words};

/// Until the first repetition of a key.
const FIRST: Duration = Duration::from_millis(700);
/// From one repetition to the next.
const NEXT: Duration = Duration::from_millis(200);
/// Speeds, in mm/min or degrees/min.
const SPEEDS: [f64; 10] = [
    6.0, 30.0, 60.0, 150.0, 300.0, 600.0, 1500.0, 3000.0, 6000.0, 15_000.0,
];

/// What the keys ask of whoever sends orders.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ask {
    /// Jog as long as the key is held.
    Hold(Way),
    /// Jog by an increment.
    Step(Way, Increment),
    /// Come to rest.
    End,
}

/// A way to go.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Way {
    axis: u32,
    direction: f64,
    speed_mm_s: f64,
}

/// What a key came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Came {
    /// It means nothing here.
    Nothing,
    /// It was taken.
    Taken,
    /// The mode is left.
    Left,
}

/// The mode, from `j` to Esc.
#[derive(Debug)]
pub struct JogMode {
    axis: usize,
    /// Of the increments of the axis; none as long as the key is held.
    step: Option<usize>,
    speed: usize,
    letters: Vec<(char, AxisKind)>,
    manual: Manual,
    asks: Sender<Ask>,
    answers: Receiver<(Tone, String)>,
}

impl JogMode {
    /// Of a cell and its machine.
    pub fn of(cell: &str, machine: &Machine) -> JogMode {
        let (asks, asked) = channel();
        let (answer, answers) = channel();
        let cell = cell.to_owned();
        // It ends with the mode, whose keys it hears no more then.
        std::thread::spawn(move || send(&cell, &asked, &answer));
        let usual = machine.manual.jog_mm_s * 60.0;
        let speed = SPEEDS.iter().rposition(|speed| *speed <= usual);
        let letter = |axis: &machine::Axis| {
            let letter = axis.name.chars().next();
            letter.map(|letter| (letter, axis.kind))
        };
        JogMode {
            axis: 0,
            step: None,
            speed: speed.unwrap_or(0),
            letters: machine.program_axes().iter().filter_map(letter).collect(),
            manual: machine.manual.clone(),
            asks,
            answers,
        }
    }

    /// What the bottom line says.
    pub fn words(&self) -> String {
        let axis = self.letters.get(self.axis);
        let (letter, kind) = axis.copied().unwrap_or(('?', AxisKind::Linear));
        let unit = kind.unit();
        let step = match self.increment() {
            None => "while a key is held".to_owned(),
            Some(Increment { shown, unit, .. }) => format!("by {shown} {unit}"),
        };
        let others: String = self.letters.iter().map(|(letter, _)| *letter).collect();
        format!(
            "JOG {letter} {step}, {} {unit}/min   ← → jog   {others} axis   i step   ↑ ↓ speed   space rest   Esc leaves",
            self.speed()
        )
    }

    /// The increments of the axis.
    fn increments(&self) -> Vec<Increment> {
        let axis = self.letters.get(self.axis);
        axis.map_or(Vec::new(), |(_, kind)| self.manual.increments(*kind))
    }

    /// That of a step; none as long as the key is held.
    fn increment(&self) -> Option<Increment> {
        let (step, increments) = (self.step?, self.increments());
        increments.get(step).or(increments.last()).copied()
    }

    fn speed(&self) -> f64 {
        SPEEDS.get(self.speed).copied().unwrap_or(600.0)
    }

    /// Acts on a key.
    pub fn key(&mut self, code: KeyCode) -> Came {
        match code {
            KeyCode::Right | KeyCode::Char('+' | '=') => self.jog(1.0),
            KeyCode::Left | KeyCode::Char('-') => self.jog(-1.0),
            KeyCode::Up => self.speed = (self.speed + 1).min(SPEEDS.len() - 1),
            KeyCode::Down => self.speed = self.speed.saturating_sub(1),
            KeyCode::Char('i') => {
                self.step = match self.step {
                    None => Some(0),
                    Some(step) if step + 1 < self.increments().len() => Some(step + 1),
                    Some(_) => None,
                };
                self.ask(Ask::End);
            }
            KeyCode::Char(' ') => self.ask(Ask::End),
            KeyCode::Esc | KeyCode::Char('j' | 'q') => {
                self.ask(Ask::End);
                return Came::Left;
            }
            KeyCode::Char(key) => {
                let key = key.to_ascii_uppercase();
                let Some(axis) = self.letters.iter().position(|(letter, _)| *letter == key) else {
                    return Came::Nothing;
                };
                self.ask(Ask::End);
                self.axis = axis;
            }
            _ => return Came::Nothing,
        }
        Came::Taken
    }

    fn jog(&self, direction: f64) {
        let way = Way {
            axis: self.axis as u32,
            direction,
            speed_mm_s: self.speed() / 60.0,
        };
        self.ask(match self.increment() {
            None => Ask::Hold(way),
            Some(step) => Ask::Step(way, step),
        });
    }

    fn ask(&self, ask: Ask) {
        let _ = self.asks.send(ask);
    }

    /// What came of the orders since the last look: the newest answer.
    pub fn answer(&self) -> Option<(Tone, String)> {
        self.answers.try_iter().last()
    }
}

/// Sends what the keys ask for, until there are no more of them.
fn send(cell: &str, asked: &Receiver<Ask>, answer: &Sender<(Tone, String)>) {
    let fails = |failure: &Failure| {
        let _ = answer.send((Tone::Bad, failure_words(failure)));
    };
    let client = match Client::find(Some(cell), "jog keys") {
        Ok(client) => client,
        Err(failure) => return fails(&failure),
    };
    let mut hand = match Eyes::open(&client) {
        Ok(eyes) => Hand {
            client: &client,
            eyes,
            clicks: None,
            held: None,
            not_taken: 0,
        },
        Err(failure) => return fails(&failure),
    };
    loop {
        let (mut asks, is_left) = match asked.recv() {
            Ok(ask) => (vec![ask], false),
            Err(_) => (vec![Ask::End], true),
        };
        asks.extend(asked.try_iter());
        for ask in newest_holds(&asks) {
            match hand.obey(ask) {
                Ok(Some(said)) => drop(answer.send(said)),
                Ok(None) => {}
                Err(failure) => {
                    hand.held = None;
                    fails(&failure);
                }
            }
        }
        if is_left {
            return;
        }
    }
}

/// A key that repeats faster than orders are answered keeps nothing moving when it is let go: of repetitions in a row the last counts.
fn newest_holds(asks: &[Ask]) -> Vec<Ask> {
    let is_hold = |ask: &Ask| matches!(ask, Ask::Hold(_));
    let followed = asks.iter().skip(1).map(Some).chain([None]);
    let pairs = asks.iter().zip(followed);
    let kept = pairs.filter(|(ask, next)| !is_hold(ask) || !next.is_some_and(is_hold));
    kept.map(|(ask, _)| *ask).collect()
}

/// What gives the orders.
struct Hand<'a> {
    client: &'a Client,
    eyes: Eyes<'a>,
    clicks: Option<Clicks<'a>>,
    held: Option<(JogSender<'a>, u32, f64)>,
    /// Steps that were not taken since the last that was.
    not_taken: u32,
}

impl Hand<'_> {
    /// Does what a key asks for; what is to be said of it.
    fn obey(&mut self, ask: Ask) -> Result<Option<(Tone, String)>, Failure> {
        match ask {
            Ask::Hold(way) => self.hold(way).map(|()| None),
            Ask::Step(way, step) => self.step(way, step).map(Some),
            Ask::End => self.end().map(|()| None),
        }
    }

    fn hold(&mut self, way: Way) -> Result<(), Failure> {
        let now = self.eyes.look()?;
        let client = self.client;
        if let Some((sender, of_axis, to)) = &mut self.held
            && (*of_axis, *to) == (way.axis, way.direction)
            && sender.renew(now.scan, client.scans(NEXT), way.speed_mm_s)?
        {
            return Ok(());
        }
        self.end()?;
        let asked = JogAsked {
            axis: way.axis,
            direction: way.direction,
            speed_mm_s: way.speed_mm_s,
            deadline_scans: client.scans(FIRST),
        };
        // Coming to rest from the jog before, it is not there yet: the next repetition asks again.
        let sender = JogSender::begin_soon(client, &asked, &now)?;
        self.held = sender.map(|sender| (sender, way.axis, way.direction));
        Ok(())
    }

    fn step(&mut self, way: Way, step: Increment) -> Result<(Tone, String), Failure> {
        let (axis, direction) = (way.axis, way.direction);
        let seen = self.eyes.look()?.scan;
        let clicks = match &mut self.clicks {
            Some(clicks) => clicks,
            none => none.insert(Clicks::of(self.client)?),
        };
        let click = clicks.click(axis, direction * step.way, way.speed_mm_s, seen)?;
        let words = click.words(self.client, axis, direction * step.shown, step.unit);
        if click != Click::NotTaken {
            self.not_taken = 0;
            let tone = if click == Click::Taken {
                Tone::Good
            } else {
                Tone::Waits
            };
            return Ok((tone, words));
        }
        self.not_taken += 1;
        let clicks = if self.not_taken == 1 {
            "click"
        } else {
            "clicks"
        };
        Ok((Tone::Waits, format!("{} {clicks} {words}", self.not_taken)))
    }

    /// All that the keys move comes to rest.
    fn end(&mut self) -> Result<(), Failure> {
        if let Some((mut sender, ..)) = self.held.take() {
            sender.end()?;
        }
        self.clicks.as_mut().map_or(Ok(()), Clicks::end)
    }
}

#[cfg(test)]
mod tests {
    use super::{Ask, Increment, JogMode, KeyCode, Way, newest_holds};

    #[test]
    fn steps_are_the_increments_of_the_machine_file_in_the_unit_of_the_axis() {
        let text = include_str!("../../../machines/xzb-pivot/machine.toml");
        let lists = "increments_mm = [0.02, 0.2]\nincrements_inch = [0.0001, 0.001, 0.01]";
        let text = format!("{text}\n[manual]\n{lists}\n");
        let machine = machine::Machine::parse("machine.toml", &text).expect("a machine");
        let mut keys = JogMode::of("no-cell-of-this-name", &machine);
        let mut shown = |key: char| {
            keys.key(KeyCode::Char(key));
            keys.words()
        };
        for step in [
            "by 0.0001 in,",
            "by 0.001 in,",
            "by 0.01 in,",
            "while a key",
        ] {
            let words = shown('i');
            assert!(words.contains(&format!("JOG X {step}")), "{words}");
        }
        for step in ["by 0.0001 in,", "by 0.001 in,", "by 0.01 in,"] {
            assert!(shown('i').contains(step), "{step}");
        }
        // An axis with fewer of them takes its largest.
        let words = shown('b');
        assert!(words.contains("JOG B by 0.2 deg,"), "{words}");
    }

    #[test]
    fn of_repetitions_in_a_row_the_last_counts_and_nothing_else_is_lost() {
        let way = |speed_mm_s| Way {
            axis: 0,
            direction: 1.0,
            speed_mm_s,
        };
        let hold = |speed_mm_s| Ask::Hold(way(speed_mm_s));
        let increment = Increment {
            way: 0.1,
            shown: 0.1,
            unit: "mm",
        };
        let step = Ask::Step(way(1.0), increment);
        let asks = [
            hold(1.0),
            hold(2.0),
            step,
            step,
            hold(3.0),
            Ask::End,
            hold(4.0),
        ];
        let kept = [hold(2.0), step, step, hold(3.0), Ask::End, hold(4.0)];
        assert_eq!(newest_holds(&asks), kept);
    }
}

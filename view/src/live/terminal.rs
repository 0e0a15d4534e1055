//! The live screen: looks, draws, listens for keys.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use bus::sample::{Mode, Order};
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};

use super::OF_A_LAUNCHER;
use super::draw::{Prompt, Screen, draw};
use super::jog_mode::{Came, JogMode};
use super::looks::{FRAME, LISTEN};
use super::override_steps::OverrideSteps;
use super::palette::Palette;
use super::source::Source;
use super::typed_line::{Typed, TypedLine};
use super::words::{Tone, failure_words};
use console::exit::{INTERRUPTED, Kind, Outcome};
use console::signals::Signals;
use operator;

/// So long an answer stays in the bottom line.
const ANSWER_SHOWN: Duration = Duration::from_secs(8);
/// So long a view that was ordered to leave may take.
const LEAVE_LIMIT: Duration = Duration::from_millis(500);

/// Shows the cell until somebody quits. The terminal is given back as it was however this ends: by key, signal, error or panic.
pub fn run(feed: Box<dyn Source>) -> Outcome {
    let signals = Arc::new(Signals::catch().environment()?);
    let left = Arc::new(AtomicBool::new(false));
    leave_for_certain(Arc::clone(&signals), Arc::clone(&left));
    // Its panic hook gives the terminal back before the message is printed.
    let mut terminal = ratatui::try_init().environment()?;
    let result = View::new(feed).run(&mut terminal, &signals);
    left.store(true, Ordering::Release);
    ratatui::restore();
    result.environment()
}

/// Where the terminal has gone, waiting for a key never ends (crossterm 0.29 reads its end for ever, at full speed): a view that has
/// been ordered to leave and does not is ended from here.
fn leave_for_certain(signals: Arc<Signals>, left: Arc<AtomicBool>) {
    std::thread::spawn(move || {
        while !left.load(Ordering::Acquire) {
            std::thread::sleep(FRAME);
            if signals.count() > 0 {
                std::thread::sleep(LEAVE_LIMIT);
                if !left.load(Ordering::Acquire) {
                    ratatui::restore();
                    std::process::exit(i32::from(INTERRUPTED));
                }
            }
        }
    });
}

/// An order on its way, answered by a thread of its own: a master that is silent must not freeze the screen.
struct Asked {
    order: Order,
    answer: Receiver<Result<String, String>>,
}

struct View {
    feed: Box<dyn Source>,
    palette: Palette,
    readout: bool,
    help: bool,
    prompt: Prompt,
    prompt_since: Instant,
    asked: Option<Asked>,
    jog: Option<JogMode>,
    /// Blocks are typed in.
    types: bool,
    line: TypedLine,
    /// What came of blocks, also while other orders are given.
    blocks: Vec<Receiver<(Tone, String)>>,
    override_steps: OverrideSteps,
}

impl View {
    fn new(feed: Box<dyn Source>) -> Self {
        View {
            feed,
            palette: Palette::of_environment(),
            readout: false,
            help: false,
            prompt: Prompt::Keys,
            prompt_since: Instant::now(),
            asked: None,
            jog: None,
            types: false,
            line: TypedLine::default(),
            blocks: Vec::new(),
            override_steps: OverrideSteps::default(),
        }
    }

    fn run(mut self, terminal: &mut DefaultTerminal, signals: &Signals) -> std::io::Result<()> {
        loop {
            let due = Instant::now() + FRAME;
            self.feed.look();
            self.feed.follow();
            self.take_answer();
            self.order_override();
            let screen = Screen {
                model: self.feed.model(),
                palette: self.palette,
                prompt: self.prompt.clone(),
                readout: self.readout,
                help: self.help,
            };
            terminal.draw(|frame| draw(frame, &screen))?;
            self.feed.watch_periods(LISTEN);
            loop {
                let left = due.saturating_duration_since(Instant::now());
                if !event::poll(left)? {
                    break;
                }
                if let Event::Key(key) = event::read()?
                    && key.kind != KeyEventKind::Release
                {
                    let control = key.modifiers.contains(KeyModifiers::CONTROL);
                    match key.code {
                        KeyCode::Char('c') if control => return Ok(()),
                        KeyCode::Char('z') if control => self.suspend(terminal)?,
                        code if self.key(code) => return Ok(()),
                        _ => {}
                    }
                }
            }
            if signals.count() > 0 {
                return Ok(());
            }
        }
    }

    /// Gives the terminal back to the shell until `fg`; a launcher's view stays, for its launcher must not stop.
    fn suspend(&mut self, terminal: &mut DefaultTerminal) -> std::io::Result<()> {
        if std::env::var_os(OF_A_LAUNCHER).is_some() {
            self.answer("the cell has its launcher in this terminal: q closes the view");
            return Ok(());
        }
        ratatui::restore();
        rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::TSTP)?;
        // Here it goes on.
        *terminal = ratatui::try_init()?;
        terminal.clear()
    }

    /// Acts on a key; true for the one that leaves.
    fn key(&mut self, code: KeyCode) -> bool {
        if code == KeyCode::Char('!') && self.feed.takes_orders() {
            // It waits for no answer to another order, and asks nothing.
            self.asked = None;
            self.jog = None;
            self.types = false;
            self.order(Order::EmergencyStop, 0.0);
            return false;
        }
        if self.types {
            self.type_key(code);
            return false;
        }
        if self.jog.is_some() && !self.help {
            self.jog_key(code);
            return false;
        }
        if std::mem::take(&mut self.help) {
            return false;
        }
        let confirmed = match self.prompt {
            Prompt::ConfirmStop => Some((Order::Stop, "not stopped")),
            Prompt::ConfirmHome => Some((Order::Home, "not homed")),
            Prompt::ConfirmResume => Some((Order::Resume, "not resumed")),
            Prompt::Keys | Prompt::Jog(_) | Prompt::Block(_) | Prompt::Answer(..) => None,
        };
        if let Some((order, otherwise)) = confirmed {
            self.say(Prompt::Keys);
            if code == KeyCode::Char('y') {
                self.order(order, 0.0);
            } else {
                self.answer(otherwise);
            }
            return false;
        }
        let order = matches!(
            code,
            KeyCode::Char('h' | 'r' | 's' | 'm' | 'b' | 'f' | 'j' | ':' | '!' | '+' | '=' | '-')
        );
        if order && !self.feed.takes_orders() {
            self.answer("read only from here: orders are given on the controller PC");
            return false;
        }
        match code {
            KeyCode::Char('q') | KeyCode::Esc => return true,
            KeyCode::Char('?') => self.help = true,
            KeyCode::Char('d') => self.readout = !self.readout,
            KeyCode::Char('h') => self.order(Order::Hold, 0.0),
            KeyCode::Char('r') if self.has_tripped() => self.say(Prompt::ConfirmResume),
            KeyCode::Char('r') => self.order(Order::Resume, 0.0),
            KeyCode::Char('s') => self.say(Prompt::ConfirmStop),
            KeyCode::Char('m') => self.say(Prompt::ConfirmHome),
            KeyCode::Char('f') => self.step_rapids(),
            KeyCode::Char('b') => self.switch_single_block(),
            KeyCode::Char('j') => self.begin_jogging(),
            KeyCode::Char(':') => {
                self.types = true;
                self.say(Prompt::Block(String::new()));
            }
            KeyCode::Char('+' | '=') => self.step_override(true),
            KeyCode::Char('-') => self.step_override(false),
            _ => {}
        }
        false
    }

    fn type_key(&mut self, code: KeyCode) {
        match self.line.key(code) {
            Typed::More => {
                let text = self.line.text().to_owned();
                self.say(Prompt::Block(text));
            }
            Typed::Left => {
                self.types = false;
                self.say(Prompt::Keys);
            }
            Typed::Sent(text) => {
                self.types = false;
                self.run_block(text);
            }
        }
    }

    /// Runs a typed-in block beside the view, whose keys act meanwhile.
    fn run_block(&mut self, text: String) {
        if self.feed.has_ended() {
            return self.answer("mdi: the run has ended");
        }
        let cell = self.feed.model().cell.clone();
        let (sender, answer) = channel();
        self.answer(&format!("{text} …"));
        // Ends by itself: with the block, or with the cell.
        std::thread::spawn(move || {
            let says = |words: &str| {
                let _ = sender.send((Tone::Good, words.to_owned()));
            };
            let done = operator::mdi_in(&cell, &text, says);
            let _ = sender.send(match done {
                Ok(words) => (Tone::Good, words),
                Err(failure) => (Tone::Bad, failure_words(&failure)),
            });
        });
        self.blocks.push(answer);
    }

    /// What came of typed-in blocks since the last look: the newest.
    fn block_answer(&mut self) -> Option<(Tone, String)> {
        let mut newest = None;
        self.blocks.retain(|answers| {
            loop {
                match answers.try_recv() {
                    Ok(answer) => newest = Some(answer),
                    Err(TryRecvError::Empty) => return true,
                    Err(TryRecvError::Disconnected) => return false,
                }
            }
        });
        newest
    }

    fn begin_jogging(&mut self) {
        let model = self.feed.model();
        let jog = JogMode::of(&model.cell, &model.machine);
        self.say(Prompt::Jog(jog.words()));
        self.jog = Some(jog);
    }

    fn jog_key(&mut self, code: KeyCode) {
        let Some(jog) = &mut self.jog else { return };
        match jog.key(code) {
            Came::Left => {
                self.jog = None;
                self.say(Prompt::Keys);
            }
            Came::Taken => {
                let words = jog.words();
                self.say(Prompt::Jog(words));
            }
            Came::Nothing if code == KeyCode::Char('h') => self.order(Order::Hold, 0.0),
            Came::Nothing if code == KeyCode::Char('?') => self.help = true,
            Came::Nothing => {}
        }
    }

    fn switch_single_block(&mut self) {
        let feedback = self.feed.model().feedback.as_ref();
        if let Some(is_on) = feedback.map(|now| now.inputs.single_block()) {
            self.order(Order::SingleBlock, f64::from(u8::from(!is_on)));
        }
    }

    /// From one of the usual overrides of rapids to the next lower one, and from the lowest to all.
    fn step_rapids(&mut self) {
        let feedback = self.feed.model().feedback.as_ref();
        let Some(now) = feedback.map(|now| now.inputs.rapid_override_percent()) else {
            return;
        };
        let lower = [50, 25, 5].into_iter().find(|step| *step < now);
        self.order(Order::RapidOverride, f64::from(lower.unwrap_or(100)));
    }

    fn step_override(&mut self, up: bool) {
        let model = self.feed.model();
        let Some(feedback) = &model.feedback else {
            return;
        };
        let most = model.machine.path.feed_override_max_percent;
        self.override_steps
            .step(up, feedback.override_percent, most);
    }

    /// Orders what the keys have come to, one order after another.
    fn order_override(&mut self) {
        if self.asked.is_some() {
            return;
        }
        if let Some(percent) = self.override_steps.next_order() {
            self.order(Order::Override, f64::from(percent));
            if self.asked.is_none() {
                self.override_steps.give_up();
            }
        } else if let Some(feedback) = &self.feed.model().feedback {
            self.override_steps.seen(feedback.override_percent);
        }
    }

    /// Whether a `resume` switches drives on and moves out of a trip.
    fn has_tripped(&self) -> bool {
        let feedback = self.feed.model().feedback.as_ref();
        feedback.and_then(|now| Mode::from_wire(now.mode)) == Some(Mode::Tripped)
    }

    fn order(&mut self, order: Order, value: f64) {
        if self.asked.is_some() {
            return self.answer("the order before has no answer yet: not sent");
        }
        if self.feed.has_ended() {
            return self.answer(&format!("{}: the run has ended", order.word()));
        }
        let cell = self.feed.model().cell.clone();
        let (sender, answer) = channel();
        // Ends by itself: with the answer, or when the answer's limit has passed.
        std::thread::spawn(move || {
            let answer = operator::order(&cell, order, value);
            let _ = sender.send(answer.map_err(|failure| failure_words(&failure)));
        });
        self.asked = Some(Asked { order, answer });
        self.answer(&format!("{} …", order.word()));
    }

    fn take_answer(&mut self) {
        if let Some((tone, words)) = self.block_answer() {
            self.say(Prompt::Answer(tone, words));
        }
        if self.types {
            // What is being typed stays on the screen.
            let text = self.line.text().to_owned();
            return self.say(Prompt::Block(text));
        }
        if let Some((tone, words)) = self.jog.as_ref().and_then(JogMode::answer) {
            self.say(Prompt::Answer(tone, words));
        }
        if let Some(asked) = &self.asked {
            let (tone, words) = match asked.answer.try_recv() {
                Ok(Ok(words)) => (Tone::Good, words),
                Ok(Err(words)) => (Tone::Bad, words),
                Err(TryRecvError::Empty) => return,
                Err(TryRecvError::Disconnected) => (Tone::Bad, "the order came to nothing".into()),
            };
            if asked.order == Order::Override && tone == Tone::Bad {
                self.override_steps.give_up();
            }
            self.asked = None;
            self.say(Prompt::Answer(tone, words));
        } else if self.prompt != Prompt::Keys && self.prompt_since.elapsed() > ANSWER_SHOWN {
            let keys = self.jog.as_ref().map(|jog| Prompt::Jog(jog.words()));
            self.say(keys.unwrap_or(Prompt::Keys));
        }
    }

    fn answer(&mut self, words: &str) {
        self.say(Prompt::Answer(Tone::Waits, words.into()));
    }

    fn say(&mut self, prompt: Prompt) {
        self.prompt = prompt;
        self.prompt_since = Instant::now();
    }
}

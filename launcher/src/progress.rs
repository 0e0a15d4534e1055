//! Progress of a run on a terminal: program line, percent, real-time factor. Silent when not a terminal.

use std::io::{self, IsTerminal};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bus::port::Reader;
use bus::sample::{Feedback, PlannerStatus, Waiting};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle, TermLike};

use console::output;

/// Looks at the cell now and then.
pub struct Progress {
    bar: ProgressBar,
    feedback: Reader<Feedback>,
    planner: Reader<PlannerStatus>,
    scan_period_s: f64,
    started: Instant,
    newest: Option<Feedback>,
    /// Stop for the operator that was told of: what for, and how many events were done by then.
    told_of: Option<(u32, u32)>,
}

impl Progress {
    /// With a bar, if one is wanted and standard error is a terminal.
    pub fn new(
        feedback: Reader<Feedback>,
        planner: Reader<PlannerStatus>,
        scan_period_s: f64,
        bar: bool,
    ) -> Progress {
        Progress {
            bar: self::bar(bar),
            feedback,
            planner,
            scan_period_s,
            started: Instant::now(),
            newest: None,
            told_of: None,
        }
    }

    /// Shows the bar from now on, where there is a terminal.
    pub fn show_bar(&self) {
        self.bar.set_draw_target(target(true));
    }

    /// Looks and draws; the newest feedback, if there has been one.
    pub fn look(&mut self) -> Option<&Feedback> {
        if let Some(feedback) = self.feedback.newest(u64::MAX) {
            self.newest = Some(feedback);
        }
        self.tell_of_stop();
        let status = self.planner.newest(u64::MAX);
        if let (Some(feedback), Some(status)) = (&self.newest, status)
            && (status.path_length_mm > 0.0 || status.line > 0)
        {
            if status.path_length_mm > 0.0 {
                let done = status.path_done_mm / status.path_length_mm;
                self.bar.set_position((done * 1000.0) as u64);
            }
            let wall_s = self.started.elapsed().as_secs_f64().max(1e-9);
            let machine_s = feedback.scan as f64 * self.scan_period_s;
            let (line, times) = (status.line, machine_s / wall_s);
            let words = format!("line {line}  {machine_s:.1} s  {times:.1}x real time");
            self.bar.set_message(words);
        }
        self.newest.as_ref()
    }

    /// Says once that the program waits for its operator.
    fn tell_of_stop(&mut self) {
        let Some(auxiliary) = self.newest.map(|feedback| feedback.auxiliary) else {
            return;
        };
        let waiting = Waiting::from_wire(auxiliary.waiting).unwrap_or_default();
        let asked = (auxiliary.waiting, auxiliary.events_done);
        let stop = waiting.is_for_operator().then_some(asked);
        let new = stop.is_some() && stop != self.told_of;
        if let Some(what) = monitor::words::waiting(&auxiliary).filter(|_| new) {
            tracing::warn!("the program waits for {what}: `quadrant resume` goes on");
        }
        self.told_of = stop;
    }

    /// The newest feedback that was seen.
    pub fn newest(&self) -> Option<&Feedback> {
        self.newest.as_ref()
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// A bar of a thousand steps with a message beside it; hidden unless it is wanted and standard error is a terminal.
pub fn bar(wanted: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(1000), target(wanted));
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {msg}") {
        bar.set_style(style);
    }
    console::logs::write_above(&bar);
    bar
}

/// Standard error, if it is a terminal.
fn target(wanted: bool) -> ProgressDrawTarget {
    if wanted && std::io::stderr().is_terminal() {
        ProgressDrawTarget::term_like_with_hz(Box::new(BarTerminal::default()), 10)
    } else {
        ProgressDrawTarget::hidden()
    }
}

/// How often the launcher looks.
pub const LOOK_EVERY: Duration = Duration::from_millis(100);

/// The bar's standard error: what is drawn at once is handed on as one picture, and nobody waits for it.
#[derive(Debug, Default)]
struct BarTerminal {
    picture: Mutex<String>,
}

impl BarTerminal {
    fn add(&self, text: &str) -> io::Result<()> {
        let mut picture = self.picture.lock().unwrap_or_else(PoisonError::into_inner);
        picture.push_str(text);
        Ok(())
    }

    /// Moves the cursor: so many, in this direction of ECMA-48.
    fn go(&self, count: usize, direction: char) -> io::Result<()> {
        match count {
            0 => Ok(()),
            _ => self.add(&format!("\x1b[{count}{direction}")),
        }
    }
}

impl TermLike for BarTerminal {
    fn width(&self) -> u16 {
        let size = rustix::termios::tcgetwinsize(rustix::stdio::stderr());
        size.map_or(80, |size| if size.ws_col > 0 { size.ws_col } else { 80 })
    }

    fn move_cursor_up(&self, n: usize) -> io::Result<()> {
        self.go(n, 'A')
    }

    fn move_cursor_down(&self, n: usize) -> io::Result<()> {
        self.go(n, 'B')
    }

    fn move_cursor_right(&self, n: usize) -> io::Result<()> {
        self.go(n, 'C')
    }

    fn move_cursor_left(&self, n: usize) -> io::Result<()> {
        self.go(n, 'D')
    }

    fn write_line(&self, s: &str) -> io::Result<()> {
        self.add(s)?;
        self.add("\n")
    }

    fn write_str(&self, s: &str) -> io::Result<()> {
        self.add(s)
    }

    fn clear_line(&self) -> io::Result<()> {
        self.add("\r\x1b[2K")
    }

    fn flush(&self) -> io::Result<()> {
        let mut picture = self.picture.lock().unwrap_or_else(PoisonError::into_inner);
        output::draw(picture.as_bytes());
        picture.clear();
        Ok(())
    }
}

//! The monitor without a screen: lines of JSON for pipes, and one screen as plain text.

use std::io::Write;
use std::time::{Duration, Instant};

use ratatui::Terminal;
use ratatui::backend::TestBackend;

use super::draw::{Screen, draw};
use super::json::{self, Reported};
use super::looks::{FRAME, heard};
use super::source::Source;
use crate::drawing::text_of;
use console::exit::{Failure, Kind, Outcome};
use console::output::{self, say};
use console::signals::Signals;

/// One screen shows this long a time.
const WATCH: Duration = Duration::from_millis(600);
/// Its size, where the terminal does not tell one.
const SIZE: (u16, u16) = (80, 24);

/// Watches for a moment, then prints one screen or one line.
pub fn once(mut feed: Box<dyn Source>, as_json: bool) -> Outcome {
    let started = Instant::now();
    loop {
        let long_enough = started.elapsed() > WATCH && feed.model().shown.state.scan.is_some();
        let too_long = started.elapsed() > super::looks::SILENCE;
        feed.look();
        if long_enough || too_long || feed.has_ended() {
            break;
        }
        feed.watch_periods(FRAME);
    }
    heard(feed.as_ref())?;
    if as_json {
        say(&json::line(feed.model(), &mut Reported::default()));
        return Ok(());
    }
    let size = ratatui::crossterm::terminal::size();
    let (width, height) = size.ok().filter(|(w, h)| *w > 0 && *h > 0).unwrap_or(SIZE);
    say(&plain(&Screen::plain(feed.model()), width, height).map_err(Failure::Environment)?);
    Ok(())
}

/// A screen as text.
fn plain(screen: &Screen<'_>, width: u16, height: u16) -> anyhow::Result<String> {
    let mut terminal = Terminal::new(TestBackend::new(width, height))?;
    terminal.draw(|frame| draw(frame, screen))?;
    Ok(text_of(terminal.backend().buffer()))
}

/// A line of JSON every 100 ms until the run ends or nobody reads any more.
pub fn run(mut feed: Box<dyn Source>) -> Outcome {
    let signals = Signals::catch().environment()?;
    let mut reported = Reported::default();
    let mut due = Instant::now();
    loop {
        feed.look();
        if feed.model().shown.state.scan.is_some() {
            let mut out = std::io::stdout().lock();
            let line = json::line(feed.model(), &mut reported);
            let written = writeln!(out, "{line}").and_then(|()| out.flush());
            if let Err(error) = written {
                output::note_failure(error);
                return Ok(());
            }
        }
        if feed.has_ended() {
            return Ok(());
        }
        if signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        feed.watch_periods(super::looks::LISTEN);
        due = (due + FRAME).max(Instant::now());
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
    }
}

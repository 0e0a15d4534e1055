//! Puts a model on a screen. Pure: the same model and size give the same screen.

mod axes;
mod circle;
mod panels;
mod readout;
mod screen;
mod top;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Style;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph, Wrap};

pub use screen::{Prompt, Screen};

/// From this width on there are three columns below the axes.
const WIDE: u16 = 120;
/// A screen smaller than this shows a word about it.
const SMALLEST: (u16, u16) = (60, 16);

/// Draws it all.
pub fn draw(frame: &mut Frame<'_>, screen: &Screen<'_>) {
    let area = frame.area();
    if area.width < SMALLEST.0 || area.height < SMALLEST.1 {
        let words = format!(
            "{}: the window is {}×{}; this view needs {}×{}",
            screen.model.shown.state.says.state, area.width, area.height, SMALLEST.0, SMALLEST.1
        );
        frame.render_widget(Paragraph::new(words), area);
        return;
    }
    let axes = screen.model.axes.len() as u16 + 1;
    let rows = Layout::vertical([
        Constraint::Length(3),
        Constraint::Length(axes),
        Constraint::Min(1),
        Constraint::Length(bottom_rows(screen, area.width)),
    ]);
    let [top, axis_rows, rest, bottom] = rows.areas(area);
    top::draw(frame, top, screen);
    if screen.readout {
        let page = axis_rows.union(rest);
        readout::draw(frame, page, screen);
    } else if area.width >= WIDE {
        axes::draw(frame, axis_rows, screen);
        wide(frame, rest, screen);
    } else {
        axes::draw(frame, axis_rows, screen);
        narrow(frame, rest, screen);
    }
    bottom_line(frame, bottom, screen);
    if screen.help {
        help(frame, area, screen);
    }
}

/// Two columns: circle and reversals; processes, timing, events.
fn narrow(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let columns = Layout::horizontal([Constraint::Percentage(48), Constraint::Min(1)]);
    let [left, right] = columns.areas(area);
    let reversals = if left.height >= 14 { 6 } else { 4 };
    let parts = Layout::vertical([Constraint::Min(1), Constraint::Length(reversals)]);
    let [plot, below] = parts.areas(left);
    circle::draw(frame, plot, screen);
    panels::reversals(frame, below, screen);
    let processes = (screen.model.shown.state.processes.len() as u16 + 2).min(right.height / 2);
    let parts = Layout::vertical([
        Constraint::Length(processes),
        Constraint::Length(3),
        Constraint::Min(1),
    ]);
    let [top, middle, below] = parts.areas(right);
    panels::processes(frame, top, screen);
    panels::timing(frame, middle, screen);
    panels::events(frame, below, screen);
}

/// Three columns: circle; reversals and timing; processes and events.
fn wide(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let lists = panels::REVERSALS_WIDTH + panels::PROCESSES_WIDTH;
    // A circle is as wide as it is high, in characters that are half as wide; what is left over is for the events.
    let round = 2 * area.height;
    let columns = Layout::horizontal([
        Constraint::Length(area.width.saturating_sub(lists).min(round)),
        Constraint::Length(panels::REVERSALS_WIDTH),
        Constraint::Min(1),
    ]);
    let [left, middle, right] = columns.areas(area);
    circle::draw(frame, left, screen);
    let parts = Layout::vertical([Constraint::Min(6), Constraint::Length(12)]);
    let [above, below] = parts.areas(middle);
    panels::reversals(frame, above, screen);
    panels::timing(frame, below, screen);
    let processes = (screen.model.shown.state.processes.len() as u16 + 2).min(area.height * 2 / 3);
    let parts = Layout::vertical([Constraint::Length(processes), Constraint::Min(1)]);
    let [above, below] = parts.areas(right);
    panels::processes(frame, above, screen);
    panels::events(frame, below, screen);
}

/// A long refusal is shown whole.
fn bottom_rows(screen: &Screen<'_>, width: u16) -> u16 {
    match &screen.prompt {
        Prompt::Answer(_, words) | Prompt::Jog(words) | Prompt::Block(words) => {
            (words.chars().count() as u16 + 8).div_ceil(width).min(3)
        }
        _ => 1,
    }
}

const KEYS: &str =
    " h hold r resume s stop b blocks +- override j jog : block ! estop ? help q quit";
const CONFIRM_STOP: &str =
    " stop? the tool comes to rest, a `quadrant run` ends.  y stop   other keys: no";
const CONFIRM_HOME: &str =
    " home? all axes that have to be homed move, one after another.  y home   other keys: no";
const CONFIRM_RESUME: &str =
    " resume? the drives come on and the tool moves back to the path.  y resume   other keys: no";

fn bottom_line(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let palette = screen.palette;
    let (style, words) = match &screen.prompt {
        Prompt::Keys if screen.model.shown.state.remote.is_some() => {
            let words = " seen from another machine, read only   ? help   q quit this view";
            (palette.quiet(), words.into())
        }
        Prompt::Keys => (palette.quiet(), KEYS.into()),
        Prompt::ConfirmStop => (palette.warn(), CONFIRM_STOP.into()),
        Prompt::ConfirmHome => (palette.warn(), CONFIRM_HOME.into()),
        Prompt::ConfirmResume => (palette.warn(), CONFIRM_RESUME.into()),
        Prompt::Block(text) => (palette.warn(), format!(" :{text}▏")),
        Prompt::Jog(words) => (palette.warn(), format!(" {words}")),
        Prompt::Answer(tone, words) => (palette.of(*tone), format!(" {words}")),
    };
    let line = Line::styled(words, style);
    let whole = Paragraph::new(line).wrap(Wrap { trim: false });
    frame.render_widget(whole, area);
}

const HELP: &str = "\
 h        feed hold: the tool comes to rest on the path and waits
 r        resume, after a jog by way of the path; asks first after a trip
 s        stop (asks first): like hold, but a `quadrant run` ends
 + -      override 10 % up or down; 0 stands
 b f      block by block, on and off; rapids at 100, 50, 25, 5 %
 j        jog by keys: arrows held, or by steps; Esc leaves it
 !        emergency stop, at once and in every state; `enable` ends it
 :        type a block, Enter runs it (`quadrant mdi`); arrows: history
 m        home the axes that have no absolute encoder (asks first)
 q  Esc   leave; the machine goes on. Ctrl-Z: for a while. ? this page
 d        the readout: work and machine coordinates, large; again: back
 The same from any terminal: quadrant hold, resume, stop …
 error    following error as the servo reckons it; peak: since this view
          came; bars: largest of each 0.1 s, newest right
 torque   share of the motor's rated torque; ! at its limit
 winding  temperature above ambient
 missed   scans without a command in time, since the start
 ⌂? ⌂…    the axis is not homed; it is being homed
 circle   radial deviation of the table; dotted: as programmed
 reversal height over the arc just before it; - off an arc, or not seen
 period   between scans, this view's own waking-up included
 age      scans since a process last answered";

fn help(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let (width, height) = (74.min(area.width), 29.min(area.height));
    let middle = Rect {
        x: area.x + (area.width - width) / 2,
        y: area.y + (area.height - height) / 2,
        width,
        height,
    };
    frame.render_widget(Clear, middle);
    let block = Block::bordered()
        .title(Span::styled(
            " keys and words (any key closes) ",
            screen.palette.title(),
        ))
        .border_style(Style::new());
    frame.render_widget(Paragraph::new(HELP).block(block), middle);
}

#[cfg(test)]
mod tests;

//! The readout: where the axes are in the program and on the machine, large; feed, speed, codes, block, time left.

use bus::sample::ProgramState as Progress;
use monitor::words::shown;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;
use remote::state::{CellState, Readout};

use super::screen::{Screen, panel};
use crate::live::palette::Palette;
use crate::live::text::{feeds, skew_words};

/// What stands where nothing is known.
const UNKNOWN: &str = "–";

/// Draws it.
pub fn draw(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let axes = screen.model.axes.len() as u16;
    // A row between the axes where there is room for it.
    let spaced = area.height >= 2 * axes + 13;
    let rows = if spaced { 2 * axes + 2 } else { axes + 2 };
    let parts = Layout::vertical([Constraint::Length(rows), Constraint::Min(1)]);
    let [above, below] = parts.areas(area);
    positions(frame, above, screen, spaced);
    program(frame, below, screen);
}

fn number(value: Option<f64>) -> String {
    value.map_or(UNKNOWN.into(), |value| format!("{value:+.4}"))
}

fn positions(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>, spaced: bool) {
    let (machine, state) = (&screen.model.machine, &screen.model.shown.state);
    let palette = screen.palette;
    let title = match &state.readout.work_offset {
        Some(offset) => format!("readout, work offset {offset}"),
        None => "readout".into(),
    };
    let inside = panel(frame, area, &title, palette);
    let heading = format!(
        "  {:<6}{:>18}{:>18}{:>18}",
        "axis", "work", "machine", "distance to go"
    );
    let mut lines = vec![Line::styled(heading, palette.title())];
    let named = state.axes.iter().zip(&machine.axes);
    for (axis, _) in named.filter(|(_, of)| !of.is_follower()) {
        if spaced {
            lines.push(Line::raw(""));
        }
        lines.push(Line::from(vec![
            Span::styled(format!("  {:<3}", axis.axis), palette.title()),
            Span::styled(format!("{:<3}", axis.unit), palette.quiet()),
            Span::styled(format!("{:>18}", number(axis.work_mm)), palette.good()),
            Span::raw(format!("{:>18}", number(Some(axis.machine_mm)))),
            Span::raw(format!("{:>18}", number(axis.distance_to_go_mm))),
        ]));
    }
    let skews = skew_words(state, machine).into_iter();
    lines.extend(skews.map(|words| Line::raw(format!("  {words}"))));
    frame.render_widget(Paragraph::new(lines), inside);
}

fn program(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let (state, palette) = (&screen.model.shown.state, screen.palette);
    let readout = &state.readout;
    let inside = panel(frame, area, "program", palette);
    let line = |name: &str, words: String, palette: Palette| {
        Line::from(vec![
            Span::styled(format!("  {name:<11}"), palette.title()),
            Span::raw(words),
        ])
    };
    let mut lines = vec![
        line("feed", feed_words(readout), palette),
        line("spindle", spindle_words(state), palette),
    ];
    let codes = &readout.active_codes;
    let (first, second) = codes.split_at(codes.len().min(12));
    lines.push(line(
        "codes",
        if first.is_empty() {
            UNKNOWN.into()
        } else {
            first.join(" ")
        },
        palette,
    ));
    if !second.is_empty() {
        lines.push(line("", second.join(" "), palette));
    }
    let text = readout.block_text.as_deref().unwrap_or_default();
    let block = match readout.block_line {
        Some(number) => format!("line {number}: {text}"),
        None => UNKNOWN.into(),
    };
    lines.push(line("block", block, palette));
    let runs = state.program.state.as_deref() == Some(Progress::Running.word());
    let left = match readout.time_left_s.filter(|_| runs) {
        Some(left_s) => format!(
            "about {} (estimate, without braking and stops)",
            time(left_s)
        ),
        None => UNKNOWN.into(),
    };
    lines.push(line("time left", left, palette));
    frame.render_widget(Paragraph::new(lines), inside);
}

fn feed_words(readout: &Readout) -> String {
    let (feed, programmed, unit) = feeds(readout);
    let actual = feed.map_or(UNKNOWN.into(), |feed| format!("{feed:.0}"));
    let programmed = match (readout.rapid, programmed) {
        (Some(true), _) => "rapid".into(),
        (_, Some(feed)) => format!("{feed:.0}"),
        _ => UNKNOWN.into(),
    };
    format!("{actual} {unit}, programmed {programmed}")
}

fn spindle_words(state: &CellState) -> String {
    let readout = &state.readout;
    let tool = readout.tool.unwrap_or(0);
    let actual = readout.spindle_rpm.unwrap_or(0.0);
    let speed = readout
        .speed_word
        .map_or(UNKNOWN.into(), |speed| format!("{speed:.0}"));
    let feed = readout.feed_word;
    let feed = feed.map_or(UNKNOWN.into(), |feed| shown(feed, 4));
    format!("{actual:.0} 1/min, S {speed}   F {feed}   T {tool}")
}

/// As hours, minutes and seconds.
pub fn time(seconds: f64) -> String {
    let whole = seconds.ceil() as u64;
    let (hours, minutes, seconds) = (whole / 3600, whole / 60 % 60, whole % 60);
    match hours {
        0 => format!("{minutes}:{seconds:02}"),
        _ => format!("{hours}:{minutes:02}:{seconds:02}"),
    }
}

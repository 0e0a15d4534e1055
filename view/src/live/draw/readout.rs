//! The readout: where the axes are in the program and on the machine, large; feed, speed, codes, block, time left.

use bus::sample::ProgramState;
use monitor::words::shown;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::screen::{Screen, panel};
use crate::live::dro::{self, Dro};
use crate::live::palette::Palette;

/// What stands where nothing is known.
const UNKNOWN: &str = "–";

/// Draws it.
pub fn draw(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let dro = dro::of(screen.model);
    let axes = screen.model.axes.len() as u16;
    // A row between the axes where there is room for it.
    let spaced = area.height >= 2 * axes + 13;
    let rows = if spaced { 2 * axes + 2 } else { axes + 2 };
    let parts = Layout::vertical([Constraint::Length(rows), Constraint::Min(1)]);
    let [above, below] = parts.areas(area);
    positions(frame, above, screen, &dro, spaced);
    state(frame, below, screen, &dro);
}

fn number(value: Option<f64>) -> String {
    value.map_or(UNKNOWN.into(), |value| format!("{value:+.4}"))
}

fn positions(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>, dro: &Dro, spaced: bool) {
    let palette = screen.palette;
    let title = match dro.work_offset {
        Some(offset) => format!("readout, work offset {offset}"),
        None => "readout".into(),
    };
    let inside = panel(frame, area, &title, palette);
    let heading = format!(
        "  {:<6}{:>18}{:>18}{:>18}",
        "axis", "work", "machine", "distance to go"
    );
    let mut lines = vec![Line::styled(heading, palette.title())];
    let named = screen.model.machine.program_axes().len();
    for (index, axis) in screen.model.axes.iter().enumerate().take(named) {
        let of = |values: &[Option<f64>]| number(values.get(index).copied().flatten());
        if spaced {
            lines.push(Line::raw(""));
        }
        lines.push(Line::from(vec![
            Span::styled(format!("  {:<2}", axis.name), palette.title()),
            Span::styled(format!("{:<4}", axis.unit), palette.quiet()),
            Span::styled(format!("{:>18}", of(&dro.work)), palette.good()),
            Span::raw(format!("{:>18}", number(Some(axis.now.command_mm)))),
            Span::raw(format!("{:>18}", of(&dro.distance_to_go))),
        ]));
    }
    let skews = screen.model.skew_words();
    lines.extend(skews.map(|words| Line::raw(format!("  {words}"))));
    frame.render_widget(Paragraph::new(lines), inside);
}

fn state(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>, dro: &Dro) {
    let (model, palette) = (screen.model, screen.palette);
    let inside = panel(frame, area, "program", palette);
    let line = |name: &str, words: String, palette: Palette| {
        Line::from(vec![
            Span::styled(format!("  {name:<11}"), palette.title()),
            Span::raw(words),
        ])
    };
    let mut lines = vec![
        line("feed", feed_words(dro), palette),
        line("spindle", spindle_words(screen, dro), palette),
    ];
    let (first, second) = dro.active_codes.split_at(dro.active_codes.len().min(12));
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
    let block = match model.block() {
        Some((number, text)) => format!("line {number}: {text}"),
        None => UNKNOWN.into(),
    };
    lines.push(line("block", block, palette));
    let left = match (model.program_state(), dro.time_left_s) {
        (Some(ProgramState::Running), Some(left_s)) => format!(
            "about {} (estimate, without braking and stops)",
            time(left_s)
        ),
        _ => UNKNOWN.into(),
    };
    lines.push(line("time left", left, palette));
    frame.render_widget(Paragraph::new(lines), inside);
}

fn feed_words(dro: &Dro) -> String {
    let actual = dro
        .feed_mm_min
        .map_or(UNKNOWN.into(), |feed| format!("{feed:.0}"));
    let programmed = match (dro.rapid, dro.programmed_feed_mm_min) {
        (Some(true), _) => "rapid".into(),
        (_, Some(feed)) => format!("{feed:.0}"),
        _ => UNKNOWN.into(),
    };
    format!("{actual} {}, programmed {programmed}", dro.feed_unit())
}

fn spindle_words(screen: &Screen<'_>, dro: &Dro) -> String {
    let feedback = screen.model.feedback.as_ref();
    let tool = feedback.map_or(0, |feedback| feedback.auxiliary.tool);
    let actual = feedback.map_or(0.0, |feedback| feedback.auxiliary.spindle_rpm);
    let speed = dro
        .speed_word
        .map_or(UNKNOWN.into(), |speed| format!("{speed:.0}"));
    let feed = dro.feed_word.map_or(UNKNOWN.into(), |feed| shown(feed, 4));
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

//! The first three lines: what the machine is doing, where in the program, what can be done.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::screen::Screen;
use crate::live::text::{age_words, progress, switched_words};

/// Draws them.
pub fn draw(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let (state, palette) = (&screen.model.shown.state, screen.palette);
    let says = &state.says;
    let mut first = vec![
        Span::styled(
            format!(" {} {} ", says.symbol, says.state),
            palette.of(says.tone),
        ),
        Span::styled(format!(" {}", says.detail), palette.of(says.tone)),
    ];
    let warnings = [
        state
            .override_percent
            .filter(|percent| *percent != 100)
            .map(|percent| format!("override {percent} %")),
        switched_words(state),
    ];
    first.extend(
        warnings
            .into_iter()
            .flatten()
            .map(|words| Span::styled(format!("  {words}"), palette.warn())),
    );
    let auxiliary = state.auxiliary.as_ref().and_then(|of| of.summary.as_ref());
    first.extend(auxiliary.map(|words| Span::styled(format!("  {words}"), palette.quiet())));
    let overrun = state.overrun_scans.filter(|scans| *scans > 0);
    let alarms = [
        state.bus.as_ref().and_then(|bus| bus.alarm.clone()),
        overrun.map(|scans| format!("{scans} scans overrun")),
        state.alarms.first().map(|alarm| match state.alarms.len() {
            1 => format!("alarm {}, {}", alarm.number, alarm.text),
            more => format!(
                "alarm {}, {} and {} more",
                alarm.number,
                alarm.text,
                more - 1
            ),
        }),
    ];
    first.extend(
        alarms
            .into_iter()
            .flatten()
            .map(|words| Span::styled(format!("  ▲ {words}"), palette.warn())),
    );
    let mut right = format!("{} ", state.cell);
    if let Some(time_s) = state.time_s {
        let pace = state.pace.as_deref().unwrap_or_default();
        right = format!("{} {pace} {time_s:.1} s ", state.cell);
    }
    let corner_width = right.chars().count() as u16;
    let second = match progress(&state.program) {
        Some(words) => bar_line(state.program.percent, &words, area.width, corner_width),
        None => " program: nothing heard of it yet".into(),
    };
    let third = Line::from(vec![
        Span::styled(" next: ", palette.quiet()),
        Span::raw(&state.next),
    ]);
    let lines = vec![Line::from(first), Line::raw(second), third];
    frame.render_widget(Paragraph::new(lines), area);
    corner(frame, area, 1, Line::styled(right, palette.quiet()));
    if let Some(link) = &state.remote {
        let words = format!(" {} ", age_words(link));
        let old = link.data_age_s_max.is_none_or(|max_s| max_s > 1.0);
        let style = if old { palette.warn() } else { palette.quiet() };
        corner(frame, area, 2, Line::styled(words, style));
    }
}

/// Words at the right end of a row.
fn corner(frame: &mut Frame<'_>, area: Rect, row: u16, words: Line<'_>) {
    let letters = words.spans.iter().map(|of| of.content.chars().count());
    let width = (letters.sum::<usize>() as u16).min(area.width);
    let corner = Rect {
        x: area.x + area.width - width,
        y: area.y + row,
        width,
        height: 1,
    };
    frame.render_widget(Paragraph::new(words), corner);
}

/// How far the program is, as a bar and in words, with `kept` columns left free at the end.
fn bar_line(percent: Option<f64>, words: &str, width: u16, kept: u16) -> String {
    let cells = (usize::from(width) / 8).max(4);
    let filled = (percent.unwrap_or(0.0) / 100.0 * cells as f64).round() as usize;
    let bar: String = (0..cells)
        .map(|cell| if cell < filled { '█' } else { '░' })
        .collect();
    let room = usize::from(width.saturating_sub(kept)).saturating_sub(cells + 4);
    let mut shown: String = words.chars().take(room).collect();
    if shown.chars().count() < words.chars().count() {
        shown.push('…');
    }
    format!(" {bar} {shown}")
}

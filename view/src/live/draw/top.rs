//! The first three lines: what the machine is doing, where in the program, what can be done.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::screen::Screen;
use crate::live::fieldbus::BusView;
use crate::live::text::progress;

/// Draws them.
pub fn draw(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let (model, palette) = (screen.model, screen.palette);
    let says = model.says();
    let mut first = vec![
        Span::styled(
            format!(" {} {} ", says.symbol, says.state),
            palette.of(says.tone),
        ),
        Span::styled(format!(" {}", says.detail), palette.of(says.tone)),
    ];
    let mut right = format!("{} ", model.cell);
    if let Some(feedback) = &model.feedback {
        let time_s = feedback.scan as f64 * model.machine.scan_period_s();
        let pace = model.pace.map_or("", |pace| pace.word());
        right = format!("{} {pace} {time_s:.1} s ", model.cell);
        let percent = feedback.override_percent;
        if percent != 100 {
            first.push(Span::styled(
                format!("  override {percent} %"),
                palette.warn(),
            ));
        }
        if let Some(words) = report::auxiliary::panel(&feedback.inputs) {
            first.push(Span::styled(format!("  {words}"), palette.warn()));
        }
        if let Some(words) = report::auxiliary::summary(&feedback.auxiliary) {
            first.push(Span::styled(format!("  {words}"), palette.quiet()));
        }
        if let Some(words) = model.bus.as_ref().and_then(BusView::alarm) {
            first.push(Span::styled(format!("  ▲ {words}"), palette.warn()));
        }
        if feedback.overrun_scans > 0 {
            let overrun = format!("  ▲ {} scans overrun", feedback.overrun_scans);
            first.push(Span::styled(overrun, palette.warn()));
        }
    }
    let corner_width = right.chars().count() as u16;
    let second = match progress(model) {
        Some(words) => bar_line(model.share_done(), &words, area.width, corner_width),
        None => " program: nothing heard of it yet".into(),
    };
    let third = Line::from(vec![
        Span::styled(" next: ", palette.quiet()),
        Span::raw(says.next),
    ]);
    let lines = vec![Line::from(first), Line::raw(second), third];
    frame.render_widget(Paragraph::new(lines), area);
    corner(frame, area, 1, Line::styled(right, palette.quiet()));
    if let Some(link) = &model.link {
        let words = format!(" {} ", link.age_words());
        let old = link.age_s.is_none_or(|(_, max_s)| max_s > 1.0);
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
fn bar_line(share: Option<f64>, words: &str, width: u16, kept: u16) -> String {
    let cells = (usize::from(width) / 8).max(4);
    let filled = (share.unwrap_or(0.0) * cells as f64).round() as usize;
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

//! The lists: reversals, processes, timing, events.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;
use remote::state::ProcessState;

use super::axes::error_heading;
use super::screen::{Screen, panel};
use crate::live::events::Weight;
use crate::live::text::standby_words;
use crate::live::timing::BARS_US;

/// Columns that the list of reversals needs.
pub const REVERSALS_WIDTH: u16 = 37;
/// Columns that the list of processes needs.
pub const PROCESSES_WIDTH: u16 = 46;

/// The last reversals, newest first.
pub fn reversals(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let (model, palette) = (screen.model, screen.palette);
    let title = format!("reversals ({} seen)", model.reversals.count);
    let inside = panel(frame, area, &title, palette);
    let heading = format!(
        " {:<5}{:>8}{:>11}{:>10}",
        "axis",
        "at s",
        "height µm",
        error_heading(&model.shown.state.axes)
    );
    let mut lines = vec![Line::styled(heading, palette.quiet())];
    let rows = usize::from(inside.height.saturating_sub(1));
    for reversal in model.reversals.last.iter().rev().take(rows) {
        let name = model.machine.axis_name(reversal.axis as usize);
        let arrow = if reversal.direction > 0 {
            "→+"
        } else {
            "→-"
        };
        let at_s = reversal.scan as f64 * model.machine.scan_period_s();
        let height = reversal
            .height_um
            .map_or("-".into(), |um| format!("{um:+.1}"));
        lines.push(Line::from(vec![
            Span::raw(format!(" {name}{arrow:<4}{at_s:>8.2}")),
            Span::styled(format!("{height:>11}"), palette.good()),
            Span::raw(format!("{:>10.1}", reversal.error_peak_um)),
        ]));
    }
    frame.render_widget(Paragraph::new(lines), inside);
}

/// The processes; if there is not room for all, those that need a look first.
pub fn processes(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let palette = screen.palette;
    let state = &screen.model.shown.state;
    let mut processes: Vec<&ProcessState> = state.processes.iter().collect();
    let inside = panel(frame, area, "processes", palette);
    let heading = format!(
        " {:<10}{:>8}{:>7}{:>6} {}",
        "name", "pid", "starts", "age", "state"
    );
    let mut lines = vec![Line::styled(heading, palette.quiet())];
    let rows = usize::from(inside.height.saturating_sub(1));
    let hidden = processes.len().saturating_sub(rows);
    if hidden > 0 {
        // Stable: the rest stays in the order of the roster.
        processes.sort_by_key(|process| (process.live && !process.stalled, process.starts == 1));
        processes.truncate(rows.saturating_sub(1));
    }
    lines.extend(processes.iter().map(|process| {
        let pid = process.pid.map_or("-".into(), |pid| pid.to_string());
        let age = process.age_scans.map_or("-".into(), |age| age.to_string());
        let style = if !process.live || process.stalled {
            palette.warn()
        } else if process.drives == Some(false) {
            palette.quiet()
        } else {
            palette.good()
        };
        Line::from(vec![
            Span::raw(format!(
                " {:<10}{pid:>8}{:>7}{age:>6} ",
                process.process, process.starts
            )),
            Span::styled(
                if state.ended {
                    "ended"
                } else {
                    short_state(process)
                },
                style,
            ),
        ])
    }));
    if hidden > 0 {
        let words = format!(" … and {} more that live", hidden + 1);
        lines.push(Line::styled(words, palette.quiet()));
    }
    frame.render_widget(Paragraph::new(lines), inside);
}

fn short_state(process: &ProcessState) -> &str {
    match (process.live, process.stalled, process.drives) {
        (false, _, _) => "✖ dead",
        (true, true, _) => "‖ stopped",
        (true, false, Some(true)) => "drives",
        (true, false, Some(false)) => standby_words(process),
        (true, false, None) => match process.job.as_str() {
            "planner" => "plans",
            "recorder" => "records",
            "master" => "machine",
            other => other,
        },
    }
}

/// How evenly scans come, as this observer sees it.
pub fn timing(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let (model, palette) = (screen.model, screen.palette);
    let inside = panel(frame, area, "scan period seen from here", palette);
    let Some(timing) = &model.shown.timing else {
        let words = match model.shown.state.pace.as_deref() {
            Some("lockstep") => " lockstep: scans follow at once",
            _ => " nothing measured yet",
        };
        frame.render_widget(Paragraph::new(Line::styled(words, palette.quiet())), inside);
        return;
    };
    let mut lines = vec![Line::raw(format!(
        " p50 {:.0}  p99 {:.0}  max {:.0} µs",
        timing.p50_us, timing.p99_us, timing.max_us
    ))];
    let total = timing.periods.max(1) as f64;
    let bars = &timing.bars;
    let room = f64::from(inside.width.saturating_sub(22).max(1));
    if inside.height as usize > bars.len() {
        for (index, count) in bars.iter().enumerate() {
            let range = match BARS_US.get(index) {
                Some(end_us) => format!("≤{end_us:>4.0} µs off"),
                None => ">500 µs off".into(),
            };
            let share = *count as f64 / total;
            let bar = "█".repeat((share * room).ceil() as usize);
            lines.push(Line::raw(format!(
                " {range:<12}{:>5.1}% {bar}",
                share * 100.0
            )));
        }
    } else {
        let within = |bars: &[u64]| bars.iter().sum::<u64>() as f64 / total * 100.0;
        lines.push(Line::raw(format!(
            " within 20 µs {:.0} %, 100 µs {:.0} %  (n {})",
            within(bars.get(..3).unwrap_or_default()),
            within(bars.get(..5).unwrap_or_default()),
            timing.periods
        )));
    }
    frame.render_widget(Paragraph::new(lines), inside);
}

/// What happened, newest first.
pub fn events(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let (model, palette) = (screen.model, screen.palette);
    let inside = panel(frame, area, "events, newest first", palette);
    let period_s = model.machine.scan_period_s();
    let rows = usize::from(inside.height);
    let newest = model.events.last.iter().rev().take(rows);
    let mut lines: Vec<Line<'_>> = newest
        .map(|event| {
            let (sign, style) = match event.weight {
                Weight::Note => (" ", ratatui::style::Style::new()),
                Weight::Warning => ("▲", palette.warn()),
            };
            let at_s = event.scan as f64 * period_s;
            Line::styled(format!(" {sign}{at_s:>7.2} s {}", event.text), style)
        })
        .collect();
    if lines.is_empty() {
        lines.push(Line::styled(" none since this view came", palette.quiet()));
    }
    frame.render_widget(Paragraph::new(lines), inside);
}

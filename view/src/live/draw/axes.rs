//! One row per axis.

use bus::sample::Reference;
use monitor::quantities;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;
use remote::state::AxisState;

use super::screen::Screen;
use crate::live::axis::{ABSOLUTE, AxisView};
use crate::live::palette::Palette;
use crate::live::text::error_unit;

/// Characters of a row beside the bars and the quantities.
const FIXED: u16 = 69;
/// Characters of a quantity.
const QUANTITY: usize = 7;
/// Characters of the mark at axes that are not homed.
const MARK: u16 = 3;
/// Heights of a bar.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// Share of the limit from which a following error is marked.
const NEAR_LIMIT: f64 = 0.5;

/// Draws them, with a line of headings.
pub fn draw(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let palette = screen.palette;
    let axes = &screen.model.shown.state.axes;
    let mark = axes.iter().any(|axis| !not_homed(axis).is_empty());
    let quantities = (QUANTITY * quantities::OF_AXIS.len()) as u16;
    let fixed = FIXED + quantities + if mark { MARK } else { 0 };
    let bars = usize::from(area.width.saturating_sub(fixed).clamp(4, 60));
    let mut heading = format!(
        " {:<5}{:>11}{:>11}{:>9}{:>8} {:<bars$}{:>7}",
        "axis",
        "command",
        "feedback",
        error_heading(axes),
        "peak",
        "history",
        "torque"
    );
    for one in &quantities::OF_AXIS {
        heading += &format!("{:>QUANTITY$}", one.short);
    }
    heading += &format!("{:>7}{:>6} {}", "frict.", "miss", "by");
    let mut lines = vec![Line::styled(heading, palette.title())];
    let views = axes.iter().zip(&screen.model.axes);
    lines.extend(views.map(|(axis, view)| row(axis, view, bars, palette)));
    frame.render_widget(Paragraph::new(lines), area);
}

/// What errors are in: µm, or where some are those of rotary axes, thousandths of the unit of the row.
pub fn error_heading(axes: &[AxisState]) -> &'static str {
    if axes.iter().any(|axis| error_unit(axis) != "µm") {
        "µm, mdeg"
    } else {
        "error µm"
    }
}

/// A mark at an axis that is not homed.
fn not_homed(axis: &AxisState) -> &'static str {
    let is = |reference: Reference| axis.reference == reference.words();
    match axis.reference == ABSOLUTE || is(Reference::Known) {
        true => "",
        false if is(Reference::Searching) => " ⌂…",
        false => " ⌂?",
    }
}

fn row(axis: &AxisState, view: &AxisView, bars: usize, palette: Palette) -> Line<'static> {
    let warn_if = |wrong: bool, otherwise: Style| if wrong { palette.warn() } else { otherwise };
    let near = |error_um: f64| error_um.abs() > NEAR_LIMIT * view.error_limit_um;
    let error_um = axis.following_error_um;
    let error = error_um.map_or("-".into(), |um| number(um, true));
    let error_style = warn_if(error_um.is_some_and(near), palette.good());
    let limited = if axis.torque_limited { "!" } else { " " };
    let torque = format!("{:>5.0}%{limited}", axis.torque_percent);
    let torque_style = warn_if(axis.torque_limited, Style::new());
    let missing = axis.missed_in_a_row > 0;
    let missed = format!("{}{}", if missing { "▲" } else { "" }, axis.missed_scans);
    let missed_style = warn_if(missing, Style::new());
    let quantities = quantities::OF_AXIS.iter();
    let quantities = quantities.map(|one| format!("{:>QUANTITY$}", one.text(&axis.quantities)));
    let mut spans = vec![
        Span::styled(format!(" {:<2}", axis.axis), palette.title()),
        Span::styled(format!("{:<3}", axis.unit), palette.quiet()),
        Span::raw(format!(
            "{:>11.4}{:>11.4}",
            axis.command_mm, axis.feedback_mm
        )),
        Span::styled(format!("{error:>9}"), error_style),
        Span::raw(format!(
            "{:>8} ",
            number(axis.following_error_peak_um, false)
        )),
        Span::styled(format!("{:<bars$}", history(view, bars)), palette.good()),
        Span::styled(torque, torque_style),
    ];
    spans.extend(quantities.map(Span::raw));
    spans.extend([
        Span::raw(format!("{:>7}", axis.friction)),
        Span::styled(format!("{missed:>6}"), missed_style),
        Span::raw(format!(" {}", axis.servo)),
        Span::styled(not_homed(axis), palette.warn()),
    ]);
    Line::from(spans)
}

/// A number of µm or mdeg in at most eight characters.
fn number(value_um: f64, signed: bool) -> String {
    let digits = if value_um.abs() < 1000.0 { 1 } else { 0 };
    if signed {
        format!("{value_um:+.digits$}")
    } else {
        format!("{value_um:.digits$}")
    }
}

/// The last looks as bars, scaled to the largest among them.
fn history(axis: &AxisView, bars: usize) -> String {
    let skipped = axis.error_history_um.len().saturating_sub(bars);
    let shown: Vec<f64> = axis
        .error_history_um
        .iter()
        .skip(skipped)
        .copied()
        .collect();
    let largest = shown.iter().copied().fold(0.0, f64::max);
    let each = shown.iter().map(|value| {
        let share = if largest > 0.0 { value / largest } else { 0.0 };
        let step = (share * BARS.len() as f64) as usize;
        BARS.get(step.min(BARS.len() - 1)).copied().unwrap_or(' ')
    });
    each.collect()
}

//! The circle as on a ball-bar: radial deviation of the table, exaggerated.

use bus::sample::ProgramState;
use monitor::words::shown as number;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::Paragraph;
use ratatui::widgets::canvas::{Canvas, Context, Line as CanvasLine, Points};
use remote::state::CircleState;

use super::screen::{Screen, panel};
use crate::live::circle::BINS;
use crate::live::palette::Palette;

/// The deviation that is drawn as [`SWING`] of the radius is one of these times a power of ten, in µm.
const STEPS: [f64; 3] = [1.0, 2.0, 5.0];
/// Share of the drawn radius that one scale of deviation takes.
const SWING: f64 = 0.3;

/// From one point to the next.
type Stroke = ((f64, f64), (f64, f64));

/// Draws it.
pub fn draw(frame: &mut Frame<'_>, area: Rect, screen: &Screen<'_>) {
    let (shown, palette) = (&screen.model.shown, screen.palette);
    let Some(circle) = &shown.circle else {
        let inside = panel(frame, area, "circle", palette);
        let program = &shown.state.program;
        let words = if program.state.as_deref() == Some(ProgramState::None.word()) {
            " no program: no circle"
        } else if program.name.is_none() {
            " the program is not known: no circle"
        } else {
            " no arc so far: the plot begins with one"
        };
        frame.render_widget(Paragraph::new(Line::styled(words, palette.quiet())), inside);
        return;
    };
    let feed = circle.feed_mm_min;
    let feed = feed.map_or("rapid".into(), |feed| format!("F{feed:.0}"));
    let when = if circle.running { "" } else { " (last)" };
    let title = format!(
        "circle {} R{} {feed}, line {}{when}",
        circle.plane,
        number(circle.radius_mm, 3),
        circle.line
    );
    let inside = panel(frame, area, &title, palette);
    let Some((low_um, high_um)) = circle.range_um().filter(|_| inside.height >= 3) else {
        let words = " settling …";
        frame.render_widget(Paragraph::new(Line::styled(words, palette.quiet())), inside);
        return;
    };
    let scale_um = scale_um(low_um.abs().max(high_um.abs()));
    let words = format!(" radial {low_um:+.1} … {high_um:+.1} µm, drawn ±{scale_um} µm");
    let caption = Rect {
        height: 1,
        ..inside
    };
    frame.render_widget(Paragraph::new(Line::raw(words)), caption);
    let plot = Rect {
        y: inside.y + 1,
        height: inside.height - 1,
        ..inside
    };
    frame.render_widget(plotted(circle, scale_um, plot, palette), plot);
}

/// The programmed circle, the deviation from it and where the tool is.
fn plotted(
    view: &CircleState,
    scale_um: f64,
    plot: Rect,
    palette: Palette,
) -> Canvas<'static, impl Fn(&mut Context<'_>)> {
    let (nominal, curve) = points(view, scale_um);
    let tool_rad = view.angle_rad.filter(|_| view.running);
    // A braille cell is two dots wide and four high: dots are square where a cell is twice as high as wide.
    let aspect = f64::from(plot.width) / 2.0 / f64::from(plot.height.max(1));
    let half = 1.0 + SWING;
    let (x, y) = if aspect >= 1.0 {
        (half * aspect, half)
    } else {
        (half, half / aspect.max(0.1))
    };
    Canvas::default()
        .marker(Marker::Braille)
        .x_bounds([-x, x])
        .y_bounds([-y, y])
        .paint(move |context| {
            context.draw(&Points {
                coords: &nominal,
                color: palette.nominal(),
            });
            context.layer();
            for ((x1, y1), (x2, y2)) in &curve {
                context.draw(&CanvasLine::new(*x1, *y1, *x2, *y2, palette.curve()));
            }
            if let Some(angle) = tool_rad {
                let place = |radius: f64| (radius * libm::cos(angle), radius * libm::sin(angle));
                let (at_x, at_y) = place(0.55);
                context.print(at_x, at_y, Line::styled("●", palette.title()));
            }
            context.print(0.0, 0.0, Line::styled("+", palette.quiet()));
        })
}

/// Dots of the programmed circle; and the deviation as strokes from angle to angle, a dot where the neighbour is unknown.
fn points(view: &CircleState, scale_um: f64) -> (Vec<(f64, f64)>, Vec<Stroke>) {
    let at = |bin: usize, radius: f64| {
        let angle = (bin as f64 + 0.5) / BINS as f64 * std::f64::consts::TAU;
        (radius * libm::cos(angle), radius * libm::sin(angle))
    };
    let nominal = (0..BINS).step_by(6).map(|bin| at(bin, 1.0)).collect();
    let curve = |bin: usize| {
        let [_, mean_um, _] = view.deviation_um.get(bin).copied().flatten()?;
        Some(at(bin, 1.0 + mean_um / scale_um * SWING))
    };
    let strokes = (0..BINS).filter_map(|bin| {
        let here = curve(bin)?;
        Some((here, curve((bin + 1) % BINS).unwrap_or(here)))
    });
    (nominal, strokes.collect())
}

/// The smallest step that holds this deviation.
fn scale_um(largest_um: f64) -> f64 {
    let power = 10f64.powi(largest_um.max(0.1).log10().floor() as i32);
    let steps = STEPS.iter().map(|step| step * power);
    steps
        .into_iter()
        .find(|step| *step >= largest_um)
        .unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_the_next_round_number() {
        for (largest, scale) in [
            (0.4, 0.5),
            (1.6, 2.0),
            (3.3, 5.0),
            (26.5, 50.0),
            (51.0, 100.0),
        ] {
            assert!((scale_um(largest) - scale).abs() < 1e-9, "{largest}");
        }
    }
}

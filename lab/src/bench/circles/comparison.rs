//! Ways of compensation compared: for each the worst deviation at a reversal over all circles, as dots on one scale.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use ::report::plot::{self, Area, Drawn, FINE, GRID, INK, PlotError, SOFT, at, words};

/// What is compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Headline.
    pub title: String,
    /// The ways of compensation, from top to bottom.
    pub methods: Vec<MethodPoints>,
}

/// One way of compensation.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodPoints {
    /// Its name.
    pub name: String,
    /// Its circles.
    pub points: Vec<Point>,
}

/// One circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Radius.
    pub radius_mm: f64,
    /// Feed.
    pub feed_mm_min: f64,
    /// Largest protrusion, at least 0.
    pub protrusion_um: f64,
    /// Deepest undercut, at most 0.
    pub undercut_um: f64,
    /// Worse than the reference by more than it may be.
    pub harms: bool,
}

impl Point {
    fn worst_um(&self) -> f64 {
        self.protrusion_um.max(-self.undercut_um)
    }

    fn cuts_under(&self) -> bool {
        -self.undercut_um > self.protrusion_um
    }
}

const WIDTH: i32 = 1000;
const LEFT: i32 = 250;
const RIGHT: i32 = 740;
const TOP: i32 = 132;
const ROW: i32 = 60;
const FOOT: i32 = 108;

/// Okabe and Ito's colours, which all kinds of colour vision tell apart; feeds take them in turn.
const COLOURS: [RGBColor; 6] = [
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xe6, 0x9f, 0x00),
];

/// Draws the comparison as SVG.
///
/// # Errors
/// The file cannot be written.
pub fn draw(path: &Path, comparison: &Comparison) -> Result<(), PlotError> {
    let height = TOP + ROW * comparison.methods.len().max(1) as i32 + FOOT;
    plot::write(path, (WIDTH, height), |area| draw_on(area, comparison))
}

fn line(area: &Area, from: (f64, f64), to: (f64, f64), colour: RGBColor, pixels: f64) -> Drawn {
    let ends = vec![at(from.0, from.1), at(to.0, to.1)];
    plot::line(area, ends, plot::stroke(colour, pixels))
}

/// All different values, in order.
fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

/// Scale and keys common to all rows.
struct Frame {
    end_um: f64,
    step_um: f64,
    feeds: Vec<f64>,
    radii: Vec<f64>,
}

impl Frame {
    fn of(comparison: &Comparison) -> Frame {
        let points = || comparison.methods.iter().flat_map(|m| &m.points);
        let most_um = points().map(Point::worst_um).fold(0.1, f64::max);
        let mut step_um = 0.01;
        for factor in [2.0, 2.5, 2.0].into_iter().cycle() {
            if most_um <= 8.0 * step_um || step_um > 1e6 {
                break;
            }
            step_um *= factor;
        }
        Frame {
            end_um: libm::ceil(most_um / step_um) * step_um,
            step_um,
            feeds: distinct(points().map(|p| p.feed_mm_min)),
            radii: distinct(points().map(|p| p.radius_mm)),
        }
    }

    fn x(&self, value_um: f64) -> f64 {
        f64::from(LEFT) + f64::from(RIGHT - LEFT) * value_um / self.end_um
    }

    fn colour(&self, feed_mm_min: f64) -> RGBColor {
        let index = self.feeds.iter().position(|f| *f == feed_mm_min);
        COLOURS
            .get(index.unwrap_or(0) % COLOURS.len())
            .copied()
            .unwrap_or(INK)
    }

    /// Radius of a dot: the larger the circle, the larger the dot.
    fn dot_px(&self, radius_mm: f64) -> f64 {
        let index = self.radii.iter().position(|r| *r == radius_mm);
        let last = self.radii.len().saturating_sub(1).max(1);
        3.5 + 4.0 * index.unwrap_or(0) as f64 / last as f64
    }

    /// Height of a dot in its row: one line per feed, so that dots of one value do not hide each other.
    fn shift_px(&self, feed_mm_min: f64) -> f64 {
        let index = self.feeds.iter().position(|f| *f == feed_mm_min);
        let middle = (self.feeds.len().max(1) - 1) as f64 / 2.0;
        let spread = f64::from(ROW) * 0.62 / self.feeds.len().max(1) as f64;
        (index.unwrap_or(0) as f64 - middle) * spread
    }
}

fn draw_on(area: &Area, comparison: &Comparison) -> Drawn {
    let frame = Frame::of(comparison);
    plot::text(
        area,
        &comparison.title,
        at(32.0, 34.0),
        24,
        &INK,
        HPos::Left,
    )?;
    let below = "worst deviation at a reversal on the table, one dot per circle, in µm";
    plot::text(area, below, at(32.0, 62.0), 14, &SOFT, HPos::Left)?;
    let bottom = f64::from(TOP + ROW * comparison.methods.len().max(1) as i32);
    let mut value_um = 0.0;
    while value_um <= frame.end_um * 1.001 {
        let x = frame.x(value_um);
        line(area, (x, f64::from(TOP)), (x, bottom), GRID, 1.0)?;
        let label = format!("{}", libm::round(value_um * 1e3) / 1e3);
        plot::text(area, &label, at(x, bottom + 16.0), 13, &SOFT, HPos::Center)?;
        value_um += frame.step_um;
    }
    for (x, head) in [(810, "mean"), (870, "worst"), (960, "worst at")] {
        let head_at = at(f64::from(x), f64::from(TOP) - 12.0);
        plot::text(area, head, head_at, 13, &SOFT, HPos::Right)?;
    }
    for (index, method) in comparison.methods.iter().enumerate() {
        let y = f64::from(TOP) + f64::from(ROW) * (index as f64 + 0.5);
        row(area, &frame, method, y)?;
        let rule = y + f64::from(ROW) / 2.0;
        line(area, (32.0, rule), (968.0, rule), GRID, 1.0)?;
    }
    keys(area, &frame, bottom + 52.0)
}

fn row(area: &Area, frame: &Frame, method: &MethodPoints, y: f64) -> Drawn {
    let name_at = at(f64::from(LEFT) - 16.0, y);
    plot::text(area, &method.name, name_at, 15, &INK, HPos::Right)?;
    let Some(worst) = method
        .points
        .iter()
        .max_by(|a, b| a.worst_um().total_cmp(&b.worst_um()))
    else {
        return Ok(());
    };
    let sum: f64 = method.points.iter().map(Point::worst_um).sum();
    let mean_um = sum / method.points.len() as f64;
    let x = frame.x(mean_um);
    line(area, (x, y - 26.0), (x, y + 26.0), INK, 2.0)?;
    // The larger dots first: what lies on them is seen.
    let mut points: Vec<&Point> = method.points.iter().collect();
    points.sort_by(|a, b| b.radius_mm.total_cmp(&a.radius_mm));
    let place = |point: &Point| {
        (
            frame.x(point.worst_um()),
            y + frame.shift_px(point.feed_mm_min),
        )
    };
    for point in &points {
        dot(area, frame, point, place(point))?;
    }
    for point in points.iter().filter(|point| point.harms) {
        cross(area, frame, point, place(point))?;
    }
    let number = |value: f64| format!("{value:.1}");
    plot::text(area, &number(mean_um), at(810.0, y), 15, &INK, HPos::Right)?;
    let worst_um = number(worst.worst_um());
    plot::text(area, &worst_um, at(870.0, y), 15, &INK, HPos::Right)?;
    let place = format!("R{} F{}", worst.radius_mm, worst.feed_mm_min);
    plot::text(area, &place, at(968.0, y), 12, &SOFT, HPos::Right)
}

/// Filled where the tool protrudes, open where it cuts under.
fn dot(area: &Area, frame: &Frame, point: &Point, (x, y): (f64, f64)) -> Drawn {
    let colour = frame.colour(point.feed_mm_min);
    let size = (frame.dot_px(point.radius_mm) * f64::from(FINE)) as i32;
    let style = if point.cuts_under() {
        colour.stroke_width(2 * FINE as u32)
    } else {
        area.draw(&Circle::new(at(x, y), size, colour.filled()))
            .map_err(words)?;
        WHITE.stroke_width(FINE as u32)
    };
    area.draw(&Circle::new(at(x, y), size, style))
        .map_err(words)
}

/// Over a dot that does harm.
fn cross(area: &Area, frame: &Frame, point: &Point, (x, y): (f64, f64)) -> Drawn {
    let arm = frame.dot_px(point.radius_mm) + 1.0;
    line(area, (x - arm, y - arm), (x + arm, y + arm), INK, 1.6)?;
    line(area, (x - arm, y + arm), (x + arm, y - arm), INK, 1.6)
}

fn keys(area: &Area, frame: &Frame, y: f64) -> Drawn {
    let sample = |feed_mm_min: f64, radius_mm: f64, undercut_um: f64, harms: bool| Point {
        radius_mm,
        feed_mm_min,
        protrusion_um: 1.0,
        undercut_um,
        harms,
    };
    let (first, widest) = (
        frame.feeds.first().copied().unwrap_or(0.0),
        frame.radii.last().copied().unwrap_or(0.0),
    );
    let mut x = 40.0;
    for &feed in frame.feeds.iter().take(COLOURS.len()) {
        dot(area, frame, &sample(feed, widest, 0.0, false), (x, y))?;
        let label = format!("F{feed} mm/min");
        plot::text(area, &label, at(x + 13.0, y), 13, &INK, HPos::Left)?;
        x += 40.0 + 7.4 * label.len() as f64;
    }
    let mut x = 40.0;
    let y = y + 26.0;
    for &radius in frame.radii.iter().take(6) {
        dot(area, frame, &sample(first, radius, 0.0, false), (x, y))?;
        let label = format!("R{radius}");
        plot::text(area, &label, at(x + 12.0, y), 13, &INK, HPos::Left)?;
        x += 34.0 + 8.0 * label.len() as f64;
    }
    let kinds = [
        (0.0, false, "protrusion"),
        (-2.0, false, "undercut"),
        (0.0, true, "worse than the backlash step"),
    ];
    x += 24.0;
    for (undercut_um, harms, label) in kinds {
        let shown = sample(first, widest, undercut_um, harms);
        dot(area, frame, &shown, (x, y))?;
        if harms {
            cross(area, frame, &shown, (x, y))?;
        }
        plot::text(area, label, at(x + 15.0, y), 13, &INK, HPos::Left)?;
        x += 44.0 + 7.0 * label.len() as f64;
    }
    line(area, (x, y - 9.0), (x, y + 9.0), INK, 2.0)?;
    plot::text(area, "mean", at(x + 9.0, y), 13, &INK, HPos::Left)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_has_round_steps_and_holds_every_dot() {
        for most_um in [0.04, 0.9, 3.0, 8.1, 32.2, 1234.0] {
            let comparison = Comparison {
                title: "test".into(),
                methods: vec![MethodPoints {
                    name: "one".into(),
                    points: vec![Point {
                        radius_mm: 10.0,
                        feed_mm_min: 1000.0,
                        protrusion_um: 0.01,
                        undercut_um: -most_um,
                        harms: false,
                    }],
                }],
            };
            let frame = Frame::of(&comparison);
            assert!(frame.end_um >= most_um && frame.end_um / frame.step_um < 8.5);
            let decade = 10f64.powf(frame.step_um.log10().floor());
            let lead = frame.step_um / decade;
            assert!(
                [1.0, 2.0, 5.0, 10.0]
                    .iter()
                    .any(|l| (lead / l - 1.0).abs() < 1e-6),
                "{lead}"
            );
        }
    }
}

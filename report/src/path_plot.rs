//! A path, coloured by the speed or the error along it.

use std::collections::BTreeSet;
use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use crate::label_layout::{self, Mark, Placed, Rect};
use crate::plot::{self, Area, Drawn, GRID, INK, PlotError, SOFT, at, fine, stroke, words};

const WIDTH: i32 = 1000;
const HEIGHT: i32 = 820;
/// Where the path is drawn, in pixels: left, top, right, bottom.
const FRAME: [f64; 4] = [70.0, 60.0, 860.0, 760.0];
/// Values of the same colour: so many steps up to the highest.
const STEPS: usize = 8;
/// From slow to fast: red over yellow to blue, told apart by those who do not see red and green as well.
const COLOURS: [RGBColor; STEPS] = [
    RGBColor(0xa5, 0x00, 0x26),
    RGBColor(0xd7, 0x30, 0x27),
    RGBColor(0xf4, 0x6d, 0x43),
    RGBColor(0xfd, 0xae, 0x61),
    RGBColor(0xab, 0xb9, 0xc2),
    RGBColor(0x74, 0xad, 0xd1),
    RGBColor(0x45, 0x75, 0xb4),
    RGBColor(0x31, 0x36, 0x95),
];
/// Letters of a label, in pixels, the height of a line of it, and the mean width of a letter.
const LABEL: (i32, f64, f64) = (11, 15.0, 5.5);
/// Places nearer to each other than this, in pixels, are one mark.
const TOGETHER_PX: f64 = 7.0;
/// Squares in which it is asked whether the path goes through, in pixels.
const SQUARE_PX: f64 = 4.0;
/// Points nearer to each other than this, in pixels, are one where the colour stays.
const NEAR_PX: f64 = 0.3;

/// A setpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// In the plane that is drawn, in mm (degrees of a rotary axis).
    pub place_mm: [f64; 2],
    /// What its colour shows.
    pub value: f64,
}

/// A place that is named.
#[derive(Debug, Clone, PartialEq)]
pub struct Label {
    /// In the plane that is drawn.
    pub place: [f64; 2],
    /// What stands beside it.
    pub title: String,
    /// What stands below that; may be empty.
    pub text: String,
}

/// A path and what is written about it.
#[derive(Debug, Clone, Copy)]
pub struct PathPicture<'a> {
    /// Above it.
    pub title: &'a str,
    /// Names of both axes, and their units.
    pub axes: [(&'a str, &'a str); 2],
    /// What the colours mean.
    pub meaning: Meaning,
    /// The path, in order of travel.
    pub points: &'a [PathPoint],
    /// Places that are named.
    pub labels: &'a [Label],
}

/// What the colours of a path mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// Speed along the path, in mm/s: what is slow is red.
    SpeedMmS,
    /// Contour error, in µm: what is far off is red.
    ContourErrorUm,
}

impl Meaning {
    fn unit(self) -> &'static str {
        match self {
            Meaning::SpeedMmS => "mm/s",
            Meaning::ContourErrorUm => "µm",
        }
    }

    /// The colour of a step.
    fn colour(self, step: usize) -> Option<&'static RGBColor> {
        match self {
            Meaning::SpeedMmS => COLOURS.get(step),
            Meaning::ContourErrorUm => COLOURS.get((STEPS - 1).checked_sub(step)?),
        }
    }
}

/// From mm to the picture; one mm is as long in both directions.
struct Scale {
    low_mm: [f64; 2],
    px_per_mm: f64,
}

impl Scale {
    fn of(points: &[PathPoint]) -> Self {
        let [mut low_mm, mut high_mm] = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for point in points {
            for ((low, high), at) in low_mm.iter_mut().zip(&mut high_mm).zip(point.place_mm) {
                (*low, *high) = (low.min(at), high.max(at));
            }
        }
        let [left, top, right, bottom] = FRAME;
        let [x_mm, y_mm] = [high_mm[0] - low_mm[0], high_mm[1] - low_mm[1]];
        let fits = ((right - left) / x_mm).min((bottom - top) / y_mm);
        let px_per_mm = if fits.is_finite() { fits } else { 1.0 };
        // In the middle.
        let free_mm = [
            (right - left) / px_per_mm - x_mm,
            (bottom - top) / px_per_mm - y_mm,
        ];
        for (low, free) in low_mm.iter_mut().zip(free_mm) {
            *low -= 0.5 * free;
        }
        Self { low_mm, px_per_mm }
    }

    fn px(&self, place_mm: [f64; 2]) -> (f64, f64) {
        let [left, _, _, bottom] = FRAME;
        let [x_mm, y_mm] = [place_mm[0] - self.low_mm[0], place_mm[1] - self.low_mm[1]];
        (left + x_mm * self.px_per_mm, bottom - y_mm * self.px_per_mm)
    }
}

/// Draws a path in the plane of two axes.
///
/// # Errors
/// It cannot be drawn, or the file cannot be written.
pub fn draw(file: &Path, picture: &PathPicture<'_>) -> Result<(), PlotError> {
    let PathPicture {
        title,
        axes,
        meaning,
        points,
        labels,
    } = *picture;
    let highest = points.iter().map(|point| point.value).fold(0.0, f64::max);
    let scale = Scale::of(points);
    plot::write(file, (WIDTH, HEIGHT), |area| {
        plot::text(area, title, at(FRAME[0], 28.0), 16, &INK, HPos::Left)?;
        lines(area, points, &scale, (meaning, highest))?;
        rulers(area, &scale, axes)?;
        legend(area, meaning, highest)?;
        name_places(area, points, &scale, labels)
    })
}

/// Labels of one mark.
struct Named<'l> {
    mark: (f64, f64),
    labels: Vec<&'l Label>,
}

impl Named<'_> {
    /// Its lines, and whether each is a title.
    fn lines(&self) -> impl Iterator<Item = (&str, bool)> {
        let each = self.labels.iter();
        let each = each.flat_map(|label| [(label.title.as_str(), true), (&label.text, false)]);
        each.filter(|(line, _)| !line.is_empty())
    }

    /// Width and height, in pixels.
    fn size(&self) -> (f64, f64) {
        let (_, line_px, letter_px) = LABEL;
        let letters = self.lines().map(|(line, _)| line.chars().count());
        let width_px = letters.max().unwrap_or(0) as f64 * letter_px + 10.0;
        (width_px, self.lines().count() as f64 * line_px + 6.0)
    }
}

/// Labels of places that the picture shows as one stand together.
fn named<'l>(labels: &'l [Label], scale: &Scale) -> Vec<Named<'l>> {
    let mut all: Vec<Named<'l>> = Vec::new();
    for label in labels {
        let mark = scale.px(label.place);
        let near =
            |other: &&mut Named| (other.mark.0 - mark.0).hypot(other.mark.1 - mark.1) < TOGETHER_PX;
        match all.iter_mut().find(near) {
            Some(known) => known.labels.push(label),
            None => all.push(Named {
                mark,
                labels: vec![label],
            }),
        }
    }
    all
}

/// Names of places, each with a leader line from the place.
fn name_places(area: &Area, points: &[PathPoint], scale: &Scale, labels: &[Label]) -> Drawn {
    let [left, top, right, bottom] = FRAME;
    let frame = Rect {
        low: (left - 8.0, top - 2.0),
        high: (right - 2.0, bottom + 8.0),
    };
    let all = named(labels, scale);
    let mark = |of: &Named| Mark {
        at: of.mark,
        size: of.size(),
    };
    let marks: Vec<Mark> = all.iter().map(mark).collect();
    let placed = label_layout::beside(&frame, &marks, &thinned(points, scale));
    for (of, place) in all.iter().zip(placed) {
        if let Some(place) = place {
            name_place(area, of, &place)?;
        }
    }
    Ok(())
}

/// The path in pixels, one point for each small square that it goes through.
fn thinned(points: &[PathPoint], scale: &Scale) -> Vec<(f64, f64)> {
    let square = |px: f64| (px / SQUARE_PX).floor() as i64;
    let squares = points.iter().map(|point| {
        let (x, y) = scale.px(point.place_mm);
        (square(x), square(y))
    });
    let squares: BTreeSet<(i64, i64)> = squares.collect();
    let middle = |square: i64| (square as f64 + 0.5) * SQUARE_PX;
    let middles = squares.into_iter().map(|(x, y)| (middle(x), middle(y)));
    middles.collect()
}

fn name_place(area: &Area, of: &Named, place: &Placed) -> Drawn {
    let (pixels, line_px, _) = LABEL;
    let mark = of.mark;
    let end = place.leader_end;
    let leader = vec![at(mark.0, mark.1), at(end.0, end.1)];
    plot::line(area, leader, stroke(INK, 1.0))?;
    let (low, high) = (place.rect.low, place.rect.high);
    let corners = [at(low.0, low.1), at(high.0, high.1)];
    area.draw(&Rectangle::new(corners, WHITE.filled()))
        .map_err(words)?;
    area.draw(&Rectangle::new(corners, stroke(SOFT, 0.8)))
        .map_err(words)?;
    for (index, (text, is_title)) in of.lines().enumerate() {
        let y = low.1 + 3.0 + (index as f64 + 0.5) * line_px;
        let colour = if is_title { &INK } else { &SOFT };
        plot::text(area, text, at(low.0 + 5.0, y), pixels, colour, HPos::Left)?;
    }
    let dot = Circle::new(at(mark.0, mark.1), fine(4.0), INK.filled());
    area.draw(&dot).map_err(words)?;
    let ring = Circle::new(at(mark.0, mark.1), fine(4.0), stroke(WHITE, 1.0));
    area.draw(&ring).map_err(words)
}

/// The step of a value.
fn step(value: f64, highest: f64) -> usize {
    let share = if highest > 0.0 { value / highest } else { 0.0 };
    ((share * STEPS as f64) as usize).min(STEPS - 1)
}

/// A line for each stretch of one colour.
fn lines(
    area: &Area,
    points: &[PathPoint],
    scale: &Scale,
    (meaning, highest): (Meaning, f64),
) -> Drawn {
    let mut stretch: Vec<(i32, i32)> = Vec::new();
    let (mut drawn, mut colour) = (None::<(f64, f64)>, None);
    let finish = |stretch: &mut Vec<(i32, i32)>, colour: Option<usize>| -> Drawn {
        let colour = colour.and_then(|step| meaning.colour(step));
        if let (Some(colour), true) = (colour, stretch.len() > 1) {
            plot::line(area, std::mem::take(stretch), stroke(*colour, 1.6))?;
        }
        stretch.clear();
        Ok(())
    };
    for point in points {
        let place = scale.px(point.place_mm);
        let here = Some(step(point.value, highest));
        let near = |before: (f64, f64)| {
            (place.0 - before.0).abs().max((place.1 - before.1).abs()) < NEAR_PX
        };
        if here == colour && drawn.is_some_and(near) {
            continue;
        }
        stretch.push(at(place.0, place.1));
        if here != colour {
            finish(&mut stretch, colour)?;
            stretch.push(at(place.0, place.1));
            colour = here;
        }
        drawn = Some(place);
    }
    finish(&mut stretch, colour)
}

/// Round numbers along both edges.
fn rulers(area: &Area, scale: &Scale, axes: [(&str, &str); 2]) -> Drawn {
    let [left, top, right, bottom] = FRAME;
    let ends = [
        (right - left) / scale.px_per_mm,
        (bottom - top) / scale.px_per_mm,
    ];
    for (index, ((axis, unit), length_mm)) in axes.iter().zip(ends).enumerate() {
        let low_mm = scale.low_mm.get(index).copied().unwrap_or(0.0);
        let every_mm = round_step_mm(length_mm / 8.0);
        let mut mark_mm = (low_mm / every_mm).ceil() * every_mm;
        while mark_mm <= low_mm + length_mm {
            let away_px = (mark_mm - low_mm) * scale.px_per_mm;
            let decimals = (-every_mm.log10().floor()).max(0.0) as usize;
            let label = format!("{:.decimals$}", mark_mm + 0.0);
            if index == 0 {
                let x = left + away_px;
                let tick = vec![at(x, bottom + 10.0), at(x, bottom + 16.0)];
                plot::line(area, tick, stroke(SOFT, 1.0))?;
                plot::text(area, &label, at(x, bottom + 26.0), 11, &SOFT, HPos::Center)?;
            } else {
                let y = bottom - away_px;
                let tick = vec![at(left - 16.0, y), at(left - 10.0, y)];
                plot::line(area, tick, stroke(SOFT, 1.0))?;
                plot::text(area, &label, at(left - 20.0, y), 11, &SOFT, HPos::Right)?;
            }
            mark_mm += every_mm;
        }
        let (place, text) = if index == 0 {
            (at(right + 12.0, bottom + 26.0), format!("{axis} {unit}"))
        } else {
            (at(left - 50.0, top - 16.0), format!("{axis} {unit}"))
        };
        plot::text(area, &text, place, 12, &INK, HPos::Left)?;
    }
    let frame = [at(left - 10.0, top - 4.0), at(right, bottom + 10.0)];
    area.draw(&Rectangle::new(frame, GRID.stroke_width(fine(1.0) as u32)))
        .map_err(words)
}

/// 1, 2 or 5 times a power of ten.
fn round_step_mm(about_mm: f64) -> f64 {
    let power = 10f64.powf(about_mm.log10().floor());
    let times = about_mm / power;
    let round = [1.0, 2.0, 5.0].into_iter().find(|round| times <= *round);
    round.unwrap_or(10.0) * power
}

/// What the colours mean.
fn legend(area: &Area, meaning: Meaning, highest: f64) -> Drawn {
    let [_, top, right, _] = FRAME;
    let (x, mut y) = (right + 20.0, top + 10.0);
    plot::text(area, meaning.unit(), at(x, y), 12, &INK, HPos::Left)?;
    let colours = (0..STEPS).rev();
    for (index, colour) in colours.filter_map(|step| Some((step, meaning.colour(step)?))) {
        y += 22.0;
        plot::line(area, vec![at(x, y), at(x + 24.0, y)], stroke(*colour, 6.0))?;
        let of = |index: usize| highest * index as f64 / STEPS as f64;
        let decimals = usize::from(highest < 20.0);
        let words = format!("{:.decimals$} – {:.decimals$}", of(index), of(index + 1));
        plot::text(area, &words, at(x + 32.0, y), 11, &SOFT, HPos::Left)?;
    }
    Ok(())
}

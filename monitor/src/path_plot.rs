//! A path, coloured by the speed or the error along it.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

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
/// Points nearer to each other than this, in pixels, are one where the colour stays.
const NEAR_PX: f64 = 0.3;

/// A setpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// In the plane that is drawn, in mm.
    pub place_mm: [f64; 2],
    /// What its colour shows.
    pub value: f64,
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
pub fn draw(
    file: &Path,
    title: &str,
    axes: [&str; 2],
    meaning: Meaning,
    points: &[PathPoint],
) -> Result<(), PlotError> {
    let highest = points.iter().map(|point| point.value).fold(0.0, f64::max);
    let scale = Scale::of(points);
    plot::write(file, (WIDTH, HEIGHT), |area| {
        plot::text(area, title, at(FRAME[0], 28.0), 16, &INK, HPos::Left)?;
        lines(area, points, &scale, (meaning, highest))?;
        rulers(area, &scale, axes)?;
        legend(area, meaning, highest)
    })
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
fn rulers(area: &Area, scale: &Scale, axes: [&str; 2]) -> Drawn {
    let [left, top, right, bottom] = FRAME;
    let ends = [
        (right - left) / scale.px_per_mm,
        (bottom - top) / scale.px_per_mm,
    ];
    for (index, (axis, length_mm)) in axes.iter().zip(ends).enumerate() {
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
            (at(right + 12.0, bottom + 26.0), format!("{axis} mm"))
        } else {
            (at(left - 50.0, top - 16.0), format!("{axis} mm"))
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

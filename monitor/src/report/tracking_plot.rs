//! Following error of every axis over time. Thinned by lowest and highest value, so that a peak of one scan is seen.

use std::path::Path;

use plotters::prelude::*;

use super::svg::{self, Area, FINE, INK, SOFT, words};
use super::{Evaluation, ReportError};
use crate::measure::axis::AxisMeter;

const WIDTH: i32 = 1100;
const PANEL: i32 = 230;
const HEAD: i32 = 64;

const GRID: RGBColor = RGBColor(0xe3, 0xe6, 0xea);
const CURVES: [RGBColor; 4] = [
    RGBColor(0x0b, 0x5c, 0xad),
    RGBColor(0xc2, 0x4a, 0x14),
    RGBColor(0x2f, 0x7d, 0x32),
    RGBColor(0x7b, 0x3f, 0xa0),
];

/// Draws one panel per axis.
pub(super) fn draw(path: &Path, evaluation: &Evaluation) -> Result<(), ReportError> {
    draw_panels(path, evaluation).map_err(|what| ReportError::Plot {
        path: path.into(),
        what,
    })
}

fn draw_panels(path: &Path, evaluation: &Evaluation) -> Result<(), String> {
    let count = evaluation.measurements.axes.len().max(1) as i32;
    svg::write(path, (WIDTH, HEAD + PANEL * count + 16), |root| {
        draw_on(root, evaluation, count)
    })
}

/// Draws one panel per axis with the curves of two runs of the same axes.
pub(super) fn draw_against(
    path: &Path,
    runs: [&Evaluation; 2],
    names: &[String; 2],
) -> Result<(), ReportError> {
    let [a, b] = runs;
    let count = a.measurements.axes.len().max(1) as i32;
    let drawn = svg::write(path, (WIDTH, HEAD + PANEL * count + 16), |root| {
        root.draw_text("Following error", &font(24, &INK), (40 * FINE, 18 * FINE))
            .map_err(words)?;
        let [colour_a, colour_b, ..] = CURVES;
        for (x, letter, name, colour) in [
            (240, 'A', &names[0], colour_a),
            (640, 'B', &names[1], colour_b),
        ] {
            let bar = vec![(x * FINE, 34 * FINE), ((x + 30) * FINE, 34 * FINE)];
            let style = colour.stroke_width(3 * FINE as u32);
            root.draw(&PathElement::new(bar, style)).map_err(words)?;
            let short: String = name.chars().take(40).collect();
            let label = format!("{letter}  {short}");
            let place = ((x + 40) * FINE, 27 * FINE);
            root.draw_text(&label, &font(14, &INK), place)
                .map_err(words)?;
        }
        let (_, body) = root.split_vertically(HEAD * FINE);
        let panels = body.split_evenly((count as usize, 1));
        let axes = a.measurements.axes.iter().zip(&b.measurements.axes);
        for (((of_a, of_b), axis), panel) in axes.zip(&a.machine.axes).zip(&panels) {
            let name = format!(
                "{}:  peak {:.1} and {:.1} µm, rms {:.2} and {:.2} µm",
                axis.name,
                of_a.following_error_mm.peak * 1e3,
                of_b.following_error_mm.peak * 1e3,
                of_a.following_error_mm.rms() * 1e3,
                of_b.following_error_mm.rms() * 1e3
            );
            // The last one lies on top: A, which is the one looked at.
            let curves = [
                (of_b, colour_b, b.measurements.scan_period_s),
                (of_a, colour_a, a.measurements.scan_period_s),
            ];
            draw_panel(panel, &name, INK, &curves)?;
        }
        Ok(())
    });
    drawn.map_err(|what| ReportError::Plot {
        path: path.into(),
        what,
    })
}

fn font(size: i32, colour: &RGBColor) -> TextStyle<'static> {
    ("sans-serif", size * FINE).into_font().color(colour)
}

fn draw_on(root: &Area, evaluation: &Evaluation, count: i32) -> Result<(), String> {
    let measurements = &evaluation.measurements;
    root.draw_text("Following error", &font(24, &INK), (40 * FINE, 18 * FINE))
        .map_err(words)?;
    let below = format!(
        "{} on {}   ·   command minus feedback, compensation not counted",
        evaluation.info.program, evaluation.machine.name
    );
    root.draw_text(&below, &font(14, &SOFT), (240 * FINE, 27 * FINE))
        .map_err(words)?;
    let (_, body) = root.split_vertically(HEAD * FINE);
    let panels = body.split_evenly((count as usize, 1));
    let axes = measurements.axes.iter().zip(&evaluation.machine.axes);
    for (index, ((meter, axis), panel)) in axes.zip(&panels).enumerate() {
        let colour = CURVES.get(index % CURVES.len()).copied().unwrap_or(INK);
        let name = format!(
            "{}:  peak {:.1} µm, rms {:.2} µm",
            axis.name,
            meter.following_error_mm.peak * 1e3,
            meter.following_error_mm.rms() * 1e3
        );
        let curve = (meter, colour, measurements.scan_period_s);
        draw_panel(panel, &name, colour, &[curve])?;
    }
    Ok(())
}

/// A curve: whose, its colour, and the scan period in s.
type Curve<'a> = (&'a AxisMeter, RGBColor, f64);

/// (time in s, lowest, highest) of each bin of a curve.
fn bins_of(&(meter, _, period_s): &Curve<'_>) -> Vec<(f64, f64, f64)> {
    let bins = meter.following_error_um_series.bins();
    bins.map(|(scan, low, high)| (scan * period_s, low, high))
        .collect()
}

fn draw_panel(
    area: &Area,
    name: &str,
    name_colour: RGBColor,
    curves: &[Curve<'_>],
) -> Result<(), String> {
    let all: Vec<Vec<(f64, f64, f64)>> = curves.iter().map(bins_of).collect();
    let bins = || all.iter().flatten();
    let most = bins().fold(0.0f64, |most, bin| most.max(bin.1.abs()).max(bin.2.abs()));
    let limit = if most > 0.0 { most * 1.1 } else { 1.0 };
    let first = bins().map(|bin| bin.0).fold(f64::INFINITY, f64::min);
    let last = bins().map(|bin| bin.0).fold(f64::NEG_INFINITY, f64::max);
    let (from, to) = if last > first {
        (first, last)
    } else {
        (0.0, 1.0)
    };
    let mut chart = ChartBuilder::on(area)
        .caption(name, font(16, &name_colour))
        .margin_top(8 * FINE)
        .margin_left(16 * FINE)
        .margin_right(30 * FINE)
        .x_label_area_size(36 * FINE)
        .y_label_area_size(66 * FINE)
        .build_cartesian_2d(from..to, -limit..limit)
        .map_err(words)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .bold_line_style(GRID.stroke_width(FINE as u32))
        .axis_style(SOFT.stroke_width(FINE as u32))
        .set_all_tick_mark_size(5 * FINE)
        .label_style(font(13, &SOFT))
        .x_desc("time in s")
        .y_desc("µm")
        .y_labels(7)
        .y_label_formatter(&|value: &f64| format!("{}", libm::round(value * 1e3) / 1e3 + 0.0))
        .draw()
        .map_err(words)?;
    for (bins, (_, colour, _)) in all.iter().zip(curves) {
        // Bins of one width follow each other; what is missing is a gap, not a straight line.
        let width = bins
            .windows(2)
            .map(|pair| pair[1].0 - pair[0].0)
            .fold(f64::INFINITY, f64::min);
        for piece in bins.chunk_by(|one, two| two.0 - one.0 < 1.5 * width) {
            let points = piece
                .iter()
                .flat_map(|&(time_s, low, high)| [(time_s, low), (time_s, high)]);
            chart
                .draw_series(LineSeries::new(points, colour.stroke_width(FINE as u32)))
                .map_err(words)?;
        }
    }
    Ok(())
}

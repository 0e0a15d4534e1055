//! Following error of every axis over time, of one run or of two. Thinned by lowest and highest value, so that a peak of one
//! scan is seen.

use std::path::Path;

use console::output::joined;
use machine::AxisKind;
use plotters::prelude::*;

use super::evaluation::Evaluation;
use crate::measure::axis::AxisMeter;
use crate::plot::{self, Area, CURVES, Drawn, FINE, Frame, INK, PlotError, SOFT, font, words};

const WIDTH: i32 = 1100;
const PANEL: i32 = 230;
const HEAD: i32 = 64;

/// Draws `tracking.svg`: one panel per axis, with a curve of each of one or two runs of the same axes. Two have names.
pub(super) fn draw(folder: &Path, runs: &[&Evaluation], names: &[String]) -> Result<(), PlotError> {
    let axes = runs.first().map_or(0, |run| run.measurements.axes.len());
    let size = (WIDTH, HEAD + PANEL * axes.max(1) as i32 + 16);
    plot::write(&folder.join("tracking.svg"), size, |root| {
        let place = (40 * FINE, 18 * FINE);
        root.draw_text("Following error", &font(24, &INK), place)
            .map_err(words)?;
        match runs {
            [run] => about(root, run)?,
            _ => legend(root, names)?,
        }
        let (_, body) = root.split_vertically(HEAD * FINE);
        let panels = body.split_evenly((axes.max(1), 1));
        (0..axes)
            .zip(&panels)
            .try_for_each(|(axis, area)| draw_axis(area, runs, axis))
    })
}

fn about(root: &Area, run: &Evaluation) -> Drawn {
    let below = format!(
        "{} on {}   ·   command minus feedback, compensation not counted",
        run.info.program, run.machine.name
    );
    root.draw_text(&below, &font(14, &SOFT), (240 * FINE, 27 * FINE))
        .map_err(words)
}

fn legend(root: &Area, names: &[String]) -> Drawn {
    let letters = [(240, 'A'), (640, 'B')].into_iter().zip(CURVES);
    for (((x, letter), colour), name) in letters.zip(names) {
        let bar = vec![(x * FINE, 34 * FINE), ((x + 30) * FINE, 34 * FINE)];
        plot::line(root, bar, plot::stroke(colour, 3.0))?;
        let short: String = name.chars().take(40).collect();
        let label = format!("{letter}  {short}");
        let place = ((x + 40) * FINE, 27 * FINE);
        root.draw_text(&label, &font(14, &INK), place)
            .map_err(words)?;
    }
    Ok(())
}

/// A curve: its bins (time in s, lowest, highest) and its colour.
type Curve = (Vec<(f64, f64, f64)>, RGBColor);

fn draw_axis(area: &Area, runs: &[&Evaluation], axis: usize) -> Drawn {
    let meters = || {
        let meters = runs.iter();
        meters.filter_map(|run| run.measurements.axes.get(axis).map(|meter| (meter, run)))
    };
    let joined = |value: &dyn Fn(&AxisMeter) -> String| {
        joined(meters().map(|(meter, _)| value(meter)), " and ")
    };
    let name = runs.first().and_then(|run| run.machine.axes.get(axis));
    let unit = name.map_or(AxisKind::Linear, |axis| axis.kind);
    let unit = unit.deviation_unit();
    let name = format!(
        "{}:  peak {} {unit}, rms {} {unit}",
        name.map_or("?", |axis| axis.name.as_str()),
        joined(&|meter| format!("{:.1}", meter.following_error_mm.peak * 1e3)),
        joined(&|meter| format!("{:.2}", meter.following_error_mm.rms() * 1e3))
    );
    // One run has a colour for each axis, two have one for each run.
    let first = if runs.len() == 1 { axis } else { 0 };
    let colours = || CURVES.into_iter().cycle().skip(first % CURVES.len());
    let name_colour = colours().next().filter(|_| runs.len() == 1).unwrap_or(INK);
    let curves = meters().zip(colours()).map(|((meter, run), colour)| {
        let period_s = run.measurements.scan_period_s;
        let bins = meter.following_error_um_series.bins();
        let bins = bins.map(|(scan, low, high)| (scan * period_s, low, high));
        (bins.collect(), colour)
    });
    let mut curves: Vec<Curve> = curves.collect();
    // The last one lies on top: A, which is the one looked at.
    curves.reverse();
    draw_panel(area, (&name, name_colour), unit, &curves)
}

fn draw_panel(area: &Area, caption: (&str, RGBColor), unit: &str, curves: &[Curve]) -> Drawn {
    let bins = || curves.iter().flat_map(|(bins, _)| bins);
    let most = bins().fold(0.0f64, |most, bin| most.max(bin.1.abs()).max(bin.2.abs()));
    let limit = if most > 0.0 { most * 1.1 } else { 1.0 };
    let first = bins().map(|bin| bin.0).fold(f64::INFINITY, f64::min);
    let last = bins().map(|bin| bin.0).fold(f64::NEG_INFINITY, f64::max);
    let frame = Frame {
        caption: Some(caption),
        top: 8,
        below: 36,
        x: if last > first { first..last } else { 0.0..1.0 },
        y: -limit..limit,
        titles: ("time in s", unit),
        labels: (None, 7),
        label_pixels: 13,
        x_label: None,
        y_label: &|value| format!("{}", libm::round(value * 1e3) / 1e3 + 0.0),
    };
    let mut chart = plot::chart(area, frame)?;
    for (bins, colour) in curves {
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

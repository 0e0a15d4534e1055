//! Ball-bar plots: the residual of each circle, exaggerated, about the least-squares circle (ISO 230-4 §7).

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};
use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::causes;
use super::evaluation::Evaluation;
use super::match_up::matched;
use super::ranking;
use crate::measure::arc::plots::{PLOTS_MAX, RUNS_MAX, in_one_plot, shown};
use crate::measure::arc::{ArcResult, CurvePoint, Quadrant};
use crate::measure::ball_bar::BallBar;
use crate::plot::{self, Area, Drawn, INK, PlotError, SOFT, at, fine, words};

const WIDTH: i32 = 900;
const CENTRE: (f64, f64) = (450.0, 470.0);
/// Radius of the circle without deviation, in pixels.
const BASE_PX: f64 = 235.0;
/// Radius of one division, in pixels.
const DIVISION_PX: f64 = 36.0;
/// Divisions on each side.
const DIVISIONS: i32 = 3;
/// Where the numbers of the quadrants stand, from the centre, in pixels.
const QUADRANT_PX: f64 = 40.0;
/// Top of the captions.
const CAPTIONS_Y: i32 = 900;

/// Half of the angle of an arrow.
const ARROW_RAD: f64 = 0.22;

const GRID: RGBColor = RGBColor(0xd9, 0xdd, 0xe2);
const COUNTER_CLOCKWISE: RGBColor = RGBColor(0x0b, 0x5c, 0xad);
const CLOCKWISE: RGBColor = RGBColor(0xc2, 0x4a, 0x14);
const MOTOR_COUNTER_CLOCKWISE: RGBColor = RGBColor(0x8f, 0xbd, 0xe6);
const MOTOR_CLOCKWISE: RGBColor = RGBColor(0xf0, 0xb0, 0x8e);

/// Draws one plot per distinct circle and feed; the names of the files.
pub(super) fn draw_all(folder: &Path, evaluation: &Evaluation) -> Result<Vec<String>, PlotError> {
    let mut groups: Vec<Vec<&ArcResult>> = Vec::new();
    for arc in evaluation.measurements.arcs.iter().filter(|arc| shown(arc)) {
        let group = groups.iter().position(|group| {
            let first = group.first();
            first.is_some_and(|first| in_one_plot(&first.circle, &arc.circle))
        });
        if let Some(group) = group.and_then(|index| groups.get_mut(index)) {
            if group.len() < RUNS_MAX {
                group.push(arc);
            }
        } else if groups.len() < PLOTS_MAX {
            groups.push(vec![arc]);
        }
    }
    draw_files(folder, &groups, |path, runs| draw(path, runs, evaluation))
}

/// Draws the circles that two runs have in common; the names of the files.
pub(super) fn draw_all_against(
    folder: &Path,
    runs: [&Evaluation; 2],
    names: &[String; 2],
) -> Result<Vec<String>, PlotError> {
    let [of_a, of_b] = runs.map(|run| &run.measurements.arcs);
    let pairs = matched(of_a, of_b, |arc| {
        (arc.line, arc.circle.plane, arc.circle.clockwise)
    });
    let both = pairs.iter().filter_map(|pair| pair.a.zip(pair.b));
    let both = both.filter(|(a, b)| !a.curve.is_empty() && !b.curve.is_empty());
    let both: Vec<(&ArcResult, &ArcResult)> = both.take(PLOTS_MAX).collect();
    let [evaluation, _] = runs;
    draw_files(folder, &both, |path, &(a, b)| {
        draw_against(path, [a, b], evaluation, names)
    })
}

/// Draws a file of each, and removes those that an earlier report left: it may have had more of them.
fn draw_files<T>(
    folder: &Path,
    all: &[T],
    draw: impl Fn(&Path, &T) -> Result<(), PlotError>,
) -> Result<Vec<String>, PlotError> {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_circle = name
            .to_str()
            .is_some_and(|name| name.starts_with("circle-") && name.ends_with(".svg"));
        if is_circle {
            let _ = std::fs::remove_file(entry.path());
        }
    }
    let files = all.iter().enumerate().map(|(index, one)| {
        let name = format!("circle-{}.svg", index + 1);
        draw(&folder.join(&name), one)?;
        Ok(name)
    });
    files.collect()
}

fn draw(path: &Path, runs: &[&ArcResult], evaluation: &Evaluation) -> Result<(), PlotError> {
    let Some(first) = runs.first() else {
        return Ok(());
    };
    let bars = &evaluation.measurements.ball_bars;
    let together = bars
        .iter()
        .find(|bar| in_one_plot(&bar.circle, &first.circle));
    let height = CAPTIONS_Y + 20 + 60 * runs.len() as i32 + 30 * i32::from(together.is_some());
    let told = together.filter(|bar| bar.diagnosis.is_some());
    let ranked = told.map(|bar| causes::ball_bar(bar, evaluation));
    let width = WIDTH + ranked.as_ref().map_or(0, |_| ranking::PANEL);
    plot::write(path, (width, height), |area| {
        let division_um = division_um(runs);
        title(area, first, evaluation)?;
        grid(area, first, evaluation)?;
        for run in runs {
            let (table, motor) = colours(run);
            curve(area, run, division_um, motor, 1.2, |point| point.motor_um)?;
            curve(area, run, division_um, table, 1.8, |point| point.table_um)?;
        }
        scale(area, division_um)?;
        for run in runs {
            protrusions(area, run, division_um)?;
            arrows(area, run)?;
        }
        captions(area, runs, division_um)?;
        if let Some(bar) = together {
            together_caption(area, bar, runs.len())?;
        }
        match &ranked {
            Some(bar) => ranking::draw(area, f64::from(WIDTH), bar),
            None => Ok(()),
        }
    })
}

/// One circle of two runs on one scale: residuals of the table, each about its own least-squares circle.
fn draw_against(
    path: &Path,
    runs: [&ArcResult; 2],
    evaluation: &Evaluation,
    names: &[String; 2],
) -> Result<(), PlotError> {
    let [first, _] = runs;
    let colours = [COUNTER_CLOCKWISE, CLOCKWISE];
    let most_um = most_um(&runs, |point| point.table_um.abs());
    let division_um = division_holding_um(most_um);
    let height = CAPTIONS_Y + 40 * 2;
    plot::write(path, (WIDTH, height), |area| {
        title(area, first, evaluation)?;
        grid(area, first, evaluation)?;
        for (run, colour) in runs.into_iter().zip(colours).rev() {
            curve(area, run, division_um, colour, 1.6, |point| point.table_um)?;
        }
        scale(area, division_um)?;
        scale_captions(area, division_um)?;
        let letters = ["A", "B"].into_iter().zip(names);
        for (index, ((run, colour), (letter, name))) in
            runs.into_iter().zip(colours).zip(letters).enumerate()
        {
            let y = f64::from(CAPTIONS_Y + 40 * index as i32);
            bar(area, y, colour, 3.0)?;
            let short: String = name.chars().take(40).collect();
            let [x_um, y_um] = run.table.fit.centre_mm.map(|mm| mm * 1e3);
            let line = format!(
                "{letter}  {short}, line {}:  G {:.2} µm  ·  radius {:+.2} µm  ·  centre {x_um:+.2} / {y_um:+.2} µm",
                run.line,
                run.table.circular_um,
                run.table.fit.radius_error_mm * 1e3
            );
            plot::text(area, &line, at(86.0, y), 15, &INK, HPos::Left)?;
        }
        Ok(())
    })
}

fn colours(run: &ArcResult) -> (RGBColor, RGBColor) {
    if run.circle.clockwise {
        (CLOCKWISE, MOTOR_CLOCKWISE)
    } else {
        (COUNTER_CLOCKWISE, MOTOR_COUNTER_CLOCKWISE)
    }
}

/// The smallest of 1, 2, 5 × 10^n µm by which everything fits into the divisions.
fn division_um(runs: &[&ArcResult]) -> f64 {
    let most_um = most_um(runs, |point| point.table_um.abs().max(point.motor_um.abs()));
    division_holding_um(most_um)
}

fn most_um(runs: &[&ArcResult], of: impl Fn(&CurvePoint) -> f64) -> f64 {
    let points = runs.iter().flat_map(|run| &run.curve);
    points.map(of).fold(0.0, f64::max)
}

fn division_holding_um(most_um: f64) -> f64 {
    let mut decade = 0.01;
    while decade < 1e6 {
        for step in [1.0, 2.0, 5.0] {
            if most_um <= f64::from(DIVISIONS) * step * decade {
                return step * decade;
            }
        }
        decade *= 10.0;
    }
    decade
}

/// Where a deviation at an angle stands, in units of the drawing.
fn place(angle_rad: f64, divisions: f64) -> (i32, i32) {
    let radius = BASE_PX + divisions * DIVISION_PX;
    (
        fine(CENTRE.0 + radius * libm::cos(angle_rad)),
        fine(CENTRE.1 - radius * libm::sin(angle_rad)),
    )
}

fn title(area: &Area, first: &ArcResult, evaluation: &Evaluation) -> Drawn {
    let circle = &first.circle;
    let [x, y] = circle.plane.map(|axis| evaluation.coordinate(axis));
    let feed = circle.feed_mm_s.unwrap_or(first.speed_mm_s) * 60.0;
    let headline = format!(
        "{x}{y} circle  ·  R {} mm  ·  F {feed:.0} mm/min",
        tidy(circle.radius_mm)
    );
    plot::text(area, &headline, at(40.0, 38.0), 26, &INK, HPos::Left)?;
    let [cx, cy] = circle.centre_mm.map(tidy);
    let info = &evaluation.info;
    let below = format!(
        "{} on {}   ·   centre {x} {cx} {y} {cy} mm   ·   {}",
        info.program, evaluation.machine.name, info.pace
    );
    plot::text(area, &below, at(40.0, 68.0), 15, &SOFT, HPos::Left)
}

/// A number of a program without rounding noise.
fn tidy(value: f64) -> String {
    format!("{}", libm::round(value * 1e4) / 1e4 + 0.0)
}

fn ring(area: &Area, divisions: f64, style: ShapeStyle) -> Drawn {
    let half_degrees = (0..=720).map(|half| f64::from(half).to_radians() / 2.0);
    let points = half_degrees.map(|angle_rad| place(angle_rad, divisions));
    plot::line(area, points.collect::<Vec<_>>(), style)
}

fn grid(area: &Area, first: &ArcResult, evaluation: &Evaluation) -> Drawn {
    for spoke in 0..8 {
        let angle = f64::from(spoke) * FRAC_PI_4;
        let from = if spoke % 2 == 0 {
            -BASE_PX / DIVISION_PX
        } else {
            -3.0
        };
        let ends = vec![place(angle, from), place(angle, 3.0)];
        plot::line(area, ends, plot::stroke(GRID, 1.0))?;
    }
    for division in -DIVISIONS..=DIVISIONS {
        let (colour, pixels) = if division == 0 {
            (SOFT, 1.2)
        } else {
            (GRID, 1.0)
        };
        ring(area, division.into(), plot::stroke(colour, pixels))?;
    }
    cross(area)?;
    for (index, quadrant) in ["I", "II", "III", "IV"].into_iter().enumerate() {
        let angle_rad = (index as f64 + 0.5) * FRAC_PI_2;
        let divisions = (QUADRANT_PX - BASE_PX) / DIVISION_PX;
        let place = place(angle_rad, divisions);
        plot::text(area, quadrant, place, 13, &SOFT, HPos::Center)?;
    }
    for index in 0..4 {
        let angle = index as f64 * FRAC_PI_2;
        let axis = first.circle.plane.get(index % 2).copied().unwrap_or(0);
        let sign = if index < 2 { "+" } else { "−" };
        let label = format!("{}{sign}", evaluation.coordinate(axis));
        plot::text(area, &label, place(angle, 4.4), 17, &INK, HPos::Center)?;
    }
    Ok(())
}

/// The least-squares centre.
fn cross(area: &Area) -> Drawn {
    for (x, y) in [(9.0, 0.0), (0.0, 9.0)] {
        let ends = vec![
            at(CENTRE.0 - x, CENTRE.1 - y),
            at(CENTRE.0 + x, CENTRE.1 + y),
        ];
        plot::line(area, ends, plot::stroke(INK, 1.4))?;
    }
    Ok(())
}

/// What the rings stand for, along a spoke on which no quadrant lies.
fn scale(area: &Area, division_um: f64) -> Drawn {
    for division in -DIVISIONS..=DIVISIONS {
        let (x, y) = place(-0.75 * std::f64::consts::PI, division.into());
        let label = match division {
            0 => "0 µm".to_string(),
            d if d < 0 => format!("−{}", tidy(-f64::from(d) * division_um)),
            d => format!("+{}", tidy(f64::from(d) * division_um)),
        };
        let (half, tall) = (fine(4.0 * label.chars().count() as f64 + 3.0), fine(9.0));
        let paper = Rectangle::new([(x - half, y - tall), (x + half, y + tall)], WHITE.filled());
        area.draw(&paper).map_err(words)?;
        plot::text(area, &label, (x, y), 13, &SOFT, HPos::Center)?;
    }
    Ok(())
}

fn curve(
    area: &Area,
    run: &ArcResult,
    division_um: f64,
    colour: RGBColor,
    width: f64,
    of: impl Fn(&CurvePoint) -> f64,
) -> Drawn {
    let mut piece: Vec<(i32, i32)> = Vec::new();
    let mut last_rad: Option<f64> = None;
    for point in &run.curve {
        // A part that was not measured is a gap, not a straight line.
        if last_rad.is_some_and(|last| (point.angle_rad - last).abs() > TAU / 120.0) {
            stroke(area, std::mem::take(&mut piece), colour, width)?;
        }
        last_rad = Some(point.angle_rad);
        let at = place(point.angle_rad, of(point) / division_um);
        if piece.last() != Some(&at) {
            piece.push(at);
        }
    }
    stroke(area, piece, colour, width)
}

fn stroke(area: &Area, piece: Vec<(i32, i32)>, colour: RGBColor, width: f64) -> Drawn {
    if piece.len() < 2 {
        return Ok(());
    }
    plot::line(area, piece, plot::stroke(colour, width))
}

/// Marks the largest protrusion at each quadrant of one run.
fn protrusions(area: &Area, run: &ArcResult, division_um: f64) -> Drawn {
    let (colour, _) = colours(run);
    for index in 0..4 {
        let of_index = |quadrant: &&Quadrant| {
            let k = libm::round(quadrant.angle_rad / FRAC_PI_2) as i64;
            k.rem_euclid(4) == index && quadrant.steady
        };
        let largest = run
            .quadrants
            .iter()
            .filter(of_index)
            .max_by(|a, b| a.protrusion_um.total_cmp(&b.protrusion_um));
        let Some(quadrant) = largest else { continue };
        let at = place(
            quadrant.protrusion_angle_rad,
            quadrant.protrusion_um / division_um,
        );
        area.draw(&Circle::new(at, fine(4.0), colour.filled()))
            .map_err(words)?;
        area.draw(&Circle::new(at, fine(4.0), plot::stroke(WHITE, 1.0)))
            .map_err(words)?;
        // Beside the axis letter, each direction on the side it travels to.
        let aside = if run.circle.clockwise { -0.16 } else { 0.16 };
        let (x, y) = place(index as f64 * FRAC_PI_2 + aside, 3.75);
        let label = format!("{:.1} µm", quadrant.protrusion_um);
        plot::text(area, &label, (x, y), 15, &colour, HPos::Center)?;
    }
    Ok(())
}

/// The direction of a run: an arrow inside the rings, in each quarter, either direction on a circle of its own.
fn arrows(area: &Area, run: &ArcResult) -> Drawn {
    let (colour, _) = colours(run);
    let (divisions, turn) = if run.circle.clockwise {
        (-4.6, -1.0)
    } else {
        (-4.0, 1.0)
    };
    for quarter in 0..4 {
        let middle_rad = (f64::from(quarter) + 0.5) * FRAC_PI_2;
        let at_share = |share: f64| place(middle_rad + turn * share * ARROW_RAD, divisions);
        let shaft = (-10..=9).map(|step| at_share(f64::from(step) / 10.0));
        plot::line(area, shaft.collect(), plot::stroke(colour, 2.0))?;
        let beside = |aside: f64| place(middle_rad + turn * 0.65 * ARROW_RAD, divisions + aside);
        let head = vec![at_share(1.0), beside(0.2), beside(-0.2)];
        area.draw(&Polygon::new(head, colour.filled()))
            .map_err(words)?;
    }
    Ok(())
}

/// What both directions show together, below the captions of the runs.
fn together_caption(area: &Area, bar: &BallBar, runs: usize) -> Drawn {
    let hysteresis = bar.hysteresis.map_or(String::new(), |(um, deg)| {
        format!("  ·  hysteresis H {um:.1} µm at {deg:.0}°")
    });
    let [x_um, y_um] = bar.centre_um;
    let line = match bar.bidirectional_um {
        Some(um) => format!(
            "both directions:  G(b) {um:.1} µm{hysteresis}  ·  common centre {x_um:+.1} / {y_um:+.1} µm"
        ),
        None => "one direction only: no hysteresis H and no G(b)".into(),
    };
    let y = f64::from(CAPTIONS_Y + 60 * runs as i32);
    plot::text(area, &line, at(86.0, y), 15, &INK, HPos::Left)
}

/// What a caption is of.
fn bar(area: &Area, y: f64, colour: RGBColor, width: f64) -> Drawn {
    let ends = vec![at(40.0, y), at(74.0, y)];
    plot::line(area, ends, plot::stroke(colour, width))
}

fn scale_captions(area: &Area, division_um: f64) -> Drawn {
    let scale = format!("1 division = {} µm", tidy(division_um));
    let right = f64::from(WIDTH - 40);
    plot::text(area, &scale, at(right, 38.0), 17, &INK, HPos::Right)?;
    let what = "radial deviation, outward +, about the least-squares circle";
    plot::text(area, what, at(right, 68.0), 13, &SOFT, HPos::Right)
}

fn captions(area: &Area, runs: &[&ArcResult], division_um: f64) -> Drawn {
    scale_captions(area, division_um)?;
    for (index, run) in runs.iter().enumerate() {
        let (table, motor) = colours(run);
        let y = f64::from(CAPTIONS_Y + 60 * index as i32);
        bar(area, y, table, 3.0)?;
        bar(area, y + 23.0, motor, 1.5)?;
        let turn = match run.circle.clockwise {
            true => "clockwise",
            false => "counter-clockwise",
        };
        let fit = &run.table.fit;
        let (radial, radius_um) = (run.table.radial_um, fit.radius_error_mm * 1e3);
        let [x_um, y_um] = fit.centre_mm.map(|mm| mm * 1e3);
        let line = format!(
            "table, {turn}, line {}:  G {:.1} µm  ·  F {:+.1} / {:+.1} µm  ·  radius {radius_um:+.1} µm  ·  centre {x_um:+.1} / {y_um:+.1} µm",
            run.line, run.table.circular_um, radial.0, radial.1
        );
        plot::text(area, &line, at(86.0, y), 15, &INK, HPos::Left)?;
        let line = format!(
            "motor side, backlash compensation removed:  G {:.1} µm  ·  radius {:+.1} µm  ·  measured over {:.0}° of {:.0}°",
            run.motor.circular_um,
            run.motor.fit.radius_error_mm * 1e3,
            run.measured_deg,
            run.turns * 360.0
        );
        plot::text(area, &line, at(86.0, y + 23.0), 13, &SOFT, HPos::Left)?;
    }
    Ok(())
}

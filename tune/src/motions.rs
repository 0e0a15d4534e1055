//! The test motions: part programs that move one axis after the other, in machine coordinates.

use std::f64::consts::PI;
use std::fmt::Write;

use anyhow::bail;
use machine::{Axis, AxisKind, Machine};

use crate::options::TuneOptions;

/// Longest stroke to either side of the middle, in mm.
const STROKE_MM: f64 = 20.0;
/// Highest test speed, in mm/s.
const SPEED_MM_S: f64 = 100.0;
/// Speeds at which friction is measured, in mm/s.
const STEADY_MM_S: [f64; 9] = [0.3, 0.7, 1.5, 3.0, 5.0, 8.0, 15.0, 40.0, 100.0];
/// Reversals: acceleration in mm/s², length of a stroke in mm, how many.
pub const REVERSALS: [(f64, f64, u32); 5] = [
    (10.0, 1.0, 12),
    (10.0, 0.04, 12),
    (60.0, 2.0, 16),
    (300.0, 5.0, 16),
    (1500.0, 15.0, 12),
];
/// Least time at one speed, in s.
const STEADY_S: f64 = 0.4;

/// What somebody allows the test motions of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limit {
    /// Travel to either side of the middle, in mm.
    pub travel_mm: Option<f64>,
    /// Speed, in mm/s.
    pub speed_mm_s: Option<f64>,
    /// Acceleration, in mm/s².
    pub acceleration_mm_s2: Option<f64>,
}

/// Limits of all axes, from the options.
///
/// # Errors
/// An option names an axis that is not there, or no number.
pub fn limits(machine: &Machine, options: &TuneOptions) -> anyhow::Result<Vec<Limit>> {
    let each = |name, list| crate::options::of_axes(machine, name, list, 1e-3..=1e5);
    let travel_mm = each("--travel-mm", &options.travel_mm)?;
    let speed_mm_s = each("--speed-mm-s", &options.speed_mm_s)?;
    let acceleration_mm_s2 = each("--acceleration-mm-s2", &options.acceleration_mm_s2)?;
    let all = travel_mm
        .into_iter()
        .zip(speed_mm_s)
        .zip(acceleration_mm_s2);
    let limit = |((travel_mm, speed_mm_s), acceleration_mm_s2)| Limit {
        travel_mm,
        speed_mm_s,
        acceleration_mm_s2,
    };
    Ok(all.map(limit).collect())
}

/// The axes of a machine, each with its limit.
fn limited<'a>(
    machine: &'a Machine,
    limits: &'a [Limit],
) -> impl Iterator<Item = (&'a Axis, Limit)> {
    let limits = limits
        .iter()
        .copied()
        .chain(std::iter::repeat(Limit::default()));
    machine.axes.iter().zip(limits)
}

/// The middle of the travel and the stroke to either side that fits, in mm.
fn place(axis: &Axis, limit: Limit) -> (f64, f64) {
    let middle_mm = 0.5 * (axis.travel_min_mm + axis.travel_max_mm);
    let room_mm = 0.4 * (axis.travel_max_mm - axis.travel_min_mm);
    let allowed_mm = limit.travel_mm.unwrap_or(STROKE_MM);
    (middle_mm, room_mm.min(allowed_mm).min(STROKE_MM))
}

/// A program that moves each axis by itself; `strokes` gives an axis's moves: places relative to the middle, in mm, and the
/// speed towards them, in mm/s.
fn one_by_one(
    machine: &Machine,
    limits: &[Limit],
    strokes: impl Fn(&Axis, f64) -> Vec<(f64, f64)>,
) -> String {
    let mut text = String::from("G21 G17 G90 G94\n");
    for (axis, limit) in limited(machine, limits) {
        let middle_mm = place(axis, limit).0;
        let _ = write!(text, "G0 {}{middle_mm:.6}\nG4 P0.1\n", axis.name);
    }
    for (axis, limit) in limited(machine, limits) {
        let (middle_mm, room_mm) = place(axis, limit);
        let allowed_mm_s = limit.speed_mm_s.unwrap_or(SPEED_MM_S);
        let name = &axis.name;
        for (to_mm, speed_mm_s) in strokes(axis, room_mm) {
            let speed_mm_s = speed_mm_s
                .min(SPEED_MM_S)
                .min(allowed_mm_s)
                .min(axis.rapid_mm_s);
            let _ = writeln!(
                text,
                "G1 {name}{:.6} F{:.3}",
                middle_mm + to_mm,
                speed_mm_s * 60.0
            );
        }
        text += "G4 P0.2\n";
    }
    text + "M2\n"
}

/// Strokes to and fro over the whole stroke, that end elsewhere each time.
pub fn strokes(machine: &Machine, limits: &[Limit]) -> String {
    one_by_one(machine, limits, |_, room_mm| {
        (0..12)
            .map(|i| {
                let part = 1.0 - 0.047 * f64::from(i);
                let to_mm = if i % 2 == 0 { part } else { -part };
                (to_mm * room_mm, SPEED_MM_S)
            })
            .collect()
    })
}

/// Reversals at the acceleration of the machine file in force: strokes of about `length_mm`, ever from another place.
pub fn reversals(machine: &Machine, limits: &[Limit], length_mm: f64, count: u32) -> String {
    one_by_one(machine, limits, |_, room_mm| {
        let length_mm = length_mm.min(0.8 * room_mm);
        let mut moves = vec![(-0.5 * length_mm - 0.5_f64.min(0.1 * room_mm), 5.0)];
        for i in 0..count {
            // The golden ratio's fractions lie evenly whatever their number.
            let at = libm::fmod(0.618_034 * f64::from(i), 1.0) - 0.5;
            let side = if i % 2 == 0 { 0.5 } else { -0.5 };
            moves.push((side * length_mm + 0.2 * at * room_mm.min(5.0), SPEED_MM_S));
        }
        moves
    })
}

/// One speed after the other, there and back.
pub fn steady(machine: &Machine, limits: &[Limit]) -> String {
    one_by_one(machine, limits, |axis, room_mm| {
        let mut moves = Vec::new();
        for speed_mm_s in STEADY_MM_S {
            let half_mm = (0.5 * STEADY_S * speed_mm_s)
                .max(axis.lead_mm / 12.0)
                .min(room_mm);
            moves.push((half_mm, speed_mm_s));
            moves.push((-half_mm, speed_mm_s));
        }
        moves
    })
}

/// The plane word and the axes of the first plane that two slides span, if there is one.
fn plane(machine: &Machine) -> Option<(&'static str, [&Axis; 2], [char; 2])> {
    let slide = |name: &str| {
        machine
            .axes
            .iter()
            .find(|a| a.name == name && a.kind == AxisKind::Linear)
    };
    [
        ("G17", ["X", "Y"], ['I', 'J']),
        ("G18", ["Z", "X"], ['K', 'I']),
        ("G19", ["Y", "Z"], ['J', 'K']),
    ]
    .into_iter()
    .find_map(|(word, [a, b], centre)| Some((word, [slide(a)?, slide(b)?], centre)))
}

/// A test circle.
#[derive(Debug, Clone, PartialEq)]
pub struct Circle {
    /// Radius, in mm.
    pub radius_mm: f64,
    /// Feed, in mm/min.
    pub feed_mm_min: f64,
    /// Names of its axes.
    pub axes: [String; 2],
    /// Its centre, in mm.
    pub centre_mm: [f64; 2],
    /// Two turns counter-clockwise and two clockwise around it.
    pub program: String,
}

/// Test circles where nobody names others.
pub const CIRCLES: [(f64, f64); 3] = [(25.0, 3000.0), (10.0, 10_000.0), (100.0, 1000.0)];

/// The test circles that were named, or those of the usual ones that this machine has room for.
///
/// # Errors
/// There is no room for one that was named.
pub fn named_circles(
    machine: &Machine,
    limits: &[Limit],
    named: &[(f64, f64)],
) -> anyhow::Result<Vec<Circle>> {
    if named.is_empty() {
        return Ok(circles(machine, limits, &CIRCLES));
    }
    for &(radius_mm, feed_mm_min) in named {
        if circle(machine, limits, radius_mm, feed_mm_min).is_some() {
            continue;
        }
        let Some((_, axes, _)) = plane(machine) else {
            bail!("--circles: this machine has no two slides that span a plane");
        };
        let most_mm = axes.map(|axis| 0.49 * (axis.travel_max_mm - axis.travel_min_mm));
        bail!(
            "--circles {radius_mm}:{feed_mm_min}: there is no room for it: the radius is at most {:.1} mm, with the travel of {} and {}",
            most_mm[0].min(most_mm[1]),
            axes[0].name,
            axes[1].name
        );
    }
    Ok(circles(machine, limits, named))
}

/// Those of these test circles, radius in mm and feed in mm/min, that this machine has room for within these limits; none if no two
/// slides span a plane.
pub fn circles(machine: &Machine, limits: &[Limit], wanted: &[(f64, f64)]) -> Vec<Circle> {
    let mut all: Vec<Circle> = Vec::new();
    for &(radius_mm, feed_mm_min) in wanted {
        let circle = circle(machine, limits, radius_mm, feed_mm_min);
        all.extend(circle.filter(|circle| !all.contains(circle)));
    }
    all
}

/// A circle around the middle of the travel, smaller and slower where a limit asks for it.
fn circle(machine: &Machine, limits: &[Limit], radius_mm: f64, feed_mm_min: f64) -> Option<Circle> {
    let (word, axes, [i, j]) = plane(machine)?;
    let limit = |axis: &Axis| {
        let found = limited(machine, limits).find(|(of, _)| of.name == axis.name);
        found.map_or(Limit::default(), |(_, limit)| limit)
    };
    let (mut radius_mm, mut feed_mm_s) = (radius_mm, feed_mm_min / 60.0);
    for axis in axes {
        let limit = limit(axis);
        radius_mm = radius_mm.min(limit.travel_mm.unwrap_or(f64::INFINITY));
        feed_mm_s = feed_mm_s.min(limit.speed_mm_s.unwrap_or(f64::INFINITY));
    }
    for axis in axes {
        let most_mm_s2 = limit(axis).acceleration_mm_s2.unwrap_or(f64::INFINITY);
        feed_mm_s = feed_mm_s.min((0.5 * most_mm_s2 * radius_mm).sqrt());
    }
    let fits = |axis: &&Axis| radius_mm <= 0.49 * (axis.travel_max_mm - axis.travel_min_mm);
    if !axes.iter().all(fits) {
        return None;
    }
    let [a, b] = axes;
    let feed_mm_min = libm::round(feed_mm_s * 60.0);
    // Off the axes, so that every reversal lies in steady motion.
    let (dx, dy) = (
        radius_mm * libm::cos(0.25 * PI),
        radius_mm * libm::sin(0.25 * PI),
    );
    let centre_mm = [place(a, limit(a)).0, place(b, limit(b)).0];
    let (x, y) = (centre_mm[0] + dx, centre_mm[1] + dy);
    let turns = |g: &str| {
        format!(
            "{g} {}{x:.6} {}{y:.6} {i}{:.6} {j}{:.6} F{feed_mm_min}\n",
            a.name, b.name, -dx, -dy
        )
        .repeat(2)
    };
    let program = format!(
        "G21 {word} G90 G94\nG0 {}{x:.6} {}{y:.6}\nG4 P0.2\n{}G4 P0.2\n{}G4 P0.2\nM2\n",
        a.name,
        b.name,
        turns("G3"),
        turns("G2")
    );
    Some(Circle {
        radius_mm,
        feed_mm_min,
        axes: axes.map(|axis| axis.name.clone()),
        centre_mm,
        program,
    })
}

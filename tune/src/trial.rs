//! Before and after: the same circles on the machine as it was and as it would be, judged by what a machine itself sees.
//!
//! A slide with a scale shows its table. One without shows its motor alone: what the compensation adds for the lost motion is taken off its
//! encoder, and whether that is right nobody knows without a ball-bar.

use std::path::Path;

use anyhow::Context;
use bus::sample::{AxisCommand, Feedback};
use machine::{Axis, Machine};
use monitor::log::{Reader, Sample};
use toml_edit::DocumentMut;

use super::bench::Bench;
use super::least_squares::NormalEquations;
use super::motions::Circle;
use super::write;
use console::exit::Failure;

/// Deviation of the command from the circle, in mm, and of its speed from the feed, as a part of it, within which motion is steady.
const ON_CIRCLE_MM: f64 = 2e-3;
const STEADY: f64 = 0.02;
/// So far behind a reversal its traces are looked for, in rad; and a little before it.
const BEHIND_RAD: f64 = 0.35;
const BEFORE_RAD: f64 = 0.03;
/// Mean over which deviations are taken, in s.
const MEAN_S: f64 = 2e-3;
/// The axes have settled a quarter of a turn after the feed is reached, and no sooner than after so much time, in s.
const SETTLED_TURNS: f64 = 0.25;
const SETTLED_S: f64 = 0.1;

/// What a circle left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Left {
    /// Largest protrusion or undercut at a reversal, in µm.
    pub worst_um: f64,
    /// Torque that the loops of the axes without a scale added near reversals to what was fed forward, root mean square, in N·m.
    pub loop_nm: f64,
    /// Whether each axis was seen by a scale.
    pub by_scales: bool,
}

/// What each test circle left; none where the machine stopped.
pub type Column = Vec<Option<Left>>;

/// Runs them.
///
/// # Errors
/// The environment does not allow it, or somebody interrupted. A machine that stops is no error.
pub fn run(
    bench: &mut Bench,
    document: &DocumentMut,
    circles: &[Circle],
) -> Result<Column, Failure> {
    let mut plain = document.clone();
    write::plain(&mut plain);
    circles
        .iter()
        .map(|circle| {
            let left = bench.with_log(&plain, &circle.program, |log, machine| {
                read(log, machine, circle)
            });
            match left {
                Ok(left) => Ok(Some(left)),
                Err(Failure::Stopped(why)) => {
                    tracing::warn!("{why:#}");
                    Ok(None)
                }
                Err(other) => Err(other),
            }
        })
        .collect()
}

/// One scan on the circle: where the table is seen, beside the centre, in mm.
struct Seen {
    place_mm: [f64; 2],
    angle_rad: f64,
    /// 1 counter-clockwise, −1 clockwise.
    turns: f64,
    loop_nm: f64,
    scan: u64,
}

/// Two axes of a circle.
struct Plane<'a> {
    axes: [(usize, &'a Axis); 2],
    circle: &'a Circle,
    scan_s: f64,
    /// Commands of the last scans, the newest last, for each axis.
    commands: [Vec<AxisCommand>; 2],
    dead_time_scans: usize,
    before_mm: Option<[f64; 2]>,
    /// Scans of steady motion in a row.
    steady_scans: u64,
    /// Whether a scale ever showed another place than the motor.
    has_scale: [bool; 2],
    seen: Vec<Seen>,
}

/// What a log shows of a circle.
fn read(log: &Path, machine: &Machine, circle: &Circle) -> anyhow::Result<Left> {
    let axis = |name: &String| {
        let found = machine
            .axes
            .iter()
            .enumerate()
            .find(|(_, a)| a.name == *name);
        found.with_context(|| format!("there is no axis {name}"))
    };
    let mut plane = Plane {
        axes: [axis(&circle.axes[0])?, axis(&circle.axes[1])?],
        circle,
        scan_s: machine.scan_period_s(),
        commands: [Vec::new(), Vec::new()],
        dead_time_scans: machine.scan.dead_time_scans as usize,
        before_mm: None,
        steady_scans: 0,
        has_scale: [false; 2],
        seen: Vec::new(),
    };
    let mut reader = Reader::open(log)?;
    while let Some(sample) = reader.next_sample()? {
        match sample {
            Sample::Feedback(feedback) => plane.feedback(&feedback),
            Sample::Command(command) => plane.command(&command),
            _ => {}
        }
    }
    Ok(plane.left())
}

impl Plane<'_> {
    fn command(&mut self, command: &AxisCommand) {
        for ((index, _), kept) in self.axes.iter().zip(&mut self.commands) {
            if command.axis as usize == *index
                && kept.last().is_none_or(|of| of.scan < command.scan)
            {
                kept.push(*command);
                if kept.len() > 16 {
                    kept.remove(0);
                }
            }
        }
    }

    fn feedback(&mut self, feedback: &Feedback) {
        let (mut command_mm, mut place_mm, mut loop_nm) = ([0.0; 2], [0.0; 2], 0.0);
        for (side, (index, axis)) in self.axes.iter().enumerate() {
            let Some(of) = feedback.axes().get(*index) else {
                return;
            };
            let mm = |increments: i64| increments as f64 * axis.increment_mm();
            command_mm[side] = mm(of.command_position) - self.circle.centre_mm[side];
            place_mm[side] = mm(of.scale_position) - self.circle.centre_mm[side];
            self.has_scale[side] |= of.scale_position != of.motor_position;
            if !self.has_scale[side] {
                // The command that this place answers to.
                let answered = feedback
                    .scan
                    .saturating_sub(1 + self.dead_time_scans as u64);
                let command = self.commands[side].iter().rev();
                if let Some(command) = command.clone().find(|of| of.scan <= answered) {
                    place_mm[side] -= command.compensation_mm;
                    loop_nm += (of.torque_nm - command.torque_feed_forward_nm).powi(2);
                }
            }
        }
        let steady_scans = std::mem::take(&mut self.steady_scans);
        let before_mm = self.before_mm.replace(command_mm);
        let Some(before_mm) = before_mm else { return };
        let step_mm = [command_mm[0] - before_mm[0], command_mm[1] - before_mm[1]];
        let feed_mm_s = self.circle.feed_mm_min / 60.0;
        let speed_mm_s = step_mm[0].hypot(step_mm[1]) / self.scan_s;
        let off_mm = command_mm[0].hypot(command_mm[1]) - self.circle.radius_mm;
        if off_mm.abs() > ON_CIRCLE_MM || (speed_mm_s / feed_mm_s - 1.0).abs() > STEADY {
            return;
        }
        self.steady_scans = steady_scans + 1;
        let turn_s = 2.0 * core::f64::consts::PI * self.circle.radius_mm / feed_mm_s;
        if (steady_scans as f64) * self.scan_s < (SETTLED_TURNS * turn_s).max(SETTLED_S) {
            return;
        }
        self.seen.push(Seen {
            place_mm,
            angle_rad: libm::atan2(command_mm[1], command_mm[0]),
            turns: (command_mm[0] * step_mm[1] - command_mm[1] * step_mm[0]).signum(),
            loop_nm,
            scan: feedback.scan,
        });
    }

    /// Worst deviation near reversals from the circles that fit best, each way round for itself.
    fn left(&self) -> Left {
        let mut left = Left {
            worst_um: 0.0,
            loop_nm: 0.0,
            by_scales: self.has_scale == [true; 2],
        };
        let mut sum = (0.0, 0.0);
        for turns in [1.0, -1.0] {
            let seen: Vec<&Seen> = self.seen.iter().filter(|of| of.turns == turns).collect();
            let off_um = self.off_um(&seen);
            for (of, off_um) in seen.iter().zip(&off_um) {
                // Angle since the last reversal of one of the axes.
                let quarter = 0.5 * core::f64::consts::PI;
                let since = turns * of.angle_rad / quarter;
                let since_rad = (since - since.floor()) * quarter;
                if since_rad < BEHIND_RAD || since_rad > quarter - BEFORE_RAD {
                    left.worst_um = left.worst_um.max(off_um.abs());
                    sum = (sum.0 + of.loop_nm, sum.1 + 1.0);
                }
            }
        }
        left.loop_nm = (sum.0 / f64::max(sum.1, 1.0)).sqrt();
        left
    }

    /// Deviations outwards from the circle that fits best, in µm, each a mean over its neighbours.
    fn off_um(&self, seen: &[&Seen]) -> Vec<f64> {
        let mut equations = NormalEquations::new(3);
        let row = |of: &Seen| [1.0, libm::cos(of.angle_rad), libm::sin(of.angle_rad)];
        let out_um =
            |of: &Seen| 1e3 * (of.place_mm[0].hypot(of.place_mm[1]) - self.circle.radius_mm);
        for of in seen {
            equations.add(&row(of), out_um(of), 1.0);
        }
        let fit = equations.solve(0).coefficients;
        let off: Vec<f64> = seen
            .iter()
            .map(|of| out_um(of) - row(of).iter().zip(&fit).map(|(a, b)| a * b).sum::<f64>())
            .collect();
        let half = (0.5 * MEAN_S / self.scan_s).round() as usize;
        (0..off.len())
            .map(|i| {
                let (low, high) = (i.saturating_sub(half), (i + half).min(off.len() - 1));
                let whole = seen[high].scan - seen[low].scan == (high - low) as u64;
                if whole {
                    off[low..=high].iter().sum::<f64>() / (high - low + 1) as f64
                } else {
                    off[i]
                }
            })
            .collect()
    }
}

/// Mean of a column; a circle on which the machine stopped counts as endlessly bad.
pub fn mean_um(column: &Column) -> f64 {
    let all = column.iter();
    let sum: f64 = all
        .map(|of| of.map_or(f64::INFINITY, |left| left.worst_um))
        .sum();
    sum / column.len().max(1) as f64
}

/// Whether every axis of every circle was seen by a scale.
pub fn by_scales(column: &Column) -> bool {
    column.iter().flatten().all(|left| left.by_scales)
}

/// The table for people.
pub fn table(circles: &[Circle], columns: &[(&str, &Column)]) -> String {
    let mut all = columns
        .iter()
        .flat_map(|(_, column)| column.iter().flatten());
    let has_scale = all.all(|of| of.by_scales);
    let mut text = String::from("worst protrusion or undercut, µm, cw and ccw, ");
    text += if has_scale {
        "by the scales\n  radius     feed  "
    } else {
        "by the motor encoders less what is added for lost motion: how much that really is they do not show\n  radius     feed  "
    };
    for (name, _) in columns {
        text += &format!("{name:>15}");
    }
    let cell = |um: Option<f64>| {
        um.filter(|um| um.is_finite())
            .map_or(format!("{:>15}", "stopped"), |um| format!("{um:15.1}"))
    };
    for (index, circle) in circles.iter().enumerate() {
        text += &format!("\n  R{:<6} F{:<8}", circle.radius_mm, circle.feed_mm_min);
        for (_, column) in columns {
            text += &cell(column.get(index).copied().flatten().map(|of| of.worst_um));
        }
    }
    text += &format!("\n  {:17}", "mean");
    for (_, column) in columns {
        text += &cell(Some(mean_um(column)));
    }
    if !has_scale {
        text += "\n  loop adds, N·m   ";
        for (_, column) in columns {
            let all: Vec<f64> = column.iter().flatten().map(|of| of.loop_nm).collect();
            let mean_nm = all.iter().sum::<f64>() / all.len().max(1) as f64;
            text += &format!("{mean_nm:15.3}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motions::{CIRCLES, Limit};

    fn machine() -> Machine {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        Machine::load(&folder).expect("machines/xy")
    }

    /// A circle of R10 that is 20 µm too large and 5 µm beside its centre, with so many µm on top close behind each reversal of X.
    fn left_um(bump_um: f64) -> f64 {
        let machine = machine();
        let limit = Limit {
            travel_mm: Some(10.0),
            ..Limit::default()
        };
        let circles = crate::motions::circles(&machine, &[limit; 2], &CIRCLES);
        let circle = circles.first().expect("a circle");
        let axes = [(0, &machine.axes[0]), (1, &machine.axes[1])];
        let mut plane = Plane {
            axes,
            circle,
            scan_s: 1e-3,
            commands: [Vec::new(), Vec::new()],
            dead_time_scans: 1,
            before_mm: None,
            steady_scans: 0,
            has_scale: [true; 2],
            seen: Vec::new(),
        };
        for scan in 0..4000_u64 {
            let angle_rad = 0.005 * scan as f64;
            let half_turn = libm::fmod(angle_rad, core::f64::consts::PI);
            let bump = if (0.05..0.15).contains(&half_turn) {
                bump_um
            } else {
                0.0
            };
            let radius_mm = circle.radius_mm + 0.020 + bump * 1e-3;
            let (sine, cosine) = (libm::sin(angle_rad), libm::cos(angle_rad));
            plane.seen.push(Seen {
                place_mm: [radius_mm * cosine + 0.005, radius_mm * sine],
                angle_rad: libm::atan2(sine, cosine),
                turns: 1.0,
                loop_nm: 0.0,
                scan,
            });
        }
        let left = plane.left();
        assert!(left.by_scales);
        left.worst_um
    }

    #[test]
    fn what_sticks_out_behind_a_reversal_is_measured_and_size_and_place_of_the_circle_are_not() {
        assert!(left_um(0.0) < 0.05, "{}", left_um(0.0));
        let of_6_um = left_um(6.0);
        assert!((5.2..6.1).contains(&of_6_um), "{of_6_um} µm");
    }

    #[test]
    fn circles_stay_within_what_is_allowed() {
        let machine = machine();
        let limit = Limit {
            travel_mm: Some(15.0),
            speed_mm_s: Some(40.0),
            acceleration_mm_s2: Some(100.0),
        };
        let circles = crate::motions::circles(&machine, &[limit; 2], &CIRCLES);
        assert!(!circles.is_empty());
        for circle in circles {
            let feed_mm_s = circle.feed_mm_min / 60.0;
            assert!(circle.radius_mm <= 15.0 && feed_mm_s <= 40.0, "{circle:?}");
            assert!(feed_mm_s.powi(2) / circle.radius_mm <= 100.0, "{circle:?}");
        }
    }
}

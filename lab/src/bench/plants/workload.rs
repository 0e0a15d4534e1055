//! A program of circles on one machine and one plant, run in this process: what it leaves at reversals, how it ends, and whether the
//! axes then stand still.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::fmt::Write as _;

use ::report::measure::Analysis;
use bus::sample::{Instruments, Mode};
use machine::Machine;
use monitor::log::Sample;
use monitor::words::StopCause;
use path::geometry::AxisVector;
use plant_sim::plant_file::PlantFile;
use program::Setup;
use serde::{Deserialize, Serialize};

use crate::bench::campaign::to_keep;
use crate::cell::InProcessCell;
use console::exit::{Failure, Kind};

/// A program that is not done after that time never ends, in s of the machine.
const TIME_S_MAX: f64 = 3600.0;

/// A circle: radius in mm, feed in mm/min.
pub(crate) type Circle = (f64, f64);

/// What is run.
#[derive(Debug, Clone)]
pub(crate) struct Workload {
    /// Circles before those that count, in which the servos see the machine that they drive.
    pub warm_up: Vec<Circle>,
    /// Those that count.
    pub circles: Vec<Circle>,
    /// Turns of a circle in each direction.
    pub turns: usize,
    /// Rest at the end, whose last four fifths are watched, in s; 0 for none.
    pub rest_s: f64,
}

/// What a program of circles left, circle by circle, in µm; none where the machine stopped before.
pub(crate) type Left = Vec<Option<f64>>;

/// How it went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Ran {
    /// What it left.
    pub left: Left,
    /// Why the machine stopped, and at which second; none where the program was done.
    pub stopped: Option<String>,
    /// By axis: whether it went to and fro without end at rest.
    pub cycling: Vec<bool>,
}

impl Workload {
    /// The program, and the lines of each circle that counts.
    fn program(&self) -> (String, Vec<Vec<u32>>) {
        let mut text = String::from("G21 G17 G90 G94\n");
        let mut lines = Vec::new();
        for (index, circle) in self.warm_up.iter().chain(&self.circles).enumerate() {
            let of_circle = turns(&mut text, *circle, self.turns);
            if index >= self.warm_up.len() {
                lines.push(of_circle);
            }
        }
        if self.rest_s > 0.0 {
            let _ = writeln!(text, "G4 P{}", self.rest_s);
        }
        text += "M2\n";
        (text, lines)
    }

    /// Runs it.
    ///
    /// # Errors
    /// The program cannot be run on this machine, the plant does not fit it, or `is_over` says so.
    pub fn run(
        &self,
        machine: &Machine,
        plant: &PlantFile,
        is_over: impl Fn() -> bool,
    ) -> Result<Ran, Failure> {
        let (text, lines) = self.program();
        let name = "circles.ngc";
        let path = program::interpret(name, &text, &Setup::of(machine), AxisVector::zeros())
            .map_err(|problem| anyhow::anyhow!("{problem:?}"))
            .input()?;
        let mut analysis = Analysis::new(machine.clone(), path.path);
        let mut cell = InProcessCell::new(machine, plant, name, &text).input()?;
        let mut rest = Rest::of(machine, plant, 0.8 * self.rest_s);
        let (mut scans, mut stopped) = (0_u64, None);
        while let Some(published) = cell.scan() {
            rest.take(published.instruments);
            analysis.take(Sample::Feedback(Box::new(*published.feedback)));
            analysis.take(Sample::Instruments(Box::new(*published.instruments)));
            for command in published.commands {
                analysis.take(Sample::Command(Box::new(*command)));
            }
            scans += 1;
            if scans.is_multiple_of(4096) && is_over() {
                return Err(Failure::Interrupted);
            }
            if published.feedback.mode == Mode::Tripped as u32 {
                let cause = StopCause::of(machine, published.feedback);
                let at_s = scans as f64 * machine.scan_period_s();
                stopped = Some(format!("{cause} at {at_s:.3} s"));
                break;
            }
            if scans as f64 * machine.scan_period_s() > TIME_S_MAX {
                stopped = Some(format!("not done after {TIME_S_MAX} s"));
                break;
            }
        }
        let measured = analysis.finish();
        let completed = measured.is_completed();
        if !completed && stopped.is_none() {
            stopped = Some(format!("{:?}", measured.ended));
        }
        let worst = lines.iter().map(|lines| {
            let of_circle = measured.reversals.iter().filter(|reversal| {
                let line = reversal.block.unwrap_or(0);
                reversal.steady && lines.contains(&line)
            });
            let worst_um = of_circle
                .filter_map(|of| Some(of.protrusion_um?.max(-of.undercut_um?)))
                .fold(0.0, f64::max);
            completed.then_some(to_keep(worst_um))
        });
        Ok(Ran {
            left: worst.collect(),
            cycling: if completed {
                rest.cycling()
            } else {
                Vec::new()
            },
            stopped,
        })
    }
}

/// Turns counter-clockwise and clockwise from 45°; the lines that they stand in.
fn turns(text: &mut String, (radius_mm, feed_mm_min): Circle, turns: usize) -> Vec<u32> {
    let at_mm = radius_mm * libm::cos(0.25 * PI);
    let _ = write!(text, "G0 X{at_mm:.6} Y{at_mm:.6}\nG4 P0.2\n");
    let mut lines = Vec::new();
    for word in ["G3", "G2"] {
        for _ in 0..turns {
            let _ = writeln!(
                text,
                "{word} X{at_mm:.6} Y{at_mm:.6} I{:.6} J{:.6} F{feed_mm_min}",
                -at_mm, -at_mm
            );
            lines.push(text.lines().count() as u32);
        }
        *text += "G4 P0.2\n";
    }
    lines
}

/// Encoder counts that a table must go to and fro by.
const COUNTS: f64 = 3.0;
/// Turnarounds in each half of the time that is watched from which on it goes on.
const TURNAROUNDS: usize = 2;

/// The tables in the last seconds of a run, scan by scan.
#[derive(Debug)]
struct Rest {
    watched_scans: usize,
    /// By axis, in mm.
    threshold_mm: Vec<f64>,
    table_mm: Vec<VecDeque<f64>>,
}

impl Rest {
    fn of(machine: &Machine, plant: &PlantFile, watched_s: f64) -> Rest {
        let threshold_mm = |axis: &machine::Axis| {
            let of_plant = plant.axis(&axis.name);
            COUNTS
                * of_plant.map_or(0.0, |of| {
                    of.screw.lead_mm / f64::from(of.motor.encoder_counts_per_turn)
                })
        };
        Rest {
            watched_scans: (watched_s / machine.scan_period_s()) as usize,
            threshold_mm: machine.axes.iter().map(threshold_mm).collect(),
            table_mm: vec![VecDeque::new(); machine.axes.len()],
        }
    }

    fn take(&mut self, instruments: &Instruments) {
        if self.watched_scans == 0 {
            return;
        }
        let last = instruments.last().unwrap_or(0);
        let tables_mm = instruments.places_mm(last, |axis| &axis.table_mm);
        for (kept, table_mm) in self.table_mm.iter_mut().zip(tables_mm) {
            if kept.len() == self.watched_scans {
                kept.pop_front();
            }
            kept.push_back(table_mm);
        }
    }

    /// By axis: whether its table turned round again and again, to the end.
    fn cycling(&self) -> Vec<bool> {
        let axes = self.table_mm.iter().zip(&self.threshold_mm);
        axes.map(|(kept, threshold_mm)| {
            let middle = kept.len() / 2;
            let halves = [kept.range(..middle), kept.range(middle..)];
            self.watched_scans > 0
                && halves
                    .into_iter()
                    .all(|half| turnarounds(half.copied(), *threshold_mm) >= TURNAROUNDS)
        })
        .collect()
    }
}

/// How often a position turns round and goes back by more than a threshold.
fn turnarounds(positions_mm: impl Iterator<Item = f64>, threshold_mm: f64) -> usize {
    let mut positions_mm = positions_mm.peekable();
    let Some(first_mm) = positions_mm.peek().copied() else {
        return 0;
    };
    // The furthest to either side, until the first direction is known; from then on the furthest in that direction.
    let (mut low_mm, mut high_mm, mut rises) = (first_mm, first_mm, None);
    let mut count = 0;
    for position_mm in positions_mm {
        low_mm = low_mm.min(position_mm);
        high_mm = high_mm.max(position_mm);
        let turns_down = rises != Some(false) && position_mm < high_mm - threshold_mm;
        let turns_up = rises != Some(true) && position_mm > low_mm + threshold_mm;
        if turns_down || turns_up {
            count += usize::from(rises.is_some());
            (low_mm, high_mm, rises) = (position_mm, position_mm, Some(turns_up));
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_turns_round_is_counted_and_what_drifts_or_stands_is_not() {
        let wave = |step: usize| 1e-4 * libm::sin(2.0 * PI * step as f64 / 500.0);
        assert_eq!(turnarounds((0..2000).map(wave), 3e-5), 8);
        assert_eq!(turnarounds((0..2000).map(wave), 3e-4), 0);
        assert_eq!(
            turnarounds((0..2000).map(|step| 1e-6 * step as f64), 3e-5),
            0
        );
        assert_eq!(turnarounds(std::iter::repeat_n(1.0, 2000), 3e-5), 0);
    }
}

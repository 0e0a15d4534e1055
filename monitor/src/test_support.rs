//! A machine for the tests of this crate.

use std::f64::consts::{FRAC_PI_2, TAU};

use bus::sample::*;
use bytemuck::Zeroable;
use machine::Machine;
use path::geometry::{AxisVector, Feed, Path, Shape};

use crate::log::Sample;

/// An axis table of a machine file.
fn axis(name: &str) -> String {
    format!(
        r#"
[[axis]]
name = "{name}"
travel_min_mm = -300.0
travel_max_mm = 300.0
rapid_mm_s = 500.0
acceleration_mm_s2 = 5000.0
quick_stop_mm_s2 = 5000.0
following_error_limit_mm = 2.0
lead_mm = 10.0
motor = {{ rated_torque_nm = 8.0, peak_torque_nm = 32.0 }}
position_loop = {{ gain_per_s = 50.0 }}
velocity_loop = {{ gain_n_s_per_m = 250000.0, integral_time_ms = 10.0, period_us = 250 }}
reversal = {{ method = "friction-pulse", pulse_mm_s = 2.0, pulse_ms = 25.0, lead_ms = 4.0 }}
"#
    )
}

/// A machine file with axes of these names, scan 1 ms.
pub fn machine_text(axes: &[&str]) -> String {
    let head = "name = \"test\"\n[scan]\nperiod_us = 1000\ninterpolation_period_scans = 8\n";
    axes.iter()
        .fold(head.to_string(), |text, name| text + &axis(name))
}

/// The machine of [`machine_text`].
pub fn machine(axes: &[&str]) -> Machine {
    Machine::parse("test machine", &machine_text(axes)).unwrap()
}

/// What the table of a synthetic run does on arcs, besides following the path.
#[derive(Debug, Clone, Copy)]
pub struct Deviation {
    /// Offset of the circle's centre, in mm.
    pub centre_mm: [f64; 2],
    /// Radius error, in mm.
    pub radius_mm: f64,
    /// Height of the bump after the reversals at 0°, 90°, 180° and 270°, in mm.
    pub bump_mm: [f64; 4],
    /// Its centre after the quadrant, in rad of travel.
    pub bump_after_rad: f64,
    /// Its standard deviation, in rad.
    pub bump_sigma_rad: f64,
    /// Scans by which the table is behind the command.
    pub lag_scans: f64,
}

/// A run of a path with exact motion and a table that deviates as given: every element from rest to rest.
pub struct SyntheticRun {
    path: Path,
    period_s: f64,
    deviation: Deviation,
    /// Start, duration and highest speed of each element.
    times: Vec<(f64, f64, f64)>,
    acceleration_mm_s2: f64,
    end_s: f64,
    program_hash: u64,
}

/// Scans before motion begins.
const STANDSTILL_SCANS: u64 = 20;
/// Scans before the reversal at which the synthetic pulse begins, and its length.
pub const PULSE_LEAD_SCANS: u64 = 4;
const PULSE_SCANS: u64 = 25;

impl SyntheticRun {
    pub fn new(path: Path, program_hash: u64, deviation: Deviation) -> Self {
        let (period_s, acceleration_mm_s2) = (1e-3, 2000.0);
        let mut at_s = STANDSTILL_SCANS as f64 * period_s;
        let mut times = Vec::new();
        for element in &path.elements {
            let feed = match element.feed {
                Feed::PathMmS(feed) => feed,
                Feed::Rapid => 200.0,
            };
            let feed = feed.min((element.length_mm * acceleration_mm_s2).sqrt());
            let duration = element.length_mm / feed + feed / acceleration_mm_s2;
            let duration = if element.length_mm > 0.0 {
                duration
            } else {
                0.05
            };
            times.push((at_s, duration, feed));
            at_s += duration;
        }
        SyntheticRun {
            path,
            period_s,
            deviation,
            times,
            acceleration_mm_s2,
            end_s: at_s,
            program_hash,
        }
    }

    pub fn scans(&self) -> u64 {
        (self.end_s / self.period_s) as u64 + 150
    }

    fn place(&self, time_s: f64) -> (usize, f64) {
        let mut index = 0;
        while index + 1 < self.times.len() && time_s >= self.times[index + 1].0 {
            index += 1;
        }
        let (start, duration, feed) = self.times[index];
        let t = (time_s - start).clamp(0.0, duration);
        let ramp = feed / self.acceleration_mm_s2;
        let rest = duration - t;
        let length = self.path.elements[index].length_mm;
        let distance = if t < ramp {
            0.5 * self.acceleration_mm_s2 * t * t
        } else if rest < ramp {
            length - 0.5 * self.acceleration_mm_s2 * rest * rest
        } else {
            feed * (t - 0.5 * ramp)
        };
        (index, distance.clamp(0.0, length))
    }

    fn command(&self, time_s: f64) -> AxisVector {
        let (element, distance) = self.place(time_s);
        self.path.elements[element].point(distance)
    }

    fn table(&self, time_s: f64) -> AxisVector {
        let time_s = time_s - self.deviation.lag_scans * self.period_s;
        let (element, distance) = self.place(time_s);
        let element = &self.path.elements[element];
        let point = element.point(distance);
        let Shape::Arc {
            centre,
            radius_mm,
            u,
            v,
            sweep_rad,
            ..
        } = &element.shape
        else {
            return point;
        };
        let d = &self.deviation;
        let spoke = point - centre;
        let (x, y) = (spoke.dot(u), spoke.dot(v));
        let angle = libm::atan2(y, x);
        let mut bump = 0.0;
        for (quadrant, height) in d.bump_mm.iter().enumerate() {
            let at = quadrant as f64 * FRAC_PI_2;
            let from = sweep_rad.signum() * (angle - at) - d.bump_after_rad;
            let from = from - TAU * (from / TAU).round();
            bump += height * libm::exp(-0.5 * (from / d.bump_sigma_rad).powi(2));
        }
        let radius = radius_mm + d.radius_mm + bump;
        centre
            + u * (d.centre_mm[0] + radius * libm::cos(angle))
            + v * (d.centre_mm[1] + radius * libm::sin(angle))
            + (spoke - u * x - v * y)
    }

    fn increments(&self, time_s: f64) -> [i64; PATH_AXES] {
        let point = self.command(time_s);
        std::array::from_fn(|axis| (point[axis] * 1e6).round() as i64)
    }

    /// Position backlash compensation: 2 µm towards the direction of the command.
    fn backlash_mm(&self, scan: i64, axis: usize) -> f64 {
        let step_mm = self.step_mm(scan as f64 * self.period_s, axis);
        if step_mm < 0.0 { -0.002 } else { 0.002 }
    }

    /// Way of an axis in the scan before this time.
    fn step_mm(&self, at_s: f64, axis: usize) -> f64 {
        self.command(at_s)[axis] - self.command(at_s - self.period_s)[axis]
    }

    /// The feedback of a scan, without what is of its axes.
    fn feedback(&self, scan: u64) -> Feedback {
        let finished = scan + 1 == self.scans();
        let mode = if finished {
            Mode::Finished
        } else {
            Mode::Enabled
        };
        Feedback {
            scan,
            visible_from: scan,
            axis_count: 2,
            mode: mode as u32,
            run: 1,
            ended: match finished {
                true => EndedRun {
                    scan,
                    run: 1,
                    outcome: RunOutcome::Completed as u32,
                    mode: mode as u32,
                    ..EndedRun::default()
                },
                false => EndedRun::default(),
            },
            incarnation: 1,
            program_hash: self.program_hash,
            ..Feedback::zeroed()
        }
    }

    /// All samples of one scan: feedback, commands, instruments.
    pub fn scan(&self, scan: u64) -> Vec<Sample> {
        let time_s = scan as f64 * self.period_s;
        let (element, distance_mm) = self.place(time_s);
        let started = scan >= STANDSTILL_SCANS;
        let tag = PathTag {
            distance_mm,
            element: element as u32,
            dwell_remaining_scans: 0,
        };
        let window = WindowId {
            checksum: 1,
            sequence: 1,
            incarnation: 1,
        };
        let mut feedback = self.feedback(scan);
        if started {
            feedback.window = window;
            feedback.tag = tag;
        }
        let before = self.increments(time_s - self.period_s);
        let position = self.increments(time_s);
        let table = self.table(time_s);
        let mut instruments = Instruments::zeroed();
        instruments.scan = scan;
        instruments.visible_from = scan + 1;
        instruments.motion_digest_low = scan;
        instruments.subsamples = 4;
        instruments.axis_count = 2;
        let mut samples = Vec::new();
        for axis in 0..2 {
            feedback.axes[axis].command_position = before[axis];
            feedback.axes[axis].command_scan = scan.wrapping_sub(1);
            feedback.axes[axis].motor_position = (table[axis] * 1e6) as i64;
            feedback.axes[axis].torque_nm = 1.0;
            feedback.axes[axis].winding_k = 5.0;
            for sub in 0..4 {
                let at = self.table(time_s + (sub + 1) as f64 * self.period_s / 4.0);
                instruments.axes[axis].table_mm[sub] = at[axis];
                // Asked for in the scan before, in force in this one.
                instruments.axes[axis].motor_mm[sub] =
                    at[axis] + self.backlash_mm(scan as i64 - 1, axis);
            }
            let mut command = AxisCommand::zeroed();
            command.scan = scan;
            command.axis = axis as u32;
            command.position = position[axis];
            command.following_error_mm = position[axis] as f64 * 1e-6 - table[axis];
            command.tag = tag;
            command.compensation_mm = self.backlash_mm(scan as i64, axis);
            if started {
                command.held = window;
            }
            // The pulse: wherever the motion turns within the lead, or has turned within its length.
            let step = |at: u64| self.step_mm(at as f64 * self.period_s, axis);
            for turn in scan.saturating_sub(PULSE_SCANS)..=scan + PULSE_LEAD_SCANS {
                let (one, two) = (step(turn), step(turn + 1));
                if turn > STANDSTILL_SCANS && one * two < 0.0 {
                    command.friction_pulse_mm_s = 2.0 * two.signum();
                }
            }
            samples.push(Sample::Command(Box::new(command)));
        }
        samples.insert(0, Sample::Feedback(Box::new(feedback)));
        samples.push(Sample::Instruments(Box::new(instruments)));
        samples
    }

    pub fn samples(&self) -> impl Iterator<Item = Sample> + '_ {
        (0..self.scans()).flat_map(|scan| self.scan(scan))
    }
}

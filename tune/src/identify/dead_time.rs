//! The dead time of a drive, from what was commanded and how the axis moved: docs/methods/dead-time.md.

use machine::DriveMode;

use super::signals::{half, smooth};
use crate::least_squares::{NormalEquations, golden_section};
use crate::recording::Recording;

/// Longest and shortest dead time that is looked for, in scans.
const SCANS_MAX: f64 = 8.75;
const SCANS_MIN: f64 = 0.25;
/// Distance of the dead times that are tried first, in scans.
const GRID_SCANS: f64 = 0.25;
/// Speed from which on an axis slides and friction is that of its direction, as a part of the highest of a recording.
const SLIDING_PART: f64 = 0.2;
/// Signals are smoothed by two running means of this length, in s: what a table on its screw makes of motion, some 100 Hz, is then small.
const SMOOTHING_S: f64 = 6e-3;
/// A minimum tells a dead time if half a scan beside it the squares of what is left are so many times as large.
const SHARP: f64 = 1.05;

/// What is known of the drive of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveClock {
    /// Which loops the drive closes.
    pub mode: DriveMode,
    /// Time by which the speed that it is closed with is older than the encoder, in s.
    pub speed_age_s: f64,
    /// Time by which force lags behind the torque command, in s.
    pub current_loop_s: f64,
}

/// Scans from the feedback that a command answers to the scan that it acts in, with fractions; none where these recordings do not tell.
/// Those of a drive that closes the position loop do not: what it asks of its velocity loop is not recorded.
pub fn scans(recordings: &[&Recording], drive: &DriveClock) -> Option<f64> {
    if drive.mode == DriveMode::Position {
        return None;
    }
    let scan_s = recordings.first()?.scan_s;
    let moves: Vec<Moves> = recordings.iter().map(|of| Moves::new(of, drive)).collect();
    let lag_scans = drive.current_loop_s / scan_s;
    let left = |scans: f64| -> f64 { moves.iter().map(|of| of.left(scans + lag_scans)).sum() };
    let count = ((SCANS_MAX - SCANS_MIN) / GRID_SCANS) as u32;
    let tried = (0..=count).map(|i| SCANS_MIN + GRID_SCANS * f64::from(i));
    let first = tried.min_by(|a, b| left(*a).total_cmp(&left(*b)))?;
    let best = golden_section(first - GRID_SCANS, first + GRID_SCANS, left);
    let least = left(best);
    let is_sharp = [best - 0.5, best + 0.5]
        .map(left)
        .iter()
        .all(|beside| *beside > SHARP * least);
    (is_sharp && least.is_finite() && (SCANS_MIN..=SCANS_MAX).contains(&best)).then_some(best)
}

/// A recording as the equation of its motion takes it: every signal through the same smoothing, which leaves a linear equation true.
struct Moves<'a> {
    mode: DriveMode,
    /// Commands: speed in mm/s, or torque in N·m.
    command: &'a [f64],
    /// Dead time with which they are in step, in scans.
    in_step_scans: f64,
    /// Where the commands of speed would have brought the axis by the start of each scan, in mm.
    commanded_mm: Vec<f64>,
    scan_s: f64,
    /// Acceleration, in mm/s², and its second difference.
    acceleration_mm_s2: Vec<f64>,
    second_difference_mm_s2: Vec<f64>,
    direction: Vec<f64>,
    /// Speed and place that the loop of the drive compares with its command.
    seen_mm_s: Vec<f64>,
    seen_mm: Vec<f64>,
    /// Instants at which the axis slides.
    sliding: Vec<usize>,
}

impl Moves<'_> {
    fn new<'a>(recording: &'a Recording, drive: &DriveClock) -> Moves<'a> {
        let (scan_s, motor_mm) = (recording.scan_s, &recording.motor_mm);
        let smooth = |values: &[f64]| smooth(values, scan_s, SMOOTHING_S);
        let mut place_mm = 0.0;
        let commanded = recording.velocity_command_mm_s.iter().map(|speed_mm_s| {
            place_mm += speed_mm_s * scan_s;
            place_mm - speed_mm_s * scan_s
        });
        let count = motor_mm.len();
        let central = |i: usize| match i {
            0 => 0.0,
            _ if i + 1 >= count => 0.0,
            _ => (motor_mm[i + 1] - motor_mm[i - 1]) / (2.0 * scan_s),
        };
        let central_mm_s: Vec<f64> = (0..count).map(central).collect();
        let bend_mm_s = second_difference(&central_mm_s);
        // A mean over two scans less what it is wider by than a triangle of a scan to either side, which weights acceleration.
        let pairs = central_mm_s.iter().zip(&bend_mm_s);
        let speed_mm_s: Vec<f64> = pairs.map(|(speed, bend)| speed - bend / 12.0).collect();
        let age_scans = match drive.mode {
            DriveMode::Velocity | DriveMode::Position => drive.speed_age_s / scan_s,
            DriveMode::Torque => 0.0,
        };
        // Between two samples a straight line is smoother than the signal by so much of its bend.
        let part = age_scans - age_scans.floor();
        let seen_mm_s: Vec<f64> = (0..count)
            .map(|i| {
                let at = i as f64 - age_scans;
                between(&speed_mm_s, at) - 0.5 * part * (1.0 - part) * between(&bend_mm_s, at)
            })
            .collect();
        let seen_mm: Vec<f64> = (0..count)
            .map(|i| between(motor_mm, i as f64 - age_scans))
            .collect();
        let per_square_s = 1.0 / (scan_s * scan_s);
        let acceleration = second_difference(motor_mm);
        let acceleration: Vec<f64> = acceleration.iter().map(|of| of * per_square_s).collect();
        let acceleration_mm_s2 = smooth(&acceleration);
        let direction: Vec<f64> = speed_mm_s.iter().map(|speed| speed.signum()).collect();
        let fastest_mm_s = speed_mm_s
            .iter()
            .map(|speed| speed.abs())
            .fold(0.0, f64::max);
        let margin = SCANS_MAX as usize + 4 * half(scan_s, SMOOTHING_S);
        let slides = |i: &usize| speed_mm_s[*i].abs() > SLIDING_PART * fastest_mm_s;
        Moves {
            mode: drive.mode,
            command: match drive.mode {
                DriveMode::Velocity | DriveMode::Position => &recording.velocity_command_mm_s,
                DriveMode::Torque => &recording.torque_command_nm,
            },
            in_step_scans: recording.dead_time_scans.into(),
            commanded_mm: commanded.collect(),
            scan_s,
            second_difference_mm_s2: second_difference(&acceleration_mm_s2),
            acceleration_mm_s2,
            direction: smooth(&direction),
            seen_mm_s: smooth(&seen_mm_s),
            seen_mm: smooth(&seen_mm),
            sliding: (margin..count.saturating_sub(margin))
                .filter(slides)
                .collect(),
        }
    }

    /// Sum of the squares of what the equation of motion leaves where force follows commands after so many scans.
    fn left(&self, scans: f64) -> f64 {
        let late_scans = scans - self.in_step_scans;
        let smooth = |values: &[f64]| smooth(values, self.scan_s, SMOOTHING_S);
        let count = self.command.len();
        let command: Vec<f64> = (0..count).map(|i| self.command(i, late_scans)).collect();
        let command = smooth(&command);
        let commanded_mm: Vec<f64> = (0..count)
            .map(|i| between(&self.commanded_mm, i as f64 - late_scans))
            .collect();
        let commanded_mm = smooth(&commanded_mm);
        let mut equations = NormalEquations::new(6);
        for i in self.sliding.iter().copied() {
            let behind_mm = match self.mode {
                DriveMode::Velocity | DriveMode::Position => commanded_mm[i] - self.seen_mm[i],
                DriveMode::Torque => 0.0,
            };
            let row = [
                command[i],
                self.seen_mm_s[i],
                behind_mm,
                self.direction[i],
                self.second_difference_mm_s2[i],
                1.0,
            ];
            equations.add(&row, self.acceleration_mm_s2[i], 1.0);
        }
        self.sliding.len() as f64 * equations.solve(0).residual.powi(2)
    }

    /// Mean of the command around an instant, weighted as the second difference of a position weights acceleration: by a triangle
    /// of a scan to either side. A command is held for a scan.
    fn command(&self, i: usize, late_scans: f64) -> f64 {
        let whole = late_scans.floor();
        let part = late_scans - whole;
        let newest = i as i64 - whole as i64;
        let at = |back: i64| {
            let index = (newest - back).clamp(0, self.command.len() as i64 - 1);
            self.command[index as usize]
        };
        let (first, last) = (0.5 * part * part, 0.5 * (1.0 - part) * (1.0 - part));
        first * at(2) + (1.0 - first - last) * at(1) + last * at(0)
    }
}

/// Second difference of a signal, 0 at its ends.
fn second_difference(values: &[f64]) -> Vec<f64> {
    let inner = values.windows(3).map(|of| of[2] - 2.0 * of[1] + of[0]);
    let mut all: Vec<f64> = [0.0].into_iter().chain(inner).collect();
    all.resize(values.len(), 0.0);
    all
}

/// A signal between its samples.
fn between(values: &[f64], at: f64) -> f64 {
    let last = values.len().saturating_sub(1);
    let low = at.clamp(0.0, last as f64).floor();
    let (here, next) = (low as usize, (low as usize + 1).min(last));
    values[here] + (at - low).clamp(0.0, 1.0) * (values[next] - values[here])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCAN_S: f64 = 1e-3;
    /// So many steps of the simulation make a scan, and a period of the drive.
    const STEPS: u32 = 40;
    const DRIVE_STEPS: u32 = 10;
    const STEP_S: f64 = SCAN_S / STEPS as f64;
    const MASS_KG: f64 = 850.0;
    const GAIN_N_S_PER_M: f64 = 300.0 * MASS_KG;
    const CURRENT_LOOP_S: f64 = 0.16e-3;

    /// Strokes at 100 mm/s and 4000 mm/s², as a speed at a time.
    fn wanted_mm_s(time_s: f64) -> f64 {
        let stroke = (time_s / 0.3).floor();
        let within_s = time_s - 0.3 * stroke;
        let direction = if stroke % 2.0 == 0.0 { 1.0 } else { -1.0 };
        direction * (4000.0 * within_s.min(0.25 - within_s).max(0.0)).min(100.0)
    }

    /// Force of friction on a slide of this speed that is driven with this force.
    fn friction_n(speed_m_s: f64, force_n: f64) -> f64 {
        if speed_m_s == 0.0 {
            return force_n.clamp(-450.0, 450.0);
        }
        450.0 * speed_m_s.signum() + 2600.0 * speed_m_s
    }

    /// A slide whose encoder has this resolution, under a servo that closes the position loop, or both loops, and whose commands act
    /// so many scans late.
    fn strokes(mode: DriveMode, dead_time_scans: f64, resolution_mm: f64) -> Recording {
        let mut recording = Recording {
            scan_s: SCAN_S,
            dead_time_scans: 1,
            ..Recording::default()
        };
        let mut commands = Vec::new();
        let (mut place_m, mut speed_m_s, mut force_n) = (0.0, 0.0f64, 0.0);
        let (mut target_mm, mut before_mm) = (0.0, [0.0; 2]);
        let (mut seen_m, mut integral_m, mut demand_n) = (0.0, 0.0, 0.0);
        for step in 0..3000 * STEPS {
            let scan = step / STEPS;
            if step % STEPS == 0 {
                let wanted_mm_s = wanted_mm_s(f64::from(scan) * SCAN_S);
                // A command answers what the encoder showed a scan ago.
                let asked_mm_s = wanted_mm_s + 30.0 * (target_mm - before_mm[0]);
                let seen_mm_s = (before_mm[0] - before_mm[1]) / SCAN_S;
                let torque_nm = 0.4e-3 * GAIN_N_S_PER_M * (asked_mm_s - seen_mm_s);
                commands.push(match mode {
                    DriveMode::Velocity | DriveMode::Position => asked_mm_s * 1e-3,
                    DriveMode::Torque => torque_nm,
                });
                target_mm += wanted_mm_s * SCAN_S;
                let motor_mm = (place_m * 1e3 / resolution_mm).floor() * resolution_mm;
                before_mm = [motor_mm, before_mm[0]];
                recording.motor_mm.push(motor_mm);
                recording.velocity_command_mm_s.push(asked_mm_s);
                recording.torque_command_nm.push(torque_nm);
            }
            let at = f64::from(step) / f64::from(STEPS) - (dead_time_scans - 1.0);
            let acting = commands.get((at + 1e-9).floor().max(0.0) as usize);
            let command = acting.filter(|_| at >= 0.0).copied().unwrap_or_default();
            if mode == DriveMode::Torque {
                demand_n = command;
            } else if step % DRIVE_STEPS == 0 {
                let period_s = f64::from(DRIVE_STEPS) * STEP_S;
                let seen_m_s = (place_m - std::mem::replace(&mut seen_m, place_m)) / period_s;
                integral_m += (command - seen_m_s) * period_s;
                demand_n = GAIN_N_S_PER_M * (command - seen_m_s + integral_m / 10e-3);
            }
            force_n += (demand_n - force_n) * STEP_S / CURRENT_LOOP_S;
            let pushing_n = force_n - friction_n(speed_m_s, force_n);
            let next_m_s = speed_m_s + pushing_n / MASS_KG * STEP_S;
            speed_m_s = if next_m_s * speed_m_s < 0.0 {
                0.0
            } else {
                next_m_s
            };
            place_m += speed_m_s * STEP_S;
        }
        recording
    }

    fn clock(mode: DriveMode) -> DriveClock {
        DriveClock {
            mode,
            speed_age_s: match mode {
                DriveMode::Velocity | DriveMode::Position => f64::from(DRIVE_STEPS) * STEP_S,
                DriveMode::Torque => 0.0,
            },
            current_loop_s: CURRENT_LOOP_S,
        }
    }

    #[test]
    fn a_dead_time_is_found_with_its_fraction_whoever_closes_the_velocity_loop() {
        for mode in [DriveMode::Velocity, DriveMode::Torque] {
            // With fractions that are whole periods of the drive: it looks at its commands once in each.
            for right in [1.0, 1.25, 2.0, 3.0, 4.5, 7.0] {
                for resolution_mm in [1e-5, 1e-4] {
                    let recording = strokes(mode, right, resolution_mm);
                    let found = scans(&[&recording], &clock(mode));
                    let near = found.is_some_and(|found| (found - right).abs() < 0.15);
                    assert!(near, "{mode:?} {right} at {resolution_mm} mm: {found:?}");
                }
            }
        }
    }

    #[test]
    fn commands_that_were_brought_into_step_by_another_dead_time_change_nothing() {
        let mut recording = strokes(DriveMode::Velocity, 3.0, 1e-5);
        let alone = scans(&[&recording], &clock(DriveMode::Velocity));
        let commands = &mut recording.velocity_command_mm_s;
        commands.rotate_right(2);
        recording.dead_time_scans = 3;
        let shifted = scans(&[&recording], &clock(DriveMode::Velocity));
        let apart = alone.zip(shifted).map(|(a, b)| (a - b).abs());
        assert!(
            apart.is_some_and(|apart| apart < 0.02),
            "{alone:?} {shifted:?}"
        );
    }

    #[test]
    fn an_axis_that_hardly_moves_tells_no_dead_time() {
        let mut recording = strokes(DriveMode::Velocity, 2.0, 1e-5);
        for (i, place) in recording.motor_mm.iter_mut().enumerate() {
            // It creeps, and its encoder is noisy.
            *place = 1e-3 * i as f64 + 1e-3 * (i as f64 * 1.7).sin();
        }
        assert_eq!(scans(&[&recording], &clock(DriveMode::Velocity)), None);
        assert_eq!(scans(&[], &clock(DriveMode::Velocity)), None);
    }
}

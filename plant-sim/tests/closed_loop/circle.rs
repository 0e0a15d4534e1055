//! A circle in a plain position loop, and its measurement as docs/methods/physics.md §5 says. Only for these tests: it shares nothing
//! with the product's own servo and monitor.

use std::f64::consts::{PI, TAU};

use master::{DriveCommand, InstrumentSample};
use plant_sim::axis::AxisSimulation;

const SCAN_S: f64 = 1e-3;
const SAMPLES: usize = 4;
/// Speeding up at the start, in s: the angular speed rises as a smooth step.
const RUN_IN_S: f64 = 0.25;

/// The path: one and a quarter turns counter-clockwise about 0, 0; the last turn is measured.
pub struct Circle {
    pub radius_mm: f64,
    pub feed_mm_min: f64,
    pub start_deg: f64,
}

/// The position loop: `v = Kp·(r − x) + r'`, and one scan of transport delay.
pub struct Loop {
    pub gain_per_s: f64,
    /// Time by which the velocity feed-forward looks ahead, in scans.
    pub feed_forward_scans: f64,
}

impl Loop {
    pub const REFERENCE: Loop = Loop {
        gain_per_s: 50.0,
        feed_forward_scans: 0.0,
    };
}

pub struct Record {
    /// Instrument samples of both axes and their time in s.
    pub table: Vec<(f64, f64, f64)>,
    /// Following error of both axes at each scan, in µm.
    pub following_error_um: Vec<(f64, [f64; 2])>,
}

#[derive(Debug, Clone)]
pub struct Reversal {
    pub protrusion_um: f64,
    pub undercut_um: f64,
}

#[derive(Debug)]
pub struct Fit {
    pub centre_um: [f64; 2],
    pub radius_error_um: f64,
    pub residual_rms_um: f64,
    pub reversals: Vec<Reversal>,
}

impl Circle {
    pub fn speed_rad_s(&self) -> f64 {
        self.feed_mm_min / 60.0 / self.radius_mm
    }

    /// Angle at a time: at rest before 0, smooth run-in, then constant speed.
    fn angle(&self, t_s: f64) -> f64 {
        let u = (t_s / RUN_IN_S).clamp(0.0, 1.0);
        // Integral of the smooth step 3u² − 2u³.
        let in_s = RUN_IN_S * (u * u * u - 0.5 * u * u * u * u);
        self.start_deg.to_radians() + self.speed_rad_s() * (in_s + (t_s - RUN_IN_S).max(0.0))
    }

    fn angular_speed(&self, t_s: f64) -> f64 {
        let u = (t_s / RUN_IN_S).clamp(0.0, 1.0);
        self.speed_rad_s() * u * u * (3.0 - 2.0 * u)
    }

    fn position_mm(&self, t_s: f64) -> [f64; 2] {
        let a = self.angle(t_s);
        let start = self.start_deg.to_radians();
        // Relative to the start, where the axes are.
        [
            self.radius_mm * (a.cos() - start.cos()),
            self.radius_mm * (a.sin() - start.sin()),
        ]
    }

    fn velocity_mm_s(&self, t_s: f64) -> [f64; 2] {
        let a = self.angle(t_s);
        let v = self.radius_mm * self.angular_speed(t_s);
        [-v * a.sin(), v * a.cos()]
    }

    /// Run-in, a quarter turn to settle, one turn to measure.
    fn turn_start_s(&self) -> f64 {
        RUN_IN_S + 0.25 * TAU / self.speed_rad_s()
    }

    fn end_s(&self) -> f64 {
        self.turn_start_s() + TAU / self.speed_rad_s()
    }
}

/// Runs the circle on two axes that are at rest.
pub fn run(x: AxisSimulation, y: AxisSimulation, circle: &Circle, position: &Loop) -> Record {
    let mut axes = [x, y];
    let zero_mm = [axes[0].motor_position_mm(), axes[1].motor_position_mm()];
    let mut acting = [0.0; 2];
    let mut record = Record {
        table: Vec::new(),
        following_error_um: Vec::new(),
    };
    let scans = (circle.end_s() / SCAN_S) as u32;
    let start = circle.start_deg.to_radians();
    let offset = [
        circle.radius_mm * start.cos(),
        circle.radius_mm * start.sin(),
    ];
    for scan in 0..scans {
        let t_s = f64::from(scan) * SCAN_S;
        let target = circle.position_mm(t_s);
        let feed_forward = circle.velocity_mm_s(t_s + position.feed_forward_scans * SCAN_S);
        let mut next = [0.0; 2];
        let mut errors_um = [0.0; 2];
        let mut samples = [[InstrumentSample::default(); SAMPLES]; 2];
        for i in 0..2 {
            let error_mm = target[i] - (axes[i].motor_position_mm() - zero_mm[i]);
            errors_um[i] = error_mm * 1e3;
            next[i] = position.gain_per_s * error_mm + feed_forward[i];
            let command = DriveCommand::Velocity {
                velocity_mm_s: acting[i],
                torque_offset_nm: 0.0,
            };
            axes[i].scan(&command, &mut samples[i]);
        }
        acting = next;
        record.following_error_um.push((t_s, errors_um));
        let [xs, ys] = samples;
        for (place, (x, y)) in xs.iter().zip(&ys).enumerate() {
            let t_s = t_s + SCAN_S * (place + 1) as f64 / SAMPLES as f64;
            record
                .table
                .push((t_s, x.table_mm + offset[0], y.table_mm + offset[1]));
        }
    }
    record
}

/// Signed angle from the nearest quadrant, in rad, and which quadrant.
fn from_quadrant(angle: f64) -> (f64, usize) {
    let quadrant = (angle / (PI / 2.0)).round();
    (
        angle - quadrant * PI / 2.0,
        (quadrant.rem_euclid(4.0)) as usize,
    )
}

impl Record {
    /// Least-squares centre and radius outside the reversal windows; extremes of the residual inside them.
    pub fn measure(&self, circle: &Circle) -> Fit {
        let w = circle.speed_rad_s();
        let before = (6e-3 * w).clamp(2_f64.to_radians(), 12_f64.to_radians());
        let after = (50e-3 * w).clamp(8_f64.to_radians(), 40_f64.to_radians());
        let turn: Vec<(f64, f64, f64)> = self
            .table
            .iter()
            .filter(|(t, _, _)| *t >= circle.turn_start_s())
            .map(|(t, x, y)| (circle.angle(*t), *x, *y))
            .collect();
        let inside = |angle: f64| {
            let (from, _) = from_quadrant(angle);
            from >= -before && from <= after
        };
        // e = dx·cos + dy·sin + dr, normal equations of three unknowns.
        let mut a = [[0.0; 4]; 3];
        for (angle, x, y) in turn.iter().filter(|s| !inside(s.0)) {
            let e = x.hypot(*y) - circle.radius_mm;
            let setpoint = [angle.cos(), angle.sin(), 1.0, e];
            for i in 0..3 {
                for j in 0..4 {
                    a[i][j] += setpoint[i] * setpoint[j];
                }
            }
        }
        for pivot in 0..3 {
            let setpoint = a[pivot].map(|value| value / a[pivot][pivot]);
            for (_, other) in a.iter_mut().enumerate().filter(|(i, _)| *i != pivot) {
                let factor = other[pivot];
                for (value, part) in other.iter_mut().zip(setpoint) {
                    *value -= factor * part;
                }
            }
        }
        let [dx, dy, dr] = [0, 1, 2].map(|i| a[i][3] / a[i][i]);
        let mut reversals: Vec<Reversal> = (0..4)
            .map(|_| Reversal {
                protrusion_um: f64::NEG_INFINITY,
                undercut_um: f64::INFINITY,
            })
            .collect();
        let (mut square, mut count) = (0.0, 0.0);
        for (angle, x, y) in &turn {
            let e = x.hypot(*y) - circle.radius_mm - dx * angle.cos() - dy * angle.sin() - dr;
            if inside(*angle) {
                let reversal = &mut reversals[from_quadrant(*angle).1];
                reversal.protrusion_um = reversal.protrusion_um.max(e * 1e3);
                reversal.undercut_um = reversal.undercut_um.min(e * 1e3);
            } else {
                square += e * e * 1e6;
                count += 1.0;
            }
        }
        Fit {
            centre_um: [dx * 1e3, dy * 1e3],
            radius_error_um: dr * 1e3,
            residual_rms_um: f64::sqrt(square / count),
            reversals,
        }
    }

    /// Largest following error of X and of Y in the measured turn, in µm.
    pub fn following_error_swing_um(&self, circle: &Circle) -> [f64; 2] {
        let mut peak = [0.0_f64; 2];
        for (_, errors) in self
            .following_error_um
            .iter()
            .filter(|(t, _)| *t >= circle.turn_start_s())
        {
            for (peak, error) in peak.iter_mut().zip(errors) {
                *peak = peak.max(error.abs());
            }
        }
        peak
    }
}

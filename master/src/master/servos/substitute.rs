//! Commands of the master's own for an axis whose servo is silent or lost: the axis goes on along the window that every process
//! knows, comes to rest with the others at the window's end, and trips there (docs/developers/architecture.md, "A silent servo").

use bus::sample::AxisCommand;
use loops::velocity_loop::VelocityLoop;
use machine::{Axis, DriveMode, Machine};

use crate::drives::DriveFeedback;

/// Missed scans in a row from which on the master commands the axis; before, its drive holds the last command.
pub(super) const SILENT_SCANS: u32 = 3;

/// Where an axis is to be for one scan, as the motor encoder shows it, in mm, and its speed there, in mm/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    pub position_mm: f64,
    pub velocity_mm_s: f64,
}

/// A position loop without compensation, and in torque mode a proportional velocity loop, from where the servo left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Substitute {
    position_gain_per_s: f64,
    feed_forward: f64,
    rapid_mm_s: f64,
    drive_mode: DriveMode,
    velocity_gain_nm_s_per_mm: f64,
    peak_torque_nm: f64,
    /// In torque mode, while the master commands: the torque that the velocity loop starts from, in N·m.
    base_torque_nm: Option<f64>,
}

impl Substitute {
    pub fn new(machine: &Machine, axis: &Axis) -> Substitute {
        let scan_s = machine.scan_period_s();
        let velocity_loop = VelocityLoop::new(
            axis.velocity_loop.gain_n_s_per_m,
            axis.velocity_loop.integral_time_ms * 1e-3,
            scan_s,
            axis.lead_mm,
            axis.motor.peak_torque_nm,
        );
        Substitute {
            position_gain_per_s: axis.position_loop.gain_per_s,
            feed_forward: if axis.feed_forward.enabled {
                axis.feed_forward.coefficient
            } else {
                0.0
            },
            rapid_mm_s: axis.rapid_mm_s,
            drive_mode: axis.drive_mode,
            velocity_gain_nm_s_per_mm: velocity_loop.gain_nm_s_per_mm,
            peak_torque_nm: axis.motor.peak_torque_nm,
            base_torque_nm: None,
        }
    }

    /// The servo commands again.
    pub fn end(&mut self) {
        self.base_torque_nm = None;
    }

    /// Changes the command in force to that of the next scan: `v = Kp·(s − x) + α·ṡ`; in torque mode
    /// `T = T₀ + Kv·(v − ẋ)`, where T₀ makes the first torque go on from the servo's last.
    pub fn step(&mut self, command: &mut AxisCommand, drive: &DriveFeedback, wanted: Wanted) {
        let before_mm_s = command.velocity_mm_s;
        let now_nm = self.torque_nm(before_mm_s, drive.velocity_mm_s);
        let base_nm = *self
            .base_torque_nm
            .get_or_insert(command.torque_nm - now_nm);
        let fed_mm_s = self.feed_forward * wanted.velocity_mm_s;
        let error_mm = wanted.position_mm - drive.motor_position_mm;
        let velocity_mm_s = self.position_gain_per_s * error_mm + fed_mm_s;
        command.velocity_mm_s = velocity_mm_s.clamp(-self.rapid_mm_s, self.rapid_mm_s);
        if self.drive_mode == DriveMode::Position {
            // What the drive's position loop is not to answer.
            command.feed_forward_mm_s = fed_mm_s;
            command.friction_pulse_mm_s = 0.0;
        }
        if self.drive_mode == DriveMode::Torque {
            let torque_nm = base_nm + self.torque_nm(command.velocity_mm_s, drive.velocity_mm_s);
            command.torque_nm = torque_nm.clamp(-self.peak_torque_nm, self.peak_torque_nm);
        }
    }

    fn torque_nm(&self, command_mm_s: f64, velocity_mm_s: f64) -> f64 {
        self.velocity_gain_nm_s_per_mm * (command_mm_s - velocity_mm_s)
    }
}

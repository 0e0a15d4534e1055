//! Drives without mechanics: an axis has moved by its velocity at the end of the scan, in steps of 10 µm, and stands at once when it
//! is braked.

use master::{DriveCommand, DriveFeedback, DriveState, Drives, InstrumentSample, StateRefused};

use crate::bench::{SCAN_S, STAND_MM};

/// The drives of both axes.
#[derive(Debug, Clone, Default)]
pub struct QuietDrives {
    axes: [(f64, f64); 2],
}

impl QuietDrives {
    /// Position in mm and speed in mm/s of each axis.
    pub fn axes(&self) -> &[(f64, f64); 2] {
        &self.axes
    }
}

impl Drives for QuietDrives {
    fn count(&self) -> usize {
        self.axes.len()
    }

    fn feedback(&self, axis: usize) -> DriveFeedback {
        let (motor_position_mm, velocity_mm_s) = self.axes.get(axis).copied().unwrap_or_default();
        DriveFeedback {
            motor_position_mm,
            velocity_mm_s,
            referenced: true,
            state: DriveState::Ready,
            ..DriveFeedback::default()
        }
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        for ((position_mm, velocity_mm_s), command) in self.axes.iter_mut().zip(commands) {
            let asked_mm_s = match *command {
                DriveCommand::Velocity { velocity_mm_s, .. } => velocity_mm_s,
                _ => 0.0,
            };
            let to = ((*position_mm + asked_mm_s * SCAN_S) / STAND_MM).round() * STAND_MM;
            *velocity_mm_s = (to - *position_mm) / SCAN_S;
            *position_mm = to;
        }
    }

    fn instruments(&self, _axis: usize) -> &[InstrumentSample] {
        &[]
    }

    fn state_bytes(&self) -> usize {
        self.axes.len() * size_of::<f64>()
    }

    fn save(&self, bytes: &mut [u8]) {
        for (slot, (position_mm, _)) in bytes.chunks_mut(size_of::<f64>()).zip(&self.axes) {
            slot.copy_from_slice(&position_mm.to_le_bytes());
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateRefused> {
        for (slot, axis) in bytes.chunks(size_of::<f64>()).zip(&mut self.axes) {
            let position = slot.try_into().map_err(|_| StateRefused)?;
            *axis = (f64::from_le_bytes(position), 0.0);
        }
        Ok(())
    }
}

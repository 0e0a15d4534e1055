//! The simulated drives of a machine, behind the seam that real ones have.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::MAX_SUBSAMPLES;
use master::{DriveCommand, DriveFeedback, DriveState, Drives, InstrumentSample, StateRefused};

use crate::axis::{AxisSimulation, AxisState};

/// Drives, motors and mechanics of all axes.
#[derive(Debug, Clone)]
pub struct SimulatedDrives {
    axes: Vec<SimulatedAxis>,
}

#[derive(Debug, Clone)]
struct SimulatedAxis {
    simulation: AxisSimulation,
    samples: [InstrumentSample; MAX_SUBSAMPLES],
}

impl SimulatedDrives {
    /// These axes.
    pub fn new(simulations: Vec<AxisSimulation>) -> SimulatedDrives {
        let axis = |simulation| SimulatedAxis {
            simulation,
            samples: [InstrumentSample::default(); MAX_SUBSAMPLES],
        };
        SimulatedDrives {
            axes: simulations.into_iter().map(axis).collect(),
        }
    }
}

impl Drives for SimulatedDrives {
    fn count(&self) -> usize {
        self.axes.len()
    }

    fn feedback(&self, axis: usize) -> DriveFeedback {
        let Some(axis) = self.axes.get(axis) else {
            return DriveFeedback {
                state: DriveState::Lost,
                ..DriveFeedback::default()
            };
        };
        let simulation = &axis.simulation;
        DriveFeedback {
            motor_position_mm: simulation.motor_position_mm(),
            scale_position_mm: simulation.scale_position_mm(),
            velocity_mm_s: simulation.velocity_mm_s(),
            torque_nm: simulation.torque_nm(),
            winding_rise_k: simulation.winding_rise_k(),
            torque_limited: simulation.torque_limited(),
            referenced: true,
            state: DriveState::Ready,
        }
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        for (axis, command) in self.axes.iter_mut().zip(commands) {
            axis.simulation.scan(command, &mut axis.samples);
        }
    }

    fn instruments(&self, axis: usize) -> &[InstrumentSample] {
        self.axes.get(axis).map_or(&[], |axis| {
            let count = axis.simulation.settings().samples_per_scan();
            axis.samples.get(..count).unwrap_or(&axis.samples)
        })
    }

    fn state_bytes(&self) -> usize {
        self.axes.len() * size_of::<AxisState>()
    }

    fn save(&self, bytes: &mut [u8]) {
        let slots = bytes.chunks_exact_mut(size_of::<AxisState>());
        for (slot, axis) in slots.zip(&self.axes) {
            slot.copy_from_slice(bytemuck::bytes_of(axis.simulation.state()));
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateRefused> {
        let slots = bytes.chunks_exact(size_of::<AxisState>());
        for (slot, axis) in slots.zip(&mut self.axes) {
            axis.simulation
                .restore(&bytemuck::pod_read_unaligned(slot))?;
            // No command names a deceleration any more: the drive's own quick stop counts.
            axis.simulation.run_down(0.0);
        }
        Ok(())
    }
}

//! The simulated drives of a machine, behind the seam that real ones have.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{Levels, MAX_SUBSAMPLES};
use bytemuck::{Pod, Zeroable};
use master::{
    AuxiliaryFeedback, DriveCommand, DriveFeedback, DriveState, Drives, InstrumentSample,
    StateRefused,
};

use crate::auxiliary::{AuxiliaryState, SimulatedAuxiliaries};
use crate::axis::{AxisSimulation, AxisState};

/// Drives, motors and mechanics of all axes.
#[derive(Debug, Clone)]
pub struct SimulatedDrives {
    axes: Vec<SimulatedAxis>,
    auxiliaries: SimulatedAuxiliaries,
}

#[derive(Debug, Clone)]
struct SimulatedAxis {
    simulation: AxisSimulation,
    samples: [InstrumentSample; MAX_SUBSAMPLES],
    /// It has braked by itself for want of commands, and is off until it is switched on.
    off: bool,
    /// Commands on their way to the drive, the next one first: as many as the dead time is longer than one scan.
    on_the_way: Vec<DriveCommand>,
}

/// A command on its way, as it is saved.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SavedCommand {
    kind: u64,
    values: [f64; 2],
}

impl SimulatedAxis {
    /// The command that acts now, where this one is handed over.
    fn acting(&mut self, command: DriveCommand) -> DriveCommand {
        let Some(next) = self.on_the_way.first().copied() else {
            return command;
        };
        self.on_the_way.rotate_left(1);
        if let Some(last) = self.on_the_way.last_mut() {
            *last = command;
        }
        next
    }

    fn state_bytes(&self) -> usize {
        size_of::<AxisState>() + self.on_the_way.len() * size_of::<SavedCommand>()
    }

    fn save(&self, bytes: &mut [u8]) {
        let Some((state, commands)) = bytes.split_at_mut_checked(size_of::<AxisState>()) else {
            return;
        };
        state.copy_from_slice(bytemuck::bytes_of(self.simulation.state()));
        let slots = commands.chunks_exact_mut(size_of::<SavedCommand>());
        for (slot, command) in slots.zip(&self.on_the_way) {
            let (kind, values) = command.parts();
            slot.copy_from_slice(bytemuck::bytes_of(&SavedCommand { kind, values }));
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateRefused> {
        let (state, commands) = bytes
            .split_at_checked(size_of::<AxisState>())
            .ok_or(StateRefused)?;
        self.simulation
            .restore(&bytemuck::pod_read_unaligned(state))?;
        // What was on its way arrives; after it comes nothing more, and the drive brakes by itself.
        for slot in commands.chunks_exact(size_of::<SavedCommand>()) {
            let saved: SavedCommand = bytemuck::pod_read_unaligned(slot);
            let command = DriveCommand::of_parts(saved.kind, saved.values).ok_or(StateRefused)?;
            self.simulation.scan(&command, &mut self.samples);
        }
        // No command names a deceleration any more: the drive's own quick stop counts.
        self.simulation.run_down(0.0);
        self.on_the_way.fill(DriveCommand::Disabled);
        Ok(())
    }
}

impl SimulatedDrives {
    /// These axes, whose commands act in the scan of their exchange.
    pub fn new(simulations: Vec<AxisSimulation>) -> SimulatedDrives {
        Self::with_dead_time(simulations, 1)
    }

    /// These axes, whose commands act so many scans after the feedback that they answer, at least one.
    pub fn with_dead_time(simulations: Vec<AxisSimulation>, scans: u32) -> SimulatedDrives {
        let axis = |simulation| SimulatedAxis {
            simulation,
            samples: [InstrumentSample::default(); MAX_SUBSAMPLES],
            off: false,
            on_the_way: vec![DriveCommand::Disabled; scans.saturating_sub(1) as usize],
        };
        SimulatedDrives {
            axes: simulations.into_iter().map(axis).collect(),
            auxiliaries: SimulatedAuxiliaries::new(None, None, 1e-3),
        }
    }

    /// The same with spindle, tool changer and outputs.
    pub fn with(self, auxiliaries: SimulatedAuxiliaries) -> SimulatedDrives {
        SimulatedDrives {
            auxiliaries,
            ..self
        }
    }

    /// Spindle, tool changer and outputs.
    pub fn auxiliaries(&self) -> &SimulatedAuxiliaries {
        &self.auxiliaries
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
            state: if axis.off {
                DriveState::Off
            } else {
                DriveState::Ready
            },
        }
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        for (axis, command) in self.axes.iter_mut().zip(commands) {
            let acting = axis.acting(*command);
            axis.off &= *command != DriveCommand::SwitchOn;
            axis.simulation.scan(&acting, &mut axis.samples);
        }
    }

    fn command_levels(&mut self, levels: &Levels) {
        self.auxiliaries.scan(levels);
    }

    fn auxiliary(&self) -> AuxiliaryFeedback {
        self.auxiliaries.feedback()
    }

    fn stalled(&mut self) {
        self.auxiliaries.run_down();
        for axis in &mut self.axes {
            axis.simulation.run_down(0.0);
            axis.on_the_way.fill(DriveCommand::Disabled);
            axis.off = true;
        }
    }

    fn instruments(&self, axis: usize) -> &[InstrumentSample] {
        self.axes.get(axis).map_or(&[], |axis| {
            let count = axis.simulation.settings().samples_per_scan();
            axis.samples.get(..count).unwrap_or(&axis.samples)
        })
    }

    fn state_bytes(&self) -> usize {
        let axes: usize = self.axes.iter().map(SimulatedAxis::state_bytes).sum();
        size_of::<AuxiliaryState>() + axes
    }

    fn save(&self, bytes: &mut [u8]) {
        let Some((state, mut bytes)) = bytes.split_at_mut_checked(size_of::<AuxiliaryState>())
        else {
            return;
        };
        state.copy_from_slice(bytemuck::bytes_of(self.auxiliaries.state()));
        for axis in &self.axes {
            let Some((slot, rest)) = bytes.split_at_mut_checked(axis.state_bytes()) else {
                return;
            };
            axis.save(slot);
            bytes = rest;
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateRefused> {
        let (state, mut bytes) = bytes
            .split_at_checked(size_of::<AuxiliaryState>())
            .ok_or(StateRefused)?;
        let state: AuxiliaryState = bytemuck::pod_read_unaligned(state);
        if !self.auxiliaries.restore(&state) {
            return Err(StateRefused);
        }
        for axis in &mut self.axes {
            let (slot, rest) = bytes
                .split_at_checked(axis.state_bytes())
                .ok_or(StateRefused)?;
            axis.restore(slot)?;
            bytes = rest;
        }
        Ok(())
    }
}

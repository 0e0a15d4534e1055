//! What outlives the machine side: mechanical state and latches, saved each scan into the cell's page, so that a machine
//! side that was killed comes back with the positions its axes really have, and knows where the path was left.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::page::{MACHINE_STATE_BYTES, Page};

use bytemuck::{Pod, Zeroable};

use bus::sample::MAX_AXES;

use crate::axis::{AxisSimulation, AxisState, StateRefused};
use crate::window_book::Left;

/// What the machine side had latched.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Latches {
    /// The scan they are of.
    pub scan: u64,
    /// The motion digest up to then, high and low half.
    pub digest: [u64; 2],
    /// Where the path was left.
    pub left: Left,
    /// Command registers the program was begun from.
    pub program_start: [i64; MAX_AXES],
    /// Override in percent.
    pub override_percent: u32,
    /// Scans overrun so far.
    pub overrun_scans: u32,
    /// 1 if somebody had asked for a stop: the run may end.
    pub may_end: u32,
    /// 1 if the cell was told to end.
    pub ends: u32,
    /// Number of the program that was loaded last.
    pub load: u32,
    /// [`ProgramState`](bus::sample::ProgramState) of it.
    pub program: u32,
    /// Programs started so far.
    pub run: u32,
    /// Kept zero.
    pub reserved: u32,
}

/// A buffer for one state: the latches, then each axis.
#[derive(Debug)]
pub struct SavedMachine {
    latches: Latches,
    axes: Vec<AxisState>,
    bytes: Vec<u8>,
}

impl SavedMachine {
    /// For this many axes.
    pub fn new(axes: usize) -> SavedMachine {
        let bytes = size_of::<Latches>() + axes * size_of::<AxisState>();
        debug_assert!(bytes <= MACHINE_STATE_BYTES);
        SavedMachine {
            latches: Latches::zeroed(),
            axes: vec![bytemuck::Zeroable::zeroed(); axes],
            bytes: vec![0; bytes],
        }
    }

    /// Saves the state after a scan.
    pub fn save<'a>(
        &mut self,
        latches: &Latches,
        simulations: impl Iterator<Item = &'a AxisSimulation>,
        page: &Page,
    ) {
        let (head, tail) = self.bytes.split_at_mut(size_of::<Latches>());
        head.copy_from_slice(bytemuck::bytes_of(latches));
        for (chunk, simulation) in tail
            .chunks_exact_mut(size_of::<AxisState>())
            .zip(simulations)
        {
            chunk.copy_from_slice(bytemuck::bytes_of(simulation.state()));
        }
        page.save_machine_state(&self.bytes);
    }

    /// Reads what was saved last; its latches.
    pub fn load(&mut self, page: &Page) -> Option<Latches> {
        if !page.load_machine_state(&mut self.bytes) {
            return None;
        }
        let (head, tail) = self.bytes.split_at(size_of::<Latches>());
        self.latches = bytemuck::pod_read_unaligned(head);
        for (state, chunk) in self
            .axes
            .iter_mut()
            .zip(tail.chunks_exact(size_of::<AxisState>()))
        {
            *state = bytemuck::pod_read_unaligned(chunk);
        }
        Some(self.latches)
    }

    /// Puts the state that was loaded into the simulations and lets their drives brake to rest by themselves.
    ///
    /// # Errors
    /// The state holds what no machine can have.
    pub fn restore(&self, simulations: &mut [AxisSimulation]) -> Result<(), StateRefused> {
        for (simulation, state) in simulations.iter_mut().zip(&self.axes) {
            simulation.restore(state)?;
            // No command names a deceleration any more: the drive's own quick stop counts.
            simulation.run_down(0.0);
        }
        Ok(())
    }
}

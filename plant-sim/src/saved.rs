//! The mechanical state that outlives the machine side: saved each scan into the cell's page, so that a machine side
//! that was killed comes back with the positions its axes really have.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::page::{MACHINE_STATE_BYTES, Page};

use crate::axis::{AxisSimulation, AxisState, StateRefused};

/// A buffer for one state: the scan, then each axis.
#[derive(Debug)]
pub struct SavedMachine {
    scan: u64,
    axes: Vec<AxisState>,
    bytes: Vec<u8>,
}

impl SavedMachine {
    /// For this many axes.
    pub fn new(axes: usize) -> SavedMachine {
        let bytes = size_of::<u64>() + axes * size_of::<AxisState>();
        debug_assert!(bytes <= MACHINE_STATE_BYTES);
        SavedMachine {
            scan: 0,
            axes: vec![bytemuck::Zeroable::zeroed(); axes],
            bytes: vec![0; bytes],
        }
    }

    /// Saves the state after `scan`.
    pub fn save<'a>(
        &mut self,
        scan: u64,
        simulations: impl Iterator<Item = &'a AxisSimulation>,
        page: &Page,
    ) {
        let (head, tail) = self.bytes.split_at_mut(size_of::<u64>());
        head.copy_from_slice(bytemuck::bytes_of(&scan));
        for (chunk, simulation) in tail
            .chunks_exact_mut(size_of::<AxisState>())
            .zip(simulations)
        {
            chunk.copy_from_slice(bytemuck::bytes_of(simulation.state()));
        }
        page.save_machine_state(&self.bytes);
    }

    /// Reads what was saved last; its scan.
    pub fn load(&mut self, page: &Page) -> Option<u64> {
        if !page.load_machine_state(&mut self.bytes) {
            return None;
        }
        let (head, tail) = self.bytes.split_at(size_of::<u64>());
        self.scan = bytemuck::pod_read_unaligned(head);
        for (state, chunk) in self
            .axes
            .iter_mut()
            .zip(tail.chunks_exact(size_of::<AxisState>()))
        {
            *state = bytemuck::pod_read_unaligned(chunk);
        }
        Some(self.scan)
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

//! What outlives the machine side, as plant-sim/src/saved.rs keeps it in the cell's page.

use plant_sim::axis::{AxisSimulation, AxisState, StateRefused};
use plant_sim::machine_side::MachineSide;
use plant_sim::saved::Latches;

/// Latches and axes after the last scan that was simulated.
#[derive(Debug)]
pub(crate) struct Saved {
    latches: Option<Latches>,
    axes: Vec<AxisState>,
}

impl Saved {
    pub fn nothing() -> Saved {
        Saved {
            latches: None,
            axes: Vec::new(),
        }
    }

    pub fn save(&mut self, side: &MachineSide) {
        self.latches = Some(side.latches());
        self.axes.clear();
        self.axes
            .extend(side.simulations().map(|axis| *axis.state()));
    }

    /// Puts the axes where they were left and lets their drives brake by themselves; the latches, if there are any.
    pub fn restore(
        &self,
        simulations: &mut [AxisSimulation],
    ) -> Result<Option<Latches>, StateRefused> {
        if self.latches.is_some() {
            for (simulation, state) in simulations.iter_mut().zip(&self.axes) {
                simulation.restore(state)?;
                simulation.run_down(0.0);
            }
        }
        Ok(self.latches)
    }
}

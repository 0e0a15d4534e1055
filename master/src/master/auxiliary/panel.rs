//! The operator's switches: optional stop, single block, overrides of rapids and jogs.

use bus::sample::{Inputs, OVERRIDE_MAX_PERCENT, Refused};

use super::Auxiliary;
use crate::master::Beginning;
use crate::master::orders::Refusal;

impl Auxiliary {
    /// What was chosen before the first scan.
    pub fn begin_with(&mut self, beginning: &Beginning) {
        self.latches.single_block = u32::from(beginning.single_block);
        self.latches.start_line = beginning.start_line;
    }

    pub fn switch_optional_stop(&mut self, value: f64) -> Result<(), Refusal> {
        self.latches.optional_stop = switch(value)?;
        Ok(())
    }

    pub fn switch_single_block(&mut self, value: f64) -> Result<(), Refusal> {
        self.latches.single_block = switch(value)?;
        Ok(())
    }

    pub fn override_rapids(&mut self, percent: f64) -> Result<(), Refusal> {
        self.latches.rapid_override_percent = share(percent, 100)?;
        Ok(())
    }

    pub fn override_jogs(&mut self, percent: f64) -> Result<(), Refusal> {
        self.latches.jog_override_percent = share(percent, OVERRIDE_MAX_PERCENT)?;
        Ok(())
    }

    /// Share of their speed that jogs are made at.
    pub fn jog_share(&self) -> f64 {
        f64::from(self.latches.jog_override_percent) / 100.0
    }

    /// What the feedback shows of the switches.
    pub fn panel(&self) -> u32 {
        let latches = &self.latches;
        let overrides = (latches.rapid_override_percent, latches.jog_override_percent);
        Inputs::panel(latches.single_block == 1, overrides)
    }
}

/// The value of an order that is a switch.
fn switch(value: f64) -> Result<u32, Refusal> {
    if value == 0.0 || value == 1.0 {
        Ok(value as u32)
    } else {
        Err(Refused::BadValue.into())
    }
}

/// The value of an order that is an override, in percent.
fn share(percent: f64, most_percent: u32) -> Result<u32, Refusal> {
    if (0.0..=f64::from(most_percent)).contains(&percent) {
        Ok(percent as u32)
    } else {
        Err(Refused::BadValue.into())
    }
}

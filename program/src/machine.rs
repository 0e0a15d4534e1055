//! What the machine file says of programs.

use bus::machine::{AxisKind, Machine};
use control::path::AxisVector;

use crate::program::{AxisSetup, Setup};

impl Setup {
    /// The machine as the interpreter needs to know it.
    pub fn of(machine: &Machine) -> Setup {
        let mut work_offset = AxisVector::zeros();
        for (offset, axis) in work_offset.iter_mut().zip(&machine.axes) {
            *offset = machine
                .program
                .work_offset_mm
                .get(&axis.name)
                .copied()
                .unwrap_or(0.0);
        }
        let axes = machine
            .axes
            .iter()
            .map(|axis| AxisSetup {
                letter: axis.name.chars().next().unwrap_or('?'),
                travel_min: axis.travel_min_mm,
                travel_max: axis.travel_max_mm,
                rotary: axis.kind == AxisKind::Rotary,
            })
            .collect();
        Setup { axes, work_offset }
    }
}

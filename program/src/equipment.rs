//! What a machine has that programs depend on: its setup, and what follows from it once for all blocks.

use std::ops::Deref;
use std::sync::Arc;

use path::geometry::{AxisVector, PATH_AXES, RotaryAxes};

use crate::letters::AXIS_LETTERS;
use crate::program::Setup;
use crate::straight::Axes;

/// The setup of a machine, which it shows to all and lets nobody change.
#[derive(Debug, Clone, Default)]
pub struct Equipment {
    setup: Arc<Setup>,
    /// Which axes turn.
    pub rotary: RotaryAxes,
    /// The axes as blocks of straight motion need them.
    pub straight_axes: Axes,
}

impl Deref for Equipment {
    type Target = Setup;

    fn deref(&self) -> &Setup {
        &self.setup
    }
}

impl Equipment {
    /// The equipment of a machine.
    pub fn of(setup: &Arc<Setup>) -> Self {
        let mut rotary = [false; PATH_AXES];
        for (flag, axis) in rotary.iter_mut().zip(&setup.axes) {
            *flag = axis.rotary;
        }
        Self {
            setup: Arc::clone(setup),
            rotary,
            straight_axes: Axes::of(setup),
        }
    }

    /// The axis of a letter, if it is a slide.
    pub fn slide(&self, letter: char) -> Option<usize> {
        let index = self.axis_index(letter);
        index.filter(|index| self.rotary.get(*index) == Some(&false))
    }

    /// Place of an axis in groups of nine, which are in the order of [`AXIS_LETTERS`].
    pub fn place_in_nine(&self, index: usize) -> Option<usize> {
        AXIS_LETTERS.find(self.setup.axes.get(index)?.letter)
    }

    /// Nine values by letter, by axis.
    pub fn by_axis(&self, nine: &[f64; 9]) -> AxisVector {
        let mut vector = AxisVector::zeros();
        for (index, component) in vector.iter_mut().enumerate() {
            let at = self.place_in_nine(index);
            *component = at.and_then(|at| nine.get(at)).copied().unwrap_or(0.0);
        }
        vector
    }
}

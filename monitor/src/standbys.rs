//! Commands of standbys that say what the servo in force says: once is enough, for the log and for the black box.

use bus::sample::{AxisCommand, MAX_AXES};

/// What was heard of an axis.
#[derive(Debug, Default)]
struct Heard {
    /// What role a said last, once there is a role b: in a scan a comes first.
    of_a: Option<Box<AxisCommand>>,
    has_b: bool,
}

/// What was heard of all axes.
#[derive(Debug, Default)]
pub(crate) struct Standbys([Heard; MAX_AXES]);

impl Standbys {
    /// Takes a command; whether it is that of the axis's other servo in the same scan, to the bit.
    pub(crate) fn repeats(&mut self, axis: usize, command: &AxisCommand) -> bool {
        let Some(heard) = self.0.get_mut(axis) else {
            return false;
        };
        if command.role == 0 {
            if heard.has_b {
                **heard.of_a.get_or_insert_with(|| Box::new(*command)) = *command;
            }
            return false;
        }
        heard.has_b = true;
        let of_a = heard.of_a.as_ref();
        of_a.is_some_and(|of_a| of_a.scan == command.scan && of_a.drives_as(command))
    }
}

//! Which faults are due: by scan, place on the path and reversals counted.

use std::cmp::Ordering;

use super::*;

/// What the triggers of a script have seen so far: fed with every feedback before it is published.
#[derive(Debug, Clone)]
pub struct TriggerState {
    triggers: Vec<Trigger>,
    axes: [AxisTurns; MAX_AXES],
}

/// Reversals of one axis's command.
#[derive(Debug, Clone, Copy, Default)]
struct AxisTurns {
    command_position: Option<i64>,
    /// Of the last motion; none before the first.
    direction: Option<Ordering>,
    reversals: u32,
}

impl AxisTurns {
    fn take(&mut self, command_position: i64) {
        let Some(before) = self.command_position.replace(command_position) else {
            return;
        };
        let direction = command_position.cmp(&before);
        if direction == Ordering::Equal {
            return;
        }
        let last = self.direction.replace(direction);
        if last.is_some_and(|last| last != direction) {
            self.reversals = self.reversals.saturating_add(1);
        }
    }
}

impl TriggerState {
    /// For the triggers of this script, its blocks resolved.
    pub fn new(script: &FaultScript) -> TriggerState {
        TriggerState {
            triggers: script.faults.iter().map(|fault| fault.at).collect(),
            axes: [AxisTurns::default(); MAX_AXES],
        }
    }

    /// Hands `fire` the index of each fault that is due in the scan of this feedback and has not `fired`, in the order of
    /// the script. Each feedback once: reversals are counted from one to the next.
    pub fn due(
        &mut self,
        feedback: &Feedback,
        fired: impl Fn(usize) -> bool,
        mut fire: impl FnMut(usize),
    ) {
        for (turns, axis) in self.axes.iter_mut().zip(feedback.axes()) {
            turns.take(axis.command_position);
        }
        for (index, trigger) in self.triggers.iter().enumerate() {
            if self.holds(*trigger, feedback) && !fired(index) {
                fire(index);
            }
        }
    }

    fn holds(&self, trigger: Trigger, feedback: &Feedback) -> bool {
        match trigger {
            Trigger::Scan(scan) => feedback.scan >= scan,
            Trigger::Block(_) => false,
            Trigger::Element(element) => {
                let on_path = !feedback.window.is_none() && !feedback.tag.is_off_path();
                on_path && feedback.tag.element >= element
            }
            Trigger::Reversal { axis, count } => self
                .axes
                .get(axis)
                .is_some_and(|turns| turns.reversals >= count),
        }
    }
}

//! What a servo remembers from one scan to the next: the states of its blocks, one after the other.
//!
//! Each command carries it as opaque words. Whoever adds a block with a state adds its state here; no sample changes as long
//! as it fits into them (docs/developers/adding.md).

use bus::sample::{AxisCommand, SERVO_STATE_WORDS};
use bytemuck::{Pod, Zeroable};
use loops::backlash::BacklashState;
use loops::dual_feedback::DualFeedbackState;
use loops::feed_forward::PeriodState;
use loops::follow_up::FollowUpState;
use loops::learned_table::LearnedTable;
use loops::reversal::ReversalState;
use loops::velocity_loop::VelocityLoopState;

use crate::compensation::{ModelSettings, ModelState};
use crate::manual::ManualState;

/// All that a command depends on beside the feedback and the windows held.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ServoState {
    /// Scan this state was left in.
    pub scan: u64,
    /// Command position (position command of the scan before, in increments, without compensation) and encoder of the scan before.
    pub program: FollowUpState,
    /// Position command one scan earlier, in increments.
    pub command_position_before: i64,
    /// Velocity estimate of the torque-mode loop, in mm/s.
    pub velocity_mm_s: f64,
    /// Position commands at the ends of the last periods.
    pub period: PeriodState,
    /// Direction of the command, and the compensation of lost motion in force.
    pub backlash: BacklashState,
    /// Friction pulse at the reversals.
    pub reversal: ReversalState,
    /// The scale's share of the position error.
    pub dual_feedback: DualFeedbackState,
    /// The axis's model.
    pub model: ModelState,
    /// Velocity loop of torque mode.
    pub velocity_loop: VelocityLoopState,
    /// The second controller.
    pub manual: ManualState,
    /// 1 once the state has been set from a first feedback.
    pub initialised: u32,
    /// [`Cause`](bus::sample::Cause) of the stop this axis asked for, held until the drives are off or tripped.
    pub cause: u32,
    /// Scans spent with the torque at its limit, in a row.
    pub torque_limited_scans: u32,
    /// Scans in a row for which the program has not moved the axis, and is not about to, as far as they are counted.
    pub resting_scans: u32,
    /// Torque that is fed beside what the model says, in N·m: what the model was off when the axis was last found at rest. The loop's
    /// integrator holds as much against it.
    pub held_torque_nm: f64,
}

const _: () = assert!(
    size_of::<ServoState>() <= SERVO_STATE_WORDS * size_of::<u64>(),
    "the state does not fit into a command: SERVO_STATE_WORDS in bus/src/sample.rs"
);

impl ServoState {
    /// The axis is at rest: its model goes by the torque that holds it. The torque itself does not change.
    pub(crate) fn rest_at(
        &mut self,
        model: &ModelSettings,
        learned: Option<&LearnedTable>,
        torque_nm: f64,
    ) {
        self.held_torque_nm += model.rest_at(&mut self.model, learned, torque_nm);
        if let Some(compensation_mm) = model.compensation_at_rest_mm(&self.model) {
            self.backlash.compensation_mm = compensation_mm;
        }
    }

    /// The state that a command carries.
    pub fn of(command: &AxisCommand) -> ServoState {
        let mut state = ServoState::zeroed();
        let from = bytemuck::bytes_of(&command.state);
        for (byte, from) in bytemuck::bytes_of_mut(&mut state).iter_mut().zip(from) {
            *byte = *from;
        }
        state
    }

    /// Puts it into a command.
    pub fn put_into(&self, command: &mut AxisCommand) {
        let from = bytemuck::bytes_of(self);
        for (byte, from) in bytemuck::cast_slice_mut(&mut command.state)
            .iter_mut()
            .zip(from)
        {
            *byte = *from;
        }
        command.state_words = (size_of::<ServoState>() / size_of::<u64>()) as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_comes_out_of_a_command_as_it_went_in() {
        let mut state = ServoState::zeroed();
        let bytes = bytemuck::bytes_of_mut(&mut state);
        for (index, byte) in bytes.iter_mut().enumerate() {
            *byte = (index * 7 % 251) as u8;
        }
        let mut command = AxisCommand::default();
        state.put_into(&mut command);
        let found = ServoState::of(&command);
        assert_eq!(bytemuck::bytes_of(&found), bytemuck::bytes_of(&state));
        let words = command.state_words as usize;
        assert_eq!(words * size_of::<u64>(), size_of::<ServoState>());
        assert!(command.state.iter().skip(words).all(|word| *word == 0));
    }
}

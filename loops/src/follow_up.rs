//! Follow-up: the position is never lost while the position loop is open.
use bytemuck::{Pod, Zeroable};

/// Keeps a command position true while nobody closes its loop, and lets the loop close again without a jump.
///
/// ```text
/// at opening:  E0 ← E
/// while open:  d = E − E0;  command position ← command position − d;  E ← E − d
/// ```
///
/// The error counter takes in the feedback's increments, so a push by +p makes `E = E0 − p`, `d = −p`, and the command position
/// goes with it by +p. `command position − E` is the encoder, always: after any push the command position is as far from it as it was at
/// the opening. Closing the loop finds the error `E0`, with which the motor stood.
///
/// Source: \[Fanuc-P1\], docs/methods/follow-up.md. Units: increments. Exact; sums saturate at the ends of `i64`.
/// First call: [`FollowUpState::open`]. A scan that is left out is made up by the next: the encoder is absolute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct FollowUpState {
    /// Command position.
    pub command_position: i64,
    /// Encoder of the scan before, whose increments the error counter has taken in.
    pub encoder: i64,
    /// Error counter E.
    pub error: i64,
    /// Steady deviation E0.
    pub steady_deviation: i64,
}

impl FollowUpState {
    /// A loop that is closed: its command position and the encoder now.
    pub fn closed(command_position: i64, encoder: i64) -> FollowUpState {
        FollowUpState {
            command_position,
            error: command_position.saturating_sub(encoder),
            steady_deviation: 0,
            encoder,
        }
    }

    /// Opens the loop: the error is the steady deviation from now on.
    pub fn open(&mut self) {
        self.steady_deviation = self.error;
    }

    /// The error counter takes in what the motor moved; the command position stands.
    pub fn count(&mut self, encoder: i64) {
        let moved = encoder.saturating_sub(self.encoder);
        self.error = self.error.saturating_sub(moved);
        self.encoder = encoder;
    }

    /// One scan with the loop open.
    pub fn follow(&mut self, encoder: i64) {
        self.count(encoder);
        let change = self.error.saturating_sub(self.steady_deviation);
        self.command_position = self.command_position.saturating_sub(change);
        self.error = self.error.saturating_sub(change);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_command_position_follows_by_what_the_motor_was_pushed_and_the_error_stays() {
        let mut state = FollowUpState::closed(1_000, 970);
        state.open();
        for (encoder, command_position) in [(975, 1_005), (975, 1_005), (-30, 0), (970, 1_000)] {
            state.follow(encoder);
            assert_eq!(
                (state.command_position, state.error),
                (command_position, 30)
            );
        }
    }

    #[test]
    fn the_ends_of_the_number_range_do_not_panic() {
        let mut state = FollowUpState::closed(i64::MIN, i64::MAX);
        state.open();
        for encoder in [i64::MIN, i64::MAX, 0] {
            state.follow(encoder);
        }
    }

    proptest! {
        #[test]
        fn after_any_pushing_command_position_and_encoder_agree_to_the_increment_and_closing_steps_by_nothing(
            command_position in -1_000_000_000i64..1_000_000_000,
            error in -2_000_000i64..2_000_000,
            pushes in prop::collection::vec((-3_000_000i64..3_000_000, any::<bool>()), 0..200),
        ) {
            let mut encoder = command_position - error;
            let mut state = FollowUpState::closed(command_position, encoder);
            state.open();
            for (push, seen) in pushes {
                encoder += push;
                // A scan that nobody saw is made up by the next.
                if seen {
                    state.follow(encoder);
                    prop_assert_eq!(state.command_position, encoder + error);
                    prop_assert_eq!(state.error, error);
                }
            }
            state.follow(encoder);
            // Closed at this instant: the loop finds the error it was opened with, at a command position that is true.
            let closed = FollowUpState::closed(state.command_position, encoder);
            prop_assert_eq!(closed.error, error);
            prop_assert_eq!(state.command_position - state.error, encoder);
        }
    }
}

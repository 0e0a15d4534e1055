//! Position backlash compensation and the direction of the command.
use bytemuck::{Pod, Zeroable};

/// Increments the command must go on in the new direction, as far as it is known ahead, before a change of sign is a
/// reversal: a coordinate that ought to be at rest may waver by one increment of rounding.
pub const REVERSAL_TRAVEL_MIN: i64 = 10;

/// Adds half the lost motion in the direction of the command, so that each reversal is a step of the whole.
///
/// `compensation = direction · step/2`. The position is then true on both sides and the machine's zero is the middle of
/// the lost motion; which side holds at power-on nobody knows, so compensation is 0 until the first motion shows it.
/// Source: \[Fanuc\], docs/methods/overview.md §2 ("position backlash compensation, added to the position error at the reversal"). Units:
/// mm and increments. A step of 0 switches it off and still finds the reversals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Backlash {
    /// Lost motion, in mm.
    pub step_mm: f64,
}

/// What [`Backlash`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct BacklashState {
    /// Compensation in force, in mm.
    pub compensation_mm: f64,
    /// Direction of the command: −1, 0 (not moved yet) or 1.
    pub direction: i32,
    /// Kept zero.
    pub reserved: u32,
}

impl Backlash {
    /// Judges one scan; true if the command reversed in it (the first motion is no reversal). `ahead` are the position
    /// commands still known to come, in increments.
    pub fn update(
        &self,
        state: &mut BacklashState,
        before: i64,
        now: i64,
        ahead: impl Iterator<Item = i64>,
    ) -> bool {
        let step = now.saturating_sub(before).signum();
        if step == 0 || step == i64::from(state.direction) {
            return false;
        }
        let goes_on = core::iter::once(now)
            .chain(ahead)
            .any(|p| p.saturating_sub(before).saturating_mul(step) >= REVERSAL_TRAVEL_MIN);
        if !goes_on {
            return false;
        }
        let reversed = state.direction != 0;
        state.direction = if step > 0 { 1 } else { -1 };
        state.compensation_mm = f64::from(state.direction) * self.step_mm / 2.0;
        reversed
    }

    /// Where the axis is now, lost motion is this much more than the step, in mm: `compensation = direction · (step + more)/2`.
    pub fn vary(&self, state: &mut BacklashState, more_mm: f64) {
        state.compensation_mm = f64::from(state.direction) * (self.step_mm + more_mm) / 2.0;
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;

    fn run(positions: &[i64]) -> Vec<(bool, i32, f64)> {
        let backlash = Backlash { step_mm: 0.008 };
        let mut state = BacklashState::default();
        (1..positions.len())
            .map(|i| {
                let ahead = positions[i + 1..].iter().copied();
                let r = backlash.update(&mut state, positions[i - 1], positions[i], ahead);
                (r, state.direction, state.compensation_mm)
            })
            .collect()
    }

    #[test]
    fn the_first_motion_adds_half_and_each_reversal_the_whole_step() {
        let found = run(&[0, 0, 20, 40, 30, 20, 40]);
        assert_eq!(
            found,
            [
                (false, 0, 0.0),
                (false, 1, 0.004),
                (false, 1, 0.004),
                (true, -1, -0.004),
                (false, -1, -0.004),
                (true, 1, 0.004)
            ]
        );
    }

    #[test]
    fn lost_motion_that_differs_by_place_is_compensated_in_the_direction_of_the_command() {
        let backlash = Backlash { step_mm: 0.008 };
        let mut state = BacklashState::default();
        for (direction, compensation_mm) in [(0, 0.0), (1, 0.006), (-1, -0.006)] {
            state.direction = direction;
            backlash.vary(&mut state, 0.004);
            assert!((state.compensation_mm - compensation_mm).abs() < 1e-12);
        }
    }

    #[test]
    fn one_increment_of_rounding_is_no_reversal() {
        let found = run(&[0, 100, 101, 100, 101, 100, 101, 100]);
        assert!(found.iter().all(|f| *f == (false, 1, 0.004)), "{found:?}");
    }

    #[test]
    fn a_slow_reversal_counts_from_its_first_increment() {
        let found = run(&[0, 100, 99, 98, 96, 93, 89]);
        assert_eq!(
            found.iter().map(|f| f.0).collect::<Vec<_>>(),
            [false, true, false, false, false, false]
        );
    }
}

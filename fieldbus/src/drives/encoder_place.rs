//! Where an absolute encoder is: its drive shows a count that begins anew after so many turns, from a zero of its own.

use crate::drive_file::DriveFile;

/// What the machine says of an absolute encoder; of an axis that is homed nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AbsoluteEncoder {
    /// Position of the machine where the drive shows 0, in mm.
    pub zero_mm: f64,
    /// Turns of the motor that the encoder tells apart; none where that are all that the 32 bits of a position hold.
    pub turns: Option<u32>,
    /// Middle of the travel, in mm.
    pub middle_mm: f64,
}

/// The place of an encoder, in increments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct EncoderPlace {
    zero: i64,
    middle: i64,
    /// So many increments further the drive shows the same, at the latest after it was without power.
    range: i64,
}

impl EncoderPlace {
    pub fn of(drive: &DriveFile, encoder: &AbsoluteEncoder, mm_per_increment: f64) -> EncoderPlace {
        let increments = |mm: f64| match mm_per_increment {
            0.0 => 0,
            each => libm::round(mm / each) as i64,
        };
        EncoderPlace {
            zero: increments(encoder.zero_mm),
            middle: increments(encoder.middle_mm),
            range: range(drive, encoder.turns),
        }
    }

    /// The place that the drive shows first, or first after it was without power: of those that it may be the nearest to where it was
    /// last, or to the middle of the travel.
    pub fn place(&self, raw: i32, last: Option<i64>) -> i64 {
        let near = last.unwrap_or(self.middle);
        let ahead = (i64::from(raw) + self.zero - near).rem_euclid(self.range);
        let back = if ahead >= self.range / 2 {
            self.range
        } else {
            0
        };
        near.saturating_add(ahead - back)
    }
}

/// Increments of so many turns of the motor, at most those of 32 bits.
pub fn range(drive: &DriveFile, turns: Option<u32>) -> i64 {
    let scaling = &drive.scaling;
    let per_turn = i64::from(scaling.position_increments);
    let whole = 1 << 32;
    let range =
        turns.map(|turns| i64::from(turns) * per_turn / i64::from(scaling.position_turns.max(1)));
    range.unwrap_or(whole).clamp(2, whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_encoder_of_few_turns_is_at_the_place_within_the_travel_and_after_a_loss_of_power_at_the_nearest()
     {
        let encoder = EncoderPlace {
            zero: -300,
            middle: 2_000,
            range: 4_096,
        };
        assert_eq!(encoder.place(400, None), 100);
        // Shown modulo the range, on either side of its zero.
        assert_eq!(encoder.place(4_090, None), 3_790);
        assert_eq!(encoder.place(-6, None), 3_790);
        assert_eq!(encoder.place(10, Some(3_790)), 3_806);
        // All of 32 bits: what is shown is there, over their ends as well.
        let whole = EncoderPlace {
            zero: 0,
            middle: 0,
            range: 1 << 32,
        };
        for raw in [0, -7, i32::MAX, i32::MIN] {
            assert_eq!(whole.place(raw, None), i64::from(raw));
        }
        let over = i64::from(i32::MAX) + 10;
        assert_eq!(whole.place(i32::MIN + 9, Some(over - 3)), over);
    }
}

//! The place of an absolute encoder: the count of its drive has a zero of its own, and repeats after the turns that the encoder tells
//! apart.

use crate::drive_file::DriveFile;

/// An absolute encoder, as the machine file describes it; the default for an axis that is homed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AbsoluteEncoder {
    /// Position of the machine where the drive shows 0, in mm.
    pub zero_mm: f64,
    /// Turns of the motor that the encoder tells apart; none for all turns that 32 bits of position hold.
    pub turns: Option<u32>,
    /// Middle of the travel, in mm.
    pub middle_mm: f64,
}

/// The place of an encoder, in increments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct EncoderPlace {
    zero: i64,
    middle: i64,
    /// Increments after which the count of the drive repeats, at the latest when the drive gets its power back.
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

    /// The place that the drive shows first, or first after it was without power. Of those that it may be, an encoder of few turns is at
    /// the one nearest to the middle of the travel, which is shorter; another at the nearest to where it was last.
    pub fn place(&self, raw: i32, last: Option<i64>) -> i64 {
        let near = match last {
            Some(last) if self.range == WHOLE => last,
            _ => self.middle,
        };
        near.saturating_add(self.nearest(i64::from(raw) + self.zero - near))
    }

    /// The way from one count that the drive shows to another, over the end of its range or not.
    pub fn step(&self, from: i32, to: i32) -> i64 {
        self.nearest(i64::from(to) - i64::from(from))
    }

    fn nearest(&self, way: i64) -> i64 {
        let ahead = way.rem_euclid(self.range);
        match ahead >= self.range / 2 {
            true => ahead - self.range,
            false => ahead,
        }
    }
}

/// Increments that 32 bits tell apart.
const WHOLE: i64 = 1 << 32;

/// Increments of so many turns of the motor, at most those of 32 bits.
pub fn range(drive: &DriveFile, turns: Option<u32>) -> i64 {
    let scaling = &drive.scaling;
    let per_turn = i64::from(scaling.position_increments);
    let range =
        turns.map(|turns| i64::from(turns) * per_turn / i64::from(scaling.position_turns.max(1)));
    range.unwrap_or(WHOLE).clamp(2, WHOLE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_encoder_of_few_turns_is_within_the_travel_whatever_happened_while_it_was_off() {
        let encoder = EncoderPlace {
            zero: -300,
            middle: 2_000,
            range: 4_096,
        };
        assert_eq!(encoder.place(400, None), 100);
        // Shown modulo the range, on either side of its zero.
        assert_eq!(encoder.place(4_090, None), 3_790);
        assert_eq!(encoder.place(-6, None), 3_790);
        // Pushed further than half its range while it was off, it is within the travel all the same.
        assert_eq!(encoder.place(4_090, Some(100)), 3_790);
        assert_eq!(
            (encoder.step(4_090, 10), encoder.step(10, 4_090)),
            (16, -16)
        );
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

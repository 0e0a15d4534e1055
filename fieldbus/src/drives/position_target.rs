//! The position target of a drive that closes its position loop itself (607A): what it is told, and the way to rest from there.

/// A target, none while the drive follows none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PositionTarget {
    /// In increments.
    at: Option<f64>,
}

impl PositionTarget {
    /// The drive follows no target: the next one begins where it is then.
    pub fn leave(&mut self) {
        self.at = None;
    }

    /// Another target, in increments; what is no number is where the drive is, `actual`.
    pub fn set(&mut self, actual: i64, target: f64) -> i64 {
        self.at = Some(if target.is_finite() {
            target
        } else {
            actual as f64
        });
        self.rounded(actual)
    }

    /// A target that goes on by `step` increments.
    pub fn go_on(&mut self, actual: i64, step: f64) -> i64 {
        let from = self.at.unwrap_or(actual as f64);
        self.set(actual, from + step)
    }

    fn rounded(self, actual: i64) -> i64 {
        self.at.map_or(actual, |at| libm::round(at) as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_add_up_from_where_the_drive_is_and_nothing_is_lost_by_rounding() {
        let mut target = PositionTarget::default();
        let last = (0..1000).map(|_| target.go_on(500, 0.3)).last();
        assert_eq!(last, Some(800));
        assert_eq!(target.set(500, 700.4), 700);
        assert_eq!(target.go_on(500, 0.2), 701);
        target.leave();
        assert_eq!(target.go_on(-7, 0.0), -7);
    }

    #[test]
    fn a_target_that_is_no_number_moves_nothing() {
        let mut target = PositionTarget::default();
        assert_eq!(target.set(40, f64::NAN), 40);
        assert_eq!(target.go_on(40, f64::INFINITY), 40);
        assert_eq!(target.set(40, 1e300), i64::MAX);
    }
}

//! Where a command changes its direction.

/// Finds the reversals of one axis' command, as the report does.
#[derive(Debug, Default, Clone)]
pub struct Turns {
    direction: i64,
    extreme: i64,
    candidate: Option<u64>,
    begun: bool,
    /// Reversals so far.
    pub count: u64,
}

impl Turns {
    /// Takes the position of a scan; once the command has gone `travel` the other way, the first scan in which it went there and
    /// the direction, −1 or 1.
    pub fn take(&mut self, scan: u64, position: i64, travel: i64) -> Option<(u64, i32)> {
        if !std::mem::replace(&mut self.begun, true) {
            self.extreme = position;
            return None;
        }
        let moved = position.saturating_sub(self.extreme);
        let far = moved.saturating_abs() >= travel;
        if self.direction == 0 {
            if far {
                self.direction = moved.signum();
                self.extreme = position;
            }
        } else if moved.saturating_mul(self.direction) >= 0 {
            self.extreme = position;
            self.candidate = None;
        } else {
            let first = *self.candidate.get_or_insert(scan);
            if far {
                self.direction = -self.direction;
                self.extreme = position;
                self.candidate = None;
                self.count += 1;
                return Some((first, self.direction as i32));
            }
        }
        None
    }

    /// Scans are missing: nothing is known of what was before.
    pub fn interrupt(&mut self) {
        *self = Turns {
            count: self.count,
            ..Turns::default()
        };
    }
}

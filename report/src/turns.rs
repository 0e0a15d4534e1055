//! Where a command changes its direction: one rule for the report, the scope and the live view.

/// Travel in the new direction from which a reversal counts, in mm: above the rounding of setpoints, far below
/// anything that friction notices.
const TRAVEL_MM: f64 = 1e-4;

/// The window about a reversal in which its height is measured (docs/methods/physics.md §5), in s before and after it.
pub const WINDOW_S: (f64, f64) = (0.006, 0.050);

/// The same on an arc, in rad: at least and at most so many degrees.
pub fn window_rad(angular_speed_rad_s: f64) -> (f64, f64) {
    let clip = |seconds: f64, low_deg: f64, high_deg: f64| {
        (seconds * angular_speed_rad_s).clamp(low_deg.to_radians(), high_deg.to_radians())
    };
    (clip(WINDOW_S.0, 2.0, 12.0), clip(WINDOW_S.1, 8.0, 40.0))
}

/// Finds the reversals of one axis' command. `T` is what is kept of the first scan in the new direction until the command has
/// gone far enough for a reversal.
#[derive(Debug, Clone)]
pub struct Turns<T> {
    travel: i64,
    direction: i64,
    /// Farthest position in the direction; none before the first one.
    extreme: Option<i64>,
    first: Option<T>,
    /// Reversals so far.
    pub count: u64,
}

impl<T: Copy> Turns<T> {
    /// For an axis of this increment, in mm.
    pub fn new(increment_mm: f64) -> Self {
        Turns {
            travel: (libm::round(TRAVEL_MM / increment_mm) as i64).max(1),
            direction: 0,
            extreme: None,
            first: None,
            count: 0,
        }
    }

    /// Takes the position of a scan. Once the command has gone far enough the other way: what `first` made of the scan in which it
    /// turned and of the new direction, −1 or 1; and that direction.
    pub fn take(&mut self, position: i64, first: impl FnOnce(i32) -> T) -> Option<(T, i32)> {
        let Some(extreme) = self.extreme else {
            self.extreme = Some(position);
            return None;
        };
        let moved = position.saturating_sub(extreme);
        let far = moved.saturating_abs() >= self.travel;
        if self.direction == 0 {
            if far {
                self.direction = moved.signum();
                self.extreme = Some(position);
            }
        } else if moved.saturating_mul(self.direction) >= 0 {
            self.extreme = Some(position);
            self.first = None;
        } else {
            let direction = -self.direction;
            let turned = *self.first.get_or_insert_with(|| first(direction as i32));
            if far {
                self.direction = direction;
                self.extreme = Some(position);
                self.first = None;
                self.count += 1;
                return Some((turned, direction as i32));
            }
        }
        None
    }

    /// Scans are missing: where the axis turned in them nobody knows, so the search starts again.
    pub fn interrupt(&mut self) {
        self.direction = 0;
        self.extreme = None;
        self.first = None;
    }
}

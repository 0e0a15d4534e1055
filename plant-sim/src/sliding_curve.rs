//! Friction in steady sliding as somebody measured it: a table of speed and force, for each direction.

/// Most rows of one direction.
pub const SIDE_ROWS_MAX: usize = 16;

/// A table of sliding friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlidingCurve {
    forward: Side,
    backward: Side,
}

/// The rows of one direction, the slowest first: speed in m/s and force in N, both above 0. Past the last row every row is the last.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Side {
    rows: [(f64, f64); SIDE_ROWS_MAX],
    /// Beyond the fastest row, in N·s/m.
    slope_n_s_per_m: f64,
}

impl Side {
    /// Rows in the order of their speeds; none without any, or with too many.
    fn new(rows: &[(f64, f64)]) -> Option<Side> {
        let last = *rows.last()?;
        let mut side = Side {
            rows: [last; SIDE_ROWS_MAX],
            slope_n_s_per_m: 0.0,
        };
        side.rows.get_mut(..rows.len())?.copy_from_slice(rows);
        if let [.., before, last] = rows {
            side.slope_n_s_per_m = ((last.1 - before.1) / (last.0 - before.0)).max(0.0);
        }
        Some(side)
    }

    /// Friction at a speed, in N.
    fn force_n(&self, speed_m_s: f64) -> f64 {
        let [mut before, ..] = self.rows;
        if speed_m_s <= before.0 {
            return before.1;
        }
        for row in self.rows {
            if speed_m_s < row.0 {
                let part = (speed_m_s - before.0) / (row.0 - before.0);
                return before.1 + part * (row.1 - before.1);
            }
            before = row;
        }
        before.1 + self.slope_n_s_per_m * (speed_m_s - before.0)
    }

    fn scaled(self, part: f64) -> Side {
        Side {
            rows: self.rows.map(|(speed, force)| (speed, part * force)),
            slope_n_s_per_m: part * self.slope_n_s_per_m,
        }
    }
}

impl SlidingCurve {
    /// Of rows of speed in m/s and force in N, in the order of their speeds, both negative in negative direction. None where a direction
    /// has no row or more than [`SIDE_ROWS_MAX`].
    pub fn new(rows: impl Iterator<Item = (f64, f64)>) -> Option<SlidingCurve> {
        let (forward, backward): (Vec<_>, Vec<_>) = rows.partition(|(speed, _)| *speed > 0.0);
        let turned = backward.iter().rev();
        let backward: Vec<_> = turned.map(|(speed, force)| (-speed, -force)).collect();
        Some(SlidingCurve {
            forward: Side::new(&forward)?,
            backward: Side::new(&backward)?,
        })
    }

    /// A part of it.
    pub fn scaled(self, part: f64) -> SlidingCurve {
        SlidingCurve {
            forward: self.forward.scaled(part),
            backward: self.backward.scaled(part),
        }
    }

    /// Friction against a velocity, in N, above 0: by line from row to row; slower than the slowest row as there, faster than the fastest
    /// one on the line through the last two, as far as it rises.
    pub fn force_n(&self, velocity_m_s: f64) -> f64 {
        if velocity_m_s < 0.0 {
            self.backward.force_n(-velocity_m_s)
        } else {
            self.forward.force_n(velocity_m_s)
        }
    }

    /// Friction at the lowest speeds, the mean of both directions, in N.
    pub fn slow_n(&self) -> f64 {
        0.5 * (self.forward.force_n(0.0) + self.backward.force_n(0.0))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn friction_goes_from_row_to_row_of_its_direction() {
        let rows = [
            (-0.1, -50.0),
            (-0.01, -20.0),
            (0.01, 30.0),
            (0.02, 26.0),
            (0.1, 34.0),
        ];
        let curve = SlidingCurve::new(rows.into_iter()).unwrap();
        for (velocity_m_s, expected_n) in [
            (0.0, 30.0),
            (0.015, 28.0),
            (0.06, 30.0),
            (0.2, 44.0),
            (-0.001, 20.0),
            (-0.055, 35.0),
            (-0.1, 50.0),
        ] {
            let force_n = curve.force_n(velocity_m_s);
            assert!(
                (force_n - expected_n).abs() < 1e-9,
                "{velocity_m_s} m/s: {force_n} N"
            );
        }
        assert_eq!(curve.scaled(0.5).slow_n(), 12.5);
        assert!(SlidingCurve::new([(0.1, 5.0)].into_iter()).is_none());
    }
}

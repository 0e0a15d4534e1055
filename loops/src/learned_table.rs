//! What runs before this one have learned about an axis's reversals.
/// Cells of one direction.
pub const CELLS: usize = 64;
/// Distance since the reversal of the last cell, in mm.
pub const DISTANCE_MAX_MM: f64 = 0.4;

/// One cell.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LearnedValue {
    /// Torque that the model lacks, in N·m.
    pub torque_nm: f64,
    /// Lost motion that the model lacks, in mm.
    pub lost_motion_mm: f64,
}

/// Residual torque and lost motion over the distance since the last reversal, for both directions.
///
/// Cell i lies at `d = 0.4 mm·(i/63)²`: fine where friction turns round, coarse where it has. Between cells it is linear; beyond
/// the last that one holds. Source: feedback-error learning (Kawato 1987) over distance, docs/methods/physics.md §4.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedTable {
    /// Friction there is over friction of the model.
    pub friction_scale: f64,
    /// Cells of negative and of positive travel.
    pub directions: [[LearnedValue; CELLS]; 2],
}

impl Default for LearnedTable {
    fn default() -> Self {
        LearnedTable {
            friction_scale: 1.0,
            directions: [[LearnedValue::default(); CELLS]; 2],
        }
    }
}

/// Place of a distance among the cells, 0 to `CELLS − 1`, not rounded.
pub fn cell_of(distance_mm: f64) -> f64 {
    let last = (CELLS - 1) as f64;
    (last * libm::sqrt((distance_mm / DISTANCE_MAX_MM).max(0.0))).min(last)
}

/// Distance of a cell, in mm.
pub fn distance_mm(cell: usize) -> f64 {
    let part = cell as f64 / (CELLS - 1) as f64;
    DISTANCE_MAX_MM * part * part
}

impl LearnedTable {
    /// From columns of cells for negative and positive travel; what a column lacks is 0.
    pub fn from_columns(
        friction_scale: f64,
        torque_nm: [&[f64]; 2],
        lost_motion_um: [&[f64]; 2],
    ) -> LearnedTable {
        let mut table = LearnedTable {
            friction_scale,
            ..LearnedTable::default()
        };
        let columns = torque_nm.into_iter().zip(lost_motion_um);
        for (cells, (torques, lost)) in table.directions.iter_mut().zip(columns) {
            for (cell, (torque_nm, lost_um)) in cells.iter_mut().zip(torques.iter().zip(lost)) {
                cell.torque_nm = *torque_nm;
                cell.lost_motion_mm = lost_um * 1e-3;
            }
        }
        table
    }

    /// What was learned of a distance; nothing where it is not a number.
    pub fn value(&self, positive: bool, distance_mm: f64) -> LearnedValue {
        let [negative, forward] = &self.directions;
        let cells = if positive { forward } else { negative };
        let place = cell_of(distance_mm);
        let low = libm::floor(place);
        let part = place - low;
        let at = |index: usize| cells.get(index).copied().unwrap_or_default();
        let here = at(low as usize);
        let next = at((low as usize + 1).min(CELLS - 1));
        let mix = |a: f64, b: f64| a + (b - a) * part;
        if distance_mm.is_finite() {
            LearnedValue {
                torque_nm: mix(here.torque_nm, next.torque_nm),
                lost_motion_mm: mix(here.lost_motion_mm, next.lost_motion_mm),
            }
        } else {
            LearnedValue::default()
        }
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;

    fn table() -> LearnedTable {
        let torque: Vec<f64> = (0..CELLS).map(|cell| cell as f64).collect();
        let lost = vec![2.0; CELLS];
        let none = vec![0.0; CELLS];
        LearnedTable::from_columns(1.2, [&none, &torque], [&none, &lost])
    }

    #[test]
    fn cells_hold_at_their_distances_linear_between_and_the_last_beyond() {
        let table = table();
        for cell in [0, 1, 17, 63] {
            let value = table.value(true, distance_mm(cell));
            assert!((value.torque_nm - cell as f64).abs() < 1e-9, "{cell}");
            assert!((value.lost_motion_mm - 2e-3).abs() < 1e-12);
        }
        assert_eq!(table.value(true, 7.0).torque_nm, 63.0);
        let middle = table.value(true, DISTANCE_MAX_MM * (17.5 / 63.0) * (17.5 / 63.0));
        assert!((middle.torque_nm - 17.5).abs() < 1e-9);
        assert_eq!(table.value(false, 0.1), LearnedValue::default());
        assert_eq!(table.value(true, f64::NAN), LearnedValue::default());
    }
}

//! The error of a screw: how far a table is from where the turns of its motor say.

use machine::ErrorTable;

/// Error of a screw over the place that its turns say: progressive, periodic and by a table, one on top of the other.
///
/// `e(x) = progressive·x + periodic·sin(2πx/L) + table(x)`, the table by line from point to point and beyond its ends as there (terms of
/// ISO 3408-3). The tool sees it, and a scale; the motor's encoder does not.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PitchError {
    /// For each mm of travel, from 0 on, in mm.
    pub progressive_mm_per_mm: f64,
    /// Amplitude of the periodic error, in mm.
    pub periodic_mm: f64,
    /// Its length, in mm.
    pub periodic_length_mm: f64,
    /// What no formula has.
    pub table: ErrorTable,
}

impl PitchError {
    /// By how much the table is further than the turns say, in mm, where they say this.
    pub fn error_mm(&self, at_mm: f64) -> f64 {
        let turns = at_mm / self.periodic_length_mm;
        let wave = libm::sin(2.0 * std::f64::consts::PI * (turns - libm::floor(turns)));
        self.progressive_mm_per_mm * at_mm + self.periodic_mm * wave + self.table.at_mm(at_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_screw_is_too_long_waves_with_its_turns_and_is_off_by_a_table() {
        let screw = PitchError {
            progressive_mm_per_mm: 5e-5,
            periodic_mm: 2e-3,
            periodic_length_mm: 10.0,
            table: ErrorTable::new(&[0.0, 100.0], [1.0, 3.0].into_iter()),
        };
        for (at_mm, error_um) in [
            (100.0, 8.0),
            (52.5, 2.625 + 2.0 + 2.05),
            (-47.5, -2.375 + 2.0 + 1.0),
            (200.0, 13.0),
        ] {
            let found_um = screw.error_mm(at_mm) * 1e3;
            assert!((found_um - error_um).abs() < 1e-9, "{at_mm}: {found_um}");
        }
    }
}

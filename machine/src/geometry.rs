//! What a laser interferometer and a square find wrong with a machine: errors of screws, squareness and straightness.
//!
//! An error is true position less nominal position, as ISO 230-2 reports it: +5 µm means that the table is 5 µm further in positive
//! direction than the encoder says. The controller adds it to what the encoder says, so all positions that it shows and commands are
//! true ones.

use schemars::JsonSchema;
use serde::Deserialize;

/// The most points of one table.
pub const ERROR_POINTS_MAX: usize = 1000;
/// The most tables of squareness, and of straightness.
pub const GUIDEWAY_ERRORS_MAX: usize = 16;

/// `[axis.compensation]`: the errors of an axis along its own travel, as a laser interferometer measures them. The table is here or in
/// a file.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
pub struct AxisCompensation {
    /// File of the table in place of the lists, a path below the folder of this file: text with a line `position_mm,forward_um` or
    /// `position_mm,forward_um,backward_um` and one line of numbers for each point; of a rotary axis `position_deg,forward_mdeg`.
    #[schemars(extend("default" = ""))]
    pub file: String,
    /// Nominal positions in machine coordinates, ascending: 2 to 1000.
    #[schemars(length(max = ERROR_POINTS_MAX), inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm", "default" = []))]
    pub positions_mm: Vec<f64>,
    /// Error at each of them, true position less nominal one, approached in positive direction. By line from point to point, beyond the
    /// ends as there.
    #[schemars(length(max = ERROR_POINTS_MAX), inner(range(min = -1000, max = 1000)), extend("unit" = "µm", "default" = []))]
    pub forward_um: Vec<f64>,
    /// The same approached in negative direction. Without it the error is the same in both directions. What it is above `forward_um` is
    /// lost motion at that place, beside `reversal.backlash_um`.
    #[schemars(length(max = ERROR_POINTS_MAX), inner(range(min = -1000, max = 1000)), extend("unit" = "µm", "default" = []))]
    pub backward_um: Vec<f64>,
    /// The file that the lists were read from; empty where they are in the machine file.
    #[serde(skip)]
    pub read_from: String,
}

/// `[[squareness]]`: the angle between two axes, of ISO 230-1, that is more or less than a right one.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
pub struct Squareness {
    /// The axis whose line leans.
    pub of: String,
    /// The axis towards which it leans; its positions are corrected.
    pub to: String,
    /// So much of `to` for each metre of `of`, from 0 of `of` on: above 0 the line of `of` leans towards higher positions of `to`.
    #[schemars(extend("unit" = "µm/m", "minimum" = -1000, "maximum" = 1000))]
    pub um_per_m: f64,
}

/// `[[straightness]]`: a guideway that is not straight (ISO 230-1).
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
pub struct Straightness {
    /// The axis that moves along the guideway.
    pub of: String,
    /// The axis in whose direction the guideway is off; its positions are corrected.
    pub to: String,
    /// Nominal positions of `of` in machine coordinates, ascending.
    #[schemars(length(min = 2, max = ERROR_POINTS_MAX), inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm"))]
    pub positions_mm: Vec<f64>,
    /// Error of `to` at each of them, true position less nominal one. By line from point to point, beyond the ends as there.
    #[schemars(length(min = 2, max = ERROR_POINTS_MAX), inner(range(min = -1000, max = 1000)), extend("unit" = "µm"))]
    pub error_um: Vec<f64>,
}

impl AxisCompensation {
    /// The error that does not depend on the direction, the mean of both, over the nominal position.
    pub fn mean(&self) -> ErrorTable {
        let backward = self.backward_um.iter().map(Some);
        let backward = backward.chain(std::iter::repeat(None));
        let both = self.forward_um.iter().zip(backward);
        let mean = both.map(|(forward, backward)| 0.5 * (forward + backward.unwrap_or(forward)));
        ErrorTable::new(&self.positions_mm, mean)
    }

    /// Lost motion over the nominal position, backward less forward; none of a table of one direction.
    pub fn lost_motion(&self) -> Option<ErrorTable> {
        let both = self.backward_um.iter().zip(&self.forward_um);
        let table = ErrorTable::new(&self.positions_mm, both.map(|(back, there)| back - there));
        (!table.points.is_empty()).then_some(table)
    }
}

/// An error over a position, by line from point to point and beyond the ends as there. What is looked up costs one binary search of
/// at most [`ERROR_POINTS_MAX`] points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorTable {
    points: Vec<Point>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Point {
    at_mm: f64,
    error_mm: f64,
}

impl ErrorTable {
    /// Of errors in µm at ascending positions in mm.
    pub fn new(positions_mm: &[f64], errors_um: impl Iterator<Item = f64>) -> ErrorTable {
        let points = positions_mm.iter().zip(errors_um);
        let point = |(at_mm, error_um): (&f64, f64)| Point {
            at_mm: *at_mm,
            error_mm: error_um * 1e-3,
        };
        ErrorTable {
            points: points.map(point).collect(),
        }
    }

    /// Error at a position, in mm; 0 of an empty table, and at a position that is no number.
    pub fn at_mm(&self, place_mm: f64) -> f64 {
        let next = self.points.partition_point(|point| point.at_mm <= place_mm);
        let before = next.checked_sub(1).and_then(|at| self.points.get(at));
        match (before, self.points.get(next)) {
            _ if place_mm.is_nan() => 0.0,
            (Some(from), Some(to)) => {
                let part = (place_mm - from.at_mm) / (to.at_mm - from.at_mm);
                from.error_mm + (to.error_mm - from.error_mm) * part
            }
            (Some(end), None) | (None, Some(end)) => end.error_mm,
            (None, None) => 0.0,
        }
    }

    /// Largest error without its sign, in mm.
    pub fn largest_mm(&self) -> f64 {
        let errors = self.points.iter().map(|point| point.error_mm.abs());
        errors.fold(0.0, f64::max)
    }

    /// First and last position, in mm; none of an empty table.
    pub fn range_mm(&self) -> Option<[f64; 2]> {
        Some([self.points.first()?.at_mm, self.points.last()?.at_mm])
    }

    /// Largest slope without its sign, and largest change of slope at a point, both in mm for each mm; beyond the ends it is level.
    pub fn steepness(&self) -> Steepness {
        let pairs = self.points.windows(2).filter_map(|pair| match pair {
            [from, to] => Some((to.error_mm - from.error_mm) / (to.at_mm - from.at_mm)),
            _ => None,
        });
        let mut found = Steepness::default();
        let mut before = 0.0;
        for slope in pairs.chain(std::iter::once(0.0)) {
            found.slope = found.slope.max(slope.abs());
            found.kink = found.kink.max((slope - before).abs());
            before = slope;
        }
        found
    }
}

/// How steep a table of errors is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Steepness {
    /// Largest slope, in mm for each mm.
    pub slope: f64,
    /// Largest change of slope from one side of a point to the other, in mm for each mm.
    pub kink: f64,
}

/// What positions of one axis are corrected by, over the nominal position of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct GeometryTerm {
    /// Index of the axis whose positions are corrected.
    pub of: usize,
    /// Index of the axis that the error depends on: the same one for errors of its screw or scale.
    pub from: usize,
    /// Error over the nominal position of `from`.
    pub errors: ErrorTable,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> AxisCompensation {
        AxisCompensation {
            positions_mm: vec![0.0, 100.0, 200.0],
            forward_um: vec![0.0, 10.0, 4.0],
            backward_um: vec![2.0, 14.0, 4.0],
            ..AxisCompensation::default()
        }
    }

    #[test]
    fn an_error_is_linear_between_points_and_constant_beyond_the_ends() {
        let mean = table().mean();
        for (place_mm, error_um) in [
            (-50.0, 1.0),
            (0.0, 1.0),
            (50.0, 6.5),
            (100.0, 12.0),
            (150.0, 8.0),
            (200.0, 4.0),
            (1e9, 4.0),
            (f64::NAN, 0.0),
        ] {
            let found_um = mean.at_mm(place_mm) * 1e3;
            assert!((found_um - error_um).abs() < 1e-9, "{place_mm}: {found_um}");
        }
        assert_eq!(mean.range_mm(), Some([0.0, 200.0]));
        assert!((mean.largest_mm() - 0.012).abs() < 1e-12);
        assert_eq!(ErrorTable::default().at_mm(3.0), 0.0);
    }

    #[test]
    fn lost_motion_is_backward_less_forward_and_none_of_one_direction() {
        let lost = table().lost_motion().map(|lost| lost.at_mm(50.0) * 1e3);
        assert!(lost.is_some_and(|lost_um| (lost_um - 3.0).abs() < 1e-9));
        let one_way = AxisCompensation {
            backward_um: vec![],
            ..table()
        };
        assert_eq!(one_way.lost_motion(), None);
        assert!((one_way.mean().at_mm(100.0) - 0.010).abs() < 1e-12);
    }

    #[test]
    fn steepness_counts_the_ends_where_the_error_goes_on_level() {
        let steep = table().mean().steepness();
        assert!((steep.slope - 1.1e-4).abs() < 1e-12, "{steep:?}");
        assert!((steep.kink - 1.9e-4).abs() < 1e-12, "{steep:?}");
    }
}

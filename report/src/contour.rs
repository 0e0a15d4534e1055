//! Contour error: how far the table is from the programmed path.

use bus::sample::PathTag;
use path::geometry::{AxisVector, Element, Path};

/// Elements looked at in each direction at most.
const NEIGHBOURS_MAX: usize = 32;
/// Path looked at beyond the lag of the table, in mm.
const MARGIN_MM: f64 = 0.1;

/// A point and the place of the path that is nearest to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// From that place to the point, in mm: across the path, but beyond its ends.
    pub across_mm: AxisVector,
    /// Direction of the path there; zero at a dwell.
    pub tangent: AxisVector,
}

/// Length of the path before each of its elements, in mm.
pub fn begins_mm(path: &Path) -> Vec<f64> {
    let lengths = path.elements.iter().map(|element| element.length_mm);
    let begins = lengths.scan(0.0, |passed_mm, length_mm| {
        let begins_mm = *passed_mm;
        *passed_mm += length_mm;
        Some(begins_mm)
    });
    begins.collect()
}

/// Distance of `point` from the path near the tag, in mm; none if the tag names no element.
///
/// The table follows its command with a lag, so the closest point may lie on an earlier element: as many neighbours
/// are looked at as the lag can span, and always one on each side.
pub fn error_mm(path: &Path, tag: &PathTag, point: &AxisVector) -> Option<f64> {
    nearest_place(path, tag, point).map(|(_, (_, best_mm))| best_mm)
}

/// The same as a vector; none if the tag names no element.
pub fn nearest(path: &Path, tag: &PathTag, point: &AxisVector) -> Option<Nearest> {
    let (element, (distance_mm, _)) = nearest_place(path, tag, point)?;
    Some(Nearest {
        across_mm: point - element.point(distance_mm),
        tangent: element.tangent(distance_mm),
    })
}

/// The element that is nearest, the distance along it and that of the point from it, in mm.
fn nearest_place<'a>(
    path: &'a Path,
    tag: &PathTag,
    point: &AxisVector,
) -> Option<(&'a Element, (f64, f64))> {
    let here = tag.element as usize;
    let element = path.elements.get(here)?;
    let reach_mm = (element.point(tag.distance_mm) - point).norm() + MARGIN_MM;
    let mut best = (element, element.closest_distance(point));
    let mut offer = |element: &'a Element| {
        let place = element.closest_distance(point);
        // A distance that is no number is never the nearest.
        if place.1 < best.1.1 || best.1.1.is_nan() {
            best = (element, place);
        }
    };
    let mut passed_mm = tag.distance_mm;
    let before = path.elements.get(..here).unwrap_or_default();
    for (count, element) in before.iter().rev().take(NEIGHBOURS_MAX).enumerate() {
        if count > 0 && passed_mm > reach_mm {
            break;
        }
        offer(element);
        passed_mm += element.length_mm;
    }
    let mut passed_mm = element.length_mm - tag.distance_mm;
    let after = path.elements.get(here + 1..).unwrap_or_default();
    for (count, element) in after.iter().take(NEIGHBOURS_MAX).enumerate() {
        if count > 0 && passed_mm > reach_mm {
            break;
        }
        offer(element);
        passed_mm += element.length_mm;
    }
    let (_, (_, best_mm)) = best;
    best_mm.is_finite().then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use path::geometry::Feed;

    fn at(x: f64, y: f64) -> AxisVector {
        let mut point = AxisVector::zeros();
        (point[0], point[1]) = (x, y);
        point
    }

    /// A straight line along X in pieces of 0.05 mm.
    fn pieces(count: u32) -> Path {
        let line = |i: u32| {
            let x = |i: u32| at(f64::from(i) * 0.05, 0.0);
            Element::line(i + 1, x(i), x(i + 1), Feed::Rapid)
        };
        Path {
            elements: (0..count).map(line).collect(),
        }
    }

    #[test]
    fn lag_along_the_path_is_no_contour_error_even_over_many_short_elements() {
        let tag = PathTag {
            element: 50,
            distance_mm: 0.02,
            dwell_remaining_scans: 0,
        };
        let error_mm = error_mm(&pieces(60), &tag, &at(50.0 * 0.05 - 0.8, 0.003)).unwrap();
        assert!((error_mm - 0.003).abs() < 1e-12, "{error_mm}");
    }

    #[test]
    fn a_corner_is_measured_to_the_leg_that_is_closer() {
        let path = Path {
            elements: vec![
                Element::line(1, at(0.0, 0.0), at(10.0, 0.0), Feed::Rapid),
                Element::line(2, at(10.0, 0.0), at(10.0, 10.0), Feed::Rapid),
            ],
        };
        let tag = PathTag {
            element: 1,
            distance_mm: 0.05,
            dwell_remaining_scans: 0,
        };
        let error_mm = error_mm(&path, &tag, &at(9.9, 0.01)).unwrap();
        assert!((error_mm - 0.01).abs() < 1e-12);
        let nowhere = PathTag { element: 9, ..tag };
        assert_eq!(super::error_mm(&path, &nowhere, &at(0.0, 0.0)), None);
    }
}

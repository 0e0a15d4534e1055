//! Where the tool was, with the contour error there: for pictures of the path.
//!
//! Points nearer to each other than a grain are one, with the largest error of them: a trail is as fine as a picture can show.

use path::geometry::AxisVector;

/// Grain where no program says how large its path is, in mm.
const GRAIN_MM: f64 = 0.1;
/// A picture shows no finer parts of the size of its path.
const PARTS: f64 = 700.0;
/// Points between two looks, at most: the oldest are dropped.
const NEW_MAX: usize = 4000;

/// A place where the tool was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrailPoint {
    /// X, Y, Z of the program, in mm.
    pub place_mm: [f64; 3],
    /// Largest distance from the programmed path near it, in µm; none beside the path.
    pub error_um: Option<f64>,
}

/// The trail since the last look.
#[derive(Debug)]
pub struct Trail {
    grain_mm: f64,
    now: Option<TrailPoint>,
    open: Option<TrailPoint>,
    new: Vec<TrailPoint>,
}

impl Default for Trail {
    fn default() -> Self {
        Trail {
            grain_mm: GRAIN_MM,
            now: None,
            open: None,
            new: Vec::new(),
        }
    }
}

impl Trail {
    /// Begins again, on a path that is so large in mm.
    pub fn begin(&mut self, size_mm: Option<f64>) {
        let size_mm = size_mm.filter(|size_mm| size_mm.is_finite() && *size_mm > 0.0);
        *self = Trail {
            grain_mm: size_mm.map_or(GRAIN_MM, |size_mm| size_mm / PARTS),
            now: self.now,
            ..Trail::default()
        };
    }

    /// Takes where the tool was at the end of a scan, and its contour error in µm.
    pub fn take(&mut self, tool_mm: &AxisVector, error_um: Option<f64>) {
        let place_mm = [0, 1, 2].map(|axis| tool_mm.get(axis).copied().unwrap_or(0.0));
        if !place_mm.iter().all(|mm| mm.is_finite()) {
            return;
        }
        let point = TrailPoint {
            place_mm,
            error_um: error_um.filter(|um| um.is_finite()),
        };
        self.now = Some(point);
        let Some(open) = &mut self.open else {
            self.open = Some(point);
            return;
        };
        if distance_mm(&open.place_mm, &place_mm) < self.grain_mm {
            open.error_um = match (open.error_um, point.error_um) {
                (Some(before), Some(now)) => Some(before.max(now)),
                (before, now) => before.or(now),
            };
            return;
        }
        if self.new.len() == NEW_MAX {
            self.new.remove(0);
        }
        self.new.push(*open);
        self.open = Some(point);
    }

    /// Where the tool is.
    pub fn now(&self) -> Option<TrailPoint> {
        self.now
    }

    /// The points since the last call.
    pub fn take_new(&mut self) -> Vec<TrailPoint> {
        std::mem::take(&mut self.new)
    }
}

fn distance_mm(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_within_a_grain_are_one_with_their_largest_error() {
        let mut trail = Trail::default();
        trail.begin(Some(700.0));
        let mut tool_mm = AxisVector::zeros();
        for step in 0..25u32 {
            tool_mm[0] = f64::from(step) * 0.1;
            let error_um = if step == 13 { 7.0 } else { 1.0 };
            trail.take(&tool_mm, Some(error_um));
        }
        let points = trail.take_new();
        let errors: Vec<Option<f64>> = points.iter().map(|point| point.error_um).collect();
        assert_eq!(errors, [Some(1.0), Some(7.0)]);
        assert!((points[1].place_mm[0] - 1.0).abs() < 1e-9);
        assert!(trail.take_new().is_empty());
        let now = trail.now().expect("a place");
        assert!((now.place_mm[0] - 2.4).abs() < 1e-9);
        tool_mm[0] = f64::NAN;
        trail.take(&tool_mm, None);
        assert_eq!(trail.now(), Some(now));
    }
}

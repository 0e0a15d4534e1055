//! The circle that is being travelled, or was last: radial deviation of the table over the angle.

use path::geometry::{AxisVector, Element, Feed, Shape};
use remote::state::CircleState;

use super::state::{round, rounded};

/// Angles that the curve is kept at, per turn.
pub const BINS: usize = 360;
/// Of a circle that begins nothing is shown for so long: the table still comes from the element before.
const SETTLE_S: f64 = 0.1;

/// One circle and what was seen of it.
#[derive(Debug, Default)]
pub struct CircleView {
    /// The circle; none before the first arc.
    pub circle: Option<Circle>,
    /// Deviation at each angle when the tool was there last.
    pub deviation: Vec<Option<Bin>>,
    /// Angle of the last sample, in rad.
    pub angle_rad: Option<f64>,
    /// Whether it is being travelled now.
    pub running: bool,
    since_scan: u64,
    last_scan: Option<u64>,
}

/// What was seen at one angle, outward positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// Mean, in µm.
    pub mean_um: f64,
    /// Lowest, in µm.
    pub low_um: f64,
    /// Highest, in µm.
    pub high_um: f64,
    samples: u32,
    last_scan: u64,
}

impl Bin {
    /// Takes one more sample of the same passage; one of a later passage begins again.
    fn with(before: Option<Bin>, scan: u64, um: f64) -> Bin {
        match before.filter(|bin| bin.last_scan + 1 == scan) {
            Some(bin) => {
                let samples = bin.samples + 1;
                Bin {
                    mean_um: bin.mean_um + (um - bin.mean_um) / f64::from(samples),
                    low_um: bin.low_um.min(um),
                    high_um: bin.high_um.max(um),
                    samples,
                    last_scan: scan,
                }
            }
            None => Bin {
                mean_um: um,
                low_um: um,
                high_um: um,
                samples: 1,
                last_scan: scan,
            },
        }
    }
}

/// A programmed circle.
#[derive(Debug, Clone, PartialEq)]
pub struct Circle {
    /// Letters of its plane: `XY`.
    plane: String,
    radius_mm: f64,
    /// Programmed feed; none for rapid.
    feed_mm_s: Option<f64>,
    /// Line of the program.
    line: u32,
    centre: AxisVector,
    u: AxisVector,
    v: AxisVector,
}

impl Circle {
    fn of(element: &Element) -> Option<Circle> {
        let Shape::Arc {
            centre,
            radius_mm,
            u,
            v,
            ..
        } = &element.shape
        else {
            return None;
        };
        // Which letters: of the coordinates of programs, where the first three are X, Y, Z.
        let letter = |unit: &AxisVector| {
            let axis = unit.iter().position(|part| part.abs() > 0.5).unwrap_or(0);
            ["X", "Y", "Z"].get(axis).copied().unwrap_or("?")
        };
        Some(Circle {
            plane: format!("{}{}", letter(u), letter(v)),
            radius_mm: *radius_mm,
            feed_mm_s: match element.feed {
                Feed::PathMmS(feed_mm_s) => Some(feed_mm_s),
                Feed::Rapid => None,
            },
            line: element.line,
            centre: *centre,
            u: *u,
            v: *v,
        })
    }

    fn is_the_same(&self, other: &Circle) -> bool {
        self.plane == other.plane
            && (self.radius_mm - other.radius_mm).abs() < 1e-6
            && (self.centre - other.centre).norm() < 1e-6
    }

    /// Angle and radial deviation of a place of the tool, in rad and µm.
    fn polar(&self, tool_mm: &AxisVector) -> (f64, f64) {
        let from_centre = tool_mm - self.centre;
        let (x, y) = (from_centre.dot(&self.u), from_centre.dot(&self.v));
        let deviation_um = (libm::hypot(x, y) - self.radius_mm) * 1e3;
        (libm::atan2(y, x), deviation_um)
    }
}

impl CircleView {
    /// Takes where the table had the tool at the end of a scan on this element; its radial deviation in µm once the
    /// motion on the circle has settled.
    pub fn take(
        &mut self,
        scan: u64,
        element: &Element,
        tool_mm: &AxisVector,
        period_s: f64,
    ) -> Option<f64> {
        let Some(now) = Circle::of(element) else {
            self.leave();
            return None;
        };
        let before = self.circle.as_ref();
        let known = before.is_some_and(|before| before.is_the_same(&now));
        let follows = self.last_scan.is_some_and(|last| last + 1 == scan);
        let goes_on = self.running && follows && known;
        if !goes_on {
            self.since_scan = scan;
            if !known {
                self.deviation = vec![None; BINS];
            }
        }
        self.running = true;
        self.last_scan = Some(scan);
        let (angle_rad, deviation_um) = now.polar(tool_mm);
        self.circle = Some(now);
        let settled = (scan - self.since_scan) as f64 * period_s >= SETTLE_S;
        if !settled || !deviation_um.is_finite() {
            return None;
        }
        self.angle_rad = Some(angle_rad);
        let share = angle_rad / std::f64::consts::TAU;
        let bin = (libm::floor((share - libm::floor(share)) * BINS as f64) as usize).min(BINS - 1);
        if let Some(slot) = self.deviation.get_mut(bin) {
            *slot = Some(Bin::with(*slot, scan, deviation_um));
        }
        Some(deviation_um)
    }

    /// The circle is left.
    pub fn leave(&mut self) {
        self.running = false;
        self.last_scan = None;
    }

    /// What is shown of it; none before the first arc.
    pub fn state(&self) -> Option<CircleState> {
        let circle = self.circle.as_ref()?;
        let deviation_um = self.deviation.iter().map(|bin| {
            let um = bin.map(|bin| [bin.low_um, bin.mean_um, bin.high_um]);
            um.map(|um| um.map(|um| rounded(um, 3)))
        });
        Some(CircleState {
            plane: circle.plane.clone(),
            line: circle.line,
            radius_mm: rounded(circle.radius_mm, 6),
            feed_mm_min: round(circle.feed_mm_s.map(|mm_s| mm_s * 60.0), 3),
            running: self.running,
            angle_rad: round(self.angle_rad, 4),
            deviation_um: deviation_um.collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc() -> Element {
        let at = |x: f64, y: f64| {
            let mut place = AxisVector::zeros();
            place[0] = x;
            place[1] = y;
            place
        };
        let sweep = std::f64::consts::TAU;
        Element::arc(
            7,
            at(25.0, 0.0),
            at(25.0, 0.0),
            at(0.0, 0.0),
            [0, 1],
            sweep,
            Feed::PathMmS(50.0),
        )
    }

    #[test]
    fn a_table_two_micrometres_outside_is_shown_as_that_once_the_motion_has_settled() {
        let mut view = CircleView::default();
        let mut seen = Vec::new();
        for scan in 0..400u64 {
            let angle = scan as f64 * 0.01;
            let mut tool = AxisVector::zeros();
            tool[0] = 25.002 * libm::cos(angle);
            tool[1] = 25.002 * libm::sin(angle);
            seen.extend(view.take(scan, &arc(), &tool, 1e-3).map(|um| (scan, um)));
        }
        assert_eq!(seen.first().map(|(scan, _)| *scan), Some(100));
        assert!(seen.iter().all(|(_, um)| (um - 2.0).abs() < 1e-6));
        let (low, high) = view.state().expect("a circle").range_um().expect("a range");
        assert!((low - 2.0).abs() < 1e-6 && (high - 2.0).abs() < 1e-6);
        // 1 rad to 4 rad: from 57° to 228°.
        assert_eq!(view.deviation[40], None);
        assert!(view.deviation[60].is_some());
        assert_eq!(view.deviation[300], None);
    }
}

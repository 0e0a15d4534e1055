//! Polar words: `@` the distance from the zero of the program in the plane XY, `^` the angle in degrees, counter-clockwise
//! from X (LinuxCNC manual, "Polar Coordinates").

use crate::flat::Flat;
use crate::refusal::{Refusal, wrong};

/// A place nearer to the zero has no angle.
const ORIGIN_MM: f64 = 1e-9;

/// The polar words of a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Polar {
    /// `@`, in mm.
    pub radius_mm: Option<f64>,
    /// `^`, in degrees.
    pub angle_deg: Option<f64>,
}

impl Polar {
    /// The place meant, from the place before it, in program coordinates X and Y. A word that is missing stays as it is;
    /// in G91 each word adds. What is wrong and what would be right where the place before has no angle.
    pub fn place(&self, from: Flat, incremental: bool) -> Result<Flat, Refusal> {
        let at_origin = from.length() < ORIGIN_MM;
        if at_origin && (incremental || self.angle_deg.is_none()) {
            let (found, right) = if incremental {
                (
                    "polar words in G91 at X0 Y0",
                    "the zero has no angle to add to: move to a place of X and Y before, or use G90",
                )
            } else {
                (
                    "@ without ^ at X0 Y0",
                    "the zero has no angle to keep: write ^ too",
                )
            };
            return wrong(found, right);
        }
        let (radius_mm, angle_rad) = (from.length(), libm::atan2(from.v, from.u));
        let word_rad = self.angle_deg.map(f64::to_radians);
        let (radius_mm, angle_rad) = if incremental {
            (
                radius_mm + self.radius_mm.unwrap_or(0.0),
                angle_rad + word_rad.unwrap_or(0.0),
            )
        } else {
            (
                self.radius_mm.unwrap_or(radius_mm),
                word_rad.unwrap_or(angle_rad),
            )
        };
        Ok(Flat::new(libm::cos(angle_rad), libm::sin(angle_rad)) * radius_mm)
    }
}

#[cfg(test)]
mod tests {
    //! Expected values are those of LinuxCNC 2.9's interpreter.

    use super::*;

    fn place(
        from: (f64, f64),
        radius_mm: Option<f64>,
        angle_deg: Option<f64>,
        incremental: bool,
    ) -> Result<(f64, f64), String> {
        let polar = Polar {
            radius_mm,
            angle_deg,
        };
        polar
            .place(Flat::new(from.0, from.1), incremental)
            .map(|to| ((to.u * 1e6).round() / 1e6, (to.v * 1e6).round() / 1e6))
            .map_err(|refusal| refusal.found)
    }

    #[test]
    fn words_that_are_missing_keep_their_value() {
        assert_eq!(
            place((1.0, 2.0), Some(10.0), Some(0.0), false),
            Ok((10.0, 0.0))
        );
        assert_eq!(
            place((10.0, 0.0), None, Some(45.0), false),
            Ok((7.071068, 7.071068))
        );
        assert_eq!(
            place((7.071068, 7.071068), Some(5.0), None, false),
            Ok((3.535534, 3.535534))
        );
    }

    #[test]
    fn in_g91_they_add() {
        let from = (4.242_640_687, 4.242_640_687);
        assert_eq!(
            place(from, Some(5.0), Some(10.0), true),
            Ok((6.309341, 9.010672))
        );
    }

    #[test]
    fn the_zero_has_no_angle() {
        assert!(place((0.0, 0.0), Some(5.0), None, false).is_err());
        assert!(place((0.0, 0.0), Some(5.0), Some(5.0), true).is_err());
        assert_eq!(
            place((0.0, 0.0), Some(5.0), Some(90.0), false),
            Ok((0.0, 5.0))
        );
    }
}

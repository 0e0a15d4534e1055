//! The speed map: where along a path how fast it may be travelled and how hard sped up and braked.
//!
//! Limits are judged on setpoints one scan period `Tp` apart. The second difference of setpoints over `Tp²` is the acceleration of
//! the continuous motion averaged under a triangle of half width `Tp` (weight `w(τ) = (1 − |τ|/Tp)/Tp`). So a motion whose
//! continuous acceleration, impulses included, stays within the limit *on that average* stays within it at every scan,
//! wherever the scans fall. Per axis `i`, with tangent `t`, curvature `κ` and path speed `v`:
//!
//! ```text
//! |t_i|·a + |κ_i|·v²                         on lines and arcs
//! v·|Δt_i| · δ(time of crossing)             at a junction where the tangent jumps by Δt
//! ```
//!
//! Where the axes are not the program's (`kinematics`), t and κ are the derivatives of the axes along the path of the tool;
//! their bounds over an element stand for them on the whole of it.
//!
//! How speed and acceleration are shared out between the two is `course`'s business.
//!
//! The map depends on path and limits only. Override scales the feed of its segments (rapids too), never what the axes
//! can bear.

use crate::course::Course;
use crate::limits::MotionLimits;
use crate::path::{AxisVector, Feed, Path, Shape};
use crate::positioning::{Move, Positioning, Profile, rapids};
pub use crate::segment::MapError;
use crate::segment::Segment;

/// Gap between elements that the rounding allowance of the limits covers, in increments.
const GAP_INCREMENTS_MAX: f64 = 0.25;
/// Steps of speed in which the time to brake is added up.
const BRAKING_STEPS: usize = 64;

/// What the map must provide for, besides the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSettings {
    /// Highest override that will be asked for; 1 is the programmed feed.
    pub override_max: f64,
    /// Most setpoints a window has for braking to rest.
    pub braking_setpoints_max: u32,
}

/// Speed limits all along a path.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedMap {
    pub(crate) segments: Vec<Segment>,
    moves: Vec<Move>,
    limited_by_window_mm_s: Option<f64>,
    override_max: f64,
    /// Elements of the path.
    pub(crate) element_count: u32,
}

impl SpeedMap {
    /// Maps a path; takes time and memory in proportion to its elements.
    pub fn new(
        path: &Path,
        limits: &MotionLimits,
        settings: &MapSettings,
    ) -> Result<Self, MapError> {
        Self::with_positioning(path, limits, settings, None)
    }

    /// The same with single rapids from rest to rest at least heat, where `positioning` is given.
    pub fn with_positioning(
        path: &Path,
        limits: &MotionLimits,
        settings: &MapSettings,
        positioning: Option<&Positioning>,
    ) -> Result<Self, MapError> {
        if path.elements.is_empty() {
            return Err(MapError::Empty);
        }
        let Ok(element_count) = u32::try_from(path.elements.len()) else {
            return Err(MapError::TooLong(path.elements.len()));
        };
        let override_max = if settings.override_max > 0.0 {
            settings.override_max.min(1e3)
        } else {
            1.0
        };
        check_geometry(path, limits)?;
        let mut course = Course::new(path, limits, override_max, positioning.is_some())?;
        course.share_among_junctions();
        let mut segments = course.segments(path);
        let limited_by_window_mm_s = limit_to_window(
            &mut segments,
            override_max,
            f64::from(settings.braking_setpoints_max) * limits.scan_period_s(),
        );
        let moves = positioning.map_or_else(Vec::new, |positioning| {
            rapids::assign(path, limits, positioning, override_max, &mut segments)
        });
        Ok(Self {
            segments,
            moves,
            limited_by_window_mm_s,
            override_max,
            element_count,
        })
    }

    /// The path speed above which braking would not fit a window, if the path would have gone faster somewhere.
    pub fn speed_limited_by_window_mm_s(&self) -> Option<f64> {
        self.limited_by_window_mm_s
    }

    /// Highest override it provides for.
    pub fn override_max(&self) -> f64 {
        self.override_max
    }

    /// The rapids that are travelled at least heat, in the order of the path.
    pub fn moves(&self) -> &[Move] {
        &self.moves
    }

    /// The profile that a segment is travelled by, if it is a move of its own.
    pub(crate) fn profile_of(&self, segment: &Segment) -> Option<&Profile> {
        let of_move = self.moves.get(segment.of_move? as usize)?;
        Some(&of_move.profile)
    }

    /// How many pieces of constant limits it has.
    pub fn segment_count(&self) -> usize {
        self.segments.len()
    }

    /// The segment on which the motion from a place goes on: the one that holds the place, the next one at its end.
    /// The number of segments at the end of the path.
    pub(crate) fn segment_at(&self, element: u32, distance_mm: f64) -> usize {
        let before = |segment: &Segment| {
            segment.element < element
                || (segment.element == element && !segment.is_dwell && segment.to_mm <= distance_mm)
        };
        self.segments.partition_point(before)
    }
}

fn check_geometry(path: &Path, limits: &MotionLimits) -> Result<(), MapError> {
    let mut previous_end: Option<AxisVector> = None;
    for element in &path.elements {
        let line = element.line;
        let feed_is_finite = match element.feed {
            Feed::Rapid => true,
            Feed::PathMmS(feed_mm_s) if feed_mm_s <= 0.0 => {
                return Err(MapError::Feed { line, feed_mm_s });
            }
            Feed::PathMmS(feed_mm_s) => feed_mm_s.is_finite(),
        };
        if !(element.shape.is_finite() && element.length_mm.is_finite() && feed_is_finite) {
            return Err(MapError::NotFinite { line });
        }
        let travels = element.end() - element.start();
        if travels
            .iter()
            .skip(limits.axes().len())
            .any(|mm| *mm != 0.0)
        {
            return Err(MapError::NoSuchAxis { line });
        }
        limits.setpoints().kinematics.check_reach(element)?;
        let own_gap = match &element.shape {
            Shape::Arc { .. } => {
                // The circle itself at both ends, not the stored end points that `point` gives there.
                let near = 1e-9 * element.length_mm;
                let inner = |at_mm: f64| element.point(at_mm) - element.tangent(at_mm) * near;
                let start_gap = (inner(near) - element.start()).abs();
                let far_mm = element.length_mm - near;
                let end = element.point(far_mm) + element.tangent(far_mm) * near;
                start_gap.sup(&(end - element.end()).abs())
            }
            _ if element.length_mm <= 0.0 => travels.abs(),
            _ => AxisVector::zeros(),
        };
        let between = previous_end.map_or(own_gap, |end| (element.start() - end).abs());
        for gap in [own_gap, between] {
            let gap = limits.setpoints().kinematics.axes_gap(element, &gap);
            for (gap_mm, axis) in gap.iter().zip(limits.axes()) {
                if *gap_mm > GAP_INCREMENTS_MAX * axis.increment_mm {
                    return Err(MapError::Gap {
                        line,
                        gap_mm: gap.norm(),
                    });
                }
            }
        }
        previous_end = Some(element.end());
    }
    Ok(())
}

/// Caps speeds so that braking to rest takes at most `braking_time_s` from anywhere. Gives the cap if it bites.
///
/// While braking, the speed `w` is passed on a segment whose cap is at least `w`; so with `A(w)` the least acceleration of
/// all those, braking from `v` takes at most ∫₀ᵛ dw/A(w).
fn limit_to_window(
    segments: &mut [Segment],
    override_max: f64,
    braking_time_s: f64,
) -> Option<f64> {
    let fastest_mm_s = segments
        .iter()
        .map(|segment| segment.cap_mm_s(override_max))
        .fold(0.0, f64::max);
    if fastest_mm_s <= 0.0 {
        return None;
    }
    let step_mm_s = fastest_mm_s / BRAKING_STEPS as f64;
    let mut least_mm_s2 = [f64::INFINITY; BRAKING_STEPS];
    for segment in segments.iter().filter(|segment| !segment.is_dwell) {
        let top_step = libm::floor(segment.cap_mm_s(override_max) / step_mm_s) as usize;
        if let Some(least) = least_mm_s2.get_mut(top_step.min(BRAKING_STEPS - 1)) {
            *least = least.min(segment.acceleration_mm_s2);
        }
    }
    let mut least_above = f64::INFINITY;
    for least in least_mm_s2.iter_mut().rev() {
        least_above = least_above.min(*least);
        *least = least_above;
    }
    let (mut time_s, mut speed_mm_s) = (0.0, 0.0);
    for least in least_mm_s2 {
        let step_time_s = step_mm_s / least;
        if time_s + step_time_s > braking_time_s {
            speed_mm_s += (braking_time_s - time_s) * least;
            for segment in segments.iter_mut() {
                segment.speed_mm_s = segment.speed_mm_s.min(speed_mm_s);
            }
            return Some(speed_mm_s);
        }
        time_s += step_time_s;
        speed_mm_s += step_mm_s;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::AxisLimits;
    use crate::path::Element;

    const FEED: Feed = Feed::PathMmS(1000.0);
    const SETTINGS: MapSettings = MapSettings {
        override_max: 1.0,
        braking_setpoints_max: 100_000,
    };

    fn limits() -> MotionLimits {
        let slide = AxisLimits {
            velocity_mm_s: 300.0,
            acceleration_mm_s2: 2000.0,
            increment_mm: 1e-9,
        };
        MotionLimits::new(&[slide; 2], 1e-3).unwrap()
    }

    fn at(x: f64, y: f64) -> AxisVector {
        let mut vector = AxisVector::zeros();
        vector[0] = x;
        vector[1] = y;
        vector
    }

    fn map(elements: Vec<Element>) -> Result<SpeedMap, MapError> {
        SpeedMap::new(&Path { elements }, &limits(), &SETTINGS)
    }

    #[test]
    fn an_arc_leaves_three_fifths_of_the_acceleration_for_changes_of_speed() {
        let turn_rad = std::f64::consts::TAU;
        let map = map(vec![Element::arc(
            1,
            at(10.0, 0.0),
            at(10.0, 0.0),
            at(0.0, 0.0),
            [0, 1],
            turn_rad,
            FEED,
        )])
        .unwrap();
        let [segment] = map.segments.as_slice() else {
            panic!("{map:?}")
        };
        assert!((segment.speed_mm_s - 126.49).abs() < 0.01, "{segment:?}");
        assert!(
            (segment.acceleration_mm_s2 - 1200.0).abs() < 0.1,
            "{segment:?}"
        );
    }

    #[test]
    fn a_diagonal_is_faster_than_its_axes() {
        let map = map(vec![Element::line(1, at(0.0, 0.0), at(30.0, 30.0), FEED)]).unwrap();
        let segment = map.segments[0];
        assert!((segment.speed_mm_s - 300.0 * 2f64.sqrt()).abs() < 0.01);
        assert!((segment.acceleration_mm_s2 - 2000.0 * 2f64.sqrt()).abs() < 0.1);
    }

    #[test]
    fn a_square_corner_is_crossed_at_its_share_and_a_line_through_points_at_full_speed() {
        let corner = [at(0.0, 0.0), at(30.0, 0.0), at(30.0, 30.0)];
        let straight = [at(0.0, 0.0), at(30.0, 0.0), at(60.0, 0.0)];
        let slowest = |points: [AxisVector; 3]| {
            let [a, b, c] = points;
            let map = map(vec![
                Element::line(1, a, b, FEED),
                Element::line(2, b, c, FEED),
            ])
            .unwrap();
            let speeds = map.segments.iter().map(|segment| segment.speed_mm_s);
            speeds.fold(f64::INFINITY, f64::min)
        };
        // One scan sees ρ·v/Tp of a unit kink and may see 70 % of 2000 mm/s².
        assert!((slowest(corner) - 0.7 * 2000.0 * 1e-3 * 0.9375).abs() < 1e-4);
        assert!((slowest(straight) - 300.0).abs() < 1e-3);
    }

    #[test]
    fn what_cannot_be_travelled_is_refused_with_its_line() {
        let line = |from, to, feed| Element::line(7, from, to, feed);
        let (a, b) = (at(0.0, 0.0), at(5.0, 0.0));
        let mut third = b;
        third[2] = 1.0;
        assert_eq!(map(vec![]), Err(MapError::Empty));
        let off_the_circle = Element::arc(
            7,
            b,
            at(0.0, 5.1),
            a,
            [0, 1],
            std::f64::consts::FRAC_PI_2,
            FEED,
        );
        assert!(matches!(
            map(vec![off_the_circle]),
            Err(MapError::Gap { line: 7, .. })
        ));
        let broken = vec![line(a, b, FEED), line(at(5.0, 1e-3), a, FEED)];
        assert!(matches!(map(broken), Err(MapError::Gap { line: 7, .. })));
        assert_eq!(
            map(vec![line(a, third, FEED)]),
            Err(MapError::NoSuchAxis { line: 7 })
        );
        let no_feed = Feed::PathMmS(0.0);
        assert!(matches!(
            map(vec![line(a, b, no_feed)]),
            Err(MapError::Feed { line: 7, .. })
        ));
        for feed in [Feed::PathMmS(f64::NAN), Feed::PathMmS(f64::INFINITY)] {
            assert_eq!(
                map(vec![line(a, b, feed)]),
                Err(MapError::NotFinite { line: 7 })
            );
        }
    }
}

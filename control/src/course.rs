//! A path laid out in one line: what the axes bear on each element, and the zones around its junctions.
//!
//! **Junctions.** The average over one scan to either side, under a triangle (see `speed_map`), sees a crossing as up to `J = v·|Δt_i|/Tp`. Each junction has a zone: as long as the path is
//! within `h·v·Tp` of it, speed is capped at the junction's `v` and `ρ·J` of each axis' acceleration is reserved for the
//! crossing. A box of height `ρ·J` and half width `h·Tp`, seen through the triangle, covers the triangle `J·(1 − |τ|/Tp)` at
//! every offset τ when `ρ = 1/(2h − h²)`: at τ = 0 with equality, elsewhere because the triangle is concave only there.
//! Averages add, so zones may overlap: reservations are summed, and a contour of many small kinks is treated as the
//! curvature it stands for, up to the factor `2hρ` = 1.6. No zone knows of the others' order or of scan instants.
//!
//! **Arcs** use at most `CENTRIPETAL_SHARE` of the acceleration across the path; what remains of the vector is for
//! changing speed: `a = sqrt(a_lim² − (κv²)²)`, constant on the element.

use crate::axis_rates::AxisRates;
use crate::kinematics::Kinematics;
use crate::limits::MotionLimits;
use crate::path::{AxisVector, Element, Feed, MAX_AXES, Path, Shape};
use crate::positioning::rapids as positioning;
use crate::segment::{MapError, Segment};

/// Share of an axis' acceleration that travelling an arc may use across the path; 60 % remains along it.
const CENTRIPETAL_SHARE: f64 = 0.8;
/// Share of an axis' acceleration that crossings of junctions may use; the rest changes the speed meanwhile.
const JUNCTION_SHARE: f64 = 0.7;
/// Share that junctions on or beside an arc and the arc itself may use together.
const JUNCTION_AND_ARC_SHARE: f64 = 0.9;
/// Half width of a junction's zone, in scans of travel (h above): wide zones suit lone kinks (1/ρ of their speed is lost),
/// narrow ones dense kinks (2hρ). Of 0.5, 0.75 and 1, and shares of 0.6 to 0.75, this pair was fastest over chord
/// contours of 2 to 20 mm radius and a sine, without long braking on dense contours.
const ZONE_SCANS: f64 = 0.75;
/// Height of the reservation relative to what one scan sees of the crossing (ρ above).
const ZONE_HEIGHT: f64 = 1.0 / (2.0 * ZONE_SCANS - ZONE_SCANS * ZONE_SCANS);
/// Junctions that take less than this share of any axis' acceleration at full speed are none.
const NEGLIGIBLE_SHARE: f64 = 1e-7;
/// Rounds in which overlapping zones are brought within their share by the square root of the excess, which is exact for
/// evenly dense kinks; one last round takes all of it and is sufficient by itself.
const SHARING_ROUNDS: usize = 6;
/// Excess over a share that is none.
const SHARE_TOLERANCE: f64 = 1e-2;

/// How the axes share the motion along one element, as bounds over its whole length.
#[derive(Debug, Clone, Copy)]
struct Sharing {
    /// Part of the tangent that turns in the plane of an arc.
    swing: [f64; MAX_AXES],
    /// Part of the tangent that is constant, or a bound of it all where the axes are not the program's.
    straight: [f64; MAX_AXES],
    /// Curvature, in 1/mm.
    curvature_per_mm: [f64; MAX_AXES],
}

impl Sharing {
    fn of(element: &Element, kinematics: &Kinematics) -> Self {
        if let Some(AxisRates { first, second }) = kinematics.axes_rates(element) {
            return Self {
                swing: [0.0; MAX_AXES],
                straight: first,
                curvature_per_mm: second,
            };
        }
        let mut sharing = Self {
            swing: [0.0; MAX_AXES],
            straight: [0.0; MAX_AXES],
            curvature_per_mm: [0.0; MAX_AXES],
        };
        let constant = match &element.shape {
            Shape::Arc {
                radius_mm,
                u,
                v,
                sweep_rad,
                axial,
                ..
            } => {
                let around = (radius_mm * sweep_rad / element.length_mm).abs();
                let turn_per_mm = element.curvature_magnitude_per_mm();
                let in_plane = u.iter().zip(v.iter());
                let of_axes = sharing.swing.iter_mut().zip(&mut sharing.curvature_per_mm);
                for ((swing, curvature), (u, v)) in of_axes.zip(in_plane) {
                    let amplitude = libm::hypot(*u, *v);
                    *swing = amplitude * around;
                    *curvature = amplitude * turn_per_mm;
                }
                axial / element.length_mm
            }
            _ => element.tangent(0.0),
        };
        for (straight, component) in sharing.straight.iter_mut().zip(&constant) {
            *straight = component.abs();
        }
        sharing
    }

    fn is_curved(&self) -> bool {
        self.curvature_per_mm.iter().any(|per_mm| *per_mm > 0.0)
    }

    /// Highest path speed within the axes' speeds and the share of their accelerations that an arc may use.
    fn speed_mm_s(&self, limits: &PlanLimits) -> f64 {
        let mut speed_mm_s = f64::INFINITY;
        for axis in 0..MAX_AXES {
            let (along, across) = (
                self.swing[axis] + self.straight[axis],
                self.curvature_per_mm[axis],
            );
            if along > 0.0 {
                speed_mm_s = speed_mm_s.min(limits.velocity_mm_s[axis] / along);
            }
            if across > 0.0 {
                let across_mm_s2 = CENTRIPETAL_SHARE * limits.acceleration_mm_s2[axis];
                speed_mm_s = speed_mm_s.min((across_mm_s2 / across).sqrt());
            }
        }
        speed_mm_s
    }

    /// Acceleration along the path that keeps every axis within what is left of its acceleration.
    fn acceleration_mm_s2(&self, left_mm_s2: &[f64; MAX_AXES], speed_mm_s: f64) -> f64 {
        let mut acceleration_mm_s2 = f64::INFINITY;
        for (axis, left) in left_mm_s2.iter().enumerate() {
            let (swing, straight) = (self.swing[axis], self.straight[axis]);
            let across = self.curvature_per_mm[axis] * speed_mm_s * speed_mm_s;
            let along = if swing > 0.0 && straight > 0.0 {
                (left - across) / (swing + straight)
            } else if swing > 0.0 {
                // |across·cos φ| + |a·swing·sin φ| is at most the length of the vector, at every angle.
                (left * left - across * across).max(0.0).sqrt() / swing
            } else if straight > 0.0 {
                // Lines of axes that are the program's have nothing across.
                (left - across) / straight
            } else {
                continue;
            };
            acceleration_mm_s2 = acceleration_mm_s2.min(along);
        }
        acceleration_mm_s2
    }
}

/// The limits less the rounding of setpoints.
struct PlanLimits {
    velocity_mm_s: [f64; MAX_AXES],
    acceleration_mm_s2: [f64; MAX_AXES],
}

/// One element that moves, and where it lies on the whole path.
struct Stretch {
    element: u32,
    start_mm: f64,
    length_mm: f64,
    sharing: Sharing,
    /// What the axes bear.
    speed_mm_s: f64,
    /// What is asked for at 100 %.
    feed_mm_s: f64,
    /// The lower of both at the highest override.
    fastest_mm_s: f64,
    /// A rapid between places where it has to stop or nearly so: it begins and ends at rest.
    from_rest_to_rest: bool,
}

/// Two elements that meet in motion, with different directions.
struct Junction {
    at_mm: f64,
    /// Jump of the tangent, per axis.
    kink: [f64; MAX_AXES],
    speed_mm_s: f64,
}

impl Junction {
    fn reach_mm(&self, scan_period_s: f64) -> f64 {
        ZONE_SCANS * self.speed_mm_s * scan_period_s
    }

    fn reserve(&self, reserved_mm_s2: &mut [f64; MAX_AXES], scan_period_s: f64) {
        let height = ZONE_HEIGHT * self.speed_mm_s / scan_period_s;
        for (reserved, kink) in reserved_mm_s2.iter_mut().zip(&self.kink) {
            *reserved += height * kink;
        }
    }
}

/// A path laid out in one line, with its junctions.
pub(crate) struct Course {
    limits: PlanLimits,
    axis_count: usize,
    scan_period_s: f64,
    stretches: Vec<Stretch>,
    junctions: Vec<Junction>,
    /// Where zones start and end, with their junctions, each in order of place.
    zone_starts: Vec<(f64, u32)>,
    zone_ends: Vec<(f64, u32)>,
}

/// The element after this one, if motion can go on to it without a stop.
fn next_without_stop(path: &Path, index: usize) -> Option<&Element> {
    let rest = path.elements.iter().skip(index + 1);
    let next = |after: &&Element| after.rests_before || after.is_dwell() || after.length_mm > 0.0;
    rest.into_iter()
        .find(next)
        .filter(|after| !after.rests_before && !after.is_dwell())
}

/// Marks the pieces that the tool rests before: the first piece of an element that says so, or after it where it has no length.
fn mark_rests(path: &Path, segments: &mut [Segment]) {
    let mut index = 0;
    let rests = path.elements.iter().enumerate();
    for (element, _) in rests.filter(|(_, element)| element.rests_before) {
        let ahead = segments.get(index..).unwrap_or(&[]);
        index += ahead.partition_point(|segment| (segment.element as usize) < element);
        if let Some(segment) = segments.get_mut(index) {
            segment.rests_at_start = true;
        }
    }
}

impl Course {
    /// With `single_rapids` a rapid that its neighbours force to rest at both ends stops there altogether.
    pub fn new(
        path: &Path,
        limits: &MotionLimits,
        override_max: f64,
        single_rapids: bool,
    ) -> Result<Self, MapError> {
        let mut course = Self::empty(limits);
        let kinematics = &limits.setpoints().kinematics;
        let mut start_mm = 0.0;
        // The element before, if motion can go on from it without a stop.
        let mut before: Option<&Element> = None;
        for (index, element) in path.elements.iter().enumerate() {
            if element.is_dwell() || element.rests_before {
                before = None;
            }
            if element.is_dwell() || element.length_mm <= 0.0 {
                continue;
            }
            let sharing = Sharing::of(element, kinematics);
            let speed_mm_s = sharing.speed_mm_s(&course.limits);
            if !speed_mm_s.is_finite() {
                return Err(MapError::NoSuchAxis { line: element.line });
            }
            let feed_mm_s = match element.feed {
                Feed::Rapid => speed_mm_s,
                Feed::PathMmS(feed_mm_s) => feed_mm_s,
            };
            let fastest_mm_s = speed_mm_s.min(feed_mm_s * override_max);
            let from_rest_to_rest = single_rapids
                && positioning::is_straight_rapid(element)
                && course.stands_alone(
                    before,
                    (element, &sharing, speed_mm_s),
                    next_without_stop(path, index),
                    override_max,
                );
            let stops = from_rest_to_rest
                || course
                    .stretches
                    .last()
                    .is_some_and(|last| last.from_rest_to_rest);
            if stops {
                before = None;
            }
            if let (Some(before), Some(last)) = (before, course.stretches.last()) {
                let kink = element.tangent(0.0) - before.tangent(before.length_mm);
                let kink = kinematics.axes_tangent(&element.start(), &kink);
                let fastest_mm_s = fastest_mm_s.min(last.fastest_mm_s);
                course.add_junction(start_mm, &kink, fastest_mm_s);
            }
            course.stretches.push(Stretch {
                element: index as u32,
                start_mm,
                length_mm: element.length_mm,
                sharing,
                speed_mm_s,
                feed_mm_s,
                fastest_mm_s,
                from_rest_to_rest,
            });
            start_mm += element.length_mm;
            before = Some(element);
        }
        Ok(course)
    }

    fn empty(limits: &MotionLimits) -> Self {
        Self {
            limits: PlanLimits {
                velocity_mm_s: limits.plan_velocity_mm_s(),
                acceleration_mm_s2: limits.plan_acceleration_mm_s2(),
            },
            axis_count: limits.axes().len(),
            scan_period_s: limits.scan_period_s(),
            stretches: Vec::new(),
            junctions: Vec::new(),
            zone_starts: Vec::new(),
            zone_ends: Vec::new(),
        }
    }

    /// Whether a straight rapid has to stop, or nearly so, at both of its ends: in a kink, or for a feed that is far slower.
    fn stands_alone(
        &self,
        before: Option<&Element>,
        (element, sharing, speed_mm_s): (&Element, &Sharing, f64),
        after: Option<&Element>,
        override_max: f64,
    ) -> bool {
        let acceleration_mm_s2 =
            sharing.acceleration_mm_s2(&self.limits.acceleration_mm_s2, speed_mm_s);
        let direction = element.tangent(0.0);
        let stops = |kink: AxisVector, neighbour: &Element| {
            let of_neighbour_mm_s = match neighbour.feed {
                Feed::Rapid => f64::INFINITY,
                Feed::PathMmS(feed_mm_s) => feed_mm_s * override_max,
            };
            positioning::forces_rest(
                self.bearable_mm_s(&kink).min(of_neighbour_mm_s),
                element.length_mm,
                speed_mm_s,
                acceleration_mm_s2,
            )
        };
        before.is_none_or(|before| stops(direction - before.tangent(before.length_mm), before))
            && after.is_none_or(|after| stops(after.tangent(0.0) - direction, after))
    }

    /// Speed at which a lone junction with this jump of the tangent can be crossed, in mm/s.
    fn bearable_mm_s(&self, kink: &AxisVector) -> f64 {
        let mut bearable_mm_s = f64::INFINITY;
        for (jump, limit_mm_s2) in kink.iter().zip(&self.limits.acceleration_mm_s2) {
            let seen_per_mm_s = ZONE_HEIGHT * jump.abs() / self.scan_period_s;
            if seen_per_mm_s > 0.0 {
                bearable_mm_s = bearable_mm_s.min(JUNCTION_SHARE * limit_mm_s2 / seen_per_mm_s);
            }
        }
        bearable_mm_s
    }

    fn add_junction(&mut self, at_mm: f64, kink: &AxisVector, fastest_mm_s: f64) {
        let mut junction = Junction {
            at_mm,
            kink: [0.0; MAX_AXES],
            speed_mm_s: fastest_mm_s,
        };
        let mut matters = false;
        let of_axes = junction.kink.iter_mut().zip(kink);
        for ((of_axis, jump), limit_mm_s2) in of_axes.zip(&self.limits.acceleration_mm_s2) {
            *of_axis = jump.abs();
            let seen_per_mm_s = ZONE_HEIGHT * *of_axis / self.scan_period_s;
            matters |= seen_per_mm_s * fastest_mm_s > NEGLIGIBLE_SHARE * limit_mm_s2;
            if seen_per_mm_s > 0.0 {
                let bearable_mm_s = JUNCTION_SHARE * limit_mm_s2 / seen_per_mm_s;
                junction.speed_mm_s = junction.speed_mm_s.min(bearable_mm_s);
            }
        }
        if matters {
            self.junctions.push(junction);
        }
    }

    /// Lowers junction speeds until the zones that overlap anywhere are within their share together.
    pub fn share_among_junctions(&mut self) {
        for round in 0..=SHARING_ROUNDS {
            let mut excesses = vec![1.0f64; self.junctions.len()];
            self.lay_out_zones();
            self.sweep(|stretch, _, _, active| {
                let excess = self.excess(stretch, active);
                for &junction in active {
                    if let Some(of_junction) = excesses.get_mut(junction as usize) {
                        *of_junction = of_junction.max(excess);
                    }
                }
            });
            let mut done = true;
            for (junction, excess) in self.junctions.iter_mut().zip(&excesses) {
                if *excess > 1.0 + SHARE_TOLERANCE {
                    done = false;
                    // Zones shrink and reservations fall with the speed, so dividing by the whole excess suffices.
                    junction.speed_mm_s /= if round < SHARING_ROUNDS {
                        excess.sqrt()
                    } else {
                        *excess
                    };
                }
            }
            if done {
                break;
            }
        }
        self.lay_out_zones();
    }

    /// How far the junctions active together on a stretch exceed their share; at most 1 is fine.
    fn excess(&self, stretch: &Stretch, active: &[u32]) -> f64 {
        // A junction alone was given no more than its share.
        if active.is_empty() || (active.len() == 1 && !stretch.sharing.is_curved()) {
            return 0.0;
        }
        let (reserved, speed_mm_s) = self.reserved(stretch, active);
        let mut excess = 0.0f64;
        let curvature = &stretch.sharing.curvature_per_mm;
        let of_axes = reserved
            .iter()
            .zip(curvature)
            .zip(&self.limits.acceleration_mm_s2);
        for ((reserved, curvature), limit) in of_axes.take(self.axis_count) {
            let share = reserved / limit;
            excess = excess.max(share / JUNCTION_SHARE);
            if *curvature > 0.0 && share > NEGLIGIBLE_SHARE {
                let across = curvature * speed_mm_s * speed_mm_s / limit;
                excess = excess.max((share + across) / JUNCTION_AND_ARC_SHARE);
            }
        }
        excess
    }

    /// What the active junctions reserve of each axis, in mm/s², and the highest speed within all of their zones.
    fn reserved(&self, stretch: &Stretch, active: &[u32]) -> ([f64; MAX_AXES], f64) {
        let mut reserved_mm_s2 = [0.0; MAX_AXES];
        let mut speed_mm_s = stretch.fastest_mm_s;
        for &index in active {
            if let Some(junction) = self.junctions.get(index as usize) {
                junction.reserve(&mut reserved_mm_s2, self.scan_period_s);
                speed_mm_s = speed_mm_s.min(junction.speed_mm_s);
            }
        }
        (reserved_mm_s2, speed_mm_s)
    }

    fn lay_out_zones(&mut self) {
        self.zone_starts.clear();
        self.zone_ends.clear();
        for (index, junction) in self.junctions.iter().enumerate() {
            let reach_mm = junction.reach_mm(self.scan_period_s);
            self.zone_starts
                .push((junction.at_mm - reach_mm, index as u32));
            self.zone_ends
                .push((junction.at_mm + reach_mm, index as u32));
        }
        // Each is in order already but for zones of unlike width; the sort makes use of that.
        for borders in [&mut self.zone_starts, &mut self.zone_ends] {
            borders.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
    }

    /// Visits all pieces of all stretches between borders, in order, with the junctions whose zones cover them.
    fn sweep(&self, mut visit: impl FnMut(&Stretch, f64, f64, &[u32])) {
        let mut active: Vec<u32> = Vec::new();
        let mut starts = self.zone_starts.iter().peekable();
        let mut ends = self.zone_ends.iter().peekable();
        for stretch in &self.stretches {
            let mut from_mm = 0.0;
            while from_mm < stretch.length_mm {
                // Every zone starts before it ends, so all starts so far may be taken before the ends.
                while let Some((_, junction)) =
                    starts.next_if(|(at_mm, _)| at_mm - stretch.start_mm <= from_mm)
                {
                    active.push(*junction);
                }
                while let Some((_, junction)) =
                    ends.next_if(|(at_mm, _)| at_mm - stretch.start_mm <= from_mm)
                {
                    active.retain(|other| other != junction);
                }
                let mut to_mm = stretch.length_mm;
                for border in [starts.peek(), ends.peek()].into_iter().flatten() {
                    to_mm = to_mm.min(border.0 - stretch.start_mm);
                }
                visit(stretch, from_mm, to_mm, &active);
                from_mm = to_mm;
            }
        }
    }

    /// The pieces of constant limits, dwells among them.
    pub fn segments(&self, path: &Path) -> Vec<Segment> {
        let mut segments: Vec<Segment> = Vec::with_capacity(self.stretches.len());
        let mut next_element = 0;
        self.sweep(|stretch, from_mm, to_mm, active| {
            self.add_dwells(path, next_element..stretch.element, &mut segments);
            next_element = stretch.element + 1;
            let (reserved, fastest_mm_s) = self.reserved(stretch, active);
            let mut left_mm_s2 = self.limits.acceleration_mm_s2;
            for (left, reserved) in left_mm_s2.iter_mut().zip(&reserved) {
                *left -= reserved;
            }
            let within = |speed_mm_s: f64| {
                if active.is_empty() {
                    speed_mm_s
                } else {
                    speed_mm_s.min(fastest_mm_s)
                }
            };
            segments.push(Segment {
                element: stretch.element,
                is_dwell: false,
                dwell_scans: 0,
                from_mm,
                to_mm,
                speed_mm_s: within(stretch.speed_mm_s),
                feed_mm_s: stretch.feed_mm_s,
                acceleration_mm_s2: stretch
                    .sharing
                    .acceleration_mm_s2(&left_mm_s2, fastest_mm_s),
                ends_block: false,
                from_rest_to_rest: stretch.from_rest_to_rest,
                rests_at_start: false,
                of_move: None,
            });
        });
        self.add_dwells(
            path,
            next_element..path.elements.len() as u32,
            &mut segments,
        );
        mark_rests(path, &mut segments);
        let line_of = |segment: &Segment| path.line_of(segment.element as usize);
        for index in 1..segments.len() {
            let next_line = segments.get(index).and_then(line_of);
            if let Some(segment) = segments.get_mut(index - 1) {
                segment.ends_block = path.line_of(segment.element as usize) != next_line;
            }
        }
        segments
    }

    fn add_dwells(&self, path: &Path, range: std::ops::Range<u32>, segments: &mut Vec<Segment>) {
        for index in range {
            let shape = path
                .elements
                .get(index as usize)
                .map(|element| &element.shape);
            if let Some(Shape::Dwell { seconds, .. }) = shape {
                segments.push(Segment {
                    element: index,
                    is_dwell: true,
                    // At least as long as asked for; a hair above a whole number of scans is that number.
                    dwell_scans: libm::ceil(seconds / self.scan_period_s - 1e-6) as u32,
                    from_mm: 0.0,
                    to_mm: 0.0,
                    speed_mm_s: 0.0,
                    feed_mm_s: 0.0,
                    acceleration_mm_s2: 0.0,
                    ends_block: false,
                    from_rest_to_rest: false,
                    rests_at_start: false,
                    of_move: None,
                });
            }
        }
    }
}

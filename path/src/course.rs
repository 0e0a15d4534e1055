//! A path laid out in one line: what the axes bear on each element, and the zones around its junctions.
//!
//! **Junctions.** The average over one scan to either side, under a triangle (see `speed_map`), sees a crossing as up to `J = v·|Δt_i|/Tp`. Each junction has a zone: as long as the path is
//! within `h·v·Tp` of it, speed is capped at the junction's `v` and `ρ·J` of each axis' acceleration is reserved for the
//! crossing. A box of height `ρ·J` and half width `h·Tp`, seen through the triangle, covers the triangle `J·(1 − |τ|/Tp)` at
//! every offset τ when `ρ = 1/(2h − h²)`: at τ = 0 with equality, elsewhere because the triangle is concave only there.
//! Averages add, so zones may overlap: reservations are summed, and a contour of many small kinks is treated as the
//! curvature it stands for, up to the factor `2hρ` = 1.6. No zone knows of the others' order or of scan instants.
//!
//! **Curves** use at most a share of the acceleration across the path (`sharing`); what remains of the vector is for
//! changing speed: `a = sqrt(a_lim² − (κv²)²)`, more of it the slower the tool is (`segment::Acceleration`). An arc is cut into pieces on which
//! that changes little.

use std::cell::OnceCell;
use std::ops::Range;

use crate::geometry::{AxisVector, Element, Feed, PATH_AXES, Shape};
use crate::path_part::{Laid, PathPart};
use crate::positioning::rapids as positioning;
use crate::segment::{Acceleration, Segment};

use crate::sharing::{PlanLimits, Sharing};

/// Share of an axis' acceleration that crossings of junctions may use; the rest changes the speed meanwhile.
const JUNCTION_SHARE: f64 = 0.7;
/// Share that junctions on or beside an arc and the arc itself may use together.
const JUNCTION_AND_ARC_SHARE: f64 = 0.9;
/// Share of an axis' jerk that crossings of junctions may use; the rest changes the acceleration meanwhile.
const JUNCTION_JERK_SHARE: f64 = 0.5;
/// What a third difference sees of a jump of the acceleration, over the scan period: the peak of the quadratic B-spline.
const BEND_HEIGHT: f64 = 0.75;
/// A piece is cut so that what is left for changes of speed falls, on a way of its length at what is left at rest, by at most this share of it.
const FALL_STEP: f64 = 0.5;
/// Largest number of such pieces.
const FALL_CUTS_MAX: usize = 64;
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

/// One element that moves, or a piece of one that is rounded.
struct Stretch<'a> {
    element: u32,
    laid: &'a Laid,
    from_mm: f64,
    to_mm: f64,
    sharing: &'a Sharing,
    /// Speed that the axes bear, in mm/s.
    speed_mm_s: f64,
    /// Feed at the highest override, in mm/s.
    asked_mm_s: f64,
    /// Speed in the zone of a junction, in mm/s, once it was asked for.
    beside_junction_mm_s: OnceCell<f64>,
    /// A rapid between places where it has to stop or nearly so: it begins and ends at rest.
    from_rest_to_rest: bool,
}

impl Stretch<'_> {
    /// In the zone of a junction: what the axes bear or what is asked for at the highest override, whichever is lower, in mm/s.
    fn beside_junction_mm_s(&self, limits: &PlanLimits) -> f64 {
        *self.beside_junction_mm_s.get_or_init(|| {
            let bearable_mm_s = if self.sharing.is_curved() {
                self.sharing.speed_beside_junctions_mm_s(limits)
            } else {
                self.speed_mm_s
            };
            bearable_mm_s.min(self.asked_mm_s)
        })
    }

    /// No less than that, and known at once.
    fn at_most_mm_s(&self) -> f64 {
        self.speed_mm_s.min(self.asked_mm_s)
    }
}

/// Two elements that meet in motion, with different directions.
struct Junction {
    at_mm: f64,
    /// Jump of the tangent, per axis.
    kink: [f64; PATH_AXES],
    /// Jump of the tangent that a third difference sees at most as much of as of the junction, jump of the curvature included, per axis.
    seen_as: [f64; PATH_AXES],
    speed_mm_s: f64,
}

/// What junctions take of each axis, in mm/s²: of its acceleration, and of what its jerk leaves of that to them.
#[derive(Default)]
struct Reserved {
    of_acceleration: [f64; PATH_AXES],
    of_jerk: [f64; PATH_AXES],
}

impl Junction {
    fn reach_mm(&self, scan_period_s: f64) -> f64 {
        ZONE_SCANS * self.speed_mm_s * scan_period_s
    }

    fn reserve(&self, reserved: &mut Reserved, scan_period_s: f64) {
        let height = ZONE_HEIGHT * self.speed_mm_s / scan_period_s;
        for (reserved, kink) in reserved.of_acceleration.iter_mut().zip(&self.kink) {
            *reserved += height * kink;
        }
        for (reserved, kink) in reserved.of_jerk.iter_mut().zip(&self.seen_as) {
            *reserved += height * kink;
        }
    }
}

/// Elements of a path laid out in one line, with their junctions.
///
/// What it makes of an element depends on the elements around it, as far as zones that overlap reach. So a part of a path is laid out with a
/// [margin](ZONES_TOGETHER) to either side, of which nothing is used.
pub(crate) struct Course<'a> {
    part: &'a PathPart,
    range: Range<u32>,
    limits: &'a PlanLimits,
    axis_count: usize,
    scan_period_s: f64,
    stretches: Vec<Stretch<'a>>,
    junctions: Vec<Junction>,
    /// Where zones start and end, with their junctions, each in order of place.
    zone_starts: Vec<(f64, u32)>,
    zone_ends: Vec<(f64, u32)>,
}

/// Half zones, one behind the other, that one junction can have a part in: in each round of sharing those of two zones that overlap, and at
/// last its own. As a distance at `v` mm/s: [`margin_mm`].
const ZONES_TOGETHER: f64 = 2.0 * (SHARING_ROUNDS as f64 + 1.0) + 2.0;

/// How far the elements of a path have a part in what is made of one, in mm, where none is faster than this.
pub(crate) fn margin_mm(fastest_mm_s: f64, scan_period_s: f64) -> f64 {
    ZONES_TOGETHER * ZONE_SCANS * fastest_mm_s * scan_period_s
}

/// The element after this one, if motion can go on to it without a stop.
fn next_without_stop<'a>(
    part: &'a PathPart,
    range: &Range<u32>,
    element: u32,
) -> Option<&'a Element> {
    let mut rest = (element + 1..range.end).filter_map(|element| part.get(element));
    let next = |after: &&Element| after.rests_before || after.is_dwell() || after.length_mm > 0.0;
    rest.find(next)
        .filter(|after| !after.rests_before && !after.is_dwell())
}

impl<'a> Course<'a> {
    /// With `single_rapids` a rapid that its neighbours force to rest at both ends stops there altogether.
    pub fn new(
        part: &'a PathPart,
        range: Range<u32>,
        override_max: f64,
        single_rapids: bool,
    ) -> Self {
        let mut course = Self {
            part,
            range: range.clone(),
            limits: &part.plan_limits,
            axis_count: part.limits().axes().len(),
            scan_period_s: part.limits().scan_period_s(),
            stretches: Vec::new(),
            junctions: Vec::new(),
            zone_starts: Vec::new(),
            zone_ends: Vec::new(),
        };
        let kinematics = &part.limits().setpoints().kinematics;
        // The element before, if motion can go on from it without a stop.
        let mut before: Option<&Element> = None;
        for index in range.clone() {
            let Some(laid) = part.laid(index) else { break };
            let element = &laid.element;
            if element.is_dwell() || element.rests_before {
                before = None;
            }
            if element.is_dwell() || !laid.moves() {
                continue;
            }
            let from_rest_to_rest = single_rapids
                && positioning::is_straight_rapid(element)
                && course.stands_alone(
                    before,
                    laid,
                    next_without_stop(part, &range, index),
                    override_max,
                );
            let last = course.stretches.last();
            // Where the path rests, no junction is crossed in motion.
            if from_rest_to_rest || last.is_some_and(|last| last.from_rest_to_rest) {
                before = None;
            }
            if let (Some(before), Some(_)) = (before, last) {
                let kink = element.tangent(0.0) - before.tangent(before.length_mm);
                let kink = kinematics.axes_tangent(&element.start(), &kink);
                let bend =
                    element.curvature_per_mm(0.0) - before.curvature_per_mm(before.length_mm);
                let stretch = course.stretches.len();
                course.add_stretches(index, laid, from_rest_to_rest, override_max);
                course.add_junction(laid.start_mm, (&kink, &bend), stretch);
            } else {
                course.add_stretches(index, laid, from_rest_to_rest, override_max);
            }
            before = Some(element);
        }
        course
    }

    fn add_stretches(
        &mut self,
        element: u32,
        laid: &'a Laid,
        from_rest_to_rest: bool,
        override_max: f64,
    ) {
        let asked_mm_s = laid.feed_mm_s * override_max;
        let stretch = |from_mm: f64, to_mm: f64, sharing: &'a Sharing, speed_mm_s: f64| Stretch {
            element,
            laid,
            from_mm,
            to_mm,
            sharing,
            speed_mm_s,
            asked_mm_s,
            beside_junction_mm_s: OnceCell::new(),
            from_rest_to_rest,
        };
        if laid.pieces.is_empty() {
            let to_mm = laid.element.length_mm;
            let whole = stretch(0.0, to_mm, &laid.sharing, laid.speed_mm_s);
            return self.stretches.push(whole);
        }
        let pieces = laid.pieces.iter();
        let pieces = pieces.map(|of| stretch(of.from_mm, of.to_mm, &of.sharing, of.speed_mm_s));
        self.stretches.extend(pieces);
    }

    /// Whether a straight rapid has to stop, or nearly so, at both of its ends: in a kink, or for a feed that is far slower.
    fn stands_alone(
        &self,
        before: Option<&Element>,
        laid: &Laid,
        after: Option<&Element>,
        override_max: f64,
    ) -> bool {
        let (element, speed_mm_s) = (&laid.element, laid.speed_mm_s);
        let acceleration_mm_s2 = laid
            .sharing
            .acceleration_mm_s2(&self.limits.acceleration_mm_s2, speed_mm_s);
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

    /// What a junction alone may take of an axis by its acceleration, and by its jerk: a third difference is the difference of two second
    /// ones over the scan period, and each of them may see the junction. In mm/s².
    fn of_junctions_mm_s2(&self, axis: usize) -> (f64, f64) {
        let of = |limits: &[f64; PATH_AXES]| limits.get(axis).copied().unwrap_or(f64::INFINITY);
        (
            JUNCTION_SHARE * of(&self.limits.acceleration_mm_s2),
            0.5 * JUNCTION_JERK_SHARE * of(&self.limits.jerk_mm_s3) * self.scan_period_s,
        )
    }

    /// Speed at which a lone junction with this jump of the tangent can be crossed, in mm/s.
    fn bearable_mm_s(&self, kink: &AxisVector) -> f64 {
        let mut bearable_mm_s = f64::INFINITY;
        for (axis, jump) in kink.iter().enumerate() {
            let seen_per_mm_s = ZONE_HEIGHT * jump.abs() / self.scan_period_s;
            if seen_per_mm_s > 0.0 {
                let (acceleration, jerk) = self.of_junctions_mm_s2(axis);
                bearable_mm_s = bearable_mm_s.min(acceleration.min(jerk) / seen_per_mm_s);
            }
        }
        bearable_mm_s
    }

    /// Whether a junction of these jumps takes anything of an axis at this speed.
    fn matters(&self, kink: &AxisVector, bend: &AxisVector, speed_mm_s: f64) -> bool {
        let limits_mm_s2 = &self.limits.acceleration_mm_s2;
        let jumps = kink.iter().zip(bend).zip(limits_mm_s2).enumerate();
        jumps
            .into_iter()
            .any(|(axis, ((kink, bend), limit_mm_s2))| {
                let (_, jerk) = self.of_junctions_mm_s2(axis);
                let takes = |kink: f64, limit: f64| {
                    ZONE_HEIGHT * kink / self.scan_period_s * speed_mm_s > NEGLIGIBLE_SHARE * limit
                };
                let seen_as = || self.seen_as(kink.abs(), bend.abs(), jerk, speed_mm_s);
                takes(kink.abs(), *limit_mm_s2) || jerk.is_finite() && takes(seen_as(), jerk)
            })
    }

    /// The jump of the tangent that a third difference sees at most as much of as of one with this jump of the curvature.
    fn seen_as(&self, kink: f64, bend: f64, jerk: f64, fastest_mm_s: f64) -> f64 {
        // The jump of the acceleration is bend·v². At the speed at which that alone is borne it is no more than that of a kink of bend·v·Tp.
        let seen = ZONE_HEIGHT * BEND_HEIGHT * bend;
        let bearable_mm_s = if seen > 0.0 {
            (jerk / seen).sqrt()
        } else {
            fastest_mm_s
        };
        let as_kink = BEND_HEIGHT * bend * self.scan_period_s;
        kink + as_kink * bearable_mm_s.min(fastest_mm_s)
    }

    /// Adds the junction before a stretch, if it takes anything of an axis.
    fn add_junction(
        &mut self,
        at_mm: f64,
        (kink, bend): (&AxisVector, &AxisVector),
        stretch: usize,
    ) {
        let before = stretch.checked_sub(1);
        let beside = [before, Some(stretch)].map(|index| self.stretches.get(index?));
        let of_both =
            |speed: &dyn Fn(&Stretch<'_>) -> f64| beside.map(|stretch| stretch.map_or(0.0, speed));
        let [before_mm_s, after_mm_s] = of_both(&|of| of.at_most_mm_s());
        // What takes nothing at a speed takes nothing at any lower one.
        if !self.matters(kink, bend, before_mm_s.min(after_mm_s)) {
            return;
        }
        let [before_mm_s, after_mm_s] = of_both(&|of| of.beside_junction_mm_s(self.limits));
        let fastest_mm_s = before_mm_s.min(after_mm_s);
        if !self.matters(kink, bend, fastest_mm_s) {
            return;
        }
        let mut junction = Junction {
            at_mm,
            kink: [0.0; PATH_AXES],
            seen_as: [0.0; PATH_AXES],
            speed_mm_s: fastest_mm_s,
        };
        let of_axes = junction.kink.iter_mut().zip(&mut junction.seen_as);
        let jumps = kink.iter().zip(bend).enumerate();
        for ((of_axis, seen_as), (axis, (jump, bend))) in of_axes.zip(jumps) {
            let (acceleration, jerk) = self.of_junctions_mm_s2(axis);
            *of_axis = jump.abs();
            let seen_per_mm_s = ZONE_HEIGHT * *of_axis / self.scan_period_s;
            if seen_per_mm_s > 0.0 {
                junction.speed_mm_s = junction.speed_mm_s.min(acceleration / seen_per_mm_s);
            }
            if jerk.is_finite() {
                *seen_as = self.seen_as(*of_axis, bend.abs(), jerk, fastest_mm_s);
                let seen_per_mm_s = ZONE_HEIGHT * *seen_as / self.scan_period_s;
                if seen_per_mm_s > 0.0 {
                    junction.speed_mm_s = junction.speed_mm_s.min(jerk / seen_per_mm_s);
                }
            }
        }
        self.junctions.push(junction);
    }

    /// Lowers junction speeds until the zones that overlap anywhere are within their share together.
    pub fn share_among_junctions(&mut self) {
        for round in 0..=SHARING_ROUNDS {
            // All are judged before one is slowed down, so that the result does not depend on their order.
            let mut excesses = vec![1.0f64; self.junctions.len()];
            self.lay_out_zones();
            self.sweep(|stretch, _, _, active| {
                let excess = self.excess(stretch, active, round == SHARING_ROUNDS);
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

    /// How far the junctions active together on a stretch exceed their share; at most 1 is fine. In the last round, so far that dividing their
    /// speeds by it suffices.
    fn excess(&self, stretch: &Stretch<'_>, active: &[u32], in_last_round: bool) -> f64 {
        // A junction alone was given no more than its share.
        if active.is_empty() || (active.len() == 1 && !stretch.sharing.is_curved()) {
            return 0.0;
        }
        let (reserved, speed_mm_s) = self.reserved(stretch, active);
        let speeds = active
            .iter()
            .filter_map(|index| self.junctions.get(*index as usize));
        let slowest = speeds.map(|junction| junction.speed_mm_s);
        // Where the arc itself is slower than the junctions that reach onto it, it stays as fast when they are slowed down.
        let arc_stays = in_last_round && slowest.fold(f64::INFINITY, f64::min) > speed_mm_s;
        let mut excess = 0.0f64;
        let curvature = &stretch.sharing.curvature_per_mm;
        let of_axes = reserved.of_acceleration.iter().zip(&reserved.of_jerk);
        let of_axes = of_axes.zip(curvature).zip(&self.limits.acceleration_mm_s2);
        for (axis, (((reserved, of_jerk), curvature), limit)) in
            of_axes.take(self.axis_count).enumerate()
        {
            let share = reserved / limit;
            excess = excess.max(share / JUNCTION_SHARE);
            let (_, jerk) = self.of_junctions_mm_s2(axis);
            excess = excess.max(of_jerk / jerk);
            if *curvature > 0.0 && share > NEGLIGIBLE_SHARE {
                let across = curvature * speed_mm_s * speed_mm_s / limit;
                excess = excess.max((share + across) / JUNCTION_AND_ARC_SHARE);
                if arc_stays && excess > 1.0 {
                    excess = excess.max(share / (JUNCTION_AND_ARC_SHARE - across));
                }
            }
        }
        excess
    }

    /// What the active junctions reserve of each axis, and the highest speed within all of their zones.
    fn reserved(&self, stretch: &Stretch<'_>, active: &[u32]) -> (Reserved, f64) {
        let mut reserved = Reserved::default();
        let mut speed_mm_s = if active.is_empty() {
            stretch.at_most_mm_s()
        } else {
            stretch.beside_junction_mm_s(self.limits)
        };
        for &index in active {
            if let Some(junction) = self.junctions.get(index as usize) {
                junction.reserve(&mut reserved, self.scan_period_s);
                speed_mm_s = speed_mm_s.min(junction.speed_mm_s);
            }
        }
        (reserved, speed_mm_s)
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
    fn sweep(&self, mut visit: impl FnMut(&Stretch<'_>, f64, f64, &[u32])) {
        let mut active: Vec<u32> = Vec::new();
        let mut starts = self.zone_starts.iter().peekable();
        let mut ends = self.zone_ends.iter().peekable();
        for stretch in &self.stretches {
            let mut from_mm = stretch.from_mm;
            while from_mm < stretch.to_mm {
                // Every zone starts before it ends, so all starts so far may be taken before the ends.
                while let Some((_, junction)) =
                    starts.next_if(|(at_mm, _)| at_mm - stretch.laid.start_mm <= from_mm)
                {
                    active.push(*junction);
                }
                while let Some((_, junction)) =
                    ends.next_if(|(at_mm, _)| at_mm - stretch.laid.start_mm <= from_mm)
                {
                    active.retain(|other| other != junction);
                }
                let mut to_mm = stretch.to_mm;
                for border in [starts.peek(), ends.peek()].into_iter().flatten() {
                    to_mm = to_mm.min(border.0 - stretch.laid.start_mm);
                }
                visit(stretch, from_mm, to_mm, &active);
                from_mm = to_mm;
            }
        }
    }

    /// The pieces of constant limits, dwells among them.
    pub fn segments(&self) -> Vec<Segment> {
        let mut segments: Vec<Segment> = Vec::with_capacity(self.stretches.len());
        let mut next_element = self.range.start;
        self.sweep(|stretch, from_mm, to_mm, active| {
            self.add_dwells(next_element..stretch.element, &mut segments);
            next_element = stretch.element + 1;
            let (reserved, fastest_mm_s) = self.reserved(stretch, active);
            // Crossings and changes of speed add up in an axis: what the zones reserve is not there for the latter.
            let mut left_mm_s2 = self.limits.acceleration_mm_s2;
            for (left, reserved) in left_mm_s2.iter_mut().zip(&reserved.of_acceleration) {
                *left -= reserved;
            }
            let speed_mm_s = if active.is_empty() {
                stretch.speed_mm_s
            } else {
                stretch.speed_mm_s.min(fastest_mm_s)
            };
            let acceleration = Acceleration::below(fastest_mm_s, |speed_mm_s| {
                stretch.sharing.acceleration_mm_s2(&left_mm_s2, speed_mm_s)
            });
            let acceleration = match self.limits.limits_jerk() {
                true => {
                    let by_jerk = self.by_jerk(stretch, fastest_mm_s, active);
                    acceleration.least_up_to(&by_jerk, fastest_mm_s)
                }
                false => acceleration,
            };
            let length_mm = to_mm - from_mm;
            // A piece has one acceleration, its least: on a curve, where that falls with the speed, a long piece would waste most of it.
            let falls = 2.0 * acceleration.steepest_per_mm() * length_mm;
            let cuts = (libm::ceil(falls / FALL_STEP) as usize).clamp(1, FALL_CUTS_MAX);
            let mut begin_mm = from_mm;
            for cut in 1..=cuts {
                let end_mm = if cut == cuts {
                    to_mm
                } else {
                    from_mm + length_mm * (cut as f64 / cuts as f64)
                };
                segments.push(Segment {
                    element: stretch.element,
                    from_mm: begin_mm,
                    to_mm: end_mm,
                    speed_mm_s,
                    feed_mm_s: stretch.laid.feed_mm_s,
                    is_rapid: stretch.laid.element.feed == Feed::Rapid,
                    acceleration,
                    from_rest_to_rest: stretch.from_rest_to_rest,
                    ..Segment::default()
                });
                begin_mm = end_mm;
            }
        });
        self.add_dwells(next_element..self.range.end, &mut segments);
        self.mark_rests(&mut segments);
        let line_of = |segment: &Segment| Some(self.part.get(segment.element)?.line);
        for index in 1..segments.len() {
            let next_line = segments.get(index).and_then(line_of);
            if let Some(segment) = segments.get_mut(index - 1) {
                segment.ends_block = line_of(segment) != next_line;
            }
        }
        segments
    }

    /// What the jerk of the axes leaves for changes of speed on a piece of a stretch.
    fn by_jerk(&self, stretch: &Stretch<'_>, fastest_mm_s: f64, active: &[u32]) -> Acceleration {
        let share = if active.is_empty() {
            1.0
        } else {
            1.0 - JUNCTION_JERK_SHARE
        };
        let by_jerk = stretch.sharing.by_jerk(self.limits, share);
        Acceleration::falling(fastest_mm_s, |speeds_mm_s| {
            by_jerk.of_lead_mm_s2(speeds_mm_s, fastest_mm_s)
        })
    }

    /// Marks the pieces that the tool rests before: the first piece of an element that says so, or after it where it has no length.
    fn mark_rests(&self, segments: &mut [Segment]) {
        let mut index = 0;
        for element in self.range.clone() {
            if self.part.get(element).is_none_or(|of| !of.rests_before) {
                continue;
            }
            let ahead = segments.get(index..).unwrap_or(&[]);
            index += ahead.partition_point(|segment| segment.element < element);
            if let Some(segment) = segments.get_mut(index) {
                segment.rests_at_start = true;
            }
        }
    }

    fn add_dwells(&self, range: Range<u32>, segments: &mut Vec<Segment>) {
        for index in range {
            let shape = self.part.get(index).map(|element| &element.shape);
            if let Some(Shape::Dwell { seconds, .. }) = shape {
                segments.push(Segment {
                    element: index,
                    is_dwell: true,
                    // At least as long as asked for; a hair above a whole number of scans is that number.
                    dwell_scans: libm::ceil(seconds / self.scan_period_s - 1e-6) as u32,
                    ..Segment::default()
                });
            }
        }
    }
}

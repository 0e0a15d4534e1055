//! Where the time of a program goes: what holds the tool back, scan by scan.
//!
//! Judged by the setpoints alone, like the audit: at the programmed feed it is the program, at an axis' highest speed that axis. Where the speed
//! is lowest, the limit of which most is used there holds the tool back; the scans before, in which it slows down, and those behind, in
//! which it gains speed, belong to that place too.
use path::geometry::{Element, Feed, PATH_AXES};
use path::limits::MotionLimits;
use path::path_part::PathPart;
use path::window::PlannedSetpoint;

/// From this share of what is asked for, or of an axis' highest speed, the tool is as fast as that.
const AS_FAST: f64 = 0.985;
/// Below this share of every limit, none of them is what holds the tool back.
const USED_MIN: f64 = 0.3;
/// A kink of so much, in rad, is one.
const KINK_MIN_RAD: f64 = 1e-3;
/// Scans around the slowest one in which its limit is looked for.
const NEAR_SCANS: usize = 3;

/// A limit of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Limit {
    /// In mm/s.
    Velocity,
    /// In mm/s².
    Acceleration,
    /// In mm/s³.
    Jerk,
}

/// The form of the path where the tool is slow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Form {
    /// A straight stretch.
    Straight,
    /// A curve of this radius, in mm.
    Curve(f64),
    /// A change of the programmed direction by so much, in rad.
    Corner(f64),
    /// Where a line runs into an arc, or an arc into another: the acceleration across the path jumps.
    Bend,
}

/// What holds the tool back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cause {
    /// The program asks for no more.
    Feed,
    /// The tool rests there.
    Rest,
    /// A limit of the axis with this index.
    Axis {
        /// The axis.
        axis: usize,
        /// Its limit.
        limit: Limit,
        /// Where.
        form: Form,
    },
    /// Braking from more does not fit into a window, or the way is too short to gain more speed.
    Braking,
}

/// A place that holds the tool back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlowPlace {
    /// Line of the program.
    pub line: u32,
    /// Lowest speed there, in mm/s.
    pub speed_mm_s: f64,
    /// What is asked for there, in mm/s; for rapids what the axes bear.
    pub asked_mm_s: f64,
    /// Why.
    pub cause: Cause,
    /// Time of the scans that belong to it, in s.
    pub time_s: f64,
    /// That above the time at what is asked for, in s.
    pub lost_s: f64,
}

/// What one block takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockTime {
    /// Line of the program.
    pub line: u32,
    /// Length, in mm.
    pub length_mm: f64,
    /// Time, in s.
    pub time_s: f64,
    /// Time at what is asked for, in s.
    pub asked_s: f64,
    /// What cost the most of the rest.
    pub cause: Cause,
}

/// A scan.
#[derive(Debug, Clone, Copy)]
struct Scan {
    line: u32,
    element: u32,
    distance_mm: f64,
    speed_mm_s: f64,
    asked_mm_s: f64,
    /// The axis and limit of which most is used, and how much.
    used: (usize, Limit, f64),
    /// The axis whose speed is the lowest limit there.
    bound_by_axis: Option<usize>,
}

/// Collects the scans of a program.
#[derive(Debug)]
pub struct TimeUse {
    limits: MotionLimits,
    scans: Vec<Scan>,
    before: [[i64; PATH_AXES]; 3],
}

/// What a program's time is used for.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeTable {
    /// Places in order of travel; what is not held back is among them, with [`Cause::Feed`].
    pub places: Vec<SlowPlace>,
    /// Blocks in order of travel.
    pub blocks: Vec<BlockTime>,
}

impl TimeUse {
    /// Of a tool at rest.
    pub fn new(limits: MotionLimits) -> Self {
        Self {
            limits,
            scans: Vec::new(),
            before: [[0; PATH_AXES]; 3],
        }
    }

    /// Takes the next setpoint of a program that is planned along `path`.
    pub fn setpoint(&mut self, path: &PathPart, setpoint: &PlannedSetpoint) {
        if self.scans.is_empty() {
            self.before = [setpoint.position_increments; 3];
        }
        let state = &setpoint.state;
        let used = self.most_used(&setpoint.position_increments);
        let [_, second, third] = self.before;
        self.before = [second, third, setpoint.position_increments];
        let Some(element) = path.get(state.element) else {
            return;
        };
        let (asked_mm_s, bound_by_axis) = self.asked(element, state.distance_mm);
        self.scans.push(Scan {
            line: element.line,
            element: state.element,
            distance_mm: state.distance_mm,
            speed_mm_s: state.speed_mm_s,
            asked_mm_s,
            used,
            bound_by_axis,
        });
    }

    /// The axis and limit of which the way to this setpoint uses most.
    fn most_used(&self, now: &[i64; PATH_AXES]) -> (usize, Limit, f64) {
        let period_s = self.limits.scan_period_s();
        let [first, second, third] = &self.before;
        let mut most = (0, Limit::Velocity, 0.0);
        let places = first.iter().zip(second).zip(third).zip(now);
        for ((axis, limits), (((a, b), c), d)) in self.limits.axes().iter().enumerate().zip(places)
        {
            let [a, b, c, d] = [a, b, c, d].map(|of| *of as f64 * limits.increment_mm);
            let velocity = (d - c) / period_s;
            let acceleration = (d - 2.0 * c + b) / period_s.powi(2);
            let jerk = (d - 3.0 * c + 3.0 * b - a) / period_s.powi(3);
            for (limit, share) in [
                (Limit::Velocity, velocity.abs() / limits.velocity_mm_s),
                (
                    Limit::Acceleration,
                    acceleration.abs() / limits.acceleration_mm_s2,
                ),
                (Limit::Jerk, jerk.abs() / limits.jerk_mm_s3),
            ] {
                if share > most.2 {
                    most = (axis, limit, share);
                }
            }
        }
        most
    }

    /// What is asked for at a place, and the axis that bears no more there, if one does.
    fn asked(&self, element: &Element, distance_mm: f64) -> (f64, Option<usize>) {
        let mut asked_mm_s = match element.feed {
            Feed::PathMmS(feed_mm_s) => feed_mm_s,
            Feed::Rapid => f64::INFINITY,
        };
        let mut bound_by = None;
        let tangent = element.tangent(distance_mm);
        let kinematics = &self.limits.setpoints().kinematics;
        let tangent = kinematics.axes_tangent(&element.point(distance_mm), &tangent);
        for (axis, (along, limits)) in tangent.iter().zip(self.limits.axes()).enumerate() {
            let bearable_mm_s = limits.velocity_mm_s / along.abs();
            if bearable_mm_s < asked_mm_s {
                (asked_mm_s, bound_by) = (bearable_mm_s, Some(axis));
            }
        }
        (asked_mm_s, bound_by)
    }

    /// What all of it comes to.
    pub fn finish(self, path: &PathPart) -> TimeTable {
        let anchors = anchors(&self.causes(path));
        let period_s = self.limits.scan_period_s();
        let mut blocks = Blocks::of(path);
        let mut places: Vec<SlowPlace> = Vec::with_capacity(anchors.len());
        let mut begin = 0;
        for (index, anchor) in anchors.iter().enumerate() {
            let end = match anchors.get(index + 1) {
                Some(next) => self.fastest_between(anchor.last, next.first),
                None => self.scans.len(),
            };
            let Some(slowest) = self.scans.get(anchor.first) else {
                break;
            };
            let mut place = SlowPlace {
                line: slowest.line,
                speed_mm_s: slowest.speed_mm_s,
                asked_mm_s: slowest.asked_mm_s,
                cause: anchor.cause,
                time_s: 0.0,
                lost_s: 0.0,
            };
            for scan in begin..end {
                let Some(here) = self.scans.get(scan) else {
                    break;
                };
                let lost_s = period_s * (1.0 - (here.speed_mm_s / here.asked_mm_s).clamp(0.0, 1.0));
                place.time_s += period_s;
                place.lost_s += lost_s;
                let before = self.scans.get(scan.max(1) - 1).unwrap_or(here);
                blocks.add(path, [before, here], anchor.cause, (period_s, lost_s));
            }
            begin = end;
            places.push(place);
        }
        TimeTable {
            places,
            blocks: blocks.blocks,
        }
    }

    /// Behind the scan at which the tool is fastest between two.
    fn fastest_between(&self, from: usize, to: usize) -> usize {
        let between = self.scans.get(from..to).unwrap_or_default();
        let speeds = between.iter().map(|scan| scan.speed_mm_s);
        let fastest = speeds.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        (from + fastest.map_or(0, |(index, _)| index) + 1).min(to)
    }

    /// The cause at each scan that has one of its own.
    fn causes(&self, path: &PathPart) -> Vec<Option<Cause>> {
        let mut causes = vec![None; self.scans.len()];
        let mut falling = true;
        let mut lowest = 0;
        for (index, scan) in self.scans.iter().enumerate() {
            let before = self.scans.get(index.max(1) - 1).unwrap_or(scan);
            let own = self.as_fast_as_asked(scan);
            if falling && scan.speed_mm_s > before.speed_mm_s {
                // The speed was lowest from `lowest` up to the scan before.
                falling = false;
                self.name_lowest(path, lowest..index, &mut causes);
            }
            if own.is_some() || scan.speed_mm_s < before.speed_mm_s {
                falling = true;
                lowest = index;
            }
            if let Some(cause) = causes.get_mut(index) {
                *cause = own;
            }
        }
        if falling {
            self.name_lowest(path, lowest..self.scans.len(), &mut causes);
        }
        causes
    }

    /// Feed or an axis' highest speed, where the tool is as fast as that.
    fn as_fast_as_asked(&self, scan: &Scan) -> Option<Cause> {
        let is_as_fast = scan.speed_mm_s >= AS_FAST * scan.asked_mm_s;
        if !is_as_fast {
            return None;
        }
        Some(match scan.bound_by_axis {
            Some(axis) => Cause::Axis {
                axis,
                limit: Limit::Velocity,
                form: Form::Straight,
            },
            None => Cause::Feed,
        })
    }

    /// Names the cause of scans at which the speed is lowest, but for those that have one.
    fn name_lowest(
        &self,
        path: &PathPart,
        lowest: std::ops::Range<usize>,
        causes: &mut [Option<Cause>],
    ) {
        let cause = self.cause_near(path, lowest.clone());
        for of in causes.get_mut(lowest).into_iter().flatten() {
            *of = of.or(Some(cause));
        }
    }

    fn cause_near(&self, path: &PathPart, lowest: std::ops::Range<usize>) -> Cause {
        let Some(scan) = self.scans.get(lowest.start) else {
            return Cause::Braking;
        };
        let way_mm = scan.speed_mm_s * self.limits.scan_period_s();
        let near = lowest.start.saturating_sub(NEAR_SCANS)..lowest.end + NEAR_SCANS;
        let near = near.start..near.end.min(self.scans.len());
        let form = form_at(path, scan, way_mm);
        if scan.speed_mm_s <= 0.0 && !matches!(form, Form::Corner(_)) {
            return Cause::Rest;
        }
        let used = self.scans.get(near).unwrap_or_default().iter();
        let most = used
            .map(|scan| scan.used)
            .filter(|(_, limit, _)| *limit != Limit::Velocity)
            .max_by(|a, b| a.2.total_cmp(&b.2));
        match most {
            Some((axis, limit, share)) if share >= USED_MIN => Cause::Axis { axis, limit, form },
            _ => match self.bend_near(path, scan, way_mm) {
                Some(axis) => Cause::Axis {
                    axis,
                    limit: Limit::Jerk,
                    form: Form::Bend,
                },
                None => Cause::Braking,
            },
        }
    }

    /// The axis whose jerk a jump of the curvature near a place takes most of, if there is one.
    fn bend_near(&self, path: &PathPart, scan: &Scan, way_mm: f64) -> Option<usize> {
        let (before, after, away_mm) = junction_near(path, scan)?;
        // The lead keeps to the speed of a place wherever it is near enough (`smoothing`).
        let reach_scans = f64::from(self.limits.smoothing_scans()).max(2.0);
        if away_mm > reach_scans * way_mm {
            return None;
        }
        let jump = after.curvature_per_mm(0.0) - before.curvature_per_mm(before.length_mm);
        let shares = jump.iter().zip(self.limits.axes());
        let shares = shares.map(|(jump, limits)| jump.abs() / limits.jerk_mm_s3);
        let most = shares.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        most.filter(|(_, share)| *share > 0.0).map(|(axis, _)| axis)
    }
}

/// Scans, one behind the other, with one cause of their own.
struct Anchor {
    first: usize,
    last: usize,
    cause: Cause,
}

fn anchors(causes: &[Option<Cause>]) -> Vec<Anchor> {
    let mut anchors: Vec<Anchor> = Vec::new();
    for (index, cause) in causes.iter().enumerate() {
        let Some(cause) = *cause else { continue };
        match anchors.last_mut() {
            Some(last) if last.last + 1 == index && last.cause == cause => last.last = index,
            _ => anchors.push(Anchor {
                first: index,
                last: index,
                cause,
            }),
        }
    }
    anchors
}

/// The form of the path at a place that is passed at so many mm in a scan.
fn form_at(path: &PathPart, scan: &Scan, way_mm: f64) -> Form {
    let Some(element) = path.get(scan.element) else {
        return Form::Straight;
    };
    let per_mm = element.curvature_per_mm(scan.distance_mm).norm();
    if let Some((before, after, away_mm)) = junction_near(path, scan) {
        let end = before.shape.tangent(before.length_mm, before.length_mm);
        let start = after.shape.tangent(0.0, after.length_mm);
        let angle_rad = angle_between_rad(&end, &start);
        let corner_rad = path.limits().setpoints().rounding.corner_angle_rad;
        let left = before.tangent(before.length_mm) - after.tangent(0.0);
        let is_kink = left.norm() > KINK_MIN_RAD && away_mm <= 2.0 * way_mm + KINK_MIN_RAD;
        let is_rounded = per_mm > 0.0 && angle_rad >= corner_rad;
        if angle_rad > KINK_MIN_RAD && (is_kink || is_rounded) {
            return Form::Corner(angle_rad);
        }
    }
    if per_mm > 0.0 {
        Form::Curve(1.0 / per_mm)
    } else {
        Form::Straight
    }
}

/// The elements that meet nearest to a place, and how far away, in mm.
fn junction_near<'a>(path: &'a PathPart, scan: &Scan) -> Option<(&'a Element, &'a Element, f64)> {
    let element = path.get(scan.element)?;
    let from_end_mm = element.length_mm - scan.distance_mm;
    if from_end_mm <= scan.distance_mm {
        let after = path.get(scan.element.checked_add(1)?)?;
        Some((element, after, from_end_mm))
    } else {
        let before = path.get(scan.element.checked_sub(1)?)?;
        Some((before, element, scan.distance_mm))
    }
}

fn angle_between_rad(a: &path::geometry::AxisVector, b: &path::geometry::AxisVector) -> f64 {
    let size = a.norm() * b.norm();
    if size > 0.0 {
        libm::acos((a.dot(b) / size).clamp(-1.0, 1.0))
    } else {
        0.0
    }
}

/// The blocks of a path with their times.
struct Blocks {
    blocks: Vec<BlockTime>,
    /// What the cause of each block cost it, in s.
    costs_s: Vec<f64>,
    /// The block of each element.
    of_elements: Vec<usize>,
    first: u32,
}

impl Blocks {
    fn of(path: &PathPart) -> Self {
        let mut blocks: Vec<BlockTime> = Vec::new();
        let mut of_elements = Vec::new();
        let mut element = path.first();
        while let Some(on) = path.get(element) {
            if blocks.last().is_none_or(|last| last.line != on.line) {
                blocks.push(BlockTime {
                    line: on.line,
                    length_mm: 0.0,
                    time_s: 0.0,
                    asked_s: 0.0,
                    cause: Cause::Feed,
                });
            }
            if let Some(block) = blocks.last_mut() {
                block.length_mm += on.length_mm;
            }
            of_elements.push(blocks.len() - 1);
            element += 1;
        }
        Self {
            costs_s: vec![0.0; blocks.len()],
            blocks,
            of_elements,
            first: path.first(),
        }
    }

    /// Counts the scan between two setpoints, `(time, time lost)` in s, with the elements that are passed in it.
    fn add(
        &mut self,
        path: &PathPart,
        [before, here]: [&Scan; 2],
        cause: Cause,
        (time_s, lost_s): (f64, f64),
    ) {
        let place_mm = |scan: &Scan| path.length_before_mm(scan.element) + scan.distance_mm;
        let (from_mm, to_mm) = (place_mm(before), place_mm(here));
        for element in before.element..=here.element {
            let start_mm = path.length_before_mm(element);
            let end_mm = start_mm + path.get(element).map_or(0.0, |on| on.length_mm);
            let share = if to_mm > from_mm {
                (end_mm.min(to_mm) - start_mm.max(from_mm)).max(0.0) / (to_mm - from_mm)
            } else if element == here.element {
                1.0
            } else {
                0.0
            };
            let Some(&block) = self.of_elements.get((element - self.first) as usize) else {
                continue;
            };
            let (Some(block), Some(cost_s)) =
                (self.blocks.get_mut(block), self.costs_s.get_mut(block))
            else {
                continue;
            };
            block.time_s += share * time_s;
            block.asked_s += share * (time_s - lost_s);
            if lost_s > *cost_s {
                (block.cause, *cost_s) = (cause, lost_s);
            }
        }
    }
}

//! The rapids of a program that run from rest to rest, each with its profile and the rest its axes have after it.

use crate::geometry::{Element, Feed, PATH_AXES, Shape};
use crate::path_part::PathPart;
use crate::segment::Segment;

use super::profile::Profile;
use super::travel_time::{MotorLoad, travel_time_s};

/// Speed that a neighbour leaves a rapid at its end, as a share of the peak speed that constant acceleration would reach on a rapid, up to which its
/// neighbours force it to rest. A whole stop then costs at most a tenth of the time to speed up.
const STANDSTILL_SHARE: f64 = 0.1;

/// Positioning at least heat: what the motors have to move. Axes without a load are bound by their limits alone.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Positioning {
    /// Per axis.
    pub loads: [Option<MotorLoad>; PATH_AXES],
}

/// A rapid from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move {
    /// Index of its element.
    pub element: u32,
    /// How it is travelled at 100 %.
    pub profile: Profile,
    /// Rest of each axis from its end until that axis' next rapid, or the end of the program, in s: dwells, rapids of
    /// other axes, and cutting as far as friction leaves of it ([`MotorLoad::rest_share_at`]). 0 for axes that are at rest.
    pub rest_s: [f64; PATH_AXES],
    /// Root mean square of each motor's force over the move and that rest, as a share of its rating; 0 without a load.
    pub rms_share: [f64; PATH_AXES],
}

/// Whether an element can be a move of its own: a straight rapid.
pub(crate) fn is_straight_rapid(element: &Element) -> bool {
    matches!(
        (&element.shape, element.feed),
        (Shape::Line { .. }, Feed::Rapid)
    ) && element.length_mm > 0.0
}

/// Whether an end forces a rapid to rest: the speed it leaves is next to nothing of what the rapid would reach.
pub(crate) fn forces_rest(
    left_mm_s: f64,
    length_mm: f64,
    speed_mm_s: f64,
    acceleration_mm_s2: f64,
) -> bool {
    let reached_mm_s = speed_mm_s.min((acceleration_mm_s2 * length_mm).sqrt());
    left_mm_s <= STANDSTILL_SHARE * reached_mm_s
}

/// Gives each segment that is a whole rapid from rest to rest its profile; the moves in the order of the path, counted from
/// `first_move`.
///
/// From the end of the segments backward, as if the program ended there at rest for no time: the rest after a move is made of what comes after it, up to the next rapid of the
/// axis, so everything it depends on is known. Times of feeds are those of the speed map at `override_max` without the time to
/// speed up and brake: never longer than they are, so no motor is taken above its rating.
pub(crate) fn assign(
    part: &PathPart,
    positioning: &Positioning,
    override_max: f64,
    segments: &mut [Segment],
    first_move: usize,
) -> Vec<Move> {
    let scan_period_s = part.limits().scan_period_s();
    let mut rest_s = [0.0; PATH_AXES];
    let mut moves = Vec::new();
    for segment in segments.iter_mut().rev() {
        let Some(element) = part.get(segment.element) else {
            continue;
        };
        if segment.is_dwell {
            let dwell_s = f64::from(segment.dwell_scans) * scan_period_s;
            rest_s.iter_mut().for_each(|rest| *rest += dwell_s);
            continue;
        }
        let shares = axis_shares(element);
        let whole = segment.from_mm == 0.0 && segment.to_mm == element.length_mm;
        let profile = if segment.from_rest_to_rest && whole {
            profile_of(
                element,
                segment,
                positioning,
                &shares,
                &rest_s,
                scan_period_s,
            )
        } else {
            None
        };
        if let Some(profile) = profile {
            moves.push(of_axes(
                segment,
                profile,
                &rest_s,
                &shares,
                &positioning.loads,
            ));
        }
        let speed_mm_s = segment.cap_mm_s(override_max);
        let time_s = match &profile {
            Some(profile) => profile.travel_time_s,
            None if speed_mm_s > 0.0 => (segment.to_mm - segment.from_mm) / speed_mm_s,
            None => 0.0,
        };
        for ((rest, share), load) in rest_s.iter_mut().zip(&shares).zip(&positioning.loads) {
            if *share <= 0.0 {
                *rest += time_s;
            } else if element.feed == Feed::Rapid {
                *rest = 0.0;
            } else if let Some(load) = load {
                *rest += time_s * load.rest_share_at(share * speed_mm_s);
            }
        }
    }
    moves.reverse();
    refer_to(&moves, first_move, segments);
    moves
}

/// The profile of a rapid from rest to rest: as fast as limits and motors allow.
fn profile_of(
    element: &Element,
    segment: &Segment,
    positioning: &Positioning,
    shares: &[f64; PATH_AXES],
    rest_s: &[f64; PATH_AXES],
    scan_period_s: f64,
) -> Option<Profile> {
    let axes = shares.iter().zip(&positioning.loads).zip(rest_s);
    let loaded = axes.filter_map(|((share, load), rest)| {
        load.filter(|_| *share > 0.0)
            .map(|load| (*share, *rest, load))
    });
    let time_s = travel_time_s(
        element.length_mm,
        segment.speed_mm_s,
        segment.least_acceleration_mm_s2(),
        scan_period_s,
        loaded,
    );
    Profile::new(
        element.length_mm,
        time_s,
        segment.speed_mm_s,
        segment.least_acceleration_mm_s2(),
    )
}

/// Writes into each segment that is a move which one it is; `moves` in the order of the path, counted from `first_move`.
fn refer_to(moves: &[Move], first_move: usize, segments: &mut [Segment]) {
    let mut next = 0;
    for segment in segments.iter_mut() {
        let of_segment = moves.get(next).filter(|of| of.element == segment.element);
        if of_segment.is_some() {
            segment.of_move = Some((first_move + next) as u32);
            next += 1;
        }
    }
}

/// A move with what it means to each axis that takes part.
fn of_axes(
    segment: &Segment,
    profile: Profile,
    rest_s: &[f64; PATH_AXES],
    shares: &[f64; PATH_AXES],
    loads: &[Option<MotorLoad>; PATH_AXES],
) -> Move {
    let mut of_move = Move {
        element: segment.element,
        profile,
        rest_s: [0.0; PATH_AXES],
        rms_share: [0.0; PATH_AXES],
    };
    let of_axes = of_move.rest_s.iter_mut().zip(&mut of_move.rms_share);
    let given = rest_s.iter().zip(shares).zip(loads);
    for ((rest, rms_share), ((rest_s, share), load)) in of_axes.zip(given) {
        if *share <= 0.0 {
            continue;
        }
        *rest = *rest_s;
        let of_axis = Profile::new(
            share * profile.distance_mm,
            profile.travel_time_s,
            share * segment.speed_mm_s,
            share * segment.least_acceleration_mm_s2(),
        );
        if let (Some(load), Some(of_axis)) = (load, of_axis) {
            *rms_share = load.rms_share(&of_axis, *rest_s);
        }
    }
    of_move
}

/// Most of the path speed that each axis takes part with on an element.
fn axis_shares(element: &Element) -> [f64; PATH_AXES] {
    let mut shares = [0.0; PATH_AXES];
    match &element.shape {
        Shape::Line { .. } => {
            for (share, component) in shares.iter_mut().zip(&element.tangent(0.0)) {
                *share = component.abs();
            }
        }
        Shape::Arc { u, v, axial, .. } => {
            let components = u.iter().zip(v.iter()).zip(axial.iter());
            for (share, ((u, v), axial)) in shares.iter_mut().zip(components) {
                if *u != 0.0 || *v != 0.0 || *axial != 0.0 {
                    *share = 1.0;
                }
            }
        }
        Shape::Dwell { .. } => {}
    }
    shares
}

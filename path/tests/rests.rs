//! Places on a path where something happens: the motion rests there, and goes on when it is told to.

#![allow(clippy::expect_used)]

use path::geometry::{AxisVector, Element, Feed, Path};
use path::limits::{AxisLimits, MotionLimits};
use path::profile::PathState;
use path::window::{PlannedSetpoint, WindowPlanner, WindowRequest, WindowSettings};

const FEED: Feed = Feed::PathMmS(50.0);

fn at(x: f64) -> AxisVector {
    let mut vector = AxisVector::zeros();
    vector[0] = x;
    vector
}

fn planner(elements: Vec<Element>) -> WindowPlanner {
    let slide = AxisLimits {
        velocity_mm_s: 300.0,
        acceleration_mm_s2: 2000.0,
        jerk_mm_s3: f64::INFINITY,
        increment_mm: 1e-6,
    };
    let limits = MotionLimits::new(&[slide], 1e-3).expect("limits");
    let settings = WindowSettings {
        intended_setpoints_max: 64,
        braking_setpoints_max: 400,
        override_max: 1.0,
        elements_per_s_max: f64::INFINITY,
    };
    WindowPlanner::with_positioning(Path { elements }, limits, settings, None).expect("a planner")
}

/// Two pieces of a straight line, with a rest between them.
fn two(rest: bool) -> Vec<Element> {
    let mut elements = vec![
        Element::line(1, at(0.0), at(10.0), FEED),
        Element::line(2, at(10.0), at(20.0), FEED),
    ];
    elements[1].rests_before = rest;
    elements
}

/// Setpoints by windows of 16, until the end or until so many scans have passed.
fn walk(planner: &mut WindowPlanner, from: PathState, until_element: u32) -> Vec<PlannedSetpoint> {
    let mut request = WindowRequest {
        intended_setpoints: 16,
        repeats_start: true,
        until_element,
        ..WindowRequest::default()
    };
    let (mut from, mut all, mut window) = (from, Vec::new(), Vec::new());
    while all.len() < 2000 {
        let outcome = planner
            .plan(&from, &request, &mut window)
            .expect("a window");
        let intended = window.iter().take(outcome.intended_setpoints as usize);
        all.extend(intended.copied());
        for setpoint in &window {
            assert!(setpoint.state.element < until_element, "{setpoint:?}");
        }
        from = all.last().expect("a setpoint").state;
        request.repeats_start = false;
        if outcome.ends_program {
            break;
        }
    }
    all
}

#[test]
fn a_path_rests_where_something_happens_and_nowhere_else() {
    let slowest = |rest: bool| {
        let mut planner = planner(two(rest));
        let start = planner.start_state();
        let all = walk(&mut planner, start, u32::MAX);
        let near = |s: &&PlannedSetpoint| {
            let travelled = s.state.distance_mm + 10.0 * f64::from(s.state.element);
            (9.9..10.1).contains(&travelled)
        };
        let speeds = all.iter().filter(near).map(|s| s.state.speed_mm_s);
        speeds.fold(f64::INFINITY, f64::min)
    };
    assert!(slowest(false) > 49.0);
    assert!(slowest(true) < 2.0);
}

#[test]
fn what_is_held_back_stands_at_the_place_and_goes_on_as_if_it_had_not_been_held() {
    let mut planner = planner(two(true));
    let start = planner.start_state();
    let free = walk(&mut planner, start, u32::MAX);
    let held = walk(&mut planner, start, 1);
    assert_eq!(held.len(), 2000);
    let last = held.last().expect("a setpoint").state;
    assert_eq!((last.element, last.distance_mm), (0, 10.0));
    assert!(planner.is_held_back(&last, 1) && !planner.is_held_back(&last, 2));
    assert!(!planner.is_held_back(&start, 1));
    let up_to = |all: &[PlannedSetpoint]| {
        let first = all.iter().take_while(|s| s.state.element == 0);
        first.filter(|s| s.state.distance_mm < 10.0).count()
    };
    assert_eq!(up_to(&free), up_to(&held));
    let on = walk(&mut planner, last, u32::MAX);
    let end = |all: &[PlannedSetpoint]| all.last().map(|s| s.position_increments[0]);
    assert_eq!(end(&on), end(&free));
}

#[test]
fn the_end_and_the_start_of_a_path_hold_back_too() {
    let mut planner = planner(two(false));
    let start = planner.start_state();
    let all = walk(&mut planner, start, 2);
    assert_eq!(all.len(), 2000, "the program does not end");
    let last = all.last().expect("a setpoint").state;
    assert!(planner.is_end(&last) && planner.is_held_back(&last, 2));
    let all = walk(&mut planner, last, u32::MAX);
    assert_eq!(all.len(), 1, "it ends where it stands");

    let mut elements = two(false);
    elements.insert(0, Element::dwell(1, at(0.0), 0.1));
    elements[0].rests_before = true;
    let mut planner = self::planner(elements);
    let start = planner.start_state();
    assert_eq!(start.dwell_remaining_scans, 100);
    assert!(planner.is_held_back(&start, 0));
    let request = WindowRequest {
        intended_setpoints: 16,
        repeats_start: true,
        until_element: 0,
        ..WindowRequest::default()
    };
    let mut window = Vec::new();
    planner
        .plan(&start, &request, &mut window)
        .expect("a window");
    assert!(
        window.iter().all(|s| s.state == start),
        "the dwell waits too"
    );
    let all = walk(&mut planner, start, u32::MAX);
    let waits = all.iter().filter(|s| s.state.element == 0);
    assert_eq!(waits.count(), 101);
}

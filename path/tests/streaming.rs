//! A path that is read as it is travelled: the motion is that of the whole path, wherever reading begins and however it goes on.

use path::geometry::{AxisVector, Element, Feed, Path, PathTolerance};
use path::limits::{AxisLimits, MotionLimits};
use path::positioning::{MotorLoad, Positioning};
use path::profile::PathState;
use path::speed_map::{BLOCK_ELEMENTS, MARGIN_ELEMENTS, first_mapped};
use path::window::{
    Lead, PlanError, PlannedSetpoint, WindowPlanner, WindowRequest, WindowSettings,
};
use proptest::prelude::*;

/// With 60 setpoints to brake in, the speed is limited where the acceleration is low.
fn settings(short: bool, limits: &MotionLimits) -> WindowSettings {
    WindowSettings {
        intended_setpoints_max: 64,
        braking_setpoints_max: if short {
            60 + limits.smoothing_scans()
        } else {
            900
        },
        override_max: 1.5,
        elements_per_s_max: f64::INFINITY,
    }
}

fn at(x: f64, y: f64) -> AxisVector {
    let mut vector = AxisVector::zeros();
    (vector[0], vector[1]) = (x, y);
    vector
}

/// With a limit of jerk, or without.
fn limits(smooth: bool) -> MotionLimits {
    let slide = AxisLimits {
        velocity_mm_s: 300.0,
        acceleration_mm_s2: 2000.0,
        jerk_mm_s3: if smooth { 40_000.0 } else { f64::INFINITY },
        increment_mm: 1e-6,
    };
    MotionLimits::new(&[slide; 2], 1e-3).unwrap()
}

fn loads() -> Positioning {
    let mut positioning = Positioning::default();
    for load in positioning.loads.iter_mut().take(2) {
        *load = Some(MotorLoad::new(400.0, 100.0, 20.0, 20.0).unwrap());
    }
    positioning
}

/// A drawn curve of chords of random lengths, with corners, arcs, rapids, dwells and places of rest.
fn curve(seed: u64, count: usize) -> Vec<Element> {
    let mut state = seed | 1;
    let mut random = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as f64 / (1u64 << 31) as f64
    };
    let mut here = at(0.0, 0.0);
    let (mut angle_rad, mut turn_rad) = (0.0, 0.001);
    let mut elements: Vec<Element> = Vec::new();
    while elements.len() < count {
        let line = elements.len() as u32 / 3 + 1;
        let kind = random();
        if kind < 0.002 {
            elements.push(Element::dwell(line, here, 0.05 * random()));
            continue;
        }
        if kind < 0.01 {
            angle_rad += 3.0 * random();
        }
        if kind > 0.99 {
            turn_rad = 0.04 * (random() - 0.5);
        }
        angle_rad += turn_rad;
        let length_mm = if kind > 0.98 { 8.0 } else { 0.02 } * (0.1 + random());
        let there = here + at(libm::cos(angle_rad), libm::sin(angle_rad)) * length_mm;
        let feed = if kind > 0.985 {
            Feed::Rapid
        } else {
            Feed::PathMmS(5.0 + 200.0 * random())
        };
        let mut element = Element::line(line, here, there, feed);
        element.rests_before = kind > 0.45 && kind < 0.4505;
        elements.push(element);
        here = there;
    }
    elements
}

fn whole(
    elements: &[Element],
    limits: &MotionLimits,
    short: bool,
    positioning: Option<&Positioning>,
) -> WindowPlanner {
    let path = Path {
        elements: elements.to_vec(),
    };
    let settings = settings(short, limits);
    WindowPlanner::with_positioning(path, limits.clone(), settings, positioning).unwrap()
}

/// Reads `elements` from `next` on, `slice` at a time, while it travels; true when the end is reached.
fn travel(
    planner: &mut WindowPlanner,
    elements: &[Element],
    mut next: usize,
    slice: usize,
    from: PathState,
) -> Vec<PlannedSetpoint> {
    let (mut window, mut all) = (Vec::new(), Vec::<PlannedSetpoint>::new());
    let (mut state, mut starts, mut misses) = (from, true, 0);
    let mut leads: Vec<Lead> = Vec::new();
    loop {
        let request = WindowRequest {
            intended_setpoints: 8,
            repeats_start: starts,
            ..WindowRequest::default()
        };
        match planner.plan_behind(&state, &leads, &request, &mut window) {
            Ok(outcome) => {
                let intended = window.iter().take(outcome.intended_setpoints as usize);
                leads.extend(intended.map(|setpoint| setpoint.lead));
                all.extend(window.iter().take(outcome.intended_setpoints as usize));
                state = all.last().unwrap().state;
                (starts, misses) = (false, 0);
                if outcome.ends_program {
                    return all;
                }
            }
            Err(PlanError::NotAtHand) => {
                misses += 1;
                assert!(misses < 100_000, "{state:?}");
                read_on(planner, elements, &mut next, slice);
            }
            Err(error) => panic!("{error}"),
        }
        planner.forget_behind(state.element);
        let far = planner.path().end().saturating_sub(state.element);
        if far < 3 * MARGIN_ELEMENTS {
            read_on(planner, elements, &mut next, slice);
        }
    }
}

fn read_on(planner: &mut WindowPlanner, elements: &[Element], next: &mut usize, slice: usize) {
    for element in elements.iter().skip(*next).take(slice) {
        planner.push(element.clone()).unwrap();
    }
    *next = (*next + slice).min(elements.len());
    if *next == elements.len() {
        planner.finish();
    }
    planner.map_on();
}

fn same(found: &[PlannedSetpoint], expected: &[PlannedSetpoint]) {
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!(found, expected);
    }
    assert_eq!(found.len(), expected.len());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    #[test]
    fn a_path_that_is_read_in_slices_is_travelled_as_the_whole(
        seed in any::<u64>(),
        slice in 1usize..3000,
        at_least_heat in any::<bool>(),
        short in any::<bool>(),
        smooth in any::<bool>(),
    ) {
        let limits = limits(smooth);
        let mut elements = curve(seed, 12_000);
        for element in elements.iter_mut().filter(|_| smooth) {
            element.tolerance = PathTolerance { corner_mm: 0.02, ..PathTolerance::EXACT };
        }
        let loads = loads();
        let positioning = at_least_heat.then_some(&loads);
        let mut planner = whole(&elements, &limits, short, positioning);
        let start = planner.start_state();
        let expected = travel(&mut planner, &[], 0, 1, start);
        let settings = settings(short, &limits);
        let mut planner = WindowPlanner::of_part(limits, settings, positioning, 0, 0.0).unwrap();
        let found = travel(&mut planner, &elements, 0, slice, start);
        same(&found, &expected);
        let is_limited = planner.speed_map().speed_limited_by_window_mm_s().is_some();
        prop_assert!(smooth || short == is_limited);
        let at_hand = planner.path().end() - planner.path().first();
        prop_assert!(at_hand < 5 * MARGIN_ELEMENTS, "{at_hand} elements");
    }

    #[test]
    fn reading_that_begins_in_the_middle_goes_on_as_the_whole(
        seed in any::<u64>(),
        first in 1u32..4000,
        place in 0.0f64..1.0,
        short in any::<bool>(),
    ) {
        let limits = limits(false);
        let elements = curve(seed, 14_000);
        let mut planner = whole(&elements, &limits, short, None);
        let mapped = first_mapped(first);
        prop_assert!(mapped >= first + MARGIN_ELEMENTS && mapped.is_multiple_of(BLOCK_ELEMENTS));
        let element = mapped + (place * f64::from(13_000 - mapped)) as u32;
        let on = &elements[element as usize];
        let state = PathState {
            element,
            distance_mm: 0.5 * on.length_mm,
            ..PathState::default()
        };
        let expected = travel(&mut planner.clone(), &[], 0, 1, state);
        let start_mm = planner.path().length_before_mm(first);
        let settings = settings(short, &limits);
        planner = WindowPlanner::of_part(limits, settings, None, first, start_mm).unwrap();
        let found = travel(&mut planner, &elements, first as usize, 700, state);
        same(&found, &expected);
    }
}

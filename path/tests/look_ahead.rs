//! Elements of any length, from 1 nm to 10 m: no more of the path is ever known than a planner reads ahead of the tool, and that is enough everywhere.

use audit::SetpointAudit;
use path::geometry::{AxisVector, Element, Feed, Path, PathTolerance};
use path::limits::{AxisLimits, MotionLimits};
use path::profile::PathState;
use path::speed_map::{BLOCK_ELEMENTS, LOOK_AHEAD_ELEMENTS};
use path::window::{Lead, PlannedSetpoint, WindowPlanner, WindowRequest, WindowSettings};
use proptest::prelude::*;

use crate::size;

/// As the planner of a machine reads: so many elements ahead of the tool, of which so many in a period while it moves.
const AHEAD: u32 = 16_384;
const IN_MOTION: usize = 256;
const SCAN_S: f64 = 1e-3;
/// Scans of a period, and intended setpoints of a window.
const PERIOD: usize = 8;
const INTENDED: u32 = 32;

fn limits(smooth: bool) -> MotionLimits {
    let slide = AxisLimits {
        velocity_mm_s: 3000.0,
        acceleration_mm_s2: 20_000.0,
        jerk_mm_s3: if smooth { 2_000_000.0 } else { f64::INFINITY },
        increment_mm: 1e-6,
    };
    MotionLimits::new(&[slide; 2], SCAN_S).unwrap()
}

fn settings(limits: &MotionLimits) -> WindowSettings {
    let period_s = PERIOD as f64 * SCAN_S;
    let ahead_scans = f64::from(INTENDED + limits.smoothing_scans()) + 2.0 * PERIOD as f64;
    let known = f64::from(AHEAD - LOOK_AHEAD_ELEMENTS - 2 * BLOCK_ELEMENTS) - IN_MOTION as f64;
    WindowSettings {
        intended_setpoints_max: INTENDED,
        braking_setpoints_max: 900 + limits.smoothing_scans(),
        override_max: 1.2,
        elements_per_s_max: (0.75 * IN_MOTION as f64 / period_s)
            .min(known / (ahead_scans * SCAN_S)),
    }
}

/// Random numbers from 0 to 1.
fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed | 1;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as f64 / (1u64 << 31) as f64
    }
}

/// Runs of elements of one length or of all lengths, straight, curved or in any direction, with feeds, rapids, rests and dwells.
fn of_all_lengths(seed: u64, count: usize, tolerance: PathTolerance) -> Vec<Element> {
    let mut random = numbers(seed);
    let mut here = AxisVector::zeros();
    let mut angle_rad = 0.0;
    let mut elements: Vec<Element> = Vec::new();
    while elements.len() < count {
        let scale_mm = libm::pow(10.0, 10.0 * random() - 6.0);
        let spread = if random() < 0.3 { 10.0 } else { 0.3 };
        let turn_rad = [0.0, 0.01, 3.0][(3.0 * random()) as usize % 3];
        let feed = match random() {
            share if share < 0.1 => Feed::Rapid,
            share => Feed::PathMmS(1.0 + 1000.0 * share),
        };
        // A path of 10 m, or one element that is longer.
        let run_mm = 0.5 * 200.0 * random();
        let first_mm = here;
        let mut way_mm = 0.0;
        // Kinks that are so dense cost much time to map.
        let is_dense = turn_rad > 0.0 && scale_mm < 2e-3;
        let most = if is_dense { 300.0 } else { 9000.0 };
        for _ in 0..(most * random()) as usize + 1 {
            let line = elements.len() as u32 / 2 + 1;
            if random() < 1e-4 {
                elements.push(Element::dwell(line, here, 0.02 * random()));
            }
            let power = spread * (random() - 0.5);
            let length_mm = (scale_mm * libm::pow(10.0, power)).clamp(1e-6, 1e4);
            way_mm += length_mm;
            if way_mm > run_mm && here != first_mm {
                break;
            }
            angle_rad += turn_rad * (random() - 0.5);
            let mut there = here;
            there[0] += length_mm * libm::cos(angle_rad);
            there[1] += length_mm * libm::sin(angle_rad);
            let mut element = Element::line(line, here, there, feed);
            if element.length_mm <= 0.0 {
                continue;
            }
            element.tolerance = tolerance;
            element.rests_before = random() < 1e-4;
            elements.push(element);
            here = there;
        }
    }
    elements
}

/// A planner that has nothing of this path at hand yet.
struct Reading<'a> {
    planner: WindowPlanner,
    elements: &'a [Element],
}

impl<'a> Reading<'a> {
    fn new(elements: &'a [Element], limits: &MotionLimits) -> Self {
        let settings = settings(limits);
        let planner = WindowPlanner::of_part(limits.clone(), settings, None, 0, 0.0).unwrap();
        Self { planner, elements }
    }

    /// Reads on ahead of an element, so many at most.
    fn read_on(&mut self, element: u32, most: usize) {
        self.planner.forget_behind(element);
        let end = self.planner.path().end() as usize;
        let wanted = (element.saturating_add(AHEAD) as usize).min(self.elements.len());
        let to = wanted.min(end.saturating_add(most));
        if self.planner.path().is_complete() {
            return;
        }
        for element in self.elements.get(end..to).unwrap_or_default() {
            self.planner.push(element.clone()).unwrap();
        }
        if to == self.elements.len() {
            self.planner.finish();
        }
        self.planner.map_on();
    }
}

fn whole(elements: &[Element], limits: &MotionLimits) -> WindowPlanner {
    let path = Path {
        elements: elements.to_vec(),
    };
    WindowPlanner::with_positioning(path, limits.clone(), settings(limits), None).unwrap()
}

/// Executes a period of each window, as a cell does, and reads before each. All setpoints, up to so many.
fn travel(reading: &mut Reading<'_>, most: usize) -> Vec<PlannedSetpoint> {
    let mut state = reading.planner.start_state();
    let (mut window, mut all) = (Vec::new(), Vec::<PlannedSetpoint>::new());
    let mut leads: Vec<Lead> = Vec::new();
    let mut request = WindowRequest {
        intended_setpoints: INTENDED,
        repeats_start: true,
        ..WindowRequest::default()
    };
    while all.len() < most {
        let slice = if state.is_at_rest() {
            usize::MAX
        } else {
            IN_MOTION
        };
        reading.read_on(state.element, slice);
        let planned = reading
            .planner
            .plan_behind(&state, &leads, &request, &mut window);
        let outcome = planned.unwrap_or_else(|error| panic!("{error}: {state:?}"));
        request.repeats_start = false;
        let executed = window
            .iter()
            .take(PERIOD.min(outcome.intended_setpoints as usize));
        leads.extend(executed.clone().map(|setpoint| setpoint.lead));
        all.extend(executed);
        state = all.last().unwrap().state;
        if outcome.ends_program && outcome.intended_setpoints as usize <= PERIOD {
            break;
        }
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1))]

    #[test]
    fn what_a_planner_reads_ahead_is_enough_all_along_a_path_of_elements_of_any_length(
        seed in any::<u64>(),
        smooth in any::<bool>(),
    ) {
        let limits = limits(smooth);
        let corner_mm = if smooth { 0.02 } else { 0.0 };
        let tolerance = PathTolerance { corner_mm, ..PathTolerance::EXACT };
        let elements = of_all_lengths(seed, size::number("ELEMENTS", 18_000, 25_000) as usize, tolerance);
        let most = size::number("SETPOINTS", 8_000, 30_000) as usize;
        let (found, expected) = std::thread::scope(|scope| {
            let found = scope.spawn(|| travel(&mut Reading::new(&elements, &limits), most));
            let mut of_whole = Reading { planner: whole(&elements, &limits), elements: &[] };
            let expected = travel(&mut of_whole, most);
            (found.join().expect("a path that is read"), expected)
        });
        for (found, expected) in found.iter().zip(&expected) {
            prop_assert_eq!(found, expected);
        }
        prop_assert_eq!(found.len(), expected.len());
        let mut audit = SetpointAudit::at_rest(limits, found[0].position_increments);
        for setpoint in &found {
            let judged = audit.setpoint(&setpoint.position_increments);
            prop_assert!(judged.is_ok(), "{:?}: {:?}", judged, setpoint.state);
        }
    }

    #[test]
    fn from_every_place_of_it_motion_begins_at_once(
        seed in any::<u64>(),
        smooth in any::<bool>(),
        feed_override in 0.01..1.2f64,
    ) {
        let limits = limits(smooth);
        let elements = of_all_lengths(seed, size::number("ELEMENTS", 18_000, 25_000) as usize, PathTolerance::EXACT);
        let mut reading = Reading::new(&elements, &limits);
        let mut all = whole(&elements, &limits);
        let request = WindowRequest {
            intended_setpoints: INTENDED,
            feed_override,
            repeats_start: true,
            ..WindowRequest::default()
        };
        let (mut found, mut expected) = (Vec::new(), Vec::new());
        for element in (0..elements.len() as u32).step_by(size::number("APART", 6_657, 1_657) as usize) {
            reading.read_on(element, usize::MAX);
            let at_hand = reading.planner.path().end() - element;
            prop_assert!(at_hand <= AHEAD);
            prop_assert!(reading.planner.is_mapped(element), "element {element}");
            let state = PathState::resume(reading.planner.path(), element, 0.0, 0).unwrap();
            let outcome = reading.planner.plan(&state, &request, &mut found);
            prop_assert_eq!(&outcome, &all.plan(&state, &request, &mut expected));
            prop_assert!(outcome.is_ok(), "element {}: {:?}", element, outcome);
            prop_assert_eq!(&found, &expected);
        }
    }

    #[test]
    fn a_time_that_is_known_without_setpoints_is_that_of_the_setpoints(seed in any::<u64>()) {
        let limits = limits(false);
        let elements = of_all_lengths(seed, size::number("ELEMENTS", 5_000, 20_000) as usize, PathTolerance::EXACT);
        let mut planner = whole(&elements, &limits);
        let start = planner.start_state();
        let known_s = planner.time_to_end_s(&start, 1.0).unwrap();
        let mut reading = Reading { planner, elements: &[] };
        let found = travel(&mut reading, 200_000);
        let end = reading.planner.is_end(&found.last().unwrap().state);
        // Each wait ends at a scan.
        let waits = elements.iter().filter(|of| of.is_dwell() || of.rests_before).count();
        let found_s = found.len() as f64 * SCAN_S;
        let apart_s = (waits + 3) as f64 * SCAN_S;
        prop_assert!(!end || (found_s - known_s).abs() <= apart_s, "{known_s} s, {found_s} s");
    }
}

#[test]
fn chords_of_a_micrometre_are_travelled_at_the_speed_that_reading_keeps_up_with() {
    let limits = limits(false);
    let mut here = AxisVector::zeros();
    let chord = |n: u32| {
        let from = here;
        here[0] = 1e-3 * f64::from(n + 1);
        Element::line(n + 1, from, here, Feed::PathMmS(500.0))
    };
    let elements: Vec<Element> = (0..40 * BLOCK_ELEMENTS).map(chord).collect();
    let mut reading = Reading::new(&elements, &limits);
    let found = travel(&mut reading, 10_000);
    let fastest_mm_s = found
        .iter()
        .map(|of| of.state.speed_mm_s)
        .fold(0.0, f64::max);
    let kept_mm_s = 1e-3 * settings(&limits).elements_per_s_max;
    let told_mm_s = reading.planner.speed_limited_by_look_ahead_mm_s();
    for speed_mm_s in [fastest_mm_s, told_mm_s.expect("a limit that is told")] {
        let off_mm_s = speed_mm_s - kept_mm_s;
        assert!(off_mm_s.abs() < 1e-6 * kept_mm_s, "{speed_mm_s} mm/s");
    }
    assert!(reading.planner.is_end(&found.last().unwrap().state));
}
